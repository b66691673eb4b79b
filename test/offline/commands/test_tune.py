# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""``plc_tune``: from a cloud or a recording to a parameter file."""

import fcntl
import json
import os
from pathlib import Path
import pty
import select
import signal
import struct
import subprocess
import sys
import termios
import time

import laspy
import numpy as np
import pytest
from toys import make_ground, make_line_cloud, make_tree
import yaml

from plc_inspect.config import Settings
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.core.tuning.objective import is_line, Objective
from plc_inspect.offline.commands import sensitivity, tuning_run
from plc_inspect.offline.commands.sensitivity import change, list_names, measure_change
from plc_inspect.offline.commands.tune import main
from plc_inspect.offline.commands.tuning_run import SearchPlan, tune
from plc_inspect.offline.commands.workers import Workers
from plc_inspect.offline.readers.parameter_file import read_settings
from plc_inspect.offline.readers.wire_truth import read_wire_truth
from plc_inspect.setting_names import update

ROOT = Path(__file__).parents[3]
SPOILED = {
    'height.beta': 9.0, 'linearity.threshold': 0.97, 'clustering.eps': 0.1,
    'clustering.min_points': 100, 'linearity.max_inclination_deg': 10.0,
}


@pytest.fixture(scope='module')
def cloud():
    """Make a span of three conductors, 8.6 m up where they are highest."""
    return make_line_cloud(spans=(90.0,), height=8.6, half_width=10.0, c=600.0,
                           more=[make_tree(45.0, 8.0, 8.0)])


@pytest.fixture(scope='module')
def file(cloud, tmp_path_factory):
    """Write it with its labels."""
    return write_las(tmp_path_factory.mktemp('cloud') / 'line.laz', *cloud)


@pytest.fixture(scope='module')
def empty(tmp_path_factory):
    """Write trees without a line."""
    cloud = make_line_cloud(offsets=(), poles=False, half_width=10.0, spans=(40.0,),
                            more=[make_tree(20.0, 0.0, 9.0)])
    return write_las(tmp_path_factory.mktemp('empty') / 'trees.laz', *cloud)


def write_las(path, points, label):
    header = laspy.LasHeader(point_format=6, version='1.4')
    header.scales = np.full(3, 1e-3)
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    las.classification = label
    las.write(path)
    return path


def run(*argv):
    try:
        return main([str(item) for item in argv])
    except SystemExit as error:
        return error.code


def spoil():
    return [word for name, value in SPOILED.items() for word in ('--set', f'{name}={value}')]


@pytest.mark.slow
@pytest.mark.parametrize('method', ['grid', 'evolution'])
def test_spoiled_settings_are_mended(file, tmp_path, capfd, method):
    output = tmp_path / 'tuned.yaml'
    assert run(file, '-o', output, '--method', method, '--budget', 40, *spoil()) == 0
    out, err = capfd.readouterr()
    assert err == ''
    assert f'line.laz: {len(laspy.read(file).x):,} points, {method}, ' in out
    settings = read_settings(output)
    points = laspy.read(file).xyz
    objective = Objective(points)
    spoiled = objective.score(update(Settings(), SPOILED)).value
    assert objective.score(settings).value > spoiled + 0.1
    assert len(Pipeline(settings).run(points).spans) == 3
    head = [line for line in output.read_text(encoding='utf-8').splitlines() if line[0] == '#']
    text = ' '.join(head)
    for word in ('line.laz', f'{len(points)} points', f'Method {method}', 'evaluations', 'SHA-256',
                 f'{spoiled:.4f} before', 'Spans: '):
        assert word in text
    content = yaml.safe_load(output.read_text(encoding='utf-8'))
    assert set(content['/**']['ros__parameters']) == {
        'height', 'linearity', 'outliers', 'clustering', 'corridor'}


@pytest.mark.slow
def test_the_search_for_f1_finds_it(file, tmp_path, capfd, cloud):
    output = tmp_path / 'tuned.yaml'
    code = run(file, '-o', output, '--truth', file, '--budget', 25, *spoil())
    assert code == 0
    assert 'f1' in capfd.readouterr().out
    assert 'F1 of the wire points' in output.read_text(encoding='utf-8')
    wire = Pipeline(read_settings(output)).find_lines(cloud[0]).spans.line_id >= 0
    right = (wire & (cloud[1] == 14)).sum()
    assert 2 * right / (wire.sum() + (cloud[1] == 14).sum()) > 0.97


