# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
How near the vehicle is to conductors, supports and whatever else stands about it.

The vehicle is taken to fly on as it does; a conductor goes on beyond an open end along its
catenary for as long as that is known.
"""

from dataclasses import dataclass
import enum
import math
from typing import Any

from numba import njit
import numpy as np

from plc_inspect.core.live.motion import LEAST_SPEED
from plc_inspect.core.live.surroundings import find_sigma, SPACING, Surroundings
from plc_inspect.core.spans.span_model import POINT_SIGMA
from plc_inspect.node_config import ProximitySettings
from plc_inspect.results import Float64

HORIZON = 20.0
"""Longest time that is looked ahead [s].  Source: judgement: 200 m at 10 m/s."""
STEP = 0.25
"""Times at which the way to a curve is looked at [s].  Source: judgement: 2.5 m at 10 m/s."""
NEWTON_STEPS = 8
"""Steps to the nearest point of a catenary.  Source: numerical: to less than 1 mm."""
SAME = 1.0
"""
Fresh returns within this of a known conductor or support are of it [m].
Source: judgement: sag and drift between two ticks.
"""
NO_POINTS: Float64 = np.zeros((0, 3))
"""No fresh returns.  Source: numerical."""
LEAST_SLOPE = 0.1
"""Divisor of a step, at least.  Source: numerical: below far curves the distance is flat."""


class Level(enum.IntEnum):
    """What is to be made of a distance."""

    UNKNOWN = 0
    """Nothing is near that is known, but not all about the vehicle was seen."""
    CLEAR = 1
    WARNING = 2
    CRITICAL = 3


class Thing(enum.IntEnum):
    """What is near."""

    CONDUCTOR = 0
    SUPPORT = 1
    """A tower or pole."""
    OBSTACLE = 2
    """Vegetation, buildings and all else that stands off the ground."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Proximity:
    """The nearest thing of one kind."""

    thing: Thing
    level: Level
    distance: float = math.nan
    """From the vehicle's position [m], NaN where nothing is known."""
    position: Float64
    """(3,) its nearest place, map frame [m]; NaN where nothing is known."""
    closest: float = math.nan
    """Distance at the closest approach to any of the kind [m]."""
    closest_in: float = math.nan
    """Time until then [s]; 0 where it does not come nearer, NaN where the speed is unknown."""
    sigma: float = math.nan
    """Standard deviation of the distance [m]."""
    line_id: int = -1
    """Of a conductor."""
    span_id: int = -1
    extended: bool = False
    """It is beyond what was seen of the conductor."""


def measure_proximity(
    around: Surroundings, seen: bool, position: Float64, velocity: Float64,
    settings: ProximitySettings, fresh: Float64 = NO_POINTS,
) -> tuple[Proximity, ...]:
    """
    Return the nearest thing of each kind.

    Parameters
    ----------
    around : Surroundings
        What is known.
    seen : bool
        Whether all within the greater of the limits was seen.
    position : (3,) float64
        Of the vehicle, map frame [m].
    velocity : (3,) float64
        [m/s]; NaN unknown.
    settings : ProximitySettings
        Distances of the levels.
    fresh : (K, 3) float64
        What no tick has looked at yet, map frame [m]; an obstacle where it is no known thing.

    Returns
    -------
    tuple of Proximity
        One for each Thing, in its order.

    """
    way = velocity if np.isfinite(velocity).all() else np.zeros(3)
    moves = bool(np.linalg.norm(way) >= LEAST_SPEED)
    way = way if moves else np.zeros(3)
    known = bool(np.isfinite(velocity).all())
    result = []
    for thing in Thing:
        if thing == Thing.CONDUCTOR:
            found = _find_conductor(around, position, way)
        elif thing == Thing.SUPPORT:
            found = _find_point(around.supports, position, way)
        else:
            strange = _are_strange(fresh, around.courses, around.supports, position)
            found = _find_point(np.concatenate((around.obstacles, fresh[strange])), position, way)
        if found is None:
            level = Level.CLEAR if seen else Level.UNKNOWN
            result.append(Proximity(thing=thing, level=level, position=np.full(3, np.nan)))
            continue
        if not known:
            found['closest'] = found['closest_in'] = math.nan
        result.append(Proximity(
            thing=thing, level=_judge(found['distance'], seen, settings), **found
        ))
    return tuple(result)


def _judge(distance: float, seen: bool, settings: ProximitySettings) -> Level:
    if distance <= settings.critical:
        return Level.CRITICAL
    if distance <= settings.warning:
        return Level.WARNING
    return Level.CLEAR if seen else Level.UNKNOWN


