# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""``plc_recover`` makes results of a record that ends anywhere, as the node does at the end."""

from dataclasses import replace
import json
import time

import numpy as np
import pytest

from plc_inspect.config import Settings
from plc_inspect.core.live.session import Session
from plc_inspect.core.live.warm_up import make_sample
from plc_inspect.core.mapping.accumulator import Accumulator
from plc_inspect.core.setup.looks import Spread
from plc_inspect.flight_record.layout import list_segments
from plc_inspect.flight_record.plain_values import to_plain
from plc_inspect.flight_record.recording import Recording
from plc_inspect.offline.commands.recover import main
from plc_inspect.offline.readers.catalogue import load_rules
from plc_inspect.offline.records.flight import MAP_FULL
from plc_inspect.ros.node.diagnostics import Health
from plc_inspect.ros.node.intake import Intake
from plc_inspect.setting_names import to_mapping, update

SETTINGS = update(Settings(), {'map.max_voxels': 200_000, 'hazards.warning_distance': 4.5})


def make_record(folder, spreads=()):
    """Write the record of a flight that was killed; return what was known in it."""
    intake = Intake(SETTINGS, Health(), print)
    voxels, session = intake.accumulator.map, Session()
    intake.accumulator.resume(('odom', 'base_link'), None, None)
    rules = load_rules(SETTINGS.hazards)
    recording = Recording(voxels, intake.remember, print)
    recording.begin(
        folder, {'settings': to_mapping(SETTINGS), 'rules': to_plain(rules)}, fresh=True
    )
    rng = np.random.default_rng(0)
    for _ in range(4):
        points = make_sample()
        voxels.insert(points[rng.random(len(points)) < 0.6])
        recording.flush()
        until = time.monotonic() + 30.0
        while recording._recorder.busy and time.monotonic() < until:
            time.sleep(0.01)  # each in a chunk of its own
    state, result, _ = session.conclude(voxels.centroids(), SETTINGS, 1, complete=True)
    recording.keep(replace(session.remember(), spreads=spreads))
    recording.flush()
    recording.close()
    return state, result


@pytest.fixture(scope='module')
def record(tmp_path_factory):
    """Return the record of a flight that was killed, and what was known in it."""
    folder = tmp_path_factory.mktemp('flight') / 'out.record'
    return folder, *make_record(folder)


def read(folder, name):
    """Return a table of a results folder."""
    return json.loads((folder / f'{name}.json').read_text(encoding='utf-8'))


def test_results_are_those_of_the_node(record, tmp_path, capsys):
    folder, state, result = record
    out = tmp_path / 'out'
    assert main([str(folder), '-o', str(out)]) == 0
    assert 'report.html' in capsys.readouterr().out
    run, spans = read(out, 'run'), read(out, 'spans')
    assert run['command'] == 'plc_recover'
    assert run['settings']['hazards']['warning_distance'] == 4.5
    assert spans['frame_id'] == 'odom'
    assert [(row['line_id'], row['span_id']) for row in spans['spans']] == [
        item.key for item in state.confirmed
    ]
    for row, span in zip(spans['spans'], result.spans, strict=True):
        np.testing.assert_allclose(row['start'], span.start, rtol=0, atol=1e-9)
        assert row['sag'] == pytest.approx(span.sag, abs=1e-9)
    assert [row['hazard_id'] for row in read(out, 'hazards')['hazards']] == [
        item.hazard_id for item in state.hazards
    ]
    assert run['num_points_written'] > 1000


def test_cut_record_says_what_it_lacks(record, tmp_path, capsys):
    (segment,) = list_segments(record[0])
    data = segment.read_bytes()
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(data[: len(data) * 3 // 5])
    assert main([str(cut), '-o', str(tmp_path / 'out')]) == 0
    assert 'are cut off or damaged' in capsys.readouterr().out
    assert len(read(tmp_path / 'out', 'spans')['spans']) == 6


@pytest.mark.parametrize(('apart', 'told'), [
    (0.07, 'hazards are held back'), (9.0, 'nothing is looked for in it'),
])
def test_hazards_are_held_back_as_they_were_in_flight(tmp_path, capsys, apart, told):
    spreads = Spread(1, np.full(50, apart**2), np.zeros(0), np.full(50, 0.02**2)),
    state, _ = make_record(tmp_path / 'it.record', spreads)
    assert state.hazards
    assert main([str(tmp_path / 'it.record'), '-o', str(tmp_path / 'out')]) == 2
    assert told in capsys.readouterr().err
    assert read(tmp_path / 'out', 'hazards')['hazards'] == []
    assert len(read(tmp_path / 'out', 'spans')['spans']) == len(state.confirmed)
    assert told in read(tmp_path / 'out', 'run')['held_back']


@pytest.mark.parametrize(('doubt', 'keeps'), [
    ('the heading turns by 1.2 degrees against the positions: results are held back', False),
    (f'{MAP_FULL} with 9 voxels and has gaps: results are held back', True),
])
def test_what_was_in_doubt_in_flight_is_said_and_hazards_are_kept_of_a_full_map_only(
    tmp_path, capsys, monkeypatch, doubt, keeps
):
    monkeypatch.setattr(Intake, 'doubt', doubt)
    state, _ = make_record(tmp_path / 'it.record')
    assert state.hazards
    assert main([str(tmp_path / 'it.record'), '-o', str(tmp_path / 'out')]) == 2
    said = capsys.readouterr().err
    assert doubt in said
    assert said.count('\n') == 1
    assert read(tmp_path / 'out', 'run')['held_back'] == doubt
    hazards = read(tmp_path / 'out', 'hazards')['hazards']
    assert [row['hazard_id'] for row in hazards] == [
        item.hazard_id for item in state.hazards if keeps
    ]
    assert len(read(tmp_path / 'out', 'spans')['spans']) == len(state.confirmed)


def test_doubt_about_a_full_map_is_told_from_others():
    intake = Intake(SETTINGS, Health(), print)
    intake.evictor.resume(1, 0.0)
    assert intake.doubt.startswith(MAP_FULL)


def test_folder_that_is_there_needs_force(record, tmp_path, capsys):
    arguments = [str(record[0]), '-o', str(tmp_path / 'out'), '--quiet']
    assert main(arguments) == 0
    assert main(arguments) == 2
    assert '--force' in capsys.readouterr().err
    assert main([*arguments, '--force']) == 0
    assert capsys.readouterr().out == ''


@pytest.mark.parametrize('content', [None, b'', b'\x89MCAP0\r\n and then nothing of it'])
def test_what_is_no_record_is_one_line(tmp_path, content, capsys):
    path = tmp_path / 'it.record'
    if content is not None:
        path.write_bytes(content)
    assert main([str(path), '-o', str(tmp_path / 'out')]) == 2
    said = capsys.readouterr().err
    assert said.startswith('plc_recover: ')
    assert said.count('\n') == 1
    assert not (tmp_path / 'out').exists()


def test_accumulator_goes_on_counting():
    accumulator = Accumulator(SETTINGS)
    accumulator.add_pose(0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), frame_id='odom')
    before = accumulator.counters()
    other = Accumulator(SETTINGS)
    other.resume(('odom', ''), before, 5)
    assert not other.add_pose(1, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), frame_id='map')
    assert other.add_pose(1, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), frame_id='odom')
    now = other.counters()
    assert (now.num_poses, now.poses_rejected) == (3, {'another frame': 1})
    assert other.last_inserted == 5
