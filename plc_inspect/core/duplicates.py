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

"""Duplicates: curves that have their points, or their course, from better seen ones."""

from collections.abc import Sequence

import numpy as np

from plc_inspect.config import CatenarySettings
from plc_inspect.core.curve import Curve, find_far_apart
from plc_inspect.results import Bool, Float64

THICK = 0.12
"""Points of one conductor spread less than this about its curve (rms) [m]."""
MAX_SHARED = 0.5
"""A curve with more of its points on better seen curves is dropped."""


def drop_duplicates(
    points: Float64, curves: Sequence[Curve], settings: CatenarySettings
) -> tuple[Curve, ...]:
    """
    Drop each curve that has most of its points, or of its course, from better seen ones.

    A line laid across several conductors at a small angle meets points of each, but has none
    of its own.
    """
    order = sorted(curves, key=lambda curve: _rank(curve, settings))
    far = find_far_apart(order)
    kept: list[int] = []
    for number, curve in enumerate(order):
        stations = curve.position(np.linspace(curve.low, curve.high, 21))
        own = points[curve.points]
        on_course = np.zeros(len(stations), dtype=bool)
        shared = np.zeros(len(own), dtype=bool)
        for other in (order[k] for k in kept if not far[number, k]):
            reach = 0.6 * max(curve.tolerance, other.tolerance)
            on_course |= _lies_on(stations, other, reach)
            shared |= _lies_on(own, other, other.tolerance)
        if on_course.mean() < 0.5 and shared.mean() <= MAX_SHARED:
            kept.append(number)
    result = [order[number] for number in kept]
    result.sort(key=lambda curve: (-curve.length, *curve.origin))
    return tuple(result)


def _rank(curve: Curve, settings: CatenarySettings) -> tuple[float, ...]:
    """
    Order of belief: by points, but a thick curve in a short span comes after all thin ones.

    Bundles hang in long spans; in a short one a thick curve lies over several conductors.
    """
    return (
        float(is_thick(curve) and curve.length < settings.bundle_length),
        float(-curve.num_points),
        float(curve.origin[0]),
        float(curve.origin[1]),
    )


def is_thick(curve: Curve) -> bool:
    """Tell a curve over several conductors, or a bundle, from one over a single conductor."""
    return max(curve.lateral_rmse, curve.fit.rmse) > THICK


def _lies_on(points: Float64, curve: Curve, reach: float) -> Bool:
    """Tell which points are within reach of a curve between its ends."""
    x, y = curve.local(points)
    inside = (x >= curve.low - 0.5) & (x <= curve.high + 0.5)
    result: Bool = inside & (np.hypot(y, points[:, 2] - curve.fit.height(x)) <= reach)
    return result
