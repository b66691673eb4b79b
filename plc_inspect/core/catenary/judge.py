# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Which curves are conductors, all of them judged together: wires hang side by side."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

from numba import njit
import numpy as np

from plc_inspect.config import CatenarySettings
from plc_inspect.core.catenary.curve import Curve, find_near, pack_curves
from plc_inspect.core.catenary.curve_row import (
    AZIMUTH,
    COS,
    CURVATURE,
    height_of,
    HIGH,
    LOW,
    open_row,
    ORIGIN_X,
    ORIGIN_Y,
    see_above,
    see_beside,
    SIN,
    SLOPE,
    to_local,
    TOLERANCE,
)
from plc_inspect.core.catenary.duplicates import find_along, is_thick, PARALLEL
from plc_inspect.core.catenary.free_length import (
    FreeLength,
    measure_free_length,
    Sight,
    UNKNOWN,
)
from plc_inspect.core.catenary.profile import Profile, profile_curve
from plc_inspect.core.catenary.stays import find_edges, find_fans, find_held, find_stays
from plc_inspect.core.catenary.validation import (
    BUILT,
    CROWDED,
    find_objection,
    HELD,
    is_straight,
    prove_sag,
    STAY,
    STRAIGHTEST,
    TIED,
)
from plc_inspect.core.numerics.plan_index import gather_strip, PlanIndex
from plc_inspect.core.numerics.threads import call_each
from plc_inspect.results import Bool, Float64, Int64

LEAST_COMMON = 8
"""Metres that two curves run side by side before they can be tied.  Source: judgement."""
SIDE = 3.0
"""
Distance within which a piece runs beside a conductor [m].
Source: judgement; conductors of one low- or medium-voltage line are up to 1.5 m apart, and its
telecom wires hang 1 to 3 m below.
"""
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
TIE_WIDTH = 0.15
"""
Distance from the plane through two curves of what ties them [m].
Source: judgement; not measured.
"""
TIE_MARGIN = 0.2
"""
At this share of the way from one curve to the other, and on, points lie between them.
Source: judgement; not measured.
"""
BEAM_CLUTTER = 0.3
"""
Metres of a beam with other things about it, less free ones, for each of its length, at least.
Source: measured: the jibs of seven random cranes have 0.36 to 0.9.
"""
FREE_SHARE = 0.5
"""
Stays of a fan hang free along this share of their length, at least.
Source: judgement: gutters and ridges, which are as straight, have a roof beside them.
"""
STEEP, STEEP_CONSTANT = math.tan(math.radians(15.0)), 1500.0
"""
What is steeper than this, and surely straighter than such a catenary constant [m], is a stay.
Source: measured: on random scenes steep conductors of 28 m and more are surely tighter than 1060 m
and bars of bridges surely straighter than 1890 m; guys of masts have 20 degrees and more.
"""
LONGEST_BAY = 8.0
"""
Brackets and hangers are no farther from each other [m].
Source: judgement: hangers of bridges are 3 to 6 m apart, brackets of pipes up to 7 m; poles of
lines are 10 m apart and more.
"""
DEEPEST = 200.0
"""
A cable with a proven curvature that is held is no conductor below this catenary constant [m].
Source: derived: main cables of bridges sag by a tenth of their span, those of 150 m have 190 m;
conductors with spacers or diverters, and messengers of railways, have 300 m and more.
"""


def may_be_held(curve: Curve, settings: CatenarySettings) -> bool:
    """Tell whether something that touches a curve at even intervals may hold it, and not hang."""
    return curve.fit.c < DEEPEST or prove_sag(curve, settings) < 1.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Verdict:
    """What is known of one curve, and why it is no conductor."""

    profile: Profile
    free: FreeLength
    objection: str
    """Empty for a conductor."""
    beside: bool
    """It was judged as one beside a conductor."""


