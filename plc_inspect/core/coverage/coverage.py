# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Coverage: how well each span, the ground below it and the corridor beside it were seen.

A section is the conductors between the same two supports.  Unseen stretches are listed as gaps: no
hazard was found there, and none can be ruled out.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import enum
import math

import numpy as np

from plc_inspect.core.coverage.sections import find_heights, find_reach_of, find_sections, Section
from plc_inspect.core.coverage.seen_ground import CELL, SeenGround
from plc_inspect.results import Bool, Float64, InspectionResult, PointClass, Span

STEP = 5.0
"""
Length of the stretches in which ground is judged [m].
Source: judgement: the crown of a tree.
"""
SIDE = 10.0
"""
Width of the corridor on either side of the outer conductors [m].
Source: judgement: twice the 4 m that are a warning by default, with blow-out.
"""
LEAST_SHARE = 0.5
"""
Least share of the cells of a stretch that must have been seen.
Source: judgement: two in four across and along leave no room for a tree.
"""
MOST_GAP = 10.0
"""
Longest distance along a conductor without a point that is no gap [m].
Source: derived: where a tree could hide, two of STEP.
"""
PASS = 80.0
"""Greatest distance of a pass that shows a section [m].  Source: derived: range of a Puck Lite."""


class Part(enum.IntEnum):
    """Part of a section; ``part`` in files."""

    CONDUCTOR = 0
    BELOW = 1
    """The ground below the conductors."""
    LEFT = 2
    """The corridor to the left, looking from the start to the end."""
    RIGHT = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Gap:
    """A stretch not seen well enough to rule out a hazard."""

    part: Part
    section: int
    """Number of the section."""
    span_id: int
    line_id: int = -1
    """Line of a conductor, -1 for other parts."""
    low: float
    """Start along the axis of the section [m]."""
    high: float
    is_beyond: bool = False
    """Beyond an open end of the conductor, whose further course is unknown."""
    places: Float64
    """(K, 3) polyline along it, on the conductor or below the section's conductors [m]."""

    @property
    def length(self) -> float:
        """Length [m]."""
        return self.high - self.low


@dataclass(frozen=True, slots=True, kw_only=True)
class ConductorSight:
    """Coverage of one conductor."""

    line_id: int
    length: float
    """[m]"""
    density: float
    """Points per metre."""
    share: float
    """Share of the length outside gaps, 0 to 1; the length includes what lies beyond open ends."""
    longest_gap: float
    """Longest distance without a point [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StripSight:
    """Coverage of the ground below or beside the conductors."""

    part: Part
    share: float
    """Seen share of its length, 0 to 1."""
    longest_gap: float
    """[m]"""
    is_flown: bool | None = None
    """The vehicle passed on this side; None if its path is unknown, and for BELOW."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SectionSight:
    """Coverage of one section."""

    section: Section
    conductors: tuple[ConductorSight, ...]
    strips: tuple[StripSight, ...]
    """BELOW, LEFT and RIGHT."""
    gaps: tuple[Gap, ...]
    distance: float = math.nan
    """
    Distance of the nearest pass from the axis, at the height of the conductors [m], NaN unknown.
    """
    angle: float = math.nan
    """Elevation of that pass as seen from the conductors [rad], NaN unknown."""
    age: float = math.nan
    """Time since the last pass within PASS [s], NaN unknown."""

    @property
    def is_enough(self) -> bool:
        """Whether all was seen well enough to rule out a hazard."""
        return not self.gaps


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Coverage:
    """Coverage of all sections."""

    sections: tuple[SectionSight, ...] = ()

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """Gaps of all sections, in their order."""
        return tuple(gap for item in self.sections for gap in item.gaps)

    @property
    def num_poor(self) -> int:
        """Number of sections where a hazard cannot be ruled out."""
        return sum(not item.is_enough for item in self.sections)


def measure_coverage(
    result: InspectionResult, points: Float64, ground: SeenGround, way: Float64 | None = None,
) -> Coverage:
    """
    Measure the coverage of the spans of a result.

    Parameters
    ----------
    result : InspectionResult
        Of the points.
    points : (N, 3) float64
        Map frame [m].
    ground : SeenGround
        Of the same points.
    way : (K, 4) float64 or None
        Time [s] and position [m] of the vehicle along its path.

    Returns
    -------
    Coverage
        Sections in the order of their first spans.

    """
    is_wire = result.classification == PointClass.WIRE
    wires = points[is_wire], result.line_id[is_wire], result.span_id[is_wire]
    seen = []
    for number, section in enumerate(find_sections(result.spans)):
        own = [
            wires[0][(wires[1] == span.line_id) & (wires[2] == span.span_id)]
            for span in section.spans
        ]
        sight = look_at_section(section, own, ground, way)
        seen.append(replace(
            sight, gaps=tuple(replace(gap, section=number) for gap in sight.gaps)
        ))
    return Coverage(sections=tuple(seen))


