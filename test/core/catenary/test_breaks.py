# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from toys import hang

from plc_inspect.core.catenary.breaks import find_breaks, settle
from plc_inspect.core.numerics.piece_sums import add_up


def make_track(spans=(80.0,), heights=None, c=700.0, per_metre=4.0, noise=0.02, seed=0, turns=()):
    """Return x, y, z of a track through several spans, and the places of its supports."""
    rng = np.random.default_rng(seed)
    heights = heights or (15.0,) * (len(spans) + 1)
    xs, ys, zs = [], [], []
    start, offset, angle = 0.0, 0.0, 0.0
    for number, length in enumerate(spans):
        x = np.sort(rng.uniform(0.0, length, int(length * per_metre)))
        xs.append(start + x)
        ys.append(offset + np.tan(angle) * x)
        zs.append(hang(x, length, heights[number], heights[number + 1], c))
        start += length
        offset += np.tan(angle) * length
        angle += np.radians(turns[number]) if number < len(turns) else 0.0
    x, y, z = map(np.concatenate, (xs, ys, zs))
    return x, y + rng.normal(0, noise, len(x)), z + rng.normal(0, noise, len(x))


@pytest.mark.parametrize('spans', [(80.0, 90.0), (40.0, 120.0), (30.0, 35.0)])
def test_the_support_between_two_spans_is_found(spans):
    found, = find_breaks(*make_track(spans))
    assert found.x == pytest.approx(spans[0], abs=0.5)
    # slopes at the support: half a length over c on either side
    assert found.kink == pytest.approx(-sum(spans) / 2 / 700.0, rel=0.2)
    assert abs(found.turn) < 0.01


@pytest.mark.parametrize('spans', [
    (40.0, 60.0, 60.0, 15.0),  # where one cut alone would lie within a span
    (50.0,) * 8, (200.0, 30.0, 250.0),
])
@pytest.mark.parametrize('seed', range(3))
def test_all_supports_of_a_track_are_found(spans, seed):
    found = find_breaks(*make_track(spans, noise=0.06, per_metre=12.0, seed=seed))
    np.testing.assert_allclose([item.x for item in found], np.cumsum(spans)[:-1], atol=1.5)


@pytest.mark.parametrize(('num', 'length', 'c'), [(150, 80.0, 700.0), (200, 60.0, 1000.0)])
def test_all_supports_of_a_track_of_12_km_are_found(num, length, c):
    found = find_breaks(*make_track((length,) * num, c=c, per_metre=12.0))
    np.testing.assert_allclose(
        [item.x for item in found], length * np.arange(1, num), atol=1.5
    )


def test_two_parabolas_by_hand():
    x = np.linspace(0.0, 40.0, 161)
    z = np.where(x < 20.0, 0.01 * (x - 10.0) ** 2, 0.01 * (x - 30.0) ** 2)
    found, = find_breaks(x, np.zeros_like(x), z)
    assert found.x == pytest.approx(20.0, abs=0.01)
    assert found.kink == pytest.approx(-0.4, abs=0.01)


@pytest.mark.parametrize('seed', range(10))
def test_one_span_has_no_break(seed):
    assert find_breaks(*make_track((120.0,), noise=0.04, seed=seed)) == ()


@pytest.mark.parametrize('per_metre', [0.5, 3.0, 60.0])
@pytest.mark.parametrize('seed', range(5))
def test_one_span_has_none_at_any_density(per_metre, seed):
    assert find_breaks(*make_track((250.0,), per_metre=per_metre, seed=seed)) == ()


def test_an_inclined_span_has_no_break():
    assert find_breaks(*make_track((120.0,), (10.0, 40.0))) == ()


def test_a_deep_span_has_no_break():
    assert find_breaks(*make_track((400.0,), c=800.0)) == ()


def test_a_turn_in_plan_is_a_break():
    found, = find_breaks(*make_track((60.0, 60.0), c=6000.0, turns=(8.0,)))
    assert found.x == pytest.approx(60.0, abs=1.0)
    assert found.turn == pytest.approx(np.radians(8.0), abs=0.01)


def test_a_support_on_a_low_point_draws_the_conductor_up():
    found, = find_breaks(*make_track((150.0, 150.0), (60.0, 20.0, 60.0), c=1500.0))
    assert found.x == pytest.approx(150.0, abs=0.5)
    assert found.kink > 0.3


def test_a_gap_at_the_support_does_not_hide_it():
    x, y, z = make_track((80.0, 90.0))
    seen = np.abs(x - 80.0) > 6.0
    found, = find_breaks(x[seen], y[seen], z[seen])
    assert found.x == pytest.approx(80.0, abs=6.0)


