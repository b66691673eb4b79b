# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
How sharp the map is: whether what was seen at one moment lies where it was seen at another.

In cells of 4 m the points of each moment (a look) give a plane or a line.  With the right set-up
those of two looks are as near as the noise of the sensor lets them; what a wrong mount, wrong
frames or wrong times do grows with the way flown between them.  Related: Razlaw et al. 2015,
Evaluation of registration methods for sparse 3D laser scans (mean plane variance); here between
looks, so that foliage and rough ground, which are thick in every look, do not count.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from plc_inspect.results import Float64, Int64

CELL = 4.0
"""
Edge of a cell [m].
Source: measured: on simulated flights: smaller ones hold too few points of a look, larger ones two
surfaces.
"""
MOST_POINTS = 3000
"""
Points of a scan that are looked at; of more, every so many.
Source: numerical: 16 a cell and scan where all 200 cells in reach are seen.
"""
MOST_WAITING = 14
"""
Windows that wait to be measured at most.
Source: numerical: 10 s of flight, 1.4 windows a second in the three scales.
"""
LEAST_LOOKS = 3
"""Looks that a cell needs.  Source: judgement; not measured."""
LINE, PLANE = 0.02, 0.02
"""
A look is a line, or a plane, where its variance across is less than this share of that along.
Source: derived: noise of 0.03 m on a piece of a metre, with room for curvature.
"""
ROUGH, ROUGH_SHARE = 0.1**2, 0.25
"""
A look is a rough plane where it is thinner than this [m2] and than this share of its width.
Source: derived: ground with grass of 0.1 m.
"""
LEAST_PLANES, LEAST_LINES = 30, 5
"""Cells from which a figure is believed.  Source: judgement; not measured."""
UNSURE = 2.0
"""So many standard deviations of the median must be over the limit.  Source: derived: 98 %."""
HELD = 1.0
"""Blur over its limit from which hazards are held back.  Source: derived: limits are set so."""


@dataclass(frozen=True, slots=True)
class Scale:
    """How long looks last, and how long those are apart that are compared."""

    look_ns: int
    window_ns: int
    least_points: int
    """Of a look in a cell."""
    reach: float
    """Points farther from the lidar are not looked at [m]."""
    limit: float
    """Greatest distance between looks of a sharp map [m]."""


SHORT = Scale(100_000_000, 1_000_000_000, 5, 30.0, 0.035)
LONG = Scale(500_000_000, 5_000_000_000, 8, 30.0, 0.035)
FAR = Scale(500_000_000, 5_000_000_000, 8, 60.0, 0.05)
SCALES = SHORT, LONG, FAR
"""
Scans against a second, and half seconds against five.  The long one sees small errors; gross ones
smear its looks until they show no planes and lines, while the short one goes on.  Where little is
near, planes farther away count, with a greater limit, as the noise of the attitude grows with
range; lines there are arcs of the scan on the ground.
Source: measured: bench/studies/sharpness.py: with the right set-up 0.009 to 0.017 m near and
0.024 to 0.032 m far; 0.041 and more, and 0.046 and more, where the first hazard changes.
"""
GROSS_PLANES, GROSS_LINES = 0.15, 0.17
"""
Distances between looks of the short scale from which that one counts [m].  Lines of it do only
where planes are not sharp: arcs of the scan on the ground, which are no lines, reach 0.35.
Source: measured: bench/studies/sharpness.py: bundles, which are no planes, reach 0.10 with the
right set-up; bench/flights/drawn_flights.py, seeds 7001 and 7028: arcs.
"""

HOPELESS = 3.0
"""
Blur over its limit from which lines are not looked for in the whole map any more.
Source: measured: bench/studies/sharpness.py: no right line was found from 4 on; bench/faults.py:
quaternions written in another order gave 3.2, and 128 lines that are none.
"""


