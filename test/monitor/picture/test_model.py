# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The monitor's knowledge, message by message, with every way a link or a node can fail."""

import math

import numpy as np
import pytest
from stream_pieces import make_rows, NO_TABLES, Source, TEXTS

from plc_inspect.core.live.proximity import Level, Thing
from plc_inspect.monitor.picture import model as model_module
from plc_inspect.monitor.picture.model import LATE, LOST, Monitor
from plc_inspect.monitor.picture.names import name_stretches
from plc_inspect.monitor.picture.node_clock import NodeClock
from plc_inspect.monitor.picture.picture import Link
from plc_inspect.monitor.picture.wishes import CLOUD_PATIENCE, OVERTAKEN, PATIENCE
from plc_inspect.monitor.web.values import make_parts
from plc_inspect.stream.nearness import Nearness
from plc_inspect.stream.summary import TURNS
from plc_inspect.stream.summary_writer import Share


def tell(picture):
    """Return the texts of all events."""
    return [event.text for event in picture.events]


@pytest.fixture
def source():
    """Return the stream of a node."""
    return Source()


@pytest.fixture
def monitor(source):
    """Return a monitor that has had everything at time 100."""
    monitor = Monitor()
    assert monitor.take_summary(source.summary(5.0, keyframe=True), 100.0)
    return monitor


def test_before_anything_came_in():
    picture = Monitor().look(3.0)
    assert picture.link is Link.WAITING
    assert not picture.complete
    assert picture.spans == picture.hazards == picture.supports == ()
    assert np.isnan([picture.ages.link, picture.ages.data, picture.ages.vehicle]).all()


def test_a_message_may_be_a_full_picture(monitor, source):
    picture = monitor.look(100.2)
    assert (picture.link, picture.complete) == (Link.LIVE, True)
    assert len(picture.spans) == 6
    assert [item.severity_name for item in picture.hazards] == ['critical', 'warning', 'notice']
    hazard, row = picture.hazards[0], source.tables.hazards[0]
    assert hazard.clearance == pytest.approx(1.234, abs=1e-9)
    assert hazard.position == tuple(int(row[axis]) * 1e-3 for axis in 'xyz')
    span = next(item for item in picture.spans if item.key == (0, 0))
    assert span.severity == 3
    assert span.sag == int(source.tables.spans['sag'][0]) * 1e-3
    assert span.trace()[0] == pytest.approx(span.start, abs=0.01)
    assert span.trace()[-1] == pytest.approx(span.end, abs=0.01)
    assert picture.ages.data == pytest.approx(0.2)
    assert picture.vehicle == (15.0, 2.0, 30.0)
    assert picture.frame_id == 'odom'


def test_changes_are_put_in(monitor, source):
    rows = make_rows(5, 1)
    rows.spans['sag'][0] += 100
    monitor.take_summary(source.summary(6.0, tables=rows), 101.0)
    picture = monitor.look(101.0)
    assert len(picture.spans) == 5
    assert [item.hazard_id for item in picture.hazards] == [0]
    assert 'hazard 1 cleared' in tell(picture)
    assert picture.complete


def test_old_data_never_look_new(monitor, source):
    # What waited on the way is as old as it is, though it came in just now.
    assert monitor.look(107.0).link is Link.LOST
    monitor.take_summary(source.summary(6.0), 109.0)
    picture = monitor.look(109.0)
    assert picture.link is Link.LIVE
    assert picture.ages.link == 0.0
    assert picture.ages.data == pytest.approx(8.0, abs=0.01)
    assert picture.ages.delay == pytest.approx(8.0, abs=0.01)
    monitor.take_summary(source.summary(14.0, tick_uptime=6.0), 109.1)
    picture = monitor.look(109.1)
    assert picture.ages.data == pytest.approx(8.1, abs=0.01)
    assert picture.ages.health == pytest.approx(0.1, abs=0.01)


