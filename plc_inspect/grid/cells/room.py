# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
The room of a run: where its tasks write files before these get their place.

If a client is killed, tasks that have begun go on in the workers of its cluster.  The next run
removes the room that they write in, so that they end without touching what it makes itself.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
import secrets
import shutil
import tempfile

_PREFIX = 'room_'


@contextmanager
def open_room(work: Path) -> Iterator[Path]:
    """Yield an empty room in the working folder of a grid; those of earlier runs are removed."""
    work.mkdir(parents=True, exist_ok=True)
    _remove_rooms(work)
    try:
        room = work / f'{_PREFIX}{secrets.token_hex(4)}'
        room.mkdir()
        yield room
    finally:
        _remove_rooms(work)


def _remove_rooms(work: Path) -> None:
    for room in work.glob(f'{_PREFIX}*'):
        gone = room.rename(f'{room}.gone')  # at once for those who write in it
        shutil.rmtree(gone, ignore_errors=True)


@contextmanager
def publish(room: Path, place: Path) -> Iterator[Path]:
    """
    Write a file or a folder, and put it in its place once it is complete.

    Parameters
    ----------
    room : Path
        Of the run, on the same file system.
    place : Path
        The file or folder, which is replaced; its parent exists.

    Yields
    ------
    Path
        Where to write it.

    Raises
    ------
    OSError
        It cannot be written, or another run has removed the room: what is in place stays.

    """
    with tempfile.TemporaryDirectory(dir=room, ignore_cleanup_errors=True) as own:
        aside = Path(own) / place.name
        yield aside
        if place.is_dir():
            place.rename(Path(own) / 'old')
        aside.rename(place)
