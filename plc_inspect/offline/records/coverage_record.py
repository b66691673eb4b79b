# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Coverage of a run, and the flight that shows its gaps, as plain records."""

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any

import numpy as np

from plc_inspect.core.coverage.coverage import Coverage, Gap, measure_coverage, SectionSight
from plc_inspect.core.coverage.refly import Kind, plan_refly, Refly
from plc_inspect.core.coverage.seen_ground import see_ground
from plc_inspect.offline.records.inspection import Inspection
from plc_inspect.offline.records.units import Record, Units
from plc_inspect.results import PointClass, Span

ENOUGH = 'seen'
NOT_ENOUGH = 'not seen well enough to rule out a hazard'
NOTE = (
    'A gap was not seen well enough to rule out a hazard. Only conductors that were found are'
    ' told of: where nothing was found, nothing is said. What was not seen may stand in the way'
    ' of the flight that is proposed.'
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sight:
    """Coverage, and the flight that shows its gaps."""

    coverage: Coverage
    refly: Refly


def review_coverage(inspection: Inspection, others: Sequence[Span] = ()) -> Sight:
    """
    Measure the coverage of a run and plan a flight over its gaps [m], in the points' frame.

    The flight keeps off ``others`` as well, conductors that are not of the run.
    """
    result, points = inspection.result, inspection.points
    ground = see_ground(points, result.classification == PointClass.WIRE)
    way = inspection.way
    coverage = measure_coverage(result, points, ground, way)
    start = None if way is None or not len(way) else way[-1, 1:]
    return Sight(coverage=coverage, refly=plan_refly(
        coverage, ground, start, others=others,
    ))


def describe_coverage(sight: Sight, units: Units) -> Record:
    """
    Return the content of ``coverage.json`` without frame and units.

    Lengths and coordinates are in ``units``, angles in radians, times in seconds.
    """
    coverage = sight.coverage
    gaps = coverage.gaps
    shown = {number for run in sight.refly.runs for number in run.gaps}
    first = np.cumsum([0, *(len(item.gaps) for item in coverage.sections)]).tolist()
    return {
        'note': NOTE,
        'sections': [
            _describe_section(item, range(low, high), units)
            for item, low, high in zip(coverage.sections, first[:-1], first[1:], strict=True)
        ],
        'gaps': [_describe_gap(number, gap, units) for number, gap in enumerate(gaps)],
        'refly': {
            'length': sight.refly.length / units.horizontal,
            'left_out': [number for number in range(len(gaps)) if number not in shown],
            'waypoints': describe_waypoints(sight.refly, units),
        },
    }


def _describe_section(item: SectionSight, gaps: range, units: Units) -> Record:
    scale = units.horizontal
    return {
        'span_id': item.section.span_id,
        'lines': sorted({span.line_id for span in item.section.spans}),
        'verdict': ENOUGH if item.is_enough else NOT_ENOUGH,
        'distance': _number(item.distance / scale),
        'angle': _number(item.angle),
        'age': _number(item.age),
        'conductors': [
            {
                'line_id': row.line_id, 'length': row.length / scale,
                'density': row.density * scale, 'share': row.share,
                'longest_gap': row.longest_gap / scale,
            } for row in item.conductors
        ],
        'strips': [
            {
                'part': row.part.name.lower(), 'share': row.share,
                'longest_gap': row.longest_gap / scale, 'flown': row.is_flown,
            } for row in item.strips
        ],
        'gaps': list(gaps),
    }


def _describe_gap(number: int, gap: Gap, units: Units) -> Record:
    return {
        'gap_id': number,
        'part': gap.part.name.lower(),
        'span_id': gap.span_id,
        'line_id': gap.line_id,
        'length': gap.length / units.horizontal,
        'beyond': gap.is_beyond,
        'line': units.from_metres(gap.places).tolist(),
    }


def describe_waypoints(refly: Refly, units: Units) -> list[Record]:
    """Return the waypoints in order of flight, as in ``coverage.json``."""
    return [
        {
            'number': number,
            'position': place,
            'kind': kind.name.lower(),
            'run': run,
            'span_id': refly.runs[run].span_id,
            'side': 'left' if refly.runs[run].is_left else 'right',
            'gaps': list(refly.runs[run].gaps) if kind == Kind.RUN else [],
        }
        for number, (place, kind, run) in enumerate(zip(
            units.from_metres(refly.places).tolist(), refly.kinds, refly.run, strict=True,
        ))
    ]


def _number(value: float) -> Any:
    return float(value) if math.isfinite(value) else None
