# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A piece of conductor in space: a catenary in a vertical plane."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
import math

from numba import njit
import numpy as np

from plc_inspect.core.catenary.catenary import CatenaryFit, FloatOrArray, NO_DRAWS
from plc_inspect.core.catenary.curve_row import (
    AZIMUTH,
    CONVERGED,
    COVARIANCE,
    CURVATURE,
    describe_misfit,
    fit_row,
    HEIGHT,
    HIGH,
    LATERAL_RMSE,
    LOW,
    MEAN_X,
    MIDDLE,
    OFFSET_SIGMA,
    ORIGIN_X,
    ORIGIN_Y,
    RMSE,
    ROW,
    to_local,
    TOLERANCE,
    TURN_SIGMA,
)
from plc_inspect.errors import FitError
from plc_inspect.results import Bool, Float64, Int64

MAX_POINTS = 2000
"""
Points that a fit takes at most while conductors are looked for.
Source: numerical: time alone; their noise is less than a millimetre in the curve's height.
"""
PART_MISS = 0.15
"""
Miss that is allowed between two parts of one conductor beyond three times its uncertainty [m].
Source: judgement; not measured.
"""


@dataclass(frozen=True, kw_only=True, eq=False)  # without slots, as the row is kept once made
class Curve:
    """
    A conductor in the frame of its own vertical plane (regularised, R_z of the paper).

    x runs along ``azimuth`` from ``origin``, y to the left of it, z up and absolute.
    """

    origin: Float64
    """(2,) plan position of x = 0 [m]."""
    azimuth: float
    """Direction of x, counter-clockwise from the map's x [rad]."""
    fit: CatenaryFit
    low: float
    """Least x of the points [m]."""
    high: float
    """Greatest x of the points [m]."""
    lateral_rmse: float
    """Root mean square of y of the inliers [m]."""
    lateral_sigma: tuple[float, float]
    """Standard deviations of the plane's offset [m] and azimuth [rad], about the mean x."""
    mean_x: float
    tolerance: float
    """Largest residual of an inlier, across and vertically [m]."""
    points: Int64
    """Indices of the inliers, ascending; one in ``stride`` of them."""
    stride: int
    """How many points of the cloud each of ``points`` stands for."""

    @property
    def num_points(self) -> int:
        """Number of inliers in the cloud, estimated where it was thinned."""
        return len(self.points) * self.stride

    @property
    def length(self) -> float:
        """Horizontal extent of the points [m]."""
        return self.high - self.low

    def local(self, points: Float64) -> tuple[Float64, Float64]:
        """Return x along and y across of (N, 2+) points, (N,) each [m]."""
        x, y = _to_locals(np.ascontiguousarray(points), self.row)
        return x, y

    def local_place(self, place: Float64) -> tuple[float, float]:
        """Return x along and y across of one place (2+,) [m]."""
        dx, dy = float(place[0] - self.origin[0]), float(place[1] - self.origin[1])
        ca, sa = math.cos(self.azimuth), math.sin(self.azimuth)
        return ca * dx + sa * dy, ca * dy - sa * dx

    def position(self, x: Float64 | float) -> Float64:
        """Return the (N, 3) points of the curve at (N,) x [m]."""
        if isinstance(x, float):
            east, north = self.origin.tolist()
            return np.array([[
                east + math.cos(self.azimuth) * x, north + math.sin(self.azimuth) * x,
                self.fit.height(x),
            ]])
        x = np.atleast_1d(np.asarray(x, dtype=np.float64))
        result = np.empty((len(x), 3))
        result[:, 0] = self.origin[0] + math.cos(self.azimuth) * x
        result[:, 1] = self.origin[1] + math.sin(self.azimuth) * x
        result[:, 2] = self.fit.height(x)
        return result

    def prediction_sigma(self, x: Float64) -> Float64:
        """Return the standard deviation of the curve's position at (N,) x [m]."""
        result: Float64 = np.sqrt(self.lateral_variance(x) + self.fit.height_sigma(x) ** 2)
        return result

    @cached_property
    def row(self) -> Float64:
        """The curve as a (ROW,) row of curve_fit; not to be changed."""
        return np.array([
            *self.origin.tolist(), math.cos(self.azimuth), math.sin(self.azimuth),
            self.fit.middle, *self.fit.shape.tolist(), self.low, self.high, self.azimuth,
            self.fit.rmse, self.lateral_rmse, *self.lateral_sigma, self.mean_x,
            self.fit.converged, self.tolerance, self.num_points,
            *self.fit.covariance.ravel().tolist(),
        ], dtype=np.float64)

    def lateral_variance(self, x: FloatOrArray) -> FloatOrArray:
        """Return the variance of the curve's position across it at x [m2]."""
        offset, turn = self.lateral_sigma
        return offset**2 + (turn * (x - self.mean_x)) ** 2


