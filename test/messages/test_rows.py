# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Rows of messages: the same from results and from a monitor, packed and unpacked."""

import numpy as np
import pytest
from spans import make_hazard, make_span, sample_points

from plc_inspect.colors import SEVERITY_COLORS
from plc_inspect.core.live.proximity import Level, Proximity, Thing
from plc_inspect.core.tracking.tracked_span import TrackedSpan
from plc_inspect.messages.markers import list_marks, mark_proximity
from plc_inspect.messages.rows import (
    CATENARIES,
    CORRIDOR,
    DATATYPES,
    gather_lines,
    HAZARDS,
    LINES,
    list_fields,
    make_catenaries,
    make_corridor,
    make_hazards,
    make_lines,
    make_proximity,
    PROXIMITY,
    read_rows,
)
from plc_inspect.messages.typestore import MessageMaker
from plc_inspect.monitor.picture import picture
from plc_inspect.results import HazardKind, Severity
from plc_inspect.stream.summary import make_tables

SPANS = (
    make_span((0.0, 0.0, 20.0), (80.0, 0.0, 22.0), 3, 1),
    make_span((80.0, 5.0, 22.0), (150.0, 40.0, 12.0), 0, 7),
)
RAISED = tuple(
    make_hazard((10.0 * k, 1.0, 5.0), 3, 1, hazard_id=k, kind=kind, severity=Severity(1 + k % 3),
                confidence=0.22 + 0.11 * k)
    for k, kind in enumerate(HazardKind)
)
KINDS = {'LINES': LINES, 'CORRIDOR': CORRIDOR, 'CATENARIES': CATENARIES, 'HAZARDS': HAZARDS,
         'PROXIMITY': PROXIMITY}


def make_items(spans=(), hazards=()):
    """Return what a monitor knows of results."""
    tables = make_tables([(span, False) for span in spans], (), hazards)
    return ([picture.make_span(row, 0) for row in tables.spans],
            [picture.make_hazard(row) for row in tables.hazards])


def assert_alike(rows, others, atol=0.0):
    """Compare rows field by field."""
    assert rows.dtype == others.dtype
    for name in rows.dtype.names:
        np.testing.assert_allclose(rows[name], others[name], rtol=1e-6, atol=atol, err_msg=name)


def pack_by_rosbags(rows):
    """Make a cloud of a recording."""
    maker = MessageMaker()
    return maker.cloud(maker.header(5, 'odom'), rows)


def pack_by_rclpy(rows):
    """Make a cloud of the node."""
    name = 'plc_inspect.ros.results.result_messages'
    module = pytest.importorskip(name, reason='needs ROS', exc_type=ImportError)
    from std_msgs.msg import Header
    return module.make_cloud(Header(frame_id='odom'), rows)


@pytest.mark.parametrize('pack', [pack_by_rosbags, pack_by_rclpy])
@pytest.mark.parametrize('name', KINDS)
@pytest.mark.parametrize('count', [0, 1, 5])
def test_packed_rows_come_back(pack, name, count):
    data = np.random.default_rng(count).integers(0, 120, count * KINDS[name].itemsize, np.uint8)
    rows = data.view(KINDS[name])
    message = pack(rows)
    assert (message.height, message.width, message.point_step) == (1, count, rows.itemsize)
    assert [(f.name, f.offset, f.datatype) for f in message.fields] == list_fields(rows.dtype)
    assert read_rows(message).dtype == rows.dtype
    assert read_rows(message).tobytes() == rows.tobytes()


def test_codes_are_those_of_ros():
    messages = pytest.importorskip('sensor_msgs.msg', exc_type=ImportError)
    names = {'i': 'INT', 'u': 'UINT', 'f': 'FLOAT'}
    for kind, code in DATATYPES.items():
        assert code == getattr(messages.PointField, f'{names[kind[0]]}{8 * int(kind[1])}')


def test_organised_clouds_have_rows_and_columns():
    maker = MessageMaker()
    rows = np.zeros((4, 3), dtype=LINES)
    message = maker.cloud(maker.header(0, 'odom'), rows, is_dense=False)
    assert (message.height, message.width, message.row_step) == (4, 3, 3 * LINES.itemsize)
    assert not message.is_dense
    assert read_rows(message).reshape(4, 3).tobytes() == rows.tobytes()


def test_spans_by_hand():
    row, other = make_catenaries(SPANS)
    assert (row['line_id'], row['span_id'], row['num_points']) == (3, 1, 80)
    assert [row[name] for name in ('start_x', 'end_x', 'end_z')] == [0.0, 80.0, 22.0]
    assert row['sigma_sag'] == np.float32(0.01)
    assert [row['x'], row['z']] == pytest.approx(SPANS[0].lowest[[0, 2]], rel=1e-6)
    assert (other['line_id'], other['span_id']) == (0, 7)


