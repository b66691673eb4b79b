# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

from itertools import pairwise

import numpy as np
import pytest
from toys import make_curve, make_route, make_wire

from plc_inspect.config import SupportSettings
from plc_inspect.core.spans.layout import find_layout
from plc_inspect.core.spans.standing_poles import StandingPole
from plc_inspect.core.spans.stations import group_joints
from plc_inspect.errors import ConfigError

SETTINGS = SupportSettings()


def lay_out(supports, adopted=(), settings=SETTINGS, **changes):
    points, curves = make_route(supports, **changes)
    return find_layout(points, curves, adopted, settings)


def test_spans_end_at_the_supports_between_them():
    layout = lay_out([(0, 0), (90, 0), (170, 0)])
    assert len(layout.stations) == 1
    station = layout.stations[0]
    np.testing.assert_allclose(station.position, [90.0, 0.0], atol=0.2)
    assert np.sin(station.direction) == pytest.approx(0.0, abs=0.01)
    assert sorted(station.attachments[:, 1].round().tolist()) == [-3.0, 0.0, 3.0]
    assert len(layout.curves) == 6
    for number, curve in enumerate(layout.curves):
        known = {layout.start_station[number], layout.end_station[number]}
        assert known == {-1, 0}
        at = curve.position([layout.start_x[number], layout.end_x[number]])[:, 0]
        assert min(abs(at - 90.0)) < 0.3
        assert layout.start_x[number] < layout.end_x[number]


def test_a_line_that_turns_has_a_support_at_each_turn():
    layout = lay_out([(0, 0), (90, 0), (160, 40), (250, 50)])
    places = np.array(sorted(station.position.tolist() for station in layout.stations))
    np.testing.assert_allclose(places, [[90, 0], [160, 40]], atol=0.5)


@pytest.mark.parametrize('height', [17.0, 28.0])
def test_a_conductor_that_passes_unbroken_is_cut_where_its_neighbours_end(height):
    points, curves = make_route([(0, 0), (60, 0), (120, 0)], offsets=(-3.0, 3.0), c=600.0)
    # an earth wire so taut that both its spans were taken for one
    earth = np.vstack([
        make_wire((60.0 * k, 0.0, height), (60.0 * k + 60.0, 0.0, height), c=6000.0, seed=8 + k)
        for k in range(2)
    ])
    points = np.vstack([points, earth])
    passing = make_curve(points, np.arange(len(points) - len(earth), len(points)))
    layout = find_layout(points, [*curves, passing], (), SETTINGS)
    own = [number for number, curve in enumerate(layout.curves)
           if curve.position(curve.mean_x)[0, 2] > 16.0]
    assert len(own) == 2
    for number in own:
        assert {layout.start_station[number], layout.end_station[number]} == {-1, 0}


@pytest.mark.parametrize(('height', 'num'), [(17.0, 2), (28.0, 1)])
def test_a_conductor_far_above_the_poles_at_which_others_end_is_not_cut(height, num):
    points, curves = make_route([(0, 0), (60, 0), (120, 0)], offsets=(-3.0, 3.0), c=600.0)
    top = float(points[:, 2].max())
    pole = StandingPole(position=np.array([60.0, 1.0]), base=0.0, top=top)
    # nothing of it was seen at the pole, so that it may be bent there
    wire = make_wire((0.0, 6.0, height), (120.0, 6.0, height), c=900.0, per_metre=2.0, noise=0.1)
    wire = wire[np.abs(wire[:, 0] - 60.0) > 35.0]
    points = np.vstack([points, wire])
    passing = make_curve(points, np.arange(len(points) - len(wire), len(points)))
    layout = find_layout(points, [*curves, passing], (), SETTINGS, [pole])
    own = [curve for curve in layout.curves if curve.position(curve.mean_x)[0, 1] > 5.0]
    assert len(own) == num


def test_no_conductor_is_cut_where_one_seems_to_end_but_the_others_run_straight():
    wires = [
        make_wire((0.0, 3.0 * k, 20.0), (50.0, 3.0 * k, 20.0), c=2000.0, per_metre=3.0, noise=0.06,
                  seed=k)
        for k in range(10)
    ]
    # one was seen in two strips of a survey that lie askew to each other
    late = wires[0][:, 0] > 25.0
    wires[0][late, 2] -= 0.02 * (wires[0][late, 0] - 25.0)
    wires[:1] = [wires[0][~late], wires[0][late]]
    points = np.vstack(wires)
    places = np.cumsum([0, *map(len, wires)])
    curves = [make_curve(points, np.arange(*own), 0.3) for own in pairwise(places)]
    layout = find_layout(points, curves, (), SETTINGS)
    assert len(layout.curves) == len(curves)


