# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Buildings of the random scenes: houses with gutters, and flat roofs."""

import math

import numpy as np
from numpy.typing import NDArray

from plc_inspect.sim.scenes.scene import Label, SceneBuilder, UP
from plc_inspect.sim.scenes.structures import add_house

Float64 = NDArray[np.float64]


def add_random_house(builder: SceneBuilder, xy: Float64, azimuth: float) -> None:
    """Add a gabled house with gutters along its eaves."""
    rng = builder.rng
    length, width = rng.uniform(8.0, 16.0), rng.uniform(6.0, 10.0)
    eaves = rng.uniform(2.5, 6.5)
    ridge = eaves + 0.5 * width * math.tan(math.radians(rng.uniform(20.0, 50.0)))
    add_house(builder, xy, azimuth, length=length, width=width, eaves=eaves, ridge=ridge)
    u = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    v = np.array([-u[1], u[0], 0.0])
    base = np.array([xy[0], xy[1], builder.ground(xy)])
    low = base + (eaves - 0.1 * (ridge - eaves)) * UP
    for side in (-1.0, 1.0):
        eave = low + side * (0.55 * width + 0.08) * v
        builder.add_strut(eave - 0.525 * length * u, eave + 0.525 * length * u, 0.06,
                          Label.BUILDING)


def add_flat_roof(builder: SceneBuilder, xy: Float64, azimuth: float) -> None:
    """Add a hall with a flat roof, a parapet or rail, and boxes and pipes on top."""
    rng = builder.rng
    size = np.array([rng.uniform(12.0, 50.0), rng.uniform(8.0, 30.0)])
    high = rng.uniform(3.0, 14.0)
    u = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    v = np.array([-u[1], u[0], 0.0])
    base = np.array([xy[0], xy[1], builder.ground(xy)])
    add_box(builder, base - 1.5 * UP, 0.5 * size[0] * u, 0.5 * size[1] * v, high + 1.5)
    roof = base + high * UP
    ring = [roof + 0.5 * size[0] * a * u + 0.5 * size[1] * b * v
            for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    edge = rng.choice(['none', 'parapet', 'rail'])
    for k in range(4):
        start, end = ring[k], ring[(k + 1) % 4]
        if edge == 'parapet':
            wall = rng.uniform(0.3, 0.9) * UP
            builder.add_face(np.array([start, end, end + wall, start + wall]), Label.BUILDING)
        elif edge == 'rail':
            for up in (0.55, 1.1):
                builder.add_strut(start + up * UP, end + up * UP, 0.025, Label.BUILDING)
    for _ in range(int(rng.integers(0, 6))):
        place = rng.uniform(-0.4, 0.4, 2) * size
        middle = roof + place[0] * u + place[1] * v
        if rng.random() < 0.6:
            half = rng.uniform(0.4, 1.5, 2)
            add_box(builder, middle, half[0] * u, half[1] * v, rng.uniform(0.5, 2.0))
        else:
            half = 0.5 * rng.uniform(2.0, 0.8 * size[1])
            pipe = middle + rng.uniform(0.2, 0.6) * UP
            builder.add_strut(pipe - half * v, pipe + half * v, rng.uniform(0.05, 0.2),
                              Label.BUILDING)


def add_box(
    builder: SceneBuilder, base: Float64, along: Float64, across: Float64, height: float,
) -> None:
    """Add an upright box; ``along`` and ``across`` (3,) reach from its middle to its sides [m]."""
    up = height * UP
    ring = [base + a * along + b * across for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    for k in range(4):
        start, end = ring[k], ring[(k + 1) % 4]
        builder.add_face(np.array([start, end, end + up, start + up]), Label.BUILDING)
    builder.add_face(np.array(ring) + up, Label.BUILDING)
