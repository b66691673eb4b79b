# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The plc_compare command on folders that were written."""

from dataclasses import replace
import json
from pathlib import Path
import re
import shutil

from factories import make_inspection
import numpy as np
import pytest

from plc_inspect.config import Settings
from plc_inspect.errors import DataError
from plc_inspect.offline.commands.compare import main, NAME
from plc_inspect.offline.export.results_folder import write_results
from plc_inspect.offline.readers.catalogue import load_rules
from plc_inspect.offline.records.changes import find_changes, read_survey, to_survey
from plc_inspect.offline.report.report import render_report
from plc_inspect.results import PointClass
from plc_inspect.setting_names import update

ROOT = Path(__file__).parents[3]
AS_HAZARDS = 'cleared_hazards', 'hazards_not_seen_again', 'unjudged_hazards_before'


def grow(inspection, by):
    """Let the vegetation of a run grow."""
    inspection.points[inspection.result.classification == PointClass.VEGETATION, 2] += by
    return inspection


@pytest.fixture(scope='module')
def folders(tmp_path_factory):
    """Write a run, the same a season later, and one elsewhere."""
    room = tmp_path_factory.mktemp('surveys')
    write_results(room / 'first', make_inspection(frame_id='odom'))
    write_results(room / 'second', grow(make_inspection(frame_id='odom', seed=1), 0.7))
    write_results(room / 'elsewhere', make_inspection(origin=(5000.0, 0.0, 0.0), frame_id='odom'))
    write_results(room / 'other_frame', make_inspection(frame_id='map'))
    write_results(room / 'crs', make_inspection(crs='EPSG:25832'))
    return room


def test_a_folder_read_back_is_what_was_written(folders):
    survey, inspection = read_survey(folders / 'first'), make_inspection(frame_id='odom')
    memory = to_survey(inspection)
    assert len(survey.spans) == 6
    for read, made in zip(survey.spans, inspection.result.spans, strict=True):
        assert (read.line_id, read.span_id, read.open_end) == (
            made.line_id, made.span_id, made.open_end)
        np.testing.assert_array_equal(read.start, made.start)
        assert (read.a, read.b, read.c, read.sag) == (made.a, made.b, made.c, made.sag)
    assert survey.hazards[0].clearance == inspection.result.hazards[0].clearance
    assert survey.vegetation == memory.vegetation
    np.testing.assert_allclose(np.sort(survey.canopy, axis=0), np.sort(memory.canopy, axis=0),
                               atol=1e-3)


def test_growth_is_measured(folders, tmp_path, capsys):
    path = tmp_path / 'changes.json'
    assert main([str(folders / 'first'), str(folders / 'second'), '-o', str(path)]) == 0
    record = json.loads(path.read_text(encoding='utf-8'))
    assert len(record['spans']) == 6
    assert record['growth'][0]['median'] == pytest.approx(0.7, abs=0.15)
    assert record['new_hazards'] == []
    assert len(record['kept_hazards']) == 1
    text = capsys.readouterr().out
    assert '6 spans in both surveys' in text
    assert 'the canopy rose by 0.7' in text
    assert main([str(folders / 'first'), str(folders / 'second'), '-o', str(path)]) == 2
    assert 'exists; --force' in capsys.readouterr().err


def list_keys(value):
    """List the keys of records within records, but for those of hazards as they are."""
    if isinstance(value, list):
        return {key for item in value for key in list_keys(item)}
    if not isinstance(value, dict):
        return set()
    return set(value) | {
        key for name, item in value.items()
        if name not in AS_HAZARDS for key in list_keys(item)
    }


def test_the_document_says_how_it_is_used(folders, tmp_path, monkeypatch, capsys):
    text = (ROOT / 'docs/results.md').read_text(encoding='utf-8')
    section = text.partition('## Two surveys compared')[2].partition('## The report')[0]
    commands = [line.split() for line in section.splitlines() if line.startswith('    ')]
    assert [command[0] for command in commands] == [NAME] * 2
    shutil.copytree(folders / 'first', tmp_path / 'spring')
    shutil.copytree(folders / 'second', tmp_path / 'autumn')
    monkeypatch.chdir(tmp_path)
    for command in commands:
        assert main(command[1:]) == 0
    assert capsys.readouterr().out.startswith('6 spans in both surveys, 0 lost, 0 added\n')
    changes = json.loads((tmp_path / 'changes.json').read_text(encoding='utf-8'))
    known = set(re.findall('`([a-z_]+)`', section))
    values = [name for name in known if f'{name}_before' in changes['spans'][0]]
    known |= {f'{name}_{end}' for name in values for end in ('before', 'after', 'change', 'sigma')}
    assert list_keys(changes) <= known


