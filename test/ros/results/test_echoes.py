# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What raises an alarm is told more than once, so that a lost message is missed soon."""

from unittest.mock import MagicMock

import numpy as np
import pytest
from stream_pieces import make_rows

from plc_inspect.core.live.proximity import Level, Thing
from plc_inspect.monitor.picture.model import Monitor
from plc_inspect.node_config import StreamSettings
from plc_inspect.ros.graph.qos import SUMMARY
from plc_inspect.ros.results.thin_link import DEPTH, ECHOES, News, PERIOD, Stream
from plc_inspect.stream.budget import OVERHEAD
from plc_inspect.stream.nearness import Nearness
from plc_inspect.stream.summary import read_summary
from plc_inspect.stream.thin_map import MESSAGE_SIZE


class Told:
    """A stream without a graph, and when it told what."""

    def __init__(self, monkeypatch, settings=None):
        self.now, self.times, self.data = 100.0, [], []
        node, intake = MagicMock(), MagicMock(told_vehicle=None)
        node.create_publisher.return_value.get_subscription_count.return_value = 0
        node.create_publisher.return_value.publish = self._take
        settings = settings or StreamSettings()
        self.stream = Stream(node, lambda: settings, intake, lambda name, call: call)
        monkeypatch.setattr(self.stream, '_now', lambda: self.now)

    def _take(self, message):
        self.times.append(round(self.now, 3))
        self.data.append(message.data.tobytes())

    def pass_time(self, seconds):
        """Let the timer run; return when messages were told from now on, from now."""
        began, before = self.now, len(self.times)
        for _ in range(round(seconds / PERIOD)):
            self.now += PERIOD
            self.stream._step()
        return tuple(round(when - began, 3) for when in self.times[before:])

    def publish(self, num_hazards):
        self.stream.publish(News(tables=make_rows(2, num_hazards), cells=None, frame_id='odom',
                                 stamp_ns=1, held=False))


def near(level, distance, thing=Thing.CONDUCTOR):
    return (Nearness(thing=thing, level=level, distance=distance, way=(1.0, 0.0, 0.0),
                     closest=distance, closest_in=0.0, sigma=0.1),)


@pytest.fixture
def told(monkeypatch):
    return Told(monkeypatch)


def test_a_critical_hazard_is_told_and_told_again(told):
    told.publish(0)
    assert told.pass_time(2.0) == ()
    told.publish(1)
    assert told.pass_time(2.0) == pytest.approx(ECHOES, abs=1.1 * PERIOD)
    told.publish(3)  # more of them, none critical
    assert told.pass_time(2.0) == ()


def test_one_that_gets_too_near_as_another_no_longer_is_is_told_again(told):
    def tell(conductor, obstacle):
        told.stream.tell_nearness(
            (*near(conductor, 5.0), *near(obstacle, 5.0, Thing.OBSTACLE)), 0.0
        )

    tell(Level.CRITICAL, Level.WARNING)
    told.pass_time(2.0)
    tell(Level.WARNING, Level.CRITICAL)
    assert told.pass_time(2.0) == pytest.approx(ECHOES, abs=1.1 * PERIOD)
    tell(Level.WARNING, Level.CRITICAL)
    assert told.pass_time(2.0) == ()


def test_alarms_of_before_a_reset_do_not_hide_those_after_it(told):
    told.publish(1)
    told.pass_time(2.0)
    told.stream.forget()
    told.publish(1)  # the numbers begin anew
    assert told.pass_time(2.0) == pytest.approx(ECHOES, abs=1.1 * PERIOD)


def test_an_echo_holds_what_a_lost_message_did(told):
    told.publish(0)
    told.publish(1)
    told.pass_time(1.0)
    monitor = Monitor()
    first, lost, *echoes = told.data
    assert len(echoes) == len(ECHOES)
    for data in (first, lost, *echoes):
        assert monitor.take_summary(data, 1.0)
    assert len(monitor.alarms.open) == 1


