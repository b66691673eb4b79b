# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Saving: checked when it is set, answered to all who ask, bounded at the end."""

import json
import threading
from threading import Event
import time
from types import SimpleNamespace

import pytest
from rclpy.parameter import Parameter
from rig import Rig, wait_for
from spans import make_hazard
from std_srvs.srv import Trigger

from plc_inspect.core.tracking.hazard_tracking import HazardNews
from plc_inspect.errors import ConfigError
from plc_inspect.offline.export import files
from plc_inspect.offline.records.flight import MAP_FULL
from plc_inspect.ros.background import tick_job
from plc_inspect.ros.background.saving import Saved
from plc_inspect.ros.node import doubt, jobs
from plc_inspect.ros.node.inspect_node import InspectNode
from plc_inspect.ros.node.intake import Intake


@pytest.fixture
def home(tmp_path, monkeypatch):
    """Return where results go that cannot go elsewhere."""
    monkeypatch.setenv('ROS_HOME', str(tmp_path / 'home'))
    return tmp_path / 'home' / 'plc_inspect'


@pytest.fixture
def rig(home, tmp_path):
    """Return a node that has seen the sample, and has a results folder."""
    rig = Rig(**{'output.directory': str(tmp_path / 'out')})
    rig.feed()
    rig.call('segment')
    rig.feed(2)
    rig.call('segment')
    yield rig
    rig.close()


def block(tmp_path, kind):
    """Return a folder that cannot be a results folder, and why."""
    if kind == 'below a file':
        (tmp_path / 'file').write_text('')
        return tmp_path / 'file' / 'out', 'file'
    (tmp_path / 'foreign').mkdir()
    (tmp_path / 'foreign' / 'mine.txt').write_text('keep')
    return tmp_path / 'foreign', 'mine.txt'


@pytest.mark.parametrize('kind', ['below a file', 'of something else'])
def test_folder_that_cannot_be_written_is_refused(rig, tmp_path, kind):
    folder, reason = block(tmp_path, kind)
    setting = Parameter('output.directory', value=str(folder))
    answer = rig.node.set_parameters([setting])[0]
    assert not answer.successful
    assert 'read-only' in answer.reason  # who may set parameters may not write elsewhere
    assert rig.node.settings.output.directory == str(tmp_path / 'out')
    with pytest.raises(ConfigError, match=reason):
        InspectNode(context=rig.contexts[1], namespace='/other', parameter_overrides=[setting])


def test_a_reset_saves_first(rig, home):
    assert rig.call('segment').success
    assert rig.node.state.confirmed
    assert rig.call('reset').success
    (folder,) = home.iterdir()
    assert len(json.loads((folder / 'spans.json').read_text())['spans']) >= 3
    assert rig.node.state is None


def test_what_cannot_be_saved_is_not_reset(rig, monkeypatch):
    found = len(rig.node.state.confirmed)
    with monkeypatch.context() as patch:
        nowhere = Saved(folder=None, whole=False, problem='the disk is full')
        patch.setattr(jobs, 'save_results', lambda *_: nowhere)
        answer = rig.call('reset')
    assert not answer.success
    assert answer.message == (
        f'not reset: {found} spans would be lost, and cannot be saved: the disk is full'
    )
    assert len(rig.node.state.confirmed) == found
    assert len(rig.node.intake.accumulator.map)
    assert rig.call('reset').success
    assert rig.node.state is None


def test_folder_that_became_foreign_is_replaced_by_another(rig, home, tmp_path):
    (tmp_path / 'out').mkdir()
    (tmp_path / 'out' / 'mine.txt').write_text('keep')
    answer = rig.call('save')
    assert answer.success, answer.message
    (folder,) = home.iterdir()
    assert f'saved to {folder}' in answer.message
    assert 'mine.txt' in answer.message
    assert len(json.loads((folder / 'spans.json').read_text())['spans']) == 6
    rig.feed(2)
    assert rig.call('segment').success


