# Copyright 2026 plc_inspect contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Breaks of a track: the supports that it passes show as kinks."""

from dataclasses import dataclass
import math

import numpy as np

from plc_inspect.results import Float64

MIN_SIDE = 5.0
"""Least extent on either side of a break [m]."""
MIN_SIDE_POINTS = 6
MIN_KINK = 0.012
"""Smallest change of slope that counts as a kink, on top of its own uncertainty."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Break:
    """A place where a track is two curves rather than one."""

    x: float
    """Position along the track [m]."""
    kink: float
    """Change of slope, negative where the conductor hangs from a support."""
    turn: float
    """Change of plan direction [rad]."""


def find_break(x: Float64, y: Float64, z: Float64) -> Break | None:
    """
    Find the most pronounced support on a track, if there is one.

    A conductor hangs in convex arcs: between two spans the slope falls abruptly, or the plan
    direction turns.  All splits are tried, with a parabola in z and a line in y on either side
    (least squares by prefix sums), and the one of least squared error is believed when its kink
    is greater than four times its own standard deviation.  O(N log N).

    Parameters
    ----------
    x, y, z : (N,) float64
        Along the track, across it and up [m].

    Returns
    -------
    Break or None

    """
    if len(x) < 2 * MIN_SIDE_POINTS or float(np.ptp(x)) < 2 * MIN_SIDE:
        return None
    order = np.argsort(x, kind='stable')
    x, y, z = x[order], y[order], z[order]
    middle, scale = (x[0] + x[-1]) / 2, (x[-1] - x[0]) / 2
    t = (x - middle) / scale
    z = z - z.mean()
    y = y - y.mean()
    sums = np.cumsum(
        np.stack(
            [np.ones_like(t), t, t**2, t**3, t**4, z, z * t, z * t**2, z * z, y, y * t, y * y]
        ),
        axis=1,
    )
    cuts = _cuts(x)
    if not len(cuts):
        return None
    left = sums[:, cuts - 1]
    right = sums[:, -1:] - left
    error_left, model_left = _errors(left)
    error_right, model_right = _errors(right)
    total = error_left + error_right
    best = int(np.argmin(total))
    cut = int(cuts[best])
    noise = math.sqrt(max(float(total[best]), 0.0) / max(len(x) - 10, 1))
    t_cut = (t[cut - 1] + t[cut]) / 2
    ml, mr = model_left[best], model_right[best]
    t_meet = _crossing(ml, mr, t_cut, float(t[cut - 1]), float(t[cut]))
    kink = ((mr[1] + 2 * mr[2] * t_meet) - (ml[1] + 2 * ml[2] * t_meet)) / scale
    turn = math.atan((mr[4] - ml[4]) / scale)
    length_left, length_right = x[cut - 1] - x[0], x[-1] - x[cut]
    spread = [(cut, length_left), (len(x) - cut, length_right)]
    kink_sigma = noise * math.sqrt(sum(192.0 / (n * length**2) for n, length in spread))
    turn_sigma = noise * math.sqrt(sum(12.0 / (n * length**2) for n, length in spread))
    if kink > -(MIN_KINK + 4 * kink_sigma) and abs(turn) < MIN_KINK + 4 * turn_sigma:
        return None
    if kink > 4 * kink_sigma + MIN_KINK:  # bends upwards: no support hangs like that
        return None
    return Break(x=float(middle + scale * t_meet), kink=float(kink), turn=turn)


def _cuts(x: Float64) -> np.ndarray:
    """Split positions about half a metre apart, each with enough on both sides."""
    inside = (x - x[0] >= MIN_SIDE) & (x[-1] - x >= MIN_SIDE)
    rank = np.arange(len(x))
    inside &= (rank >= MIN_SIDE_POINTS) & (rank <= len(x) - MIN_SIDE_POINTS)
    index = np.flatnonzero(inside)
    if not len(index):
        return index
    bins = np.floor(x[index] / 0.5)
    first = np.ones(len(index), dtype=bool)
    first[1:] = np.diff(bins) > 0
    return index[first]


def _errors(s: Float64) -> tuple[Float64, Float64]:
    """Squared error and model of the parabola in z and the line in y, for (12, C) sums."""
    matrix = np.empty((s.shape[1], 3, 3))
    for i in range(3):
        for j in range(3):
            matrix[:, i, j] = s[i + j]
    matrix += 1e-9 * s[0][:, None, None] * np.eye(3)
    right = s[5:8].T
    solution = np.linalg.solve(matrix, right[:, :, None])[:, :, 0]
    error_z = s[8] - (solution * right).sum(axis=1)
    spread = s[0] * s[2] - s[1] ** 2 + 1e-12
    slope = (s[0] * s[10] - s[1] * s[9]) / spread
    offset = (s[9] - slope * s[1]) / s[0]
    error_y = s[11] - slope * s[10] - offset * s[9]
    model = np.concatenate([solution, offset[:, None], slope[:, None]], axis=1)
    return np.maximum(error_z, 0.0) + np.maximum(error_y, 0.0), model


def _crossing(left: Float64, right: Float64, near: float, low: float, high: float) -> float:
    """Where the two parabolas meet nearest to ``near``; ``near`` if they do not meet there."""
    d0, d1, d2 = right[0] - left[0], right[1] - left[1], right[2] - left[2]
    roots = np.roots([d2, d1, d0]) if abs(d2) > 1e-12 else np.array([-d0 / d1 if d1 else near])
    real = np.real(roots[np.abs(np.imag(roots)) < 1e-9])
    if not len(real):
        return near
    meet = float(real[np.argmin(np.abs(real - near))])
    slack = 0.02
    return meet if low - slack <= meet <= high + slack else near
