# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The report: complete, self-contained, well-formed, small."""

import base64
import dataclasses
from html.parser import HTMLParser
import io
import json
from pathlib import Path
import re
import xml.etree.ElementTree as ElementTree

from factories import make_empty_result, make_inspection
import numpy as np
from PIL import Image
import pyproj
import pytest

from plc_inspect.config import Settings
from plc_inspect.core.hazards.clearance_rules import plain_rules
from plc_inspect.core.loads.load_cases import evaluate_cases
from plc_inspect.offline.export.coverage_files import write_coverage_views
from plc_inspect.offline.export.files import describe_run
from plc_inspect.offline.readers.catalogue import load_conductor, load_rules, parse_case
from plc_inspect.offline.records.coverage_record import review_coverage
from plc_inspect.offline.records.inspection import measure_clearances
from plc_inspect.offline.records.sentences import describe_place
from plc_inspect.offline.records.units import Units
from plc_inspect.offline.report.drawing import (
    blend,
    choose_ticks,
    draw_bars,
    encode_png,
    format_tick,
    Plot,
)
from plc_inspect.offline.report.figures import rank
from plc_inspect.offline.report.paper import Paper
from plc_inspect.offline.report.point_scene import make_scene
from plc_inspect.offline.report.report import format_number, render_report
from plc_inspect.offline.report.span_frame import find_frame
from plc_inspect.offline.report.view import encode_view
from plc_inspect.offline.terminal.result_table import render_summary
from plc_inspect.results import PointClass, StageReport
from plc_inspect.setting_names import describe, update

RULES = Path(__file__).parents[3] / 'config' / 'rules'
VOID = {'meta', 'br', 'img', 'hr', 'link', 'input'}
UTM = (615_300.0, 5_712_000.0, 30.0)


class Outline(HTMLParser):
    """Checks that elements nest, and collects ids, links and text."""

    def __init__(self):
        super().__init__()
        self.open, self.ids, self.links, self.text = [], [], [], []

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.ids += [attributes['id']] if 'id' in attributes else []
        self.links += [attributes[name] for name in ('href', 'src') if name in attributes]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def outline(page):
    """Parse a page and check that it is closed."""
    parser = Outline()
    parser.feed(page)
    parser.close()
    assert parser.open == []
    return parser


@pytest.fixture(scope='module')
def page():
    """Render one report for all tests that only read it."""
    return render_report(make_inspection(origin=UTM))


def test_page_is_well_formed_and_loads_nothing(page):
    parsed = outline(page)
    assert len(parsed.ids) == len(set(parsed.ids))
    for link in parsed.links:
        assert link.startswith(('#', 'data:image/png;base64,'))
        if link.startswith('#'):
            assert link[1:] in parsed.ids
    assert not re.search(r'(https?:)?//|@import|url\((?!#)|<script', page.split('<body>')[0])
    bare = re.sub(r'base64,[^"]*|<script type="application/json".*?</script>', '', page)
    assert 'http' not in bare
    assert not re.search(r'fetch\(|XMLHttpRequest|import\(|<script src', bare)


def test_page_holds_every_part(page):
    parsed = outline(page)
    text = ' '.join(' '.join(parsed.text).split())
    for part in ('corridor.laz', 'Map', 'Hazards', 'Supports', 'How it was found', 'Settings',
                 'span 1', 'too low', 'not linear', 'beta', 'voxel sizes', 'critical', 'tower'):
        assert part in text, part
    assert {'span-0', 'span-1', 'hazard-0'} <= set(parsed.ids)
    assert page.count('<svg viewBox') == 1 + 4 * 2
    assert page.count('class="bars"') == 1
    for name, _, _ in describe():
        assert f'<code>{name}</code>' in page
    assert '615365' in text
    assert len(page) < 900_000


def test_drawings_are_xml(page):
    drawings = re.findall(r'<svg.*?</svg>', page, re.DOTALL)
    assert len(drawings) > 3
    for drawing in drawings:
        ElementTree.fromstring(drawing)


def test_user_text_is_escaped():
    page = render_report(make_inspection(num_ground=10, source='<script>alert(1)</script>&.laz'))
    assert '<script>alert' not in page
    assert '&lt;script&gt;alert(1)&lt;/script&gt;&amp;.laz' in page
    outline(page)


@pytest.mark.parametrize('num_points', [0, 1, 20])
def test_no_line_is_said(num_points):
    points = np.random.default_rng(1).random((num_points, 3))
    page = render_report(make_inspection(result=make_empty_result(num_points), points=points))
    outline(page)
    assert 'No power line was found' in page
    assert 'No clearance rule is broken' in page


