# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Compares two surveys of the same lines."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from plc_inspect.core.hazards.conductor_hazards import SURE
from plc_inspect.core.numerics.assignment import assign
from plc_inspect.core.numerics.boxes import measure_box_gap
from plc_inspect.core.numerics.disjoint_sets import unite
from plc_inspect.errors import DataError
from plc_inspect.results import Float64, Hazard, Span

MIN_COMMON = 0.5
"""
Least common part of the same span in two surveys, as a share of the shorter one.
Source: judgement; not measured.
"""
MAX_LATERAL = 1.0
"""
Greatest mean distance in plan of the same span in two surveys [m].
Source: judgement; not measured.
"""
MAX_VERTICAL = 5.0
"""
Greatest mean vertical distance of the same span in two surveys [m].
Source: judgement; not measured.
"""
JOINT = 5.0
"""
Greatest distance in plan between ends on one support [m].
Source: judgement; not measured.
"""
MAX_END = 0.3
"""
Greatest vertical distance of ends of the same span on a support seen in both surveys [m].
Source: judgement; not measured.
"""
SAME_PLACE = 3.0
"""
Greatest distance between the boxes of the same hazard in two surveys [m].
Source: judgement; not measured.
"""
NUM_STATIONS = 41
"""Positions at which two spans are compared.  Source: judgement; not measured."""
STEP = 10.0
"""
Spacing of the positions along lines by which lines near each other are found [m].
Source: numerical: any point of a line is within STEP / 2 of such a position, on both lines.
"""
LEAST_CHANGE = 0.15
"""Change of sag that is always tolerated [m].  Source: judgement; not measured."""
TIE_BREAK = 1e-3
"""
Weight of the distance between the positions of hazards, relative to that of their boxes.
Source: numerical: decides between boxes that overlap.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """A value before and after."""

    before: float
    after: float
    sigma: float
    """Standard deviation of the difference; NaN if unknown."""

    @property
    def difference(self) -> float:
        """After minus before."""
        return self.after - self.before


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpanChange:
    """One span found in both surveys."""

    before: Span
    after: Span
    common: float
    """Length of the common stretch [m]."""
    height: Change
    """Mean height of the curve over the common stretch, relative to the first survey [m]."""
    sag: Change
    """Sag of the whole span [m]; NaN if an end is open."""
    ground: Change
    """Least ground clearance [m]; NaN if unknown."""
    is_abnormal: bool
    """Whether the sag changed more than tolerated and more than errors explain."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Comparison:
    """Differences between two surveys."""

    spans: tuple[SpanChange, ...]
    lost: tuple[Span, ...]
    """Spans of the first survey that are not in the second."""
    added: tuple[Span, ...]
    kept: tuple[tuple[Hazard, Hazard], ...]
    """Hazards in both surveys, as before and after."""
    new: tuple[Hazard, ...]
    cleared: tuple[Hazard, ...]
    """Hazards that are gone where the second survey found the conductor."""
    unseen: tuple[Hazard, ...]
    """Hazards of the first survey where the second did not find the conductor."""


def compare_surveys(
    before: Sequence[Span], after: Sequence[Span], hazards_before: Sequence[Hazard],
    hazards_after: Sequence[Hazard], *, sag_deviation: float,
) -> Comparison:
    """
    Match the spans and hazards of two surveys, and compute the differences.

    Parameters
    ----------
    before, after : sequence of Span
        Spans in one frame; numbers of lines and spans may differ.
    hazards_before, hazards_after : sequence of Hazard
        Hazards of the same surveys.
    sag_deviation : float
        Tolerated change of sag, as a share of the sag before.

    Returns
    -------
    Comparison

    Raises
    ------
    DataError
        The surveys have no span in common.

    """
    pairs = match_spans(before, after)
    if not pairs:
        raise DataError(
            f'the surveys do not overlap: none of {len(before)} spans before is one of'
            f' {len(after)} after'
        )
    spans = tuple(_compare(before[i], after[j], sag_deviation) for i, j in pairs)
    firsts, seconds = {i for i, _ in pairs}, {j for _, j in pairs}
    kept, gone, new = _match_hazards(hazards_before, hazards_after)
    seen = _find_seen(gone, before, after)
    return Comparison(
        spans=spans,
        lost=tuple(span for i, span in enumerate(before) if i not in firsts),
        added=tuple(span for j, span in enumerate(after) if j not in seconds),
        kept=kept,
        new=new,
        cleared=tuple(item for i, item in enumerate(gone) if i in seen),
        unseen=tuple(item for i, item in enumerate(gone) if i not in seen),
    )


