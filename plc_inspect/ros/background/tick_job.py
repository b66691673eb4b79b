# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A tick with its messages, in whatever thread or process, and what it needs made ready."""

from dataclasses import dataclass

import numba

from plc_inspect.config import Settings
from plc_inspect.core.live.session import Kept, LiveState, Session
from plc_inspect.core.live.told_state import move_state
from plc_inspect.core.live.warm_up import warm_up_pipeline
from plc_inspect.offline.records.flight import Snapshot
from plc_inspect.results import Float64, Int64, UInt8
from plc_inspect.ros.background.saving import Saved
from plc_inspect.ros.results.publishing import Bundle, make_bundle

TICK_THREADS = 1
"""On a busy machine a second thread is waited for longer than it helps with small windows."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Done:
    """What a job hands back."""

    state: LiveState
    bundle: Bundle
    slots: Int64
    points: Float64
    labels: UInt8
    """For the map: one for each point of the window."""
    kept: Kept
    """What the session keeps, for the record."""
    session: Session
    """Goes on from here."""
    saved: Saved | None = None
    """What became of the results, None for a tick."""


def prepare(settings: Settings, *, rare: bool = False) -> None:
    """Make ready what every tick needs, with all cores, or what few do, beside scans with one."""
    if rare:
        numba.set_num_threads(TICK_THREADS)
    warm_up_pipeline(settings, rare=rare)


def run_tick(session: Session, snapshot: Snapshot) -> Done:
    """Run one tick and build its messages; it takes one core and leaves the others alone."""
    numba.set_num_threads(TICK_THREADS)
    window, flight = snapshot.window, snapshot.flight
    session.way = flight.places
    tick = session.tick(
        window, flight.settings, snapshot.vehicle, flight.rules, snapshot.looks
    )
    return Done(
        state=tick.state,
        bundle=make_bundle(
            move_state(tick.state, flight.move), flight.frame_id, snapshot.stamp_ns,
            flight.settings.stream,
        ),
        slots=window.slots[:len(tick.labels)],
        points=window.points[:len(tick.labels)],
        labels=tick.labels,
        kept=session.remember(),
        session=session,
    )
