# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Sorting by buckets against numpy's stable sort."""

import hypothesis
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from plc_inspect.core.numerics.sorting import argsort_spread, MOST_IN_BUCKET

NUMBERS = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False, width=64),
    st.floats(-10.0, 10.0),
    st.sampled_from([0.0, -0.0, 1.0, 1e-12, -1e-12, 5.0]),
)


@hypothesis.settings(deadline=None)
@given(values=st.lists(NUMBERS, max_size=60))
def test_equals_a_stable_sort(values):
    values = np.array(values, dtype=np.float64)
    assert argsort_spread(values).tolist() == np.argsort(values, kind='stable').tolist()


@hypothesis.settings(deadline=None)
@given(values=st.lists(st.integers(-2**40, 2**40), max_size=60))
def test_whole_numbers_equal_a_stable_sort(values):
    values = np.array(values, dtype=np.int64)
    assert argsort_spread(values).tolist() == np.argsort(values, kind='stable').tolist()


@pytest.mark.parametrize('crowd', [MOST_IN_BUCKET // 4, 20 * MOST_IN_BUCKET])
def test_values_in_crowds_and_far_apart(crowd):
    rng = np.random.default_rng(0)
    values = np.concatenate([rng.normal(place, 1e-3, crowd) for place in (0.0, 0.5, 1e6)])
    values = np.round(rng.permutation(values), 3)  # many are the same
    assert argsort_spread(values).tolist() == np.argsort(values, kind='stable').tolist()


@pytest.mark.parametrize('odd', [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_sorted_as_well(odd):
    values = np.append(np.random.default_rng(1).normal(size=300), odd)
    order = argsort_spread(values)
    assert sorted(order.tolist()) == list(range(301))
    if not np.isnan(odd):
        assert (np.diff(values[order]) >= 0).all()
