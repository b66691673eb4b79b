# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Real clouds in many frames: what a rigid motion, thinning, noise or the edge of a cut changes.

Each cloud is turned about the vertical and moved at random, and as asked mirrored, thinned,
blurred and cut to a part of it; the worst frame and the spread are what count.  As a cloud has a
frame of its own, a rigid motion alone changes little; a mirror, or 2 mm of noise, shows what is
luck.  Labels are the classes in the file; class 0 is left out.  The worst loss is that of recall
against what is found of the same points in the cloud as it is.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product
import math
from pathlib import Path
import sys
import time

from common.tables import render_table
import laspy
import numpy as np
from numpy.typing import NDArray

from plc_inspect.config import Settings
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.results import InspectionResult, PointClass
from plc_inspect.setting_names import update

ROOT = Path(__file__).resolve().parents[1]
REAL = ROOT.parent / 'shared/data/real'
US_FOOT = 1200.0 / 3937.0
FARTHEST = 1000.0
"""Greatest shift of a frame along each axis [m]."""
BREADTH, OFF = 0.7, 1 / 3
"""Breadth of a cut, and how far a wire in it is off its middle at most, by its length."""
LEAST_POINTS, TRIES = 3000, 200
"""A cut is drawn again where it holds fewer points, so many times."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """What one frame of one cloud gave."""

    precision: float
    recall: float
    f1: float
    num_lines: int
    num_spans: int
    num_hazards: int
    num_unique: int
    """Different pairs of line and span; as many as spans where they are right."""
    loss: float
    """Recall of the cloud as it is, of the same points, less that of the frame."""
    seconds: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cloud:
    """A labelled cloud."""

    name: str
    points: NDArray[np.float64]
    """(N, 3) [m]"""
    label: NDArray[np.uint8]
    """(N,) ASPRS classes, 0 unknown."""

    @property
    def is_labelled(self) -> bool:
        """Whether its wires are known."""
        return bool((self.label == PointClass.WIRE).any())


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """What is done to a frame, besides its motion."""

    thin: float
    """Share of the points that is kept."""
    noise: float
    """Standard deviation that is added to each coordinate [m]."""
    cut: float
    """Length of the part that is kept, as a share of the cloud's."""


@dataclass(slots=True, kw_only=True)
class Frames:
    """All frames of one cloud."""

    name: str
    scores: list[Score] = field(default_factory=list)

    def values(self, name: str) -> NDArray[np.float64]:
        """Return one figure of all frames."""
        return np.array([getattr(score, name) for score in self.scores], dtype=np.float64)


def read(path: Path) -> Cloud:
    """Read a cloud and its classes; coordinates in metres."""
    las = laspy.read(path)
    scale = US_FOOT if 'us_feet' in path.stem else 1.0
    points = np.column_stack([las.x, las.y, las.z]).astype(np.float64) * scale
    return Cloud(name=path.stem, points=points, label=np.array(las.classification, np.uint8))


