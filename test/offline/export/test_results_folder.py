# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The results folder: complete, exact, and whole or not there."""

import csv
import json
import math

from factories import make_empty_result, make_inspection
import numpy as np
import pytest

from plc_inspect import __version__
from plc_inspect.config import Settings
from plc_inspect.errors import DataError
from plc_inspect.offline.export import files
from plc_inspect.offline.export.file_names import FILES
from plc_inspect.offline.export.files import render_json
from plc_inspect.offline.export.results_folder import write_results
from plc_inspect.offline.records.units import Units
from plc_inspect.setting_names import to_mapping

FOOT = 1200.0 / 3937.0
UTM = (615_300.0, 5_712_000.0, 30.0)


@pytest.fixture(scope='module')
def inspection():
    """Make one run for all tests that only read it."""
    return make_inspection(origin=UTM, num_ground=500, frame_id='odom')


def read(path):
    """Read a JSON file in which NaN and infinity are errors."""
    return json.loads(path.read_text(encoding='utf-8'), parse_constant=pytest.fail)


def names(folder):
    """List what is in a folder."""
    return sorted(item.name for item in folder.iterdir())


def test_all_files_are_there_and_nothing_else(tmp_path, inspection):
    write_results(tmp_path / 'out', inspection)
    assert names(tmp_path / 'out') == sorted(FILES)
    assert names(tmp_path) == ['out']


def test_tables_alone(tmp_path, inspection):
    write_results(tmp_path / 'out', inspection)
    write_results(tmp_path / 'small', inspection, tables_only=True)
    assert names(tmp_path / 'small') == sorted(
        name for name in FILES if name.endswith(('.json', '.csv'))
    )
    for name in ('spans.json', 'hazards.json', 'supports.json', 'spans.csv'):
        assert (tmp_path / 'small' / name).read_text() == (tmp_path / 'out' / name).read_text()
    assert read(tmp_path / 'small/run.json')['num_points_written'] == 0


def test_spans_are_exact(tmp_path, inspection):
    write_results(tmp_path / 'out', inspection)
    content = read(tmp_path / 'out/spans.json')
    assert (content['frame_id'], content['crs']) == ('odom', '')
    assert len(content['spans']) == 6
    for record, span in zip(content['spans'], inspection.result.spans, strict=True):
        for name in ('line_id', 'span_id', 'azimuth', 'length', 'a', 'b', 'c', 'sag', 'rmse',
                     'num_points', 'coverage', 'open_start', 'open_end', 'sigma'):
            assert record[name] == getattr(span, name), name
        for name in ('start', 'end', 'lowest', 'quadratic'):
            assert record[name] == list(getattr(span, name)), name
        # The catenary of the file passes through both ends and the lowest point of the file.
        for name, x in (('start', 0.0), ('end', record['length'])):
            z = record['a'] + record['c'] * math.cosh((x - record['b']) / record['c'])
            assert z == pytest.approx(record[name][2], abs=1e-9)


def test_feet_are_scaled_properly(tmp_path):
    metres = make_inspection(num_ground=100)
    feet = make_inspection(num_ground=100, units=Units(horizontal=FOOT, vertical=FOOT))
    assert feet.units.name == 'ftUS'
    write_results(tmp_path / 'm', metres)
    write_results(tmp_path / 'ft', feet)
    for one, other in zip(*(read(tmp_path / f'{name}/spans.json')['spans'] for name in
                            ('m', 'ft')), strict=True):
        x = 0.3 * other['length']
        by_catenary = other['a'] + other['c'] * math.cosh((x - other['b']) / other['c'])
        expected = one['a'] + one['c'] * math.cosh((x * FOOT - one['b']) / one['c'])
        assert by_catenary * FOOT == pytest.approx(expected, abs=1e-9)
        by_square = np.polyval(other['quadratic'], x) * FOOT
        assert by_square == pytest.approx(np.polyval(one['quadratic'], x * FOOT), abs=1e-9)
        for name in ('sag', 'rmse', 'length'):
            assert other[name] * FOOT == pytest.approx(one[name])
        assert other['sigma']['sag'] * FOOT == pytest.approx(one['sigma']['sag'])
        assert np.allclose(np.array(other['lowest']) * FOOT, one['lowest'])
        assert other['azimuth'] == one['azimuth']
    hazards = [read(tmp_path / f'{name}/hazards.json')['hazards'][0] for name in ('m', 'ft')]
    for name in ('clearance', 'required', 'horizontal', 'vertical', 'sigma', 'along_span'):
        assert hazards[1][name] * FOOT == pytest.approx(hazards[0][name]), name
    assert np.allclose(np.array(hazards[1]['extent']) * FOOT, hazards[0]['extent'])
    supports = [read(tmp_path / f'{name}/supports.json')['supports'][1] for name in ('m', 'ft')]
    assert supports[1]['height'] * FOOT == pytest.approx(supports[0]['height'])
    assert supports[0]['lines'] == [0, 1, 2]


