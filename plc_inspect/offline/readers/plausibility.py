# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Checks that coordinates without a CRS can be lengths east, north and up."""

from collections.abc import Sequence
import math
from pathlib import Path
from typing import Any

import numpy as np

from plc_inspect.errors import ConfigError, DataError
from plc_inspect.results import Float64

UNITS = {'m': 1.0, 'ft': 0.3048, 'us-ft': 1200.0 / 3937.0}
"""
Metres in one unit, by name.
Source: EPSG registry: the metre, the international foot and that of the US surveys.
"""
DEGREES_EXTENT, DEGREES_RATIO = 1.0, 5.0
"""
Width below which a cloud this many times as high is in degrees, if x and y are within 180.
Source: derived: a degree is 111 km; no line is 5 m high and less than 1 m long.
"""
LOWEST, HIGHEST = -12_000.0, 9_000.0
"""Range of heights on Earth [m].  Source: derived: the deepest trench, the highest mountain."""
EARTH_RADII = 6.33e6, 6.40e6
"""Range of distances from the Earth's centre [m].  Source: derived: WGS 84 and mountains."""
UTM_EAST = 1e6
"""Upper bound of UTM eastings [m].  Source: derived: they are 167 km to 833 km."""

COARSEST = 0.02
"""
Greatest step of coordinates in single precision [units of the file].
Source: derived: the diameter of a conductor.
"""


def parse_unit(name: str | None) -> float | None:
    """Return the metres in a unit by name, None for None; ConfigError if it is unknown."""
    if name is None:
        return None
    if name not in UNITS:
        raise ConfigError(f'--units must be one of {", ".join(UNITS)}, got {name!r}')
    return UNITS[name]


def question_place(
    name: str, low: Sequence[float], high: Sequence[float], units: tuple[float, float],
    is_said: bool,
) -> str:
    """
    Check whether coordinates without a CRS can be lengths east, north and up.

    Parameters
    ----------
    name : str
        Name of the input.
    low, high : sequence of float
        Least and greatest x, y and z, in units of the input.
    units : tuple of float
        Metres in one unit of x and y, and in one of z.
    is_said : bool
        False if that of x and y is assumed.

    Returns
    -------
    str
        The unit assumed and why that may be wrong, and that z may point down; '' if neither.

    Raises
    ------
    DataError
        They are degrees, geocentric, or z is no height on Earth.

    """
    horizontal, vertical = units
    wide = max(high[0] - low[0], high[1] - low[1])
    tall = high[2] - low[2]
    place = f'x {low[0]:.6g} to {high[0]:.6g}, y {low[1]:.6g} to {high[1]:.6g}'
    if (
        0.0 < wide < DEGREES_EXTENT and tall > DEGREES_RATIO * wide
        and max(map(abs, (low[0], high[0]))) <= 180.0
        and max(map(abs, (low[1], high[1]))) <= 180.0
    ):
        raise DataError(
            f'{name}: {place} are degrees, as z spans {tall:.4g}: project the cloud to lengths '
            'east and north first'
        )
    scales = (horizontal, horizontal, vertical)
    middle = [(a + b) / 2 * scale for a, b, scale in zip(low, high, scales, strict=True)]
    radius = math.hypot(*middle)
    if low[2] * vertical > HIGHEST or high[2] * vertical < LOWEST:
        if EARTH_RADII[0] <= radius <= EARTH_RADII[1]:
            raise DataError(
                f'{name}: {place}, z {low[2]:.6g} to {high[2]:.6g} lie {radius / 1000:.0f} km from'
                ' the origin, as geocentric coordinates do: project the cloud first'
            )
        raise DataError(
            f'{name}: z from {low[2]:.6g} to {high[2]:.6g} is not a height on Earth in '
            f'{"metres" if vertical == 1.0 else "that unit"}: give --units or --crs, or correct z'
        )
    notes = []
    if not is_said:
        other = '' if vertical == horizontal else (
            f' for x and y, z is in units of {vertical:.6g} m by its GeoTIFF key'
        )
        notes.append(f'{name} has no coordinate reference system: metres assumed{other}')
        if max(abs(low[0]), abs(high[0])) > UTM_EAST:
            notes.append(
                f'x of {high[0]:.6g} may be feet: then give --units ft or us-ft, or --crs'
            )
    if high[2] < 0.0:
        notes.append(
            f'{"" if notes else f"{name}: "}z from {low[2]:.6g} to {high[2]:.6g} is below 0'
            ' throughout: if it points down, turn its sign'
        )
    return '; '.join(notes)


def check_precision(path: Path, points: Float64, kinds: Sequence[Any]) -> None:
    """
    Refuse coordinates that are too coarse in single precision.

    Points beyond MOST_COORDINATE are left to others.

    Parameters
    ----------
    path : Path
        The file.
    points : (N, 3) float64
        Its coordinates.
    kinds : sequence of 3 dtypes
        Type of x, y and z in the file, of either byte order.

    Raises
    ------
    DataError
        Those in single precision are so large that their steps exceed COARSEST.

    """
    from plc_inspect.core.numerics.arrays import MOST_COORDINATE  # with numba, which --help lacks

    single = [np.dtype(kind).kind == 'f' and np.dtype(kind).itemsize <= 4 for kind in kinds]
    sizes = np.abs(points[:, single])
    largest = float(sizes.max(initial=0.0, where=sizes < MOST_COORDINATE))
    step = float(np.spacing(np.float32(largest)))
    if step > COARSEST:
        raise DataError(
            f'{path}: coordinates up to {largest:.7g} in single precision have steps of {step:g}'
            ': write them in double precision, or relative to a nearby origin'
        )
