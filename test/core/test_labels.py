# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

from types import SimpleNamespace

import numpy as np
import pytest

from plc_inspect.core.labels import choose_surroundings, GROUND_BAND


@pytest.mark.parametrize('num', [0, 1, 17, 5000])
def test_surroundings_are_off_the_ground_and_belong_to_no_line(num):
    rng = np.random.default_rng(num)
    total = 2 * num
    height = rng.uniform(0.0, 3.0 * GROUND_BAND, total).astype(np.float32)
    height[::7] = np.nan
    spans = SimpleNamespace(
        line_id=rng.integers(-3, 2, total).clip(-1).astype(np.int32),
        support=rng.uniform(size=total) < 0.1,
        intruders=rng.permutation(total)[: total // 10],
    )
    near = np.sort(rng.permutation(total)[:num])
    corridor = SimpleNamespace(
        near=near,
        near_distance=rng.uniform(0.0, 20.0, num).astype(np.float32),
        near_span=rng.integers(0, 9, num).astype(np.int32),
    )
    around = ~(height[near] < GROUND_BAND) & (spans.line_id[near] < 0) & ~spans.support[near]
    around &= ~np.isin(near, spans.intruders)
    found = choose_surroundings(height, spans, corridor)
    fields = found.index, found.distance, found.span
    for own, expected in zip(
        fields, (near, corridor.near_distance, corridor.near_span), strict=True
    ):
        np.testing.assert_array_equal(own, expected[around])
    assert [own.dtype for own in fields] == [np.int64, np.float64, np.int64]
