# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The record of a running flight: takes changes from the map's owner, and reports its state."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
import time
from typing import Any

from plc_inspect.core.live.session import Kept
from plc_inspect.core.voxel_buffer.voxel_map import VoxelMap
from plc_inspect.errors import DataError
from plc_inspect.flight_record.layout import SUFFIX
from plc_inspect.flight_record.map_tap import MapTap
from plc_inspect.flight_record.recorder import Recorder
from plc_inspect.flight_record.segment import Batch

PERIOD = 0.04
"""Time between two steps over the map [s]; five steps cover it."""
LATE = 1.0
"""Age of the end of a record from which it counts as behind [s]: that much may be lost."""
END_TIMEOUT = 10.0
"""Longest wait for the disk at the end [s]."""
MOST_NAMES = 1000
"""Most records of one results folder that are set aside."""


@dataclass(frozen=True, slots=True)
class Condition:
    """The condition of a record."""

    problem: str
    """'' if all is well."""
    values: Mapping[str, Any]


class Recording:
    """
    Writes the record of a flight, if there is one; for the thread that owns the map.

    Parameters
    ----------
    voxels : VoxelMap
        The map.
    remember : callable
        Returns what came in so far, JSON-serialisable.
    complain : callable
        Takes a line of text for the log.

    """

    def __init__(
        self, voxels: VoxelMap, remember: Callable[[], Mapping[str, Any]],
        complain: Callable[[str], object],
    ) -> None:
        self._voxels, self._remember, self._complain = voxels, remember, complain
        self._tap = MapTap(voxels)
        self._recorder: Recorder | None = None
        self._kept = Kept()
        self._due: Kept | None = None
        self._next: Kept | None = None
        self._begins = False
        self._whole = 0
        self._problem = self._told = ''

    @property
    def folder(self) -> Path | None:
        """Folder of the record, None without one."""
        return self._recorder.folder if self._recorder is not None else None

    def begin(self, folder: Path, header: Mapping[str, Any], *, fresh: bool) -> None:
        """
        Begin to write a record; a failure is reported.

        Parameters
        ----------
        folder : Path
            Where.
        header : mapping
            What the node was started with, JSON-serialisable.
        fresh : bool
            Its old content is obsolete.

        """
        try:
            self._recorder = Recorder(folder, header, fresh=fresh)
        except DataError as error:
            self._problem = f'no record is written: {error}'
            self._complain(self._problem)

    def keep(self, kept: Kept) -> None:
        """Take the state of the session; it is written once the map of that state is recorded."""
        self._next = kept

    def forget(self) -> None:
        """Note that the session no longer keeps anything."""
        self._due, self._next = Kept(), None

    def step(self) -> None:
        """Take a part of the changes in the map; a complete round is written."""
        recorder = self._recorder
        if recorder is None:
            return
        if recorder.problem != self._told:
            self._told = recorder.problem
            self._complain(
                f'the record cannot be written: {self._told}; it goes on when that is over'
                if self._told else 'the record is written again'
            )
        if recorder.has_room and self._tap.step():
            self._hand_over(recorder, '')

    def _hand_over(self, recorder: Recorder, closed: str) -> None:
        self._whole = self._tap.whole if self._tap.over else self._whole
        changes, sweep, complete = self._tap.finish()
        state = {
            'time': time.time(), 'closed': closed, 'num_slots': self._voxels.num_slots,
            'origin': self._voxels.origin, 'sequence': self._voxels.sequence,
            'whole': self._whole, **self._remember(),
        }
        kept = self._kept if self._begins and self._due is None else self._due
        self._kept = kept or self._kept
        recorder.put(Batch(
            generation=self._voxels.generation, changes=changes, sweep=sweep,
            cells=self._voxels.cells.copy_state(),
            kept=kept, state=state, begins=self._begins, complete=complete,
        ))
        self._due, self._next, self._begins = self._next, None, False
        if recorder.wants_all and not self._tap.sweeping and not complete:
            self._tap.sweep()
            self._begins = True

    def flush(self, closed: str = '') -> None:
        """Hand over all remaining changes."""
        if self._recorder is not None:
            self._hand_over(self._recorder, '')
            while not self._tap.step():
                pass
            self._hand_over(self._recorder, closed)

    def close(self, closed: str = '') -> None:
        """
        End the record.

        Parameters
        ----------
        closed : str
            Path of the results, '' if they were not saved, so that the flight may be resumed.

        """
        recorder = self._recorder
        if recorder is None:
            return
        if closed:
            self.flush(closed)
        if not recorder.close(END_TIMEOUT):
            self._complain(
                f'the record {recorder.folder} is not whole: '
                f'{recorder.problem or "the disk is too slow"}'
            )
        self._recorder = None

    def describe(self) -> Condition:
        """Return the condition of the record."""
        recorder = self._recorder
        if recorder is None:
            return Condition(self._problem, {'record': 'none'})
        problem = ''
        if recorder.problem:
            problem = f'the record is not written: {recorder.problem}'
        elif recorder.age > LATE:
            cause = 'the disk is slow' if recorder.busy else 'the node had no time for it'
            problem = f'the record is {recorder.age:.1f} s behind: {cause}'
        return Condition(problem, {
            'record': str(recorder.folder), 'record [MB]': round(recorder.size / 1e6, 1),
            'record behind [s]': round(recorder.age, 2),
        })


def set_aside(folder: Path) -> Path:
    """
    Rename a record whose flight was not saved, to make room for a new one.

    Raises
    ------
    DataError
        It cannot be renamed.

    """
    name = folder.name.removesuffix(SUFFIX)
    for number in range(1, MOST_NAMES):
        place = folder.with_name(f'{name}.lost_{number}{SUFFIX}')
        if not place.exists():
            try:
                folder.rename(place)
            except OSError as error:
                raise DataError(f'{folder} cannot be renamed: {error.strerror}') from error
            return place
    raise DataError(f'{folder} cannot be renamed: there are {MOST_NAMES} such records')