def look_at_section(
    section: Section, wires: Sequence[Float64], ground: SeenGround, way: Float64 | None,
) -> SectionSight:
    """
    Measure the coverage of one section.

    Parameters
    ----------
    section : Section
        As from ``find_sections``.
    wires : sequence of (M, 3) float64
        Points of each of its spans [m].
    ground : SeenGround
        Points other than wires.
    way : (K, 4) float64 or None
        As for ``measure_coverage``.

    Returns
    -------
    SectionSight

    """
    gaps, conductors = [], []
    for span, own in zip(section.spans, wires, strict=True):
        conductor, missing = _look_at_conductor(section, span, own)
        conductors.append(conductor)
        gaps += missing
    strips = []
    for part, low, high in (
        (Part.BELOW, section.right, section.left), (Part.LEFT, section.left, section.left + SIDE),
        (Part.RIGHT, section.right - SIDE, section.right),
    ):
        strip, missing = _look_at_strip(section, part, (low, high), ground)
        strips.append(strip)
        gaps += missing
    sight = SectionSight(
        section=section, conductors=tuple(conductors), strips=tuple(strips), gaps=tuple(gaps),
    )
    return sight if way is None or not len(way) else _look_at_passes(sight, way)


def _look_at_conductor(
    section: Section, span: Span, points: Float64
) -> tuple[ConductorSight, list[Gap]]:
    unit = (span.end - span.start)[:2] / max(span.length, CELL)
    x = np.sort((points[:, :2] - span.start[:2]) @ unit)
    x = np.concatenate([[0.0], x[(x > 0.0) & (x < span.length)], [span.length]])
    step = np.diff(x)
    missing = [(x[k], x[k + 1], False) for k in np.flatnonzero(step > MOST_GAP)]
    before, after = find_reach_of(section, span)
    missing += [(-before, 0.0, True)] if before > 0.0 else []
    missing += [(span.length, span.length + after, True)] if after > 0.0 else []
    gaps = []
    for low, high, is_beyond in missing:
        places = span.positions(np.linspace(low, high, 2 + int((high - low) / STEP)))
        along = section.enter(places)[:, 0]
        gaps.append(Gap(
            part=Part.CONDUCTOR, section=-1, span_id=span.span_id, line_id=span.line_id,
            low=float(along.min()), high=float(along.max()), is_beyond=is_beyond, places=places,
        ))
    total = span.length + before + after
    return ConductorSight(
        line_id=span.line_id, length=span.length,
        density=len(points) / max(span.length, CELL),
        share=1.0 - sum(high - low for low, high, _ in missing) / max(total, CELL),
        longest_gap=float(step.max()),
    ), gaps


def _look_at_strip(
    section: Section, part: Part, across: tuple[float, float], ground: SeenGround
) -> tuple[StripSight, list[Gap]]:
    num = max(math.ceil(section.high / STEP), 1)
    width = max(across[1] - across[0], CELL)
    rows, columns = max(round(width / CELL), 1), max(round(STEP / CELL), 1)
    x = (np.arange(num * columns) + 0.5) * section.high / (num * columns)
    y = across[0] + (np.arange(rows) + 0.5) * (across[1] - across[0]) / rows
    grid = np.repeat(x, rows), np.tile(y, len(x))
    seen = ground.is_seen(section.leave(*grid)).reshape(num, columns * rows)
    good: Bool = seen.mean(axis=1) >= LEAST_SHARE
    edge = np.flatnonzero(np.diff(np.concatenate([[True], good, [True]])))
    gaps = []
    for first, last in edge.reshape(-1, 2):
        low, high = first * section.high / num, last * section.high / num
        along = np.linspace(low, high, 2 + int((high - low) / STEP))
        gaps.append(Gap(
            part=part, section=-1, span_id=section.span_id, low=float(low), high=float(high),
            places=np.column_stack([
                section.leave(along, sum(across) / 2), find_heights(section, along)[:, 0],
            ]),
        ))
    return StripSight(
        part=part, share=float(good.mean()),
        longest_gap=max((gap.length for gap in gaps), default=0.0),
    ), gaps


def _look_at_passes(sight: SectionSight, way: Float64) -> SectionSight:
    """Add the viewpoints of the vehicle to the coverage of a section."""
    section = sight.section
    place = section.enter(way[:, 1:3])
    beside = (place[:, 0] >= 0.0) & (place[:, 0] <= section.high) & (np.abs(place[:, 1]) <= PASS)
    strips = tuple(
        strip if strip.part == Part.BELOW else replace(strip, is_flown=bool((
            beside & (place[:, 1] > section.left if strip.part == Part.LEFT
                      else place[:, 1] < section.right)
        ).any())) for strip in sight.strips
    )
    if not beside.any():
        return replace(sight, strips=strips)
    rows = np.flatnonzero(beside)
    across = place[rows, 1] - (section.left + section.right) / 2
    above = way[rows, 3] - find_heights(section, place[rows, 0]).mean(axis=1)
    apart = np.hypot(across, above)
    at = int(np.argmin(apart))
    return replace(
        sight, strips=strips, distance=float(apart[at]),
        angle=float(math.atan2(above[at], abs(across[at]))),
        age=float(way[:, 0].max() - way[rows, 0].max()),
    )
