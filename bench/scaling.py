# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Growth of time and memory with the number of points, the length of the corridor and the flight.

The points are those of one high-voltage corridor at rising density, and copies of a corridor laid
end to end at one density.  A straight line in the double logarithmic plot is a power; its slope is
printed, and 1 is linear.  ``--write`` draws docs/images/scaling.png and puts the tables into
docs/performance.md.  A flight sees copies of a corridor bit by bit, and a tick of the node's
worker, run here without ROS, must not take longer for what was flown before: from half way on a
second flight, which begins there, has its ticks by turns with those of the first.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
import sys

from common.flown_ticks import FlownTick, fly_along
from common.measure import measure
from common.surveys import make_map, open_cache
from common.tables import at_most, Check, CHECK_COLUMNS, render_table, replace_section
from matplotlib import pyplot
import numpy as np

from plc_inspect.core.pipeline import Pipeline
from plc_inspect.offline.commands.allocator import keep_freed_memory

ROOT = Path(__file__).resolve().parents[1]
NUM_POINTS = (100_000, 300_000, 1_000_000, 3_000_000, 10_000_000, 30_000_000)
COPIES = (1, 2, 4, 8, 16)
COPY_POINTS = 1_000_000
GAP = 200.0
"""Distance of the copies of a corridor [m]."""
MOST_POWER = 1.1
"""Growth counts as linear up to this power: the smallest clouds fit into caches."""
FLIGHT_COPIES = 8
MOST_SLOWER = 1.1
"""Median tick of a flight's second half, in those of a flight that begins there."""
FROM_POINTS = 1_000_000
"""Powers are fitted from this size on, where fixed costs no longer count."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sample:
    """One cloud through the pipeline."""

    size: float
    """What grows: points, or kilometres of corridor."""
    num_points: int
    num_spans: int
    seconds: float
    extra_bytes: float


def grow_density(cache: Path, most: int, rng: np.random.Generator) -> Iterator[np.ndarray]:
    """Yield clouds of one corridor, each a random share of the densest, smallest first."""
    numbers = [number for number in NUM_POINTS if number <= most]
    points = make_map(cache, 'high_voltage', num_points=numbers[-1]).points
    order = rng.permutation(len(points)) if len(numbers) > 1 else np.arange(len(points))
    for number in numbers:
        yield points[np.sort(order[:number])]


def grow_length(cache: Path, most: int) -> Iterator[tuple[float, np.ndarray]]:
    """Yield the length [km] and the points of ever longer corridors of one density."""
    num = min(COPY_POINTS, most)
    for copies in COPIES:
        if copies == 1 or copies * num <= most:
            points, pitch = lay_copies(cache, num, copies)
            yield copies * (pitch - GAP) / 1000.0, points


def lay_copies(cache: Path, num: int, copies: int) -> tuple[np.ndarray, float]:
    """Return copies of one corridor of so many points, end to end, and their distance [m]."""
    points = make_map(cache, 'high_voltage', num_points=num).points
    pitch = float(np.ptp(points[:, 0])) + GAP
    laid = [points + np.array([k * pitch, 0.0, 0.0]) for k in range(copies)]
    return np.vstack(laid), pitch


Part = tuple[float, list[FlownTick]]
"""The end of one copy of the corridor [m], and the ticks along it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Flight:
    """A flight along copies of one corridor."""

    parts: list[Part]
    """Copy by copy."""
    middle: float
    """Where the second half begins, and the other flight [m]."""
    other: list[FlownTick]
    """Ticks of a flight that begins there, by turns with those of the second half."""