def _find_conductor(
    around: Surroundings, position: Float64, way: Float64
) -> dict[str, Any] | None:
    if not around.spans:
        return None
    number, x, distance, closest, closest_in = _approach_curves(around.courses, position, way)
    span, row = around.spans[around.owner[number]], around.courses[number]
    beyond = max(-x, x - span.length, 0.0)
    z = row[6] + row[8] * math.cosh((x - row[7]) / row[8])
    place = np.array([*(row[0:2] + x * row[2:4]), z])
    return {
        'distance': distance, 'position': place, 'closest': closest, 'closest_in': closest_in,
        'sigma': find_sigma(span, beyond), 'line_id': span.line_id, 'span_id': span.span_id,
        'extended': beyond > 0.0,
    }


def _find_point(points: Float64, position: Float64, way: Float64) -> dict[str, Any] | None:
    if not len(points):
        return None
    nearest, distance, closest, closest_in = _approach_points(points, position, way)
    return {
        'distance': distance, 'position': points[nearest].copy(), 'closest': closest,
        'closest_in': closest_in, 'sigma': math.hypot(POINT_SIGMA, SPACING / 2),
    }


# These keep Python's lock: each return from a kernel without it would wait for a tick.
@njit(cache=True, error_model='numpy')
def _nearest_on(row, px, py, pz):  # type: ignore[no-untyped-def]
    """Where on a row's curve it is nearest to a place, and how near."""
    dx, dy = px - row[0], py - row[1]
    along, across = dx * row[2] + dy * row[3], dy * row[2] - dx * row[3]
    x = min(max(along, row[4]), row[5])
    for _ in range(NEWTON_STEPS):
        u = (x - row[7]) / row[8]
        above, slope = row[6] + row[8] * math.cosh(u) - pz, math.sinh(u)
        first = x - along + above * slope
        second = 1.0 + slope * slope + above * math.cosh(u) / row[8]
        x = min(max(x - first / max(second, LEAST_SLOPE), row[4]), row[5])
    above = row[6] + row[8] * math.cosh((x - row[7]) / row[8]) - pz
    return x, math.sqrt((x - along) ** 2 + across**2 + above**2)


@njit(cache=True, error_model='numpy')
def _are_strange(points, rows, supports, place):  # type: ignore[no-untyped-def]
    """Tell which points about a place are near no row's curve and no point of a support."""
    reach = 0.0
    for k in range(len(points)):
        x, y, z = points[k, 0] - place[0], points[k, 1] - place[1], points[k, 2] - place[2]
        reach = max(reach, math.sqrt(x * x + y * y + z * z))
    result = np.ones(len(points), dtype=np.bool_)
    for row in rows:
        if _nearest_on(row, place[0], place[1], place[2])[1] > reach + SAME:
            continue
        for k in range(len(points)):
            if result[k]:
                apart = _nearest_on(row, points[k, 0], points[k, 1], points[k, 2])[1]
                result[k] = apart > SAME
    for m in range(len(supports)):
        for k in range(len(points)):
            x, y = supports[m, 0] - points[k, 0], supports[m, 1] - points[k, 1]
            z = supports[m, 2] - points[k, 2]
            result[k] &= x * x + y * y + z * z > SAME * SAME
    return result


@njit(cache=True, error_model='numpy')
def _approach_curves(rows, position, way):  # type: ignore[no-untyped-def]
    """Nearest row, x on it and distance; and the closest approach to any, and when it is."""
    number, at, least = 0, 0.0, np.inf
    for k in range(len(rows)):
        x, distance = _nearest_on(rows[k], position[0], position[1], position[2])
        if distance < least:
            number, at, least = k, x, distance
    closest, closest_in = least, 0.0
    speed = math.sqrt(way[0] ** 2 + way[1] ** 2 + way[2] ** 2)
    if speed > 0.0:
        for k in range(len(rows)):
            time = 0.0
            while time < HORIZON:
                x, distance = _nearest_on(
                    rows[k], position[0] + time * way[0], position[1] + time * way[1],
                    position[2] + time * way[2],
                )
                if distance < closest:
                    closest, closest_in = distance, time
                # it cannot be nearer than the best before so much time
                time += max((distance - closest) / speed, STEP)
    return number, at, least, closest, closest_in


@njit(cache=True, error_model='numpy')
def _approach_points(points, position, way):  # type: ignore[no-untyped-def]
    """Nearest point and its distance; and the closest approach to any, and when it is."""
    square = way[0] ** 2 + way[1] ** 2 + way[2] ** 2
    nearest, least, closest, closest_in = 0, np.inf, np.inf, 0.0
    for k in range(len(points)):
        x, y = points[k, 0] - position[0], points[k, 1] - position[1]
        z = points[k, 2] - position[2]
        apart = x * x + y * y + z * z
        if apart < least:
            nearest, least = k, apart
        time = 0.0
        if square > 0.0:
            time = min(max((x * way[0] + y * way[1] + z * way[2]) / square, 0.0), HORIZON)
            x, y, z = x - time * way[0], y - time * way[1], z - time * way[2]
            apart = x * x + y * y + z * z
        if apart < closest:
            closest, closest_in = apart, time
    return nearest, math.sqrt(least), math.sqrt(closest), closest_in
