# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Changes of the hazards from one message to the next, as lines of text."""

from collections.abc import Iterator, Mapping, Sequence

from plc_inspect.monitor.picture.causes import describe_hazard
from plc_inspect.monitor.picture.picture import HazardItem, name_severity
from plc_inspect.results import Severity


def list_news(
    before: Sequence[HazardItem], hazards: Sequence[HazardItem],
    stretches: Mapping[tuple[int, int], str], *, was_held: bool, held: bool,
    kept: bool = False,
) -> Iterator[tuple[int, str]]:
    """
    Yield the changes of the hazards.

    Parameters
    ----------
    before, hazards : sequence of HazardItem
        Hazards before and now.
    stretches : mapping
        Names of spans by line and span.
    was_held, held : bool
        Whether the node held hazards back before, and does now.
    kept : bool
        The node tells what it kept of an earlier run.

    Yields
    ------
    level : int
        As of ``Event``.
    text : str
        One line.

    """
    if held != was_held:
        yield int(held), (
            'hazards are held back: they are shown as they were told last' if held else
            'hazards are told again'
        )
    old = {item.hazard_id: item for item in before}
    for item in hazards:
        known = old.pop(item.hazard_id, None)
        if known is not None and known.severity == item.severity:
            continue
        critical = item.severity >= Severity.CRITICAL
        word = 'kept' if kept else 'new' if known is None else (
            f'was {name_severity(known.severity)}, is'
        )
        text = describe_hazard(item, stretches)
        yield 2 if critical and not kept else 0, f'{word} {item.severity_name} {text}'
    for number in sorted(old):
        yield 0, f'hazard {number} cleared'
