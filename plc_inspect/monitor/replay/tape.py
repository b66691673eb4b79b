# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The stream of a recorded flight, from a record or from a results folder."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
import json
from pathlib import Path
from typing import Any

from mcap.reader import NonSeekingReader
import numpy as np
from rosbags.typesys import get_typestore, Stores

from plc_inspect.errors import DataError
from plc_inspect.flight_record.layout import SUFFIX
from plc_inspect.offline.records.results_reader import (
    parse_hazard,
    parse_span,
    parse_units,
    read_points,
    read_run,
    read_table,
    understanding,
)
from plc_inspect.printable import make_one_line
from plc_inspect.results import Float32, Float64, Support, UInt8
from plc_inspect.stream.blocks import BlockKey, pack_blocks, thin_points, UInt64
from plc_inspect.stream.frame import CLOUD, Frame, pack_frame
from plc_inspect.stream.summary import make_tables, Status
from plc_inspect.stream.summary_writer import EVERYTHING, SummaryWriter

SUMMARY_TAIL, CLOUD_TAIL, SEEN_TAIL = '/summary', '/thin_corridor', '/acknowledged'
VOXEL = 0.5
"""Edge of the cells to which points of a results folder are thinned, as the node does [m]."""
BLOCKS_AT_ONCE = 200
FARTHEST, ROUND = 2_000_000.0, 1000.0
"""
Limit of coordinates, as the stream holds millimetres in 32 bits, and the step of the origin that
is used beyond it [m].
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """One message."""

    time: float
    """Time since the first message [s]."""
    kind: str
    """'summary', 'cloud' or 'seen'."""
    data: bytes
    """Message of the stream; JSON for 'seen'."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """An acknowledgement."""

    number: int
    """Number of the alarm in the monitor that recorded; a replay may count otherwise."""
    key: str
    """Key of its cause, '' unknown."""
    who: str
    stood: bool
    """Whether the alarm stood then."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tape:
    """All messages of a flight."""

    name: str
    """Name of the node or of the folder."""
    start: float
    """Time of day of the first message [s since 1970], 0 unknown."""
    entries: tuple[Entry, ...]
    note: str = ''
    """Note for the user."""

    @property
    def length(self) -> float:
        """Time of the last message [s]."""
        return self.entries[-1].time


def read_tape(path: Path, node: str = '') -> Tape:
    """
    Read a record of ``plc_monitor --record``, or a results folder.

    Parameters
    ----------
    path : Path
        MCAP file, or folder.
    node : str
        Vehicle of a record, by the name of its node; '' for the only one.

    Returns
    -------
    Tape

    Raises
    ------
    DataError
        It is neither, or damaged before its first summary, or holds not that vehicle, or several.

    """
    if path.is_dir() and path.suffix == SUFFIX:
        raise DataError(
            f'{path} is the flight record of a node: "plc_recover {path} -o OUT" makes a results '
            'folder of it, which can be opened'
        )
    if path.is_dir() and node:
        raise DataError(f'{path} is a results folder: --node is for records of plc_monitor')
    return _read_folder(path) if path.is_dir() else _read_record(path, node.rstrip('/'))


def _read_record(path: Path, node: str) -> Tape:
    found: list[tuple[int, str, str, bytes]] = []
    note = ''
    store = get_typestore(Stores.ROS2_JAZZY)
    kinds = {SUMMARY_TAIL: 'summary', CLOUD_TAIL: 'cloud', SEEN_TAIL: 'seen'}
    try:
        with path.open('rb') as stream:
            for schema, channel, message in NonSeekingReader(stream).iter_messages(
                log_time_order=False  # what comes before damage is read
            ):
                tail = '/' + channel.topic.rpartition('/')[2]
                if tail not in kinds or schema is None:
                    continue
                message_found: Any = store.deserialize_cdr(message.data, schema.name)
                value = message_found.data
                data = value.encode() if isinstance(value, str) else value.tobytes()
                found.append((message.log_time, kinds[tail], channel.topic, data))
    except Exception as error:  # mcap and rosbags pass errors of struct, zstd and others on
        if not any(kind == 'summary' for _, kind, _, _ in found):
            raise DataError(f'{path} cannot be read: {make_one_line(error)}') from error
        note = 'the file is damaged: what comes behind is missing'
    names = sorted({topic.rpartition('/')[0] for _, kind, topic, _ in found if kind == 'summary'})
    if not names:
        raise DataError(f'{path} holds no {SUMMARY_TAIL[1:]}: it is not a record of plc_monitor')
    if node not in names and (node or len(names) > 1):
        raise DataError(f'{path} is to be opened with --node {" or --node ".join(names)}')
    node = node or names[0]
    found = [item for item in found if item[2].rpartition('/')[0] == node]
    found.sort(key=lambda item: item[0])
    first = found[0][0]
    return Tape(name=node, start=first * 1e-9, note=note, entries=tuple(
        Entry(time=(stamp - first) * 1e-9, kind=kind, data=data) for stamp, kind, _, data in found
    ))


