# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Three vehicles at once on one graph: nothing is mixed, and none is missed."""

import array
import contextlib
import time
from types import SimpleNamespace

import pytest
import rclpy
from rclpy.context import Context
from rig import isolate, take_domain
from std_msgs.msg import UInt8MultiArray
from stream_pieces import make_rows, Source

from plc_inspect.errors import ConfigError
from plc_inspect.monitor import command
from plc_inspect.monitor import fleet as fleet_module
from plc_inspect.monitor.fleet import Fleet, ROUND
from plc_inspect.monitor.listener import Listener, MOST_AT_ONCE
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