def test_writer_that_fails_leaves_the_tables(rig, tmp_path, monkeypatch):
    def fail(*arguments):
        raise RuntimeError('a decoder in Rust gave up')

    monkeypatch.setattr(files, 'write_points', fail)
    answer = rig.call('save')
    assert answer.success
    assert 'RuntimeError: a decoder in Rust gave up' in answer.message
    assert f'tables only to {tmp_path / "out"}' in answer.message
    assert len(json.loads((tmp_path / 'out' / 'spans.json').read_text())['spans']) == 6
    assert not (tmp_path / 'out' / 'points.laz').exists()


@pytest.mark.slow
@pytest.mark.parametrize('pause', [0.0, 0.08])
@pytest.mark.parametrize('service', ['segment', 'save'])
def test_two_hundred_calls_are_answered(rig, service, pause):
    """Also those of a client that keeps ten answers, as by default, and stands still at times."""
    client = rig.client.create_client(Trigger, f'/plc_inspect/{service}')
    timer = rig.client.create_timer(0.25, lambda: time.sleep(pause))
    assert client.wait_for_service(10.0)
    futures = [client.call_async(Trigger.Request()) for _ in range(200)]
    wait_for(lambda: all(future.done() for future in futures), '200 answers')
    assert all(future.result().success for future in futures)
    rig.in_turn(lambda: rig.client.destroy_timer(timer))
    rig.in_turn(lambda: rig.client.destroy_client(client))


@pytest.mark.parametrize('service', ['segment', 'save'])
def test_a_call_is_answered_by_a_job_that_begins_after_it(rig, monkeypatch, service):
    module, name = {'segment': (tick_job, 'run_tick'), 'save': (jobs, 'run_save')}[service]
    run, began, released, sequences = getattr(module, name), Event(), Event(), []

    def wait(session, snapshot):
        began.set()
        assert released.wait(60.0)
        sequences.append(snapshot.window.sequence)
        return run(session, snapshot)

    monkeypatch.setattr(module, name, wait)
    rig.feed(2)
    client = rig.client.create_client(Trigger, f'/plc_inspect/{service}')
    assert client.wait_for_service(10.0)
    try:
        futures = [client.call_async(Trigger.Request())]
        assert began.wait(10.0)
        rig.feed(2)
        futures.append(client.call_async(Trigger.Request()))
        queue = rig.node._saving if service == 'save' else rig.node._segmenting
        wait_for(lambda: queue, 'second call')
    finally:
        released.set()
    wait_for(lambda: all(future.done() for future in futures), 'answers')
    assert all(future.result().success for future in futures)
    assert sequences == [sequences[0], rig.node.intake.accumulator.map.sequence]
    assert sequences[1] >= sequences[0] + 2
    rig.in_turn(lambda: rig.client.destroy_client(client))


def test_calls_are_answered_where_no_job_can_begin(rig, monkeypatch):
    def fail(*arguments, **options):
        raise ValueError('made to fail')

    monkeypatch.setattr(rig.node._planner, 'plan', fail)
    answer = rig.call('segment')
    assert not answer.success
    assert answer.message == 'step: ValueError: made to fail'


def test_end_is_bounded_where_the_map_takes_for_ever(rig, tmp_path, monkeypatch, capfd):
    released = threading.Event()
    monkeypatch.setattr(jobs, 'RESCUE_AFTER', 0.2)
    monkeypatch.setattr(jobs, 'GIVE_UP_AFTER', 0.5)
    monkeypatch.setattr(jobs, 'conclude', lambda *_: released.wait(60.0) and None)
    try:
        assert not rig.node.close()
    finally:
        released.set()
    said = capfd.readouterr().err
    assert f'results of the last tick, without points: saved to {tmp_path / "out"}' in said
    assert 'not worked through within 0.5 s' in said
    assert len(json.loads((tmp_path / 'out' / 'spans.json').read_text())['spans']) == 6
    run = json.loads((tmp_path / 'out' / 'run.json').read_text())
    assert run['input']['counts']['results_of'] == 'the last tick'