def test_no_conductor_is_cut_where_one_seems_to_be_held_down_but_the_others_hang_free():
    wires = [
        make_wire((0.0, 0.45 * k, 9.0), (44.0, 0.45 * k, 9.0), c=205.0, per_metre=4.0, seed=k)
        for k in range(5)
    ]
    # of one a part was seen too high, as a curve of its own with a kink upwards
    late = wires[0][:, 0] > 22.0
    wires[0][late, 2] += 0.04 * (wires[0][late, 0] - 22.0)
    wires[:1] = [wires[0][~late], wires[0][late]]
    points = np.vstack(wires)
    places = np.cumsum([0, *map(len, wires)])
    curves = [make_curve(points, np.arange(*own), 0.3) for own in pairwise(places)]
    layout = find_layout(points, curves, (), SETTINGS)
    assert len(layout.joints) == 1  # that one alone
    assert len(layout.curves) == len(curves)


def test_a_conductor_is_cut_at_its_support_though_those_of_another_line_run_straight():
    points, curves = make_route([(0, 0), (60, 0), (120, 0)], offsets=(-3.0, 3.0), c=600.0)
    # an earth wire so taut that both its spans were taken for one, and a line with other supports
    wires = [
        make_wire((60.0 * k, 0.0, 17.0), (60.0 * k + 60.0, 0.0, 17.0), c=6000.0, seed=8 + k)
        for k in range(2)
    ]
    wires = [np.vstack(wires), *[
        make_wire((0.0, 9.0 + k, 12.0), (120.0, 9.0 + k, 12.0), c=600.0, seed=20 + k)
        for k in range(6)
    ]]
    first = np.cumsum([len(points), *map(len, wires)])
    points = np.vstack([points, *wires])
    passing = [make_curve(points, np.arange(*own)) for own in pairwise(first)]
    layout = find_layout(points, [*curves, *passing], (), SETTINGS)
    own = [curve.position(curve.mean_x)[0] for curve in layout.curves]
    assert sum(place[2] > 16.0 for place in own) == 2
    assert sum(place[1] > 8.0 for place in own) == 6


def test_a_conductor_that_passes_is_cut_also_where_too_little_is_seen_beyond():
    points, curves = make_route([(0, 0), (60, 0), (120, 0)], offsets=(-3.0, 3.0), c=600.0)
    earth = make_wire((0.0, 0.0, 17.0), (60.0, 0.0, 17.0), c=6000.0, seed=9)
    beyond = make_wire((60.0, 0.0, 17.0), (100.0, 0.0, 17.0), c=6000.0, per_metre=0.5, seed=8)
    points = np.vstack([points, earth, beyond])
    passing = make_curve(points, np.arange(len(points) - len(earth) - len(beyond), len(points)))
    layout = find_layout(points, [*curves, passing], (), SETTINGS)
    (own,) = [number for number, curve in enumerate(layout.curves)
              if curve.position(curve.mean_x)[0, 2] > 16.0]
    assert {layout.start_station[own], layout.end_station[own]} == {-1, 0}
    at = layout.curves[own].position([layout.start_x[own], layout.end_x[own]])
    assert at[:, 0].max() == pytest.approx(60.0, abs=0.5)


def test_a_line_beside_one_with_other_supports_is_not_cut_at_them():
    points, curves = make_route([(0, 0), (90, 0), (170, 0)])
    more, beside = make_route([(0, 18), (40, 18), (125, 18)])
    points = np.vstack([points, more])
    moved = [
        make_curve(points, curve.points + len(points) - len(more)) for curve in beside
    ]
    layout = find_layout(points, [*curves, *moved], (), SETTINGS)
    assert len(layout.stations) == 2
    assert len(layout.curves) == 12


def test_a_line_beside_one_is_not_cut_at_its_supports_where_they_have_one_in_common():
    points, curves = make_route([(0, 0), (40, 0), (80, 0), (120, 0)], c=300.0)
    more, beside = make_route([(0, 8), (80, 8), (160, 8)], height=17.0)
    points = np.vstack([points, more])
    moved = [
        make_curve(points, curve.points + len(points) - len(more)) for curve in beside
    ]
    layout = find_layout(points, [*curves, *moved], (), SETTINGS)
    length = layout.end_x - layout.start_x
    above = [curve.position(curve.mean_x)[0, 1] > 4.0 for curve in layout.curves]
    np.testing.assert_allclose(length[above], [80.0] * 6, atol=1.0)
    np.testing.assert_allclose(length[np.invert(above)], [40.0] * 9, atol=1.0)