@pytest.mark.parametrize('paper', [None, Paper(size='A4')])
def test_load_cases_without_a_line_are_left_out(paper):
    run = make_inspection(result=make_empty_result(20), points=np.zeros((20, 3)))
    conductor, cases = load_conductor('ACSR Drake'), (parse_case('temperature=80'),)
    what_if = evaluate_cases(
        run.points, run.result, conductor, 20.0, cases, plain_rules(run.settings.hazards), 3
    )
    page = render_report(dataclasses.replace(run, what_if=what_if), paper=paper)
    assert 'No power line was found' in page
    assert 'id="what-if"' not in page
    assert 'href="#what-if"' not in page


def test_points_that_are_not_finite_do_no_harm():
    inspection = make_inspection(num_ground=100)
    inspection.points[-5:] = np.nan
    outline(render_report(inspection))


def test_changed_settings_are_marked():
    settings = update(Settings(), {'height.beta': 6.5})
    page = render_report(make_inspection(num_ground=10, settings=settings))
    assert page.count('class="changed"') == 1
    assert '6.5' in page


def test_feet_are_shown_as_feet():
    foot = 1200.0 / 3937.0
    page = render_report(
        make_inspection(num_ground=10, units=Units(horizontal=foot, vertical=foot))
    )
    assert f'{120.0 / foot:.2f}' in page
    assert '[ftUS]' in page


def test_places_are_those_of_the_files():
    """With x and y in feet and z in metres, as in hazards.json."""
    run = make_inspection(num_ground=10, units=Units(horizontal=0.3048, vertical=1.0))
    text = ' '.join(outline(render_report(run)).text)
    for foot in (item.position for item in run.result.supports):
        place = f'{foot[0] / 0.3048:.2f}, {foot[1] / 0.3048:.2f}, {foot[2]:.2f}'
        assert place.replace('-', '\u2212') in text
    assert 'lengths in ft, z of positions in m' in ' '.join(text.split())


def test_many_points_are_thinned_out(monkeypatch):
    monkeypatch.setattr('plc_inspect.offline.report.point_scene.MOST_POINTS', 3000)
    inspection = make_inspection(num_ground=50_000)
    scene = make_scene(inspection)
    assert len(scene.points) <= 3000
    monkeypatch.undo()
    assert len(make_scene(inspection).points) == len(inspection.points)


def test_clearance_of_each_span():
    inspection = make_inspection()
    result = inspection.result
    nearest = np.sort(result.clearance[result.classification == PointClass.VEGETATION])
    for min_points in (1, 3, 1500):
        clearances = measure_clearances(result, min_points)
        assert clearances.pop((0, 0)) == pytest.approx(nearest[min_points - 1])
        assert set(clearances.values()) == {None}
        assert len(clearances) == 5
    assert set(measure_clearances(result, 1501).values()) == {None}
    assert measure_clearances(make_empty_result(4), 1) == {}


def test_png_is_read_by_others():
    rng = np.random.default_rng(5)
    indices = rng.integers(0, 4, (7, 13), dtype=np.uint8)
    palette = ('#ffffff', '#ff0000', '#00ff00', '#0000ff')
    image = np.asarray(Image.open(io.BytesIO(encode_png(indices, palette))).convert('RGBA'))
    colors = np.array([[255, 255, 255, 0], [255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255]])
    np.testing.assert_array_equal(image, colors[indices])


@pytest.mark.parametrize(('low', 'high', 'most', 'expected'), [
    (0.0, 10.0, 6, [0, 2, 4, 6, 8, 10]),
    (-1.0, 1.0, 5, [-1, -0.5, 0, 0.5, 1]),
    (615_300.0, 615_900.0, 4, [615_400, 615_600, 615_800]),
    (3.0, 3.0, 5, [3]),
])
def test_ticks(low, high, most, expected):
    ticks = choose_ticks(low, high, most)
    assert ticks == pytest.approx(expected)
    assert len(ticks) <= most


@pytest.mark.parametrize(('value', 'step', 'text'), [
    (0.5, 0.5, '0.5'), (-20.0, 10.0, '\u221220'), (2.0, 1.0, '2'), (0.02, 0.01, '0.02'),
])
def test_tick_texts(value, step, text):
    assert format_tick(value, step) == text


def test_plot_maps_corners():
    plot = Plot((10.0, 20.0), (0.0, 5.0), (120, 70), 'x', margins=(10, 10, 10, 10))
    px, py = plot.to_pixels(np.array([10.0, 20.0]), np.array([5.0, 0.0]))
    assert px.tolist() == [10.0, 110.0]
    assert py.tolist() == [10.0, 60.0]


