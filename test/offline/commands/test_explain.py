# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The plc_explain command on folders that were written."""

import json
import re
import shutil

import laspy
import numpy as np
import pytest
from toys import make_line_cloud, make_wire

from plc_inspect.config import Settings
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.offline.commands.explain import main, read_folder
from plc_inspect.offline.export.files import describe_run, render_json
from plc_inspect.offline.export.points_file import write_points
from plc_inspect.offline.records.inspection import Inspection
from plc_inspect.offline.records.units import Units
from plc_inspect.results import Decision
from plc_inspect.setting_names import update

FOOT = 0.3048


def write(folder, points, settings, units, way=None):
    """Write what of a results folder the command reads."""
    inspection = Inspection(
        result=Pipeline(settings, way=way).run(points), points=points, settings=settings,
        source='toy', command='plc_survey', units=units,
    )
    folder.mkdir()
    num = write_points(folder / 'points.laz', inspection)
    text = render_json(describe_run(inspection, num))
    (folder / 'run.json').write_text(text, encoding='utf-8')
    return inspection


@pytest.fixture(scope='module')
def room(tmp_path_factory):
    """Write runs: as it should be, with a setting that hides the line, and in feet."""
    folder = tmp_path_factory.mktemp('runs')
    arc = make_wire((150, 10, 9), (161, 10, 9), c=50, per_metre=20)
    points, _ = make_line_cloud(half_width=15.0, more=[arc])
    write(folder / 'good', points, Settings(), Units())
    hidden = update(Settings(), {'catenary.min_length': 150.0})
    write(folder / 'hidden', points, hidden, Units())
    write(folder / 'feet', points, Settings(), Units(horizontal=FOOT, vertical=FOOT))
    return folder


def find(folder, decision):
    """Return the row and the coordinates of a point of a decision."""
    las = laspy.read(folder / 'points.laz')
    rows = np.flatnonzero(np.asarray(las['decision']) == decision)
    index = int(rows[-1])
    return index, [f'{value:.6f}' for value in las.xyz[index]]


def run(capsys, *arguments):
    """Run the command and return its code, output and complaint."""
    code = main([str(item) for item in arguments])
    told = capsys.readouterr()
    return code, told.out, told.err


@pytest.mark.parametrize('name', ['good', 'feet'])
def test_a_point_by_place_and_by_number(room, capsys, name):
    index, place = find(room / name, Decision.NO_CATENARY)
    code, by_place, error = run(capsys, room / name, '--at', *place)
    assert (code, error) == (0, '')
    first, _, rest = by_place.partition('\n')
    assert first.startswith('the nearest point is 0.00 ')
    code, by_number, _ = run(capsys, room / name, '--point', index)
    assert code == 0
    assert by_number == rest
    x, y, z = map(float, place)
    assert f'point {index} at {x:.2f}, {y:.2f}, {z:.2f}, class vegetation' in rest
    assert 'NO_CATENARY, 7); decided by catenary' in rest
    assert re.search(
        r'x curve 1: metres of evidence: \d+\.\d+ m < 12 m \(catenary.min_evidence\)', rest
    )
    assert re.search(r'changed it: catenary.min_evidence = \d+\.\d+ instead of 12', rest)
    assert 'run with it, the point is WIRE' in rest


def test_dust_of_a_flight_is_told_as_such(tmp_path, capsys):
    """The path is not in the folder, so that dust is explained as any other point."""
    points, _ = make_line_cloud(half_width=15.0)
    way = np.column_stack([np.linspace(0.0, 90.0, 90), np.full(90, -9.0), np.full(90, 15.0)])
    dust = way[np.arange(4500) % 90] + np.random.default_rng(0).uniform(-5.0, 5.0, (4500, 3))
    write(tmp_path / 'out', np.vstack([points, dust]), Settings(), Units(), way)
    index, _ = find(tmp_path / 'out', Decision.NOT_FINITE)
    assert index >= len(points)
    _, text, _ = run(capsys, tmp_path / 'out', '--point', index, '--quick')
    assert 'in the folder it is NOT_FINITE' in text
    assert 'about which dust is left out' in text


