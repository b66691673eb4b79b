# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Explanations are true: the setting that is named, moved as told, changes the outcome."""

import dataclasses

import numpy as np
import pytest
from toys import make_ground, make_line_cloud, make_tree, make_wire

from plc_inspect.config import LinearitySettings, SegmentSettings, Settings
from plc_inspect.core.evidence.validation import BORNE
from plc_inspect.core.explain.catenary_view import Curves, CurveView
from plc_inspect.core.explain.clustering_view import Windows
from plc_inspect.core.explain.extraction_view import Place
from plc_inspect.core.explain.point import confirm, explain_point, find_nearest
from plc_inspect.core.explain.proposals import propose, rank
from plc_inspect.core.extraction.linearity import anchor
from plc_inspect.core.extraction.occupancy import drop_bulk
from plc_inspect.core.pipeline import enter_frame, Pipeline
from plc_inspect.errors import DataError
from plc_inspect.results import Decision
from plc_inspect.setting_names import update

SETTINGS = Settings()
ORDER = (
    'height', 'linearity', 'outliers', 'alignment', 'clustering', 'catenary', 'supports',
    'corridor',
)


def make_rod(start, end, radius=0.02, num=200, seed=0):
    """Make a straight rod of points."""
    rng = np.random.default_rng(seed)
    share = np.sort(rng.random(num))[:, None]
    rod = np.array(start, float) + share * np.subtract(end, start)
    return rod + rng.normal(0.0, radius, (num, 3))


def make_things():
    """Make one thing for each stage to drop, beside a line of three conductors."""
    return {
        'bush': make_tree(20.0, -12.0, 3.5, 0.5),
        'tree': make_tree(60.0, -12.0, 12.0),
        'stay': make_rod((30, 12, 7), (38, 12, 12), num=300, seed=1),
        'rack': np.vstack([
            make_rod((100, y, z), (112, y, z), num=160, seed=9 * z + y)
            for y in (10, 11, 12) for z in (8, 9, 10)
        ]),
        'stick': make_rod((190, -14, 9), (191.2, -14, 9), num=60, seed=2),
        'pipe': make_rod((120, -12, 9), (150, -12, 9), radius=0.3, num=2500, seed=4),
        'arc': make_wire((150, 13, 9), (161, 13, 9), c=50, per_metre=20, seed=5),
    }


@pytest.fixture(scope='module')
def cloud():
    """Return points in their own frame, and the names of the things that they belong to."""
    things = make_things()
    points, label = make_line_cloud(more=things.values(), half_width=20.0)
    names = np.where(label == 14, 'line', 'rest').astype('U8')
    names[label == 1] = np.repeat(list(things), [len(item) for item in things.values()])
    return enter_frame(points)[0], names


@pytest.fixture(scope='module')
def trace(cloud):
    """Run the pipeline once."""
    return Pipeline().trace(cloud[0])


def decide(points, index, moves):
    """Return the decision on a point in a run with some settings at other values."""
    return Decision(Pipeline(update(SETTINGS, moves)).run(points).decision[index])


def pick(cloud, trace, name, decision):
    """Return five points of a thing that were decided so."""
    rows = np.flatnonzero((cloud[1] == name) & (trace.result.decision == decision))
    assert len(rows), f'no {decision.name} in {name}'
    return rows[np.linspace(0, len(rows) - 1, 5).astype(np.int64)].tolist()


