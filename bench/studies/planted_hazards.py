# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Hazards planted into random scenes: found, missed, raised on the safe side, and their intervals.

Trees, bushes, buildings, low spans and crossing lines are put into the scenes of
``plc_simulate random``, nearer or farther than their limits by chance, half of them close to it.
Truth is the least distance between what the survey saw of a thing, where it met it exactly, and
the surface of the true conductor.  "Due" lies beyond two standard deviations of its limit with as
many points as a hazard needs, "safe" keeps it by as much.  Each hazard is judged, planted or not:
by the class and the exact place of the point that it rests on.
"""

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
import math
from pathlib import Path
import sys

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from common.planted_scenes import (
    find_own,
    Item,
    LIMITS,
    make_planted,
    measure_surfaces,
    PlantedScene,
)
from common.tables import render_table, replace_section

from plc_inspect.config import Settings
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.errors import PlcInspectError
from plc_inspect.results import Hazard, HazardKind, InspectionResult
from plc_inspect.setting_names import update
from plc_inspect.sim.random_scenes.returns import UNJUDGED
from plc_inspect.sim.scenes.scene import Label, Scene

Float64 = NDArray[np.float64]

PAGE = Path(__file__).parents[2] / 'docs/hazards.md'
SETTINGS = update(Settings(), {'hazards.fall_distance': 2.0})
USUAL_SIGMA = {
    HazardKind.VEGETATION: 0.05, HazardKind.STRUCTURE: 0.05, HazardKind.GROUND: 0.07,
    HazardKind.CROSSING: 0.05, HazardKind.FALL_IN: 0.2,
}
"""Standard deviation of what was not raised [m]; at least the scatter of its conductor."""
INTERVAL = 1.96
"""Half of a 95 % interval [standard deviations]."""
REACH = 60.0
"""Farther from all conductors nothing is looked at [m]."""
SAME = 1.0
"""A true conductor is found where a found one runs this near [m]; bundles are found as one."""
BOX = 0.5
"""A hazard is about a thing whose nearest point lies this near to its box [m]."""
NUM_ABOUT = 8
"""Points about a place by which the error of the odometry there is told."""
GROUND_SEEN = 2.0
"""Where no ground was seen this near in plan, none is due to be told of [m]."""
CROSSING_NEAR = 12.0
"""A crossing is the one that was planted where it lies this near to it in plan [m]."""
NUM_WORST = 10
MIXED = 'on a mixed return'
"""A return between two objects; its hazard is true where the object behind it is too near."""
ON_OBJECTS = (HazardKind.VEGETATION, HazardKind.STRUCTURE, HazardKind.FALL_IN)


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What became of one planted thing."""

    seed: int
    kind: HazardKind
    name: str
    strands: int
    """Conductors of the phase that it is nearest to."""
    margin: float
    """Truth less the limit [m]."""
    sigma: float
    """Stated, or what would be [m]."""
    enough: bool
    """It has as many points beyond the limit as a hazard needs."""
    known: bool
    """Its conductors were found."""
    raised: bool
    error: float
    """Measured less true clearance [m], NaN where it was not raised."""

    @property
    def due(self) -> bool:
        """Whether it has to be raised."""
        return self.margin < -2.0 * self.sigma and self.enough

    @property
    def safe(self) -> bool:
        """Whether it must not be raised."""
        return self.margin > 2.0 * self.sigma

    @property
    def missed(self) -> bool:
        """Whether it should have been raised and was not."""
        return self.due and not self.raised

    @property
    def safe_raised(self) -> bool:
        """Whether it was raised and must not be; a hazard may rest on its neighbour."""
        return self.safe and not math.isnan(self.error)

    @property
    def scaled(self) -> float:
        """Error in standard deviations."""
        return self.error / self.sigma


@dataclass(slots=True, kw_only=True)
class Judged:
    """One scene."""

    seed: int
    text: str
    items: list[Outcome] = field(default_factory=list)
    false: list[str] = field(default_factory=list)
    """Hazards that rest on no object, or on one that keeps its limit, each with why."""
    num_hazards: int = 0

    @property
    def num_faults(self) -> int:
        """Things missed where their conductor was found, and hazards that are none."""
        return sum(item.missed and item.known for item in self.items) + len(self.false)


