# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The station's place on the graph over hours in which nothing comes."""

import errno
import os
from types import SimpleNamespace

import pytest
from rosbags.highlevel import AnyReader
from stream_pieces import Source

from plc_inspect.errors import ConfigError
from plc_inspect.monitor import station as station_module
from plc_inspect.monitor.picture.admission import Admission
from plc_inspect.monitor.picture.condition import Condition, judge
from plc_inspect.monitor.record import recorder as recorder_module
from plc_inspect.monitor.record.recorder import Recorder
from plc_inspect.monitor.station import MOST_LEFT, REJOIN_AFTER, SEARCH_PERIOD, Station

HOUR = 3600


@pytest.fixture
def silent(monkeypatch):
    """Return a station with keys, and a function that lets seconds pass; nothing comes in."""
    clock = [1000.0]
    monkeypatch.setattr(station_module, 'time', SimpleNamespace(monotonic=lambda: clock[0]))
    monkeypatch.setattr(station_module, 'Listener', lambda *_, over_tcp: SimpleNamespace(
        spin=lambda seconds: True, subscribe=lambda topic: None, close=lambda: None,
    ))
    monkeypatch.setattr(station_module, 'SeenRuns', lambda: SimpleNamespace(
        keys=True, admission=Admission(), save=lambda: None,
    ))
    station = Station('/plc_inspect', [])

    def wait(seconds):
        for _ in range(seconds):
            clock[0] += 1.0
            station.spin(1.0)

    return station, wait


def test_nodes_that_are_there_are_named_while_this_one_is_not(silent):
    station, wait = silent
    station._listener.find_nodes = lambda: ['/uav1/plc_inspect']
    assert judge(station.look(), '/uav9') == Condition(
        'warning', 'nothing heard of /uav9; on the graph: /uav1/plc_inspect'
    )
    station._listener.find_nodes = list
    assert station.look().others  # they are not looked for each time
    wait(int(SEARCH_PERIOD) + 1)
    assert judge(station.look(), '/uav9').text == 'waiting for /uav9: nothing heard yet'


def test_a_full_disk_ends_the_record_not_the_monitor(silent, tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    station, wait = silent
    path, source = tmp_path / 'flight.mcap', Source()
    monkeypatch.setattr(recorder_module, 'FLUSH_PERIOD', 0.0)
    with Recorder(path, '/plc_inspect') as recorder:
        station._recorder = recorder
        station._take_summary(source.summary(1.0, keyframe=True))
        with monkeypatch.context() as full:
            full.setattr(os, 'pwrite', refuse)
            station._take_summary(source.summary(2.0))
        wait(2)
        station._take_summary(source.summary(3.0))
        station.acknowledge([1], 'crew')
    picture = station.look()
    assert picture.counts.messages == 3
    assert [event.text for event in picture.events if 'record' in event.text] == [
        'the record ended: No space left on device: free disk space, then start plc_monitor '
        'anew with another --record'
    ]
    with AnyReader([path]) as reader:
        assert len(list(reader.messages())) == 1


def test_graph_is_joined_anew_soon_and_not_for_ever(silent):
    station, wait = silent
    wait(10 * 60)
    assert len(station._left) >= 9
    wait(23 * HOUR)
    assert len(station._left) <= MOST_LEFT + 14


def test_graph_that_cannot_be_joined_anew_is_tried_again(silent, monkeypatch):
    def refuse():
        raise ConfigError('keys cannot be read')

    station, wait = silent
    join = station._join
    monkeypatch.setattr(station, '_join', refuse)
    wait(60)
    assert station._left == []
    texts = {event.text for event in station.monitor.look(0.0).events}
    assert texts == {'the graph cannot be joined anew: keys cannot be read'}
    monkeypatch.setattr(station, '_join', join)
    wait(60)
    assert station._left


def test_link_that_comes_and_goes_leaves_few_places(silent):
    station, wait = silent
    for _ in range(200):
        wait(int(REJOIN_AFTER) + 20)
        station._take_summary(b'something')
        wait(int(REJOIN_AFTER) + 20)
    assert len(station._left) <= MOST_LEFT + 10
