# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The frame of a cloud: turned or moved, a cloud gives the same result."""

import math

import numpy as np
import pytest
from toys import make_line_cloud, make_tree, turn

from plc_inspect.config import Settings
from plc_inspect.core.cloud_frame import CloudFrame, find_cloud_frame, OBLIQUE
from plc_inspect.core.live.session import Session
from plc_inspect.core.live.window import Window
from plc_inspect.core.pipeline import Pipeline

SHIFT = np.array([500_123.4, 4_000_321.9, 512.3])


@pytest.fixture(scope='module')
def cloud():
    """Make a line on poles with a tree below it, towards the south-east."""
    points, _ = make_line_cloud(
        spans=(60.0, 50.0), per_metre=12.0, more=[make_tree(35.0, 1.0, 14.0, radius=2.0)]
    )
    return turn(points, -0.6)


@pytest.fixture(scope='module')
def result(cloud):
    """Inspect it."""
    return Pipeline().run(cloud)


@pytest.mark.parametrize('azimuth', [0.3, -2.0, math.pi / 2, math.pi])
@pytest.mark.parametrize('shift', [np.zeros(3), SHIFT])
def test_a_turned_cloud_is_the_same_in_its_frame(azimuth, shift):
    rng = np.random.default_rng(4)
    points = rng.gamma(2.0, (9.0, 4.0, 1.0), (500, 3))
    points[7] = np.nan
    points[9, 1] = np.inf
    points[11] = 1e300
    kept = np.abs(points).max(axis=1) < 1e8
    own = find_cloud_frame(points).enter(points)
    moved = turn(points, azimuth, shift)
    again = find_cloud_frame(moved).enter(moved)
    np.testing.assert_allclose(again[kept], own[kept], atol=1e-7)
    np.testing.assert_allclose(own[kept].mean(axis=0), 0.0, atol=1e-9)
    axis = np.linalg.eigh(np.cov(own[kept][:, :2].T))[1][:, 1]
    assert math.remainder(math.atan2(axis[1], axis[0]) - OBLIQUE, math.pi) == pytest.approx(0.0)
    unit = np.array([math.cos(OBLIQUE), math.sin(OBLIQUE)])
    assert ((own[kept][:, :2] @ unit) ** 3).mean() > 0.0


def test_what_enters_leaves_again():
    frame = CloudFrame(origin=SHIFT, azimuth=2.2)
    points = np.random.default_rng(0).normal(0.0, 50.0, (20, 3)) + SHIFT
    np.testing.assert_allclose(frame.leave(frame.enter(points)), points, atol=1e-9)
    np.testing.assert_allclose(frame.leave(frame.enter(points)[3]), points[3], atol=1e-9)
    along = SHIFT + np.array([math.cos(2.2), math.sin(2.2), 0.0])
    np.testing.assert_allclose(frame.enter(along[None]), [[1.0, 0.0, 0.0]], atol=1e-9)


@pytest.mark.parametrize('points', [np.zeros((0, 3)), np.full((3, 3), np.nan), np.ones((1, 3))])
def test_few_points_have_a_frame(points):
    frame = find_cloud_frame(points)
    assert np.isfinite([*frame.origin, frame.azimuth]).all()
    assert frame.enter(points).shape == points.shape


@pytest.mark.parametrize('azimuth', [math.pi / 2, 0.7])  # it still runs eastwards
def test_a_turned_cloud_gives_the_same_result(cloud, result, azimuth):
    assert len(result.spans) == 6
    assert result.hazards
    assert result.spans[0].sag == pytest.approx(60.0**2 / 8 / 800, abs=0.05)
    moved = turn(cloud, azimuth, SHIFT)
    again = Pipeline().run(moved)
    np.testing.assert_array_equal(again.line_id, result.line_id)
    np.testing.assert_array_equal(again.decision, result.decision)
    np.testing.assert_array_equal(again.classification, result.classification)
    for span, other in zip(result.spans, again.spans, strict=True):
        for name in ('start', 'end', 'lowest'):
            place = turn(getattr(span, name)[None], azimuth, SHIFT)[0]
            np.testing.assert_allclose(getattr(other, name), place, atol=1e-3)
        x = np.linspace(0.0, span.length, 5)
        np.testing.assert_allclose(other.heights(x), span.heights(x) + SHIFT[2], atol=1e-3)
        quadratic = np.polyval(other.quadratic, x) - np.polyval(span.quadratic, x)
        np.testing.assert_allclose(quadratic, SHIFT[2], atol=1e-3)
        run = (other.end - other.start)[:2]
        assert other.azimuth == pytest.approx(math.atan2(run[1], run[0]), abs=1e-5)
    for support, other in zip(result.supports, again.supports, strict=True):
        place = turn(support.position[None], azimuth, SHIFT)[0]
        np.testing.assert_allclose(other.position, place, atol=1e-3)
    for hazard, other in zip(result.hazards, again.hazards, strict=True):
        assert other.clearance == pytest.approx(hazard.clearance, abs=1e-3)
        np.testing.assert_allclose(
            other.position, turn(hazard.position[None], azimuth, SHIFT)[0], atol=1e-3
        )
        assert (other.extent[0] <= other.position + 1e-6).all()
        if azimuth == math.pi / 2:
            box = turn(hazard.extent, azimuth, SHIFT)
            np.testing.assert_allclose(
                other.extent, [box.min(axis=0), box.max(axis=0)], atol=1e-3
            )


def test_the_extent_is_that_of_offending_points(cloud, result):
    hazard = max(result.hazards, key=lambda item: item.num_points)
    inside = ((cloud >= hazard.extent[0] - 1e-6) & (cloud <= hazard.extent[1] + 1e-6)).all(axis=1)
    assert inside.sum() >= hazard.num_points > 0
    np.testing.assert_allclose(cloud[inside].min(axis=0), hazard.extent[0], atol=1e-6)
    np.testing.assert_allclose(cloud[inside].max(axis=0), hazard.extent[1], atol=1e-6)


def test_a_turned_tick_gives_the_same_lines(cloud):
    found = []
    for azimuth in (0.0, 1.1):  # both towards the east, from which lines are numbered
        session, moved = Session(), turn(cloud, azimuth, SHIFT)
        for share in (0.7, 1.0):  # the frame of the first window is held
            num = int(share * len(moved))
            cells = np.unique(np.floor(moved[:, :2] / 8.0).astype(np.int64), axis=0)
            tick = session.tick(
                Window(
                    slots=np.arange(num), points=moved[:num], fresh=cells, cell_size=8.0,
                    spans=frozenset(), sequence=num,
                ),
                Settings(), moved[0],
            )
        found.append((tick.labels, [item.span.sag for item in tick.state.spans]))
    assert len(found[0][1]) == 6
    np.testing.assert_array_equal(found[1][0], found[0][0])
    np.testing.assert_allclose(found[1][1], found[0][1], atol=1e-3)  # thinned in the map