def test_what_the_node_kept_for_those_who_come_late_is_old_too():
    source, monitor = Source(), Monitor()
    kept = [source.summary(10.0 + k, keyframe=not k, tick_uptime=9.0) for k in range(8)]
    for data in kept:
        monitor.take_summary(data, 50.0)
    picture = monitor.look(50.0)
    assert picture.ages.data == pytest.approx(8.0)
    assert picture.complete
    assert picture.counts.lost_summary == 0


def test_a_silent_link_is_told(monitor, source):
    assert monitor.look(100.0 + LATE - 0.1).link is Link.LIVE
    assert monitor.look(100.0 + LATE + 0.1).link is Link.LATE
    picture = monitor.look(100.0 + LOST + 0.1)
    assert picture.link is Link.LOST
    assert picture.events[-1].level == 2
    assert monitor.look(120.0).events == picture.events
    monitor.take_summary(source.summary(25.0), 120.0)
    picture = monitor.look(120.0)
    assert picture.link is Link.LIVE
    assert tell(picture)[-1] == 'link is back after 20 s'


def test_lost_messages_make_it_incomplete_until_everything_came(monitor, source):
    rows = make_rows(6, 2)
    source.summary(6.0, tables=rows)
    source.summary(7.0)
    monitor.take_summary(source.summary(8.0), 103.0)
    picture = monitor.look(103.0)
    assert not picture.complete
    assert picture.counts.lost_summary == 2
    assert len(picture.hazards) == 3  # the message that took one back is lost
    assert monitor.take_wishes(103.0) == set()  # it may only have been overtaken
    assert monitor.take_wishes(103.0 + OVERTAKEN) == {'summary'}
    assert monitor.take_wishes(103.1 + OVERTAKEN) == set()
    monitor.take_summary(source.summary(9.0, keyframe=True), 104.0)
    picture = monitor.look(104.0)
    assert picture.complete
    assert len(picture.hazards) == 2
    assert monitor.take_wishes(103.0 + 2 * PATIENCE) == set()


def test_what_is_sent_again_on_request_completes_it(monitor, source):
    kept = [source.summary(6.0, keyframe=True, tables=make_rows(6, 1))]
    kept += [source.summary(7.0 + k) for k in range(3)]
    monitor.take_summary(kept[-1], 104.0)
    assert not monitor.look(104.0).complete
    assert monitor.take_wishes(104.0 + OVERTAKEN) == {'summary'}
    for data in kept:
        monitor.take_summary(data, 104.5)
    picture = monitor.look(104.5)
    assert picture.complete
    assert len(picture.hazards) == 1


def test_a_resend_changes_no_alarm(monitor, source):
    def list_alarms():
        return ([(item.number, item.state, item.times) for item in monitor.alarms.open],
                [item.number for item in monitor.alarms.past], monitor.alarms.raises)

    near = (Nearness(
        thing=Thing.SUPPORT, level=Level.CRITICAL, distance=5.0, way=(5.0, 0.0, 0.0),
        closest=5.0, closest_in=0.0, sigma=0.1, limit=8.0,
    ),)
    kept = []
    for k in range(20):
        last = source.summary(
            6.0 + k, tables=make_rows(6, 4 if k >= 8 else 0), near=near if 2 <= k < 5 else (),
            share=Share(turn=k % TURNS, turns=TURNS), levels=(0, 2 * (k == 3), 0),
        )
        kept.append(last)
        if k != 17:
            monitor.take_summary(last, 101.0 + k)
        monitor.acknowledge([item.number for item in monitor.alarms.open], 'crew', 101.5 + k)
    before, events = list_alarms(), len(monitor.look(121.0).events)
    assert [state for _, state, _ in before[0]] == ['acknowledged'] * 2
    assert monitor.take_wishes(121.0) == {'summary'}
    for data in kept:
        assert monitor.take_summary(data, 121.1)
        assert list_alarms() == before
    picture = monitor.look(121.2)
    assert picture.complete
    assert [item.hazard_id for item in picture.hazards] == [0, 3, 1, 2]
    assert len(picture.events) == events
    assert picture.ages.data == pytest.approx(1.2, abs=0.01)
    monitor.take_summary(source.summary(26.0, tables=make_rows(6, 3)), 122.0)
    assert [number for number, *_ in list_alarms()[0]] == [before[0][1][0]]


