# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""GeoJSON, KML and GeoPackage of a run whose coordinate reference system is known."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
import math
import os
from pathlib import Path
from typing import Any
from xml.etree import ElementTree  # nosec B405

import numpy as np
from numpy.typing import NDArray
import pyogrio
import pyproj
from pyproj.exceptions import CRSError, ProjError
import shapely

from plc_inspect.colors import LOOKS
from plc_inspect.errors import DataError
from plc_inspect.offline.readers.clouds import render_wkt
from plc_inspect.offline.records.georeference import find_horizontal, find_whole
from plc_inspect.offline.records.inspection import flatten, Inspection
from plc_inspect.offline.records.sentences import find_measured
from plc_inspect.offline.records.span_curve import TOLERANCE, trace_span
from plc_inspect.offline.records.units import Record, Units

FILE_DATE = '2000-01-01T00:00:00.000Z'
"""Fixed file time, so that the same results give the same bytes."""

LINES = 'spans', 'coverage'
"""Layers of lines; the others are of points."""

Layers = dict[str, tuple[list[Any], list[Record]]]
"""Name of a layer to its geometries, in the frame of the input, and their attributes."""


def write_geo(folder: Path, inspection: Inspection, records: dict[str, list[Record]]) -> bool:
    """
    Write spans, supports and hazards for geographic information systems.

    GeoJSON and KML are in longitude and latitude (WGS 84) with heights in metres; the GeoPackage
    keeps the coordinates of the input.

    Parameters
    ----------
    folder : Path
        Where; files of these names must not exist.
    inspection : Inspection
        The run.
    records : dict
        'spans', 'supports' and 'hazards' as their JSON files hold them.

    Returns
    -------
    bool
        False where nothing was written because the CRS is unknown.

    Raises
    ------
    DataError
        The coordinates are outside the CRS.

    """
    system = find_horizontal(inspection)
    if system is None:
        return False
    pyogrio.set_gdal_config_options({'OGR_CURRENT_DATE': FILE_DATE})
    layers = make_layers(inspection, records)
    world = write_geojson(folder, layers, system, inspection)
    plain = find_whole(inspection) or system.to_wkt()
    for name, (shapes, rows) in layers.items():
        write_layer(folder / 'results.gpkg', 'GPKG', name, shapes, rows, plain)
    _write_kml(folder / 'results.kml', world, layers, inspection.units)
    return True


def write_geojson(
    folder: Path, layers: Layers, system: pyproj.CRS, inspection: Inspection
) -> dict[str, list[Any]]:
    """
    Write each layer into a file of its name.

    Parameters
    ----------
    folder : Path
        Where; files of these names must not exist.
    layers : dict
        In the frame and units of the input.
    system : pyproj.CRS
        Of the input.
    inspection : Inspection
        The run.

    Returns
    -------
    dict
        Name of a layer to its geometries in longitude, latitude and metres.

    Raises
    ------
    DataError
        The coordinates are outside the CRS.

    """
    try:
        world = to_world(layers, system, inspection)
    except ProjError as error:
        raise DataError(f'coordinates are outside {system.name}: {error}') from error
    for name, (_, rows) in layers.items():
        write_layer(folder / f'{name}.geojson', 'GeoJSON', name, world[name], rows, 'EPSG:4326',
                    RFC7946='YES', COORDINATE_PRECISION='9')
    return world


def make_layers(inspection: Inspection, records: dict[str, list[Record]]) -> Layers:
    """Return spans, supports and hazards as geometries with attributes."""
    units = inspection.units
    tolerance, ratio = TOLERANCE / units.horizontal, units.horizontal / units.vertical
    points = {
        name: [shapely.Point(row['position']) for row in records[name]]
        for name in ('supports', 'hazards')
    }
    return {
        'spans': (
            [shapely.LineString(trace_span(row, tolerance, ratio)) for row in records['spans']],
            [flatten(row) for row in records['spans']],
        ),
        'supports': (points['supports'], [
            flatten(row) | {'lines': ' '.join(map(str, row['lines']))}
            for row in records['supports']
        ]),
        'hazards': (points['hazards'], [flatten(row) for row in records['hazards']]),
    }


def to_world(
    layers: Layers, system: pyproj.CRS, inspection: Inspection
) -> dict[str, list[Any]]:
    """Return geometries in longitude, latitude and metres; ProjError where they have none."""
    transformer = pyproj.Transformer.from_crs(system, 'EPSG:4326', always_xy=True)
    height = inspection.units.vertical

    def move(xyz: NDArray[np.float64]) -> NDArray[np.float64]:
        x, y = transformer.transform(xyz[:, 0], xyz[:, 1], errcheck=True)
        return np.column_stack([x, y, xyz[:, 2] * height + inspection.altitude])

    return {
        name: [_cut(shape) for shape in shapely.transform(shapes, move, include_z=True)]
        if shapes else []
        for name, (shapes, _) in layers.items()
    }


def _cut(shape: Any) -> Any:
    """Cut a line at the antimeridian, where GDAL would write latitudes as heights."""
    places = shapely.get_coordinates(shape, include_z=True)
    at = 1 + np.flatnonzero(np.abs(np.diff(places[:, 0])) > 180.0)
    parts = np.split(places, at)
    for number in range(len(at)):
        before, after = parts[number : number + 2]
        edge = math.copysign(180.0, before[-1, 0])
        near = np.array([before[-1], after[0]])
        near[1, 0] += 2 * edge
        share = (edge - near[0, 0]) / (near[1, 0] - near[0, 0])
        middle = near[0] + share * (near[1] - near[0])
        middle[0] = edge
        parts[number] = np.vstack([before, middle])
        middle[0] = -edge
        parts[number + 1] = np.vstack([middle, after])
    return shapely.MultiLineString(parts) if len(at) else shape


