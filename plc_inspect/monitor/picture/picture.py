# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The picture: what a monitor knows at one moment, for terminal, page and scripts."""

from collections.abc import Mapping
from dataclasses import dataclass
import enum
import math
from typing import Any

import numpy as np

from plc_inspect.monitor.picture.alarms import Alarm
from plc_inspect.results import catenary_heights, Float64, HazardKind, Severity
from plc_inspect.stream.nearness import Nearness
from plc_inspect.stream.summary import (
    FINISHED,
    metres,
    OPEN_END,
    OPEN_START,
    STATUSES,
    SUPPORT_KINDS,
)

Place = tuple[float, float, float]


ERROR = 2
"""Level of diagnostics."""
STALE = 5.0
"""Age from which a value is marked as stale [s]."""
PAUSE = 2.0
"""Pause after which scans or poses count as stopped, as in the node [s]."""


class Link(enum.Enum):
    """State of the link to the node."""

    WAITING = 'waiting'
    """Nothing has been received yet."""
    LIVE = 'live'
    LATE = 'late'
    """The next message is overdue."""
    LOST = 'lost'


@dataclass(frozen=True, slots=True, kw_only=True)
class SpanItem:
    """One conductor between two supports; lengths in metres."""

    line_id: int
    span_id: int
    start: Place
    end: Place
    length: float
    """Horizontal distance from start to end."""
    a: float
    b: float
    c: float
    """z(x) = a + c cosh((x - b) / c), x from start towards end."""
    sag: float
    sigma_sag: float
    rmse: float
    coverage: float
    """Share of the length with points, 0 to 1."""
    num_points: int
    ground_clearance: float
    """Least height above ground, NaN unknown."""
    open_start: bool
    open_end: bool
    finished: bool
    """The vehicle has left it behind."""
    severity: int
    """Of its worst hazard, 0 none."""

    @property
    def key(self) -> tuple[int, int]:
        """line_id and span_id."""
        return self.line_id, self.span_id

    @property
    def lowest(self) -> Place:
        """Lowest point of the curve between its ends [m]."""
        x, y, z = self.positions(np.array([min(max(self.b, 0.0), self.length)]))[0].tolist()
        return x, y, z

    def positions(self, x: Float64) -> Float64:
        """Return points (N, 3) of the curve at distances x (N,) from the start [m]."""
        start, end = np.array(self.start), np.array(self.end)
        unit = (end - start)[:2] / max(self.length, 1e-9)
        heights = catenary_heights(self.a, self.b, self.c, x)
        return np.column_stack((start[:2] + x[:, None] * unit, heights))

    def trace(self, step: float = 5.0) -> Float64:
        """Return (N, 3) points along the curve, about a step apart [m]."""
        num = max(2, min(64, int(self.length / step))) + 1
        return self.positions(np.linspace(0.0, self.length, num))


@dataclass(frozen=True, slots=True, kw_only=True)
class SupportItem:
    """A tower or pole."""

    support_id: int
    position: Place
    """Foot [m]."""
    height: float
    kind: str
    num_lines: int
    lines: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class HazardItem:
    """One place where a clearance rule is broken; lengths in metres, NaN unknown."""

    hazard_id: int
    line_id: int
    span_id: int
    kind: str
    severity: int
    position: Place
    clearance: float
    """What its rule measures."""
    required: float
    horizontal: float
    vertical: float
    sigma: float
    along_span: float
    from_support: float
    support_id: int
    height: float
    num_points: int
    confidence: float
    """Probability that its severity is true, 0 to 1."""

    @property
    def measured(self) -> float:
        """As of a `Hazard`: the link tells this alone."""
        return self.clearance

    @property
    def severity_name(self) -> str:
        """Notice, warning or critical, in small letters."""
        return name_severity(self.severity)


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """An entry of the log of events."""

    time: float
    """Steady time of the monitor [s]."""
    level: int
    """0 information, 1 warning, 2 alarm."""
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Ages:
    """Ages of the data [s], NaN where there is none."""

    link: float
    """Since the last message of the summary."""
    data: float
    """Since the node made the tables."""
    vehicle: float
    near: float
    """Since the node measured how near the vehicle is."""
    health: float
    cloud: float
    """Since the last message of the thinned corridor."""
    delay: float
    """Delay of the last message over the quickest one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Counts:
    """Counts of received, lost and refused messages."""

    messages: int = 0
    bytes: int = 0
    kbps: float = 0.0
    """Rate over the last ten seconds, without network overhead."""
    lost_summary: int = 0
    """Messages that are missing."""
    lost_cloud: int = 0
    malformed: int = 0
    foreign: int = 0
    """Messages of another node of the same name, not taken."""
    forged: int = 0
    """Messages that the node did not send: without its signature, or with an impossible number."""
    replayed: int = 0
    """Repeated messages: received before, or of an earlier run of the node."""
    reordered: int = 0
    """Messages that came after newer ones."""
    restarts: int = 0
    """Times the node restarted or was reset."""

    def describe_refused(self) -> str:
        """Return what was refused and why, '' if nothing."""
        names = ('forged', 'replayed', 'reordered', 'foreign')
        found = [f'{count} {name}' for name in names if (count := getattr(self, name))]
        return f'refused {", ".join(found)}' if found else ''


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Picture:
    """Everything known at one moment; immutable."""

    time: float
    """Steady time of the monitor [s]."""
    link: Link
    session: int | None
    complete: bool
    """All rows that the node announced have arrived."""
    ages: Ages
    counts: Counts
    frame_id: str
    stamp_ns: int
    """Stamp of the newest scan in the map [ns], 0 none."""
    spans: tuple[SpanItem, ...]
    """Worst first, then by line and span."""
    supports: tuple[SupportItem, ...]
    hazards: tuple[HazardItem, ...]
    """Worst first, then nearest to the conductor; the last known ones while held back."""
    held: bool
    """The node holds hazards back."""
    vehicle: Place | None
    heading: float
    """Direction of the vehicle's x axis in plan, from x towards y [rad], NaN unknown."""
    height: float
    """Height of the vehicle above the ground below it [m], NaN unknown."""
    flown: float
    """Length of the track [m]."""
    stood: float
    """Time since the vehicle last moved [s]."""
    near: tuple[Nearness, ...]
    """Distances of the vehicle to conductors, supports and other points."""
    track: tuple[Place, ...]
    """Past positions of the vehicle."""
    levels: tuple[int, ...]
    """Levels of the node's diagnostics: 0 good, 1 warning, 2 error."""
    texts: tuple[str, ...]
    health: Mapping[str, float]
    """As the node told it last."""
    cloud_blocks: int
    """Blocks of the thinned corridor received."""
    cloud_total: int
    """Blocks that the node has."""
    cloud_cells: int
    events: tuple[Event, ...]
    """Oldest first."""
    alarms: tuple[Alarm, ...]
    """Open alarms, unacknowledged first."""
    past_alarms: tuple[Alarm, ...]
    """Closed alarms, newest first."""
    others: tuple[str, ...] = ()
    """Nodes on the graph, while nothing was heard of this one."""

    @property
    def problem(self) -> str:
        """Why the node finds nothing, or nothing reliable; '' if it is well."""
        return next(
            (text or 'the node is in error'
             for level, text in zip(self.levels, self.texts, strict=False) if level >= ERROR), '',
        )

    @property
    def health_now(self) -> dict[str, float]:
        """Health as it is now: ages also grow while nothing is heard of the node."""
        ages = {
            name: self.health.get(name, math.nan) + self.ages.health
            for name in ('scan_age', 'odometry_age')
        }
        rate = math.nan if ages['scan_age'] > PAUSE else self.health.get('scan_rate', math.nan)
        return {**self.health, **ages, 'scan_rate': rate}

    @property
    def held_back(self) -> str:
        """Why the node holds hazards back; '' if it does not."""
        if not self.held:
            return ''
        place = STATUSES.index('map')
        told = self.texts[place] if self.levels[place] >= ERROR else ''
        return told or 'map is not sharp; hazards are held back'

    def count_severities(self) -> dict[str, int]:
        """
        Return how many hazards and proximities are critical, and how many hazards are warnings.

        A critical one raises an alarm, which may arrive before the tables hold it.
        """
        return {
            'critical': sum(item.stands for item in self.alarms),
            'warning': sum(item.severity == Severity.WARNING for item in self.hazards),
        }