def judge(seed: int, planted: PlantedScene, result: InspectionResult) -> Judged:
    """Compare the hazards of a scene with its truth."""
    cloud, scene = planted.made.cloud, planted.made.scene
    judged = Judged(seed=seed, text=planted.made.text, num_hazards=len(result.hazards))
    _, rests = index_points(planted).query(
        np.array([item.position for item in result.hazards]).reshape(-1, 3)
    )
    for item in planted.items:
        outcome = judge_item(seed, item, planted, result, rests)
        if outcome is not None:
            judged.items.append(outcome)
    objects = [(hazard, k) for hazard, k in zip(result.hazards, rests.tolist(), strict=True)
               if hazard.kind in ON_OBJECTS]
    away, _ = measure_surfaces(cloud.exact[[k for _, k in objects]], scene, REACH)
    for (hazard, k), distance in zip(objects, away.tolist(), strict=True):
        why = find_fault(hazard, int(cloud.label[k]), distance)
        if why == MIXED and is_of_object(hazard, planted):
            why = ''
        if why and is_false_conductor(hazard, planted, result):
            why = f'by a conductor that is none, {why}'
        if why:
            judged.false.append(
                f'{why}: {hazard.kind.name.lower()} {hazard.clearance:.2f} m, sigma'
                f' {hazard.sigma:.3f} m, truth {distance:.2f} m,'
                f' confidence {hazard.confidence:.2f}'
                f' at {hazard.position.round(1).tolist()}'
            )
    return judged


def find_fault(hazard: Hazard, label: int, distance: float) -> str:
    """Return why a hazard that rests on a point of a class, truly so far away, is none, or ''."""
    if label in (Label.WIRE, Label.TOWER):
        return 'on the line'
    if label == Label.GROUND:
        return 'on the ground'
    if label == UNJUDGED:
        return MIXED
    beyond = hazard.kind != HazardKind.FALL_IN and distance > (
        LIMITS[hazard.kind] + 2.0 * hazard.sigma)
    return 'beyond the limit' if beyond else ''


def is_of_object(hazard: Hazard, planted: PlantedScene) -> bool:
    """Return whether what a hazard encloses is truly too near, whatever point it rests on."""
    cloud, scene = planted.made.cloud, planted.made.scene
    low, high = hazard.extent
    own = cloud.exact[
        ((cloud.points >= low) & (cloud.points <= high)).all(axis=1)
        & ~np.isin(cloud.label, (Label.GROUND, Label.WIRE, Label.TOWER, UNJUDGED))
    ]
    if not len(own):
        return False
    limit = LIMITS[hazard.kind] + 2.0 * hazard.sigma
    if hazard.kind != HazardKind.FALL_IN:
        return float(measure_surfaces(own, scene, REACH)[0].min()) <= limit
    top = own[np.argmax(own[:, 2])]
    foot = np.array([[*top[:2], scene.terrain.height(*top[:2].tolist())]])
    away, _ = measure_surfaces(foot, scene, REACH)
    return float(away[0]) - float(top[2] - foot[0, 2]) <= limit


@lru_cache(maxsize=1)
def index_points(planted: PlantedScene) -> cKDTree:
    """Return the points of a scene, for searches."""
    return cKDTree(planted.made.cloud.points)


def find_true_places(places: Float64, planted: PlantedScene) -> Float64:
    """Return where places (P, 3) of the map truly are, by the points about them [m]."""
    cloud = planted.made.cloud
    _, near = index_points(planted).query(places, NUM_ABOUT)
    moved: Float64 = places + (cloud.exact - cloud.points)[near].mean(axis=1)
    return moved


def is_false_conductor(
    hazard: Hazard, planted: PlantedScene, result: InspectionResult
) -> bool:
    """Return whether no true conductor is where the one of a hazard was found."""
    key = hazard.line_id, hazard.span_id
    span = next(item for item in result.spans if (item.line_id, item.span_id) == key)
    place = find_true_places(span.positions(np.array([hazard.along_span])), planted)
    away, _ = measure_surfaces(place, planted.made.scene, REACH)
    return float(away[0]) > SAME


