# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A real scheduler with two workers: one is killed, an input is damaged, a run goes on."""

import os
import signal
import threading
import time
from types import SimpleNamespace

from grid.clusters import start_cluster
from grid.grids import inspect, make_line, open_run, write_las
from grid.tasks import (
    DEADLINE,
    fail,
    fill_twice,
    refuse,
    sleep_and_tell,
    tell_of_loss,
    tell_threads,
)
import numpy as np
import pytest

from plc_inspect import __version__
from plc_inspect.errors import DataError
from plc_inspect.grid import engine
from plc_inspect.grid.engine import make_environment, open_engine, OwnProcess, Task
from plc_inspect.grid.ledger import Ledger

distributed = pytest.importorskip('distributed')
MEMORY = 2e9


@pytest.fixture(scope='module')
def cluster(tmp_path_factory):
    """Start a scheduler and two workers as processes of their own."""
    with start_cluster(tmp_path_factory.mktemp('cluster')) as own:
        yield own


def test_a_killed_worker_loses_nothing(cluster, tmp_path):
    named, workers = cluster
    with open_engine(2, str(named), MEMORY) as engine:
        engine._client.wait_for_workers(2, DEADLINE)  # raises where they do not come

        def kill():
            until = time.monotonic() + DEADLINE
            while len(list(tmp_path.glob('*.*'))) < 2 and time.monotonic() < until:
                time.sleep(0.02)
            workers[0].send_signal(signal.SIGKILL)
            workers[0].wait(DEADLINE)
            (tmp_path / 'go').touch()

        killer = threading.Thread(target=kill)
        killer.start()
        tasks = [
            Task(name=f't{k}', function=sleep_and_tell, arguments=(str(tmp_path), k))
            for k in range(4)
        ]
        tasks += [Task(name='bad', function=fail, arguments=()),
                  Task(name='none', function=refuse, arguments=())]
        outcomes = {outcome.name: outcome for outcome in engine.run(tasks)}
        killer.join()
    assert [outcomes[f't{k}'].answer['number'] for k in range(4)] == [0, 1, 2, 3]
    assert {outcomes[f't{k}'].answer['process'] for k in range(4)} == {workers[1].pid}
    assert outcomes['bad'].error == 'ZeroDivisionError: by zero'
    assert outcomes['bad'].is_defect
    assert outcomes['none'].error == 'no such thing'
    assert not outcomes['none'].is_defect


@pytest.mark.slow
def test_a_cluster_gives_what_one_process_gives(cluster, tmp_path):
    named, _ = cluster
    points = make_line(2)
    good = write_las(tmp_path / 'a.laz', points)
    bad = write_las(tmp_path / 'b.laz', points[:2000] + np.array([0.0, 0.0, 0.01]))
    bad.write_bytes(bad.read_bytes()[:-3000])
    alone, _ = inspect(tmp_path / 'alone', [good], halo=130.0, edge=60.0)
    folder = tmp_path / 'out'
    with open_engine(2, str(named), MEMORY) as engine:
        both, _ = inspect(folder, [good, bad], engine=engine, halo=130.0, edge=60.0)
        told = []
        again, _ = inspect(folder, [good, bad], told, engine=engine, halo=130.0, edge=60.0)
    assert both.num_points == len(points)
    assert [stage for stage, *_ in both.failures] == ['cut']
    assert 'b.laz' in both.failures[0][2]
    assert 'truncated' in both.failures[0][2]
    assert [span.sag for span in both.joined.spans] == [span.sag for span in alone.joined.spans]
    assert [span.sag for span in again.joined.spans] == [span.sag for span in both.joined.spans]
    assert ('cut', 1, 2, 0) in told
    assert ('tile', 0, 1, 0) not in told
    with Ledger(folder, __version__) as ledger:
        assert ledger.list_failures()[0][0] == 'cut'


def test_a_run_that_was_stopped_goes_on(tmp_path):
    class Stopped(OwnProcess):
        def run(self, tasks):
            for number, outcome in enumerate(super().run(tasks)):
                if number == 2:
                    raise KeyboardInterrupt
                yield outcome

    with Ledger(tmp_path, __version__) as ledger:
        tasks = [Task(name=f't{k}', function=dict, arguments=()) for k in range(5)]
        keys = {task.name: 'key' for task in tasks}
        run = open_run(tmp_path, ledger, engine=Stopped(MEMORY))
        with pytest.raises(KeyboardInterrupt):
            run.run('stage', tasks, keys)
    told = []
    with Ledger(tmp_path, __version__) as ledger:
        run = open_run(tmp_path, ledger, told=told)
        assert len(run.run('stage', tasks, keys)) == 5
    assert told[0] == ('stage', 2, 5, 0)
    assert told[-1] == ('stage', 5, 5, 0)


@pytest.mark.parametrize('num', [1, 2])
def test_a_worker_has_one_thread_and_a_process_of_its_own(num, monkeypatch):
    for name in engine.ALONE:
        monkeypatch.delenv(name, raising=False)
    tasks = [Task(name=str(k), function=tell_threads, arguments=()) for k in range(num)]
    with open_engine(num, None, MEMORY) as local:
        answers = [outcome.answer for outcome in local.run(tasks)]
    assert [answer['threads'] for answer in answers] == [1] * num
    assert os.getpid() not in {answer['process'] for answer in answers}


