# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What is told where the odometry is found to be wrong: what was known before it went wrong."""

from collections import deque
from dataclasses import replace

from plc_inspect.core.live.session import LiveState
from plc_inspect.core.mapping.accumulator import Accumulator

TRUSTED_NS = 15_000_000_000
"""
Age from which a state is trusted though the odometry is found to be wrong now [ns].
Source: measured: bench/flights/drawn_flights.py and the demo flight: a heading that drifts by 0.1
degrees/s is found within 12 s, faster ones sooner.
"""


class KnownStates:
    """Keeps what was known after the last ticks; owned by one thread."""

    def __init__(self, nothing: LiveState) -> None:
        self._nothing = nothing
        """What is told where nothing can be trusted."""
        self._states: deque[tuple[int, LiveState]] = deque()

    @property
    def state(self) -> LiveState | None:
        """What is known now, None before the first tick."""
        return self._states[-1][1] if self._states else None

    def add(self, stamp_ns: int, state: LiveState) -> None:
        """
        Add the state after a tick, and the stamp of the newest scan in it [ns].

        What is from later was before time went back, and is forgotten.
        """
        while self._states and self._states[-1][0] > stamp_ns:
            self._states.pop()
        self._states.append((stamp_ns, state))
        while len(self._states) > 1 and stamp_ns - self._states[1][0] >= TRUSTED_NS:
            self._states.popleft()

    def hold_back(self, entry: Accumulator) -> LiveState | None:
        """
        Return what can be told where the odometry is found to be wrong.

        Parameters
        ----------
        entry : Accumulator
            Of the map.

        Returns
        -------
        LiveState or None
            The newest that is old enough to be trusted, without hazards; None where nothing is
            wrong, and where that is told already.

        """
        doubt, now = entry.doubt, entry.last_inserted or 0
        if not doubt or self.state is None or self.state.sharpness.doubt:
            return None
        trusted = [state for stamp, state in self._states if now - stamp >= TRUSTED_NS]
        known = trusted[-1] if trusted else self._nothing
        held = replace(known, hazards=(), sharpness=replace(known.sharpness, doubt=doubt))
        self._nothing = held
        self._states = deque([(now, held)])
        return held
