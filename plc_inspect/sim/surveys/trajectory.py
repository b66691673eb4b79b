# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""True trajectories of the vehicle, and odometry with errors."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from plc_inspect.errors import DataError
from plc_inspect.sim.scenes.scene import Scene

Float64 = NDArray[np.float64]

RATE = 200.0
"""Rate of the nodes of a trajectory, linear between them [Hz]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightPlan:
    """Where and how fast to fly along the route of a scene."""

    speed: float = 6.0
    """[m/s]"""
    lateral: float = 0.0
    """Offset to the left of the route [m]."""
    height: float = 6.0
    """Height above the highest phase, or above the ground without a line [m]."""
    margin: float = 8.0
    """Distance by which the flight exceeds the end supports [m]."""
    sway_deg: float = 2.0
    """Standard deviation of roll and pitch [deg]."""
    duration: float = 0.0
    """Length of the flight [s], 0: once along the route."""
    shuttle: bool = False
    """Fly back and forth until the duration is over."""
    waypoints: tuple[tuple[float, float, float], ...] = ()
    """Waypoints in the frame of the scene, in place of the route [m]."""
    turning: float = 0.0
    """Standard deviation of the time over which the speed is smoothed at the ends [s]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trajectory:
    """Poses at a fixed rate, linear between nodes."""

    start: float
    """Time of the first node [s]."""
    position: Float64
    """(N, 3) positions of the base [m]."""
    rpy: Float64
    """(N, 3) roll, pitch and unwrapped yaw [rad]."""

    @property
    def duration(self) -> float:
        """Time from the first to the last node [s]."""
        return (len(self.position) - 1) / RATE

    def interpolate(self, times: Float64) -> tuple[Float64, Float64]:
        """
        Return the poses at times within the trajectory.

        Parameters
        ----------
        times : ndarray
            (K,) float64 [s].

        Returns
        -------
        position : ndarray
            (K, 3) [m].
        rotation : ndarray
            (K, 3, 3) from base to world.

        """
        at = np.clip((times - self.start) * RATE, 0.0, len(self.position) - 1.000001)
        low = at.astype(np.int64)
        share = (at - low)[:, None]
        position = self.position[low] * (1 - share) + self.position[low + 1] * share
        return position, rotate(self.rpy[low] * (1 - share) + self.rpy[low + 1] * share)


