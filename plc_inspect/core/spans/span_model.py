# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A span with its curve, and where along it something is."""

from collections.abc import Sequence
from dataclasses import dataclass, field
import math

import numpy as np

from plc_inspect.core.catenary.catenary import fit_quadratic
from plc_inspect.core.catenary.curve import Curve, span_table
from plc_inspect.core.spans.span_fit import CutCurve
from plc_inspect.results import Float64, Int64, NO_STRANDS, Span, Support

POINT_SIGMA = 0.03
"""
Standard deviation of one measured point, of the sensor's data sheet [m].
Source: data sheet of the Velodyne Puck Lite, accuracy of 3 cm.
"""
MAP_SIGMA = 0.01
"""
Standard deviation of the sag from what bends the map along a span: trajectory, strips [m].
Source: measured: of 1,958 spans of random scenes (clean 40000:40040 and 50000:50030, any
41000:41040 and 51000:51030) the true sag lies in its 95 % interval in 90 % without it and in 96 %
with it; from the air, from a car and with a Puck Lite in 98, 94 and 80 %.
"""
SAG_STEP = 0.25
"""
Half the step by which the sag is differentiated at an end [m].
Source: numerical: the sag is nearly quadratic in the length.
"""
SUPPORT_REACH = 20.0
"""
A span hangs on the nearest support of its line within this of its end in plan [m].
Source: judgement; not measured.
"""
NEIGHBOR_REACH = 10.0
"""
A support that is known to carry other lines only may hold an end within this of it [m].
Source: judgement; not measured.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpanModel:
    """A span with the curve behind it, in the orientation of its route."""

    span: Span
    curve: Curve
    start_x: float
    """x of the curve at the span's start [m]; greater than end_x where reversed."""
    end_x: float
    strands: Float64 = field(default_factory=lambda: NO_STRANDS)
    """(S, 2) places of its sub-conductors across and above the curve [m]."""
    scatter: float = POINT_SIGMA
    """Standard deviation of one point of the conductors of the cloud along each axis [m]."""
    noise: float = POINT_SIGMA
    """
    Standard deviation of one point of what is near it [m].

    That of its own points in height, and of those of the cloud at least: across its beam, which
    comes from above or below, a wire hangs anywhere in the footprint, which other things fill.
    """

    @property
    def low(self) -> float:
        """Lesser of both x [m]."""
        return min(self.start_x, self.end_x)

    @property
    def high(self) -> float:
        """Greater of both x [m]."""
        return max(self.start_x, self.end_x)

    @property
    def lowest_strand(self) -> float:
        """How far its lowest sub-conductor is above the curve, 0 or less but for noise [m]."""
        return float(self.strands[:, 1].min())

    def along(self, x: Float64) -> Float64:
        """Return the distance (N,) from the start of the span at the curve's x (N,) [m]."""
        return np.abs(np.asarray(x) - self.start_x)

    def at(self, along: Float64) -> Float64:
        """Return the curve's x (N,) at distances (N,) from the start of the span [m]."""
        return self.start_x + math.copysign(1.0, self.end_x - self.start_x) * along

    def sigma(self, x: float) -> float:
        """Return the standard deviation of the distance of what is near to the curve at x [m]."""
        return math.hypot(self.place_sigma(x), self.noise)

    def wire_sigma(self, x: float) -> float:
        """Return the same of a point of a conductor [m]."""
        return math.hypot(float(self.curve.prediction_sigma(np.array([x]))[0]), self.scatter)

    def place_sigma(self, x: float) -> float:
        """Return the standard deviation of the place of the curve itself at x [m]."""
        return math.hypot(float(self.curve.prediction_sigma(np.array([x]))[0]), MAP_SIGMA)

    def strand_positions(self, x: Float64) -> Float64:
        """Return the (S, N, 3) points of its sub-conductors at the curve's x (N,) [m]."""
        ca, sa = math.cos(self.curve.azimuth), math.sin(self.curve.azimuth)
        across, above = self.strands.T
        shift = np.column_stack([-sa * across, ca * across, above])
        result: Float64 = self.curve.position(x)[None] + shift[:, None]
        return result

    def part(self, points: Float64) -> tuple[Float64, Float64, Float64]:
        """
        Split the distances of points to the span, to the nearest of its sub-conductors.

        Parameters
        ----------
        points : (N, 3) float64
            Positions [m].

        Returns
        -------
        x : (N,) float64
            Foot on the curve, within the span, in the curve's x [m].
        horizontal : (N,) float64
            Horizontal distance to it [m].
        vertical : (N,) float64
            How far it is above the point [m].

        """
        x, y = self.curve.local(points)
        inside = np.clip(x, self.low, self.high)
        vertical: Float64 = self.curve.fit.height(inside) - points[:, 2]
        if len(self.strands) == 1:
            return inside, np.hypot(y, x - inside), vertical
        across, above = y[:, None] - self.strands[:, 0], vertical[:, None] + self.strands[:, 1]
        nearest = np.arange(len(points)), np.argmin(across**2 + above**2, axis=1)
        return inside, np.hypot(across[nearest], x - inside), above[nearest]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FittedSpan:
    """A span that was fitted, before it is described in the orientation of its route."""

    cut: CutCurve
    """Its final curve, and where that ends."""
    points: Int64
    """(K,) points of the conductor."""
    reverse: bool
    """The route runs from the high to the low end."""
    is_open: tuple[bool, bool]
    """No support is known at the low, and at the high end."""
    line_id: int
    span_id: int
    coverage: float
    """Share of its metres with points."""
    end_sigma: tuple[float, float]
    """Standard deviations of the place of both ends along the curve [m]."""


