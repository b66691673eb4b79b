# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
A thin, long and lossy link between two network namespaces of this machine.

As netem would make it, for kernels that lack netem: frames of two TAP devices are carried from one
to the other by this process.  It needs root and ``ip`` of iproute2.
"""

from collections import deque
from dataclasses import dataclass, field
import fcntl
import os
from pathlib import Path
import random
import select
import struct
import subprocess
import threading
import time

TUNSETIFF, TAP, NO_HEAD = 0x400454CA, 0x0002, 0x1000
MOST_FRAME = 2048
QUEUE_SECONDS = 1.0
"""What waits longer for a place on the link is dropped, as by a modem [s]."""


@dataclass
class Way:
    """One direction of the link."""

    source: int
    target: int
    kbps: float
    loss: float
    delay: float
    rng: random.Random
    frames: deque[tuple[float, bytes]] = field(default_factory=deque)
    free: float = 0.0
    lost: int = 0
    dropped: int = 0
    """For want of a place."""
    bytes: int = 0

    def take(self, now: float) -> None:
        """Read one frame, and say when it comes out."""
        frame = os.read(self.source, MOST_FRAME)
        start = max(self.free, now)
        if start - now > QUEUE_SECONDS:
            self.dropped += 1
            return
        self.free = start + len(frame) * 8e-3 / self.kbps
        self.bytes += len(frame)
        if self.rng.random() < self.loss:
            self.lost += 1
            return
        self.frames.append((self.free + self.delay, frame))

    def give(self, now: float) -> float:
        """Write what is due; return how long until the next is [s]."""
        while self.frames and self.frames[0][0] <= now:
            os.write(self.target, self.frames.popleft()[1])
        return self.frames[0][0] - now if self.frames else 0.05


class ThinPath:
    """
    Two namespaces, ``air`` and ``ground``, and the link between them; a context manager.

    Parameters
    ----------
    kbps : float
        Of each direction [kbit/s].
    loss : float
        Share of the frames that are lost.
    delay : float
        One way [s].

    """

    def __init__(self, kbps: float, loss: float, delay: float, seed: int = 0) -> None:
        mark = os.getpid() % 10_000
        self.air, self.ground = f'plc_air{mark}', f'plc_gnd{mark}'
        self._ends, self._ended = [], threading.Event()
        try:
            for number, name in enumerate((self.air, self.ground)):
                self._ends.append(self._open(name, f'plc{number}t{mark}', f'10.77.0.{number + 1}'))
        except BaseException:
            self._remove()
            raise
        one, other = self._ends
        rng = random.Random(seed)
        self.down = Way(one, other, kbps, loss, delay, rng)
        """From the air to the ground."""
        self.up = Way(other, one, kbps, loss, delay, rng)
        self._thread = threading.Thread(target=self._carry)

    def __enter__(self) -> 'ThinPath':
        """Open the link."""
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        """Close the link, and take the namespaces away."""
        self._ended.set()
        self._thread.join()
        self._remove()

    @staticmethod
    def inside(name: str, *words: object) -> list[str]:
        """Return a command line that runs in a namespace."""
        return ['ip', 'netns', 'exec', name, *map(str, words)]

    def _open(self, name: str, device: str, address: str) -> int:
        _run('netns', 'add', name)
        end = os.open('/dev/net/tun', os.O_RDWR | os.O_NONBLOCK)
        fcntl.ioctl(end, TUNSETIFF, struct.pack('16sH', device.encode(), TAP | NO_HEAD))
        _run('link', 'set', device, 'netns', name)
        for words in (('link', 'set', 'lo', 'up'), ('addr', 'add', f'{address}/24', 'dev', device),
                      ('link', 'set', device, 'up'),
                      ('route', 'add', '224.0.0.0/4', 'dev', device)):
            _run('-n', name, *words)
        return end

    def _remove(self) -> None:
        for end in self._ends:
            os.close(end)
        for name in (self.air, self.ground):
            subprocess.run(['ip', 'netns', 'del', name], check=False, capture_output=True)

    def _carry(self) -> None:
        ways = {way.source: way for way in (self.down, self.up)}
        wait = 0.0
        while not self._ended.is_set():
            for end in select.select(list(ways), [], [], max(wait, 0.0))[0]:
                ways[end].take(time.monotonic())
            wait = min(way.give(time.monotonic()) for way in ways.values())


def _run(*words: str) -> None:
    subprocess.run(['ip', *words], check=True)


def write_wrapper(path: Path, name: str, program: str) -> Path:
    """Write a program that runs another one in a namespace."""
    path.write_text(f'#!/bin/sh\nexec ip netns exec {name} {program} "$@"\n', encoding='utf-8')
    path.chmod(0o755)
    return path
