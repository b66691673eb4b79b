# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
The summary: spans, supports, hazards, vehicle and health in a few hundred bytes a second.

A message holds rows that changed, the keys of those that are gone, and all rows of one turn, which
replace what was known of it: after all turns a receiver has everything, whatever it missed.
Lengths are whole millimetres.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
import math
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plc_inspect.errors import DataError
from plc_inspect.results import Float64, Hazard, Span, Support
from plc_inspect.stream.curve_check import check_curves, check_places, NO_LENGTH
from plc_inspect.stream.frame import (
    BodyReader,
    Frame,
    SUMMARY,
    unpack_frame,
)
from plc_inspect.stream.nearness import NEARNESS, Nearness, read_nearness

HELD = 2
"""Flag of a message whose hazards are held back."""
TURNS = 12
"""
Turns in which a stream tells all rows again.
Source: derivation: at least every second message has a turn, so the last 24 messages, which the
topic keeps, have them all; one turn of 300 spans is a kilobyte, 30 ms of 256 kbit/s.
"""
MOST_LINES = 16
"""Lines of a support that are named; the number of all of them is told too."""
LAST_LINE = (1 << 15) - 1
"""Lines of greater numbers are not named at supports, as there are 16 bits for each."""
_XYZ = [('x', '<i4'), ('y', '<i4'), ('z', '<i4')]
SPANS = np.dtype([
    ('line_id', '<i4'), ('span_id', '<i4'),
    *((f'{end}_{axis}', '<i4') for end in ('start', 'end') for axis in 'xyz'),
    ('a', '<f4'), ('b', '<f4'), ('c', '<f4'), ('sag', '<u4'), ('rmse', '<u2'),
    ('sigma_sag', '<u2'), ('coverage', 'u1'), ('num_points', '<u4'), ('flags', 'u1'),
    ('ground_clearance', '<i4'),
])
SUPPORTS = np.dtype([
    ('support_id', '<i4'), *_XYZ, ('height', '<u4'), ('kind', 'u1'), ('num_lines', 'u1'),
    ('lines', '<i2', (MOST_LINES,)),
])
HAZARDS = np.dtype([
    ('hazard_id', '<i4'), ('line_id', '<i4'), ('span_id', '<i4'), ('kind', 'u1'),
    ('severity', 'u1'), *_XYZ,
    *((name, '<i4') for name in ('clearance', 'required', 'horizontal', 'vertical', 'sigma',
                                 'along_span', 'from_support', 'height')),
    ('support_id', '<i4'), ('num_points', '<u4'), ('confidence', 'u1'),
])
TABLES = {'spans': SPANS, 'supports': SUPPORTS, 'hazards': HAZARDS}
KEYS = {
    'spans': ('line_id', 'span_id'), 'supports': ('support_id',), 'hazards': ('hazard_id',),
}
OPEN_START, OPEN_END, FINISHED = 1, 2, 4
SUPPORT_KINDS = ('unseen', 'tower', 'pole')
STATUSES = ('input', 'map', 'segmentation')
ERROR = 2
"""Greatest level of a status; 0 good, 1 warning."""
LATEST = (1 << 31) * 1_000_000_000
"""Stamps are within this of 0 [ns], as the seconds of ROS have 32 bits."""
NOT_READY = 'NOT READY'
"""So begins the text of a node that looks for nothing yet."""
HEALTH = {
    'scan_rate': ('input', 'scan rate [Hz]'),
    'scans': ('input', 'scans'),
    'scans_inserted': ('input', 'scans inserted'),
    'scans_lost': ('input', 'scans lost'),
    'scans_dropped': ('input', 'scans dropped'),
    'pose_gaps': ('input', 'pose gaps'),
    'pose_jumps': ('input', 'pose jumps'),
    'malformed': ('input', 'messages malformed'),
    'clock_jumps': ('input', 'clock jumps'),
    'scan_age': ('input', 'age of the last scan [s]'),
    'odometry_age': ('input', 'age of the last odometry [s]'),
    'voxels': ('map', 'voxels'),
    'max_voxels': ('map', 'voxels at most'),
    'voxels_evicted': ('map', 'voxels evicted'),
    'sharpness': ('map', 'sharpness, 0.5 at least'),
    'memory_mb': ('map', 'resident memory [MB]'),
    'ticks': ('segmentation', 'ticks'),
    'ticks_postponed': ('segmentation', 'ticks postponed'),
    'ticks_failed': ('segmentation', 'ticks failed'),
    'tick_ms': ('segmentation', 'last tick [ms]'),
    'callback_ms': ('segmentation', 'callbacks p99 [ms]'),
}
"""Numbers of health, each with its status and key in /diagnostics; NaN where there is none."""
_FIXED = struct.Struct(f'<qIIHIiiifII{len(STATUSES)}B{len(HEALTH)}f')
_TURN = struct.Struct('<BB')
_NEVER = 0xFFFFFFFF

