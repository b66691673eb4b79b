# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Texts and tables of the report: worst hazards, load cases and changes."""

from typing import Any

import numpy as np

from plc_inspect.offline.records.changes import describe_changes
from plc_inspect.offline.records.inspection import Inspection
from plc_inspect.offline.records.load_case_record import describe_what_if
from plc_inspect.offline.records.sentences import describe_place
from plc_inspect.offline.records.units import Record, Units
from plc_inspect.offline.report.figures import rank
from plc_inspect.offline.report.point_scene import Scene

MOST = 10


def list_worst(scene: Scene, inspection: Inspection) -> list[Record]:
    """
    Return the worst hazards, each with a sentence.

    Parameters
    ----------
    scene : Scene
        Holds the hazards in the unit of the figures.
    inspection : Inspection
        The run.

    Returns
    -------
    list of dict
        At most MOST, the worst first, with ``text``.

    """
    moved = {}
    contacts: dict[int, float] = {}
    if inspection.what_if is not None:
        contacts = inspection.what_if.contacts
        moved = {
            number: list(zip([case.name for case in inspection.what_if.cases], values[1:],
                             strict=True))
            for number, values in inspection.what_if.hazards.items()
        }
    worst = []
    for item in sorted(scene.hazards, key=rank)[:MOST]:
        cases = moved.get(item['hazard_id'])
        contact = contacts.get(item['hazard_id'])
        text = describe_place(item, scene.unit, scene.metre, cases, contact)
        worst.append(item | {'text': text})
    return worst


def list_what_if(inspection: Inspection) -> Record | None:
    """
    Return the table of the what-if: a row for each span and kind, a column for each case.

    None without a what-if, or without a span.
    """
    if inspection.what_if is None or not inspection.what_if.spans:
        return None
    horizontal = inspection.units.horizontal
    units = Units(horizontal=horizontal, vertical=horizontal)
    record = describe_what_if(inspection.what_if, units)
    rows: list[Record] = []
    for span in record['spans']:
        outcomes = span['outcomes']
        for kind in ('sag', 'vegetation', 'building', 'ground'):
            cells: list[Any] = [
                {'value': item['sag'], 'severity': None} if kind == 'sag' else
                {'value': item[kind]['clearance'], 'severity': item[kind]['severity']}
                for item in outcomes
            ]
            if any(cell['value'] is not None for cell in cells):
                rows.append({
                    'line_id': span['line_id'], 'span_id': span['span_id'], 'kind': kind,
                    'cells': cells, 'worst': span['worst'].get(kind) if kind != 'sag' else None,
                })
    return record | {
        'rows': rows, 'worst_sags': [
            float(np.max([item['sag'] for item in span['outcomes']]))  # NaN if one is
            for span in record['spans']
        ],
        'worst_reaches': [
            {kind: _pick(span['outcomes'], kind, span['worst'][kind])
             for kind in ('vegetation', 'building', 'ground')}
            for span in record['spans']
        ],
    }


def _pick(outcomes: list[Record], kind: str, case: str | None) -> Record | None:
    """Return the nearest outcome in one case, with its name."""
    return next((item[kind] | {'case': case} for item in outcomes if item['case'] == case), None)


def list_changes(inspection: Inspection) -> Record | None:
    """Return the changes since an earlier survey, in the unit of the report."""
    if inspection.changes is None:
        return None
    horizontal = inspection.units.horizontal
    return describe_changes(inspection.changes, Units(horizontal=horizontal, vertical=horizontal))
