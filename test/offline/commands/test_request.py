# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Rules, conductors and cases from files and commands; what is wrong ends in one line, exit 2."""

import json

from factories import make_inspection
import laspy
import numpy as np
import pytest

from plc_inspect.config import HazardSettings
from plc_inspect.errors import ConfigError
from plc_inspect.offline.commands.request import hash_input
from plc_inspect.offline.commands.survey import main
from plc_inspect.offline.readers.catalogue import (
    GRAVITY,
    list_rules,
    load_conductor,
    load_rules,
    parse_case,
)
from plc_inspect.shared_files import find_shared

ROW = {'name': 'own', 'diameter': 20, 'mass': 1000, 'area': 300, 'modulus': 70000,
       'expansion': 2e-5, 'source': 'a letter'}


@pytest.fixture(scope='module')
def cloud(tmp_path_factory):
    """Write the points of three lines with a tree beside them."""
    path = tmp_path_factory.mktemp('cloud') / 'cloud.laz'
    header = laspy.LasHeader(version='1.4', point_format=6)
    header.scales = np.full(3, 0.001)
    las = laspy.LasData(header)
    las.xyz = make_inspection().points
    las.write(path)
    return path


def test_every_shipped_conductor_is_sound():
    text = find_shared('conductors.yaml').read_text(encoding='utf-8')
    names = [line.partition('name: ')[2].partition(',')[0] for line in text.splitlines()
             if 'name: ' in line]
    assert len(names) >= 6
    assert {name.split()[0] for name in names} >= {'ACSR', 'AAAC'}
    for name in names:
        conductor = load_conductor(name)
        assert conductor.source
        density = conductor.weight / GRAVITY / (np.pi / 4 * conductor.diameter**2)
        assert 1500 < density < 3500
        assert 1.4e-5 < conductor.expansion < 2.4e-5


def test_drake_in_newtons_and_metres():
    drake = load_conductor(' acsr drake ')
    assert drake.weight == pytest.approx(15.95, abs=0.01)
    assert drake.stiffness == pytest.approx(36.07e6, rel=1e-3)
    assert drake.diameter == pytest.approx(1.108 * 0.0254, abs=1e-5)


def test_another_table(tmp_path):
    path = tmp_path / 'own.yaml'
    path.write_text(json.dumps([ROW]), encoding='utf-8')
    assert load_conductor('OWN', path).weight == pytest.approx(1000e-3 * GRAVITY)
    with pytest.raises(ConfigError, match="unknown conductor 'drake'; there are own"):
        load_conductor('drake', path)


@pytest.mark.parametrize(('content', 'message'), [
    ('{', 'is not a YAML'), ('[]', 'list of conductors'), ('[1]', 'row 1 is not a mapping'),
    (json.dumps([{**ROW, 'mass': -1}]), 'mass must be a positive number, got -1'),
    (json.dumps([{**ROW, 'colour': 'red'}]), 'colour is unknown'),
    (json.dumps([{key: ROW[key] for key in ROW if key != 'source'}]), 'source is missing'),
])
def test_bad_tables(tmp_path, content, message):
    path = tmp_path / 'bad.yaml'
    path.write_text(content, encoding='utf-8')
    with pytest.raises(ConfigError, match=message):
        load_conductor('own', path)
    with pytest.raises(ConfigError, match='cannot be read'):
        load_conductor('own', tmp_path / 'missing.yaml')


def test_cases():
    case = parse_case('winter: temperature=-5, ice=0.01, wind=15')
    assert (case.name, case.temperature, case.ice, case.wind) == ('winter', -5.0, 0.01, 15.0)
    assert parse_case('temperature=80').name == '80 C'
    assert parse_case('temperature=-5,ice=0.01,wind=15').name == '-5 C, 10 mm ice, 15 m/s wind'


@pytest.mark.parametrize(('text', 'message'), [
    ('', 'expected temperature'), ('ice=0.1', 'has no temperature'), ('hot', 'expected'),
    ('temperature=warm', "'warm' is not a number"), ('temperature=20,temperature=30', 'expected'),
    ('temperature=20,ice=10', r'ice must lie in \[0, 0.5\] m, got 10'), ('temperature=nan', 'lie'),
])
def test_bad_cases(text, message):
    with pytest.raises(ConfigError, match=message):
        parse_case(text)


