# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What a tick looks at: what is new, with whole spans, at a cost that does not grow."""

import dataclasses

import numpy as np
from passage import copy, fly
import pytest
from spans import make_span, sample_points

from plc_inspect.config import MapSettings, Settings
from plc_inspect.core.live.corridor_points import map_numbers
from plc_inspect.core.live.owed_cells import MOST_FAILURES, MOST_RENEWED, OwedCells
from plc_inspect.core.live.warm_up import make_sample
from plc_inspect.core.live.window import (
    CLOSE,
    copy_window,
    plan_everything,
    QUIET,
    WindowPlanner,
)
from plc_inspect.core.mapping.eviction import BATCH, Evictor, START, STOP
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.core.voxel_buffer.voxel_map import VoxelMap
from plc_inspect.results import Decision, PointClass


def make_map(points, **settings):
    voxels = VoxelMap(MapSettings(**settings))
    voxels.insert(points)
    return voxels


def make_block(x, y, height=12.0, num=2000, seed=0):
    """Return points that fill a cell from the ground to a height."""
    rng = np.random.default_rng(seed)
    return rng.uniform((x, y, 0.0), (x + 9.9, y + 9.9, height), (num, 3))


def label(voxels, window, value):
    voxels.label(window.slots, window.points, np.full(len(window.slots), value, dtype=np.uint8))


def test_empty_map_and_nothing_new():
    voxels = VoxelMap(MapSettings())
    planner = WindowPlanner(4.0)
    assert planner.plan(voxels, (), None) is None
    voxels.insert(make_block(0, 0))
    assert planner.plan(voxels, (), None) is not None
    assert planner.plan(voxels, (), None) is None
    empty = copy(VoxelMap(MapSettings()), plan_everything(VoxelMap(MapSettings()), ()))
    assert empty.points.shape == (0, 3)


def test_first_window_is_everything_that_is_high():
    voxels = make_map(np.concatenate((make_block(0, 0), make_block(50, 0, height=0.5))))
    window = copy(voxels, WindowPlanner(4.0).plan(voxels, (), None))
    assert window.fresh.tolist() == [[0, 0]]
    assert window.points[:, 0].max() < 10.0
    assert len(window.points) == voxels.cells.count[0]


def test_height_counts_above_the_lowest_place_around():
    """A cell that holds only a wire is high above the ground of its neighbour."""
    wire = np.column_stack((np.arange(0, 9.9, 0.1), np.full(99, 5.0), np.full(99, 12.0)))
    voxels = make_map(np.concatenate((wire, make_block(10, 0, height=0.3))))
    window = copy(voxels, WindowPlanner(4.0).plan(voxels, (), None))
    assert window.fresh.tolist() == [[0, 0]]
    lonely = make_map(wire)
    assert WindowPlanner(4.0).plan(lonely, (), None) is None


def test_wires_alone_are_looked_at_where_no_ground_was_seen_and_about_the_vehicle():
    wire = np.column_stack((np.arange(0, 9.9, 0.1), np.full(99, 5.0), np.full(99, 12.0)))
    voxels, vehicle = make_map(wire), np.array([-40.0, 5.0, 14.0])
    planner = WindowPlanner(4.0, close=8.0)
    assert planner.plan(voxels, (), vehicle) is None
    assert copy(voxels, planner.plan(voxels, (), vehicle, ground=False)).holds(wire).all()
    voxels = make_map(wire)
    assert copy(voxels, planner.plan(voxels, (), wire[0])).holds(wire).all()


def test_a_little_more_of_the_same_is_not_fresh_until_it_is_quiet():
    voxels = make_map(make_block(0, 0, num=4000))
    planner = WindowPlanner(4.0)
    vehicle = np.array([5.0, 5.0, 20.0])
    assert planner.plan(voxels, (), vehicle) is not None
    voxels.insert(make_block(0, 0, num=100, seed=1))
    assert planner.plan(voxels, (), vehicle) is None
    assert planner.plan(voxels, (), vehicle, at_once=True) is not None
    voxels.insert(make_block(0, 0, num=100, seed=3))
    for _ in range(QUIET + 1):
        voxels.insert(np.array([[500.0, 0.0, 0.0]]))
    assert copy(voxels, planner.plan(voxels, (), vehicle)).fresh.tolist() == [[0, 0]]
    voxels.insert(make_block(0, 0, num=1500, seed=2))
    assert planner.plan(voxels, (), vehicle) is not None


