# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The Velodyne Puck Lite: directions and times of its beams, and its measurements."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plc_inspect.errors import ConfigError
from plc_inspect.sim.surveys.ray_kernels import GROUND, MISS
from plc_inspect.sim.surveys.raycast import Beam, cast, World
from plc_inspect.sim.surveys.trajectory import rotate, Trajectory

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]
Int32 = NDArray[np.int32]

NUM_RINGS = 16
POINT_RATE = 300_000
POINT_DTYPE = np.dtype({
    'names': ['x', 'y', 'z', 'intensity', 'ring', 'time'],
    'formats': ['<f4', '<f4', '<f4', '<f4', '<u2', '<f4'],
    'offsets': [0, 4, 8, 12, 16, 18], 'itemsize': 22,
})
"""Point layout of the driver."""

START_DELAY = 0.05
"""Time from the start of the odometry to the first scan [s]."""
_LASER_DELAY = 2.304e-6
_REFLECTIVITY = {1: 30, 2: 25, 5: 45, 6: 60, 14: 18, 15: 40}


@dataclass(frozen=True, slots=True, kw_only=True)
class Puck:
    """Mounting and settings of the scanner and its driver."""

    rate: float = 10.0
    """Turns per second [Hz]."""
    noise: float = 0.03
    """Standard deviation of a range [m]."""
    quantum: float = 0.002
    """Resolution of a range [m]."""
    min_range: float = 0.4
    """Nearer returns are dropped by the driver [m]."""
    max_range: float = 100.0
    """Farther returns are dropped by the driver [m]."""
    lidar_xyz: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Position of the lidar in the base frame [m]."""
    lidar_rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Roll, pitch and yaw of the lidar in the base frame [deg]."""
    view_direction_deg: float = 0.0
    """Middle of the sector that the driver passes on, counter-clockwise from x [deg]."""
    view_width_deg: float = 360.0
    """Width of that sector [deg]."""
    dual: bool = False
    """Two returns per beam; the second repeats the first if there is only one."""
    organized: bool = False
    """Publish firings x rings, NaN where there is no return."""
    stamp_first: bool = False
    """Stamp the first packet (times >= 0), not the last (times <= 0)."""

    def __post_init__(self) -> None:
        """Raise ConfigError unless the settings are possible."""
        if not 1.0 <= self.rate <= 20.0:
            raise ConfigError(f'the scanner turns at 1 to 20 Hz, got {self.rate:g}')
        if not 0.0 <= self.min_range < self.max_range <= 200.0:
            raise ConfigError(f'no ranges from {self.min_range:g} to {self.max_range:g} m')
        if not 0.0 < self.view_width_deg <= 360.0:
            raise ConfigError(f'no sector of {self.view_width_deg:g} degrees')

    @property
    def num_firings(self) -> int:
        """Firings per turn, of 16 beams each."""
        return round(POINT_RATE / NUM_RINGS / self.rate)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scan:
    """One turn of the scanner: points of the message, and truth of the returns."""

    stamp: float
    """Header stamp on the clock of the trajectory [s]."""
    points: NDArray[np.void]
    """(rows, columns) of POINT_DTYPE in the lidar frame; one row unless organised."""
    times: Float64
    """(M,) times of the returns [s]."""
    exact: Float64
    """(M, 3) true positions of the returns in the world [m]."""
    items: Int32
    """(M,) items of the world that were hit."""