@pytest.mark.parametrize(('width', 'text'), [
    (0.9, '0.2'), (40.0, '10'), (85.0, '20'), (1113.0, '200'),
])
def test_scale_bar_is_round(width, text):
    plot = Plot((0.0, width), (0.0, 1.0), (120, 70), 'x', margins=(10, 10, 10, 10))
    plot.add_scale_bar('m')
    assert f'>{text} m<' in plot.render('x')


def test_bars_show_what_one_bar_would_hide():
    linear, log = (draw_bars(values, 'x') for values in ([4, 2, 1], [1e6, 10, 1]))
    assert 'logarithmic' not in linear
    assert re.findall(r'v-([0-9.]+)h', linear) == ['36.0', '18.0', '9.0']
    assert 'logarithmic' in log
    assert float(re.findall(r'v-([0-9.]+)h', log)[1]) > 5.0
    for values in ([], [0.0], [float('nan'), 1.0], [-1.0]):
        ElementTree.fromstring(draw_bars(values, 'x'))


def test_colors_blend():
    assert blend('#000000', '#ffffff', 3) == ['#000000', '#808080', '#ffffff']


@pytest.mark.parametrize(('value', 'text'), [
    (1234.567, '1,234.57'), (-0.5, '\u22120.50'), (-0.004, '0.00'), (None, '\u2013'),
    (float('nan'), '\u2013'),
])
def test_numbers_for_people(value, text):
    assert format_number(value) == text


def test_worst_places_are_said_in_words(page):
    text = ' '.join(' '.join(outline(page).text).split())
    hazard = make_inspection(origin=UTM).result.hazards[0]
    assert f'Span 0, line 0: vegetation at {hazard.along_span:.0f} m from the start' in text
    assert f'is {hazard.clearance:.2f} m away, 2.00 m required.' in text
    assert 'no authority' in text


@pytest.mark.parametrize(('changes', 'words'), [
    ({}, 'vegetation, 7.5 m high, at 12 m from support 3 is 1.90 m away, 2.50 m required;'
         ' 0.80 m at 80 C; critical in 3.0 years.'),
    ({'severity': 'notice'}, '0.80 m at 80 C; reaches the most severe tier in 3.0 years.'),
    ({'support_id': -1, 'years': None, 'height': None},
     'vegetation at 40 m from the start of the span is 1.90 m away, 2.50 m required;'
     ' 0.80 m at 80 C.'),
    ({'kind': 'ground'}, 'hangs 1.90 m above the ground at 12 m from support 3, 2.50 m required'),
    ({'kind': 'fall_in'}, 'a tree, 7.5 m high, at 12 m from support 3 comes within'
     ' 1.90 m of the conductor when it falls, 2.50 m required'),
    ({'kind': 'fall_in', 'clearance': -1.2}, 'a tree, 7.5 m high, at 12 m from support 3 reaches'
     ' 1.2 m past the conductor when it falls, 2.50 m required'),
    ({'kind': 'sag'}, 'sags 1.90 m more than its peers, 2.50 m tolerated.'),
    ({'kind': 'crossing', 'other_line_id': 5}, 'a crossing conductor (line 5) at 12 m from'),
    ({'kind': 'crossing'}, 'a crossing conductor (not modelled) at 12 m from'),
    ({'kind': 'missing', 'other_line_id': 5}, 'the conductor beside it, line 5, is missing;'
     ' of 2.50 m 1.90 m were seen: it may be down.'),
    ({'kind': 'missing'}, 'the conductor beside it is missing; of'),
])
def test_sentences(changes, words):
    item = {
        'span_id': 14, 'line_id': 2, 'along_span': 40.0, 'support_id': 3, 'from_support': 12.0,
        'clearance': 1.9, 'required': 2.5, 'kind': 'vegetation', 'height': 7.5, 'years': 3.0,
        'other_line_id': -1, 'severity': 'warning',
    }
    text = describe_place(item | changes, 'm', 1.0, [('80 C', 0.8)])
    assert text.startswith('Span 14, line 2: ')
    assert 'touch' not in text
    assert '; will touch at 60 \u00b0C' in describe_place(item, 'm', contact=60.2)
    assert words in text


