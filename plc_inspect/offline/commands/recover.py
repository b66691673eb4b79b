# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The command ``plc_recover``: a results folder from the record of a flight, wherever it ends."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from plc_inspect.offline.commands.command_line import DONE, Parser, run_command
from plc_inspect.printable import make_printable

if TYPE_CHECKING:
    from plc_inspect.flight_record.reader import Flight
    from plc_inspect.offline.records.inspection import Inspection

NAME = 'plc_recover'


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recovered:
    """Results recovered from a record."""

    inspection: 'Inspection'
    notes: tuple[str, ...]
    """Unusable parts of the record, one line each."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return run_command(NAME, lambda: _run(argv))


def recover(record: Path) -> Recovered:
    """
    Produce the results of a flight from its record, as the node does at the end.

    Parameters
    ----------
    record : Path
        The folder of the record, or one of its segments.

    Returns
    -------
    Recovered
        Ready to be written; where the node held back results of the whole map, those of the
        last tick.  Where the map is not sharp, or the odometry is in doubt, without hazards.
        ``counts['held_back']`` says why, also where a full map holds back the rest.

    Raises
    ------
    DataError
        It is not a record, or holds no valid chunk.

    """
    from plc_inspect.flight_record.reader import read_flight

    flight = read_flight(record)
    return Recovered(inspection=_inspect(flight), notes=flight.notes)


def _inspect(flight: 'Flight') -> 'Inspection':
    from plc_inspect.config import Settings
    from plc_inspect.core.alignment.rigid_move import RigidMove
    from plc_inspect.core.hazards.clearance_rules import RuleSet
    from plc_inspect.core.live.session import Session
    from plc_inspect.core.voxel_buffer.voxel_map import VoxelMap
    from plc_inspect.errors import DataError
    from plc_inspect.flight_record.plain_values import from_plain
    from plc_inspect.offline.records.flight import (
        conclude,
        copy_everything,
        describe_last_tick,
        Snapshot,
    )
    from plc_inspect.offline.records.flight import (
        Flight as Told,
    )
    from plc_inspect.setting_names import update

    state = flight.state
    try:
        settings = update(Settings(), state.get('settings') or flight.header['settings'])
        rules = from_plain(RuleSet, state.get('rules') or flight.header['rules'])
        frames = state['frames'] or ['', '']
        voxels = VoxelMap(settings.map)
        voxels.restore(flight.map)
        session = Session()
        session.restore(flight.kept)
        told = Told(
            settings=settings, rules=rules, frame_id=str(frames[0]),
            first_stamp_ns=state['first_stamp_ns'] or 0, counts=state['counts'], command=NAME,
            move=RigidMove.from_record(state.get('move')).inverse(), doubt=state['doubt'],
        )
        snapshot = Snapshot(
            window=copy_everything(voxels), flight=told, stamp_ns=state['stamp_ns'] or 0,
            vehicle=None, complete=state['counts']['num_voxels_evicted'] == 0,
        )
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        raise DataError(f'the record lacks something: {type(error).__name__}: {error}') from error
    if told.doubt or session.state.sharpness.hopeless:
        return describe_last_tick(told, session.state)
    return conclude(session, snapshot)[1]


def _run(argv: Sequence[str] | None) -> int:
    parser = Parser(
        prog=NAME,
        description='Makes a results folder from a flight record, which may end anywhere.',
    )
    parser.add_argument(
        'record', type=Path, metavar='RECORD',
        help='the folder that plc_node wrote beside its results, or one of its .mcap files',
    )
    parser.add_argument(
        '-o', '--output', type=Path, required=True, metavar='OUT', help='results folder to write'
    )
    parser.add_argument('--force', action='store_true', help='replace a results folder')
    parser.add_argument('--quiet', action='store_true', help='print errors only')
    arguments = parser.parse_args(argv)
    from plc_inspect.errors import DataError
    from plc_inspect.offline.export.results_folder import check_results, write_results
    from plc_inspect.offline.terminal.result_table import render_summary

    check_results(arguments.output, arguments.force, [arguments.record])
    recovered = recover(arguments.record)
    write_results(arguments.output, recovered.inspection, arguments.force)
    if not arguments.quiet:
        parts = [render_summary(recovered.inspection), *recovered.notes]
        print(make_printable('\n\n'.join(parts)))
        print(make_printable(f'\nreport: {arguments.output / "report.html"}'))
    if recovered.inspection.counts['held_back']:
        raise DataError(f'{arguments.record}: {recovered.inspection.counts["held_back"]}')
    return DONE
