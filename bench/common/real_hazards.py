# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Hazards in real clouds held against the classes of their points, in many frames.

Into two tiles trees and cranes were pasted; what was pasted nearer to a wire than the limit has to
be raised once, and nothing where none was pasted or in the tiles without them.  In all clouds no
hazard may rest on a point of a wire or tower, or lie beyond its limit, and its clearance is held
against the nearest point of a wire.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
import math
from pathlib import Path

from common.tables import at_most, Check, format_figure, render_table
from frames import move, read
import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from plc_inspect.core.pipeline import Pipeline
from plc_inspect.results import Hazard, HazardKind, PointClass

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
UInt8 = NDArray[np.uint8]

PASTED = ('ahn_12AN2_20_pasted_trees', 'ahn_12BZ1_21_pasted_trees')
FLOWN = ('uav_costarica_mv', 'uav_jujuy_street_trees')
CLEAN = ('ahn_12AN2_20', 'ahn_12BZ1_21')
"""The tiles before anything was pasted."""
CLOUDS = (*PASTED, *CLEAN, *FLOWN)
PASTED_CLASSES = (5, 26)
"""ASPRS classes of pasted trees and cranes."""
LINK = 2.0
"""Pasted points this near to each other are of one object [m]."""
LEAST_OBJECT = 100
"""Points of a pasted object at least; less is a scrap of one."""
TOLERANCE = 0.3
"""How near to its limit an object may be raised or not [m]."""
SAME_TREE = 4.0
"""Hazards of one object this near to each other in plan are one raised twice [m]."""
NEAR = 0.5
"""A hazard is about a pasted object that has a point this near to its position [m]."""
MEDIAN_ERROR, WIDE_ERROR = 0.1, 0.3
"""Greatest median and 95 % error of a clearance [m]."""
_BESIDE = (HazardKind.VEGETATION, HazardKind.STRUCTURE)


@dataclass(slots=True, kw_only=True)
class Figures:
    """What the hazards of one frame of one cloud are worth."""

    num_hazards: int
    on_wire: int
    """Hazards that rest on a point of a wire or tower."""
    beyond: int
    """Hazards farther from any wire than their limit allows."""
    missed: int
    """Pasted objects too near to a wire without a hazard."""
    twice: int
    """Hazards beyond the first of one tree."""
    due: int
    """Pasted objects too near to a wire."""
    for_nothing: int
    """Hazards of any kind away from all that was pasted; 0 where nothing was."""
    errors: list[float] = field(default_factory=list)
    """Clearance less the distance to the nearest point of a wire [m]; none without objects."""
    sigmas: list[float] = field(default_factory=list)
    """Stated standard deviations of those [m]."""
    faults: list[str] = field(default_factory=list)


def run_clouds(
    folder: Path, names: Sequence[str], frames: int, seed: int, verbose: bool = False
) -> tuple[str, list[Check]]:
    """
    Run the clouds as they are and in frames.

    Returns
    -------
    table : str
        A row for each cloud, of its worst frame.
    checks : list of Check

    """
    rows, checks = [], []
    for name in names:
        figures = []
        for number, item in enumerate(run_frames(folder / f'{name}.laz', frames, seed)):
            figures.append(item)
            for line in item.faults if verbose else ():
                print(f'{name}, frame {number}: {line}', flush=True)
        rows.append(describe(name, figures))
        checks += check(name, figures)
    return render_table(COLUMNS, rows), checks


def run_frames(path: Path, frames: int, seed: int) -> Iterator[Figures]:
    """Yield the figures of a cloud as it is, then turned and moved at random."""
    cloud = read(path)
    objects = list_objects(cloud.points, cloud.label)
    rng = np.random.default_rng([seed, *path.stem.encode()])
    pipeline = Pipeline()
    for number in range(frames + 1):
        points = move(cloud.points, rng) if number else cloud.points
        yield judge(points, cloud.label, objects, pipeline.run(points).hazards)


def judge(
    points: Float64, label: UInt8, objects: Sequence[Int64], hazards: Sequence[Hazard]
) -> Figures:
    """
    Hold hazards against the classes of points.

    Parameters
    ----------
    points : (N, 3) float64
        Positions [m].
    label : (N,) uint8
        ASPRS classes.
    objects : sequence of (K,) int64
        Points of each thing that was pasted.
    hazards : sequence of Hazard
        Raised in these points.

    Returns
    -------
    Figures

    """
    wire = cKDTree(points[label == PointClass.WIRE])
    everything = cKDTree(points)
    result = Figures(
        num_hazards=len(hazards), on_wire=0, beyond=0, missed=0, twice=0, due=0, for_nothing=0,
    )
    good = []
    for hazard in find_for_nothing(points[np.isin(label, PASTED_CLASSES)], hazards):
        result.for_nothing += 1
        result.faults.append(f'for nothing: {describe_hazard(hazard)}')
    for hazard in hazards:
        if hazard.kind not in (*_BESIDE, HazardKind.FALL_IN):
            continue
        _, own = everything.query(hazard.position)
        text = describe_hazard(hazard)
        if label[own] in (PointClass.WIRE, PointClass.TOWER):
            result.on_wire += 1
            result.faults.append(f'on class {label[own]}: {text}')
            continue
        good.append(hazard)
        if hazard.kind in _BESIDE and objects:  # elsewhere not all wires are labelled
            true = float(wire.query(hazard.position)[0])
            result.errors.append(hazard.clearance - true)
            result.sigmas.append(hazard.sigma)
            if true > hazard.required + TOLERANCE:
                result.beyond += 1
                result.faults.append(f'beyond, truly {true:.2f} m: {text}')
            elif abs(hazard.clearance - true) > WIDE_ERROR:
                result.faults.append(f'truly {true:.2f} m: {text}')
    limit = Pipeline().rules.reach('vegetation', 'building')
    for own_points in (points[own] for own in objects):
        distance = float(wire.query(own_points)[0].min())
        if distance > limit - TOLERANCE:
            continue
        result.due += 1
        tree = cKDTree(own_points)
        mine = [item.position for item in good if tree.query(item.position)[0] <= NEAR]
        if not mine:
            result.missed += 1
            middle = own_points.mean(axis=0).round(1).tolist()
            result.faults.append(
                f'missed: {len(own_points)} points at {middle}, {distance:.2f} m away'
            )
        apart = [
            min((math.dist(one[:2], other[:2]) for other in mine[:k]), default=math.inf)
            for k, one in enumerate(mine)
        ]
        result.twice += sum(value < SAME_TREE for value in apart)
    return result