@pytest.mark.slow
@pytest.mark.parametrize(('name', 'decision', 'setting'), [
    ('bush', Decision.TOO_LOW, 'height.beta'),
    ('rack', Decision.NOT_LINEAR, 'linearity.max_occupied'),
    ('pipe', Decision.NOT_LINEAR, 'linearity.threshold'),
    ('stay', Decision.NOT_LINEAR, 'linearity.max_inclination_deg'),
    ('tree', Decision.OUTLIER, 'outliers.sigma'),
    ('stick', Decision.NO_SECTION, 'alignment.min_votes'),
    ('pipe', Decision.NO_CLUSTER, 'clustering.max_thickness'),
    ('arc', Decision.NO_CATENARY, 'catenary.min_evidence'),
    ('line', Decision.WIRE, 'catenary.'),
])
def test_the_named_setting_moved_as_told_changes_the_outcome(
    cloud, trace, name, decision, setting
):
    points = cloud[0]
    tried = 0
    for index in pick(cloud, trace, name, decision):
        explanation = explain_point(trace, points, SETTINGS, index)
        assert explanation.decision == decision
        for proposal in explanation.proposals[:1]:
            after = decide(points, index, proposal.moves)
            if decision == Decision.WIRE:
                assert after != Decision.WIRE
            else:
                assert after > decision, proposal
            tried += proposal.setting.startswith(setting)
    assert tried


@pytest.mark.parametrize(('name', 'decision', 'is_steep'), [
    ('stay', Decision.NOT_LINEAR, True), ('line', Decision.WIRE, False),
])
def test_what_is_steep_is_said_to_be_searched_later(cloud, trace, name, decision, is_steep):
    told = [
        any('searched as steep' in note for finding in explanation.findings
            for note in finding.notes)
        for explanation in (
            explain_point(trace, cloud[0], SETTINGS, index)
            for index in pick(cloud, trace, name, decision)
        )
    ]
    assert any(told) if is_steep else not any(told)


@pytest.mark.parametrize(('name', 'decision', 'step'), [
    ('bush', Decision.TOO_LOW, 0.02), ('tree', Decision.OUTLIER, -0.12),
    ('stick', Decision.NO_SECTION, 1),
])
def test_a_little_less_than_told_is_not_enough(cloud, trace, name, decision, step):
    index = pick(cloud, trace, name, decision)[2]
    proposal = explain_point(trace, cloud[0], SETTINGS, index).proposals[0]
    assert decide(cloud[0], index, {proposal.setting: proposal.after + step}) == decision


@pytest.mark.slow
def test_two_settings_are_named_where_one_is_not_enough(cloud, trace):
    told = 0
    rows = np.flatnonzero((cloud[1] == 'tree') & (trace.result.decision == Decision.NOT_LINEAR))
    for index in rows[::250].tolist():
        for proposal in explain_point(trace, cloud[0], SETTINGS, index).proposals[:1]:
            assert decide(cloud[0], index, proposal.moves) > Decision.NOT_LINEAR
            for name, value in proposal.moves.items():
                if proposal.also:
                    assert decide(cloud[0], index, {name: value}) == Decision.NOT_LINEAR
            told += proposal.also is not None
    assert told


@pytest.mark.slow
def test_confirmed_changes_are_those_of_a_run_of_their_own(cloud, trace):
    rng = np.random.default_rng(3)
    confirmed = 0
    for decision in (Decision.NOT_LINEAR, Decision.NO_CLUSTER, Decision.WIRE):
        rows = np.flatnonzero(trace.result.decision == decision)
        for index in rng.choice(rows, 3).tolist():
            told = confirm(explain_point(trace, cloud[0], SETTINGS, index), cloud[0], SETTINGS)
            assert len(told.trials) <= len(told.proposals)
            if told.change is not None:
                confirmed += 1
                after = decide(cloud[0], index, told.change.proposal.moves)
                assert after == told.change.decision != decision
    assert confirmed >= 3


