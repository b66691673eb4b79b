# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A vehicle that passes a cloud and sees it piece by piece, as the node would."""

import numpy as np

from plc_inspect.config import MapSettings, Settings
from plc_inspect.core.live.map_labels import make_planner
from plc_inspect.core.live.session import Session
from plc_inspect.core.live.window import copy_window
from plc_inspect.core.voxel_buffer.voxel_map import VoxelMap


def copy(voxels, plan):
    """Return the window of a plan."""
    return next(item for item in copy_window(voxels, plan) if item is not None)


def fly(points, ticks, settings=None):
    """Let a vehicle pass from x = -10 to 140 m; return session, map and the state of each tick."""
    settings = settings or Settings()
    voxels, session, planner = VoxelMap(MapSettings()), Session(), make_planner(settings)
    states, rng = [], np.random.default_rng(0)
    for number in range(ticks):
        x = -10.0 + 150.0 * number / ticks
        near = np.abs(points[:, 0] - x) < 35.0
        voxels.insert(points[near & (rng.random(len(points)) < 0.5)])
        spans = [item.span for item in states[-1].spans] if states else []
        vehicle = np.array([x, 5.0, 20.0])
        plan = planner.plan(voxels, spans, vehicle)
        if plan is None:
            continue
        window = copy(voxels, plan)
        done = session.tick(window, settings, vehicle)
        voxels.label(window.slots, window.points, done.labels)
        states.append(done.state)
    return session, voxels, states