def test_results_of_the_whole_map_replace_those_of_the_last_tick(rig, tmp_path, monkeypatch):
    released = threading.Event()
    real = jobs.conclude

    def late(session, snapshot):
        assert released.wait(60.0)
        return real(session, snapshot)

    monkeypatch.setattr(jobs, 'RESCUE_AFTER', 0.2)
    monkeypatch.setattr(jobs, 'conclude', late)
    threading.Timer(2.0, released.set).start()
    assert rig.node.close()
    run = json.loads((tmp_path / 'out' / 'run.json').read_text())
    assert 'results_of' not in run['input']['counts']
    assert run['num_points_written'] > 1000


def test_map_that_fails_at_the_end_is_said(rig, tmp_path, monkeypatch, capfd):
    def fail(*arguments):
        raise ValueError('made to fail')

    monkeypatch.setattr(jobs, 'conclude', fail)
    assert not rig.node.close()
    said = capfd.readouterr().err
    assert 'the map failed: ValueError: made to fail' in said
    assert len(json.loads((tmp_path / 'out' / 'spans.json').read_text())['spans']) == 6


def test_the_end_tells_why_it_takes_a_hazard_back(monkeypatch, tmp_path):
    news = HazardNews().clear([make_hazard((1.0, 2.0, 3.0), hazard_id=7)], 'the wind')
    state = SimpleNamespace(sharpness=SimpleNamespace(poor=False), news=news)
    monkeypatch.setattr(jobs, 'conclude', lambda *_: (state, None, None))
    monkeypatch.setattr(jobs, 'save_results', lambda *_: Saved(folder=tmp_path, whole=True))
    flight = SimpleNamespace(settings=SimpleNamespace(output=None), first_stamp_ns=0)
    said, warned = [], []
    jobs.FinalSave(said.append, warned.append).run(None, SimpleNamespace(flight=flight), None)
    assert warned[0].startswith('hazard 7 cleared: warning, vegetation 3.00 m')
    assert warned[0].endswith('; the wind')


@pytest.mark.parametrize('trusted', [False, True])
def test_a_doubt_about_the_odometry_holds_hazards_back_and_is_told(
    rig, tmp_path, monkeypatch, trusted
):
    if trusted:  # the flight is young
        monkeypatch.setattr(doubt, 'TRUSTED_NS', 0)
    assert rig.call('segment').success
    accumulator = rig.node.intake.accumulator
    accumulator.follower.steady.doubt = 'the heading drifts: results are held back'
    answer = rig.call('segment')
    assert not answer.success
    assert answer.message == accumulator.doubt
    wait_for(lambda: rig.node.state.sharpness.poor, 'the doubt')
    assert rig.node.state.hazards == ()
    assert rig.node.state.sharpness.describe() == accumulator.doubt
    assert bool(rig.node.state.confirmed) == trusted
    assert not rig.node.close()
    run = json.loads((tmp_path / 'out' / 'run.json').read_text())
    assert run['input']['counts']['held_back'] == accumulator.doubt


@pytest.mark.parametrize('at', ['end', 'reset'])
def test_results_of_a_full_map_say_why_the_rest_is_held_back(
    rig, home, tmp_path, monkeypatch, at
):
    why = f'{MAP_FULL} with 9 voxels and has gaps: results are held back'
    monkeypatch.setattr(Intake, 'doubt', why)
    if at == 'end':
        assert not rig.node.close()
        folder = tmp_path / 'out'
    else:
        assert rig.call('reset').success
        (folder,) = home.iterdir()
    run = json.loads((folder / 'run.json').read_text())
    assert run['num_spans'] >= 3
    assert run['held_back'] == why
