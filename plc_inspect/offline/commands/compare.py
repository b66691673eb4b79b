# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The command ``plc_compare``: what changed between two surveys."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from plc_inspect.offline.commands.command_line import DONE, Parser, run_command
from plc_inspect.printable import make_printable

if TYPE_CHECKING:
    from plc_inspect.offline.records.change_list import Changes
    from plc_inspect.offline.records.units import Units

NAME = 'plc_compare'


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return run_command(NAME, lambda: _run(argv))


def render_changes(changes: 'Changes', units: 'Units') -> str:
    """
    Return the changes as text.

    Parameters
    ----------
    changes : Changes
        Two surveys compared.
    units : Units
        Of the second survey; lengths are in its unit.

    Returns
    -------
    str
        Some lines without a line break at the end.

    """
    from plc_inspect.offline.records.changes import describe_changes
    from plc_inspect.offline.terminal.result_table import format_number, format_table

    record = describe_changes(changes, units)
    unit = units.name
    parts = [
        f'{len(record["spans"])} spans in both surveys, {len(record["lost_spans"])} lost,'
        f' {len(record["added_spans"])} added'
    ]
    parts.append(format_table(
        ('line', 'span', f'sag [{unit}]', 'change', '+-', 'note', f'ground [{unit}]', 'change',
         f'vegetation [{unit}]', 'change', '+-'),
        [
            [
                str(row['line_id']), str(row['span_id']),
                format_number(row['sag_after'], 2), format_number(row['sag_change'], 3),
                format_number(row['sag_sigma'], 3),
                'abnormal' if row['sag_is_abnormal'] else '-',
                format_number(row['ground_clearance_after'], 2),
                format_number(row['ground_clearance_change'], 2),
                format_number(row['vegetation_clearance_after'], 2),
                format_number(row['vegetation_clearance_change'], 2),
                format_number(row['vegetation_clearance_sigma'], 3),
            ]
            for row in record['spans']
        ],
    ))
    for item in record['growth']:
        parts.append(
            f'span {item["span_id"]}: the canopy rose by {item["median"]:.2f} {unit} (median of'
            f' {item["num_cells"]} cells), at most by {item["highest"]:.2f} {unit}'
        )
    parts.append(
        f'hazards: {len(record["new_hazards"])} new, {len(record["kept_hazards"])} kept,'
        f' {len(record["cleared_hazards"])} cleared,'
        f' {len(record["hazards_not_seen_again"])} not seen again'
    )
    if record['limits_note']:
        parts.append(record['limits_note'])
    return '\n\n'.join(parts)


def write_changes(path: Path, changes: 'Changes', units: 'Units') -> None:
    """Write the changes as JSON, whole or not at all."""
    from plc_inspect.offline.export.files import render_json
    from plc_inspect.offline.records.changes import describe_changes
    from plc_inspect.whole_files import replace_file

    with replace_file(path) as aside:
        aside.write_text(render_json(describe_changes(changes, units)) + '\n', encoding='utf-8')


def _run(argv: Sequence[str] | None) -> int:
    parser = Parser(prog=NAME, description='Compares two results folders of one line.')
    parser.add_argument('before', type=Path, metavar='A', help='results of the first survey')
    parser.add_argument('after', type=Path, metavar='B', help='results of the second survey')
    parser.add_argument('-o', '--output', type=Path, metavar='FILE', help='JSON file to write')
    parser.add_argument('--force', action='store_true', help='replace FILE')
    parser.add_argument(
        '--sag-deviation', type=float, default=0.25, metavar='SHARE',
        help='change of sag that is tolerated, as a share (default 0.25)',
    )
    parser.add_argument('--quiet', action='store_true', help='print errors only')
    arguments: argparse.Namespace = parser.parse_args(argv)
    from plc_inspect.errors import ConfigError
    from plc_inspect.offline.records.changes import find_changes, read_survey
    from plc_inspect.whole_files import check_file

    if not 0.0 < arguments.sag_deviation < 10.0:
        raise ConfigError(f'--sag-deviation must lie in (0, 10), got {arguments.sag_deviation:g}')
    if arguments.output:
        check_file(arguments.output, arguments.force)
    after = read_survey(arguments.after)
    changes = find_changes(read_survey(arguments.before), after, arguments.sag_deviation)
    if arguments.output:
        write_changes(arguments.output, changes, after.units)
    if not arguments.quiet:
        print(make_printable(render_changes(changes, after.units)))
    return DONE