def test_an_alarm_is_told_by_each_of_its_messages_alone(told):
    told.publish(0)
    told.publish(1)
    told.pass_time(1.0)
    first, *alarms = told.data
    assert len(alarms) == 1 + len(ECHOES)
    for data in alarms:  # as if all before it were lost
        monitor = Monitor()
        monitor.take_summary(first, 1.0)
        monitor.take_ahead(data, 1.1)
        (alarm,) = monitor.alarms.open
        assert alarm.state == 'new'
        assert alarm.key == 'hazard 0'


def test_an_alarm_waits_for_no_other_rows(told):
    told.publish(0)
    told.publish(0)
    told.stream.publish(News(tables=make_rows(40, 3), cells=None, frame_id='odom', stamp_ns=1,
                             held=False))
    told.pass_time(1.0)
    messages = list(map(read_summary, told.data))
    alarm, *echoes = messages[2:]
    assert alarm.turns == 0
    assert len(alarm.tables.spans) == 0
    assert alarm.tables.hazards['hazard_id'].tolist() == [0]
    assert {(*row,) for row in echoes[0].tables.spans[['line_id', 'span_id']].tolist()} >= {
        (*row,) for row in make_rows(40).spans[['line_id', 'span_id']].tolist()[2:]}
    monitor = Monitor()
    for data in told.data:
        assert monitor.take_summary(data, 1.0)
    assert len(monitor.look(1.0).spans) == 40


@pytest.mark.parametrize('max_kbps', [192.0, 0.0])
def test_nothing_is_told_at_once_that_an_alarm_would_wait_for(monkeypatch, max_kbps):
    told = Told(monkeypatch, StreamSettings(max_kbps=max_kbps))
    budget = told.stream._budget
    monkeypatch.setattr(budget, '_clock', lambda: told.now)
    budget._last = told.now
    told.publish(0)
    told.pass_time(2.0)
    before = len(told.data)
    many = make_rows(600, 3)
    for name in ('start_x', 'end_x', 'num_points'):  # as measured ones, not easily compressed
        many.spans[name] = np.random.default_rng(1).integers(0, 1 << 20, 600)
    told.stream.publish(News(tables=many, cells=None, frame_id='odom', stamp_ns=1, held=False))
    assert len(read_summary(told.data[-1]).tables.spans) == 0
    while told.stream._writer.behind:
        told.pass_time(PERIOD)
    sizes, times = [len(data) for data in told.data[before:]], told.times[before:]
    assert max(sizes) <= 2 * MESSAGE_SIZE
    assert np.diff(times).min() >= 0.99 * PERIOD
    if max_kbps:  # no more than the budget, what it had saved, and one message
        spent = np.cumsum(np.array(sizes) + OVERHEAD)
        room = 125.0 * max_kbps * (np.array(times) - times[0] + DEPTH)
        assert (spent <= room + max(sizes) + OVERHEAD).all()
    assert times[-1] - times[0] < 3.0
    monitor = Monitor()
    for data in told.data:
        assert monitor.take_summary(data, 1.0)
    assert len(monitor.look(1.0).spans) == 600


def test_what_is_kept_has_everything_however_many_alarms_were_told(told):
    for number in range(60):
        rows = make_rows(30, 1)
        rows.hazards['hazard_id'] = number // 2
        told.stream.publish(News(tables=rows, cells=None, frame_id='odom', stamp_ns=1,
                                 held=False))
        told.pass_time(PERIOD * (number % 3))
        late = Monitor()
        for data in told.data[-SUMMARY.depth:]:
            assert late.take_summary(data, 1.0)
        picture = late.look(1.0)
        assert picture.complete
        assert len(picture.spans) == 30 or told.stream._writer.behind


def test_what_comes_too_near_is_told_again_and_what_leaves_is_not(told):
    told.stream.tell_nearness(near(Level.WARNING, 12.0), 0.0)
    assert told.pass_time(1.0) == ()
    told.stream.tell_nearness(near(Level.CRITICAL, 7.0), 0.0)
    assert told.pass_time(1.0) == pytest.approx(ECHOES, abs=1.1 * PERIOD)
    told.stream.tell_nearness(near(Level.WARNING, 12.0), 0.0)
    assert told.pass_time(1.0) == ()
