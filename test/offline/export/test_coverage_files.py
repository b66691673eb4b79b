# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What was not seen, and the flight that shows it, in the results folder."""

from dataclasses import replace
import json

from factories import make_inspection
import numpy as np
import pyproj
import pytest

from plc_inspect.core.coverage.coverage import Part
from plc_inspect.offline.export.results_folder import write_results
from plc_inspect.offline.readers.clouds import add_heights
from plc_inspect.offline.records.coverage_record import (
    describe_coverage,
    ENOUGH,
    NOT_ENOUGH,
    review_coverage,
)
from plc_inspect.offline.records.georeference import make_origin_crs
from plc_inspect.offline.records.units import Units
from plc_inspect.offline.report.report import render_report

FOOT = 0.3048
PLACE = 51.5, 7.25


def read(path):
    """Read a JSON file in which NaN and infinity are errors."""
    return json.loads(path.read_text(encoding='utf-8'), parse_constant=pytest.fail)


@pytest.fixture(scope='module')
def run():
    """Make a run whose ground was hardly seen, at a known place."""
    return replace(
        make_inspection(num_ground=500, frame_id='odom'), altitude=80.0,
        georeference=make_origin_crs(*PLACE),
        way=np.array([[float(t), 5.0 * t, 20.0, 30.0] for t in range(5)]),
    )


@pytest.fixture(scope='module')
def folder(run, tmp_path_factory):
    folder = tmp_path_factory.mktemp('run') / 'out'
    write_results(folder, run)
    return folder


def test_each_span_has_a_verdict(run, folder):
    record = read(folder / 'coverage.json')
    assert (record['frame_id'], record['metres_per_unit']) == ('odom', [1.0, 1.0])
    assert {row['span_id'] for row in record['sections']} == {
        span.span_id for span in run.result.spans
    }
    assert record['gaps']
    held = []
    for row in record['sections']:
        assert row['verdict'] == (NOT_ENOUGH if row['gaps'] else ENOUGH)
        assert [strip['part'] for strip in row['strips']] == ['below', 'left', 'right']
        held += row['gaps']
    assert held == [*range(len(record['gaps']))] == [row['gap_id'] for row in record['gaps']]
    shown = {gap for row in record['refly']['waypoints'] for gap in row['gaps']}
    assert shown == set(held)


def test_report_says_that_not_seen_is_not_safe(run, folder):
    page = (folder / 'report.html').read_text(encoding='utf-8')
    assert 'id="coverage"' in page
    assert NOT_ENOUGH in page
    sight = review_coverage(run)
    assert page.count(f'<b>{NOT_ENOUGH}</b>') == sight.coverage.num_poor > 0
    calm = replace(run, result=replace(run.result, hazards=()))
    write_results(folder.parent / 'calm', calm)
    page = (folder.parent / 'calm' / 'report.html').read_text(encoding='utf-8')
    assert 'No clearance rule is broken by what was seen' in page


@pytest.mark.parametrize(('is_part', 'text'), [
    (True, 'but for {} of {} gaps'), (False, 'No safe flight was found'),
])
def test_gaps_that_no_run_covers_are_told(run, is_part, text):
    sight = review_coverage(run)
    runs = sight.refly.runs[:1] if is_part else ()
    kept = [number for number, own in enumerate(sight.refly.run) if own < len(runs)]
    sight = replace(sight, refly=replace(
        sight.refly, runs=runs, places=sight.refly.places[kept],
        kinds=tuple(sight.refly.kinds[k] for k in kept),
        run=tuple(sight.refly.run[k] for k in kept),
    ))
    record = describe_coverage(sight, run.units)
    shown = {gap for row in record['refly']['waypoints'] for gap in row['gaps']}
    assert record['refly']['left_out'] == sorted(set(range(len(record['gaps']))) - shown) != []
    page = render_report(run, sight)
    assert text.format(len(record['refly']['left_out']), len(record['gaps'])) in page


