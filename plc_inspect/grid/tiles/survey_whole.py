# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Measure the whole grid tile by tile: the tasks, and how their answers are combined."""

from collections.abc import Iterable, Sequence
from dataclasses import fields
import math
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from plc_inspect.config import HeightSettings, Settings
from plc_inspect.core.cloud_frame import CloudFrame
from plc_inspect.core.extraction.height import (
    count_heights,
    extract_high,
    find_ground_peak,
    lay_edges,
)
from plc_inspect.core.extraction.linearity import anchor, find_candidates
from plc_inspect.core.extraction.off_ground import gather_off_ground
from plc_inspect.core.ground.ground_grid import GroundGrid
from plc_inspect.core.ground.ground_surface import bounds, measure_surface, Surface
from plc_inspect.grid.tiles.tile_job import TileJob
from plc_inspect.results import Float64

REACH = 200.0
"""
Distance within which neighbours of candidates are searched at first [m].
Source: judgement; it is doubled for those that have too few.
"""
HEIGHTS, CANDIDATES, BOXES = '.heights.npz', '.candidates.npy', 'candidates.npz'
"""Suffixes of the files of the ground and candidates, and file of their bounds in all tiles."""
MOST_CANDIDATES = 2_000_000
"""
Candidates among which neighbours are searched at once, somewhat more where they are dense.
Source: numerical: 48 MB, and as much again for the tree.
"""

Answer = dict[str, Any]


def measure_bounds(job: TileJob, frame: CloudFrame) -> Answer:
    """Return least x, y, z and greatest of a tile's points in the frame [m], infinite if none."""
    parts = [bounds(frame.enter(points)) for points in job.iterate()]
    region = join_bounds({'bounds': [*low.tolist(), *high.tolist()]} for low, high, _ in parts)
    return {'bounds': region.ravel().tolist()}


def join_bounds(answers: Iterable[Answer]) -> Float64:
    """Return least x, y, z and greatest, (2, 3), over all tiles [m]."""
    region = np.array([[math.inf] * 3, [-math.inf] * 3])
    for answer in answers:
        region[0] = np.minimum(region[0], answer['bounds'][:3])
        region[1] = np.maximum(region[1], answer['bounds'][3:])
    return region


def measure_ground(
    job: TileJob, frame: CloudFrame, region: Float64, settings: HeightSettings
) -> Answer:
    """
    Measure the ground of a tile and its first halo, and store it with the tile.

    Parameters
    ----------
    job : TileJob
        The tile.
    frame : CloudFrame
        Of the whole grid.
    region : (2, 3) float64
        Least and greatest x, y and z of the grid in that frame [m]; fixes the ground cells.
    settings : HeightSettings
        Settings of the ground.

    Returns
    -------
    dict
        ``extremes``, least and greatest height [m], infinite where there is none.

    """
    found = job.read(job.tile.halo)
    surface = measure_surface(frame.enter(found.points), settings, region=region)
    ground = surface.ground
    known = surface.height[found.core & np.isfinite(surface.height)]
    with job.publish(HEIGHTS) as aside:
        np.savez(
            aside, height=surface.height, core=np.packbits(found.core),
            extremes=surface.extremes, num_finite=surface.num_finite,
            **{f'ground_{item.name}': getattr(ground, item.name) for item in fields(ground)},
        )
    return {
        'extremes': [float(known.min(initial=math.inf)), float(known.max(initial=-math.inf))],
    }


def count_tile(
    job: TileJob, extremes: tuple[float, float], settings: HeightSettings
) -> Answer:
    """Return the histogram of the heights stored with a tile."""
    edges = lay_edges(np.array(extremes, dtype=np.float32), settings)
    with np.load(f'{job.place}{HEIGHTS}') as kept:
        height = kept['height']
        is_core = np.unpackbits(kept['core'], count=len(height)).astype(bool)
    return {'counts': count_heights(height[is_core], edges).tolist()}


def load_surface(job: TileJob) -> Surface:
    """Return what `measure_ground` stored with a tile; OSError if it is there no more."""
    with np.load(f'{job.place}{HEIGHTS}') as kept:
        rows, columns = kept['ground_shape'].tolist()
        return Surface(
            height=kept['height'], extremes=kept['extremes'], num_finite=int(kept['num_finite']),
            ground=GroundGrid(
                origin=kept['ground_origin'], cell_size=float(kept['ground_cell_size']),
                shape=(rows, columns), table=kept['ground_table'],
                shift=int(kept['ground_shift']), height=kept['ground_height'],
                seen=kept['ground_seen'],
            ),
        )


def join_extremes(answers: Iterable[Answer]) -> tuple[float, float]:
    """Return least and greatest height over all tiles [m]."""
    low, high = math.inf, -math.inf
    for answer in answers:
        low, high = min(low, answer['extremes'][0]), max(high, answer['extremes'][1])
    return low, high


def find_peak(
    answers: Iterable[Answer], extremes: tuple[float, float], settings: HeightSettings
) -> float:
    """Return the peak of the histogram of all heights [m]."""
    edges = lay_edges(np.array(extremes, dtype=np.float32), settings)
    counts = np.zeros(settings.num_bins, dtype=np.int64)
    for answer in answers:
        counts += answer['counts']
    return find_ground_peak(counts, edges, settings.beta)


def measure_candidates(
    job: TileJob, frame: CloudFrame, region: Float64, peak: float, settings: Settings
) -> Answer:
    """
    Find the candidates of a tile, with the heights of `measure_ground`, and store them with it.

    Parameters
    ----------
    job : TileJob
        The tile.
    frame : CloudFrame
        Of the whole grid.
    region : (2, 3) float64
        Least and greatest x, y and z of the grid in that frame [m].
    peak : float
        Peak of the height histogram of the whole grid [m].
    settings : Settings
        Of all stages.

    Returns
    -------
    dict
        ``name`` of the tile, ``num`` candidates, ``box``, least x and y and greatest of them;
        ``low``, least x and y of the points off the ground [m].

    """
    found = job.read(job.tile.halo)
    points = frame.enter(found.points)
    height = extract_high(points, settings.height, surface=load_surface(job), peak=peak)
    cloud = gather_off_ground(points, height, settings.height.beta / 2, region[0, :2])
    own = cloud.points[found.core[cloud.place], :2]
    linearity = settings.linearity
    origin = anchor(cloud.points, cloud.high, linearity)
    places = find_candidates(cloud.points, cloud.high, origin, linearity).position
    places = places[_is_inside(frame.leave(places), job.tile.rectangle(job.grid))]
    with job.publish(CANDIDATES) as aside:
        np.save(aside, places)
    plan = places[:, :2]
    return {
        'name': job.tile.name, 'num': len(places),
        'low': own.min(axis=0, initial=math.inf).tolist(),
        'box': [*plan.min(axis=0, initial=math.inf).tolist(),
                *plan.max(axis=0, initial=-math.inf).tolist()],
    }


def write_candidate_boxes(folder: Path, answers: Sequence[Answer]) -> None:
    """Write the bounds of the candidates of each tile, for `measure_distances`."""
    held = [item for item in answers if item['num']]
    folder.mkdir(parents=True, exist_ok=True)
    np.savez(
        folder / BOXES, names=np.array([item['name'] for item in held], dtype=np.str_),
        boxes=np.array([item['box'] for item in held]).reshape(-1, 4),
        counts=np.array([item['num'] for item in held], dtype=np.int64),
    )


def measure_distances(folder: str, name: str, num_neighbors: int) -> Answer:
    """
    Measure the distance of a tile's candidates to their neighbours in all tiles.

    Parameters
    ----------
    folder : str
        With the candidates of all tiles.
    name : str
        Of the tile.
    num_neighbors : int
        Neighbours over which a distance is averaged.

    Returns
    -------
    dict
        ``num`` distances, their ``mean`` [m] and ``squares``, the sum of squared differences from
        it [m2].

    """
    with np.load(Path(folder) / BOXES) as known:
        names, boxes, counts = known['names'].tolist(), known['boxes'], known['counts']
    if name not in names or counts.sum() <= num_neighbors:
        return {'num': 0, 'mean': 0.0, 'squares': 0.0}
    own = boxes[names.index(name)]
    gaps = np.maximum(np.maximum(boxes[:, :2] - own[2:], own[:2] - boxes[:, 2:]), 0.0)
    apart = np.hypot(*gaps.T)
    places = np.load(Path(folder) / f'{name}{CANDIDATES}')
    spacing = np.zeros(len(places))
    rest, reach = np.arange(len(places)), REACH
    while len(rest):
        near = np.flatnonzero(apart <= reach)
        is_last = len(near) == len(names) or int(counts[near].sum()) > MOST_CANDIDATES
        tree = cKDTree(np.concatenate([
            np.load(Path(folder) / f'{names[k]}{CANDIDATES}') for k in near.tolist()
        ]))
        distance, _ = tree.query(places[rest], k=num_neighbors + 1)
        # a place that is not loaded lies beyond the reach
        sure = (distance[:, -1] <= reach) | is_last
        spacing[rest[sure]] = distance[sure, 1:].sum(axis=1) / num_neighbors
        rest, reach = rest[~sure], 2.0 * reach
    mean = float(spacing.mean())
    return {
        'num': len(spacing), 'mean': mean, 'squares': float(((spacing - mean) ** 2).sum()),
    }


def _is_inside(
    points: Float64, rectangle: tuple[float, float, float, float]
) -> np.ndarray:
    x, y = points[:, 0], points[:, 1]
    result: np.ndarray = (
        (x >= rectangle[0]) & (x < rectangle[2]) & (y >= rectangle[1]) & (y < rectangle[3])
    )
    return result


def join_spacing(
    answers: Sequence[Answer], lows: Iterable[Answer], num_neighbors: int
) -> tuple[tuple[float, float] | None, Float64]:
    """
    Join what `measure_distances` and `measure_candidates` tell of all tiles.

    Parameters
    ----------
    answers : sequence of dict
        Of `measure_distances`.
    lows : iterable of dict
        Of `measure_candidates`.
    num_neighbors : int
        Neighbours over which a distance is averaged.

    Returns
    -------
    spacing : tuple of float or None
        Mean and standard deviation of all distances [m], None where there are too few.
    low : (2,) float64
        Least x and y off the ground [m].

    """
    num = sum(answer['num'] for answer in answers)
    low = np.full(2, math.inf)
    for answer in lows:
        low = np.minimum(low, answer['low'])
    low[~np.isfinite(low)] = 0.0
    if num <= num_neighbors:
        return None, low
    mean = math.fsum(answer['num'] * answer['mean'] for answer in answers) / num
    squares = math.fsum(
        answer['squares'] + answer['num'] * (answer['mean'] - mean) ** 2 for answer in answers
    )
    return (mean, math.sqrt(squares / num)), low


def remove_kept(folder: Path) -> None:
    """Remove ground and candidates beside all tiles."""
    for pattern in (f'*{HEIGHTS}', f'*{CANDIDATES}', BOXES):
        for path in folder.glob(pattern):
            path.unlink()
