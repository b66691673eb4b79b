# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A run that is killed, or interrupted, goes on where it was and comes to the same end."""

from contextlib import closing, suppress
import json
import os
from pathlib import Path
import shutil
import signal
import sqlite3
import subprocess
import sys
import time

from grid.clusters import start_cluster
from grid.grids import make_line, write_las
from grid.tasks import DEADLINE as LOADED
import pytest

from plc_inspect.offline.commands.command_line import INTERRUPTED

pytestmark = pytest.mark.slow

SURVEY = (
    'import sys; from plc_inspect.offline.commands.survey import main;'
    ' sys.exit(main(sys.argv[1:]))'
)
DEADLINE = 4 * LOADED
"""Workers load all kernels first [s]."""
TABLES = ('spans.json', 'supports.json', 'hazards.json', 'spans.csv')


@pytest.fixture(scope='module')
def cloud(tmp_path_factory):
    """Write a line of two spans."""
    return write_las(tmp_path_factory.mktemp('cloud') / 'line.las', make_line(2))


STARTED = []


@pytest.fixture(autouse=True, scope='module')
def end_all():
    """Leave no process behind, whatever failed."""
    yield
    for process in STARTED:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait(DEADLINE)


def start(cloud, out, *options):
    """Start plc_survey over many tiles, a process group of its own."""
    STARTED.append(subprocess.Popen(
        [sys.executable, '-c', SURVEY, str(cloud), '-o', str(out), '--tile', '60', '--halo', '60',
         '--memory', '2', '--quiet', *options],
        stderr=subprocess.PIPE, text=True, start_new_session=True,
        env=os.environ | {'PYTHONPATH': str(Path(__file__).parents[2]), 'NUMBA_NUM_THREADS': '1'},
    ))
    return STARTED[-1]


def count_done(out):
    """Return how many tiles the ledger of a run that goes on tells as done."""
    try:
        with closing(sqlite3.connect(f'file:{out}/ledger.sqlite?immutable=1', uri=True)) as file:
            return sum(file.execute(
                "SELECT COUNT(*) FROM task WHERE stage = 'tile' AND state = 'done'"
            ).fetchone())
    except sqlite3.Error:  # not there yet, or in the middle of a write
        return 0


def wait_for_tiles(process, out, num):
    """Wait until some tiles are done, by what they leave behind."""
    until = time.monotonic() + DEADLINE
    while len(list(out.glob('work/tiles/*.json'))) < num:
        assert process.poll() is None, process.stderr.read()
        assert time.monotonic() < until
        time.sleep(0.01)


def list_group(number):
    """List the processes of a group that run; what ended and waits to be asked does not."""
    found = []
    for path in Path('/proc').glob('[0-9]*/stat'):
        try:
            state, _, group = path.read_text().rpartition(')')[2].split()[:3]
        except OSError:  # it has ended
            continue
        if int(group) == number and state != 'Z':
            found.append(path.parent.name)
    return found


@pytest.fixture(scope='module')
def whole(cloud, tmp_path_factory):
    """Run without interruption; return its tables."""
    out = tmp_path_factory.mktemp('whole') / 'out'
    process = start(cloud, out)
    _, error = process.communicate(timeout=DEADLINE)
    assert process.returncode == 0, error
    return {name: (out / name).read_bytes() for name in TABLES}


def test_a_killed_client_goes_on_where_it_was(cloud, whole, tmp_path):
    out = tmp_path / 'out'
    process = start(cloud, out)
    wait_for_tiles(process, out, 3)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    assert process.returncode == -signal.SIGKILL
    assert not (out / 'index.html').exists()
    before = {path: path.stat().st_mtime_ns for path in out.glob('work/tiles/*.json')}
    again = start(cloud, out)
    _, error = again.communicate(timeout=DEADLINE)
    assert again.returncode == 0, error
    assert {name: (out / name).read_bytes() for name in TABLES} == whole
    kept = [path for path, stamp in before.items() if path.stat().st_mtime_ns == stamp]
    assert len(kept) >= len(before) - 1  # the last may not have reached the ledger
    assert count_done(out) > len(kept)


@pytest.mark.parametrize('workers', [1, 2])
def test_ctrl_c_ends_in_order(workers, cloud, whole, tmp_path):
    if workers > 1:
        pytest.importorskip('distributed')
    out = tmp_path / 'out'
    process = start(cloud, out, '--workers', str(workers))
    wait_for_tiles(process, out, 2)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does, to the workers as well
    _, error = process.communicate(timeout=DEADLINE)
    assert process.returncode == INTERRUPTED, error
    assert 'Traceback' not in error
    assert not (out / 'index.html').exists()
    until = time.monotonic() + DEADLINE
    while list_group(process.pid) and time.monotonic() < until:
        time.sleep(0.05)
    assert list_group(process.pid) == []  # no worker is left behind
    again = start(cloud, out)
    _, error = again.communicate(timeout=DEADLINE)
    assert again.returncode == 0, error
    assert {name: (out / name).read_bytes() for name in TABLES} == whole


def list_tiles(out):
    """Return the process that inspected each tile, by the ledger of a run that ended."""
    with closing(sqlite3.connect(f'file:{out}/ledger.sqlite?mode=ro', uri=True)) as file:
        return {name: int(worker.split()[1]) for name, worker in file.execute(
            "SELECT name, worker FROM task WHERE stage = 'tile' AND state = 'done'"
        )}


def test_a_worker_and_then_the_client_are_killed_beside_a_truncated_tile(cloud, tmp_path):
    pytest.importorskip('distributed')
    tiles, out = tmp_path / 'tiles', tmp_path / 'out'
    tiles.mkdir()
    shutil.copy(cloud, tiles / 'a.las')
    bad = write_las(tiles / 'b.laz', make_line(1))
    bad.write_bytes(bad.read_bytes()[:-3000])
    quiet = start(tiles, tmp_path / 'alone')
    quiet.communicate(timeout=DEADLINE)
    assert quiet.returncode == 2
    with start_cluster(tmp_path) as (named, workers):
        process = start(tiles, out, '--scheduler', str(named))
        wait_for_tiles(process, out, 2)
        workers[0].kill()
        workers[0].wait(LOADED)
        wait_for_tiles(process, out, len(list(out.glob('work/tiles/*.json'))) + 1)
        process.kill()
        process.communicate()
        assert not (out / 'index.html').exists()
        before = list_tiles(out)
        again = start(tiles, out, '--scheduler', str(named))
        _, error = again.communicate(timeout=DEADLINE)
        survivor = workers[1].pid
    assert again.returncode == 2, error
    assert f'{bad} cannot be read, is it truncated?' in error
    assert {name: (out / name).read_bytes() for name in TABLES} == {
        name: (tmp_path / 'alone' / name).read_bytes() for name in TABLES
    }
    assert len(json.loads((out / 'spans.json').read_text())['spans']) == 6
    after = list_tiles(out)
    assert 1 <= len(before) < len(after)  # both were killed in the middle
    assert {name: after[name] for name in before} == before  # and not inspected again
    assert {after[name] for name in after.keys() - before.keys()} == {survivor}
    rows = json.loads((out / 'run.json').read_text())['failures']
    assert [(stage, str(bad) in text) for stage, _, text in rows] == [('cut', True)]
