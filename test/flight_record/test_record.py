# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A record holds all that was handed over, wherever it ends and whatever the disk does."""

from dataclasses import replace
import errno
import json
import os
import resource
import threading
import time

from mcap.records import Chunk
from mcap.stream_reader import StreamReader
import numpy as np
import pytest

from plc_inspect.config import MapSettings, Settings
from plc_inspect.core.live.session import Session
from plc_inspect.core.live.warm_up import make_sample
from plc_inspect.core.setup.ground_side import GroundSides
from plc_inspect.core.setup.looks import Spread
from plc_inspect.core.setup.plumb import Leans, NO_LEANS
from plc_inspect.core.voxel_buffer.voxel_map import VoxelMap
from plc_inspect.errors import ConfigError, DataError
from plc_inspect.flight_record import reader as reader_module
from plc_inspect.flight_record import recorder as recorder_module
from plc_inspect.flight_record import recording as recording_module
from plc_inspect.flight_record import segment as segment_module
from plc_inspect.flight_record.layout import list_segments, pack_json
from plc_inspect.flight_record.plain_values import from_plain, to_plain
from plc_inspect.flight_record.reader import find_end, read_flight
from plc_inspect.flight_record.recording import Recording, set_aside
from plc_inspect.flight_record.resumption import look_at
from plc_inspect.results import Hazard

NUM_CUTS = 60
SETTINGS = MapSettings(max_voxels=100_000)


class Source:
    """A map that grows, and a session that knows more and more."""

    def __init__(self, folder):
        self.voxels = VoxelMap(SETTINGS)
        self.session = Session()
        self.said = []
        self.number = 0
        self.recording = Recording(
            self.voxels, lambda: {'number': self.number}, self.said.append
        )
        self.recording.begin(folder, {'settings': {}}, fresh=True)
        self._rng = np.random.default_rng(0)
        self._sample = make_sample()

    def grow(self, knows=None):
        """Let something happen, and wait until it is handed over."""
        self.number += 1
        chosen = self._rng.random(len(self._sample)) < 0.3
        self.voxels.insert(self._sample[chosen])
        if knows is not None:
            self.recording.keep(knows)
        self.recording.flush()

    def wait(self):
        """Wait until all is on the disk."""
        end = time.monotonic() + 20.0
        while self.recording._recorder.busy:
            assert time.monotonic() < end
            time.sleep(0.01)


@pytest.fixture(scope='module')
def knows():
    """Return what a session keeps that found the sample."""
    session = Session()
    session.conclude(make_sample(), Settings(), 0, complete=True)
    return session.remember()


def check_map(flight, voxels):
    """Check that a flight has the map, bit for bit."""
    other = VoxelMap(SETTINGS)
    other.restore(flight.map)
    assert other.num_slots == voxels.num_slots
    assert other.centroids().tobytes() == voxels.centroids().tobytes()
    assert other.counts().tolist() == voxels.counts().tolist()


def describe(flight):
    """Return all that a record adds up to."""
    columns = flight.map.keys, flight.map.counts, flight.map.means, flight.map.labels
    return (
        *(column.tobytes() for column in columns), flight.map.cell_state.tobytes(),
        json.dumps(to_plain(flight.kept.hazards)), flight.state['number'],
        [(item.key, item.hits, item.points.tobytes()) for item in flight.kept.spans.spans],
    )


@pytest.fixture(scope='module')
def made(tmp_path_factory, knows):
    """Return a record as a node that was killed leaves it, and where its chunks end."""
    folder = tmp_path_factory.mktemp('made') / 'it.record'
    source = Source(folder)
    fewer = replace(knows, spans=replace(knows.spans, spans=knows.spans.spans[:4]))
    for number in range(12):
        source.grow({3: fewer, 7: knows}.get(number))
        source.wait()
    (segment,) = list_segments(folder)
    data = segment.read_bytes()
    with segment.open('rb') as stream:
        ends = [
            stream.tell() for record in StreamReader(stream, emit_chunks=True).records
            if isinstance(record, Chunk)
        ]
    flight = read_flight(folder)
    assert flight.notes == ()
    check_map(flight, source.voxels)
    source.recording.close()
    return data, ends