@dataclass(frozen=True, slots=True, eq=False)
class LookWindow:
    """Points of one window of one scale."""

    scale: int
    """Place in SCALES."""
    points: Float64
    """(N, 3) map frame [m]."""
    stamps: Int64
    """(N,) [ns]."""


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """How far looks lie apart in the cells of one window beyond their noise, as variances [m2]."""

    scale: int
    planes: Float64
    """(P,) across planes."""
    lines: Float64
    """(L,) across lines."""
    noise: Float64
    """(P,) across the planes of one look."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sharpness:
    """How sharp a map is."""

    blur: float = 0.0
    """Distance of looks at one thing over its limit; more than 1 is not sharp."""
    distance: float = 0.0
    """That distance [m]."""
    noise: float = 0.0
    """Thickness of a plane in one look [m]."""
    num_cells: int = 0
    """Cells that were compared."""
    doubt: str = ''
    """What else is wrong with the map, '' if nothing is known of."""

    @property
    def known(self) -> bool:
        """Whether enough was seen to tell."""
        return self.num_cells > 0

    @property
    def poor(self) -> bool:
        """Whether hazards are held back."""
        return bool(self.doubt) or (self.known and self.blur > HELD)

    @property
    def hopeless(self) -> bool:
        """Whether lines are not looked for either."""
        return self.known and self.blur > HOPELESS

    @property
    def figure(self) -> float:
        """Sharpness from 0 to 1; 0.5 is the limit."""
        return 1.0 / (1.0 + self.blur)

    def record(self) -> dict[str, float | bool | int]:
        """Return it JSON-serialisable."""
        return {
            'known': self.known, 'figure': round(self.figure, 3), 'poor': self.poor,
            'distance': round(self.distance, 4), 'noise': round(self.noise, 4),
            'num_cells': self.num_cells,
        }

    def describe(self) -> str:
        """Return it in one line."""
        if self.doubt:
            return self.doubt
        if not self.known:
            return 'sharpness unknown: too few planes and lines were seen twice'
        text = (
            f'sharpness {self.figure:.2f}: things seen twice lie {self.distance:.3f} m apart, '
            f'noise {self.noise:.3f} m'
        )
        if not self.poor:
            return text
        held = 'nothing is looked for in it' if self.hopeless else 'hazards are held back'
        return f'map is not sharp: check mount, frames, time ({text}); {held}'


class SharpnessMeter:
    """Gathers the points of scans in windows; owned by the thread that inserts them."""

    def __init__(self) -> None:
        self._waiting: deque[LookWindow] = deque(maxlen=MOST_WAITING)
        self.clear()

    def clear(self) -> None:
        """Forget all points."""
        self._waiting.clear()
        self._numbers = [-1] * len(SCALES)
        self._parts: list[list[tuple[Float64, Int64]]] = [[] for _ in SCALES]

    def add(self, points: Float64, stamps: Int64, apart: Float64) -> None:
        """
        Take the points of a scan.

        Parameters
        ----------
        points : Float64
            (N, 3) map frame [m].
        stamps : Int64
            (N,) [ns].
        apart : Float64
            (N,) distance from the lidar [m].

        """
        for index, scale in enumerate(SCALES):
            chosen = np.flatnonzero(apart < scale.reach)
            if not len(chosen):
                continue
            step = 1 + (len(chosen) - 1) // MOST_POINTS
            chosen = chosen[:: step | 1]  # an odd step takes all beams of an interleaved scan
            part = points[chosen], stamps[chosen]
            number = int(part[1][0]) // scale.window_ns
            if number != self._numbers[index]:
                self._close(index)
                self._numbers[index] = number
            self._parts[index].append(part)

    def _close(self, index: int) -> None:
        parts, self._parts[index] = self._parts[index], []
        if len(parts) >= LEAST_LOOKS:
            self._waiting.append(LookWindow(
                index, np.concatenate([item[0] for item in parts]),
                np.concatenate([item[1] for item in parts]),
            ))

    def take(self) -> list[LookWindow]:
        """Hand out the windows that are complete."""
        found = list(self._waiting)
        self._waiting.clear()
        return found


def measure_spread(window: LookWindow) -> Spread:
    """
    Measure how far the looks of a window lie apart.

    Parameters
    ----------
    window : LookWindow
        As from ``SharpnessMeter.take``.

    Returns
    -------
    Spread
        Costs O(N log N), 3 ms for 30,000 points.

    """
    scale = SCALES[window.scale]
    index = np.floor(window.points / CELL).astype(np.int64)
    offsets = window.points - (index + 0.5) * CELL
    index -= index.min(axis=0)
    size = index.max(axis=0) + 1
    cell = (index[:, 0] * size[1] + index[:, 1]) * size[2] + index[:, 2]
    look = (window.stamps - window.stamps.min()) // scale.look_ns
    num_looks = int(look.max()) + 1
    key, group, count = np.unique(
        cell * num_looks + look, return_inverse=True, return_counts=True
    )
    # means and scatter of each look in each cell
    mean = _sum(group, offsets, len(key)) / count[:, None]
    apart = offsets - mean[group]
    scatter = _sum(group, (apart[:, :, None] * apart[:, None, :]).reshape(-1, 9), len(key))
    good = count >= scale.least_points
    key, count, mean, scatter = key[good], count[good], mean[good], scatter[good]
    # pooled over the looks of a cell, and between them
    _, home, looks = np.unique(key // num_looks, return_inverse=True, return_counts=True)
    total = _sum(home, count[:, None].astype(np.float64), len(looks))
    centre = _sum(home, mean * count[:, None], len(looks)) / np.maximum(total, 1.0)
    apart = (mean - centre[home]) * np.sqrt(count)[:, None]
    between = _sum(home, (apart[:, :, None] * apart[:, None, :]).reshape(-1, 9), len(looks))
    kept = looks >= LEAST_LOOKS
    within = _sum(home, scatter, len(looks))[kept] / (total[kept] - looks[kept, None])
    # without what the noise of one look's mean is in any map
    expected = within * ((looks[kept] - 1) / total[kept, 0])[:, None]
    between = (between[kept] / total[kept] - expected).reshape(-1, 3, 3)
    values, axes = np.linalg.eigh(within.reshape(-1, 3, 3))
    line = (values[:, 1] < LINE * values[:, 2]) & (values[:, 1] < ROUGH)
    plane = (values[:, 0] < PLANE * values[:, 1]) | (
        (values[:, 0] < ROUGH) & (values[:, 0] < ROUGH_SHARE * values[:, 1])
    )
    plane &= ~line
    return Spread(
        scale=window.scale,
        planes=_project(between[plane], axes[plane, :, 0]),
        lines=_project(between[line], axes[line, :, 1]),
        noise=np.maximum(values[plane, 0], 0.0),
    )


def _sum(group: Int64, values: Float64, num: int) -> Float64:
    """Sum the rows of (N, K) values by group."""
    columns = [np.bincount(group, column, minlength=num) for column in values.T]
    return np.stack(columns, axis=1)


def _project(variance: Float64, axis: Float64) -> Float64:
    """Return the variances along axes (N, 3), 0 at least."""
    result: Float64 = np.maximum(np.einsum('ni,nij,nj->n', axis, variance, axis), 0.0)
    return result


@dataclass(slots=True)
class SharpnessBook:
    """
    What was measured so far.

    Parameters
    ----------
    num_windows : int or None
        Windows that are remembered; None: all.

    """

    num_windows: int | None = None
    _spreads: deque[Spread] = field(init=False)

    def __post_init__(self) -> None:
        """Begin with nothing."""
        self._spreads = deque(maxlen=self.num_windows)

    def clear(self) -> None:
        """Forget what was measured."""
        self._spreads.clear()

    def remember(self) -> tuple[Spread, ...]:
        """Return what was measured, oldest first; what is in it never changes."""
        return tuple(self._spreads)

    def restore(self, spreads: Sequence[Spread]) -> None:
        """Go on from what another book measured."""
        self.clear()
        self._spreads.extend(spreads)

    def add(self, windows: Sequence[LookWindow]) -> None:
        """Measure some windows."""
        self._spreads.extend(measure_spread(window) for window in windows)

    def judge(self) -> Sharpness:
        """Return how sharp the map is, by the worst of planes and lines."""
        found = Sharpness()
        near, far = (self._measure(scale, 'planes', LEAST_PLANES) for scale in (LONG, FAR))
        planes, limit = (near, LONG.limit) if near is not None else (far, FAR.limit)
        sharp = planes is not None and planes.distance <= limit
        # what the long one shows may not be known yet
        unsure = not any(SCALES[item.scale] is LONG for item in self._spreads)
        for scale, kind, least, gross in (
            (LONG, 'planes', LEAST_PLANES, 0.0), (LONG, 'lines', LEAST_LINES, 0.0),
            (SHORT, 'planes', LEAST_PLANES, GROSS_PLANES),
            (SHORT, 'lines', LEAST_LINES, GROSS_LINES), (FAR, 'planes', LEAST_PLANES, 0.0),
        ):
            own = self._measure(scale, kind, least)
            if own is None or own.distance < gross:
                continue
            arcs = kind == 'lines' and scale is SHORT and sharp
            if arcs or (scale is SHORT and unsure) or (scale is FAR and found.known):
                continue
            if own.blur >= found.blur:
                found = own
        return found

    def _measure(self, scale: Scale, kind: str, least: int) -> Sharpness | None:
        """Return what one scale says by planes or lines, None where there are too few."""
        own = [item for item in self._spreads if SCALES[item.scale] is scale]
        values = _gather([item.planes if kind == 'planes' else item.lines for item in own])
        if len(values) < least:
            return None
        noise = _gather([item.noise for item in own])
        distance = float(np.sqrt(np.median(values)))
        # what grows with the way flown is that much more over a long window
        share = LONG.window_ns / scale.window_ns / scale.limit
        blur = share * distance
        # of few cells the median may be great by chance
        low = float(np.quantile(values, max(0.0, 0.5 - 0.5 * UNSURE / np.sqrt(len(values)))))
        if share * np.sqrt(low) <= HELD:
            blur = min(blur, HELD)
        return Sharpness(
            blur=blur, distance=distance, num_cells=len(values),
            noise=float(np.sqrt(np.median(noise))) if len(noise) else 0.0,
        )


def _gather(parts: Sequence[Float64]) -> Float64:
    return np.concatenate([np.zeros(0), *parts])
