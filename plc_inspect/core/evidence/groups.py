# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Curves side by side: they bend together at a support, and prove together that they hang."""

from collections.abc import Sequence
import math

import numpy as np

from plc_inspect.config import CatenarySettings
from plc_inspect.core.catenary.curve import Curve, find_near, pack_curves
from plc_inspect.core.catenary.curve_row import COS, HIGH, LOW, ORIGIN_X, ORIGIN_Y, SIN
from plc_inspect.core.catenary.cutting import cut_each
from plc_inspect.core.catenary.duplicates import drop_duplicates, is_thick, PARALLEL
from plc_inspect.core.evidence.validation import prove_sag
from plc_inspect.core.ground.ground_grid import GroundGrid
from plc_inspect.core.numerics.disjoint_sets import unite
from plc_inspect.results import Float64, Int64

LEAST_TOGETHER = 3
"""Curves that prove something together, at least.  Source: judgement; two may be any edges."""
LEAST_LENGTH = 12.0
"""
Length of each of them at least [m].
Source: derived: the metres of evidence that are asked of one curve by itself.
"""
LEAST_SEEN = 0.8
"""
Share of the metres of a curve over which the ground below was seen, at least.
Source: measured: those on wires of real clouds have 0.96 and more (bench/hazards.py), strands of a
bundle 26 m above sparse ground 0.81 to 0.90 (random scene 338034), rows on roofs less than 0.8.
"""
PROVEN = 0.5
"""
Sum of the squares of what their sags prove, at least.
Source: measured: 7 of the 10 standard deviations of `min_significance`; strands of bundles seen
over 15 to 26 m have 0.9 together (random scenes 317011 and 312013), and no line came of it in 150
scenes without one.
"""
OVERLAP = 0.5
"""Share of the shorter of two curves along which both run.  Source: judgement."""
STEP = 1.0
"""Step along a curve at which the ground below is looked at [m].  Source: numerical."""


def find_groups(
    curves: Sequence[Curve], sight: GroundGrid, side: float, settings: CatenarySettings,
    known: Sequence[Curve] = (),
) -> list[tuple[Int64, Int64]]:
    """
    Group curves that run side by side over seen ground, where their sags are proven together.

    A roof hides the ground below the rows of a scanner.  Sags that agree prove more than each
    does, as the squares of their significances add up; straight ones count against it.

    Parameters
    ----------
    curves : sequence of Curve
        C curves with too little evidence of their own.
    sight : GroundGrid
        Where the ground was seen.
    side : float
        Distance of curves of a group to the next one at most [m].
    settings : CatenarySettings
        Of the stage.
    known : sequence of Curve
        Conductors, which prove something with those that they run along.

    Returns
    -------
    list of (G,) int64, (K,) int64
        The numbers of the curves of each group, and of what is known beside them.

    """
    return [
        (group, beside) for group, beside in _list_groups(curves, sight, side, known)
        if prove_together([
            *(curves[number] for number in group.tolist()),
            *(known[number] for number in beside.tolist()),
        ], settings)
    ]


def cut_groups(
    points: Float64, curves: Sequence[Curve], sight: GroundGrid, side: float,
    settings: CatenarySettings,
) -> tuple[Curve, ...]:
    """
    Cut curves that run side by side over seen ground where all of them are bent.

    Wires of a rack that ran over a low pole are straight as one curve, and so taken for bars.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    curves : sequence of Curve
        All of them, thick ones too.
    sight : GroundGrid
        Where the ground was seen.
    side : float
        Distance of curves of a group to the next one at most [m].
    settings : CatenarySettings
        Of duplicates.

    Returns
    -------
    tuple of Curve
        The parts and the others, longest first.

    """
    thin = [curve for curve in curves if not is_thick(curve)]
    parts: dict[int, list[Curve]] = {}
    for group, _ in _list_groups(thin, sight, side):
        own = [thin[number] for number in group.tolist()]
        for curve, pieces in zip(own, cut_each(points, own), strict=True):
            parts[id(curve)] = pieces
    cut = [part for curve in curves for part in parts.get(id(curve), [curve])]
    return drop_duplicates(points, cut, settings) if len(cut) != len(curves) else tuple(curves)


