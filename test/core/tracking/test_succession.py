# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Hazards stay with their conductor, whatever spans and numbers ticks give it."""

import itertools

import numpy as np
import pytest
from spans import make_hazard, make_result, make_span

from plc_inspect.core.tracking.hazard_tracking import HazardBook
from plc_inspect.core.tracking.span_registry import MAX_MISSES, SpanRegistry

FLAT = 5e4


class Inspection:
    """A registry and a book that take ticks as a session does."""

    def __init__(self):
        self.registry, self.book = SpanRegistry(), HazardBook()

    def tick(self, spans, hazards=(), holds=lambda points: np.ones(len(points), bool),
             expected=None):
        """Take a tick; return the hazards that were taken back as their span was gone."""
        result, points = make_result(spans, hazards)
        if expected is None:
            expected = [item.key for item in self.registry.spans]
        numbered = self.registry.update(result, points, expected)
        self.book.follow(self.registry.find_heir)
        expected = {self.registry.find_renamed(key) for key in expected}
        keys = {item.key for item in self.registry.spans if item.confirmed}
        told = {old: new for old, new in numbered.items() if new in keys}
        self.book.update(hazards, told, expected, holds)
        return self.book.keep(keys)

    @property
    def spans(self):
        """Number to rounded ends along x of the confirmed spans."""
        return {
            item.key: (round(float(item.span.start[0])), round(float(item.span.end[0])))
            for item in self.registry.spans if item.confirmed
        }


def span(start, end, line=0, number=0, y=1.0):
    return make_span((start, y, 10.0), (end, y, 10.0), line, number, c=FLAT)


def hazard(x, line=0, number=0):
    return make_hazard((x, 1.0, 7.0), line, number, from_support=15.0)


def about(low, high):
    return lambda points: (points[:, 0] > low) & (points[:, 0] < high)


@pytest.mark.parametrize(('known', 'found'), [
    ([span(0, 40, 0, 0), span(60, 100, 1, 1)], [span(0, 100, 0, 0)]),  # a gap closes
    ([span(0, 50, 0, 0), span(50, 100, 0, 1)], [span(0, 100, 0, 0)]),  # a pole was none
    ([span(0, 100, 0, 0)], [span(0, 50, 0, 0), span(50, 100, 0, 1)]),  # a pole is found
], ids=['gap', 'no pole', 'pole'])
@pytest.mark.parametrize('again', [False, True])
def test_a_hazard_goes_to_the_span_that_took_the_place_of_its_own(known, found, again):
    """Also where the tick saw it in part only, and so does not raise it anew."""
    inspection = Inspection()
    own = known[-1]
    for _ in range(9):
        inspection.tick(known, [hazard(85.0, own.line_id, own.span_id)])
    (before,) = inspection.book.hazards
    heir = found[-1]
    seen = [hazard(85.0, heir.line_id, heir.span_id)] if again else []
    for _ in range(MAX_MISSES):
        assert inspection.tick(found, seen, holds=about(40, 60)) == ()
    (after,) = inspection.book.hazards
    assert after.hazard_id == before.hazard_id
    low, high = inspection.spans[after.line_id, after.span_id]
    assert low <= 85 <= high


@pytest.mark.parametrize('found', [
    [span(0, 106, 0, 0), span(106, 160, 0, 1)], [span(0, 160, 0, 0)],
], ids=['the joint moves', 'the pole is missed'])
def test_a_part_of_a_span_does_not_take_its_place(found):
    """Of the span behind, the window holds the part near the joint."""
    inspection = Inspection()
    for _ in range(4):
        inspection.tick([span(0, 100, 0, 0), span(100, 400, 0, 1)], [hazard(300.0, 0, 1)])
    for _ in range(2 * MAX_MISSES):
        assert inspection.tick(found, holds=about(20, 80), expected=[(0, 0)]) == ()
    assert inspection.spans[0, 1] == (100, 400)
    assert inspection.spans[0, 0][0] == 0
    assert len(inspection.book.hazards) == 1


@pytest.mark.parametrize('seed', range(12))
def test_no_hazard_is_taken_back_while_its_conductor_is_there(seed):
    """Ticks of a window that moves along number all anew, and miss some of it."""
    rng = np.random.default_rng(seed)
    inspection, poles = Inspection(), np.concatenate(([0.0], np.cumsum(rng.uniform(30, 80, 6))))
    sides = 2.5 * np.arange(rng.integers(1, 4))
    places = [rng.uniform(low + 5.0, high - 5.0) for low, high in itertools.pairwise(poles)]
    vehicle = 0.0
    for _ in range(40):
        vehicle = min(vehicle + rng.uniform(5, 20), poles[-1])
        core = [item for item in inspection.registry.spans if item.span.end[0] > vehicle - 25]
        low = max(min([vehicle - 25, *(item.span.start[0] for item in core)]), 0.0)
        high = min(vehicle + 15, poles[-1])
        spans, hazards, lines = [], [], rng.permutation(len(sides))
        for side, line in zip(sides, lines, strict=True):
            cuts = [p for p in poles[1:-1] if low < p < high and rng.random() < 0.9]
            ends = [low, *cuts, high]
            first = 10 * int(rng.integers(0, 3))
            for number, (a, b) in enumerate(itertools.pairwise(ends)):
                if b - a < 6:
                    continue
                spans.append(span(a, b, int(line), first + number, 1.0 + side))
                hazards += [
                    make_hazard((x, 1.0 + side, 7.0), int(line), first + number,
                                from_support=15.0)
                    for x in places if a < x < b and rng.random() < 0.9
                ]
        gone = inspection.tick(
            spans, hazards, holds=about(vehicle - 25, high), expected=[item.key for item in core]
        )
        assert gone == ()
