# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Flies there and back with odometry that steps, drifts or stands still, and prints what is found.

Each flight is simulated once, and put into a map as it is and with each fault.  ``doubled`` is how
far what was seen on the way back lies from where the same was put on the way there, at the place
of the vehicle; ``--bare`` does without the correction of the odometry.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
import sys

import numpy as np

from plc_inspect.results import Severity
from plc_inspect.sim.scenes.catalogue import make_scene
from plc_inspect.sim.scenes.scene import Scene
from plc_inspect.sim.surveys.flight import Flight, PLANS
from plc_inspect.sim.surveys.trajectory import fly

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from flights.faulty_flights import (
    compare,
    Event,
    Fault,
    Found,
    list_conductors,
    Pose,
    put_together,
    record,
    Recorded,
    Turn,
)

SCENES = ('low_voltage', 'medium_voltage', 'contact', 'street', 'rack')
SEEDS = (41, 42)
"""None of them was used in development, which had 1 to 3."""
LENGTH, SPEED = 52.0, 6.0
"""Of a flight [s], [m/s]: 150 m there and back."""

Change = Callable[[float, np.ndarray], np.ndarray | None]


def fly_back(name: str, seed: int, cache: Path | None) -> tuple[Scene, Recorded]:
    """Simulate a flight there and back, or read it from the cache."""
    scene = make_scene(name, seed)
    plan = replace(PLANS[name], speed=SPEED, margin=0.0)
    whole = fly(scene, plan, np.random.default_rng(seed)).duration * SPEED
    plan = replace(
        plan, shuttle=True, turning=1.0, duration=LENGTH,
        margin=min(8.0, (LENGTH / 2.0 * SPEED - whole) / 2.0),
    )
    path = cache / f'there_{name}_{seed}.pickle' if cache else None
    return scene, record(path, lambda: (scene, Flight(plan=plan)), seed)


def change_poses(change: Change) -> Fault:
    """Return a fault that changes positions, or leaves poses out."""

    def run(event: Event) -> Iterator[Event]:
        place = change(event.time, event.position) if isinstance(event, Pose) else None
        if isinstance(event, Turn):
            yield event
        elif place is not None:
            yield event._replace(position=place)

    return run


def make_faults(seed: int) -> dict[str, Change]:
    """Return the faults of one flight: sizes, directions and times are of the seed."""
    rng = np.random.default_rng(seed)

    def draw_way() -> np.ndarray:
        way = rng.normal(size=3) * (1.0, 1.0, 0.5)
        return way / np.linalg.norm(way)

    faults: dict[str, Change] = {'none': lambda t, p: p}
    for size in (0.1, 0.5, 2.0, 10.0):
        when, move = rng.uniform(12.0, LENGTH - 12.0), size * draw_way()
        faults[f'step of {size:g} m'] = (
            lambda t, p, when=when, move=move: p + move if t > when else p
        )
    for speed in (0.01, 0.03, 0.1):
        rate = speed * draw_way()
        faults[f'drift of {100 * speed:g} cm/s'] = lambda t, p, rate=rate: p + rate * t
    when = rng.uniform(12.0, LENGTH - 12.0)
    kept: dict[str, np.ndarray] = {}

    def freeze(t: float, p: np.ndarray) -> np.ndarray:
        if not when < t < when + 5.0:
            kept['last'] = p
        return kept['last']

    faults['frozen for 5 s'] = freeze
    return faults


def describe(found: Found, clean: Found, truth: np.ndarray) -> tuple[str, bool]:
    """Return what was found beside the flight without fault, and whether that is right."""
    own, before = compare(found, clean, truth), compare(clean, clean, truth)
    text = (
        f'{own.spans} spans for {own.known}, {own.ghosts} elsewhere, '
        f'doubled {found.doubled:.2f} m, {own.criticals} criticals for {before.criticals}, '
        f'{own.false} false'
        f'{", held back" if found.poor else ""}'
        f'{f", {found.restarts} times anew" if found.restarts else ""}'
    )
    return text, found.doubled < 0.2 and not own.false


def main() -> int:
    """Fly, and print a row for each fault of each flight."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('names', nargs='*', help='parts of the names of the faults; all')
    parser.add_argument('--scenes', nargs='+', default=SCENES)
    parser.add_argument('--seeds', nargs='+', type=int, default=SEEDS)
    parser.add_argument('--cache', type=Path, help='where simulated flights are kept')
    parser.add_argument('--bare', action='store_true')
    parser.add_argument('--say', action='store_true', help='print what was said, too')
    arguments = parser.parse_args()
    wrong = 0
    for seed in arguments.seeds:
        for name in arguments.scenes:
            scene, flight = fly_back(name, seed, arguments.cache)
            clean = None
            for fault, change in make_faults(seed).items():
                if fault != 'none' and arguments.names and not any(
                    part in fault for part in arguments.names
                ):
                    continue
                found = put_together(flight, change_poses(change), bare=arguments.bare)
                clean = clean or found
                text, good = describe(found, clean, list_conductors(scene))
                wrong += not good
                print(f'{name} {seed} | {fault} | {text}', flush=True)
                if arguments.say:
                    print(*[f'    {line}' for line in found.told], sep='\n', flush=True)
                    print('    critical:', *[
                        f'{h.kind.name} {h.clearance:.2f} of {h.required:.2f} at '
                        f'{h.position.round(1).tolist()}' for h in found.hazards
                        if h.severity == Severity.CRITICAL
                    ], sep='\n        ')
    print(f'{wrong} not as they should be')
    return 0


if __name__ == '__main__':
    sys.exit(main())
