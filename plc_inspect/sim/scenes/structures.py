# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Structures of the simulated scenes other than supports: houses, walls, fences, lights, rails."""

from itertools import pairwise
import math

import numpy as np
from numpy.typing import NDArray

from plc_inspect.sim.scenes.scene import Label, SceneBuilder, UP

Float64 = NDArray[np.float64]


def add_house(
    builder: SceneBuilder, xy: Float64, azimuth: float, *, length: float = 11.0,
    width: float = 8.0, eaves: float = 3.5, ridge: float = 6.5,
) -> None:
    """
    Add a gabled house.

    Parameters
    ----------
    builder : SceneBuilder
        Takes the parts.
    xy : ndarray
        (2,) centre [m].
    azimuth : float
        Direction of the ridge [rad].
    length, width : float
        Extent along and across the ridge [m].
    eaves, ridge : float
        Heights above the ground [m].

    """
    u = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    v = np.array([-u[1], u[0], 0.0])
    base = np.array([xy[0], xy[1], builder.ground(xy)])

    def corner(along: float, across: float, up: float) -> Float64:
        return base + 0.5 * length * along * u + 0.5 * width * across * v + up * UP

    for side in (-1, 1):
        builder.add_face(np.array([
            corner(-1, side, -1), corner(1, side, -1), corner(1, side, eaves),
            corner(-1, side, eaves),
        ]), Label.BUILDING)
        builder.add_face(np.array([
            corner(side, -1, -1), corner(side, 1, -1), corner(side, 1, eaves),
            corner(side, 0, ridge), corner(side, -1, eaves),
        ]), Label.BUILDING)
        low = eaves - 0.1 * (ridge - eaves)
        builder.add_face(np.array([
            corner(-1.05, 1.1 * side, low), corner(1.05, 1.1 * side, low),
            corner(1.05, 0, ridge), corner(-1.05, 0, ridge),
        ]), Label.BUILDING)
    chimney = corner(0.4, 0.2, ridge - 0.8)
    builder.add_strut(chimney, chimney + 1.4 * UP, 0.35, Label.BUILDING)


def add_wall(
    builder: SceneBuilder, path: Float64, height: float, label: Label = Label.OTHER,
    bottom: float = -0.3,
) -> None:
    """Add a wall, board fence or hedge face of ``height`` [m] along path (K, 2) [m]."""
    for low, high in zip(*_trace(builder, path, 4.0), strict=True):
        up = np.array([0.0, 0.0, height])
        down = np.array([0.0, 0.0, bottom])
        builder.add_face(np.array([low + down, high + down, high + up, low + up]), label)


def add_fence(
    builder: SceneBuilder, path: Float64, height: float = 1.2, rails: int = 3,
) -> None:
    """Add posts with ``rails`` wires or bars up to ``height`` [m] along path (K, 2) [m]."""
    for low, high in zip(*_trace(builder, path, 3.0), strict=True):
        builder.add_strut(low, low + height * UP, 0.05, Label.OTHER)
        for i in range(1, rails + 1):
            up = np.array([0.0, 0.0, height * i / rails])
            builder.add_strut(low + up, high + up, 0.02, Label.OTHER)


def add_guard_rail(builder: SceneBuilder, path: Float64) -> None:
    """Add a steel guard rail 0.75 m high along path (K, 2) [m]."""
    for low, high in zip(*_trace(builder, path, 2.0), strict=True):
        up = np.array([0.0, 0.0, 0.65])
        builder.add_strut(low, low + up, 0.06, Label.OTHER)
        builder.add_strut(low + up, high + up, 0.14, Label.OTHER)


def add_rails(builder: SceneBuilder, path: Float64, gauge: float = 1.435) -> None:
    """Add a railway track, rails 0.3 m above the ground, along path (K, 2) [m]."""
    for side in (-0.5, 0.5):
        for low, high in zip(*_trace(builder, path, 4.0, side * gauge), strict=True):
            up = np.array([0.0, 0.0, 0.3])
            builder.add_strut(low + up, high + up, 0.07, Label.OTHER)


def add_street_lights(
    builder: SceneBuilder, path: Float64, spacing: float = 28.0, height: float = 7.5,
) -> None:
    """Add lamp posts with an arm to the left every ``spacing`` [m] along path (K, 2) [m]."""
    for low, high in zip(*_trace(builder, path, spacing), strict=True):
        along = (high - low)[:2] / np.hypot(*(high - low)[:2])
        arm = np.array([-along[1], along[0], 0.1])
        top = low + height * UP
        builder.add_strut(low, top, 0.08, Label.OTHER)
        builder.add_strut(top, top + 1.8 * arm, 0.05, Label.OTHER)
        builder.add_strut(top + 1.3 * arm, top + 2.0 * arm, 0.13, Label.OTHER)


