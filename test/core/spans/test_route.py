# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from toys import make_curve, make_route, make_wire, turn

from plc_inspect.config import SupportSettings
from plc_inspect.core.spans.layout import find_layout
from plc_inspect.core.spans.route import trace_routes

SETTINGS = SupportSettings()


def trace(supports, order=None, yaw=0.0, **changes):
    """Return the layout and route, and the offset and span of each of its curves."""
    points, curves = make_route(supports, **changes)
    if yaw:
        points = turn(points, yaw)
        curves = [make_curve(points, curve.points) for curve in curves]
    if order is not None:
        curves = [curves[number] for number in order]
    layout = find_layout(points, curves, (), SETTINGS)
    return layout, trace_routes(layout)


def get_middles(layout):
    x = (layout.start_x + layout.end_x) / 2
    return np.array([
        curve.position(at)[0] for curve, at in zip(layout.curves, x, strict=True)
    ])


def test_spans_count_along_the_route_and_lines_go_through():
    layout, route = trace([(0, 0), (90, 0), (170, 0), (260, 0)])
    middle = get_middles(layout)
    for number, (x, y, _) in enumerate(middle):
        assert route.span_id[number] == np.searchsorted([90, 170, 260], x)
        # from left to right as seen along the route
        assert route.line_id[number] == {3: 0, 0: 1, -3: 2}[round(y / 3) * 3]
        runs_west = np.cos(layout.curves[number].azimuth) < 0
        assert route.reverse[number] == runs_west


@pytest.mark.parametrize('seed', range(4))
def test_the_order_of_curves_does_not_matter(seed):
    supports = [(0, 0), (90, 0), (160, 40), (250, 50)]
    one = trace(supports)
    other = trace(supports, np.random.default_rng(seed).permutation(9))
    found = []
    for layout, route in (one, other):
        middle = get_middles(layout).round(0)
        found.append({
            tuple(place): (line, span)
            for place, line, span in zip(
                middle.tolist(), route.line_id, route.span_id, strict=True
            )
        })
    assert found[0] == found[1]


@pytest.mark.parametrize('degrees', [60, 90, 150, 180, 270])
def test_lines_keep_their_course_whatever_the_yaw(degrees):
    supports = [(0, 0), (90, 0), (160, 40), (250, 50)]
    layout, route = trace(supports, yaw=np.radians(degrees))
    assert sorted(zip(route.line_id, route.span_id, strict=True)) == [
        (line, span) for line in range(3) for span in range(3)
    ]
    # neighbours in number are neighbours in place, from one end to the other
    middle = turn(get_middles(layout), -np.radians(degrees))
    spans = [middle[np.array(route.span_id) == span, 0].mean() for span in range(3)]
    assert spans in (sorted(spans), sorted(spans, reverse=True))
    for line in range(3):
        own = np.array(route.line_id) == line
        assert np.ptp(np.array(route.span_id)[own]) == 2


def test_the_higher_of_two_layers_comes_first():
    points = np.vstack([
        make_wire((0, 0, z), (90, 0, z), seed=number) for number, z in enumerate((12.0, 16.0))
    ])
    curves = [make_curve(points, np.arange(720)), make_curve(points, np.arange(720, 1440))]
    route = trace_routes(find_layout(points, curves, (), SETTINGS))
    assert route.line_id == (1, 0)
    assert route.span_id == (0, 0)


def test_two_routes_are_numbered_from_the_west():
    points, curves = make_route([(0, 0), (90, 0)], offsets=(0.0,))
    other, _ = make_route([(300, 100), (300, 190)], offsets=(0.0,))
    both = np.vstack([points, other])
    curves = [make_curve(both, np.arange(len(points), len(both))), curves[0]]
    route = trace_routes(find_layout(both, curves, (), SETTINGS))
    assert route.line_id == (1, 0)
    assert route.span_id == (1, 0)


def test_no_conductor_has_a_span_twice():
    for offsets in ((0.0,), (-4.0, -1.0, 1.0, 4.0), (0.0, 0.4, 0.8, 1.2)):
        _, route = trace([(0, 0), (60, 0), (110, 25), (165, 25), (220, -10)], offsets=offsets)
        pairs = list(zip(route.line_id, route.span_id, strict=True))
        assert len(pairs) == len(set(pairs)) == 4 * len(offsets)
        assert set(route.line_id) == set(range(len(offsets)))


def test_few_curves():
    route = trace_routes(find_layout(np.zeros((0, 3)), [], (), SETTINGS))
    assert route.line_id == route.span_id == route.reverse == ()
    _, route = trace([(0, 0), (90, 0)], offsets=(0.0,))
    assert (route.line_id, route.span_id) == ((0,), (0,))