def test_a_resend_that_is_cut_off_clears_nothing(monitor, source):
    kept = []
    for k in range(22):
        kept.append(source.summary(
            6.0 + k, tables=make_rows(6, 4 if k >= 16 else 3),
            share=Share(turn=k % TURNS, turns=TURNS),
        ))
        if k != 17:
            monitor.take_summary(kept[-1], 101.0 + k)
    assert monitor.take_wishes(123.0) == {'summary'}
    for data in kept[:14]:  # all turns, of before number 3 was there
        monitor.take_summary(data, 123.1)
    for k in range(22, 22 + TURNS):
        monitor.take_summary(source.summary(
            6.0 + k, share=Share(turn=k % TURNS, turns=TURNS)
        ), 101.0 + k)
        assert {item.key: item.stands for item in monitor.alarms.open} == {
            'hazard 0': True, 'hazard 3': True
        }
    assert len(monitor.look(135.0).hazards) == 4
    assert monitor.alarms.raises == 2


def test_what_only_a_resend_holds_is_shown_with_the_newest_message(monitor, source):
    lost = source.summary(6.0, tables=make_rows(6, 4))
    newest = source.summary(7.0)
    monitor.take_summary(newest, 102.0)
    assert monitor.take_wishes(102.0 + OVERTAKEN) == {'summary'}
    monitor.take_summary(lost, 102.5)
    assert len(monitor.look(102.5).hazards) == 3
    monitor.take_summary(newest, 102.5)
    assert len(monitor.look(102.5).hazards) == 4
    assert {item.key for item in monitor.alarms.open} == {'hazard 0', 'hazard 3'}


def test_a_message_twice_or_late_changes_nothing(monitor, source):
    first, second = source.summary(6.0), source.summary(7.0, tables=make_rows(3, 0))
    assert monitor.take_summary(first, 101.0)
    assert monitor.take_summary(second, 102.0)
    assert not monitor.take_summary(first, 103.0)
    assert not monitor.take_summary(second, 103.0)
    picture = monitor.look(103.0)
    assert len(picture.spans) == 3
    assert picture.ages.link == 1.0


def test_damaged_messages_are_counted_and_survived(monitor, source):
    good = source.summary(6.0)
    for bad in (b'', good[:-5], good[:25] + b'\x00' * 9 + good[34:], source.cloud(6.0)):
        assert not monitor.take_summary(bad, 101.0)
    assert not monitor.take_cloud(good, 101.0)
    assert monitor.take_summary(good, 101.5)
    picture = monitor.look(101.5)
    assert picture.counts.malformed == 5
    assert picture.complete


def test_a_node_that_was_started_anew_clears_everything(monitor):
    monitor.take_cloud(Source().cloud(5.0), 100.1)
    other = Source(session=999)
    monitor.take_summary(other.summary(0.5, keyframe=True, tables=NO_TABLES), 130.0)
    picture = monitor.look(130.0)
    assert picture.spans == picture.hazards == ()
    assert picture.cloud_cells == 0
    assert picture.counts.restarts == 1
    assert 'the node was started anew: cleared until it tells what it kept' in tell(picture)
    assert picture.ages.data == pytest.approx(0.0)
    assert picture.track == ((10.5, 2.0, 30.0),)


def test_what_a_node_kept_is_old_until_the_first_result(monitor):
    other, rows = Source(session=999), make_rows(4, 1)
    monitor.take_summary(other.summary(
        0.5, keyframe=True, tables=rows, tick_uptime=math.nan, vehicle_uptime=math.nan,
    ), 130.0)
    picture = monitor.look(130.0)
    assert (len(picture.spans), len(picture.hazards)) == (4, 1)
    assert math.isnan(picture.ages.data)
    assert math.isnan(picture.ages.vehicle)
    state = make_parts(picture, 'node', 0.0)['state']
    assert state['old'] == {'data': True, 'vehicle': True, 'health': False, 'near': False}
    assert state['age_texts']['data'] == 'from before the restart of the node'
    monitor.take_summary(other.summary(1.5, tables=rows), 131.0)
    picture = monitor.look(131.0)
    assert 'the node went on with 4 of the 6 spans from before' in tell(picture)
    assert make_parts(picture, 'node', 0.0)['state']['old']['data'] is False


