# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What the node's worker does: the start, what few ticks need, a tick, a results folder."""

from collections.abc import Mapping
from dataclasses import dataclass
import os
from pathlib import Path
import time
from typing import Any

import numba

from plc_inspect.config import Settings
from plc_inspect.core.live.session import LiveState, Session
from plc_inspect.core.live.warm_up import warm_up_pipeline
from plc_inspect.core.live.window import Window
from plc_inspect.errors import PlcInspectError
from plc_inspect.results import Float64, Int64, UInt8
from plc_inspect.ros.node.publishing import Bundle, make_bundle

COMMAND = 'plc_node'
ALL_THREADS: int = numba.get_num_threads()
TICK_THREADS = 1
"""On a busy machine a second thread is waited for longer than it helps with small windows."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Snapshot:
    """What a job works on; nothing in it changes afterwards."""

    window: Window
    settings: Settings
    frame_id: str
    stamp_ns: int
    """Newest scan that is in [ns]."""
    vehicle: Float64 | None
    complete: bool
    """Nothing was evicted from the map."""
    counts: Mapping[str, Any]
    """What came in so far."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Done:
    """What a job hands back."""

    state: LiveState
    bundle: Bundle
    slots: Int64
    points: Float64
    labels: UInt8
    """For the map: one for each point of the window."""
    folder: Path | None = None
    problem: str = ''
    """Why no folder was written."""


def prepare(settings: Settings, *, rare: bool = False) -> None:
    """Make ready what every tick needs, with all cores, or what few do, beside scans with one."""
    if rare:
        numba.set_num_threads(TICK_THREADS)
    warm_up_pipeline(settings, rare=rare)


def run_tick(session: Session, snapshot: Snapshot) -> Done:
    """Run one tick and build its messages; it takes one core and leaves the others alone."""
    numba.set_num_threads(TICK_THREADS)
    window = snapshot.window
    tick = session.tick(window, snapshot.settings, snapshot.vehicle)
    return Done(
        state=tick.state,
        bundle=make_bundle(
            tick.state, snapshot.frame_id, snapshot.stamp_ns, snapshot.settings.stream
        ),
        slots=window.slots,
        points=window.points,
        labels=tick.labels,
    )


def run_save(session: Session, snapshot: Snapshot, folder: Path) -> Done:
    """
    Run the pipeline over the whole map and write the results folder.

    A folder that cannot be written is told of in ``problem``.
    """
    from plc_inspect.offline.export.results_folder import write_results
    from plc_inspect.offline.records.inspection import Inspection

    numba.set_num_threads(ALL_THREADS)
    started = time.perf_counter()
    window = snapshot.window
    state, result, labels = session.conclude(
        window.points, snapshot.settings, window.sequence, complete=snapshot.complete
    )
    inspection = Inspection(
        result=result,
        points=window.points,
        settings=snapshot.settings,
        source=snapshot.settings.input.scan_topic,
        command=COMMAND,
        frame_id=snapshot.frame_id,
        counts=snapshot.counts,
        seconds={'pipeline': time.perf_counter() - started},
    )
    problem = ''
    try:
        write_results(folder, inspection, force=True)
    except PlcInspectError as error:
        problem = str(error)
    return Done(
        state=state,
        bundle=make_bundle(
            state, snapshot.frame_id, snapshot.stamp_ns, snapshot.settings.stream
        ),
        slots=window.slots,
        points=window.points,
        labels=labels,
        folder=None if problem else folder,
        problem=problem,
    )


def choose_folder(settings: Settings, stamp_ns: int) -> Path:
    """
    Return where the results go.

    Parameters
    ----------
    settings : Settings
        ``output.directory``; where it is empty, a new folder below ROS_HOME (~/.ros) is named
        after the time of the first scan.
    stamp_ns : int
        Stamp of the first scan [ns].

    Returns
    -------
    Path

    """
    if settings.output.directory:
        return Path(settings.output.directory).expanduser()
    home = Path(os.environ.get('ROS_HOME') or Path.home() / '.ros') / 'plc_inspect'
    name = time.strftime('flight_%Y%m%dT%H%M%SZ', time.gmtime(stamp_ns // 1_000_000_000))
    folder, number = home / name, 1
    while folder.exists():
        number += 1
        folder = home / f'{name}_{number}'
    return folder