RowKey = tuple[int, ...]
_STEPS = (1, 5)
"""
By these the numbers of a key add up to its turn.
Source: derivation: without a common divisor with TURNS, so that the spans of one conductor, and
the conductors of one span, are spread over the turns.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SummaryTables:
    """Rows of everything that is known."""

    spans: NDArray[Any] = field(default_factory=lambda: np.empty(0, SPANS))
    supports: NDArray[Any] = field(default_factory=lambda: np.empty(0, SUPPORTS))
    hazards: NDArray[Any] = field(default_factory=lambda: np.empty(0, HAZARDS))


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """How the node is, and where the vehicle is."""

    stamp_ns: int = 0
    """Stamp of the newest scan that is in the tables [ns], 0 none."""
    tick_uptime: float = math.nan
    """Steady time of the node when the tables were made [s], NaN never."""
    vehicle_uptime: float = math.nan
    """Steady time of the node when the position came in [s], NaN never."""
    resets: int = 0
    """How often the node was told to forget everything."""
    cloud_sent: int = 0
    """Messages of the thinned corridor that the session sent so far."""
    vehicle: tuple[float, float, float] | None = None
    """Position in the frame of the tables [m]."""
    heading: float = math.nan
    """Direction of the vehicle's x axis in plan, from x towards y [rad], NaN unknown."""
    near_uptime: float = math.nan
    """Steady time of the node when the distances of ``near`` were measured [s], NaN never."""
    near: tuple[Nearness, ...] = ()
    """How near the vehicle is to each kind of thing."""
    held: bool = False
    """Hazards are held back as the map is not sharp: their table is empty, and none cleared."""
    health_uptime: float = math.nan
    """Steady time of the node when the health was taken [s], NaN never."""
    levels: tuple[int, ...] = (0,) * len(STATUSES)
    """Of STATUSES: 0 good, 1 warning, 2 error."""
    health: Mapping[str, float] = field(default_factory=dict)
    """Numbers by the names of HEALTH."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SummaryMessage:
    """What one message says."""

    frame: Frame
    status: Status
    turn: int
    turns: int
    """Of so many turns it holds all rows of this one; 0 none, 1: it holds everything."""
    tables: SummaryTables
    """Rows that are new or changed, and those of the turn."""
    gone: Mapping[str, tuple[RowKey, ...]]
    """Keys of rows that are no more, by table."""
    texts: tuple[str, ...] | None
    """Frame of the coordinates, then a text for each of STATUSES; None: as before."""


def make_tables(
    spans: Sequence[tuple[Span, bool]], supports: Sequence[Support], hazards: Sequence[Hazard]
) -> SummaryTables:
    """
    Put results into rows.

    Parameters
    ----------
    spans : sequence of tuple
        Spans, and whether each was left behind.
    supports : sequence of Support
        With their lasting numbers.
    hazards : sequence of Hazard
        With their lasting numbers.

    Returns
    -------
    SummaryTables

    """
    tables = SummaryTables(
        spans=np.zeros(len(spans), SPANS), supports=np.zeros(len(supports), SUPPORTS),
        hazards=np.zeros(len(hazards), HAZARDS),
    )
    for row, (span, finished) in zip(tables.spans, spans, strict=True):
        for name in ('line_id', 'span_id', 'a', 'b', 'c', 'num_points'):
            row[name] = getattr(span, name)
        _put_place(row, span.start, 'start_')
        _put_place(row, span.end, 'end_')
        row['sag'] = max(0, _millimetres(span.sag))
        for name, value in (('rmse', span.rmse), ('sigma_sag', span.sigma['sag'])):
            row[name] = min(max(0, _millimetres(value)), 0xFFFF)
        row['coverage'] = round(100 * min(max(span.coverage, 0.0), 1.0))
        row['flags'] = (
            OPEN_START * span.open_start | OPEN_END * span.open_end | FINISHED * finished
        )
        row['ground_clearance'] = _millimetres(span.ground_clearance)
    for row, support in zip(tables.supports, supports, strict=True):
        row['support_id'] = support.support_id
        _put_place(row, support.position)
        row['height'] = max(0, _millimetres(support.height))
        row['kind'] = SUPPORT_KINDS.index(support.kind) if support.kind in SUPPORT_KINDS else 0
        row['num_lines'] = min(len(support.line_ids), 0xFF)
        row['lines'] = -1
        named = [line for line in support.line_ids if line <= LAST_LINE][:MOST_LINES]
        row['lines'][:len(named)] = named
    for row, hazard in zip(tables.hazards, hazards, strict=True):
        for name in ('hazard_id', 'line_id', 'span_id', 'kind', 'severity', 'support_id',
                     'num_points'):
            row[name] = getattr(hazard, name)
        _put_place(row, hazard.position)
        for name in ('required', 'horizontal', 'vertical', 'sigma', 'along_span',
                     'from_support', 'height'):
            row[name] = _millimetres(getattr(hazard, name))
        row['clearance'] = _millimetres(hazard.measured)
        row['confidence'] = round(100 * min(max(hazard.confidence, 0.0), 1.0))
    return tables


def metres(value: int) -> float:
    """Return a length of a row in metres, NaN where it is not known."""
    return math.nan if value == NO_LENGTH else int(value) * 1e-3


def read_summary(data: bytes) -> SummaryMessage:
    """
    Read a message of the summary.

    Parameters
    ----------
    data : bytes
        As SummaryWriter gave them.

    Returns
    -------
    SummaryMessage

    Raises
    ------
    DataError
        It is no such message, damaged, or holds a curve that cannot be or a row without position.

    """
    frame = unpack_frame(data, SUMMARY)
    reader = BodyReader(frame.body)
    turn, turns = reader.take_struct(_TURN)
    if turn >= max(turns, 1):
        raise DataError(f'summary of turn {turn} of {turns}')
    status = _read_status(reader)
    rows, gone = {}, {}
    for name, dtype in TABLES.items():
        rows[name] = reader.take_rows(dtype)
        gone[name] = tuple(keys_of(name, reader.take_rows(_key_dtype(name))))
    (count,) = reader.take(1)
    texts = tuple(reader.take_text() for _ in range(count)) if count else None
    near = read_nearness(reader.take_rows(NEARNESS))
    reader.finish()
    if texts is not None and len(texts) != 1 + len(STATUSES):
        raise DataError(f'summary with {len(texts)} texts, not {1 + len(STATUSES)}')
    check_curves(rows['spans'])
    for name in ('supports', 'hazards'):
        check_places(rows[name], *KEYS[name])
    return SummaryMessage(
        frame=frame, status=replace(status, near=near, held=bool(frame.flags & HELD)),
        turn=turn, turns=turns, tables=SummaryTables(**rows), gone=gone, texts=texts,
    )


def _millimetres(value: float) -> int:
    if not math.isfinite(value):
        return NO_LENGTH
    return max(1 - (1 << 31), min(round(value * 1e3), (1 << 31) - 1))


def _put_place(row: Any, place: Float64, prefix: str = '') -> None:
    for axis, value in zip('xyz', place.tolist(), strict=True):
        row[prefix + axis] = _millimetres(value)


def keys_of(table: str, rows: NDArray[Any]) -> list[RowKey]:
    """Return what the rows of a table are known by."""
    return list(zip(*(rows[name].tolist() for name in KEYS[table]), strict=True))


def find_turn(key: RowKey, turns: int) -> int:
    """Return the turn of a row, by its key."""
    return sum(step * number for step, number in zip(_STEPS, key, strict=False)) % turns


def pack_keys(table: str, keys: Sequence[RowKey]) -> NDArray[Any]:
    """Return keys of a table as rows."""
    return np.array(list(keys), dtype=_key_dtype(table))


def pack_status(status: Status, turn: int, turns: int) -> bytes:
    """Return the beginning of a message: its turn, and how the node is."""
    place = (math.nan,) * 3 if status.vehicle is None else status.vehicle
    return _TURN.pack(turn, turns) + _FIXED.pack(
        status.stamp_ns, _pack_time(status.tick_uptime), _pack_time(status.vehicle_uptime),
        status.resets & 0xFFFF, status.cloud_sent, *map(_millimetres, place),
        status.heading, _pack_time(status.near_uptime), _pack_time(status.health_uptime),
        *status.levels, *(status.health.get(name, math.nan) for name in HEALTH),
    )


def _key_dtype(table: str) -> np.dtype[Any]:
    return np.dtype([(name, '<i4') for name in KEYS[table]])


def _read_status(reader: BodyReader) -> Status:
    values = reader.take_struct(_FIXED)
    stamp_ns, tick, vehicle, resets, cloud_sent, *place = values[:8]
    heading, near, health = values[8:11]
    levels = values[11:11 + len(STATUSES)]
    if not -LATEST <= stamp_ns < LATEST or max(levels) > ERROR:
        raise DataError(f'summary with stamp {stamp_ns} ns and levels {levels}')
    return Status(
        stamp_ns=stamp_ns, tick_uptime=_read_time(tick), vehicle_uptime=_read_time(vehicle),
        resets=resets, cloud_sent=cloud_sent, heading=heading, near_uptime=_read_time(near),
        health_uptime=_read_time(health),
        vehicle=None if NO_LENGTH in place else (
            metres(place[0]), metres(place[1]), metres(place[2])
        ),
        levels=levels,
        health=dict(zip(HEALTH, values[11 + len(STATUSES):], strict=True)),
    )


def _pack_time(seconds: float) -> int:
    return _NEVER if math.isnan(seconds) else min(round(seconds * 1e3), _NEVER - 1)


def _read_time(milliseconds: int) -> float:
    return math.nan if milliseconds == _NEVER else milliseconds * 1e-3