def match_spans(before: Sequence[Span], after: Sequence[Span]) -> list[tuple[int, int]]:
    """
    Return the pairs of spans that are the same: one to one, at the least total distance.

    Parameters
    ----------
    before, after : sequence of Span
        In one frame.

    Returns
    -------
    list of tuple of int
        Indices into ``before`` and ``after``.

    """
    marks = [[_mark(span.start[:2], span.end[:2]) for span in own] for own in (before, after)]
    pairs, costs = [], []
    for i, j in _find_near(marks[0], marks[1], MAX_LATERAL):
        first, second = before[i], after[j]
        common = _overlay(first, second)
        if common is None:
            continue
        lateral, vertical = (float(np.abs(value).mean()) for value in common[1:])
        held = _are_held_alike(first, second)
        if held and lateral <= MAX_LATERAL and vertical <= MAX_VERTICAL:
            pairs.append((i, j))
            costs.append(math.hypot(lateral, vertical))
    return _assign(pairs, costs)


def _mark(start: Float64, end: Float64) -> Float64:
    """Return positions in plan along a line, at most STEP apart, with both ends."""
    num = math.ceil(float(np.linalg.norm(end - start)) / STEP) + 1
    return np.linspace(start, end, max(num, 2))


def _find_near(
    before: Sequence[Float64], after: Sequence[Float64], distance: float
) -> list[tuple[int, int]]:
    """Return the pairs of lines, given by `_mark`, that may be within a distance in plan."""
    if not before or not after:
        return []
    from scipy.spatial import cKDTree  # imported here, as it takes a moment

    owners = [np.repeat(np.arange(len(own)), [len(line) for line in own])
              for own in (before, after)]
    trees = [cKDTree(np.concatenate(own)) for own in (before, after)]
    found = trees[0].sparse_distance_matrix(
        trees[1], distance + STEP, output_type='coo_matrix'
    )
    pairs = np.column_stack([owners[0][found.row], owners[1][found.col]])
    return [(int(i), int(j)) for i, j in np.unique(pairs, axis=0).tolist()]


def _mark_box(extent: Float64) -> Float64:
    """Return positions in plan over a box, at most STEP apart along its sides."""
    x, y = (_mark(extent[:1, axis], extent[1:, axis])[:, 0] for axis in (0, 1))
    return np.column_stack([np.tile(x, len(y)), np.repeat(y, len(x))])


def _assign(pairs: Sequence[tuple[int, int]], costs: Sequence[float]) -> list[tuple[int, int]]:
    """Choose pairs one to one at the least total cost, in each connected group by itself."""
    if not pairs:
        return []
    first, second = (np.unique(own, return_inverse=True) for own in np.array(pairs).T)
    links = np.column_stack([first[1], len(first[0]) + second[1]])
    root = np.asarray(unite(links.tolist(), len(first[0]) + len(second[0])))[links[:, 0]]
    order = np.argsort(root, kind='stable')
    result = []
    for own in np.split(order, np.flatnonzero(np.diff(root[order])) + 1):
        rows, row = np.unique(first[1][own], return_inverse=True)
        columns, column = np.unique(second[1][own], return_inverse=True)
        cost = np.full((len(rows), len(columns)), np.inf)
        cost[row, column] = np.array(costs)[own]
        result += [
            (int(first[0][rows[i]]), int(second[0][columns[j]])) for i, j in assign(cost)
        ]
    return sorted(result)


def _overlay(first: Span, second: Span) -> tuple[float, Float64, Float64] | None:
    """Return the common length, and the second span's offsets beside and above the first [m]."""
    unit = (first.end - first.start)[:2] / first.length
    ends = np.array([second.start, second.end])[:, :2] - first.start[:2]
    low, high = np.sort(ends @ unit)
    low, high = max(float(low), 0.0), min(float(high), first.length)
    if high - low < MIN_COMMON * min(first.length, second.length):
        return None
    at = first.positions(np.linspace(low, high, NUM_STATIONS))
    along = (second.end - second.start)[:2] / second.length
    moved = at[:, :2] - second.start[:2]
    x = np.clip(moved @ along, 0.0, second.length)
    other = second.positions(x)
    lateral = moved @ np.array([-along[1], along[0]])
    return high - low, lateral, other[:, 2] - at[:, 2]