def rotate(rpy: Float64) -> Float64:
    """Return the rotations (K, 3, 3) Rz(yaw) Ry(pitch) Rx(roll) of rpy (K, 3) [rad]."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy).T, np.sin(rpy).T
    return np.stack([
        np.stack([cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr], axis=-1),
        np.stack([sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr], axis=-1),
        np.stack([-sp, cp * sr, cp * cr], axis=-1),
    ], axis=-2)


def fly(scene: Scene, plan: FlightPlan, rng: np.random.Generator) -> Trajectory:
    """
    Return the true trajectory of a flight along the route of a scene.

    The vehicle follows the smoothed route at a height above the line, heads along it, and sways.

    Raises
    ------
    DataError
        The plan has no speed, or the flight would be shorter than a second.

    """
    if not plan.speed > 0:
        raise DataError(f'no flight at {plan.speed:g} m/s')
    path = _join_waypoints(plan.waypoints) if plan.waypoints else _lay_path(scene, plan)
    step = np.linalg.norm(np.diff(path, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(step)])
    duration = plan.duration or float(along[-1]) / plan.speed
    if not plan.shuttle:
        duration = min(duration, float(along[-1]) / plan.speed)
    if duration < 1.0:
        raise DataError(f'a flight of {duration:g} s is too short')
    times = np.arange(0.0, duration, 1.0 / RATE)
    travelled = plan.speed * times
    if plan.shuttle:
        phase = np.mod(travelled, 2 * along[-1])
        travelled = np.where(phase > along[-1], 2 * along[-1] - phase, phase)
        if plan.turning > 0.0:
            travelled = gaussian_filter1d(travelled, plan.turning * RATE, mode='nearest')
    position = np.column_stack([np.interp(travelled, along, path[:, axis]) for axis in range(3)])
    heading = np.unwrap(_find_headings(path))
    yaw = np.interp(travelled, along, gaussian_filter1d(heading, 10, mode='nearest'))
    sway = np.radians(plan.sway_deg)
    rpy = np.column_stack([
        _wander(rng, len(times), 0.6) * sway, _wander(rng, len(times), 0.6) * sway,
        yaw + _wander(rng, len(times), 2.0) * sway,
    ])
    for axis, size in enumerate((0.25, 0.25, 0.15)):
        position[:, axis] += size * _wander(rng, len(times), 1.5)
    return Trajectory(start=0.0, position=position, rpy=rpy)


def _join_waypoints(waypoints: tuple[tuple[float, float, float], ...]) -> Float64:
    """Return the straight path through waypoints, a node (K, 3) every metre [m]."""
    places = np.array(waypoints, dtype=np.float64)
    step = np.linalg.norm(np.diff(places, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(step)])
    s = np.arange(0.0, along[-1] + 1.0)
    return np.column_stack([np.interp(s, along, places[:, axis]) for axis in range(3)])


def _find_headings(path: Float64) -> Float64:
    """Return the directions (K,) in plan of a path, kept where it is vertical [rad]."""
    x, y = np.gradient(path[:, 0]), np.gradient(path[:, 1])
    moves = np.hypot(x, y) > 1e-6
    if not moves.any():
        return np.zeros(len(path))
    last = np.maximum.accumulate(np.where(moves, np.arange(len(path)), moves.argmax()))
    return np.asarray(np.arctan2(y, x)[last])


def _lay_path(scene: Scene, plan: FlightPlan) -> Float64:
    """Return the path along the line, a node (K, 3) every metre [m]."""
    route = _list_supports(scene)
    edges = np.diff(route, axis=0)
    lengths = np.hypot(*edges.T)
    first, last = edges[0] / lengths[0], edges[-1] / lengths[-1]
    route = np.vstack([
        route[0] - (plan.margin + 60.0) * first, route[1:-1],
        route[-1] + (plan.margin + 60.0) * last,
    ])
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(route, axis=0).T))])
    s = np.arange(0.0, along[-1], 1.0)
    xy = np.column_stack([np.interp(s, along, route[:, axis]) for axis in range(2)])
    heights = _find_heights(scene, xy)
    tangent = gaussian_filter1d(np.gradient(xy, axis=0), 6, axis=0, mode='nearest')
    tangent /= np.hypot(*tangent.T)[:, None]
    xy = gaussian_filter1d(xy, 5, axis=0, mode='nearest')
    xy += plan.lateral * np.column_stack([-tangent[:, 1], tangent[:, 0]])
    z = gaussian_filter1d(heights, 12, mode='nearest') + plan.height
    inside = slice(60, len(s) - 60)
    return np.column_stack([xy, z])[inside]


def _list_supports(scene: Scene) -> Float64:
    """Return the route (K, 2) of the supports of the first line, or that of the scene [m]."""
    first = [item for item in scene.conductors if item.line_id == 0]
    if not first:
        return scene.route
    feet = {tuple(post.position[:2]): None for post in scene.posts if 0 in post.line_ids}
    return np.array(list(feet))


def _find_heights(scene: Scene, xy: Float64) -> Float64:
    """Return the heights (N,) of the highest phase at xy (N, 2), or of the ground [m]."""
    if not scene.conductors:
        return scene.terrain.heights(xy)
    phases = [item for item in scene.conductors if item.line_id == 0]
    nodes = np.vstack([item.sample(1.0) for item in phases])
    gap = (xy[:, None, 0] - nodes[None, :, 0]) ** 2 + (xy[:, None, 1] - nodes[None, :, 1]) ** 2
    return np.asarray(nodes[gap.argmin(axis=1), 2])


def _wander(rng: np.random.Generator, num: int, smoothness: float) -> Float64:
    """Return a smooth random signal (num,) of unit standard deviation; smoothness [s]."""
    signal = gaussian_filter1d(rng.normal(size=num + 2000), smoothness * RATE / 2)
    return signal[1000:num + 1000] / max(float(signal.std()), 1e-9)


@dataclass(frozen=True, slots=True, kw_only=True)
class OdometryErrors:
    """Errors of the odometry."""

    drift: float = 0.002
    """Standard deviation of the horizontal slip per distance, along each axis."""
    vertical_share: float = 0.1
    """Vertical drift as a share of the horizontal drift."""
    correlation: float = 100.0
    """Correlation length of the slip [m]."""
    attitude_deg: float = 0.05
    """Standard deviation of roll, pitch and yaw [deg]."""
    jitter: float = 0.005
    """Standard deviation of the position noise, smooth over a tenth of a second [m]."""


def drift(truth: Trajectory, errors: OdometryErrors, rng: np.random.Generator) -> Trajectory:
    """
    Return the odometry of a true trajectory.

    The slip per distance is an Ornstein-Uhlenbeck process along the path, so the position error
    is a smooth random walk.  The frame of the odometry has its origin where the flight began, and
    the axes of the world.

    Parameters
    ----------
    truth : Trajectory
        Trajectory in the world frame.
    errors : OdometryErrors
        Size of the errors.
    rng : numpy.random.Generator
        Source of all randomness.

    Returns
    -------
    Trajectory
        Trajectory in the odometry frame, at the same times.

    """
    num = len(truth.position)
    step = np.linalg.norm(np.diff(truth.position, axis=0, prepend=truth.position[:1]), axis=1)
    keep = np.exp(-step.mean() / errors.correlation)
    noise = rng.normal(size=(num, 3)) * np.sqrt(1 - keep**2)
    noise[0] = rng.normal(size=3)
    slip = lfilter([1.0], [1.0, -keep], noise, axis=0)
    slip *= errors.drift * np.array([1.0, 1.0, errors.vertical_share])
    error = np.cumsum(slip * step[:, None], axis=0)
    error += errors.jitter * np.column_stack([_wander(rng, num, 0.1) for _ in range(3)])
    tilt = np.radians(errors.attitude_deg)
    rpy = truth.rpy + tilt * np.column_stack([_wander(rng, num, 0.3) for _ in range(3)])
    return Trajectory(
        start=truth.start, position=truth.position - truth.position[0] + error, rpy=rpy,
    )