@pytest.mark.parametrize(('other', 'message'), [
    ('elsewhere', 'do not overlap'), ('other_frame', "frame 'odom'"), ('missing', 'no such'),
    ('crs', 'no reference system'), ('torn', 'cannot be read'), ('no_json', 'is not JSON'),
    ('holes', 'not understood'),
])
def test_bad_surveys_are_one_line_and_exit_2(folders, tmp_path, capsys, other, message):
    folder = folders / other
    if other in ('torn', 'no_json', 'holes'):
        folder = tmp_path / other
        shutil.copytree(folders / 'first', folder)
        if other == 'torn':
            laz = folder / 'points.laz'
            laz.write_bytes(laz.read_bytes()[:5000])
        elif other == 'no_json':
            (folder / 'spans.json').write_text('{', encoding='utf-8')
        else:
            content = json.loads((folder / 'spans.json').read_text(encoding='utf-8'))
            del content['spans'][0]['sag']
            (folder / 'spans.json').write_text(json.dumps(content), encoding='utf-8')
    path = tmp_path / 'changes.json'
    assert main([str(folders / 'first'), str(folder), '-o', str(path)]) == 2
    error = capsys.readouterr().err
    assert error.count('\n') == 1
    assert message in error
    assert not path.exists()


def test_frames_must_agree():
    first, second = make_inspection(crs='EPSG:25832'), make_inspection(crs='EPSG:25833')
    with pytest.raises(DataError, match=r'UTM zone 32N.*UTM zone 33N'):
        find_changes(to_survey(first), to_survey(second), 0.25)


def write_with_limits(folder, warning, critical, hazards=None, **changes):
    """Write the run of the factory as if raised by other limits, with some of its hazards."""
    settings = update(Settings(), {
        'hazards.warning_distance': warning, 'hazards.critical_distance': critical, **changes})
    inspection = make_inspection(frame_id='odom', settings=settings)
    if hazards is not None:
        inspection = replace(inspection, result=replace(inspection.result, hazards=hazards))
    write_results(folder, inspection)


def compare(before, after, path):
    """Compare two folders, and return what is written."""
    assert main([str(before), str(after), '-o', str(path), '--force']) == 0
    return json.loads(path.read_text(encoding='utf-8'))


def test_other_limits_clear_no_hazard(folders, tmp_path, capsys):
    (hazard,) = make_inspection().result.hazards
    assert 0.7 < hazard.clearance < 4.0
    write_with_limits(tmp_path / 'narrow', 0.7, 0.5, ())
    record = compare(folders / 'first', tmp_path / 'narrow', tmp_path / 'changes.json')
    assert record['cleared_hazards'] == []
    assert [item['hazard_id'] for item in record['unjudged_hazards_before']] == [0]
    assert record['limits'] == [
        {'name': 'hazards.warning_distance', 'before': 4.0, 'after': 0.7},
        {'name': 'hazards.critical_distance', 'before': 2.0, 'after': 0.5},
    ]
    text = capsys.readouterr().out
    assert 'hazards.warning_distance was 4.0 and is 0.7' in text
    assert '0 new, 0 kept, 0 cleared' in text
    # the other way nothing is new
    record = compare(tmp_path / 'narrow', folders / 'first', tmp_path / 'changes.json')
    assert (record['new_hazards'], record['unjudged_hazards']) == ([], [0])


def test_what_both_limits_raise_is_new_or_cleared(folders, tmp_path):
    # nothing is there, though 5 m would have raised it
    write_with_limits(tmp_path / 'clear', 5.0, 2.0, ())
    record = compare(folders / 'first', tmp_path / 'clear', tmp_path / 'changes.json')
    assert [item['hazard_id'] for item in record['cleared_hazards']] == [0]
    assert (record['unjudged_hazards_before'], len(record['limits'])) == ([], 1)
    record = compare(tmp_path / 'clear', folders / 'first', tmp_path / 'changes.json')
    assert (record['new_hazards'], record['unjudged_hazards']) == ([0], [])


