# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Three vehicles at once on one graph: nothing is mixed, and none is missed."""

import array
import contextlib
import math
import time
from types import SimpleNamespace

import pytest
import rclpy
from rclpy.context import Context
from rig import isolate, take_domain
from std_msgs.msg import UInt8MultiArray
from stream_pieces import make_rows, Source

from plc_inspect.errors import ConfigError, DataError
from plc_inspect.monitor import command
from plc_inspect.monitor import fleet as fleet_module
from plc_inspect.monitor.fleet import Fleet, ROUND
from plc_inspect.monitor.listener import Listener, MOST_AT_ONCE
from plc_inspect.monitor.picture.model import Monitor
from plc_inspect.monitor.record.recorder import Recorder
from plc_inspect.monitor.replay.replay import Replay
from plc_inspect.monitor.replay.tape import read_tape
from plc_inspect.monitor.station import Station
from plc_inspect.monitor.web.page import Page
from plc_inspect.ros.graph.qos import SUMMARY

NAMES = ('/one/plc_inspect', '/two/plc_inspect', '/three/plc_inspect')


@pytest.fixture
def vehicles(monkeypatch):
    """Publish the summaries of three vehicles, with 1, 2 and 3 hazards."""
    isolate()
    domain = take_domain()
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    monkeypatch.setattr(fleet_module, 'SEARCH_PERIOD', 0.2)
    context = Context()
    rclpy.init(context=context, domain_id=domain)
    node = rclpy.create_node('vehicles', context=context)
    for number, name in enumerate(NAMES):
        source = Source(session=100 + number)
        publisher = node.create_publisher(UInt8MultiArray, f'{name}/summary', SUMMARY)
        data = source.summary(1.0, keyframe=True, tables=make_rows(6, 1 + number),
                              vehicle=(1000.0 * number, 0.0, 20.0))
        publisher.publish(UInt8MultiArray(data=array.array('B', data)))
    yield node
    node.destroy_node()
    rclpy.shutdown(context=context)


def spin_until(fleet, condition, deadline=20.0):
    end = time.monotonic() + deadline
    while not condition():
        assert time.monotonic() < end
        assert fleet.spin(0.1)


def test_all_that_come_up_are_followed_and_nothing_is_mixed(vehicles):
    nobody = '/plc_inspect'
    with (Fleet(lambda name: Station(name, [], cloud=False), [nobody], search=True) as fleet,
          Page('127.0.0.1', 0) as page):
        spin_until(fleet, lambda: set(fleet.stations) == {nobody, *NAMES} and all(
            fleet.stations[name].look().complete for name in NAMES
        ))
        page.show(nobody, fleet.stations[nobody].look(), fleet.stations[nobody].monitor.cloud)
        assert page._site.first == nobody
        for number, name in enumerate(NAMES):
            picture = fleet.stations[name].look()
            assert len(picture.hazards) == 1 + number
            assert picture.vehicle == (1000.0 * number, 0.0, 20.0)
            page.show(name, picture, fleet.stations[name].monitor.cloud)
        fleet.stations[NAMES[0]].acknowledge([1], 'crew')
        seen = [station.look().alarms[0].seen for station in map(fleet.stations.get, NAMES)]
        assert seen == [True, False, False]
        rows = [page._fleet[name] for name in sorted(NAMES)]
        assert [row['critical'] for row in rows] == [1, 1, 1]
        assert page._site.first == sorted(NAMES)[0]  # of those that were heard


def test_silent_vehicles_hold_up_no_other():
    waits = []

    def join(name):
        return contextlib.nullcontext(SimpleNamespace(
            spin=lambda seconds: waits.append(seconds) or True
        ))

    fleet = Fleet(join, [f'/uav{k}' for k in range(12)])
    assert fleet.spin(0.2)
    assert sum(waits) == pytest.approx(ROUND)
    assert len(waits) == 12