def test_plan_and_layers_are_where_the_waypoints_are(run, folder):
    waypoints = read(folder / 'coverage.json')['refly']['waypoints']
    plan, points = read(folder / 'refly.plan'), read(folder / 'refly.geojson')['features']
    assert plan['fileType'] == 'Plan'
    items = plan['mission']['items']
    assert len(items) == len(points) == len(waypoints) > 1
    radius = 6_378_137.0
    for number, (item, point, row) in enumerate(zip(items, points, waypoints, strict=True)):
        x, y, z = row['position']
        latitude, longitude, altitude = item['params'][4:]
        assert (item['command'], item['frame'], item['AltitudeMode']) == (16, 0, 2)
        assert item['doJumpId'] == number + 1 == row['number'] + 1
        assert altitude == item['Altitude'] == pytest.approx(z + 80.0)
        north = np.radians(latitude - PLACE[0]) * radius
        east = np.radians(longitude - PLACE[1]) * radius * np.cos(np.radians(PLACE[0]))
        assert (east, north) == (pytest.approx(x, abs=1.0), pytest.approx(y, abs=1.0))
        assert point['geometry']['coordinates'] == pytest.approx(
            [longitude, latitude, altitude], abs=1e-6
        )
    lines = read(folder / 'coverage.geojson')['features']
    kinds = [line['properties']['kind'] for line in lines]
    record = read(folder / 'coverage.json')
    assert kinds.count('section') == len(record['sections'])
    assert kinds.count('gap') == len(record['gaps'])


@pytest.mark.parametrize(('name', 'has_plan', 'words'), [
    ('EPSG:25833+5783', True, 'refly.geojson, refly.plan.'),
    ('EPSG:25833', True, 'refly.plan. The latter takes the heights for altitudes above the sea'),
    ('EPSG:25833 3D', False, 'There is no refly.plan'),
    ('EPSG:25833 feet', True, 'which the reference system does not say: check them'),
])
def test_plan_only_where_heights_may_be_above_the_sea(run, tmp_path, name, has_plan, words):
    system = pyproj.CRS(name.partition(' ')[0])
    system = system.to_3d() if name.endswith('3D') else system
    system = add_heights(system, 0.3048) if name.endswith('feet') else system
    write_results(tmp_path / 'out', replace(run, crs=system.to_wkt()))
    assert (tmp_path / 'out/refly.plan').exists() == has_plan
    assert (tmp_path / 'out/refly.geojson').exists()
    assert words in (tmp_path / 'out/report.html').read_text(encoding='utf-8')


def test_without_a_place_on_earth_there_is_no_plan(run, tmp_path):
    write_results(tmp_path / 'out', replace(run, georeference=''))
    assert (tmp_path / 'out/coverage.json').exists()
    assert not (tmp_path / 'out/refly.plan').exists()
    assert not (tmp_path / 'out/coverage.geojson').exists()


def test_feet(run, folder, tmp_path):
    units = Units(horizontal=FOOT, vertical=FOOT)
    write_results(tmp_path / 'out', replace(run, units=units, georeference=''))
    ours, theirs = read(tmp_path / 'out/coverage.json'), read(folder / 'coverage.json')
    for one, other in zip(ours['gaps'], theirs['gaps'], strict=True):
        assert one['length'] * FOOT == pytest.approx(other['length'])
        np.testing.assert_allclose(np.array(one['line']) * FOOT, other['line'])
    one, other = (item['sections'][0] for item in (ours, theirs))
    assert one['distance'] * FOOT == pytest.approx(other['distance'])
    assert one['angle'] == other['angle']
    conductors = one['conductors'][0], other['conductors'][0]
    assert conductors[0]['density'] / FOOT == pytest.approx(conductors[1]['density'])
    assert ours['refly']['length'] * FOOT == pytest.approx(theirs['refly']['length'])


def test_nothing_found_is_said_to_say_nothing(tmp_path):
    empty = make_inspection(num_ground=500)
    empty = replace(empty, result=replace(empty.result, spans=(), hazards=(), supports=()))
    write_results(tmp_path / 'out', empty)
    record = read(tmp_path / 'out/coverage.json')
    assert record['sections'] == record['gaps'] == record['refly']['waypoints'] == []
    assert 'where nothing was found, nothing is said' in record['note']
    assert Part.CONDUCTOR.name.lower() == 'conductor'
