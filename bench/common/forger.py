# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Sits between node and monitor: forges, replays and reorders the stream, and prints how often.

``python bench/common/forger.py RECORDED`` passes the summary of /plc_inspect on as that of
/relay/plc_inspect, which the monitor follows.  When as many messages went through as a monitor
asks for, it sends what it forged, and what it heard before; told to by a line on its input, it
goes on with pairs of messages in the wrong order.  RECORDED is a file of messages of an earlier
flight, each with its length (uint32) before it.  It prints a line of JSON for each part.
"""

import array
from collections.abc import Iterator
import json
from pathlib import Path
import struct
import sys
import threading
import time
from typing import Any

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
import rclpy
from rclpy.node import Node
from std_msgs.msg import UInt8MultiArray

from plc_inspect.ros.graph.qos import SUMMARY
from plc_inspect.stream.signature import FLAGS_AT, OVERHEAD, SIGNED, Signer

NODE, RELAY = '/plc_inspect', '/relay/plc_inspect'
PASSED = 6
"""Messages that go through before the first try."""
PAIRS = 3
"""Messages that change places with the next one."""
PACE = 0.02
"""Between two messages of its own [s]: none is to be lost for want of room."""
SESSION_AT, SEQUENCE_AT = 6, 10
"""Where a message has session and number (uint32), see ``stream/frame.py``."""


class Forger:
    """A place on the graph between node and monitor."""

    def __init__(self) -> None:
        self._node = Node('forger')
        self._publisher = self._node.create_publisher(UInt8MultiArray, f'{RELAY}/summary', SUMMARY)
        self._node.create_subscription(UInt8MultiArray, f'{NODE}/summary', self._hear, SUMMARY)
        self.heard: list[bytes] = []
        self._held: bytes | None = None
        self.pairs_left = 0

    def _hear(self, message: Any) -> None:
        data = message.data.tobytes()
        self.heard.append(data)
        if self.pairs_left and self._held is None:
            self._held = data
            return
        self.send(data)
        if self._held is not None:
            self.send(self._held)
            self._held = None
            self.pairs_left -= 1

    def send(self, data: bytes) -> None:
        """Send a message as if it were the node's."""
        self._publisher.publish(UInt8MultiArray(data=array.array('B', data)))
        time.sleep(PACE)

    def step(self) -> None:
        """Pass on what comes."""
        rclpy.spin_once(self._node, timeout_sec=0.05)

    @property
    def followed(self) -> bool:
        """Whether a monitor listens."""
        return self._publisher.get_subscription_count() > 0


def forge(good: bytes) -> Iterator[bytes]:
    """Yield messages that are not the node's, made of one that is."""
    body = good[:-OVERHEAD]
    plain = body[:FLAGS_AT] + bytes([body[FLAGS_AT] & ~SIGNED]) + body[FLAGS_AT + 1:]
    key = Ed25519PrivateKey.generate().private_bytes(
        Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()
    )
    yield plain  # without a signature
    yield Signer(key, 1 << 40).sign(plain)  # with another key, of a later run
    for at in (SESSION_AT, SEQUENCE_AT):  # a session or a number of its own
        changed = bytearray(good)
        changed[at:at + 4] = struct.pack('<I', struct.unpack_from('<I', good, at)[0] + 1)
        yield bytes(changed)
    for at in range(FLAGS_AT, len(good), max(1, len(good) // 40)):  # a bit of each part
        yield good[:at] + bytes([good[at] ^ 1]) + good[at + 1:]
    for size in (0, 4, 17, len(good) // 2, len(good) - 1):
        yield good[:size]
    yield good + b'\0'
    yield b'PLCS' + bytes(100)


def read_recorded(path: Path) -> Iterator[bytes]:
    """Yield the messages of an earlier flight."""
    data = path.read_bytes()
    while data:
        (size,) = struct.unpack_from('<I', data)
        yield data[4:4 + size]
        data = data[4 + size:]


def main() -> int:
    """Pass messages on, and try."""
    recorded = list(read_recorded(Path(sys.argv[1])))
    go_on = threading.Event()
    threading.Thread(target=lambda: sys.stdin.readline() and go_on.set(), daemon=True).start()
    rclpy.init()
    forger = Forger()
    while not forger.followed:
        time.sleep(0.05)
    while len(forger.heard) < PASSED:
        forger.step()
    forged, replayed = list(forge(forger.heard[-1])), [*forger.heard, *recorded]
    for data in (*forged, *replayed):
        forger.send(data)
    print(json.dumps({'forged': len(forged), 'replayed': len(replayed)}), flush=True)
    while not go_on.is_set():
        forger.step()
    forger.pairs_left = PAIRS
    while forger.pairs_left:
        forger.step()
    print(json.dumps({'reordered': PAIRS}), flush=True)
    while True:
        forger.step()


if __name__ == '__main__':
    sys.exit(main())
