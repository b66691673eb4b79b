# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What is of a line near a conductor: its continuation, unmodelled wires, debris."""

from factories import find_nearby, make_model, make_span_result
import numpy as np
import pytest
from toys import make_curve, make_sight, make_tree, make_wire

from plc_inspect.config import HazardSettings
from plc_inspect.core.hazards.clearance_rules import plain_rules
from plc_inspect.core.hazards.crossings import find_crossings
from plc_inspect.core.hazards.hazards import find_hazards
from plc_inspect.core.hazards.line_parts import DoubtfulCurves, find_line_parts, WIDEST_TUBE
from plc_inspect.results import HazardKind

START, END, CONSTANT = (0.0, 0.0, 12.0), (100.0, 0.0, 12.0), 800.0
REACH = 4.0


def fit_model(end=END, **changes):
    """Return a span, to the end that was found, with the curve of points that scatter."""
    points = make_wire(START, END, CONSTANT, noise=0.02, per_metre=20.0)
    return make_model(START, end, c=CONSTANT, points=points, **changes)


def find(points, model=None, doubtful=(), reach=20.0, kind='alone', sight=None):
    """Return what points are, those beyond reach as nothing."""
    model = model or fit_model()
    near = find_nearby(points, [model], reach)
    curves = DoubtfulCurves(**{kind: tuple(doubtful)}, sight=sight)
    parts = find_line_parts(
        points[near.index], near.distance, near.span, [model], curves, REACH
    )
    own, unmodelled = np.zeros((2, len(points)), dtype=bool)
    own[near.index], unmodelled[near.index] = parts.own, parts.unmodelled
    return own, unmodelled, parts.num_wires


def raise_hazards(points, model=None):
    model = model or fit_model()
    near = find_nearby(points, [model], 20.0)
    spans = make_span_result([model], len(points))
    return find_hazards(
        points, points[:, 2].astype(np.float32), near, spans, HazardSettings()
    ).hazards


def shift(points, y, z):
    return points + np.array([0.0, y, z])


@pytest.mark.parametrize('per_metre', [1.5, 20.0])
@pytest.mark.parametrize(('y', 'z'), [(1.2, 0.0), (0.0, -1.5), (-2.5, 1.0)])
def test_a_wire_that_runs_along_is_unmodelled(per_metre, y, z):
    wire = shift(make_wire(START, END, 900.0, noise=0.03, per_metre=per_metre), y, z)
    _, unmodelled, num_wires = find(wire)
    assert unmodelled.mean() > 0.98
    assert num_wires >= 1
    assert not raise_hazards(wire)


def test_a_wire_through_a_crown_is_told_from_it():
    wire = shift(make_wire(START, END, 900.0, noise=0.03, per_metre=10.0), 1.5, 0.0)
    tree = make_tree(50.0, 3.5, 11.0, bottom=2.0)
    own, unmodelled, _ = find(np.vstack([wire, tree]))
    assert unmodelled[: len(wire)].mean() > 0.98
    assert (own | unmodelled)[len(wire) :].mean() < 0.1
    (hazard,) = raise_hazards(np.vstack([wire, tree]))
    assert np.hypot(*(tree - hazard.position).T[:2]).min() < 1e-9


def test_a_tree_that_touches_is_no_part_of_the_line():
    tree = make_tree(50.0, 0.5, 11.0, bottom=2.0)
    own, unmodelled, num_wires = find(tree)
    assert not (own | unmodelled).any()
    assert num_wires == 0
    (hazard,) = raise_hazards(tree)
    assert hazard.clearance < 1.0


