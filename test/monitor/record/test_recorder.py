# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Recordings: whole at every moment, in order at the end, with what was published in them."""

from collections import Counter
from datetime import datetime
import json
import os
from pathlib import Path
import subprocess
import sys
import time

from mcap.reader import make_reader, NonSeekingReader
import pytest
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from stream_pieces import make_rows, Source

from plc_inspect.errors import ConfigError
from plc_inspect.mcap_file import McapFile
from plc_inspect.messages.rows import read_rows
from plc_inspect.monitor.picture.cloud_store import CloudStore
from plc_inspect.monitor.picture.model import Monitor
from plc_inspect.monitor.record import recorder as recorder_module
from plc_inspect.monitor.record.recorder import Recorder
from plc_inspect.stream.summary import read_summary

ROOT = Path(__file__).parents[3]
ENDLESS = """
import sys, time
from pathlib import Path
from plc_inspect.mcap_file import McapFile
file = McapFile(Path(sys.argv[1]))
channel = file.add_channel('/count', 'std_msgs/msg/String', 'string data')
number = 0
while True:
    for _ in range(200):
        file.write(channel, number, number.to_bytes(4, 'little') + bytes(300))
        number += 1
    file.flush()
    print(number, flush=True)
"""


def record(path, monkeypatch):
    """Record everything, a change and some of the corridor; return the source."""
    monkeypatch.setattr(recorder_module, 'FLUSH_PERIOD', 0.0)
    monitor, source = Monitor(), Source()
    with Recorder(path, '/plc_inspect') as recorder:
        for k in range(3):
            data = source.summary(5.0 + k, keyframe=not k, tables=make_rows(4 + k, 3))
            recorder.take('summary', data)
            monitor.take_summary(data, 100.0 + k)
            cloud = source.cloud(5.0 + k, [[10.0 + k, 2.0, 30.0], [900.0, 0.0, 0.0]])
            recorder.take('cloud', cloud)
            monitor.take_cloud(cloud, 100.0 + k)
            recorder.show(monitor.look(100.0 + k), monitor.cloud)
    return source


def test_it_holds_the_stream_and_what_it_says(tmp_path, monkeypatch):
    path = tmp_path / 'flight.mcap'
    source = record(path, monkeypatch)
    with Reader(path) as reader:
        counts = {item.topic: item.msgcount for item in reader.connections}
        messages = {}
        from rosbags.typesys import get_typestore, Stores
        store = get_typestore(Stores.ROS2_JAZZY)
        for connection, _, raw in reader.messages():
            messages.setdefault(connection.topic, []).append(
                store.deserialize_cdr(raw, connection.msgtype)
            )
    assert counts == {
        '/plc_inspect/summary': 3, '/plc_inspect/thin_corridor': 3, '/plc_inspect/catenaries': 3,
        '/plc_inspect/hazards': 3, '/plc_inspect/markers': 3, '/plc_inspect/vehicle': 3,
        '/diagnostics': 3, '/plc_inspect/corridor': 1,
    }
    spans = read_rows(messages['/plc_inspect/catenaries'][-1])
    expected = {(row['line_id'], row['span_id']): row for row in source.tables.spans}
    assert {(row['line_id'], row['span_id']) for row in spans} == set(expected)
    for row in spans:
        own = expected[row['line_id'], row['span_id']]
        assert row['sag'] == pytest.approx(own['sag'] * 1e-3, abs=1e-6)
        assert row['start_x'] == pytest.approx(own['start_x'] * 1e-3, abs=1e-4)
        assert row['z'] <= min(row['start_z'], row['end_z'])
    hazards = read_rows(messages['/plc_inspect/hazards'][-1])
    assert sorted(hazards['clearance'].tolist()) == pytest.approx([1.234, 2.234, 3.234], abs=1e-6)
    assert hazards['kind'].tolist() == [1, 1, 1]
    (corridor,) = messages['/plc_inspect/corridor']
    assert read_rows(corridor)['x'].tolist() == [10.25]
    assert corridor.header.frame_id == 'odom'
    summary = bytes(messages['/plc_inspect/summary'][1].data)
    assert read_summary(summary).frame.uptime == 6.0
    markers = messages['/plc_inspect/markers'][-1].markers
    assert Counter(marker.ns for marker in markers)['catenaries'] == 6
    assert messages['/diagnostics'][0].status[0].message == 'scans and odometry come in'


