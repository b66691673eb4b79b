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

"""Two-stage clustering: across the line in each window, then along the line."""

from dataclasses import dataclass
import math

from numba import njit, prange
import numpy as np
from scipy.spatial import cKDTree

from plc_inspect.config import ClusteringSettings
from plc_inspect.core.alignment import AlignmentResult
from plc_inspect.core.plan_index import gather_strip, PlanIndex
from plc_inspect.results import Float64, Int32, Int64

MAX_WINDOW_POINTS = 2500
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClusteringResult:
    """Beads, and the tracks that they join to."""

    beads: Beads
    track: Int32
    """(B,) track of each bead, -1 none; numbered by first bead."""
    num_tracks: int
    num_clusters: int
    """Clusters of the first stage, before the tests of a bead."""
    eps: float
    min_points: int


def cluster(
    points: Float64,
    index: PlanIndex,
    seeds: Float64,
    alignment: AlignmentResult,
    settings: ClusteringSettings,
) -> ClusteringResult:
    """
    Separate conductors across the line, window by window, and join them along it.

    First stage: in the regularised frame of a window (x along, y across, z up) the rise along
    the line is taken out, so every conductor is a dot in the orthogonal plane, and DBSCAN with
    ``eps`` and ``min_points`` finds the dots.  ``min_points`` holds where a window is well
    sampled and is lowered with the sampling.  A cluster too thick for one conductor is divided
    with a smaller eps.  Second stage: beads of different windows are joined where each, extended
    to half way, meets the other; the sag cancels there because both deviate by the same amount.

    Parameters
    ----------
    points : (N, 3) float64 [m]
    index : PlanIndex of the high points
    seeds : (M, 3) float64, positions of the candidates [m]
    alignment : AlignmentResult
    settings : ClusteringSettings

    Returns
    -------
    ClusteringResult

    """
    beads, num_clusters = _find_beads(points, index, seeds, alignment, settings)
    track = _join(beads, settings)
    return ClusteringResult(
        beads=beads,
        track=track,
        num_tracks=int(track.max(initial=-1)) + 1,
        num_clusters=num_clusters,
        eps=settings.eps,
        min_points=settings.min_points,
    )


