# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Flights: trajectory, odometry, scanner and the placement of the truth."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plc_inspect.errors import ConfigError, DataError
from plc_inspect.sim.scenes.catalogue import make_scene, SCENES
from plc_inspect.sim.scenes.conductors import measure_distances
from plc_inspect.sim.scenes.placement import place_truth, Placement, PlacementSums
from plc_inspect.sim.surveys.flight import choose_nodes, Flight, PLANS, simulate_flight
from plc_inspect.sim.surveys.puck import POINT_DTYPE, Puck, scan
from plc_inspect.sim.surveys.raycast import build_world, label_items
from plc_inspect.sim.surveys.trajectory import (
    drift,
    FlightPlan,
    fly,
    OdometryErrors,
    RATE,
    rotate,
    Trajectory,
)


@pytest.fixture(scope='module')
def scene():
    """Make the scene of the demo."""
    return make_scene('demo', 3)


@pytest.fixture(scope='module')
def world(scene):
    """Make its arrays."""
    return build_world(scene)


class Sink:
    """Keeps what a flight makes."""

    def __init__(self):
        self.scans, self.nodes = [], []

    def write_scan(self, item):
        """Keep a scan."""
        self.scans.append(item)

    def write_odometry(self, odometry, index):
        """Keep a pose."""
        self.nodes.append(index)
        self.odometry = odometry


def test_rotation_against_scipy():
    """Rz Ry Rx as REP-103 says."""
    rpy = np.random.default_rng(0).uniform(-1.5, 1.5, (20, 3))
    expected = Rotation.from_euler('ZYX', rpy[:, ::-1]).as_matrix()
    np.testing.assert_allclose(rotate(rpy), expected, atol=1e-12)


def test_interpolation_by_hand():
    """Half-way between two nodes lies their mean."""
    steps = np.arange(5.0)
    item = Trajectory(start=10.0, position=np.column_stack([steps, 0 * steps, -steps]),
                      rpy=np.column_stack([0 * steps, 0 * steps, 0.1 * steps]))
    position, rotation = item.interpolate(np.array([10.0 + 1.5 / 200]))
    np.testing.assert_allclose(position, [[1.5, 0.0, -1.5]], atol=1e-9)
    np.testing.assert_allclose(rotation[0], rotate(np.array([[0, 0, 0.15]]))[0], atol=1e-9)
    assert item.duration == pytest.approx(4 / 200)


def test_flight_follows_the_line(scene):
    """Speed, offset and height are those of the plan; the vehicle sways."""
    item = fly(scene, FlightPlan(speed=6.0, lateral=9.0, height=3.0), np.random.default_rng(0))
    speed = np.linalg.norm(item.position[200:] - item.position[:-200], axis=1)
    assert np.median(speed) == pytest.approx(6.0, rel=0.1)
    gaps = np.min([measure_distances(item.position[::50], c) for c in scene.conductors], axis=0)
    assert np.median(gaps) == pytest.approx(np.hypot(7.8, 3.5), abs=1.5)
    assert np.degrees(item.rpy[:, :2].std()) == pytest.approx(2.0, rel=0.3)
    heading = np.degrees(np.interp([5.0, item.duration - 5.0], np.arange(len(item.rpy)) / 200,
                                   item.rpy[:, 2]))
    assert heading == pytest.approx([-8.0, 13.0], abs=7.0)


def test_shuttle_turns_back(scene):
    """A shuttle flies for as long as it is told, and comes by its start again."""
    once = fly(scene, FlightPlan(speed=10.0), np.random.default_rng(0))
    plan = FlightPlan(speed=10.0, shuttle=True, duration=2 * once.duration + 5.0)
    item = fly(scene, plan, np.random.default_rng(0))
    assert item.duration == pytest.approx(plan.duration, abs=0.02)
    back = round(2 * once.duration * 200)
    assert np.linalg.norm(item.position[back] - item.position[0]) < 3.0


@pytest.mark.parametrize('plan', [FlightPlan(speed=0.0), FlightPlan(duration=0.5)])
def test_impossible_flights_raise(scene, plan):
    """No speed or no time, no flight."""
    with pytest.raises(DataError):
        fly(scene, plan, np.random.default_rng(0))


def test_drift_is_as_large_as_promised():
    """Over 300 m the position error is about 0.2 % of the way, a tenth of it upwards."""
    along = np.linspace(0.0, 300.0, 10_000)
    truth = Trajectory(start=0.0, position=np.column_stack([along, 0 * along, 0 * along + 20]),
                       rpy=np.zeros((10_000, 3)))
    ends = np.array([
        drift(truth, OdometryErrors(), np.random.default_rng(seed)).position[-1]
        for seed in range(150)
    ]) - [300.0, 0.0, 0.0]
    spread = ends.std(axis=0)
    # OU of 0.002 per metre with 100 m of correlation: 0.002 sqrt(2 l (L - l (1 - exp(-L/l)))).
    expected = 0.002 * np.sqrt(200.0 * (300.0 - 100.0 * (1 - np.exp(-3.0))))
    assert spread[:2] == pytest.approx([expected, expected], rel=0.25)
    assert spread[2] == pytest.approx(0.1 * expected, rel=0.25)
    exact = drift(truth, OdometryErrors(drift=0.0, attitude_deg=0.0, jitter=0.0),
                  np.random.default_rng(0))
    np.testing.assert_allclose(exact.position, truth.position - truth.position[0], atol=1e-9)
    np.testing.assert_array_equal(exact.rpy, truth.rpy)


