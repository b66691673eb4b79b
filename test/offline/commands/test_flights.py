# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""``plc_replay`` over many recordings: each by itself, none twice, what fails is told."""

import json
import os

from offline.commands.test_replay import pipeline, run, write_bag
import pytest

from plc_inspect.errors import DataError
from plc_inspect.offline.commands.flights import expand_flights

__all__ = ['pipeline']


@pytest.fixture
def bags(tmp_path):
    """Write two flights, and one whose file is cut off, into folders of a folder."""
    folder = tmp_path / 'flown'
    for name in ('monday', 'tuesday', 'wednesday'):
        (folder / name).mkdir(parents=True)
        write_bag(folder / name / 'flight', num_scans=5 if name == 'monday' else 8)
    (damaged,) = (folder / 'wednesday').rglob('*.mcap')
    damaged.write_bytes(damaged.read_bytes()[:900])
    return folder


def test_each_flight_has_its_folder_and_a_damaged_one_is_told(bags, pipeline, tmp_path, capfd):
    out = tmp_path / 'out'
    assert run(bags, '-o', out) == 2
    text, error = capfd.readouterr()
    assert text.startswith('2 flights')
    assert error.count('\n') == 1
    assert error.startswith('plc_replay: flight_3: ')
    head = json.loads((out / 'run.json').read_text(encoding='utf-8'))
    assert head['totals']['flights'] == 2
    assert {name: item['num_points'] for name, item in head['flights'].items()} == {
        'flight': 50, 'flight_2': 80,
    }
    assert head['flights']['flight_2']['source'].endswith('tuesday/flight')
    page = (out / 'index.html').read_text(encoding='utf-8')
    assert 'flights/flight_2/report.html' in page
    assert 'flight_3' in page
    assert (out / 'flights/flight/report.html').is_file()
    assert not (out / 'flights/flight_3').exists()


def test_names_that_are_not_utf8_are_refused(tmp_path):
    bag = tmp_path / os.fsdecode(b'n\xff.mcap')
    bag.touch()
    with pytest.raises(DataError, match='its name is not UTF-8, as names in the ledger are: rena'):
        expand_flights([str(bag)])


def test_a_flight_is_replayed_once(bags, pipeline, tmp_path, capfd):
    out = tmp_path / 'out'
    flights = [bags / 'monday/flight', bags / 'tuesday/flight']
    assert run(*flights, '-o', out, '--quiet') == 0
    stamp = {path: path.stat().st_mtime_ns for path in out.glob('flights/*/run.json')}
    assert len(stamp) == 2
    pipeline.given = None
    assert run(*flights, '-o', out, '--quiet') == 0
    assert pipeline.given is None
    assert {path: path.stat().st_mtime_ns for path in stamp} == stamp
    assert run(*flights, '-o', out, '--quiet', '--set', 'map.min_points=2') == 0
    assert pipeline.given is not None


def test_results_of_flights_are_lost_by_force_alone(bags, pipeline, tmp_path, capfd):
    out = tmp_path / 'out'
    monday, tuesday = bags / 'monday/flight', bags / 'tuesday/flight'
    assert run(monday, tuesday, '-o', out, '--quiet') == 0
    assert run(tuesday, '-o', out, '--memory', '2') == 2
    assert capfd.readouterr().err == (
        f'plc_replay: {out} holds results of 1 of 2 inputs that are not named any more, as '
        f'{monday}: name them as well, or another folder; --force begins anew\n'
    )
    stamp = {path: path.stat().st_mtime_ns for path in out.glob('flights/*/run.json')}
    assert len(stamp) == 2
    # in another order they keep their names, and a flight that fails keeps its result
    (file,) = monday.rglob('*.mcap')
    file.write_bytes(file.read_bytes()[:900])
    assert run(tuesday, monday, '-o', out) == 2
    error = capfd.readouterr().err
    assert error.startswith('plc_replay: flight: ')
    assert error.endswith('; its earlier result is kept\n')
    assert json.loads((out / 'run.json').read_text())['totals']['flights'] == 1
    assert {path: path.stat().st_mtime_ns for path in stamp} == stamp
    assert run(tuesday, '-o', out, '--memory', '2', '--quiet', '--force') == 0
    assert sorted(path.name for path in (out / 'flights').iterdir()) == ['flight']


def test_a_search_passes_over_results(bags, pipeline, tmp_path, capfd):
    """They hold a recording for playback, results.mcap."""
    out = bags / 'out'
    for _ in range(2):
        assert run(bags, '-o', out, '--quiet') == 2
    assert run(bags / 'monday/flight', '-o', bags / 'single', '--quiet') == 0
    assert len(list(bags.rglob('results.mcap'))) == 3
    own = [bags / name / 'flight' for name in ('monday', 'tuesday', 'wednesday')]
    assert expand_flights([str(bags)], tmp_path / 'out') == own
    assert expand_flights([f'{bags}/*'], tmp_path / 'out') == own
    capfd.readouterr()
    named = bags / 'single/results.mcap'
    assert run(named, '-o', bags / 'single', '--force') == 2
    assert 'where the results go: name another folder' in capfd.readouterr().err
    assert expand_flights([str(named)], tmp_path / 'out') == [named]


def test_what_is_no_recording_is_refused(bags, tmp_path, capfd):
    out = tmp_path / 'out'
    (tmp_path / 'parts').mkdir()
    for number in range(2):
        (tmp_path / f'parts/bag_{number}.mcap').touch()
    for arguments, message in (
        ([tmp_path / '*.bag'], 'matches no file'),
        ([bags / 'monday/flight', tmp_path / 'none'], 'does not exist'),
        ([tmp_path / 'parts'], 'has no metadata.yaml and 2 files bag_N: parts of one recording?'),
        ([bags, '--origin', '59,18,20'], '--origin is for a single flight'),
        ([bags, '--baseline', bags], 'not a results folder'),
        ([bags, '--workers', '0'], '--workers must be 1 or more'),
        ([bags, '--workers', '2', '--memory', 'nan'], '--memory must be 0.1 or more, at most'),
        ([bags, '--workers', '2', '--memory', '-3'], '--memory must be 0.1 or more, at most'),
        ([bags, '--workers', '2', '--memory', '0.2'], '0.20 GB for a worker are too few: allow'),
    ):
        assert run(*arguments, '-o', out) == 2
        _, error = capfd.readouterr()
        assert error.count('\n') == 1
        assert message in error
    assert not out.exists()