def test_tables_agree_with_json(tmp_path, inspection):
    write_results(tmp_path / 'out', inspection)
    with (tmp_path / 'out/spans.csv').open(encoding='utf-8') as stream:
        rows = list(csv.DictReader(stream))
    spans = read(tmp_path / 'out/spans.json')['spans']
    assert len(rows) == len(spans)
    for row, span in zip(rows, spans, strict=True):
        assert float(row['start_y [m]']) == pytest.approx(span['start'][1], abs=1e-4)
        assert float(row['a2 [1/m]']) == pytest.approx(span['quadratic'][0], rel=1e-11)
        assert float(row['sigma_sag [m]']) == span['sigma']['sag']
        assert row['open_end'] == str(span['open_end']).lower()
    with (tmp_path / 'out/hazards.csv').open(encoding='utf-8') as stream:
        rows = list(csv.DictReader(stream))
    assert [row['kind'] for row in rows] == ['vegetation']
    assert rows[0]['severity'] == 'critical'
    assert float(rows[0]['min_z [m]']) < float(rows[0]['position_z [m]'])
    assert float(rows[0]['position_z [m]']) <= float(rows[0]['max_z [m]'])


def test_columns_of_tables_say_their_units(tmp_path):
    units = Units(horizontal=1200.0 / 3937.0, vertical=0.3048)
    write_results(tmp_path / 'out', make_inspection(units=units))
    heads = {
        name: (tmp_path / f'out/{name}.csv').read_text().splitlines()[0].split(',')
        for name in ('spans', 'supports', 'hazards')
    }
    assert {'start_x [ftUS]', 'start_z [ft]', 'azimuth [rad]', 'a2 [1/ftUS]', 'a1', 'sag [ftUS]',
            'coverage', 'num_points', 'lowest_z [ft]'} <= set(heads['spans'])
    assert {'position_y [ftUS]', 'position_z [ft]', 'height [ft]', 'kind'} <= set(
        heads['supports'])
    assert {'clearance [ftUS]', 'required [ftUS]', 'max_z [ft]', 'voltage', 'years [a]',
            'confidence', 'text'} <= set(heads['hazards'])


def test_run_says_how(tmp_path, inspection):
    write_results(tmp_path / 'out', inspection)
    run = read(tmp_path / 'out/run.json')
    assert run['version'] == __version__
    assert run['settings'] == to_mapping(Settings())
    assert run['num_points'] == len(inspection.points)
    assert [stage['name'] for stage in run['stages']] == ['height', 'linearity', 'catenary']
    assert run['stages'][0]['dropped']['too low'] == 12
    assert sum(run['decisions'].values()) == sum(run['classes'].values()) == run['num_points']
    assert run['peak_memory'] > 2**20
    assert set(run['seconds']) >= {'points_file', 'report'}


def test_same_run_gives_the_same_bytes(tmp_path, inspection):
    for name in ('one', 'two'):
        write_results(tmp_path / name, inspection)
    for name in set(FILES) - {'run.json', 'report.html'}:
        one, two = ((tmp_path / folder / name).read_bytes() for folder in ('one', 'two'))
        assert one == two, name


@pytest.mark.parametrize('num_points', [0, 1, 7])
def test_no_line_is_a_result(tmp_path, num_points):
    points = np.zeros((num_points, 3))
    inspection = make_inspection(result=make_empty_result(num_points), points=points)
    write_results(tmp_path / 'out', inspection)
    assert names(tmp_path / 'out') == sorted(FILES)
    for name in ('spans', 'supports', 'hazards'):
        assert read(tmp_path / f'out/{name}.json')[name] == []


