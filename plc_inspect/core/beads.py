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

"""Beads: the first stage of clustering, across the line, window by window."""

from dataclasses import dataclass
import math

from numba import njit, prange
import numpy as np

from plc_inspect.config import ClusteringSettings
from plc_inspect.core.alignment import AlignmentResult
from plc_inspect.core.dbscan import dbscan_plane
from plc_inspect.core.plan_index import gather_strip, PlanIndex
from plc_inspect.results import Float64, Int32, Int64

MAX_WINDOW_POINTS = 1200
"""More points in a window than this are thinned; a wire needs far fewer."""
SHELL_RATIO = 1.6
"""Outer radius of the shell about a conductor, in radii of the conductor."""
SHELL_SHARE = 0.3
"""A place is crowded where the shell holds more than this share of the points within it."""
NUM_EPS = 3
"""Halvings of eps that are tried on a cluster too thick for one conductor."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Beads:
    """B short straight pieces of conductor, each one cluster across the line in a window."""

    window: Int32
    """(B,) window that each was found in."""
    center: Float64
    """(B, 3) [m]"""
    direction: Float64
    """(B, 3) unit vector, azimuth in (-pi/2, pi/2]."""
    half_length: Float64
    """(B,) [m]"""
    rms: Float64
    """(B,) root mean square distance of the points to the axis [m]."""
    point_start: Int64
    """(B + 1,) first entry of each bead in ``points``."""
    points: Int32
    """Point indices, bead by bead."""

    def __len__(self) -> int:
        """Return the number of beads."""
        return len(self.center)


def find_beads(
    points: Float64,
    index: PlanIndex,
    seeds: Float64,
    alignment: AlignmentResult,
    settings: ClusteringSettings,
) -> tuple[Beads, int]:
    num_windows = len(alignment.azimuth)
    rows, members, starts, numbers = [], [], [], []
    num_clusters = 0
    if num_windows:
        found = _cluster_windows(
            points,
            index.start,
            index.order,
            index.origin,
            index.cell_size,
            index.shape[0],
            index.shape[1],
            seeds,
            alignment.seed_start,
            alignment.seeds,
            alignment.center,
            alignment.azimuth,
            alignment.slope,
            alignment.half_length,
            settings.eps,
            settings.min_points,
            settings.max_thickness,
            settings.max_crowding,
        )
        for window, (beads, owner, chosen, num) in enumerate(found):
            num_clusters += num
            if len(beads):
                rows.append(beads)
                numbers.append(np.full(len(beads), window, dtype=np.int32))
                order = np.argsort(owner, kind='stable')
                members.append(chosen[order])
                starts.append(np.bincount(owner, minlength=len(beads)))
    table = np.concatenate(rows) if rows else np.zeros((0, 8))
    counts = np.concatenate(starts) if starts else np.zeros(0, dtype=np.int64)
    beads = Beads(
        window=np.concatenate(numbers) if numbers else np.zeros(0, dtype=np.int32),
        center=table[:, 0:3],
        direction=table[:, 3:6],
        half_length=table[:, 6],
        rms=table[:, 7],
        point_start=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        points=np.concatenate(members) if members else np.zeros(0, dtype=np.int32),
    )
    return beads, num_clusters


@njit(cache=True, nogil=True)
def _fit_bead(x, y, w, member):  # type: ignore[no-untyped-def]
    """Straight line through the chosen points: means, slopes in y and w, rms, extent."""
    n = 0.0
    sx = sy = sw = sxx = sxy = sxw = 0.0
    low, high = np.inf, -np.inf
    for k in range(len(x)):
        if member[k]:
            n += 1.0
            sx += x[k]
            sy += y[k]
            sw += w[k]
            sxx += x[k] * x[k]
            sxy += x[k] * y[k]
            sxw += x[k] * w[k]
            low, high = min(low, x[k]), max(high, x[k])
    mx, my, mw = sx / n, sy / n, sw / n
    spread = sxx - n * mx * mx
    ky = (sxy - n * mx * my) / spread if spread > 1e-9 else 0.0
    kw = (sxw - n * mx * mw) / spread if spread > 1e-9 else 0.0
    error = 0.0
    for k in range(len(x)):
        if member[k]:
            ey = y[k] - my - ky * (x[k] - mx)
            ew = w[k] - mw - kw * (x[k] - mx)
            error += ey * ey + ew * ew
    return mx, my, mw, ky, kw, math.sqrt(error / n), low, high


@njit(cache=True, nogil=True)
def fit_trimmed(x, y, w, member):  # type: ignore[no-untyped-def]
    """Fit, drop from ``member`` what lies far off, and fit again."""
    fit = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for attempt in range(2):
        if member.sum() < 4:
            return fit
        fit = _fit_bead(x, y, w, member)
        if attempt == 0:
            mx, my, mw, ky, kw, rms, _, _ = fit
            limit = max(2.5 * rms, 0.05)
            for k in range(len(x)):
                if member[k]:
                    ey = y[k] - my - ky * (x[k] - mx)
                    ew = w[k] - mw - kw * (x[k] - mx)
                    if ey * ey + ew * ew > limit * limit:
                        member[k] = False
    return fit


@njit(cache=True, nogil=True)
def measure_filling(x, member, low, high):  # type: ignore[no-untyped-def]
    """Share of the metres between low and high that hold members."""
    num = max(int(high - low), 1)
    filled = np.zeros(num, dtype=np.bool_)
    for k in range(len(x)):
        if member[k]:
            filled[min(int((x[k] - low) / max(high - low, 1e-9) * num), num - 1)] = True
    return filled.sum() / num


@njit(cache=True, nogil=True)
def measure_crowding(x, y, w, member, mx, my, mw, ky, kw, rms):  # type: ignore[no-untyped-def]
    """
    Share of the bead's parts that have points close about the axis, not only on it.

    Air surrounds a wire.  A plane that goes on beside the axis, such as a roof, has 0.6 times
    as many points between 1 and 1.6 radii as within one radius; a crown has 1.6 times as many.
    """
    inner = max(2.5 * rms, 0.1)
    outer = SHELL_RATIO * inner
    low = np.inf
    high = -np.inf
    for k in range(len(x)):
        if member[k]:
            low, high = min(low, x[k]), max(high, x[k])
    num = max(int((high - low) / 3.0), 1)
    core = np.zeros(num)
    shell = np.zeros(num)
    for k in range(len(x)):
        if x[k] < low or x[k] > high:
            continue
        ey = y[k] - my - ky * (x[k] - mx)
        ew = w[k] - mw - kw * (x[k] - mx)
        r2 = ey * ey + ew * ew
        place = min(int((x[k] - low) / (high - low) * num), num - 1)
        if r2 <= inner * inner:
            core[place] += 1.0
        elif r2 <= outer * outer:
            shell[place] += 1.0
    crowded = 0
    for place in range(num):
        if shell[place] > SHELL_SHARE * core[place] + 1.0:
            crowded += 1
    return crowded / num


@njit(cache=True, nogil=True)
def _cluster_window(  # type: ignore[no-untyped-def]
    x, y, w, eps, min_points, half, max_thickness, max_crowding
):
    """Beads among the points of one window: rows of fits and the owner of each point."""
    n = len(x)
    owner = np.full(n, -1, dtype=np.int64)
    fits = np.empty((n // 4 + 1, 8))
    found = 0
    num_clusters = 0
    open_mask = np.ones(n, dtype=np.bool_)
    first_label = np.full(n, -1, dtype=np.int64)
    for attempt in range(NUM_EPS + 1):
        if attempt < NUM_EPS:
            chosen = np.flatnonzero(open_mask)
            if len(chosen) < 4:
                break
            label = dbscan_plane(y[chosen], w[chosen], eps / 2**attempt, min_points)
            limit = max_thickness
        else:  # what no eps divides: a bundle, as one
            chosen = np.flatnonzero((owner < 0) & (first_label >= 0))
            label = first_label[chosen].copy()
            divided = np.zeros(num_clusters + 1, dtype=np.bool_)
            for k in range(n):
                if owner[k] >= 0 and first_label[k] >= 0:
                    divided[first_label[k]] = True
            for k in range(len(label)):
                if divided[label[k]]:
                    label[k] = -1
            limit = 2.0 * max_thickness
        if len(label) == 0:
            break
        num = label.max() + 1
        if attempt == 0:
            num_clusters = num
            first_label[:] = label
        open_mask[:] = False
        for c in range(num):
            member = np.zeros(n, dtype=np.bool_)
            for k in range(len(chosen)):
                if label[k] == c:
                    member[chosen[k]] = True
            fit = fit_trimmed(x, y, w, member)
            mx, my, mw, ky, kw, rms, low, high = fit
            length = high - low
            if member.sum() < 4 or length < 0.5 * half:
                continue
            if measure_filling(x, member, low, high) < 0.4:
                continue
            if rms > limit:
                open_mask |= member
                continue
            if measure_crowding(x, y, w, member, mx, my, mw, ky, kw, rms) > max_crowding:
                continue
            if found == len(fits):
                continue
            fits[found, 0], fits[found, 1], fits[found, 2] = mx, my, mw
            fits[found, 3], fits[found, 4] = ky, kw
            fits[found, 5], fits[found, 6], fits[found, 7] = rms, low, high
            owner[member] = found
            found += 1
    return fits[:found], owner, num_clusters


@njit(cache=True, parallel=True, nogil=True)
def _cluster_windows(  # type: ignore[no-untyped-def]
    points, start, order, origin, cell, rows, columns,
    seeds, seed_start, seed_list, center, azimuth, slope, half, eps, min_points, max_thickness,
    max_crowding,
):
    num = len(azimuth)
    results = [
        (
            np.empty((0, 8)),
            np.empty(0, dtype=np.int64),
            np.empty(0, dtype=np.int32),
            0,
        )
        for _ in range(num)
    ]
    for window in prange(num):
        cx, cy, cz = center[window, 0], center[window, 1], center[window, 2]
        ca, sa, rise = math.cos(azimuth[window]), math.sin(azimuth[window]), slope[window]
        # the cross-section that the seeds occupy, dilated by a metre
        low_y, high_y, low_w, high_w = np.inf, -np.inf, np.inf, -np.inf
        for s in range(seed_start[window], seed_start[window + 1]):
            dx, dy = seeds[seed_list[s], 0] - cx, seeds[seed_list[s], 1] - cy
            y = -sa * dx + ca * dy
            w = seeds[seed_list[s], 2] - cz - rise * (ca * dx + sa * dy)
            low_y, high_y = min(low_y, y), max(high_y, y)
            low_w, high_w = min(low_w, w), max(high_w, w)
        grid = 0.5
        ny = int((high_y - low_y) / grid) + 7
        nw = int((high_w - low_w) / grid) + 7
        allowed = np.zeros((ny, nw), dtype=np.bool_)
        for s in range(seed_start[window], seed_start[window + 1]):
            dx, dy = seeds[seed_list[s], 0] - cx, seeds[seed_list[s], 1] - cy
            y = -sa * dx + ca * dy
            w = seeds[seed_list[s], 2] - cz - rise * (ca * dx + sa * dy)
            iy, iw = int((y - low_y) / grid) + 3, int((w - low_w) / grid) + 3
            allowed[iy - 2 : iy + 3, iw - 2 : iw + 3] = True
        reach = max(abs(low_y), abs(high_y)) + 1.5
        near = gather_strip(
            start, order, origin, cell, rows, columns,
            cx - half * ca, cy - half * sa, cx + half * ca, cy + half * sa, reach,
        )
        chosen = np.empty(len(near), dtype=np.int32)
        x = np.empty(len(near))
        y = np.empty(len(near))
        w = np.empty(len(near))
        n = 0
        for i in near:
            dx, dy = points[i, 0] - cx, points[i, 1] - cy
            px = ca * dx + sa * dy
            if abs(px) > half:
                continue
            py = -sa * dx + ca * dy
            pw = points[i, 2] - cz - rise * px
            iy, iw = int((py - low_y) / grid + 3), int((pw - low_w) / grid + 3)
            if 0 <= iy < ny and 0 <= iw < nw and allowed[iy, iw]:
                chosen[n], x[n], y[n], w[n] = i, px, py, pw
                n += 1
        if n > MAX_WINDOW_POINTS:
            step = (n + MAX_WINDOW_POINTS - 1) // MAX_WINDOW_POINTS
            kept = np.arange(0, n, step)
            n = len(kept)
            chosen[:n], x[:n], y[:n], w[:n] = chosen[kept], x[kept], y[kept], w[kept]
        if n < 4:
            continue
        needed = count_needed(y[:n], w[:n], eps, min_points)
        fits, owner, num_clusters = _cluster_window(
            x[:n], y[:n], w[:n], eps, needed, half, max_thickness, max_crowding
        )
        beads = np.empty((len(fits), 8))
        for b in range(len(fits)):
            mx, my, mw, ky, kw = fits[b, 0], fits[b, 1], fits[b, 2], fits[b, 3], fits[b, 4]
            beads[b, 0] = cx + ca * mx - sa * my
            beads[b, 1] = cy + sa * mx + ca * my
            beads[b, 2] = cz + rise * mx + mw
            ux, uy, uz = ca - sa * ky, sa + ca * ky, rise + kw
            norm = math.sqrt(ux * ux + uy * uy + uz * uz)
            beads[b, 3], beads[b, 4], beads[b, 5] = ux / norm, uy / norm, uz / norm
            beads[b, 6] = (fits[b, 7] - fits[b, 6]) / 2.0
            beads[b, 7] = fits[b, 5]
        mine = owner >= 0
        results[window] = (beads, owner[mine], chosen[:n][mine], num_clusters)
    return results


@njit(cache=True, nogil=True)
def count_needed(y, w, eps, min_points):  # type: ignore[no-untyped-def]
    """Core threshold at the sampling of this window: a fifth of its fullest place."""
    counts = np.zeros((256, 256), dtype=np.int64)
    fullest = 0
    for k in range(len(y)):
        i, j = math.floor(y[k] / eps) & 255, math.floor(w[k] / eps) & 255
        counts[i, j] += 1
        fullest = max(fullest, counts[i, j])
    return min(max(fullest // 5, 4), min_points)
