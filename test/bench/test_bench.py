# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The benches: a quick part of the accuracy bench with its floors, and what they measure with."""

from dataclasses import replace
import importlib
import math
from pathlib import Path
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from sklearn.cluster import DBSCAN

ROOT = Path(__file__).parents[2]
BENCH = ROOT / 'bench'
REAL = ROOT.parent / 'shared/data/real'


@pytest.fixture(scope='module')
def bench():
    """Import the benches as they are when one of them is run as a script."""
    sys.path.insert(0, str(BENCH))
    try:
        names = (
            'accuracy', 'common.measure', 'common.paper_baseline', 'scaling', 'common.surveys',
            'table2', 'common.tables',
        )
        yield SimpleNamespace(**{
            name.rpartition('.')[2]: importlib.import_module(name) for name in names
        })
    finally:
        sys.path.remove(str(BENCH))


@pytest.fixture(scope='module')
def cache(tmp_path_factory):
    """Return a folder of surveys for all tests."""
    return tmp_path_factory.mktemp('surveys')


def make_toy(rng, spacing=0.02):
    """Return a line of two conductors over rough ground, and which points are wire."""
    x = np.arange(0.0, 60.0, spacing)
    z = 12.0 + 400.0 * (np.cosh((x - 30.0) / 400.0) - 1.0)
    wires = np.vstack([np.column_stack([x, np.full(len(x), y), z]) for y in (-2.0, 2.0)])
    ground = np.column_stack([rng.uniform((0.0, -15.0), (60.0, 15.0), (20_000, 2)),
                              rng.normal(0.0, 0.1, 20_000)])
    points = np.vstack([wires, ground])
    points += rng.normal(0.0, 0.02, points.shape)
    return points, np.arange(len(points)) < len(wires)


@pytest.mark.slow
def test_quick_accuracy_keeps_its_floors_on_maps(bench, cache, capsys):
    code = bench.accuracy.main(['--quick', '--parts', 'maps', '--cache', str(cache)])
    text = capsys.readouterr().out
    assert code == 0, text
    assert 'wire F1' in text
    assert bench.tables.MISSED not in text


@pytest.mark.slow
@pytest.mark.skipif(not REAL.is_dir(), reason='no ../shared/data/real')
def test_quick_accuracy_keeps_its_floors_on_real_clouds(bench, cache):
    arguments = bench.accuracy.build_parser().parse_args(['--quick'])
    arguments.parts = ('real',)
    checks = bench.accuracy.check_real(bench.accuracy.run_all(arguments, cache))
    assert {('ahn_12BZ1_21', 'wire F1'), ('real clouds without wires', 'lines found')} <= {
        (check.data, check.measure) for check in checks
    }
    assert [check.row() for check in checks if not check.passed] == []


def test_absent_real_clouds_are_skipped_and_named(bench, cache, capsys):
    absent = cache / 'nowhere'
    assert bench.accuracy.main(['--quick', '--parts', 'real', '--real', str(absent)]) == 0
    assert f'skipped: the real clouds, as there is no {absent}' in capsys.readouterr().err


def test_worst_run_is_judged_and_a_missing_figure_is_missed(bench):
    accuracy = bench.accuracy
    run = accuracy.Run(
        kind='map', name='angle', density=20.0, num_points=0, result=None, scores=None,
        pulls=(0.5,), seconds=0.0,
    )
    runs = [replace(run, density=density) for density in (1.0, 2.0, 3.0)]
    (check,) = accuracy._check_worst('maps', 'x', runs, lambda item: item.density, 2.5)
    assert (check.value, check.passed) == (3.0, False)
    (check,) = accuracy._check_worst('maps', 'x', runs, lambda item: item.density, 1.0, least=True)
    assert (check.value, check.passed) == (1.0, True)
    (check,) = accuracy._check_worst('maps', 'x', runs, lambda item: math.nan, 1.0, least=True)
    assert not check.passed
    assert accuracy._check_worst('maps', 'x', [], lambda item: 1.0, 1.0) == []


@pytest.mark.parametrize(('inside', 'passed'), [(170, False), (180, True), (196, True),
                                                (200, False)])
def test_coverage_may_be_neither_too_low_nor_too_high(bench, inside, passed):
    pulls = (1.96,) * inside + (2.0,) * (200 - inside)
    (check,) = bench.accuracy._check_coverage([SimpleNamespace(pulls=pulls)])
    assert (check.value, check.passed) == (inside / 200, passed)
    assert bench.accuracy._check_coverage([SimpleNamespace(pulls=pulls[1:])]) == []