@pytest.mark.parametrize('name', sorted(path.stem for path in RULES.glob('*.yaml')))
def test_a_report_by_each_rule_set(name):
    settings = update(Settings(), {
        'hazards.rules': name, 'hazards.voltage': 230.0, 'hazards.elevation': 100.0,
    })
    inspection = make_inspection(rules=load_rules(settings.hazards))
    page = render_report(inspection)
    assert inspection.rules.title in page
    for text in inspection.rules.not_applied:
        assert f'Not applied: {text}.' in page
    assert inspection.rules.gaps[1:] in page
    assert 'class="gaps"' in page
    summary = render_summary(inspection)
    assert f'WARNING: {inspection.rules.gaps}' in summary
    assert describe_run(inspection, 0)['not_covered'] == inspection.rules.gaps


@pytest.mark.parametrize(('cell', 'is_told'), [(1.0, False), (6.64, True)])
def test_a_ground_coarser_than_set_is_told(cell, is_told):
    inspection = make_inspection()
    stage = StageReport(name='height', num_in=9, num_kept=9, values={'cell_size': cell})
    inspection = dataclasses.replace(
        inspection, result=dataclasses.replace(inspection.result, stages=(stage,))
    )
    text = 'the ground has cells of 6.6 m in place of 1 m'
    assert (text in describe_run(inspection, 0)['coarse_ground']) == is_told
    assert (text in render_summary(inspection)) == is_told
    assert (text in render_report(inspection)) == is_told


def test_what_reaches_the_conductor_comes_first():
    near = {'severity': 'warning', 'kind': 'vegetation', 'clearance': 2.5, 'required': 4.0}
    fall = {'severity': 'warning', 'kind': 'fall_in', 'clearance': -2.0, 'required': 3.5}
    farther = fall | {'clearance': -20.7}
    low = {'severity': 'warning', 'kind': 'ground', 'clearance': 4.9, 'required': 5.0}
    worst = near | {'severity': 'critical', 'clearance': 1.9}
    little, much = (
        {'severity': 'warning', 'kind': 'sag', 'clearance': value, 'required': 0.5}
        for value in (0.6, 2.0)
    )
    order = [worst, farther, fall, much, near, little, low]
    assert sorted([order[k] for k in (3, 1, 6, 0, 5, 2, 4)], key=rank) == order


def test_view_keeps_the_places():
    inspection = make_inspection(origin=UTM)
    scene = make_scene(inspection)
    data = json.loads(encode_view(scene))
    grid = np.frombuffer(base64.b64decode(data['points']), dtype='<u2').reshape(-1, 3)
    assert len(base64.b64decode(data['colors'])) == len(grid) == len(scene.points)
    low, high = scene.points.min(axis=0), scene.points.max(axis=0)
    middle = np.round((low + high) / 2)
    places = np.array(data['low']) + grid / 65535.0 * data['size'] + middle
    np.testing.assert_allclose(places, scene.points, atol=0.01)
    assert len(data['lines']) == 6 + 3
    assert data['hazards'][0]['xyz'] == pytest.approx(
        np.array(scene.hazards[0]['position']) - middle, abs=0.001
    )
    empty = make_inspection(result=make_empty_result(0), points=np.zeros((0, 3)))
    assert encode_view(make_scene(empty)) == ''


@pytest.mark.parametrize('crs', ['', pyproj.CRS.from_epsg(28992).to_wkt()])
def test_the_flight_again_names_only_files_that_are_written(tmp_path, crs):
    inspection = dataclasses.replace(make_inspection(), crs=crs)
    sight = review_coverage(inspection)
    assert sight.refly.runs
    write_coverage_views(tmp_path, inspection, sight)
    page = render_report(inspection)
    assert 'coverage.json' in page
    assert ('refly.geojson' in page) == (tmp_path / 'refly.geojson').exists() == bool(crs)


def test_points_beside_a_part_of_a_span_are_all_found():
    scene = make_scene(make_inspection(UTM, units=Units(horizontal=0.3048, vertical=0.3048)))
    frame = find_frame(scene, scene.spans[0]['span_id'])
    s, t = ((scene.points[:, :2] - frame.origin) @ axis for axis in (frame.along, frame.across))
    first, last = frame.stations.min(), frame.stations.max()
    left, right = frame.offsets.max(), frame.offsets.min()
    for low, high in ((first - 30.0, last + 30.0), (first + 40.0, first + 48.0)):
        rows, along, across = frame.locate(scene, low, high, 20.0)
        assert (np.diff(rows) > 0).all()
        np.testing.assert_array_equal((along, across), (s[rows], t[rows]))
        near = np.flatnonzero((s > low) & (s < high) & (t > right - 20.0) & (t < left + 20.0))
        assert len(near) > 50
        assert set(near) <= set(rows)