def test_quick_tries_nothing(room, capsys):
    index, _ = find(room / 'good', Decision.WIRE)
    code, text, _ = run(capsys, room / 'good', '--point', index, '--quick')
    assert code == 0
    assert '(not tried)' in text
    assert 'run with it' not in text


def test_a_span_that_was_found(room, capsys):
    code, text, _ = run(capsys, room / 'good', '--span', 1, 0)
    assert code == 0
    assert text.startswith('line 1, span 0: 100.0 m from ')
    assert 'a conductor was found along it' in text
    assert 'curve 1: conductor' in text


@pytest.mark.parametrize('places', [
    [(0, 0, 15), (100, 0, 15)], [(0, 0, 15), (50, 0, 13.44), (100, 0, 15)],
])
def test_a_span_that_was_missed(room, capsys, places):
    arguments = [item for place in places for item in ('--at', *place)]
    code, text, _ = run(capsys, room / 'hidden', *arguments)
    assert code == 0
    assert 'here it is lost' in text
    assert 'curve 1: too short' in text
    assert re.search(r'changed it: catenary.min_length = \d+\.?\d* instead of 150', text)


@pytest.mark.parametrize(('arguments', 'message'), [
    (['good', '--point', '-1'], 'there is no point -1'),
    (['good', '--point', '999999'], 'there is no point 999999'),
    (['good', '--span', '0', '7'], 'no span 7 of line 0'),
    (['good', '--at', 'nan', '0', '0'], '--at must be finite'),
    (['good', '--at', '0', '0', '0', '--at', '0', '0', '0'], 'a metre apart'),
    (['good', '--point', '1', '--reach', '0'], '--reach must lie'),
    (['missing', '--point', '1'], 'no such results folder'),
    (['', '--point', '1'], 'no run.json'),
    (['no_json', '--point', '1'], 'is not JSON'),
    (['alien', '--point', '1'], 'unknown setting'),
    (['torn', '--point', '1'], 'cannot be read'),
    (['no_points', '--point', '1'], 'no points.laz'),
])
def test_what_is_wrong_is_one_line_and_exit_2(room, capsys, arguments, message):
    folder, *rest = arguments
    path = room / folder
    if folder in ('no_json', 'alien', 'torn', 'no_points'):
        shutil.copytree(room / 'good', path)
        if folder == 'no_json':
            (path / 'run.json').write_text('{', encoding='utf-8')
        elif folder == 'alien':
            content = json.loads((path / 'run.json').read_text(encoding='utf-8'))
            content['settings']['height']['gamma'] = 1.0
            (path / 'run.json').write_text(json.dumps(content), encoding='utf-8')
        elif folder == 'torn':
            laz = path / 'points.laz'
            laz.write_bytes(laz.read_bytes()[:5000])
        else:
            (path / 'points.laz').unlink()
    code, text, error = run(capsys, path, *rest)
    assert (code, text) == (2, '')
    assert error.startswith('plc_explain: ')
    assert error.count('\n') == 1
    assert message in error


@pytest.mark.parametrize('arguments', [
    [], ['--point', '1', '--at', '0', '0', '0'], ['--at', '1', '2'], ['--span', '1'],
    ['--point', 'x'], ['--at', '0', '0', '0'] * 4,
])
def test_bad_usage_ends_with_2(room, capsys, arguments):
    with pytest.raises(SystemExit) as stop:
        main([str(room / 'good'), *arguments])
    assert stop.value.code == 2
    assert capsys.readouterr().err.count('\n') == 1


def test_a_folder_is_read_in_metres(room):
    good, feet = read_folder(room / 'good'), read_folder(room / 'feet')
    np.testing.assert_allclose(feet.points, good.points, atol=2e-4)
    assert feet.units == Units(horizontal=FOOT, vertical=FOOT)
    assert feet.settings == Settings()
    np.testing.assert_array_equal(good.decision, Pipeline().run(good.points).decision)