@pytest.mark.slow
def test_settings_are_not_left_for_a_gain_that_shows_nothing(cloud, monkeypatch):
    given = update(Settings(), {'clustering.eps': 0.5, 'height.num_bins': 250})
    told = []
    tuned = tune(cloud[0], given, SearchPlan(budget=24), tell=told.append)
    assert tuned.settings == given
    assert tuned.after == tuned.before
    assert sum('the settings given are kept' in line for line in told) == 1
    monkeypatch.setattr(tuning_run, 'WORTH_CHANGING', 0.0)
    assert tune(cloud[0], given, SearchPlan(budget=24)).after.value > tuned.before.value


@pytest.mark.slow
def test_a_large_cloud_is_searched_where_the_line_is(cloud, monkeypatch):
    """Wherever its coordinates begin."""
    line, label = cloud
    field = make_ground((-900.0, -900.0), (-400.0, -400.0), per_square_metre=0.2)
    points = np.vstack([field, line]) + np.array([500_000.0, 6_000_000.0, 40.0])
    searched = []

    def search(part, *more):
        searched.append(part)
        return Workers(part, *more)

    monkeypatch.setattr(tuning_run, 'MOST_POINTS', len(line) // 2)
    monkeypatch.setattr(tuning_run, 'Workers', search)
    tune(points, Settings(), SearchPlan(budget=1))
    wires = points[len(field):][label == 14]
    held = (searched[0][:, None] == wires[None, ::50]).all(axis=2).any(axis=0)
    assert held.mean() > 0.5


def test_other_settings_that_were_given_are_kept(file, tmp_path):
    params = tmp_path / 'mine.yaml'
    params.write_text('catenary: {min_length: 20.0}\ncorridor: {radius: 0.6}\n', encoding='utf-8')
    output = tmp_path / 'tuned.yaml'
    assert run(file, '-o', output, '--params', params, '--budget', 3, '--quiet') == 0
    settings = read_settings(output)
    assert settings.catenary.min_length == 20.0
    assert settings.corridor.radius == 0.0  # 0.6 m is less than the height of the line


def test_a_cloud_without_lines_gives_no_file(empty, tmp_path, capfd):
    output = tmp_path / 'tuned.yaml'
    assert run(empty, '-o', output, '--budget', 20) == 0
    out, err = capfd.readouterr()
    assert out.splitlines()[-1].startswith('trees.laz: no power line was found')
    assert err == ''
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_same_input_same_file(file, tmp_path):
    for name in ('one.yaml', 'two.yaml'):
        assert run(file, '-o', tmp_path / name, '--budget', 12, '--seed', 3, '--quiet') == 0
    one, two = ((tmp_path / name).read_bytes() for name in ('one.yaml', 'two.yaml'))
    assert one == two


@pytest.mark.parametrize(('arguments', 'words'), [
    ([], ['-o']), (['-o', 'none/x.yaml'], ['none']), (['-o', '.'], ['folder']),
    (['-o', 'x.yaml', '--budget', '0'], ['--budget']), (['-o', 'x.yaml', '--set', 'a=1'], ['a']),
    (['-o', 'x.yaml', '--seed', '-1'], ['--seed']), (['--sensitivity', '--seed', '-1'], ['-1']),
    (['-o', 'x.yaml', '--truth', 'no.laz'], ['no.laz']),
    (['-o', 'x.yaml', '--method', 'luck'], ['luck']),
])
def test_refusals_take_one_line(file, tmp_path, monkeypatch, capfd, arguments, words):
    monkeypatch.chdir(tmp_path)
    assert run(file, *arguments) == 2
    out, err = capfd.readouterr()
    assert out == ''
    assert err.count('\n') == 1
    assert err.startswith('plc_tune: ')
    for word in words:
        assert word in err
    assert list(tmp_path.iterdir()) == []


def test_a_file_is_replaced_with_force_only(file, tmp_path, capfd):
    output = tmp_path / 'tuned.yaml'
    output.write_text('mine', encoding='utf-8')
    assert run(file, '-o', output, '--budget', 1) == 2
    assert '--force' in capfd.readouterr().err
    assert output.read_text(encoding='utf-8') == 'mine'
    assert run(file, '-o', output, '--budget', 1, '--force', '--quiet') == 0
    assert read_settings(output) == Settings()


def test_truth_of_another_cloud_is_refused(file, empty, tmp_path, capfd):
    assert run(file, '-o', tmp_path / 'x.yaml', '--truth', empty) == 2
    assert 'points, the cloud' in capfd.readouterr().err
    points = laspy.read(file)
    points.points = points.points[np.arange(len(points))[::-1]]
    points.write(tmp_path / 'turned.laz')
    assert run(file, '-o', tmp_path / 'x.yaml', '--truth', tmp_path / 'turned.laz') == 2
    assert 'or in another order: point' in capfd.readouterr().err


def test_truth_from_spans(tmp_path):
    span = {'start': [0.0, 0.0, 10.0], 'end': [50.0, 0.0, 10.0], 'b': 25.0, 'c': 500.0}
    span['a'] = 10.0 - 500.0 * float(np.cosh(25.0 / 500.0))
    (tmp_path / 'truth.json').write_text(
        json.dumps({'kind': 'flight', 'spans': [span]}), encoding='utf-8')
    low = span['a'] + 500.0
    points = np.array([
        [25.0, 0.0, low], [25.0, 0.2, low], [25.0, 0.4, low], [25.0, 0.6, low], [0.5, 0.0, 10.0],
        [np.nan, 0.0, 0.0],
    ])
    wire, left_out = read_wire_truth(tmp_path, points)
    np.testing.assert_array_equal(wire & ~left_out, [True, True, False, False, False, False])
    np.testing.assert_array_equal(left_out, [False, False, True, False, True, True])


def test_sensitivity_names_what_decides(file, capfd, monkeypatch):
    chosen = ['height.beta', 'linearity.threshold', 'supports.max_reach']
    assert set(chosen) < set(list_names())
    monkeypatch.setattr(sensitivity, 'list_names', lambda: chosen)
    assert run(file, '--sensitivity', '--set', 'height.beta=7.6') == 0
    lines = capfd.readouterr().out.splitlines()
    assert lines[0].split()[:3] == ['setting', 'value', 'to']
    rows = [line.split() for line in lines[1:]]
    assert {row[0] for row in rows} == set(chosen)
    beta = {row[2]: float(row[3]) for row in rows if row[0] == 'height.beta'}
    assert beta['9.12'] == 100.0  # above all wires
    assert beta['6.08'] < 5.0
    assert [float(row[3]) for row in rows if row[0] == 'supports.max_reach'] == [0.0, 0.0]
    assert max(float(row[3]) for row in rows[:2]) == 100.0


def test_steps_of_a_fifth():
    settings = update(Settings(), {'linearity.threshold': 0.9})
    assert change(settings, 'height.beta') == pytest.approx([3.2, 4.8])
    assert change(settings, 'linearity.num_scales') == [3, 5]
    assert change(settings, 'linearity.threshold') == pytest.approx([0.72, 1.0])
    assert change(settings, 'catenary.tolerance') == []
    assert measure_change(np.array([1, 2, 3]), np.array([2, 3, 4])) == pytest.approx(0.5)
    assert measure_change(np.zeros(0, int), np.zeros(0, int)) == 0.0


@pytest.mark.slow
def test_processes_give_what_one_gives(cloud):
    choices = [Settings(), update(Settings(), SPOILED), update(Settings(), {'height.beta': 6.0})]
    results = []
    for num in (1, 2):
        with Workers(cloud[0], 7, num_workers=num) as workers:
            results.append(list(workers.evaluate(choices)))
    assert len(results[0]) == len(choices)
    for (score, wire), (other, same) in zip(*results, strict=True):
        assert repr(score) == repr(other)  # NaN is not itself
        np.testing.assert_array_equal(wire, same)


@pytest.mark.slow
def test_an_interrupt_keeps_the_best_so_far(cloud):
    told = []

    def progress(step, share):
        told.append(step)
        if len(told) > 30:
            raise KeyboardInterrupt

    tuned = tune(cloud[0], update(Settings(), SPOILED), progress=progress)
    assert tuned.interrupted
    assert is_line(tuned.after)
    assert 15 < tuned.num_evaluations < 30
    assert tuned.after.value > tuned.before.value


@pytest.mark.slow
def test_a_terminal_shows_time_left_and_an_interrupt_writes_the_file(file, tmp_path):
    output = tmp_path / 'tuned.yaml'
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack('HHHH', 30, 90, 0, 0))
    code = 'import sys; from plc_inspect.offline.commands.tune import main; sys.exit(main())'
    process = subprocess.Popen(
        [sys.executable, '-c', code, str(file), '-o', str(output), '--budget', '100000',
         '--method', 'grid', *spoil()],
        stdout=subprocess.PIPE, stderr=slave, cwd=ROOT,
    )
    os.close(slave)
    shown, deadline = b'', time.monotonic() + 60
    while b'grid 20' not in shown and time.monotonic() < deadline:
        if select.select([master], [], [], 1.0)[0]:
            shown += os.read(master, 4096)
    process.send_signal(signal.SIGINT)
    out = process.communicate(timeout=60)[0].decode()
    os.close(master)
    assert process.returncode == 130
    assert b' left' in shown
    assert 'interrupted' in out
    assert 'interrupted' in output.read_text(encoding='utf-8')
    read_settings(output)
