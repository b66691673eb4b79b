# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Log lines about what was found."""

from collections.abc import Callable
import itertools

from plc_inspect.core.live.session import LiveState
from plc_inspect.core.tracking.hazard_tracking import HazardNews


class Teller:
    """
    Tells of new lines and of what became of hazards.

    Parameters
    ----------
    say, warn : callable
        Take a line of text; hazards that are taken back are warned of.

    """

    def __init__(self, say: Callable[[str], object], warn: Callable[[str], object]) -> None:
        self._say, self._warn = say, warn
        self._told: set[int] = set()

    def clear(self) -> None:
        """Forget what was told, after a reset."""
        self._told.clear()

    def tell(self, state: LiveState) -> None:
        """Log what is new in a state."""
        lines = {item.span.line_id for item in state.confirmed}
        for line in sorted(lines - self._told):
            self._say(f'line {line} found')
        self._told |= lines
        tell_hazards(state.news, self._say, self._warn)


def tell_hazards(
    news: HazardNews, say: Callable[[str], object], warn: Callable[[str], object]
) -> None:
    """Log the hazards that were raised or changed, and warn of those taken back, and why."""
    for tell, title, hazards, reasons in (
        (say, 'raised', news.raised, ()), (say, 'updated', news.updated, ()),
        (warn, 'cleared', news.cleared, news.reasons),
    ):
        for hazard, reason in itertools.zip_longest(hazards, reasons):
            tell(
                f'hazard {hazard.hazard_id} {title}: {hazard.severity.name.lower()}, '
                f'{hazard.kind.name.lower()} {hazard.measured:.2f} m, '
                f'line {hazard.line_id} span {hazard.span_id}'
                + (f'; {reason}' if reason else '')
            )


def summarize(state: LiveState) -> str:
    """Return a state in one line, and why hazards are held back where they are."""
    text = count_found(state)
    return f'{text}; {state.sharpness.describe()}' if state.sharpness.poor else text


def count_found(state: LiveState) -> str:
    """Return how much of what is known; hazards that are held back have no number."""
    lines = {item.span.line_id for item in state.confirmed}
    hazards = 'hazards held back' if state.sharpness.poor else f'{len(state.hazards)} hazards'
    return f'{len(lines)} lines, {len(state.confirmed)} spans, {hazards}'