def judge_item(
    seed: int, item: Item, planted: PlantedScene, result: InspectionResult,
    rests: NDArray[np.int64],
) -> Outcome | None:
    """Return what became of a thing, None where nothing was seen of it."""
    scene, own = planted.made.scene, find_own(item, planted.made.cloud)
    if item.kind in ON_OBJECTS:
        if len(own) < SETTINGS.hazards.min_points:
            return None
        exact = planted.made.cloud.exact[own]
        values, numbers, first = measure_object(item, exact, scene)
        at, in_map = exact[first], planted.made.cloud.points[own[first]]
        mine = [hazard for hazard in result.hazards
                if hazard.kind in ON_OBJECTS and is_inside(in_map, hazard)
                and (hazard.kind == HazardKind.FALL_IN) == (item.kind == HazardKind.FALL_IN)]
        exactly = [hazard for hazard, k in zip(result.hazards, rests, strict=True)
                   if any(hazard is other for other in mine) and k in own]
        exactly.sort(key=lambda hazard: hazard.clearance)  # one thing may be parted
        if item.kind == HazardKind.FALL_IN:  # what is one as it stands is not told twice
            mine += [hazard for hazard, k in zip(result.hazards, rests, strict=True)
                     if hazard.kind == HazardKind.VEGETATION and k in own]
    else:
        found = measure_wires(item, planted)
        if found is None:
            return None
        values, numbers, at = found
        mine = exactly = [
            hazard for hazard in result.hazards if hazard.kind == item.kind
            and (math.dist(hazard.position[:2], at[:2]) < CROSSING_NEAR
                 if item.kind == HazardKind.CROSSING else hangs_on(hazard, item, planted))
        ][:1]
    if not numbers:
        return None
    known = [find_rmse(planted, number, at, result) for number in numbers]
    usual = max(USUAL_SIGMA[item.kind], *(0.0 if math.isnan(rmse) else rmse for rmse in known))
    nearest = scene.conductors[numbers[0]]
    limit = LIMITS[item.kind]
    return Outcome(
        seed=seed, kind=item.kind, name=item.name, margin=float(values[0]) - limit,
        strands=sum(other.bundle_id == nearest.bundle_id >= 0 and other.span_id == nearest.span_id
                    for other in scene.conductors) or 1,
        sigma=exactly[0].sigma if exactly else usual,
        enough=item.kind not in ON_OBJECTS or item.kind == HazardKind.FALL_IN or bool(
            values[SETTINGS.hazards.min_points - 1] < limit - 2.0 * usual),
        known=not any(map(math.isnan, known)), raised=bool(mine),
        error=exactly[0].clearance - float(values[0]) if exactly else math.nan,
    )


def hangs_on(hazard: Hazard, item: Item, planted: PlantedScene) -> bool:
    """Return whether the conductor that a hazard of the ground is below is one of a thing."""
    place = hazard.position + np.array([0.0, 0.0, hazard.clearance])
    place = find_true_places(place[None], planted)
    return any(
        measure_distances_of(place, planted.made.scene, number)[0] < SAME
        for number in item.conductors
    )


def measure_object(
    item: Item, exact: Float64, scene: Scene
) -> tuple[Float64, list[int], int]:
    """Return ascending values [m] of an object's points, the nearest conductor, at which point."""
    if item.kind == HazardKind.FALL_IN:
        first = int(np.argmax(exact[:, 2]))
        at = exact[first]
        foot = np.array([[*at[:2], scene.terrain.height(*at[:2].tolist())]])
        reach, which = measure_surfaces(foot, scene, REACH)
        return reach - (at[2] - foot[0, 2]), which[which >= 0].tolist(), first
    away, which = measure_surfaces(exact, scene, REACH)
    order = np.argsort(away)
    first = int(order[0])
    return away[order], [int(which[first])] if which[first] >= 0 else [], first


