# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Markers: stable numbers, one table of colours, and the same from node, files and records."""

import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from rosbags.typesys import get_typestore, Stores
from spans import make_hazard, make_result, make_span, make_support, sample_points

from plc_inspect.colors import line_color, OK_COLOR, parse_color, SEVERITY_COLORS
from plc_inspect.config import Settings
from plc_inspect.core.live.corridor_points import CorridorPoints
from plc_inspect.core.live.session import LiveState
from plc_inspect.core.tracking.tracked_span import TrackedSpan
from plc_inspect.messages.markers import list_marks, MarkKind, MOST_SEGMENTS
from plc_inspect.monitor.picture.model import Monitor
from plc_inspect.monitor.picture.picture import HazardItem
from plc_inspect.monitor.record import recorder as recorder_module
from plc_inspect.monitor.record.recorder import Recorder
from plc_inspect.node_config import StreamSettings
from plc_inspect.offline.export.playback import write_playback
from plc_inspect.offline.records.inspection import Inspection
from plc_inspect.results import HazardKind, Severity
from plc_inspect.stream.summary import Status, STATUSES
from plc_inspect.stream.summary_writer import EVERYTHING, SummaryWriter

SPANS = (
    make_span((0.0, 0.0, 20.0), (93.0, 4.0, 22.0), 0, 4),
    make_span((93.0, 4.0, 22.0), (180.0, 40.0, 12.0), 0, 5),
    make_span((0.0, 3.0, 19.0), (22.0, 3.5, 18.0), 11, 4),
    make_span((0.0, 6.0, 9.0), (3.0, 6.0, 9.0), 2, 4),
)
SUPPORTS = (
    make_support((0.0, 1.0, 2.0), support_id=3, kind='tower', height=21.5),
    make_support((93.0, 4.0, 1.0), support_id=4, kind='pole', height=9.25),
    make_support((180.0, 40.0, 0.0), support_id=9, kind='unseen', height=0.0),
)
HAZARDS = tuple(
    make_hazard((20.0 + k, 1.5, 8.0), 0, 4, hazard_id=10 + k, kind=kind, clearance=1.234 + k,
                severity=Severity(1 + k % 3), confidence=0.97 - 0.05 * k)
    for k, kind in enumerate(HazardKind)
)


def read_markers(path):
    """Return the newest markers of a recording, by namespace and id."""
    store, markers = get_typestore(Stores.ROS2_JAZZY), []
    with Reader(path) as reader:
        for connection, _, data in reader.messages():
            if connection.topic == '/plc_inspect/markers':
                markers = store.deserialize_cdr(data, connection.msgtype).markers
    return {(marker.ns, marker.id): marker for marker in markers if marker.action == 0}


@pytest.fixture(scope='module')
def bundle():
    """Return all messages of the live node for one state."""
    publishing = pytest.importorskip(
        'plc_inspect.ros.results.publishing', reason='needs ROS', exc_type=ImportError
    )
    none = np.zeros(0)
    state = LiveState(
        spans=tuple(
            TrackedSpan(span=span, points=sample_points(span),
                        residual=np.zeros(len(sample_points(span)), np.float32), confirmed=True)
            for span in SPANS
        ),
        supports=SUPPORTS, hazards=HAZARDS,
        corridor=CorridorPoints(
            points=np.zeros((0, 3)), classification=none.astype(np.uint8),
            clearance=none.astype(np.float32), line_id=none.astype(np.int32),
            span_id=none.astype(np.int32),
        ),
    )
    return publishing.make_bundle(state, 'odom', 5_000_000_000, StreamSettings())


@pytest.fixture(scope='module')
def live(bundle):
    """Return the markers of the live node."""
    markers = {(marker.ns, marker.id): marker for marker in bundle.markers}
    assert len(markers) == len(bundle.markers)
    return markers


def play_back(room, bundle):
    """Return the markers of results.mcap."""
    result, points = make_result(SPANS, HAZARDS, SUPPORTS)
    inspection = Inspection(
        result=result, points=points, settings=Settings(), source='toy', command='plc_replay',
        frame_id='odom',
    )
    write_playback(room / 'results.mcap', inspection)
    return read_markers(room / 'results.mcap')


def record(room, bundle):
    """Return the markers that a monitor records, told of the state by the stream."""
    monitor, writer = Monitor(), SummaryWriter(7)
    status = Status(stamp_ns=5_000_000_000, tick_uptime=1.0)
    texts = ('odom', *('' for _ in STATUSES))
    data = writer.write(bundle.news.tables, status, texts, 1.0, EVERYTHING)
    with pytest.MonkeyPatch.context() as patch, Recorder(room / 'a.mcap', '/plc_inspect') as sink:
        patch.setattr(recorder_module, 'FLUSH_PERIOD', 0.0)
        monitor.take_summary(data, 100.0)
        sink.show(monitor.look(100.0), monitor.cloud)
    return read_markers(room / 'a.mcap')