@pytest.mark.parametrize('first', [False, True])
def test_scan_puts_points_back_where_they_were(scene, world, first):
    """Points taken through their own pose and mounting are the exact hits, up to noise."""
    puck = Puck(lidar_xyz=(0.2, -0.1, 0.3), lidar_rpy_deg=(3.0, 20.0, -15.0), stamp_first=first)
    truth = fly(scene, PLANS['demo'], np.random.default_rng(1))
    turn = scan(world, label_items(scene, world).label, truth, puck, 40, np.random.default_rng(2))
    points = turn.points[0]
    assert points.dtype == POINT_DTYPE
    assert points.dtype.itemsize == 22
    time = points['time'].astype(float)
    assert time.min() >= (0.0 if first else -0.1)
    assert time.max() <= (0.1 if first else 0.0)
    position, rotation = truth.interpolate(turn.stamp + time)
    mount = Rotation.from_euler('ZYX', [-15.0, 20.0, 3.0], degrees=True).as_matrix()
    local = np.column_stack([points['x'], points['y'], points['z']]).astype(float)
    put = position + np.einsum('nij,nj->ni', rotation, local @ mount.T + puck.lidar_xyz)
    off = np.linalg.norm(put - turn.exact, axis=1)
    assert np.sqrt(np.mean(off**2)) == pytest.approx(0.03, rel=0.1)
    ranges = np.linalg.norm(local, axis=1)
    assert np.abs(ranges / 0.002 - np.round(ranges / 0.002)).max() < 0.01
    tilt = np.degrees(np.arcsin(local[:, 2] / ranges))
    np.testing.assert_allclose(tilt, -15.0 + 2.0 * points['ring'], atol=0.01)


def test_layouts_of_the_driver(scene, world):
    """Organised clouds hold all firings with NaN; dual return doubles; sectors cut."""
    labels = label_items(scene, world).label
    truth = fly(scene, PLANS['demo'], np.random.default_rng(1))

    def turn(**options):
        rng = np.random.default_rng(2)
        return scan(world, labels, truth, Puck(**options), 30, rng).points

    flat, grid = turn(), turn(organized=True)
    assert flat.shape[0] == 1
    assert grid.shape == (1875, 16)
    assert np.isnan(grid['x']).sum() == grid.size - flat.size
    np.testing.assert_array_equal(grid['x'][~np.isnan(grid['x'])], flat['x'][0])
    assert (grid['ring'] == np.arange(16)).all()
    assert turn(organized=True, rate=20.0).shape == (938, 16)
    assert turn(dual=True).size > 1.9 * flat.size
    dual = turn(organized=True, dual=True)
    assert dual.shape == (2 * 1875, 16)
    assert (dual['ring'] == np.arange(16)).all()
    one, other = dual[0::2], dual[1::2]
    np.testing.assert_array_equal(one['time'], other['time'])
    again = one['x'] == other['x']
    assert again.sum() > 0.7 * flat.size  # the only return of a beam comes twice, as it is
    for name in POINT_DTYPE.names:
        np.testing.assert_array_equal(one[name][again], other[name][again])
    apart = [np.linalg.norm([rows[axis] for axis in 'xyz'], axis=0) for rows in (one, other)]
    behind = (apart[1] - apart[0])[~again & ~np.isnan(apart[0] + apart[1])]
    assert len(behind) > 500
    assert behind.min() > -0.2  # noise of two returns
    assert np.median(behind) > 0.4
    side = turn(view_direction_deg=-90.0, view_width_deg=120.0, max_range=40.0)[0]
    azimuth = np.degrees(np.arctan2(side['y'], side['x']))
    assert np.abs(azimuth + 90.0).max() < 60.5
    assert np.hypot(side['x'], side['y']).max() <= 40.0


@pytest.mark.parametrize('rate', [7.0, 50.0, 80.0, 100.0, 130.0, 150.0, 200.0])
def test_odometry_comes_at_its_rate(rate):
    """Also where the rate does not divide that of the nodes; never twice at one node."""
    nodes = choose_nodes(4001, rate)
    assert len(nodes) == pytest.approx(20.0 * rate + 1, abs=1)
    assert np.abs(np.array(nodes) / RATE - np.arange(len(nodes)) / rate).max() <= 0.5001 / RATE
    assert len(set(nodes)) == len(nodes)
    assert max(nodes) <= 4000


