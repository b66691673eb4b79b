# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Scores of many settings at once, in worker processes that each hold the cloud."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
import multiprocessing
import os
from pathlib import Path
import signal
import tempfile
from types import TracebackType
from typing import Self

import numba
import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.tuning.objective import Objective, Score
from plc_inspect.results import Bool, Float64, Int64

LEAST_POINTS = 200_000
"""Points of a cloud below which starting workers does not pay."""
NUM_WORKERS = 2

_objective: Objective | None = None


class Workers:
    """
    Evaluates settings on one cloud in order, in several processes if that is faster.

    A context manager.  Uses processes because half of an evaluation is Python code, see
    docs/tuning.md.
    """

    def __init__(
        self,
        points: Float64,
        seed: int,
        truth: tuple[Bool, Bool] | None = None,
        num_workers: int | None = None,
        base: Settings | None = None,
    ) -> None:
        """Take what an Objective takes; its points are (N, 3) [m]."""
        self._given = points, seed, truth, base
        if num_workers is None:
            enough = len(points) >= LEAST_POINTS
            num_workers = min(NUM_WORKERS, os.cpu_count() or 1) if enough else 1
        self.num_workers = num_workers
        self._objective: Objective | None = None
        self._pool: ProcessPoolExecutor | None = None
        self._folder: tempfile.TemporaryDirectory[str] | None = None

    def __enter__(self) -> Self:
        """Start the workers."""
        points, seed, truth, base = self._given
        if self.num_workers == 1:
            self._objective = Objective(points, seed=seed, truth=truth, base=base)
            return self
        self._folder = tempfile.TemporaryDirectory(prefix='plc_tune_')
        path = Path(self._folder.name) / 'points.npy'
        np.save(path, points)
        self._pool = ProcessPoolExecutor(
            self.num_workers, multiprocessing.get_context('spawn'), _start,
            (path, seed, truth, base),
        )
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop the workers; running evaluations are lost."""
        if self._pool is not None:
            running = list((self._pool._processes or {}).values())
            self._pool.shutdown(wait=False, cancel_futures=True)
            if kind is not None:
                for process in running:
                    process.terminate()
            for process in running:
                process.join()
        if self._folder is not None:
            self._folder.cleanup()

    def evaluate(self, choices: Sequence[Settings]) -> Iterator[tuple[Score, Int64]]:
        """Yield the score and the wire points of each of several settings, in their order."""
        if self._pool is not None:
            waiting = [self._pool.submit(_evaluate, settings) for settings in choices]
            for item in waiting:
                yield item.result()
        elif self._objective is not None:
            for settings in choices:
                yield self._objective.evaluate(settings)


def _start(
    path: Path, seed: int, truth: tuple[Bool, Bool] | None, base: Settings | None
) -> None:
    """Prepare a worker process; interrupts are the parent's."""
    global _objective
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    numba.set_num_threads(1)
    points = np.asarray(np.load(path, mmap_mode='c'))
    _objective = Objective(points, seed=seed, truth=truth, base=base)


def _evaluate(settings: Settings) -> tuple[Score, Int64]:
    if _objective is None:
        raise RuntimeError('the worker was not started')
    return _objective.evaluate(settings)
