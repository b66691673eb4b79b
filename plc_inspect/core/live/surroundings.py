# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What is known about the vehicle: conductors, whatever else stands there, and what was seen."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plc_inspect.core.live.motion import LEAST_SPEED
from plc_inspect.core.live.window import Window
from plc_inspect.core.numerics.arrays import MOST_COORDINATE
from plc_inspect.core.spans.span_model import POINT_SIGMA
from plc_inspect.core.tracking.wire_points import thin_points
from plc_inspect.core.voxel_buffer.cell_index import CellIndex
from plc_inspect.results import Bool, Decision, Float64, InspectionResult, Int64, Span

RANGE = 60.0
"""
Distance from the vehicle in plan up to which points are kept [m].
Source: judgement: at 15 m/s four seconds to react.
"""
SPACING = 0.25
"""
Spacing to which points are thinned [m].
Source: judgement: of a tree's surface the nearest point is at most half of it nearer.
"""
OFF_GROUND = 1.5
"""
Points at least this high above the ground stand off it [m].
Source: judgement: below are grass, walls and errors of the ground.
"""
MOST_EXTENSION = 50.0
"""A conductor goes on beyond an open end for at most this [m].  Source: judgement."""
MOST_SIGMA = 1.0
"""
And as long as its place is known to this standard deviation [m].
Source: judgement: an eighth of the default distance that is critical.
"""
SETTLED = 3
"""
Ticks after its first from which a cell is seen: so long a conductor in it may take to be found.
Source: measured: bench/live/proximity.py: with 0, flights begin with a conductor near and "clear".
"""
MOST_RISE = 2.0
"""
And up to this height above the higher of its ends: there a support must follow [m].
Source: judgement: one that went on rising behind a support that was not found yet gave 57 false
criticals in a flight of bench/live/proximity.py.
"""
LEAST_LENGTH = 1.0
"""Length of a span in a divisor, at least [m].  Source: numerical: not 0."""
COURSE = 9
"""Length of a course.  Source: derived: two places, two ends, three of the catenary."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Surroundings:
    """All that may be near the vehicle; nothing in it changes afterwards."""

    spans: tuple[Span, ...] = ()
    """Also those that are not confirmed yet."""
    courses: Float64 = field(default_factory=lambda: np.empty((0, COURSE)))
    """
    (C, COURSE) of each sub-conductor: start x, y; unit vector x, y; ends of x; a, b, c [m].
    """
    owner: Int64 = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """(C,) the span of each of these."""
    supports: Float64 = field(default_factory=lambda: np.empty((0, 3)))
    """(K, 3) points of towers and poles, map frame [m]."""
    obstacles: Float64 = field(default_factory=lambda: np.empty((0, 3)))
    """(K, 3) points of all else that stands off the ground, conductors apart [m]."""
    settled: frozenset[tuple[int, int]] = frozenset()
    """Places on the grid of plan cells that ticks saw whole SETTLED ticks ago or earlier."""
    ground: bool | None = None
    """Whether a tick saw ground within RANGE; None while none has looked."""

    def may_hold_ground(self, velocity: Float64) -> bool:
        """
        Tell whether what lies lowest about the vehicle may be the ground.

        It may where a tick saw ground, and, before the first tick, about a vehicle that stands
        still.  Otherwise it is in the air with nothing but wires and the like in view.

        Parameters
        ----------
        velocity : (3,) float64
            Of the vehicle [m/s]; NaN unknown.

        """
        if self.ground is None:
            return not np.linalg.norm(velocity) >= LEAST_SPEED
        return self.ground

    def is_seen(self, cells: CellIndex, position: Float64, reach: float, beta: float) -> bool:
        """
        Tell whether all that is about a position was seen.

        Ground must have been seen, every plan cell of the map within reach must hold something,
        and where something stands high, ticks must have looked at it for SETTLED ticks.

        Parameters
        ----------
        cells : CellIndex
            Of the map.
        position : (3,) float64
            Map frame [m].
        reach : float
            In plan [m].
        beta : float
            Something this far above the lowest place is high, and looked at by ticks [m].

        """
        if not self.ground or not (np.abs(position) < MOST_COORDINATE).all():
            return False
        found = cells.find_all(position, reach)
        if (found < 0).any() or not cells.count[found].all():
            return False
        is_high = cells.high[found] - cells.low[found].min() >= beta
        return {*map(tuple, cells.index_of(found[is_high]).tolist())} <= self.settled


def surround(spans: Sequence[Span], obstacles: Float64) -> Surroundings:
    """Return surroundings of spans and (K, 3) obstacles [m], nothing of it settled."""
    owner = np.repeat(np.arange(len(spans)), [len(span.strands) for span in spans])
    courses = np.array([_describe(span) for span in spans]).reshape(-1, COURSE)[owner]
    if len(owner):
        left, above = np.vstack([span.strands for span in spans]).T
        courses[:, 0] -= left * courses[:, 3]
        courses[:, 1] += left * courses[:, 2]
        courses[:, 6] += above
    return Surroundings(spans=tuple(spans), courses=courses, owner=owner, obstacles=obstacles)


class SurroundingsBook:
    """Keeps the surroundings from tick to tick."""

    def __init__(self) -> None:
        self._known = Surroundings()
        self._cells = np.empty((0, 3), dtype=np.int64)
        """Row, column and first tick of each cell in which something was seen."""
        self._num_ticks = 0
        self._on_ground: Float64 | None = None
        """(1, 2) where the vehicle was when a tick saw ground last [m]."""

    @property
    def known(self) -> Surroundings:
        """What is known after the last tick."""
        return self._known

    def update(
        self,
        spans: Sequence[Span],
        window: Window,
        result: InspectionResult,
        vehicle: Float64 | None,
    ) -> None:
        """
        Replace what is known in the cells that a tick saw whole.

        Parameters
        ----------
        spans : sequence of Span
            All that are known.
        window : Window
            Of the tick.
        result : InspectionResult
            What it found.
        vehicle : (2+,) float64 or None
            Where it is [m].

        """
        points, decision = window.points, result.decision
        near = _is_near(points, vehicle, RANGE)
        # where no ground was seen, heights are NaN, and everything is in the air
        stands = near & ~(result.ground_height < OFF_GROUND) & (decision != Decision.WIRE)
        rows = np.flatnonzero(stands)
        rows = rows[window.holds(points[rows])]
        rows = rows[thin_points(points[rows], SPACING)]
        kept, is_support = self._known, decision[rows] == Decision.SUPPORT
        cells, first = self._see(window, vehicle)
        self._known = replace(
            surround(
                spans, _renew(kept.obstacles, points[rows[~is_support]], window, vehicle)
            ),
            supports=_renew(kept.supports, points[rows[is_support]], window, vehicle),
            settled=frozenset(map(tuple, cells[first <= self._num_ticks - SETTLED].tolist())),
            ground=self._sees_ground(result.ground_height[near], vehicle),
        )

    def _sees_ground(self, heights: NDArray[Any], vehicle: Float64 | None) -> bool | None:
        """Tell of heights near the vehicle, and of what was before, whether ground is near."""
        if np.isfinite(heights).any():
            self._on_ground = np.array([[*vehicle[:2]]]) if vehicle is not None else None
            return True
        if not len(heights) or vehicle is None:
            return self._known.ground
        return self._on_ground is not None and bool(_is_near(self._on_ground, vehicle, RANGE)[0])

    def _see(self, window: Window, vehicle: Float64 | None) -> tuple[Int64, Int64]:
        """Add the cells of a window; return all near the vehicle and the first tick of each."""
        self._num_ticks += 1
        new = np.column_stack((window.fresh, np.full(len(window.fresh), self._num_ticks)))
        both = np.concatenate((self._cells, new))
        _, first = np.unique(both[:, :2], axis=0, return_index=True)
        both = both[first]
        self._cells = both[
            _is_near((both[:, :2] + 0.5) * window.cell_size, vehicle, 2.0 * RANGE)
        ]
        return self._cells[:, :2], self._cells[:, 2]


def _renew(kept: Float64, new: Float64, window: Window, vehicle: Float64 | None) -> Float64:
    """Replace the points in the cells that a window holds whole; forget what is far."""
    stays = ~window.holds(kept) & _is_near(kept, vehicle, RANGE)
    return np.concatenate((kept[stays], new))


def _is_near(points: NDArray[Any], vehicle: Float64 | None, reach: float) -> Bool:
    """Tell which of (N, 2+) places are near the vehicle in plan; all where it is unknown."""
    if vehicle is None:
        return np.ones(len(points), dtype=np.bool_)
    near: Bool = np.hypot(*(points[:, :2] - vehicle[:2]).T) <= reach
    return near


def find_sigma(span: Span, beyond: float) -> float:
    """
    Return the standard deviation of a span's place [m], ``beyond`` metres from its ends.

    An error of the sag of a parabola of length L is, d beyond its end, one of 4 d (L + d) / L^2
    times that.
    """
    lever = max(1.0, 4.0 * beyond * (span.length + beyond) / max(span.length, LEAST_LENGTH) ** 2)
    return math.hypot(lever * span.sigma_sag, POINT_SIGMA, span.rmse)


def _describe(span: Span) -> tuple[float, ...]:
    """Return the course of a span, with the ends up to which it is known."""
    reach = 0.0
    if span.open_start or span.open_end:
        # where find_sigma comes to MOST_SIGMA
        room = MOST_SIGMA**2 - POINT_SIGMA**2 - span.rmse**2
        ratio = math.sqrt(max(room, 0.0)) / max(span.sigma_sag, POINT_SIGMA)
        reach = min(span.length * (math.sqrt(1.0 + ratio) - 1.0) / 2.0, MOST_EXTENSION)
    most = max(span.start[2], span.end[2]) + MOST_RISE
    bow = span.c * math.acosh(max((most - span.a) / span.c, 1.0))
    unit = (span.end - span.start)[:2] / max(span.length, LEAST_LENGTH)
    return (
        *span.start[:2], *unit, min(max(-reach, span.b - bow), 0.0) if span.open_start else 0.0,
        max(min(span.length + reach, span.b + bow), span.length) if span.open_end
        else span.length, span.a, span.b, span.c,
    )