@pytest.mark.parametrize('rate', [0.0, -1.0, 201.0, float('nan')])
def test_impossible_odometry_raises(rate):
    """No rate beyond that of the nodes."""
    with pytest.raises(ConfigError, match='up to 200 Hz'):
        Flight(odometry_rate=rate)


@pytest.mark.parametrize('options', [
    {'rate': 0.5}, {'min_range': 5.0, 'max_range': 4.0}, {'view_width_deg': 0.0},
])
def test_impossible_scanners_raise(options):
    """Settings outside of what the sensor can do."""
    with pytest.raises(ConfigError):
        Puck(**options)


def test_placement_finds_a_known_motion():
    """Yaw, shift and smear of a known motion come back."""
    rng = np.random.default_rng(0)
    points = rng.uniform((-40, -3, 5), (40, 3, 9), (5000, 3))
    points += [100.0, 50.0, 0.0]
    c, s = np.cos(0.004), np.sin(0.004)
    moved = points @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T + [0.4, -0.3, 0.05]
    sums = PlacementSums(np.array([100.0, 50.0, 0.0]))
    assert sums.solve() is None
    for part in np.array_split(np.arange(5000), 7):
        sums.add(points[part], moved[part])
    placement = sums.solve()
    assert placement.yaw == pytest.approx(0.004, abs=1e-9)
    np.testing.assert_allclose(placement.move(points), moved, atol=1e-9)
    assert placement.horizontal_rms == pytest.approx(0.0, abs=1e-4)
    noisy = PlacementSums(np.zeros(3))
    noisy.add(points, moved + rng.normal(0, 0.1, moved.shape))
    assert noisy.solve().horizontal_rms == pytest.approx(0.1 * np.sqrt(2), rel=0.05)
    assert noisy.solve().vertical_rms == pytest.approx(0.1, rel=0.05)


@pytest.mark.parametrize('yaw', [-0.02, 0.02])
def test_boxes_of_hazards_hold_what_was_in_them(yaw):
    """Also long ones that the drift turns, either way."""
    extent = np.array([[0.0, 0.0, 0.0], [60.0, 1.0, 3.0]])
    hazard = {'line_id': 0, 'span_id': 0, 'position': [30.0, 0.5, 3.0], 'extent': extent.tolist()}
    drifted = Placement(
        centre=np.array([30.0, 0.5, 0.0]), yaw=yaw, shift=np.array([0.3, 0.1, 0.0]),
    )
    truth = {'spans': [], 'supports': [], 'hazards': [hazard], 'planted': []}
    low, high = np.array(place_truth(truth, {}, drifted)['hazards'][0]['extent'])
    points = drifted.move(np.random.default_rng(0).uniform(*extent, (1000, 3)))
    assert (points >= low - 1e-9).all()
    assert (points <= high + 1e-9).all()
    assert (high - low)[1] == pytest.approx(1.0 + 60.0 * abs(yaw), rel=0.01)


@pytest.mark.slow
def test_truth_of_a_flight_lies_where_the_odometry_puts_it(scene):
    """Wire returns placed by the odometry lie on the placed conductors, not on the true ones."""
    sink = Sink()
    plan = replace(PLANS['demo'], duration=8.0)
    errors = OdometryErrors(drift=0.01)
    truth = simulate_flight(scene, sink, np.random.default_rng(5), Flight(
        plan=plan, errors=errors, odometry_rate=50.0,
    ))
    assert truth['num_scans'] == len(sink.scans) == 79
    assert truth['num_points'] == sum(item.points.size for item in sink.scans)
    assert np.diff(sink.nodes).tolist() == [4] * (len(sink.nodes) - 1)
    labels = label_items(scene, build_world(scene))
    points, conductor = [], []
    for item in sink.scans:
        wire = labels.conductor[item.items] >= 0
        table = item.points[0][wire]
        position, rotation = sink.odometry.interpolate(item.times[wire])
        local = np.column_stack([table['x'], table['y'], table['z']]).astype(float)
        points.append(position + np.einsum('nij,nj->ni', rotation, local))
        conductor.append(labels.conductor[item.items[wire]])
    points, conductor = np.vstack(points), np.concatenate(conductor)
    row = next(item for item in truth['spans'] if item['span_id'] == 0 and item['line_id'] == 1)
    placed = replace(scene.conductors[1], start=np.array(row['start']), end=np.array(row['end']))
    assert placed.a == pytest.approx(row['a'], abs=1e-6)
    off = measure_distances(points[conductor == 1], placed)
    assert np.median(off) < 0.1
    assert np.abs(np.array(row['start']) - row['world']['start']).max() > 1.0
    assert row['seen'] > 0.9
    assert row['num_points'] == (conductor == 1).sum()


def test_every_scene_has_a_plan():
    """No scene is flown by accident."""
    assert set(PLANS) == set(SCENES)
