# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What the node says of itself: /diagnostics, and the log lines about what was lost."""

from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
import os
from pathlib import Path
import time

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
import numpy as np

from plc_inspect.core.extraction.dust import describe_air
from plc_inspect.core.live.session import LiveState
from plc_inspect.core.mapping.scan_counters import Counters
from plc_inspect.core.setup.sharpness import ON_TRUST
from plc_inspect.core.voxel_buffer.voxel_map import VoxelMap
from plc_inspect.flight_record.recording import Condition
from plc_inspect.ros.graph.transport import ADVICE
from plc_inspect.ros.results.teller import count_found
from plc_inspect.stream.summary import NOT_READY

SILENCE = 2.0
"""Scans or odometry that pause longer are reported [s]."""
WINDOW = 4000
"""Durations of callbacks that the percentiles are taken from."""


@dataclass(slots=True)
class Health:
    """Counts and times of the node's life; owned by the executor's thread."""

    malformed: Counter[str] = field(default_factory=Counter)
    """Messages that could not be used, by topic."""
    problems: dict[str, str] = field(default_factory=dict)
    """Why the newest of them could not be used, by topic."""
    hints: dict[str, str] = field(default_factory=dict)
    """Why no 'scan' or no 'odometry' comes in, where the graph tells."""
    mount: str = ''
    """How the lidar is mounted, once a scan is in."""
    mount_doubt: str = ''
    odometry: str = ''
    """What is wrong with the odometry, '' if nothing."""
    """What does not fit about it."""
    num_ticks: int = 0
    num_postponed: int = 0
    """Ticks that fell due while another ran, and were taken up after it."""
    num_failed: int = 0
    num_clock_jumps: int = 0
    messages_lost: int = 0
    """Messages that the middleware says it lost."""
    last_error: str = ''
    last_scan: float | None = None
    """Steady time of the last scan [s]."""
    last_pose: float | None = None
    preparing: float | None = field(default_factory=time.monotonic)
    """Steady time since which the node gets ready to look for anything [s], None: it is."""
    _durations: dict[str, deque[float]] = field(default_factory=dict)

    @contextmanager
    def measure(self, name: str) -> Iterator[None]:
        """Take the wall time of a callback."""
        started = time.perf_counter()
        try:
            yield
        finally:
            own = self._durations.setdefault(name, deque(maxlen=WINDOW))
            own.append(time.perf_counter() - started)

    def percentiles(self) -> dict[str, tuple[float, float, float]]:
        """Return median, p99 and greatest time of each callback [s]."""
        result = {}
        for name, own in sorted(self._durations.items()):
            middle, high = np.percentile(own, [50, 99])
            result[name] = float(middle), float(high), float(max(own))
        return result

    def find_causes(self, problems: Mapping[str, str]) -> dict[str, str]:
        """Return problems with messages, and why no poses come in where tf or the graph tells."""
        hint = self.hints.get('odometry', '')
        causes = {'poses': hint} if hint and 'odometry' not in problems else {}
        return {**problems, **causes}

    def all_durations(self) -> list[float]:
        """Return the durations of all callbacks that are remembered [s]."""
        return [value for own in self._durations.values() for value in own]


class LossReporter:
    """
    Says what was lost since it was last asked, so that each loss is logged once and counted.

    Parameters
    ----------
    say : callable
        Takes a line of text.

    """

    def __init__(self, say: Callable[[str], object]) -> None:
        self._say = say
        self._before: dict[str, int] = {}

    def skip(self, counters: Counters) -> None:
        """Take what was lost so far as told."""
        self._before = dict(_losses(counters))

    def report(self, counters: Counters) -> bool:
        """Log what was lost since the last call; return whether anything was."""
        now = dict(_losses(counters))
        news = {
            name: count - self._before.get(name, 0)
            for name, count in now.items() if count > self._before.get(name, 0)
        }
        self._before = now
        for name, count in news.items():
            advice = f'; {ADVICE}' if name == _LOST else ''
            self._say(f'{count} {name} ({now[name]} so far){advice}')
        return bool(news)


_LOST = 'scans lost on the way, seen from their stamps'