def test_where_a_hazard_waits_to_be_seen_again_is_looked_at():
    voxels = make_map(make_block(0, 0, num=4000))
    planner, vehicle = WindowPlanner(4.0), np.array([5.0, 5.0, 20.0])
    waiting, elsewhere = np.array([[5.0, 5.0, 3.0]]), np.array([[95.0, 5.0, 3.0]])

    def look(places):
        plan = planner.plan(voxels, (), vehicle, waiting=places)
        return plan and copy(voxels, plan)

    assert look(None) is not None
    assert look(waiting) is None  # nothing came in anywhere
    voxels.insert(make_block(0, 0, num=100, seed=1))  # too little to be looked at by itself
    assert look(elsewhere) is None
    assert look(waiting).holds(waiting).all()
    voxels.insert(make_block(20, 0, num=4000, seed=2))  # where nothing is new, with others
    assert look(waiting).holds(waiting).all()
    voxels.insert(make_block(30, 0, num=4000, seed=3))
    far = np.array([70.0, 5.0, 20.0])
    assert not copy(voxels, planner.plan(voxels, (), far, waiting=waiting)).holds(waiting).any()


def test_whatever_is_new_about_the_vehicle_is_looked_at():
    """A wire beside it is little in a cell of a house that was seen before."""
    voxels = make_map(make_block(0, 0, num=4000))
    planner = WindowPlanner(4.0, close=8.0)
    vehicle = np.array([5.0, 5.0, 20.0])
    assert planner.plan(voxels, (), vehicle) is not None
    assert planner.plan(voxels, (), vehicle) is None
    wire = np.column_stack((np.arange(0, 9.9, 0.5), np.full(20, 5.0), np.full(20, 16.0)))
    voxels.insert(wire)
    assert planner.plan(voxels, (), np.array([25.0, 5.0, 20.0])) is None
    window = copy(voxels, planner.plan(voxels, (), vehicle))
    assert window.holds(wire).all()


@pytest.mark.parametrize('how', ['failed', 'in_vain'])
def test_cells_of_ticks_in_vain_are_looked_at_again(how):
    voxels = make_map(np.concatenate([make_block(20 * number, 0) for number in range(3)]))
    planner, owed = WindowPlanner(4.0), OwedCells()
    owed.begin(copy(voxels, planner.plan(voxels, (), None)).fresh)
    owed.end(voxels.cells, **{how: True})
    assert planner.plan(voxels, (), None) is None  # nobody asks while all is in vain
    voxels.insert(make_block(40, 0, seed=1))
    window = copy(voxels, planner.plan(voxels, (), None))
    assert window.fresh.tolist() == [[4, 0]]
    owed.begin(window.fresh)
    owed.end(voxels.cells)
    again = copy(voxels, planner.plan(voxels, (), None))
    assert sorted(again.fresh.tolist()) == [[0, 0], [2, 0]]
    owed.begin(again.fresh)
    owed.end(voxels.cells)
    assert planner.plan(voxels, (), None) is None


def test_a_cell_that_fails_every_tick_is_given_up():
    voxels = make_map(np.concatenate([make_block(20 * number, 0) for number in range(12)]))
    owed, bad = OwedCells(), np.array([[0, 0]])
    others = voxels.cells.index[1:]
    voxels.cells.settle(np.arange(len(voxels.cells)))
    for number in range(MOST_FAILURES):
        owed.begin(bad)
        owed.end(voxels.cells, failed=True)
        assert voxels.cells.num_new[0] == 0
        owed.begin(others[number : number + 1])
        owed.end(voxels.cells)
        assert (voxels.cells.num_new[0] > 0) == (number + 1 < MOST_FAILURES)
        voxels.cells.settle(np.arange(1))


def test_only_some_of_what_is_owed_is_looked_at_in_one_tick():
    num = MOST_RENEWED + 10
    voxels = make_map(np.concatenate([make_block(10 * k, 0, num=20) for k in range(num)]))
    voxels.cells.settle(np.arange(num))
    owed = OwedCells()
    owed.begin(voxels.cells.index)
    owed.end(voxels.cells, in_vain=True)
    looked = set()
    for _ in range(3):
        new = np.flatnonzero(voxels.cells.num_new)
        assert len(new) <= MOST_RENEWED
        looked |= set(new.tolist())
        voxels.cells.settle(new)
        owed.begin(voxels.cells.index[new])
        owed.end(voxels.cells)
    assert len(looked) == num


