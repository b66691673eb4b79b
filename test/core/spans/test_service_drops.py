# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from toys import make_line_cloud, make_pole, make_tree, make_wire, turn

from plc_inspect.core.pipeline import Pipeline
from plc_inspect.results import PointClass


def make_street(*pieces):
    """Make a line of two spans of 45 m on poles, and pieces of wires at the second."""
    more = [make_pole(x, 0.0, 9.6, 40)[:300] for x in (0.0, 45.0, 90.0)]
    taps = [make_wire(*piece, c=2000.0, per_metre=15.0, seed=70 + number)
            for number, piece in enumerate(pieces)]
    points, _ = make_line_cloud(
        spans=(45.0, 45.0), offsets=(-0.8, 0.0, 0.8), height=9.0, c=150.0, half_width=15.0,
        poles=False, more=[*more, *taps],
    )
    own = np.zeros(len(points), dtype=bool)
    if taps:
        own[-sum(map(len, taps)):] = True
    return points, own


TAPS = (((45.2, 0.4, 7.4), (47.0, 7.0, 6.9)), ((45.2, 0.4, 6.9), (47.0, 7.0, 6.4)))


@pytest.fixture(scope='module')
def street():
    """Make the street with two taps, one below the other, and inspect it."""
    points, own = make_street(*TAPS)
    return points, own, Pipeline().run(points)


def test_taps_are_lines_of_their_own_at_the_support(street):
    points, own, result = street
    assert [(span.line_id, span.span_id) for span in result.spans] == [
        (0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1), (3, 2), (4, 2)
    ]
    for span, (start, end) in zip(result.spans[6:], TAPS, strict=True):
        np.testing.assert_allclose(span.start, start, atol=0.5)
        np.testing.assert_allclose(span.end, end, atol=0.3)
        assert (span.open_start, span.open_end) == (False, True)
    wire = result.classification == PointClass.WIRE
    assert wire[own].mean() > 0.95
    held = [item.line_ids for item in result.supports]
    assert held == [(0, 1, 2), (0, 1, 2, 3, 4), (0, 1, 2)]
    assert len(points) == len(wire)


def test_the_line_is_as_it_is_without_its_taps(street):
    _, own, result = street
    alone = Pipeline().run(make_street()[0])
    assert len(alone.spans) == 6
    for one, other in zip(alone.spans, result.spans[:6], strict=True):
        assert (one.line_id, one.span_id) == (other.line_id, other.span_id)
        np.testing.assert_allclose(one.end, other.end, atol=0.05)
    assert ((alone.line_id >= 0) != (result.line_id >= 0)[~own]).sum() < 20  # of 14,760


@pytest.mark.parametrize('rise', [-3.4, -4.9, 2.8])
def test_a_drop_may_be_steep(rise):
    points, own = make_street(((45.2, 0.4, 7.4), (47.0, 7.0, 7.4 + rise)))
    result = Pipeline().run(points)
    assert result.num_lines == 4
    assert (result.classification[own] == PointClass.WIRE).mean() > 0.9


@pytest.mark.parametrize('degrees', [50, 200])
def test_yaw_turns_taps(street, degrees):
    points, own, result = street
    turned = Pipeline().run(turn(points, np.radians(degrees), (3e5, 5e6, 40.0)))
    assert len(turned.spans) == len(result.spans)
    wire = turned.classification == PointClass.WIRE
    assert wire[own].mean() > 0.95


@pytest.mark.parametrize('piece', [
    pytest.param(((45.2, 0.4, 7.4), (45.6, 2.4, 7.4)), id='an arm'),
    pytest.param(((45.2, 0.4, 7.4), (48.0, 7.0, 1.0)), id='a stay'),
    pytest.param(((45.2, 0.4, 7.4), (48.0, 9.0, 1.0)), id='a stay as flat as a drop'),
    pytest.param(((46.5, 5.0, 7.4), (47.9, 10.0, 7.1)), id='it begins too far from the pole'),
    pytest.param(((45.2, 0.4, 2.0), (47.0, 7.0, 1.9)), id='a fence'),
])
def test_other_things_at_a_pole_are_no_taps(piece):
    result = Pipeline().run(make_street(piece)[0])
    assert result.num_lines == 3


def test_a_wire_that_passes_a_pole_is_a_line_of_its_own():
    result = Pipeline().run(make_street(((38.0, 4.0, 7.4), (53.0, 4.0, 7.4)))[0])
    assert result.num_lines == 4


def test_branches_and_roof_edges_at_a_pole_are_no_taps():
    rng = np.random.default_rng(5)
    points, _ = make_street()
    roof = rng.uniform((46.0, 1.0, 0.0), (52.0, 9.0, 0.0), (3000, 3))
    roof[:, 2] = 7.0 - 0.5 * np.abs(roof[:, 0] - 47.0)  # with its ridge towards the pole
    tree = make_tree(44.0, -3.0, 9.0, radius=2.5, num=4000)
    assert Pipeline().run(np.vstack([points, roof, tree])).num_lines == 3


