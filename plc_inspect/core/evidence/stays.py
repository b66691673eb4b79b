# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Stays: straight thin bars above a beam that they hold, as on tower cranes and stayed bridges.

Others fan out from a mast, and rails and chords keep their distance from a beam.
"""

from collections.abc import Sequence
import math

from numba import njit
import numpy as np

from plc_inspect.core.catenary.curve import Curve, find_near, pack_curves
from plc_inspect.core.catenary.curve_row import (
    COS,
    height_of,
    HIGH,
    LOW,
    ORIGIN_X,
    ORIGIN_Y,
    SIN,
    to_local,
)
from plc_inspect.core.evidence.free_length import FreeLength
from plc_inspect.core.evidence.validation import is_straight, STRAIGHTEST
from plc_inspect.results import Bool

BEAM_CLUTTER = 0.3
"""
Metres of a beam with other things about it, less free ones, for each of its length, at least; of
one that is surely straight any.
Source: measured: the jibs of seven random cranes have 0.36 to 0.9.
"""
BEAM_CONSTANT = 1000.0
"""
A beam is surely straighter than this catenary constant [m], whatever is about it.
Source: measured: of phases that crowd each other over their last 14 m one seemed a beam, with a
curvature of 0.0002 and a standard deviation of 0.0007 1/m (uav_costarica_mv, cut); the jibs of
cranes in 80 random scenes without lines are known all the same.
"""
SOLID = 0.5
"""
The same of a beam that things run along as chords of its frame.
Source: measured: beams above rails of gantries and pipe racks of random scenes have 0.59 to 1.
"""
ASIDE = 1.5
"""
Distance of a stay from the beam, in plan [m].
Source: derived: half the width of a tower crane's jib, up to 2.5 m, and the miss of a curve on it.
"""
ABOVE_SHARE = 0.8
"""Share of a stay that is above the beam.  Source: judgement: the mast's head is off its end."""
NEAREST = 3.0
"""
Height above the beam at the lower end, at most, where less than half of a stay was seen [m].
Source: derived: the depth of a jib.
"""
RISE = 0.06
"""
Least rise of a stay over the beam for each metre of it.
Source: derived: conductors of one line part by less: half their spacing at a support, 1 m in 20 m;
the stays of twelve random cranes rise by 0.1 to 0.5.
"""
PARALLEL, LEAST_DEPTH = 0.15, 1.0
"""
A chord of a frame keeps its distance from a beam but for so much, and it is so much at least [m].
Source: measured: on random scenes rails of gantries and pipe racks keep theirs, 1.6 to 2 m, to
0.1 m; judgement: wires of a rack are 0.3 to 0.5 m apart, and one seen badly may pass for a beam.
"""
STEEP, STEEP_CONSTANT = math.tan(math.radians(15.0)), 1500.0
"""
What is steeper than this, and surely straighter than such a catenary constant [m], is a stay.
Source: measured: on random scenes steep conductors of 28 m and more are surely tighter than 1060 m
and bars of bridges surely straighter than 1890 m; guys of masts have 20 degrees and more.
"""
MEETING = 0.3
"""
Bars that meet at an end may seem to cross by this much there [m].
Source: derived: ten standard deviations of a curve's end at 3 cm of noise.
"""
FAN_SHARE = 0.3
"""
What fans out tells that a bar is a stay where it is so long, as a share of the bar, at least.
Source: measured: a piece of 6 m of a service drop or of a branch, beside 68 m of a telecom cable
(uav_costarica_mv, cut), 0.09; judgement: the stays of one mast are of like lengths.
"""
NUM_STATIONS = 25
"""Places along a stay.  Source: numerical."""


def is_beam(curve: Curve, free: FreeLength, proof: float) -> bool:
    """
    Tell whether a curve that is no conductor is straight and part of something solid.

    Parameters
    ----------
    curve : Curve
        The curve.
    free : FreeLength
        Metres of it that hang free in the air.
    proof : float
        Of its sag, as `validation.prove_sag`.

    """
    share = free.wide / curve.length
    if not math.isfinite(share):
        return False
    straight = curve.fit.c > STRAIGHTEST and is_straight(curve, BEAM_CONSTANT)
    return (straight and share <= -BEAM_CLUTTER) or (share < 0.0 and proof < 0.0)


def is_solid(curve: Curve, free: FreeLength) -> bool:
    """Tell whether things lie along a beam, ``free`` as it is, as they do within a frame."""
    return free.wide <= -SOLID * curve.length


def find_stays(curves: Sequence[Curve], sure: Bool, beams: Sequence[Curve]) -> Bool:
    """
    Tell which curves are stays, rails or main cables of a beam.

    Parameters
    ----------
    curves : sequence of Curve
        What may be held.
    sure : (C,) bool
        Which of them are surely straight, or deeper than conductors of a line.
    beams : sequence of Curve
        Straight, and part of something solid.

    Returns
    -------
    (C,) bool
        Curves that run above a beam, in its vertical plane, and come near to it: at one end, or
        anywhere those that are sure.

    """
    near = find_near(curves, ASIDE, beams)
    result: Bool = _find_stays(pack_curves(curves), sure, pack_curves(beams), near, False)
    return result


def find_hung(curves: Sequence[Curve], beams: Sequence[Curve]) -> Bool:
    """
    Tell which curves are stays of a beam although they seem to hang.

    A curve over two stays, or one that drift has bent, has a sag; it begins at the beam all the
    same.

    Parameters
    ----------
    curves : sequence of Curve
        C curves with a proven sag.
    beams : sequence of Curve
        Straight, and part of something solid.

    Returns
    -------
    (C,) bool

    """
    sure, near = np.zeros(len(curves), dtype=np.bool_), find_near(curves, ASIDE, beams)
    result: Bool = _find_stays(pack_curves(curves), sure, pack_curves(beams), near, True)
    return result


