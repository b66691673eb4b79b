# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
A ROS domain that no other program of this package on the machine is in.

Two graphs in one domain hear each other: a player finds the subscribers of another node and
begins before its own is up, and diagnostics are those of either.
"""

import fcntl
import os
from pathlib import Path
import tempfile

from plc_inspect.errors import ConfigError

LAST_DOMAIN = 100
"""Ports of greater domain ids may be taken by connections of other programs."""
MOST_DOMAINS = 20
"""Domain ids that one process holds; then they take turns."""
_held: list[tuple[int, int]] = []


def take_domain() -> int:
    """
    Return a domain id that no other process has taken, held until this process ends.

    Raises
    ------
    ConfigError
        All are taken.

    """
    if len(_held) < MOST_DOMAINS:
        for domain in range(1, LAST_DOMAIN + 1):
            path = Path(tempfile.gettempdir()) / f'plc_inspect_domain_{domain}'
            try:
                lock = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
            except OSError:  # of another user
                continue
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                os.close(lock)
                continue
            _held.append((domain, lock))
            return domain
    if not _held:
        raise ConfigError(f'all ROS domains from 1 to {LAST_DOMAIN} are taken by other programs')
    _held.append(_held.pop(0))
    return _held[-1][0]


def set_apart() -> int:
    """Give this process and those that it starts a domain of their own on this machine."""
    domain = take_domain()
    os.environ['ROS_DOMAIN_ID'] = str(domain)
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    return domain