class Judge:
    """Curves of one cloud, and what is believed of them so far."""

    def __init__(
        self,
        points: Float64,
        index: PlanIndex,
        sight: Sight,
        curves: Sequence[Curve],
        settings: CatenarySettings,
        believed: Sequence[Verdict] = (),
    ) -> None:
        """Take the curves; what is believed of the first ones already is not judged again."""
        self._points, self._index, self._sight = points, index, sight
        self._curves, self._settings = curves, settings
        fresh = curves[len(believed):]
        profiles = call_each(
            lambda k: profile_curve(points, index, fresh[k], fresh[k].low, fresh[k].high),
            len(fresh),
        )
        self.wire: Bool = np.zeros(len(points), dtype=bool)
        """(N,) points that do not clutter a curve, as they are wires themselves."""
        self.verdicts = [*believed, *(
            Verdict(
                profile=profile, free=UNKNOWN, beside=False,
                objection=find_objection(curve, profile, UNKNOWN, settings),
            )
            for curve, profile in zip(fresh, profiles, strict=True)
        )]
        self._mark(np.arange(len(believed)))

    def decide(self) -> None:
        """
        Judge all curves.

        A thin curve with all evidence but that it is free clutters no other one; and each that is
        free, once those are left out, frees its neighbours.  What is a truss is taken back, and
        at last short pieces beside a conductor are believed.
        """
        objections = np.array([verdict.objection for verdict in self.verdicts], dtype=object)
        proven = np.flatnonzero(objections == CROWDED)
        self._mark(proven)
        self._sweep(np.flatnonzero((objections != CROWDED) & (objections != '')), beside=False)
        self._try(proven, beside=False)
        self._untie()
        self._unstay()
        self._unhold()
        near = self._find_beside()
        while self._sweep(near, beside=True):
            near = self._find_beside()
        self._untie()
        self._unhold()

    def _untie(self) -> None:
        """
        Take back what is tied together along its whole length: chords of a truss, rails, racks.

        Conductors that hang side by side have air between them.  What is tied to something that
        was taken back is so too.
        """
        known = np.flatnonzero([verdict.objection in ('', *BUILT) for verdict in self.verdicts])
        curves = [self._curves[number] for number in known.tolist()]
        if len(curves) < 2:
            return
        rows, near = pack_curves(curves), find_near(curves, TIE)
        own = np.zeros(len(self._points), dtype=bool)  # curves not believed may be the bracing
        for number in known.tolist():
            own[self.verdicts[number].profile.chosen] = True
        tied = np.zeros(len(curves), dtype=bool)
        for number, others in enumerate(call_each(
            lambda k: _find_tied(self._points, self._index.grid, rows, k, near.of(k), own),
            len(curves),
        )):
            tied[others] = True
            tied[number] |= len(others) > 0
        for number in known[tied].tolist():
            if not self.verdicts[number].objection:
                self.verdicts[number] = replace(self.verdicts[number], objection=TIED)

    def _unstay(self) -> None:
        """Take back what is of a beam, fans out, or is steep and straight."""
        proofs = [prove_sag(curve, self._settings) for curve in self._curves]
        numbers = [
            number for number, verdict in enumerate(self.verdicts)
            if verdict.objection != TIED and may_be_held(self._curves[number], self._settings)
        ]
        curves = [self._curves[number] for number in numbers]
        straight = np.array([proofs[number] < 0.0 for number in numbers], dtype=bool)
        deep = np.array([proofs[number] == 1.0 for number in numbers], dtype=bool)
        steep = np.array([
            abs(float(curve.fit.slope(0.5 * (curve.low + curve.high)))) > STEEP
            and is_straight(curve, STEEP_CONSTANT) for curve in curves
        ], dtype=bool)
        free = np.array([
            self.verdicts[number].free.wide >= FREE_SHARE * self._curves[number].length
            for number in numbers
        ], dtype=bool)
        beams = [self._curves[number] for number in numbers if self._is_beam(number)]
        stays = find_stays(curves, straight | deep, beams) | steep
        stays |= find_fans(curves, straight, free & ~deep)
        for number in np.array(numbers, dtype=np.int64)[stays].tolist():
            self.verdicts[number] = replace(self.verdicts[number], objection=STAY)

    def _unhold(self) -> None:
        """Take back what is held at regular intervals, hangs over a deck, or lies on a wall."""
        known = np.flatnonzero([
            not verdict.objection and may_be_held(curve, self._settings)
            for curve, verdict in zip(self._curves, self.verdicts, strict=True)
        ])
        curves = [self._curves[k] for k in known.tolist()]
        held = find_held(self._points, self._index, curves, self.wire, LONGEST_BAY)
        edge = find_edges(self._points, self._index, curves, self.wire)
        rows = pack_curves(curves)
        hung = (rows[:, CURVATURE] > 1.0 / DEEPEST) | (np.abs(rows[:, SLOPE]) > STEEP)
        held |= (edge > 0) | ((edge < 0) & hung)
        for number in known[held].tolist():
            self.verdicts[number] = replace(self.verdicts[number], objection=HELD)

    def _is_beam(self, number: int) -> bool:
        """Whether a curve is straight and part of something solid."""
        curve, verdict = self._curves[number], self.verdicts[number]
        wide = verdict.free.wide
        return (
            bool(verdict.objection) and curve.fit.c > STRAIGHTEST
            and -math.inf < wide <= -BEAM_CLUTTER * curve.length
        )

    def _mark(self, numbers: Int64) -> None:
        for number in numbers.tolist():
            self.wire[self.verdicts[number].profile.chosen] = True

    def _sweep(self, numbers: Int64, *, beside: bool) -> bool:
        """Judge curves over and over, as long as more of them are found free; tell if any was."""
        found = False
        while len(numbers):
            won = self._try(numbers, beside=beside)
            if not len(won):
                break
            self._mark(won)
            numbers = np.setdiff1d(numbers, won)
            found = True
        return found

    def _try(self, numbers: Int64, *, beside: bool) -> Int64:
        """Judge curves with what is known now; return those that are conductors."""
        wanted = numbers.tolist()
        free = call_each(
            lambda k: measure_free_length(
                self._points, self._index, self._curves[wanted[k]], self.wire, self._sight
            ),
            len(wanted),
        )
        won = []
        for number, length in zip(wanted, free, strict=True):
            verdict = self.verdicts[number]
            objection = find_objection(
                self._curves[number], verdict.profile, length, self._settings, beside=beside
            )
            self.verdicts[number] = Verdict(
                profile=verdict.profile, free=length, objection=objection, beside=beside
            )
            if not objection:
                won.append(number)
        return np.array(won, dtype=np.int64)

    def _find_beside(self) -> Int64:
        """Return the curves that are not believed, thin, and run beside one that is."""
        known = [k for k, verdict in enumerate(self.verdicts) if not verdict.objection]
        rest = [
            number for number, verdict in enumerate(self.verdicts)
            if verdict.objection not in ('', *BUILT) and not is_thick(self._curves[number])
        ]
        along = find_along(
            [self._curves[number] for number in rest], [self._curves[number] for number in known],
            SIDE,
        )
        return np.array(rest, dtype=np.int64)[along]


