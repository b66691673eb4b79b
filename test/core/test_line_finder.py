# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from toys import make_curve, make_ground, make_wire

from plc_inspect.config import Settings
from plc_inspect.core import line_finder
from plc_inspect.core.extraction.height import extract_high
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.core.spans.ground_revision import LEAST_FREED, raise_ground, revise_ground

LENGTH = 150.0
SETTINGS = Settings().height


def make_place(west, hidden, num, per_metre):
    """Make a row of wires, and ground that was not seen below the last metres of them."""
    ground = make_ground((west - 20.0, -45.0), (west + LENGTH + 20.0, 45.0), seed=0)
    x = ground[:, 0] - west
    gap = (x > LENGTH - 5.0 - hidden) & (x < LENGTH - 5.0) & (np.abs(ground[:, 1]) < 28.0)
    wires = [
        make_wire(
            (west, number - (num - 1) / 2, 14.0), (west + LENGTH, number - (num - 1) / 2, 14.0),
            c=700.0, per_metre=per_metre, seed=number,
        )
        for number in range(num)
    ]
    return np.vstack(wires), ground[~gap]


@pytest.fixture
def searches(monkeypatch):
    """Return a list to which each search of a cloud adds an item."""
    done = []
    once = line_finder._find_once

    def count(*arguments):
        done.append(len(arguments[0]))
        return once(*arguments)

    monkeypatch.setattr(line_finder, '_find_once', count)
    return done


def test_what_was_freed_stays_free_when_others_are_searched_again(searches):
    """Where nothing is low any more, wires do not lie for ground again."""
    far = np.vstack(make_place(0.0, 60.0, 15, 2.0))
    Pipeline().find_lines(far)
    num_far = len(searches)
    wires, ground = make_place(600.0, 50.0, 12, 1.5)
    own = slice(0, len(wires))
    before = extract_high(np.vstack([wires, ground]), SETTINGS)
    assert not before.high[own].all()
    searches.clear()
    alone = Pipeline().find_lines(np.vstack([wires, ground]))
    assert len(searches) < num_far
    assert alone.height.high[own].all()
    searches.clear()
    together = Pipeline().find_lines(np.vstack([wires, ground, far]))
    assert len(searches) == num_far
    assert together.height.high[own].all()


def make_two_places(num_here, num_there):
    """Make two rows of wires over ground that was not seen, with fewer points in one of them."""
    ground = make_ground((0, 0), (520, 90), height=lambda x, y: 0.0 * x + 12.0)
    hidden = np.abs(ground[:, 1] - 45.0) < 30.0
    seen, curves = [], []
    for west, num in ((0.0, num_here), (400.0, num_there)):
        wires = [
            make_wire((west, y, 12.0), (west + 120.0, y, 12.0), c=900.0) for y in range(40, 51)
        ]
        curves += [make_curve(wire) for wire in wires]
        row = np.vstack(wires)
        seen.append(row[np.random.default_rng(0).choice(len(row), num, replace=False)])
    return np.vstack([*seen, ground[~hidden]]), curves


@pytest.mark.parametrize('num_there', [0, 400])
def test_a_place_with_few_freed_points_is_not_searched_again(num_there):
    """Also where another place, far away, is: a part of a cloud does as the whole."""
    few = LEAST_FREED - 1
    points, curves = make_two_places(few, num_there)
    before = extract_high(points, SETTINGS)
    after = revise_ground(points, before, curves, SETTINGS)
    assert after.high[: few + num_there].all()
    assert not before.high[: few + num_there].any()
    risen = raise_ground(points, before, after, SETTINGS)
    if not num_there:
        assert risen is None
        return
    np.testing.assert_array_equal(risen.high[:few], before.high[:few])
    assert risen.high[few : few + num_there].all()
    here = points[:, 0] < 200.0
    np.testing.assert_array_equal(risen.height[here], before.height[here])


def test_freed_points_count_together_near_one_place_alone():
    """As many as decide, but half of them 400 m away, do not."""
    half = LEAST_FREED // 2
    points, curves = make_two_places(half, half)
    before = extract_high(points, SETTINGS)
    after = revise_ground(points, before, curves, SETTINGS)
    assert (after.high & ~before.high).sum() == 2 * half >= LEAST_FREED
    assert raise_ground(points, before, after, SETTINGS) is None


def test_all_places_with_enough_freed_points_are_searched_again():
    points, curves = make_two_places(500, 500)
    before = extract_high(points, SETTINGS)
    after = revise_ground(points, before, curves, SETTINGS)
    assert raise_ground(points, before, after, SETTINGS) is after


def test_a_crown_beyond_the_dead_end_of_a_wire_is_not_of_it():
    wire = make_wire((0.0, 0.0, 12.0), (60.0, 0.0, 12.0), parts=((0.0, 0.7),))
    height = make_wire((0.0, 0.0, 12.0), (60.0, 0.0, 12.0), noise=0.0, per_metre=100.0)
    rng = np.random.default_rng(3)
    leaves = np.column_stack([rng.uniform(46.0, 52.0, 200), *rng.uniform(-1.5, 1.5, (2, 200))])
    leaves[:2] = [[47.7, 0.0, 0.0], [51.1, 0.0, 0.0]]
    leaves[:, 2] += np.interp(leaves[:, 0], *height[:, [0, 2]].T)
    ground = make_ground((-20.0, -30.0), (80.0, 30.0))
    (span,) = Pipeline(Settings()).run(np.vstack([wire, leaves, ground])).spans
    assert span.length == pytest.approx(42.0, abs=1.5)
