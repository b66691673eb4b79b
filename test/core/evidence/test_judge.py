# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Curves judged together: wires side by side, pieces beside them, and trusses."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from toys import make_curve, make_index, make_sight, make_wire

from plc_inspect.config import CatenarySettings
from plc_inspect.core.evidence.conductors import _list_bundles
from plc_inspect.core.evidence.judge import Judge
from plc_inspect.core.evidence.validation import (
    BAR,
    CROWDED,
    DEEP,
    HELD,
    STAY,
    TIED,
    UNPROVEN,
    UNTIDY,
)


def judge(wires, others=(), seen=True):
    """Return what speaks against each of some wires, among other points."""
    points = np.vstack([*wires, *others])
    first = np.cumsum([0, *map(len, wires)])
    curves = [
        make_curve(points, np.arange(first[k], first[k + 1])) for k in range(len(wires))
    ]
    found = Judge(points, make_index(points), make_sight(points, seen), curves, CatenarySettings())
    found.decide()
    return [verdict.objection for verdict in found.verdicts]


def make(y=0.0, z=12.0, start=0.0, length=60.0, c=400.0, seed=0):
    return make_wire(
        (start, y, z), (start + length, y, z), c=c, per_metre=30.0, seed=seed
    )


def test_wires_that_hang_side_by_side_do_not_clutter_each_other():
    wires = [make(y=0.5 * k, seed=k) for k in range(4)]
    assert judge(wires) == [''] * 4


def test_strands_of_a_bundle_that_is_free_as_a_whole_do_not_clutter_each_other():
    """Though one of them has no curve, as it was seen twice, and no ground was seen."""
    rng = np.random.default_rng(2)
    places = [(0.0, 12.0), (0.45, 12.0), (0.0, 11.55), (0.45, 11.55)]
    wires = [make(y=y, z=z, seed=k) for k, (y, z) in enumerate(places)]
    wires[3][:, 1] += 0.25 * (rng.random(len(wires[3])) < 0.5)
    points = np.vstack(wires)
    ends = np.cumsum([0, *map(len, wires)])
    strands = [make_curve(points, np.arange(*own)) for own in list(pairwise(ends))[:3]]
    whole = make_curve(points, np.arange(len(points)), 0.5)
    found = Judge(
        points, make_index(points), make_sight(points, False), [whole], CatenarySettings()
    )
    found.decide()
    assert found.verdicts[0].objection == CROWDED
    assert len(found.try_more(strands)) < len(strands)
    spared = _list_bundles([whole], found.verdicts, CatenarySettings())
    assert len(spared) > 0.9 * len(points)
    won = found.try_more(strands, spared=spared)
    assert [curve for curve, _ in won] == strands


def test_a_thick_curve_that_is_not_proven_frees_no_other():
    rng = np.random.default_rng(2)
    thick = make(y=0.8, c=2000.0, length=30.0)
    thick[:, 1:] += rng.normal(0.0, 0.13, (len(thick), 2))
    wire = make(c=1e5, length=30.0, seed=1)
    points = np.vstack([wire, thick])
    curves = [
        make_curve(points, np.arange(len(wire))),
        make_curve(points, np.arange(len(wire), len(points)), 0.4),
    ]
    found = Judge(points, make_index(points), make_sight(points), curves, CatenarySettings())
    assert found.verdicts[1].objection == UNPROVEN
    found.decide()
    assert found.verdicts[0].objection
    assert found.verdicts[1].objection


def test_a_piece_too_short_alone_is_believed_beside_a_conductor():
    piece = make(z=11.0, start=20.0, length=8.0, c=1e5, seed=1)
    assert judge([piece]) == [UNPROVEN]
    assert judge([make(c=1000.0), piece]) == ['', '']


@pytest.mark.parametrize(('y', 'z'), [(1.0, 12.0), (-4.0, 12.0), (0.0, 9.0), (2.0, 14.0)])
def test_a_conductor_far_slacker_than_others_of_its_span_is_believed(y, z):
    slack = make(y=y, z=z, c=80.0, seed=1)  # sags by 9 % of its span
    assert judge([slack]) == [DEEP]
    assert judge([make(c=1000.0), slack]) == ['', '']
    seen = slack[(slack[:, 0] > 0.0) & (slack[:, 0] < 50.0)]
    assert judge([make(c=1000.0), seen]) == ['', '']


