# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Run tasks in this process, on a local Dask cluster, or on an existing one.

Tasks are functions of plain values and paths, so no points pass through the scheduler.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
import importlib.util
import logging
from multiprocessing import resource_tracker
import os
import signal
import time
from typing import Any, Protocol

from plc_inspect.errors import DataError, PlcInspectError
from plc_inspect.grid.memory_limits import measure_left
from plc_inspect.interrupts import interruptible
from plc_inspect.printable import make_one_line

PENDING = 4
"""Tasks submitted ahead, per worker."""
ALLOWED_FAILURES = 3
"""Workers that may die on one task before it counts as failed."""
KEEP_FREED = {
    'MALLOC_ARENA_MAX': '1', 'MALLOC_TRIM_THRESHOLD_': str(2**31 - 1),
    'MALLOC_MMAP_MAX_': '0', 'MALLOC_TOP_PAD_': str(64 << 20),
}
"""
Environment of a worker: its C library keeps freed memory for the next arrays [bytes].

A worker runs tasks in a thread, which would have an arena of its own, and glibc gives the memory
of such an arena back whatever the threshold, as it does that of arrays of more than 32 MB: 42 s of
the system for 60 million points with two workers, 14 s so, and a peak 0.06 GB higher.
"""
QUIET = {'DASK_LOGGING__DISTRIBUTED': 'critical'}
"""
Environment of a worker: it tells nothing of a scheduler that has gone.

What fails is told as the outcome of a task. After Ctrl-C the scheduler may end while a worker asks
it, which the worker told with a traceback, once that it had let go of `silence_logs`.
"""
ALONE = {'NUMBA_NUM_THREADS': '1', 'RAYON_NUM_THREADS': '1', 'OMP_NUM_THREADS': '1'}
"""
Environment of a worker: one thread, as tiles are what is parallel.

With two threads a worker is 1.27 times as fast for 1.06 times the processor time (60 million
points): cores go further as workers.
"""
CONNECT_TIMEOUT = 15.0
"""Seconds to wait for a scheduler."""
TASKS_PER_WORKER = 2
"""Tasks for each worker below which another one is not started: it would wait for the last."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """One call."""

    name: str
    function: Callable[..., dict[str, Any]]
    arguments: tuple[Any, ...]
    size: int = 0
    """
    Roughly what it has to do; of a stage the largest run first, so that no worker idles long.
    """
    stage: str = ''


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """The outcome of a task."""

    name: str
    answer: dict[str, Any] | None
    """None if the task failed."""
    error: str = ''
    is_defect: bool = False
    """The error is a defect of the program, not of its input."""
    seconds: float = 0.0
    worker: str = ''
    stage: str = ''


class Engine(Protocol):
    """Runs tasks."""

    num_workers: int
    memory: float
    """Memory of each worker [bytes]."""
    address: str
    """Address of the dashboard, '' without one."""

    def run(self, tasks: Iterable[Task]) -> Iterator[Outcome]:
        """Run tasks and yield their outcomes in any order."""


def call(task: Task) -> Outcome:
    """Run one task in this process; an error becomes its outcome."""
    started = time.perf_counter()
    answer, error, is_defect = None, '', False
    try:
        with interruptible():  # else an interrupt fails the tile and the run goes on
            answer = task.function(*task.arguments)
    except PlcInspectError as fault:
        error = make_one_line(fault)
    except MemoryError as fault:
        error = f'not enough memory: {make_one_line(fault)}'
    except OSError as fault:
        where = f'{fault.filename}: ' if fault.filename else ''
        error = f'{where}{fault.strerror or make_one_line(fault)}'
    except Exception as fault:  # one tile may not end the others
        error, is_defect = f'{type(fault).__name__}: {make_one_line(fault)}', True
    return Outcome(
        name=task.name, stage=task.stage, answer=answer, error=error, is_defect=is_defect,
        seconds=time.perf_counter() - started, worker=f'{os.uname().nodename} {os.getpid()}',
    )


class OwnProcess:
    """Runs tasks one after the other in this process."""

    num_workers = 1
    address = ''

    def __init__(self, memory: float) -> None:
        """Set the memory that a task may use [bytes]."""
        self.memory = memory

    def run(self, tasks: Iterable[Task]) -> Iterator[Outcome]:
        """Run tasks in their order."""
        return map(call, tasks)


class DaskEngine:
    """Runs tasks by a Dask client."""

    def __init__(self, client: Any, memory: float | None) -> None:
        """Take a connected client; memory [bytes] defaults to that of the smallest worker."""
        self._client = client
        with suppress(TimeoutError):
            client.wait_for_workers(1, timeout=CONNECT_TIMEOUT)
        workers = client.scheduler_info(n_workers=-1)['workers']
        if not workers:
            raise DataError(f'the scheduler at {client.scheduler.address} has no workers')
        self.num_workers = sum(int(item['nthreads']) for item in workers.values())
        limits = [item['memory_limit'] / item['nthreads'] for item in workers.values()]
        least = min((limit for limit in limits if limit > 0), default=0.0)  # 0 is unlimited
        self.memory = memory or least or measure_available()
        self.address = str(client.dashboard_link or '')

    def run(self, tasks: Iterable[Task]) -> Iterator[Outcome]:
        """Run tasks, keeping PENDING for each worker submitted."""
        from distributed import as_completed

        waiting = iter(tasks)
        sent: dict[str, Task] = {}
        running = as_completed()
        try:
            for task in waiting:
                future = self._client.submit(call, task, pure=False)
                sent[future.key] = task
                running.add(future)
                if len(sent) >= PENDING * self.num_workers:
                    yield self._take(next(running), sent)
            while sent:
                yield self._take(next(running), sent)
        except BaseException:
            self._client.cancel(list(running.futures), force=True)
            raise

    def _take(self, future: Any, sent: dict[str, Task]) -> Outcome:
        task = sent.pop(future.key)
        error = future.exception()
        if error is None:
            outcome: Outcome = future.result()
            return outcome
        text = make_one_line(error) or type(error).__name__
        if type(error).__name__ == 'KilledWorker':
            text = (
                f'{ALLOWED_FAILURES + 1} workers died at it one after the other,'
                ' perhaps for lack of memory'
            )
        return Outcome(name=task.name, stage=task.stage, answer=None, error=text)


def count_workers(num_tasks: int, memory: float) -> int | None:
    """
    Return how many workers a local cluster should have.

    Parameters
    ----------
    num_tasks : int
        Long tasks, about.
    memory : float
        That a worker needs [bytes].

    Returns
    -------
    int or None
        At most one for each core.  None: this process, with all cores, as a second worker would
        not pay, or Dask is missing.

    """
    if importlib.util.find_spec('distributed') is None:
        return None
    cores = len(os.sched_getaffinity(0))
    num = min(cores, num_tasks // TASKS_PER_WORKER, int(measure_available() / memory))
    return num if num > 1 else None


@contextmanager
def open_engine(
    num_workers: int | None, scheduler: str | None, memory: float | None,
    timeout: float = CONNECT_TIMEOUT,
) -> Iterator[Engine]:
    """
    Start the engine, and stop it at the end of the block.

    Parameters
    ----------
    num_workers : int or None
        Processes of a local cluster, each with one thread. None: this process, with all cores.
    scheduler : str or None
        Address of a Dask scheduler, as tcp://host:8786, or a file that it wrote.
    memory : float or None
        Of each worker [bytes], by default what is free, divided among them.
    timeout : float
        To wait for a scheduler [s].

    Yields
    ------
    Engine

    Raises
    ------
    DataError
        No scheduler answers, or it has no workers.

    """
    if scheduler is None and num_workers is None:
        yield OwnProcess(memory or measure_available())
        return
    import dask

    dask.config.set({
        'distributed.scheduler.allowed-failures': ALLOWED_FAILURES,
        'distributed.comm.timeouts.connect': timeout,
        # a task holds its memory until it ends: nothing can be spilled
        'distributed.worker.memory.target': False, 'distributed.worker.memory.spill': False,
        'distributed.worker.memory.pause': False,
        # no samples of what a task does, nor of the event loops: they take a tenth of a core
        'distributed.worker.profile.enabled': False, 'distributed.admin.tick.interval': '1s',
    })
    if scheduler is not None:
        yield from _connect(scheduler, memory, timeout)
    elif num_workers is not None:
        yield from _start(num_workers, memory)


def _start(num_workers: int, memory: float | None) -> Iterator[Engine]:
    import dask
    from distributed import Client, LocalCluster

    each = memory or measure_available() / num_workers
    environment = make_environment()
    new = environment.keys() - os.environ.keys()
    dask.config.set({'distributed.nanny.pre-spawn-environ': environment})
    logging.getLogger('distributed').setLevel(logging.CRITICAL)  # of this process, as `QUIET`
    with _without_interrupts():
        local = LocalCluster(  # type: ignore[no-untyped-call]
            n_workers=num_workers, threads_per_worker=1, processes=True, memory_limit=int(each),
            dashboard_address='127.0.0.1:0', host='127.0.0.1', silence_logs=logging.CRITICAL,
        )
    with local as cluster, Client(cluster) as client:  # type: ignore[no-untyped-call]
        yield DaskEngine(client, each)
    for name in new:  # Dask sets them in this process as well
        os.environ.pop(name, None)


def make_environment() -> dict[str, str]:
    """Return the environment of each worker of this machine; what this process has set stays."""
    return {
        name: os.environ.get(name, value) for name, value in (KEEP_FREED | QUIET | ALONE).items()
    }


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """
    Start threads and processes with Ctrl-C blocked; it reaches this process after the block.

    A terminal sends Ctrl-C to the workers too, and each would end with a traceback.
    """
    resource_tracker.ensure_running()  # it lets interrupts in again where it starts
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _connect(scheduler: str, memory: float | None, timeout: float) -> Iterator[Engine]:
    is_file = os.path.isfile(scheduler)
    if not is_file and ':' not in scheduler:
        raise DataError(
            f'--scheduler {scheduler}: there is no such file; name that which the scheduler wrote,'
            ' or its address, as tcp://host:8786'
        )
    named = {'scheduler_file' if is_file else 'address': scheduler}
    try:
        try:
            client = _open_client(named, timeout)
        except AssertionError:  # other news came with the greeting, which Dask does not expect
            client = _open_client(named, timeout)
    except Exception as error:  # also of a file that holds no address, or of TLS without keys
        text = make_one_line(error) or type(error).__name__
        raise DataError(f'no Dask scheduler answers at {scheduler}: {text}') from error
    with client:
        yield DaskEngine(client, memory)


def _open_client(named: dict[str, str], timeout: float) -> Any:
    """
    Connect a client; one that fails is closed.

    Else it would be closed when it is collected, which may be while another one is being started:
    they would wait for one lock for ever.
    """
    from distributed import Client

    client = Client.__new__(Client)
    try:
        client.__init__(**named, timeout=timeout)  # type: ignore[misc, no-untyped-call]
    except BaseException:
        with suppress(Exception):
            client.close()  # type: ignore[no-untyped-call]
        raise
    return client


def measure_available() -> float:
    """Return the memory that is free and that limits allow, less a tenth [bytes]."""
    try:
        with open('/proc/meminfo', encoding='ascii') as file:
            values = dict(line.split(':', 1) for line in file)
        free = float(values['MemAvailable'].split()[0]) * 1024.0
    except (OSError, KeyError, ValueError):
        free = float(os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES')) / 2
    return 0.9 * max(min(free, measure_left()), 0.0)