@njit(cache=True, nogil=True, error_model='numpy')
def _find_tied(points, grid, rows, number, near, own):  # type: ignore[no-untyped-def]
    """Return those of the rows near one, by its number, that come before it and are tied to it."""
    tied = np.zeros(len(near), dtype=np.bool_)
    row = rows[number]
    between = np.empty((0, 3))
    for place in range(len(near)):
        k = near[place]
        if k >= number:
            break
        if abs(math.sin(rows[k, AZIMUTH] - row[AZIMUTH])) > PARALLEL:
            continue
        if len(between) == 0:
            between = _list_beside(points, grid, row, own)
            if len(between) == 0:
                break
        tied[place] = _measure_tie(between, row, rows[k]) >= TIE_SHARE
    return near[tied]


@njit(cache=True, nogil=True, error_model='numpy')
def _list_beside(points, grid, row, own):  # type: ignore[no-untyped-def]
    """Places within TIE of a row's curve, along, across and above it, that are on none [m]."""
    start, order, corner, cell, num_rows, num_columns = grid
    low, high = row[LOW], row[HIGH]
    near = gather_strip(
        start, order, corner, cell, num_rows, num_columns,
        row[ORIGIN_X] + row[COS] * low, row[ORIGIN_Y] + row[SIN] * low,
        row[ORIGIN_X] + row[COS] * high, row[ORIGIN_Y] + row[SIN] * high, TIE,
    )
    result = np.empty((len(near), 3))
    opened, count = open_row(row), 0
    for i in near:
        if own[i]:
            continue
        x, y = see_beside(opened, points[i, 0], points[i, 1])
        if x < low or x >= high or abs(y) > TIE:
            continue
        above, _ = see_above(opened, x, points[i, 2])
        if abs(above) <= TIE:
            result[count, 0], result[count, 1], result[count, 2] = x, y, above
            count += 1
    return result[:count]


@njit(cache=True, nogil=True, error_model='numpy')
def _measure_tie(between, row, other):  # type: ignore[no-untyped-def]
    """Share of the metres common to two rows' curves with points in each part between them."""
    low, high = row[LOW], row[HIGH]
    num = max(int(high - low), 1)

    # where the other curve is, metre by metre
    y, up = np.full(num, np.nan), np.empty(num)
    for place in range(num):
        x = low + (place + 0.5) * (high - low) / num
        px, py = row[ORIGIN_X] + row[COS] * x, row[ORIGIN_Y] + row[SIN] * x
        at, off = to_local(other, px, py)
        if not other[LOW] <= at <= other[HIGH]:
            continue
        side = -off if math.cos(row[AZIMUTH] - other[AZIMUTH]) > 0.0 else off
        rise = height_of(other, at) - height_of(row, x)
        apart = math.hypot(side, rise)
        if row[TOLERANCE] + other[TOLERANCE] < apart <= TIE:
            y[place], up[place] = side, rise
    common = num - np.isnan(y).sum()
    if common < LEAST_COMMON:
        return 0.0

    # and which parts of the way to it hold points
    filled = np.zeros((num, TIE_PARTS), dtype=np.bool_)
    for k in range(len(between)):
        place = min(int((between[k, 0] - low) / (high - low) * num), num - 1)
        if np.isnan(y[place]):
            continue
        apart = math.hypot(y[place], up[place])
        along = (between[k, 1] * y[place] + between[k, 2] * up[place]) / apart**2
        across = (between[k, 1] * up[place] - between[k, 2] * y[place]) / apart
        if abs(across) <= TIE_WIDTH and TIE_MARGIN < along < 1.0 - TIE_MARGIN:
            part = int((along - TIE_MARGIN) / (1.0 - 2.0 * TIE_MARGIN) * TIE_PARTS)
            filled[place, min(part, TIE_PARTS - 1)] = True
    # the emptiest part tells: what is tied is tied all the way
    least = num
    for part in range(TIE_PARTS):
        least = min(least, filled[:, part].sum())
    return least / common
