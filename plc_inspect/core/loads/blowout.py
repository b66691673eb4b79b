# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A span blown out of its vertical plane by wind."""

import math

import numpy as np

from plc_inspect.core.loads.sag_tension import height_at, LEAST_LENGTH, solve_vertex, State
from plc_inspect.results import Float64, Span

NUM_STEPS = 4
"""
Newton steps to the nearest point of a curve.
Source: numerical: each step squares the error.
"""
LEAST_BEND = -0.5
"""
Least curvature term of such a step, so that it converges for points above the curve.
Source: numerical: keeps the second derivative above 1/2.
"""


class SwungSpan:
    """
    A span in the plane of its load.

    x runs along the span from its start, y out of the plane, z against the load.
    """

    def __init__(self, span: Span, state: State, side: float = 1.0) -> None:
        """
        Place a span in the plane of its load.

        Parameters
        ----------
        span : Span
            Gives the ends.
        state : State
            Gives swing and constant.
        side : float
            1 if the wind blows to the left of the span, -1 if to the right.

        """
        chord = span.end - span.start
        across = np.array([-chord[1], chord[0], 0.0]) / max(
            float(np.hypot(*chord[:2])), LEAST_LENGTH
        )
        swing = side * state.swing
        self.up = np.array([0.0, 0.0, math.cos(swing)]) - across * math.sin(swing)
        self.along = (chord - (chord @ self.up) * self.up) / state.length
        self.out = np.cross(self.up, self.along)
        self.start, self.state = span.start, state

    def measure(self, points: Float64) -> tuple[Float64, Float64]:
        """Return (N,) distances of (N, 3) points to the curve, and x of its nearest points [m]."""
        state, moved = self.state, points - self.start
        x0, y, z = moved @ self.along, moved @ self.out, moved @ self.up
        b = solve_vertex(state.length, state.rise, state.c)
        x = np.clip(x0, 0.0, state.length)
        for _ in range(NUM_STEPS):
            gap = height_at(x, state.length, state.rise, state.c) - z
            slope = np.sinh((x - b) / state.c)
            first = (x - x0) + gap * slope
            bend = np.maximum(gap * np.cosh((x - b) / state.c) / state.c, LEAST_BEND)
            second = 1.0 + slope**2 + bend
            x = np.clip(x - first / second, 0.0, state.length)
        gap = height_at(x, state.length, state.rise, state.c) - z
        return np.sqrt((x - x0) ** 2 + y**2 + gap**2), x

    def position(self, x: Float64) -> Float64:
        """Return the (N, 3) points of the curve at (N,) x [m]."""
        z = height_at(x, self.state.length, self.state.rise, self.state.c)
        result: Float64 = self.start + x[:, None] * self.along + z[:, None] * self.up
        return result
