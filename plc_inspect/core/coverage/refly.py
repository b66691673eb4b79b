# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Plans a flight that shows all gaps, at a safe distance and in order of flight.

A run passes one stretch on one side, below no conductor: at the height of the conductors where
these were not seen, nearer to the ground where that was not.  Between runs, and before the first,
the vehicle climbs above everything seen.
Unseen objects may stand higher, so the path is a proposal to a pilot, who must look out.
"""

from collections.abc import Sequence
from dataclasses import dataclass
import enum

import numpy as np

from plc_inspect.core.coverage.airspace import (
    Airspace,
    LEAD,
    OBSTACLES,
    ROUNDING,
    SAFE,
    sample_path,
    sample_wires,
)
from plc_inspect.core.coverage.coverage import Coverage, Gap, Part, PASS, STEP
from plc_inspect.core.coverage.sections import find_heights, find_sections, Section
from plc_inspect.core.coverage.seen_ground import SeenGround
from plc_inspect.results import Bool, Float64, Span

LOW_LEAD = PASS
"""
The same where ground is passed low [m].
Source: derived: where the lowest rings of a Puck, 15 to 11 degrees below the horizon, meet it.
"""
ASIDES = (0.0, 12.0, 24.0)
"""
Distances beyond the safe one at which ground may be passed: that from which most is seen [m].
Source: derived: 15 degrees below the horizon the ground 8 m below is met after 30 m, and the
corridor is 10 m wide.
"""
DOWN = 13.0
"""Lowest direction of view that is planned with [deg].  Source: derived: the second ring."""
MISSED = 8.0
"""
Height above conductors in which there may be one that was not found [m].
Source: judgement: an earth wire, which is thin, above the phases.
"""
ABOVE = 4.0
"""
Height above the highest conductor [m].
Source: judgement: as the flights of the simulator; bench/studies/coverage.py flies it.
"""
MOST_STEP = 25.0
"""
Greatest distance between two waypoints of a run [m].
Source: judgement: over hills the height changes.
"""
MOST_SLOPE = 0.5
"""Greatest slope of a run.  Source: judgement: a multirotor climbs at half of its speed."""
NUM_TURNS, NUM_REACHES = 16, 6
"""
Directions in which a start below conductors is left level, and half safe distances tried.
Source: numerical: 54 m reach beyond the conductors of any line.
"""
LIFT = 2.0
"""Step by which a path is lifted until it is safe [m].  Source: numerical."""
MOST_LIFT = 200.0
"""Greatest height above that of conductors [m].  Source: judgement: higher than any line."""


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
    space = Airspace(wires, ground, safe)
    runs, number = [], 0
    for item in coverage.sections:
        numbers = range(number, number + len(item.gaps))
        number += len(item.gaps)
        flown = {strip.part: strip.is_flown for strip in item.strips}
        fixed = [gap.part for gap in item.gaps if gap.part in (Part.LEFT, Part.RIGHT)]
        # what can be seen from either side is looked at from one that is flown anyhow, or is new
        free = fixed[0] == Part.LEFT if fixed else not flown.get(Part.LEFT)
        passes: dict[tuple[bool, bool], list[tuple[int, Gap]]] = {}
        for place, gap in zip(numbers, item.gaps, strict=True):
            is_low = gap.part != Part.CONDUCTOR and _hangs_high(item.section, gap, space)
            own = gap.part == Part.LEFT if gap.part in (Part.LEFT, Part.RIGHT) else free
            # what trees hide from one side may be seen from the other
            for is_left in (own, not own) if is_low else (own,):
                passes.setdefault((is_left, is_low), []).append((place, gap))
        seen: dict[tuple[int, ...], Bool] = {}
        for (is_left, is_low), chosen in passes.items():
            lead = LOW_LEAD if is_low else LEAD
            for low, high, held in _merge(chosen, lead):
                ways = _lay_runs(item.section, (low, high, lead), is_left, is_low, space)
                if not ways:
                    continue
                targets = np.concatenate([gap.places for place, gap in chosen if place in held])
                views = [_see(targets, way, space) | seen.get(held, np.False_) for way in ways]
                best = int(np.argmax([view.sum() for view in views]))
                seen[held] = views[best]
                runs.append(Run(
                    span_id=item.section.span_id, is_left=is_left, gaps=held, places=ways[best],
                ))
    return _order(runs, space, start)


def _hangs_high(section: Section, gap: Gap, space: Airspace) -> bool:
    """Tell whether a run at the height of the conductors passes too high above a gap's ground."""
    high = find_heights(section, section.enter(gap.places)[:, 0])[:, 1] + ABOVE
    return bool((high > space.find_low(gap.places)).any())


