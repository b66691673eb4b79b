# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The coordinate reference system of a run."""

import enum

import pyproj
from pyproj.exceptions import CRSError

from plc_inspect.errors import ConfigError
from plc_inspect.offline.readers.clouds import UNKNOWN_DATUM
from plc_inspect.offline.records.inspection import Inspection


class HeightDatum(enum.Enum):
    """What the heights of a run are above."""

    SEA = 'the sea'
    ELLIPSOID = 'the ellipsoid'
    UNKNOWN = 'an unknown surface'


def make_origin_crs(latitude: float, longitude: float) -> str:
    """
    Return the CRS of a flight whose frame has its origin at a known place, as WKT.

    x is east and y north (REP-103): a transverse Mercator about the origin, in metres.

    Parameters
    ----------
    latitude, longitude : float
        Of the origin, WGS 84 [degrees].

    Returns
    -------
    str

    Raises
    ------
    ConfigError
        Latitude or longitude is out of range.

    """
    if not (-84.0 <= latitude <= 84.0 and -180.0 <= longitude <= 180.0):
        raise ConfigError(
            f'origin {latitude:g}, {longitude:g} must be a latitude within 84 degrees and a'
            ' longitude within 180'
        )
    return str(pyproj.CRS.from_dict({
        'proj': 'tmerc', 'lat_0': latitude, 'lon_0': longitude, 'k': 1, 'x_0': 0, 'y_0': 0,
        'datum': 'WGS84', 'units': 'm', 'type': 'crs',
    }).to_wkt())


def find_horizontal(inspection: Inspection) -> pyproj.CRS | None:
    """Return the horizontal CRS of the coordinates, None where it is unknown."""
    return parse_horizontal(inspection.crs or inspection.georeference)


def require_horizontal(name: str, wkt: str) -> None:
    """Raise ConfigError where the horizontal CRS of an input is unknown."""
    if parse_horizontal(wkt) is None:
        raise ConfigError(
            f'{name} has no projected coordinate reference system: give one (--crs for a cloud,'
            ' --origin for a flight)'
        )


def parse_horizontal(wkt: str) -> pyproj.CRS | None:
    """Return the horizontal part of a CRS, None where that is '' or not projected."""
    if not wkt:
        return None
    try:
        system = pyproj.CRS.from_wkt(wkt)
    except CRSError:
        return None
    if system.is_compound:
        system = system.sub_crs_list[0]
    return system if system.is_projected else None


def find_height_datum(inspection: Inspection) -> HeightDatum:
    """Return what the heights of a run are above, by its CRS, or by the origin of its flight."""
    if not inspection.crs and inspection.georeference:
        return HeightDatum.SEA
    try:
        system = pyproj.CRS.from_wkt(inspection.crs)
    except CRSError:
        return HeightDatum.UNKNOWN
    if system.is_compound:
        datum = system.sub_crs_list[-1].datum
        is_unknown = datum is not None and datum.name == UNKNOWN_DATUM
        return HeightDatum.UNKNOWN if is_unknown else HeightDatum.SEA
    return HeightDatum.UNKNOWN if len(system.axis_info) < 3 else HeightDatum.ELLIPSOID


def find_whole(inspection: Inspection) -> str:
    """Return the WKT of a CRS with a vertical part, '' for one without."""
    wkt = inspection.crs or inspection.georeference
    try:
        system = pyproj.CRS.from_wkt(wkt) if wkt else None
    except CRSError:
        return ''
    return wkt if system is not None and system.is_compound else ''
