# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What the stages of one run report, how long they took, and what earlier runs know already."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
import threading
import time
from typing import Any, TypeVar

from plc_inspect.results import StageReport

Progress = Callable[[str, float], None]
"""Called with the name of a stage and the share of stages done before it."""
T = TypeVar('T')
STAGES = (
    'height', 'linearity', 'outliers', 'alignment', 'clustering', 'catenary', 'supports',
    'corridor', 'hazards',
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What one stage kept and dropped."""

    num_in: int
    num_kept: int
    dropped: dict[str, int] = field(default_factory=dict)
    """Reason to count; reasons that drop nothing are left out of the report."""
    values: dict[str, Any] = field(default_factory=dict)
    """Thresholds used and values derived from the data, JSON-serialisable."""


class StageMemory:
    """
    The newest results of each stage, by the settings they depend on.

    For one cloud only: the points are no part of a key.  May be shared by threads.
    """

    def __init__(self, room: int = 2) -> None:
        """Keep up to ``room`` results of each stage; the one unused for longest goes first."""
        self._room = room
        self._kept: dict[str, OrderedDict[Hashable, Any]] = {}
        self._lock = threading.Lock()
        self.num_found: dict[str, int] = {}
        """Results that were taken from here, by stage."""

    def find(self, stage: str, key: Hashable) -> Any:
        """Return what was kept, None if there is nothing."""
        with self._lock:
            kept = self._kept.get(stage, OrderedDict())
            if key not in kept:
                return None
            kept.move_to_end(key)
            self.num_found[stage] = self.num_found.get(stage, 0) + 1
            return kept[key]

    def keep(self, stage: str, key: Hashable, result: Any) -> None:
        """Keep a result."""
        with self._lock:
            kept = self._kept.setdefault(stage, OrderedDict())
            kept[key] = result
            kept.move_to_end(key)
            while len(kept) > self._room:
                kept.popitem(last=False)


class StageLog:
    """
    Runs the stages of one pass through the pipeline and collects their reports.

    Parameters
    ----------
    progress : callable or None
        Told of each stage that begins.
    memory : StageMemory or None
        Of the points of this pass.  What it knows is not computed again.

    """

    def __init__(
        self, progress: Progress | None = None, memory: StageMemory | None = None
    ) -> None:
        self.reports: list[StageReport] = []
        self.num_strays = 0
        """Points far from all others that were left out before the first stage."""
        self.num_lone = 0
        """Returns of dusty air that were."""
        self._progress = progress
        self._memory = memory
        self._key: tuple[Hashable, ...] = ()
        self._started = self._begun = time.perf_counter()
        if progress is not None:
            progress(STAGES[0], 0.0)

    def begin_again(self) -> None:
        """Drop all reports, as the stages run once more for another ground."""
        self.reports.clear()
        self._memory, self._key = None, ()
        self._started = self._begun

    def run(
        self, settings: Hashable, compute: Callable[[], T], describe: Callable[[T], Outcome]
    ) -> T:
        """
        Run the next stage, or recall what it gave, and report it.

        Parameters
        ----------
        settings : hashable or None
            What the stage depends on besides the stages before it.  None: it always runs, and
            so do all stages after it.
        compute : callable
            Runs the stage.
        describe : callable
            Says what the stage kept and dropped.

        Returns
        -------
        What ``compute`` gives.

        """
        stage = STAGES[len(self.reports)]
        if settings is None:
            self._memory = None
        self._key = (*self._key, settings)
        result, outcome = self.recall(stage, self._key, lambda: _settle(compute, describe))
        now = time.perf_counter()
        self.reports.append(StageReport(
            name=stage,
            num_in=outcome.num_in,
            num_kept=outcome.num_kept,
            dropped={reason: count for reason, count in outcome.dropped.items() if count},
            values=outcome.values,
            seconds=now - self._started,
        ))
        self._started = now
        done = len(self.reports)
        if self._progress is not None and done < len(STAGES):
            self._progress(STAGES[done], done / len(STAGES))
        return result

    def recall(self, name: str, key: Hashable, compute: Callable[[], T]) -> T:
        """Return what was computed under a name with the same key, or compute it now."""
        if self._memory is None:
            return compute()
        known: tuple[T] | None = self._memory.find(name, key)
        if known is None:
            known = (compute(),)
            self._memory.keep(name, key, known)
        return known[0]

    def recall_after(self, name: str, settings: Hashable, compute: Callable[[], T]) -> T:
        """Do what `recall` does for what depends on all stages so far and on some settings."""
        return self.recall(name, (*self._key, settings), compute)


def _settle(compute: Callable[[], T], describe: Callable[[T], Outcome]) -> tuple[T, Outcome]:
    result = compute()
    return result, describe(result)
