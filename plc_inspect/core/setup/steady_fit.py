# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
What makes planes lie together: clock and mount of the lidar, scale of positions, heading.

Planes that are seen within two seconds lie apart as far as points are put wrongly.  By a wrong
clock they are where the vehicle was, and as it was turned, at another time; by a wrong scale as
far along the way as it flew meanwhile; by a heading that turns about the lidar; by a wrong mount
turned about the lidar with the vehicle.  All are fitted together, so that none is taken for
another.  Least squares with weights of Student's t by cell, so that what is no plane does not
count (Lange, Little and Taylor 1989, Robust statistical modeling using the t distribution).
Standard deviations are what the flight itself shows: how the values change without one of its
planes, blocks of time or windows (jackknife by clusters: MacKinnon, Nielsen and Webb 2023,
Cluster-robust inference), as the errors of an attitude last from scan to scan, and what is no
plane is none in all its looks.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
import math

import numpy as np

from plc_inspect.core.alignment.steady_errors import Steady
from plc_inspect.core.numerics.cell_sums import pack_cells, sum_rows
from plc_inspect.core.setup.look_cells import gather_cells, Look, LookCells
from plc_inspect.core.setup.looks import LINE, PLANE, ROUGH, ROUGH_SHARE
from plc_inspect.results import Float64, Int64

WINDOW_NS = 2_000_000_000
"""
Time within which looks are compared [ns].
Source: measured: bench/studies/input_faults.py: with 1 s standard deviations are twice as great.
"""
BLOCK_NS = 500_000_000
"""Errors of the attitude last shorter [ns].  Source: judgement: vehicles sway at 1 Hz."""
REMEMBERED = 10
"""Windows that are remembered.  Source: judgement: 20 s."""
LEAST_LOOKS = 3
"""Of looks in a cell.  Source: as sharpness."""
MOST_APART = 0.6
"""
Looks that lie farther apart in a cell are of two things [m].
Source: judgement: a sixth of a cell.
"""
ATTITUDE = 0.001
"""
Error of an attitude, by which looks lie apart with range [rad].
Source: derived: 0.05 degrees.
"""
LEAST_NOISE = 0.01
"""Error of a position [m].  Source: as jitter of the simulated odometry, twice."""
FREEDOM = 4.0
"""Degrees of freedom of Student's t.  Source: Lange, Little and Taylor 1989."""
ROUNDS = 6
"""Rounds of weights.  Source: numerical: values move by less than a tenth of their deviations."""
LEAST_GROUPS = 8
"""
Planes, blocks or windows that tell standard deviations.
Source: derived: two windows have eight blocks.
"""
CHANCE = 5e-6
"""
Probability of a value as great by chance.
Source: derived: 1 in 20 in an hour, with 1800 windows of six values.
"""
MOST_REST = 6.0
"""
Squares of what is left over their variances, in the median of the planes, up to which the values
are believed.
Source: measured: bench/studies/input_faults.py, sharpness.py: 0.1 to 1 where planes are ground and
houses, 3 to 8 where strands and crowns are among them: values are right to 1 degree there, and
none was sure in 20 right flights, whatever is left; 10 to 60 where crowns and arcs of the scan are
most of them.
"""
EXPLAINED = 2.0
"""
By so much less is left than with none of the values, else: great offsets of a clock are found in
steps, the first of which leaves much.  Nothing but the clock is told then.
Source: measured: bench/studies/input_faults.py: 2.2 and more for 0.2 and 0.3 s, 1.7 and less where
planes do not tell.
"""
RIDGE = 1e-9
"""
Added to what the other groups tell of each value, of 1 by all, as they may tell nothing.
Source: numerical: above rounding.
"""
NUM = 6
"""Values.  Source: derived: clock, scale, heading, three turns of the mount."""


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Looks at planes within a window: how far they lie off, and would for each value."""

    off: Float64
    """(M,) across the plane, less what is the same in all looks [m]."""
    moves: Float64
    """(M, 6) the same by a second, all of the way, a radian a second, and a radian thrice."""
    sure: Float64
    """(M,) one over the variance [1/m2]."""
    cell: Int64
    """(M,) which plane each is of, from 0 on."""
    block: Int64
    """(M,) which part of the window, from 0 on."""
    speed: float = 0.0
    """Of the lidar [m/s]."""


class SteadyFit:
    """Gathers points of scans, and fits the values; owned by one thread."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Expect nothing of the next scan."""
        self._window = -1
        self._looks: list[LookCells] = []
        self._complete: list[LookCells] = []
        self._rows: deque[Rows] = deque(maxlen=REMEMBERED)
        self._values = np.zeros(NUM)
        self.steady: Steady | None = None
        """What is known; None: too little, or planes do not tell."""

    def see(self, look: Look, stamp_ns: int) -> bool:
        """
        Take some points of a scan; tell whether a window is complete, for ``judge``.

        Parameters
        ----------
        look : Look
            At least one point, those of ``choose_points``.
        stamp_ns : int
            Of the scan [ns].

        """
        window, seen = stamp_ns // WINDOW_NS, gather_cells(look)
        if window == self._window:
            self._looks.append(seen)
            return False
        self._complete, self._looks, self._window = self._looks, [seen], window
        return True

    def judge(self) -> Iterator[None]:
        """Fit the values to the window that is complete, in pieces."""
        if len(self._complete) >= LEAST_LOOKS:
            self._rows.append(compare_looks(self._complete))
            yield
            self.steady = fit_rows(self._rows, self._values)
            self._values = np.zeros(NUM) if self.steady is None else self.steady.values