def measure_wires(
    item: Item, planted: PlantedScene
) -> tuple[Float64, list[int], Float64] | None:
    """Return the least clearance [m] of hung conductors, which, and where, if it was surveyed."""
    scene = planted.made.scene
    best: tuple[float, list[int], Float64] | None = None
    for number in item.conductors:
        own = scene.conductors[number]
        at = own.sample(0.1)
        inside = scene.covers(at[:, :2])
        if item.kind == HazardKind.GROUND:
            inside &= find_seen(number, at, planted) & find_seen_ground(at, planted)
        at = at[inside]
        if not len(at):
            continue
        if item.kind == HazardKind.GROUND:
            away, others = at[:, 2] - scene.terrain.heights(at[:, :2]), np.full(len(at), -1)
        else:
            rest = [k for k in range(len(scene.conductors)) if k not in item.conductors
                    and scene.conductors[k].span_id != own.span_id]
            table = np.array([measure_distances_of(at, scene, k) for k in rest])
            away, others = table.min(axis=0), np.array(rest)[table.argmin(axis=0)]
        k = int(np.argmin(away))
        value = float(away[k]) - own.radius
        if best is None or value < best[0]:
            best = value, [number, *([int(others[k])] if others[k] >= 0 else [])], at[k]
    return None if best is None else (np.array([best[0]]), best[1], best[2])


def measure_distances_of(points: Float64, scene: Scene, number: int) -> Float64:
    """Return the distances (N,) [m] of points to the surface of one conductor."""
    from plc_inspect.sim.scenes.conductors import measure_distances
    item = scene.conductors[number]
    return measure_distances(points, item) - item.radius


def find_seen(number: int, at: Float64, planted: PlantedScene) -> NDArray[np.bool_]:
    """Return which places of a conductor lie within 2 m of points of it."""
    own = planted.made.cloud.exact[planted.made.cloud.conductor == number]
    if not len(own):
        return np.zeros(len(at), dtype=bool)
    away, _ = cKDTree(own).query(at)
    return np.asarray(away < 2.0)


def find_seen_ground(at: Float64, planted: PlantedScene) -> NDArray[np.bool_]:
    """Return which places lie within GROUND_SEEN in plan of points of the ground."""
    own = planted.made.cloud.exact[planted.made.cloud.label == Label.GROUND, :2]
    if not len(own):
        return np.zeros(len(at), dtype=bool)
    away, _ = cKDTree(own).query(at[:, :2])
    return np.asarray(away < GROUND_SEEN)


def is_inside(at: Float64, hazard: Hazard) -> bool:
    """Return whether a place lies in the box of a hazard."""
    low, high = hazard.extent
    return bool((at >= low - BOX).all() and (at <= high + BOX).all())


def find_rmse(
    planted: PlantedScene, number: int, at: Float64, result: InspectionResult
) -> float:
    """Return the scatter [m] of the found conductor that is a true one near a place, or NaN."""
    curve = planted.made.scene.conductors[number].sample(0.25)
    place = curve[np.argmin(np.linalg.norm(curve - at, axis=1))]
    best = (SAME, math.nan)
    for span in result.spans:
        points = span.positions(np.linspace(0.0, span.length, max(2, int(span.length / 0.5))))
        points = find_true_places(points, planted)
        best = min(best, (float(np.linalg.norm(points - place, axis=1).min()), span.rmse))
    return best[1]


def render_items(items: Sequence[Outcome], key: str) -> str:
    """Return a table of things by kind or by strands."""
    rows = []
    for value in sorted({getattr(item, key) for item in items}):
        own = [item for item in items if getattr(item, key) == value]
        scaled = np.array([item.scaled for item in own if not math.isnan(item.error)])
        errors = np.array([item.error for item in own if not math.isnan(item.error)])
        due = [item for item in own if item.due]
        rows.append((
            value.name.lower() if isinstance(value, HazardKind) else str(value), str(len(due)),
            str(sum(item.raised for item in due)),
            str(sum(item.missed and not item.known for item in due)),
            str(sum(item.safe for item in own)),
            str(sum(item.safe_raised for item in own)),
            f'{(np.abs(scaled) <= INTERVAL).sum()} of {len(scaled)}'
            f' ({(np.abs(scaled) <= INTERVAL).mean():.1%})' if len(scaled) else '-',
            f'{np.median(errors):+.3f}' if len(errors) else '-',
            f'{np.median(scaled):+.2f}' if len(scaled) else '-',
            f'{np.std(scaled):.2f}' if len(scaled) else '-',
        ))
    return render_table(
        (key, 'due', 'found', 'missed, no conductor found', 'safe', 'raised all the same',
         'truth in the 95 % interval', 'median error [m]', 'median [sigma]', 'spread [sigma]'),
        rows,
    )


