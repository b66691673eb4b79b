# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
The part of the map that one tick of the node processes.

A plan cell is fresh when enough of it is new and something stands high in it.  Fresh cells are
taken whole, except for ground and foliage that earlier ticks saw far from conductors, which are
sampled.  Of their neighbours, and along the whole length of the spans through them, all that was
ever linear is taken, with samples of ground and wires, so that a span is always fitted along its
whole length.  Of the spans next to those the part near the joint is taken.  The cost follows what
is new, not the length of the flight.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import itertools
import math

from numba import njit
import numpy as np

from plc_inspect.core.live.owed_cells import add_waiting, NEAR
from plc_inspect.core.voxel_buffer.cell_index import CellIndex
from plc_inspect.core.voxel_buffer.voxel_map import VoxelMap
from plc_inspect.results import Bool, Decision, Float64, Int32, Int64, Span, SpanKey, UInt8

GROWTH = 0.1
"""
Share of new voxels that makes a cell near the vehicle fresh.
Source: judgement; not measured.
"""
QUIET = 30
"""Scans without a new voxel after which a cell is quiet.  Source: judgement; not measured."""
STUB = 60.0
"""
Length that is taken of a neighbouring span, from the joint [m].
Source: judgement; not measured.
"""
SIDE = 8.0
"""Distance beside a span within which points are taken [m].  Source: judgement; not measured."""
SPACING = 5.0
"""
Spacing of the samples that find a span's cells, at most: half a cell [m].
Source: judgement; not measured.
"""
JOINT = 5.0
"""Distance of span ends that hang on one support [m].  Source: judgement; not measured."""
MOST_CONDUCTORS = 100
"""Conductors counted in a cell.  Source: numerical: multiples of samples are uint8."""
CHUNK = 20_000
"""Voxels copied in one step.  Source: numerical: bounds the time of a step."""
NUM_TURNS = 8
"""Directions from a sample in which SIDE is looked to.  Source: judgement; not measured."""
WHOLE_SAMPLES = 4
"""
Samples of ground and foliage far from wires in a fresh cell, by SAMPLE of `cell_lists`.
Source: judgement; not measured.
"""
GROUND_SAMPLES = 2
"""Samples of ground in any other cell.  Source: judgement; not measured."""
SUPPORT_SAMPLES = 4
"""Samples of supports in any other cell.  Source: judgement; not measured."""
WIRE_SAMPLES = 1
"""Samples of wire in any other cell, a conductor in it.  Source: judgement; not measured."""
UNSURE_SAMPLES = 10
"""Samples of unseen voxels and of outliers in any other cell.  Source: judgement; not measured."""

_TURN = np.linspace(0.0, 2.0 * np.pi, NUM_TURNS, endpoint=False)
_AROUND = SIDE * np.vstack(([[0.0, 0.0]], np.column_stack((np.cos(_TURN), np.sin(_TURN)))))

CLOSE = 100
"""
Label of a voxel close to a conductor but not of it; other labels are Decision, 0 is unseen.
Source: numerical: above every Decision.
"""
LEAST_CLOSE = 8.0
"""
Distance from a conductor within which points are never sampled, whatever the rules ask for [m].
Source: judgement; not measured.
"""

WHOLE: UInt8 = np.ones(256, dtype=np.uint8)
"""Labels taken from fresh cells: all, but samples of ground and foliage far from wires."""
WHOLE[[Decision.GROUND, Decision.TOO_LOW, Decision.NOT_LINEAR]] = 1 + WHOLE_SAMPLES

