# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The bench of hazards told live: a few seconds of one flight, and what it counts."""

import importlib
from pathlib import Path
import sys

import numpy as np
import pytest
from spans import make_hazard

from plc_inspect.config import Settings

BENCH = Path(__file__).parents[2] / 'bench'


@pytest.fixture(scope='module')
def bench():
    """Import the bench as it is when it is run as a script."""
    sys.path[:0] = [str(BENCH), str(BENCH / 'studies')]
    try:
        yield importlib.import_module('live_hazards')
    finally:
        for folder in (BENCH, BENCH / 'studies'):
            sys.path.remove(str(folder))


@pytest.mark.parametrize(('told', 'figures'), [
    ({7: (3.0, '')}, [1, 1, 0, 0, 0, 0, 0]),
    ({7: (60.0, '')}, [1, 1, 0, 0, 1, 0, 0]),
    ({}, [0, 1, 0, 0, 0, 1, 0]),
    ({7: (3.0, ''), 8: (3.0, 'gone')}, [2, 1, 1, 0, 0, 0, 0]),
    ({7: (3.0, ''), 8: (3.0, '')}, [2, 1, 0, 1, 0, 0, 0]),
])
def test_what_live_and_final_do_not_agree_in_is_counted(bench, told, figures):
    vehicle = bench.Vehicle(Settings())
    vehicle.track = [np.zeros(3)]
    vehicle.told = {number: bench.Told(*item) for number, item in told.items()}
    found, words = bench.compare(vehicle, {7: make_hazard(position=np.zeros(3))})
    assert found == figures
    assert len(words) == sum(figures[4:6])


def test_hazards_far_from_the_way_need_not_be_raised(bench):
    vehicle = bench.Vehicle(Settings())
    vehicle.track = [np.array([100.0, 0.0, 0.0])]
    found, words = bench.compare(vehicle, {7: make_hazard(position=np.zeros(3))})
    assert found == [0, 1, 0, 0, 0, 0, 1]
    assert words == []


@pytest.mark.slow
def test_a_flight_tells_its_state_at_the_end(bench):
    vehicle, state = bench.fly(3, Settings(), 4.0, 0.3)
    assert vehicle.state is not None
    assert len(vehicle.track) > 100
    assert vehicle.told
    assert {item.hazard_id for item in state.hazards} >= {
        number for number, item in vehicle.told.items() if not item.reason
    }