def _read_folder(folder: Path) -> Tape:
    spans, supports, hazards = (
        read_table(folder, name) for name in ('spans', 'supports', 'hazards')
    )
    with understanding(folder / 'spans.json'):
        units = parse_units(spans['metres_per_unit'])
        own = [(parse_span(row, units), True) for row in spans['spans']]
        frame = str(spans['frame_id'] or spans['crs'] or '')
    with understanding(folder / 'hazards.json'):
        raised = [parse_hazard(row, units) for row in hazards['hazards']]
    with understanding(folder / 'supports.json'):
        standing = [
            Support(
                support_id=row['support_id'], kind=row['kind'], line_ids=tuple(row['lines']),
                position=units.to_metres(np.array(row['position'], np.float64)),
                height=(row['height'] or 0.0) * units.vertical,
            ) for row in supports['supports']
        ]
    held = str(read_run(folder).get('held_back', ''))
    las, points = read_points(folder, 'clearance')
    points = units.to_metres(points)
    shift = _find_shift([span.start for span, _ in own] or list(points[:1]))
    note = '; '.join(filter(None, (
        f'positions from {shift[0]:.0f} {shift[1]:.0f}' if shift.any() else '', held,
    )))
    own = [(
        replace(span, start=span.start - shift, end=span.end - shift, lowest=span.lowest - shift),
        finished,
    ) for span, finished in own]
    raised = [replace(item, position=item.position - shift) for item in raised]
    standing = [replace(item, position=item.position - shift) for item in standing]
    points = points - shift
    kind = np.asarray(las.classification, dtype=np.uint8)
    clearance = (np.asarray(las['clearance'], np.float64) * units.horizontal).astype(np.float32)
    writer = SummaryWriter(0)
    summary = writer.write(
        make_tables(own, standing, raised),
        Status(stamp_ns=1, tick_uptime=0.0, health_uptime=0.0, held=bool(held),
               levels=(0, 2 if held else 0, 0)),
        (frame, '', held, ''), 0.0, EVERYTHING,
    )
    clouds = tuple(
        Entry(time=0.0, kind='cloud', data=data)
        for data in _pack_points(points, kind, clearance)
    )
    return Tape(name=folder.resolve().name, start=0.0, note=note, entries=(
        Entry(time=0.0, kind='summary', data=summary), *clouds
    ))


def _find_shift(places: list[Float64]) -> Float64:
    """Return the offset (3,) subtracted from all places [m], 0 if they are near enough."""
    if not places or np.abs(places).max() <= FARTHEST:
        return np.zeros(3)
    first = np.floor(np.min(places, axis=0) / ROUND) * ROUND
    return np.array([first[0], first[1], 0.0])


def _pack_points(points: Float64, kind: UInt8, clearance: Float32) -> Iterator[bytes]:
    """Return the points that have a clearance as corridor messages of the stream."""
    near = np.isfinite(clearance)
    cells = thin_points(points[near], kind[near], clearance[near], VOXEL)
    blocks: list[tuple[BlockKey, UInt64]] = [
        ((int(key[0]), int(key[1])), cells.codes[low:high])
        for key, low, high in zip(cells.blocks, cells.starts, cells.starts[1:], strict=False)
    ]
    for number, first in enumerate(range(0, len(blocks), BLOCKS_AT_ONCE)):
        part = dict(blocks[first:first + BLOCKS_AT_ONCE])
        yield pack_frame(Frame(
            kind=CLOUD, flags=0, session=0, sequence=number, uptime=0.0,
            body=pack_blocks(part, overview=False, voxel=VOXEL, total=len(blocks)),
        ))


def read_seen(data: bytes) -> Seen | None:
    """Return an acknowledgement, None if the note is malformed."""
    try:
        note = json.loads(data)
        return Seen(number=int(note['alarm']), key=str(note.get('what', '')),
                    who=str(note['who']), stood=bool(note.get('stands', True)))
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
