# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The table that a command prints at its end."""

from collections.abc import Sequence
import math

from plc_inspect.offline.records.inspection import (
    describe_coarse_ground,
    describe_hazard,
    describe_span,
    Inspection,
    measure_clearances,
)
from plc_inspect.offline.records.sentences import find_measured
from plc_inspect.offline.records.units import Record


def render_summary(inspection: Inspection) -> str:
    """
    Return lines, spans, sag and hazards of a run as text.

    Parameters
    ----------
    inspection : Inspection
        The run.

    Returns
    -------
    Some lines of text without a line break at the end; lengths in the units of the input.

    """
    result, units = inspection.result, inspection.units
    unit = units.name
    ids = {span.span_id for span in result.spans}
    withheld = describe_withheld(inspection.counts.get('num_withheld', 0))
    parts = [
        f'{inspection.source}: {result.num_points:,} points{withheld},'
        f' {_plural(result.num_lines, "line")}, {_plural(len(ids), "span")},'
        f' {_plural(len(result.supports), "support")}, {_plural(len(result.hazards), "hazard")}'
    ]
    not_covered = '' if inspection.rules is None else inspection.rules.gaps
    lean = inspection.counts.get('lean', '')
    for text in filter(None, (not_covered, describe_coarse_ground(inspection), lean)):
        parts[0] += f'\nWARNING: {text}'
    if not result.spans:
        return parts[0] + '\nno power line was found'
    clearances = measure_clearances(result, inspection.settings.hazards.min_points)
    parts.append(format_table(
        ('line', 'span', f'length [{unit}]', f'sag [{unit}]', '+-', f'rmse [{unit}]', 'points',
         'seen', f'vegetation [{unit}]'),
        [
            _span_row(
                describe_span(span, units), clearances[span.line_id, span.span_id],
                units.horizontal,
            )
            for span in result.spans
        ],
    ))
    if result.hazards:
        parts.append(format_table(
            ('hazard', 'severity', 'kind', 'line', 'span', f'measured [{unit}]',
             f'required [{unit}]', f'along span [{unit}]'),
            [_hazard_row(describe_hazard(hazard, units)) for hazard in result.hazards],
        ))
    return '\n\n'.join(parts)


def describe_withheld(num: int) -> str:
    """Say in brackets how many points are withheld, '' if none."""
    return f' ({num:,} withheld, left out)' if num else ''


def _span_row(span: Record, clearance: float | None, scale: float) -> list[str]:
    length = format_number(span['length'], 2)
    return [
        str(span['line_id']),
        str(span['span_id']),
        length + ('+' if span['open_start'] or span['open_end'] else ' '),
        format_number(span['sag'], 2),
        format_number(span['sigma']['sag'], 3),
        format_number(span['rmse'], 3),
        str(span['num_points']),
        f'{100 * span["coverage"]:.0f} %',
        '-' if clearance is None else format_number(clearance / scale, 2),
    ]


def _hazard_row(hazard: Record) -> list[str]:
    return [
        str(hazard['hazard_id']),
        hazard['severity'],
        hazard['kind'],
        str(hazard['line_id']),
        str(hazard['span_id']),
        format_number(find_measured(hazard)[0], 2),
        format_number(hazard['required'], 2),
        format_number(hazard['along_span'], 1),
    ]


def format_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table with its columns aligned: numbers to the right, words to the left."""
    widths = [max(len(cell) for cell in column) for column in zip(head, *rows, strict=True)]
    words = [any(cell[:1].isalpha() for cell in column) for column in zip(*rows, strict=True)]
    return '\n'.join(
        '  '.join(
            cell.ljust(width) if word else cell.rjust(width)
            for cell, width, word in zip(row, widths, words, strict=True)
        ).rstrip()
        for row in (head, *rows)
    )


def format_number(value: float | None, decimals: int) -> str:
    """Return a number with so many decimals; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return '-'
    return f'{round(value, decimals) + 0.0:.{decimals}f}'  # -0 as 0


def _plural(count: int, noun: str) -> str:
    return f'{count} {noun}' if count == 1 else f'{count} {noun}s'