def add_footbridge(
    builder: SceneBuilder, start: Float64, end: Float64, height: float = 5.2,
) -> None:
    """Add a bridge from start (2,) to end (2,) [m]: piers, deck and thin hand rails."""
    base = max(builder.ground(start), builder.ground(end))
    u = (end - start) / np.hypot(*(end - start))
    v = np.array([-u[1], u[0], 0.0])
    low = np.array([*start, base + height])
    high = np.array([*end, base + height])
    builder.add_face(np.array([low - v, high - v, high + v, low + v]), Label.OTHER)
    for share in (0.02, 0.5, 0.98):
        pier = low + share * (high - low)
        builder.add_strut(pier - [0.0, 0.0, height + 1.0], pier, 0.35, Label.OTHER)
    num = max(2, round(float(np.hypot(*(end - start))) / 2.0))
    for side in (-1.0, 1.0):
        for share in np.linspace(0.0, 1.0, num):
            post = low + share * (high - low) + side * v
            builder.add_strut(post, post + 1.1 * UP, 0.03, Label.OTHER)
        for up in (0.6, 1.1):
            lift = np.array([0.0, 0.0, up])
            builder.add_strut(low + side * v + lift, high + side * v + lift, 0.03, Label.OTHER)


def add_village(
    builder: SceneBuilder, route: Float64, *, setback: float = 16.0, spacing: float = 22.0,
    keep: float = 6.0, fences: bool = True,
) -> None:
    """
    Add a row of houses with garden fences on both sides of a route.

    Parameters
    ----------
    builder : SceneBuilder
        Takes the parts.
    route : ndarray
        (K, 2) centre line of the street [m].
    setback : float
        Distance from the route to the middle of the houses [m].
    spacing : float
        Distance from house to house [m].
    keep : float
        Least distance in plan of the centre of a house from conductors [m].
    fences : bool
        Whether to add fences along the street and between plots.

    """
    rng = builder.rng
    for side in (-1.0, 1.0):
        starts, ends = _trace(builder, route, spacing, side * setback)
        for low, high in zip(starts, ends, strict=True):
            azimuth = math.atan2(*(high - low)[:2][::-1])
            middle = (0.5 * (low + high))[:2]
            if rng.uniform() < 0.12 or not _is_free(builder, middle, keep):
                continue
            turn = 0.0 if rng.uniform() < 0.7 else 0.5 * math.pi
            ridge = rng.uniform(5.5, 7.8)
            add_house(
                builder, middle, azimuth + turn + rng.normal(0.0, 0.04),
                length=rng.uniform(9.0, 12.5), width=rng.uniform(7.0, 9.0),
                eaves=rng.uniform(2.8, 0.65 * ridge), ridge=ridge,
            )
            if not fences:
                continue
            across = np.array([-math.sin(azimuth), math.cos(azimuth)]) * side
            front = [low[:2] - (setback - 5.5) * across, high[:2] - (setback - 5.5) * across]
            depth = low[:2] + 12.0 * across
            if rng.uniform() < 0.5:
                add_wall(builder, np.array(front), rng.uniform(0.9, 1.6))
            else:
                add_fence(builder, np.array(front), rng.uniform(0.9, 1.3))
            add_wall(builder, np.array([front[0], depth]), rng.uniform(1.4, 1.9))


def keep_off_faces(builder: SceneBuilder, xy: Float64, keep: float) -> Float64:
    """Return the positions xy (K, 2) at least ``keep`` from the box of each face in plan [m]."""
    if not builder.triangles or not len(xy):
        return xy
    corners = np.array(builder.triangles).reshape(-1, 3, 3)[:, :, :2]
    low, high = corners.min(axis=1) - keep, corners.max(axis=1) + keep
    inside = (xy[:, None] >= low).all(axis=2) & (xy[:, None] <= high).all(axis=2)
    return xy[~inside.any(axis=1)]


def _is_free(builder: SceneBuilder, xy: Float64, keep: float) -> bool:
    for item in builder.conductors:
        edge = (item.end - item.start)[:2]
        along = np.clip(np.dot(xy - item.start[:2], edge) / np.dot(edge, edge), 0.0, 1.0)
        if np.hypot(*(xy - item.start[:2] - along * edge)) < keep:
            return False
    return True


def _trace(
    builder: SceneBuilder, path: Float64, step: float, shift: float = 0.0,
) -> tuple[Float64, Float64]:
    """Return starts and ends (K, 3) of pieces of a shifted path, on the ground [m]."""
    starts, ends = [], []
    for begin, finish in pairwise(path):
        edge = np.asarray(finish, dtype=np.float64) - begin
        length = float(np.hypot(*edge))
        normal = np.array([-edge[1], edge[0]]) / length * shift
        nodes = begin + np.linspace(0.0, 1.0, max(1, round(length / step)) + 1)[:, None] * edge
        nodes = np.column_stack([nodes + normal, builder.terrain.heights(nodes + normal)])
        starts.append(nodes[:-1])
        ends.append(nodes[1:])
    return np.vstack(starts), np.vstack(ends)