THIN: UInt8 = np.zeros(256, dtype=np.uint8)
"""Labels taken from other cells: what is new or was ever linear, and a little ground."""
THIN[Decision.GROUND] = 1 + GROUND_SAMPLES
THIN[Decision.SUPPORT] = 1 + SUPPORT_SAMPLES
THIN[Decision.WIRE] = 1 + WIRE_SAMPLES
THIN[[0, Decision.OUTLIER]] = 1 + UNSURE_SAMPLES
THIN[[Decision.NO_SECTION, Decision.NO_CLUSTER, Decision.NO_CATENARY]] = 1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WindowPlan:
    """What to copy from the map."""

    fresh: Int64
    """(C,) fresh cells, to be copied whole."""
    thin: Int64
    """(T,) cells around them and along spans, to be copied in part."""
    conductors: Int64
    """(T,) known spans through each of these, at least 1."""
    everything: bool
    """Copy the whole map, in the order in which its voxels were made."""
    spans: frozenset[SpanKey]
    """Known spans that are in the window along their whole length, with both neighbours."""
    sequence: int
    """Newest insertion of the map."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Window:
    """Copies of M voxels; nothing in it changes afterwards."""

    slots: Int64
    """(M,) slots in the map."""
    points: Float64
    """(M, 3) centroids, map frame [m]."""
    fresh: Int64
    """(C, 2) places on the grid of cells that are there whole."""
    cell_size: float
    """Edge of a plan cell [m]."""
    spans: frozenset[SpanKey]
    """Known spans that are there along their whole length, with both neighbours."""
    sequence: int
    """Newest insertion of the map."""

    def holds(self, points: Float64) -> Bool:
        """Return which of (N, 2+) points lie in fresh cells."""
        fresh = np.sort(_pack(self.fresh))
        points = np.ascontiguousarray(points, dtype=np.float64)
        found: Bool = _find_held(points, self.cell_size, fresh)
        return found


@njit(cache=True, nogil=True)
def _find_held(points, cell_size, fresh):  # type: ignore[no-untyped-def]
    """Tell which points lie in cells whose packed places, ascending, are given."""
    result = np.zeros(len(points), dtype=np.bool_)
    last, held = np.int64(0), False  # neighbours are often of one cell
    for k in range(len(points)):
        row = np.int64(math.floor(points[k, 0] / cell_size))
        key = (row << 32) + np.int64(math.floor(points[k, 1] / cell_size))
        if k == 0 or key != last:
            place = np.searchsorted(fresh, key)
            last, held = key, bool(place < len(fresh) and fresh[place] == key)
        result[k] = held
    return result


def sample_span(span: Span, spacing: float) -> Float64:
    """Return (K, 2) plan points along a span, ends included, at most ``spacing`` apart."""
    share = np.linspace(0.0, 1.0, max(2, int(np.ceil(span.length / spacing)) + 1))
    result: Float64 = span.start[:2] + share[:, None] * (span.end[:2] - span.start[:2])
    return result


class WindowPlanner:
    """
    Chooses the window of each tick.

    Parameters
    ----------
    beta : float
        A cell with something this far above the lowest place around it is high [m].
    reach : float
        Conductors this near to a fresh cell are taken with it, as a rule may hold there [m].
    close : float
        A cell this near to the vehicle is fresh with anything new in it; -inf: none is [m].

    """

    def __init__(self, beta: float, reach: float = 0.0, close: float = -math.inf) -> None:
        self._beta, self._reach, self._close = beta, reach, close

    def plan(
        self, voxels: VoxelMap, spans: Sequence[Span], vehicle: Float64 | None, *,
        at_once: bool = False, ground: bool = True, waiting: Float64 | None = None,
    ) -> WindowPlan | None:
        """
        Choose the window and settle its fresh cells.

        Parameters
        ----------
        voxels : VoxelMap
            Its cells are settled where they are fresh.
        spans : sequence of Span
            Known so far.
        vehicle : Float64 or None
            (2+,) where the vehicle is [m]; None: everywhere near.
        at_once : bool
            Take every high cell with anything new in it.
        ground : bool
            Ground was seen about the vehicle; else the lowest may be wires: each cell is high.
        waiting : Float64 or None
            (W, 2+) where hazards wait to be seen again, whose cells are fresh too [m].

        Returns
        -------
        WindowPlan or None
            None when nothing is new.

        """
        cells = voxels.cells
        fresh = self._find_fresh(cells, voxels.sequence, vehicle, at_once, ground)
        fresh = add_waiting(cells, fresh, waiting, vehicle)
        if not len(fresh):
            return None
        index = cells.index
        around = _find_around(cells, index[fresh], 1)
        width = max(1, math.ceil(self._reach / cells.cell_size))
        within = around if width == 1 else _find_around(cells, index[fresh], width)
        core, stubs = _involve(spans, cells, index[within])
        samples = [sample_span(span, SPACING) for span in core] + stubs
        along = _concatenate([_cells_of(at, cells) for at in samples])
        thin = np.setdiff1d(np.union1d(around, along), fresh)
        passed = _concatenate([np.unique(cells.find(cells.locate(at))) for at in samples])
        known = np.bincount(passed[passed >= 0], minlength=len(cells))
        cells.settle(fresh)
        return WindowPlan(
            fresh=fresh,
            thin=thin,
            conductors=np.maximum(known[thin], 1),
            everything=False,
            spans=frozenset(_key(span) for span in core),
            sequence=voxels.sequence,
        )

    def _find_fresh(
        self, cells: CellIndex, sequence: int, vehicle: Float64 | None, at_once: bool,
        ground: bool,
    ) -> Int64:
        new = np.flatnonzero(cells.num_new)
        if not len(new):
            return new
        around = cells.find(_list_around(cells.index[new], 1).reshape(-1, 2))
        low = np.where(around >= 0, cells.low[around], np.inf).reshape(len(new), -1)
        high = cells.high[new] - low.min(axis=1) >= (self._beta if ground else 0.0)
        num_new = cells.num_new[new]
        due = num_new > GROWTH * (cells.count[new] - num_new)
        if vehicle is not None:
            apart = np.linalg.norm(cells.centers[new] - vehicle[:2], axis=1)
            close = apart <= self._close + cells.cell_size * math.sqrt(0.5)
            high, due = high | close, close | (due & (apart <= NEAR))
        quiet = sequence - cells.touched[new] > QUIET
        cells.settle(new[quiet & ~high])
        return new[high & (quiet | due | at_once)]


def copy_window(voxels: VoxelMap, plan: WindowPlan) -> Iterator[Window | None]:
    """
    Copy a window in steps, so that the owner of the map can do other things between them.

    Parameters
    ----------
    voxels : VoxelMap
        The map of the plan; scans may be inserted between steps.
    plan : WindowPlan
        What to copy.

    Yields
    ------
    Window or None
        None after each step, at last the window.

    """
    parts = [voxels.copy_voxels(np.empty(0, dtype=np.int32))]
    for slots in _list_everything(voxels) if plan.everything else _list_slots(voxels, plan):
        parts.append(voxels.copy_voxels(slots))
        yield None
    index = voxels.cells.index
    yield Window(
        slots=np.concatenate([part[0] for part in parts]),
        points=np.concatenate([part[1] for part in parts]),
        fresh=index[plan.fresh],
        cell_size=voxels.cells.cell_size,
        spans=plan.spans,
        sequence=plan.sequence,
    )


def plan_everything(voxels: VoxelMap, spans: Sequence[Span]) -> WindowPlan:
    """Return the plan of a window that is the whole map; nothing is settled."""
    everything = np.arange(len(voxels.cells))
    return WindowPlan(
        fresh=everything,
        thin=everything[:0],
        conductors=everything[:0],
        everything=True,
        spans=frozenset(_key(span) for span in spans),
        sequence=voxels.sequence,
    )


def _list_everything(voxels: VoxelMap) -> Iterator[Int32]:
    start = 0
    while start < voxels.num_slots:
        stop = min(start + CHUNK, voxels.num_slots)
        yield np.arange(start, stop, dtype=np.int32)
        start = stop


def _list_slots(voxels: VoxelMap, plan: WindowPlan) -> Iterator[Int32]:
    parts = [(plan.fresh, WHOLE)]
    for number in np.unique(plan.conductors):
        wanted = THIN.copy()
        wanted[Decision.WIRE] = 1 + min(int(number), MOST_CONDUCTORS) * (THIN[Decision.WIRE] - 1)
        parts.append((plan.thin[plan.conductors == number], wanted))
    for cells, wanted in parts:
        for group in _split(cells, voxels.cells.count[cells]):
            yield voxels.collect(group, wanted)


def _key(span: Span) -> SpanKey:
    return span.line_id, span.span_id


def _pack(place: Int64) -> Int64:
    return (place[:, 0] << 32) + place[:, 1]


def _split(cells: Int64, count: Int32) -> list[Int64]:
    """Split a list of cells at every CHUNK voxels."""
    part = np.cumsum(count, dtype=np.int64) // CHUNK
    return np.split(cells, np.flatnonzero(np.diff(part)) + 1) if len(cells) else [cells]


def _find_around(cells: CellIndex, index: Int64, width: int) -> Int64:
    """Return the cells at these places and up to so many cells beside them, ascending."""
    places = np.unique(_list_around(index, width).reshape(-1, 2), axis=0)
    found = np.unique(cells.find(places))
    return found[found >= 0].astype(np.int64)


def _list_around(index: Int64, width: int) -> Int64:
    """Return for (C, 2) places (C, K, 2): they and those up to so many cells beside them."""
    square = np.mgrid[-width:width + 1, -width:width + 1].reshape(2, -1).T
    return index[:, None, :] + square


def _concatenate(parts: Sequence[Int64]) -> Int64:
    return np.concatenate([np.empty(0, dtype=np.int64), *parts])


def _cells_of(at: Float64, cells: CellIndex) -> Int64:
    """Return the cells at (K, 2) plan points and to their sides, ascending."""
    around = (at[:, None, :] + _AROUND).reshape(-1, 2)
    found = np.unique(cells.find(np.unique(cells.locate(around), axis=0)))
    return found[found >= 0].astype(np.int64)


def _involve(
    spans: Sequence[Span], cells: CellIndex, index: Int64
) -> tuple[list[Span], list[Float64]]:
    """
    Find the spans through some cells, those beside them, and the next ones along the lines.

    Of the latter only plan points near the joint are returned.
    """
    if not spans:
        return [], []
    ends = np.array([(span.start, span.end) for span in spans])
    low, high = index.min(axis=0) * cells.cell_size, (index.max(axis=0) + 1) * cells.cell_size
    box = ends[:, :, :2].min(axis=1), ends[:, :, :2].max(axis=1)
    near = ((box[0] <= high) & (box[1] >= low)).all(axis=1)
    places = _pack(index)
    touched = {
        span.span_id for span in itertools.compress(spans, near)
        if np.isin(_pack(cells.locate(sample_span(span, SPACING))), places).any()
    }
    inside = np.array([span.span_id in touched for span in spans])
    core = list(itertools.compress(spans, inside))
    by_line: dict[int, list[Span]] = {}
    for span in core:
        by_line.setdefault(span.line_id, []).append(span)
    apart = np.linalg.norm(ends[:, :, None] - ends[inside].reshape(-1, 3), axis=3)
    beside = ~inside & (apart <= JOINT).any(axis=(1, 2))
    stubs = []
    for span in itertools.compress(spans, beside):
        for other in by_line.get(span.line_id, ()):
            joint = _meet(span, other)
            if joint is not None:
                at = sample_span(span, SPACING)
                stubs.append(at[np.hypot(*(at - joint).T) <= STUB])
    return core, stubs


def _meet(span: Span, other: Span) -> Float64 | None:
    """Return the plan position of the end of a span at which another one meets it."""
    for end in (span.start, span.end):
        if any(math.dist(end, place) <= JOINT for place in (other.start, other.end)):
            return end[:2]
    return None
