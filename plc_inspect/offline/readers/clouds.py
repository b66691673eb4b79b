# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Reads point clouds from files, in metres."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import laspy
from numba import njit
import numpy as np
import pyproj
from pyproj.crs import CompoundCRS
from pyproj.exceptions import CRSError

from plc_inspect.core.ground.ground_surface import bounds
from plc_inspect.core.numerics.arrays import MOST_COORDINATE
from plc_inspect.errors import ConfigError, DataError
from plc_inspect.offline.readers.laz import erase_withheld, open_checked
from plc_inspect.offline.readers.plain_clouds import (
    count_plain_points,
    find_named_crs,
    is_plain,
    read_points,
    READERS,
)
from plc_inspect.offline.readers.plausibility import question_place, UNITS
from plc_inspect.printable import make_one_line
from plc_inspect.results import Float64, Int32

SUFFIXES = ('.las', '.laz', *READERS)

_UNIT_CODES = {9001: UNITS['m'], 9002: UNITS['ft'], 9003: UNITS['us-ft']}
"""
Metres in one unit, by its EPSG code in GeoTIFF keys.
Source: EPSG registry.
"""

MOST_FAR, MOST_FAR_SHARE = 100, 0.01
"""
Greatest number and share of points beyond MOST_COORDINATE that are strays.
Source: judgement: as core.extraction.stray_points; more mean a wrong unit or CRS.
"""

_PROJECTED_KEY, _HORIZONTAL_UNIT_KEY = 3072, 3076
_VERTICAL_SYSTEM_KEY, _VERTICAL_UNIT_KEY = 4096, 4099

_SAME_UNIT = 1e-5
"""
Relative difference up to which two units are the same.
Source: derived: the two feet differ by 2e-6, which no length of a line shows.
"""

_ROUNDING = 1e-9
"""
Difference up to which two units are one, written with more or fewer digits [m].
Source: numerical: WKT of a foot has 12 digits; the two feet differ by 6e-7.
"""
UNKNOWN_DATUM = 'unknown'
_HEIGHTS = (
    f'VERT_CS["heights",VERT_DATUM["{UNKNOWN_DATUM}",2005],UNIT["of z",{{unit!r}}],'
    'AXIS["Up",UP]]'
)
"""Heights of which the unit alone is known, as WKT."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cloud:
    """One cloud in metres, in the order of its file."""

    path: Path
    points: Float64
    """(N, 3) coordinates of the file times ``metres_per_unit`` [m]; a point of which any
    coordinate was not finite, or beyond MOST_COORDINATE, is NaN in all three, as is one with the
    withheld flag of LAS."""
    num_not_finite: int
    """Number of NaN points that are not withheld, including those beyond MOST_COORDINATE."""
    crs: str
    """Coordinate reference system as WKT, '' if neither file nor user gives one."""
    metres_per_unit: tuple[float, float]
    """Metres in one horizontal and one vertical unit of the file."""
    las: Any
    """The laspy.LasData with all attributes, None for other kinds of files."""
    note: str = ''
    """Assumptions about the coordinates, '' if none."""
    num_withheld: int = 0
    """Number of points with the withheld flag, which count as deleted."""


def read_cloud(
    path: Path | str, crs: str | None = None, unit: float | None = None
) -> Cloud:
    """
    Read a cloud, and convert its coordinates to metres.

    The units are those of the CRS: that of the argument, else that of the file; without a CRS,
    ``unit`` or metres.  A CRS without a vertical unit has the horizontal one.

    Parameters
    ----------
    path : Path or str
        A file whose name ends in one of SUFFIXES.
    crs : str or None
        CRS in place of the file's, as 'EPSG:2992' or WKT.
    unit : float or None
        Metres in one unit of a file without CRS; None: the unit in the file, else 1.

    Returns
    -------
    Cloud
        The cloud; 0 points are a valid cloud.

    Raises
    ------
    DataError
        The file is missing, truncated, damaged or of an unknown kind; its CRS is not in units of
        length; too many points lie beyond MOST_COORDINATE; or the coordinates cannot be lengths
        east, north and up.
    ConfigError
        ``crs`` is unknown, or ``unit`` is given for a file that has a CRS.

    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise DataError(f'{path} is not a cloud: its name must end in {", ".join(SUFFIXES)}')
    if not path.is_file():
        kind = 'is a folder' if path.is_dir() else 'is not a regular file'
        raise DataError(f'{path} {kind if path.exists() else "does not exist"}')
    given = None if crs is None else parse_crs(crs)
    if is_plain(path):
        las, points, num_withheld = None, read_points(path), 0
        given = given or find_plain_crs(path)
    else:
        las, points = load_las(path)
        num_withheld = erase_withheld(las.points, points)
    system, wkt, units = given, '', (1.0, 1.0)
    if system is not None:
        wkt, units = render_wkt(system), measure_units(system, path)
    elif las is not None:
        wkt, units = find_las_crs(las.header, path)
    units = choose_units(path, wkt, units, unit)
    num_not_finite, num_far, farthest = convert_to_metres(points, *units)
    if num_far > max(MOST_FAR, MOST_FAR_SHARE * len(points)):
        raise DataError(
            f'{path}: {num_far} of {len(points)} points have coordinates up to {farthest:.3g} m, '
            'which no coordinate reference system has'
        )
    note = ''
    if not wkt:
        low, high, num_finite = bounds(points)
        if num_finite:
            scale = np.array([units[0], units[0], units[1]])
            is_said = unit is not None or units[0] != 1.0
            note = question_place(str(path), low / scale, high / scale, units, is_said)
    return Cloud(
        path=path,
        points=points,
        num_not_finite=num_not_finite + num_far - num_withheld,
        crs=wkt,
        metres_per_unit=units,
        las=las,
        note=note,
        num_withheld=num_withheld,
    )


def count_points(path: Path) -> int:
    """
    Return how many points a file holds by its header, about how many if it is text.

    0 if its suffix is none of SUFFIXES; DataError if the header cannot be read.
    """
    if path.suffix.lower() not in SUFFIXES:
        return 0
    if is_plain(path):
        return count_plain_points(path)
    with open_checked(path) as reader:
        return int(reader.header.point_count)


def choose_units(
    path: Path, wkt: str, units: tuple[float, float], unit: float | None
) -> tuple[float, float]:
    """Return the units of a file; ConfigError if one is given but the CRS is known."""
    if unit is None:
        return units
    if wkt:
        raise ConfigError(f'--units is for clouds without a CRS: that of {path} is known')
    return unit, unit


def load_las(path: Path) -> tuple[laspy.LasData, Float64]:
    """
    Read a LAS or LAZ file unchanged.

    Parameters
    ----------
    path : Path
        A file that exists.

    Returns
    -------
    laspy.LasData
        All points with their attributes.
    (N, 3) float64
        Their coordinates, in the units of the file.

    Raises
    ------
    DataError
        The file cannot be read, is truncated or damaged.

    """
    with open_checked(path) as reader:
        las = reader.read()
    expected = las.header.point_count
    if len(las.points) != expected:
        raise DataError(
            f'{path} is truncated: {len(las.points)} points, its header says {expected}'
        )
    header = las.header
    return las, scale_grid(las.X, las.Y, las.Z, np.array(header.scales), np.array(header.offsets))


@njit(cache=True, nogil=True)
def scale_grid(x: Int32, y: Int32, z: Int32, scales: Float64, offsets: Float64) -> Float64:
    """Return the (N, 3) coordinates of the integers of a LAS file, in its units."""
    points = np.empty((len(x), 3), dtype=np.float64)
    for i in range(len(x)):
        points[i, 0] = x[i] * scales[0] + offsets[0]
        points[i, 1] = y[i] * scales[1] + offsets[1]
        points[i, 2] = z[i] * scales[2] + offsets[2]
    return points


@njit(cache=True, nogil=True)
def convert_to_metres(
    points: Float64, horizontal: float, vertical: float
) -> tuple[int, int, float]:
    """
    Convert to metres in place, and set points that are not finite or not on Earth to NaN.

    Return the number of points not finite and too far out, and the greatest coordinate of those.
    """
    not_finite, far, farthest = 0, 0, 0.0
    for i in range(len(points)):
        points[i, 0] *= horizontal
        points[i, 1] *= horizontal
        points[i, 2] *= vertical
        if not (
            np.isfinite(points[i, 0]) and np.isfinite(points[i, 1]) and np.isfinite(points[i, 2])
        ):
            points[i, :] = np.nan
            not_finite += 1
            continue
        largest = max(abs(points[i, 0]), abs(points[i, 1]), abs(points[i, 2]))
        if largest > MOST_COORDINATE:
            farthest = max(farthest, largest)
            points[i, :] = np.nan
            far += 1
    return not_finite, far, farthest


def parse_crs(text: str) -> pyproj.CRS:
    """Return a coordinate reference system by name; ConfigError if it is unknown."""
    try:
        return pyproj.CRS.from_user_input(text)
    except CRSError as error:
        raise ConfigError(f'unknown coordinate reference system {text!r}') from error


def find_plain_crs(path: Path) -> pyproj.CRS | None:
    """Return the CRS in a file other than LAS; DataError if it is unreadable."""
    text = find_named_crs(path)
    if not text:
        return None
    try:
        return pyproj.CRS.from_user_input(text)
    except CRSError as error:
        shown = make_one_line(text)[:120]
        raise DataError(f'{path} has an unreadable CRS (use --crs): {shown}') from error


def render_wkt(system: pyproj.CRS) -> str:
    """Return WKT 1, as LAS 1.4 requires, or WKT 2 if the system needs it."""
    try:
        return str(system.to_wkt('WKT1_GDAL'))
    except CRSError:
        return str(system.to_wkt())