def test_a_conductor_is_cut_at_a_low_support_over_which_it_alone_runs_straight():
    heights = (15.0, 13.0, 15.0)
    wires = [
        make_wire((60.0 * k, y, heights[k]), (60.0 * k + 60.0, y, heights[k + 1]), 600.0, seed=k)
        for y in (-3.0, 3.0) for k in range(2)
    ]
    # as its two spans are less curved, they are one curve
    wires.append(make_wire((0.0, 0.0, 17.0), (120.0, 0.0, 17.0), 900.0, seed=9))
    ends = np.cumsum([0, *map(len, wires)])
    points = np.vstack(wires)
    curves = [make_curve(points, np.arange(low, high)) for low, high in pairwise(ends)]
    assert len(find_layout(points, curves, (), SETTINGS).curves) == 6


def test_conductors_are_cut_at_a_low_support_that_holds_down_the_earth_wire_alone():
    # phases of more sag pass it as one curve over both spans would
    wires = [make_wire((0.0, y, 25.0), (240.0, y, 25.0), 1460.0, seed=int(y)) for y in (3.0, 6.0)]
    low = 35.0 - 240.0**2 / 8 / 1460.0
    wires += [
        make_wire((0.0, 0.0, 35.0), (120.0, 0.0, low), 1900.0, seed=8),
        make_wire((120.0, 0.0, low), (240.0, 0.0, 35.0), 1900.0, seed=9),
    ]
    ends = np.cumsum([0, *map(len, wires)])
    points = np.vstack(wires)
    curves = [make_curve(points, np.arange(*own)) for own in pairwise(ends)]
    layout = find_layout(points, curves, (), SETTINGS)
    np.testing.assert_allclose(layout.end_x - layout.start_x, [120.0] * 6, atol=1.0)


def test_a_conductor_that_fades_out_hangs_at_the_support_of_its_neighbours():
    points, curves = make_route([(0, 0), (90, 0), (170, 0)], offsets=(-3.0, 3.0))
    short = make_wire((0.0, 0.0, 15.0), (90.0, 0.0, 15.0), parts=((0.0, 0.8),), seed=7)
    points = np.vstack([points, short])
    fading = make_curve(points, np.arange(len(points) - len(short), len(points)))
    layout = find_layout(points, [*curves, fading], (), SETTINGS)
    number = len(layout.curves) - 1
    assert {layout.start_station[number], layout.end_station[number]} == {-1, 0}
    at = layout.curves[number].position([layout.start_x[number], layout.end_x[number]])
    assert at[:, 0].max() == pytest.approx(90.0, abs=0.5)


@pytest.mark.parametrize('offsets', [(-3.0, 3.0), (-3.0,)])
def test_a_conductor_seen_far_from_its_support_hangs_where_more_of_its_neighbours_do(offsets):
    points, curves = make_route([(0, 0), (120, 0), (240, 0)], offsets=offsets, c=900.0)
    spans = (
        make_wire((0.0, 0.0, 24.0), (120.0, 0.0, 24.0), c=3000.0, seed=8),
        make_wire((120.0, 0.0, 25.0), (240.0, 0.0, 24.0), c=3000.0, seed=9),
    )
    earth = np.vstack([spans[0][spans[0][:, 0] < 95.0], spans[1][spans[1][:, 0] > 155.0]])
    for part in (earth[:, 0] < 120.0, earth[:, 0] > 120.0):
        curves.append(make_curve(np.vstack([points, earth]), len(points) + np.flatnonzero(part)))
    layout = find_layout(np.vstack([points, earth]), curves, (), SETTINGS)
    if len(offsets) == 1:  # as good as the other
        assert len(layout.stations) == 2
        return
    (station,) = layout.stations
    np.testing.assert_allclose(station.position, [120.0, 0.0], atol=0.5)
    for number, curve in enumerate(layout.curves):
        ends = layout.start_x[number], layout.end_x[number]
        at = [curve.position(x)[0, 0] for x in ends]
        assert min(abs(np.array(at) - 120.0)) < 0.5


@pytest.mark.parametrize(('seen', 'poles'), [
    ((-3.0, 3.0), False), ((3.0,), False), ((), True), ((3.0,), True),
])
@pytest.mark.parametrize('length', [40.0, 70.0])
def test_no_support_stands_amid_a_span_that_was_not_seen(length, seen, poles):
    supports = [(number * length, 0.0) for number in range(4)]
    points, curves = make_route(supports, offsets=(-3.0, 0.0, 3.0))
    hidden = [
        curve for curve in curves
        if abs(curve.position((curve.low + curve.high) / 2)[0, 0] - 1.5 * length) < 2.0
        and not any(abs(curve.position(curve.low)[0, 1] - offset) < 1.0 for offset in seen)
    ]
    curves = [curve for curve in curves if curve not in hidden]
    assert len(hidden) == 3 - len(seen)
    standing = [
        StandingPole(position=np.array([x, offset]), base=0.0, top=15.0)
        for x in (length, 2 * length) for offset in (-3.0, 0.0, 3.0)
    ] if poles else []
    layout = find_layout(points, curves, (), SETTINGS, standing)
    at = [station.position[0] for station in layout.stations]
    known = [length, 2 * length] if seen else []
    assert sorted(at) == pytest.approx(known, abs=0.5)
    ends = [
        curve.position(x)[0, 0] for curve, low, high in zip(
            layout.curves, layout.start_x, layout.end_x, strict=True
        ) for x in (low, high)
    ]
    assert np.abs(np.array(ends)[:, None] - np.arange(4) * length).min(axis=1).max() < 1.0


