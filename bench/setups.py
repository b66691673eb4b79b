# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Replays the demo flight as other vehicles would have recorded it, and prints what comes of each.

Right is what comes of the flight as it was recorded, or exit code 2 and one line that names the
cause.  Ends with 1 where a set-up gives anything else.
"""

import argparse
from contextlib import redirect_stderr, redirect_stdout
import io
import json
from pathlib import Path
import sys
import tempfile

from common.setups import Flight, read_flight, Setup, SETUPS, write_bag

from plc_inspect.offline.commands.replay import main as replay


def list_assignments(setup: Setup) -> list[str]:
    """Return the settings of a vehicle as arguments."""
    return [
        item for name, value in setup.settings.items() for item in ('--set', f'{name}={value}')
    ]


def judge(setup: Setup, flight: Flight, room: Path, wanted: str) -> tuple[str, bool]:
    """Return what came of a set-up in one line, and whether that is right."""
    bag, out = write_bag(room / 'bag', flight, setup.layout), room / 'out'
    said = io.StringIO()
    with redirect_stderr(said), redirect_stdout(io.StringIO()):
        code = replay([str(bag), '-o', str(out), '--quiet', *list_assignments(setup)])
    text = f'exit {code}'
    found = count(out)
    if code:
        text += f': {said.getvalue().strip().rpartition("bag: ")[2]}'
    else:
        text += f': {found}'
    if setup.cause:
        return text, code == 2 and setup.cause in said.getvalue()
    return text, code == 0 and wanted in ('', found)


def count(out: Path) -> str:
    """Return lines, spans and hazards of a results folder."""
    if not (out / 'run.json').exists():
        return 'no results'
    run = json.loads((out / 'run.json').read_text(encoding='utf-8'))
    return f'{run["num_lines"]} lines, {run["num_spans"]} spans, {run["num_hazards"]} hazards'


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('names', nargs='*', help='parts of the names of set-ups; all')
    parser.add_argument('--step', type=int, default=1, help='take every so many scans')
    arguments = parser.parse_args()
    flight = read_flight(step=arguments.step)
    chosen = [item for item in SETUPS if item is SETUPS[0] or not arguments.names
              or any(part in item.name for part in arguments.names)]
    wanted, wrong = '', 0
    print('| set-up | result | |\n| --- | --- | --- |')
    for setup in chosen:
        with tempfile.TemporaryDirectory() as room:
            text, right = judge(setup, flight, Path(room), wanted)
        if not wanted:
            wanted = text.partition(': ')[2]
        wrong += not right
        print(f'| {setup.name} | {text} | {"right" if right else "WRONG"} |', flush=True)
    return min(wrong, 1)


if __name__ == '__main__':
    sys.exit(main())
