# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The plc_compare command on folders that were written."""

import json
from pathlib import Path
import re
import shutil

from factories import make_inspection
import numpy as np
import pytest

from plc_inspect.errors import DataError
from plc_inspect.offline.commands.compare import main, NAME
from plc_inspect.offline.export.results_folder import write_results
from plc_inspect.offline.records.changes import find_changes, read_survey, to_survey
from plc_inspect.results import PointClass

ROOT = Path(__file__).parents[3]


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
        if name not in ('cleared_hazards', 'hazards_not_seen_again') for key in list_keys(item)
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
