# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest

from plc_inspect.config import ClusteringSettings
from plc_inspect.core.clustering.cross_section import find_skew, MOST_SKEW, SKEW_STEP
from plc_inspect.core.clustering.refinement import attempt_window, open_window
from plc_inspect.core.clustering.segments import cluster_window

HALF = 6.0
LIMITS = ClusteringSettings()


def make_row(skew, *, num=200, noise=0.045, apart=0.3, seed=0):
    """Make five conductors side by side in a window that is askew, strips a few cm apart."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-HALF, HALF, (5, num))
    y = apart * np.arange(5)[:, None] + skew * x + rng.normal(0.0, noise, (5, num))
    w = 0.04 * (x / HALF) ** 2 + rng.normal(0.0, noise / 2, (5, num))
    return x.ravel(), y.ravel(), w.ravel()


def find_all(x, y, w, method='dbscan'):
    """Return the owners that the kernel finds, and those of the attempts one by one."""
    kernel = cluster_window(
        x, y, w, 0, LIMITS.eps, 20, HALF, LIMITS.max_thickness, LIMITS.max_crowding
    )[1]
    state = open_window(len(x))
    attempts = list(attempt_window((x, y, w), state, 20, HALF, LIMITS))
    numbers = [item.number for item in attempts]
    assert len(set(zip(numbers, [item.half for item in attempts], strict=True))) == len(numbers)
    return kernel, state[0], attempts


@pytest.mark.parametrize('skew', [-0.03, -0.012, 0.0, 0.015, 0.045])
def test_the_direction_in_which_points_lie_sharpest_is_found(skew):
    x, y, w = make_row(skew)
    assert find_skew(x, y) == pytest.approx(skew, abs=1.5 * SKEW_STEP)
    assert find_skew(x, w) == 0.0


@pytest.mark.parametrize('seed', range(5))
def test_points_that_lie_nowhere_sharper_are_not_turned(seed):
    rng = np.random.default_rng(seed)
    for num in (0, 1, 4, 40, 1200):
        x, v = rng.uniform(-HALF, HALF, num), rng.normal(0.0, 0.5, num)
        assert find_skew(x, v) == 0.0
    x, y, _ = make_row(2.0 * MOST_SKEW, num=10)
    assert abs(find_skew(x, y)) <= MOST_SKEW + 1e-9


@pytest.mark.parametrize('skew', [0.0, 0.01, -0.025])
def test_conductors_side_by_side_are_told_apart_though_their_window_is_askew(skew):
    x, y, w = make_row(skew)
    kernel, owner, attempts = find_all(x, y, w)
    np.testing.assert_array_equal(kernel, owner)
    row = owner.reshape(5, -1)
    for conductor in row:
        found = np.bincount(conductor[conductor >= 0])
        assert found.max() > 0.9 * len(conductor)
    assert len({np.bincount(conductor[conductor >= 0]).argmax() for conductor in row}) == 5
    assert all(len(item.across) == len(item.chosen) == len(item.label) for item in attempts)


@pytest.mark.parametrize('crossing', [False, True])
def test_a_far_conductor_is_found_beside_one_with_sixty_times_the_points(crossing):
    rng = np.random.default_rng(4)
    near = rng.uniform(-HALF, HALF, 1000)
    far = np.linspace(-HALF, HALF, 15) / (2.0 if crossing else 1.0)
    x = np.concatenate([near, far])
    y = np.concatenate([rng.normal(0.0, 0.02, 1000), rng.normal(7.0, 0.05, 15)])
    w = np.concatenate([rng.normal(0.0, 0.02, 1000), rng.normal(3.0, 0.05, 15)])
    kernel, owner, attempts = find_all(x, y, w)
    np.testing.assert_array_equal(kernel, owner)
    assert (owner[:1000] == 0).mean() > 0.9
    assert attempts[-1].needed < attempts[0].needed
    # what does not run through the window may be anything
    assert (owner[1000:] == (-1 if crossing else 1)).mean() > 0.9


def test_a_crown_has_no_conductor_in_any_direction():
    rng = np.random.default_rng(3)
    x, y, w = rng.uniform(-HALF, HALF, 1200), *rng.normal(0.0, 0.6, (2, 1200))
    kernel, owner, _ = find_all(x, y, w)
    np.testing.assert_array_equal(kernel, owner)
    assert (owner < 0).all()
