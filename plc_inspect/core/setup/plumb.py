# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Whether the map stands upright: poles stand, and conductors hang, along the vertical.

A lidar that is mounted askew, or an odometry whose z is not up, tilts the whole map; from a
vehicle that never turns, everything is seen askew alike, and the map is as sharp as a right one.
Poles of real lines lean as well, and wind swings conductors, so either alone tells little, unless
they lean much.  A map that stands on its head is told by where the ground lies.
"""

from dataclasses import dataclass, field, replace
import math

import numpy as np

from plc_inspect.core.setup.ground_side import GroundSides, measure_sides, OVERHEAD
from plc_inspect.core.setup.sharpness import Sharpness
from plc_inspect.results import Float64, InspectionResult, PointClass, Span, Support

REACH = 1.2
"""
Points about the foot of a pole that are looked at, in plan [m].
Source: derived: 10 m of it that lean by 5 degrees, with room.
"""
SHAFT = 0.3
"""
Points of the shaft lie this near to its axis at most [m].
Source: derived: half the width of a pole, 0.2 m, and of a voxel.
"""
FOOT, TOP = 1.0, 0.8
"""
Parts of a pole above the ground and below its highest point that are not looked at [m].
Source: derived: herbs; and crossarms, which stand out to one side.
"""
SHORTEST = 4.0
"""Shafts shorter than this tell nothing [m].  Source: derived: 0.05 m across is 0.7 degrees."""
STEP, FILLED = 0.5, 0.9
"""
Share of the steps of a shaft that hold points, and their length [m].
Source: measured: shafts of flights 8510 and 8600 to 8611 are full, what is none has gaps.
"""
LEAST_POINTS = 30
"""Points of a shaft, or of a conductor.  Source: judgement; not measured."""
LEAST_SAG = 1.0
"""
Conductors whose points lie within less height about their chord tell nothing [m].
Source: derived: a drift of 0.03 m across is 1.7 degrees.
"""
SAME = 2.0
"""
Poles and conductors this near to each other in plan are one that is seen again [m].
Source: derived: less than poles and middles of spans are apart.
"""
ASIDE = 0.7
"""
Conductors tell of a lean whose direction has this cosine across them.
Source: derived: 45 degrees.
"""
MEDIAN_ERROR = 1.48 * 1.25
"""
Standard error of a median by the median deviation and the root of the number.
Source: derived: of a normal distribution.
"""
LONE = float(np.tan(np.radians(1.2)))
"""
Standard error where one pole tells [m/m].
Source: measured: poles of six real clouds lean by that off the median of their cloud.
"""
LEAST_POLES, LEAST_CONDUCTORS = 2, 3
"""How many are asked.  Source: judgement: one pole may lean by any angle; those of one span."""
SURELY = 2.0
"""So many standard errors of the median are taken off.  Source: derived: 98 %."""
LEANING, AGREED = float(np.tan(np.radians(1.0))), 0.5
"""
The map is tilted where poles surely lean by the first [m/m], and conductors as they do but for
this share of it.
Source: measured: bench/flights/drawn_flights.py, 8510 and 8600 to 8611: with a right mount poles
lean by 0.0 to 0.5 degrees, with 2 degrees of roll by 1.3 to 2.1.  Poles of five real clouds lean
by 0.7 to 3.8 degrees, and where conductors sag enough to tell, these lean the other way.
"""
ASKEW = float(np.tan(np.radians(3.0)))
"""
The map is tilted where poles surely lean by more, whatever conductors do [m/m].
Source: measured: the flights of LEANING with 5 degrees of roll: 3.1 and more; real poles lean
unlike each other: those of oakland_part2_ai, by 3.8 degrees in the median, surely by 1.4.
"""
WANDER = 2.5e-5
"""
Standard error of the lean of a conductor for each metre of its catenary constant [1/m].
Source: measured: 8510 to 8530: with a right mount a drift bends conductors of 90 m by 0.05 m to
one side, of 257 m by 0.29 m; as bend and sag grow alike with the span, the lean is 3e-5 times the
constant.
"""
CHECK = 'check mount (input.lidar_rpy_deg, /tf_static), and that z of the odometry is up'
"""What to do about a map that may be tilted."""
HELD_BACK = 'hazards are held back'
"""What is done about one that is."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Leans:
    """How poles and conductors lean."""

    poles: Float64
    """(P, 4) place in plan [m], and shift in plan a metre of height [m/m]."""
    conductors: Float64
    """(C, 6) place in plan [m], unit vector across, shift that way [m/m], constant [m]."""
    sides: GroundSides = field(default_factory=GroundSides)
    """On which side of the vehicle the ground lies."""