def scan(
    world: World, labels: NDArray[np.uint8], trajectory: Trajectory, puck: Puck, number: int,
    rng: np.random.Generator,
) -> Scan:
    """
    Measure one turn.

    Parameters
    ----------
    world : World
        Scene, from `plc_inspect.sim.surveys.raycast.build_world`.
    labels : ndarray
        ASPRS class of each item of the world.
    trajectory : Trajectory
        True poses of the base.
    puck : Puck
        The scanner.
    number : int
        The scan begins `START_DELAY` + number / rate after the trajectory [s].
    rng : numpy.random.Generator
        Source of all randomness.

    Returns
    -------
    Scan

    """
    # firings within the view, and the time of each beam
    begin = trajectory.start + START_DELAY + number / puck.rate
    firing = np.arange(puck.num_firings)
    turn = np.mod(-2 * np.pi * firing / puck.num_firings, 2 * np.pi)
    off = np.abs(np.angle(np.exp(1j * (turn - np.radians(puck.view_direction_deg)))))
    firing = firing[off <= np.radians(puck.view_width_deg) / 2 + 1e-9]
    rings = np.tile(np.arange(NUM_RINGS), len(firing))
    delay = np.repeat(firing / (puck.num_firings * puck.rate), NUM_RINGS) + rings * _LASER_DELAY
    # cast the beams from the pose at their time
    azimuth = -2 * np.pi * puck.rate * delay
    local = point_beams(azimuth, rings)
    position, rotation = trajectory.interpolate(begin + delay)
    mount = rotate(np.radians([puck.lidar_rpy_deg]))[0]
    origins = position + rotation @ np.array(puck.lidar_xyz)
    directions = np.einsum('nij,nj->ni', rotation @ mount, local)
    num_returns = 2 if puck.dual else 1
    ranges, items = cast(
        world, origins, directions, np.full(len(local), puck.max_range),
        Beam(max_returns=num_returns, pass_share=0.5), int(rng.integers(2**62)),
    )
    # keep the returns that are detected, with noise and in range
    beam, order = np.nonzero(items != MISS)
    seen = _is_detected(ranges[beam, order], items[beam, order], directions[beam], rng)
    beam, order = beam[seen], order[seen]
    measured = ranges[beam, order] + rng.normal(0.0, puck.noise, len(beam))
    measured = np.round(measured / puck.quantum) * puck.quantum
    good = (measured >= puck.min_range) & (measured <= puck.max_range)
    beam, order, measured = beam[good], order[good], measured[good]
    # write the message: the returns of a firing one after the other, each of all rings
    stamp = begin if puck.stamp_first else begin + float(delay[-1] if len(delay) else 0.0)
    table = np.zeros(ranges.shape, dtype=POINT_DTYPE)
    for name in ('x', 'y', 'z'):
        table[name] = np.nan
    for axis, name in enumerate('xyz'):
        table[name][beam, order] = measured * local[beam, axis]
    table['ring'] = rings[:, None]
    table['time'] = (begin + delay - stamp)[:, None]
    shade = np.array([_REFLECTIVITY.get(int(label), 30) for label in range(32)])
    bright = shade[labels[items[beam, order]]] * np.exp(-measured / 120.0)
    bright += rng.normal(0, 3, len(beam))
    table['intensity'][beam, order] = np.clip(np.round(bright), 1, 255)
    if puck.dual:
        alone = items[:, 1] == MISS
        for rows in (table, ranges, items):
            rows[alone, 1] = rows[alone, 0]
    place = np.arange(table.size).reshape(-1, NUM_RINGS, num_returns).swapaxes(1, 2).ravel()
    table = table.ravel()[place]
    hit = np.flatnonzero(~np.isnan(table['x']))
    source, order = np.divmod(place[hit], num_returns)
    return Scan(
        stamp=stamp, times=begin + delay[source], items=items[source, order],
        points=table.reshape(-1, NUM_RINGS) if puck.organized else table[hit][None],
        exact=origins[source] + ranges[source, order][:, None] * directions[source],
    )


def point_beams(azimuth: Float64, rings: NDArray[np.int64]) -> Float64:
    """Return the directions (N, 3) of beams in the lidar frame, from azimuth [rad] and ring."""
    elevation = np.radians(-15.0 + 2.0 * rings)
    return np.column_stack([
        np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth),
        np.sin(elevation),
    ])


def _is_detected(
    ranges: Float64, items: Int32, directions: Float64, rng: np.random.Generator,
) -> NDArray[np.bool_]:
    """Drop far returns of ground at grazing incidence, at random; return the (N,) mask to keep."""
    limit = 400.0 * np.sqrt(0.25 * np.abs(directions[:, 2]))
    chance = 1.0 / (1.0 + np.exp(np.clip((ranges - limit) / 6.0, -50.0, 50.0)))
    return (items != GROUND) | (rng.uniform(size=len(ranges)) < chance)