def _losses(counters: Counters) -> Iterator[tuple[str, int]]:
    for reason, count in counters.scans_dropped.items():
        yield f'scans dropped: {reason}', count
    for reason, count in counters.poses_rejected.items():
        yield f'poses rejected: {reason}', count
    yield _LOST, counters.num_scans_lost
    yield 'interruptions of the scans', counters.num_interruptions
    yield 'gaps in the odometry', counters.num_pose_gaps
    yield 'jumps of the odometry', counters.num_pose_jumps
    yield 'restarts of the odometry, whose time went back', counters.num_pose_restarts
    yield 'scans without times of their points', counters.num_scans_without_time
    yield 'new beginnings of the map', counters.num_map_restarts
    if 'map full' in counters.points_dropped:
        yield 'points refused, map full', counters.points_dropped['map full']


def describe_input(
    counters: Counters, health: Health, now: float, lossy: bool, found: tuple[str, str],
) -> DiagnosticStatus:
    """
    Describe scans and odometry.

    Parameters
    ----------
    counters : Counters
        Of the accumulator.
    health : Health
        Of the node.
    now : float
        Steady time [s].
    lossy : bool
        Something was lost since the last report.
    found : tuple of str
        What makes the input useless, and what is doubtful; as from ``InputWatch``.

    Returns
    -------
    DiagnosticStatus

    """
    ages = {
        name: None if last is None else now - last
        for name, last in (('scan', health.last_scan), ('odometry', health.last_pose))
    }
    missing = [name for name, age in ages.items() if age is None or age > SILENCE]
    level, text = DiagnosticStatus.OK, 'scans and odometry come in'
    if missing:
        hints = [health.hints[name] for name in missing if health.hints.get(name)]
        text = '; '.join([f'no {" and no ".join(missing)}', *hints])
        level = DiagnosticStatus.ERROR
    elif found[0]:
        level, text = DiagnosticStatus.ERROR, found[0]
    elif doubts := '; '.join(item for item in (
        found[1], health.mount_doubt, health.odometry,
    ) if item):
        level, text = DiagnosticStatus.WARN, doubts
    elif lossy:
        level, text = DiagnosticStatus.WARN, 'something was lost'
        if counters.num_scans_lost:
            text = f'{counters.num_scans_lost} scans lost so far; {ADVICE}'
    period = counters.scan_period
    first = {'mount of the lidar': health.mount} if health.mount else {}
    values: dict[str, object] = first | {
        'scan rate [Hz]': 'unknown' if not period else round(1.0 / period, 2),
        'scans': counters.num_scans,
        'scans inserted': counters.num_scans_inserted,
        'scans waiting': counters.num_scans_waiting,
        'scans lost': counters.num_scans_lost,
        'scans dropped': sum(counters.scans_dropped.values()),
        'interruptions': counters.num_interruptions,
        'poses': counters.num_poses,
        'poses rejected': sum(counters.poses_rejected.values()),
        'pose gaps': counters.num_pose_gaps,
        'pose jumps': counters.num_pose_jumps,
        'pose restarts': counters.num_pose_restarts,
        'messages lost by the middleware': health.messages_lost,
        'messages malformed': sum(health.malformed.values()),
        'clock jumps': health.num_clock_jumps,
        'map restarts': counters.num_map_restarts,
        'scans ahead of odometry [s]': (
            'unknown' if counters.stamp_lead is None else round(counters.stamp_lead, 3)
        ),
        'odometry rate [Hz]': (
            'unknown' if not counters.pose_period else round(1.0 / counters.pose_period, 1)
        ),
    }
    for name, age in ages.items():
        values[f'age of the last {name} [s]'] = 'none yet' if age is None else round(age, 2)
    for reason, count in counters.scans_dropped.items():
        values[f'scans dropped: {reason}'] = count
    for reason, count in counters.poses_rejected.items():
        values[f'poses rejected: {reason}'] = count
    return _make_status('input', level, text, values)


