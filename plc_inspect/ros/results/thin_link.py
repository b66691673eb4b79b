# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
The stream for thin links: a latched summary, and the thinned corridor within a budget.

Described in docs/monitor.md.  The worker makes the news; all else is the executor's thread's.
"""

import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
import math
import secrets
import time
from typing import Protocol

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.event_handler import PublisherEventCallbacks, QoSPublisherMatchedInfo
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import UInt8MultiArray

from plc_inspect.core.live.proximity import Level, Thing
from plc_inspect.core.live.session import CORRIDOR_REACH, LiveState
from plc_inspect.node_config import StreamSettings
from plc_inspect.results import Float64, Severity
from plc_inspect.ros.graph.qos import overridable, SUMMARY, THIN_CORRIDOR, watched
from plc_inspect.security.member_keys import find_keys
from plc_inspect.stream.blocks import (
    BlockKey,
    Cells,
    COARSENESS,
    pack_blocks,
    thin_points,
    UInt64,
)
from plc_inspect.stream.budget import Budget
from plc_inspect.stream.frame import CLOUD, Frame, pack_frame
from plc_inspect.stream.nearness import Nearness
from plc_inspect.stream.summary import (
    HEALTH,
    make_tables,
    Status,
    STATUSES,
    SummaryTables,
    TURNS,
)
from plc_inspect.stream.summary_writer import MOST_CHANGED, Share, SummaryWriter
from plc_inspect.stream.thin_map import ThinMap

PERIOD = 0.1
"""Time between two looks at what the budget allows [s]."""
DEPTH = 0.25
"""
The corridor saves up so much of its rate [s].
Source: derivation: what is sent at once stands before an alarm on the link; of one second from the
message to the screen the link itself, its losses and the page take the rest.
"""
ECHOES = (0.1, 0.3, 0.6)
"""
What raises an alarm is told again so much later [s], as the message before may be lost; one that
comes also shows the monitor's DDS what was, which Fast DDS says by itself only every 3 s.
"""
SETTLE = 0.3
"""A listener that is new has found the node too after this [s]; what is sent before is lost."""
PULSE = 0.9
"""The summary says at least this often that the node lives [s]."""
LEAST_SILENCE, NEAR_PERIOD = 0.1, 0.5
"""
A change of the keep-out that raises no alarm is told no sooner after the last message; while
something is too near, the summary says how near at least this often [s].
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class News:
    """What one tick has to tell."""

    tables: SummaryTables
    cells: Cells | None
    """The thinned corridor, None where none is wanted."""
    frame_id: str
    stamp_ns: int
    """Stamp of the newest scan that is in [ns]."""
    held: bool
    """Hazards are held back."""


def make_news(state: LiveState, frame_id: str, stamp_ns: int, settings: StreamSettings) -> News:
    """
    Put a state into rows and cells; in the worker's thread.

    Parameters
    ----------
    state : LiveState
        What is known.
    frame_id : str
        Frame of the odometry.
    stamp_ns : int
        Stamp of the newest scan that is in [ns].
    settings : StreamSettings
        How the corridor is thinned.

    Returns
    -------
    News

    """
    corridor = state.corridor
    cells = None
    if settings.max_kbps > 0.0:
        cells = thin_points(
            corridor.points, corridor.classification, corridor.clearance, settings.voxel_size
        )
    spans = [(item.span, item.finished) for item in state.confirmed]
    return News(
        tables=make_tables(spans, state.supports, state.hazards), cells=cells,
        frame_id=frame_id, stamp_ns=stamp_ns, held=state.sharpness.poor,
    )


class Located(Protocol):
    """Knows where the vehicle is."""

    told_vehicle: Float64 | None
    """(3,) where its odometry says that it is [m], None before the first pose."""


