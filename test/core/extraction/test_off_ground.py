# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest

from plc_inspect.config import HeightSettings
from plc_inspect.core.extraction.height import extract_high
from plc_inspect.core.extraction.off_ground import gather_off_ground


def make_cloud(num=3000):
    rng = np.random.default_rng(0)
    points = rng.uniform((0.0, 0.0, 0.0), (40.0, 30.0, 0.05), (num, 3))
    points[::5, 2] += rng.uniform(1.0, 20.0, len(points[::5]))
    return points


def test_what_is_off_the_ground_is_copied_in_order_of_plan_cells():
    points = make_cloud()
    height = extract_high(points, HeightSettings())
    cloud = gather_off_ground(points, height, 2.0)
    np.testing.assert_array_equal(
        np.sort(cloud.place), np.flatnonzero(height.high | (height.height >= 2.0))
    )
    np.testing.assert_array_equal(cloud.points, points[cloud.place])
    np.testing.assert_array_equal(cloud.height.height, height.height[cloud.place])
    np.testing.assert_array_equal(cloud.height.high, height.high[cloud.place])
    np.testing.assert_array_equal(cloud.high, np.flatnonzero(cloud.height.high))
    cell = np.floor((cloud.points[:, :2] - cloud.index.origin) / cloud.index.cell_size)
    assert (np.diff(cell[:, 1] * cloud.index.shape[1] + cell[:, 0]) >= 0).all()


@pytest.mark.parametrize(('dtype', 'elsewhere'), [
    (np.int32, -1), (np.float32, np.nan), (np.float32, 0.0), (np.bool_, False),
])
def test_figures_are_put_back_to_their_points(dtype, elsewhere):
    points = make_cloud()
    cloud = gather_off_ground(points, extract_high(points, HeightSettings()), 2.0)
    values = np.random.default_rng(1).integers(-2, 3, len(cloud.place)).astype(dtype)
    if dtype == np.float32:
        values[::3] = np.nan
    expected = np.full(len(points), elsewhere, dtype=dtype)
    expected[cloud.place] = values
    found = cloud.scatter(values, elsewhere)
    assert found.dtype == dtype
    np.testing.assert_array_equal(found, expected)
