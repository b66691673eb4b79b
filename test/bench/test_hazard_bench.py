# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The bench of hazards: one scene whole, and what it counts."""

import importlib
from pathlib import Path
import sys

import numpy as np
import pytest
from spans import make_hazard

from plc_inspect.results import HazardKind
from plc_inspect.sim.surveys.planted import Planted

pytestmark = pytest.mark.slow

BENCH = Path(__file__).parents[2] / 'bench'


@pytest.fixture(scope='module')
def bench():
    """Import the bench as it is when it is run as a script."""
    sys.path.insert(0, str(BENCH))
    try:
        yield importlib.import_module('hazards')
    finally:
        sys.path.remove(str(BENCH))


@pytest.fixture(scope='module')
def rows(bench):
    """Survey one scene."""
    return bench.survey(3, 20.0)


def test_what_is_planted_is_found_once_and_nothing_else(bench, rows):
    assert bench.list_faults(rows) == []
    tallies = bench.tally(rows)
    planted = {item.kind for item in tallies if item.due + item.safe + item.close}
    assert planted == set(HazardKind) - {HazardKind.MISSING}  # studies/missing_conductors.py
    assert sum(item.due for item in tallies) >= 5
    assert all(check.passed for check in bench.check_tallies(tallies))


def test_faults_are_counted(bench, rows):
    hazard = next(found[0] for _, _, found in rows if found)
    place = Planted(kind=HazardKind.VEGETATION, position=np.zeros(2))
    missed, safe = (place, -1.0, []), (place, 1.0, [hazard])
    twice, stray = (place, -1.0, [hazard, hazard]), (None, 0.0, [hazard])
    faults = [missed, safe, twice, stray]
    assert [line.split(':')[0] for line in bench.list_faults(faults)] == [
        'missed', 'raised', 'twice', 'for nothing',
    ]
    by_kind = {item.kind: item for item in bench.tally(faults)}
    own = by_kind[HazardKind.VEGETATION]
    assert (own.due, own.found, own.safe, own.raised, own.doubled) == (2, 1, 1, 1, 1)
    assert by_kind[hazard.kind].stray == 1
    assert not any(check.passed for check in bench.check_tallies(list(by_kind.values())))


@pytest.fixture(scope='module')
def real(bench):
    """Import what holds hazards against classes of points."""
    return importlib.import_module('common.real_hazards')


def test_hazards_are_held_against_classes(real):
    wire = np.column_stack([np.arange(0.0, 20.0, 0.1), np.zeros(200), np.full(200, 10.0)])
    tree = np.column_stack([np.full(150, 5.0), np.linspace(1.0, 9.0, 150), np.full(150, 10.0)])
    points = np.vstack([wire, tree])
    label = np.repeat(np.array([14, 5], dtype=np.uint8), [200, 150])
    objects = real.list_objects(points, label)
    assert [len(own) for own in objects] == [150]
    own = make_hazard(tree[0], clearance=1.2)
    far = make_hazard(tree[-1], clearance=9.0)
    false = make_hazard(wire[3], clearance=0.1)
    result = real.judge(points, label, objects, [own, own, far, false])
    assert (result.due, result.missed, result.twice) == (1, 0, 1)
    assert (result.on_wire, result.beyond, result.for_nothing) == (1, 1, 1)
    np.testing.assert_allclose(result.errors, [0.2, 0.2, 0.0], atol=1e-9)
    assert real.judge(points, label, objects, [false]).missed == 1
    checks = real.check(real.PASTED[0], [result])
    assert [check.passed for check in checks] == [False, True, False, False, False, False, True]
    nothing = real.judge(wire, label[:200], [], [own])
    assert nothing.for_nothing == 0
    assert [check.passed for check in real.check(real.CLEAN[0], [nothing])] == [False, False]
    none = real.judge(wire, label[:200], [], [])
    assert all(check.passed for check in real.check(real.CLEAN[0], [none]))


def test_without_real_clouds_nothing_is_said_of_them(bench, rows, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(bench, 'survey', lambda seed, density: rows)
    assert bench.main(['--seeds', '1', '--real', str(tmp_path / 'none')]) == 0
    said = capsys.readouterr()
    assert 'Real clouds' not in said.out
    assert 'planted hazards' in said.out
    assert 'there is no' in said.err