def find_las_crs(header: laspy.LasHeader, path: Path) -> tuple[str, tuple[float, float]]:
    """Return the CRS and units of a LAS file, '' and metres by default."""
    try:
        system = header.parse_crs()
    except CRSError as error:
        text = make_one_line(error)[:120]
        raise DataError(f'{path} has an unreadable CRS (use --crs): {text}') from error
    keys = _read_unit_keys(header)
    if system is not None and not _has_wkt(header):
        _check_keys(system, header, path)
    if system is None:
        horizontal = keys.get(_HORIZONTAL_UNIT_KEY, 1.0)
        return '', (horizontal, keys.get(_VERTICAL_UNIT_KEY, horizontal))
    system = _add_vertical(system, header, keys.get(_VERTICAL_UNIT_KEY))
    units = measure_units(system, path)
    unit = keys.get(_VERTICAL_UNIT_KEY, units[1])
    if len(system.axis_info) == 2 and abs(unit - units[1]) > _ROUNDING:
        # what is written holds the system, not the keys
        system, units = add_heights(system, unit), (units[0], unit)
    return render_wkt(system), units


def add_heights(system: pyproj.CRS, unit: float) -> pyproj.CRS:
    """Return a horizontal CRS with heights of which the unit alone is known [m]."""
    heights = pyproj.CRS.from_wkt(_HEIGHTS.format(unit=unit))
    return CompoundCRS(f'{system.name} + {heights.name}', [system, heights])


def _check_keys(system: pyproj.CRS, header: laspy.LasHeader, path: Path) -> None:
    """Refuse GeoTIFF keys that do not say where the points are."""
    codes = [key.value_offset for key in _list_geo_keys(header) if key.id == _PROJECTED_KEY]
    if system.is_geographic and codes:
        raise DataError(
            f'{path}: its CRS is user-defined (GeoTIFF key {_PROJECTED_KEY} is {codes[0]}), based'
            f' on {system.name}: give --crs'
        )
    unit = _read_unit_keys(header).get(_HORIZONTAL_UNIT_KEY)
    if unit is None or system.is_geographic or system.is_geocentric:
        return
    metres, _ = measure_units(system, path)
    if abs(unit - metres) > _SAME_UNIT * metres:
        raise DataError(
            f'{path}: its GeoTIFF keys contradict: one unit of {system.name} is {metres:.6g} m, of'
            f' key {_HORIZONTAL_UNIT_KEY} {unit:.6g} m: give --crs'
        )


def _has_wkt(header: laspy.LasHeader) -> bool:
    """Tell whether the CRS is that of a WKT record, which goes before GeoTIFF keys."""
    records = [*header.vlrs, *(header.evlrs or [])]
    return any(isinstance(item, laspy.vlrs.known.WktCoordinateSystemVlr) for item in records)


def _add_vertical(
    system: pyproj.CRS, header: laspy.LasHeader, unit: float | None
) -> pyproj.CRS:
    """Return the CRS with the vertical one of the GeoTIFF keys, if units agree."""
    codes = [key.value_offset for key in _list_geo_keys(header) if key.id == _VERTICAL_SYSTEM_KEY]
    if len(system.axis_info) != 2 or not codes:
        return system
    try:
        heights = pyproj.CRS.from_epsg(codes[0])
        if not heights.is_vertical:
            return system
        metres = heights.axis_info[0].unit_conversion_factor
        if unit is not None and abs(metres - unit) > _ROUNDING:
            return system
        return CompoundCRS(f'{system.name} + {heights.name}', [system, heights])
    except CRSError:  # a user's own, or the number of a datum
        return system


def _list_geo_keys(header: laspy.LasHeader) -> list[Any]:
    records = [*header.vlrs, *(header.evlrs or [])]
    return [key for record in records for key in getattr(record, 'geo_keys', ())]


def _read_unit_keys(header: laspy.LasHeader) -> dict[int, float]:
    """Return the GeoTIFF unit keys of a LAS file, in metres."""
    return {
        key.id: _UNIT_CODES[key.value_offset]
        for key in _list_geo_keys(header)
        if key.id in (_HORIZONTAL_UNIT_KEY, _VERTICAL_UNIT_KEY)
        and key.value_offset in _UNIT_CODES
    }


def measure_units(system: pyproj.CRS, path: Path) -> tuple[float, float]:
    """Return the metres in one horizontal and one vertical unit of a CRS, whose z is up."""
    if system.is_geographic or system.is_geocentric:
        raise DataError(
            f'{path}: coordinates in {system.name} are not lengths east, north and up; '
            'project the cloud first'
        )
    if any(axis.direction == 'down' for axis in system.axis_info):
        raise DataError(
            f'{path}: z of {system.name} points down: turn its sign, and give --crs with heights'
        )
    flat = [axis for axis in system.axis_info if axis.direction != 'up']
    up = [axis for axis in system.axis_info if axis.direction == 'up']
    if up and not flat:
        raise DataError(f'{path}: {system.name} is a system of heights alone: give a whole one')
    horizontal = float(flat[0].unit_conversion_factor) if flat else 1.0
    vertical = float(up[0].unit_conversion_factor) if up else horizontal
    return horizontal, vertical