def format_age(seconds: float) -> str:
    """Return a short text of an age, such as ``0.4 s`` or ``3 min``."""
    if math.isnan(seconds):
        return 'none'
    if seconds < 10.0:
        return f'{seconds:.1f} s'
    if seconds < 120.0:
        return f'{seconds:.0f} s'
    return f'{seconds / 60:.0f} min' if seconds < 7200.0 else f'{seconds / 3600:.1f} h'


def name_severity(severity: int) -> str:
    """Return the name of a severity in small letters, ``ok`` for none."""
    return Severity(severity).name.lower() if severity in list(Severity) else 'ok'


def make_span(row: Any, severity: int) -> SpanItem:
    """Turn a row of the summary into a span."""
    start, end = _read_place(row, 'start_'), _read_place(row, 'end_')
    flags = int(row['flags'])
    return SpanItem(
        line_id=int(row['line_id']), span_id=int(row['span_id']), start=start, end=end,
        length=math.hypot(end[0] - start[0], end[1] - start[1]),
        a=float(row['a']), b=float(row['b']), c=float(row['c']), sag=int(row['sag']) * 1e-3,
        sigma_sag=int(row['sigma_sag']) * 1e-3, rmse=int(row['rmse']) * 1e-3,
        coverage=int(row['coverage']) / 100.0, num_points=int(row['num_points']),
        ground_clearance=metres(row['ground_clearance']), open_start=bool(flags & OPEN_START),
        open_end=bool(flags & OPEN_END), finished=bool(flags & FINISHED), severity=severity,
    )


def make_support(row: Any) -> SupportItem:
    """Turn a row of the summary into a support."""
    kind = int(row['kind'])
    return SupportItem(
        support_id=int(row['support_id']), position=_read_place(row),
        height=int(row['height']) * 1e-3,
        kind=SUPPORT_KINDS[kind] if kind < len(SUPPORT_KINDS) else 'unseen',
        num_lines=int(row['num_lines']),
        lines=tuple(line for line in row['lines'].tolist() if line >= 0),
    )


def make_hazard(row: Any) -> HazardItem:
    """Turn a row of the summary into a hazard."""
    kind = int(row['kind'])
    return HazardItem(
        hazard_id=int(row['hazard_id']), line_id=int(row['line_id']),
        span_id=int(row['span_id']),
        kind=HazardKind(kind).name.lower() if kind in list(HazardKind) else f'kind {kind}',
        severity=int(row['severity']), position=_read_place(row),
        clearance=metres(row['clearance']), required=metres(row['required']),
        horizontal=metres(row['horizontal']), vertical=metres(row['vertical']),
        sigma=metres(row['sigma']), along_span=metres(row['along_span']),
        from_support=metres(row['from_support']), support_id=int(row['support_id']),
        height=metres(row['height']), num_points=int(row['num_points']),
        confidence=int(row['confidence']) * 1e-2,
    )


def _read_place(row: Any, prefix: str = '') -> Place:
    return metres(row[f'{prefix}x']), metres(row[f'{prefix}y']), metres(row[f'{prefix}z'])
