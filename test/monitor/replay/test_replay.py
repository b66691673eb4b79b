# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A flight that is over is shown as it was, at every time of it."""

import contextlib
import dataclasses
import itertools
import json
import math
from time import time_ns

from factories import make_inspection
import numpy as np
import pytest
from stream_pieces import make_rows, Source

from plc_inspect.errors import DataError
from plc_inspect.monitor import command
from plc_inspect.monitor.picture.model import Monitor
from plc_inspect.monitor.record import recorder as recorder_module
from plc_inspect.monitor.record.recorder import Recorder
from plc_inspect.monitor.replay.replay import Replay
from plc_inspect.monitor.replay.tape import Entry, read_tape, Tape
from plc_inspect.monitor.web.values import make_parts, make_replay
from plc_inspect.offline.export.results_folder import write_results

SECONDS = 40


def make_tape(tables):
    """Return a tape with a summary each second; tables by the second from which they hold."""
    source, entries = Source(), []
    now = make_rows(6, 0)
    for k in range(SECONDS + 1):
        now = tables.get(k, now)
        entries.append(Entry(time=float(k), kind='summary', data=source.summary(
            float(k), keyframe=k % 20 == 0, tables=now)))
        if k in (3, 30):
            entries.append(Entry(time=float(k), kind='cloud', data=source.cloud(
                float(k), [[100.0 * k, 2.0, 3.0]])))
    return Tape(name='/plc_inspect', start=1.7e9, entries=tuple(entries))


@pytest.fixture
def replay():
    """Return a flight with a hazard from 10 s to 20 s that somebody saw at 12 s."""
    tape = make_tape({10: make_rows(6, 1), 20: make_rows(6, 0)})
    seen = Entry(time=12.0, kind='seen', data=json.dumps({'alarm': 1, 'who': 'crew'}).encode())
    entries = sorted([*tape.entries, seen], key=lambda entry: entry.time)
    return Replay(dataclasses.replace(tape, entries=tuple(entries)))


def test_each_time_is_shown_as_it_was(replay):
    assert [(mark.time, mark.text[:8]) for mark in replay.marks] == [(10.0, 'hazard 0')]
    for time, states, past in ((5.0, [], 0), (11.0, ['new'], 0), (15.0, ['acknowledged'], 0),
                               (25.0, [], 1), (11.0, ['new'], 0), (0.0, [], 0)):
        replay.seek(time)
        picture = replay.look()
        assert [alarm.state for alarm in picture.alarms] == states
        assert len(picture.past_alarms) == past
        assert len(picture.hazards) == (1 if 10.0 <= time < 20.0 else 0)
        assert picture.vehicle[0] == 10.0 + time


def test_what_is_not_known_yet_is_taken_from_the_picture_again(replay):
    replay.seek(35.0)
    assert len(replay.cloud.list_homes()) == 2
    late = set(replay.cloud.take_changed())
    replay.seek(5.0)
    assert len(replay.cloud.list_homes()) == 1
    assert late <= set(replay.cloud.take_changed())  # what is gone is told too


def test_it_plays_to_the_end_and_again(replay):
    assert replay.playing
    replay.steer(None, None, 4.0)
    replay.step(2.0)
    assert replay.time == 8.0
    replay.steer(None, False, None)
    replay.step(2.0)
    assert replay.time == 8.0
    replay.steer(38.0, True, 1e9)
    replay.step(5.0)
    assert (replay.time, replay.playing, replay.speed) == (SECONDS, False, 16.0)
    replay.steer(None, True, None)
    assert (replay.time, replay.playing) == (0.0, True)
    replay.seek(-5.0)
    assert replay.time == 0.0


def test_a_replay_never_looks_live(replay):
    for time in range(SECONDS):
        replay.seek(float(time))
        parts = make_parts(replay.look(), '/plc_inspect', replay.tape.start)
        state = make_replay(parts['state'], replay)['state']
        assert state['tone'] != 'ok'
        assert state['text'].startswith('replay: ')