def _merge(
    gaps: Sequence[tuple[int, Gap]], lead: float
) -> list[tuple[float, float, tuple[int, ...]]]:
    """Return stretches of numbered gaps, merging near ones."""
    merged: list[tuple[float, float, tuple[int, ...]]] = []
    for number, gap in sorted(gaps, key=lambda item: item[1].low):
        if merged and gap.low - merged[-1][1] <= 2.0 * lead:
            low, high, held = merged[-1]
            merged[-1] = low, max(high, gap.high), (*held, number)
        else:
            merged.append((gap.low, gap.high, (number,)))
    return merged


def _see(targets: Float64, way: Float64, space: Airspace) -> Bool:
    """Return which places (N, 2+) on the ground come into view along a way (K, 3)."""
    ground = space.find_ground(targets)
    at, _ = sample_path(way)
    apart = np.linalg.norm(targets[:, None, :2] - at[None, :, :2], axis=2)
    below = at[None, :, 2] - ground[:, None]
    seen: Bool = ((apart <= PASS) & (below <= np.tan(np.deg2rad(DOWN)) * apart)).any(axis=1)
    return seen


def _lay_runs(
    section: Section, stretch: tuple[float, float, float], is_left: bool, is_low: bool,
    space: Airspace,
) -> list[Float64]:
    """Return the safe ones of the ways (K, 3) along a stretch with a lead [m], nearest first."""
    aside = 2.0 * space.least - space.safe  # so that rounding does not lift it
    left, right = section.left + aside, section.right - aside
    ways = [
        _lay_run(section, stretch, left + more if is_left else right - more, is_low, space)
        for more in (ASIDES if is_low else ASIDES[:1])
    ]
    return [way for way in ways if way is not None]


def _lay_run(
    section: Section, stretch: tuple[float, float, float], y: float, is_low: bool, space: Airspace,
) -> Float64 | None:
    low, high = _find_ends(section, stretch, y, space)
    x = np.linspace(low, high, 2 + int((high - low) / MOST_STEP))
    inside = np.clip(x, 0.0, section.high)
    heights = find_heights(section, inside)[:, 1] + ABOVE
    plan = section.leave(x, y)
    most = heights + MOST_LIFT
    if is_low:
        heights = np.minimum(heights, space.find_low(plan))
    return _lift(np.column_stack([plan, heights]), most, space)


def _find_ends(
    section: Section, stretch: tuple[float, float, float], y: float, space: Airspace
) -> tuple[float, float]:
    """
    Return where a run along a stretch with a lead begins and ends [m].

    Where nothing was seen it passes no farther than known conductors go: they may turn there.
    """
    low, high, lead = stretch
    known = section.enter(np.array([
        place for span in section.spans for place in (span.start, span.end)
    ]))[:, 0]
    first, last = float(known.min()), float(known.max())
    ends = []
    for begin, sign in ((low, -1.0), (high, 1.0)):
        begin = float(np.clip(begin, first, last))
        x = begin + sign * np.arange(0.0, lead + STEP, STEP)
        good = space.is_known(section.leave(x, y)) | ((x >= first) & (x <= last))
        ends.append(float(x[np.flatnonzero(np.append(~good, True))[0] - 1]))
    return ends[0], ends[1]