def fly(cache: Path, most: int, rng: np.random.Generator) -> Flight:
    """Fly along copies of one corridor, and from half way on a second time beside it."""
    num = min(COPY_POINTS, most)
    copies = min(FLIGHT_COPIES, most // num)
    points, pitch = lay_copies(cache, num, copies)
    middle = copies // 2 * pitch
    late = points[points[:, 0] >= points[:, 0].min() + middle]
    second = fly_along(late, np.random.default_rng(0)) if middle else iter(())
    parts: list[Part] = []
    other: list[FlownTick] = []
    for tick in fly_along(points, rng):
        if not parts or tick.flown >= parts[-1][0]:
            parts.append(((len(parts) + 1) * pitch, []))
            print(f'flown {tick.flown:.0f} m: a tick of {1e3 * tick.seconds:.0f} ms',
                  file=sys.stderr, flush=True)
        parts[-1][1].append(tick)
        if tick.flown >= middle:
            other += islice(second, 1)
    return Flight(parts=parts, middle=middle, other=other)


def take(size: float, points: np.ndarray, repeats: int) -> Sample:
    """Return the fastest of a few runs, and the memory of one before them."""
    first = measure(lambda: Pipeline().run(points))
    extra_bytes, num_spans = first.extra_bytes, len(first.value.spans)
    del first  # its memory serves the next runs
    seconds = min(
        measure(lambda: Pipeline().run(points), memory=False).seconds for _ in range(repeats)
    )
    sample = Sample(
        size=size, num_points=len(points), num_spans=num_spans, seconds=seconds,
        extra_bytes=extra_bytes,
    )
    print(f'{sample.num_points} points: {sample.seconds:.2f} s, '
          f'{sample.extra_bytes / 1e9:.2f} GB, {sample.num_spans} spans', file=sys.stderr,
          flush=True)
    return sample


def measure_power(samples: Sequence[Sample], name: str) -> float:
    """Return the exponent of growth of one figure with size, NaN for fewer than two samples."""
    chosen = [item for item in samples if item.num_points >= FROM_POINTS]
    chosen = chosen if len(chosen) > 1 else list(samples)
    if len(chosen) < 2:
        return float('nan')
    values = [max(getattr(item, name), 1.0 if name == 'extra_bytes' else 1e-6) for item in chosen]
    return float(np.polyfit(np.log([item.size for item in chosen]), np.log(values), 1)[0])


def render(title: str, unit: str, samples: Sequence[Sample]) -> str:
    """Return the table of one experiment."""
    return render_table((title, 'points', 'spans', 'time [s]', 'us/point', 'extra memory [GB]'), [
        (f'{item.size:,.{0 if unit == "points" else 2}f} {unit}', f'{item.num_points:,}',
         f'{item.num_spans}', f'{item.seconds:.3f}', f'{1e6 * item.seconds / item.num_points:.3f}',
         f'{item.extra_bytes / 1e9:.2f}')
        for item in samples
    ])


def check_growth(title: str, samples: Sequence[Sample]) -> list[Check]:
    """Return the checks of the exponents of one experiment."""
    return [
        at_most(title, f'power of {what}', measure_power(samples, name), MOST_POWER)
        for what, name in (('time', 'seconds'), ('memory', 'extra_bytes'))
    ]


def render_flight(parts: Sequence[Part]) -> str:
    """Return the table of the flight."""
    columns = ('flown', 'ticks', 'tick, median [ms]', 'tick, p95 [ms]',
               'points of a window, median', 'voxels in the map', 'spans known')
    return render_table(columns, [
        (f'to {end / 1000.0:.1f} km', f'{len(ticks)}',
         *(f'{1e3 * np.percentile([tick.seconds for tick in ticks], share):.0f}'
           for share in (50, 95)),
         f'{np.median([tick.num_points for tick in ticks]):,.0f}', f'{ticks[-1].num_voxels:,}',
         f'{ticks[-1].num_spans}')
        for end, ticks in parts
    ])


def check_flight(flight: Flight) -> Check:
    """Return the check that ticks are no slower for what was flown before."""
    late = [
        tick.seconds for _, ticks in flight.parts for tick in ticks
        if tick.flown >= flight.middle
    ]
    early = [tick.seconds for tick in flight.other]
    slower = float(np.median(late) / np.median(early)) if early else float('nan')
    return at_most(
        'flight', 'median tick, second half in a flight that begins there', slower, MOST_SLOWER
    )


def draw(
    path: Path, density: Sequence[Sample], length: Sequence[Sample], flight: Flight
) -> None:
    """Draw all experiments, time above and memory below."""
    figure, axes = pyplot.subplots(2, 3, figsize=(13.0, 6.0), layout='constrained', sharex='col')
    columns = ((density, 'points in one corridor'), (length, 'length of the corridor [km]'))
    rows = (('seconds', 1.0, 'time [s]'), ('extra_bytes', 1e-9, 'extra memory [GB]'))
    for column, (samples, what) in enumerate(columns):
        size = np.array([item.size for item in samples])
        for row, (name, unit, title) in enumerate(rows):
            axis = axes[row, column]
            value = unit * np.array([getattr(item, name) for item in samples])
            axis.loglog(size, value, 'o-', color='#1f5fa8', label='measured')
            axis.loglog(size, value[-1] * size / size[-1], '--', color='#888888', label='linear')
            axis.set_ylabel(title)
            axis.grid(visible=True, which='major', alpha=0.3)
        axes[1, column].set_xlabel(what)
    axes[0, 0].legend(frameon=False)
    ticks = [tick for _, part in flight.parts for tick in part]
    flown = np.array([tick.flown for tick in ticks]) / 1000.0
    axes[0, 2].plot(flown, [1e3 * tick.seconds for tick in ticks], '.', color='#1f5fa8',
                    markersize=3)
    axes[0, 2].plot([(flight.middle + tick.flown) / 1000.0 for tick in flight.other],
                    [1e3 * tick.seconds for tick in flight.other], '.', color='#888888',
                    markersize=2, label='flight that begins here')
    for number, (_, part) in enumerate(flight.parts):
        middle = 1e3 * np.median([tick.seconds for tick in part])
        axes[0, 2].plot([part[0].flown / 1000.0, part[-1].flown / 1000.0], [middle, middle], '-',
                        color='#c0392b', label='' if number else 'median of a corridor')
    axes[0, 2].set_ylim(bottom=0.0)
    axes[0, 2].set_ylabel('tick [ms]')
    axes[0, 2].legend(frameon=False)
    axes[1, 2].plot(flown, [tick.num_voxels / 1e6 for tick in ticks], '-', color='#1f5fa8')
    axes[1, 2].set_ylabel('voxels in the map [million]')
    axes[1, 2].set_xlabel('flown [km]')
    for axis in axes[:, 2]:
        axis.grid(visible=True, which='major', alpha=0.3)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    pyplot.close(figure)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the bench."""
    parser = argparse.ArgumentParser(description='Growth of time and memory.')
    parser.add_argument('--most', type=int, default=NUM_POINTS[-1], help='points, a cap')
    parser.add_argument('--repeats', type=int, default=3)
    parser.add_argument('--cache', type=Path, metavar='DIR', help='keep simulated clouds here')
    parser.add_argument('--plot', type=Path, metavar='FILE', help='draw here')
    parser.add_argument('--write', action='store_true', help='into docs')
    arguments = parser.parse_args(argv)
    if arguments.most < NUM_POINTS[0] or arguments.repeats < 1:
        parser.error(f'--most must be {NUM_POINTS[0]} or more and --repeats 1 or more')
    keep_freed_memory()  # as plc_survey does
    rng = np.random.default_rng(0)
    with open_cache(arguments.cache) as cache:
        for points in grow_density(cache, NUM_POINTS[0], rng):
            Pipeline().run(points)  # compiles, or loads what is compiled
        density = [
            take(len(points), points, arguments.repeats)
            for points in grow_density(cache, arguments.most, rng)
        ]
        length = [
            take(size, points, arguments.repeats)
            for size, points in grow_length(cache, arguments.most)
        ]
        flight = fly(cache, arguments.most, rng)
    page = '\n\n'.join([
        f'Best of {arguments.repeats} runs.',
        render('density', 'points', density),
        render('length', 'km', length),
        render_flight(flight.parts),
        render_table(CHECK_COLUMNS[:5], [
            check.row()[:5]
            for check in (*check_growth('density', density), *check_growth('length', length),
                          check_flight(flight))
        ]),
    ])
    print(page)
    plot = arguments.plot or (ROOT / 'docs/images/scaling.png' if arguments.write else None)
    if plot is not None:
        draw(plot, density, length, flight)
    if arguments.write:
        replace_section(ROOT / 'docs/performance.md', 'scaling', page)
    return 0


if __name__ == '__main__':
    sys.exit(main())
