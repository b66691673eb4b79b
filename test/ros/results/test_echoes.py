# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What raises an alarm is told more than once, so that a lost message is missed soon."""

from unittest.mock import MagicMock

import pytest
from stream_pieces import make_rows

from plc_inspect.core.live.proximity import Level, Thing
from plc_inspect.monitor.picture.model import Monitor
from plc_inspect.node_config import StreamSettings
from plc_inspect.ros.results import thin_link
from plc_inspect.ros.results.thin_link import ECHOES, News, PERIOD, Stream
from plc_inspect.stream.nearness import Nearness
from plc_inspect.stream.summary import read_summary


class Told:
    """A stream without a graph, and when it told what."""

    def __init__(self, monkeypatch):
        self.now, self.times, self.data = 100.0, [], []
        node, intake = MagicMock(), MagicMock(told_vehicle=None)
        node.create_publisher.return_value.get_subscription_count.return_value = 0
        node.create_publisher.return_value.publish = self._take
        self.stream = Stream(node, StreamSettings, intake, lambda name, call: call)
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


def near(level, distance):
    return (Nearness(thing=Thing.CONDUCTOR, level=level, distance=distance, way=(1.0, 0.0, 0.0),
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


def test_an_alarm_waits_for_no_keyframe_and_for_no_spans(told, monkeypatch):
    monkeypatch.setattr(thin_link, 'KEYFRAME_EVERY', 2)
    told.publish(0)
    told.publish(0)
    told.stream.publish(News(tables=make_rows(40, 1), cells=None, frame_id='odom', stamp_ns=1,
                             held=False))
    told.pass_time(1.0)
    messages = list(map(read_summary, told.data))
    alarm, *echoes = messages[2:]
    assert not alarm.keyframe
    assert (len(alarm.tables.spans), len(alarm.tables.hazards)) == (0, 1)
    assert len(echoes[0].tables.spans) == 38
    assert [item.keyframe for item in echoes] == [False, False, True]
    monitor = Monitor()
    for data in told.data:
        assert monitor.take_summary(data, 1.0)
    assert len(monitor.look(1.0).spans) == 40


def test_what_comes_too_near_is_told_again_and_what_leaves_is_not(told):
    told.stream.tell_nearness(near(Level.WARNING, 12.0), 0.0)
    assert told.pass_time(1.0) == ()
    told.stream.tell_nearness(near(Level.CRITICAL, 7.0), 0.0)
    assert told.pass_time(1.0) == pytest.approx(ECHOES, abs=1.1 * PERIOD)
    told.stream.tell_nearness(near(Level.WARNING, 12.0), 0.0)
    assert told.pass_time(1.0) == ()
