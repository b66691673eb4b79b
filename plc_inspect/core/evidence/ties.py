# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Ties: curves with something all the way between them, as the chords of a truss."""

from collections.abc import Sequence
import math

from numba import njit
import numpy as np

from plc_inspect.core.catenary.curve import Curve, find_near, Near, pack_curves
from plc_inspect.core.catenary.curve_row import (
    AZIMUTH,
    COS,
    height_of,
    HIGH,
    LATERAL_RMSE,
    LOW,
    open_row,
    ORIGIN_X,
    ORIGIN_Y,
    RMSE,
    see_above,
    see_beside,
    SIN,
    to_local,
    TOLERANCE,
)
from plc_inspect.core.catenary.duplicates import PARALLEL, THICK
from plc_inspect.core.numerics.plan_index import gather_strip, PlanIndex
from plc_inspect.core.numerics.threads import call_each
from plc_inspect.results import Bool, Float64

LEAST_COMMON = 8
"""Metres that two curves run side by side before they can be tied.  Source: judgement."""
TIE = 2.5
"""
Greatest distance of two curves that may be tied [m].
Source: judgement; the chords of a tower crane's jib are 1 to 2.5 m apart.
"""
TIE_SHARE = 0.3
"""
Two curves are tied where each part of the way between them holds points in this share of the
metres, at least.
Source: measured: the jib of a crane 0.42 to 0.88; wires beside crowns, with others that were not
found between them, 0.11 at most.
"""
TIE_PARTS = 6
"""Parts of the way from curve to curve, less TIE_MARGIN at both ends.  Source: judgement."""
TIE_EVEN = 0.2
"""
Points in the emptiest of these parts, by their median, at least.
Source: chosen on bench/random_scenes.py, bench/frames.py and the fans of test_searches: nearly all
bracing and sheets have more, other wires of a fan between two 0.15.
"""
TIE_WIDTH = 0.15
"""
Distance from the plane through two curves of what ties them [m].
Source: judgement; not measured.
"""
TIE_COMMON = 0.5
"""Share of a curve that what may be part of a crown runs beside, at least.  Source: judgement."""
TIE_AIR, TIE_FLAT = 0.85, 0.2
"""
What lies flat between two curves has fewer points than this share of its own on one side of it,
this far away [m].
Source: chosen on bench/frames.py: bracing of a jib has 0.01 at most, a crown beside a conductor of
uav_mexico_street 1.35.
"""
TIE_MARGIN = 0.2
"""
At this share of the way from one curve to the other, and on, points lie between them.
Source: judgement; not measured.
"""
SHEET_APART = 0.8
"""
Greatest distance of two curves that may lie on one surface [m].
Source: judgement: pipes, trays and beams are 0.3 to 1 m wide.
"""
SHEET_BIN, SHEET_BINS = 0.05, 3
"""
Width of the bins in which points of a surface are counted across it [m], and how many are taken
together.
Source: derived: conductors 0.2 m apart leave one empty.
"""
SHEET_FILLED = 0.5
"""
Density on a surface, by its mean between two curves, at least.
Source: chosen on bench/frames.py and bench/random_scenes.py: on a pipe, a beam and a net of two
real clouds 0.6 at least, between conductors 0.3 at most.
"""
SHEET_WIDTH = 0.6
"""
Width of a surface that two curves lie on, at least [m].
Source: derived: a conductor that drift doubled by 0.3 m is 0.5 m wide.
"""
SHEET_POINTS = 20
"""Points between two curves that tell of a surface, at least.  Source: judgement."""
MOST_CALLS = 62
"""Calls that are remembered.  Source: numerical: bits of an integer."""


class Ties:
    """Tells which curves are tied to each other; asked again, it compares no two curves twice."""

    def __init__(self, points: Float64, index: PlanIndex) -> None:
        """Take (N, 3) points [m] and their index."""
        self._points, self._index = points, index
        self._calls = 0
        self._known: dict[Curve, tuple[int, int]] = {}  # calls it was in, and was asked in: bits

    def copy(self) -> 'Ties':
        """Return ties that know what was compared so far."""
        result = Ties(self._points, self._index)
        result._calls, result._known = self._calls, dict(self._known)
        return result

    def find(
        self, curves: Sequence[Curve], own: Bool, asked: Bool, sure: Bool, hung: Bool
    ) -> Bool:
        """
        Tell which curves are tied to another one along their whole length, or lie on one surface.

        Parameters
        ----------
        curves : sequence of Curve
            What may be tied.
        own : (N,) bool
            Points of curves, which tie nothing.
        asked : (C,) bool
            Curves that are asked of; others are not compared with each other.
        sure : (C,) bool
            Thin lines; what is none may be part of a crown, and ties another one only along most
            of it, and by what lies flat between both.
        hung : (C,) bool
            Curves that surely hang; two of them on one surface are a band of wires that strips
            askew leave no air between.

        Returns
        -------
        (C,) bool
            Curves with another one beside them and points all the way between, or as many there
            as on both and beyond, none of two that were compared before.

        """
        tied = np.zeros(len(curves), dtype=bool)
        if len(curves) < 2:
            return tied
        before = np.array([self._known.get(curve, (0, 0)) for curve in curves], dtype=np.int64)
        near = find_near(curves, TIE)
        pairs = Near(*_list_pairs(near.start, near.item, asked, before))
        numbers, rows = np.flatnonzero(np.diff(pairs.start)).tolist(), pack_curves(curves)
        lists = call_each(
            lambda k: _find_tied(
                self._points, self._index.grid, rows, numbers[k], pairs.of(numbers[k]), own, asked,
                sure, hung,
            ),
            len(numbers),
        )
        for number, others in zip(numbers, lists, strict=True):
            tied[others] = True
            tied[number] |= len(others) > 0
        bits = np.column_stack([np.ones_like(asked), asked]).astype(np.int64)
        now = before | bits << self._calls
        self._known.update(zip(curves, map(tuple, now.tolist()), strict=True))
        self._calls += 1
        if self._calls == MOST_CALLS:
            self._known, self._calls = {}, 0
        return tied


