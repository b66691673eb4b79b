# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

from itertools import pairwise

import numpy as np
import pytest
from toys import make_curve, make_route, make_wire

from plc_inspect.config import SupportSettings
from plc_inspect.core.spans.attachments import settle_ends
from plc_inspect.core.spans.layout import find_layout
from plc_inspect.core.spans.span_fit import CutCurve

SETTINGS = SupportSettings()
OFFSETS = (-6.0, -2.0, 2.0, 6.0)


def settle(curves, points):
    layout = find_layout(points, curves, (), SETTINGS)
    return layout, *settle_ends(layout, cut(layout))


def cut(layout):
    """Return the curves of a layout with their ends."""
    return [
        CutCurve(curve=curve, low=low, high=high)
        for curve, low, high in zip(layout.curves, layout.start_x, layout.end_x, strict=True)
    ]


def make_noisy_route(supports, seed):
    """Make four conductors, each with noise of its own, over given supports."""
    wires = [
        make_wire((low[0], low[1] + offset, 15.0), (high[0], high[1] + offset, 15.0), c=2500.0,
                  per_metre=1.0, noise=0.08, seed=100 * seed + 10 * number + span)
        for number, offset in enumerate(OFFSETS)
        for span, (low, high) in enumerate(pairwise(supports))
    ]
    points = np.vstack(wires)
    ends = np.cumsum([0, *map(len, wires)])
    return points, [make_curve(points, np.arange(a, b), 0.3) for a, b in pairwise(ends)]


def find_errors(layout, finals, sigma, truth):
    """Return how far along the line each end at a support is from it, and the deviation."""
    errors = []
    for number, final in enumerate(finals):
        curve, low, high = final.curve, final.low, final.high
        for side, x, station in (
            (0, low, layout.start_station[number]), (1, high, layout.end_station[number]),
        ):
            if station >= 0:
                at = curve.position(x)[0]
                place = truth[np.argmin([np.hypot(*(at[:2] - t)) for t in truth])]
                direction = layout.stations[station].direction
                unit = np.array([np.cos(direction), np.sin(direction)])
                errors.append((float((at[:2] - place) @ unit), sigma[number, side]))
    return np.array(errors)


@pytest.mark.parametrize(('supports', 'share'), [
    ([(0, 0), (230, 0), (480, 0)], 0.75),
    ([(0, 0), (200, 0), (380, 90)], 1.1),  # a turn tells where a conductor hangs by itself
])
def test_ends_are_drawn_together_and_nearer_to_the_truth(supports, share):
    before, after = [], []
    for seed in range(12):
        points, curves = make_noisy_route(supports, seed)
        truth = [np.add(supports[1], (0.0, offset)) for offset in OFFSETS]
        layout, settled, finals, sigma = settle(curves, points)
        before.append(find_errors(layout, cut(layout), sigma, truth))
        after.append(find_errors(settled, finals, sigma, truth))
    before, after = np.vstack(before), np.vstack(after)
    assert len(after) == 96
    assert np.sqrt((after[:, 0] ** 2).mean()) < share * np.sqrt((before[:, 0] ** 2).mean())
    assert (np.abs(after[:, 0]) < 1.96 * after[:, 1]).mean() > 0.85
    assert after[:, 1].mean() < 3 * np.sqrt((after[:, 0] ** 2).mean())


def test_conductors_that_hang_at_different_places_stay_there():
    shifts = (0.0, 1.2, 0.0, -1.2)
    points, curves = [], []
    for number, shift in enumerate(shifts):
        for span, (low, high) in enumerate(pairwise((0.0, 100.0 + shift, 200.0))):
            y = 4.0 * number
            points.append(make_wire((low, y, 15.0), (high, y, 15.0), c=500.0, noise=0.01,
                                    seed=10 * number + span))
            curves.append(make_curve(points[-1]))
    ends = np.cumsum([0, *map(len, points)])
    points = np.vstack(points)
    curves = [make_curve(points, np.arange(low, high)) for low, high in pairwise(ends)]
    _, settled, finals, sigma = settle(curves, points)
    assert len(settled.stations) == 1
    for number, final in enumerate(finals):
        curve, low, high = final.curve, final.low, final.high
        x = curve.position(high if settled.end_station[number] == 0 else low)[0]
        assert x[0] == pytest.approx(100.0 + shifts[round(x[1] / 4.0)], abs=0.06)
    assert sigma.max() < 0.1


def test_open_ends_stay_and_no_curves_are_no_trouble():
    points, curves = make_route([(0, 0), (90, 0)])
    layout, settled, finals, sigma = settle(curves, points)
    assert settled.stations == ()
    assert (sigma == 0).all()
    for final, start, end in zip(finals, layout.start_x, layout.end_x, strict=True):
        assert (final.low, final.high) == (start, end)
    layout, settled, finals, sigma = settle([], points)
    assert finals == []
    assert sigma.shape == (0, 2)
