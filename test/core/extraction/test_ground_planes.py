# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import tracemalloc

import numpy as np
from toys import make_ground

from plc_inspect.core.extraction.ground_planes import find_planes


def test_ground_of_sites_far_apart_is_that_of_each_alone_in_little_memory():
    site = make_ground((0.0, 0.0), (40.0, 40.0), per_square_metre=5.0)
    feet = np.column_stack([np.linspace(5.0, 35.0, 7), np.linspace(30.0, 8.0, 7), np.full(7, 0.2)])
    away = np.array([60e3, 50e3, 90.0])
    points, places = np.vstack([site, site + away]), np.vstack([feet, feet + away])
    height = np.zeros(len(points), dtype=np.float32)
    alone = find_planes(site, height[: len(site)], feet)
    tracemalloc.start()
    both = find_planes(points, height, places)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 200e6
    assert np.isfinite(alone[0]).all()
    for found, expected, rise in zip(both, alone, (90.0, 0.0), strict=True):
        np.testing.assert_allclose(found, np.concatenate([expected, expected + rise]), atol=1e-9)
