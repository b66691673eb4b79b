# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from toys import hang, make_curve, make_line_cloud, make_tree

from plc_inspect.config import Settings
from plc_inspect.core.extraction.height import extract_high
from plc_inspect.core.extraction.off_ground import gather_off_ground
from plc_inspect.core.spans.layout import find_layout
from plc_inspect.core.spans.point_claims import settle_strays
from plc_inspect.core.spans.route import trace_routes
from plc_inspect.core.spans.spans import build_spans

SETTINGS = Settings()


def make_strays(x, y=0.0, apart=0.3):
    """Make points this far beside the middle conductor of the first span [m]."""
    x = np.asarray(x, float)
    return np.column_stack([x, np.full(len(x), y + apart), hang(x, 100.0, 15.0, 15.0, 800.0)])


def settle(*more, num_wires=6):
    """
    Build the spans of a line of two with other things about, and settle their strays.

    Returns
    -------
    cloud, before, after, and of the cloud's points which of the other things they belong to

    """
    points, label = make_line_cloud(spans=(100.0, 100.0), more=more)
    which = np.full(len(points), -1)
    which[label == 1] = np.repeat(np.arange(len(more)), [len(thing) for thing in more])
    wire = np.flatnonzero(label == 14)[: None if num_wires else 0]
    curves = [make_curve(points, own) for own in np.array_split(wire, 6)] if num_wires else []
    layout = find_layout(points, curves, (), SETTINGS.supports)
    cloud = gather_off_ground(points, extract_high(points, SETTINGS.height), -np.inf)
    before = build_spans(
        cloud, layout, trace_routes(layout), SETTINGS, np.random.default_rng(0)
    )
    return cloud, before, settle_strays(cloud, before), which[cloud.place]


def test_points_beside_a_free_conductor_become_its_own():
    _, before, after, which = settle(make_strays(np.linspace(20.0, 80.0, 10)))
    strays = which == 0
    assert (before.line_id[strays] == -1).all()
    assert set(zip(after.line_id[strays], after.span_id[strays], strict=True)) == {(1, 0)}
    np.testing.assert_allclose(after.residual[strays], 0.3, atol=0.02)


def test_points_farther_off_stay_what_they_were():
    near, far = (make_strays(np.linspace(20.0, 80.0, 10), apart=apart) for apart in (0.45, 0.6))
    _, _, after, which = settle(near, far)
    assert (after.line_id[which == 0] == 1).all()
    assert (after.line_id[which == 1] == -1).all()


def test_points_beside_a_conductor_are_a_trees_where_it_stands():
    tree = make_tree(50.0, 0.8, 15.0, 9.0, 2.0, 8000)
    cloud, before, after, which = settle(tree, make_strays([20.0, 30.0, 70.0, 80.0]))
    model = next(m for m in after.models if (m.span.line_id, m.span.span_id) == (1, 0))
    distance = np.hypot(*model.part(cloud.points)[1:])
    beside = (which == 0) & (before.line_id < 0) & (distance < 0.5)
    assert beside.sum() > 100
    assert (after.line_id[beside] >= 0).mean() < 0.03
    assert (after.line_id[which == 1] == 1).all()


def test_labels_given_and_the_input_are_not_changed():
    cloud, before, after, _ = settle(make_strays(np.linspace(20.0, 80.0, 10)))
    wire = before.line_id >= 0
    assert not len(after.intruders)
    for name in ('line_id', 'span_id', 'residual'):
        own = getattr(before, name)
        np.testing.assert_array_equal(getattr(after, name)[wire], own[wire])
        kept = own.copy()
        settle_strays(cloud, before)
        np.testing.assert_array_equal(own, kept)


@pytest.mark.parametrize('more', [
    (), (make_strays(np.linspace(20.0, 80.0, 10)),), (make_tree(50.0, 0.8, 15.0, 9.0, 2.0, 8000),),
], ids=['free', 'strays', 'tree'])
def test_the_number_of_points_of_a_span_follows_its_labels(more):
    _, before, after, _ = settle(*more)
    for model in after.models:
        span = model.span
        own = (after.line_id == span.line_id) & (after.span_id == span.span_id)
        assert own.sum() == span.num_points
    assert (after.line_id[after.intruders] == -1).all()
    assert (before.line_id[after.intruders] >= 0).all()


def test_without_spans_nothing_is_settled():
    _, before, after, _ = settle(num_wires=0)
    assert after.models == ()
    np.testing.assert_array_equal(after.line_id, before.line_id)
    assert (after.line_id == -1).all()
