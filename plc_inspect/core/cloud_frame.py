# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
A frame that a cloud's own points fix: the same cloud gives the same result wherever it lies.

Cells of the ground, voxels and windows are laid out along the axes of the frame in which the
stages run.  In a frame of its own a cloud that was turned about the vertical or moved comes out
the same, up to rounding.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

from numba import njit, prange
import numpy as np

from plc_inspect.core.numerics.arrays import is_on_earth, NUM_PARTS
from plc_inspect.results import Float64, Hazard, InspectionResult, Span

OBLIQUE = 0.55
"""
Azimuth of the cloud's longest axis in its frame [rad].
Source: judgement: no line along or across that axis runs along a border of cells for long; of
five angles from 0.3 to 0.65 one at which the streets of test/test_real_clouds.py are found best.
"""
NUM_SUMS = 11
"""Number, three sums, three products and four triple products.  Source: derived."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CloudFrame:
    """A frame with z up, turned about the vertical and moved against the map frame."""

    origin: Float64
    """(3,) in the map frame [m]."""
    azimuth: float
    """Of the frame's x axis in the map frame, counter-clockwise (REP-103) [rad]."""

    @property
    def axes(self) -> Float64:
        """(2, 2) unit vectors of the frame's x and y in the plane of the map frame, row by row."""
        cos, sin = math.cos(self.azimuth), math.sin(self.azimuth)
        return np.array([[cos, sin], [-sin, cos]])

    @property
    def east(self) -> Float64:
        """(2,) unit vector of the map frame's x axis in this frame."""
        return self.axes[:, 0].copy()

    def enter(self, points: Float64) -> Float64:
        """
        Bring points from the map frame into this one.

        Parameters
        ----------
        points : (N, 3) float64
            Map frame [m]; what is not finite stays so.

        Returns
        -------
        (N, 3) float64
            This frame, a new array [m].

        """
        own = np.ascontiguousarray(points, dtype=np.float64)
        own = own if own.flags.writeable else own.copy()  # else numba would compile all anew
        result = np.empty((len(own), 3))  # here and not in the kernel: in large pages of memory
        _enter(own, self.origin, self.axes, result)
        return result

    def leave(self, points: Float64) -> Float64:
        """Bring (..., 3) points from this frame into the map frame [m]; a new array."""
        result = points + self.origin
        result[..., :2] = points[..., :2] @ self.axes + self.origin[:2]
        return result

    def leave_span(self, span: Span) -> Span:
        """Bring a span from this frame into the map frame."""
        a2, a1, a0 = span.quadratic
        up = float(self.origin[2])
        return replace(
            span,
            start=self.leave(span.start),
            end=self.leave(span.end),
            lowest=self.leave(span.lowest),
            azimuth=math.remainder(span.azimuth + self.azimuth, 2 * math.pi),
            a=span.a + up,
            quadratic=(a2, a1, a0 + up),
        )

    def leave_result(
        self, result: InspectionResult, offending: Sequence[Float64]
    ) -> InspectionResult:
        """
        Bring a result from this frame into the map frame.

        Parameters
        ----------
        result : InspectionResult
            This frame.
        offending : sequence of (K, 3) float64
            Points of each hazard, this frame [m].

        Returns
        -------
        InspectionResult

        """
        return replace(
            result,
            spans=tuple(self.leave_span(span) for span in result.spans),
            supports=tuple(
                replace(item, position=self.leave(item.position)) for item in result.supports
            ),
            hazards=tuple(
                self._leave_hazard(hazard, own)
                for hazard, own in zip(result.hazards, offending, strict=True)
            ),
        )

    def _leave_hazard(self, hazard: Hazard, offending: Float64) -> Hazard:
        own = self.leave(offending)
        return replace(
            hazard,
            position=self.leave(hazard.position),
            extent=np.stack([own.min(axis=0), own.max(axis=0)]),
        )


def find_cloud_frame(points: Float64) -> CloudFrame:
    """
    Return the frame that a cloud's points fix.

    Its origin is their mean, its x axis OBLIQUE from the longest axis of their spread in plan,
    which points to the side where they reach farther.  Cost O(N).

    Parameters
    ----------
    points : (N, 3) float64
        Map frame, z up [m]; rows that are not finite are left out.

    Returns
    -------
    CloudFrame

    """
    own = np.ascontiguousarray(points, dtype=np.float64)
    own = own if own.flags.writeable else own.copy()
    first = _find_first(own)
    reference = own[max(first, 0)].copy() if first >= 0 else np.zeros(3)
    return derive_frame(reference, sum_moments(own, reference))