def test_the_order_of_points_does_not_matter_and_input_is_unchanged():
    x, y, z = make_track((80.0, 90.0))
    order = np.random.default_rng(0).permutation(len(x))
    before = x.copy(), y.copy(), z.copy()
    one, = find_breaks(x, y, z)
    other, = find_breaks(x[order], y[order], z[order])
    assert (one.x, one.kink, one.turn) == pytest.approx((other.x, other.kink, other.turn))
    for array, old in zip((x, y, z), before, strict=True):
        np.testing.assert_array_equal(array, old)


@pytest.mark.parametrize('num', [0, 1, 11])
def test_few_points_have_no_break(num):
    x = np.linspace(0.0, 50.0, num)
    assert find_breaks(x, np.zeros(num), np.abs(x - 25.0)) == ()


def test_duplicates_and_a_short_track_have_no_break():
    assert find_breaks(np.ones(50), np.ones(50), np.ones(50)) == ()
    x = np.linspace(0.0, 9.0, 60)
    assert find_breaks(x, np.zeros(60), -np.abs(x - 4.5)) == ()


def test_many_points_at_one_place_before_a_gap_are_no_side():
    x = np.concatenate([np.zeros(6), np.linspace(5.0, 30.0, 60)])
    for seed in range(20):
        y, z = np.random.default_rng(seed).normal(0.0, 0.02, (2, len(x)))
        for found in find_breaks(x, y, z - 0.1 * (x > 0.0)):
            assert np.isfinite([found.x, found.kink, found.turn]).all()


def test_of_cuts_that_part_the_points_alike_the_first_is_taken():
    """Those before and after empty cells differ by rounding alone."""
    for seed in range(40):
        rng = np.random.default_rng(seed)
        x = np.repeat(np.arange(0.0, 160.0, rng.uniform(2.0, 4.0)), 6)
        x += rng.uniform(0.0, 0.1, len(x))
        z = np.abs(x - 80.0) * -0.06 + x * x / 1200.0 + rng.normal(0.0, 0.02, len(x))
        one = np.zeros(len(x), dtype=np.int64)
        before = add_up(x, rng.normal(0.0, 0.02, len(x)), z, one)
        num = before.shape[1] - 1
        bounds = np.array([0, num // 2, num])
        settle(before, bounds)
        assert before[0, bounds[1], 0] > before[0, bounds[1] - 1, 0]


def test_a_sure_break_stays_at_its_support_when_one_that_is_not_is_dropped():
    """Spans of 20, 38 and 20 m, bent by 0.014 and 0.03: the best single cut is in mid-span."""
    num_found = 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        x = np.sort(rng.uniform(0.0, 78.0, (4, 860)))
        z = x**2 / 600.0 - 0.0144 * np.maximum(x - 20.0, 0.0) - 0.03 * np.maximum(x - 58.0, 0.0)
        z += rng.normal(0.0, 0.045, z.shape)
        y = rng.normal(0.0, 0.06, z.shape)
        found = find_breaks(x.ravel(), y.ravel(), z.ravel(), np.repeat(np.arange(4), 860))
        assert all(item.kink < 0.0 for item in found)
        num_found += any(abs(item.x - 58.0) < 4.0 for item in found)
    assert num_found >= 6


def test_four_conductors_show_what_one_does_not():
    """Spans of 22 m with 3 points a metre and 4 cm of noise: the kink is 0.027."""
    alone = together = 0
    for seed in range(20):
        tracks = [
            make_track((22.0, 22.0), c=800.0, noise=0.04, per_metre=3.0, seed=100 * seed + k)
            for k in range(4)
        ]
        alone += sum(len(find_breaks(*track)) == 1 for track in tracks)
        number = np.repeat(np.arange(4), [len(x) for x, _, _ in tracks])
        found = find_breaks(*map(np.concatenate, zip(*tracks, strict=True)), number)
        together += len(found) == 1 and abs(found[0].x - 22.0) < 3.0 and found[0].kink < -0.012
    assert alone <= 8  # of 80
    assert together >= 15  # of 20


def test_conductors_of_one_span_have_no_break_together():
    for seed in range(40):
        tracks = [
            make_track((40.0,), c=800.0, noise=0.04, per_metre=3.0, seed=100 * seed + k)
            for k in range(4)
        ]
        number = np.repeat(np.arange(4), [len(x) for x, _, _ in tracks])
        assert find_breaks(*map(np.concatenate, zip(*tracks, strict=True)), number) == ()
