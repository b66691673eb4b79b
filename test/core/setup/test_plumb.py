# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Whether a map stands upright: lines on poles that stand straight, lean or are tilted."""

from dataclasses import replace

import numpy as np
import pytest
from spans import make_result, make_span, make_support, sample_points

from plc_inspect.config import Settings
from plc_inspect.core.live.session import Session
from plc_inspect.core.live.warm_up import make_sample
from plc_inspect.core.setup.plumb import find_lean, Leans, measure_leans, PlumbBook
from plc_inspect.core.setup.sharpness import Sharpness
from plc_inspect.core.setup.transforms import make_transform
from plc_inspect.offline.commands.survey import survey
from plc_inspect.offline.report.report import render_report
from plc_inspect.offline.terminal.result_table import render_summary
from plc_inspect.results import PointClass

SPAN, HEIGHT = 90.0, 10.0
SHARP = Sharpness(num_cells=100, blur=0.4)


def make_line(num_poles=3, tilt=(0.0, 0.0), swing=0.0, leans=None, constant=450.0, seed=0):
    """
    Measure a line along x that is tilted, its poles and conductors beside that [degrees].

    ``tilt`` is about x and y, ``leans`` (P, 2) are those of the poles.
    """
    rng = np.random.default_rng(seed)
    turn = make_transform((0.0, 0.0, 0.0), (*tilt, 0.0))[:3, :3]
    feet = np.array([(SPAN * k, 0.0, 0.0) for k in range(num_poles)])
    leans = np.zeros((num_poles, 2)) if leans is None else np.asarray(leans)
    spans = [
        make_span((x, y, HEIGHT), (x + SPAN, y, HEIGHT), line_id=n, span_id=k, c=constant)
        for k, x in enumerate(feet[:-1, 0]) for n, y in enumerate((-1.0, 0.0, 1.0))
    ]
    result, _ = make_result(spans, supports=[
        make_support(turn @ foot, support_id=k, height=HEIGHT) for k, foot in enumerate(feet)
    ])
    wires = [sample_points(item) for item in result.spans]
    for wire in wires:
        wire[:, 1] += np.tan(np.radians(swing)) * (wire[:, 2] - HEIGHT)
    shafts = []
    for foot, lean in zip(feet, leans, strict=True):
        z, angle = rng.uniform(0.0, HEIGHT, 400), rng.uniform(0.0, 2.0 * np.pi, 400)
        round_it = 0.15 * np.column_stack([np.cos(angle), np.sin(angle)])
        shafts.append(foot + np.column_stack([
            round_it + z[:, None] * np.tan(np.radians(lean)), z,
        ]))
    built = np.concatenate(shafts)
    points = np.concatenate([*wires, built])
    points = (points + rng.normal(0.0, 0.03, points.shape)) @ turn.T
    none = np.full(len(built), -1, dtype=np.int32)
    result = replace(
        result, line_id=np.concatenate([result.line_id, none]),
        span_id=np.concatenate([result.span_id, none]),
        classification=np.concatenate([
            result.classification, np.full(len(built), PointClass.TOWER, dtype=np.uint8),
        ]),
    )
    return measure_leans(points, result)


def judge(*parts):
    """Return what a book says of parts of a map."""
    book = PlumbBook()
    for part in parts:
        book.add(part)
    return book.judge(SHARP)


@pytest.mark.parametrize('num_poles', [2, 3, 6])
def test_what_stands_upright_is_no_matter(num_poles):
    leans = make_line(num_poles)
    assert leans.poles.shape == (num_poles, 4)
    assert leans.conductors.shape == (3 * (num_poles - 1), 6)
    np.testing.assert_allclose(leans.poles[:, 2:], 0.0, atol=0.01)
    np.testing.assert_allclose(leans.conductors[:, 4], 0.0, atol=0.015)
    assert judge(leans) == SHARP


@pytest.mark.parametrize('roll', [2.0, -2.0, 5.0])
def test_a_tilted_map_is_held_back(roll):
    leans = make_line(tilt=(roll, 0.0))
    shift = np.tan(np.radians(roll))
    np.testing.assert_allclose(np.median(leans.poles[:, 2:], axis=0), [0.0, -shift], atol=0.006)
    np.testing.assert_allclose(np.median(leans.conductors[:, 4]), -shift, atol=0.01)
    found = judge(leans)
    assert found.poor
    assert not found.hopeless
    assert '3 poles lean by ' in found.describe()
    assert ' degrees and 6 conductors hang ' in found.describe()
    assert 'the map is tilted; check mount' in found.describe()
    assert found.describe().endswith('hazards are held back')


