# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Catenary curves of estimates and truth, and the distance between two of them."""

from collections.abc import Mapping
from dataclasses import dataclass
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plc_inspect.errors import DataError
from plc_inspect.results import catenary_heights, Span

Float64 = NDArray[np.float64]
FARTHEST = 50.0
"""Distance from its vertex beyond which a curve is level [c]; cosh overflows at 710."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Curve:
    """z(x) = a + c cosh((x - b) / c), x the horizontal distance from start towards end [m]."""

    line_id: int
    span_id: int
    start: Float64
    """(3,) [m]."""
    end: Float64
    """(3,) [m]."""
    a: float
    b: float
    c: float

    @property
    def length(self) -> float:
        """Horizontal distance from start to end [m]."""
        return float(np.hypot(*(self.end - self.start)[:2]))

    def heights(self, x: Float64) -> Float64:
        """Return z (N,) at x (N,), without overflow far outside the span [m]."""
        reach = FARTHEST * self.c
        return catenary_heights(self.a, self.b, self.c, np.clip(x, self.b - reach, self.b + reach))

    def locate(self, x: Float64) -> Float64:
        """Return the points (N, 3) [m] at x (N,) [m]."""
        share = x / self.length
        points = self.start + share[:, None] * (self.end - self.start)
        points[:, 2] = self.heights(x)
        return points

    def project(self, xy: Float64) -> tuple[Float64, Float64]:
        """Return the distances along and to the left (N,) of positions xy (N, 2) [m]."""
        along = (self.end - self.start)[:2] / self.length
        rel = xy - self.start[:2]
        return rel @ along, rel @ np.array([-along[1], along[0]])

    def measure_sag(self, low: float, high: float) -> float:
        """Return the greatest vertical distance [m] from chord to curve between x low and high."""
        ends = self.heights(np.array([low, high]))
        slope = float(ends[1] - ends[0]) / (high - low)
        x = min(max(self.b + self.c * math.asinh(slope), low), high)
        return float(ends[0]) + slope * (x - low) - float(self.heights(np.array([x]))[0])


def parse_curve(row: Mapping[str, Any]) -> Curve:
    """
    Return the curve of one span of ``truth.json``.

    Raises
    ------
    DataError
        A key is missing, a value is not a finite number, or the span has no length.

    """
    try:
        curve = Curve(
            line_id=int(row['line_id']), span_id=int(row['span_id']),
            start=np.array(row['start'], dtype=np.float64).reshape(3),
            end=np.array(row['end'], dtype=np.float64).reshape(3),
            a=float(row['a']), b=float(row['b']), c=float(row['c']),
        )
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise DataError(f'a span cannot be read: {error!r}') from error
    return check_curve(curve)


def check_curve(curve: Curve) -> Curve:
    """Return a curve; DataError if a value is not finite, or it has no length."""
    values = np.array([*curve.start, *curve.end, curve.a, curve.b, curve.c])
    if not np.isfinite(values).all() or curve.length <= 0 or curve.c <= 0:
        raise DataError(
            f'span {curve.span_id} of line {curve.line_id} has length {curve.length:g} m and'
            f' c {curve.c:g} m'
        )
    return curve


def from_span(span: Span) -> Curve:
    """Return the curve of a span of an InspectionResult."""
    return Curve(
        line_id=span.line_id, span_id=span.span_id, start=span.start, end=span.end, a=span.a,
        b=span.b, c=span.c,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Comparison:
    """Differences of an estimate from a reference over their common length."""

    common: float
    """Share of the reference's stretch that the estimate covers, 0 to 1."""
    lateral: Float64
    """(K,) horizontal distances across the reference [m]."""
    vertical: Float64
    """(K,) heights of the estimate above the reference [m]."""

    @property
    def lateral_rms(self) -> float:
        """Root mean square lateral distance [m], inf without common length."""
        return _rms(self.lateral)

    @property
    def vertical_rms(self) -> float:
        """Root mean square vertical distance [m], inf without common length."""
        return _rms(self.vertical)


def _rms(values: Float64) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else math.inf


def compare(
    reference: Curve, estimate: Curve, stretch: tuple[float, float], step: float = 0.5,
    overhang: float = 0.5,
) -> Comparison:
    """
    Compare an estimated curve with a reference every ``step`` metres.

    Parameters
    ----------
    reference, estimate : Curve
        Curves in one frame.
    stretch : tuple of float
        First and last x along the reference [m].
    step : float
        Spacing of the samples [m].
    overhang : float
        Length by which the estimate is extended at both ends [m].

    Returns
    -------
    Comparison

    """
    num = max(2, round((stretch[1] - stretch[0]) / step) + 1)
    points = reference.locate(np.linspace(stretch[0], stretch[1], num))
    x, lateral = estimate.project(points[:, :2])
    inside = (x >= -overhang) & (x <= estimate.length + overhang)
    vertical = estimate.heights(x[inside]) - points[inside, 2]
    return Comparison(common=float(inside.mean()), lateral=-lateral[inside], vertical=vertical)
