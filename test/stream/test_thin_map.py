# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Which blocks are sent when, and the budget."""

import numpy as np
import pytest

from plc_inspect.stream import thin_map
from plc_inspect.stream.blocks import find_home, thin_points
from plc_inspect.stream.budget import Budget, OVERHEAD
from plc_inspect.stream.thin_map import ThinMap


def cells_of(points, near=2.0):
    points = np.array(points, float).reshape(-1, 3)
    return thin_points(points, np.full(len(points), 5, np.uint8),
                       np.full(len(points), near, np.float32), 0.5)


def strip(low, high, step=0.5):
    """Points along x."""
    x = np.arange(low, high, step)
    return np.column_stack((x, np.full(len(x), 1.0), np.full(len(x), 2.0)))


def empty_out(held, now):
    """Take everything that is due; return the codes by block."""
    sent = {}
    while blocks := held.take(now):
        sent |= blocks
    return sent


def test_everything_is_sent_once_nearest_first():
    held = ThinMap(0.5, 150.0)
    held.update(cells_of(strip(0.0, 80.0)), np.array([40.0, 0.0]), 0.0)
    sent = empty_out(held, 0.1)
    assert len(sent) == 10
    assert next(iter(sent)) in ((4, 0), (5, 0))
    assert list(sent)[-1] in ((0, 0), (9, 0))
    held.update(cells_of(strip(0.0, 80.0)), np.array([41.0, 0.0]), 1.0)
    assert held.take(100.0) == {}


def test_messages_stay_short():
    held = ThinMap(0.5, 1000.0)
    rng = np.random.default_rng(0)
    held.update(cells_of(rng.uniform((-200, -20, 0), (200, 20, 15), (60_000, 3))), None, 0.0)
    first = held.take(0.0)
    cells = sum(map(len, first.values()))
    assert 600 < cells < 2500
    assert len(empty_out(held, 0.0)) == len(held) - len(first)


def test_what_changed_is_sent_at_once_and_what_trembles_is_not():
    held = ThinMap(0.5, 150.0)
    vehicle = np.array([4.0, 0.0])
    held.update(cells_of(strip(0.0, 8.0)), vehicle, 0.0)
    held.take(0.0)
    held.update(cells_of(strip(0.0, 8.0), near=2.2), vehicle, 1.0)
    assert held.take(1.0 + thin_map.PATIENCE) == {}
    held.update(cells_of(strip(0.0, 8.0), near=4.0), vehicle, 2.0)
    assert list(held.take(2.0)) == [(0, 0)]


def test_a_small_change_waits_for_others():
    held = ThinMap(0.5, 150.0)
    held.update(cells_of(strip(0.0, 8.0, 0.25)), np.array([4.0, 0.0]), 0.0)
    held.take(0.0)
    more = np.vstack((strip(0.0, 8.0, 0.25), [[1.0, 5.0, 2.0]]))
    held.update(cells_of(more), np.array([4.0, 0.0]), 1.0)
    assert held.take(2.0) == {}
    assert list(held.take(1.0 + thin_map.PATIENCE)) == [(0, 0)]


def test_what_is_no_more_is_taken_back_only_where_all_was_seen():
    held = ThinMap(0.5, 150.0)
    held.update(cells_of(strip(0.0, 80.0)), np.array([40.0, 0.0]), 0.0)
    empty_out(held, 0.0)
    held.update(cells_of(strip(8.0, 80.0)), np.array([40.0, 0.0]), 1.0)
    gone = held.take(2.0)
    assert {key: len(codes) for key, codes in gone.items()} == {(0, 0): 0}
    assert len(held) == 9
    held.update(cells_of(strip(200.0, 208.0)), np.array([204.0, 0.0]), 3.0)
    sent = empty_out(held, 20.0)
    kept = {key for key in held._blocks if key[0] * 8.0 < 55.0}
    assert (25, 0) in sent
    assert {key for key, codes in sent.items() if not len(codes)} == {
        (k, 0) for k in (7, 8, 9)
    }
    assert kept == {(k, 0) for k in range(1, 7)}