def test_the_corridor_is_laid_out_only_about_the_vehicle(tmp_path, monkeypatch):
    monitor, source, laid_out = Monitor(), Source(), []
    monitor.take_summary(source.summary(5.0, keyframe=True, vehicle=(5000.0, 2.0, 30.0)), 100.0)
    for k in range(100):
        monitor.take_cloud(source.cloud(5.0, [[100.0 * k, 2.0, 30.0]]), 100.0)
    assemble = CloudStore.assemble

    def note(cloud, home):
        laid_out.append(home)
        return assemble(cloud, home)

    monkeypatch.setattr(CloudStore, 'assemble', note)
    with Recorder(tmp_path / 'flight.mcap', '/plc_inspect') as recorder:
        recorder.show(monitor.look(100.0), monitor.cloud)
    with AnyReader([tmp_path / 'flight.mcap']) as reader:
        ((connection, _, data),) = reader.messages(
            [item for item in reader.connections if item.topic == '/plc_inspect/corridor']
        )
        rows = read_rows(reader.deserialize(data, connection.msgtype))
    assert rows['x'].tolist() == [4900.25, 5000.25, 5100.25]
    assert 3 <= len(laid_out) <= 8


def test_the_end_adds_what_readers_jump_with(tmp_path, monkeypatch):
    path = tmp_path / 'flight.mcap'
    record(path, monkeypatch)
    with path.open('rb') as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert summary.statistics.message_count == sum(
            summary.statistics.channel_message_counts.values()
        ) == 22
        assert len(summary.chunk_indexes) == summary.statistics.chunk_count > 3
        found = list(reader.iter_messages(topics=['/plc_inspect/hazards']))
        assert len(found) == 3
        assert found[0][0].encoding == 'ros2msg'
        assert b'PointField' in found[0][0].data


def test_a_killed_writer_leaves_a_whole_file(tmp_path):
    path = tmp_path / 'killed.mcap'
    for attempt in range(3):
        path.unlink(missing_ok=True)
        process = subprocess.Popen([sys.executable, '-c', ENDLESS, str(path)], cwd=ROOT,
                                   stdout=subprocess.PIPE, text=True,
                                   env=os.environ | {'PYTHONPATH': str(ROOT)})
        process.stdout.readline()
        time.sleep(0.1 + 0.05 * attempt)
        process.kill()
        told = [int(line) for line in process.communicate()[0].split()]
        with path.open('rb') as stream:
            numbers = [
                int.from_bytes(message.data[:4], 'little')
                for _, _, message in NonSeekingReader(stream).iter_messages()
            ]
        assert numbers == list(range(len(numbers)))
        assert len(numbers) >= max(told, default=200)


def test_before_the_first_message_it_is_whole_too(tmp_path):
    path = tmp_path / 'empty.mcap'
    file = McapFile(path)
    with path.open('rb') as stream:
        assert list(NonSeekingReader(stream).iter_messages()) == []
    file.close()
    file.close()
    with path.open('rb') as stream:
        assert make_reader(stream).get_summary().statistics.message_count == 0


def test_a_recording_is_not_overwritten_unless_told(tmp_path):
    path = tmp_path / 'flight.mcap'
    path.write_bytes(b'precious')
    with pytest.raises(ConfigError, match='is there already: --force replaces it'):
        Recorder(path, '/plc_inspect')
    assert path.read_bytes() == b'precious'
    with Recorder(path, '/plc_inspect', force=True):
        pass
    assert path.read_bytes().startswith(b'\x89MCAP')
    with pytest.raises(ConfigError, match='No such file'):
        Recorder(tmp_path / 'nowhere' / 'flight.mcap', '/plc_inspect')


def test_values_are_json_that_everything_reads():
    from plc_inspect.monitor.terminal.snapshot import format_snapshot
    monitor, source = Monitor(), Source()
    empty = json.loads(format_snapshot(monitor.look(1.0)))
    assert empty['link'] == 'waiting'
    assert empty['age']['data'] is None
    monitor.take_summary(source.summary(5.0, keyframe=True), 100.0)
    record = json.loads(format_snapshot(monitor.look(100.5)))
    assert record['age']['data'] == 0.5
    assert record['hazards'][0]['clearance'] == 1.234
    assert record['hazards'][0]['severity'] == 'critical'
    assert record['spans'][0]['severity'] == 'critical'
    assert record['spans'][0]['ground_clearance'] is None
    assert record['status'][1] == {'name': 'map', 'level': 0, 'text': '6% of the map in use'}
    assert record['health']['scans_lost'] == 4.0
    assert [(item['hazard_id'], item['state']) for item in record['alarms']] == [(0, 'new')]
    assert record['state']['tone'] == 'ok'


def test_who_acknowledged_an_alarm_stands_in_the_record(tmp_path):
    path = tmp_path / 'flight.mcap'
    monitor, source = Monitor(), Source()
    monitor.take_summary(source.summary(5.0, keyframe=True), 100.0)
    with Recorder(path, '/plc_inspect') as recorder:
        for alarm in monitor.acknowledge([1], 'crew', 101.5):
            recorder.note(alarm)
    with AnyReader([path]) as reader:
        ((connection, _, data),) = reader.messages()
        note = json.loads(reader.deserialize(data, connection.msgtype).data)
    assert connection.topic == '/plc_inspect/acknowledged'
    assert (note['who'], note['what'], note['after']) == ('crew', 'hazard 0', 1.5)
    assert datetime.fromisoformat(note['time']).tzinfo is not None
