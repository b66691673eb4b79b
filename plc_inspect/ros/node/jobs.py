# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What the node's worker is given and does besides ticks: windows, snapshots, results."""

from collections.abc import Callable
from dataclasses import replace
import threading

import numba

from plc_inspect.config import Settings
from plc_inspect.core.hazards.clearance_rules import RuleSet
from plc_inspect.core.live.session import LiveState, Session
from plc_inspect.core.live.told_state import move_state
from plc_inspect.core.live.window import plan_everything, Window, WindowPlan, WindowPlanner
from plc_inspect.core.tracking.hazard_tracking import HazardNews
from plc_inspect.errors import DataError
from plc_inspect.node_config import OutputSettings
from plc_inspect.offline.records.flight import (
    conclude,
    copy_everything,
    describe_last_tick,
    Flight,
    Snapshot,
)
from plc_inspect.results import Span
from plc_inspect.ros.background.saving import save_results, Saved
from plc_inspect.ros.background.tick_job import Done
from plc_inspect.ros.node.intake import Intake
from plc_inspect.ros.results.publishing import make_bundle
from plc_inspect.ros.results.teller import tell_hazards

ALL_THREADS: int = numba.get_num_threads()
RESCUE_AFTER = 20.0
"""Results of the last tick are written where those of the whole map take longer [s]."""
GIVE_UP_AFTER = 120.0
"""The whole map is waited for no longer [s]."""


def plan_tick(
    planner: WindowPlanner, intake: Intake, state: LiveState | None, at_once: bool
) -> WindowPlan | None:
    """Choose the window of a tick, of what the last one found; None when nothing is new."""
    return planner.plan(
        intake.accumulator.map, _list_spans(state), intake.vehicle, at_once=at_once,
        ground=bool(state and state.around.ground), waiting=state.awaited if state else None,
    )


def plan_save(intake: Intake, state: LiveState | None) -> WindowPlan:
    """Return the plan of a window that is the whole map."""
    return plan_everything(intake.accumulator.map, _list_spans(state))


def _list_spans(state: LiveState | None) -> list[Span]:
    return [item.span for item in state.spans] if state else []


def take_flight(intake: Intake, settings: Settings, rules: RuleSet) -> Flight:
    """Return what results tell of the flight now."""
    return Flight(
        settings=settings,
        rules=rules,
        frame_id=intake.accumulator.frame_id,
        first_stamp_ns=intake.first_stamp or 0,
        counts=intake.describe(),
        way=intake.way.places,
        move=intake.move.inverse(),
        doubt=intake.doubt,
    )


def take_snapshot(intake: Intake, window: Window, flight: Flight) -> Snapshot:
    """Return what is known of the flight now; the meter of sharpness begins anew."""
    return Snapshot(
        window=window,
        flight=flight,
        stamp_ns=intake.accumulator.last_inserted or 0,
        vehicle=intake.vehicle,
        complete=intake.evictor.complete,
        looks=intake.accumulator.entry.meter.take(),
    )


def run_save(session: Session, snapshot: Snapshot) -> Done:
    """Run the pipeline over the whole map and write the results folder, or say why not."""
    numba.set_num_threads(ALL_THREADS)
    session.way = snapshot.flight.places
    sharpness = session.measure(snapshot.window.points, snapshot.looks)
    if sharpness.hopeless:
        raise DataError(sharpness.describe())
    state, inspection, labels = conclude(session, replace(snapshot, looks=()))
    flight = snapshot.flight
    saved = save_results(flight.settings.output, flight.first_stamp_ns, inspection)
    if state.sharpness.poor:
        told = [item for item in (saved.problem, state.sharpness.describe()) if item]
        saved = replace(saved, problem='; '.join(told))
    return Done(
        state=state,
        bundle=make_bundle(
            move_state(state, flight.move), flight.frame_id, snapshot.stamp_ns,
            flight.settings.stream,
        ),
        slots=snapshot.window.slots,
        points=snapshot.window.points,
        labels=labels,
        kept=session.remember(),
        session=session,
        saved=saved,
    )