@pytest.mark.parametrize('when', [2.2, 2.8])
def test_acknowledgements_are_of_the_same_cause(when):
    source, monitor, entries = Source(), Monitor(), []
    first, both = make_rows(6, 1), make_rows(6, 4)  # number 3 is critical, as number 0 is
    messages = [
        source.summary(float(k), keyframe=not k, tables=tables)
        for k, tables in enumerate((make_rows(6, 0), first, both, both))
    ]

    def take(k, now):
        monitor.take_summary(messages[k], now)
        entries.append(Entry(time=now, kind='summary', data=messages[k]))

    def see(now):
        (seen,) = monitor.acknowledge([1], 'crew', now)
        entries.append(Entry(time=now, kind='seen', data=json.dumps({
            'alarm': seen.number, 'what': seen.key, 'who': seen.who, 'stands': seen.stands,
        }).encode()))

    take(0, 0.0)
    monitor.take_ahead(messages[2], 2.0)  # the one before is sent again
    (alarm, *_) = [item for item in monitor.alarms.open if item.number == 1]
    if when < 2.5:
        see(when)
    take(1, 2.5)
    take(2, 2.5)
    if when > 2.5:
        see(when)
    take(3, 3.0)
    replay = Replay(Tape(name='/plc_inspect', start=1.0, entries=tuple(entries)))
    replay.seek(3.0)
    assert {item.key: item.who for item in replay.look().alarms} == {
        item.key: 'crew' if item.key == alarm.key else '' for item in monitor.alarms.open
    }
    assert len(replay.look().alarms) == 2


def test_a_record_is_read_back(tmp_path, monkeypatch):
    monkeypatch.setattr(recorder_module, 'FLUSH_PERIOD', 0.0)
    path, source, monitor = tmp_path / 'flight.mcap', Source(), Monitor()
    with Recorder(path, '/two/plc_inspect') as recorder:
        for k in range(3):
            data = source.summary(5.0 + k, keyframe=not k, tables=make_rows(4 + k, 1))
            recorder.take('summary', data)
            monitor.take_summary(data, 100.0 + k)
        recorder.take('cloud', source.cloud(5.0, [[10.0, 2.0, 30.0]]))
        for alarm in monitor.acknowledge([1], 'crew', 103.0):
            recorder.note(alarm)
    tape = read_tape(path)
    assert tape.name == '/two/plc_inspect'
    assert tape.start > 1.7e9
    assert [entry.kind for entry in tape.entries] == ['summary'] * 3 + ['cloud', 'seen']
    replay = Replay(tape)
    replay.seek(math.inf)
    picture = replay.look()
    assert len(picture.spans) == 6
    assert picture.alarms[0].who == 'crew'
    assert picture.cloud_cells == 1
    (tmp_path / 'flight.record').mkdir()
    with pytest.raises(DataError, match=r'flight record of a node: "plc_recover .*flight\.record'):
        read_tape(tmp_path / 'flight.record')


@pytest.fixture
def recorded(tmp_path, monkeypatch):
    """Return a record of 20 messages of the summary, the last with an alarm."""
    monkeypatch.setattr(recorder_module, 'FLUSH_PERIOD', 0.0)
    path, source = tmp_path / 'flight.mcap', Source()
    with Recorder(path, '/plc_inspect') as recorder:
        for k in range(20):
            recorder.take('summary', source.summary(
                float(k), keyframe=not k, tables=make_rows(6, int(k == 19))
            ))
    return path


