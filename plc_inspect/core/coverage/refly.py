# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Plans a flight that shows all gaps, at a safe distance and in order of flight.

A run passes one stretch on one side, below no conductor.  Between runs, and before the first, the
vehicle climbs above everything seen.
Unseen objects may stand higher, so the path is a proposal to a pilot, who must look out.
"""

from collections.abc import Sequence
from dataclasses import dataclass
import enum
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from plc_inspect.core.coverage.coverage import Coverage, Gap, Part, STEP
from plc_inspect.core.coverage.sections import find_heights, find_sections, Section
from plc_inspect.core.coverage.seen_ground import SeenGround
from plc_inspect.results import Bool, Float64, Int64, Span

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

SAFE = 18.0
"""
Least distance from all conductors, extrapolated beyond open ends [m].
Source: derived: the default warning distance of 15 m, and 3 m of wind and odometry.
"""
ABOVE = 4.0
"""
Height above the highest conductor [m].
Source: judgement: as the flights of the simulator; bench/studies/coverage.py flies it.
"""
LEAD = 40.0
"""
Distance before and after a stretch at which its run begins and ends [m].
Source: derived: 15 degrees below the horizon the ground 10 m below is met after 37 m.
"""
OBSTACLES, NEAR = 8.0, 10.0
"""
Least height above objects, and distance in plan from the path within which they count [m].
Source: derived: the default critical distance; sway and odometry.
"""
MOST_STEP = 25.0
"""
Greatest distance between two waypoints of a run [m].
Source: judgement: over hills the height changes.
"""
NUM_TURNS, NUM_REACHES = 16, 6
"""
Directions in which a start below conductors is left level, and half safe distances tried.
Source: numerical: 54 m reach beyond the conductors of any line.
"""
LIFT = 2.0
"""Step by which a path is lifted until it is safe [m].  Source: numerical."""
MOST_LIFT = 200.0
"""Greatest lift of a path [m].  Source: judgement: higher than any line."""
ROUNDING = 1e-6
"""Distances equal to it count as kept [m].  Source: numerical."""
SAMPLE = 2.0
"""Spacing of compared positions on conductors and paths [m].  Source: numerical: SAFE is nine."""


@dataclass(frozen=True, eq=False)
class _Around:
    """Obstacles of the path."""

    wires: Float64
    """(N, 3) positions along all conductors [m]."""
    ground: SeenGround
    safe: float

    @cached_property
    def tree(self) -> 'cKDTree':
        """Kd-tree of these positions."""
        from scipy.spatial import cKDTree  # a moment that others need not wait for

        return cKDTree(self.wires)

    @cached_property
    def plan_tree(self) -> 'cKDTree':
        """Kd-tree of these positions in plan."""
        from scipy.spatial import cKDTree

        return cKDTree(self.wires[:, :2])

    @property
    def least(self) -> float:
        """Distance between samples from which all between them keeps the safe one [m]."""
        return float(np.hypot(self.safe, SAMPLE / np.sqrt(2.0)))

    def is_safe(self, places: Float64) -> Bool:
        """Return which positions (N, 3) are above all else and no conductor is near or above."""
        return self.is_above(places) & self.is_apart(places) & ~self.is_below(places)

    def is_above(self, places: Float64) -> Bool:
        """Return which positions (N, 3) are above all objects near them."""
        # as a waypoint may lie exactly that high, rounding is left to it
        high: Bool = places[:, 2] >= self.find_floor(places) - ROUNDING
        return high

    def find_floor(self, places: Float64) -> Float64:
        """Return the least safe height (N,) above the objects near positions (N, 2+) [m]."""
        # an object near a leg counts at the samples before and behind it
        return self.ground.find_top(places, NEAR + SAMPLE) + OBSTACLES

    def is_apart(self, places: Float64) -> Bool:
        """Return which positions (N, 3) are far enough from conductors."""
        return self.measure(places) >= self.least - ROUNDING

    def measure(self, places: Float64) -> Float64:
        """Return the distance (N,) of positions (N, 3) from conductors, up to the least [m]."""
        if not len(self.wires):
            return np.full(len(places), self.least)
        apart: Float64 = np.minimum(self.tree.query(places)[0], self.least)
        return apart

    def is_below(self, places: Float64) -> Bool:
        """Return which positions (N, 3) cannot be left upwards: a conductor hangs above."""
        below: Bool = np.zeros(len(places), dtype=np.bool_)
        if not len(self.wires):
            return below
        (low,) = np.nonzero(places[:, 2] < self.wires[:, 2].max())
        near = self.plan_tree.query_ball_point(places[low, :2], self.least)
        for number, own in zip(low, near, strict=True):
            below[number] = bool((self.wires[own, 2] > places[number, 2]).any())
        return below


class Kind(enum.IntEnum):
    """Purpose of a waypoint."""

    RUN = 0
    TRANSIT = 1
    """On the way to the next run."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Run:
    """One pass along a section on one side."""

    span_id: int
    is_left: bool
    places: Float64
    """(K, 3) waypoints in order [m]."""
    gaps: tuple[int, ...]
    """Indices of the gaps that it shows."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Refly:
    """The flight that shows all gaps."""

    runs: tuple[Run, ...]
    """Runs in order of flight."""
    places: Float64
    """(W, 3) all waypoints in order of flight, transits included [m]."""
    kinds: tuple[Kind, ...]
    """Kind of each waypoint."""
    run: tuple[int, ...]
    """Run of each waypoint; for a transit, the following one."""

    @property
    def length(self) -> float:
        """Length of the path [m]."""
        return float(np.linalg.norm(np.diff(self.places, axis=0), axis=1).sum())


def plan_refly(
    coverage: Coverage, ground: SeenGround, start: Float64 | None = None, safe: float = SAFE,
    others: Sequence[Span] = (),
) -> Refly:
    """
    Plan a path that shows all gaps.

    Parameters
    ----------
    coverage : Coverage
        Coverage with its gaps.
    ground : SeenGround
        Heights of everything seen.
    start : (3,) float64 or None
        Start of the vehicle [m]; None: at the first gap.  Where it cannot be left safely, as
        below a conductor, the way to the first run is left to the pilot.
    safe : float
        Least distance from conductors [m].
    others : sequence of Span
        Conductors besides those of the coverage, which are kept off as well.

    Returns
    -------
    Refly
        Without waypoints if there are no gaps; without runs that no lift makes safe.

    """
    wires = sample_wires([
        *(item.section for item in coverage.sections), *find_sections(others),
    ])
    around = _Around(wires, ground, safe)
    runs, number = [], 0
    for item in coverage.sections:
        numbers = range(number, number + len(item.gaps))
        number += len(item.gaps)
        sides: dict[bool, list[int]] = {True: [], False: []}
        flown = {strip.part: strip.is_flown for strip in item.strips}
        fixed = [gap.part for gap in item.gaps if gap.part in (Part.LEFT, Part.RIGHT)]
        # what can be seen from either side is looked at from one that is flown anyhow, or is new
        free = fixed[0] == Part.LEFT if fixed else not flown.get(Part.LEFT)
        for place, gap in zip(numbers, item.gaps, strict=True):
            own = gap.part == Part.LEFT if gap.part in (Part.LEFT, Part.RIGHT) else free
            sides[own].append(place)
        for is_left, chosen in sides.items():
            gaps = [(place, item.gaps[place - numbers[0]]) for place in chosen]
            for low, high, held in _merge(gaps):
                places = _lay_run(item.section, (low, high), is_left, around)
                if places is not None:
                    runs.append(Run(
                        span_id=item.section.span_id, is_left=is_left, gaps=held, places=places,
                    ))
    return _order(runs, around, start)


def sample_wires(sections: Sequence[Section]) -> Float64:
    """Return positions (N, 3) along all conductors, extrapolated beyond open ends [m]."""
    parts = [np.empty((0, 3))]
    for section in sections:
        for span in section.spans:
            low, high = _extend(section, span)
            parts.append(span.positions(np.linspace(low, high, 2 + int((high - low) / SAMPLE))))
    return np.concatenate(parts)


def _extend(section: Section, span: Span) -> tuple[float, float]:
    """Return least and greatest x of a span, beyond its open ends included [m]."""
    reach = LEAD + section.high - span.length
    return -reach if span.open_start else 0.0, span.length + (reach if span.open_end else 0.0)


def _merge(gaps: Sequence[tuple[int, Gap]]) -> list[tuple[float, float, tuple[int, ...]]]:
    """Return stretches of numbered gaps, merging near ones."""
    merged: list[tuple[float, float, tuple[int, ...]]] = []
    for number, gap in sorted(gaps, key=lambda item: item[1].low):
        if merged and gap.low - merged[-1][1] <= 2.0 * LEAD:
            low, high, held = merged[-1]
            merged[-1] = low, max(high, gap.high), (*held, number)
        else:
            merged.append((gap.low, gap.high, (number,)))
    return merged


def _lay_run(
    section: Section, stretch: tuple[float, float], is_left: bool,
    around: _Around,
) -> Float64 | None:
    low, high = stretch[0] - LEAD, stretch[1] + LEAD
    x = np.linspace(low, high, 2 + int((high - low) / MOST_STEP))
    aside = 2.0 * around.least - around.safe  # so that rounding does not lift it
    y = section.left + aside if is_left else section.right - aside
    inside = np.clip(x, 0.0, section.high)
    heights = find_heights(section, inside)[:, 1] + ABOVE
    return _lift(np.column_stack([section.leave(x, y), heights]), around)


def _lift(places: Float64, around: _Around) -> Float64 | None:
    """Return a path lifted so that each leg is safe, None where none is."""
    most = places[:, 2] + MOST_LIFT
    places = places.copy()
    places[:, 2] = np.maximum(places[:, 2], around.find_floor(places))
    for _ in range(1 + int(MOST_LIFT / LIFT)):
        if (places[:, 2] > most).any():
            return None
        at, owner = _sample(places)
        bad = ~around.is_safe(at)
        if not bad.any():
            return places
        chosen = np.unique(np.concatenate([owner[bad], owner[bad] + 1]))
        places[np.minimum(chosen, len(places) - 1), 2] += LIFT
    return None


def _sample(places: Float64) -> tuple[Float64, Int64]:
    """Return positions (N, 3) along a path, and the number of the leg of each."""
    parts, owner = [places[:1]], [0]
    for number in range(len(places) - 1):
        apart = float(np.linalg.norm(places[number + 1] - places[number]))
        share = np.linspace(0.0, 1.0, 2 + int(apart / SAMPLE))[:, None]
        parts.append(places[number] + share * (places[number + 1] - places[number]))
        owner += [number] * len(share)
    return np.concatenate(parts), np.array(owner, dtype=np.int64)


def _order(
    runs: Sequence[Run], around: _Around, start: Float64 | None
) -> Refly:
    """Put runs one after the other, the nearest end first, with the way between them."""
    left, at = list(runs), start
    ordered: list[Run] = []
    places: list[Float64] = [np.empty((0, 3))]
    kinds: list[Kind] = []
    owner: list[int] = []
    while left:
        if at is None:
            number, turned = 0, False
        else:
            ends = np.array([(run.places[0], run.places[-1]) for run in left])
            apart = np.linalg.norm(ends - at, axis=2)
            number, end = divmod(int(apart.argmin()), 2)
            turned = bool(end)
        run = left.pop(number)
        way = run.places[::-1] if turned else run.places
        if at is not None:
            between = _cross(at, way[0], around) if ordered else _leave(at, way[0], around)
            places.append(between)
            kinds += [Kind.TRANSIT] * len(between)
            owner += [len(ordered)] * len(between)
        places.append(way)
        kinds += [Kind.RUN] * len(way)
        owner += [len(ordered)] * len(way)
        ordered.append(Run(
            span_id=run.span_id, is_left=run.is_left, places=way, gaps=run.gaps,
        ))
        at = way[-1]
    return Refly(
        runs=tuple(ordered), places=np.concatenate(places), kinds=tuple(kinds), run=tuple(owner),
    )


def _cross(first: Float64, last: Float64, around: _Around) -> Float64:
    """Return waypoints (K, 3) between two safe places: none, or up, over and down."""
    if around.is_safe(_sample(np.array([first, last]))[0]).all():
        return np.empty((0, 3))
    # nothing hangs above a safe place, so that both ways up are safe
    near = around.wires[_lies_along(around.wires, first, last, around.least)]
    level, _ = _sample(np.array([[*first[:2], 0.0], [*last[:2], 0.0]]))
    top = max(
        float(around.find_floor(level).max()), float(first[2]), float(last[2]),
        float(near[:, 2].max()) + around.least if len(near) else -np.inf,
    )
    return np.array([[*first[:2], top], [*last[:2], top]])


def _leave(start: Float64, last: Float64, around: _Around) -> Float64:
    """Return waypoints (K, 3) from where the vehicle is, none where no way is safe."""
    turns = np.linspace(0.0, 2.0 * np.pi, NUM_TURNS, endpoint=False)
    reaches = around.least * np.arange(1, NUM_REACHES + 1) / 2.0
    aside = start + np.array([
        (reach * np.cos(turn), reach * np.sin(turn), 0.0) for reach in reaches for turn in turns
    ])
    for way in [np.empty((0, 3)), *aside[around.is_safe(aside)][:, None]]:
        own = np.vstack([start, way])
        between = np.vstack([way, _cross(own[-1], last, around)])
        if _comes_clear(np.vstack([start, between, last]), around):
            return between
    return np.empty((0, 3))


def _comes_clear(places: Float64, around: _Around) -> bool:
    """Tell whether a path from an unsafe place climbs or comes no nearer until it is safe."""
    at, _ = _sample(places)
    apart = around.measure(at)
    above = around.is_above(at) | (np.hypot(*(at - at[0])[:, :2].T) <= ROUNDING)
    return bool(above.all() and (np.diff(apart) >= -ROUNDING).all())


def _lies_along(wires: Float64, first: Float64, last: Float64, reach: float) -> Bool:
    """Tell which places (N, 3) are within reach of a leg in plan."""
    leg = (last - first)[:2]
    share = np.clip((wires[:, :2] - first[:2]) @ leg / max(float(leg @ leg), STEP), 0.0, 1.0)
    apart = wires[:, :2] - first[:2] - share[:, None] * leg
    near: Bool = np.hypot(*apart.T) <= reach
    return near
