# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Load cases (what-if) of a run as plain records."""

import math

from plc_inspect.core.loads.load_cases import Outcome, Reach, WhatIf
from plc_inspect.offline.records.units import Record, Units

ASSUMPTIONS = (
    'the conductor had the given temperature when surveyed; it is not measured',
    'ends stay where they are: insulators do not swing and supports do not bend',
    'elastic change of length, without creep; bare and in calm air when surveyed',
    'no figures of cases where the curve is too short or too straight to tell the tension',
    'wind blows across the line, from either side; clearances are distances in space',
)


def describe_what_if(what_if: WhatIf, units: Units) -> Record:
    """
    Return the content of ``whatif.json``.

    Parameters
    ----------
    what_if : WhatIf
        All spans in all cases.
    units : Units
        Lengths are in the horizontal unit; tension is in newtons, the angle in radians.

    Returns
    -------
    dict
        JSON-serialisable.

    """
    scale = units.horizontal
    conductor = what_if.conductor
    return {
        'conductor': {
            'name': conductor.name, 'diameter_m': conductor.diameter,
            'weight_n_per_m': conductor.weight, 'stiffness_n': conductor.stiffness,
            'expansion_per_k': conductor.expansion, 'source': conductor.source,
        },
        'surveyed_at': what_if.temperature,
        'assumptions': list(ASSUMPTIONS),
        'cases': [
            {'name': case.name, 'temperature': case.temperature, 'ice_m': case.ice,
             'wind_m_per_s': case.wind}
            for case in what_if.cases
        ],
        'spans': [
            {
                'line_id': row.line_id, 'span_id': row.span_id,
                'ruling_span': row.ruling_span / scale,
                'outcomes': [_describe_outcome(item, scale) for item in row.outcomes],
                'worst': _find_worst(row.outcomes),
            }
            for row in what_if.spans
        ],
        'hazards': [
            {'hazard_id': number,
             'clearances': [None if math.isnan(value) else value / scale for value in values],
             'contact': what_if.contacts.get(number)}
            for number, values in sorted(what_if.hazards.items())
        ],
    }


def _describe_outcome(item: Outcome, scale: float) -> Record:
    return {
        'case': item.case, 'sag': item.sag / scale, 'c': item.c / scale,
        'tension': item.tension, 'swing': item.swing,
        **{
            name: _describe_reach(getattr(item, name), scale)
            for name in ('vegetation', 'building', 'ground')
        },
    }


def _describe_reach(item: Reach, scale: float) -> Record:
    known = not math.isnan(item.clearance)
    return {
        'clearance': item.clearance / scale if known else None,
        'along': item.along / scale if known else None,
        'severity': item.severity.name.lower() if item.severity is not None else None,
    }


def _find_worst(outcomes: tuple[Outcome, ...]) -> Record:
    """Return the case of least clearance of each kind, None where it is not known in all."""
    worst: Record = {}
    if any(math.isnan(item.sag) for item in outcomes):
        outcomes = ()
    for name in ('vegetation', 'building', 'ground'):
        known = [item for item in outcomes if not math.isnan(getattr(item, name).clearance)]
        worst[name] = min(
            known, key=lambda item: float(getattr(item, name).clearance)
        ).case if known else None
    return worst