def test_a_map_that_is_tilted_along_the_line_is_told_by_poles_alone():
    assert judge(make_line(tilt=(0.0, 5.0))).poor
    some = judge(make_line(tilt=(0.0, 2.0)))
    assert not some.poor
    assert 'the map may be tilted' in some.remark


def test_wind_is_a_remark():
    found = judge(make_line(swing=6.0))
    assert not found.poor
    assert '6 conductors hang ' in found.remark
    assert 'wind, or the map is tilted' in found.remark
    assert not judge(make_line(swing=2.0, constant=900.0)).remark, 'a drift may do that'


@pytest.mark.parametrize('leans', [
    [(0.2, 3.8), (1.2, 3.3), (-3.0, 1.3)],  # oakland_part2_ai
    [(0.1, -3.0), (-1.5, -2.2), (1.0, -1.2)],  # oakland_part3_am
    [(-0.3, 1.6), (0.3, 2.7)],  # oakland_part3_ao
])
def test_poles_that_lean_hold_nothing_back(leans):
    assert not judge(make_line(len(leans), leans=leans)).poor
    assert not judge(make_line(len(leans), leans=leans, swing=-1.0)).poor


def test_one_pole_is_a_remark():
    line = make_line(tilt=(6.0, 0.0))
    one = Leans(poles=line.poles[:1], conductors=line.conductors[:0])
    assert '1 pole leans by ' in judge(one).remark
    assert not judge(one).poor


def test_the_newest_of_each_counts():
    tilted, upright = make_line(tilt=(3.0, 0.0)), make_line()
    assert judge(tilted).poor
    assert not judge(tilted, upright).poor
    assert judge(upright, tilted).poor
    twice = PlumbBook()
    twice.add(tilted)
    twice.add(tilted)
    assert len(twice.leans.poles) == len(tilted.poles)
    assert len(twice.leans.conductors) == len(tilted.conductors)


def test_nothing_tells_nothing():
    result, points = make_result([])
    leans = measure_leans(points, result)
    assert find_lean(leans).describe() == ''
    assert judge(leans) == SHARP


def test_hazards_are_held_back_in_a_tilted_map():
    session, points = Session(), make_sample()
    assert session.conclude(points, Settings(), 1, complete=True)[0].hazards
    tilted = points @ make_transform((0.0, 0.0, 0.0), (4.0, 0.0, 0.0))[:3, :3].T
    session = Session()
    state, result, _ = session.conclude(tilted, Settings(), 1, complete=True)
    assert state.hazards == result.hazards == ()
    assert '3 poles lean by 4.0 degrees' in state.sharpness.doubt
    kept = session.remember()
    after = Session()
    after.restore(kept)
    assert after.state.sharpness == state.sharpness


@pytest.mark.parametrize(('roll', 'words'), [(0.0, ''), (4.0, 'the map is tilted: check that z')])
def test_a_survey_warns_of_a_tilted_cloud(tmp_path, roll, words):
    points = make_sample() @ make_transform((0.0, 0.0, 0.0), (roll, 0.0, 0.0))[:3, :3].T
    np.savetxt(tmp_path / 'cloud.xyz', points, fmt='%.3f')
    found = survey(tmp_path / 'cloud.xyz', Settings())
    assert found.result.hazards
    assert words in found.counts.get('lean', '')
    assert ('lean' in found.counts) == bool(words)
    for text in (render_summary(found), render_report(found)):
        assert ('3 poles lean by 4.0 degrees' in text) == bool(words)


@pytest.mark.parametrize(('heights', 'num'), [
    ((1.0, 9.0), 1), ((1.0, 3.0), 0), ((1.0, 3.0, 6.0, 9.0), 0), ((1.0, 1.1, 1.2), 0),
])
def test_shafts_are_long_and_without_gaps(heights, num):
    rng = np.random.default_rng(1)
    low, high = np.reshape(heights[: 2 * (len(heights) // 2)], (-1, 2)).T
    part = rng.integers(len(low), size=300)
    points = np.column_stack([rng.normal(0.0, 0.05, (300, 2)), rng.uniform(low[part], high[part])])
    result, _ = make_result([], supports=[make_support((0.0, 0.0, 0.0))])
    none = np.full(300, -1, dtype=np.int32)
    result = replace(
        result, line_id=none, span_id=none,
        classification=np.full(300, PointClass.TOWER, dtype=np.uint8),
    )
    assert len(measure_leans(points, result).poles) == num
