# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The bench of random scenes: what it counts, on scenes whose result is known."""

from dataclasses import replace
import importlib
import math
from pathlib import Path
import sys

import pytest

from plc_inspect.errors import DataError

BENCH = Path(__file__).parents[2] / 'bench'


@pytest.fixture(scope='module')
def bench():
    """Import the bench as it is when it is run as a script."""
    sys.path.insert(0, str(BENCH))
    try:
        yield importlib.import_module('random_scenes')
    finally:
        sys.path.remove(str(BENCH))


@pytest.fixture(scope='module')
def made(bench):
    """Make a small scene."""
    return bench.make_random(6, 'clean')


@pytest.fixture(scope='module')
def result(bench, made):
    """Run the pipeline on it."""
    return bench.run(made)[0]


def test_shares_are_those_of_the_labels(bench, made, result):
    whole = replace(result, classification=made.cloud.label)
    item = bench.judge(6, made, whole, 0.0)
    assert item.f1 == 1.0
    assert item.shares
    assert set(item.shares) == {1.0}
    none = replace(result, classification=0 * made.cloud.label, spans=())
    item = bench.judge(6, made, none, 0.0)
    assert (item.f1, item.found, item.false) == (0.0, 0, 0)
    assert set(item.shares) == {0.0}
    assert 'not at all' in dict(bench.sum_up([item]))['conductor-spans, all']


def test_a_scene_without_a_result_counts_as_missed(bench, made, result, monkeypatch):
    def fail(scene):
        raise DataError('two spans of line 0 have the number 0')

    monkeypatch.setattr(bench, 'run', fail)
    item = bench.try_seed(6, 'clean')
    good = bench.judge(6, made, result, 0.0)
    assert (item.f1, item.found, item.required) == (0.0, 0, good.required)
    assert item.shares == (0.0,) * len(good.shares)
    assert item.clean == good.clean
    assert 'two spans' in bench.describe(item)[9]


def test_the_worst_come_first(bench, made, result):
    good = bench.judge(6, made, result, 0.0)
    items = [
        replace(good, seed=1, f1=0.9), replace(good, seed=2, f1=math.nan, false=3),
        replace(good, seed=3, f1=math.nan, false=0), replace(good, seed=4, f1=0.5),
    ]
    assert [item.seed for item in sorted(items, key=lambda item: item.rank)] == [2, 4, 1, 3]


@pytest.mark.slow
def test_seeds_are_run_and_the_worst_are_drawn(bench, tmp_path, capsys):
    arguments = ['--seeds', '6:7', '--kind', 'clean', '--pictures', str(tmp_path)]
    assert bench.main(arguments) == 0
    text = capsys.readouterr().out
    assert 'true sag in its 95 % interval' in text
    assert (tmp_path / 'clean_6.png').stat().st_size > 10_000


def test_ranges_and_lists_of_seeds(bench):
    assert bench.parse_seeds('3:6') == (3, 4, 5)
    assert bench.parse_seeds('7,2') == (7, 2)
