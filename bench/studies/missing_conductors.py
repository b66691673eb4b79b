# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Takes a conductor out of one span of random scenes, and tells whether that is a hazard.

It is one of three spans at least, well seen in these, and no strand of a bundle.  What is raised
elsewhere, or in the scene as it was, is false.  Ends with 1 where anything is.
"""

import argparse
import math
from pathlib import Path
import sys

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from random_scenes import parse_seeds

from plc_inspect.core.pipeline import Pipeline
from plc_inspect.results import Float64, Hazard, HazardKind
from plc_inspect.sim.random_scenes.truth import make_random, RandomScene
from plc_inspect.sim.scenes.conductors import Conductor

DENSITY, LEAST_POINTS = 1.5, 60
"""Points a metre of the conductor in each of the three spans, and of the one taken, at least."""
SAME = 15.0
"""A hazard is of the conductor where it lies this near to its middle in plan [m]."""


def choose(made: RandomScene) -> int | None:
    """Return the number of a conductor to take out, None where there is none."""
    conductors, own = made.scene.conductors, made.cloud.conductor
    count = np.bincount(own[own >= 0], minlength=len(conductors))
    number = {(item.line_id, item.span_id): k for k, item in enumerate(conductors)
              if item.bundle_id < 0}
    found = []
    for (line, span), k in number.items():
        beside = number.get((line, span - 1)), number.get((line, span + 1))
        if None not in beside and count[k] >= LEAST_POINTS and all(
            count[n] >= DENSITY * measure(conductors[n]) for n in (k, *beside)
        ):
            found.append(k)
    return found[len(found) // 2] if found else None


def measure(conductor: Conductor) -> float:
    """Return the length of a conductor in plan [m]."""
    return math.dist(conductor.start[:2], conductor.end[:2])


def find(points: Float64) -> list[Hazard]:
    """Return the conductors that are said to be missing."""
    return [item for item in Pipeline().run(points).hazards if item.kind == HazardKind.MISSING]


def main() -> int:
    """Print what was found, and what was not."""
    parser = argparse.ArgumentParser(description='Conductors taken out of random scenes.')
    parser.add_argument('--seeds', type=parse_seeds, default='0:50', metavar='A:B')
    arguments = parser.parse_args()
    taken = found = false = 0
    for seed in arguments.seeds:
        made = make_random(seed, 'any')
        points, own = made.cloud.points, made.cloud.conductor
        before = find(points)
        false += len(before)
        number = choose(made)
        note = f'{len(before)} in the scene as it is' if before else ''
        if number is not None:
            taken += 1
            middle = points[own == number].mean(axis=0)
            hazards = find(points[own != number])
            right = [item for item in hazards
                     if math.dist(item.position[:2], middle[:2]) < SAME]
            found += bool(right)
            false += len(hazards) - len(right)
            if len(hazards) != 1 or not right:
                note += f' {len(right)} at the conductor, {len(hazards) - len(right)} elsewhere'
        if note:
            print(f'seed {seed}: {made.text}: {note.strip()}', flush=True)
    print(f'{found} of {taken} found, {false} false in {len(arguments.seeds)} scenes')
    return int(false > 0)


if __name__ == '__main__':
    sys.exit(main())