@pytest.mark.slow
def test_what_comes_before_damage_is_replayed(recorded):
    whole = recorded.read_bytes()
    assert read_tape(recorded).note == ''
    rng = np.random.default_rng(0)
    lengths = set()
    for kind, place in itertools.product(('cut', 'changed', 'taken out'), range(40)):
        at = int(rng.integers(100, len(whole) // 2))
        recorded.write_bytes({
            'cut': whole[:at], 'changed': whole[:at] + bytes(rng.bytes(8)) + whole[at + 8:],
            'taken out': whole[:at] + whole[at + 40:],
        }[kind])
        tape = None
        with contextlib.suppress(DataError):  # damaged before its first summary
            tape = read_tape(recorded)
        if tape is None:
            continue
        lengths.add(len(tape.entries))
        assert tape.note.startswith('the file is damaged') or len(tape.entries) >= 19, place
        replay = Replay(tape)
        replay.seek(math.inf)
        parts = make_parts(replay.look(), '/plc_inspect', tape.start)
        text = make_replay(parts['state'], replay)['state']['text']
        assert text.startswith(f'replay: {tape.note}')
    assert len(lengths) > 5


def test_a_clock_that_is_set_back_loses_no_alarm(tmp_path, monkeypatch):
    path, source = tmp_path / 'flight.mcap', Source()
    with Recorder(path, '/plc_inspect') as recorder:
        for k in range(20):
            if k == 10:
                monkeypatch.setattr('time.time_ns', lambda: time_ns() - 3_600_000_000_000)
            recorder.take('summary', source.summary(
                float(k), keyframe=not k, tables=make_rows(6, int(k == 15))
            ))
    tape = read_tape(path)
    assert tape.length < 60.0
    assert len(Replay(tape).marks) == 1


@pytest.mark.parametrize('origin', [(0.0, 0.0, 0.0), (500_000.0, 5_650_000.0, 100.0)])
def test_a_results_folder_is_shown(tmp_path, origin):
    inspection = make_inspection(np.array(origin))
    write_results(tmp_path / 'out', inspection)
    tape = read_tape(tmp_path / 'out')
    replay = Replay(tape)
    assert not replay.playing
    picture = replay.look()
    result = inspection.result
    assert {item.key for item in picture.spans} == {
        (span.line_id, span.span_id) for span in result.spans
    }
    shift = np.array([*map(float, tape.note.split()[2:]), 0.0]) if tape.note else np.zeros(3)
    assert tape.note.startswith('positions from ') == any(origin)
    assert np.abs(shift - origin).max() <= 1000.0
    for hazard, item in zip(result.hazards, picture.hazards, strict=True):
        np.testing.assert_allclose(item.position, hazard.position - shift, atol=2e-3)
        assert item.clearance == pytest.approx(hazard.clearance, abs=1e-3)
    assert len(picture.supports) == len(result.supports)
    assert picture.cloud_cells > 0
    parts = make_parts(picture, tape.name, tape.start)
    assert make_replay(parts['state'], replay)['clock'] is None


def test_a_results_folder_says_why_hazards_are_held_back(tmp_path):
    inspection = make_inspection()
    why = 'map is not sharp: check mount, frames, time; hazards are held back'
    write_results(tmp_path / 'out', dataclasses.replace(
        inspection, counts={**inspection.counts, 'held_back': why},
        result=dataclasses.replace(inspection.result, hazards=()),
    ))
    tape = read_tape(tmp_path / 'out')
    assert tape.note == why
    picture = Replay(tape).look()
    assert (picture.hazards, picture.held_back) == ((), why)


def test_what_is_no_record_is_told(tmp_path, capsys):
    other = tmp_path / 'text.mcap'
    other.write_text('no record')
    with pytest.raises(DataError, match=r'text\.mcap cannot be read'):
        read_tape(other)
    with pytest.raises(DataError, match='not a results folder'):
        read_tape(tmp_path)
    assert command.main(['--open', str(tmp_path / 'nothing')]) == 2
    assert command.main(['--open', str(other), '--once']) == 2
    said = capsys.readouterr().err
    assert 'nothing cannot be read: ' in said
    assert '--open replays on the page' in said


def test_messages_that_were_sent_again_on_request_are_taken_as_in_flight():
    source, live, kept, entries = Source(), Monitor(cloud=False), [], []

    def hear(time, data):
        entries.append(Entry(time=time, kind='summary', data=data))
        live.take_summary(data, time)

    for k in range(10):
        kept.append(source.summary(float(k), cloud_sent=k, tables=make_rows(6, 3 if k > 3 else 0)))
        if k != 4:  # lost, with three hazards that later messages do not name
            hear(float(k), kept[-1])
        if k == 6:
            assert live.take_wishes(6.5) == {'summary'}
            for number, data in enumerate(kept):
                hear(6.6 + 0.01 * number, data)
    seen, replay = live.look(9.0), Replay(Tape(name='/n', start=1.0, entries=tuple(entries)))
    replay.seek(9.0)
    picture = replay.look()
    assert len(picture.hazards) == len(seen.hazards) == 3
    assert picture.counts == dataclasses.replace(seen.counts, kbps=picture.counts.kbps)
    assert [event.text for event in picture.events] == [event.text for event in seen.events]


def test_what_was_sent_again_after_a_reset_is_not_called_foreign():
    first, second = Source(session=7), Source(session=8, resets=1)
    live, entries = Monitor(cloud=False), []
    told = [(first if k < 14 else second).summary(float(k)) for k in range(16)]
    times = [*range(14), 15.0, *(15.1 + 0.01 * k for k in range(6))]
    for time, data in zip(times, [*told[:14], told[15], *told[10:]], strict=True):  # one is lost
        if time == 15.1:
            assert live.take_wishes(15.05) == {'summary'}
        entries.append(Entry(time=float(time), kind='summary', data=data))
        live.take_summary(data, float(time))
    replay = Replay(Tape(name='/n', start=1.0, entries=tuple(entries)))
    replay.seek(16.0)
    assert replay.look().counts.foreign == live.look(16.0).counts.foreign == 0
    assert replay.look().session == 8