def test_cells_that_are_not_looked_at_again_bar_no_others():
    """Such as those below the vehicle, where nothing is high, or those that were evicted."""
    num = MOST_RENEWED + 10
    voxels = make_map(np.concatenate([make_block(10 * k, 0, num=20) for k in range(num)]))
    places = voxels.cells.index
    voxels.cells.settle(np.arange(num))
    owed, looked = OwedCells(), set()
    owed.begin(places)
    owed.end(voxels.cells, in_vain=True)
    for _ in range(3):
        new = np.flatnonzero(voxels.cells.num_new)
        voxels.cells.settle(new)
        looked |= set(new.tolist())
        owed.begin(places[:0])
        owed.end(voxels.cells)
    assert len(looked) == num


def test_far_cells_wait_until_they_are_quiet():
    voxels = make_map(make_block(0, 0))
    planner = WindowPlanner(4.0)
    vehicle = np.array([100.0, 0.0, 20.0])
    assert planner.plan(voxels, (), vehicle) is None
    for _ in range(QUIET + 1):
        voxels.insert(np.array([[500.0, 0.0, 0.0]]))
    assert planner.plan(voxels, (), vehicle) is not None


def test_known_spans_come_wholly_and_neighbours_as_stubs():
    spans = [
        make_span((x, y, 12), (x + 200, y, 12), line, span, c=5e4)
        for x, y, line, span in ((0, 5, 0, 0), (200, 5, 0, 1), (0, 25, 1, 0), (0, 500, 2, 2))
    ]
    wires = np.concatenate([sample_points(span, 2000) for span in spans])
    rng = np.random.default_rng(0)
    ground = np.column_stack((
        rng.uniform(0, 400, 40_000), rng.uniform(-10, 40, 40_000), np.zeros(40_000),
    ))
    trees = np.concatenate([make_block(x, 10, 6.0, 800, x) for x in range(0, 400, 10)])
    voxels = make_map(np.concatenate((wires, ground, trees)))
    planner = WindowPlanner(4.0)
    window = copy(voxels, planner.plan(voxels, (), None))
    labels = np.full(len(window.points), Decision.NOT_LINEAR, dtype=np.uint8)
    labels[window.points[:, 2] < 0.2] = Decision.GROUND
    labels[window.points[:, 2] > 10.5] = Decision.WIRE
    voxels.label(window.slots, window.points, labels)
    voxels.insert(make_block(20, 0, seed=5))
    window = copy(voxels, planner.plan(voxels, spans, np.array([25.0, 5.0, 20.0])))
    assert window.fresh.tolist() == [[2, 0]]
    assert window.spans == {(0, 0), (1, 0)}
    wire = window.points[window.points[:, 2] > 10.5]
    for span in (spans[0], spans[2]):
        near = np.abs(wire[:, 1] - span.start[1]) < 0.2
        x = np.sort(wire[near, 0])
        assert x[0] < 1.0
        assert x[-1] > 199.0
        assert np.diff(x).max() < 1.5  # every other voxel, as drawn
    stub = wire[(wire[:, 0] > 205) & (np.abs(wire[:, 1] - 5) < 0.2), 0]
    assert 240.0 < stub.max() < 285.0
    assert wire[:, 1].max() < 30.0
    elsewhere = window.points[window.points[:, 0] > 60.0]
    assert not ((elsewhere[:, 2] > 1.0) & (elsewhere[:, 2] < 6.0)).any()  # no trees
    assert (elsewhere[:, 2] < 0.2).any()  # some ground


@pytest.mark.parametrize('num', [1, 7])
def test_each_conductor_of_a_cell_keeps_its_points(num):
    spans = [
        make_span((0, 5.05, 12.05 + k), (200, 5.05, 12.05 + k), k, 0, c=5e4) for k in range(num)
    ]
    places = np.random.default_rng(0).uniform((0, 0), (200, 10), (40_000, 2))
    ground = np.column_stack((places, np.full(40_000, 0.05)))
    voxels = make_map(np.concatenate([sample_points(span, 20_000) for span in spans] + [ground]))
    planner = WindowPlanner(4.0)
    window = copy(voxels, planner.plan(voxels, (), None))
    high = window.points[:, 2] > 8.0
    voxels.label(window.slots, window.points,
                 np.where(high, Decision.WIRE, Decision.GROUND).astype(np.uint8))
    before = high.sum() / num
    voxels.insert(make_block(20, 0, 6.0, seed=5))
    plan = planner.plan(voxels, spans, np.array([25.0, 5.0, 20.0]))
    assert set(plan.conductors.tolist()) == {num}
    window = copy(voxels, plan)
    far = (window.points[:, 2] > 8.0) & (window.points[:, 0] > 60.0)
    assert 140 * 3.5 < far.sum() / num < 140 * 8  # points a metre, however many share a cell
    assert far.sum() / num < 0.6 * before


