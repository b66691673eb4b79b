# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Lets a conductor slip in one span of random scenes, and tells whether it is found as it hangs.

It then sags by more than 8 % of its span, by 17 % at most, and stays 2 m above the ground.  It is
chosen as `missing_conductors` does.  It is found where 95 % of its points are called wire, and a
span there sags as much to 5 %; spans more than in the scene as it was are false.
"""

import argparse
from pathlib import Path
import sys

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from random_scenes import parse_seeds
from studies.missing_conductors import choose, measure, SAME

from plc_inspect.core.pipeline import Pipeline
from plc_inspect.results import Float64, PointClass
from plc_inspect.sim.random_scenes.truth import make_random, RandomScene

LEAST_RATIO, MOST_RATIO = 0.085, 0.17
"""Sag as a share of the span."""
LEAST_HEIGHT = 2.0
"""Above the ground [m]."""
LABELLED, SAME_SAG = 0.95, 0.05


def let_slip(made: RandomScene, number: int, ratio: float) -> tuple[Float64, float] | None:
    """Return the points with a conductor that sags more, and its sag [m]; None if too low."""
    conductor, points = made.scene.conductors[number], made.cloud.points.copy()
    length = measure(conductor)
    share = np.linspace(0.0, 1.0, 101)
    curve = conductor.sample(0.5)
    along = np.hypot(*(curve[:, :2] - curve[0, :2]).T) / length
    before = np.interp(share, along, curve[:, 2])
    chord = before[0] + share * (before[-1] - before[0])
    sag = ratio * length
    lower = before - (chord - 4.0 * sag * share * (1.0 - share))
    place = conductor.start[:2] + share[:, None] * (conductor.end[:2] - conductor.start[:2])
    if (before - lower - made.scene.terrain.heights(place)).min() < LEAST_HEIGHT:
        return None
    own = np.flatnonzero(made.cloud.conductor == number)
    at = np.hypot(*(points[own, :2] - conductor.start[:2]).T) / length
    points[own, 2] -= np.interp(at, share, lower)
    return points, sag


def main() -> int:
    """Print what was found, and what was not."""
    parser = argparse.ArgumentParser(description='Conductors that slipped in random scenes.')
    parser.add_argument('--seeds', type=parse_seeds, default='0:50', metavar='A:B')
    arguments = parser.parse_args()
    taken = found = false = 0
    for seed in arguments.seeds:
        made = make_random(seed, 'any')
        number = choose(made)
        ratio = float(np.random.default_rng(seed).uniform(LEAST_RATIO, MOST_RATIO))
        slipped = None
        while number is not None and slipped is None and ratio >= LEAST_RATIO:
            slipped, ratio = let_slip(made, number, ratio), 0.9 * ratio
        if slipped is None:
            continue
        points, sag = slipped
        before, after = Pipeline().run(made.cloud.points), Pipeline().run(points)
        own = made.cloud.conductor == number
        labelled = float((after.classification[own] == PointClass.WIRE).mean())
        middle = points[own, :2].mean(axis=0)
        sags = [
            span.sag for span in after.spans
            if np.hypot(*(0.5 * (span.start + span.end)[:2] - middle)) < SAME
            and abs(span.sag - sag) < SAME_SAG * sag
        ]
        more = max(len(after.spans) - len(before.spans), 0)
        is_found = labelled >= LABELLED and bool(sags)
        taken, found, false = taken + 1, found + is_found, false + more
        if not is_found or more:
            print(f'seed {seed}: {made.text}: sag {sag:.1f} m, {100 * labelled:.0f} % labelled,'
                  f' {"found" if sags else "not found"}, {more} more spans', flush=True)
    print(f'{found} of {taken} found, {false} more spans, {len(arguments.seeds)} scenes')
    return 0


if __name__ == '__main__':
    sys.exit(main())
