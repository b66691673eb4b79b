# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Live updates: each browser is sent the newest state that it lacks, text before points.

A browser on a slow link skips states that were replaced meanwhile; nothing queues up.  State and
alarms are sent at once; rows of tables and points of the corridor at the pace at which the browser
answers, the nearest to the vehicle first, and of each block a thinned copy before the rest.
Alarms are also sent over two other connections: after a lost packet, TCP holds back all that
follows, for a second on a slow link; the browser shows whichever copy comes first.
"""

import asyncio
from collections.abc import Container, Iterable, Mapping, Sequence
import contextlib
import json
import math
import secrets
import threading
import time

from aiohttp import web

from plc_inspect.monitor.web.cells import BlockPoints
from plc_inspect.monitor.web.pace import Pace
from plc_inspect.stream.blocks import BlockKey

GREETING, ALARMS = 'me', 'alarms'
STAGES = (500, 4_000)
"""Points of every block that are sent before more of any block [count]."""
ROWS_BYTES = 3_000
"""Approximate size of a message of rows [bytes]."""
QUEUE_AGE = 0.5
"""
Blocks are queued anew after this [s].
Source: measured: 20 ms for 20,000 blocks, and what changed near the vehicle waits no longer.
"""
LEAST_POINTS = 100
"""Least points of a message, except the last of a block."""

Rows = Mapping[str, Sequence[tuple[str, object]]]
"""Of tables, by name: key and value of each row, in the order in which they are shown."""


class Visitor:
    """What one browser has received."""

    def __init__(self) -> None:
        self.parts: dict[str, int] = {}
        self.rows: dict[tuple[str, str], int] = {}
        self.blocks: dict[BlockKey, tuple[int, int]] = {}
        """Version of each block, and number of its points sent."""
        self.queue: list[tuple[int, BlockKey]] = []
        """Stages and keys of the blocks that come next, the last first."""
        self.queued = -math.inf
        """When they were queued [s]."""
        self.pace = Pace()


class Hub:
    """All that is shown of one vehicle, for any number of browsers; thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.life = secrets.randbits(32)
        """Random number of this run of the monitor, in which numbers of alarms hold."""
        self._version = 0
        self._parts: dict[str, tuple[int, str]] = {}
        self._rows: dict[str, dict[str, tuple[int, str]]] = {}
        self._blocks: dict[BlockKey, tuple[int, BlockPoints]] = {}
        self._vehicle: Sequence[float] | None = None
        self._waiting: set[tuple[asyncio.AbstractEventLoop, asyncio.Event]] = set()

    def put(
        self, parts: Mapping[str, object], rows: Rows | None = None,
        blocks: Iterable[BlockPoints] = (), vehicle: Sequence[float] | None = None,
    ) -> None:
        """
        Replace what is shown; unchanged values are not sent again.

        Parameters
        ----------
        parts : mapping of str to JSON values
            By name.
        rows : mapping
            Of tables; all of them.
        blocks : iterable of BlockPoints
            Blocks of the corridor that changed.
        vehicle : sequence of float or None
            Where it is [m]: what is near is sent first.

        """
        texts = {name: _dump(value) for name, value in parts.items()}
        tables = {
            name: {key: _dump(value) for key, value in own} for name, own in (rows or {}).items()
        }
        for name, table in tables.items():
            texts[f'{name}-keys'] = _dump({'keys': list(table)})
        with self._lock:
            self._version += 1
            self._vehicle = vehicle
            for name, text in texts.items():
                if self._parts.get(name, (0, ''))[1] != text:
                    self._parts[name] = self._version, text
            for name, table in tables.items():
                before = self._rows.get(name, {})
                self._rows[name] = {
                    key: before[key] if key in before and before[key][1] == text
                    else (self._version, text) for key, text in table.items()
                }
            for block in blocks:
                self._blocks[block.home] = self._version, block
            for loop, event in self._waiting:
                loop.call_soon_threadsafe(event.set)

    async def serve(
        self, socket: web.WebSocketResponse, greeting: Mapping[str, object], *,
        alarms: bool = False,
    ) -> None:
        """Serve a browser until it disconnects: everything, or alarms only."""
        event = asyncio.Event()
        own = asyncio.get_running_loop(), event
        visitor = Visitor()
        with self._lock:
            self._waiting.add(own)
        reader = asyncio.create_task(_read(socket, event, visitor.pace))
        try:
            await socket.send_str(_pack(GREETING, _dump({**greeting, 'life': self.life}), 0))
            while not socket.closed:
                event.clear()
                if alarms:
                    await self._send_parts(socket, visitor, {ALARMS})
                wait = None if alarms else await self._send_news(socket, visitor)
                if wait != 0.0:
                    with contextlib.suppress(TimeoutError):
                        await asyncio.wait_for(event.wait(), wait)
        except ConnectionError:
            pass  # it left
        finally:
            reader.cancel()
            with self._lock:
                self._waiting.discard(own)

    async def _send_parts(
        self, socket: web.WebSocketResponse, visitor: Visitor, names: Container[str] | None = None
    ) -> None:
        """Send the parts that a browser lacks."""
        with self._lock:
            parts = [(name, *item) for name, item in self._parts.items()
                     if visitor.parts.get(name) != item[0] and (names is None or name in names)]
        for name, version, text in parts:
            await socket.send_str(_pack(name, text, version))
            visitor.parts[name] = version

    async def _send_news(self, socket: web.WebSocketResponse, visitor: Visitor) -> float | None:
        """Send urgent parts and another message; return how long to wait [s], None: for news."""
        await self._send_parts(socket, visitor)
        wait = visitor.pace.wait(time.monotonic())
        if wait > 0.0:
            return None if math.isinf(wait) else wait
        with self._lock:
            message = self._choose_rows(visitor) or self._choose_points(visitor)
        if message is None:
            return None
        visitor.pace.send(len(message), time.monotonic())
        if isinstance(message, str):
            await socket.send_str(message)
        else:
            await socket.send_bytes(message)
        return 0.0

    def _choose_rows(self, visitor: Visitor) -> str | None:
        """Return rows of one table that a browser lacks, and mark them as sent."""
        for name, table in self._rows.items():
            chosen: list[str] = []
            size = 0
            for key, (version, text) in table.items():
                if visitor.rows.get((name, key)) == version:
                    continue
                if chosen and size + len(text) > ROWS_BYTES:
                    break
                visitor.rows[name, key] = version
                chosen.append(f'[{_dump(key)},{text}]')
                size += len(text)
            if chosen:
                return f'{{"part":{_dump(name)},"value":{{"rows":[{",".join(chosen)}]}}}}'
        return None

    def _choose_points(self, visitor: Visitor) -> bytes | None:
        """Return points that a browser lacks, and mark them as sent."""
        now = time.monotonic()
        while True:
            if not visitor.queue or now >= visitor.queued + QUEUE_AGE:
                visitor.queue, visitor.queued = self._queue_blocks(visitor), now
            if not visitor.queue:
                return None
            queued, home = visitor.queue[-1]
            stage, sent = self._find_stage(visitor, home)
            if stage is None or stage > queued:
                visitor.queue.pop()
                continue
            version, block = self._blocks[home]
            most = min((*STAGES, block.count)[stage], block.count)
            room = max(LEAST_POINTS, visitor.pace.piece // block.bytes_each)
            count = min(most, sent + room) - sent
            if block.count - sent - count < LEAST_POINTS:
                count = block.count - sent
            visitor.blocks[home] = version, sent + count
            return block.pack(version, sent, count)

    def _queue_blocks(self, visitor: Visitor) -> list[tuple[int, BlockKey]]:
        """Return the blocks of which a browser lacks points, with their stages; the next last."""
        found = []
        for home, (_, block) in self._blocks.items():
            stage, _ = self._find_stage(visitor, home)
            if stage is not None:
                apart = 0.0 if self._vehicle is None else math.dist(
                    block.middle[:2], self._vehicle[:2]
                )
                found.append((stage, apart, home))
        found.sort(reverse=True)
        return [(stage, home) for stage, _, home in found]

    def _find_stage(self, visitor: Visitor, home: BlockKey) -> tuple[int | None, int]:
        """Return the stage of a block's next points, None if all are sent, and how many are."""
        version, block = self._blocks[home]
        known, sent = visitor.blocks.get(home, (0, 0))
        if known != version:
            return 0, 0
        if sent >= block.count:
            return None, sent
        return next((k for k, most in enumerate(STAGES) if sent < most), len(STAGES)), sent


async def _read(socket: web.WebSocketResponse, event: asyncio.Event, pace: Pace) -> None:
    """Read acknowledgements until the browser disconnects."""
    async for _ in socket:
        pace.answer(time.monotonic())
        event.set()
    event.set()


def _pack(name: str, text: str, version: int) -> str:
    return f'{{"part":{_dump(name)},"version":{version},"value":{text}}}'


def _dump(value: object) -> str:
    return json.dumps(value, allow_nan=False, separators=(',', ':'))
