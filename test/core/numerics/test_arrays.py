# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest

from plc_inspect.core.numerics.arrays import (
    count_bits,
    find_true,
    merge_ascending,
    put,
    take_rows,
)


@pytest.mark.parametrize('num', [0, 1, 15, 16, 17, 10_001])
@pytest.mark.parametrize('share', [0.0, 0.3, 1.0])
def test_it_finds_what_numpy_finds(num, share):
    mask = np.random.default_rng(num).random(num) < share
    found = find_true(mask)
    assert found.dtype == np.int64
    np.testing.assert_array_equal(found, np.flatnonzero(mask))


@pytest.mark.parametrize('dtype', [np.int32, np.int64])
def test_it_takes_what_numpy_takes(dtype):
    points = np.random.default_rng(0).normal(size=(500, 3))
    chosen = np.random.default_rng(1).integers(0, 500, 200).astype(dtype)
    np.testing.assert_array_equal(take_rows(points, chosen), points[chosen])
    assert take_rows(points, chosen[:0]).shape == (0, 3)


def test_it_puts_values_in_the_first_places():
    target = np.arange(5.0)
    put(np.array([7.0, 8.0]), target[1:])
    put(np.empty(0), target)
    assert target.tolist() == [0.0, 7.0, 8.0, 3.0, 4.0]


@pytest.mark.parametrize('sizes', [(0, 0), (0, 5), (5, 0), (40, 60)])
def test_it_merges_as_numpy_does(sizes):
    rng = np.random.default_rng(sum(sizes))
    first, second = (np.unique(rng.integers(0, 80, size)) for size in sizes)
    np.testing.assert_array_equal(merge_ascending(first, second), np.union1d(first, second))


@pytest.mark.parametrize('bits', [0, 1, 0b1011, 2**31, 2**62 + 2**40 + 1, 2**63 - 1])
def test_it_counts_the_bits_that_python_counts(bits):
    assert count_bits(np.int64(bits)) == bits.bit_count()
    assert count_bits(np.uint32(bits % 2**32)) == (bits % 2**32).bit_count()
