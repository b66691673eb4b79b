# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Loads the kernels before the first scan, or compiles them the first time."""

from dataclasses import replace

import numpy as np

from plc_inspect.config import MapSettings, Settings
from plc_inspect.core.alignment.cell_comparison import OPEN_NS
from plc_inspect.core.alignment.normal_cells import NormalCells
from plc_inspect.core.alignment.registration import fit_points, sample_points
from plc_inspect.core.alignment.rigid_move import RigidMove
from plc_inspect.core.clustering.sharpening import find_dots, sharpen
from plc_inspect.core.extraction.dust import find_dust
from plc_inspect.core.ground.ground_grid import make_unknown
from plc_inspect.core.hazards.clearance_rules import PLAIN
from plc_inspect.core.hazards.strands import divide_section
from plc_inspect.core.live.proximity import measure_proximity
from plc_inspect.core.live.session import Session
from plc_inspect.core.live.surroundings import surround
from plc_inspect.core.live.window import copy_window, WindowPlanner
from plc_inspect.core.mapping.accumulator import Accumulator
from plc_inspect.core.numerics.assignment import assign
from plc_inspect.core.setup.steady_fit import find_quantile
from plc_inspect.core.voxel_buffer.voxel_map import INITIAL_CAPACITY
from plc_inspect.results import Float64


def make_sample() -> Float64:
    """Return (N, 3) points of three conductors over two spans, poles, a tree and the ground."""
    rng = np.random.default_rng(0)
    along = np.arange(0.0, 120.0, 0.15)
    inside = along % 60.0 - 30.0
    parts = [
        np.column_stack((along, np.full(len(along), side), 9.0 + inside**2 / 900.0))
        for side in (-1.2, 0.0, 1.2)
    ]
    for x in (0.0, 60.0, 120.0):
        up = np.arange(0.0, 10.5, 0.1)
        parts.append(np.column_stack((np.full(len(up), x), np.zeros(len(up)), up)))
    x, y = (item.ravel() for item in np.mgrid[-5.0:125.0:0.7, -15.0:15.0:0.7])
    parts.append(np.column_stack((x, y, np.zeros(len(x)))))
    parts.append(np.array([30.0, 4.0, 5.0]) + rng.normal(0.0, 1.2, (600, 3)))
    points: Float64 = np.concatenate(parts)
    return points + rng.normal(0.0, 0.01, points.shape)


def make_rarities() -> Float64:
    """
    Return (N, 3) points of what few lines have [m].

    A service drop from the second pole of the sample, two conductors that end in the air, one of
    them with a gap, and a piece too short to prove its curvature.
    """
    along = np.arange(20.0, 118.0, 0.15)
    parts = [
        np.column_stack((x, np.full(len(x), side), 8.0 + (x - 69.0) ** 2 / 900.0))
        for side, x in ((-13.0, along), (-14.0, along[np.abs(along - 67.5) > 7.5]))
    ]
    short = np.arange(40.0, 54.0, 0.15)
    parts.append(np.column_stack((
        short, np.full(len(short), 12.0), 8.0 + (short - 47.0) ** 2 / 5000.0
    )) + np.random.default_rng(1).normal(0.0, 0.03, (len(short), 3)))
    tap = np.arange(0.3, 7.0, 0.1)
    parts.append(np.column_stack((60.0 + 0.3 * tap, tap, 9.6 - 0.12 * tap + 0.001 * tap**2)))
    points: Float64 = np.concatenate(parts)
    return points


def warm_up_intake() -> None:
    """Run what the scans' and the odometry's callbacks run, on made-up data."""
    # more room than at first, so that it grows
    settings = MapSettings(max_voxels=INITIAL_CAPACITY + 1)
    accumulator = Accumulator(Settings(map=settings))
    points = make_sample()[::2].astype(np.float32)
    times = np.linspace(-0.1, 0.0, len(points))
    for number in range(4):
        stamp = 1_000_000_000 + 100_000_000 * number
        accumulator.add_pose(stamp, (0.1 * number, 0.0, 20.0), (0.0, 0.0, 0.0, 1.0), now=0.0)
        accumulator.add_scan(stamp, points, times, now=0.0)
    cells = NormalCells()
    for number in range(3):
        cells.add(sample_points(points.astype(np.float64)), number)
    fit_points(cells, points.astype(np.float64), RigidMove(), np.eye(4), 2 * OPEN_NS)
    accumulator.entry.near.find(points[0].astype(np.float64), 8.0, accumulator.map.cells, 0)
    voxels = accumulator.map
    plan = WindowPlanner(4.0).plan(voxels, (), None)
    if plan is not None:
        window = next(item for item in copy_window(voxels, plan) if item is not None)
        window.holds(window.points)
        voxels.label(window.slots, window.points, np.zeros(len(window.slots), dtype=np.uint8))
    voxels.drop(0, np.zeros(256, dtype=np.bool_))
    voxels.take_changes(0, 10)


def warm_up_pipeline(settings: Settings, *, rare: bool = False) -> int:
    """
    Run the pipeline on a made-up line.

    Parameters
    ----------
    settings : Settings
        For the pipeline; the rules are the plain ones, which need no file.
    rare : bool
        Add what few lines have, to reach every kernel, and import what is rarely needed.

    Returns
    -------
    int
        Spans found: six with the default settings, ten with ``rare``.

    """
    settings = replace(settings, hazards=replace(settings.hazards, rules=PLAIN))
    points = make_sample()
    if rare:
        find_quantile(1)
        assign(np.zeros((2, 2)), 1.0)  # two rows with the same cheapest column
        along = np.arange(100.0)
        make_unknown().tell_seen(points[:1])
        divide_section(along, np.column_stack((along % 2.0, along % 3.0 / 100.0)))  # a bundle
        aside, above = sharpen(along, along % 2.0, along % 3.0, 0.0)  # a rack
        find_dots(along, aside, above, 50.0)
        points = np.concatenate((points, make_rarities()))
    _, result, _ = Session().conclude(points, settings, 0, complete=True)
    find_dust(points[:1000], points[:1])
    around = surround(result.spans, points)
    measure_proximity(around, True, points[0], np.ones(3), settings.proximity, points[:9])
    return len(result.spans)
