# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Simulated flights: recorded scans and odometry, and their truth."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from plc_inspect.errors import ConfigError, DataError
from plc_inspect.sim.scenes.placement import (
    place_truth,
    Placement,
    PlacementSums,
    solve_placements,
)
from plc_inspect.sim.scenes.scene import Label, Scene
from plc_inspect.sim.surveys.bag import FlightSink
from plc_inspect.sim.surveys.puck import Puck, Scan, scan, START_DELAY
from plc_inspect.sim.surveys.raycast import build_world, label_items
from plc_inspect.sim.surveys.trajectory import (
    drift,
    FlightPlan,
    fly,
    OdometryErrors,
    RATE,
    Trajectory,
)
from plc_inspect.sim.surveys.truth import (
    count_post_points,
    make_truth,
    measure_along,
    NEAR,
    Sightings,
)

Float64 = NDArray[np.float64]
Int32 = NDArray[np.int32]

PLANS: dict[str, FlightPlan] = {
    'high_voltage': FlightPlan(speed=8.0, lateral=22.0, height=3.0),
    'low_voltage': FlightPlan(speed=5.0, lateral=6.0, height=2.5),
    'medium_voltage': FlightPlan(speed=5.0, lateral=1.5, height=6.0),
    'contact': FlightPlan(speed=5.0, lateral=1.5, height=6.0),
    'bundles': FlightPlan(speed=8.0, lateral=20.0, height=3.0),
    'double_circuit': FlightPlan(speed=7.0, lateral=22.0, height=7.0),
    'rack': FlightPlan(speed=5.0, lateral=7.0, height=1.0),
    'street': FlightPlan(speed=5.0, lateral=6.0, height=2.5),
    'angle': FlightPlan(speed=5.0, lateral=9.0, height=2.5),
    'valley': FlightPlan(speed=8.0, lateral=22.0, height=3.0),
    'crossing': FlightPlan(speed=7.0, lateral=22.0, height=3.0),
    'hidden': FlightPlan(speed=8.0, lateral=22.0, height=3.0),
    'no_line': FlightPlan(speed=6.0, height=18.0),
    'town': FlightPlan(speed=6.0, height=16.0),
    'demo': FlightPlan(speed=6.8, lateral=9.0, height=2.5, margin=5.0),
}
"""Default flight plan of each scene."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Flight:
    """Plan, sensor and errors of a flight."""

    plan: FlightPlan | None = None
    """None: the default plan of the scene."""
    puck: Puck = field(default_factory=Puck)
    errors: OdometryErrors = field(default_factory=OdometryErrors)
    odometry_rate: float = 100.0
    """Rate of odometry messages, at most RATE [Hz]; each has the pose of one node."""

    def __post_init__(self) -> None:
        """Raise ConfigError unless the odometry has a possible rate."""
        if not 0.0 < self.odometry_rate <= RATE:
            raise ConfigError(
                f'odometry comes at up to {RATE:g} Hz, got {self.odometry_rate:g}'
            )


_CELL = 0.1
_THIN = 0.15


@dataclass(slots=True)
class _Tally:
    """Bounded sums over the returns of a flight."""

    scene: Scene
    counts: list[NDArray[np.int64]]
    sums: list[PlacementSums]
    near: Float64
    near_label: NDArray[np.uint8]
    near_gap: Float64
    posts: NDArray[np.int64]
    tree: cKDTree | None
    limit: int = 200_000
    """Number of near returns above which they are thinned; grows with what is left."""

    def add_wires(self, exact: Float64, put: Float64, conductor: Int32) -> None:
        """Count wire returns along their conductors, and add them to the placements."""
        for number in np.unique(conductor):
            rows = conductor == number
            item, count = self.scene.conductors[number], self.counts[number]
            cell = (measure_along(exact[rows], item) / _CELL).astype(np.int64)
            np.add.at(count, np.clip(cell, 0, len(count) - 1), 1)
            self.sums[number].add(exact[rows], put[rows])

    def add_others(self, exact: Float64, label: NDArray[np.uint8]) -> None:
        """Keep the returns near conductors, and count those of supports."""
        if self.tree is None:
            return
        self.posts += count_post_points(self.scene, exact[label == Label.TOWER])
        other = np.isin(label, (Label.VEGETATION, Label.BUILDING, Label.OTHER))
        gap, _ = self.tree.query(exact[other], distance_upper_bound=NEAR)
        good = np.isfinite(gap)
        self.near = np.vstack([self.near, exact[other][good]])
        self.near_label = np.concatenate([self.near_label, label[other][good]])
        self.near_gap = np.concatenate([self.near_gap, gap[good]])
        if len(self.near) > self.limit:
            self.thin()
            self.limit = max(self.limit, 2 * len(self.near))

    def thin(self) -> None:
        """Keep the return nearest to a conductor in each small cell."""
        cells = np.floor(self.near / _THIN).astype(np.int64)
        order = np.lexsort((self.near_gap, *cells.T))
        changed = np.ones(len(order), dtype=bool)
        changed[1:] = (np.diff(cells[order], axis=0) != 0).any(axis=1)
        keep = np.sort(order[changed])
        self.near, self.near_gap = self.near[keep], self.near_gap[keep]
        self.near_label = self.near_label[keep]

    def sum_up(self) -> Sightings:
        """Return the sightings of the flight so far."""
        self.thin()
        return Sightings(
            wire_x=tuple(
                np.asarray((np.flatnonzero(count) + 0.5) * _CELL, dtype=np.float64)
                for count in self.counts
            ),
            num_points=np.array([int(count.sum()) for count in self.counts], dtype=np.int64),
            near=self.near, near_label=self.near_label, post_points=self.posts,
        )


def _begin_tally(scene: Scene) -> _Tally:
    curves = [item.sample(0.25) for item in scene.conductors]
    return _Tally(
        scene=scene, near=np.zeros((0, 3)), near_label=np.zeros(0, dtype=np.uint8),
        counts=[np.zeros(int(item.length / _CELL) + 1, dtype=np.int64)
                for item in scene.conductors],
        sums=[PlacementSums(item.lowest) for item in scene.conductors],
        near_gap=np.zeros(0), posts=np.zeros(len(scene.posts), dtype=np.int64),
        tree=cKDTree(np.vstack(curves)) if curves else None,
    )


def simulate_flight(
    scene: Scene, writer: FlightSink, rng: np.random.Generator, flight: Flight | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """
    Fly along a scene, record scans and odometry, and return the truth.

    Memory does not grow with the length of the flight: each scan is written at once.

    Parameters
    ----------
    scene : Scene
        What is surveyed.
    writer : FlightWriter
        An open recording, or another receiver of scans and poses.
    rng : numpy.random.Generator
        Source of all randomness.
    flight : Flight, optional
        Plan, sensor and errors.
    progress : callable, optional
        Called with the number of scans made and their total.

    Returns
    -------
    dict
        Content of ``truth.json`` in the odometry frame.

    Raises
    ------
    DataError
        The plan gives no flight.

    """
    flight = flight or Flight()
    puck = flight.puck
    truth = fly(scene, flight.plan or PLANS.get(scene.name, FlightPlan()), rng)
    odometry = drift(truth, flight.errors, rng)
    world = build_world(scene)
    labels, tally = label_items(scene, world), _begin_tally(scene)
    num_scans = int((truth.duration - START_DELAY - 1.0 / RATE) * puck.rate)
    if num_scans < 1:
        raise DataError(f'a flight of {truth.duration:g} s has no scan of {1 / puck.rate:g} s')
    nodes = deque(choose_nodes(len(truth.position), flight.odometry_rate))
    num_points = 0
    for number in range(num_scans):
        turn = scan(world, labels.label, truth, puck, number, rng)
        while nodes and truth.start + nodes[0] / RATE <= turn.stamp:
            writer.write_odometry(odometry, nodes.popleft())
        writer.write_scan(turn)
        num_points += len(turn.items)
        conductor = labels.conductor[turn.items]
        wire = conductor >= 0
        if wire.any():
            put = _put(turn, wire, truth, odometry)
            tally.add_wires(turn.exact[wire], put, conductor[wire])
        tally.add_others(turn.exact[~wire], labels.label[turn.items[~wire]])
        if progress is not None:
            progress(number + 1, num_scans)
    for node in nodes:
        writer.write_odometry(odometry, node)
    content = make_truth(
        scene, tally.sum_up(), kind='flight', frame_id='odom', bin_size=2.0, noise=puck.noise,
    )
    placements = solve_placements(scene.conductors, tally.sums)
    middle = len(truth.position) // 2
    default = Placement(
        centre=truth.position[middle], yaw=0.0,
        shift=odometry.position[middle] - truth.position[middle],
    )
    return {
        **place_truth(content, placements, default), 'num_scans': num_scans,
        'num_points': num_points, 'duration': num_scans / puck.rate,
        'odometry_origin': truth.position[0].tolist(),
    }


def choose_nodes(num: int, rate: float) -> list[int]:
    """Return the nodes, of so many of a trajectory, of odometry at a rate [Hz]: the nearest."""
    times = np.arange(0.0, num - 0.5, RATE / rate)
    return [int(node) for node in np.floor(times + 0.5)]


def _put(
    turn: Scan, rows: NDArray[np.bool_], truth: Trajectory, odometry: Trajectory,
) -> Float64:
    """Return the mapped positions of some returns (N, 3) [m]."""
    position, rotation = truth.interpolate(turn.times[rows])
    other, turned = odometry.interpolate(turn.times[rows])
    local = np.einsum('nji,nj->ni', rotation, turn.exact[rows] - position)
    return np.einsum('nij,nj->ni', turned, local) + other