def test_books_come_back(tmp_path, knows):
    source = Source(tmp_path / 'it.record')
    source.grow(knows)
    source.recording.close('somewhere')
    flight = read_flight(tmp_path / 'it.record')
    for name in ('hazards', 'supports'):
        assert to_plain(getattr(flight.kept, name)) == to_plain(getattr(knows, name))
    assert len(flight.kept.spans.spans) == len(knows.spans.spans) == 6
    for one, other in zip(flight.kept.spans.spans, knows.spans.spans, strict=True):
        assert to_plain(one.span) == to_plain(other.span)
        np.testing.assert_allclose(one.points, other.points, rtol=0, atol=2e-5)
    restored = Session()
    restored.restore(flight.kept)
    sessions = [restored, Session()]
    sessions[1].restore(knows)
    found = [
        session.conclude(make_sample(), Settings(), 1, complete=True)[0] for session in sessions
    ]
    assert to_plain([item.span for item in found[0].spans]) == to_plain(
        [item.span for item in found[1].spans]
    )
    assert to_plain(found[0].hazards) == to_plain(found[1].hazards)


def test_sharpness_comes_back_with_what_was_added_and_what_was_dropped(tmp_path, knows):
    parts = [
        Spread(number % 3, np.full(3, 0.1 * number), np.zeros(0), np.full(2, 1.0 / 3.0))
        for number in range(6)
    ]
    source = Source(tmp_path / 'it.record')
    for first, last in ((0, 0), (0, 3), (1, 5), (1, 5), (4, 6)):
        source.grow(replace(knows, spreads=tuple(parts[first:last])))
        source.wait()
        found = read_flight(tmp_path / 'it.record').kept.spreads
        assert to_plain(found) == to_plain(parts[first:last])
    source.grow(replace(knows, spreads=()))
    source.recording.close()
    assert read_flight(tmp_path / 'it.record').kept.spreads == ()


def test_leans_come_back(tmp_path, knows):
    assert len(knows.leans.poles)
    leans = Leans(
        poles=np.full((2, 4), 0.1), conductors=np.full((1, 6), 1.0 / 3.0),
        sides=GroundSides(below=0.01, above=0.4),
    )
    source = Source(tmp_path / 'it.record')
    changed = replace(knows, leans=leans)
    for kept in (replace(knows, leans=NO_LEANS), knows, changed, changed):
        source.grow(kept)
        source.wait()
        found = read_flight(tmp_path / 'it.record').kept.leans
        assert to_plain(found) == to_plain(kept.leans)
    source.recording.close()


@pytest.mark.slow
def test_cut_at_any_byte_gives_the_last_whole_chunk(tmp_path, made):
    data, ends = made
    rng = np.random.default_rng(3)
    places = [*rng.integers(0, len(data), NUM_CUTS), len(data)]
    places += [end + k for end in ends[::4] for k in (-1, 0, 1)]
    path = tmp_path / '000001.mcap'
    expected = {}
    for end in ends:
        path.write_bytes(data[:end])
        expected[end] = describe(read_flight(tmp_path))
    for place in places:
        path.write_bytes(data[:place])
        whole = [end for end in ends if end <= place]
        if not whole:
            with pytest.raises(DataError, match='no whole chunk'):
                read_flight(tmp_path)
            continue
        assert describe(read_flight(tmp_path)) == expected[whole[-1]]