def test_what_is_close_to_a_conductor_is_never_thinned_out():
    voxels = make_map(make_block(0, 0, num=9000))
    planner = WindowPlanner(4.0)
    window = copy(voxels, planner.plan(voxels, (), None))
    num = len(window.points)
    label(voxels, window, CLOSE)
    voxels.insert(make_block(0, 0, num=2500, seed=1))
    again = copy(voxels, planner.plan(voxels, (), None))
    assert len(again.points) == len(voxels) > num
    label(voxels, again, Decision.NOT_LINEAR)
    voxels.insert(make_block(0, 0, num=2500, seed=2))
    thinned = copy(voxels, planner.plan(voxels, (), None))
    assert len(thinned.points) < 0.6 * len(voxels)


def test_a_window_does_not_change_with_the_map():
    voxels = make_map(make_block(0, 0))
    window = copy(voxels, WindowPlanner(4.0).plan(voxels, (), None))
    before = window.points.copy()
    voxels.insert(make_block(0, 0, seed=3))
    voxels.drop(0, np.zeros(256, dtype=np.bool_))
    np.testing.assert_array_equal(window.points, before)


def test_scans_may_come_between_the_steps_of_a_copy():
    voxels = make_map(np.concatenate([make_block(x, 0, num=9000, seed=x) for x in (0, 20, 40)]))
    before = voxels.centroids()
    steps = copy_window(voxels, WindowPlanner(4.0).plan(voxels, (), None))
    window, number = None, 0
    while window is None:
        window = next(steps)
        number += 1
        voxels.insert(make_block(60, 0, num=500, seed=100 + number))
        voxels.drop(voxels.cells.find(np.array([[4, 0]]))[0], np.zeros(256, dtype=np.bool_))
    assert number > 1
    assert np.isin(window.points[:, 0], before[:, 0]).mean() > 0.99


def test_everything_comes_in_the_order_of_a_replay():
    voxels = make_map(np.random.default_rng(0).uniform(-50, 50, (60_000, 3)))
    window = copy(voxels, plan_everything(voxels, ()))
    np.testing.assert_array_equal(window.points, voxels.centroids())


def test_holds_tells_where_everything_was_seen():
    voxels = make_map(np.concatenate((make_block(0, 0), make_block(-10, -10))))
    window = copy(voxels, WindowPlanner(4.0).plan(voxels, (), None))
    points = np.array([[5.0, 5, 0], [-5.0, -5, 99], [5.0, -5, 0], [np.pi, 9.99, 1]])
    assert window.holds(points).tolist() == [True, True, False, True]
    assert window.holds(np.empty((0, 3))).tolist() == []


def test_cost_does_not_grow_with_the_map():
    """After a long flight a new block asks for no more voxels than at its start."""
    planner, sizes = WindowPlanner(4.0), []
    voxels = make_map(make_block(0, 0))
    for number in range(1, 60):
        voxels.insert(make_block(20 * number, 0, seed=number))
        window = copy(voxels, planner.plan(voxels, (), np.array([20.0 * number, 0, 20])))
        label(voxels, window, Decision.NOT_LINEAR)
        sizes.append(len(window.points))
    assert max(sizes[30:]) <= 1.1 * max(sizes[:30])
    assert len(voxels) > 40 * sizes[-1]


def fill(voxels, num, start=0):
    for number in range(start, start + num):
        voxels.insert(make_block(10 * number, 0, num=2000, seed=number))


