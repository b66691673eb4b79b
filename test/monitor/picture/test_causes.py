# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The keep-out becomes an alarm, and things have the names of a field crew."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from stream_pieces import make_rows, Source

from plc_inspect.core.live.proximity import Level, Thing
from plc_inspect.monitor.picture.causes import describe_nearness, find_height
from plc_inspect.monitor.picture.cloud_store import CloudStore
from plc_inspect.monitor.picture.model import Monitor
from plc_inspect.monitor.picture.names import find_structures, name_stretch, REACH
from plc_inspect.results import PointClass
from plc_inspect.stream.blocks import pack_blocks, read_cloud, thin_points
from plc_inspect.stream.frame import CLOUD, Frame, pack_frame
from plc_inspect.stream.nearness import Nearness

WIRE = Nearness(
    thing=Thing.CONDUCTOR, level=Level.CRITICAL, distance=4.2, way=(1.0, 2.0, -3.0), closest=4.0,
    closest_in=2.0, sigma=0.1, line_id=1, span_id=0, limit=8.0,
)


def feed(monitor, source, uptime, *near, **values):
    monitor.take_summary(source.summary(
        uptime, keyframe=uptime == 1.0, near=near, near_uptime=uptime, **values
    ), 100.0 + uptime)
    return monitor.look(100.0 + uptime)


def test_a_keep_out_is_an_alarm_until_somebody_has_seen_it():
    monitor, source = Monitor(), Source()
    picture = feed(monitor, source, 1.0, WIRE, tables=make_rows(6, 0))
    (alarm,) = picture.alarms
    assert alarm.cause.text == (
        'keep-out: conductor 4.2 m from the vehicle, 8.0 m required, north-east, 3 m below; '
        'structure 0 to 1, conductor 2'
    )
    np.testing.assert_allclose(alarm.cause.place, np.array(picture.vehicle) + WIRE.way, atol=1e-5)
    assert picture.count_severities() == {'critical': 1, 'warning': 0}
    far = dataclasses.replace(WIRE, level=Level.WARNING, distance=9.0)
    picture = feed(monitor, source, 2.0, far)
    assert picture.count_severities() == {'critical': 0, 'warning': 0}
    assert [item.state for item in picture.alarms] == ['cleared']
    monitor.acknowledge([alarm.number], 'crew', 103.0)
    picture = feed(monitor, source, 4.0, far)
    assert picture.alarms == ()
    assert picture.past_alarms[0].who == 'crew'
    assert any(event.text.startswith('crew acknowledged: keep-out') for event in picture.events)


def test_a_node_that_begins_anew_clears_no_alarm_silently():
    monitor, source = Monitor(), Source()
    feed(monitor, source, 1.0, WIRE, tables=make_rows(6, 0))
    other = Source(session=99)
    monitor.take_summary(other.summary(1.0, keyframe=True, tables=make_rows(6, 0)), 120.0)
    (alarm,) = monitor.look(120.0).alarms
    assert alarm.state == 'cleared'
    assert alarm.reason == 'the node began anew'


def test_a_span_is_named_by_its_structures():
    monitor, source = Monitor(), Source()
    picture = feed(monitor, source, 1.0)
    span = picture.spans[0]
    whole = dataclasses.replace(span, open_start=False, open_end=False)
    names = {name_stretch(item, picture.supports) for item in picture.spans}
    assert 'structure 0 to 1' in names
    assert name_stretch(dataclasses.replace(whole, open_end=True), picture.supports).endswith('?')
    assert name_stretch(whole, ()) == f'span {span.span_id}'


