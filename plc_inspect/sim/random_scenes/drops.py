# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Service drops: houses beside a low-voltage line, and a conductor from a pole to each of them."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from plc_inspect.sim.random_scenes.lines import Line
from plc_inspect.sim.scenes.conductors import hang
from plc_inspect.sim.scenes.lines import add_drop
from plc_inspect.sim.scenes.scene import Label, SceneBuilder, UP
from plc_inspect.sim.scenes.structures import add_house

Float64 = NDArray[np.float64]

POLES = 0.5
"""Share of poles with a drop."""
BELOW = 0.4
"""Distance of a drop below the lowest conductor at its pole [m]."""
CLEARANCE = 2.7
"""Least height of a drop above the ground [m]."""
KEEP = 1.0
"""Least distance of houses from conductors, supports and other houses [m]."""


def add_drops(builder: SceneBuilder, line: Line, half_width: float) -> None:
    """Add houses within the corridor, and drops to them from some poles of a line."""
    rng = builder.rng
    stood = [(post.position[:2], 0.0) for post in builder.posts]
    wires = cKDTree(np.vstack([item.sample(0.25) for item in builder.conductors]))
    for stand in line.stands:
        if rng.random() > POLES:
            continue
        side = rng.choice([-1.0, 1.0])
        length, width = rng.uniform(8.0, 14.0), rng.uniform(6.0, 9.0)
        eaves = rng.uniform(3.5, 5.5)
        ridge = eaves + rng.uniform(1.5, 3.0)
        out = side * stand.left
        away = rng.uniform(7.0, max(8.0, min(24.0, half_width - width))) + 0.5 * width
        xy = (stand.foot + away * out + rng.uniform(-6.0, 6.0) * stand.ahead)[:2]
        base = np.array([xy[0], xy[1], builder.ground(xy)])
        edge = 0.3 + 0.5 * math.hypot(length, width)
        gap, _ = wires.query(base + ridge * UP)
        end = base - (0.55 * width + 0.25) * out + (eaves - 0.5) * UP
        start = stand.locate(0.0, min(z for _, z in line.layout.phases) - BELOW) + 0.16 * out
        slack = rng.uniform(0.01, 0.03)
        curve = hang(start, end, slack, line_id=0, span_id=0).sample(0.5)
        low = float((curve[:, 2] - builder.terrain.heights(curve[:, :2])).min())
        taken = any(np.hypot(*(xy - other)) < edge + reach + KEEP for other, reach in stood)
        if gap < edge + KEEP or low < CLEARANCE or taken:
            continue
        stood.append((xy, edge))
        add_house(
            builder, xy, math.atan2(stand.ahead[1], stand.ahead[0]), length=length, width=width,
            eaves=eaves, ridge=ridge,
        )
        builder.add_strut(end + 0.25 * out, end + 0.02 * out, 0.02, Label.BUILDING)
        add_drop(builder, start, end, sag_ratio=slack, radius=rng.uniform(0.005, 0.01))
