# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What browsers are sent, in which order, and how much of it ahead."""

import heapq
import itertools
import json
import math
import struct

import numpy as np
import pytest

from plc_inspect.monitor.picture.cloud_store import CloudStore
from plc_inspect.monitor.web.cells import find_unit, lay_out_block, UNIT
from plc_inspect.monitor.web.live import Hub, ROWS_BYTES, STAGES, Visitor
from plc_inspect.monitor.web.pace import AHEAD, ANSWER, LEAST_WINDOW, MOST_WINDOW, Pace
from plc_inspect.results import PointClass

HEAD = struct.Struct('=iidddfIIII')


def make_block(x, count, seed=0):
    """Return a block of so many points about (x, 0, 0)."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-10.0, 10.0, (count, 3)).astype(np.float32)
    points[:, 0] += x
    return lay_out_block((round(x), 0), (
        points, np.full(count, PointClass.VEGETATION, np.uint8),
        np.full(count, 5.0, np.float32), np.full(count, 0.5, np.float32),
    ))


def read(message):
    """Return number, version, points in all, the first and the places of a message."""
    x, y, *middle, _, version, total, first, count = HEAD.unpack_from(message)
    places = np.frombuffer(message, np.int16, 3 * count, HEAD.size).reshape(-1, 3)
    assert len(message) == HEAD.size + 9 * count
    return (x, y), version, total, first, places * UNIT + middle


class Browser:
    """Takes messages as a browser does."""

    def __init__(self, hub):
        self.hub, self.visitor = hub, Visitor()
        self.visitor.pace.window = MOST_WINDOW
        self.blocks = {}
        self.order = []

    def take(self, most=10_000):
        """Take points until there are none."""
        for _ in range(most):
            message = self.hub._choose_points(self.visitor)
            if message is None:
                return
            key, version, total, first, places = read(message)
            known = self.blocks.get(key, (0, 0, np.empty((0, 3))))
            own = np.empty((0, 3)) if first == 0 else known[2]
            assert first == len(own)
            assert not first or known[0] == version
            self.blocks[key] = version, total, np.vstack((own, places))
            self.order.append((key, first, len(places)))


def test_all_points_come_thinned_first_and_the_nearest_before_others():
    hub, blocks = Hub(), [make_block(x, 9_000, seed=x) for x in (0, 100, 200)]
    hub.put({}, None, blocks, vehicle=(190.0, 0.0, 0.0))
    browser = Browser(hub)
    browser.take()
    firsts = [(key[0], first) for key, first, _ in browser.order]
    assert firsts[:3] == [(200, 0), (100, 0), (0, 0)]
    assert firsts[3:6] == [(200, STAGES[0]), (100, STAGES[0]), (0, STAGES[0])]
    assert firsts[6][1] == STAGES[1]
    for block in blocks:
        _, total, places = browser.blocks[block.home]
        assert total == len(places) == 9_000
        np.testing.assert_allclose(places, block.places * UNIT + np.array(block.middle))
    assert hub._choose_points(browser.visitor) is None


def test_a_block_that_changes_on_its_way_is_sent_anew():
    hub = Hub()
    hub.put({}, None, [make_block(0, 9_000)])
    browser = Browser(hub)
    browser.take(most=2)
    hub.put({}, None, [make_block(0, 3_000, seed=1)])
    browser.take()
    assert len(browser.blocks[0, 0][2]) == 3_000
    assert [first for _, first, _ in browser.order] == [0, STAGES[0], 0, STAGES[0]]


@pytest.mark.parametrize('edge', [0.01, 0.5, 10.0])
def test_points_are_where_they_were_in_blocks_of_any_cells(edge):
    rng = np.random.default_rng(0)
    points = (rng.uniform(0.0, 128.0 * edge, (500, 3)) * [1, 1, 0.5]).astype(np.float32)
    points[:450] *= np.float32(0.1)  # the middle lies near a corner
    block = lay_out_block((0, 0), (
        points, np.full(500, PointClass.VEGETATION, np.uint8),
        np.full(500, 5.0, np.float32), np.full(500, edge, np.float32),
    ))
    _, _, _, _, middle_z, sent, *_ = HEAD.unpack_from(block.pack(1, 0, 500))
    assert (middle_z, sent) == pytest.approx((block.middle[2], edge))
    places = np.sort(block.places * find_unit(sent) + np.array(block.middle), axis=0)
    np.testing.assert_allclose(places, np.sort(points, axis=0), atol=0.51 * max(0.01, edge / 50))


def test_a_block_without_points_is_told_once():
    hub, store = Hub(), CloudStore()
    hub.put({}, None, [lay_out_block((3, 4), store.assemble((3, 4)))])
    visitor = Visitor()
    assert read(hub._choose_points(visitor))[:4] == ((3, 4), 1, 0, 0)
    assert hub._choose_points(visitor) is None


def test_a_slow_browser_gets_small_messages():
    hub, visitor = Hub(), Visitor()
    hub.put({}, None, [make_block(0, 9_000)])
    for _ in range(20):
        message = hub._choose_points(visitor)
        assert len(message) <= LEAST_WINDOW


def test_rows_come_in_small_parts_and_only_what_changed_again():
    hub, visitor = Hub(), Visitor()
    table = [(str(k), {'text': 'x' * 100, 'k': k}) for k in range(200)]
    hub.put({}, {'spans': table})
    found = {}
    for text in iter(lambda: hub._choose_rows(visitor), None):
        assert len(text) < ROWS_BYTES + 1_000
        message = json.loads(text)
        assert message['part'] == 'spans'
        found |= dict(message['value']['rows'])
    assert found == dict(table)
    table[7] = '7', {'text': 'new'}
    hub.put({}, {'spans': table[:-1]})
    assert json.loads(hub._choose_rows(visitor))['value']['rows'] == [['7', {'text': 'new'}]]
    assert hub._choose_rows(visitor) is None
    keys = json.loads(hub._parts['spans-keys'][1])
    assert keys == {'keys': [key for key, _ in table[:-1]]}
    hub.put({}, {'spans': table})  # one that had gone is sent again
    assert json.loads(hub._choose_rows(visitor))['value']['rows'][0][0] == '199'


def drive(pace, rate, delay, busy, seconds, loss=0.0):
    """
    Send through a link of a rate [B/s] to a browser that looks every so often [s].

    What is lost comes a round trip later, and all that follows no sooner.
    """
    now, free, answers, sent = 0.0, 0.0, [], []
    number, rng, held = itertools.count(), np.random.default_rng(1), 0.0
    while now < seconds:
        while not (wait := pace.wait(now)):
            size = max(1_000, pace.piece)
            pace.send(size, now)
            free = max(free, now) + size / rate
            sent.append((now, free - now, size))
            lost = rng.random() > (1.0 - loss) ** math.ceil(size / 1_400)
            there = held = max(free + delay + 2.0 * delay * lost, held)
            seen = there if not busy else (int(there / busy) + 1) * busy
            heapq.heappush(answers, (seen + delay, next(number)))
        if answers and answers[0][0] <= now + wait:
            now, _ = heapq.heappop(answers)
            pace.answer(now)
        else:
            now += wait
    return sent


@pytest.mark.parametrize(('rate', 'delay', 'loss', 'share'), [
    (32e3, 0.2, 0.0, 0.8), (32e3, 0.02, 0.0, 0.8), (2e6, 0.05, 0.0, 0.8), (32e3, 0.2, 0.02, 0.6),
    (32e3, 0.1, 0.02, 0.6),
])
def test_a_link_is_filled_and_nothing_waits_long(rate, delay, loss, share):
    sent = [item for item in drive(Pace(), rate, delay, 0.0, 60.0, loss) if item[0] > 5.0]
    waits = [wait for _, wait, _ in sent]
    usual = max(AHEAD, ANSWER - 2.0 * delay)
    assert np.quantile(waits, 0.5) < usual + 0.1  # a message itself takes up to 0.1 s
    assert np.quantile(waits, 0.9) < usual + 0.25
    assert sum(size for _, _, size in sent) / 55.0 > share * rate


def test_a_browser_that_looks_seldom_is_not_taken_for_a_slow_link():
    pace = Pace()
    drive(pace, 1e8, 0.0005, 0.3, 10.0)
    assert pace.window > 100_000


def test_answers_that_nobody_asked_for_change_nothing():
    pace = Pace()
    pace.answer(1.0)
    assert (pace.window, pace.wait(1.0)) == (LEAST_WINDOW, 0.0)
