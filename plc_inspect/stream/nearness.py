# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The keep-out on the thin link: how near the vehicle is to conductors, supports and all else."""

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plc_inspect.core.live.proximity import Level, Proximity, Thing
from plc_inspect.errors import DataError

NEARNESS = np.dtype([
    ('thing', 'u1'), ('level', 'u1'), ('extended', 'u1'), ('line_id', '<i4'), ('span_id', '<i4'),
    *((name, '<f4') for name in ('distance', 'limit', 'closest', 'closest_in', 'sigma')),
    *((axis, '<f4') for axis in ('from_x', 'from_y', 'from_z')),
])
"""from_: the way from the vehicle to the place, so that float32 is enough far from the origin."""

Place = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Nearness:
    """The nearest thing of one kind; lengths in metres, NaN where nothing is known."""

    thing: Thing
    level: Level
    distance: float
    """From the vehicle's position."""
    way: Place
    """From the vehicle to the nearest place."""
    closest: float
    """Distance at the closest approach, as the vehicle flies now."""
    closest_in: float
    """Time until then [s]."""
    sigma: float
    line_id: int = -1
    span_id: int = -1
    extended: bool = False
    """It is beyond what was seen of the conductor."""
    limit: float = math.nan
    """Distance within which the level is critical, NaN unknown."""


def tell_nearness(
    found: Sequence[Proximity], vehicle: Place, limit: float
) -> tuple[Nearness, ...]:
    """Return what the stream tells of proximities, measured with the vehicle at a place [m]."""
    result = []
    for item in found:
        x, y, z = (float(value) for value in item.position - np.array(vehicle))
        result.append(Nearness(
            thing=item.thing, level=item.level, distance=item.distance, way=(x, y, z),
            closest=item.closest, closest_in=item.closest_in, sigma=item.sigma,
            line_id=item.line_id, span_id=item.span_id, extended=item.extended, limit=limit,
        ))
    return tuple(result)


def pack_nearness(near: Sequence[Nearness]) -> NDArray[Any]:
    """Return one row (N,) NEARNESS for each thing."""
    rows = np.zeros(len(near), NEARNESS)
    for row, item in zip(rows, near, strict=True):
        for name in ('thing', 'level', 'extended', 'line_id', 'span_id', 'distance', 'limit',
                     'closest', 'closest_in', 'sigma'):
            row[name] = getattr(item, name)
        for axis, value in zip('xyz', item.way, strict=True):
            row[f'from_{axis}'] = value
    return rows


def read_nearness(rows: NDArray[Any]) -> tuple[Nearness, ...]:
    """
    Return what rows (N,) NEARNESS tell.

    Raises
    ------
    DataError
        They name a thing or a level that is none, or a critical one without a distance.

    """
    result = []
    for row in rows:
        thing, level = int(row['thing']), int(row['level'])
        distance = float(row['distance'])
        if thing not in list(Thing) or level not in list(Level):
            raise DataError(f'nearness of thing {thing} and level {level}: there is no such')
        if level >= Level.WARNING and not math.isfinite(distance):
            raise DataError(f'nearness of level {level} with a distance of {distance:g} m')
        result.append(Nearness(
            thing=Thing(thing), level=Level(level), distance=distance,
            way=(float(row['from_x']), float(row['from_y']), float(row['from_z'])),
            closest=float(row['closest']), closest_in=float(row['closest_in']),
            sigma=float(row['sigma']), line_id=int(row['line_id']), span_id=int(row['span_id']),
            extended=bool(row['extended']), limit=float(row['limit']),
        ))
    return tuple(result)