def test_a_vehicle_that_is_gone_gives_its_place_to_one_that_is_there(monkeypatch):
    monkeypatch.setattr(fleet_module, 'SEARCH_PERIOD', 0.0)
    silence = {f'/uav{k}': 100.0 + k for k in range(12)}
    there, told, left = [], [], []

    @contextlib.contextmanager
    def join(name):
        if name == '/bad':
            raise ConfigError('keys cannot be read')
        yield SimpleNamespace(
            spin=lambda seconds: True, find_nodes=lambda: list(there), report=told.append,
            measure_silence=lambda: silence.get(name),
        )
        left.append(name)

    with Fleet(join, list(silence)[:1], search=True) as fleet:
        there[:] = silence
        assert fleet.spin(0.0)
        assert set(fleet.stations) == set(silence)
        there[:] = ['/uav11', '/new']  # the longest silent, but there
        assert fleet.spin(0.0)
        assert left == ['/uav10']
        assert set(fleet.stations) == {*silence, '/new'} - {'/uav10'}
        there[:] = ['/bad']
        assert fleet.spin(0.0)
        assert fleet.spin(0.0)
        assert told == ['/bad is not followed: keys cannot be read']
        silence.clear()  # all are there, or have alarms that nobody has seen
        before = set(fleet.stations)
        there[:] = [*fleet.stations, '/one more']
        assert fleet.spin(0.0)
        assert set(fleet.stations) == before
        assert told[1:] == ['/one more is not followed: 12 vehicles are followed already']
    assert set(left) >= before


def test_what_is_gone_is_shown_no_more():
    monitor = Monitor()
    with Page('127.0.0.1', 0) as page:
        for name in ('/one', '/two'):
            page.show(name, monitor.look(1.0), monitor.cloud)
        page.keep({'/two': None})
        page.show('/two', monitor.look(1.0), monitor.cloud)
        assert (set(page._shown), set(page._fleet), set(page._site._hubs)) == (
            {'/two'}, {'/two'}, {'/two'}
        )


def test_a_place_is_given_by_who_is_gone_and_left_no_alarm_unseen():
    station = Station.__new__(Station)
    station.monitor, source = Monitor(), Source()
    assert station.measure_silence() == math.inf
    now = time.monotonic()
    station.monitor.take_summary(source.summary(1.0, keyframe=True), now - 10.0)
    assert station.measure_silence() is None  # an alarm
    station.monitor.acknowledge([1], 'crew', now)
    assert station.measure_silence() == pytest.approx(10.0, abs=5.0)
    station.monitor.take_summary(source.summary(2.0), time.monotonic())
    assert station.measure_silence() is None


def test_all_vehicles_are_recorded_and_one_is_replayed(vehicles, tmp_path):
    path = tmp_path / 'flight.mcap'
    with Recorder(path, '/plc_inspect') as recorder, Fleet(
        lambda name: Station(name, [], cloud=False, recorder=recorder.beside(name)),
        ['/plc_inspect'], search=True,
    ) as fleet:
        spin_until(fleet, lambda: set(NAMES) < set(fleet.stations) and all(
            fleet.stations[name].look().complete for name in NAMES
        ))
        fleet.stations[NAMES[1]].acknowledge([1], 'crew')
    for number, name in enumerate(NAMES):
        replay = Replay(read_tape(path, name))
        replay.seek(1e9)
        assert len(replay.look().hazards) == 1 + number
        assert [item.who for item in replay.look().alarms] == ['crew' * (number == 1)]
    for node in ('', '/four'):
        with pytest.raises(DataError, match='--node /one/plc_inspect or --node /three/plc_insp'):
            read_tape(path, node)


def test_messages_that_wait_are_taken_at_once_up_to_a_bound():
    listener, asked = Listener.__new__(Listener), []
    waiting = [5]

    def spin_once(timeout_sec):
        asked.append(timeout_sec)
        listener._received += waiting[0] > 0
        waiting[0] -= 1

    listener._received = 0
    listener._context = SimpleNamespace(ok=lambda: True)
    listener._executor = SimpleNamespace(spin_once=spin_once)
    assert listener.spin(0.1)
    assert asked == [0.1, 0.0, 0.0, 0.0, 0.0, 0.0]
    waiting[0] = 10 * MOST_AT_ONCE
    assert listener.spin(0.1)
    assert waiting[0] == 9 * MOST_AT_ONCE


def test_a_name_is_given_once(vehicles):
    with pytest.raises(ConfigError, match='named twice'):
        Fleet(lambda name: contextlib.nullcontext(), ['/a', '/a'])


def test_who_asks_for_a_node_that_is_not_there_hears_what_is(vehicles, capsys):
    assert command.main(['--once', '--wait', '3']) == 2
    said = capsys.readouterr().err
    assert 'no summary of /plc_inspect within 3 s: there is: ' in said
    for name in NAMES:
        assert f'--node {name}' in said
    assert command.main(['--node', '/a', '--node', '/b', '--once']) == 2
    assert 'more than one --node needs --web' in capsys.readouterr().err