def _are_held_alike(first: Span, second: Span) -> bool:
    """Tell whether ends on a support in both surveys are at the same height."""
    ends = [(span.start, span.open_start) for span in (first, second)]
    others = [(span.end, span.open_end) for span in (first, second)]
    if math.dist(first.start[:2], second.start[:2]) > math.dist(first.start[:2], second.end[:2]):
        ends[1], others[1] = others[1], ends[1]
    return all(
        one_open or other_open or abs(float(one[2] - other[2])) <= MAX_END
        or math.dist(one[:2], other[:2]) > JOINT
        for (one, one_open), (other, other_open) in (ends, others)
    )


def _compare(before: Span, after: Span, sag_deviation: float) -> SpanChange:
    overlay = _overlay(before, after)
    length, lift = (overlay[0], overlay[2]) if overlay else (0.0, np.zeros(1))
    sigma = math.hypot(before.sigma['sag'], after.sigma['sag'])
    noise = math.hypot(
        before.rmse / math.sqrt(max(before.num_points, 1)),
        after.rmse / math.sqrt(max(after.num_points, 1)),
    )
    is_open = before.open_start or before.open_end or after.open_start or after.open_end
    sag = Change(
        before=math.nan if is_open else before.sag,
        after=math.nan if is_open else after.sag,
        sigma=sigma,
    )
    tolerated = max(sag_deviation * before.sag, LEAST_CHANGE)
    return SpanChange(
        before=before,
        after=after,
        common=length,
        height=Change(before=0.0, after=float(lift.mean()), sigma=noise),
        sag=sag,
        ground=Change(
            before=before.ground_clearance, after=after.ground_clearance, sigma=sigma,
        ),
        is_abnormal=abs(sag.difference) > tolerated + SURE * sigma,
    )


def _match_hazards(
    before: Sequence[Hazard], after: Sequence[Hazard]
) -> tuple[tuple[tuple[Hazard, Hazard], ...], list[Hazard], tuple[Hazard, ...]]:
    """Return pairs of the same hazard, hazards that are gone, and new ones."""
    near = find_same_place(before, after)
    pairs = _assign([(i, j) for i, j, _ in near], [
        apart + TIE_BREAK * math.dist(before[i].position, after[j].position)
        for i, j, apart in near
    ])
    firsts, seconds = {i for i, _ in pairs}, {j for _, j in pairs}
    return (
        tuple((before[i], after[j]) for i, j in pairs),
        [item for i, item in enumerate(before) if i not in firsts],
        tuple(item for j, item in enumerate(after) if j not in seconds),
    )


def find_same_place(
    before: Sequence[Hazard], after: Sequence[Hazard]
) -> list[tuple[int, int, float]]:
    """
    Return all pairs of hazards of one kind at one place, with the gap between their boxes.

    Parameters
    ----------
    before, after : sequence of Hazard
        In one frame.

    Returns
    -------
    list of tuple
        Indices into ``before`` and ``after``, and the gap [m]; a hazard may be in many pairs.

    """
    marks = [[_mark_box(item.extent) for item in own] for own in (before, after)]
    result = []
    for i, j in _find_near(marks[0], marks[1], SAME_PLACE + STEP):
        if before[i].kind == after[j].kind:
            apart = measure_box_gap(before[i].extent, after[j].extent)
            if apart <= SAME_PLACE:
                result.append((i, j, apart))
    return result


def _find_seen(
    gone: Sequence[Hazard], before: Sequence[Span], after: Sequence[Span]
) -> set[int]:
    """Return which hazards of the first survey are where the second found the conductor."""
    own = {(span.line_id, span.span_id): span for span in before}
    rows = [i for i, item in enumerate(gone) if (item.line_id, item.span_id) in own
            and math.isfinite(item.along_span)]
    places = [
        own[gone[i].line_id, gone[i].span_id].positions(np.array([gone[i].along_span]))
        for i in rows
    ]
    seen = set()
    marks = [_mark(span.start[:2], span.end[:2]) for span in after]
    for k, j in _find_near([place[:, :2] for place in places], marks, SAME_PLACE):
        span = after[j]
        unit = (span.end - span.start)[:2] / span.length
        moved = places[k][0, :2] - span.start[:2]
        x, lateral = float(moved @ unit), float(moved @ np.array([-unit[1], unit[0]]))
        lift = float(span.heights(np.array([x]))[0] - places[k][0, 2])
        if (
            -SAME_PLACE <= x <= span.length + SAME_PLACE
            and abs(lateral) <= MAX_LATERAL and abs(lift) <= MAX_VERTICAL
        ):
            seen.add(rows[k])
    return seen