@pytest.mark.parametrize('seed', range(5))
def test_sparse_foliage_is_no_wire(seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform([20.0, -3.5, 5.0], [80.0, 3.5, 9.0], (3000, 3))
    own, unmodelled, _ = find(points)
    assert (own | unmodelled).mean() < 0.03


def test_the_conductor_goes_on_beyond_an_open_end():
    model = fit_model(open_end=True, end=tuple(make_wire(
        START, END, CONSTANT, noise=0.0, per_metre=1.0)[60]))
    wire = make_wire(START, END, CONSTANT, noise=0.02, per_metre=10.0)
    beyond = wire[wire[:, 0] > model.span.end[0] + 0.1]
    own, _, _ = find(beyond, model)
    near = np.linalg.norm(beyond - model.span.end, axis=1) < REACH
    assert own[near].all()
    assert not raise_hazards(beyond, model)


def test_within_the_span_only_what_is_by_itself_is_of_the_line():
    model = fit_model()
    rng = np.random.default_rng(3)
    at = model.curve.position(np.array([model.start_x + 10.0]))[0]
    ball = at + rng.normal(0.0, 0.2, (60, 3))
    own, _, _ = find(ball)
    assert own.all()
    hanging = ball - np.array([0.0, 0.0, 1.4])
    assert not find(hanging)[0].any()
    assert find(hanging - np.array([3.0, 0.0, 0.0]))[0].all()  # near the end, as jumpers do
    branch = at + np.column_stack([np.zeros(60), np.linspace(0.2, 3.0, 60), np.zeros(60)])
    own, unmodelled, _ = find(branch)
    assert not (own | unmodelled).any()


def test_a_curve_that_stayed_doubtful_is_unmodelled():
    wire = shift(make_wire((40.0, 0.0, 12.0), (45.5, 0.0, 12.0), 900.0, noise=0.02), 2.0, 0.0)
    crown = make_tree(40.5, 2.0, 13.0, bottom=2.0)
    points = np.vstack([wire, crown])
    without, _, _ = find(points)
    _, unmodelled, num_wires = find(points, doubtful=[make_curve(wire)])
    assert unmodelled[: len(wire)].all()
    assert num_wires == 1
    assert not without[: len(wire)].any()


def make_row(width, num):
    """Points of wires that run side by side across the span, 1 m below it, and their curves."""
    wires = [
        make_wire((50.0 + x, -20.0, 11.2), (50.0 + x, 20.0, 11.2), 900.0, noise=0.08, seed=k)
        for k, x in enumerate(np.linspace(-width / 2, width / 2, num).tolist())
    ]
    return np.vstack(wires), [make_curve(wire) for wire in wires]


@pytest.mark.parametrize(('width', 'num', 'is_row'), [(1.0, 3, True), (1.2, 6, True),
                                                      (4.0, 20, False)])
def test_wires_that_cross_side_by_side_are_no_structure(width, num, is_row):
    points, curves = make_row(width, num)
    _, unmodelled, _ = find(points, doubtful=curves[num // 2 : num // 2 + 1], kind='crowded')
    assert (unmodelled.mean() > 0.9) == is_row
    assert is_row or unmodelled.mean() < 0.01


def test_a_hedge_below_a_curve_makes_no_row_of_it():
    points, curves = make_row(1.0, 3)
    rng = np.random.default_rng(1)
    hedge = points[rng.integers(len(points), size=20 * len(points))]
    hedge = hedge + rng.uniform((-0.5, -0.1, -2.0), (0.5, 0.1, 0.0), (len(hedge), 3))
    assert find(np.vstack([points, hedge]), doubtful=curves, kind='crowded')[1].mean() < 0.01


def test_a_crowded_curve_over_a_roof_takes_nothing_from_it():
    rng = np.random.default_rng(2)
    roof = np.column_stack([rng.uniform(46.0, 54.0, 4000), rng.uniform(-6.0, 6.0, 4000),
                            rng.normal(9.0, 0.02, 4000)])
    row = np.flatnonzero(np.abs(roof[:, 0] - 50.0) < 0.2)
    curve = make_curve(roof, row)
    assert not find(roof, doubtful=[curve], kind='crowded')[1].any()


@pytest.mark.parametrize('edge', [-6.0, -0.3])
def test_a_short_doubtful_curve_on_a_roof_takes_nothing_from_it(edge):
    rng = np.random.default_rng(4)
    num = int(42.0 * 16.0 * (6.0 - edge))
    roof = np.column_stack([rng.uniform(42.0, 58.0, num), rng.uniform(edge, 6.0, num),
                            rng.normal(9.0, 0.02, num)])
    row = np.flatnonzero((np.abs(roof[:, 1]) < 0.1) & (np.abs(roof[:, 0] - 50.0) < 1.5))
    curve = make_curve(roof, row)
    assert 3.0 * curve.prediction_sigma(np.array([curve.high + 10.0]))[0] > WIDEST_TUBE
    assert not find(roof, doubtful=[curve])[1].any()


def test_an_unmodelled_wire_that_crosses_too_near_is_a_crossing():
    points, curves = make_row(1.0, 3)
    model = fit_model()
    near = find_nearby(points, [model], 20.0)
    (hazard,) = find_hazards(
        points, points[:, 2].astype(np.float32), near, make_span_result([model], len(points)),
        HazardSettings(), doubtful=DoubtfulCurves(crowded=tuple(curves)),
    ).hazards
    assert hazard.kind == HazardKind.CROSSING
    assert hazard.other_line_id == -1
    assert hazard.position[:2] == pytest.approx((50.0, 0.0), abs=0.7)
    height = model.curve.position(model.at(np.array([hazard.along_span])))[0, 2]
    assert hazard.position[2] == pytest.approx(height)  # of the lower of both
    assert hazard.clearance == pytest.approx(10.98 - height, abs=0.05)
    # what runs along is none
    assert not find_crossings([model], (), plain_rules(HazardSettings()), [model.curve])


def test_a_pole_at_the_end_is_no_hazard_and_in_the_span_it_is():
    rng = np.random.default_rng(3)
    pole = np.column_stack([rng.normal(0, 0.1, 200), rng.normal(1.0, 0.1, 200),
                            rng.uniform(1.0, 11.0, 200)])
    model = fit_model(open_start=True, open_end=True)
    assert not raise_hazards(pole + np.array([3.0, 0.0, 0.0]), model)
    assert len(raise_hazards(pole + np.array([50.0, 0.0, 0.0]), model)) == 1


def test_what_hangs_above_a_tree_is_not_of_it():
    tree = make_tree(50.0, 1.0, 10.5, bottom=2.0)
    above = make_wire((40.0, 1.0, 26.0), (60.0, 1.0, 26.0), 900.0, noise=0.02)
    (alone,), (hazard,) = raise_hazards(tree), raise_hazards(np.vstack([tree, above]))
    assert hazard.height == alone.height
    assert hazard.num_points == alone.num_points


@pytest.mark.parametrize(('y', 'own'), [(1.5, True), (4.0, False)])
def test_a_narrow_tree_far_beside_the_end_is_no_pole(y, own):
    rng = np.random.default_rng(5)
    tree = np.column_stack([rng.uniform(2.5, 3.6, 40), rng.uniform(y - 0.5, y + 0.5, 40),
                            rng.uniform(8.0, 12.0, 40)])
    assert find(tree)[0].all() == own
    assert bool(raise_hazards(shift(tree, 0.0, 0.0))) != own


def test_sparse_foliage_near_an_end_goes_on_though_thinly():
    rng = np.random.default_rng(6)
    crown = rng.uniform([2.0, 0.8, 6.0], [7.0, 6.0, 11.5], (150, 3))  # a point in a cubic metre
    own, unmodelled, _ = find(crown)
    near = find_nearby(crown, [fit_model()], REACH)
    assert len(near.index) > 20
    assert (own | unmodelled)[near.index].mean() < 0.1
    (hazard,) = raise_hazards(crown)
    assert hazard.clearance == pytest.approx(near.distance.min(), abs=0.3)


def test_a_roof_beyond_the_end_is_not_the_conductor():
    model = fit_model()
    x = np.linspace(101.0, 108.0, 71)
    at = model.curve.position(model.at(x))
    wire, across = at[:, None], np.linspace(-2.0, 2.0, 41)
    roof = (wire + np.stack([0.0 * across, across, 0.0 * across], axis=1)).reshape(-1, 3)
    own = find(roof, model)[0]
    assert own.mean() < 0.02
    assert find(at, model)[0].all()


@pytest.mark.parametrize(('num', 'is_wire'), [(3, False), (8, True)])
def test_a_few_leaves_in_line_are_no_piece_of_a_wire(num, is_wire):
    """They lie along the conductor by chance, a metre above their crown."""
    wire = make_wire((40.0, 0.0, 12.0), (41.5, 0.0, 12.0), 900.0, noise=0.03, per_metre=20.0)
    leaves = shift(wire[np.linspace(0, len(wire) - 1, num).astype(int)], 3.0, 0.0)
    _, unmodelled, _ = find(leaves)
    assert unmodelled.all() == unmodelled.any() == is_wire
    assert bool(raise_hazards(leaves)) != is_wire


@pytest.mark.parametrize(('num', 'own'), [(3, True), (12, False)])
def test_a_few_points_of_the_next_span_are_of_it_however_far_a_rule_reaches(num, own):
    model = fit_model(open_start=False, open_end=False)
    x = np.linspace(112.6, 114.4, num)
    points = np.column_stack([x, np.full(num, 0.5), np.full(num, 11.0)])
    near = find_nearby(points, [model], 40.0)
    parts = find_line_parts(
        points[near.index], near.distance, near.span, [model], DoubtfulCurves(), 30.0
    )
    assert parts.own.tolist() == [own] * num


@pytest.mark.parametrize(('num', 'own'), [(6, True), (12, False)])
def test_a_few_points_of_the_next_span_are_no_hazard(num, own):
    model = fit_model(open_start=False, open_end=False)
    x = np.linspace(102.6, 104.4, num)
    places = np.arange(num)
    points = np.column_stack([x, 0.5 + 0.2 * (places % 3), 11.5 + 0.2 * (places % 2)])
    found, _, _ = find(points, model)
    assert found.all() == own
    assert len(raise_hazards(points, model)) == (not own)


@pytest.mark.parametrize(('seen', 'unmodelled'), [(False, False), (True, True)])
def test_rows_of_a_scanner_on_a_roof_are_no_wires(seen, unmodelled):
    along = np.arange(46.0, 54.0, 0.2)
    at = fit_model().curve.position(fit_model().at(along))
    rows = np.vstack([shift(at, y, -2.5) for y in (-1.5, -0.5, 0.5, 1.5)])
    rows[:, 2] += np.random.default_rng(4).normal(0.0, 0.02, len(rows))
    ground = np.array([(x, y, 0.0) for x in (-20.0, 120.0) for y in (-20.0, 20.0)])
    found = find(rows, sight=make_sight(ground, seen=seen))
    assert found[1].all() == unmodelled
    assert found[1].any() == unmodelled
    assert (found[2] > 0) == unmodelled


@pytest.mark.parametrize(('apart', 'is_row'), [(0.35, True), (None, False)])
def test_the_first_metres_of_the_next_span_are_wires_and_a_scan_line_over_a_crown_is_none(
    apart, is_row
):
    rng = np.random.default_rng(14)
    x = rng.uniform(2.2, 4.2, 60)
    z = rng.uniform(-1.2, 0.0, 60) if apart is None else -apart * rng.integers(0, 4, 60)
    points = np.column_stack([100.0 + x, 0.1 * x, 12.0 - 0.2 * x + z])
    points += rng.normal(0.0, 0.02, points.shape)
    _, unmodelled, _ = find(points, fit_model(open_end=False))
    assert unmodelled.all() == is_row
    assert unmodelled.any() == is_row
