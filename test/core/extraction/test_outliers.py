# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest

from plc_inspect.config import OutlierSettings
from plc_inspect.core.extraction.outliers import remove_outliers
from plc_inspect.errors import ConfigError


def measure_mean_distance(positions, num):
    distance = np.linalg.norm(positions[:, None] - positions[None], axis=2)
    return np.sort(distance, axis=1)[:, 1:num + 1].mean(axis=1)


def test_toy_case_by_hand():
    positions = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [100, 0, 0]])
    # mean distance to two others: 1.5 1 1 1.5 97.5
    result = remove_outliers(positions, OutlierSettings(num_neighbors=2, sigma=1.5))
    assert result.mean == pytest.approx(20.5)
    assert result.sigma == pytest.approx(np.std([1.5, 1, 1, 1.5, 97.5]))
    assert result.threshold == pytest.approx(result.mean + 1.5 * result.sigma)
    assert result.keep.tolist() == [True, True, True, True, False]


def test_against_brute_force():
    rng = np.random.default_rng(0)
    positions = np.vstack([rng.normal(size=(300, 3)), rng.uniform(-60, 60, (6, 3))])
    settings = OutlierSettings(num_neighbors=5, sigma=2.0)
    result = remove_outliers(positions, settings)
    mean = measure_mean_distance(positions, 5)
    assert result.mean == pytest.approx(mean.mean())
    np.testing.assert_array_equal(result.keep, mean <= mean.mean() + 2.0 * mean.std())
    assert 0 < (~result.keep).sum() < 10


@pytest.mark.parametrize('num', [0, 1, 8])
def test_too_few_to_judge_are_kept(num):
    result = remove_outliers(np.random.default_rng(0).normal(size=(num, 3)), OutlierSettings())
    assert result.keep.shape == (num,)
    assert result.keep.dtype == np.bool_
    assert result.keep.all()
    assert result.threshold == np.inf


def test_few_of_many_are_far_from_the_others():
    """In a part of a cloud, the neighbours that are missing lie beyond its edge."""
    positions = np.random.default_rng(0).normal(size=(8, 3))
    assert not remove_outliers(positions, OutlierSettings(), (1.0, 0.5)).keep.any()
    assert remove_outliers(positions[:0], OutlierSettings(), (1.0, 0.5)).keep.shape == (0,)


def test_duplicates_are_kept_and_the_limit_is_inclusive():
    result = remove_outliers(np.ones((20, 3)), OutlierSettings())
    assert result.keep.all()
    assert result.threshold == 0.0


def test_order_translation_and_yaw_do_not_matter():
    rng = np.random.default_rng(1)
    positions = np.vstack([rng.normal(size=(200, 3)), rng.uniform(-60, 60, (6, 3))])
    keep = remove_outliers(positions, OutlierSettings()).keep
    order = rng.permutation(len(positions))
    np.testing.assert_array_equal(remove_outliers(positions[order], OutlierSettings()).keep,
                                  keep[order])
    moved = positions[:, [1, 0, 2]] * [-1, 1, 1] + [5e5, 6.6e6, 100.0]
    np.testing.assert_array_equal(remove_outliers(moved, OutlierSettings()).keep, keep)


def test_a_greater_sigma_keeps_more():
    rng = np.random.default_rng(2)
    positions = rng.standard_t(2.0, size=(500, 3))
    kept = [
        int(remove_outliers(positions, OutlierSettings(sigma=sigma)).keep.sum())
        for sigma in (0.5, 1.0, 2.0, 4.0, 20.0)
    ]
    assert kept == sorted(kept)
    assert kept[0] < kept[2] < kept[4]


def test_input_is_unchanged():
    positions = np.random.default_rng(0).normal(size=(50, 3))
    before = positions.copy()
    remove_outliers(positions, OutlierSettings())
    np.testing.assert_array_equal(positions, before)


@pytest.mark.parametrize('change', [{'sigma': 0.0}, {'num_neighbors': 0}, {'sigma': True}])
def test_bad_settings(change):
    with pytest.raises(ConfigError, match=next(iter(change))):
        OutlierSettings(**change)