def model_span(points: Float64, fitted: FittedSpan) -> SpanModel:
    """
    Describe a span in the orientation of its route.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    fitted : FittedSpan
        Curve, ends and points.

    Returns
    -------
    SpanModel

    """
    curve, low, high = fitted.cut.curve, fitted.cut.low, fitted.cut.high
    own, reverse, end_sigma = fitted.points, fitted.reverse, fitted.end_sigma
    start_x, end_x = (high, low) if reverse else (low, high)
    sign = -1.0 if reverse else 1.0
    start, end = curve.position(np.array([start_x, end_x]))
    sag, sigma_sag = curve.fit.sag(low, high)
    step = SAG_STEP
    shares = (
        (curve.fit.sag(low - step, high)[0] - curve.fit.sag(low + step, high)[0]) / (2 * step),
        (curve.fit.sag(low, high + step)[0] - curve.fit.sag(low, high - step)[0]) / (2 * step),
    )
    sigma_sag = math.hypot(
        sigma_sag, shares[0] * end_sigma[0], shares[1] * end_sigma[1], MAP_SIGMA
    )
    sigma_a, sigma_b, sigma_c = curve.fit.parameter_sigma()
    x, _ = curve.local(points[own])
    along = (x - start_x) * sign
    lowest = curve.position(curve.fit.lowest(low, high))[0]
    a2, a1, a0 = fit_quadratic(along, points[own, 2])
    open_low, open_high = fitted.is_open
    record = Span(
        line_id=fitted.line_id,
        span_id=fitted.span_id,
        start=start,
        end=end,
        azimuth=math.remainder(curve.azimuth + (math.pi if reverse else 0.0), 2 * math.pi),
        length=high - low,
        a=curve.fit.a,
        b=(curve.fit.b - start_x) * sign,
        c=curve.fit.c,
        quadratic=(a2, a1, a0),
        sag=sag,
        lowest=lowest,
        open_start=open_high if reverse else open_low,
        open_end=open_low if reverse else open_high,
        rmse=curve.fit.rmse,
        num_points=len(own),
        coverage=fitted.coverage,
        sigma={'a': sigma_a, 'b': sigma_b, 'c': sigma_c, 'sag': sigma_sag},
    )
    return SpanModel(span=record, curve=curve, start_x=start_x, end_x=end_x)


def find_support(
    span: Span, along: float, supports: Sequence[Support]
) -> tuple[int, float]:
    """
    Return the nearer support of a span and the distance from it.

    Parameters
    ----------
    span : sequence
        Span.
    along : float
        Horizontal distance from the start of the span [m].
    supports : sequence of Support
        Towers and poles.

    Returns
    -------
    support_id, from_support
        -1 and NaN where no support is known at either end.

    """
    best = (-1, math.nan)
    for end, is_open, distance in (
        (span.start, span.open_start, along), (span.end, span.open_end, span.length - along),
    ):
        if is_open or not (math.isnan(best[1]) or distance < best[1]):
            continue
        near = [
            (math.dist(item.position[:2], end[:2]), item.support_id)
            for item in supports if span.line_id in item.line_ids
        ]
        if near and min(near)[0] <= SUPPORT_REACH:
            best = (min(near)[1], max(distance, 0.0))
    return best


def find_kind(span: Span, end: Float64, supports: Sequence[Support]) -> str:
    """Return the kind of the support that an end (3,) hangs on, 'unseen' if none is known."""
    near = [
        (distance, item.support_id, item.kind) for item in supports
        if (distance := math.dist(item.position[:2], end[:2]))
        <= (SUPPORT_REACH if span.line_id in item.line_ids else NEIGHBOR_REACH)
    ]
    return min(near)[2] if near else 'unseen'


def tabulate(models: Sequence[SpanModel]) -> Float64:
    """Return the span_table (C, ROW) of C spans between their ends."""
    return span_table(
        [model.curve for model in models],
        np.array([model.low for model in models]),
        np.array([model.high for model in models]),
    )