@pytest.mark.parametrize('has_hangers', [False, True])
def test_the_main_cable_of_a_bridge_beside_a_pole_is_no_tap(has_hangers):
    points, _ = make_street()
    cable = make_wire((45.2, 0.4, 7.4), (48.5, 14.0, 11.0), c=120.0, per_metre=15.0, seed=3)
    cable = cable[np.argsort(cable[:, 1])]
    rods = [
        np.column_stack([
            np.full(60, x), np.full(60, y), np.linspace(z - 4.0, z - 0.1, 60)
        ]) for x, y, z in cable[np.searchsorted(cable[:, 1], np.arange(2.4, 13.0, 2.4))]
    ]
    found = Pipeline().run(np.vstack([points, cable, *rods[: 5 * has_hangers]]))
    assert found.num_lines == (3 if has_hangers else 4)


@pytest.mark.parametrize(('c', 'num'), [(90.0, 4), (45.0, 3)])
def test_what_is_deeper_than_a_conductor_is_no_tap(c, num):
    """The main cable of a bridge whose deck was not seen; sags of 6 and 11 % of the span."""
    points, _ = make_street()
    cable = make_wire((45.2, 0.4, 8.6), (47.0, 40.0, 8.6), c=c, per_metre=15.0)
    side = np.random.default_rng(1).uniform((0.0, 15.0, -0.02), (90.0, 42.0, 0.02), (20000, 3))
    assert Pipeline().run(np.vstack([points, side, cable])).num_lines == num


def test_without_a_line_nothing_is_looked_for():
    rng = np.random.default_rng(6)
    ground = np.column_stack([rng.uniform(-20, 20, (5000, 2)), rng.normal(0.0, 0.02, 5000)])
    pieces = [make_wire(*piece, c=2000.0, per_metre=15.0) for piece in TAPS]
    pole = make_pole(45.0, 0.0, 9.6)
    ground[:, 0] += 45.0
    points = np.vstack([ground, pole, *pieces])
    assert Pipeline().run(points).num_lines == 0


def test_an_arm_that_conductors_hang_from_is_no_tap():
    rng = np.random.default_rng(7)
    points, _ = make_line_cloud(
        spans=(60.0, 60.0), offsets=(-0.3, 0.3), height=12.0, c=150.0, half_width=15.0,
        poles=False,
    )
    # the mast stands aside, where no conductor tells of it
    mast = np.column_stack([rng.normal(60.0, 0.2, 1500), rng.normal(5.5, 0.2, 1500),
                            rng.uniform(0.0, 18.0, 1500)])
    arm = np.column_stack([rng.normal(60.0, 0.03, 400), rng.uniform(0.6, 5.5, 400),
                           rng.normal(12.3, 0.03, 400)])
    assert Pipeline().run(np.vstack([points, mast, arm])).num_lines == 2


def test_an_edge_with_other_things_a_metre_beside_is_no_tap():
    rng = np.random.default_rng(8)
    points, own = make_street(TAPS[0])
    assert Pipeline().run(points).num_lines == 4
    along = (np.array(TAPS[0][1]) - TAPS[0][0])[:2]
    along /= np.linalg.norm(along)
    around = points[own][rng.integers(0, own.sum(), 1500)]
    away = rng.choice([-1.0, 1.0], 1500) * rng.uniform(0.83, 0.97, 1500)
    around[:, 2] += rng.uniform(-0.3, 0.3, 1500)
    around[:, :2] += away[:, None] * np.array([-along[1], along[0]])
    assert Pipeline().run(np.vstack([points, around])).num_lines == 3


@pytest.mark.parametrize('apart', [0.4, 0.6])
def test_a_deck_seen_in_lines_at_a_pole_has_no_taps(apart):
    x = np.arange(-6, 7) * apart
    points, own = make_street(*[((45.0 + at, 1.0, 6.0), (45.0 + at, 15.0, 6.0)) for at in x])
    hidden = ~own & (np.abs(points[:, 0] - 45.0) < 4.5) & (points[:, 1] > 1.0) & (points[:, 2] < 1)
    assert Pipeline().run(points[~hidden]).num_lines == 3


@pytest.mark.parametrize('turn', [-0.13, 0.0])
def test_rows_of_a_roof_beyond_the_last_pole_are_no_taps(turn):
    rng = np.random.default_rng(9)
    points, _ = make_street()
    rows = []
    for k in range(11):
        x = np.arange(87.0, 97.5, 0.17) + rng.uniform(-0.03, 0.03, 62)
        y = -0.6 + 0.6 * k + turn * (x - 90.0)
        rows.append(np.column_stack([x, y, 4.6 + 0.7 * y + rng.normal(0.0, 0.01, 62)]))
    roof = np.vstack(rows)
    roof = roof[(roof[:, 1] >= -0.6) & (roof[:, 1] < 2.9)]
    low, high = (87.0, -0.6), (97.5, 4.4)
    below = ((points[:, :2] > low) & (points[:, :2] < high)).all(axis=1) & (points[:, 2] < 0.5)
    assert Pipeline().run(np.vstack([points[~below], roof])).num_lines == 3