@pytest.mark.parametrize('other', [
    make(y=8.0, c=1000.0), make(c=1000.0, length=40.0), make(c=130.0),
    make_wire((30.0, -30.0, 12.0), (30.0, 30.0, 12.0), c=1000.0, per_metre=30.0),
], ids=['far', 'short', 'as slack', 'across'])
def test_a_cable_as_deep_as_no_conductor_is_none_without_others_along_it(other):
    assert judge([other, make(y=1.0, c=80.0, seed=1)]) == ['', DEEP]


def test_a_piece_that_runs_another_way_is_not_beside():
    across = make_wire((20.0, -4.0, 10.5), (20.0, 4.0, 10.5), c=1e5, per_metre=30.0)
    assert judge([make(c=1000.0), across]) == ['', UNPROVEN]


def test_a_piece_beside_one_that_was_believed_beside_is_believed_too():
    chain = [make(y=2.5 * k, start=20.0, length=8.0, c=1e5, seed=k) for k in (1, 2)]
    assert judge([make(c=1000.0), *chain]) == ['', '', '']


def lay_bracing(apart, length, per_metre=8, seed=9):
    """Make the diagonals between two chords, there and back in each metre."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(0.0, length, int(per_metre * length))
    share = np.abs(2.0 * (x % 1.0) - 1.0)
    bracing = make(length=length, seed=seed)[:1].repeat(len(x), axis=0)
    bracing[:, 0], bracing[:, 1] = x, apart * share
    middle = length / 2
    bracing[:, 2] = 12.0 + 400.0 * (np.cosh((x - middle) / 400.0) - np.cosh(middle / 400.0))
    return bracing + rng.normal(0.0, 0.02, bracing.shape)


def test_chords_of_a_truss_are_no_conductors():
    chords = [make(), make(y=1.5, seed=1)]
    assert judge(chords) == ['', '']
    assert judge(chords, [lay_bracing(1.5, 60.0)]) == [TIED, TIED]
    assert judge(chords, [lay_bracing(1.5, 60.0, per_metre=40)]) == [CROWDED, CROWDED]
    assert judge(chords[:1], [lay_bracing(1.5, 60.0, per_metre=40)]) == [CROWDED]


def test_wires_with_a_wire_between_that_was_not_found_are_not_tied():
    between = make(y=0.75, seed=2)
    assert judge([make(), make(y=1.5, seed=1)], [between]) == ['', '']


def test_a_crown_between_two_wires_ties_them_nowhere_else():
    rng = np.random.default_rng(0)
    crown = np.column_stack([
        rng.uniform(20.0, 30.0, 4000), rng.uniform(-0.5, 2.0, 4000), rng.uniform(9.0, 12.5, 4000)
    ])
    assert judge([make(), make(y=1.5, seed=1)], [crown]) == ['', '']


def test_one_curve_on_a_sheet_is_cluttered_and_two_do_not_free_it():
    rng = np.random.default_rng(1)
    sheet = make()[rng.integers(0, 1800, 12000)]
    sheet[:, 1] += rng.uniform(-3.0, 3.0, len(sheet))
    assert judge([make()], [sheet]) == [CROWDED]
    assert CROWDED in judge([make(), make(y=0.6, seed=1)], [sheet])


def test_nothing_is_judged_where_there_is_no_curve():
    points = np.ones((5, 3))
    found = Judge(points, make_index(points), make_sight(points), [], CatenarySettings())
    found.decide()
    assert found.verdicts == []
    assert not found.wire.any()


@pytest.mark.parametrize(('objection', 'crowding', 'spread', 'deep', 'expected'), [
    (STAY, 1.0, 0.02, 0.0, TIED), (UNPROVEN, 0.0, 0.02, 0.0, TIED),
    (STAY, 1.0, 0.02, 0.3, TIED), (UNPROVEN, 0.0, 0.02, 0.3, TIED),
    (UNPROVEN, 1.0, 0.02, 0.0, TIED), (UNPROVEN, 0.0, 0.2, 0.0, TIED),
    (UNTIDY, 1.0, 0.2, 0.0, TIED),
    (UNPROVEN, 1.0, 0.02, 0.3, ''), (UNPROVEN, 0.0, 0.2, 0.3, ''), (UNTIDY, 1.0, 0.2, 0.3, ''),
    ('too short', 0.0, 0.02, 0.0, ''),
])
def test_what_is_tied_to_something_that_is_no_conductor_is_none(
    objection, crowding, spread, deep, expected
):
    """But to what runs through the midst of it, or is thick: that may be of a crown, if deep."""
    lower, upper = make(z=12.0, c=1000.0), make(z=13.0, c=1000.0, seed=1)
    at = np.random.default_rng(6).integers(0, len(lower), 6000)
    up = np.random.default_rng(7).uniform(0.0, 1.0, (len(at), 1))
    lattice = lower[at] + up * np.array([0.0, 0.0, 1.0])
    lattice[:, 1] += np.random.default_rng(8).normal(0.0, deep, len(at))
    points = np.vstack([lower, upper, lattice])
    ends = np.cumsum([0, len(lower), len(upper)])
    curves = [make_curve(points, np.arange(low, high)) for low, high in pairwise(ends)]
    found = Judge(points, make_index(points), make_sight(points), curves, CatenarySettings())
    found.curves[0] = replace(curves[0], lateral_rmse=spread)
    first, other = found.verdicts
    shell = np.where(first.profile.core > 0, 100 * crowding, 0).astype(np.int64)
    found.verdicts = [
        replace(first, objection=objection, profile=replace(first.profile, shell=shell)),
        replace(other, objection=''),
    ]
    found.untie()
    assert [verdict.objection for verdict in found.verdicts] == [objection, expected]


def make_bar(first, last, low=0.0, high=40.0, y=0.0):
    """Return the points of a straight bar between two heights."""
    x = np.arange(low, high, 1.0 / 30.0)
    z = first + (last - first) * (x - low) / (high - low)
    points = np.column_stack([x, np.full(len(x), y), z])
    return points + np.random.default_rng(3).normal(0.0, 0.01, points.shape)


def make_rods(places, top_of):
    """Return the points of thin rods that go 4 m down from something at some x."""
    rng = np.random.default_rng(5)
    return [
        np.column_stack([rng.normal(x, 0.02, 40), rng.normal(0.0, 0.02, 40),
                         top_of(x) - rng.uniform(0.0, 4.0, 40)])
        for x in places
    ]


def test_a_pipe_on_brackets_is_held_and_a_level_wire_of_few_supports_is_not():
    pipe = make_bar(12.0, 12.0)
    assert judge([pipe], make_rods(np.arange(2.0, 40.0, 6.0), lambda _: 12.0)) == [HELD]
    assert judge([pipe], make_rods((2.0, 22.0, 38.0), lambda _: 12.0)) == ['']


def test_what_held_a_pipe_may_prove_to_be_wires():
    pipe = make_bar(12.0, 12.0)
    rods = make_rods(np.arange(2.0, 40.0, 6.0), lambda _: 12.0)
    points = np.vstack([pipe, *rods])
    found = Judge(
        points, make_index(points), make_sight(points), [make_curve(points, np.arange(len(pipe)))],
        CatenarySettings(),
    )
    found.decide()
    assert [verdict.objection for verdict in found.verdicts] == [HELD]
    found._unhold()
    assert [verdict.objection for verdict in found.verdicts] == [HELD]
    found.wire[:] = True
    found._unhold()
    assert [verdict.objection for verdict in found.verdicts] == ['']


def test_a_conductor_with_diverters_at_even_distances_is_kept():
    wire = make(c=400.0)
    places = np.arange(3.0, 58.0, 6.0)
    heights = [float(wire[np.argmin(np.abs(wire[:, 0] - x)), 2]) for x in places]
    hanging = [
        np.column_stack([np.full(40, x), np.zeros(40), z - np.linspace(0.1, 0.9, 40)])
        for x, z in zip(places, heights, strict=True)
    ]
    assert judge([wire], hanging) == ['']


def test_a_steep_straight_bar_is_a_stay_and_a_level_one_is_not():
    assert judge([make_bar(8.0, 26.0)]) == [STAY]
    assert judge([make_bar(12.0, 12.5)]) == ['']


def clutter_jib(share, seed=4):
    """Return points about a share of the metres of a bar 60 m long, 12 m high."""
    rng = np.random.default_rng(seed)
    return [
        np.column_stack([rng.uniform(x, x + 1.0, 25), rng.uniform(-0.5, 0.5, 25),
                         rng.uniform(10.8, 12.4, 25)])
        for x in rng.permutation(60)[: int(share * 60)]
    ]


@pytest.mark.parametrize(('share', 'expected'), [(0.6, STAY), (0.4, UNPROVEN)])
def test_what_is_surely_straight_and_more_cluttered_than_free_is_a_beam_of_stays(share, expected):
    """The jib of a crane that was seen in few points."""
    bars = [make_bar(17.5, 13.5, 20.0, 38.0), make_bar(12.0, 12.0, 0.0, 60.0)]
    assert judge(bars, clutter_jib(share)) == [expected, UNPROVEN]


def test_a_beam_holds_what_is_found_later():
    stay, jib = make_bar(17.5, 13.5, 20.0, 38.0), make_bar(12.0, 12.0, 0.0, 60.0)
    stay[:, 2] += (stay[:, 0] - 20.0) * (stay[:, 0] - 38.0) / 800.0  # over two of them
    points = np.vstack([stay, jib, *clutter_jib(0.6)])
    first, then = np.arange(len(stay), len(stay) + len(jib)), np.arange(len(stay))
    found = Judge(
        points, make_index(points), make_sight(points), [make_curve(points, first)],
        CatenarySettings(),
    )
    found.decide()
    assert found.try_more([make_curve(points, then)]) == []


@pytest.mark.parametrize(('last', 'expected'), [(14.0, STAY), (21.7, '')])
def test_what_was_believed_is_a_stay_once_another_one_is_seen(last, expected):
    bars = [make_bar(22.0, 18.0), make_bar(22.0, last, y=2.0 if not expected else 0.0)]
    points = np.vstack(bars)
    ends = np.cumsum([0, *map(len, bars)])
    one, other = (make_curve(points, np.arange(low, high)) for low, high in pairwise(ends))
    found = Judge(points, make_index(points), make_sight(points), [one], CatenarySettings())
    found.decide()
    assert found.believed == [one]
    assert len(found.try_more([other])) == (not expected)
    assert [verdict.objection for verdict in found.verdicts] == [expected]


def test_what_is_searched_again_needs_a_proven_sag_or_a_conductor_beside():
    bar, wire = make_bar(12.0, 12.0), make(y=20.0)
    points = np.vstack([bar, wire])
    ends = np.cumsum([0, len(bar), len(wire)])
    curves = [make_curve(points, np.arange(low, high)) for low, high in pairwise(ends)]
    found = Judge(points, make_index(points), make_sight(points), [], CatenarySettings())
    assert [curve for curve, _ in found.try_more(curves[:1])] == curves[:1]
    assert found.try_again(curves[:1]) == []
    assert [curve for curve, _ in found.try_again(curves[1:2])] == curves[1:2]
    assert [curve for curve, _ in found.try_again(curves[:2])] == curves[1:2]


def test_beside_is_what_is_believed_however_free_the_piece_is_itself():
    """Not what is dropped, too, as it has no proven sag."""
    pieces = [
        make(y=1.0, start=20.0, length=25.0, c=1e5, seed=1),
        make(y=20.0, length=25.0, c=1e5, seed=2),
        make(y=21.0, start=5.0, length=8.0, c=1e5, seed=3),
    ]
    points = np.vstack([make(c=1000.0), *pieces])
    ends = np.cumsum([0, len(points) - sum(map(len, pieces)), *map(len, pieces)])
    known, *curves = (make_curve(points, np.arange(low, high)) for low, high in pairwise(ends))
    found = Judge(points, make_index(points), make_sight(points), [known], CatenarySettings())
    found.decide()
    assert [curve for curve, _ in found.try_more(curves)] == curves
    assert [curve for curve, _ in found.try_again(curves)] == curves[:1]


def test_a_main_cable_is_none_once_its_beam_is_found():
    wire = make(length=60.0, c=150.0)
    rng = np.random.default_rng(8)
    deck = np.column_stack([
        rng.uniform(0.0, 60.0, 9000), rng.uniform(-0.8, 0.8, 9000), np.full(9000, 8.5)
    ]) + rng.normal(0.0, 0.01, (9000, 3))
    points = np.vstack([wire, deck])
    one = make_curve(points, np.arange(len(wire)))
    middle = np.flatnonzero(np.abs(deck[:, 1]) < 0.1) + len(wire)
    other = make_curve(points, middle)
    both = Judge(
        points, make_index(points), make_sight(points), [one, other], CatenarySettings()
    )
    both.decide()
    assert both.verdicts[0].objection == STAY  # the main cable of a bridge, if seen together
    found = Judge(points, make_index(points), make_sight(points), [one], CatenarySettings())
    found.decide()
    assert found.believed == [one]
    assert found.try_more([other]) == []
    assert [verdict.objection for verdict in found.verdicts] == [STAY]


def test_a_proven_sag_is_believed_whatever_else_is_built_below():
    wire, bar = make(length=60.0, c=150.0), make_bar(7.0, 7.5, 0.0, 60.0)
    points = np.vstack([wire, bar])
    one, other = make_curve(points, np.arange(len(wire))), make_curve(
        points, np.arange(len(wire), len(points))
    )
    found = Judge(points, make_index(points), make_sight(points), [one], CatenarySettings())
    found.decide()
    found.try_more([other])
    assert found.believed == [one]


def test_a_pipe_seen_from_above_is_a_bar():
    rng = np.random.default_rng(4)
    around = rng.uniform(0.0, np.pi, 160)
    round_top = 0.14 * np.column_stack([np.cos(around), np.sin(around)])
    noise = rng.normal(0.0, 0.03, (160, 2))
    for spread, expected in ((round_top, BAR), (2.0 * noise, '')):
        points = np.column_stack([rng.uniform(0.0, 34.0, 160), spread + noise])
        points[:, 2] += 12.0
        found = Judge(
            points, make_index(points), make_sight(points), [make_curve(points, tolerance=0.35)],
            CatenarySettings(),
        )
        found.decide()
        assert [verdict.objection for verdict in found.verdicts] == [expected]


def test_three_hangers_hold_a_cable_as_deep_as_those_of_bridges():
    cable = make(c=150.0, length=40.0)
    places = (12.0, 18.0, 24.0)
    rods = make_rods(places, lambda x: float(cable[np.argmin(np.abs(cable[:, 0] - x)), 2]))
    assert judge([cable], rods) == [HELD]
    assert judge([make(c=400.0, length=40.0)], rods) == ['']


def test_a_cable_deeper_than_any_conductor_is_of_the_deck_below_it():
    cable = make(c=60.0, length=30.0)
    rng = np.random.default_rng(6)
    z = cable[:, 2].min() - 3.0
    deck = np.column_stack([
        rng.uniform(0.0, 30.0, 2000), rng.uniform(0.3, 4.0, 2000), rng.normal(z, 0.02, 2000)
    ])
    assert judge([cable], [deck]) == [HELD]
    assert judge([cable]) == ['']


def test_what_may_go_on_a_conductor_passes_below_a_roof_and_is_not_its_edge():
    rng = np.random.default_rng(6)
    roof = np.column_stack([
        rng.uniform(0.0, 9.0, 900), rng.uniform(0.3, 5.0, 900), rng.normal(12.0, 0.02, 900)
    ])
    for z, expected in ((11.8, HELD), (8.0, '')):
        piece = make_bar(z, z, high=9.0)
        points = np.vstack([piece, roof])
        found = Judge(
            points, make_index(points), make_sight(points),
            [make_curve(points, np.arange(len(piece)))], CatenarySettings(),
        )
        assert found.name_built(np.array([0]), below=1.5) == [expected]
        assert found.name_built(np.array([0])) == [HELD]
