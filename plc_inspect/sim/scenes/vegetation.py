# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Vegetation of the simulated scenes: porous trees, some planted at known clearances."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from plc_inspect.errors import DataError
from plc_inspect.sim.scenes.conductors import Conductor
from plc_inspect.sim.scenes.scene import Label, Planted, SceneBuilder, UP

Float64 = NDArray[np.float64]
Shape = Callable[[np.random.Generator, float], Float64]

LOWEST = 0.8
"""Least height of a tree [m]."""
WITH_TRUNK = 2.5
"""Height above which trees have a trunk [m]."""
CLEAR = 4.7
"""Default distance from conductors of vegetation that is no hazard [m]."""


def shape_broadleaf(rng: np.random.Generator, height: float) -> Float64:
    """Return the crown (K, 5) of a broadleaved tree of a height with its foot at 0 [m]."""
    radius = 0.26 * height
    blobs = [[0.0, 0.0, 0.68 * height, 0.8 * radius, 0.5]]
    for i in range(7):
        angle = 2 * np.pi * (i + rng.uniform(-0.3, 0.3)) / 7
        reach, r = radius * rng.uniform(0.5, 0.75), radius * rng.uniform(0.4, 0.6)
        z = height * rng.uniform(0.5, 0.75)
        blobs.append([reach * np.cos(angle), reach * np.sin(angle), z, r, 0.7])
    blobs.append([0.0, 0.0, height - 0.45 * radius, 0.45 * radius, 0.7])
    return np.array(blobs)


def shape_conifer(rng: np.random.Generator, height: float) -> Float64:
    """Return the crown (K, 5) of a conifer of a height with its foot at 0 [m]."""
    blobs = []
    for share in np.linspace(0.25, 0.97, 9):
        r = max(0.22, 0.2 * height * (1.02 - share) * rng.uniform(0.85, 1.15))
        sway = rng.normal(0.0, 0.12 * r, 2)
        blobs.append([sway[0], sway[1], share * height - (r if share > 0.9 else 0.0), r, 0.8])
    return np.array(blobs)


def shape_bush(rng: np.random.Generator, height: float) -> Float64:
    """Return the leaves (K, 5) of a bush of a height with its foot at 0 [m]."""
    blobs = []
    for _ in range(4):
        r = 0.5 * height * rng.uniform(0.6, 1.0)
        x, y = rng.normal(0.0, 0.35 * height, 2)
        blobs.append([x, y, min(height - r, 0.9 * r), r, 1.5])
    return np.array(blobs)


def shape_poplar(rng: np.random.Generator, height: float) -> Float64:
    """Return the crown (K, 5) of a slender tree of a height with its foot at 0 [m]."""
    radius = 0.09 * height
    return np.array([
        [*rng.normal(0.0, 0.1, 2), z, radius * rng.uniform(0.8, 1.1), 0.9]
        for z in np.linspace(0.2 * height, height - radius, 10)
    ])


def place(builder: SceneBuilder, crown: Float64, xy: Float64) -> Float64:
    """Return the crown (K, 5) moved from 0 to the ground at xy (2,)."""
    moved = crown.copy()
    moved[:, :2] += xy
    moved[:, 2] += builder.ground(xy)
    return moved


def add_tree(
    builder: SceneBuilder, shape: Shape, xy: Float64, height: float, clear: float = CLEAR,
) -> bool:
    """
    Add a tree, lowered as needed for its hull to keep ``clear`` from all conductors [m].

    Returns
    -------
    bool
        False, with nothing added, if not even a tree of LOWEST would keep that distance.

    """
    for _ in range(12):
        crown = place(builder, shape(builder.rng, height), xy)
        if builder.measure_gaps(crown).min() >= clear:
            _add(builder, crown, xy, height)
            return True
        height *= 0.8
        if height < LOWEST:
            break
    return False


def _add(builder: SceneBuilder, crown: Float64, xy: Float64, height: float) -> None:
    builder.add_blobs(crown)
    if height > WITH_TRUNK:
        foot = np.array([xy[0], xy[1], builder.ground(xy)])
        top = foot + 0.55 * height * UP
        builder.add_strut(foot, top, 0.012 * height + 0.03, Label.VEGETATION)


def plant_beside(
    builder: SceneBuilder, conductor: Conductor, share: float, side: int, clearance: float,
    shape: Shape = shape_broadleaf,
) -> None:
    """
    Plant a tree beside a conductor, with its crown at a given distance.

    Parameters
    ----------
    builder : SceneBuilder
        Holds all conductors; the distance is from the nearest of them.
    conductor : Conductor
        The outermost conductor on that side.
    share : float
        Position along the span, 0 to 1.
    side : int
        1 to the left of the conductor's direction, -1 to the right.
    clearance : float
        Distance of the hull of the crown from the nearest conductor [m], negative inside.
    shape : callable
        Shape of the tree.

    Raises
    ------
    DataError
        No position on that side has this distance.

    """
    target = conductor.locate(np.array([share * conductor.length]))[0]
    along = (conductor.end - conductor.start)[:2] / conductor.length
    normal = side * np.array([-along[1], along[0]])
    height = float(target[2]) - builder.ground(target[:2])
    crown = shape(builder.rng, height / 0.68)

    def measure(offset: float) -> float:
        place_xy = target[:2] + offset * normal
        return float(builder.measure_gaps(place(builder, crown, place_xy)).min())

    low, high = 0.0, 60.0
    if not measure(low) < clearance < measure(high):
        raise DataError(f'no place for a crown at {clearance:g} m from the conductor')
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if measure(middle) < clearance else (low, middle)
    xy = target[:2] + high * normal
    _add(builder, place(builder, crown, xy), xy, height / 0.68)
    _note(builder, conductor, target, clearance)


def plant_under(
    builder: SceneBuilder, conductor: Conductor, share: float, clearance: float,
    shape: Shape = shape_conifer,
) -> None:
    """
    Plant a tree under a conductor, with its top at a given distance.

    Parameters are those of `plant_beside`; raises DataError if no tree fits.
    """
    target = conductor.locate(np.array([share * conductor.length]))[0]
    height = float(target[2]) - builder.ground(target[:2])
    model = shape(builder.rng, 1.0)

    def grow(size: float) -> Float64:
        crown = model.copy()
        crown[:, :4] *= size
        return place(builder, crown, target[:2])

    low, high = 0.5, height + 2.0
    if not builder.measure_gaps(grow(low)).min() > clearance:
        raise DataError(f'no tree fits {clearance:g} m under a conductor {height:g} m up')
    for _ in range(50):
        middle = 0.5 * (low + high)
        near = builder.measure_gaps(grow(middle)).min() < clearance
        low, high = (low, middle) if near else (middle, high)
    _add(builder, grow(low), target[:2], low)
    _note(builder, conductor, target, clearance)


def _note(
    builder: SceneBuilder, conductor: Conductor, target: Float64, clearance: float,
) -> None:
    builder.planted.append(Planted(
        line_id=conductor.line_id, span_id=conductor.span_id, position=target,
        clearance=clearance,
    ))


def scatter_trees(
    builder: SceneBuilder, xy: Float64, heights: tuple[float, float], clear: float = CLEAR,
    shapes: tuple[Shape, ...] = (shape_broadleaf, shape_conifer),
) -> int:
    """
    Add trees of random height and shape at xy (N, 2) where they keep ``clear`` [m].

    Returns
    -------
    int
        Number of trees added.

    """
    rng, count = builder.rng, 0
    for spot in xy:
        shape = shapes[int(rng.integers(len(shapes)))]
        count += add_tree(builder, shape, spot, rng.uniform(*heights), clear)
    return count