def find_chords(curves: Sequence[Curve], beams: Sequence[Curve]) -> Bool:
    """
    Tell which curves are chords of a frame.

    Parameters
    ----------
    curves : sequence of Curve
        C of them, none of which surely hangs.
    beams : sequence of Curve
        Straight, and part of something solid.

    Returns
    -------
    (C,) bool
        Curves that keep their distance from a beam in their vertical plane, 1 to 3 m.

    """
    near = find_near(curves, ASIDE, beams)
    result: Bool = _find_chords(pack_curves(curves), pack_curves(beams), near)
    return result


@njit(cache=True, nogil=True, error_model='numpy')
def _find_chords(rows, beams, near):  # type: ignore[no-untyped-def]
    result = np.zeros(len(rows), dtype=np.bool_)
    for k in range(len(rows)):
        for m in near.item[near.start[k] : near.start[k + 1]]:
            common, _, first, last, nearest = _compare(rows[k], beams[m])
            if (common >= ABOVE_SHARE * NUM_STATIONS and LEAST_DEPTH <= nearest <= NEAREST
                    and abs(last - first) <= PARALLEL):
                result[k] = True
                break
    return result


@njit(cache=True, nogil=True, error_model='numpy')
def _find_stays(rows, sure, beams, near, whole):  # type: ignore[no-untyped-def]
    result = np.zeros(len(rows), dtype=np.bool_)
    for k in range(len(rows)):
        for m in near.item[near.start[k] : near.start[k + 1]]:
            if _holds(rows[k], sure[k], beams[m], whole):
                result[k] = True
                break
    return result


@njit(cache=True, nogil=True, error_model='numpy')
def _holds(row, is_sure, beam, whole):  # type: ignore[no-untyped-def]
    """
    Tell whether a row's curve is a stay of a beam, or a rail or cable where it is sure.

    With ``whole``, its lower end must have been seen.
    """
    _, above, first, last, nearest = _compare(row, beam)
    rise = abs(last - first)
    if above < ABOVE_SHARE * NUM_STATIONS or nearest > (NEAREST if whole else max(NEAREST, rise)):
        return False
    return is_sure or rise >= RISE * (row[HIGH] - row[LOW])


@njit(cache=True, nogil=True, error_model='numpy')
def _compare(row, other):  # type: ignore[no-untyped-def]
    """
    Compare a row's curve with another one in its vertical plane, from station to station.

    Returned are how many stations they have in common, how many of these are above the other
    curve, how high above it the first and the last are [m], NaN where there are none, and how
    high above or below it the nearest is [m].
    """
    common = above = 0
    first = last = math.nan
    nearest = math.inf
    for station in range(NUM_STATIONS):
        x = row[LOW] + (row[HIGH] - row[LOW]) * station / (NUM_STATIONS - 1)
        at, aside = to_local(
            other, row[ORIGIN_X] + row[COS] * x, row[ORIGIN_Y] + row[SIN] * x
        )
        if abs(aside) > ASIDE or at < other[LOW] - ASIDE or at > other[HIGH] + ASIDE:
            continue
        last = height_of(row, x) - height_of(other, at)
        if common == 0:
            first = last
        common += 1
        above += last > 0.0
        nearest = min(nearest, abs(last))
    return common, above, first, last, nearest


def find_fans(curves: Sequence[Curve], sure: Bool, free: Bool) -> Bool:
    """
    Tell which curves fan out from a mast as stays do.

    Parameters
    ----------
    curves : sequence of Curve
        Straight, as far as is known.
    sure : (C,) bool
        Which of them surely are, or are as steep as stays.
    free : (C,) bool
        Which of them hang free in the air.

    Returns
    -------
    (C,) bool
        Curves that run in one vertical plane with another one, at least one of both sure,
        and part from it by more than conductors of one line do.

    """
    result: Bool = _find_fans(pack_curves(curves), sure, free, find_near(curves, NEAREST))
    return result


@njit(cache=True, nogil=True, error_model='numpy')
def _find_fans(rows, sure, free, near):  # type: ignore[no-untyped-def]
    result = np.zeros(len(rows), dtype=np.bool_)
    for k in range(len(rows)):
        for m in near.item[near.start[k] : near.start[k + 1]]:
            if m < k and free[k] and free[m] and (sure[k] or sure[m]):
                shorter, longer = k, m
                if rows[k, HIGH] - rows[k, LOW] > rows[m, HIGH] - rows[m, LOW]:
                    shorter, longer = m, k
                if _parts(rows[shorter], rows[longer]):
                    length = rows[longer, HIGH] - rows[longer, LOW]
                    share = (rows[shorter, HIGH] - rows[shorter, LOW]) / length
                    result[shorter] = True
                    result[longer] |= share >= FAN_SHARE
    return result


@njit(cache=True, nogil=True, error_model='numpy')
def _parts(row, other):  # type: ignore[no-untyped-def]
    """Tell whether two curves meet at one end, in a vertical plane, and part from there on."""
    common, _, first, last, _ = _compare(row, other)
    least = min(abs(first), abs(last))
    if common < ABOVE_SHARE * NUM_STATIONS or (first * last < 0.0 and least > MEETING):
        return False  # they cross
    return least <= NEAREST and abs(last - first) >= RISE * (row[HIGH] - row[LOW])
