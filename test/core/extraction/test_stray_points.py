# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest

from plc_inspect.core.extraction.stray_points import leave_out_strays, MOST_STRAYS
from plc_inspect.core.live.warm_up import make_sample
from plc_inspect.core.pipeline import Pipeline


def make_site(num=20_000, at=(0.0, 0.0, 0.0), size=400.0, seed=0):
    """Return points of a site."""
    return np.array(at) + np.random.default_rng(seed).uniform(0, size, (num, 3)) * [1, 1, 0.05]


@pytest.mark.parametrize('place', [
    (100e3, 0, 0), (0, -3000, 0), (0, 0, 100e3), (1e8, 1e8, -1e8), (1e5, 1e7, 5),
])
@pytest.mark.parametrize('num', [1, 7])
def test_strays_are_left_out_and_counted(place, num):
    site = make_site()
    strays = np.array(place) + np.random.default_rng(1).uniform(0, 1, (num, 3))
    points = np.concatenate((site[:100], strays, site[100:]))
    given = points.copy()
    found, count = leave_out_strays(points)
    assert count == num
    np.testing.assert_array_equal(points, given)
    assert np.isnan(found[100 : 100 + num]).all()
    np.testing.assert_array_equal(np.delete(found, range(100, 100 + num), axis=0), site)


def test_strays_at_several_distances():
    points = np.concatenate((make_site(), [[1e8, 0, 0], [1e6, 0, 0], [3e4, 0, 0], [0, 2e3, 0]]))
    found, count = leave_out_strays(points)
    assert count == 4
    assert np.isnan(found[-4:]).all()


@pytest.mark.parametrize('points', [
    np.empty((0, 3)),
    np.full((5, 3), np.nan),
    np.array([[1.0, 2.0, 3.0]]),
    np.array([[0.0, 0.0, 0.0], [1e6, 0.0, 0.0]]),
    make_site(size=5000.0),
    np.concatenate((make_site(), make_site(num=MOST_STRAYS + 101, at=(5e3, 0, 0)))),
    np.concatenate((make_site(num=300), make_site(num=30, at=(5e3, 0, 0)))),
])
def test_groups_that_may_be_meant_stay(points):
    found, count = leave_out_strays(points)
    assert found is points
    assert count == 0


def test_order_of_points_does_not_matter():
    points = np.concatenate((make_site(), [[1e5, 0, 0], [0, 2e3, 0]]))
    order = np.random.default_rng(2).permutation(len(points))
    np.testing.assert_array_equal(leave_out_strays(points)[0][order],
                                  leave_out_strays(points[order])[0])


@pytest.mark.parametrize('stray', [(70e3, 70e3, 0.0), (-9e3, 100e3, -50.0), (5e6, 5e6, 5e6)])
def test_one_stray_point_changes_nothing(stray):
    """One point 100 km away made ground clearances 0.6 to 0.9 m too large."""
    points = make_sample()
    slope = points + np.array([0.0, 0.0, 1.0]) * (0.2 * points[:, :1])
    expected = Pipeline().run(slope)
    result = Pipeline().run(np.concatenate((slope, [stray])))
    assert len(result.spans) == 6
    for found, span in zip(result.spans, expected.spans, strict=True):
        assert found.ground_clearance == pytest.approx(span.ground_clearance, abs=1e-6)
        assert found.sag == pytest.approx(span.sag, abs=1e-6)
    assert result.stages[0].dropped['isolated, far away'] == 1