def test_damage_costs_what_is_behind_it(tmp_path, made):
    data, ends = made
    rng = np.random.default_rng(4)
    path = tmp_path / '000001.mcap'
    numbers = set()
    for place in rng.integers(ends[2], ends[-1], 20).tolist():
        harmed = bytearray(data)
        harmed[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(harmed)
        number = read_flight(tmp_path).state['number']
        path.write_bytes(data[: max(end for end in ends if end <= place)])
        assert number >= read_flight(tmp_path).state['number']
        numbers.add(number)
    assert len(numbers) > 3


def test_full_disk_costs_record_for_a_while_and_nothing_else(tmp_path, monkeypatch):
    monkeypatch.setattr(recorder_module, 'RETRY', 0.05)
    source = Source(tmp_path / 'it.record')
    source.grow()
    source.wait()
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
    try:
        end = time.monotonic() + 20.0
        while not source.recording.describe().problem:
            source.grow()
            time.sleep(0.05)
            assert time.monotonic() < end
        assert 'File too large' in source.recording.describe().problem
        for _ in range(50):  # nothing more is taken while it lasts
            source.voxels.insert(make_sample()[::50])
            source.recording.step()
        waiting = source.recording._recorder._queue
        assert len(waiting) <= 3 + 1
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    source.wait()
    source.recording.step()
    assert 'cannot be written' in source.said[0]
    assert 'written again' in source.said[-1]
    source.recording.flush()
    source.wait()
    check_map(read_flight(tmp_path / 'it.record'), source.voxels)
    source.recording.close()


def fail(monkeypatch, name, seldom):
    """Let a call of the system say that the disk is full, as long as a condition holds."""
    real = getattr(os, name)

    def run(*arguments):
        if seldom(*arguments):
            raise OSError(errno.ENOSPC, 'No space left on device')
        return real(*arguments)

    monkeypatch.setattr(os, name, run)


def test_folder_that_cannot_be_made_is_said_and_costs_no_point(tmp_path):
    (tmp_path / 'file').write_text('')
    source = Source(tmp_path / 'file' / 'it.record')
    (said,) = source.said
    assert said.startswith('no record is written: ')
    assert 'it.record cannot be written' in said
    source.grow()
    source.recording.step()
    assert len(source.voxels) > 0
    assert source.recording.folder is None
    assert source.recording.describe().problem == said
    source.recording.close('somewhere')


def test_folder_that_is_read_only_is_said_and_costs_no_point(tmp_path, monkeypatch):
    source = Source(tmp_path / 'it.record')
    made = segment_module.McapFile

    def refuse(path, **options):
        raise ConfigError(f'{path} cannot be written: Read-only file system')

    monkeypatch.setattr(segment_module, 'McapFile', refuse)
    source.grow()
    until = time.monotonic() + 20.0
    while not source.said and time.monotonic() < until:
        source.recording.step()
        time.sleep(0.01)
    assert 'Read-only file system' in source.said[0]
    assert source.said[0].startswith('the record cannot be written: ')
    assert 'Read-only file system' in source.recording.describe().problem
    before = len(source.voxels)
    source.voxels.insert(source._sample + 500.0)
    source.recording.step()
    assert len(source.voxels) > before
    monkeypatch.setattr(segment_module, 'McapFile', made)
    until = time.monotonic() + 20.0
    while len(source.said) < 2 and time.monotonic() < until:
        source.recording.step()
        time.sleep(0.01)
    assert source.said[1] == 'the record is written again'
    source.recording.close('somewhere')
    check_map(read_flight(tmp_path / 'it.record'), source.voxels)


def test_what_keeps_the_record_behind_is_said(tmp_path, monkeypatch):
    source = Source(tmp_path / 'it.record')
    source.grow()
    source.wait()
    monkeypatch.setattr(recording_module, 'LATE', 0.0)
    assert source.recording.describe().problem.endswith('behind: the node had no time for it')
    real, slow = os.pwrite, threading.Event()

    def write(*arguments):
        assert slow.wait(20.0)
        return real(*arguments)

    monkeypatch.setattr(os, 'pwrite', write)
    source.grow()
    assert source.recording.describe().problem.endswith('behind: the disk is slow')
    slow.set()
    source.wait()
    source.recording.close()
    check_map(read_flight(tmp_path / 'it.record'), source.voxels)


def test_record_begins_once_the_full_disk_has_room(tmp_path, monkeypatch):
    monkeypatch.setattr(recorder_module, 'RETRY', 0.05)
    full = [True]
    fail(monkeypatch, 'pwrite', lambda *_: full[0])
    source = Source(tmp_path / 'it.record')
    num_files = len(os.listdir('/proc/self/fd'))
    source.grow()
    end = time.monotonic() + 20.0
    while 'No space left' not in source.recording.describe().problem:
        assert time.monotonic() < end
        time.sleep(0.01)
    time.sleep(0.3)  # it tries a few more times
    while list_segments(tmp_path / 'it.record'):  # for a moment of each try
        assert time.monotonic() < end
        time.sleep(0.001)
    assert len(os.listdir('/proc/self/fd')) <= num_files + 1
    full[0] = False
    source.wait()
    source.recording.flush()
    source.wait()
    check_map(read_flight(tmp_path / 'it.record'), source.voxels)
    source.recording.close()


def test_next_segment_waits_for_the_last_chunk_of_the_one_before(tmp_path, monkeypatch):
    monkeypatch.setattr(recorder_module, 'RETRY', 0.05)
    folder = tmp_path / 'it.record'
    source = Source(folder)
    source.grow()
    source.wait()
    full = [False]
    fail(monkeypatch, 'pwrite', lambda *_: full[0])
    full[0] = True
    source.grow()
    end = time.monotonic() + 20.0
    while not source.recording.describe().problem:
        assert time.monotonic() < end
        time.sleep(0.01)
    number = source.number
    source.voxels.clear()  # the next batch begins another segment
    source.number += 1
    source.recording.flush()
    time.sleep(0.3)
    assert [path.name for path in list_segments(folder)] == ['000001.mcap']
    full[0] = False
    opened = []
    begin = recorder_module.Segment

    def note(path, *arguments, **options):
        opened.append((path.name, read_flight(folder).state['number']))
        return begin(path, *arguments, **options)

    monkeypatch.setattr(recorder_module, 'Segment', note)
    source.wait()
    assert opened == [('000002.mcap', number)]
    source.recording.close()


def test_segments_that_are_told_of_once_more_go(tmp_path, knows, monkeypatch):
    monkeypatch.setattr(recorder_module, 'LEAST_GROWTH', 300_000)
    folder = tmp_path / 'it.record'
    source = Source(folder)
    source.grow(knows)
    seen = set()
    for _ in range(40):
        source.grow()
        source.wait()
        seen |= {path.name for path in list_segments(folder)}
        flight = read_flight(folder)
        assert flight.state['number'] == source.number
        check_map(flight, source.voxels)
        assert len(flight.kept.spans.spans) == 6
    assert len(seen) > 2
    assert len(list_segments(folder)) <= 2
    source.recording.close()


def test_map_that_begins_anew_begins_a_record_anew(tmp_path, knows):
    folder = tmp_path / 'it.record'
    source = Source(folder)
    source.grow(knows)
    source.voxels.clear()
    source.recording.forget()
    source.grow()
    source.wait()
    flight = read_flight(folder)
    check_map(flight, source.voxels)
    assert flight.kept.spans.spans == ()
    assert [path.name for path in list_segments(folder)] == ['000002.mcap']
    source.recording.close()


def test_record_goes_on_after_the_segments_there_are(tmp_path, knows):
    folder = tmp_path / 'it.record'
    source = Source(folder)
    source.grow(knows)
    source.recording.close()
    assert find_end(folder) == ''
    flight = read_flight(folder)
    other = Source(tmp_path / 'none')
    other.recording.close()
    other.voxels.restore(flight.map)
    other.recording.begin(folder, {'settings': {}}, fresh=False)
    other.recording.keep(flight.kept)
    other.grow()
    other.recording.close('/data/out')
    assert find_end(folder) == '/data/out'
    check_map(read_flight(folder), other.voxels)
    assert len(read_flight(folder).kept.spans.spans) == 6
    assert len(list_segments(folder)) == 2


def test_copies_in_the_folder_are_no_segments(tmp_path, knows):
    first = Source(tmp_path / 'it.record')
    first.grow(knows)
    first.recording.close()
    segments = list_segments(tmp_path / 'it.record')
    for name in ('000001_copy.mcap', '1.mcap', '000001.old.mcap'):
        (tmp_path / 'it.record' / name).write_bytes(segments[0].read_bytes())
    assert list_segments(tmp_path / 'it.record') == segments
    again = Recording(first.voxels, lambda: {'number': 2}, first.said.append)
    again.begin(tmp_path / 'it.record', {'settings': {}}, fresh=False)
    again.close()
    assert not first.said


def test_flight_that_was_saved_is_over_whatever_the_power_cut_took(tmp_path, knows):
    folder = tmp_path / 'it.record'
    source = Source(folder)
    source.grow(knows)
    source.recording.close('/data/out')
    assert look_at(folder, Settings()).over
    (segment,) = list_segments(folder)
    with segment.open('rb') as stream:
        end = [
            stream.tell() for record in StreamReader(stream, emit_chunks=True).records
            if isinstance(record, Chunk)
        ][-1]
    os.truncate(segment, end)
    found = look_at(folder, Settings())
    assert found.over
    assert found.reason == 'its flight was saved'


def test_end_that_is_not_on_the_disk_is_told(tmp_path, monkeypatch):
    source = Source(tmp_path / 'it.record')
    source.grow()
    source.wait()
    (segment,) = list_segments(tmp_path / 'it.record')
    sizes, real = [], os.fsync

    def note(number):
        sizes.append(os.fstat(number).st_size)
        real(number)

    monkeypatch.setattr(os, 'fsync', note)
    source.recording.close('/data/out')
    assert sizes[-1] == segment.stat().st_size  # the summary, too

    source = Source(tmp_path / 'other.record')
    source.grow()
    source.wait()
    fail(monkeypatch, 'pwrite', lambda *_: True)
    source.recording.close()
    assert 'is not whole' in source.said[-1]
    assert 'No space left' in source.said[-1]


def test_chunks_before_one_that_is_too_large_count(tmp_path, made, monkeypatch):
    data, ends = made
    (tmp_path / '000001.mcap').write_bytes(data)
    sizes = []
    with (tmp_path / '000001.mcap').open('rb') as stream:
        for record in StreamReader(stream, emit_chunks=True).records:
            if isinstance(record, Chunk):
                sizes.append(record.uncompressed_size)
    most = max(sizes[:2])
    number = next(number for number, size in enumerate(sizes) if size > most)
    assert number > 1
    monkeypatch.setattr(reader_module, 'MOST_CHUNK', most)
    flight = read_flight(tmp_path)
    assert flight.num_chunks == number
    assert f'the last {len(data) - ends[number - 1]} bytes are cut off' in flight.notes[0]


def test_record_of_another_process_is_left_alone(tmp_path):
    source = Source(tmp_path / 'it.record')
    other = Source(tmp_path / 'it.record')
    assert 'is written by another node' in other.recording.describe().problem
    assert other.said == [other.recording.describe().problem]
    other.grow()
    other.recording.close()
    source.recording.close()


def test_records_that_were_not_saved_are_kept_aside(tmp_path):
    for number in (1, 2):
        folder = tmp_path / 'out.record'
        folder.mkdir()
        assert set_aside(folder) == tmp_path / f'out.lost_{number}.record'
        assert not folder.exists()


@pytest.mark.parametrize(('content', 'text'), [
    (None, 'does not exist'), ({}, 'no segment'), ({'000001.mcap': b''}, 'no whole chunk'),
    ({'000001.mcap': b'nothing of MCAP at all'}, 'no whole chunk'),
])
def test_what_is_no_record_is_said(tmp_path, content, text):
    folder = tmp_path / 'it.record'
    if content is not None:
        folder.mkdir()
        for name, data in content.items():
            (folder / name).write_bytes(data)
    with pytest.raises(DataError, match=text):
        read_flight(folder)
    assert find_end(folder) == ''


@pytest.mark.parametrize('change', [
    {'hazard_id': 'one'}, {'position': 'here'}, {'kind': 99}, {'nonsense': 1}, {'extent': None},
])
def test_values_of_another_kind_are_refused(knows, change):
    plain = json.loads(pack_json(to_plain(knows.hazards.hazards[0].hazard)))
    assert to_plain(from_plain(Hazard, plain)) == plain
    with pytest.raises(DataError, match='no Hazard'):
        from_plain(Hazard, plain | change)