def test_a_vehicle_and_its_health_grow_old_with_the_link(monitor):
    def look(now):
        parts = make_parts(monitor.look(now), 'node', 0.0)
        return parts['state']['old'], dict(parts['health']['rows'])

    old, health = look(100.0)
    assert not any(old.values())
    age = float(health['last scan'].split()[0])
    assert health['scan rate'].endswith('Hz')
    old, health = look(100.0 + LATE + 0.1)
    assert old == {'data': False, 'vehicle': True, 'health': False, 'near': True}
    assert health['scan rate'] == '-'
    assert float(health['last scan'].split()[0]) == pytest.approx(age + LATE + 0.1, abs=0.11)
    assert all(look(100.0 + LOST + 0.1)[0].values())


def test_a_reset_is_told_from_a_restart(monitor):
    after = Source(session=8, resets=1)
    monitor.take_summary(after.summary(9.0, keyframe=True, tables=NO_TABLES), 104.0)
    picture = monitor.look(104.0)
    assert 'the node was told to forget everything: cleared' in tell(picture)
    assert picture.spans == ()
    assert picture.ages.data == pytest.approx(0.0, abs=0.01)


def test_of_two_nodes_the_one_that_was_there_is_shown(monitor, source):
    other = Source(session=999)
    assert not monitor.take_summary(other.summary(1.0, keyframe=True, tables=NO_TABLES), 101.0)
    assert not monitor.take_cloud(other.cloud(1.0), 101.2)
    assert monitor.take_summary(source.summary(6.0), 101.5)
    assert monitor.take_cloud(source.cloud(6.0), 101.5)
    picture = monitor.look(102.0)
    assert len(picture.spans) == 6
    assert picture.counts.foreign == 2
    assert any('another node of this name' in text for text in tell(picture))
    # When it is silent the other is shown, and when that is, the first again.
    assert monitor.take_summary(other.summary(3.0, keyframe=True, tables=NO_TABLES), 104.1)
    assert monitor.look(104.2).spans == ()
    assert monitor.take_summary(source.summary(12.0, keyframe=True), 107.0)
    assert len(monitor.look(107.0).spans) == 6


def test_critical_hazards_are_alarms_until_cleared_and_seen(monitor, source):
    def list_alarms(now):
        return [(item.cause.hazard_id, item.state) for item in monitor.look(now).alarms]

    assert list_alarms(101.0) == [(0, 'new')]
    assert list_alarms(4000.0) == [(0, 'new')]  # however long ago it was raised
    rows = make_rows(6, 4)  # number 3 is critical
    rows.hazards['severity'][1] = 3
    monitor.take_summary(source.summary(50.0, tables=rows), 145.0)
    picture = monitor.look(145.0)
    assert {item.cause.hazard_id for item in picture.alarms} == {0, 1, 3}
    assert any(text.startswith('was warning, is critical hazard 1') for text in tell(picture))
    monitor.take_summary(source.summary(51.0, tables=make_rows(6, 3)), 146.0)
    assert set(list_alarms(146.0)) == {(0, 'new'), (1, 'cleared'), (3, 'cleared')}
    numbers = [item.number for item in monitor.look(146.0).alarms]
    monitor.acknowledge(numbers, 'crew', 147.0)
    assert list_alarms(147.0) == [(0, 'acknowledged')]
    assert {item.cause.hazard_id for item in monitor.look(147.0).past_alarms} == {1, 3}