def compare_looks(looks: list[LookCells]) -> Rows:
    """
    Compare the looks at planes within a window.

    Parameters
    ----------
    looks : list of LookCells
        One a scan.

    Returns
    -------
    Rows
        Costs O(K log K), 3 ms for 2,000 cells.

    """
    begin, lidar = min(item.first_ns for item in looks), looks[0].lidar[0]
    index = np.concatenate([item.index for item in looks])
    if not len(index):
        return Rows(
            np.zeros(0), np.zeros((0, NUM)), np.zeros(0), np.zeros(0, np.int64),
            np.zeros(0, np.int64),
        )
    count = np.concatenate([item.count for item in looks])
    mean = np.concatenate([item.mean for item in looks])
    scatter = np.concatenate([item.scatter for item in looks])
    num_cells = [len(item.count) for item in looks]
    mean[:, 6:9] += np.repeat([item.lidar[0] - lidar for item in looks], num_cells, axis=0)
    mean[:, -2] += np.repeat([(item.first_ns - begin) * 1e-9 for item in looks], num_cells)
    seconds = (looks[-1].stamps[1] - looks[0].stamps[0]) * 1e-9
    # planes, as the looks of a cell show them
    _, home, num = np.unique(pack_cells(index), return_inverse=True, return_counts=True)
    home = home.reshape(-1)
    total: Float64 = np.bincount(home, count, minlength=len(num)).astype(np.float64)
    within = sum_rows(home, scatter, len(num)) / np.maximum(total - num, 1.0)[:, None]
    values, normals = np.linalg.eigh(within.reshape(-1, 3, 3))
    plane = (values[:, 0] < PLANE * values[:, 1]) | (
        (values[:, 0] < ROUGH) & (values[:, 0] < ROUGH_SHARE * values[:, 1])
    )
    plane &= (values[:, 1] >= LINE * values[:, 2]) & (num >= LEAST_LOOKS)
    # across the plane, less what is the same in all looks
    normal = normals[home, :, 0]
    across = np.column_stack([
        *(np.einsum('ni,ni->n', mean[:, start : start + 3], normal) for start in (0, 3, 6)),
        _turn(mean, home, count, normal),
    ])
    sure = 1.0 / (
        np.maximum(values[home, 0], 0.0) / count + LEAST_NOISE**2 + (ATTITUDE * mean[:, -1]) ** 2
    )
    weight = np.bincount(home, sure, minlength=len(num))
    across -= (sum_rows(home, across * sure[:, None], len(num)) / weight[:, None])[home]
    wide = np.bincount(home, across[:, 0] ** 2, minlength=len(num)) / np.maximum(num, 1)
    kept = (plane & (wide < MOST_APART**2))[home]
    _, own = np.unique(home[kept], return_inverse=True)
    return Rows(
        across[kept, 0], across[kept, 1:], sure[kept], own.reshape(-1),
        (mean[kept, -2] // (BLOCK_NS * 1e-9)).astype(np.int64),
        math.dist(looks[-1].lidar[1], lidar) / max(abs(seconds), 1e-3),
    )


def _turn(mean: Float64, home: Int64, count: Int64, normal: Float64) -> Float64:
    """
    Return how far looks move across their planes by turns of heading and mount (N, 4) [m/rad].

    A turn that is the same in all looks turns the plane as well, so that it matters where the
    lidar was, and not which part of the plane a look has.
    """
    total = np.bincount(home, count)
    lever, offset = mean[:, 9:12], mean[:, :3]
    centre = sum_rows(home, offset * count[:, None], len(total)) / total[:, None]
    turns = np.zeros((len(mean), 4, 3))
    turns[:, 0, 2] = mean[:, -2]
    turns[:, 1:] = mean[:, 12:21].reshape(-1, 3, 3)
    same = sum_rows(home, turns.reshape(-1, 12) * count[:, None], len(total)) / total[:, None]
    same = same.reshape(-1, 4, 3)[home]
    moved = np.cross(same, (lever - offset + centre[home])[:, None])
    moved += np.cross(turns - same, lever[:, None])
    result: Float64 = np.einsum('nki,ni->nk', moved, normal)
    return result


def fit_rows(windows: deque[Rows], start: Float64) -> Steady | None:
    """
    Fit the values to what windows tell.

    Parameters
    ----------
    windows : deque of Rows
        At least one.
    start : (3,) float64
        Values to begin with.

    Returns
    -------
    Steady or None
        None where there is too little to tell standard deviations, or planes do not lie together
        with any values.

    """
    off = np.concatenate([item.off for item in windows])
    moves = np.concatenate([item.moves for item in windows])
    sure = np.concatenate([item.sure for item in windows])
    cell, block = _number([item.cell for item in windows]), _number(
        [item.block for item in windows]
    )
    num_looks = np.bincount(cell)
    if len(off) <= NUM or min(len(num_looks), len(np.unique(block))) < LEAST_GROUPS:
        return None
    values = start
    for _ in range(ROUNDS):
        rest = off + moves @ values
        square = np.bincount(cell, sure * rest**2)
        weight = sure * ((FREEDOM + num_looks - 1.0) / (FREEDOM + square))[cell]
        matrix = moves.T @ (moves * weight[:, None])
        unit = np.sqrt(np.maximum(np.diag(matrix), 1e-12))
        inverse = np.linalg.pinv(matrix / np.outer(unit, unit), hermitian=True)
        inverse /= np.outer(unit, unit)
        values = -inverse @ (moves.T @ (weight * off))
    rest = off + moves @ values
    left, before = (
        np.median(np.bincount(cell, sure * item**2) / np.maximum(num_looks - 1, 1))
        for item in (rest, off)
    )
    if left > max(MOST_REST, before / EXPLAINED):
        return None
    # by how unlike the looks are; by planes, blocks, and windows where there are enough
    spare = max(len(off) - len(num_looks) - NUM, 1)
    sigma = np.sqrt(np.diag(inverse) * float(weight @ rest**2) / spare)
    least = np.full(NUM, find_quantile(spare))
    window = np.repeat(np.arange(len(windows)), [len(item.off) for item in windows])
    across = moves / unit
    # the values take freedom from planes and blocks; each window tells all of them
    for group, taken in ((cell, NUM), (block, NUM), (window, 1)):
        num = len(np.unique(group))
        if num < LEAST_GROUPS:
            continue
        own = _leave_out(group, across, weight, rest) / unit
        surely = find_quantile(num - taken)
        greater = surely * own > least * sigma
        sigma[greater], least[greater] = own[greater], surely
    if left > MOST_REST:
        sigma[1:] = np.inf
    return Steady(values, sigma, least, float(np.mean([item.speed for item in windows])))


def _leave_out(group: Int64, moves: Float64, weight: Float64, rest: Float64) -> Float64:
    """Return how much values change without one of the groups, as standard deviations (K,)."""
    _, group = np.unique(group, return_inverse=True)
    weighed = moves * weight[:, None]
    upper = np.triu_indices(moves.shape[1])
    slope = sum_rows(group, weighed * rest[:, None], int(group.max()) + 1)
    own = np.zeros((len(slope), moves.shape[1], moves.shape[1]))
    squares = weighed[:, upper[0]] * moves[:, upper[1]]
    own[:, upper[0], upper[1]] = sum_rows(group, squares, len(slope))
    own[:, upper[1], upper[0]] = own[:, upper[0], upper[1]]
    left = moves.T @ weighed - own + RIDGE * np.eye(moves.shape[1])
    change = np.linalg.solve(left, slope[..., None])[..., 0]
    result: Float64 = np.sqrt((len(slope) - 1) / len(slope) * (change**2).sum(axis=0))
    return result


def find_quantile(freedom: int) -> float:
    """Return how many standard deviations CHANCE allows, by the t distribution."""
    from scipy.special import stdtrit  # a tenth of a second that no start waits for

    return float(stdtrit(freedom, 1.0 - 0.5 * CHANCE))


def _number(parts: list[Int64]) -> Int64:
    """Join numbers from 0 on of each part to numbers of all."""
    steps = np.cumsum([0, *[int(part.max(initial=-1)) + 1 for part in parts]])
    return np.concatenate([part + step for part, step in zip(parts, steps, strict=False)])