def test_a_block_at_the_edge_keeps_what_is_out_of_reach():
    held = ThinMap(0.5, 20.0)
    held.update(cells_of(strip(0.0, 8.0)), np.array([0.0, 0.0]), 0.0)
    held.take(0.0)
    held.update(cells_of(strip(4.0, 8.0)), np.array([22.0, 0.0]), 1.0)
    assert held.take(1.0 + thin_map.PATIENCE) == {}
    assert len(held._blocks[0, 0].codes) == 16


def test_who_is_new_gets_an_outline_and_then_everything():
    held = ThinMap(0.5, 150.0)
    held.update(cells_of(strip(0.0, 800.0)), np.array([0.0, 0.0]), 0.0)
    empty_out(held, 0.0)
    assert held.take_overview() == {}
    held.refresh(1.0)
    outline = {}
    while blocks := held.take_overview():
        outline |= blocks
    assert set(outline) == {find_home((k, 0)) for k in range(100)}
    assert sum(map(len, outline.values())) == 200
    sent = empty_out(held, 1.0)
    assert len(sent) == 100
    assert next(iter(sent)) == (0, 0)


def test_new_places_come_before_old_ones_that_somebody_wants():
    held = ThinMap(0.5, 150.0)
    held.update(cells_of(strip(0.0, 40.0)), np.array([0.0, 0.0]), 0.0)
    empty_out(held, 0.0)
    held.refresh(1.0)
    held.update(cells_of(strip(0.0, 48.0)), np.array([0.0, 0.0]), 1.1)
    assert next(iter(held.take(1.2))) == (5, 0)


def test_where_nobody_listens_nothing_waits():
    held = ThinMap(0.5, 150.0)
    held.update(cells_of(strip(0.0, 40.0)), None, 0.0)
    held.forget_listeners()
    assert held.take(1.0) == {}
    held.refresh(5.0)
    assert len(empty_out(held, 5.0)) == 5


def test_a_block_that_comes_and_goes_unseen_leaves_nothing():
    held = ThinMap(0.5, 150.0)
    held.update(cells_of(strip(0.0, 8.0)), None, 0.0)
    held.update(cells_of([]), None, 1.0)
    assert len(held) == 0
    assert held.take(20.0) == {}


def test_it_is_bounded(monkeypatch):
    monkeypatch.setattr(thin_map, 'MAX_CELLS', 100)
    held = ThinMap(0.5, 20.0)
    for k in range(20):
        held.update(cells_of(strip(8.0 * k, 8.0 * k + 8.0)), np.array([8.0 * k, 0.0]), k)
        assert sum(len(block.codes) for block in held._blocks.values()) <= 100
    assert (19, 0) in held._blocks
    assert (0, 0) not in held._blocks
    empty_out(held, 50.0)


def test_what_it_keeps_holds_no_more_memory_than_its_cells():
    held = ThinMap(0.5, 20.0)
    cells = []
    for k in range(20):
        cells.append(cells_of(strip(8.0 * k, 8.0 * k + 40.0)))
        held.update(cells[-1], np.array([8.0 * k, 0.0]), k)
    assert held._blocks
    for block in held._blocks.values():
        assert not any(np.shares_memory(block.codes, item.codes) for item in cells)


def test_budget_by_hand():
    time = [0.0]
    budget = Budget(1000.0, clock=lambda: time[0])
    assert budget.balance == 0.0
    time[0] = 0.5
    assert budget.balance == pytest.approx(500.0)
    time[0] = 60.0
    assert budget.balance == pytest.approx(1000.0)  # what was not used is not saved up
    budget.spend(3000)
    assert budget.balance == pytest.approx(-2000.0 - OVERHEAD)
    time[0] = 62.0
    assert budget.balance == pytest.approx(-OVERHEAD)
    budget.rate = 0.0
    time[0] = 90.0
    assert budget.balance == pytest.approx(-OVERHEAD)


def test_a_long_time_of_sending_keeps_to_the_rate():
    time, sent = [0.0], 0
    budget = Budget(32_000.0, clock=lambda: time[0])
    for step in range(400):
        time[0] = 0.25 * step
        while budget.balance > 0.0:
            budget.spend(6000)
            sent += 6000 + OVERHEAD
    assert 31_000 < sent / 100.0 < 32_700