def test_an_alarm_waits_for_no_message_that_was_lost(monitor, source):
    def list_alarms():
        return [(item.cause.hazard_id, item.state) for item in monitor.look(101.0).alarms]

    lost = source.summary(6.0, tables=make_rows(6, 3))
    alarm = source.summary(7.0, tables=make_rows(6, 4))  # number 3 is critical
    after = source.summary(8.0)
    for data in (alarm, after, alarm, b'damaged', alarm[:40]):
        monitor.take_ahead(data, 100.5)
    assert list_alarms() == [(3, 'new'), (0, 'new')]
    picture = monitor.look(100.6)
    assert [item.hazard_id for item in picture.hazards] == [0, 1, 2]  # tables wait
    assert picture.count_severities() == {'critical': 2, 'warning': 1}
    assert picture.counts.malformed == 0  # that is counted where it comes in order
    assert monitor.take_summary(lost, 100.7)  # sent again
    assert list_alarms() == [(3, 'new'), (0, 'new')]
    assert monitor.take_summary(alarm, 100.8)
    assert monitor.take_summary(after, 100.8)
    assert list_alarms() == [(3, 'new'), (0, 'new')]
    assert monitor.take_summary(source.summary(9.0, tables=make_rows(6, 3)), 101.0)
    assert list_alarms() == [(0, 'new'), (3, 'cleared')]
    monitor.take_ahead(alarm, 101.0)  # it was taken: what comes once more raises nothing
    assert list_alarms() == [(0, 'new'), (3, 'cleared')]


def test_what_never_comes_in_order_stands_until_what_follows_it(monitor, source):
    source.summary(6.0)
    monitor.take_ahead(source.summary(7.0, tables=make_rows(6, 4)), 100.5)
    assert monitor.take_summary(source.summary(9.0, tables=make_rows(6, 3), keyframe=True), 103.0)
    assert {item.key: item.state for item in monitor.look(103.0).alarms} == {
        'hazard 0': 'new', 'hazard 3': 'cleared'}


def test_a_node_that_begins_anew_ends_what_was_ahead(monitor, source):
    source.summary(6.0)
    monitor.take_ahead(source.summary(7.0, tables=make_rows(6, 4)), 100.5)
    other = Source(session=9)
    monitor.take_ahead(other.summary(1.0, keyframe=True, tables=make_rows(6, 6)), 104.0)
    assert {item.key for item in monitor.look(104.0).alarms} == {'hazard 0', 'hazard 3'}
    assert monitor.take_summary(other.summary(1.5, keyframe=True, tables=NO_TABLES), 104.0)
    assert {item.state for item in monitor.look(104.0).alarms} == {'unsure'}


def test_hazards_that_are_held_back_are_not_cleared(monitor, source):
    shown = monitor.look(100.5).hazards
    rows = make_rows(6, 0)
    for uptime, keyframe in ((6.0, False), (7.0, True), (8.0, False)):
        monitor.take_summary(
            source.summary(uptime, keyframe=keyframe, tables=rows, held=True), 95.0 + uptime
        )
        picture = monitor.look(95.0 + uptime)
        assert picture.hazards == shown
        assert picture.held_back == 'map is not sharp; hazards are held back'
        (alarm,) = picture.alarms
        assert (alarm.state, alarm.stands) == ('new', True)
        assert alarm.cause.text.endswith('; held back, as told last')
        assert picture.spans[0].severity == 3
    assert len([text for text in tell(picture) if text.startswith('hazards are held')]) == 1
    assert not [text for text in tell(picture) if 'cleared' in text]
    monitor.take_summary(source.summary(9.0, levels=(0, 2, 0), held=True), 104.0)
    assert monitor.look(104.0).held_back == TEXTS[2]  # as the node's health has it
    before = len(monitor.look(104.0).events)
    monitor.take_summary(source.summary(10.0, tables=make_rows(6, 2)), 105.0)
    picture = monitor.look(105.0)
    assert tell(picture)[before:] == ['hazards are told again', 'map: good again']
    assert picture.hazards == shown  # number 2 may be told in a turn to come
    monitor.take_summary(source.summary(11.0, keyframe=True), 106.0)
    picture = monitor.look(106.0)
    assert tell(picture)[before + 2:] == ['hazard 2 cleared']
    assert picture.held_back == ''
    assert [item.hazard_id for item in picture.hazards] == [0, 1]
    assert 'held back' not in picture.alarms[0].cause.text