class Stream:
    """
    Publishes the summary and the thinned corridor.

    Parameters
    ----------
    node : Node
        Owns the publishers and the timer.
    settings : callable
        Returns the settings that hold now.
    intake : Located
        Knows where the vehicle is.
    guard : callable
        Wraps a callback under a name, so that its failure does not end the node.

    Raises
    ------
    ConfigError
        PLC_KEYS names keys that cannot be read.

    """

    def __init__(
        self,
        node: Node,
        settings: Callable[[], StreamSettings],
        intake: 'Located',
        guard: Callable[[str, Callable[..., None]], Callable[..., None]],
    ) -> None:
        self._settings = settings
        self._intake = intake
        self._started = time.monotonic()
        self._session = secrets.randbits(32)
        keys = find_keys()
        self._signer = None if keys is None else keys.make_signer()
        self._status = Status()
        self._texts = ['', *('' for _ in STATUSES)]
        self._tables = SummaryTables()
        self._vehicle: Float64 | None = None
        self._told = -math.inf
        self._levels: dict[Thing, Level] = {}
        self._listened = self._blank = False
        self._echoes: list[float] = []
        self._arrived: float | None = None
        self._begin()
        self._summary = node.create_publisher(
            UInt8MultiArray, '~/summary', **overridable(SUMMARY), **watched(node, 'summary')
        )
        self._corridor = node.create_publisher(
            UInt8MultiArray, '~/thin_corridor', **overridable(THIN_CORRIDOR),
            event_callbacks=PublisherEventCallbacks(
                matched=self._on_match, use_default_callbacks=False
            ),
        )
        node.create_timer(
            PERIOD, guard('stream', self._step), clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def _begin(self) -> None:
        """Begin a session, in which nothing was told yet."""
        settings = self._settings()
        self._alarms: frozenset[int] = frozenset()
        self._again: frozenset[int] = frozenset()
        self._writer = SummaryWriter(self._session)
        self._turn, self._turned = 0, False
        self._map = ThinMap(settings.voxel_size, CORRIDOR_REACH)
        self._budget = Budget(settings.max_kbps * 125.0, DEPTH)
        self._sequence = 0

    def forget(self) -> None:
        """Begin anew after a reset of the node: a session of its own, so nothing is mixed up."""
        self._session = (self._session + 1) % (1 << 32)
        self._status = replace(self._status, resets=self._status.resets + 1, cloud_sent=0)
        self._blank = True
        self._begin()

    def publish(self, news: News, *, kept: bool = False) -> None:
        """Tell what a tick found, or what was kept of an earlier run of the node."""
        now = self._now()
        self._texts[0] = news.frame_id or self._texts[0]
        blank, self._blank = self._blank, False
        self._status = replace(
            self._status, stamp_ns=0 if blank else news.stamp_ns, held=news.held,
            tick_uptime=math.nan if blank or kept else now,
        )
        if kept and (vehicle := self._intake.told_vehicle) is not None:
            self._vehicle = vehicle  # where it was, which is no news either
            x, y, z = vehicle.tolist()
            self._status = replace(self._status, vehicle=(x, y, z), vehicle_uptime=math.nan)
        if news.cells is not None:
            self._map.update(news.cells, self._intake.told_vehicle, now)
        hazards = news.tables.hazards
        alarms = frozenset(hazards['hazard_id'][hazards['severity'] >= Severity.CRITICAL].tolist())
        new = alarms - self._alarms
        self._alarms, self._again = alarms, (self._again & alarms) | new
        self._tables = news.tables
        if new:
            self._alarm(now)
        else:
            self._tell(now)

    def tell_health(self, report: Sequence[DiagnosticStatus]) -> None:
        """Take the node's diagnostics up, and see to it that the summary tells of them."""
        now = self._now()
        found = {status.name.rpartition(' ')[2]: status for status in report}
        values = {
            name: {item.key: item.value for item in status.values}
            for name, status in found.items()
        }
        self._texts[1:] = [found[name].message for name in STATUSES]
        self._status = replace(
            self._status,
            health_uptime=now,
            levels=tuple(int.from_bytes(found[name].level, 'little') for name in STATUSES),
            health={name: _read_number(values, *place) for name, place in HEALTH.items()},
        )
        if now - self._told >= PULSE:
            self._tell(now)

    def tell_nearness(self, near: tuple[Nearness, ...], heading: float) -> None:
        """
        Take up how near the vehicle is; a level that rose or fell is told at once.

        Parameters
        ----------
        near : tuple of Nearness
            To each kind of thing.
        heading : float
            Of the vehicle [rad].

        """
        now = self._now()
        self._status = replace(self._status, near=near, near_uptime=now, heading=heading)
        silence = now - self._told
        levels = {item.thing: item.level for item in near}
        changed = self._levels != levels and silence >= LEAST_SILENCE
        close = any(item.level >= Level.WARNING for item in near) and silence >= NEAR_PERIOD
        if any(level == Level.CRITICAL and self._levels.get(thing) != level
               for thing, level in levels.items()):
            self._alarm(now)
        elif changed or close:
            self._tell(now)

    def _now(self) -> float:
        return time.monotonic() - self._started

    def _alarm(self, now: float) -> None:
        """Tell what raises an alarm and no more, and have it told again, with what is new."""
        self._echoes = [now + later for later in ECHOES]
        self._tell(now, urgent=True)

    def _tell(self, now: float, *, urgent: bool = False) -> None:
        vehicle = self._intake.told_vehicle
        if vehicle is not None and vehicle is not self._vehicle:
            self._vehicle = vehicle
            x, y, z = vehicle.tolist()
            self._status = replace(self._status, vehicle=(x, y, z), vehicle_uptime=now)
        # of two messages at least one has a turn, so that those that the topic keeps have all
        self._turned = not (urgent and self._turned)
        data = self._writer.write(self._tables, self._status, self._texts, now, Share(
            turn=self._turn * self._turned, turns=TURNS * self._turned, again=self._again,
            most=0 if urgent else MOST_CHANGED,
        ))
        self._turn = (self._turn + self._turned) % TURNS
        self._told = now
        self._levels = {item.thing: item.level for item in self._status.near}
        self._publish(self._summary, data)

    def _on_match(self, info: QoSPublisherMatchedInfo) -> None:
        # Who leaves and comes at once does not change the count of those that are there.
        if info.total_count_change > 0:
            self._arrived = self._now()

    def _step(self) -> None:
        """
        Say an alarm again where that is due.

        Then send the rows and as much of the corridor as there is room for.
        """
        now = self._now()
        self._budget.rate = self._settings().max_kbps * 125.0
        due = bool(self._echoes) and now >= self._echoes[0]
        room = self._budget.balance > 0.0 or not self._budget.rate
        if due or (self._writer.behind and room):
            self._echoes = [later for later in self._echoes if later > now]
            self._tell(now)
            if not self._echoes:
                self._again = frozenset()
        if not self._corridor.get_subscription_count() or not self._budget.rate:
            if self._listened:
                self._map.forget_listeners()
            self._listened = False
            return
        self._listened = True
        if self._arrived is not None and now - self._arrived >= SETTLE:
            self._arrived = None
            self._map.refresh(now)
        while self._budget.balance > 0.0:
            voxel = self._map.voxel
            if overview := self._map.take_overview():
                self._send(overview, now, overview=True, voxel=voxel * COARSENESS)
            elif blocks := self._map.take(now):
                self._send(blocks, now, overview=False, voxel=voxel)
            else:
                return

    def _send(
        self, blocks: Mapping[BlockKey, UInt64], now: float, *, overview: bool, voxel: float
    ) -> None:
        data = pack_frame(Frame(
            kind=CLOUD, flags=0, session=self._session,
            sequence=self._sequence, uptime=now,
            body=pack_blocks(blocks, overview=overview, voxel=voxel, total=len(self._map)),
        ))
        self._sequence += 1
        self._status = replace(self._status, cloud_sent=self._sequence)
        self._publish(self._corridor, data)

    def _publish(self, topic: Publisher, data: bytes) -> None:
        """Send a message, signed where there is a key."""
        data = data if self._signer is None else self._signer.sign(data)
        self._budget.spend(len(data))
        topic.publish(_wrap(data))


def _wrap(data: bytes) -> UInt8MultiArray:
    message = UInt8MultiArray()
    message.data = array.array('B', data)
    return message


def _read_number(values: Mapping[str, Mapping[str, str]], status: str, key: str) -> float:
    try:
        return float(values[status][key])
    except (KeyError, ValueError):
        return math.nan
