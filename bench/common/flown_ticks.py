# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Ticks along a flight: what the node's worker does, without ROS, over a cloud seen bit by bit."""

from collections.abc import Iterator
from dataclasses import dataclass
import time

import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.live.map_labels import make_planner
from plc_inspect.core.live.session import Session
from plc_inspect.core.live.window import copy_window
from plc_inspect.core.voxel_buffer.voxel_map import VoxelMap
from plc_inspect.ros.background.system_memory import take_memory

STEP = 10.0
"""Flown between two ticks [m]: a second."""
SIGHT = 60.0
"""What is this near along the line is seen [m]."""
SHARE = 0.3
"""Of the points in sight, those that one tick adds to the map."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlownTick:
    """One tick and how far the vehicle had come."""

    flown: float
    """[m]"""
    seconds: float
    """From the choice of the window to the labels in the map."""
    num_points: int
    """Of the window."""
    num_voxels: int
    """Of the map."""
    num_spans: int
    """Known so far."""


def fly_along(points: np.ndarray, rng: np.random.Generator) -> Iterator[FlownTick]:
    """
    Fly above a corridor that runs along x, and yield every tick.

    Parameters
    ----------
    points : (N, 3) float64
        The corridor [m].
    rng : numpy.random.Generator
        Draws what is seen.

    Yields
    ------
    FlownTick

    """
    settings = Settings()
    points = points[np.argsort(points[:, 0], kind='stable')]
    voxels = VoxelMap(settings.map)
    voxels.reserve(voxels.max_voxels)
    take_memory(voxels.memory)
    session = Session()
    planner = make_planner(settings)
    for x in np.arange(points[0, 0], points[-1, 0], STEP):
        first, last = np.searchsorted(points[:, 0], (x - SIGHT, x + SIGHT))
        seen = points[first:last]
        if not len(seen):  # between two corridors
            continue
        voxels.insert(seen[rng.random(len(seen)) < SHARE])
        vehicle = np.array([x, seen[:, 1].mean(), seen[:, 2].max()])
        started = time.perf_counter()
        plan = planner.plan(voxels, [item.span for item in session.state.spans], vehicle)
        if plan is None:
            continue
        window = next(item for item in copy_window(voxels, plan) if item is not None)
        done = session.tick(window, settings, vehicle)
        voxels.label(window.slots, window.points, done.labels)
        yield FlownTick(
            flown=float(x - points[0, 0]), seconds=time.perf_counter() - started,
            num_points=len(window.points), num_voxels=len(voxels),
            num_spans=len(done.state.spans),
        )