@njit(cache=True, nogil=True)
def _list_pairs(start, item, asked, before):  # type: ignore[no-untyped-def]
    """List of what is near each curve, as Near has it, what is to be compared with it."""
    pair_start, pairs, num = np.zeros_like(start), np.empty_like(item), 0
    for number in range(len(asked)):
        for place in range(start[number], start[number + 1]):
            k = item[place]
            if k >= number:
                break
            was_asked = before[number, 1] & before[k, 0] | before[number, 0] & before[k, 1]
            if (asked[number] or asked[k]) and not was_asked:
                pairs[num] = k
                num += 1
        pair_start[number + 1] = num
    return pair_start, pairs[:num]


@njit(cache=True, nogil=True, error_model='numpy')
def _find_tied(  # type: ignore[no-untyped-def]
    points, grid, rows, number, others, own, asked, sure, hung
):
    """Return those of some other rows that are tied to one, by its number."""
    tied = np.zeros(len(others), dtype=np.bool_)
    row = rows[number]
    beside, is_own = np.empty((0, 3)), np.empty(0, dtype=np.bool_)
    for place in range(len(others)):
        k = others[place]
        if abs(math.sin(rows[k, AZIMUTH] - row[AZIMUTH])) > PARALLEL:
            continue
        y, up, common = _place_other(row, rows[k])
        if common < LEAST_COMMON:
            continue
        if len(beside) == 0:
            beside, is_own = _list_beside(points, grid, row, own)
            if len(beside) == 0:
                break
        seen, apart = _see_between(beside, row, y, up), np.hypot(y, up)
        is_tied = _measure_tie(seen, is_own, row, rows[k], apart) >= TIE_SHARE
        if not (sure[number] and sure[k]):
            one = row if asked[number] else rows[k]
            is_along = common >= TIE_COMMON * (one[HIGH] - one[LOW])
            tied[place] = is_tied and is_along and _is_flat(seen, is_own)
        elif hung[number] and hung[k]:
            tied[place] = is_tied
        else:
            tied[place] = is_tied or _lie_on_one(seen, row, rows[k], apart)
    return others[tied]


@njit(cache=True, nogil=True, error_model='numpy')
def _list_beside(points, grid, row, own):  # type: ignore[no-untyped-def]
    """Places within TIE of a row's curve, along, across and above it [m]; which are of curves."""
    start, order, corner, cell, num_rows, num_columns = grid
    low, high = row[LOW], row[HIGH]
    near = gather_strip(
        start, order, corner, cell, num_rows, num_columns,
        row[ORIGIN_X] + row[COS] * low, row[ORIGIN_Y] + row[SIN] * low,
        row[ORIGIN_X] + row[COS] * high, row[ORIGIN_Y] + row[SIN] * high, TIE,
    )
    result, is_own = np.empty((len(near), 3)), np.empty(len(near), dtype=np.bool_)
    opened, count = open_row(row), 0
    for i in near:
        x, y = see_beside(opened, points[i, 0], points[i, 1])
        if x < low or x >= high or abs(y) > TIE:
            continue
        above, _ = see_above(opened, x, points[i, 2])
        if abs(above) <= TIE:
            result[count, 0], result[count, 1], result[count, 2] = x, y, above
            is_own[count] = own[i]
            count += 1
    return result[:count], is_own[:count]


@njit(cache=True, nogil=True, error_model='numpy')
def _place_other(row, other):  # type: ignore[no-untyped-def]
    """Place another row's curve beside and above a row's, metre by metre [m], and count these."""
    low, high = row[LOW], row[HIGH]
    num = max(int(high - low), 1)
    y, up = np.full(num, np.nan), np.empty(num)
    for place in range(num):
        x = low + (place + 0.5) * (high - low) / num
        px, py = row[ORIGIN_X] + row[COS] * x, row[ORIGIN_Y] + row[SIN] * x
        at, off = to_local(other, px, py)
        if not other[LOW] <= at <= other[HIGH]:
            continue
        side = -off if math.cos(row[AZIMUTH] - other[AZIMUTH]) > 0.0 else off
        rise = height_of(other, at) - height_of(row, x)
        if 0.0 < math.hypot(side, rise) <= TIE:
            y[place], up[place] = side, rise
    return y, up, num - np.isnan(y).sum()


