# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Stages that are not run again give what they would have given."""

import dataclasses

import numpy as np
import pytest
from toys import make_line_cloud

from plc_inspect.config import Settings
from plc_inspect.core import line_finder
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.core.stage_log import Outcome, StageLog, StageMemory
from plc_inspect.setting_names import update


@pytest.fixture(scope='module')
def points():
    return make_line_cloud(half_width=10.0)[0]


def describe(lines):
    """Return what was found, bit for bit."""
    spans = [
        [np.asarray(getattr(model.span, item.name)).tolist()
         for item in dataclasses.fields(model.span)]
        for model in lines.spans.models
    ]
    points = lines.spans.line_id.tolist(), lines.clustering.segments.points.tolist()
    return repr(spans), points, lines.height.threshold


@pytest.mark.parametrize('change', [
    {}, {'height.beta': 6.0}, {'height.num_bins': 50}, {'linearity.threshold': 0.9},
    {'linearity.voxel_size': 0.4}, {'outliers.sigma': 1.0}, {'clustering.eps': 0.4},
    {'height.cell_size': 2.0}, {'catenary.min_length': 105.0}, {'segment.min_points': 10**6},
])
def test_what_is_remembered_is_what_would_be_found(points, change):
    memory = StageMemory()
    Pipeline().find_lines(points, memory)
    settings = update(Settings(), change)
    remembered = Pipeline(settings).find_lines(points, memory)
    assert describe(remembered) == describe(Pipeline(settings).find_lines(points))


def test_only_stages_behind_the_change_run_again(points, monkeypatch):
    ran = []
    for name in ('measure_surface', 'extract_high', 'measure_scales', 'find_candidates',
                 'remove_outliers', 'cluster'):
        real = getattr(line_finder, name)
        monkeypatch.setattr(
            line_finder, name,
            lambda *args, real=real, name=name, **more: ran.append(name) or real(*args, **more),
        )
    memory = StageMemory()

    def run(change):
        ran.clear()
        Pipeline(update(Settings(), change)).find_lines(points, memory)
        return list(ran)

    assert len(run({})) == 7  # candidates are level ones and steep ones
    assert run({}) == []
    assert run({'clustering.eps': 0.3}) == ['cluster']
    assert run({'outliers.sigma': 5.0}) == ['remove_outliers', 'cluster']
    assert run({'linearity.threshold': 0.9}) == [
        'find_candidates', 'find_candidates', 'remove_outliers', 'cluster',
    ]
    assert run({'height.beta': 5.0})[:2] == ['extract_high', 'measure_scales']


def test_memory_is_bounded_and_drops_what_was_unused_for_longest():
    memory = StageMemory(room=2)
    for key in 'ab':
        memory.keep('stage', key, key.upper())
    assert memory.find('stage', 'a') == 'A'
    memory.keep('stage', 'c', 'C')
    assert [memory.find('stage', key) for key in 'abc'] == ['A', None, 'C']
    assert memory.find('other', 'a') is None
    assert memory.num_found == {'stage': 3}


def test_a_second_search_takes_the_place_of_the_first_in_the_reports():
    log = StageLog()
    for kept in (1, 2):
        log.run(None, lambda: None, lambda _, kept=kept: Outcome(num_in=9, num_kept=kept))
        if kept == 1:
            before = log.reports[0]
            log.begin_again()
    assert [(item.name, item.num_kept) for item in log.reports] == [('height', 2)]
    assert log.reports[0].seconds > before.seconds
