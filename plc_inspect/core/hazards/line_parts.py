# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
What near a conductor is of a line, and so no hazard to it.

The continuation of a conductor beyond its ends, curves that stayed doubtful, and whatever is thin
and runs along a conductor.  In the frame of a span (x along it, y across, w above its sag) each
wire beside it is a dot that stays in its place from slab to slab; foliage is none.
"""

from collections.abc import Sequence
from dataclasses import dataclass
import itertools

import numpy as np

from plc_inspect.core.catenary.curve import Curve, span_table
from plc_inspect.core.catenary.nearest_span import find_near
from plc_inspect.core.evidence.roof_rows import find_roof_rows
from plc_inspect.core.ground.ground_grid import GroundGrid
from plc_inspect.core.hazards.blur import find_blur
from plc_inspect.core.hazards.columns import find_columns, find_straight
from plc_inspect.core.hazards.wires import (
    are_parallel,
    CLEARING,
    find_free,
    find_wires,
    FREE_LENGTH,
    FREE_SHARE,
    GONE_ON,
    measure_groups,
    ROW,
    ROW_LENGTH,
    tell_thin,
    THIN,
    TUBE,
)
from plc_inspect.core.numerics.grouping import group_cells
from plc_inspect.core.spans.point_claims import FREE_RADIUS
from plc_inspect.core.spans.span_model import SpanModel
from plc_inspect.results import Bool, Float64, Int64

WIDEST_TUBE = 0.8
"""The same at most, where a curve goes on beyond its points [m].
Source: judgement; as evidence.conductors.MAX_MISS."""
APART = 1e5
"""Distance that parts the frames of spans [m].  Source: numerical: far beyond any span."""
MARGIN = 1.0
"""Distance beyond the rules' reach of what is looked at [m].  Source: derived: over CLEARING."""
GAP = (2.0, 0.4, 0.4)
"""
Edges of the cells along, across and above a span; what lies in cells that touch is one thing [m].
Source: judgement; foliage has a point in each, sparse wires a point a metre.
"""
ABOUT = 1.0
"""Points about a curve at most, as a share of those on it, where these are of a wire.
Source: derived: evenly spread, foliage has 6 times as many there, a roof 1.7 times."""
BODY = 0.5
"""Edge of the cells that touch within what goes on away from a conductor [m].
Source: chosen on bench/hazards.py and bench/studies/planted_hazards.py: beyond 0.5 what hangs at a
pole goes on as the pole, and below 0.5 foliage seen thinly ends."""
STRAYS = 0.02
"""Share of the points on either side of a row that are not of it.  Source: judgement."""
PIECE_LENGTH = 1.0
"""Length of a piece of wire at least [m].  Source: judgement; not measured."""
PIECE_POINTS = 5
"""Points of a piece of wire at least.  Source: derived: as columns.LEAST_DROP: two lie on any
line, three leaves do once in fifty times."""
FEW = 10
"""Fewer points beyond an end may be of the next span, however far beyond.
Source: judgement; roofs and trees have more."""
PARALLEL = 0.3
"""Slope against the conductor, across or vertically, of a piece of wire at most.
Source: judgement; not measured."""
JUMPER_ROOM = 8.0
"""Distance along the line from an end within which jumpers and insulators hang [m].
Source: judgement; on bench/hazards.py one was at 6 m."""
JUMPER_REACH = 2.5
"""Distance from a conductor within which these hang [m].  Source: judgement; not measured."""
POLE_WIDTH = 1.2
"""Extent in plan, along each axis, of a pole or a piece of one at most [m].
Source: chosen on bench/hazards.py."""
POLE_REACH = 3.3
"""Distance from a conductor at which its pole stands at most, unless it is thin [m].
Source: chosen on bench/hazards.py: parts of poles at 2.9 m, a poplar at 3.8."""
POLE_ROOM = 5.0
"""Distance along the line from an end of a conductor within which a pole is its support [m].
Source: judgement; as encroachments.ROOM of a tower."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DoubtfulCurves:
    """Curves that may be conductors, and are no spans."""

    alone: tuple[Curve, ...] = ()
    crowded: tuple[Curve, ...] = ()
    """Those with other things close about them, which may be conductors themselves."""
    sight: GroundGrid | None = None
    """Where the ground was seen; None: wherever lines of points run."""

    @property
    def every(self) -> tuple[Curve, ...]:
        """All of them."""
        return self.alone + self.crowded


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LineParts:
    """Which of K points near conductors are of lines."""

    own: Bool
    """(K,) of a conductor that was modelled: what continues it, and its strands."""
    unmodelled: Bool
    """(K,) of wires that were not modelled."""
    column: Bool
    """(K,) of bare columns away from all ends: they hold no conductor, and are no foliage."""
    num_wires: int
    """Doubtful curves that have points, and wires told by their dots; scraps are not counted."""
    curves: tuple[int, ...] = ()
    """Which of all doubtful curves are wires that hang free, or rows of such."""
    wires: tuple[Int64, ...] = ()
    """(W,) which points, of each wire or row that was told by its dots."""


def find_line_parts(
    points: Float64,
    distance: Float64,
    owner: Int64,
    models: Sequence[SpanModel],
    doubtful: DoubtfulCurves,
    reach: float,
) -> LineParts:
    """
    Find what is of a line near conductors.

    Parameters
    ----------
    points : (K, 3) float64
        Near conductors, off the ground, neither wire nor support [m].
    distance : (K,) float64
        To the nearest conductor [m].
    owner : (K,) int64
        Which that is.
    models : sequence of SpanModel
        Spans with their curves.
    doubtful : DoubtfulCurves
        Curves that may be conductors.
    reach : float
        Distance from a conductor up to which it matters what something is [m].

    Returns
    -------
    LineParts

    """
    own, unmodelled, column = np.zeros((3, len(points)), dtype=bool)
    near = np.flatnonzero(distance < max(reach, POLE_REACH) + MARGIN)  # things are seen whole
    if not len(near) or not models:
        return LineParts(own=own, unmodelled=unmodelled, column=column, num_wires=0)
    own[_find_continued(points, models)] = True
    own |= find_blur(points, owner, models)
    held, column = find_columns(points, distance, owner, models)
    own |= held
    wires, which = _find_on(points, doubtful.alone, [
        (curve.low - GONE_ON, curve.high + GONE_ON) for curve in doubtful.alone
    ])
    unmodelled[wires] = True
    rows, of_row = _find_rows(points, doubtful.every)
    unmodelled[rows] = True
    num_wires, curves = len(np.union1d(which, of_row)), tuple(np.unique(of_row).tolist())
    near = near[~(own | unmodelled)[near]]
    if not len(near):
        return LineParts(
            own=own, unmodelled=unmodelled, column=column, num_wires=num_wires, curves=curves
        )
    places, ends = _lay_out(points[near], owner[near], models)
    dots, roof = [near[wire] for wire in find_wires(places)], np.zeros(len(points), dtype=bool)
    if doubtful.sight is not None:
        on_roof = find_roof_rows(points, dots, doubtful.sight)
        roof[np.concatenate([near[:0], *itertools.compress(dots, on_roof)])] = True
        dots = list(itertools.compress(dots, ~on_roof))
    for wire in dots:
        unmodelled[wire] = True
    rest = np.flatnonzero(~(unmodelled | roof)[near])
    beside, beyond = _measure_beside(
        points[near[rest]], distance[near[rest]], owner[near[rest]], models
    )
    debris, pieces = _find_scraps(places[rest], distance[near[rest]], beside, beyond, ends)
    drops, lines = find_straight(points[near[rest]], owner[near[rest]], models)
    own[near[rest[debris | drops]]] = True
    column[near[rest[lines]]] = True
    unmodelled[near[rest[pieces]]] = True
    return LineParts(
        own=own, unmodelled=unmodelled & ~own, column=column & ~unmodelled,
        num_wires=num_wires + len(dots), curves=curves, wires=tuple(dots),
    )


def _lay_out(
    points: Float64, owner: Int64, models: Sequence[SpanModel]
) -> tuple[Float64, Float64]:
    """
    Put points into the frames of their spans, each far from the next along the first axis.

    Returned are (K, 3) places along the longest conductor of the span, across it and above its
    sag, and (E,) where along it conductors of the span end [m].
    """
    span_id = np.array([model.span.span_id for model in models])
    places, ends = np.empty_like(points), []
    for turn, number in enumerate(np.unique(span_id[owner]).tolist()):
        mine = np.flatnonzero(span_id[owner] == number)
        members = [model for model in models if model.span.span_id == number]
        curve = max(members, key=lambda model: model.span.length).curve
        x, places[mine, 1] = curve.local(points[mine])
        places[mine, 0] = x + turn * APART
        places[mine, 2] = points[mine, 2] - curve.fit.height(x)
        tips = np.array([tip for model in members for tip in (model.span.start, model.span.end)])
        ends.append(curve.local(tips)[0] + turn * APART)
    return places, np.concatenate(ends)


def _find_continued(points: Float64, models: Sequence[SpanModel]) -> Int64:
    """Return the points on the curves beyond the ends of their spans."""
    ends = []
    for model in models:
        is_open = (model.span.open_start, model.span.open_end)
        if model.start_x > model.end_x:
            is_open = is_open[::-1]
        beyond = [model.span.length if side else GONE_ON for side in is_open]
        ends.append((model.low - beyond[0], model.high + beyond[1]))
    found, _ = _find_on(
        points, [model.curve for model in models], ends,
        [(model.low, model.high) for model in models],
    )
    return found


def _measure_beside(
    points: Float64, distance: Float64, owner: Int64, models: Sequence[SpanModel]
) -> tuple[Float64, Bool]:
    """Return distances (K,) of points to conductors that go on level [m], and which are beyond."""
    result, ahead = distance.copy(), np.zeros(len(points), dtype=bool)
    for number in np.unique(owner).tolist():
        mine, model = np.flatnonzero(owner == number), models[number]
        x, across = model.curve.local(points[mine])
        end = np.clip(x, model.low, model.high)
        above, beyond = points[mine, 2] - model.curve.fit.height(end), x != end
        result[mine[beyond]] = np.hypot(across, above)[beyond]
        ahead[mine] = beyond
    return np.minimum(result, distance), ahead


def _find_scraps(
    places: Float64, distance: Float64, beside: Float64, beyond: Bool, ends: Float64
) -> tuple[Bool, Bool]:
    """
    Tell what is by itself, and is no hazard.

    That is what does not go on away from a conductor (strays, spacers, dampers, balls; farther
    out near an end, jumpers and insulators), poles and slender pieces of them at the end of a
    span (debris), and what runs along the conductor (pieces).

    Parameters
    ----------
    places : (K, 3) float64
        Along the span, across it and above its sag [m].
    distance, beside : (K,) float64
        To the nearest conductor, and to it as if it went on beyond its ends [m].
    beyond : (K,) bool
        Beyond its ends.
    ends : (E,) float64
        Where along the span conductors end [m].

    Returns
    -------
    debris, pieces : (K,) bool

    """
    if not len(places):
        return np.zeros(0, dtype=bool), np.zeros(0, dtype=bool)
    thing = group_cells(places, np.array(GAP))
    mean, low, high, slope, spread = measure_groups(places, thing)
    farthest, nearest = np.zeros(len(mean)), np.full(len(mean), np.inf)
    np.minimum.at(nearest, thing, distance)
    num = np.bincount(thing)
    is_beyond = np.bincount(thing, weights=beyond) == num
    next_span = (num < FEW) & is_beyond
    distance = np.where((num < FEW)[thing], beside, distance)
    np.maximum.at(farthest, thing, distance)
    extent = high - low
    long = (extent[:, 0] >= PIECE_LENGTH) & (num >= PIECE_POINTS)
    piece = (spread <= THIN).all(axis=1) & (np.abs(slope) <= PARALLEL).all(axis=1) & long
    from_end = np.abs(mean[:, 0, None] - ends).min(axis=1)
    thin, straight = tell_thin(places, thing)
    at_end = from_end <= JUMPER_ROOM
    piece |= straight & at_end  # service drops, stays
    row = long & is_beyond & at_end & (spread.min(axis=1) <= THIN)
    for number in np.flatnonzero(row & ~piece).tolist():  # the first metres of the next span
        piece[number] = are_parallel(places[thing == number])
    pole = (from_end <= POLE_ROOM) & (extent[:, :2] <= POLE_WIDTH).all(axis=1)
    pole &= thin | (nearest <= POLE_REACH)
    reach = np.where(at_end | next_span, JUMPER_REACH, FREE_RADIUS)
    apart = (farthest <= reach)[thing] & ~_go_on(places, thing, distance, (pole | piece), reach)
    return apart | pole[thing], piece[thing]


def _go_on(
    places: Float64, thing: Int64, distance: Float64, left_out: Bool, reach: Float64
) -> Bool:
    """Tell the points of things about which others go on beyond their reach."""
    body = group_cells(places, np.full(3, BODY))
    farthest = np.zeros(int(body.max()) + 1)
    np.maximum.at(farthest, body, np.where(left_out[thing], 0.0, distance))
    result: Bool = farthest[body] > reach[thing]
    return result


def _find_rows(points: Float64, curves: Sequence[Curve]) -> tuple[Int64, Int64]:
    """
    Return the points of rows of wires about curves, and which curve that is.

    Wires that hang level beside each other clutter each other; together they are thin one way,
    narrow the other, and hang free, whichever way they run.
    """
    found, which = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for number, curve in enumerate(curves):
        if curve.length < ROW_LENGTH:
            continue
        low, high = curve.low - GONE_ON, curve.high + GONE_ON
        x, across = curve.local(points)
        about = np.flatnonzero((x >= low) & (x <= high) & (np.abs(across) <= ROW + CLEARING))
        above = points[about, 2] - curve.fit.height(x[about])
        level = np.abs(across[about]) <= ROW
        level &= np.abs(above) <= TUBE
        if not level.any():
            continue
        first, last = np.quantile(across[about[level]], (STRAYS, 1.0 - STRAYS))
        off = np.abs(np.column_stack([across[about] - 0.5 * (first + last), above]))
        off[:, 0] = np.maximum(off[:, 0] - 0.5 * (last - first), 0.0)
        free, share = find_free((x[about] - low).astype(np.int64), off, TUBE)
        if last - first <= ROW and free.sum() >= FREE_LENGTH and share >= FREE_SHARE:
            own = about[np.hypot(*off.T) <= TUBE]
            found.append(own)
            which.append(np.full(len(own), number))
    return np.concatenate(found), np.concatenate(which)


def _find_on(
    points: Float64, curves: Sequence[Curve], ends: Sequence[tuple[float, float]],
    left_out: Sequence[tuple[float, float]] = (),
) -> tuple[Int64, Int64]:
    """
    Return the points on curves between other ends than theirs, and which curve that is.

    Stretches of them may be left out, where a curve is a conductor.  Where there is as much about
    what goes on beyond them as on it, its points are of that, unless it hangs free over most of
    its length.  A curve that is no conductor has to hang free over most of its own length.
    """
    if not curves:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    low, high = np.array(ends).T
    widest = np.array([
        _measure_tube(curve, np.array(end)).max() for curve, end in zip(curves, ends, strict=True)
    ])
    table = span_table(curves, low, high)
    found, _, which = find_near(points, table, widest)
    wide, _, beside = find_near(points, table, widest + CLEARING - TUBE)
    kept = np.zeros(len(found), dtype=bool)
    for number in np.unique(which).tolist():
        mine, curve = np.flatnonzero(which == number), curves[number]
        about = np.union1d(found[mine], wide[beside == number])
        x, across = curve.local(points[about])
        off = np.column_stack([across, points[about, 2] - curve.fit.height(x)])
        tube = _measure_tube(curve, x)
        on = np.hypot(*off.T) <= tube
        if left_out:
            judged = (x < left_out[number][0]) | (x > left_out[number][1])
            on &= judged
        else:
            judged = (x >= curve.low) & (x <= curve.high)
            judged |= not (judged & on).any()
        metre = np.maximum(x - low[number] + 1.0, 0.0).astype(np.int64)  # ends are round
        free, share = find_free(
            metre[judged], off[judged], tube[judged], most=ABOUT, fuller=True
        )
        if share < FREE_SHARE and left_out:
            on[judged] &= free[metre[judged]]
        elif share < FREE_SHARE:
            on[:] = False
        kept[mine] = on[np.searchsorted(about, found[mine])]
    return found[kept], which[kept].astype(np.int64)


def _measure_tube(curve: Curve, x: Float64) -> Float64:
    """Return the distance (N,) from a curve at x (N,) within which points are of it [m]."""
    result: Float64 = np.clip(3.0 * curve.prediction_sigma(x), TUBE, WIDEST_TUBE)
    return result
