# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Puts flights together with wrong mounts and clocks, and prints what is said of the map.

Flights are the demo and simulated ones.  With --seed 11 the limits were chosen; others check them.
``--write`` writes the table of the demo flight into docs/ingest.md.  Ends with 1 where a right
set-up is held back, a mount that is wrong by 2 degrees and more in pitch or yaw is not, or
sharpness does not fall as an error grows.
"""

import argparse
from contextlib import redirect_stdout
from dataclasses import replace
import io
from pathlib import Path
import sys

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common.setups import DEMO, Flight, read_flight
from common.tables import render_table, replace_section

from plc_inspect.config import Settings
from plc_inspect.core.mapping.accumulator import Accumulator
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.core.setup.plumb import measure_leans, PlumbBook
from plc_inspect.core.setup.sharpness import HELD, Sharpness, SharpnessBook
from plc_inspect.errors import DataError
from plc_inspect.setting_names import update
from plc_inspect.sim.simulate import main as simulate

SERIES = {
    axis: [(tuple(np.eye(3)[number] * angle), 0.0) for angle in (2.0, 5.0, 10.0, 30.0)]
    for number, axis in enumerate(('roll', 'pitch', 'yaw'))
} | {
    'time': [((0.0, 0.0, 0.0), lead) for lead in (0.05, 0.2, 1.0)],
    'both': [((0.0, 2.0, 0.0), 0.05), ((0.0, 5.0, 0.0), 0.2), ((0.0, 10.0, 0.0), 1.0)],
}
"""Growing errors: roll, pitch and yaw of the mount [degrees], and lead of the scans' clock [s]."""
PAGE = Path(__file__).resolve().parents[2] / 'docs' / 'ingest.md'
COLUMNS = 'flight', 'error', 'sharpness', '', 'said', 'apart [m]', 'found'
DOUBTS = {
    'lidar turned': 'mount', 'aside': 'drift aside', 'heading of the': 'heading',
    'positions of the': 'positions', 'map is tilted': 'tilted',
}
"""Words of a doubt about odometry or mount, and how the table calls it."""
SCENES = ('low_voltage', 'street', 'bundles', 'crossing', 'valley', 'angle')


def build(
    flight: Flight, turn: tuple[float, ...], lead: float
) -> tuple[Accumulator, Sharpness]:
    """Return map and sharpness of a flight whose mount is said, and clock set, wrongly."""
    settings = update(Settings(), {'input.lidar_rpy_deg': list(turn), 'input.max_wait': 5.0})
    accumulator, book = Accumulator(settings, recorded=True), SharpnessBook()
    events = [(scan.log_ns, 1, index) for index, scan in enumerate(flight.scans)]
    events += [(int(stamp), 0, index) for index, stamp in enumerate(flight.pose_ns)]
    for log, kind, index in sorted(events):
        if kind == 0:
            accumulator.add_pose(
                log, flight.position[index], flight.quaternion[index], frame_id='odom',
                now=log * 1e-9,
            )
            continue
        scan = flight.scans[index]
        accumulator.add_scan(
            scan.stamp_ns + round(lead * 1e9), scan.xyz, scan.time, frame_id='velodyne',
            now=log * 1e-9,
        )
        book.add(accumulator.entry.meter.take())
    return accumulator, replace(book.judge(), doubt=accumulator.doubt)


def say(found: Sharpness, accumulator: Accumulator) -> str:
    """Return in a few words what is said of the set-up."""
    words = [name for word, name in DOUBTS.items() if word in found.doubt]
    words += ['leans'] if found.remark else []
    blurred = found.known and found.blur > HELD
    clock = ['clock'] if accumulator.timing.describe() else []
    return ', '.join(words + clock + (['not sharp'] if blurred else []))


def describe(accumulator: Accumulator, found: Sharpness) -> tuple[str, Sharpness]:
    """Return what the pipeline finds in a map, and how good that is whose poles may lean."""
    if found.hopeless:
        return 'not looked for', found
    points, plumb = accumulator.map.centroids(), PlumbBook()
    result = Pipeline().run(points)
    plumb.add(measure_leans(points, result))
    hazards = ', '.join(
        f'{item.kind.name.lower()} {item.clearance:.2f}' for item in result.hazards[:6]
    )
    text = f'{result.num_lines} lines, {len(result.hazards)} hazards ({hazards})'
    return text, plumb.judge(found)


def read_scene(name: str, seed: int, cache: Path) -> Flight:
    """Return a simulated flight, from the cache if it is there."""
    folder = cache / f'{name}-{seed}'
    if not folder.is_dir():
        with redirect_stdout(io.StringIO()):
            code = simulate([name, '-o', str(folder), '--seed', str(seed), '--duration', '30'])
        if code:
            raise DataError(f'the flight of {name} was not made')
    return read_flight(folder)


def study(name: str, flight: Flight, results: bool) -> tuple[list[list[str]], int]:
    """Return the rows of a flight, and how many are not as they should be."""
    rows, wrong = [], 0
    accumulator, right = build(flight, (0.0, 0.0, 0.0), 0.0)
    wrong += right.poor

    def add(error: str, accumulator: Accumulator, found: Sharpness, *, falls: bool = True) -> None:
        text, found = describe(accumulator, found) if results else ('', found)
        figure = f'{found.figure:.3f}' if found.known else 'unknown'
        rows.append([name, error, figure, 'held back' if found.poor else '',
                     say(found, accumulator), f'{found.distance:.3f}',
                     text if falls else f'{text} RISES'])
        print('|', ' | '.join(rows[-1]), '|', flush=True)

    add('none', accumulator, right)
    for series, errors in SERIES.items():
        before = right
        for turn, lead in errors:
            accumulator, found = build(flight, turn, lead)
            # a clock that is followed leaves the map as sharp as it was
            falls = found.figure < before.figure or bool(accumulator.timing.describe())
            wrong += not falls or (series in ('pitch', 'yaw') and not found.poor)
            size = f'{max(turn):g} degrees' if any(turn) else ''
            error = ' '.join([series, size, f'{lead:g} s' if lead else '']).strip()
            add(' '.join(error.split()), accumulator, found, falls=falls)
            before = found
    return rows, wrong


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('scenes', nargs='*', help='demo, or scenes of plc_simulate')
    parser.add_argument('--seed', type=int, default=11)
    parser.add_argument('--cache', type=Path, default=Path('build/sharpness'))
    parser.add_argument('--results', action='store_true', help='run the pipeline as well')
    parser.add_argument('--write', action='store_true',
                        help='write the table of the demo flight, with results')
    arguments = parser.parse_args()
    wrong = 0
    print('|', ' | '.join(COLUMNS), '|')
    for name in arguments.scenes or ('demo', *SCENES):
        flight = (
            read_flight(DEMO) if name == 'demo'
            else read_scene(name, arguments.seed, arguments.cache)
        )
        rows, bad = study(name, flight, arguments.results or arguments.write)
        wrong += bad
        if name == 'demo' and arguments.write:
            replace_section(PAGE, 'sharpness', render_table(COLUMNS[1:], [r[1:] for r in rows]))
    return min(wrong, 1)


if __name__ == '__main__':
    sys.exit(main())