def test_whole_lines_are_counted(bench):
    spans = [SimpleNamespace(line_id=line, span_id=span)
             for line, span in ((0, 0), (0, 1), (0, 2), (1, 0), (1, 2), (2, 1))]
    assert bench.accuracy.count_whole_lines(SimpleNamespace(spans=spans)) == (1, 3)
    assert bench.accuracy.count_whole_lines(SimpleNamespace(spans=[])) == (0, 0)


def test_table_and_floors_read_well(bench):
    tables = bench.tables
    assert tables.at_least('maps', 'F1', 0.5, 0.98).row() == (
        'maps', 'F1', '0.5', '>= 0.98', '**missed**', '')
    assert tables.at_most('maps', 'RMSE', 0.03, 0.04, 'm').row()[2:5] == (
        '0.03 m', '<= 0.04 m', 'ok')
    check = tables.Check(data='a', measure='b', value=0.95, limit=(0.9, 0.98), unit='%')
    assert check.row()[2:5] == ('95.0%', '90.0% to 98.0%', 'ok')
    assert tables.render_table(('a', 'long'), [('1', '2')]) == (
        '| a   | long |\n| --- | ---- |\n| 1   | 2    |')


def test_a_section_is_replaced_and_the_rest_left_alone(bench, tmp_path):
    page = tmp_path / 'page.md'
    page.write_text('# Title\n\n<!-- begin one -->\nold\n<!-- end one -->\n\nmine\n')
    bench.tables.replace_section(page, 'one', 'new\n')
    bench.tables.replace_section(page, 'two', 'more')
    bench.tables.replace_section(page, 'two', 'other')
    assert page.read_text() == (
        '# Title\n\n<!-- begin one -->\nnew\n<!-- end one -->\n\nmine\n\n'
        '<!-- begin two -->\nother\n<!-- end two -->\n')
    assert [item.name for item in tmp_path.iterdir()] == ['page.md']


def test_surveys_are_made_once_and_have_the_number_of_points(bench, cache):
    first = bench.surveys.make_map(cache, 'rack', num_points=20_000)
    files = {path: path.stat().st_mtime_ns for path in cache.iterdir()}
    again = bench.surveys.make_map(cache, 'rack', num_points=20_000)
    assert first.points.shape == (20_000, 3)
    assert len(first.truth.labels) == 20_000
    np.testing.assert_array_equal(first.points, again.points)
    assert {path: path.stat().st_mtime_ns for path in cache.iterdir()} == files
    assert first.area > 0


@pytest.mark.skipif(not Path('/proc/self/clear_refs').exists(), reason='no /proc')
def test_extra_memory_is_that_of_the_call(bench):
    measured = bench.measure.measure(lambda: np.ones(25_000_000).sum())
    assert measured.value == 25_000_000
    assert 190e6 < measured.extra_bytes < 300e6
    assert measured.seconds > 0


def test_power_of_growth(bench):
    samples = [
        bench.scaling.Sample(size=n, num_points=n, num_spans=1, seconds=1e-7 * n**1.5,
                             extra_bytes=8.0 * n)
        for n in (10**6, 3 * 10**6, 10**7)
    ]
    assert bench.scaling.measure_power(samples, 'seconds') == pytest.approx(1.5)
    assert bench.scaling.measure_power(samples, 'extra_bytes') == pytest.approx(1.0)
    assert math.isnan(bench.scaling.measure_power(samples[:1], 'seconds'))
    passed = [check.passed for check in bench.scaling.check_growth('x', samples)]
    assert passed == [False, True]


@pytest.mark.slow
def test_ticks_of_a_flight_are_told_corridor_by_corridor(bench, cache):
    scaling = bench.scaling
    flight = scaling.fly(cache, 60_000, np.random.default_rng(0))
    ((end, ticks),) = flight.parts
    assert end == pytest.approx(1210.0, abs=10.0)
    assert len(ticks) > 80
    assert ticks[-1].num_voxels > ticks[0].num_voxels
    assert min(tick.seconds for tick in ticks) > 0.0
    assert f'to {end / 1000:.1f} km' in scaling.render_flight(flight.parts)
    assert not scaling.check_flight(flight).passed  # one corridor tells nothing

    def fly_on(first, second):
        """Return a flight over two corridors whose ticks take so long, and one over the second."""
        parts = [
            ((k + 1) * end, [replace(tick, seconds=seconds, flown=k * end + tick.flown)
                             for tick in ticks])
            for k, seconds in enumerate((first, second))
        ]
        other = [replace(tick, seconds=0.1) for tick in ticks]
        return scaling.Flight(parts=parts, middle=end, other=other)

    assert scaling.check_flight(fly_on(0.5, 0.1)).passed  # the machine was slower at first
    assert not scaling.check_flight(fly_on(0.1, 0.12)).passed


