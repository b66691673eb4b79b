# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Curves that are part of something built: of a bridge, a rack, a deck, a roof, a wall."""

from collections.abc import Sequence
from itertools import compress
import math

import numpy as np

from plc_inspect.config import CatenarySettings
from plc_inspect.core.catenary.curve import Curve, pack_curves
from plc_inspect.core.catenary.curve_row import CURVATURE, SLOPE
from plc_inspect.core.evidence.bars import is_bar
from plc_inspect.core.evidence.contacts import find_held, LEAST_EVEN
from plc_inspect.core.evidence.edges import find_edges
from plc_inspect.core.evidence.stays import STEEP
from plc_inspect.core.evidence.validation import (
    BAR,
    DEEPEST,
    HELD,
    is_bent,
    is_scan_line,
    may_be_held,
    prove_sag,
    SCAN_LINE,
    WALL,
)
from plc_inspect.core.evidence.walls import Walls
from plc_inspect.core.numerics.plan_index import PlanIndex
from plc_inspect.results import Bool, Float64

LONGEST_BAY = 8.0
"""
Brackets and hangers are no farther from each other [m].
Source: judgement: hangers of bridges are 3 to 6 m apart, brackets of pipes up to 7 m; poles of
lines are 10 m apart and more.
"""
CABLE_EVEN = 2
"""
Even intervals between hangers of a cable that surely hangs, at least.
Source: derived: one more that agrees with one; service drops, as deep, touch nothing evenly.
"""
RAIL = 1.5
"""
What runs along the edge of a deck or roof, no higher above it than this, is of it [m].
Source: derived: railings and parapets are 0.9 to 1.4 m high.
"""


def are_held(
    points: Float64, index: PlanIndex, curves: Sequence[Curve], wire: Bool,
    settings: CatenarySettings, below: float = math.inf,
) -> Bool:
    """
    Tell which curves something touches evenly, or lie along the edge of a deck or roof.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    index : PlanIndex
        Searched.
    curves : sequence of Curve
        C curves.
    wire : (N,) bool
        Points of conductors.
    settings : CatenarySettings
        Of the stage.
    below : float
        What runs below the edge of a deck or roof by this at most is on its wall [m].

    Returns
    -------
    (C,) bool

    """
    result = np.array([may_be_held(curve, settings) for curve in curves], dtype=np.bool_)
    own = list(compress(curves, result))
    bent = np.array([is_bent(curve, settings) for curve in own], dtype=np.bool_)
    least = np.where(bent, CABLE_EVEN, LEAST_EVEN).tolist()
    held = find_held(points, index, own, wire, LONGEST_BAY, least)
    edge = find_edges(points, index, own, wire)
    rows = pack_curves(own)
    hung = bent & (rows[:, CURVATURE] > 1.0 / DEEPEST)
    hung |= np.abs(rows[:, SLOPE]) > STEEP
    held |= ((edge < RAIL) & (edge > -below)) | ((edge >= RAIL) & hung)
    result[result] = held
    return result


def name_built(
    points: Float64, index: PlanIndex, curves: Sequence[Curve], wire: Bool, walls: Walls,
    settings: CatenarySettings, below: float = math.inf,
) -> list[str]:
    """
    Tell what curves are part of that is no line: one of RIGID for each, empty for a conductor.

    The arguments are those of `are_held`, and the walls of the same points.
    """
    held = are_held(points, index, curves, wire, settings, below).tolist()
    return [
        WALL if is_wall else HELD if is_held else _name(points, curve, settings)
        for curve, is_wall, is_held in zip(curves, walls.find(curves).tolist(), held, strict=True)
    ]


def _name(points: Float64, curve: Curve, settings: CatenarySettings) -> str:
    """Return what the points of a curve alone say that it is part of."""
    if not may_be_held(curve, settings):
        return ''
    if is_scan_line(curve):
        return SCAN_LINE
    return BAR if prove_sag(curve, settings) < 1.0 and is_bar(points, curve) else ''