def test_rule_sets_by_name_and_by_file(tmp_path):
    assert load_rules(HazardSettings()).name == 'plain'
    assert load_rules(HazardSettings(rules='en50423_cz')).name == 'en50423_cz'
    assert 'nerc_fac_003_4' in list_rules()
    path = tmp_path / 'own.yaml'
    path.write_text(
        'name: own\ntitle: t\nedition: "1"\nsource: s\n'
        'limits: [{feature: vegetation, distance: 2}]\n', encoding='utf-8',
    )
    assert load_rules(HazardSettings(rules=str(path))).limits[0].distance == 2.0
    for name in ('nope', '../conductors'):
        with pytest.raises(ConfigError, match=r'unknown rule set .*; there are plain, en50423_cz'):
            load_rules(HazardSettings(rules=name))


def test_checksum_of_a_file_and_a_folder(tmp_path):
    (tmp_path / 'b').write_bytes(b'two')
    (tmp_path / 'a').write_bytes(b'one')
    whole = hash_input(tmp_path)
    (tmp_path / 'c').write_bytes(b'onetwo')
    assert hash_input(tmp_path / 'c') == whole
    assert len(whole) == 64


@pytest.mark.parametrize(('arguments', 'message'), [
    (['--rules', 'nope'], 'unknown rule set'),
    (['--rules', 'go95_case_13'], 'no limit for a line of unknown voltage'),
    (['--rules', 'nerc_fac_003_4', '--voltage', '230'], 'give hazards.elevation'),
    (['--case', 'temperature=80'], '--case needs --conductor'),
    (['--case', 'temperature=80', '--conductor', 'ACSR Drake'], '--case needs --surveyed-at'),
    (['--case', 'temperature=80', '--conductor', 'string', '--surveyed-at', '15'],
     "unknown conductor 'string'"),
    (['--case', 'temperature=80', '--case', 'temperature=80', '--conductor', 'ACSR Drake',
      '--surveyed-at', '15'], 'names of cases must differ'),
    (['--case', 'as surveyed: temperature=80', '--conductor', 'ACSR Drake', '--surveyed-at', '15'],
     "also from 'as surveyed'"),
    (['--case', 'cold', '--conductor', 'ACSR Drake', '--surveyed-at', '15'], 'expected'),
    (['--case', 'temperature=80', '--conductor', 'ACSR Drake', '--surveyed-at', '900'],
     'temperature must lie'),
    (['--baseline', 'nowhere'], 'no such results folder'),
    (['--voltage', '-3'], 'hazardsettings.voltage must lie'),
    (['--geo'], 'no projected coordinate reference system'),
    (['--set', 'hazards.critical_distance=9'], 'is greater than hazards.warning_distance'),
])
def test_bad_requests_are_one_line_and_exit_2(cloud, tmp_path, capsys, arguments, message):
    out = tmp_path / 'out'
    assert main([str(cloud), '-o', str(out), *arguments]) == 2
    error = capsys.readouterr().err
    assert error.count('\n') == 1
    assert message in error.lower() or message in error
    assert not list(tmp_path.iterdir())


def test_rules_cases_and_baseline_end_up_in_the_folder(cloud, tmp_path):
    first, second = tmp_path / 'first', tmp_path / 'second'
    assert main([str(cloud), '-o', str(first), '--quiet']) == 0
    assert main([
        str(cloud), '-o', str(second), '--quiet', '--rules', 'en50423_cz', '--voltage', '22',
        '--baseline', str(first), '--case', 'temperature=60', '--conductor', 'ACSR Drake',
        '--surveyed-at', '15', '--crs', 'EPSG:25832', '--force',
    ]) == 2  # the baseline has no reference system
    assert main([
        str(cloud), '-o', str(second), '--quiet', '--rules', 'en50423_cz', '--voltage', '22',
        '--baseline', str(first), '--case', 'temperature=60', '--conductor', 'ACSR Drake',
        '--surveyed-at', '15',
    ]) == 0
    hazards = json.loads((second / 'hazards.json').read_text(encoding='utf-8'))['hazards']
    assert hazards
    for item in hazards:
        assert item['voltage'] == '22 kV'
        if item['kind'] == 'vegetation':
            assert item['edition'] == 'EN 50423'
            assert item['required'] in (0.5, 0.6)
    what_if = json.loads((second / 'whatif.json').read_text(encoding='utf-8'))
    assert [case['name'] for case in what_if['cases']] == ['60 C']
    assert all(row['outcomes'][1]['sag'] > row['outcomes'][0]['sag'] for row in what_if['spans'])
    changes = json.loads((second / 'changes.json').read_text(encoding='utf-8'))
    assert all(abs(row['height_change']) < 1e-9 for row in changes['spans'])
    run = json.loads((second / 'run.json').read_text(encoding='utf-8'))
    assert run['input']['sha256'] == hash_input(cloud)
    page = (second / 'report.html').read_text(encoding='utf-8')
    for word in ('What if', 'Changes since first', '22 kV', 'roads cannot be told'):
        assert word in page
