# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""One thread that does the long work, one job at a time."""

from collections.abc import Callable
from dataclasses import dataclass
import threading
from typing import Any

from plc_inspect.ros.background.system_memory import give_back_memory


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a job."""

    value: Any
    """What it returned, None if it failed."""
    error: Exception | None


class Worker:
    """
    Runs a job in a thread of its own and tells when it is done.

    Parameters
    ----------
    notify : callable
        Called in the worker's thread after each job, such as the trigger of a guard condition.

    """

    def __init__(self, notify: Callable[[], object]) -> None:
        self._notify = notify
        self._condition = threading.Condition()
        self._job: Callable[[], Any] | None = None
        self._outcome: Outcome | None = None
        self._busy = False
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name='plc_worker', daemon=True)
        self._thread.start()

    @property
    def busy(self) -> bool:
        """Whether a job runs, or its outcome was not taken yet."""
        with self._condition:
            return self._busy

    def submit(self, job: Callable[[], Any]) -> None:
        """
        Start a job.

        Raises
        ------
        RuntimeError
            Another job runs, its outcome was not taken, or the worker was stopped.

        """
        with self._condition:
            if self._busy or self._stopping:
                raise RuntimeError('the worker is busy' if self._busy else 'the worker stopped')
            self._busy = True
            self._job = job
            self._condition.notify_all()

    def take(self) -> Outcome | None:
        """Return the outcome of the job that is done, once; None if there is none."""
        with self._condition:
            outcome, self._outcome = self._outcome, None
            if outcome is not None:
                self._busy = False
            return outcome

    def stop(self, timeout: float) -> bool:
        """
        Let the job that runs end, and the thread with it.

        Parameters
        ----------
        timeout : float
            Longest wait [s].

        Returns
        -------
        bool
            Whether the thread has ended.

        """
        with self._condition:
            self._stopping = True
            self._condition.notify_all()
        self._thread.join(timeout)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while True:
            with self._condition:
                self._condition.wait_for(lambda: self._job is not None or self._stopping)
                job, self._job = self._job, None
            if job is None:
                return
            try:
                outcome = Outcome(job(), None)
            except Exception as error:
                outcome = Outcome(None, error)
            with self._condition:
                self._outcome = outcome
            self._notify()
            del job, outcome  # the next ones may be long in coming
            give_back_memory()
