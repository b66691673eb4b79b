# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Coverage and the planned flight as GeoJSON, and a plan for QGroundControl."""

from pathlib import Path

import numpy as np
import pyproj
import shapely

from plc_inspect.offline.export.geo import Layers, write_geojson
from plc_inspect.offline.records.coverage_record import describe_coverage, Sight
from plc_inspect.offline.records.georeference import (
    find_height_datum,
    find_horizontal,
    HeightDatum,
)
from plc_inspect.offline.records.inspection import Inspection
from plc_inspect.offline.records.units import Record

SPEED = 6.0
"""Speed of the planned flight [m/s].  Source: judgement: bench/studies/coverage.py does."""
MAV_CMD_NAV_WAYPOINT, MAV_FRAME_GLOBAL, ABSOLUTE = 16, 0, 2
"""Of MAVLink, common.xml: a waypoint, its altitude above mean sea level; so in QGroundControl."""


def write_coverage_views(folder: Path, inspection: Inspection, sight: Sight) -> bool:
    """
    Write ``coverage.geojson`` and ``refly.geojson``.

    Parameters
    ----------
    folder : Path
        Where; files of these names must not exist.
    inspection : Inspection
        The run.
    sight : Sight
        Its coverage.

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
    record = describe_coverage(sight, inspection.units)
    write_geojson(folder, _make_layers(inspection, record, sight), system, inspection)
    return True


def make_plan(inspection: Inspection, sight: Sight) -> Record | None:
    """Return a plan for QGroundControl, None where the CRS tells no place or no altitude."""
    system = find_horizontal(inspection)
    if system is None or find_height_datum(inspection) == HeightDatum.ELLIPSOID:
        return None  # the sea is up to 100 m above or below the ellipsoid
    transformer = pyproj.Transformer.from_crs(system, 'EPSG:4326', always_xy=True)
    places = inspection.units.from_metres(sight.refly.places)
    longitude, latitude = transformer.transform(places[:, 0], places[:, 1])
    altitude = sight.refly.places[:, 2] + inspection.altitude
    rows = np.column_stack([latitude, longitude, altitude]).tolist()
    return {
        'fileType': 'Plan', 'version': 1, 'groundStation': 'QGroundControl',
        'geoFence': {'version': 2, 'circles': [], 'polygons': []},
        'rallyPoints': {'version': 2, 'points': []},
        'mission': {
            'version': 2, 'firmwareType': 12, 'vehicleType': 2, 'globalPlanAltitudeMode': ABSOLUTE,
            'cruiseSpeed': SPEED, 'hoverSpeed': SPEED,
            'plannedHomePosition': rows[0] if rows else [0.0, 0.0, 0.0],
            'items': [
                {
                    'type': 'SimpleItem', 'command': MAV_CMD_NAV_WAYPOINT,
                    'frame': MAV_FRAME_GLOBAL, 'doJumpId': number + 1, 'autoContinue': True,
                    'params': [0, 0, 0, None, *row], 'Altitude': row[2],
                    'AltitudeMode': ABSOLUTE, 'AMSLAltAboveTerrain': None,
                } for number, row in enumerate(rows)
            ],
        },
    }


def _make_layers(inspection: Inspection, record: Record, sight: Sight) -> Layers:
    """Return sections and gaps as lines, waypoints as points, in the units of the input."""
    units = inspection.units
    lines, rows = [], []
    for item, section in zip(record['sections'], sight.coverage.sections, strict=True):
        span = section.section.spans[0]
        x = np.linspace(0.0, span.length, 9)
        lines.append(shapely.LineString(units.from_metres(span.positions(x))))
        rows.append({
            'kind': 'section', 'span_id': item['span_id'], 'line_id': -1, 'part': 'all',
            'length': span.length / units.horizontal, 'verdict': item['verdict'],
        })
    for gap in record['gaps']:
        lines.append(shapely.LineString(gap['line']))
        rows.append({
            'kind': 'gap', 'span_id': gap['span_id'], 'line_id': gap['line_id'],
            'part': gap['part'], 'length': gap['length'],
            'verdict': record['sections'][sight.coverage.gaps[gap['gap_id']].section]['verdict'],
        })
    waypoints = record['refly']['waypoints']
    return {
        'coverage': (lines, rows),
        'refly': (
            [shapely.Point(row['position']) for row in waypoints],
            [
                {name: row[name] for name in ('number', 'kind', 'run', 'span_id', 'side')}
                for row in waypoints
            ],
        ),
    }
