# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The wire points of a result, span by span."""

import numpy as np

from plc_inspect.results import Float32, Float64, InspectionResult, Int64, Span

MOST_CUBES = 2**62
"""Greatest number of cubes numbered by int64.  Source: numerical."""


class WirePoints:
    """
    The wire points of a result by span.

    Parameters
    ----------
    result : InspectionResult
        What was found.
    points : Float64
        (N, 3) its input [m].

    """

    def __init__(self, result: InspectionResult, points: Float64) -> None:
        wire = np.flatnonzero(result.line_id >= 0)
        keys = _pack(result.line_id[wire], result.span_id[wire])
        order = np.argsort(keys, kind='stable')
        self._chosen, self._keys = wire[order], keys[order]
        self._points, self._residual = points, result.residual

    def take(self, span: Span) -> tuple[Float64, Float32]:
        """Return copies of the points and residuals of one span."""
        key = _pack(np.array([span.line_id]), np.array([span.span_id]))[0]
        own = self._chosen[slice(*np.searchsorted(self._keys, (key, key + 1)))]
        return self._points[own], self._residual[own]


def _pack(line_id: np.ndarray, span_id: np.ndarray) -> Int64:
    packed: Int64 = (line_id.astype(np.int64) << 32) + span_id
    return packed


def thin_points(points: Float64, spacing: float) -> Int64:
    """Return the index of one point in each occupied cube of edge ``spacing`` [m]."""
    cubes = np.floor(points / spacing).astype(np.int64)
    if not len(cubes):
        return np.empty(0, dtype=np.int64)
    cubes -= cubes.min(axis=0)
    rows, columns, layers = (cubes.max(axis=0) + 1).tolist()
    if rows * columns * layers < MOST_CUBES:  # one number per cube sorts far faster than three
        cubes = (cubes[:, 0] * columns + cubes[:, 1]) * layers + cubes[:, 2]
    _, first = np.unique(cubes, axis=0, return_index=True)
    result: Int64 = np.sort(first).astype(np.int64)
    return result
