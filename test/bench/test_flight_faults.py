# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The benches of faulty flights: the faults they do, and that a wrong row ends them with 1."""

from dataclasses import replace
import importlib
from pathlib import Path
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from spans import make_hazard, make_span

from plc_inspect.results import PointClass, Severity

sys.path.insert(0, str(Path(__file__).parents[2] / 'bench'))
flights = importlib.import_module('flights.faulty_flights')
faults = importlib.import_module('flights.event_faults')
BENCHES = [
    importlib.import_module(f'studies.{name}') for name in ('input_faults', 'odometry_faults')
]
sys.path.pop(0)
LINE = make_span((0.0, 0.0, 10.0), (60.0, 0.0, 10.0))
GHOST = make_span((0.0, 3.0, 10.0), (60.0, 3.0, 10.0))
CRITICAL = make_hazard((30.0, 0.0, 8.0), severity=Severity.CRITICAL)
SCENE = SimpleNamespace(name='made', seed=1, conductors=[SimpleNamespace(
    sample=lambda step: flights.trace([LINE])[1:],
)])


def make_found(**changes):
    """Return what comes of a flight without a fault."""
    values = {
        'spans': (LINE,), 'hazards': (), 'doubled': 0.1, 'poor': False, 'restarts': 0, 'told': [],
        'said': {}, 'offset': 0.0, 'true': np.zeros((40, 3)), 'off': np.zeros((40, 3)),
    }
    return flights.Found(**(values | changes))


@pytest.fixture(autouse=True)
def stands(monkeypatch):
    """Return a function that puts something of a class to a place of the scene."""
    def put(place, label):
        cloud = SimpleNamespace(exact=np.array([place]), label=np.array([label]))
        monkeypatch.setattr(flights, 'simulate_map', lambda *_: cloud)
    put((0.0, 0.0, -90.0), PointClass.GROUND)
    return put


@pytest.fixture(params=BENCHES, ids=lambda bench: bench.__name__)
def bench(request, monkeypatch):
    """Return a bench that flies nothing, and finds what a test says."""
    bench = request.param
    own = bench is BENCHES[0]
    monkeypatch.setattr(bench, 'draw_flight' if own else 'fly_back', lambda *_: (
        (SCENE, None, 'a line') if own else (SCENE, None)
    ))
    monkeypatch.setattr(bench, 'record', lambda *_: None)
    return bench


def run(bench, monkeypatch, found):
    """Run the step of 2 m after a flight without fault; return the exit code."""
    results = iter([make_found(), found])
    monkeypatch.setattr(bench, 'put_together', lambda *_, **__: next(results))
    arguments = ['step of 2 m', '--seeds', '1']
    if bench is BENCHES[1]:
        arguments += ['--scenes', 'rack']
    monkeypatch.setattr(sys, 'argv', ['bench', *arguments])
    return bench.main()


def test_right_flights_end_with_0(bench, monkeypatch, capsys):
    assert run(bench, monkeypatch, make_found()) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith('0 ')


@pytest.mark.parametrize('change', [
    {'hazards': (CRITICAL,)}, {'doubled': 0.3, 'spans': (LINE, GHOST)},
])
def test_a_wrong_row_ends_with_1_and_is_named(bench, monkeypatch, capsys, change):
    assert run(bench, monkeypatch, make_found(**change)) == 1
    *_, count, name = capsys.readouterr().out.splitlines()
    assert count.startswith('1 ')
    assert name.strip() in ('1 step of 2 m', 'rack 1 step of 2 m')


@pytest.mark.parametrize(('place', 'label', 'code'), [
    ((30.0, 0.0, 8.2), PointClass.VEGETATION, 0),
    ((30.0, 0.0, 8.2), PointClass.TOWER, 1),
    ((30.0, 0.0, 8.2), PointClass.WIRE, 1),
    ((32.0, 0.0, 8.2), PointClass.VEGETATION, 1),
])
def test_a_critical_is_right_where_something_stands(
    bench, monkeypatch, stands, place, label, code
):
    stands(place, label)
    assert run(bench, monkeypatch, make_found(hazards=(CRITICAL,))) == code


@pytest.mark.parametrize(('nearer', 'code'), [(0.2, 0), (0.4, 1)])
def test_what_stands_is_as_near_as_a_critical_says(bench, monkeypatch, stands, nearer, code):
    place = np.array([30.0, 0.0, 8.2])
    stands(place, PointClass.VEGETATION)
    away = np.linalg.norm(flights.trace([LINE])[1:] - place, axis=1).min()
    found = make_found(hazards=(replace(CRITICAL, clearance=away - nearer),))
    assert run(bench, monkeypatch, found) == code


@pytest.mark.parametrize(('change', 'code'), [
    ({'spans': ()}, 1),
    ({'spans': (), 'said': {'step': 20.0}}, 0),
    ({'spans': (), 'poor': True}, 0),
    ({'spans': (LINE, GHOST), 'said': {'step': 20.0}}, 1),
])
def test_what_is_missing_must_be_said(monkeypatch, capsys, change, code):
    bench = BENCHES[0]
    monkeypatch.setattr(bench, 'draw_flight', lambda seed: (SCENE, None, 'a line'))
    monkeypatch.setattr(bench, 'record', lambda *_: None)
    assert run(bench, monkeypatch, make_found(**change)) == code


def change(fault, times):
    """Return positions and quaternions of a straight flight with a fault."""
    poses = [
        flights.Pose(time, np.array([time, 0.0, 0.0]), np.array([0.0, 0.0, time, 1.0]))
        for time in times
    ]
    changed = [item for pose in poses for item in fault(pose)]
    return np.array([item.position for item in changed]), [item.quaternion[2] for item in changed]


def test_frozen_poses_repeat_the_last_one_whole():
    positions, turns = change(faults.freeze(1.0, 2.0), [0.5, 1.0, 1.5, 2.5, 3.0, 3.5])
    assert positions[:, 0].tolist() == turns == [0.5, 1.0, 1.0, 1.0, 3.0, 3.5]


def test_steps_and_drifts_add_up():
    way = np.array([0.0, 1.0, 0.0])
    positions, _ = change(faults.move(1.0, 2.0, 0.5, way), [0.0, 1.0, 2.0])
    assert positions[:, 1].tolist() == [0.0, 0.5, 3.0]


def test_dust_is_within_ten_metres_and_of_the_time():
    scan = flights.Turn(0.3, np.full((5000, 3), 50.0), np.zeros(5000))
    (dusty,), (again,) = (list(faults.raise_dust(0.1)(scan)) for _ in range(2))
    moved = (dusty.xyz != 50.0).any(axis=1)
    assert moved.mean() == pytest.approx(0.1, abs=0.02)
    assert (np.linalg.norm(dusty.xyz[moved], axis=1) < 10.0).all()
    assert np.array_equal(dusty.xyz, again.xyz)
    assert (scan.xyz == 50.0).all()


def test_a_lidar_that_is_mounted_otherwise_sees_points_turned_back():
    seen = flights.Turn(0.0, np.array([[1.0, 0.0, 0.0]], dtype=np.float32), np.zeros(1))
    (event,) = faults.mount_otherwise((0.0, 0.0, 90.0))(seen)
    np.testing.assert_allclose(event.xyz, [[0.0, -1.0, 0.0]], atol=1e-6)