def test_clearance_is_what_the_rule_limits():
    near = make_hazard((10, 0, 5), clearance=28.87, horizontal=0.04, vertical=28.87,
                       note='a note; measured horizontally', required=3.0)
    _, (told,) = make_items(hazards=[near])
    for hazard in (near, told):
        (row,) = make_hazards([hazard])
        assert row['clearance'] == pytest.approx(0.04, abs=1e-3)
        assert row['vertical'] == pytest.approx(28.87, abs=1e-3)
        (text,) = (mark.text for mark in list_marks((), (), [hazard]) if mark.text)
        assert text.startswith('vegetation 0.04 m (of 3.00 m)')


def test_spans_and_hazards_of_a_monitor_give_the_same_rows():
    spans, hazards = make_items(SPANS, RAISED)
    assert_alike(make_catenaries(spans), make_catenaries(SPANS), atol=1e-3)
    assert_alike(make_hazards(hazards), make_hazards(RAISED), atol=1e-3)


def test_confidence_is_the_last_of_a_row():
    rows = make_hazards(RAISED)
    assert rows.dtype.names[-1] == 'confidence'
    assert rows['confidence'] == pytest.approx([0.22 + 0.11 * k for k in range(len(RAISED))])
    _, items = make_items(hazards=RAISED)  # the stream tells whole percents
    assert make_hazards(items)['confidence'] == pytest.approx(rows['confidence'], abs=0.005)


def test_a_kind_that_is_unknown_is_none():
    _, (item,) = make_items(hazards=RAISED[:1])
    strange = picture.HazardItem(**{
        name: getattr(item, name) for name in item.__slots__ if name != 'kind'
    }, kind='kind 99')
    assert make_hazards([item, strange])['kind'].tolist() == [1, 0]


def test_rows_are_relative_to_an_origin():
    origin = np.array([100.0, -20.0, 3.0])
    here, there = make_catenaries(SPANS), make_catenaries(SPANS, origin)
    for axis, shift in zip('xyz', origin, strict=True):
        for prefix in ('', 'start_', 'end_'):
            np.testing.assert_allclose(there[prefix + axis] + shift, here[prefix + axis],
                                       atol=1e-5)
    np.testing.assert_allclose(there['a'] + 3.0, here['a'], rtol=1e-6)
    assert there['b'].tobytes() == here['b'].tobytes()
    assert make_hazards(RAISED, origin)['y'] == pytest.approx(21.0)


def test_wire_points_of_all_spans_follow_each_other():
    tracked = [
        TrackedSpan(span=span, points=sample_points(span, 4 + k),
                    residual=np.arange(4 + k, dtype=np.float32))
        for k, span in enumerate(SPANS)
    ]
    rows = gather_lines(tracked)
    assert rows['line_id'].tolist() == [3] * 4 + [0] * 5
    assert rows['span_id'].tolist() == [1] * 4 + [7] * 5
    assert rows['residual'].tolist() == [0, 1, 2, 3, 0, 1, 2, 3, 4]
    assert rows['x'][0] == 0.0
    assert rows['z'][-1] == pytest.approx(12.0)


def test_nothing_gives_no_rows():
    none = np.empty((0, 3))
    assert gather_lines([]).dtype == make_lines(none, line_id=0, span_id=0, residual=0).dtype
    corridor = make_corridor(none, classification=5, clearance=1.0, line_id=-1, span_id=-1)
    assert (len(corridor), corridor.dtype) == (0, CORRIDOR)
    assert len(gather_lines([])) == len(make_catenaries([])) == len(make_hazards([])) == 0


def test_rows_and_marks_of_what_is_near():
    near = Proximity(
        thing=Thing.CONDUCTOR, level=Level.CRITICAL, distance=5.0, closest=3.0, closest_in=2.0,
        position=np.array([3.0, 14.0, 30.0]), sigma=0.1, line_id=4, span_id=2, extended=True,
    )
    nothing = Proximity(thing=Thing.SUPPORT, level=Level.UNKNOWN, position=np.full(3, np.nan))
    vehicle = np.array([0.0, 10.0, 30.0])
    row, other = make_proximity((near, nothing), vehicle)
    assert row.tolist()[:5] == (3.0, 14.0, 30.0, 0, 3)
    assert [row['direction_' + axis] for axis in 'xyz'] == pytest.approx([0.6, 0.8, 0.0])
    assert (row['line_id'], row['span_id'], row['extended']) == (4, 2, 1)
    assert (row['distance'], row['closest'], row['closest_in']) == (5.0, 3.0, 2.0)
    assert (other['thing'], other['level'], other['line_id']) == (1, 0, -1)
    assert np.isnan([other['distance'], other['x'], other['direction_x']]).all()
    line, text = mark_proximity((near, nothing), vehicle)
    np.testing.assert_array_equal(line.points, [vehicle, near.position])
    assert line.color == SEVERITY_COLORS['critical']
    assert text.text == 'conductor 5.0 m'