def test_eviction_takes_the_farthest_first_and_wires_last():
    voxels = VoxelMap(MapSettings(max_voxels=40_000))
    evictor = Evictor(voxels)
    fill(voxels, 19)
    window = copy(voxels, plan_everything(voxels, ()))
    high = window.points[:, 2] > 11.0
    voxels.label(window.slots, window.points,
                 np.where(high, Decision.WIRE, Decision.GROUND).astype(np.uint8))
    assert evictor.step(np.array([190.0, 0, 0])) == 0
    fill(voxels, 1, start=19)
    size = len(voxels)
    assert size > START * 40_000
    removed = evictor.step(np.array([190.0, 0, 0]))
    assert removed == size - len(voxels) == evictor.num_evicted
    assert not evictor.complete
    assert len(voxels) <= STOP * 40_000 + 2000
    points = voxels.centroids()
    far, near = points[points[:, 0] < 10], points[points[:, 0] > 150]
    assert far[:, 2].min() > 11.0  # its wires stand
    assert near[:, 2].min() < 1.0
    assert len(points[points[:, 2] > 11.0]) >= high.sum()


def test_eviction_of_a_map_of_wires_takes_wires():
    voxels = VoxelMap(MapSettings(max_voxels=20_000))
    evictor = Evictor(voxels)
    for number in range(10):
        voxels.insert(make_block(10 * number, 0, num=2000, seed=number))
        window = copy(voxels, plan_everything(voxels, ()))
        label(voxels, window, Decision.WIRE)
    assert evictor.step(np.array([95.0, 5, 0])) > 0
    assert voxels.centroids()[:, 0].min() >= 10.0
    assert len(voxels) <= STOP * 20_000


def test_a_map_that_is_never_full_keeps_taking_points():
    voxels = VoxelMap(MapSettings(max_voxels=30_000))
    evictor = Evictor(voxels)
    refused = 0
    for number in range(80):
        insertion = voxels.insert(make_block(10 * number, 0, num=1000, seed=number))
        refused += insertion.num_refused
        assert evictor.step(np.array([10.0 * number, 0, 0])) <= BATCH + 2000
        assert len(voxels) <= 30_000
    assert refused == 0
    assert len(voxels) > STOP * 30_000 - 1000
    assert voxels.cells.count.sum() == len(voxels)


@pytest.fixture(scope='module')
def sample():
    """Return the made-up line, and what the pipeline finds in all of it."""
    points = make_sample()
    return points, Pipeline(Settings()).run(points)


def test_session_finds_in_pieces_what_the_pipeline_finds_in_the_whole(sample):
    points, whole = sample
    session, voxels, states = fly(points, 20)
    confirmed = states[-1].confirmed
    assert len(confirmed) == len(whole.spans) == 6
    assert {item.span.line_id for item in confirmed} == {0, 1, 2}
    ids = {}
    for state in states:
        for item in state.confirmed:
            y = round(float(item.span.start[1]), 0)
            ids.setdefault(y, set()).add(item.span.line_id)
    assert sorted(map(len, ids.values())) == [1, 1, 1]
    state, final, _ = session.conclude(
        voxels.centroids(), Settings(), voxels.sequence, complete=True
    )
    assert len(final.spans) == 6
    assert {(s.line_id, s.span_id) for s in final.spans} == {i.key for i in confirmed}
    assert set(final.line_id[final.line_id >= 0]) == {0, 1, 2}
    wire = final.classification == PointClass.WIRE
    assert (final.line_id[wire] >= 0).all()
    assert state.hazards == final.hazards


def test_corridor_follows_the_vehicle(sample):
    points, _ = sample
    _, _, states = fly(points, 12)
    corridor = states[-1].corridor
    assert len(corridor.points) == len(corridor.clearance) == len(corridor.line_id) > 100
    places = np.unique(np.round(corridor.points, 4), axis=0)
    assert len(places) == len(corridor.points)  # no point twice


def test_numbers_are_translated_point_by_point():
    line, span = np.array([0, 1, -1, 2, 0], np.int32), np.array([0, 1, -1, 0, 3], np.int32)
    found = map_numbers(line, span, {(0, 0): (5, 6), (1, 1): (-3, -4)})
    assert [item.tolist() for item in found] == [[5, -3, -1, -1, -1], [6, -4, -1, -1, -1]]
    empty = map_numbers(line[:0], span[:0], {})
    assert [item.tolist() for item in empty] == [[], []]
    assert [item.tolist() for item in map_numbers(line, span, {})] == [[-1] * 5] * 2


def test_states_are_frozen(sample):
    _, _, states = fly(sample[0], 3)
    with pytest.raises(dataclasses.FrozenInstanceError):
        states[0].hazards = ()