class FinalSave:
    """
    Writes the results of the whole map, or those of the last tick.

    Parameters
    ----------
    say, complain : callable
        Take a line of text for the log.

    """

    def __init__(self, say: Callable[[str], object], complain: Callable[[str], object]) -> None:
        self._say, self._complain = say, complain
        self._writing = threading.Lock()
        self.saved: Saved | None = None
        """What became of the results of the whole map, None if nothing yet."""
        self._error: Exception | None = None
        self._doubt = ''
        self._news = HazardNews()

    def save(
        self, session: Session, intake: Intake, flight: Flight, state: LiveState | None, late: str
    ) -> bool:
        """
        Write the results of the whole map, or those of the last tick where the map is in doubt.

        Parameters
        ----------
        session : Session
            What is known; belongs to this object from now on.
        intake : Intake
            Owns the map.
        flight : Flight
            What the results tell of it.
        state : LiveState or None
            Of the last tick.
        late : str
            Why the map cannot be used, '' if it can.

        Returns
        -------
        bool
            Whether all files of the whole map were written, and nothing was held back.

        """
        blurred = state.sharpness.describe() if state and state.sharpness.hopeless else ''
        if reason := late or flight.doubt or blurred:
            self._complain(rescue(flight, state, reason))
            return False
        window = copy_everything(intake.accumulator.map)
        return self.run(session, take_snapshot(intake, window, flight), state)

    def run(self, session: Session, snapshot: Snapshot, state: LiveState | None) -> bool:
        """
        Write the results of the whole map.

        Parameters
        ----------
        session : Session
            What is known; belongs to this object from now on.
        snapshot : Snapshot
            The whole map.
        state : LiveState or None
            Of the last tick, for when the map takes too long or fails.

        Returns
        -------
        bool
            Whether all files of the whole map were written, and nothing was held back.

        """
        thread = threading.Thread(
            target=self._conclude, args=(session, snapshot), name='plc_save', daemon=True
        )
        thread.start()
        thread.join(RESCUE_AFTER)
        if thread.is_alive() and self._writing.acquire(blocking=False):
            try:
                self._complain(rescue(
                    snapshot.flight, state, f'the map takes longer than {RESCUE_AFTER:g} s'
                ))
            finally:
                self._writing.release()
        thread.join(max(GIVE_UP_AFTER - RESCUE_AFTER, 0.0))
        if thread.is_alive():
            self._complain(f'the map was not worked through within {GIVE_UP_AFTER:g} s')
        elif self._error is not None:
            self._complain(f'the map failed: {type(self._error).__name__}: {self._error}')
            self._complain(rescue(snapshot.flight, state, 'the map failed'))
        elif self.saved is not None:
            tell_hazards(self._news, self._say, self._complain)
            tell = self._complain if self.saved.problem else self._say
            tell(self.saved.describe())
            if self._doubt:
                self._complain(self._doubt)
            return self.saved.whole and not self._doubt
        return False

    def _conclude(self, session: Session, snapshot: Snapshot) -> None:
        try:
            numba.set_num_threads(ALL_THREADS)
            concluded, inspection, _ = conclude(session, snapshot)
        except Exception as error:
            self._error = error
            return
        if concluded.sharpness.poor:
            self._doubt = concluded.sharpness.describe()
        self._news = concluded.news
        flight = snapshot.flight
        with self._writing:
            self.saved = save_results(
                flight.settings.output, flight.first_stamp_ns, inspection
            )


def rescue(flight: Flight, state: LiveState | None, reason: str) -> str:
    """
    Write the results of the last tick alone, where the map is busy or gone.

    Parameters
    ----------
    flight : Flight
        What the results tell of it.
    state : LiveState or None
        Of the last tick.
    reason : str
        Why the map is not asked.

    Returns
    -------
    str
        What became of the results, for the log.

    """
    if state is None:
        return f'nothing saved: {reason}, and no tick was done before'
    return _tell(_save_tick(flight, state, flight.settings.output), reason)


def keep_state(flight: Flight, state: LiveState | None, reason: str, *, lose: bool) -> str:
    """
    Save what was found in a map that is given up for a reason; return what became of it, or ''.

    It goes to a folder of its own, as that of the settings is taken at the end of the flight.

    Raises
    ------
    DataError
        It could not be saved anywhere, and may not be lost.

    """
    if state is None or not state.confirmed:
        return ''
    saved = _save_tick(flight, state, OutputSettings())
    if saved.folder is None and not lose:
        raise DataError(
            f'{len(state.confirmed)} spans would be lost, and cannot be saved: {saved.problem}'
        )
    return _tell(saved, reason)


def _save_tick(flight: Flight, state: LiveState, output: OutputSettings) -> Saved:
    return save_results(output, flight.first_stamp_ns, describe_last_tick(flight, state))


def _tell(saved: Saved, reason: str) -> str:
    return f'{reason}; results of the last tick, without points: {saved.describe()}'
