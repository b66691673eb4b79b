# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The summary: changes, all rows in turns, or everything at once; whole millimetres."""

import dataclasses
import math

from factories import make_span
from hypothesis import given, settings, strategies
import numpy as np
import pytest
from stream_pieces import make_hazards, make_rows, NO_TABLES, Source, TEXTS

from plc_inspect.errors import DataError
from plc_inspect.monitor.picture.rows import RowBook
from plc_inspect.results import Support
from plc_inspect.stream.curve_check import NO_LENGTH
from plc_inspect.stream.frame import Frame, pack_frame, SUMMARY
from plc_inspect.stream.summary import (
    find_turn,
    keys_of,
    make_tables,
    metres,
    read_summary,
    Status,
    TABLES,
    TURNS,
)
from plc_inspect.stream.summary_writer import (
    EVERYTHING,
    MOST_CHANGED,
    Share,
    SummaryWriter,
)
from plc_inspect.stream.thin_map import MESSAGE_SIZE


def test_a_message_may_hold_everything():
    source = Source()
    message = read_summary(source.summary(5.0, keyframe=True))
    assert (message.turn, message.turns) == (0, 1)
    for name in ('spans', 'supports', 'hazards'):
        np.testing.assert_array_equal(
            getattr(message.tables, name), getattr(source.tables, name)
        )
    assert message.texts == TEXTS
    assert message.status.vehicle == (15.0, 2.0, 30.0)
    assert message.status.stamp_ns == 1_005_000_000_000
    assert message.status.health['scans_lost'] == 4.0
    assert math.isnan(message.status.health['tick_ms'])


def test_lengths_are_kept_to_the_millimetre():
    span = make_span(2, 5, (1000.1234, -5.0, 15.0), (1119.9876, 0.0, 16.0))
    (row,) = make_tables([(span, True)], [], []).spans
    assert (row['line_id'], row['span_id'], row['flags']) == (2, 5, 4)
    assert row['start_x'] == 1_000_123
    assert row['sag'] == round(span.sag * 1000)
    assert row['a'] == np.float32(span.a)
    assert math.isnan(metres(row['ground_clearance']))
    for hazard, row in zip(make_hazards(), make_rows().hazards, strict=True):
        assert metres(row['clearance']) == pytest.approx(hazard.clearance, abs=5e-4)
        assert math.isnan(metres(row['height'])) == math.isnan(hazard.height)


def test_what_cannot_be_told_is_bounded():
    support = Support(support_id=3, position=np.array([1e9, 0.0, -1.0]), height=20.0,
                      kind='tower', line_ids=tuple(range(40)))
    (row,) = make_tables([], [support], []).supports
    assert row['num_lines'] == 40
    assert row['lines'].tolist() == list(range(16))
    assert row['x'] == 2**31 - 1
    (row,) = make_tables([], [dataclasses.replace(support, line_ids=(2,))], []).supports
    assert row['lines'].tolist() == [2] + [-1] * 15


@pytest.mark.parametrize('keyframe', [True, False])
@pytest.mark.parametrize('held', [True, False])
def test_it_tells_that_hazards_are_held_back(keyframe, held):
    message = read_summary(Source().summary(1.0, keyframe=keyframe, held=held))
    assert (message.turns == 1, message.status.held) == (keyframe, held)


def test_only_what_changed_is_told():
    source = Source()
    source.summary(1.0, keyframe=True)
    same = source.summary(2.0)
    assert len(same) < 130
    message = read_summary(same)
    assert (message.turns, message.texts) == (0, None)
    assert sum(len(getattr(message.tables, name)) for name in message.gone) == 0
    rows = make_rows(5, 4)
    rows.spans['sag'][1] += 10
    message = read_summary(source.summary(3.0, tables=rows))
    assert message.tables.spans['sag'].tolist() == [rows.spans['sag'][1]]
    assert message.tables.hazards['hazard_id'].tolist() == [3]
    assert message.gone == {'spans': ((2, 1),), 'supports': (), 'hazards': ()}


def test_nothing_known_is_told_too():
    writer = SummaryWriter(1)
    message = read_summary(writer.write(NO_TABLES, Status(), TEXTS, 0.0, EVERYTHING))
    assert message.status == dataclasses.replace(
        Status(), health=message.status.health, tick_uptime=message.status.tick_uptime,
        vehicle_uptime=message.status.vehicle_uptime,
        health_uptime=message.status.health_uptime, heading=message.status.heading,
        near_uptime=message.status.near_uptime,
    )
    assert message.status.vehicle is None
    assert len(message.tables.spans) == 0


def test_a_body_of_another_layout_is_refused():
    good = Source().summary(1.0, keyframe=True)
    body = read_summary(good).frame.body
    for bad in (body[:-1], body + b'x', body[:50], b''):
        frame = Frame(kind=SUMMARY, flags=1, session=1, sequence=0, uptime=0.0, body=bad)
        with pytest.raises(DataError):
            read_summary(pack_frame(frame))


def known(book):
    """Return what a receiver knows, as bytes."""
    return {name: {key: row.tobytes() for key, row in book[name].items()} for name in TABLES}


def all_of(tables):
    """Return the same of all rows."""
    return {name: dict(zip(keys_of(name, rows), map(bytes, rows), strict=True))
            for name, rows in zip(TABLES, (tables.spans, tables.supports, tables.hazards),
                                  strict=True)}


