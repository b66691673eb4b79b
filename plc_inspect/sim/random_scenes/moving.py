# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Moving scanners of the random scenes: a car with a push-broom, and a Puck Lite in flight."""

from collections.abc import Iterator
from dataclasses import replace
import math

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from plc_inspect.sim.random_scenes.returns import Beams, Scanner
from plc_inspect.sim.random_scenes.surveys import PuckFlight, PushBroom
from plc_inspect.sim.scenes.routes import shift_route
from plc_inspect.sim.surveys.puck import NUM_RINGS, point_beams
from plc_inspect.sim.surveys.trajectory import drift, FlightPlan, fly, OdometryErrors

Float64 = NDArray[np.float64]

_BATCH = 400_000
_CAR_REACH, _PUCK_REACH = 60.0, 100.0
"""Greatest range of beams [m]."""
_UNDER = 0.35
"""Angle from straight down within which the car blocks its scanner [rad]."""
_MAST = 2.2
"""Height of the scanner of a car above the road [m]."""
_FIRINGS = 937
"""Firings in one turn of a Puck Lite at 20 Hz."""
_SPEED = 6.0
"""Speed of a flight [m/s]."""
_LOWEST = 2.5
"""Height of a flight above the ground, at least [m]."""


def drive(scanner: Scanner, pattern: PushBroom, rng: np.random.Generator) -> Iterator[Beams]:
    """Yield the beams of a car that drives along the route beside the line."""
    scene = scanner.scene
    road = shift_route(scene.route, pattern.lateral)
    edges = np.diff(road, axis=0)
    ends = np.concatenate([[0.0], np.cumsum(np.hypot(*edges.T))])
    along = np.arange(0.0, ends[-1], pattern.spacing)
    xy = np.column_stack([np.interp(along, ends, road[:, axis]) for axis in range(2)])
    # a car turns over some ten metres
    xy = gaussian_filter1d(xy, max(1.0, 5.0 / pattern.spacing), axis=0, mode='nearest')
    ahead = np.gradient(xy, axis=0)
    ahead /= np.maximum(np.hypot(*ahead.T)[:, None], 1e-9)
    eye = np.column_stack([xy, scene.terrain.heights(xy) + _MAST])
    eye[:, 2] = gaussian_filter1d(eye[:, 2], max(1.0, 2.0 / pattern.spacing), mode='nearest')
    walk = rng.normal(0.0, pattern.drift * math.sqrt(pattern.spacing / 100.0), eye.shape)
    offset = gaussian_filter1d(np.cumsum(walk, axis=0), max(1.0, 3.0 / pattern.spacing), axis=0)
    angle = np.arange(-math.pi + _UNDER, math.pi - _UNDER, pattern.step)
    # beams by their angle from straight up, positive to the left, in a plane turned about z
    lines = max(1, _BATCH // len(angle))
    cos, sin = math.cos(pattern.tilt), math.sin(pattern.tilt)
    for first in range(0, len(eye), lines):
        u = ahead[first:first + lines]
        left = np.column_stack([-u[:, 1] * cos - u[:, 0] * sin, u[:, 0] * cos - u[:, 1] * sin])
        beam = np.repeat(np.arange(len(u)), len(angle))
        turned = np.tile(angle, len(u)) + rng.uniform(0.0, pattern.step, len(u))[beam]
        directions = np.column_stack([np.sin(turned)[:, None] * left[beam], np.cos(turned)])
        yield Beams(
            origins=eye[first:first + lines][beam], directions=directions,
            reach=np.full(len(beam), _CAR_REACH), skipped=np.zeros(len(beam)),
            offset=offset[first:first + lines][beam],
        )


def follow(scanner: Scanner, pattern: PuckFlight, rng: np.random.Generator) -> Iterator[Beams]:
    """Yield the turns of a Puck Lite in flight along the line, displaced by odometry."""
    scene = scanner.scene
    truth = fly(scene, FlightPlan(
        speed=_SPEED, lateral=pattern.lateral, height=pattern.height, margin=10.0,
    ), rng)
    position = truth.position.copy()
    lowest = scene.terrain.heights(position[:, :2]) + _LOWEST  # beside the line lies a hill
    position[:, 2] = np.maximum(position[:, 2], lowest)
    truth = replace(truth, position=position)
    odometry = drift(truth, OdometryErrors(drift=pattern.drift), rng)
    firing = np.repeat(np.arange(_FIRINGS), NUM_RINGS)
    rings = np.tile(np.arange(NUM_RINGS), _FIRINGS)
    local = point_beams(-2.0 * math.pi * firing / _FIRINGS, rings)
    start = odometry.position[0] - truth.position[0]
    for begin in np.arange(truth.start, truth.start + truth.duration - 0.1,
                           pattern.advance / _SPEED):
        times = begin + 0.05 * firing / _FIRINGS
        position, rotation = truth.interpolate(times)
        if scanner.coverage.find(position[:1, :2])[0] < 0:
            continue
        put, turned = odometry.interpolate(times)
        yield Beams(
            origins=position, directions=np.einsum('nij,nj->ni', rotation, local),
            reach=np.full(len(local), _PUCK_REACH), skipped=np.zeros(len(local)),
            offset=put - position - start, turn=np.einsum('nij,nkj->nik', turned, rotation),
        )
