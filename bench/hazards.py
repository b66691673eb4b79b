# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Hazards: those planted in simulated scenes, and those of real clouds in many frames.

Each scene of `plc_inspect.sim.surveys.planted` holds something of each kind, nearer or farther
than the limit.  What lies beyond two standard deviations of its limit has to be raised once, what
keeps it by as much has to be left alone; the rest is too close to call.  What real clouds are held
against is in `common.real_hazards`.  With ``--write`` the tables go into ``docs/hazards.md``.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
import math
from pathlib import Path
import sys

from common.real_hazards import CLOUDS, run_clouds
from common.tables import at_least, at_most, Check, CHECK_COLUMNS, render_table, replace_section
import numpy as np
from numpy.typing import NDArray

from plc_inspect.config import Settings
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.results import Hazard, HazardKind
from plc_inspect.setting_names import update
from plc_inspect.sim.surveys.airborne import simulate_map
from plc_inspect.sim.surveys.planted import measure, PLACES, plant, Planted

Float64 = NDArray[np.float64]

ROOT = Path(__file__).parents[1]
REAL = ROOT.parent / 'shared/data/real'
PAGE = ROOT / 'docs/hazards.md'
SETTINGS = update(Settings(), {'hazards.fall_distance': 2.0})
NOISE = 0.03
"""Standard deviation of each coordinate of a simulated point [m]."""
SIGMA = {
    HazardKind.VEGETATION: 0.05, HazardKind.STRUCTURE: 0.05, HazardKind.FALL_IN: 0.2,
    HazardKind.GROUND: 0.05, HazardKind.CROSSING: 0.05, HazardKind.INTERFERENCE: 0.05,
    HazardKind.SAG: 0.02,
}
"""Standard deviation that decides what is too close to call [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tally:
    """What became of the things of one kind."""

    kind: HazardKind
    due: int
    found: int
    safe: int
    raised: int
    """Of the safe ones."""
    close: int
    """Too close to the limit to call."""
    doubled: int
    """Raised more than once."""
    stray: int
    """Hazards where nothing of the kind was planted."""
    errors: tuple[float, ...]
    """Measured less exact values of what was raised [m]."""


def survey(seed: int, density: float) -> list[tuple[Planted | None, float, list[Hazard]]]:
    """
    Survey one scene.

    Returns
    -------
    list of tuple
        What was planted, by how much it keeps its limit [m], and the hazards raised for it; at
        the end None, 0 and the hazards for nothing.

    """
    scene, planted = plant(seed)
    cloud = simulate_map(scene, density, np.random.default_rng(seed), noise=NOISE)
    left = list(Pipeline(SETTINGS).run(cloud.points).hazards)
    rows: list[tuple[Planted | None, float, list[Hazard]]] = []
    for item in planted:
        value, limit = measure(item, scene, cloud)
        own = [hazard for hazard in left if belongs(hazard, item)]
        left = [hazard for hazard in left if not any(hazard is other for other in own)]
        rows.append((item, value - limit, own))
        if item.kind == HazardKind.VEGETATION and not own:  # what is near already does not fall
            tree = replace(item, kind=HazardKind.FALL_IN)
            value, limit = measure(tree, scene, cloud)
            own = [hazard for hazard in left if belongs(hazard, tree)]
            left = [hazard for hazard in left if not any(hazard is other for other in own)]
            rows.append((tree, value - limit, own))
    return [*rows, (None, 0.0, left)]


def list_faults(rows: Sequence[tuple[Planted | None, float, list[Hazard]]]) -> list[str]:
    """Return in words what was missed, raised wrongly, twice or for nothing."""
    lines = []
    for item, margin, found in rows:
        if item is None:
            lines += [f'for nothing: {hazard}' for hazard in found]
            continue
        sigma = SIGMA[item.kind]
        what = f'{item.kind.name.lower()} at {item.position.round(1)}, margin {margin:+.3f} m'
        if margin < -2 * sigma and not found:
            lines.append(f'missed: {what}')
        if margin > 2 * sigma and found:
            lines.append(f'raised: {what}: {found[0]}')
        if len(found) > 1:
            lines.append(f'twice: {what}: {found}')
    return lines


def belongs(hazard: Hazard, item: Planted) -> bool:
    """Return whether a hazard is about something planted."""
    apart = math.dist(hazard.position[:2], item.position)
    return hazard.kind == item.kind and apart <= max(PLACES[item.kind], item.radius)


def tally(rows: Sequence[tuple[Planted | None, float, list[Hazard]]]) -> list[Tally]:
    """Return the counts of each kind."""
    result = []
    for kind in PLACES:
        own = [(margin, found) for item, margin, found in rows if item and item.kind == kind]
        margins = np.array([margin for margin, _ in own])
        raised = np.array([len(found) for _, found in own])
        sigma = SIGMA[kind]
        due, safe = margins < -2 * sigma, margins > 2 * sigma
        errors = tuple(
            required_margin(found[0]) - margin for margin, found in own if found
        )
        result.append(Tally(
            kind=kind, due=int(due.sum()), found=int((due & (raised > 0)).sum()),
            safe=int(safe.sum()), raised=int((safe & (raised > 0)).sum()),
            close=int((~due & ~safe).sum()), doubled=int((raised > 1).sum()),
            stray=sum(hazard.kind == kind for item, _, found in rows if item is None
                      for hazard in found),
            errors=errors,
        ))
    return result


def required_margin(hazard: Hazard) -> float:
    """Return by how much a hazard keeps its limit, negative [m]."""
    margin = hazard.clearance - hazard.required
    return -margin if hazard.kind == HazardKind.SAG else margin


def render_tallies(tallies: Sequence[Tally]) -> str:
    """Return the table of the simulated scenes."""
    return render_table(
        ('kind', 'due', 'found', 'safe', 'raised all the same', 'too close to call',
         'raised twice', 'for nothing', 'median error [m]', 'greatest [m]'),
        [
            (
                item.kind.name.lower(), str(item.due), str(item.found), str(item.safe),
                str(item.raised), str(item.close), str(item.doubled), str(item.stray),
                f'{np.median(item.errors):+.3f}' if item.errors else '-',
                f'{max(item.errors, key=abs):+.3f}' if item.errors else '-',
            )
            for item in tallies
        ],
    )


def check_tallies(tallies: Sequence[Tally]) -> list[Check]:
    """Return the checks of the simulated scenes."""
    return [
        at_least('planted hazards', 'found of those due',
                 sum(item.found for item in tallies) / max(sum(item.due for item in tallies), 1),
                 1.0, '%'),
        at_most('planted hazards', 'raised on the safe side',
                float(sum(item.raised for item in tallies)), 0.0),
        at_most('planted hazards', 'raised for nothing',
                float(sum(item.stray for item in tallies)), 0.0),
        at_most('planted hazards', 'raised twice',
                float(sum(item.doubled for item in tallies)), 0.0),
    ]


def main(argv: Sequence[str] | None = None) -> int:
    """Print the tables; exit 1 where a floor is missed."""
    parser = argparse.ArgumentParser(description='Hazards found, missed and false.')
    parser.add_argument('--seeds', type=int, default=10, help='number of scenes')
    parser.add_argument('--density', type=float, default=40.0, help='pulses per square metre')
    parser.add_argument('--real', type=Path, metavar='DIR', default=REAL)
    parser.add_argument('--clouds', nargs='*', choices=CLOUDS, default=CLOUDS, metavar='NAME',
                        help='real clouds, by default all')
    parser.add_argument('--frames', type=int, default=5, metavar='N',
                        help='random frames of each real cloud beside its own')
    parser.add_argument('--seed', type=int, default=0, help='of the frames')
    parser.add_argument('--write', action='store_true', help=f'into {PAGE.relative_to(ROOT)}')
    parser.add_argument('--verbose', action='store_true', help='name what went wrong')
    arguments = parser.parse_args(argv)
    rows = []
    for seed in range(arguments.seeds):
        found = survey(seed, arguments.density)
        rows += found
        for line in list_faults(found) if arguments.verbose else ():
            print(f'seed {seed}: {line}', file=sys.stderr)
    tallies = tally(rows)
    checks = check_tallies(tallies)
    real = []
    if arguments.real.is_dir():
        table, own = run_clouds(
            arguments.real, arguments.clouds, arguments.frames, arguments.seed, arguments.verbose
        )
        checks += own
        real = [f'Real clouds as they are and in {arguments.frames} frames; the worst frame of'
                ' each.', table]
    else:
        print(f'skipped: the real clouds, as there is no {arguments.real}', file=sys.stderr)
    text = '\n\n'.join([
        f'{arguments.seeds} scenes at {arguments.density:g} pulses/m2, range noise'
        f' {NOISE:g} m on each coordinate.',
        render_tallies(tallies),
        *real,
        render_table(CHECK_COLUMNS, [check.row() for check in checks]),
    ])
    print(text)
    if arguments.write:
        replace_section(PAGE, 'bench', text)
    return 0 if all(check.passed for check in checks) else 1


if __name__ == '__main__':
    sys.exit(main())