def sum_moments(points: Float64, reference: Float64) -> Float64:
    """
    Return what fixes the frame of a cloud; that of parts of it adds up.

    Parameters
    ----------
    points : (N, 3) float64
        Map frame, contiguous and writeable [m]; rows that are not finite are left out.
    reference : (3,) float64
        Near the points, the same for all parts [m].

    Returns
    -------
    (NUM_SUMS,) float64
        Number of points, and sums of coordinates and their products from the reference.

    """
    result: Float64 = _sum(points, reference)
    return result


def derive_frame(reference: Float64, sums: Float64) -> CloudFrame:
    """
    Return the frame of a cloud from what `sum_moments` gives of it, or of all its parts.

    Parameters
    ----------
    reference : (3,) float64
        That of the sums [m].
    sums : (NUM_SUMS,) float64
        Of all points.

    Returns
    -------
    CloudFrame

    """
    num, x, y, z, xx, xy, yy, xxx, xxy, xyy, yyy = sums.tolist()
    if num == 0:
        return CloudFrame(origin=np.zeros(3), azimuth=0.0)
    x, y, z = x / num, y / num, z / num
    var_x, cov, var_y = xx / num - x * x, xy / num - x * y, yy / num - y * y
    axis = math.atan2(2.0 * cov, var_x - var_y) / 2.0
    cos, sin = math.cos(axis), math.sin(axis)
    # third moment along the axis, about the mean
    mean, spread = cos * x + sin * y, cos**2 * var_x + 2 * cos * sin * cov + sin**2 * var_y
    cubed = cos**3 * xxx + 3 * cos**2 * sin * xxy + 3 * cos * sin**2 * xyy + sin**3 * yyy
    if cubed / num - 3.0 * mean * spread - mean**3 < 0.0:
        axis += math.pi
    return CloudFrame(
        origin=reference + np.array([x, y, z]),
        azimuth=math.remainder(axis - OBLIQUE, 2 * math.pi),
    )


@njit(cache=True, nogil=True)
def _find_first(points):  # type: ignore[no-untyped-def]
    """Return the first of (N, 3) points that can be one, -1 none."""
    for i in range(len(points)):
        if is_on_earth(points[i, 0], points[i, 1], points[i, 2]):
            return i
    return -1


@njit(cache=True, parallel=True, nogil=True)
def _sum(points, reference):  # type: ignore[no-untyped-def]
    """Return number of points, and sums of x, y, z, and products of x and y, from a reference."""
    parts = np.zeros((NUM_PARTS, NUM_SUMS))
    num = len(points)
    for part in prange(NUM_PARTS):
        # local variables stay in registers
        n = sx = sy = sz = xx = xy = yy = xxx = xxy = xyy = yyy = 0.0
        for i in range(part * num // NUM_PARTS, (part + 1) * num // NUM_PARTS):
            if not is_on_earth(points[i, 0], points[i, 1], points[i, 2]):
                continue
            x, y = points[i, 0] - reference[0], points[i, 1] - reference[1]
            n, sx, sy, sz = n + 1.0, sx + x, sy + y, sz + points[i, 2] - reference[2]
            x2, y2 = x * x, y * y
            xx, xy, yy = xx + x2, xy + x * y, yy + y2
            xxx, xxy, xyy, yyy = xxx + x2 * x, xxy + x2 * y, xyy + x * y2, yyy + y2 * y
        for k, value in enumerate((n, sx, sy, sz, xx, xy, yy, xxx, xxy, xyy, yyy)):
            parts[part, k] = value
    for part in range(1, NUM_PARTS):
        for k in range(NUM_SUMS):
            parts[0, k] += parts[part, k]
    return parts[0].copy()


@njit(cache=True, parallel=True, nogil=True)
def _enter(points, origin, axes, result):  # type: ignore[no-untyped-def]
    num = len(points)
    for part in prange(NUM_PARTS):
        for i in range(part * num // NUM_PARTS, (part + 1) * num // NUM_PARTS):
            x, y = points[i, 0] - origin[0], points[i, 1] - origin[1]
            result[i, 0] = axes[0, 0] * x + axes[0, 1] * y
            result[i, 1] = axes[1, 0] * x + axes[1, 1] * y
            result[i, 2] = points[i, 2] - origin[2]
