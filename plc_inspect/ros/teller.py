# Copyright 2026 plc_inspect contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Log lines about what was found."""

from collections.abc import Callable

from plc_inspect.core.session import LiveState


class Teller:
    """
    Tells of new lines and of what became of hazards.

    Parameters
    ----------
    say : callable
        Takes a line of text.

    """

    def __init__(self, say: Callable[[str], object]) -> None:
        self._say = say
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
        for title, hazards in (
            ('raised', state.news.raised), ('updated', state.news.updated),
            ('cleared', state.news.cleared),
        ):
            for hazard in hazards:
                self._say(
                    f'hazard {hazard.hazard_id} {title}: {hazard.severity.name.lower()}, '
                    f'{hazard.kind.name.lower()} {hazard.clearance:.2f} m, '
                    f'line {hazard.line_id} span {hazard.span_id}'
                )


def summarize(state: LiveState) -> str:
    """Return a state in one line."""
    lines = {item.span.line_id for item in state.confirmed}
    return f'{len(lines)} lines, {len(state.confirmed)} spans, {len(state.hazards)} hazards'
