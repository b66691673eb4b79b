# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A piece of conductor in space: a catenary in a vertical plane."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
import math
from typing import NamedTuple

from numba import njit
import numpy as np

from plc_inspect.core.catenary.catenary import CatenaryFit, FloatOrArray, NO_DRAWS
from plc_inspect.core.catenary.curve_row import (
    AZIMUTH,
    CONVERGED,
    COS,
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
    SIN,
    SLOPE,
    to_local,
    TOLERANCE,
    TURN_SIGMA,
)
from plc_inspect.core.catenary.solver import height_at
from plc_inspect.core.numerics.arrays import put
from plc_inspect.errors import FitError
from plc_inspect.results import Float64, Int32, Int64

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
        result: Float64 = _positions(np.ascontiguousarray(x, dtype=np.float64), self.row)
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


@njit(cache=True, nogil=True, error_model='numpy')
def _positions(x, row):  # type: ignore[no-untyped-def]
    result = np.empty((len(x), 3))
    for k in range(len(x)):
        result[k, 0] = row[ORIGIN_X] + row[COS] * x[k]
        result[k, 1] = row[ORIGIN_Y] + row[SIN] * x[k]
        result[k, 2] = height_at(row[MIDDLE], row[HEIGHT], row[SLOPE], row[CURVATURE], x[k])
    return result


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


def span_table(curves: Sequence[Curve], start_x: Float64, end_x: Float64) -> Float64:
    """
    Pack curves between other ends than their own for the kernels.

    Parameters
    ----------
    curves : sequence of Curve
        C of them.
    start_x, end_x : (C,) float64
        x of the ends, the lesser first [m].

    Returns
    -------
    (C, ROW) float64
        As pack_curves, with these ends.

    """
    table = pack_curves(curves)
    table[:, LOW], table[:, HIGH] = start_x, end_x
    return table


class Near(NamedTuple):
    """For each curve, which are near it: those of curve k are item[start[k] : start[k + 1]]."""

    start: Int64
    """(C + 1,) where the list of each curve begins."""
    item: Int32
    """(P,) numbers of curves, ascending in each list."""

    def of(self, number: int) -> Int32:
        """Return the list of one curve."""
        return self.item[self.start[number] : self.start[number + 1]]


def find_near(
    curves: Sequence[Curve], margin: float = 1.0, others: Sequence[Curve] | None = None
) -> Near:
    """
    Find, cheaply, which curves are so near to each other that a point may be on or near both.

    Parameters
    ----------
    curves : sequence of Curve
        C curves.
    margin : float
        Pieces are near that come, in plan, within this of each other beyond their tolerances [m].
    others : sequence of Curve, optional
        What is looked for; the curves themselves by default, each but itself.

    Returns
    -------
    Near
        Numbers of others for each curve.

    """
    rows = pack_curves(curves)
    wanted = rows if others is None else pack_curves(others)
    order = np.argsort(_list_boxes(wanted)[:, 0], kind='stable')
    return Near(*_list_near(rows, wanted, order, margin, others is None))


@njit(cache=True, nogil=True, error_model='numpy')
def _list_boxes(rows):  # type: ignore[no-untyped-def]
    """Least x, most x, least y and most y of the pieces, in plan, with their tolerances [m]."""
    result = np.empty((len(rows), 4))
    for k in range(len(rows)):
        row = rows[k]
        for axis in range(2):
            first = row[ORIGIN_X + axis] + row[COS + axis] * row[LOW]
            last = row[ORIGIN_X + axis] + row[COS + axis] * row[HIGH]
            result[k, 2 * axis] = min(first, last) - row[TOLERANCE]
            result[k, 2 * axis + 1] = max(first, last) + row[TOLERANCE]
    return result


@njit(cache=True, nogil=True, error_model='numpy')
def _list_near(rows, wanted, order, margin, is_same):  # type: ignore[no-untyped-def]
    """List the wanted rows near each row, as Near has them; ``order`` is that of their least x."""
    boxes, others = _list_boxes(rows), _list_boxes(wanted)
    start = np.zeros(len(rows) + 1, dtype=np.int64)
    item = np.empty(max(4 * len(rows), 16), dtype=np.int32)
    used = 0
    for k in range(len(rows)):
        box = boxes[k]
        for m in order:
            if others[m, 0] > box[1] + margin:
                break
            if (
                others[m, 1] < box[0] - margin
                or others[m, 2] > box[3] + margin
                or others[m, 3] < box[2] - margin
                or (is_same and m == k)
            ):
                continue
            if _is_beyond(rows[k], wanted[m], margin) or _is_beyond(wanted[m], rows[k], margin):
                continue
            if used == len(item):
                longer = np.empty(2 * used, dtype=np.int32)
                put(item, longer)
                item = longer
            item[used] = m
            used += 1
        item[start[k] : used].sort()
        start[k + 1] = used
    return start, item[:used]


@njit(cache=True, nogil=True, error_model='numpy')
def _is_beyond(row, other, margin):  # type: ignore[no-untyped-def]
    """Tell whether another piece lies wholly before, behind or on one side of a row's."""
    reach = row[TOLERANCE] + other[TOLERANCE] + margin
    x, y = to_local(
        row, other[ORIGIN_X] + other[COS] * other[LOW], other[ORIGIN_Y] + other[SIN] * other[LOW]
    )
    end_x, end_y = to_local(
        row, other[ORIGIN_X] + other[COS] * other[HIGH], other[ORIGIN_Y] + other[SIN] * other[HIGH]
    )
    return (
        max(x, end_x) < row[LOW] - reach or min(x, end_x) > row[HIGH] + reach
        or max(y, end_y) < -reach or min(y, end_y) > reach
    )