def test_stages_are_told_in_order_up_to_the_one_that_decided(cloud, trace):
    decisions = np.unique(trace.result.decision).tolist()
    assert len(decisions) > 4
    for decision in decisions:
        rows = np.flatnonzero(trace.result.decision == decision)
        told = explain_point(trace, cloud[0], SETTINGS, int(rows[len(rows) // 2]))
        assert tuple(finding.stage for finding in told.findings) == ORDER
        outcomes = {finding.stage: finding.outcome for finding in told.findings}
        if Decision.TOO_LOW <= decision <= Decision.NO_CLUSTER:
            assert outcomes[told.stage] == 'dropped'
            before = ORDER[: ORDER.index(told.stage)]
            assert {outcomes[stage] for stage in before} <= {'kept'}
        if decision == Decision.WIRE:
            assert outcomes['catenary'] == outcomes['supports'] == 'kept'


def test_a_trace_holds_the_result_of_a_run_and_changes_nothing(cloud, trace):
    points = cloud[0].copy()
    result = Pipeline().run(points)
    for name in ('decision', 'line_id', 'span_id', 'residual', 'clearance', 'classification'):
        np.testing.assert_array_equal(getattr(result, name), getattr(trace.result, name), name)
    for index in (0, len(points) - 1):
        explain_point(trace, points, SETTINGS, index)
    np.testing.assert_array_equal(points, cloud[0])


def test_occupied_cells_are_those_of_the_stage(cloud, trace):
    held = trace.lines.cloud
    limits = SETTINGS.linearity
    origin = anchor(held.points, held.high, limits)
    kept = set(drop_bulk(held.points, held.high, origin, limits.max_occupied).tolist())
    assert len(held.high) > 1500
    for slot in held.high[::150].tolist():
        place = Place(trace, SETTINGS, held.points[slot], int(held.place[slot]))
        assert place.searched
        assert (place.occupied <= limits.max_occupied) == (slot in kept)


def test_windows_are_seen_as_the_stage_saw_them(cloud, trace):
    held = trace.lines.cloud
    inside = np.isin(held.place, np.flatnonzero(np.isin(cloud[1], ('line', 'pipe', 'arc'))))
    num_compared = 0
    for slot in np.flatnonzero(inside)[::90].tolist():
        windows = Windows(Place(trace, SETTINGS, held.points[slot], int(held.place[slot])))
        segments = sum(view.outcome == 'segment' and view.is_own for view in windows.views)
        if windows.num_near <= len(windows.numbers):
            assert segments == len(windows.segments)
            num_compared += 1
    assert num_compared > 3


def test_curves_are_those_of_the_run():
    # so close and noisy, the draws of MSAC decide which points each curve has
    points, _ = make_line_cloud(
        (45.0, 50.0, 40.0), (-0.3, 0.0, 0.3), per_metre=4.0, noise=0.06, seed=1
    )
    trace = Pipeline().trace(enter_frame(points)[0])
    believed = {view.curve.fit.c for view in Curves(trace, SETTINGS).views if view.believed}
    assert len(believed) == 9
    assert believed == {curve.fit.c for curve in trace.lines.conductors.curves}


def test_a_curve_that_was_adopted_says_so():
    points, _ = make_line_cloud((100.0, 10.0), (0.0,), c=1000.0, per_metre=6.0)
    trace = Pipeline().trace(enter_frame(points)[0])
    assert len(trace.models) == 2
    fates = [view.fate for view in Curves(trace, SETTINGS).views]
    assert 'conductor' in fates
    assert 'conductor, as it continues one at a support; curvature not proven' in fates


def test_what_poles_bear_says_so():
    rng = np.random.default_rng(0)
    posts = [  # below and beside it, so that they touch nothing from either side
        rng.uniform((x - 0.07, 0.78, 0.0), (x + 0.07, 0.92, 8.4), (400, 3))
        for x in range(3, 48, 7)
    ]
    pipe = make_wire((0, 0, 9), (48, 0, 9), c=1e5, per_metre=12)
    points = np.vstack([pipe, *posts, make_ground((-20, -20), (70, 20))])
    trace = Pipeline().trace(enter_frame(points)[0])
    assert not trace.models
    assert [view.fate for view in Curves(trace, SETTINGS).views] == [BORNE]
    assert {stage.name: stage.dropped for stage in trace.result.stages}['supports'] == {BORNE: 1}


def test_a_point_far_away_is_told_as_isolated(cloud):
    points, _, num_strays = enter_frame(np.vstack([cloud[0], [[9000.0, 0.0, 10.0]]]))
    assert num_strays == 1
    told = explain_point(Pipeline().trace(points), points, SETTINGS, len(points) - 1)
    assert told.decision == Decision.NOT_FINITE
    assert told.findings[0].notes == ('not finite, or isolated far away',)


def test_ground_and_what_is_not_finite_have_no_setting(cloud):
    points = cloud[0].copy()
    points[7] = np.nan
    trace = Pipeline().trace(points)
    for index, decision in ((7, Decision.NOT_FINITE), (8, Decision.GROUND)):
        told = explain_point(trace, points, SETTINGS, index)
        assert (told.decision, told.stage, told.proposals) == (decision, 'height', ())
    assert find_nearest(points, points[8] + 0.001) == 8


@pytest.mark.parametrize('index', [-1, 2])
def test_points_that_do_not_exist(index):
    points = np.zeros((2, 3))
    with pytest.raises(DataError, match='there is no point'):
        explain_point(Pipeline().trace(points), points, SETTINGS, index)
    with pytest.raises(DataError, match='finite'):
        find_nearest(np.full((2, 3), np.nan), np.zeros(3))


def test_a_cloud_too_small_to_be_searched():
    points = np.vstack([make_rod((0, 0, 9), (9, 0, 9), num=20), np.zeros((3, 3))])
    settings = Settings(segment=SegmentSettings(min_points=30))
    trace = Pipeline(settings).trace(points)
    told = explain_point(trace, points, settings, 0)
    assert told.decision == Decision.TOO_LOW
    assert any('segment.min_points' in note for note in told.findings[0].notes)
    told = confirm(told, points, settings)
    assert (told.change.proposal.setting, told.change.proposal.after) == (
        'segment.min_points', 23)


@pytest.mark.parametrize(('setting', 'needed', 'is_least', 'away', 'expected'), [
    ('linearity.threshold', 0.71239, True, False, 0.712),
    ('linearity.threshold', 0.3, True, False, None),
    ('linearity.max_inclination_deg', 31.01, False, False, 31.1),
    ('linearity.max_occupied', 17, False, False, 17),
    ('alignment.min_votes', 3, True, False, 3),
    ('catenary.min_points', 240, True, True, 241),
    ('catenary.max_crowding', 0.25, False, True, 0.249),
    ('catenary.max_constant', 12345.6, False, False, 12400.0),
    ('catenary.min_coverage', 0.0, False, True, None),
    ('height.beta', np.inf, True, False, None),
])
def test_values_are_rounded_to_the_side_that_does_it(setting, needed, is_least, away, expected):
    found = list(propose(SETTINGS, setting, needed, is_least, 'x', needed, away=away))
    assert [item.after for item in found] == ([] if expected is None else [expected])


def test_smaller_moves_come_first():
    items = [
        *propose(SETTINGS, 'height.beta', 2.0, True, 'x', 2.0),
        *propose(SETTINGS, 'height.beta', 3.0, True, 'x', 3.0),
        *propose(SETTINGS, 'height.beta', 2.0, True, 'x', 2.0),
    ]
    assert [item.after for item in rank(items)] == [3.0, 2.0]


def test_a_setting_that_was_moved_before_is_told_as_it_is(cloud):
    settings = dataclasses.replace(SETTINGS, linearity=LinearitySettings(threshold=1.0))
    trace = Pipeline(settings).trace(cloud[0])
    index = int(np.flatnonzero(cloud[1] == 'line')[300])
    told = confirm(explain_point(trace, cloud[0], settings, index), cloud[0], settings)
    assert told.decision == Decision.NOT_LINEAR
    assert (told.change.proposal.setting, told.change.proposal.before) == (
        'linearity.threshold', 1.0)


def test_what_was_taken_back_says_why():
    view = CurveView(curve=None, evidence=(), objection='tied', believed=False)
    assert view.fate == 'tied'
    assert dataclasses.replace(view, objection='').fate == 'dropped beside others'