def write_layer(
    path: Path, driver: str, layer: str, shapes: Sequence[Any], rows: Sequence[Record], crs: str,
    **options: str,
) -> None:
    """Add a layer to a file."""
    columns = _columns(rows)
    with name_plainly(path) as place:
        pyogrio.raw.write(
            place,
            geometry=np.array([shapely.to_wkb(shape, output_dimension=3) for shape in shapes],
                              dtype=object),
            field_data=list(columns.values()),
            fields=np.array(list(columns), dtype=object),
            geometry_type='LineString Z' if layer in LINES else 'Point Z',
            crs=name_system(crs), driver=driver, layer=layer, layer_options=options or None,
        )


def name_system(crs: str) -> str:
    """
    Return the name of a CRS, as 'EPSG:2193', where it is that of its authority; else itself.

    In WKT 1, which LAS needs, x is east also where the authority begins with north; GDAL takes
    that for a system of another definition.
    """
    system = pyproj.CRS.from_user_input(crs)
    own = system.to_json_dict().get('id')
    if own is None:
        return crs
    try:
        official = pyproj.CRS.from_authority(own['authority'], own['code'])
    except CRSError:
        return crs
    is_official = pyproj.CRS.from_wkt(render_wkt(official)) == system
    return f'{own["authority"]}:{own["code"]}' if is_official else crs


@contextmanager
def name_plainly(path: Path) -> Iterator[str]:
    """Yield a name of a file that pyogrio takes for one; what is before '!' were an archive."""
    if '!' not in str(path.absolute()):
        yield str(path.absolute())
        return
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        yield f'/proc/self/fd/{folder}/{path.name}'
    finally:
        os.close(folder)


def _columns(rows: Sequence[Record]) -> dict[str, NDArray[Any]]:
    """Return the attributes as arrays of one type each; null is NaN."""
    if not rows:
        return {}
    columns: dict[str, NDArray[Any]] = {}
    for name in rows[0]:
        values = [row[name] for row in rows]
        known = [value for value in values if value is not None]
        if any(isinstance(value, str) for value in known):
            columns[name] = np.array(values, dtype=object)
        elif known and all(isinstance(value, bool) for value in known):
            columns[name] = np.array(values, dtype=bool)
        elif known and len(known) == len(values) and all(isinstance(v, int) for v in known):
            columns[name] = np.array(values, dtype=np.int64)
        else:
            columns[name] = np.array(
                [np.nan if value is None else value for value in values], dtype=np.float64
            )
    return columns


def _write_kml(
    path: Path, world: dict[str, list[Any]], layers: Layers, units: Units
) -> None:
    """Write all layers into one, as KML has no attributes other than name and description."""
    shapes, names, texts = [], [], []
    for layer, (_, rows) in layers.items():
        for shape, row in zip(world[layer], rows, strict=True):
            shapes.append(shapely.to_wkb(shape, output_dimension=3))
            name, text = _describe(layer, row, units)
            names.append(name)
            texts.append(text)
    with name_plainly(path) as place:
        pyogrio.raw.write(
            place, geometry=np.array(shapes, dtype=object),
            field_data=[np.array(names, dtype=object), np.array(texts, dtype=object)],
            fields=np.array(['Name', 'Description'], dtype=object), geometry_type='Unknown',
            crs='EPSG:4326', driver='KML', layer='results',
            dataset_options={'AltitudeMode': 'absolute'},
        )
    _color_kml(path, [row['severity'] for row in layers['hazards'][1]])


def _color_kml(path: Path, severities: Sequence[str]) -> None:
    """Colour the hazards, which come last, by severity; GDAL writes no colours."""
    space = '{http://www.opengis.net/kml/2.2}'
    ElementTree.register_namespace('', space[1:-1])
    tree = ElementTree.parse(path)  # nosec B314 (written just now)
    document = tree.getroot()[0]
    for number, (name, look) in enumerate(LOOKS.items()):
        red, green, blue = look.color[1:3], look.color[3:5], look.color[5:7]
        style = ElementTree.Element(f'{space}Style', id=name)
        for kind in ('IconStyle', 'LabelStyle'):
            item = ElementTree.SubElement(style, f'{space}{kind}')
            ElementTree.SubElement(item, f'{space}color').text = f'ff{blue}{green}{red}'
        document.insert(number, style)
    marks = list(tree.iter(f'{space}Placemark'))
    for mark, severity in zip(marks[len(marks) - len(severities):], severities, strict=True):
        url = ElementTree.Element(f'{space}styleUrl')
        url.text = f'#{severity}'
        mark.insert(2, url)
    tree.write(path, encoding='utf-8', xml_declaration=True)


def _describe(layer: str, row: Record, units: Units) -> tuple[str, str]:
    """Return name and description of one thing, in units of the input."""
    unit = units.name
    if layer == 'spans':
        return (f'line {row["line_id"]}, span {row["span_id"]}',
                f'length {row["length"]:.1f} {unit}, sag {row["sag"]:.2f} {unit}')
    if layer == 'supports':
        return (f'support {row["support_id"]}',
                f'{row["kind"]}, height {row["height"] or 0:.1f} {units.vertical_name}')
    measured, way = find_measured(row)
    return (f'{row["severity"]} {row["kind"]} {row["hazard_id"]}',
            f'line {row["line_id"]}, span {row["span_id"]}: {measured:.2f} {unit} measured{way},'
            f' {row["required"]:.2f} {unit} required by {row["rule"]} ({row["edition"]})')