@pytest.mark.parametrize('start', [85.0, 90.5])
def test_a_short_piece_hangs_with_its_nearer_end(start):
    points, curves = make_route([(0, 0), (90, 0), (180, 0)])
    piece = make_wire((start, 5.0, 15.0), (start + 4.5, 5.0, 15.0), c=1e5)
    both = np.vstack([points, piece])
    curves.append(make_curve(both, np.arange(len(points), len(both))))
    found = find_layout(both, curves, (), SETTINGS)
    before = start < 90.0
    x = sorted(found.curves[-1].position(np.array([found.start_x[-1], found.end_x[-1]]))[:, 0])
    assert found.start_x[-1] < found.end_x[-1]
    assert x == pytest.approx([start, 90.0] if before else [90.0, start + 4.5], abs=0.3)
    assert sorted([found.start_station[-1], found.end_station[-1]]) == [-1, 0]


def test_an_adopted_curve_that_continues_none_is_dropped():
    points, curves = make_route([(0, 0), (90, 0), (114, 0)], offsets=(0.0,))
    believed, doubtful = curves
    far = make_wire((0.0, 60.0, 15.0), (24.0, 60.0, 15.0), seed=3)
    points = np.vstack([points, far])
    alone = make_curve(points, np.arange(len(points) - len(far), len(points)))
    layout = find_layout(points, [believed], [doubtful, alone], SETTINGS)
    assert len(layout.curves) == 2
    assert len(layout.stations) == 1
    assert len(find_layout(points, [believed], [alone], SETTINGS).curves) == 1


def test_joints_of_two_lines_far_apart_are_two_supports():
    points, curves = make_route([(0, 0), (90, 0), (170, 0)], offsets=(0.0, 50.0))
    layout = find_layout(points, curves, (), SETTINGS)
    assert len(layout.stations) == 2


def test_a_curve_that_lies_on_a_better_one_is_dropped():
    points, curves = make_route([(0, 0), (90, 0), (170, 0)])
    again = make_curve(points, curves[0].points[::2])
    layout = find_layout(points, [*curves, again], (), SETTINGS)
    assert len(layout.curves) == 6


@pytest.mark.parametrize(('aside', 'below', 'num'), [
    (12.0, 12.0, 2),  # a line of low voltage beside one on towers
    (12.0, 8.0, 1),  # levels of a tower
    (3.0, 12.0, 1),  # borne by the tower
])
def test_lines_side_by_side_of_which_one_is_far_below_have_supports_of_their_own(
    aside, below, num
):
    points, curves = make_route([(0, 0), (90, 0), (170, 0)], height=25.0)
    low, others = make_route(
        [(0, 0), (90, 0), (170, 0)], offsets=(-3.0 - aside,), height=25.0 - below
    )
    moved = [make_curve(np.vstack([points, low]), own.points + len(points)) for own in others]
    layout = find_layout(np.vstack([points, low]), [*curves, *moved], (), SETTINGS)
    assert len(layout.stations) == num


def test_the_order_of_curves_does_not_matter():
    points, curves = make_route([(0, 0), (90, 0), (160, 40)])
    one = find_layout(points, curves, (), SETTINGS)
    other = find_layout(points, curves[::-1], (), SETTINGS)
    np.testing.assert_allclose(
        one.stations[0].position, other.stations[0].position, atol=0.02
    )
    lengths = [np.sort(layout.end_x - layout.start_x) for layout in (one, other)]
    np.testing.assert_allclose(lengths[0], lengths[1], atol=0.02)


def test_few_curves():
    empty = find_layout(np.zeros((0, 3)), [], (), SETTINGS)
    assert empty.curves == empty.stations == empty.joints == ()
    assert empty.start_x.shape == empty.end_x.shape == (0,)
    points, curves = make_route([(0, 0), (90, 0)], offsets=(0.0,))
    one = find_layout(points, curves, (), SETTINGS)
    assert one.start_station == one.end_station == (-1,)
    assert one.start_x[0] == curves[0].low
    assert one.end_x[0] == curves[0].high
    assert group_joints((), SETTINGS) == ()


@pytest.mark.parametrize('change', [
    {'radius': 0.0}, {'width': 200.0}, {'min_span': 1.0}, {'max_reach': 0.0},
])
def test_bad_settings(change):
    with pytest.raises(ConfigError, match=next(iter(change))):
        SupportSettings(**change)
