# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""From the map of a flight to its results, live and from its record."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
import time
from typing import Any, TYPE_CHECKING

import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.alignment.moved_results import move_result
from plc_inspect.core.alignment.rigid_move import RigidMove
from plc_inspect.core.hazards.clearance_rules import RuleSet
from plc_inspect.core.live.session import LiveState, Session
from plc_inspect.core.live.told_state import move_state
from plc_inspect.core.live.window import copy_window, plan_everything, Window
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.core.setup.looks import LookWindow
from plc_inspect.core.voxel_buffer.voxel_map import VoxelMap
from plc_inspect.results import Float64, InspectionResult, UInt8

if TYPE_CHECKING:
    from plc_inspect.offline.records.inspection import Inspection

MAP_FULL = 'the map is full'
"""Beginning of the doubt about a map without room, whose hazards stand as they were told."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Flight:
    """Facts about a flight that its results hold besides the findings."""

    settings: Settings
    rules: RuleSet
    frame_id: str
    first_stamp_ns: int
    """Stamp of the first scan [ns], 0 without one."""
    counts: Mapping[str, Any]
    """Counts of the input so far."""
    move: RigidMove = field(default_factory=RigidMove)
    """Move from the map frame into the present frame of the odometry."""
    way: Float64 | None = None
    """(K, 4) time [s] and position in the map [m] of the vehicle, None unknown."""
    command: str = 'plc_node'
    """Name of the executable."""
    doubt: str = ''
    """Why results of the whole map are held back, '' if they are not."""

    @property
    def places(self) -> Float64 | None:
        """(K, 3) position of the vehicle in the map [m], None unknown."""
        return None if self.way is None else self.way[:, 1:]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Snapshot:
    """State of a flight at one moment; immutable."""

    window: Window
    flight: Flight
    stamp_ns: int
    """Stamp of the newest scan in the map [ns]."""
    vehicle: Float64 | None
    complete: bool
    """Whether nothing was evicted from the map."""
    looks: Sequence[LookWindow] = ()
    """Looks since the last job, for the measurement of sharpness."""


def copy_everything(voxels: VoxelMap) -> Window:
    """Return a window with the whole map."""
    copy = copy_window(voxels, plan_everything(voxels, []))
    return next(item for item in copy if item is not None)


def conclude(
    session: Session, snapshot: Snapshot
) -> tuple[LiveState, 'Inspection', UInt8]:
    """Run the pipeline over the whole map; its labels go to the map."""
    started = time.perf_counter()
    window, flight = snapshot.window, snapshot.flight
    session.way = flight.places
    state, result, labels = session.conclude(
        window.points, flight.settings, window.sequence, complete=snapshot.complete,
        rules=flight.rules, looks=snapshot.looks,
    )
    flight = replace(flight, counts={**flight.counts, **describe_sharpness(state)})
    seconds = time.perf_counter() - started
    moved = move_result(result, flight.move)
    points = flight.move.apply(window.points)
    return state, describe_run(flight, moved, points, seconds), labels


def describe_sharpness(state: LiveState) -> dict[str, Any]:
    """Return the sharpness of the map, JSON-serialisable, and why hazards are held back."""
    held = state.sharpness.describe() if state.sharpness.poor else ''
    return {
        'sharpness': state.sharpness.record(), 'held_back': held, 'lean': state.sharpness.remark,
    }


def describe_last_tick(flight: Flight, state: LiveState) -> 'Inspection':
    """
    Return the results of the last tick, without points.

    Parameters
    ----------
    flight : Flight
        Facts about the flight.  If it is in doubt, hazards are left out unless by a full map.
    state : LiveState
        What the tick told.

    Returns
    -------
    Inspection
        With the doubt in ``counts['held_back']``.

    """
    doubt = flight.doubt
    if doubt and not doubt.startswith(MAP_FULL):
        state = replace(state, hazards=(), sharpness=replace(state.sharpness, doubt=doubt))
    sharpness = describe_sharpness(state)
    empty = np.empty((0, 3))
    state = move_state(state, flight.move)
    result = replace(
        Pipeline(flight.settings, flight.rules).run(empty),
        spans=tuple(item.span for item in state.confirmed),
        supports=state.supports, hazards=state.hazards,
    )
    part = replace(flight, counts={
        **flight.counts, **sharpness, 'held_back': sharpness['held_back'] or doubt,
        'results_of': 'the last tick',
    })
    return describe_run(part, result, empty)


def describe_run(
    flight: Flight, result: InspectionResult, points: Float64, seconds: float = 0.0
) -> 'Inspection':
    """Return the inspection of a flight from its result."""
    from plc_inspect.offline.records.inspection import Inspection

    way = flight.way
    if way is not None:
        way = np.column_stack([way[:, 0], flight.move.apply(way[:, 1:])])
    return Inspection(
        result=result,
        points=points,
        settings=flight.settings,
        source=flight.settings.input.scan_topic,
        command=flight.command,
        frame_id=flight.frame_id,
        rules=flight.rules,
        counts=flight.counts,
        way=way,
        seconds={'pipeline': seconds},
    )