def find_for_nothing(pasted: Float64, hazards: Sequence[Hazard]) -> list[Hazard]:
    """Return the hazards farther than NEAR from all (K, 3) pasted points; none without such."""
    if not len(pasted) or not hazards:
        return []
    apart, _ = cKDTree(pasted).query(np.array([item.position for item in hazards]))
    return [item for item, gap in zip(hazards, apart, strict=True) if gap > NEAR]


def describe_hazard(hazard: Hazard) -> str:
    """Return a hazard in words."""
    return (
        f'{hazard.kind.name.lower()} {hazard.severity.name.lower()} {hazard.clearance:.2f} m'
        f' of line {hazard.line_id} span {hazard.span_id} at'
        f' {hazard.position.round(1).tolist()}, {hazard.num_points} points'
    )


def list_objects(points: Float64, label: UInt8) -> list[Int64]:
    """Return which points each pasted object has."""
    result: list[Int64] = []
    for kind in PASTED_CLASSES:
        own = np.flatnonzero(label == kind)
        if not len(own):
            continue
        tree = cKDTree(points[own])
        near = tree.sparse_distance_matrix(tree, LINK, output_type='coo_matrix')
        num, group = connected_components(near)
        parts = (own[group == number] for number in range(num))
        result += [part for part in parts if len(part) >= LEAST_OBJECT]
    return result


COLUMNS = ('cloud', 'frames', 'hazards', 'on wire or tower', 'objects due', 'missed', 'twice',
           'for nothing', 'beyond the limit', 'median error [m]', '95 % [m]', 'within 2 sigma')


def describe(name: str, figures: Sequence[Figures]) -> tuple[str, ...]:
    """Return the row of one cloud: the range over the frames, or the worst."""
    hazards = [item.num_hazards for item in figures]
    inside = [share_inside(item) for item in figures if item.errors]
    return (
        name, str(len(figures)), f'{min(hazards)} to {max(hazards)}',
        str(max(item.on_wire for item in figures)), str(max(item.due for item in figures)),
        str(max(item.missed for item in figures)), str(max(item.twice for item in figures)),
        str(max(item.for_nothing for item in figures)),
        str(max(item.beyond for item in figures)),
        format_figure(measure_worst(figures, 50.0)), format_figure(measure_worst(figures, 95.0)),
        f'{min(inside):.0%}' if inside else '-',
    )


def share_inside(item: Figures) -> float:
    """Return the share of errors within two standard deviations."""
    return float(np.mean(np.abs(item.errors) <= 2.0 * np.array(item.sigmas)))


def measure_worst(figures: Sequence[Figures], percent: float) -> float:
    """Return the worst median error of a frame, or percentile of its absolute errors [m]."""
    values = [
        float(np.median(item.errors)) if percent == 50.0
        else float(np.percentile(np.abs(item.errors), percent))
        for item in figures if item.errors
    ]
    return max(values, key=abs, default=math.nan)


def check(name: str, figures: Sequence[Figures]) -> list[Check]:
    """Return what must hold of one cloud in its worst frame."""
    where = f'worst of {len(figures)} frames'
    result = [at_most(name, 'hazards on wire or tower',
                      float(max(item.on_wire for item in figures)), 0.0, remark=where)]
    if name in CLEAN:
        most = max(item.num_hazards for item in figures)
        result.append(at_most(name, 'hazards', float(most), 0.0, remark=where))
    if name not in PASTED:
        return result
    for measure, title in (
        ('missed', 'objects missed'), ('twice', 'objects twice'), ('beyond', 'objects beyond'),
        ('for_nothing', 'hazards where nothing was pasted'),
    ):
        worst = max(getattr(item, measure) for item in figures)
        result.append(at_most(name, title, float(worst), 0.0, remark=where))
    result += [
        at_most(name, f'error of clearance, {title}', abs(measure_worst(figures, percent)),
                ceiling, 'm', where)
        for title, percent, ceiling in (
            ('median', 50.0, MEDIAN_ERROR), ('95 %', 95.0, WIDE_ERROR)
        )
    ]
    return result
