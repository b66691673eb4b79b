# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Command line ``plc_simulate``: simulated surveys with exact truth."""

import argparse
from collections.abc import Sequence
from dataclasses import replace
import json
from pathlib import Path
import sys
from typing import Any

import numpy as np

from plc_inspect.core.numerics.arrays import MOST_COORDINATE
from plc_inspect.offline.commands.command_line import DONE, Parser, positive, run_command
from plc_inspect.printable import make_one_line
from plc_inspect.sim.random_scenes.scenes import KINDS
from plc_inspect.sim.random_scenes.truth import make_random
from plc_inspect.sim.scenes.catalogue import make_scene, SCENES
from plc_inspect.sim.scenes.scene import Scene
from plc_inspect.sim.surveys.airborne import LabelledCloud, simulate_map
from plc_inspect.sim.surveys.bag import open_bag
from plc_inspect.sim.surveys.flight import Flight, PLANS, simulate_flight
from plc_inspect.sim.surveys.labelled_cloud import write_cloud
from plc_inspect.sim.surveys.output import open_folder
from plc_inspect.sim.surveys.puck import Puck
from plc_inspect.sim.surveys.trajectory import FlightPlan, OdometryErrors
from plc_inspect.sim.surveys.truth import collect_sightings, make_truth

NAME = 'plc_simulate'
RANDOM = 'random'
"""Name of the scene that is drawn from the seed."""
_OF_RANDOM = {'scene', 'kind', 'output', 'seed', 'force'}
"""Options of random scenes, which draw their own sensor and size."""
_OF_MAPS = {'density', 'num_points', 'origin'}
_OF_ALL = {'scene', 'output', 'seed', 'force', 'map'}
_MAP_NOISE = 0.03


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of ``plc_simulate``."""
    parser = Parser(
        prog=NAME,
        description='Simulate a survey of a power line: a flight with a Puck Lite, or an '
                    'airborne map; truth.json describes the scene.',
        epilog=f'Scenes: {", ".join((*SCENES, RANDOM))}',
    )
    parser.add_argument(
        'scene', metavar='SCENE', choices=(*SCENES, RANDOM),
        help=f'name of the scene, or {RANDOM}: one drawn from the seed with its own sensor',
    )
    parser.add_argument(
        '--kind', choices=KINDS, default='any', help='of a random scene (default: %(default)s)',
    )
    parser.add_argument('-o', '--output', metavar='DIR', type=Path, required=True)
    parser.add_argument('--seed', type=natural, default=0, help='of everything random')
    parser.add_argument('--force', action='store_true', help='replace DIR if it exists')
    _add_flight_options(parser.add_argument_group('flight'))
    survey = parser.add_argument_group('airborne map')
    survey.add_argument('--map', action='store_true', help='write map.laz instead of a flight')
    survey.add_argument(
        '--density', type=positive, default=20.0, metavar='D', help='pulses per square metre',
    )
    survey.add_argument(
        '--num-points', type=natural, metavar='N', help='exactly this number of points',
    )
    survey.add_argument(
        '--origin', type=number, nargs=3, default=(0.0, 0.0, 0.0), metavar=('X', 'Y', 'Z'),
        help='added to all coordinates [m], for UTM-sized ones',
    )
    return parser


def _add_flight_options(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        '--duration', type=positive, metavar='S', help='end after this time; once along the '
        'line by default',
    )
    group.add_argument(
        '--shuttle', action='store_true', help='fly back and forth until the duration is over',
    )
    group.add_argument('--speed', type=positive, metavar='M/S')
    group.add_argument(
        '--lateral', type=number, metavar='M', help='offset to the left of the line',
    )
    group.add_argument(
        '--height', type=number, metavar='M',
        help='above the phases, or the ground without a line',
    )
    group.add_argument(
        '--drift', type=number, default=OdometryErrors().drift, metavar='SHARE',
        help='slip of the odometry per distance (default: %(default)s)',
    )
    group.add_argument(
        '--odometry-rate', type=positive, default=100.0, metavar='HZ', help='at most 200',
    )
    group.add_argument('--scan-rate', type=positive, default=10.0, metavar='HZ', help='1 to 20')
    group.add_argument('--dual', action='store_true', help='two returns a beam')
    group.add_argument(
        '--organized', action='store_true', help='firings x 16 points, NaN where nothing returned',
    )
    group.add_argument(
        '--stamp-first', action='store_true',
        help='stamp the first packet (times >= 0), not the last (times <= 0)',
    )
    group.add_argument('--max-range', type=positive, default=100.0, metavar='M')
    group.add_argument(
        '--view', type=number, nargs=2, default=(0.0, 360.0), metavar=('DIRECTION', 'WIDTH'),
        help='sector that the driver passes on [deg], counter-clockwise from ahead',
    )
    group.add_argument(
        '--lidar-xyz', type=number, nargs=3, default=(0.0, 0.0, 0.0), metavar=('X', 'Y', 'Z'),
        help='position of the lidar in the base frame [m]',
    )
    group.add_argument(
        '--lidar-rpy-deg', type=number, nargs=3, default=(0.0, 0.0, 0.0),
        metavar=('ROLL', 'PITCH', 'YAW'), help='its attitude in the base frame [deg]',
    )


def number(text: str) -> float:
    """Read a number that a coordinate can have, as the type of an argument."""
    value = float(text)
    if not abs(value) <= MOST_COORDINATE:
        raise argparse.ArgumentTypeError(f'{text} is not within {MOST_COORDINATE:g}')
    return value


def natural(text: str) -> int:
    """Read a whole number from 0, as the type of an argument."""
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f'{value} is negative')
    return value


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return run_command(NAME, lambda: _run(argv))


def _run(argv: Sequence[str] | None) -> int:
    parser = build_parser()
    arguments = parser.parse_args(argv)
    refused, what = {'kind', *_OF_MAPS}, 'a flight'
    if arguments.scene == RANDOM:
        refused, what = set(vars(arguments)) - _OF_RANDOM, f'the scene {RANDOM}'
    elif arguments.map:
        refused, what = set(vars(arguments)) - _OF_ALL - _OF_MAPS, 'a map'
    given = sorted(
        name for name in refused if getattr(arguments, name) != parser.get_default(name)
    )
    if given:
        options = ', '.join(f'--{name.replace("_", "-")}' for name in given)
        parser.error(f'{what} takes no {options}')
    with open_folder(arguments.output, arguments.force) as folder:
        if arguments.scene == RANDOM:
            text = _write_random(folder, arguments)
        else:
            scene = make_scene(arguments.scene, arguments.seed)
            write = _write_map if arguments.map else _write_flight
            text = write(folder, scene, arguments)
    print(make_one_line(f'{arguments.output}: {text}'))
    return DONE


def _write_map(folder: Path, scene: Scene, arguments: argparse.Namespace) -> str:
    rng = np.random.default_rng(arguments.seed)
    cloud = simulate_map(
        scene, arguments.density, rng, noise=_MAP_NOISE, num_points=arguments.num_points,
    )
    write_cloud(folder / 'map.laz', cloud, arguments.origin)
    truth = make_truth(
        scene, collect_sightings(scene, cloud.exact, cloud.label, cloud.conductor), kind='map',
        frame_id='map', bin_size=1.0, noise=_MAP_NOISE, origin=arguments.origin,
    )
    return _write_truth(folder, scene, cloud, truth)


def _write_random(folder: Path, arguments: argparse.Namespace) -> str:
    made = make_random(arguments.seed, arguments.kind)
    write_cloud(folder / 'map.laz', made.cloud)
    return _write_truth(folder, made.scene, made.cloud, made.truth)


def _write_truth(
    folder: Path, scene: Scene, cloud: LabelledCloud, truth: dict[str, Any],
) -> str:
    (folder / 'truth.json').write_text(json.dumps(truth, indent=1) + '\n')
    return (f'map of {len(cloud.points)} points on {scene.area:.0f} m2, '
            f'{scene.num_lines} lines, {len(scene.conductors)} spans, '
            f'{len(truth["hazards"])} hazards')


def _write_flight(folder: Path, scene: Scene, arguments: argparse.Namespace) -> str:
    given = {
        name: getattr(arguments, name) for name in ('speed', 'lateral', 'height', 'duration')
        if getattr(arguments, name) is not None
    }
    plan = replace(PLANS.get(scene.name, FlightPlan()), shuttle=arguments.shuttle, **given)
    puck = Puck(
        rate=arguments.scan_rate, max_range=arguments.max_range, dual=arguments.dual,
        organized=arguments.organized, stamp_first=arguments.stamp_first,
        lidar_xyz=tuple(arguments.lidar_xyz), lidar_rpy_deg=tuple(arguments.lidar_rpy_deg),
        view_direction_deg=arguments.view[0], view_width_deg=arguments.view[1],
    )
    from tqdm import tqdm

    with open_bag(folder, 'flight') as writer, tqdm(
        unit='scan', disable=sys.stderr is None or not sys.stderr.isatty(), leave=False,
    ) as bar:
        def show(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        truth = simulate_flight(
            scene, writer, np.random.default_rng(arguments.seed), Flight(
                plan=plan, puck=puck, errors=OdometryErrors(drift=arguments.drift),
                odometry_rate=arguments.odometry_rate,
            ), show,
        )
    (folder / 'truth.json').write_text(json.dumps(truth, indent=1) + '\n')
    return (f'flight of {truth["duration"]:.0f} s, {truth["num_scans"]} scans, '
            f'{truth["num_points"]} points, {scene.num_lines} lines, '
            f'{len(scene.conductors)} spans, {len(truth["hazards"])} hazards')


if __name__ == '__main__':
    sys.exit(main())
