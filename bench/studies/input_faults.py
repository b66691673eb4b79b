# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Flies what seeds draw, without a fault and with each kind, and prints what was said and found.

``wrongly`` is what was said though it is not so, ``missed`` what was not said though spans or
hazards came out wrong.  Ends with 1, and names the rows, where one is not as it should be: without
a fault something was said or held back; with one a ghost span or a false critical was told, or
spans are missing without a word.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path
import sys
import time

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from flights.drawn_flights import draw_flight, SECONDS
from flights.event_faults import (
    freeze,
    hold,
    leave,
    mount_otherwise,
    move,
    raise_dust,
    shift_clock,
    stretch,
    turn_heading,
    turn_world,
)
from flights.faulty_flights import (
    compare,
    Fault,
    Found,
    put_together,
    record,
    tell_truth,
    Truth,
)

LEAST_FOUND = 0.9
"""Share of the length of the spans without the fault that is to be found, or said to be lost."""
CLOCK = 'clock', 'unsharp'
SCALE = 'scale', 'drift', 'otherwise', 'aside', 'unsharp'
HEADING = 'heading', 'mount', 'aside', 'drift', 'unsharp'
DOWN = 'overhead', 'plumb', 'drift', 'lost'
MOUNT = 'mount', 'plumb', 'aside', 'heading', 'drift', 'unsharp'
"""What may be said of these; the first should be."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """A kind of fault."""

    fault: Fault
    right: tuple[str, ...] = ()
    """What may be said of it, of KINDS; the first should be."""


def make_kinds(seed: int) -> dict[str, Kind]:
    """Return the faults of a flight; directions and times are of the seed."""
    rng = np.random.default_rng([seed, 26])
    way = rng.normal(size=3) * (1.0, 1.0, 0.5)
    way /= np.linalg.norm(way)
    when = float(rng.uniform(10.0, SECONDS - 12.0))
    faults: dict[str, tuple[Fault, tuple[str, ...]]] = {
        'none': (leave, ()),
        **{f'clock {1e3 * lead:+.0f} ms': (shift_clock(lead), CLOCK)
           for lead in (0.03, -0.05, 0.08, -0.15, 0.3)},
        'clock 0.5 % fast': (shift_clock(0.0, 0.005), CLOCK),
        **{f'positions {100 * (scale - 1):+.0f} %': (stretch(scale), SCALE)
           for scale in (1.02, 0.97, 1.05, 0.9, 1.1)},
        **{f'heading {rate:g} degrees/s': (turn_heading(rate), HEADING)
           for rate in (0.05, -0.2, 1.0)},
        **{f'mount {axis} {angle:g} degrees': (
            mount_otherwise(tuple(angle * np.eye(3)[number])), MOUNT,
        ) for number, axis in enumerate(('roll', 'pitch', 'yaw')) for angle in (2.0, -5.0)},
        'z down': (turn_world(180.0, 0.0, 0.0), DOWN),
        'upside down': (mount_otherwise((180.0, 0.0, 0.0)), (*DOWN, *MOUNT)),
        **{f'dust {100 * share:g} %': (raise_dust(share), ('dust',))
           for share in (0.001, 0.003, 0.01, 0.1)},
        'positions at 10 Hz': (hold(0.1), ('repeated',)),
        'still for 5 s': (freeze(when, 5.0), ('stood', 'drift')),
        'step of 2 m': (move(when, 2.0, 0.0, way), ('step', 'drift')),
        'drift of 5 cm/s': (move(0.0, 0.0, 0.05, way), ('drift',)),
    }
    return {name: Kind(fault=fault, right=right) for name, (fault, right) in faults.items()}


def by_time(item: tuple[str, float]) -> float:
    """Return when something was said [s]."""
    return item[1]


def describe(
    name: str, kind: Kind, found: Found, clean: Found, truth: Truth
) -> tuple[str, bool]:
    """Return a row of the table, and whether it is as it should be."""
    own, before = compare(found, clean, truth), compare(clean, clean, truth)
    said = found.said
    wrongly = [word for word in said if word not in kind.right and word not in clean.said]
    if name == 'none':
        wrongly = [word for word in said if word != 'drift']  # it slips
    first = min((said[word] for word in kind.right if word in said), default=None)
    told = ' '.join(f'{word} {when:.0f}' for word, when in sorted(said.items(), key=by_time))
    lost = first is None and own.covered < LEAST_FOUND * before.covered
    wrong = not found.poor and (own.ghosts > before.ghosts or own.false > 0 or lost)
    good = not wrong and not (name == 'none' and (wrongly or found.poor))
    held = 'held' if found.poor else ''
    row = (
        f'{own.spans} of {own.known} spans, {own.covered:.0%}, '
        f'{own.ghosts} ghosts of {before.ghosts}, {own.criticals} criticals of '
        f'{before.criticals}, {own.false} false, doubled {found.doubled:.2f} | {held}'
        f'{f" anew {found.restarts}" if found.restarts else ""} | {told or "-"}'
        f'{f" | WRONGLY {wrongly}" if wrongly else ""}{"" if good else " | BAD"}'
        f'{" | MISSED" if wrong and first is None else ""}'
    )
    if 'clock' in kind.right or found.offset:
        row += f' | shifted by {found.offset:+.3f} s'
    return row, good


def main() -> int:
    """Fly, and print a row for each fault of each flight."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('names', nargs='*', help='parts of the names of the faults; all')
    parser.add_argument('--seeds', nargs='+', type=int, default=range(5000, 5010))
    parser.add_argument('--cache', type=Path, help='where simulated flights are kept')
    parser.add_argument('--say', action='store_true', help='print what was said, too')
    arguments = parser.parse_args()
    wrong: list[str] = []
    rows = 0
    for seed in arguments.seeds:
        *made, text = draw_flight(seed)
        path = arguments.cache / f'drawn_{seed}.pickle' if arguments.cache else None
        flight = record(path, lambda made=made: made, seed)
        print(f'{seed}: {text}', flush=True)
        truth = tell_truth(made[0])
        clean: Found | None = None
        for name, kind in make_kinds(seed).items():
            if name != 'none' and arguments.names and not any(
                part in name for part in arguments.names
            ):
                continue
            begin = time.perf_counter()
            found = put_together(flight, kind.fault)
            clean = clean or found
            row, good = describe(name, kind, found, clean, truth)
            wrong += [] if good else [f'{seed} {name}']
            rows += 1
            print(f'{seed} | {name} | {row} | {time.perf_counter() - begin:.0f} s', flush=True)
            if arguments.say:
                print(*[f'    {line}' for line in found.told], sep='\n', flush=True)
    print(f'{len(wrong)} of {rows} are not as they should be', *wrong, sep='\n    ')
    return int(bool(wrong))


if __name__ == '__main__':
    sys.exit(main())
