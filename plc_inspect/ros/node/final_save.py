# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The results at the end of the node: bounded in time, and never without a trace."""

from collections.abc import Callable
from dataclasses import replace
import threading

import numpy as np

from plc_inspect.core.live.session import LiveState, Session
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.ros.node.jobs import conclude, describe_run, Snapshot
from plc_inspect.ros.node.saving import save_results, Saved

RESCUE_AFTER = 20.0
"""Results of the last tick are written where those of the whole map take longer [s]."""
GIVE_UP_AFTER = 120.0
"""The whole map is waited for no longer [s]."""


class FinalSave:
    """
    Writes the results of the whole map, or those of the last tick.

    Parameters
    ----------
    say, complain : callable
        Take a line of text for the log.

    """

    def __init__(self, say: Callable[[str], object], complain: Callable[[str], object]) -> None:
        self._say, self._complain = say, complain
        self._writing = threading.Lock()
        self._saved: Saved | None = None
        self._error: Exception | None = None

    def run(self, session: Session, snapshot: Snapshot, state: LiveState | None) -> bool:
        """
        Write the results of the whole map.

        Parameters
        ----------
        session : Session
            What is known; belongs to this object from now on.
        snapshot : Snapshot
            The whole map.
        state : LiveState or None
            Of the last tick, for when the map takes too long or fails.

        Returns
        -------
        bool
            Whether all files of the whole map were written.

        """
        thread = threading.Thread(
            target=self._conclude, args=(session, snapshot), name='plc_save', daemon=True
        )
        thread.start()
        thread.join(RESCUE_AFTER)
        if thread.is_alive() and self._writing.acquire(blocking=False):
            try:
                self._rescue(snapshot, state, f'the map takes longer than {RESCUE_AFTER:g} s')
            finally:
                self._writing.release()
        thread.join(max(GIVE_UP_AFTER - RESCUE_AFTER, 0.0))
        if thread.is_alive():
            self._complain(f'the map was not worked through within {GIVE_UP_AFTER:g} s')
        elif self._error is not None:
            self._complain(f'the map failed: {type(self._error).__name__}: {self._error}')
            self._rescue(snapshot, state, 'the map failed')
        elif self._saved is not None:
            tell = self._complain if self._saved.problem else self._say
            tell(self._saved.describe())
            return self._saved.whole
        return False

    def rescue(self, snapshot: Snapshot, state: LiveState | None, reason: str) -> None:
        """Write the results of the last tick alone, where a job keeps the map busy."""
        self._rescue(snapshot, state, reason)

    def _conclude(self, session: Session, snapshot: Snapshot) -> None:
        try:
            _, inspection, _ = conclude(session, snapshot)
        except Exception as error:
            self._error = error
            return
        with self._writing:
            self._saved = save_results(
                snapshot.settings.output, snapshot.first_stamp_ns, inspection
            )

    def _rescue(self, snapshot: Snapshot, state: LiveState | None, reason: str) -> None:
        if state is None:
            self._complain(f'nothing saved: {reason}, and no tick was done before')
            return
        empty = np.empty((0, 3))
        result = replace(
            Pipeline(snapshot.settings, snapshot.rules).run(empty),
            spans=tuple(item.span for item in state.confirmed),
            supports=state.supports, hazards=state.hazards,
        )
        part = replace(snapshot, counts={**snapshot.counts, 'results_of': 'the last tick'})
        saved = save_results(
            snapshot.settings.output, snapshot.first_stamp_ns, describe_run(part, result, empty)
        )
        self._complain(f'{reason}; results of the last tick, without points: {saved.describe()}')