def test_points_may_lie_beyond_a_limit_that_reaches_less_far(folders, tmp_path):
    write_with_limits(tmp_path / 'near', 3.0, 2.0, ())
    record = compare(folders / 'first', tmp_path / 'near', tmp_path / 'changes.json')
    assert record['cleared_hazards'] == []
    assert len(record['unjudged_hazards_before']) == 1


def test_a_folder_without_its_run_tells_no_limits(folders, tmp_path):
    shutil.copytree(folders / 'first', tmp_path / 'old')
    (tmp_path / 'old/run.json').unlink()
    record = compare(tmp_path / 'old', folders / 'second', tmp_path / 'changes.json')
    assert (record['limits'], len(record['kept_hazards'])) == ([], 1)


@pytest.mark.parametrize('change', [
    {'settings': {'hazards': 4}}, {'settings': []}, {'rules': 'plain'}, {'settings': {}},
])
def test_a_run_that_is_not_understood_is_one_line(folders, tmp_path, capsys, change):
    shutil.copytree(folders / 'first', tmp_path / 'odd')
    path = tmp_path / 'odd/run.json'
    path.write_text(json.dumps(
        {**json.loads(path.read_text(encoding='utf-8')), **change}), encoding='utf-8')
    assert main([str(tmp_path / 'odd'), str(folders / 'second')]) == 2
    error = capsys.readouterr().err
    assert error.count('\n') == 1
    assert 'run.json is not understood' in error


def test_a_part_of_a_wider_hazard_is_not_new(folders, tmp_path):
    # narrow limits raise two places where wide ones raise one
    (hazard,) = make_inspection().result.hazards
    write_with_limits(
        tmp_path / 'narrow', 3.5, 2.0, (hazard, replace(hazard, hazard_id=1)))
    record = compare(folders / 'first', tmp_path / 'narrow', tmp_path / 'changes.json')
    assert len(record['kept_hazards']) == 1
    assert record['new_hazards'] == []
    assert len(record['unjudged_hazards']) == 1


def test_equal_limits_are_not_spoken_of(folders, tmp_path, capsys):
    write_with_limits(tmp_path / 'grown', 4.0, 2.0, (), **{'hazards.growth': 0.5})
    record = compare(folders / 'first', tmp_path / 'grown', tmp_path / 'changes.json')
    assert (record['limits'], record['limits_note']) == ([], '')
    assert len(record['cleared_hazards']) == 1
    assert 'limits' not in capsys.readouterr().out


def test_rules_changed_since_are_another_edition(folders, tmp_path):
    rules = tmp_path / 'own.yaml'
    text = ('name: own\ntitle: own\nedition: "1"\nsource: test\n'
            'limits:\n  - {feature: vegetation, distance: 4.0}\n')
    rules.write_text(text, encoding='utf-8')
    settings = update(Settings(), {'hazards.rules': str(rules)})
    for name, edition in (('old', '1'), ('new', '2')):
        rules.write_text(text.replace('"1"', f'"{edition}"'), encoding='utf-8')
        write_results(tmp_path / name, make_inspection(
            frame_id='odom', settings=settings, rules=load_rules(settings.hazards)))
    record = compare(tmp_path / 'old', tmp_path / 'new', tmp_path / 'changes.json')
    assert record['limits'] == [{'name': 'edition of the rules', 'before': '1', 'after': '2'}]


def test_the_report_names_limits_that_differ(folders):
    settings = update(Settings(), {
        'hazards.warning_distance': 0.7, 'hazards.critical_distance': 0.5})
    inspection = make_inspection(frame_id='odom', settings=settings)
    inspection = replace(inspection, result=replace(inspection.result, hazards=()))
    changes = find_changes(read_survey(folders / 'first'), to_survey(inspection), 0.25)
    page = render_report(replace(inspection, changes=changes))
    assert 'Limits of hazards differ: hazards.warning_distance was 4.0 and is 0.7' in page