@pytest.mark.parametrize('resent', [False, True])
@pytest.mark.parametrize('lost', [(), range(29, 33), range(19, 33), range(19, 24)])
def test_hazards_that_are_held_back_outlast_their_release(monitor, source, lost, resent):
    rows = make_rows(6, 8)  # numbers 0, 3 and 6 are critical
    gone = make_rows(6, 7)
    numbers, kept = [], []
    for k in range(50):
        held, now = 20 <= k < 30, 101.0 + k
        tables = make_rows(6, 0) if held else gone if k > 30 else rows
        data = source.summary(6.0 + k, tables=tables, held=held, share=Share(
            turn=k % TURNS, turns=TURNS, most=0 if k == 30 else 3500
        ))
        kept = [*kept[-23:], data]
        if k not in lost:
            monitor.take_summary(data, now)
        if resent and monitor.take_wishes(now + OVERTAKEN):
            assert all(monitor.take_summary(data, now + 0.4) for data in kept)
        if k == 12:
            numbers = [item.number for item in monitor.alarms.open]
            monitor.acknowledge(numbers, 'crew', now)
        if k >= 12:
            assert sorted(item.number for item in monitor.alarms.open) == sorted(numbers)
            assert all(item.stands for item in monitor.alarms.open)
            assert len(monitor.look(now).hazards) >= 7
    assert monitor.alarms.raises == 3
    assert len(monitor.look(151.0).hazards) == 7
    assert [text for text in tell(monitor.look(151.0)) if 'cleared' in text] == [
        'hazard 7 cleared'
    ]


def test_who_comes_while_hazards_are_held_back_is_told():
    monitor = Monitor()
    monitor.take_summary(
        Source().summary(5.0, keyframe=True, tables=make_rows(6, 0), held=True), 100.0
    )
    picture = monitor.look(100.0)
    assert picture.hazards == ()
    assert picture.held_back
    assert tell(picture)[-1] == 'hazards are held back: they are shown as they were told last'


def test_health_and_time_that_jumps_are_told(monitor, source):
    monitor.take_summary(source.summary(6.0, levels=(2, 0, 0), stamp_ns=900_000_000_000), 101.0)
    texts = tell(monitor.look(101.0))
    assert 'input: scans and odometry come in' in texts
    assert 'the time of the data went back by 105 s' in texts
    monitor.take_summary(source.summary(7.0), 102.0)
    assert tell(monitor.look(102.0))[-1] == 'input: good again'


def test_the_corridor_is_put_together():
    monitor, source = Monitor(), Source()
    monitor.take_cloud(source.cloud(1.0, [[1.0, 1.0, 1.0], [41.0, 1.0, 1.0]], overview=True,
                                    voxel=4.0, total=2), 10.0)
    points, _, _, size = monitor.cloud.assemble_all()
    assert points.tolist() == [[2.0, 2.0, 2.0], [42.0, 2.0, 2.0]]
    assert size.tolist() == [4.0, 4.0]
    monitor.take_cloud(source.cloud(2.0, [[1.2, 1.2, 1.2]], total=2), 11.0)
    points, _, _, size = monitor.cloud.assemble_all()
    assert sorted(points[:, 0].tolist()) == [1.25, 42.0]
    assert monitor.cloud.take_changed() == [(0, 0)]
    picture = monitor.look(11.5)
    assert (picture.cloud_blocks, picture.cloud_total, picture.cloud_cells) == (1, 2, 1)
    assert picture.ages.cloud == 0.5
    beside = monitor.cloud.cut_out(np.array([0.0, 0.0]), np.array([20.0, 0.0]), 3.0)
    assert beside[0].tolist() == [[1.25, 1.25, 1.25]]
    assert len(monitor.cloud.cut_out(np.array([0.0, 9.0]), np.array([9.0, 9.0]), 3.0)[0]) == 0


