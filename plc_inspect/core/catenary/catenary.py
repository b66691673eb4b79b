# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Catenary model of a conductor: course, covariance and sag; draws and quadratic form."""

from dataclasses import dataclass
import math
from typing import TypeVar

from numba import njit
import numpy as np

from plc_inspect.core.catenary.solver import add_up_quadratic, height_at, slope_at
from plc_inspect.errors import FitError
from plc_inspect.results import Float64

FloatOrArray = TypeVar('FloatOrArray', float, Float64)
NO_DRAWS: Float64 = np.empty((0, 3))
"""All points start as inliers."""
LEAST_CHORD = 1e-9
"""A shorter span has no sag [m].  Source: numerical: its chord has no slope."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CatenaryFit:
    """
    z(x) = a + c cosh((x - b) / c) with its uncertainty (paper Eq. 6).

    Inside, the curve is held by its height, slope and curvature at ``middle``, which stay
    well determined for a wire that is nearly straight, where a, b and c do not.
    """

    middle: float
    """x about which the curve is expanded [m]."""
    shape: Float64
    """(3,) height [m], slope and curvature 1 / c [1/m] at ``middle``."""
    covariance: Float64
    """(3, 3) covariance of ``shape``."""
    rmse: float
    """Root mean square residual of the inliers [m]."""
    converged: bool

    @property
    def c(self) -> float:
        """Catenary constant T0 / w [m]."""
        return 1.0 / float(self.shape[2])

    @property
    def b(self) -> float:
        """Position of the vertex [m]."""
        return self.middle - self.c * math.asinh(self.shape[1])

    @property
    def a(self) -> float:
        """Vertical displacement [m]."""
        return float(self.shape[0]) - self.c * math.sqrt(1.0 + self.shape[1] ** 2)

    def height(self, x: FloatOrArray) -> FloatOrArray:
        """Return z at each x; any shape, float64 [m]."""
        if isinstance(x, float):
            h, g, k = self.shape.tolist()
            return height_at(self.middle, h, g, k, x)
        x = np.asarray(x, dtype=np.float64)
        flat = _heights(np.ascontiguousarray(x).ravel(), self.middle, self.shape)
        result: Float64 = flat.reshape(x.shape)[()]
        return result

    def slope(self, x: FloatOrArray) -> FloatOrArray:
        """Return dz/dx at each x."""
        if isinstance(x, float):
            _, g, k = self.shape.tolist()
            return slope_at(self.middle, g, k, x)
        t = np.asarray(x, dtype=np.float64) - self.middle
        result: Float64 = np.sinh(self.shape[2] * t + math.asinh(self.shape[1]))
        return result

    def height_sigma(self, x: Float64) -> Float64:
        """Return the standard deviation of z at each x [m]."""
        t = np.atleast_1d(np.asarray(x, dtype=np.float64)) - self.middle
        result: Float64 = _height_sigma(t, self.shape, self.covariance)
        return result

    def sag(self, start: float, end: float) -> tuple[float, float]:
        """
        Return the greatest vertical distance from chord to curve and its standard deviation [m].

        Parameters
        ----------
        start, end : float
            X of the ends of the span [m].

        """
        value, sigma = _sag_and_sigma(
            self.middle, self.shape, self.covariance, float(start), float(end)
        )
        return value, sigma

    def parameter_sigma(self) -> tuple[float, float, float]:
        """Return the standard deviations of a, b and c [m]."""
        _, g, k = self.shape
        root = math.sqrt(1.0 + g * g)
        jacobian = np.array(
            [
                [1.0, -g / (root * k), root / k**2],
                [0.0, -1.0 / (root * k), math.asinh(g) / k**2],
                [0.0, 0.0, -1.0 / k**2],
            ]
        )
        variance = np.einsum('ij,jk,ik->i', jacobian, self.covariance, jacobian)
        a, b, c = np.sqrt(np.maximum(variance, 0.0))
        return float(a), float(b), float(c)

    def lowest(self, start: float, end: float) -> float:
        """Return the x of the lowest point of the curve between start and end [m]."""
        return min(max(self.b, min(start, end)), max(start, end))


def draw_triples(num_trials: int, rng: np.random.Generator) -> Float64:
    """Return (num_trials, 3) numbers from 0 to 1 that choose triples."""
    return rng.random((num_trials, 3))


def fit_quadratic(x: Float64, z: Float64) -> tuple[float, float, float]:
    """Return a2, a1, a0 of the least-squares quadratic form (N >= 3 points)."""
    if len(x) < 3:
        raise FitError(f'a quadratic needs 3 points, got {len(x)}')
    middle, mean = float(x.mean()), float(z.mean())
    t = x - middle
    scale = max(float(np.abs(t).max()), 1e-9)
    normal, right = add_up_quadratic(t, z - mean, scale, np.ones(len(t)))
    b0, b1, b2 = np.linalg.lstsq(normal, right, rcond=None)[0].tolist()
    b1, b2 = b1 / scale, b2 / scale**2
    return b2, b1 - 2.0 * b2 * middle, b0 - b1 * middle + b2 * middle**2 + mean


@njit(cache=True, nogil=True)
def _heights(x, middle, shape):  # type: ignore[no-untyped-def]
    result = np.empty(len(x))
    for m in range(len(x)):
        result[m] = height_at(middle, shape[0], shape[1], shape[2], x[m])
    return result


@njit(cache=True, nogil=True)
def _sag(middle, shape, start, end):  # type: ignore[no-untyped-def]
    """Greatest vertical distance from chord to curve: where the slope is that of the chord."""
    g, k = shape[1], shape[2]
    t0, t1 = start - middle, end - middle
    if abs(t1 - t0) < LEAST_CHORD:
        return 0.0
    base = math.asinh(g)
    first = math.cosh(k * t0 + base) / k
    chord = (math.cosh(k * t1 + base) / k - first) / (t1 - t0)
    t = (math.asinh(chord) - base) / k
    t = min(max(t, min(t0, t1)), max(t0, t1))
    at = math.cosh(k * t + base) / k
    return max(first + chord * (t - t0) - at, 0.0)


@njit(cache=True, nogil=True)
def _sag_and_sigma(middle, shape, covariance, start, end):  # type: ignore[no-untyped-def]
    """Sag, and its standard deviation by the gradient over height, slope and curvature."""
    value = _sag(middle, shape, start, end)
    gradient = np.empty(3)
    for k in range(3):
        step = max(1e-6, 1e-4 * abs(shape[k]))
        moved = shape.copy()
        moved[k] += step
        gradient[k] = (_sag(middle, moved, start, end) - value) / step
    variance = 0.0
    for p in range(3):
        for q in range(3):
            variance += gradient[p] * covariance[p, q] * gradient[q]
    return value, math.sqrt(max(variance, 0.0))


@njit(cache=True, nogil=True)
def _height_sigma(t, shape, covariance):  # type: ignore[no-untyped-def]
    """Propagate the covariance of height, slope and curvature to the height at each t."""
    g, k = shape[1], shape[2]
    root, base = math.sqrt(1.0 + g * g), math.asinh(g)
    result = np.empty(len(t))
    row = np.ones(3)
    for m in range(len(t)):
        sinh, cosh = math.sinh(k * t[m] + base), math.cosh(k * t[m] + base)
        row[1] = (sinh - g) / (root * k)
        row[2] = t[m] * sinh / k - (cosh - root) / (k * k)
        variance = 0.0
        for p in range(3):
            for q in range(3):
                variance += row[p] * covariance[p, q] * row[q]
        result[m] = math.sqrt(max(variance, 0.0))
    return result