def _find_beads(
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


def _join(beads: Beads, settings: ClusteringSettings) -> Int32:
    """Second stage: tracks of beads that continue one another."""
    num = len(beads)
    if num == 0:
        return np.zeros(0, dtype=np.int32)
    pairs = cKDTree(beads.center).query_pairs(settings.max_gap, output_type='ndarray')
    i, j = pairs[:, 0], pairs[:, 1]
    apart = beads.center[j] - beads.center[i]
    ui, uj = beads.direction[i], beads.direction[j].copy()
    flip = np.einsum('ij,ij->i', ui, uj) < 0
    uj[flip] *= -1
    along_i = np.einsum('ij,ij->i', apart, ui)
    along_j = np.einsum('ij,ij->i', apart, uj)
    # both axes at the plane half way between the centres
    meet_i = ui * (along_i / 2)[:, None]
    meet_j = apart - uj * (along_j / 2)[:, None]
    offset = meet_j - meet_i
    mean = ui + uj
    mean /= np.linalg.norm(mean, axis=1, keepdims=True)
    offset -= mean * np.einsum('ij,ij->i', offset, mean)[:, None]
    miss = np.linalg.norm(offset, axis=1)
    length = np.abs(along_i)
    tolerance = settings.join_tolerance + 0.004 * length
    turn = np.abs(ui[:, 0] * uj[:, 1] - ui[:, 1] * uj[:, 0])
    bend = np.abs(ui[:, 2] - uj[:, 2])
    good = (miss <= tolerance) & (turn <= 0.04) & (bend <= 0.04 + length / 200.0)
    good &= np.linalg.norm(apart, axis=1) <= np.maximum(length * 1.05, length + 0.3)
    good &= beads.window[i] != beads.window[j]
    i, j, miss = i[good], j[good], miss[good]
    # mutual best between any two windows
    best = _mutual_best(i, j, miss, beads.window)
    i, j = i[best], j[best]
    order = np.lexsort((j, i, np.round(miss[best] + 0.02 * length[good][best], 6)))
    label = _link(i[order], j[order], beads.window)
    _, first, track = np.unique(label, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[track].astype(np.int32)


def _mutual_best(i: Int64, j: Int64, miss: Float64, window: Int32) -> np.ndarray:
    """Pairs in which each bead is the other's nearest among those of its window."""
    keep = np.ones(len(i), dtype=bool)
    for own, other in ((i, j), (j, i)):
        order = np.lexsort((miss, window[other], own))
        first = np.ones(len(order), dtype=bool)
        a, b = own[order], window[other][order]
        first[1:] = (a[1:] != a[:-1]) | (b[1:] != b[:-1])
        is_first = np.zeros(len(order), dtype=bool)
        is_first[order] = first
        keep &= is_first
    return keep


@njit(cache=True, nogil=True)
def _link(first, second, window):  # type: ignore[no-untyped-def]
    """
    Join beads along the links, best first, but never two of one window.

    Two beads of one window are two conductors, however well a third seems to continue both.
    """
    num = len(window)
    parent = np.arange(num)
    following = np.full(num, -1, dtype=np.int64)
    last = np.arange(num)
    seen = np.full(window.max() + 1, -1, dtype=np.int64)
    for link in range(len(first)):
        a, b = first[link], second[link]
        while parent[a] != a:
            parent[a] = parent[parent[a]]
            a = parent[a]
        while parent[b] != b:
            parent[b] = parent[parent[b]]
            b = parent[b]
        if a == b:
            continue
        item = a
        while item >= 0:
            seen[window[item]] = link
            item = following[item]
        item = b
        clash = False
        while item >= 0 and not clash:
            clash = seen[window[item]] == link
            item = following[item]
        if clash:
            continue
        parent[b] = a
        following[last[a]] = b
        last[a] = last[b]
    for item in range(num):
        root = item
        while parent[root] != root:
            root = parent[root]
        parent[item] = root
    return parent


@njit(cache=True, nogil=True)
def dbscan_plane(u, v, eps, min_points):  # type: ignore[no-untyped-def]
    """
    DBSCAN (Ester et al. 1996) of n points in the plane; -1 is noise.

    Labels are those of scikit-learn's DBSCAN: clusters numbered by their first core point, a
    border point goes to the cluster that reaches it first.  O(n log n + pairs within eps in u).

    Parameters
    ----------
    u, v : (n,) float64
    eps : neighbours lie within this distance, inclusive
    min_points : neighbours of a core point, itself included

    Returns
    -------
    (n,) int64

    """
    n = len(u)
    label = np.full(n, -1, dtype=np.int64)
    order = np.argsort(u)
    rank = np.empty(n, dtype=np.int64)
    for k in range(n):
        rank[order[k]] = k
    limit = eps * eps
    core = np.zeros(n, dtype=np.bool_)
    for k in range(n):
        a = order[k]
        count = 1
        m = k + 1
        while m < n and u[order[m]] - u[a] <= eps and count < min_points:
            dv = v[order[m]] - v[a]
            du = u[order[m]] - u[a]
            if du * du + dv * dv <= limit:
                count += 1
            m += 1
        m = k - 1
        while m >= 0 and u[a] - u[order[m]] <= eps and count < min_points:
            dv = v[order[m]] - v[a]
            du = u[order[m]] - u[a]
            if du * du + dv * dv <= limit:
                count += 1
            m -= 1
        core[a] = count >= min_points
    stack = np.empty(n, dtype=np.int64)
    cluster_number = 0
    for first in range(n):
        if label[first] >= 0 or not core[first]:
            continue
        label[first] = cluster_number
        stack[0] = first
        top = 1
        while top > 0:
            top -= 1
            a = stack[top]
            if not core[a]:
                continue
            k = rank[a]
            for step in (1, -1):
                m = k + step
                while 0 <= m < n and abs(u[order[m]] - u[a]) <= eps:
                    b = order[m]
                    if label[b] < 0:
                        du, dv = u[b] - u[a], v[b] - v[a]
                        if du * du + dv * dv <= limit:
                            label[b] = cluster_number
                            stack[top] = b
                            top += 1
                    m += step
        cluster_number += 1
    return label


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
def _trimmed_fit(x, y, w, member):  # type: ignore[no-untyped-def]
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
def _filled_share(x, member, low, high):  # type: ignore[no-untyped-def]
    """Share of the metres between low and high that hold members."""
    num = max(int(high - low), 1)
    filled = np.zeros(num, dtype=np.bool_)
    for k in range(len(x)):
        if member[k]:
            filled[min(int((x[k] - low) / max(high - low, 1e-9) * num), num - 1)] = True
    return filled.sum() / num


@njit(cache=True, nogil=True)
def _crowding(x, y, w, member, mx, my, mw, ky, kw, rms):  # type: ignore[no-untyped-def]
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
            for k in range(n):
                if owner[k] >= 0 and first_label[k] >= 0:
                    label[label == first_label[k]] = -1
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
            fit = _trimmed_fit(x, y, w, member)
            mx, my, mw, ky, kw, rms, low, high = fit
            length = high - low
            if member.sum() < 4 or length < 0.5 * half:
                continue
            if _filled_share(x, member, low, high) < 0.4:
                continue
            if rms > limit:
                open_mask |= member
                continue
            if _crowding(x, y, w, member, mx, my, mw, ky, kw, rms) > max_crowding:
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
        needed = _needed_points(y[:n], w[:n], eps, min_points)
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
def _needed_points(y, w, eps, min_points):  # type: ignore[no-untyped-def]
    """Core threshold at the sampling of this window: a fifth of its fullest place."""
    counts = np.zeros((256, 256), dtype=np.int64)
    fullest = 0
    for k in range(len(y)):
        i, j = int(math.floor(y[k] / eps)) & 255, int(math.floor(w[k] / eps)) & 255
        counts[i, j] += 1
        fullest = max(fullest, counts[i, j])
    return min(max(fullest // 5, 4), min_points)