@settings(max_examples=8, deadline=None)
@given(strategies.lists(strategies.tuples(
    strategies.integers(0, 8), strategies.integers(0, 6), strategies.booleans()
), min_size=1, max_size=12))
def test_changes_add_up_to_what_is_known(steps):
    writer, book = SummaryWriter(1), RowBook()
    for number, (num_spans, num_hazards, everything) in enumerate(steps):
        tables = make_rows(num_spans, num_hazards)
        tables.spans['sag'] += number % 3
        book.take(read_summary(writer.write(
            tables, Status(), TEXTS, 0.0, EVERYTHING if everything else Share()
        )))
        assert known(book) == all_of(tables)
        assert not writer.behind


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(strategies.integers(0, 40), strategies.lists(strategies.tuples(
    strategies.integers(0, 30), strategies.integers(0, 6), strategies.booleans()
), min_size=30, max_size=40))
def test_whoever_lost_messages_has_everything_after_all_turns(first, steps):
    writer, book, since = SummaryWriter(1), RowBook(), 0
    for number, (num_spans, num_hazards, lost) in enumerate(steps):
        tables = make_rows(num_spans, num_hazards)
        tables.spans['sag'] += number % 3
        message = read_summary(writer.write(
            tables, Status(), TEXTS, 0.0, Share(turn=number % TURNS, turns=TURNS, most=10**6)
        ))
        if (lost and number < len(steps) - TURNS) or number < first:
            book.miss()
            since = number + 1
            continue
        book.take(message)
        assert book.complete == (since == 0 or number - since >= TURNS - 1)
        if book.complete:
            assert known(book) == all_of(tables)


def test_no_message_is_longer_than_an_alarm_may_wait():
    rng = np.random.default_rng(1)
    writer, book, sizes = SummaryWriter(1), RowBook(), []
    for _ in range(5):
        tables = make_rows(400, 40)
        for name in ('start_x', 'start_y', 'start_z', 'end_x', 'end_y', 'end_z', 'sag', 'rmse',
                     'num_points', 'ground_clearance', 'sigma_sag'):
            noise = rng.integers(0, 1000, 400)
            tables.spans[name] = tables.spans[name] + noise
        for name in 'abc':
            tables.spans[name] += rng.uniform(size=400).astype(np.float32)
        sizes.append(0)
        while not sizes[-1] or writer.behind:
            data = writer.write(tables, Status(), TEXTS, 0.0, Share(
                turn=len(sizes) % TURNS, turns=TURNS))
            sizes[-1] += 1
            assert len(data) <= 2 * MESSAGE_SIZE
            book.take(read_summary(data))
        assert known(book) == all_of(tables)
    assert max(sizes) <= 1 + 1.2 * (400 * tables.spans.itemsize) / MOST_CHANGED


def test_hazards_are_told_before_spans_and_the_worst_first():
    writer = SummaryWriter(1)
    tables = make_rows(100, 9)
    most = 3 * tables.hazards.itemsize
    first = read_summary(writer.write(tables, Status(), TEXTS, 0.0, Share(most=most))).tables
    assert first.hazards['severity'].tolist() == [3, 3, 3]
    assert not len(first.spans)
    assert writer.behind
    alarm = read_summary(writer.write(tables, Status(), TEXTS, 0.0, Share(most=0, again={0})))
    assert alarm.tables.hazards['hazard_id'].tolist() == [0]


def test_turns_are_about_equally_long():
    for rows in ([(0, k) for k in range(600)], [(k % 10, k // 10) for k in range(600)]):
        counts = np.bincount([find_turn(key, TURNS) for key in rows], minlength=TURNS)
        assert counts.max() <= 1.3 * counts.mean()


def test_a_turn_that_cannot_be_is_refused():
    message = read_summary(Source().summary(1.0, keyframe=True))
    for turn, turns in ((1, 1), (3, 0), (12, 12)):
        body = bytes([turn, turns]) + message.frame.body[2:]
        with pytest.raises(DataError, match=f'turn {turn} of {turns}'):
            read_summary(pack_frame(dataclasses.replace(message.frame, body=body)))


@pytest.mark.parametrize('table', ['supports', 'hazards'])
@pytest.mark.parametrize('axis', ['x', 'y', 'z'])
def test_a_row_without_position_is_refused(table, axis):
    tables = make_rows(6, 3)
    getattr(tables, table)[axis][-1] = NO_LENGTH
    number = getattr(tables, table)[f'{table[:-1]}_id'][-1]
    with pytest.raises(DataError, match=f'{table[:-1]} {number} has no position'):
        read_summary(Source().summary(1.0, keyframe=True, tables=tables))


@pytest.mark.parametrize('status', [
    {'stamp_ns': 1 << 62}, {'stamp_ns': -(1 << 62)}, {'stamp_ns': (1 << 31) * 10**9},
    {'levels': (0, 3, 0)}, {'levels': (255, 0, 0)},
])
def test_a_status_that_no_message_of_ros_can_hold_is_refused(status):
    with pytest.raises(DataError, match='summary with stamp'):
        read_summary(Source().summary(1.0, keyframe=True, **status))


def test_lines_of_large_numbers_are_not_named_at_supports():
    support = Support(
        support_id=1, kind='tower', line_ids=(7, 32_767, 32_768, 100_000),
        position=np.zeros(3), height=20.0,
    )
    (row,) = make_tables([], [support], []).supports
    assert row['lines'].tolist()[:3] == [7, 32_767, -1]
    assert row['num_lines'] == 4
