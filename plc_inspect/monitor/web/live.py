# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
What browsers are sent: each gets what it does not have yet, the newest only, words before points.

A browser on a slow link skips what was replaced meanwhile; nothing queues up for it.
"""

import asyncio
from collections.abc import Iterable, Mapping
import json
import threading

from aiohttp import web

from plc_inspect.stream.blocks import BlockKey

MOST_AT_ONCE = 6
"""Blocks of the corridor that are sent before the words are looked at anew."""
GREETING = 'me'


class Hub:
    """All that is shown of one vehicle, for any number of browsers; safe between threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._version = 0
        self._parts: dict[str, tuple[int, str]] = {}
        self._blocks: dict[BlockKey, tuple[int, bytes]] = {}
        self._waiting: set[tuple[asyncio.AbstractEventLoop, asyncio.Event]] = set()

    def put(
        self, parts: Mapping[str, object], blocks: Iterable[tuple[BlockKey, bytes]] = ()
    ) -> None:
        """
        Take what is to be shown; what is as before is not sent again.

        Parameters
        ----------
        parts : mapping of str to JSON values
            By name.
        blocks : iterable of tuple
            Blocks of the corridor that changed, and their bytes.

        """
        texts = {name: _pack(name, value) for name, value in parts.items()}
        with self._lock:
            self._version += 1
            for name, text in texts.items():
                if self._parts.get(name, (0, ''))[1] != text:
                    self._parts[name] = self._version, text
            for key, data in blocks:
                self._blocks.pop(key, None)
                self._blocks[key] = self._version, data
            for loop, event in self._waiting:
                loop.call_soon_threadsafe(event.set)

    async def serve(self, socket: web.WebSocketResponse, greeting: Mapping[str, object]) -> None:
        """Send everything to a browser until it leaves."""
        event = asyncio.Event()
        own = asyncio.get_running_loop(), event
        with self._lock:
            self._waiting.add(own)
        reader = asyncio.create_task(_read(socket, event))
        try:
            await socket.send_str(_pack(GREETING, greeting))
            seen: dict[object, int] = {}
            while not socket.closed:
                event.clear()
                if not await self._send_news(socket, seen):
                    await event.wait()
        except ConnectionError:
            pass  # it left
        finally:
            reader.cancel()
            with self._lock:
                self._waiting.discard(own)

    async def _send_news(self, socket: web.WebSocketResponse, seen: dict[object, int]) -> bool:
        """Send what a browser does not have; return whether there was anything."""
        with self._lock:
            parts = [(name, *item) for name, item in self._parts.items()
                     if seen.get(name) != item[0]]
            blocks = [(key, *item) for key, item in self._blocks.items()
                      if seen.get(key) != item[0]][:MOST_AT_ONCE]
        for name, version, text in parts:
            await socket.send_str(text)
            seen[name] = version
        for key, version, data in blocks:
            await socket.send_bytes(data)
            seen[key] = version
        return bool(parts or blocks)


async def _read(socket: web.WebSocketResponse, event: asyncio.Event) -> None:
    """Wait for the browser to leave; what it says is not listened to."""
    async for _ in socket:
        pass
    event.set()


def _pack(name: str, value: object) -> str:
    return json.dumps({'part': name, 'value': value}, allow_nan=False, separators=(',', ':'))