def move(points: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """Turn points about the vertical through their middle, and move them."""
    azimuth = rng.uniform(-math.pi, math.pi)
    cos, sin = math.cos(azimuth), math.sin(azimuth)
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return (points - points.mean(axis=0)) @ turn + rng.uniform(-FARTHEST, FARTHEST, 3)


def cut(cloud: Cloud, share: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Return which points lie in a rectangle somewhere, so long as a share of the cloud."""
    wire = np.flatnonzero(cloud.label == PointClass.WIRE)
    plan = cloud.points[:, :2]
    length = share * float(np.ptp(plan, axis=0).max())
    for _ in range(TRIES):
        middle = plan[rng.choice(wire) if len(wire) else rng.integers(len(plan))]
        azimuth = rng.uniform(0.0, math.pi)
        cos, sin = math.cos(azimuth), math.sin(azimuth)
        local = (plan - middle) @ np.array([[cos, -sin], [sin, cos]])
        local -= rng.uniform(-OFF, OFF, 2) * length * (1.0, BREADTH)
        inside: NDArray[np.bool_] = (np.abs(local) < 0.5 * length * np.array([1.0, BREADTH])).all(
            axis=1)
        if inside.sum() > min(LEAST_POINTS, 0.5 * len(plan)):
            break
    return inside


def measure_recall(cloud: Cloud, found: NDArray[np.bool_]) -> float:
    """Return the share of the wire that was found."""
    wire = cloud.label == PointClass.WIRE
    return int((wire & found).sum()) / max(int(wire.sum()), 1)


def score(
    cloud: Cloud, result: InspectionResult, seconds: float, whole: NDArray[np.bool_]
) -> Score:
    """Compare a result with the classes of its cloud, and what is found of it as a whole."""
    judged = cloud.label != 0
    wire, found = (cloud.label == PointClass.WIRE)[judged], (result.line_id >= 0)[judged]
    hits = int((wire & found).sum())
    recall = measure_recall(cloud, result.line_id >= 0)
    return Score(
        precision=hits / max(int(found.sum()), 1),
        recall=recall,
        f1=2 * hits / max(int(wire.sum() + found.sum()), 1),
        num_lines=result.num_lines,
        num_spans=len(result.spans),
        num_hazards=len(result.hazards),
        num_unique=len({(span.line_id, span.span_id) for span in result.spans}),
        loss=measure_recall(cloud, whole) - recall,
        seconds=seconds,
    )


def run(cloud: Cloud, settings: Settings, changes: Sequence[Change], num: int,
        rng: np.random.Generator, *, mirror: bool = False) -> Iterator[Score]:
    """
    Yield the score of the cloud as it is, and of frames of it, one change after another.

    With ``mirror`` every second frame is one of the mirrored cloud.
    """
    pipeline = Pipeline(settings)
    whole = np.empty(0, dtype=np.bool_)
    for number in range(num + 1):
        points, own, kept = cloud.points, cloud, np.ones(len(cloud.points), dtype=np.bool_)
        if number:
            change = changes[number % len(changes)]
            if change.cut < 1.0:
                kept = cut(cloud, change.cut, rng)
            if change.thin < 1.0:
                kept &= rng.random(len(points)) < change.thin
            own = Cloud(name=cloud.name, points=points[kept], label=cloud.label[kept])
            points = move(own.points, rng)
            if mirror and number % 2:
                points[:, 0] *= -1.0
            if change.noise:
                points = points + rng.normal(0.0, change.noise, points.shape)
        started = time.perf_counter()
        result = pipeline.run(points)
        seconds = time.perf_counter() - started
        whole = whole if number else result.line_id >= 0
        yield score(own, result, seconds, whole[kept])


def describe(frames: Frames, is_labelled: bool) -> tuple[str, ...]:
    """
    Return the row of one cloud: as it is, then worst, median and range over the frames.

    Where no wires are known, it tells how many spans are in how many of them.
    """
    first, moved = frames.scores[0], Frames(name=frames.name, scores=frames.scores[1:])
    if not moved.scores:
        moved = frames
    spans = moved.values('num_spans')
    row = [frames.name, f'{first.num_spans}', f'{spans.min():.0f} to {spans.max():.0f}']
    if not is_labelled:
        row[-1] += f', {spans.sum():.0f} in {(spans > 0).sum()} of {len(spans)}'
    doubled = sum(item.num_unique < item.num_spans for item in frames.scores)
    row.append(f'{doubled}' if doubled else '')
    if is_labelled:
        f1 = moved.values('f1')
        row += [
            f'{first.precision:.3f} {first.recall:.3f} {first.f1:.3f}',
            f'{moved.values("precision").min():.3f}', f'{moved.values("recall").min():.3f}',
            f'{f1.min():.3f}', f'{np.median(f1):.3f}', f'{f1.max() - f1.min():.3f}',
            f'{moved.values("loss").max():.3f}',
        ]
    else:
        row += [''] * 7
    row.append(f'{np.median(frames.values("seconds")):.2f}')
    return tuple(row)


COLUMNS = ('cloud', 'spans', 'in frames', 'doubled', 'P R F1', 'worst P', 'worst R', 'worst F1',
           'median', 'range', 'worst loss', '[s]')


def main(argv: Sequence[str] | None = None) -> int:
    """Run the clouds in frames and print a row for each."""
    parser = argparse.ArgumentParser(
        description='Clouds in random frames, thinned, blurred and cut; of several values of each '
        'option, one frame after another gets all of their combinations.')
    parser.add_argument('--real', type=Path, default=REAL, metavar='DIR')
    parser.add_argument('--frames', type=int, default=6, metavar='N')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--thin', type=float, nargs='+', default=[1.0], metavar='SHARE',
                        help='shares of the points that are kept')
    parser.add_argument('--noise', type=float, nargs='+', default=[0.0], metavar='M',
                        help='standard deviations that are added to each coordinate [m]')
    parser.add_argument('--cut', type=float, nargs='+', default=[1.0], metavar='SHARE',
                        help='lengths of the part that is kept, as shares of that of the cloud')
    parser.add_argument('--mirror', action='store_true', help='mirror every second frame')
    parser.add_argument('--only', nargs='*', default=[''], metavar='PART',
                        help='clouds with one of these in their names')
    parser.add_argument('--set', nargs='*', default=[], metavar='NAME=VALUE', dest='changes')
    arguments = parser.parse_args(argv)
    changes = dict(item.split('=', 1) for item in arguments.changes)
    settings = update(Settings(), {name: float(value) for name, value in changes.items()})
    combined = [Change(thin=thin, noise=noise, cut=length) for thin, noise, length in product(
        arguments.thin, arguments.noise, arguments.cut)]
    rows = []
    for path in sorted(arguments.real.glob('*.laz')):
        if not any(part in path.stem for part in arguments.only):
            continue
        cloud, frames = read(path), Frames(name=path.stem)
        rng = np.random.default_rng([arguments.seed, *path.stem.encode()])
        for item in run(
            cloud, settings, combined, arguments.frames, rng, mirror=arguments.mirror
        ):
            frames.scores.append(item)
        rows.append(describe(frames, cloud.is_labelled))
        print(' | '.join(rows[-1]), flush=True)
    print(render_table(COLUMNS, rows))
    return 0


if __name__ == '__main__':
    sys.exit(main())