def test_without_workers_tasks_run_in_this_process():
    with open_engine(None, None, MEMORY) as own:
        (outcome,) = own.run([Task(name='one', function=tell_threads, arguments=())])
    assert outcome.answer['process'] == os.getpid()


def test_what_is_set_for_workers_stays(monkeypatch):
    monkeypatch.setenv('NUMBA_NUM_THREADS', '3')
    assert make_environment()['NUMBA_NUM_THREADS'] == '3'


def test_a_worker_keeps_freed_memory_for_the_next_arrays():
    with open_engine(2, None, MEMORY) as engine:
        task = Task(name='fill', function=fill_twice, arguments=(100, 3_000_000))
        (outcome,) = engine.run([task])
    assert 'MALLOC_ARENA_MAX' not in os.environ
    assert outcome.answer['mapped'] < 1000  # of 73,000 pages


def test_a_worker_that_ends_says_nothing(capfd):
    with open_engine(2, None, MEMORY) as engine:
        (outcome,) = engine.run([Task(name='loss', function=tell_of_loss, arguments=())])
    assert outcome.answer['process'] != os.getpid()
    assert 'DASK_LOGGING__DISTRIBUTED' not in os.environ
    assert 'the scheduler is lost' not in capfd.readouterr().err


def test_no_scheduler_is_one_clear_error():
    with pytest.raises(DataError, match=r'no Dask scheduler answers at tcp://127.0.0.1:9'), \
            open_engine(1, 'tcp://127.0.0.1:9', MEMORY, timeout=0.5):
        pass
    with pytest.raises(DataError, match=r'^--scheduler none.json: there is no such file; name'), \
            open_engine(1, 'none.json', MEMORY):
        pass


@pytest.mark.parametrize('text', ['junk', '{}', '[]', '{"address": 5}', '{"address": "http://a"}'])
def test_a_file_that_no_scheduler_wrote_is_one_clear_error(text, tmp_path):
    path = tmp_path / 'scheduler.json'
    path.write_text(text)
    with pytest.raises(DataError, match=f'no Dask scheduler answers at {path}: .'), \
            open_engine(1, str(path), MEMORY, timeout=0.5):
        pass


def test_memory_is_that_of_the_smallest_worker_with_a_limit(monkeypatch):
    monkeypatch.setattr(engine, 'measure_available', lambda: 5e9)
    for limits, expected in (([0, 4e9, 6e9], 2e9), ([0, 0], 5e9)):
        workers = {
            str(k): {'nthreads': 2, 'memory_limit': limit} for k, limit in enumerate(limits)
        }
        client = SimpleNamespace(
            wait_for_workers=lambda *_, **__: None, dashboard_link='',
            scheduler_info=lambda n_workers, workers=workers: {'workers': workers},
        )
        assert engine.DaskEngine(client, None).memory == expected
        assert engine.DaskEngine(client, 1e9).memory == 1e9


def test_tls_without_keys_is_one_clear_error():
    with pytest.raises(DataError, match='check your TLS configuration'), \
            open_engine(1, 'tls://127.0.0.1:9', MEMORY, timeout=0.5):
        pass


def test_a_scheduler_without_workers_is_one_clear_error(tmp_path, monkeypatch):
    monkeypatch.setattr(engine, 'CONNECT_TIMEOUT', 0.1)
    with start_cluster(tmp_path, num_workers=0) as (named, _), pytest.raises(
        DataError, match=r'the scheduler at tcp://127\.0\.0\.1:\d+ has no workers'
    ), open_engine(1, str(named), MEMORY, timeout=DEADLINE):
        pass


def test_a_greeting_that_dask_does_not_understand_is_asked_for_again(tmp_path, monkeypatch):
    """Where a worker comes or goes in that moment, more than the greeting is sent."""
    tries = []

    def start(self, **options):
        tries.append(self.status)
        real(self, **options)
        if len(tries) == 1:
            raise AssertionError

    real = distributed.Client.start
    with start_cluster(tmp_path, num_workers=1) as (named, _):
        monkeypatch.setattr(distributed.Client, 'start', start)
        with open_engine(1, str(named), MEMORY, timeout=DEADLINE) as found:
            assert found.num_workers == 1
    assert len(tries) == 2


def test_two_runs_do_not_share_a_folder(tmp_path):
    with Ledger(tmp_path, __version__) as ledger:
        ledger.keep_fact('a', 1)
        with pytest.raises(DataError, match='in use by another run'):
            Ledger(tmp_path, __version__)


@pytest.mark.parametrize(('num_tasks', 'memory', 'num'), [
    (1000, 1e9, 8), (10, 1e9, 5), (1000, 6e9, 3), (3, 1e9, None), (1000, 11e9, None),
])
def test_a_local_cluster_is_the_default_where_it_pays(num_tasks, memory, num, monkeypatch):
    """It has a core, memory and two tasks for each worker, else there is none."""
    monkeypatch.setattr(engine.os, 'sched_getaffinity', lambda _: set(range(8)))
    monkeypatch.setattr(engine, 'measure_available', lambda: 20e9)
    assert engine.count_workers(num_tasks, memory) == num


def test_without_dask_this_process_runs_all(monkeypatch):
    monkeypatch.setattr(engine.importlib.util, 'find_spec', lambda name: None)
    monkeypatch.setattr(engine, 'measure_available', lambda: 1e12)
    assert engine.count_workers(1000, 1e9) is None
