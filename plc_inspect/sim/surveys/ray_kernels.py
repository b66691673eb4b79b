# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Kernels of the ray caster: trace beams one by one through the grid of objects.

``world`` is a `plc_inspect.sim.surveys.raycast.World`; ``wire`` holds divergence, exit width, wire
reach, wire fraction and wire range of the beam.
"""

import math

from numba import njit
import numpy as np

CELL = 4.0
"""Edge of the cells that list the objects [m]."""
MISS, GROUND = -1, -2
"""Items that stand for no return, and for the ground."""
PAST_LEAF, PAST_WIRE = 0.4, 0.01
"""Distance behind a leaf or strut, and behind a wire, at which a beam continues [m]."""


@njit(cache=True, nogil=True)
def trace_beams(  # type: ignore[no-untyped-def]
    world, origins, directions, reach, wire, key, pass_share, ranges, items, first, last,
):
    """Fill in ranges and items of the beams from ``first`` to before ``last``."""
    # the last search that tried each item: an item in several cells is tried once
    tried = np.full(world.num_items, -1, dtype=np.int64)
    search = 0
    for n in range(first, last):
        t_min = 0.0
        beam_key = _mix(key + np.uint64(n) * np.uint64(0x9E3779B97F4A7C15))
        for k in range(ranges.shape[1]):
            search += 1
            t, item = _trace(
                world, origins[n], directions[n], t_min, reach[n], wire, beam_key, tried, search,
            )
            if item == MISS:
                break
            ranges[n, k], items[n, k] = t, item
            # solid objects end the beam, leaves and struts by chance, wires never
            num_struts = len(world.struts)
            num_solid = num_struts + len(world.triangles)
            if item == GROUND or num_struts <= item < num_solid:
                break
            if item < num_solid + len(world.crowns):
                if _chance(beam_key, -2 - k) > pass_share:
                    break
                t_min = t + PAST_LEAF
            else:
                t_min = t + PAST_WIRE


@njit(cache=True, inline='always')
def _mix(x):  # type: ignore[no-untyped-def]
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


@njit(cache=True)
def _chance(key, item):  # type: ignore[no-untyped-def]
    """Return a pseudo-random number in (0, 1) for a beam and an object."""
    mixed = _mix(key + np.uint64(item + 1) * np.uint64(0xD1342543DE82EF95))
    return (np.float64(mixed >> np.uint64(11)) + 0.5) / 9007199254740992.0


@njit(cache=True)
def _ground(world, x, y):  # type: ignore[no-untyped-def]
    ny, nx = world.grid.shape
    u = min(max((x - world.grid_origin[0]) / world.grid_cell, 0.0), nx - 1.000001)
    v = min(max((y - world.grid_origin[1]) / world.grid_cell, 0.0), ny - 1.000001)
    i, j = int(u), int(v)
    u, v = u - i, v - j
    g = world.grid
    low = g[j, i] * (1 - u) + g[j, i + 1] * u
    high = g[j + 1, i] * (1 - u) + g[j + 1, i + 1] * u
    return low * (1 - v) + high * v


@njit(cache=True)
def _trace(world, o, d, t_min, reach, wire, key, tried, search):  # type: ignore[no-untyped-def]
    """Walk the grid along one beam; return range and item of the first hit beyond t_min."""
    # clip the beam to the grid
    ny, nx = world.shape
    t0, t1 = 0.0, reach
    for axis in range(2):
        low = world.origin[axis]
        high = low + CELL * (nx if axis == 0 else ny)
        if abs(d[axis]) < 1e-12:
            if o[axis] < low or o[axis] >= high:
                return math.inf, MISS
        else:
            near, far = (low - o[axis]) / d[axis], (high - o[axis]) / d[axis]
            t0, t1 = max(t0, min(near, far)), min(t1, max(near, far))
    t0 = max(t0, t_min)
    if t0 >= t1:
        return math.inf, MISS
    # a beam that continues behind a leaf just above the ground has one return with the ground
    z = o[2] + t0 * d[2]
    if t_min > 0.0 and z < _ground(world, o[0] + t0 * d[0], o[1] + t0 * d[1]):
        return math.inf, MISS
    # begin in the cell at the near end, and walk from cell to cell
    x, y = o[0] + (t0 + 1e-9) * d[0], o[1] + (t0 + 1e-9) * d[1]
    i = min(max(int((x - world.origin[0]) / CELL), 0), nx - 1)
    j = min(max(int((y - world.origin[1]) / CELL), 0), ny - 1)
    si, sj = (1 if d[0] > 0 else -1), (1 if d[1] > 0 else -1)
    best, found = math.inf, MISS
    enter = t0
    while True:
        tx = math.inf
        if abs(d[0]) > 1e-12:
            tx = (world.origin[0] + CELL * (i + (si > 0)) - o[0]) / d[0]
        ty = math.inf
        if abs(d[1]) > 1e-12:
            ty = (world.origin[1] + CELL * (j + (sj > 0)) - o[1]) / d[1]
        # try the objects of the cell, then the ground, unless the beam stays above them
        leave = min(tx, ty, t1)
        cell = j * nx + i
        z = min(o[2] + enter * d[2], o[2] + leave * d[2])
        if z <= world.top[cell]:
            for index in range(world.first[cell], world.first[cell + 1]):
                item = world.items[index]
                if tried[item] == search:
                    continue
                tried[item] = search
                t = _meet(world, item, o, d, t_min, wire, key)
                if t < best:
                    best, found = t, item
        if z <= world.ground_top[cell] and enter < best:
            t = _land(world, o, d, enter, min(leave, best))
            if t_min < t < best:
                best, found = t, GROUND
        # stop at a hit in this cell, otherwise enter the next one
        if best <= leave:
            break
        if leave >= t1:
            break
        if tx <= ty:
            i += si
        else:
            j += sj
        if i < 0 or i >= nx or j < 0 or j >= ny:
            break
        enter = leave
    if best > reach:
        return math.inf, MISS
    return best, found


@njit(cache=True)
def _land(world, o, d, enter, leave):  # type: ignore[no-untyped-def]
    """March from enter to leave, and bisect where the beam enters the ground."""
    steps = max(1, int((leave - enter) / 0.7) + 1)
    low = enter
    for k in range(1, steps + 1):
        high = enter + (leave - enter) * k / steps
        if o[2] + high * d[2] < _ground(world, o[0] + high * d[0], o[1] + high * d[1]):
            for _ in range(20):
                middle = 0.5 * (low + high)
                x, y = o[0] + middle * d[0], o[1] + middle * d[1]
                if o[2] + middle * d[2] < _ground(world, x, y):
                    high = middle
                else:
                    low = middle
            return high
        low = high
    return math.inf


@njit(cache=True)
def _meet(world, item, o, d, t_min, wire, key):  # type: ignore[no-untyped-def]
    """Return the range at which a beam hits an item beyond t_min, inf if it misses."""
    if item < len(world.struts):
        row = world.struts[item]
        t, gap, _ = _approach(row, o, d)
        radius = row[6] + 0.25 * (wire[1] + wire[0] * max(t, 0.0))
        if gap < radius and t > t_min:
            return max(t - math.sqrt(row[6] * row[6] - min(gap, row[6]) ** 2), t_min + 1e-6)
        return math.inf
    number = item - len(world.struts)
    if number < len(world.triangles):
        return _meet_triangle(world.triangles[number], o, d, t_min)
    number -= len(world.triangles)
    if number < len(world.crowns):
        return _meet_crown(world, number, o, d, t_min, key)
    # a piece of a conductor: the chord first, then shifted onto the catenary
    row = world.pieces[number - len(world.crowns)]
    t, gap, share = _approach(row, o, d)
    if gap > 0.5 or t <= t_min:
        return math.inf
    curve = world.curves[int(row[7])]
    x = o[0] + t * d[0] - curve[3]
    x = x * curve[5] + (o[1] + t * d[1] - curve[4]) * curve[6]
    rise = row[2] + min(max(share, 0.0), 1.0) * (row[5] - row[2])
    shift = curve[0] + curve[2] * math.cosh((x - curve[1]) / curve[2]) - rise
    t, gap, share = _approach_shifted(row, o, d, shift)
    footprint = wire[1] + wire[0] * t
    if share < -1e-6 or share > 1.000001:
        return math.inf
    if gap > (wire[2] if wire[2] > 0.0 else 0.5 * footprint + row[6]):
        return math.inf
    # thin and distant wires return less often
    if wire[2] == 0.0:
        seen = min(1.0, 2 * row[6] / max(wire[3] * footprint, 1e-9))
        seen *= math.exp(-((t / wire[4]) ** 2))
        if _chance(key, len(world.blobs) + int(row[7])) > seen:
            return math.inf
    return t


@njit(cache=True)
def _approach(row, o, d):  # type: ignore[no-untyped-def]
    return _approach_shifted(row, o, d, 0.0)


@njit(cache=True)
def _approach_shifted(row, o, d, shift):  # type: ignore[no-untyped-def]
    """Return range and gap where beam and segment are closest, and the share along its axis."""
    ex, ey, ez = row[3] - row[0], row[4] - row[1], row[5] - row[2]
    wx, wy, wz = row[0] - o[0], row[1] - o[1], row[2] + shift - o[2]
    ee = ex * ex + ey * ey + ez * ez
    de = d[0] * ex + d[1] * ey + d[2] * ez
    dw = d[0] * wx + d[1] * wy + d[2] * wz
    ew = ex * wx + ey * wy + ez * wz
    bottom = ee - de * de
    axis_share = 0.0 if bottom < 1e-12 else (de * dw - ew) / bottom
    share = min(max(axis_share, 0.0), 1.0)
    t = dw + share * de
    gx, gy, gz = wx + share * ex - t * d[0], wy + share * ey - t * d[1], wz + share * ez - t * d[2]
    return t, math.sqrt(gx * gx + gy * gy + gz * gz), axis_share


@njit(cache=True)
def _meet_crown(world, number, o, d, t_min, key):  # type: ignore[no-untyped-def]
    """Return the range of the nearest leaf of a crown beyond t_min, inf if there is none."""
    # the upright cylinder about the crown
    crown = world.crowns[number]
    best = math.inf
    bx, by = crown[0] - o[0], crown[1] - o[1]
    flat = max(d[0] * d[0] + d[1] * d[1], 1e-12)
    middle = (bx * d[0] + by * d[1]) / flat
    inside = crown[2] * crown[2] - (bx * bx + by * by - middle * middle * flat)
    if inside <= 0.0:
        return best
    half = math.sqrt(inside / flat)
    near, far = max(middle - half, t_min), middle + half
    if far <= near:
        return best
    low, high = o[2] + near * d[2], o[2] + far * d[2]
    if max(low, high) < crown[3] or min(low, high) > crown[4]:
        return best
    # free paths through its blobs are exponential
    for blob in range(int(crown[5]), int(crown[6])):
        row = world.blobs[blob]
        bx, by, bz = row[0] - o[0], row[1] - o[1], row[2] - o[2]
        middle = bx * d[0] + by * d[1] + bz * d[2]
        inside = row[3] * row[3] - (bx * bx + by * by + bz * bz - middle * middle)
        if inside <= 0.0:
            continue
        half = math.sqrt(inside)
        if middle + half <= t_min or middle - half >= best:
            continue
        t = max(middle - half, 0.0) - math.log(_chance(key, blob)) / row[4]
        if t_min < t < middle + half and t < best:
            best = t
    return best


@njit(cache=True)
def _meet_triangle(row, o, d, t_min):  # type: ignore[no-untyped-def]
    ax, ay, az = row[3] - row[0], row[4] - row[1], row[5] - row[2]
    bx, by, bz = row[6] - row[0], row[7] - row[1], row[8] - row[2]
    px, py, pz = d[1] * bz - d[2] * by, d[2] * bx - d[0] * bz, d[0] * by - d[1] * bx
    det = ax * px + ay * py + az * pz
    if abs(det) < 1e-12:
        return math.inf
    sx, sy, sz = o[0] - row[0], o[1] - row[1], o[2] - row[2]
    u = (sx * px + sy * py + sz * pz) / det
    if u < 0.0 or u > 1.0:
        return math.inf
    qx, qy, qz = sy * az - sz * ay, sz * ax - sx * az, sx * ay - sy * ax
    v = (d[0] * qx + d[1] * qy + d[2] * qz) / det
    if v < 0.0 or u + v > 1.0:
        return math.inf
    t = (bx * qx + by * qy + bz * qz) / det
    return t if t > t_min else math.inf