def _list_groups(
    curves: Sequence[Curve], sight: GroundGrid, side: float, known: Sequence[Curve] = ()
) -> list[tuple[Int64, Int64]]:
    """
    Group curves that run side by side over seen ground, whatever their sags prove.

    What is known joins each group that it runs along, but unites none and is none.
    """
    own, others = _choose(curves, sight), _choose(known, sight)
    chosen = [
        *(curves[number] for number in own.tolist()), *(known[k] for k in others.tolist())
    ]
    if len(own) < 2 or len(chosen) < LEAST_TOGETHER:
        return []
    pairs = _find_pairs(chosen, side, len(own))
    within = pairs[:, 1] < len(own)
    group = unite(pairs[within], len(own))
    found = []
    for number in np.unique(group).tolist():
        member = group == number
        beside = np.unique(pairs[member[pairs[:, 0]] & ~within, 1]) - len(own)
        if member.sum() > 1 and member.sum() + len(beside) >= LEAST_TOGETHER:
            found.append((own[member], others[beside]))
    return found


def _choose(curves: Sequence[Curve], sight: GroundGrid) -> Int64:
    """Return the curves that are long enough, over seen ground."""
    return np.array([
        number for number, curve in enumerate(curves)
        if curve.length >= LEAST_LENGTH and _measure_seen(curve, sight) >= LEAST_SEEN
    ], dtype=np.int64)


def prove_together(curves: Sequence[Curve], settings: CatenarySettings) -> bool:
    """Tell whether curves are enough, and their sags significant when added up."""
    if len(curves) < LEAST_TOGETHER:
        return False
    proofs = [prove_sag(curve, settings) for curve in curves]
    return sum(math.copysign(proof**2, proof) for proof in proofs) >= PROVEN


def _measure_seen(curve: Curve, sight: GroundGrid) -> float:
    x = np.linspace(curve.low, curve.high, max(2, math.ceil(curve.length / STEP)))
    return float(sight.tell_seen(curve.position(x)).mean())


def _find_pairs(curves: Sequence[Curve], side: float, num: int) -> Int64:
    """Return the (P, 2) pairs of the first ones with others along them within a distance [m]."""
    near, rows = find_near(curves[:num], side, curves), pack_curves(curves)
    first, second = np.repeat(np.arange(num), np.diff(near.start)), near.item
    one, other = rows[first], rows[second]
    sine = one[:, SIN] * other[:, COS] - one[:, COS] * other[:, SIN]
    low, high = _project(one, other, LOW), _project(one, other, HIGH)
    start = np.maximum(np.minimum(low[0], high[0]), one[:, LOW])
    end = np.minimum(np.maximum(low[0], high[0]), one[:, HIGH])
    shorter = np.minimum(one[:, HIGH] - one[:, LOW], other[:, HIGH] - other[:, LOW])
    along = (first != second) & (np.abs(sine) <= PARALLEL) & (end - start >= OVERLAP * shorter)
    along &= np.minimum(np.abs(low[1]), np.abs(high[1])) <= side
    pairs = np.column_stack([first, second])[along]
    kept = [
        _measure_above(curves[one], curves[other]) <= side for one, other in pairs.tolist()
    ]
    return pairs[np.array(kept, dtype=bool)]


def _project(one: Float64, other: Float64, end: int) -> tuple[Float64, Float64]:
    """Return where ends of other curves lie along and across curves (P,) [m]."""
    x = other[:, ORIGIN_X] + other[:, COS] * other[:, end] - one[:, ORIGIN_X]
    y = other[:, ORIGIN_Y] + other[:, SIN] * other[:, end] - one[:, ORIGIN_Y]
    return x * one[:, COS] + y * one[:, SIN], y * one[:, COS] - x * one[:, SIN]


def _measure_above(one: Curve, other: Curve) -> float:
    """Return the height of one curve above another where the middle of the latter is [m]."""
    middle = other.position(0.5 * (other.low + other.high))
    x, _ = one.local(middle)
    return abs(float(middle[0, 2] - one.fit.height(x)[0]))
