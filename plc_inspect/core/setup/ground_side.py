# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
On which side of the vehicle the ground lies.

A lidar that hangs upside down, or an odometry whose z points down, turns the map on its head: it
is as sharp as a right one, and the ground is a sky.  What lies below and above the way flown
tells: only ground fills wide sheets there, wires and crowns do not.
"""

from dataclasses import dataclass

import numpy as np

from plc_inspect.results import Bool, Float64, Int64

RADIUS = 12.0
"""
Plan distance from the way that is looked at [m].
Source: measured: bench/flights/drawn_flights.py, eight of 8510 to 8604: less is filled within 8 m,
which a lidar that looks level does not see; within 20 m the sides of valleys rise.
"""
CELL = 1.0
"""Cells in plan [m].  Source: judgement: more than scan lines are apart, less than wires are."""
MARGIN = 0.1
"""
What lies this near to the height of the vehicle is on no side [m].
Source: derived: three times the noise of the sensor; less than a lidar stands above the ground.
"""
LEAST_PLACES = 5
"""
Places of the way from which the ground is looked for.
Source: judgement: they are 2 m apart, and a vehicle that has not flown may stand in a hollow.
"""
MOST_PLACES = 64
"""Places of the way that are looked at.  Source: judgement: 64 discs of RADIUS, 29,000 cells."""
LEAST_POINTS = 1000
"""
Points about the way from which sheets are looked for.
Source: judgement: a thirtieth of one scan of a Puck; few far apart may fill anything.
"""
LEAST_FILLED = 8
"""
Cells of a block of 3 by 3 that are filled where it is of a sheet.
Source: derived: strips less than 3 m wide, as wires fill, have less.
"""
SURE, OTHER = 0.1, 0.2
"""
The ground is where sheets fill this share, and on the other side not that share of it.
Source: measured: the flights of RADIUS: below 0.05 (high above) to 0.65, above 0.01 at most.
"""
OVERHEAD = (
    'the ground lies above the vehicle: check that z of the odometry is up (REP-103), and that '
    'the lidar is not mounted upside down (input.lidar_rpy_deg, /tf_static); nothing is looked for'
)
"""What is said of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundSides:
    """How much of the plan about the way flown is filled by sheets."""

    below: float = 0.0
    """Share below the vehicle, 0 to 1."""
    above: float = 0.0
    """Share above it."""

    @property
    def known(self) -> bool:
        """Whether the ground was seen."""
        more, less = max(self.below, self.above), min(self.below, self.above)
        return more > SURE and less < OTHER * more

    @property
    def overhead(self) -> bool:
        """Whether it lies above the vehicle."""
        return self.known and self.above > self.below


def measure_sides(points: Float64, way: Float64) -> GroundSides:
    """
    Measure what lies below and above the way flown.

    Parameters
    ----------
    points : Float64
        (N, 3) [m].
    way : Float64
        (W, 3) where the vehicle was [m]; what is beyond the points is left out.

    Returns
    -------
    GroundSides

    """
    if not len(points):
        return GroundSides()
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    way = way[((way[:, :2] >= low) & (way[:, :2] <= high)).all(axis=1)]
    if len(way) < LEAST_PLACES:
        return GroundSides()
    way = way[np.linspace(0, len(way) - 1, min(len(way), MOST_PLACES)).astype(np.int64)]
    origin = low - 2.0 * RADIUS
    points = points[_are_near(points, way, origin, high)]
    if len(points) < LEAST_POINTS:
        return GroundSides()
    width = int((high[1] - origin[1] + 2.0 * RADIUS) / CELL)
    own = _to_cells(way, origin, CELL) @ (width, 1)
    keys, of_place = np.unique(own[:, None] + _make_disc() @ (width, 1), return_inverse=True)
    heights = np.repeat(way[:, 2], of_place.size // len(way))
    lowest, highest = np.full(len(keys), np.inf), np.full(len(keys), -np.inf)
    np.minimum.at(lowest, of_place.ravel(), heights)
    np.maximum.at(highest, of_place.ravel(), heights)
    cell, known = _look_up(keys, _to_cells(points, origin, CELL) @ (width, 1))
    cell, z = cell[known], points[known, 2]
    return GroundSides(
        below=_measure_sheets(keys, cell[z < lowest[cell] - MARGIN], width),
        above=_measure_sheets(keys, cell[z > highest[cell] + MARGIN], width),
    )


def _to_cells(points: Float64, origin: Float64, cell: float) -> Int64:
    """Return the cells (N, 2) of points (N, 2+), of an edge [m]."""
    return np.floor((points[:, :2] - origin) / cell).astype(np.int64)


def _make_disc() -> Int64:
    """Return the steps (D, 2) from a cell to those within RADIUS of it."""
    reach = np.arange(-int(RADIUS / CELL), int(RADIUS / CELL) + 1)
    grid = np.stack(np.meshgrid(reach, reach), axis=-1).reshape(-1, 2)
    disc: Int64 = grid[np.hypot(*grid.T) * CELL <= RADIUS]
    return disc


def _are_near(points: Float64, way: Float64, origin: Float64, high: Float64) -> Bool:
    """Tell which points (N,) may lie within RADIUS of the way."""
    blocks = np.zeros(_to_cells(high[None], origin, RADIUS)[0] + 4, dtype=bool)
    for x, y in _to_cells(way, origin, RADIUS).tolist():
        blocks[x - 1:x + 2, y - 1:y + 2] = True
    near: Bool = blocks[tuple(_to_cells(points, origin, RADIUS).T)]
    return near


def _look_up(keys: Int64, wanted: Int64) -> tuple[Int64, Bool]:
    """Return the places of some keys among those that ascend, and whether they are there."""
    place = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return place, keys[place] == wanted


def _measure_sheets(keys: Int64, cells: Int64, width: int) -> float:
    """Return the share of cells that are filled like those about them."""
    filled = np.zeros(len(keys), dtype=bool)
    filled[cells] = True
    around = np.zeros(len(keys), dtype=np.int64)
    for step in (i * width + j for i in (-1, 0, 1) for j in (-1, 0, 1)):
        place, known = _look_up(keys, keys + step)
        around += known & filled[place]
    return float((filled & (around >= LEAST_FILLED)).mean())
