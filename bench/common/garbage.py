# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Talks nonsense, and slowly, to a port: ``garbage.py ADDRESS PORT GARBAGE SLOW``.

Some connections say nonsense and hang up, others a byte a second until they are killed.
"""

import contextlib
import os
import socket
import sys
import time

if __name__ == '__main__':
    place = sys.argv[1], int(sys.argv[2])
    for number in range(int(sys.argv[3])):
        with contextlib.suppress(OSError), socket.create_connection(place, 2.0) as link:
            link.sendall(os.urandom(200) if number % 2 else b'RTCP' * 100)
    slow = [socket.create_connection(place, 2.0) for _ in range(int(sys.argv[4]))]
    while True:
        for link in slow:
            with contextlib.suppress(OSError):
                link.sendall(b'\x16')
        time.sleep(1.0)
