# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Stays: straight thin bars above a beam that they hold, as on tower cranes and stayed bridges."""

from collections.abc import Sequence
import math

from numba import njit
import numpy as np

from plc_inspect.core.catenary.curve import Curve, pack_curves
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
from plc_inspect.results import Bool

ASIDE = 1.5
"""
Distance of a stay from the beam, in plan [m].
Source: derived: half the width of a tower crane's jib, up to 2.5 m, and the miss of a curve on it.
"""
ABOVE_SHARE = 0.8
"""Share of a stay that is above the beam.  Source: judgement: the mast's head is off its end."""
NEAREST = 3.0
"""Height above the beam at the lower end, at most [m].  Source: derived: the depth of a jib."""
RISE = 0.06
"""
Least rise of a stay over the beam for each metre of it.
Source: derived: conductors of one line part by less: half their spacing at a support, 1 m in 20 m;
the stays of twelve random cranes rise by 0.1 to 0.5.
"""
NUM_STATIONS = 25
"""Places along a stay.  Source: numerical."""


def find_stays(curves: Sequence[Curve], beams: Sequence[Curve]) -> Bool:
    """
    Tell which curves are stays of a beam.

    Parameters
    ----------
    curves : sequence of Curve
        Straight, as far as is known.
    beams : sequence of Curve
        Straight, and part of something solid.

    Returns
    -------
    (C,) bool
        Curves that run above a beam, in its vertical plane, and come down on it at one end.

    """
    result: Bool = _find_stays(pack_curves(curves), pack_curves(beams))
    return result


@njit(cache=True, nogil=True, error_model='numpy')
def _find_stays(rows, beams):  # type: ignore[no-untyped-def]
    result = np.zeros(len(rows), dtype=np.bool_)
    for k in range(len(rows)):
        for m in range(len(beams)):
            if _holds(rows[k], beams[m]):
                result[k] = True
                break
    return result


@njit(cache=True, nogil=True, error_model='numpy')
def _holds(row, beam):  # type: ignore[no-untyped-def]
    """Tell whether a row's curve is a stay of a beam."""
    above = 0
    first = last = math.nan
    for station in range(NUM_STATIONS):
        x = row[LOW] + (row[HIGH] - row[LOW]) * station / (NUM_STATIONS - 1)
        at, aside = to_local(
            beam, row[ORIGIN_X] + row[COS] * x, row[ORIGIN_Y] + row[SIN] * x
        )
        if abs(aside) > ASIDE or at < beam[LOW] - ASIDE or at > beam[HIGH] + ASIDE:
            continue
        rise = height_of(row, x) - height_of(beam, at)
        above += rise > 0.0
        if math.isnan(first):
            first = rise
        last = rise
    if above < ABOVE_SHARE * NUM_STATIONS:
        return False
    return min(first, last) <= NEAREST and abs(last - first) >= RISE * (row[HIGH] - row[LOW])
