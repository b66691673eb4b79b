# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Describes each hazard in one sentence."""

from typing import Any

from plc_inspect.core.hazards.confidence import find_doubts
from plc_inspect.results import MEASURE_NOTES

Record = dict[str, Any]
_NAMES = {
    'vegetation': 'vegetation', 'structure': 'a structure', 'ground': 'the ground',
    'fall_in': 'a tree that can fall',
}


def describe_place(
    item: Record, unit: str, metre: float = 1.0, moved: list[tuple[str, float]] | None = None,
    contact: float | None = None,
) -> str:
    """
    Return one hazard as a sentence.

    Parameters
    ----------
    item : dict
        As ``hazards.json`` holds it.
    unit : str
        Of its lengths.
    metre : float
        One metre in that unit.
    moved : list of tuple
        Name of each case and the clearance of the object in it [m].
    contact : float
        Temperature at which the conductor touches it [degrees Celsius].

    Returns
    -------
    str

    """
    where = f'Span {item["span_id"]}, line {item["line_id"]}'
    along = f'{item["along_span"]:.0f} {unit} from the start of the span'
    if item['support_id'] >= 0 and item['from_support'] is not None:
        along = f'{item["from_support"]:.0f} {unit} from support {item["support_id"]}'
    distance, way = find_measured(item)
    measured = f'{distance:.2f} {unit}'
    required = f'{item["required"]:.2f} {unit}'
    kind = item['kind']
    if kind == 'sag':
        text = f'sags {measured} more than its peers, {required} tolerated'
        return f'{where}: {text}.'
    if kind == 'missing':
        which = f', line {item["other_line_id"]},' if item['other_line_id'] >= 0 else ''
        text = f'the conductor beside it{which} is missing'
        return f'{where}: {text}; of {required} {measured} were seen: it may be down.'
    if kind in ('interference', 'crossing'):
        what = 'the next conductor' if kind == 'interference' else 'a crossing conductor'
        other = item['other_line_id']
        which = f'line {other}' if other >= 0 else 'not modelled'
        text = f'{what} ({which}) at {along} is {measured} away'
        return f'{where}: {text}, {required} required.'
    tall = f', {item["height"]:.1f} {unit} high,' if item['height'] is not None else ''
    if kind == 'fall_in':
        text = f'a tree{tall} at {along} comes within {measured} of the conductor when it falls'
        if item['clearance'] < 0:
            past = f'{-item["clearance"]:.1f} {unit} past the conductor when it falls'
            text = f'a tree{tall} at {along} reaches {past}'
    elif kind == 'ground':
        text = f'hangs {measured} above the ground at {along}'
    else:
        text = f'{_NAMES[kind]}{tall} at {along} is {measured} away{way}'
    text += f', {required} required'
    for name, clearance in moved or []:
        if clearance == clearance:
            text += f'; {clearance * metre:.2f} {unit} at {name}'
    if contact is not None:
        text += f'; will touch at {contact:.0f} \u00b0C'
    if item['years'] is not None and item['years'] > 0:
        # a notice grows into whichever of the others is the first tier of its rule
        tier = 'critical' if item['severity'] == 'warning' else 'reaches the most severe tier'
        text += f'; {tier} in {item["years"]:.1f} years'
    if doubts := find_doubts(item.get('note', '')):
        text += f'; {doubts}'
    return f'{where}: {text}.'


def find_measured(item: Record) -> tuple[float, str]:
    """Return what the rule of a hazard measures, and in which way, as `Hazard.measured`."""
    notes = item.get('note', '').split('; ')
    for name, note in MEASURE_NOTES.items():
        if note in notes:
            return abs(item[name]), note.removeprefix('measured')
    return item['clearance'], ''
