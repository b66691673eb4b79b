# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The line at the top is good only where all is well, and says what is not."""

import math

import pytest
from stream_pieces import make_rows, NO_TABLES, Source, TEXTS

from plc_inspect.core.live.proximity import Level, Thing
from plc_inspect.monitor.picture.condition import judge, LANDED_TIME
from plc_inspect.monitor.picture.model import Monitor
from plc_inspect.stream.nearness import Nearness
from plc_inspect.stream.summary_writer import SummaryWriter

WIRE = Nearness(
    thing=Thing.CONDUCTOR, level=Level.CLEAR, distance=20.0, way=(1.0, 2.0, -3.0), closest=20.0,
    closest_in=0.0, sigma=0.1,
)
GOOD = {'scan_rate': 10.0, 'scan_age': 0.1, 'odometry_age': 0.02, 'sharpness': 0.9}
SILENT = 'no scan; nobody publishes /velodyne_points'


def show(levels=(0, 0, 0), texts=TEXTS, later=0.1, **values):
    """Return the line after one message of the node, some seconds later."""
    monitor, source = Monitor(), Source()
    source.writer = Texts(texts)
    status = {'health': GOOD | values.pop('health', {}), 'levels': levels}
    monitor.take_summary(source.summary(5.0, keyframe=True, **(status | values)), 100.0)
    return judge(monitor.look(100.0 + later), '/vehicle/plc_inspect')


class Texts:
    """A writer that says other texts."""

    def __init__(self, texts):
        self.writer, self.texts = SummaryWriter(7), texts

    def write(self, tables, status, _, uptime, share):
        return self.writer.write(tables, status, self.texts, uptime, share)


def test_it_is_good_where_all_is_well():
    assert show().good
    assert show().text == 'live: scans at 10.0 Hz and poses come in, the map is sharp'


@pytest.mark.parametrize(('tone', 'text', 'given'), [
    ('critical', 'LINK LOST 7.0 s ago: all of this is old', {'later': 7.0}),
    ('warning', 'link late: nothing for 3.0 s', {'later': 3.0}),
    ('critical', 'waiting for the lidar: nobody publishes /velodyne_points',
     {'health': {'scan_age': math.nan}, 'levels': (2, 0, 0),
      'texts': ('odom', SILENT, *TEXTS[2:])}),
    ('critical', 'poses stopped 3.1 s ago',
     {'health': {'odometry_age': 3.0}, 'levels': (2, 0, 0),
      'texts': ('odom', 'no odometry', *TEXTS[2:])}),
    ('critical', 'scans and poses stopped 4.1 s ago',
     {'health': {'odometry_age': 9.0, 'scan_age': 4.0}}),
    ('critical', 'waiting for poses', {'health': {'odometry_age': math.nan}}),
    ('critical', 'map: walls are seen twice',
     {'levels': (0, 2, 0), 'texts': (*TEXTS[:2], 'walls are seen twice', TEXTS[3])}),
    ('warning', 'segmentation: last error: x',
     {'levels': (0, 0, 1), 'texts': (*TEXTS[:3], 'last error: x')}),
    ('critical', 'map: map is not sharp; hazards are held back', {'held': True}),
    ('critical', 'map: walls are seen twice',
     {'held': True, 'levels': (1, 2, 0), 'texts': (*TEXTS[:2], 'walls are seen twice', '')}),
    ('notice', 'scans at 10.0 Hz and poses come in; sharpness of the map not known yet',
     {'health': {'sharpness': math.nan}}),
    ('notice', 'scans and poses come in; no result yet: shown is what was known before the '
     'restart', {'tick_uptime': math.nan}),
    ('critical', 'NOT READY: preparing for 9 s; waiting for poses',
     {'levels': (0, 0, 1), 'texts': (*TEXTS[:3], 'NOT READY: preparing for 9 s'),
      'health': {'odometry_age': math.nan}}),
    ('critical', 'NOT READY: preparing for 9 s',
     {'levels': (0, 0, 2), 'texts': (*TEXTS[:3], 'NOT READY: preparing for 9 s')}),
    ('warning', 'no new result for 5.9 s', {'tick_uptime': 0.0, 'later': 0.9}),
    ('warning', 'keep-out not measured for 5.9 s',
     {'near': (WIRE,), 'near_uptime': 0.0, 'later': 0.9}),
    ('notice', 'waiting for the health of /vehicle/plc_inspect', {'health_uptime': math.nan}),
])
def test_it_says_what_is_not_well(tone, text, given):
    condition = show(**given)
    assert (condition.tone, condition.text) == (tone, text)
    assert not condition.good


def test_before_anything_came_in_it_waits():
    condition = judge(Monitor().look(1.0), '/vehicle/plc_inspect')
    assert condition.text == 'waiting for /vehicle/plc_inspect: nothing heard yet'
    assert condition.tone == 'notice'


def test_part_of_a_picture_is_not_good():
    monitor, source = Monitor(), Source()
    source.summary(1.0, keyframe=True)
    monitor.take_summary(source.summary(2.0, health=GOOD), 100.0)
    assert judge(monitor.look(100.1)).text.startswith('incomplete')


@pytest.mark.parametrize(('height', 'held', 'landed'), [
    (1.0, False, True), (1.0, True, True), (9.0, False, False),
])
def test_it_has_landed_when_it_flew_and_stands_low(height, held, landed):
    monitor, source = Monitor(), Source()
    tables = make_rows(6, 0)
    tables.spans['ground_clearance'] = 7000  # that is how the ground is known
    for k in range(12):
        monitor.take_summary(source.summary(
            1.0 + k, keyframe=not k, health=GOOD, vehicle=(5.0 * k, 2.0, 30.0), tables=tables
        ), 100.0 + k)
    ground = 30.0 - monitor.look(111.0).height
    assert 0.0 < ground < 10.0
    assert not judge(monitor.look(111.0)).text.startswith('landed')
    for k in range(12, 12 + int(LANDED_TIME) + 3):
        monitor.take_summary(source.summary(
            1.0 + k, health=GOOD, vehicle=(60.0, 2.0, ground + height), held=held
        ), 100.0 + k)
    condition = judge(monitor.look(101.0 + k))
    assert condition.text.startswith('landed') == landed
    assert ('held back' in condition.text) == (condition.tone == 'critical') == held


def test_who_never_flew_has_not_landed():
    monitor, source = Monitor(), Source()
    for k in range(30):
        monitor.take_summary(source.summary(
            1.0 + k, keyframe=not k, health=GOOD, tables=NO_TABLES if not k else None,
            vehicle=(0.0, 0.0, 0.5),
        ), 100.0 + k)
    assert judge(monitor.look(129.5)).good