def test_the_height_is_from_ground_or_about_from_what_stands_on_it():
    monitor, source = Monitor(), Source()
    picture = feed(monitor, source, 1.0)
    spans = [dataclasses.replace(span, ground_clearance=7.0) for span in picture.spans]
    x, y, z = spans[0].lowest
    bad = dataclasses.replace(picture.supports[0], position=(x, y, z), kind='pole')
    three = [dataclasses.replace(bad, position=(x + k, y, z - 7.0)) for k in range(1, 4)]
    assert find_height((x, y, z), CloudStore(), (), three) == pytest.approx(7.0)
    assert find_height((x, y, z), CloudStore(), (), [bad, *three]) == pytest.approx(7.0)
    assert math.isnan(find_height((x, y, z), CloudStore(), (), three[:2]))  # too few
    assert find_height((x, y, z), CloudStore(), spans[:3], ()) == pytest.approx(7.0, abs=0.5)
    assert math.isnan(find_height(None, CloudStore(), (), three))
    assert math.isnan(find_height((x + 900.0, y, z), CloudStore(), (), three))


def test_ground_below_the_vehicle_comes_first():
    points = np.array([[10.0, 0.0, 1.0], [14.0, 0.0, 3.0], [10.0, 3.0, 9.0]])
    kind = np.array([PointClass.GROUND, PointClass.GROUND, PointClass.VEGETATION], np.uint8)
    cells = thin_points(points, kind, np.full(3, 5.0, np.float32), 0.5)
    blocks = {
        tuple(key): cells.codes[low:high] for key, low, high in zip(
            cells.blocks.tolist(), cells.starts, cells.starts[1:], strict=False
        )
    }
    body = pack_blocks(blocks, overview=False, voxel=0.5, total=1)
    cloud = CloudStore()
    cloud.put(read_cloud(pack_frame(
        Frame(kind=CLOUD, flags=0, session=1, sequence=0, uptime=0.0, body=body)
    )))
    assert find_height((10.0, 0.0, 21.0), cloud, (), ()) == pytest.approx(20.0, abs=0.3)
    assert find_height((14.4, 0.0, 21.0), cloud, (), ()) == pytest.approx(18.0, abs=0.3)
    assert math.isnan(find_height((30.0, 0.0, 21.0), cloud, (), ()))


def test_what_is_not_confirmed_has_no_number():
    told = 'conductor 4.2 m from the vehicle, 8.0 m required, north-east, 3 m below'
    assert describe_nearness(dataclasses.replace(WIRE, line_id=-3, span_id=-7)) == told
    assert describe_nearness(WIRE) == f'{told}; span 0, conductor 2'


@pytest.mark.parametrize(('way', 'words'), [
    ((0.0, 5.0, 0.4), ', north'), ((5.0, -5.0, 2.0), ', south-east, 2 m above'),
    ((-5.0, 0.1, 0.0), ', west'), ((0.3, 0.3, -4.0), ', 4 m below'),
    ((math.nan, math.nan, math.nan), ''),
])
def test_an_obstacle_is_somewhere(way, words):
    tree = Nearness(thing=Thing.OBSTACLE, level=Level.WARNING, distance=5.0, way=way, closest=5.0,
                    closest_in=0.0, sigma=0.1)
    assert describe_nearness(tree) == f'obstacle 5.0 m from the vehicle{words}'


def test_structures_at_the_ends_of_spans_are_the_nearest_within_reach():
    picture = feed(Monitor(), Source(), 1.0)
    rng = np.random.default_rng(0)
    places = [(*rng.uniform(0.0, 60.0, 2).tolist(), 0.0) for _ in range(200)]
    supports = [
        dataclasses.replace(picture.supports[0], support_id=k, position=place)
        for k, place in enumerate(places[:12])
    ]
    spans = [
        dataclasses.replace(picture.spans[0], start=start, end=end)
        for start, end in itertools.pairwise(places)
    ]

    def find(place):
        nearest = min(supports, key=lambda item: math.dist(item.position[:2], place[:2]))
        return nearest if math.dist(nearest.position[:2], place[:2]) <= REACH else None

    assert find_structures(spans, supports) == [(find(item.start), find(item.end))
                                                for item in spans]
    assert find_structures(spans, ()) == [(None, None)] * len(spans)
