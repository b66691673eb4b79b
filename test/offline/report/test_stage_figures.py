# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The figures of the report that show what a stage decided by."""

import re
import xml.etree.ElementTree as ElementTree

from factories import make_inspection
import pytest
from toys import make_line_cloud

from plc_inspect.core.pipeline import Pipeline
from plc_inspect.core.tracking.wire_points import WirePoints
from plc_inspect.offline.report.point_scene import make_scene
from plc_inspect.offline.report.stage_figures import draw_residuals, draw_stage
from plc_inspect.results import StageReport


def test_histograms_show_the_threshold():
    stages = Pipeline().run(make_line_cloud(half_width=15.0)[0]).stages
    drawn = {stage.name: draw_stage(stage) for stage in stages}
    assert {name for name, (figure, _) in drawn.items() if figure} == {'height', 'linearity'}
    for stage in stages[:2]:
        figure, caption = drawn[stage.name]
        ElementTree.fromstring(figure)
        assert f'threshold {stage.values["threshold"]:.3g}' in figure
        assert 'threshold' in caption
        assert len(figure) < 10_000
    linearity = stages[1].values
    assert sum(linearity['likeness_of_all'][17:]) >= stages[1].num_kept
    assert len(linearity['likeness_of_all']) == 20


@pytest.mark.parametrize('stage', [
    StageReport(name='height', num_in=0, num_kept=0, values={'threshold': None}),
    StageReport(name='height', num_in=0, num_kept=0, values={
        'threshold': 4.0, 'histogram': [0, 0], 'edges': [0.0, 1.0]}),
    StageReport(name='linearity', num_in=0, num_kept=0),
    StageReport(name='hazards', num_in=0, num_kept=0),
])
def test_nothing_is_drawn_of_nothing(stage):
    assert draw_stage(stage) == ('', '')


def test_residuals_are_those_of_the_spans():
    inspection = make_inspection()
    scene = make_scene(inspection)
    wires = WirePoints(inspection.result, inspection.points)
    figure = draw_residuals(scene, inspection.result, wires, 0)
    ElementTree.fromstring(figure)
    ticks = [float(text.replace('\u2212', '-')) for text in
             re.findall(r'class="tick end"[^>]*>([^<]*)<', figure)]
    assert ticks == [-0.1, 0.0, 0.1]  # the noise of the points is 0.02 m
    assert draw_residuals(scene, inspection.result, wires, 7) == ''