def spread(place):
    """Return a Point, Vector3 or ColorRGBA as numbers."""
    return [float(getattr(place, name)) for name in 'xyzrgba' if hasattr(place, name)]


@pytest.mark.parametrize(('make', 'tolerance'), [(play_back, 1e-9), (record, 2e-3)])
def test_files_and_records_show_what_the_node_shows(tmp_path, bundle, live, make, tolerance):
    """Lengths of the stream are whole millimetres, its curves float32."""
    others = make(tmp_path, bundle)
    assert set(others) == set(live)
    for key, marker in live.items():
        other = others[key]
        assert (other.type, other.text) == (marker.type, marker.text), key
        assert spread(other.color) == pytest.approx(spread(marker.color), abs=1e-6), key
        assert len(other.points) == len(marker.points), key
        for mine, its in [
            (marker.pose.position, other.pose.position), (marker.scale, other.scale),
            (marker.pose.orientation, other.pose.orientation),
            *zip(marker.points, other.points, strict=True),
        ]:
            assert spread(its) == pytest.approx(spread(mine), abs=tolerance), key


def test_marks_of_the_node(live):
    """Numbers and colours by hand."""
    assert set(live) == {
        *(('catenaries', number) for number in (4, 5, 1_100_004, 200_004)),
        *(('supports', number) for number in (3, 4, 9)),
        *((name, 10 + k) for k in range(8) for name in ('hazards', 'hazard_texts')),
    }
    tower, pole, unseen = (live['supports', number] for number in (3, 4, 9))
    assert spread(tower.scale) == [1.2, 1.2, 21.5]
    assert spread(tower.pose.position) == [0.0, 1.0, 12.75]
    assert spread(pole.scale) == [0.35, 0.35, 9.25]
    assert spread(unseen.scale) == [0.35, 0.35, 0.1]
    red, green, blue = parse_color(line_color(11))
    assert spread(live['catenaries', 1_100_004].color) == pytest.approx(
        [red / 255, green / 255, blue / 255, 1.0])
    worst = live['hazards', 12]
    assert spread(worst.color)[:3] == pytest.approx(
        [value / 255 for value in parse_color(SEVERITY_COLORS['critical'])])
    assert live['hazard_texts', 12].text == 'structure 3.23 m (of 4.00 m), 87 % sure'


def test_curves_have_few_pieces_and_both_ends():
    marks = list_marks(SPANS, (), ())
    assert [len(mark.points) for mark in marks] == [17, 17, 5, 2]
    assert MOST_SEGMENTS == 16
    for mark, span in zip(marks, SPANS, strict=True):
        assert mark.kind == MarkKind.LINE_STRIP
        assert mark.points[[0, -1]] == pytest.approx(np.array([span.start, span.end]))


def test_marks_are_relative_to_an_origin():
    origin = np.array([500_000.0, -7.0, 0.0])
    for here, there in zip(list_marks(SPANS, SUPPORTS, HAZARDS),
                           list_marks(SPANS, SUPPORTS, HAZARDS, origin), strict=True):
        moved = np.array([mark.position for mark in (here, there)])
        if here.kind == MarkKind.LINE_STRIP:
            np.testing.assert_allclose(there.points + origin, here.points, atol=1e-9)
            assert (moved == 0.0).all()
        else:
            np.testing.assert_allclose(moved[1] + origin, moved[0], atol=1e-9)


def test_severities_have_the_colours_of_the_page():
    marks = [mark for mark in list_marks((), (), HAZARDS) if mark.namespace == 'hazards']
    for mark, hazard in zip(marks, HAZARDS, strict=True):
        assert mark.color == SEVERITY_COLORS[hazard.severity.name.lower()]
        assert mark.alpha == (0.9 if hazard.severity == Severity.CRITICAL else 0.8)


def test_what_a_newer_node_tells_is_drawn_all_the_same():
    strange = HazardItem(
        hazard_id=1, line_id=0, span_id=0, kind='kind 99', severity=0, position=(1.0, 2.0, 3.0),
        clearance=1.0, required=2.0, horizontal=1.0, vertical=0.0, sigma=0.1, along_span=3.0,
        from_support=3.0, support_id=-1, height=4.0, num_points=9,
        confidence=0.5,
    )
    sphere, text = list_marks((), (), [strange])
    assert sphere.color == OK_COLOR
    assert text.text == 'kind 99 1.00 m (of 2.00 m), 50 % sure'


def test_nothing_gives_no_marks():
    assert list_marks((), (), ()) == []
