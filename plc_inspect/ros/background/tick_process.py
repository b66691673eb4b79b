# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
A process of its own for the ticks.

In one process with the callbacks, ticks would wait for Python's lock for longer than they
compute, and callbacks for ticks.  What a tick needs is sent there, and what it found comes back;
the process keeps nothing from tick to tick, so another one can take its place.
"""

from collections.abc import Callable
import multiprocessing
from multiprocessing.connection import Connection
import os
import pickle
import signal
import subprocess
import sys
from typing import Any, TYPE_CHECKING

from plc_inspect.errors import PlcInspectError
from plc_inspect.ros.background.exchange import Exchange

if TYPE_CHECKING:
    from plc_inspect.config import Settings
    from plc_inspect.core.live.session import Session
    from plc_inspect.offline.records.flight import Snapshot
    from plc_inspect.ros.background.tick_job import Done


class TickProcessError(PlcInspectError):
    """The process of the ticks has ended, or cannot be started."""


class TickProcess:
    """
    Runs ticks in another process, for one thread at a time.

    It starts at once and loads its modules beside those of this process; one that has ended is
    followed by another one at the next call.

    Raises
    ------
    OSError
        It cannot be started.

    """

    def __init__(self) -> None:
        self._start()

    def _start(self) -> None:
        ours, theirs = multiprocessing.Pipe()
        try:
            # Ctrl-C is for the node's process group: it lets a tick end.  Of another session it
            # would be, as Linux shares cores between sessions, as nice as all others together.
            self._process = subprocess.Popen(
                [sys.executable, '-P', '-m', __name__, str(theirs.fileno())],
                pass_fds=(theirs.fileno(),), stdin=subprocess.DEVNULL, process_group=0,
                env=os.environ | {'PYTHONPATH': os.pathsep.join(sys.path)},
            )
        except OSError:
            ours.close()
            raise
        finally:
            theirs.close()
        self._connection = ours
        self._exchange = Exchange(ours, _list_shared(), first=True)

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    def prepare(self, settings: 'Settings', *, rare: bool = False) -> None:
        """Make ready what ticks need, as ``tick_job.prepare``."""
        self._call('prepare', settings, rare)

    def run_tick(self, session: 'Session', snapshot: 'Snapshot') -> 'Done':
        """
        Run a tick, as ``tick_job.run_tick``.

        Returns
        -------
        Done
            With another session, which replaces the one that was given; that is unchanged.

        Raises
        ------
        TickProcessError
            The process has ended.
        Exception
            As in the process.

        """
        from plc_inspect.ros.background.tick_job import Done

        (state, kept, after), labels, bundle = self._call('tick', session, snapshot)
        window, count = snapshot.window, len(labels)
        return Done(
            state=state, bundle=bundle, slots=window.slots[:count], points=window.points[:count],
            labels=labels, kept=kept, session=after,
        )

    def _call(self, name: str, *arguments: Any) -> tuple[Any, ...]:
        if self._process.poll() is not None:
            self.close()
            try:
                self._start()
            except OSError as error:
                raise TickProcessError(
                    f'the process of the ticks cannot be started: {error}'
                ) from error
        try:
            self._exchange.send(name, *arguments)
            answer = self._exchange.receive()
        except (OSError, EOFError) as error:
            raise TickProcessError(
                f'the process of the ticks ended with code {self._end()}; '
                'the next tick begins another one'
            ) from error
        except BaseException:
            self.close()  # nobody knows how much of it was sent
            raise
        if answer and isinstance(answer[0], Exception):
            raise answer[0]
        return answer

    def _end(self) -> int:
        """Return how the process ended; one that does not end is killed."""
        self._connection.close()
        try:
            return self._process.wait(1.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            return self._process.wait()

    def close(self) -> None:
        """End the process; a tick that runs fails."""
        self._process.kill()
        self._end()


def serve(connection: Connection) -> None:
    """Do what the other process asks for, until it ends."""
    from plc_inspect.ros.background.system_memory import give_back_memory
    from plc_inspect.ros.background.tick_job import prepare, run_tick

    begun = os.getpriority(os.PRIO_PROCESS, 0)

    def tick(session: 'Session', snapshot: 'Snapshot') -> tuple[Any, ...]:
        step_back(snapshot.flight.settings)
        done = run_tick(session, snapshot)
        return (done.state, done.kept, done.session), done.labels, done.bundle

    def make_ready(settings: 'Settings', rare: bool) -> tuple[()]:
        prepare(settings, rare=rare)
        return ()

    def step_back(settings: 'Settings') -> None:
        now = os.getpriority(os.PRIO_PROCESS, 0)
        wanted = min(begun + settings.segment.niceness, 19)
        if wanted > now:  # only root may lower it
            os.nice(wanted - now)

    calls: dict[str, Callable[..., tuple[Any, ...]]] = {'tick': tick, 'prepare': make_ready}
    exchange = Exchange(connection, _list_shared(), first=False)
    while True:
        try:
            name, *arguments = exchange.receive()
        except (EOFError, OSError):
            return
        try:
            answer = calls[name](*arguments)
        except Exception as error:
            exchange.send(_make_plain(error))
            continue
        exchange.send(*answer, forget=name == 'tick')
        del arguments, answer  # the next ones may be long in coming
        give_back_memory()


def _list_shared() -> tuple[type, ...]:
    """Return the classes of what a session keeps; the record tells by identity what is new."""
    from plc_inspect.core.setup.looks import Spread
    from plc_inspect.core.setup.plumb import Leans
    from plc_inspect.core.tracking.hazard_tracking import TrackedHazard
    from plc_inspect.core.tracking.tracked_span import TrackedSpan
    from plc_inspect.results import Support

    return TrackedSpan, TrackedHazard, Support, Spread, Leans


def _make_plain(error: Exception) -> Exception:
    """Return an error that can be sent: the same, or one that says what it was."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f'{type(error).__name__}: {error}')
    return error


def main() -> None:
    """Run the process."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT):
        signal.signal(number, signal.SIG_IGN)  # it ends with the node
    serve(Connection(int(sys.argv[1])))


if __name__ == '__main__':
    main()