NO_LEANS = Leans(poles=np.zeros((0, 4)), conductors=np.zeros((0, 6)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lean:
    """How poles and conductors lean, in the median."""

    num_poles: int
    shift: Float64
    """(2,) of poles in plan a metre of height [m/m]."""
    error: float
    """Standard error of it [m/m]."""
    num_conductors: int
    """Those that could tell of a lean that way; of any where poles do not lean."""
    swing: float
    """Of conductors that way [m/m]."""
    swing_error: float
    """Standard error of it [m/m]."""

    @property
    def size(self) -> float:
        """How much poles lean [m/m]."""
        return float(np.hypot(*self.shift))

    @property
    def surely(self) -> float:
        """How much poles lean at least [m/m]."""
        return self.size - SURELY * self.error

    @property
    def leaning(self) -> bool:
        """Whether poles surely lean."""
        return self.surely > LEANING

    @property
    def swinging(self) -> bool:
        """Whether conductors hang out of plumb."""
        surely = abs(self.swing) - SURELY * self.swing_error
        return self.num_conductors >= LEAST_CONDUCTORS and surely > LEANING

    @property
    def tilted(self) -> bool:
        """Whether the map is tilted."""
        if self.num_poles < LEAST_POLES:
            return False
        alike = abs(self.swing - self.size) < AGREED * self.size
        alike &= self.num_conductors >= LEAST_CONDUCTORS
        return self.leaning and (alike or self.surely > ASKEW)

    def describe(self) -> str:
        """Return what leans, and what it may mean, '' nothing."""
        parts = []
        if self.leaning:
            parts.append(
                f'{self.num_poles} pole{"s lean" if self.num_poles > 1 else " leans"} by '
                f'{_to_degrees(self.size):.1f} degrees'
            )
        if self.swinging or (self.tilted and self.num_conductors >= LEAST_CONDUCTORS):
            parts.append(
                f'{self.num_conductors} conductors hang {_to_degrees(self.swing):.1f} degrees out '
                f'of plumb{" that way" if self.leaning else ""}'
            )
        if not parts:
            return ''
        meaning = (
            'the map is tilted' if self.tilted
            else 'the map may be tilted' if self.leaning else 'wind, or the map is tilted'
        )
        return f'{" and ".join(parts)}: {meaning}'


def _to_degrees(shift: float) -> float:
    return float(np.degrees(np.arctan(shift)))


class PlumbBook:
    """Leans of all poles and conductors, the newest of each, and where the ground lies."""

    def __init__(self) -> None:
        self.leans = NO_LEANS

    def look(self, points: Float64, way: Float64 | None) -> None:
        """
        Look where the ground lies, until it is known to lie below.

        Parameters
        ----------
        points : Float64
            (N, 3) a part of the map [m].
        way : Float64 or None
            (W, 3) where the vehicle was in it [m].

        """
        before = self.leans.sides
        if way is None or (before.known and not before.overhead):
            return
        sides = measure_sides(points, way)
        if sides.known or not before.known:
            self.leans = replace(self.leans, sides=sides)

    def add(self, leans: Leans) -> None:
        """Add what was measured in a part of the map."""
        self.leans = replace(
            self.leans,
            poles=_replace(self.leans.poles, leans.poles),
            conductors=_replace(self.leans.conductors, leans.conductors),
        )

    def judge(self, sharpness: Sharpness) -> Sharpness:
        """Return how good a map is that is as sharp as given."""
        if self.leans.sides.overhead:
            return replace(sharpness, doubt=OVERHEAD, useless=True)
        lean = find_lean(self.leans)
        text = lean.describe()
        if lean.tilted:
            return replace(sharpness, doubt=sharpness.doubt or f'{text}; {CHECK}; {HELD_BACK}')
        return replace(sharpness, remark=f'{text}; {CHECK}' if text else '')


def _replace(known: Float64, new: Float64) -> Float64:
    """Return old rows that are no new ones, and these."""
    apart = np.hypot(*(known[:, None, :2] - new[None, :, :2]).transpose(2, 0, 1))
    return np.concatenate([known[(apart >= SAME).all(axis=1)], new])


def find_lean(leans: Leans) -> Lean:
    """Return how poles and conductors lean; without any of them not at all."""
    shift, error = np.zeros(2), LONE
    if len(leans.poles):
        shift = np.median(leans.poles[:, 2:], axis=0)
    if len(leans.poles) > 1:
        spread = np.median(np.hypot(*(leans.poles[:, 2:] - shift).T))
        error = MEDIAN_ERROR * float(spread) / math.sqrt(len(leans.poles))
    size = float(np.hypot(*shift))
    if size - SURELY * error > LEANING:
        aside = leans.conductors[:, 2:4] @ shift / size
    else:  # each to its own left, where the span begins in the west
        aside = np.where(leans.conductors[:, 3] < 0.0, -1.0, 1.0)
    able = np.abs(aside) > ASIDE
    own, aside = leans.conductors[able], aside[able]
    swing, constant = np.median([own[:, 4] / aside, own[:, 5]], axis=1) if len(own) else (0.0, 0.0)
    return Lean(
        num_poles=len(leans.poles), shift=shift, error=error, num_conductors=len(own),
        swing=float(swing), swing_error=WANDER * float(constant),
    )


def measure_leans(points: Float64, result: InspectionResult) -> Leans:
    """
    Measure how the poles and conductors of a cloud lean.

    Parameters
    ----------
    points : Float64
        (N, 3) [m].
    result : InspectionResult
        Of these points.

    Returns
    -------
    Leans

    """
    return Leans(
        poles=_measure_poles(points, result), conductors=_measure_conductors(points, result)
    )


def _measure_poles(points: Float64, result: InspectionResult) -> Float64:
    poles = [item for item in result.supports if item.kind == 'pole']
    if not poles:
        return NO_LEANS.poles
    built = points[result.classification == PointClass.TOWER]
    built = built[np.argsort(built[:, 0])]
    rows: list[list[float]] = []
    for pole in poles:
        first, last = np.searchsorted(built[:, 0], pole.position[0] + np.array([-REACH, REACH]))
        if (shift := _fit_shaft(built[first:last], pole)) is not None:
            rows.append([*pole.position[:2], *shift])
    return np.array(rows).reshape(-1, 4)


def _fit_shaft(points: Float64, pole: Support) -> Float64 | None:
    """Return the shift of the axis of a pole in plan a metre of height (2,), None: unknown."""
    height = points[:, 2] - pole.position[2]
    shaft = (height > FOOT) & (height < pole.height - TOP)
    shaft &= np.hypot(*(points[:, :2] - pole.position[:2]).T) < REACH
    points, height = points[shaft, :2] - pole.position[:2], height[shaft]
    if len(points) < LEAST_POINTS:
        return None
    middle = height.mean()
    terms = np.column_stack([np.ones(len(height)), height - middle])
    axis = np.array([np.median(points, axis=0), (0.0, 0.0)])
    for reach in (3.0 * SHAFT, 2.0 * SHAFT, *[SHAFT] * 4):
        kept = np.hypot(*(points - terms @ axis).T) < reach
        if kept.sum() < LEAST_POINTS:
            return None
        axis = np.linalg.lstsq(terms[kept], points[kept], rcond=None)[0]
    steps = np.floor(height[kept] / STEP).astype(np.int64)
    length = np.ptp(steps) + 1
    if length * STEP < SHORTEST or len(np.unique(steps)) < FILLED * length:
        return None
    shift: Float64 = axis[1]
    return shift


def _measure_conductors(points: Float64, result: InspectionResult) -> Float64:
    order = np.flatnonzero(result.line_id >= 0)
    order = order[np.lexsort((result.span_id[order], result.line_id[order]))]
    keys = np.column_stack([result.line_id[order], result.span_id[order]])
    begin = np.flatnonzero(np.r_[True, (np.diff(keys, axis=0) != 0).any(axis=1)][: len(keys)])
    spans = {(item.line_id, item.span_id): item for item in result.spans}
    rows: list[list[float]] = []
    for key, own in zip(keys[begin].tolist(), np.split(order, begin[1:]), strict=False):
        span = spans.get((key[0], key[1]))
        if span is None or len(own) < LEAST_POINTS:
            continue
        swing, sag = _fit_swing(points[own], span)
        if sag >= LEAST_SAG:
            across = (-np.sin(span.azimuth), np.cos(span.azimuth))
            middle = span.positions(np.array([0.5 * span.length]))[0, :2]
            rows.append([*middle, *across, swing, span.c])
    return np.array(rows).reshape(-1, 6)


def _fit_swing(points: Float64, span: Span) -> tuple[float, float]:
    """Return by how much a conductor lies aside a metre that it sags [m/m], and its sag [m]."""
    apart = points[:, :2] - span.start[:2]
    along = apart @ (np.cos(span.azimuth), np.sin(span.azimuth))
    aside = apart @ (-np.sin(span.azimuth), np.cos(span.azimuth))
    chord = np.column_stack([np.ones(len(along)), along - along.mean()])
    hung = span.heights(along)
    hung = hung - chord @ np.linalg.lstsq(chord, hung, rcond=None)[0]
    swing = np.linalg.lstsq(np.column_stack([chord, hung]), aside, rcond=None)[0][2]
    return float(swing), float(np.ptp(hung))