def test_a_gap_in_the_corridor_is_told_and_asked_for():
    monitor, source = Monitor(), Source()
    monitor.take_cloud(source.cloud(1.0), 10.0)
    source.cloud(2.0)
    monitor.take_cloud(source.cloud(3.0, [[30.0, 0.0, 0.0]]), 12.0)
    assert monitor.take_wishes(12.0 + OVERTAKEN) == {'cloud'}
    assert monitor.take_wishes(12.1 + OVERTAKEN) == set()
    assert monitor.look(12.0).counts.lost_cloud == 1
    assert monitor.look(12.0).cloud_blocks == 2
    for _ in range(4):  # what was sent before the node knew of the new subscription
        source.cloud(4.0)
    monitor.take_cloud(source.cloud(4.0), 14.0)
    assert monitor.take_wishes(14.0) == set()
    assert monitor.look(14.0).counts.lost_cloud == 1
    for second in (15.0, 16.0):  # once more, but not at once: all would be sent anew
        source.cloud(second)
        monitor.take_cloud(source.cloud(second), second)
        assert monitor.take_wishes(second) == set()
    assert monitor.look(16.0).counts.lost_cloud == 3
    assert sum('were lost' in event.text for event in monitor.look(16.0).events) == 2
    assert monitor.take_wishes(12.0 + OVERTAKEN + CLOUD_PATIENCE) == {'cloud'}


@pytest.mark.parametrize('cloud', [True, False])
def test_a_corridor_that_never_came_is_asked_for(cloud):
    monitor, source = Monitor(cloud=cloud), Source()
    for second in range(int(PATIENCE) + 3):
        monitor.take_summary(source.summary(second, keyframe=True, cloud_sent=2), 10.0 + second)
        asked = monitor.take_wishes(10.0 + second)
        assert asked == ({'cloud'} if cloud and second == int(PATIENCE) + 1 else set())
    source.sequence = 2
    monitor.take_cloud(source.cloud(20.0), 30.0)
    for second in range(20, 30):
        monitor.take_summary(source.summary(second, keyframe=True, cloud_sent=3), 10.0 + second)
        assert not monitor.take_wishes(10.0 + second)


def test_everything_is_bounded(monitor, source):
    for k in range(400):
        rows = make_rows(2, k % 4)
        monitor.take_summary(source.summary(6.0 + k, tables=rows, vehicle=(10.0 * k, 0.0, 0.0)),
                             101.0 + k)
    picture = monitor.look(500.0)
    assert len(picture.events) == 200
    assert len(picture.track) == 401
    assert picture.counts.kbps < 20.0


def test_names_are_found_anew_only_where_rows_changed(monitor, source, monkeypatch):
    found = []

    def find(*known):
        found.append(known)
        return name_stretches(*known)

    monkeypatch.setattr(model_module, 'name_stretches', find)
    for k in range(10):
        assert monitor.take_summary(source.summary(6.0 + k), 101.0 + k)
        monitor.take_ahead(source.summary(6.5 + k), 101.5 + k)
    before = len(found)
    monitor.take_summary(source.summary(20.0, tables=make_rows(5, 3)), 120.0)
    assert (before, len(found)) == (0, 1)


def test_the_nodes_clock_is_that_of_the_quickest_message():
    clock = NodeClock()
    assert np.isnan(clock.measure_age(0.0, 10.0))
    clock.hear(100.0, 10.5)
    assert clock.measure_age(100.0, 11.5) == pytest.approx(1.0)
    clock.hear(101.0, 11.1)  # 0.4 s quicker than the first
    assert clock.measure_age(101.0, 11.1) == pytest.approx(0.0)
    assert clock.measure_age(100.0, 11.1) == pytest.approx(1.0)
    clock.hear(102.0, 14.1)
    assert clock.delay == pytest.approx(2.0, abs=0.01)


def test_a_clock_that_runs_apart_is_followed():
    for rate in (1 - 5e-5, 1 + 5e-5):
        clock = NodeClock()
        for k in range(5000):
            clock.hear(100.0 + k * rate, 10.0 + k)
        assert clock.delay < 0.01
        assert clock.measure_age(100.0 + 4999 * rate, 5010.0) == pytest.approx(1.0, abs=0.01)