@njit(cache=True, nogil=True, error_model='numpy')
def _to_locals(points, row):  # type: ignore[no-untyped-def]
    x, y = np.empty(len(points)), np.empty(len(points))
    for k in range(len(points)):
        x[k], y[k] = to_local(row, points[k, 0], points[k, 1])
    return x, y


def fit_curve(
    points: Float64,
    chosen: Int64,
    *,
    tolerance: float,
    azimuth: float | None = None,
) -> Curve:
    """
    Fit a vertical plane and a catenary in it to points of one conductor.

    Parameters
    ----------
    points : (N, 3) float64
        Map frame [m].
    chosen : (K,) int64
        Indices of the conductor's points, ascending, no repeats.
    tolerance : float
        Largest residual of an inlier, across and vertically [m].
    azimuth : float or None
        The curve's x runs this way rather than opposite [rad]; by default to the east.

    Returns
    -------
    Curve

    Raises
    ------
    FitError
        Fewer than four points agree on a curve.

    """
    row, own, stride, num_plane = fit_row(
        points, np.ascontiguousarray(chosen, dtype=np.int64), MAX_POINTS, tolerance, tolerance,
        math.nan if azimuth is None else azimuth, NO_DRAWS,
    )
    problem = describe_misfit(row, -(-len(chosen) // stride), num_plane, len(own))
    if problem:
        raise FitError(problem)
    return unpack_curve(row, own, stride)


def unpack_curve(row: Float64, own: Int64, stride: int) -> Curve:
    """Return the curve of a row of fit_row and its (K,) points, one in ``stride`` of all."""
    values = row.tolist()
    curve = Curve(
        origin=row[ORIGIN_X : ORIGIN_Y + 1],
        azimuth=values[AZIMUTH],
        fit=CatenaryFit(
            middle=values[MIDDLE],
            shape=row[HEIGHT : CURVATURE + 1],
            covariance=row[COVARIANCE : COVARIANCE + 9].reshape(3, 3),
            rmse=values[RMSE],
            converged=bool(values[CONVERGED]),
        ),
        low=values[LOW],
        high=values[HIGH],
        lateral_rmse=values[LATERAL_RMSE],
        lateral_sigma=(values[OFFSET_SIGMA], values[TURN_SIGMA]),
        mean_x=values[MEAN_X],
        tolerance=values[TOLERANCE],
        points=own,
        stride=stride,
    )
    vars(curve)['row'] = row  # as it would be made anew
    return curve


def pack_curves(curves: Sequence[Curve]) -> Float64:
    """
    Return curves as the rows of curve_fit.

    Returns
    -------
    (C, ROW) float64

    """
    return np.array([curve.row for curve in curves], dtype=np.float64).reshape(-1, ROW)


def find_far_apart(curves: Sequence[Curve], margin: float = 1.0) -> Bool:
    """
    Tell, cheaply, which pairs of curves are so far apart that no point is on or near both.

    Returns
    -------
    (C, C) bool
        True where, in plan, the piece of one is more than ``margin`` [m] beyond the tolerances
        away from the other's.

    """
    origin = np.array([curve.origin for curve in curves]).reshape(-1, 2)
    azimuth = np.array([curve.azimuth for curve in curves])
    low, high = (np.array([getattr(curve, name) for curve in curves]) for name in ('low', 'high'))
    reach = np.array([curve.tolerance for curve in curves])
    reach = reach[:, None] + reach + margin
    unit = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    left = np.stack([-unit[:, 1], unit[:, 0]], axis=1)
    beyond = np.zeros((len(curves), len(curves)), dtype=bool)
    for axis, least, most in ((unit, low, high), (left, 0.0 * low, 0.0 * high)):
        ends = [
            (origin + at[:, None] * unit) @ axis.T - (origin * axis).sum(axis=1)
            for at in (low, high)
        ]
        beyond |= np.maximum(*ends) < least - reach
        beyond |= np.minimum(*ends) > most + reach
    return beyond