@njit(cache=True, nogil=True, error_model='numpy')
def _see_between(beside, row, y, up):  # type: ignore[no-untyped-def]
    """
    Where places lie on the way from a row's curve to another one.

    Returned are the metre of each, its share of the way, NaN where there is none, and how far it
    lies off the plane through both [m].
    """
    low, high, num = row[LOW], row[HIGH], len(beside)
    metre, along, across = np.zeros(num, dtype=np.int64), np.full(num, np.nan), np.zeros(num)
    for k in range(num):
        place = min(int((beside[k, 0] - low) / (high - low) * len(y)), len(y) - 1)
        if np.isnan(y[place]):
            continue
        metre[k], apart = place, math.hypot(y[place], up[place])
        across[k] = (beside[k, 1] * up[place] - beside[k, 2] * y[place]) / apart
        along[k] = (beside[k, 1] * y[place] + beside[k, 2] * up[place]) / apart**2
    return metre, along, across


@njit(cache=True, nogil=True, error_model='numpy')
def _measure_tie(seen, is_own, row, other, apart):  # type: ignore[no-untyped-def]
    """Share of the metres common to two rows' curves with points in each part between them."""
    is_apart = apart > row[TOLERANCE] + other[TOLERANCE]
    common = is_apart.sum()  # not where one of them is NaN
    if common < LEAST_COMMON:
        return 0.0
    filled, count = np.zeros((len(apart), TIE_PARTS), dtype=np.bool_), np.zeros(TIE_PARTS)
    metre, along, across = seen
    for k in range(len(metre)):
        if is_own[k] or not is_apart[metre[k]] or abs(across[k]) > TIE_WIDTH:
            continue
        # outside of both
        first = max(TIE_MARGIN, row[TOLERANCE] / apart[metre[k]])
        room = 1.0 - max(TIE_MARGIN, other[TOLERANCE] / apart[metre[k]]) - first
        if room > 0.0 and 0.0 < along[k] - first < room:
            part = min(int((along[k] - first) / room * TIE_PARTS), TIE_PARTS - 1)
            filled[metre[k], part] = True
            count[part] += 1.0
    if count.min() < TIE_EVEN * np.median(count):
        return 0.0  # other lines beside, with air between
    # the emptiest part tells: what is tied is tied all the way
    least = len(apart)
    for part in range(TIE_PARTS):
        least = min(least, filled[:, part].sum())
    return least / common


@njit(cache=True, nogil=True, error_model='numpy')
def _is_flat(seen, is_own):  # type: ignore[no-untyped-def]
    """Tell whether what lies between two curves has air on one side of it."""
    inside = left = right = 0
    _, along, across = seen
    for k in range(len(along)):
        if not is_own[k] and TIE_MARGIN < along[k] < 1.0 - TIE_MARGIN:
            if abs(across[k]) <= TIE_WIDTH:
                inside += 1
            elif abs(across[k]) <= TIE_AIR and across[k] > 0.0:
                left += 1
            elif abs(across[k]) <= TIE_AIR:
                right += 1
    return min(left, right) <= TIE_FLAT * inside


@njit(cache=True, nogil=True, error_model='numpy')
def _lie_on_one(seen, row, other, apart):  # type: ignore[no-untyped-def]
    """Tell whether a row's curve and another one lie on one surface, evenly covered by points."""
    if max(row[RMSE], row[LATERAL_RMSE], other[RMSE], other[LATERAL_RMSE]) > THICK:
        return False  # blurred by so much, conductors beside each other leave no gap
    is_apart = apart >= np.median(apart[~np.isnan(apart)])  # wires of a fan meet at their pole
    middle = np.median(apart[is_apart])
    if middle > SHEET_APART:
        return False
    num = math.ceil((middle + 2.0 * SHEET_WIDTH) / SHEET_BIN)
    count = np.zeros(num)
    metre, along, across = seen
    for k in range(len(metre)):
        if not is_apart[metre[k]] or abs(across[k]) > TIE_WIDTH:
            continue
        place = (along[k] * middle + SHEET_WIDTH) / SHEET_BIN  # others of a fan stay in one place
        if 0.0 <= place < num:
            count[int(place)] += 1.0
    first, last = int(SHEET_WIDTH / SHEET_BIN), int((SHEET_WIDTH + middle) / SHEET_BIN)
    inner = count[first : last + 1]
    if inner.sum() < SHEET_POINTS:
        return False
    # as far as it is covered evenly on both sides
    least = SHEET_FILLED * SHEET_BINS * inner.mean()
    width = 0
    for place in range(SHEET_BINS - 1, num):
        is_filled = count[place - SHEET_BINS + 1 : place + 1].sum() >= least
        if is_filled:
            width += 1
        elif place - SHEET_BINS + 1 > last:
            break
        elif place >= first:
            return False  # a gap between both
        else:
            width = 0
    return (width + SHEET_BINS - 1) * SHEET_BIN >= SHEET_WIDTH