def list_faults(judged: Judged) -> list[str]:
    """Return in words what is wrong with a scene."""
    lines = [
        f'{"missed" if item.missed else "raised"}: {item.name} ({item.kind.name.lower()}), margin'
        f' {item.margin:+.3f} m, sigma {item.sigma:.3f} m, {item.strands} conductors'
        + ('' if item.known else ', conductor not found')
        for item in judged.items if item.missed or item.safe_raised
    ]
    lines += [
        f'outside: {item.name} ({item.kind.name.lower()}), error {item.error:+.3f} m, sigma'
        f' {item.sigma:.3f} m, {item.strands} conductors'
        for item in judged.items if abs(item.scaled) > INTERVAL
    ]
    return lines + judged.false


def run(seeds: Iterable[int], most: int, bundles: bool) -> list[Judged]:
    """Plant, survey and judge the scenes of some seeds, until there are enough."""
    result: list[Judged] = []
    for seed in seeds:
        if len(result) >= most:
            break
        try:
            planted = make_planted(seed, bundles)
            if planted is None:
                continue
            found = Pipeline(SETTINGS).run(planted.made.cloud.points)
        except PlcInspectError as error:
            print(f'seed {seed}: {error}', flush=True)
            continue
        judged = judge(seed, planted, found)
        result.append(judged)
        print(f'seed {seed}: {judged.text}: {len(judged.items)} things,'
              f' {judged.num_hazards} hazards, {judged.num_faults} faults', flush=True)
        for line in list_faults(judged):
            print(f'  {line}', flush=True)
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Run the seeds and print the tables; exit 1 where anything was missed or raised falsely."""
    parser = argparse.ArgumentParser(description='Hazards planted into random scenes.')
    parser.add_argument('--seed', type=int, default=100, help='the first')
    parser.add_argument('--scenes', type=int, default=50, metavar='N')
    parser.add_argument('--bundles', action='store_true', help='only scenes with bundles')
    parser.add_argument('--write', action='store_true', help='the tables into docs/hazards.md')
    arguments = parser.parse_args(argv)
    scenes = run(range(arguments.seed, arguments.seed + 20 * arguments.scenes),
                 arguments.scenes, arguments.bundles)
    items = [item for scene in scenes for item in scene.items]
    false = [line for scene in scenes for line in scene.false]
    whys = sorted({line.partition(':')[0] for line in false})
    worst = sorted((scene for scene in scenes if list_faults(scene)),
                   key=lambda scene: (-scene.num_faults, -len(list_faults(scene))))[:NUM_WORST]
    text = '\n\n'.join([
        f'{len(scenes)} random scenes from seed {arguments.seed} on, {len(items)} things planted,'
        f' {sum(scene.num_hazards for scene in scenes)} hazards raised.',
        render_items(items, 'kind'), render_items(items, 'strands'),
        'Hazards that are none: ' + (', '.join(
            f'{sum(line.startswith(why) for line in false)} {why}' for why in whys) or 'none')
        + '.',
        'The worst:\n\n' + render_table(('seed', 'scene', 'faults', 'what'), [
            (str(scene.seed), scene.text, str(scene.num_faults), '; '.join(list_faults(scene)[:4]))
            for scene in worst
        ]),
    ])
    print(f'\n{text}')
    if arguments.write:
        replace_section(PAGE, 'bench planted', text)
    return int(bool(false) or any(
        (item.missed and item.known) or item.safe_raised for item in items))


if __name__ == '__main__':
    sys.exit(main())
