# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

from dataclasses import replace
from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticStatus
import pytest

from plc_inspect.config import MapSettings
from plc_inspect.core.extraction.dust import LONE
from plc_inspect.core.live.session import Session
from plc_inspect.core.setup.sharpness import ON_TRUST, Sharpness
from plc_inspect.core.voxel_buffer.voxel_map import VoxelMap
from plc_inspect.results import StageReport
from plc_inspect.ros.node.diagnostics import describe_map
from plc_inspect.ros.node.doubt import KnownStates, TRUSTED_NS

NOTHING = Session().state
SECOND = 10**9


def fly(seconds):
    """Return what was known after ticks of 2 s, numbered by ``num_points``."""
    known = KnownStates(NOTHING)
    for stamp in range(0, seconds * SECOND, 2 * SECOND):
        known.add(stamp, replace(NOTHING, num_points=stamp, hazards=('one',)))
    return known


def doubt(known, seconds, text='the heading drifts'):
    return known.hold_back(SimpleNamespace(doubt=text, last_inserted=seconds * SECOND))


def test_what_was_known_before_the_odometry_went_wrong_is_told():
    known = fly(60)
    held = doubt(known, 60)
    assert 60 * SECOND - held.num_points == TRUSTED_NS + SECOND  # ticks are 2 s apart
    assert held.hazards == ()
    assert held.sharpness.poor
    assert held.sharpness.describe() == 'the heading drifts'
    assert known.state is held
    assert doubt(known, 61) is None  # told already


def test_nothing_is_told_where_the_flight_was_young():
    held = doubt(fly(8), 8)
    assert held.num_points == 0
    assert not held.spans
    assert held.sharpness.poor


def test_nothing_is_held_back_without_doubt_or_state():
    assert doubt(fly(8), 8, '') is None
    assert doubt(KnownStates(NOTHING), 8) is None
    assert KnownStates(NOTHING).state is None


def test_a_tick_that_ends_after_the_doubt_is_held_back_too():
    known = fly(60)
    first = doubt(known, 60)
    known.add(61 * SECOND, replace(NOTHING, num_points=1))
    assert doubt(known, 62).num_points == first.num_points


def test_what_a_blurred_map_told_is_held_back_too():
    known = fly(8)
    blurred = Sharpness(num_cells=40, blur=2.0)
    known.add(9 * SECOND, replace(NOTHING, num_points=1, sharpness=blurred))
    assert known.state.sharpness.poor
    held = doubt(known, 10)
    assert held.num_points == 0
    assert held.sharpness.describe() == 'the heading drifts'


def test_few_states_are_kept():
    assert len(fly(600)._states) < 12


def test_what_was_before_time_went_back_is_forgotten():
    known = fly(600)
    for stamp in range(0, 300 * SECOND, 2 * SECOND):
        known.add(stamp, NOTHING)
        assert len(known._states) < 12


@pytest.mark.parametrize(('num_hazards', 'sharpness', 'level', 'text'), [
    (1, Sharpness(), DiagnosticStatus.WARN, ON_TRUST),
    (0, Sharpness(), DiagnosticStatus.OK, '0% of the map in use'),
    (1, Sharpness(num_cells=40), DiagnosticStatus.OK, '0% of the map in use'),
])
def test_hazards_of_a_map_of_unknown_sharpness_are_a_warning(num_hazards, sharpness, level, text):
    state = replace(NOTHING, hazards=(None,) * num_hazards, sharpness=sharpness)
    status = describe_map(VoxelMap(MapSettings()), 0, 0, '', state)
    assert (status.level, status.message) == (level, text)


def test_dusty_air_is_a_warning_and_hides_no_error():
    height = StageReport(name='height', num_in=1000, num_kept=50, dropped={LONE: 60})
    state = replace(NOTHING, sharpness=Sharpness(num_cells=40), stages=(height,))
    status = describe_map(VoxelMap(MapSettings()), 0, 0, '', state)
    assert status.level == DiagnosticStatus.WARN
    assert '60 of 1000 points (6%)' in status.message
    status = describe_map(VoxelMap(MapSettings()), 0, 0, 'turned round', state)
    assert status.level == DiagnosticStatus.ERROR
    assert 'turned round; dusty air' in status.message


def test_poles_that_lean_are_a_warning():
    state = replace(NOTHING, sharpness=Sharpness(num_cells=40, remark='3 poles lean'))
    status = describe_map(VoxelMap(MapSettings()), 0, 0, '', state)
    assert status.level == DiagnosticStatus.WARN
    assert status.message.endswith('; 3 poles lean')
