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

"""Collection of the points along a curve, and its extension as far as they go."""

import dataclasses
from dataclasses import dataclass
import math

from numba import njit
import numpy as np

from plc_inspect.config import CatenarySettings
from plc_inspect.core.bead_fit import SHELL_RATIO, SHELL_SHARE
from plc_inspect.core.curve import Curve, fit_curve
from plc_inspect.core.plan_index import gather_strip, PlanIndex
from plc_inspect.errors import FitError
from plc_inspect.results import Bool, Float64, Int64

CROWD_LENGTH = 4.0
"""Length of the parts of a curve that are crowded or not [m]."""
FOLLOW_SHARE = 0.6
"""A conductor is followed where the shell holds at most this share of the points on it."""
COMPANY_RADIUS = 0.8
"""Distance at which other things keep a curve company [m]."""
MAX_ROUNDS = 8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Profile:
    """What lies on a curve and close about it, metre by metre."""

    low: float
    """x of the first bin's lower edge [m]."""
    step: float
    """Length of a bin [m]."""
    core: Int64
    """(B,) points on the curve in each bin."""
    shell: Int64
    """(B,) points close about the curve, but not on it."""
    chosen: Int64
    """Indices of the points on the curve, ascending."""

    @property
    def coverage(self) -> float:
        """Share of the bins that hold points of the curve."""
        return float((self.core > 0).mean()) if len(self.core) else 0.0

    @property
    def crowding(self) -> float:
        """Share of the curve, in parts of CROWD_LENGTH, that has points close about it."""
        parts = max(round(CROWD_LENGTH / self.step), 1)
        starts = np.arange(0, len(self.core), parts)
        core = np.add.reduceat(self.core, starts)
        shell = np.add.reduceat(self.shell, starts)
        filled = (core > 0) | (shell > 0)
        if not filled.any():
            return 1.0
        return float((shell > SHELL_SHARE * core + 1.0)[filled].mean())


def profile_curve(
    points: Float64,
    index: PlanIndex,
    curve: Curve,
    low: float,
    high: float,
    *,
    step: float = 1.0,
    ignore: Bool | None = None,
) -> Profile:
    """
    Count the points on a curve and close about it between two x.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    index : PlanIndex
        Searched.
    curve : Curve
        Used also beyond its own ends.
    low, high : float
        X of the ends [m].
    step : float
        Length of a bin [m].
    ignore : (N,) bool
        Points that do not count as close about the curve, such as other wires.

    Returns
    -------
    Profile

    """
    ends = curve.position(np.array([low, high]))
    num = max(math.ceil((high - low) / step), 1)
    if ignore is None:
        ignore = np.zeros(0, dtype=bool)
    core, shell, chosen = _profile(
        points,
        index.start,
        index.order,
        index.origin,
        index.cell_size,
        index.shape[0],
        index.shape[1],
        ends,
        curve.origin,
        curve.azimuth,
        curve.fit.middle,
        curve.fit.shape,
        low,
        step,
        num,
        curve.tolerance,
        ignore,
    )
    chosen.sort(kind='stable')  # it comes nearly in order
    return Profile(low=low, step=step, core=core, shell=shell, chosen=chosen)


def measure_company(
    points: Float64, index: PlanIndex, curve: Curve, profile: Profile, wire: Bool
) -> float:
    """
    Return the share of a curve, in parts, that has other things close beside it.

    A part counts where more points lie within ``COMPANY_RADIUS`` than on the curve itself, other
    wires left out.  Roofs, walls and the arcs that scan lines draw on them have company all
    along; a conductor has it only where it passes a crown.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    index : PlanIndex
        Searched.
    curve : Curve
        The curve.
    profile : Profile
        Of the curve between its ends.
    wire : (N,) bool
        Points of this and other curves.

    """
    radius = max(COMPANY_RADIUS, 2 * curve.tolerance)
    around = profile_curve(
        points, index, dataclasses.replace(curve, tolerance=radius), curve.low, curve.high
    ).chosen
    others = around[~wire[around]]
    x, _ = curve.local(points[others])
    parts = max(round(CROWD_LENGTH / profile.step), 1)
    num = math.ceil(len(profile.core) / parts)
    place = np.clip(((x - profile.low) / CROWD_LENGTH).astype(np.int64), 0, num - 1)
    beside = np.bincount(place, minlength=num)
    on = np.add.reduceat(profile.core, np.arange(0, len(profile.core), parts))
    return float((beside > on).mean())