def test_existing_folder_needs_force(tmp_path, inspection):
    write_results(tmp_path / 'out', inspection)
    (tmp_path / 'out/spans.json').write_text('old', encoding='utf-8')
    with pytest.raises(DataError, match='--force'):
        write_results(tmp_path / 'out', inspection)
    assert (tmp_path / 'out/spans.json').read_text(encoding='utf-8') == 'old'
    write_results(tmp_path / 'out', inspection, force=True)
    assert len(read(tmp_path / 'out/spans.json')['spans']) == 6
    assert names(tmp_path) == ['out']


def test_force_never_removes_what_is_not_ours(tmp_path, inspection):
    (tmp_path / 'out').mkdir()
    (tmp_path / 'out/thesis.tex').write_text('dear', encoding='utf-8')
    with pytest.raises(DataError, match=r'1 files that are not results, such as thesis\.tex'):
        write_results(tmp_path / 'out', inspection, force=True)
    assert names(tmp_path / 'out') == ['thesis.tex']


@pytest.mark.parametrize(('force', 'name', 'message'), [
    (False, 'spans.json', '--force replaces it'), (True, 'thesis.tex', r'such as thesis\.tex'),
])
def test_what_came_while_results_were_written_stays(
    tmp_path, inspection, monkeypatch, force, name, message
):
    def write(folder, run):
        (folder / 'spans.json').write_text('new', encoding='utf-8')
        (tmp_path / 'out').mkdir()
        (tmp_path / 'out' / name).write_text('of another', encoding='utf-8')

    monkeypatch.setattr('plc_inspect.offline.export.files.write_tables', write)
    with pytest.raises(DataError, match=message):
        write_results(tmp_path / 'out', inspection, force, tables_only=True)
    assert (tmp_path / 'out' / name).read_text(encoding='utf-8') == 'of another'
    assert names(tmp_path) == ['out']


def test_a_file_is_no_folder(tmp_path, inspection):
    (tmp_path / 'out').write_text('mine', encoding='utf-8')
    with pytest.raises(DataError, match='not a folder'):
        write_results(tmp_path / 'out', inspection, force=True)
    with pytest.raises(DataError, match='cannot be written'):
        write_results(tmp_path / 'out/deeper', inspection)


@pytest.mark.parametrize('error', [RuntimeError('bug'), KeyboardInterrupt(), OSError(28, 'full')])
def test_failure_leaves_the_old_folder_and_no_new_one(tmp_path, inspection, monkeypatch, error):
    write_results(tmp_path / 'old', inspection)
    before = (tmp_path / 'old/run.json').read_bytes()

    def fail(*_):
        raise error

    monkeypatch.setattr(files, 'render_report', fail)
    expected = DataError if isinstance(error, OSError) else type(error)
    for name in ('old', 'new'):
        with pytest.raises(expected):
            write_results(tmp_path / name, inspection, force=True)
    assert names(tmp_path) == ['old']
    assert names(tmp_path / 'old') == sorted(FILES)
    assert (tmp_path / 'old/run.json').read_bytes() == before


def test_missing_parents_are_made(tmp_path, inspection):
    write_results(tmp_path / 'a/b/out', inspection)
    assert (tmp_path / 'a/b/out/report.html').is_file()


def test_input_is_unchanged(tmp_path, inspection):
    before = inspection.points.copy()
    write_results(tmp_path / 'out', inspection)
    np.testing.assert_array_equal(before, inspection.points)


@pytest.mark.parametrize(('value', 'text'), [
    (1.0, '1.0'),
    (0.1 + 0.2, '0.30000000000000004'),
    (math.nan, 'null'),
    (np.float64(2.5), '2.5'),
    (np.int64(7), '7'),
    (True, 'true'),
    (None, 'null'),
    ((1, 2.0), '[1, 2.0]'),
    ([], '[]'),
    ({}, '{}'),
    (np.array([1.0, math.inf]), '[1.0, null]'),
    ({'a': [1, {'b': 2}]}, '{\n  "a": [\n    1,\n    {\n      "b": 2\n    }\n  ]\n}'),
    ('\u00e5"', '"\u00e5\\""'),
])
def test_json_rules(value, text):
    assert render_json(value) == text
    json.loads(text)
