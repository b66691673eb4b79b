# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Attachments: where the conductors of a support hang, from all of them together."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

from numba import njit
import numpy as np

from plc_inspect.core.catenary.curve import pack_curves
from plc_inspect.core.catenary.curve_row import (
    COS,
    height_of,
    ORIGIN_X,
    ORIGIN_Y,
    SIN,
    slope_of,
    to_local,
    variances_of,
)
from plc_inspect.core.spans.joints import Joint
from plc_inspect.core.spans.layout import Layout
from plc_inspect.core.spans.route import SIDE_BY_SIDE
from plc_inspect.core.spans.span_fit import CutCurve, pack_ends
from plc_inspect.results import Float64

TERMINAL_SPREAD = 2.5
"""Open ends this near along the line end at one support [m].
Source: judgement; holds from 1.25 to 5 on bench/constants.py."""
END_SCATTER = 0.05
"""Standard deviation along the line of where conductors hang from one support [m].
Source: judgement; holds from 0.025 to 0.1 on bench/constants.py."""
LEAST_MISS = 0.003
"""
Standard deviation of the distance of two curves, at least [m].
Source: judgement; holds from 0.0015 to 0.006 on bench/constants.py.
"""
REACH = 1.5
"""
The final curves cross this near to where the first ones did [m].
Source: judgement; holds from 0.75 to 3 on bench/constants.py.
"""
NUM_STEPS = 4
"""
Steps of Gauss-Newton to a crossing.
Source: numerical: Gauss-Newton converges quadratically.
"""
LEAST_WEIGHT = 1e-12
"""Inverse variance of a crossing, at least [1/m2].  Source: numerical: avoids a division by 0."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpanEnd:
    """One end of the curve of a span."""

    number: int
    """Which curve."""
    side: int
    """-1 its low, 1 its high end."""
    place: Float64
    """(3,) where it is [m]."""
    azimuth: float
    """Of the curve [rad]."""

    @property
    def outward(self) -> Float64:
        """(2,) plan direction in which the conductor would go on."""
        return self.side * np.array([math.cos(self.azimuth), math.sin(self.azimuth)])


def group_ends(ends: Sequence[SpanEnd]) -> list[list[SpanEnd]]:
    """Open ends that lie side by side across their line."""
    groups: list[list[SpanEnd]] = []
    for end in ends:
        unit = end.side * end.outward
        for group in groups:
            apart = np.array([other.place[:2] - end.place[:2] for other in group])
            if (
                np.abs(apart @ unit).max() <= TERMINAL_SPREAD
                and np.linalg.norm(apart, axis=1).min() <= SIDE_BY_SIDE
            ):
                group.append(end)
                break
        else:
            groups.append([end])
    return groups


def mean_azimuth(ends: Sequence[SpanEnd]) -> float:
    """Azimuth of the line at a support, half way between both sides of an angle."""
    doubled = 2 * np.array([end.azimuth for end in ends])
    return 0.5 * math.atan2(float(np.sin(doubled).sum()), float(np.cos(doubled).sum()))


def measure_gap(ends: Sequence[SpanEnd], finals: Sequence[CutCurve]) -> float:
    """Return how far before their support the last point of conductors is, in the mean [m]."""
    curves = [finals[end.number].curve for end in ends]
    spacing = np.mean([curve.length / max(curve.num_points, 1) for curve in curves])
    return float(spacing) / len(ends)


def settle_ends(
    layout: Layout, finals: Sequence[CutCurve]
) -> tuple[Layout, list[CutCurve], Float64]:
    """
    Say where the final curves end at their supports.

    The curves of both spans cross at a shallow angle, so that the place of one crossing along
    the line is known to some decimetres only, and the sag of a span goes with the square of its
    length.  What hangs from one support hangs side by side: each crossing is drawn to the mean
    of all, the more the less it is sure of (a random-effects mean, DerSimonian and Laird 1986).
    Where conductors truly hang at different places along the line, the scatter shows it and
    they stay there.

    Parameters
    ----------
    layout : Layout
        Joints and supports.
    finals : sequence of CutCurve
        For each curve of the layout the final one.

    Returns
    -------
    layout : Layout
        With its supports where the mean crossings are.
    finals : list of CutCurve
        With settled ends.
    sigma : (C, 2) float64
        Standard deviation of the place of the low and the high end along the curve [m], 0 where
        it is not at a support.

    """
    ends = pack_ends(finals)
    sigma = np.zeros_like(ends)
    stations = np.array([layout.start_station, layout.end_station]).T.reshape(-1, 2)
    rows = pack_curves([cut.curve for cut in finals])
    moved = []
    for number, station in enumerate(layout.stations):
        unit = np.array([math.cos(station.direction), math.sin(station.direction)])
        members = [(int(curve), int(side)) for curve, side in np.argwhere(stations == number)]
        joints = [
            joint for joint in layout.joints
            if (joint.curves[0], (joint.sides[0] + 1) // 2) in members
        ]
        crossings = [_cross(rows, finals, joint) for joint in joints]
        along = np.array([(place - station.position) @ unit for place, _ in crossings])
        own_sigma = np.array([own for _, own in crossings])
        settled, settled_sigma, mean, mean_sigma = _draw_together(along, own_sigma)
        place = dict.fromkeys(members, (mean, mean_sigma))
        for joint, value, deviation in zip(joints, settled, settled_sigma, strict=True):
            for curve, side in zip(joint.curves, joint.sides, strict=True):
                place[curve, (side + 1) // 2] = float(value), float(deviation)
        for (curve, side), (value, deviation) in place.items():
            azimuth = finals[curve].curve.azimuth
            rate = unit @ (math.cos(azimuth), math.sin(azimuth))
            to_station = (station.position - finals[curve].curve.origin) @ unit
            ends[curve, side] = (to_station + value) / rate
            sigma[curve, side] = deviation / abs(rate)
        moved.append(replace(station, position=station.position + mean * unit))
    settled_finals = [
        CutCurve(curve=cut.curve, low=low, high=high)
        for cut, (low, high) in zip(finals, ends.tolist(), strict=True)
    ]
    return replace(layout, stations=tuple(moved)), settled_finals, sigma


def _cross(rows: Float64, finals: Sequence[CutCurve], joint: Joint) -> tuple[Float64, float]:
    """Plan position where two final curves are nearest, and its deviation along the first [m]."""
    first, second = joint.curves
    curve = finals[first].curve
    start, _ = curve.local_place(joint.position)
    x, sigma = _find_crossing(
        rows[first], rows[second], start, curve.azimuth - finals[second].curve.azimuth
    )
    return curve.position(x)[0, :2], sigma


@njit(cache=True, nogil=True, error_model='numpy')
def _find_crossing(first, second, start, turn):  # type: ignore[no-untyped-def]
    """Gauss-Newton on the vertical and the lateral distance, each by its uncertainty."""
    x, weight = start, 0.0
    for _ in range(NUM_STEPS):
        other_x, across = to_local(
            second, first[ORIGIN_X] + first[COS] * x, first[ORIGIN_Y] + first[SIN] * x
        )
        gap = height_of(first, x) - height_of(second, other_x)
        rate = slope_of(first, x) - math.cos(turn) * slope_of(second, other_x)
        vertical, lateral = variances_of(first, x)
        other_vertical, other_lateral = variances_of(second, other_x)
        vertical += other_vertical + LEAST_MISS**2
        lateral += other_lateral + LEAST_MISS**2
        weight = rate**2 / vertical + math.sin(turn) ** 2 / lateral
        step = gap * rate / vertical + across * math.sin(turn) / lateral
        x = min(max(x - step / max(weight, LEAST_WEIGHT), start - REACH), start + REACH)
    return x, min(1.0 / math.sqrt(max(weight, LEAST_WEIGHT)), REACH)


def _draw_together(
    values: Float64, sigma: Float64
) -> tuple[Float64, Float64, float, float]:
    """Draw (J,) values to their mean; with deviations, also of the mean as that of one more."""
    if not len(values):
        return values, sigma, 0.0, REACH
    weight = 1.0 / sigma**2
    mean = float(weight @ values / weight.sum())
    scatter = END_SCATTER**2
    if len(values) > 1:
        excess = float(weight @ (values - mean) ** 2) - (len(values) - 1)
        freedom = float(weight.sum() - (weight**2).sum() / weight.sum())
        scatter = max(scatter, excess / freedom)
    weight = 1.0 / (sigma**2 + scatter)
    mean = float(weight @ values / weight.sum())
    mean_variance = 1.0 / float(weight.sum())
    share = scatter / (scatter + sigma**2)  # of a value's own
    drawn = share * values + (1.0 - share) * mean
    variance = share * sigma**2 + (1.0 - share) ** 2 * mean_variance
    return drawn, np.sqrt(variance), mean, math.sqrt(mean_variance + scatter)
