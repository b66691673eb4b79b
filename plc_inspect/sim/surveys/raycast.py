# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Ray caster of the simulator: beams of any scanner against all objects of a scene.

Objects are listed in the cells of a grid in plan, and a beam visits its cells in order.  A hash of
beam and object decides whether the beam passes a porous crown or misses a thin wire, so the result
does not depend on order or number of threads.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plc_inspect.sim.scenes.scene import Label, Scene
from plc_inspect.sim.surveys.ray_kernels import CELL, MISS, trace_beams

Float64 = NDArray[np.float64]
Int32 = NDArray[np.int32]
Int64 = NDArray[np.int64]
UInt8 = NDArray[np.uint8]

_PIECE = 2.0
_THREADS = 2


class World(NamedTuple):
    """Arrays of a scene for the kernels; items are struts, triangles, crowns and wire pieces."""

    first: Int64
    """(cells + 1,) first item of each cell in ``items``."""
    items: Int32
    top: Float64
    """(cells,) top of the objects in each cell [m], -inf without objects."""
    ground_top: Float64
    """(cells,) top of the ground in each cell [m]."""
    shape: tuple[int, int]
    origin: tuple[float, float]
    struts: Float64
    triangles: Float64
    blobs: Float64
    crowns: Float64
    """(C, 7) upright cylinder about each crown: centre, radius, bottom, top; range of blobs."""
    pieces: Float64
    """(P, 8) both ends, radius and conductor number."""
    curves: Float64
    """(C, 8) a, b, c, start x, y, unit direction x, y and length of each conductor."""
    grid: Float64
    grid_origin: tuple[float, float]
    grid_cell: float
    num_items: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Beam:
    """Properties of a scanner's beam that decide what it hits."""

    divergence: float = 0.003
    """Full angle [rad]."""
    exit_width: float = 0.01
    """Width of the beam at the scanner [m]."""
    wire_reach: float = 0.0
    """Greatest distance of a wire that is hit from the axis [m]; 0: by the footprint."""
    wire_fraction: float = 0.3
    """Share of the footprint from which a wire always returns; thinner ones return less often."""
    wire_range: float = 60.0
    """Range at which the returns of a wire have fallen to 1/e [m]."""
    max_returns: int = 1
    """Greatest number of returns of one beam."""
    pass_share: float = 0.0
    """Share of beams that continue behind a leaf or strut."""


def build_world(scene: Scene) -> World:
    """Return the arrays of a scene, with the grid that lists its objects."""
    pieces, curves = _cut_conductors(scene)
    corners = scene.triangles.reshape(-1, 3, 3)
    ends = scene.struts[:, :6].reshape(-1, 2, 3)
    radius = scene.struts[:, 6][:, None] + 0.1
    wire_ends = pieces[:, :6].reshape(-1, 2, 3)
    crowns = _wrap_crowns(scene)
    plan, size = crowns[:, :2], crowns[:, 2][:, None]
    crown_low = np.column_stack([plan - size, crowns[:, 3]])
    crown_high = np.column_stack([plan + size, crowns[:, 4]])
    low = np.vstack([
        ends.min(axis=1) - radius, corners.min(axis=1), crown_low,
        wire_ends.min(axis=1) - 0.4,
    ])
    high = np.vstack([
        ends.max(axis=1) + radius, corners.max(axis=1), crown_high,
        wire_ends.max(axis=1) + 0.4,
    ])
    terrain = scene.terrain
    ny = math.ceil((terrain.grid.shape[0] - 1) * terrain.cell / CELL)
    nx = math.ceil((terrain.grid.shape[1] - 1) * terrain.cell / CELL)
    origin = (terrain.x0, terrain.y0)
    first, items, top = _list_items(low, high, origin, nx, ny)
    step = max(1, round(CELL / terrain.cell))
    padded = np.pad(terrain.grid, ((0, 2 * step), (0, 2 * step)), mode='edge')
    ground_top = np.full((ny, nx), -np.inf)
    for dy in range(step + 1):
        for dx in range(step + 1):
            part = padded[dy:dy + ny * step:step, dx:dx + nx * step:step]
            ground_top = np.maximum(ground_top, part[:ny, :nx])
    return World(
        first=first, items=items, top=top, ground_top=ground_top.ravel(), shape=(ny, nx),
        origin=origin, struts=scene.struts, triangles=scene.triangles, blobs=scene.blobs,
        crowns=crowns, pieces=pieces, curves=curves, grid=terrain.grid, grid_origin=origin,
        grid_cell=terrain.cell, num_items=len(low),
    )


