# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The node's flight record: found again at the start, written in flight, ended at the end."""

from collections.abc import Callable
import os
from pathlib import Path
import time
from typing import Any

from plc_inspect.config import Settings
from plc_inspect.core.hazards.clearance_rules import RuleSet
from plc_inspect.core.live.session import CORRIDOR_REACH, Kept, Session
from plc_inspect.errors import DataError
from plc_inspect.flight_record.layout import list_segments
from plc_inspect.flight_record.plain_values import to_plain
from plc_inspect.flight_record.reader import Flight
from plc_inspect.flight_record.recorder import is_held
from plc_inspect.flight_record.recording import Condition, Recording, set_aside
from plc_inspect.flight_record.resumption import (
    find_newest,
    Found,
    judge_pose,
    look_at,
    name_record,
)
from plc_inspect.messages.poses import StampedPose
from plc_inspect.ros.background.saving import choose_folder, Saved
from plc_inspect.ros.graph.voices import Voices
from plc_inspect.ros.node.intake import Intake
from plc_inspect.setting_names import to_mapping
from plc_inspect.shared_files import find_home
from plc_inspect.whole_files import sweep_partial

MOST_REFUSED = 5
"""Poses that cannot be of the flight, until it is another one; one may be astray."""


class Keeper:
    """
    Keeps the record of a flight; for the executor's thread only.

    Parameters
    ----------
    settings : Settings
        At the start.
    rules : RuleSet
        At the start.
    intake : Intake
        Owns the map.
    log : Voices
        Of the node.
    forget : callable
        Takes why: odometry showed that it is another flight, the map is empty now.

    """

    def __init__(
        self, settings: Settings, rules: RuleSet, intake: Intake, log: Voices,
        forget: Callable[[str], object],
    ) -> None:
        self._settings, self._intake = settings, intake
        self._say, self._complain = log.info, log.error
        self._header = {
            'settings': to_mapping(settings), 'rules': to_plain(rules), 'pid': os.getpid(),
        }
        self._wanted = settings.output.record
        self._flight: Flight | None = None
        self._num_refused = 0
        self._held_since: float | None = None
        self._changed: dict[str, Any] = {}
        self._recording = self._make_recording()
        self._forget = forget

    def _make_recording(self) -> Recording:
        return Recording(
            self._intake.accumulator.map, lambda: {**self._intake.remember(), **self._changed},
            self._complain,
        )

    def configure(self, settings: Settings, rules: RuleSet) -> None:
        """Tell of changed settings from now on."""
        self._changed = {'settings': to_mapping(settings), 'rules': to_plain(rules)}

    def resume(self, session: Session) -> bool:
        """
        Go on with the flight of the record that is there, or say why not.

        Returns
        -------
        bool
            Whether map and session are those of the record now.

        """
        output = self._settings.output
        place = Path(output.directory).expanduser() if output.directory else None
        self._sweep(find_home() if place is None else place.parent, place)
        if not self._wanted:
            return False
        record = name_record(place) if place is not None else find_newest(find_home())
        if record is not None and list_segments(record) and not is_held(record):
            found = look_at(record, self._settings)
            reason = self._go_on(found, session)
            if not reason:
                return True
            if not found.over:
                self._put_aside(record, reason)
        if place is not None:
            self._begin(place)
        return False

    def _sweep(self, folder: Path, place: Path | None) -> None:
        for path in sweep_partial(folder, place.name if place is not None else ''):
            self._say(f'{path} was left half-written by another run: it is removed')

    def _go_on(self, found: Found, session: Session) -> str:
        """Take up the flight of a record; return why not, '' if it is done."""
        flight, intake = found.flight, self._intake
        if flight is None:
            return found.reason
        try:
            intake.resume(flight.state, flight.map)
        except (DataError, KeyError, TypeError, ValueError, IndexError) as error:
            intake.disown()
            return f'it is damaged: {type(error).__name__}: {error}'
        session.restore(flight.kept)
        if intake.vehicle is not None:
            cells = intake.accumulator.map.cells
            cells.renew(cells.find_near(intake.vehicle, CORRIDOR_REACH))
        self._recording.begin(found.folder, self._header, fresh=False)
        self._recording.keep(flight.kept)
        self._flight, intake.judge_pose = flight, self._judge
        if intake.accumulator.mount is not None:
            self._held_since, intake.judge_scan = None, self._judge_scan
        for note in flight.notes:
            self._complain(note)
        self._say(
            f'the flight of {found.folder} goes on: {len(intake.accumulator.map)} voxels, '
            f'{len(flight.kept.spans.spans)} spans, {len(flight.kept.hazards.hazards)} hazards; '
            f'it was interrupted for {time.time() - flight.state["time"]:.1f} s'
        )
        return ''

    def _judge(self, pose: StampedPose) -> bool:
        """Look at the first poses after an interruption: another flight begins anew."""
        flight = self._flight
        frames = pose.frame_id, pose.child_frame_id
        reason = '' if flight is None else judge_pose(
            flight.state, frames, pose.stamp_ns, pose.position
        )
        self._num_refused += bool(reason)
        if reason and self._num_refused < MOST_REFUSED:
            return False
        self._flight = self._intake.judge_pose = None
        if reason:
            self._begin_another(reason)
        return True

    def _judge_scan(self, frame: str) -> bool:
        """Hold the first scans back until the lidar is mounted as in the map, or another way."""
        before, mount = self._intake.accumulator.mount, self._intake.find_mount(frame)
        if before is None or mount.equals(before):
            self._intake.judge_scan = None
            return True
        now = time.monotonic()
        self._held_since = self._held_since or now
        if now - self._held_since <= self._settings.input.max_wait:
            return False
        self._begin_another(
            f'the mount of the lidar is {mount.describe()}, and was {before.describe()}'
        )
        return True

    def _begin_another(self, reason: str) -> None:
        """Forget the flight that was resumed, its record put aside, and begin anew."""
        folder = self._recording.folder
        self._flight = self._intake.judge_pose = self._intake.judge_scan = None
        self._recording.close()
        self._forget(reason)  # saves what was found, named after the flight that it is of
        self._intake.disown()
        self._recording = self._make_recording()
        if folder is not None:
            self._put_aside(folder, reason)
        if self._settings.output.directory:
            self._begin(Path(self._settings.output.directory).expanduser())

    def _put_aside(self, record: Path, reason: str) -> None:
        """Say that a flight was not saved; where another one takes its place, it makes way."""
        try:
            place = set_aside(record) if self._settings.output.directory else record
        except DataError as error:
            self._wanted = False
            self._complain(f'no record is written: {error}')
            return
        self._complain(
            f'the flight of {record} does not go on: {reason}; it was not saved, '
            f'"plc_recover {place} -o OUT" does it'
        )

    def _begin(self, results: Path) -> None:
        if self._wanted:
            record, number = name_record(results), 1
            while not self._settings.output.directory and record.exists():
                number += 1
                record = name_record(results.with_name(f'{results.name}_{number}'))
            self._recording.begin(record, self._header, fresh=True)
            self._wanted = self._recording.folder is not None

    def step(self) -> None:
        """Take a little of what changed; without a folder it begins with the first scan."""
        stamp = self._intake.first_stamp
        if self._recording.folder is None and self._wanted and stamp is not None:
            self._begin(choose_folder(self._settings.output, stamp))
        self._recording.step()

    def keep(self, kept: Kept) -> None:
        """Take what the session keeps now."""
        self._recording.keep(kept)

    def forget(self) -> None:
        """Take that the session keeps nothing any more."""
        self._recording.forget()

    def describe(self) -> Condition:
        """Return what is to be said of the record."""
        return self._recording.describe()

    def flush(self) -> None:
        """Hand all over that changed, before the results are saved."""
        self._recording.flush()

    def close(self, saved: Saved | None, *, wanted: bool = True) -> None:
        """End the record; where results are wanted and not whole, say how to get them from it."""
        folder = self._recording.folder
        done = saved is not None and saved.whole
        self._recording.close(str(saved.folder) if saved is not None and saved.whole else '')
        if folder is not None and wanted and not done:
            self._complain(f'"plc_recover {folder} -o OUT" makes the results from the record')
