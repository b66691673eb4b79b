# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Writes a flight record in a thread of its own, without blocking its callers.

A slow or full disk delays only the record: batches wait and are retried, no more are taken until
then, and the changes made meanwhile are merged into the next batch.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
import fcntl
import os
from pathlib import Path
import threading
import time
from typing import Any

from plc_inspect.errors import DataError, PlcInspectError
from plc_inspect.flight_record.layout import list_segments, name_segment
from plc_inspect.flight_record.segment import Batch, Segment

MOST_WAITING = 3
"""Most batches waiting to be written; each covers a fifth of a second."""
RETRY = 1.0
"""Time between two attempts to write [s]."""
LEAST_GROWTH = 128 << 20
"""Least size of a segment before a new one with the whole map begins [bytes]."""


class Recorder:
    """
    Writes a record.

    Parameters
    ----------
    folder : Path
        The record; created if missing, else continued.
    header : mapping
        What the node was started with, JSON-serialisable.
    fresh : bool
        Its old content is obsolete.

    Raises
    ------
    DataError
        The folder cannot be created, or another process writes to it.

    """

    def __init__(self, folder: Path, header: Mapping[str, Any], *, fresh: bool) -> None:
        self.folder = folder
        self._lock = lock_folder(folder)
        self._header, self._fresh = dict(header), fresh
        segments = list_segments(folder)
        self._number = max((int(path.stem) for path in segments), default=0)
        self._put_on_disk(segments)
        self._generation: int | None = None
        self._segment: Segment | None = None
        self._condition = threading.Condition()
        self._queue: deque[Batch] = deque()
        self._stopping = self._writing = False
        self._problem = ''
        self._saved_at = time.monotonic()
        self._may_drop = False
        self._past = 0
        self._base = 0
        self._thread = threading.Thread(target=self._run, name='plc_record', daemon=True)
        self._thread.start()

    @property
    def has_room(self) -> bool:
        """Whether another batch can be taken now."""
        with self._condition:
            return not self._problem and len(self._queue) < MOST_WAITING

    @property
    def busy(self) -> bool:
        """Whether batches are not on disk yet."""
        with self._condition:
            return bool(self._queue) or self._writing

    @property
    def problem(self) -> str:
        """Why writing fails, '' if it works."""
        return self._problem

    @property
    def age(self) -> float:
        """Time since the last sync to disk [s]."""
        return time.monotonic() - self._saved_at

    @property
    def size(self) -> int:
        """Bytes written by this process."""
        segment = self._segment
        return self._past + (segment.size if segment is not None else 0)

    @property
    def wants_all(self) -> bool:
        """Whether the whole map is to be repeated, so that old segments can be removed."""
        segment = self._segment
        return segment is not None and segment.size > max(LEAST_GROWTH, self._base)

    def put(self, batch: Batch) -> None:
        """Queue a batch for writing."""
        with self._condition:
            self._queue.append(batch)
            self._condition.notify_all()

    def close(self, timeout: float) -> bool:
        """
        Write pending batches, close the file, and release the record.

        Parameters
        ----------
        timeout : float
            Longest wait [s].

        Returns
        -------
        bool
            Whether all was written.

        """
        with self._condition:
            self._stopping = True
            self._condition.notify_all()
        self._thread.join(timeout)
        if self._thread.is_alive():
            return False
        os.close(self._lock)
        return not self._problem

    def _run(self) -> None:
        waiting: list[Batch] = []
        while True:
            with self._condition:
                if self._problem:
                    self._condition.wait_for(lambda: self._stopping, RETRY)
                else:
                    self._condition.wait_for(lambda: self._queue or self._stopping)
                if not waiting:
                    waiting = list(self._queue)
                    self._queue.clear()
                stopping, self._writing = self._stopping, True
            waiting = self._try_to_write(waiting)
            with self._condition:
                self._writing = bool(self._problem)
            if stopping and (self._problem or not (waiting or self._queue)):
                break
        try:
            if self._segment is not None:
                self._segment.close()
        except OSError as error:
            self._problem = f'{self.folder}: {error.strerror or type(error).__name__}'

    def _try_to_write(self, batches: list[Batch]) -> list[Batch]:
        """Write batches; return those that could not be prepared."""
        rest = list(batches)
        try:
            while rest:
                self._put(rest[0])
                self._may_drop |= rest.pop(0).complete
            self._flush()
            if self._may_drop:
                self._drop_old()
        except OSError as error:
            self._problem = f'{self.folder}: {error.strerror or type(error).__name__}'
        except PlcInspectError as error:
            self._problem = str(error)
        except Exception as error:  # the flight goes on whatever this is
            self._problem = f'{self.folder}: {type(error).__name__}: {error}'
        else:
            self._problem = ''
            self._saved_at = time.monotonic()
        return rest

    def _put_on_disk(self, segments: Sequence[Path]) -> None:
        """Sync to disk what another process wrote, as this record continues it."""
        with suppress(OSError):
            for path in (*segments, self.folder.parent):
                number = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
                try:
                    os.fsync(number)
                finally:
                    os.close(number)

    def _flush(self) -> None:
        if self._segment is not None:
            self._segment.flush()

    def _put(self, batch: Batch) -> None:
        cleared = self._generation is not None and batch.generation != self._generation
        segment = self._segment
        if segment is None or batch.begins or cleared:
            segment = self._begin(fresh=cleared or (self._fresh and segment is None))
        self._generation = batch.generation
        segment.put(batch)

    def _begin(self, *, fresh: bool) -> Segment:
        self._flush()  # what is in the segment before is whole first, or it goes on
        segment = Segment(
            name_segment(self.folder, self._number + 1), self._header, fresh=fresh
        )
        try:
            os.fsync(self._lock)  # the name of the file, too, is to outlive a power cut
        except OSError:
            segment.remove()
            raise
        before, self._segment = self._segment, segment
        self._may_drop = fresh
        self._number += 1
        if before is not None:
            self._past += before.size
            with suppress(OSError):  # all but its summary is there
                before.close()
        return segment

    def _drop_old(self) -> None:
        """Remove the segments before this one, which holds the whole map."""
        self._may_drop = False
        newest = name_segment(self.folder, self._number)
        self._base = newest.stat().st_size
        for path in list_segments(self.folder):
            if path != newest:
                path.unlink(missing_ok=True)


def lock_folder(folder: Path) -> int:
    """
    Create a folder if it is missing, and lock it for the life of this process.

    Returns
    -------
    int
        File descriptor of the lock; close it to release.

    Raises
    ------
    DataError
        It cannot be created, or another process holds it.

    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        number = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except OSError as error:
        raise DataError(f'{folder} cannot be written: {error.strerror}') from error
    try:
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(number)
        raise DataError(f'{folder} is written by another node') from error
    return number


def is_held(folder: Path) -> bool:
    """Return whether another process writes to an existing record."""
    try:
        os.close(lock_folder(folder))
    except DataError:
        return True
    return False
