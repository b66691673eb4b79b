# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The bench that moves constants: what it finds, moves and puts back."""

from dataclasses import replace
import importlib
import math
from pathlib import Path
import sys

import numpy as np
import pytest

from plc_inspect.core.clustering import clustering
from plc_inspect.core.spans import point_claims, support_points, supports

BENCH = Path(__file__).parents[2] / 'bench'


@pytest.fixture(scope='module')
def bench():
    """Import the bench as it is when it is run as a script."""
    sys.path.insert(0, str(BENCH))
    try:
        yield importlib.import_module('constants')
    finally:
        sys.path.remove(str(BENCH))


def test_numbers_and_tuples_of_them_are_found(bench):
    assert {'MIN_TOWER', 'SAME_WAY'} <= set(bench.list_constants(supports))
    assert 'POLE_SLICE' in set(bench.list_constants(support_points))
    assert 'find_structure' not in set(bench.list_constants(supports))


@pytest.mark.parametrize(('value', 'factor', 'expected'), [
    (4.0, 0.5, 2.0), (3, 0.5, 1), (3, 2.0, 6), (5, 1.4, 7), (1, 0.5, 0), ((2.0, 4), 0.5, (1.0, 2)),
])
def test_whole_numbers_stay_whole(bench, value, factor, expected):
    found = bench.scale(value, factor)
    assert found == expected
    assert type(found) is type(expected)


def test_a_constant_is_moved_wherever_it_is_known(bench):
    modules = [point_claims, support_points, supports]
    moved = bench.Moved(support_points, 'HOLD_RADIUS', modules)
    assert moved.kernels == [support_points._count_around]
    points, wire = np.array([[2.0, 0.0, 0.0]]), np.zeros(1, dtype=bool)
    found, end = np.zeros(1, dtype=np.int64), np.zeros(3)
    caches = [support_points._count_around._cache]
    assert support_points._count_around(points, wire, found, end) == 1
    moved.put(1.0, [bench.NullCache()])
    try:
        assert support_points._count_around(points, wire, found, end) == 0
    finally:
        moved.put(moved.value, caches)
    assert support_points._count_around(points, wire, found, end) == 1


def test_callers_of_a_kernel_are_compiled_with_it(bench):
    from plc_inspect.core.clustering import segment_fit, segments

    modules = [segment_fit, segments, clustering]
    found = bench.Moved(segment_fit, 'LEAST_TRIM', modules).kernels
    names = {kernel.py_func.__name__ for kernel in found}
    assert {'fit_trimmed', 'judge_clusters', 'cluster_window', '_cluster_windows'} <= names
    assert '_link' not in names


def test_harm_is_told_from_noise(bench):
    usual = bench.Figures(0.99, (5, 3), (0, 0), (0.01, 0.02))
    assert bench.find_harm(usual, usual) == ''
    assert bench.find_harm(usual, replace(usual, f1=0.986)) == ''
    assert bench.find_harm(usual, replace(usual, f1=0.98)).startswith('wire F1')
    assert bench.find_harm(usual, replace(usual, f1=math.nan)).startswith('wire F1')
    assert bench.find_harm(usual, replace(usual, found=(5, 2))) == 'supports 3 to 2'
    assert bench.find_harm(usual, replace(usual, false=(1, 0))) == 'false spans 0 to 1'
    assert bench.find_harm(usual, replace(usual, errors=(0.01, 0.05))).startswith('median')