def _lift(places: Float64, most: Float64, space: Airspace) -> Float64 | None:
    """Return a path lifted so that each leg is safe, None where none below heights (K,) is."""
    places[:, 2] = np.maximum(places[:, 2], space.find_floor(places))
    while True:
        _limit_slope(places)
        if (places[:, 2] > most).any():
            return None
        at, owner = sample_path(places)
        bad = ~space.is_safe(at)
        if not bad.any():
            return places
        chosen = np.unique(np.concatenate([owner[bad], owner[bad] + 1]))
        places[np.minimum(chosen, len(places) - 1), 2] += LIFT


def _limit_slope(places: Float64) -> None:
    """Lift waypoints so that no leg is steeper than MOST_SLOPE."""
    for way in (places, places[::-1]):
        drop = MOST_SLOPE * np.hypot(*np.diff(way[:, :2], axis=0).T)
        for k in range(1, len(way)):
            way[k, 2] = max(way[k, 2], way[k - 1, 2] - drop[k - 1])


def _order(
    runs: Sequence[Run], space: Airspace, start: Float64 | None
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
            between = _cross(at, way[0], space) if ordered else _leave(at, way[0], space)
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


def _cross(first: Float64, last: Float64, space: Airspace) -> Float64:
    """
    Return waypoints (K, 3) between two safe places: none, or up, over and down.

    Over what was not seen the way is as high as over all that was within PASS of it.
    """
    way, _ = sample_path(np.array([first, last]))
    is_known = bool(space.is_known(way).all())
    if is_known and space.is_safe(way).all():
        return np.empty((0, 3))
    # nothing hangs above a safe place, so that both ways up are safe
    reach = space.least if is_known else max(space.least, PASS)
    near = space.wires[_lies_along(space.wires, first, last, reach)]
    level, _ = sample_path(np.array([[*first[:2], 0.0], [*last[:2], 0.0]]))
    top = max(
        float(space.find_floor(level).max()), float(first[2]), float(last[2]),
        float(near[:, 2].max()) + space.least + MISSED if len(near) else -np.inf,
    )
    if not is_known:
        tree, heights = space.seen
        beside = _lies_along(tree.data, first, last, reach)
        top = max(top, float(heights[:-1][beside].max(initial=-np.inf)) + OBSTACLES)
    return np.array([[*first[:2], top], [*last[:2], top]])


def _leave(start: Float64, last: Float64, space: Airspace) -> Float64:
    """Return waypoints (K, 3) from where the vehicle is, none where no way is safe."""
    turns = np.linspace(0.0, 2.0 * np.pi, NUM_TURNS, endpoint=False)
    reaches = space.least * np.arange(1, NUM_REACHES + 1) / 2.0
    aside = start + np.array([
        (reach * np.cos(turn), reach * np.sin(turn), 0.0) for reach in reaches for turn in turns
    ])
    for way in [np.empty((0, 3)), *aside[space.is_safe(aside)][:, None]]:
        own = np.vstack([start, way])
        between = np.vstack([way, _cross(own[-1], last, space)])
        if _comes_clear(np.vstack([start, between, last]), space):
            return between
    return np.empty((0, 3))


def _comes_clear(places: Float64, space: Airspace) -> bool:
    """Tell whether a path from an unsafe place climbs or comes no nearer until it is safe."""
    at, _ = sample_path(places)
    apart = space.measure(at)
    above = space.is_above(at) | (np.hypot(*(at - at[0])[:, :2].T) <= ROUNDING)
    return bool(above.all() and (np.diff(apart) >= -ROUNDING).all())


def _lies_along(wires: Float64, first: Float64, last: Float64, reach: float) -> Bool:
    """Tell which places (N, 3) are within reach of a leg in plan."""
    leg = (last - first)[:2]
    share = np.clip((wires[:, :2] - first[:2]) @ leg / max(float(leg @ leg), STEP), 0.0, 1.0)
    apart = wires[:, :2] - first[:2] - share[:, None] * leg
    near: Bool = np.hypot(*apart.T) <= reach
    return near