def _cut_conductors(scene: Scene) -> tuple[Float64, Float64]:
    pieces, curves = [np.zeros((0, 8))], [np.zeros((0, 8))]
    for number, item in enumerate(scene.conductors):
        nodes = item.sample(_PIECE)
        part = np.column_stack([
            nodes[:-1], nodes[1:], np.full(len(nodes) - 1, item.radius),
            np.full(len(nodes) - 1, float(number)),
        ])
        if item.hidden is not None:
            share = (np.arange(len(part)) + 0.5) / len(part)
            part = part[(share < item.hidden[0]) | (share > item.hidden[1])]
        pieces.append(part)
        azimuth = item.azimuth
        curves.append(np.array([[item.a, item.b, item.c, item.start[0], item.start[1],
                                 math.cos(azimuth), math.sin(azimuth), item.length]]))
    return np.vstack(pieces), np.vstack(curves)


def _wrap_crowns(scene: Scene) -> Float64:
    """Return an upright cylinder about each crown, and the range of its blobs (C, 7)."""
    crowns = np.zeros((len(scene.crowns) - 1, 7))
    for row, (first, last) in zip(crowns, pairwise(scene.crowns), strict=True):
        blobs = scene.blobs[first:last]
        low = (blobs[:, :3] - blobs[:, 3:4]).min(axis=0)
        high = (blobs[:, :3] + blobs[:, 3:4]).max(axis=0)
        centre = 0.5 * (low + high)[:2]
        radius = (np.hypot(*(blobs[:, :2] - centre).T) + blobs[:, 3]).max()
        row[:] = *centre, radius, low[2], high[2], first, last
    return crowns


def _list_items(
    low: Float64, high: Float64, origin: tuple[float, float], nx: int, ny: int,
) -> tuple[Int64, Int32, Float64]:
    limit = np.array([nx - 1, ny - 1])
    i0 = np.clip(((low[:, :2] - origin) // CELL).astype(np.int64), 0, limit)
    i1 = np.clip(((high[:, :2] - origin) // CELL).astype(np.int64), 0, limit)
    counts = (i1 - i0 + 1).prod(axis=1)
    item = np.repeat(np.arange(len(low)), counts)
    rank = np.arange(len(item)) - np.repeat(np.cumsum(counts) - counts, counts)
    width = (i1 - i0 + 1)[item, 0]
    cell = (i0[item, 1] + rank // width) * nx + i0[item, 0] + rank % width
    order = np.argsort(cell, kind='stable')
    first = np.zeros(nx * ny + 1, dtype=np.int64)
    np.cumsum(np.bincount(cell, minlength=nx * ny), out=first[1:])
    top = np.full(nx * ny, -np.inf)
    np.maximum.at(top, cell, high[item, 2])
    return first, item[order].astype(np.int32), top


def cast(
    world: World, origins: Float64, directions: Float64, reach: Float64, beam: Beam, key: int,
) -> tuple[Float64, Int32]:
    """
    Cast beams, and return what they hit.

    Parameters
    ----------
    world : World
        Scene, from `build_world`.
    origins, directions : ndarray
        (N, 3) float64 starts [m] and unit vectors.
    reach : ndarray
        (N,) float64 greatest range of each beam [m].
    beam : Beam
        Shape of the beams and number of returns.
    key : int
        Seed of the hash that replaces randomness.

    Returns
    -------
    ranges : ndarray
        (N, max_returns) float64 [m], inf where there is no return.
    items : ndarray
        (N, max_returns) int32 items of the world, `ray_kernels.GROUND` or `ray_kernels.MISS`.

    """
    wire = np.array([beam.divergence, beam.exit_width, beam.wire_reach, beam.wire_fraction,
                     beam.wire_range])
    ranges = np.full((len(origins), beam.max_returns), np.inf)
    items = np.full((len(origins), beam.max_returns), MISS, dtype=np.int32)
    edges = np.linspace(0, len(origins), _THREADS + 1).astype(np.int64)
    with ThreadPoolExecutor(_THREADS) as pool:
        jobs = [
            pool.submit(
                trace_beams, world, origins, directions, reach, wire, np.uint64(key),
                beam.pass_share, ranges, items, first, last,
            )
            for first, last in pairwise(edges)
        ]
        for job in jobs:
            job.result()
    return ranges, items


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Labels:
    """Truth of the items of a world, indexed by item."""

    label: UInt8
    line_id: Int32
    span_id: Int32
    conductor: Int32
    """Number of the conductor in the scene, -1 for other items."""


def label_items(scene: Scene, world: World) -> Labels:
    """Return the truth of each item; the last two entries, -1 and -2, are miss and ground."""
    num_other = len(scene.struts) + len(scene.triangles) + len(world.crowns)
    number = world.pieces[:, 7].astype(np.int32)
    label = np.concatenate([
        scene.strut_label, scene.triangle_label, np.full(len(world.crowns), Label.VEGETATION),
        np.full(len(number), Label.WIRE), [Label.GROUND, 0],
    ]).astype(np.uint8)
    conductor = np.concatenate([np.full(num_other, -1), number, [-1, -1]]).astype(np.int32)
    lines = np.array([*(item.line_id for item in scene.conductors), -1], dtype=np.int32)
    spans = np.array([*(item.span_id for item in scene.conductors), -1], dtype=np.int32)
    return Labels(
        label=label, conductor=conductor, line_id=lines[conductor], span_id=spans[conductor],
    )