@pytest.mark.slow
def test_the_second_flight_begins_where_the_second_half_does(bench, cache, monkeypatch):
    scaling = bench.scaling
    monkeypatch.setattr(scaling, 'COPY_POINTS', 60_000)
    flight = scaling.fly(cache, 120_000, np.random.default_rng(0))
    (_, first), (_, second) = flight.parts
    assert first[-1].flown < flight.middle <= second[0].flown
    assert abs(len(flight.other) - len(second)) <= 2
    assert flight.other[0].flown < 50.0
    assert flight.other[-1].num_voxels < 0.6 * second[-1].num_voxels


def test_baseline_finds_a_plain_line(bench):
    points, wire = make_toy(np.random.default_rng(1))
    before = points.copy()
    result = bench.paper_baseline.segment(points)
    np.testing.assert_array_equal(points, before)
    found = result.wire
    assert (found & wire).sum() > 0.99 * wire.sum()
    assert (found & wire).sum() > 0.99 * found.sum()
    assert len(result.fits) == 2
    a2 = result.fits[:, 0]
    assert a2 == pytest.approx(1 / 800, rel=0.05)  # cosh(x/400) * 400 = x^2 / 800 + ...
    assert result.radius == pytest.approx(12.0, abs=0.5)
    assert set(np.flatnonzero(found)) <= set(result.corridor)


def test_baseline_of_few_points(bench):
    for points in (np.zeros((0, 3)), np.zeros((1, 3)), np.ones((3, 3))):
        result = bench.paper_baseline.segment(points)
        assert result.wire.shape == (len(points),)
        assert not result.wire.any()
        assert result.fits.shape == (0, 3)
        assert result.corridor.shape == (0,)


def test_baseline_linearity_is_that_of_the_ball(bench):
    rng = np.random.default_rng(2)
    points = rng.uniform(0.0, 1.0, (400, 3))
    linear, direction = bench.paper_baseline.measure_linearity(points, 0.3)
    for k in range(0, 400, 37):
        near = points[np.linalg.norm(points - points[k], axis=1) <= 0.3]
        values, vectors = np.linalg.eigh(np.cov(near.T, bias=True))
        if len(near) <= 5:
            assert linear[k] == 0.0
            continue
        assert linear[k] == pytest.approx((values[2] - values[1]) / values[2])
        assert abs(direction[k] @ vectors[:, 2]) == pytest.approx(1.0)


def test_baseline_clusters_along_the_line_as_dbscan_does(bench):
    baseline = bench.paper_baseline
    rng = np.random.default_rng(3)
    x = np.sort(np.concatenate([
        rng.uniform(0.0, 20.0, 4000), rng.uniform(30.0, 50.0, 4000), rng.uniform(0.0, 60.0, 40),
    ]))
    settings = baseline.BaselineSettings()
    spacing = x[settings.min_points - 1:] - x[:len(x) - settings.min_points + 1]
    eps = max(settings.eps, float(np.quantile(spacing, 0.9)))
    other = DBSCAN(eps=eps, min_samples=settings.min_points).fit(x[:, None]).labels_
    ours = baseline._cluster_sorted(x, settings)
    np.testing.assert_array_equal(ours < 0, other < 0)
    pairs = {pair for pair in zip(ours.tolist(), other.tolist(), strict=True) if pair[0] >= 0}
    assert len(pairs) == len(set(ours[ours >= 0].tolist())) == len(set(other[other >= 0].tolist()))
    assert len(pairs) == 2


@pytest.mark.slow
def test_table2_compares_both_programs_on_one_cloud(bench, cache):
    table2 = bench.table2
    survey = bench.surveys.make_map(cache, 'rack', num_points=20_000)
    item = table2.compare(table2.CASES[1], survey, 1)
    rows = table2.render_rows(item)
    assert [row[1] for row in rows[:2]] == ['plc_inspect', 'paper baseline']
    assert float(rows[0][3]) == pytest.approx(1e3 * item.ours.seconds() / survey.area, abs=1e-3)
    assert 'linearity' in table2.render_stages([item])
    assert table2.score_wire(survey.truth.labels == 14, survey) == 1.0
    assert [case.num_points for case in table2.CASES] == [10_000_429, 928_146]