def extend(
    points: Float64, index: PlanIndex, curve: Curve, settings: CatenarySettings
) -> Curve:
    """
    Let a curve take in the points along it, within its ends and beyond, as far as they go.

    Each round extrapolates no farther than the fit is sure of, and stops for good where the next
    ``max_step`` metres hold no points of a free wire.
    """
    for _ in range(MAX_ROUNDS):
        reach = _sure_reach(curve, settings.max_step)
        profile = profile_curve(points, index, curve, curve.low - reach, curve.high + reach)
        good = (profile.core > 0) & (profile.shell <= FOLLOW_SHARE * profile.core)
        own_low = int((curve.low - profile.low) / profile.step)
        own_high = int((curve.high - profile.low) / profile.step)
        allowed = math.ceil(settings.max_step / profile.step)
        first = _walk(good[: own_low + 1][::-1], allowed)
        last = _walk(good[min(own_high, len(good) - 1) :], allowed)
        low = profile.low + (own_low - first) * profile.step
        high = profile.low + (own_high + last + 1) * profile.step
        x, _ = curve.local(points[profile.chosen])
        chosen = profile.chosen[(x >= low) & (x <= high)]
        if len(chosen) < 4:
            return curve
        try:
            grown = fit_curve(
                points, chosen, tolerance=curve.tolerance, azimuth=curve.azimuth
            )
        except FitError:
            return curve
        if grown.num_points < 0.9 * curve.num_points or grown.length < 0.9 * curve.length:
            return curve
        done = grown.length < curve.length + 1.0
        curve = grown
        if done:
            break
    return curve


def _sure_reach(curve: Curve, longest: float) -> float:
    """How far beyond both ends the curve is known to its tolerance, at most ``longest``."""
    steps = np.linspace(0.0, longest, 13)
    sigma = np.maximum(
        curve.prediction_sigma(curve.high + steps), curve.prediction_sigma(curve.low - steps)
    )
    sure = steps[3 * sigma <= curve.tolerance]
    return float(sure[-1]) if len(sure) else 0.0


def _walk(good: Bool, allowed: int) -> int:
    """Count the steps to the last good bin reached over at most ``allowed`` bad in a row."""
    last = bad = 0
    for step, value in enumerate(good):
        if value:
            last, bad = step, 0
        else:
            bad += 1
            if bad > allowed:
                break
    return last


@njit(cache=True, nogil=True)
def _profile(  # type: ignore[no-untyped-def]
    points, start, order, grid_origin, cell, rows, columns, ends,
    origin, azimuth, middle, shape, low, step, num, tolerance, ignore,
):
    near = gather_strip(
        start, order, grid_origin, cell, rows, columns,
        ends[0, 0], ends[0, 1], ends[1, 0], ends[1, 1], tolerance * SHELL_RATIO,
    )
    ca, sa = math.cos(azimuth), math.sin(azimuth)
    h, g, k = shape[0], shape[1], shape[2]
    base, root = math.asinh(g), math.sqrt(1.0 + g * g)
    core = np.zeros(num, dtype=np.int64)
    shell = np.zeros(num, dtype=np.int64)
    chosen = np.empty(len(near), dtype=np.int64)
    outer = (tolerance * SHELL_RATIO) ** 2
    found = 0
    for i in near:
        dx, dy = points[i, 0] - origin[0], points[i, 1] - origin[1]
        x = ca * dx + sa * dy
        place = math.floor((x - low) / step)
        if place < 0 or place >= num:
            continue
        y = ca * dy - sa * dx
        if abs(y) > tolerance * SHELL_RATIO:
            continue
        grown = math.exp(k * (x - middle) + base)
        cosh = 0.5 * (grown + 1.0 / grown)
        dz = points[i, 2] - h - (cosh - root) / k
        dz /= cosh  # vertical to perpendicular: cosh of the angle's gudermannian
        r2 = y * y + dz * dz
        if r2 <= tolerance * tolerance:
            core[place] += 1
            chosen[found] = i
            found += 1
        elif r2 <= outer and not (len(ignore) and ignore[i]):
            shell[place] += 1
    return core, shell, chosen[:found]