def describe_map(
    voxels: VoxelMap, num_evicted: int, refused: int, doubt: str, state: LiveState | None,
    ticks: int | None = None,
) -> DiagnosticStatus:
    """
    Describe size and sharpness of the map, and the size of this process and that of the ticks.

    A doubt about the map is an error, and so is a map that is not sharp.  Where that is not known,
    hazards are a warning, as dusty air is, and what leans.
    """
    share = len(voxels) / voxels.max_voxels
    sharpness = state.sharpness if state else None
    level, text = DiagnosticStatus.OK, f'{share:.0%} of the map in use'
    if doubt:
        level, text = DiagnosticStatus.ERROR, doubt
    elif sharpness is not None and sharpness.poor:
        level, text = DiagnosticStatus.ERROR, sharpness.describe()
    elif refused:
        level, text = DiagnosticStatus.WARN, f'map full: {refused} points were refused'
    elif state is not None and state.hazards and not state.sharpness.known:
        level, text = DiagnosticStatus.WARN, ON_TRUST
    if state is not None:
        for remark in filter(None, (state.sharpness.remark, describe_air(state.stages))):
            level, text = max(level, DiagnosticStatus.WARN), f'{text}; {remark}'
    values: dict[str, object] = {
        'voxels': len(voxels),
        'voxels at most': voxels.max_voxels,
        'voxels evicted': num_evicted,
        'points refused': refused,
        'map memory [MB]': round(voxels.nbytes / 1e6, 1),
        'resident memory [MB]': round(measure_memory(ticks) / 1e6, 1),
    }
    values['sharpness, 0.5 at least'] = 'unknown'
    if sharpness is not None and sharpness.known:
        values |= {
            'sharpness, 0.5 at least': round(sharpness.figure, 3),
            'things seen twice apart [m]': round(sharpness.distance, 4),
            'noise [m]': round(sharpness.noise, 4),
        }
    return _make_status('map', level, text, values)


def describe_segmentation(
    state: LiveState | None, health: Health, busy: bool
) -> DiagnosticStatus:
    """Describe the ticks and the times of callbacks."""
    level, text = DiagnosticStatus.OK, 'no tick yet'
    values: dict[str, object] = {
        'ticks': health.num_ticks,
        'ticks postponed': health.num_postponed,
        'ticks failed': health.num_failed,
        'busy': busy,
    }
    if state is not None:
        text = count_found(state)
        values |= {
            'lines': len({item.span.line_id for item in state.confirmed}),
            'spans': len(state.confirmed),
            'supports': len(state.supports),
            'hazards': 'held back' if state.sharpness.poor else len(state.hazards),
            'lines merged': state.num_merges,
            'last tick [ms]': round(state.seconds * 1e3, 1),
            'last tick voxels': state.num_points,
        }
        for stage in state.stages:
            values[f'stage {stage.name} [ms]'] = round(stage.seconds * 1e3, 1)
    if health.last_error:
        level, text = DiagnosticStatus.WARN, f'{text}; last error: {health.last_error}'
    if health.preparing is not None:  # scans that come in are kept, and nobody looks at them
        level = DiagnosticStatus.WARN if health.last_scan is None else DiagnosticStatus.ERROR
        text = (
            f'{NOT_READY}: preparing for {time.monotonic() - health.preparing:.0f} s, nothing '
            'is looked for yet; a first start takes minutes'
        )
    values['last error'] = health.last_error or 'none'
    for name, (middle, high, most) in health.percentiles().items():
        values[f'callback {name} [ms]: median, p99, greatest'] = (
            f'{middle * 1e3:.2f}, {high * 1e3:.2f}, {most * 1e3:.2f}'
        )
    durations = health.all_durations()
    if durations:
        values['callbacks p99 [ms]'] = round(float(np.percentile(durations, 99)) * 1e3, 2)
    return _make_status('segmentation', level, text, values)


def describe_record(condition: Condition) -> DiagnosticStatus:
    """Describe the flight record."""
    level = DiagnosticStatus.WARN if condition.problem else DiagnosticStatus.OK
    text = condition.problem or str(condition.values['record'])
    return _make_status('record', level, text, condition.values)


def sign(status: Iterable[DiagnosticStatus], node: str) -> None:
    """Put the node's full name in front, by which vehicles are told apart."""
    for item in status:
        item.hardware_id = node.lstrip('/')
        item.name = f'{item.hardware_id}: {item.name}'


def measure_memory(other: int | None = None) -> int:
    """Return the resident memory of this process, and what another one has besides [bytes]."""
    own, _ = _read_pages('self')
    more, shared = (0, 0) if other is None else _read_pages(str(other))
    return (own + more - shared) * os.sysconf('SC_PAGE_SIZE')


def _read_pages(process: str) -> tuple[int, int]:
    """Return the resident pages of a process, and those of them that are of files."""
    try:
        _, resident, shared, *_ = Path(f'/proc/{process}/statm').read_text('ascii').split()
    except (OSError, ValueError):
        return 0, 0
    return int(resident), int(shared)


def _make_status(
    name: str, level: bytes, text: str, values: Mapping[str, object]
) -> DiagnosticStatus:
    return DiagnosticStatus(
        level=level,
        name=name,
        message=text,
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )
