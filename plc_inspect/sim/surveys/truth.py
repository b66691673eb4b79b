# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Truth of a simulated survey: the objects, how they were seen, and the hazards."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from plc_inspect.config import HazardSettings
from plc_inspect.sim.scenes.conductors import Conductor, measure_distances
from plc_inspect.sim.scenes.placement import REACH
from plc_inspect.sim.scenes.scene import Label, Scene

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
UInt8 = NDArray[np.uint8]

AMBIGUOUS = 0.3
"""Distance beyond a limit up to which objects are listed, but need not be found [m]."""


NEAR = 12.0
"""Distance from conductors up to which returns of objects are kept [m]."""
LEAST_SEEN = 5
"""Least number of returns of a support that was seen."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sightings:
    """Returns of a survey, reduced to what the truth needs."""

    wire_x: tuple[Float64, ...]
    """x of the returns of each conductor of the scene [m]."""
    num_points: Int64
    """Number of returns of each conductor."""
    near: Float64
    """(M, 3) true positions of returns of vegetation and structures near conductors [m]."""
    near_label: UInt8
    """(M,) ASPRS classes."""
    post_points: Int64
    """Number of returns of each support of the scene."""


def collect_sightings(
    scene: Scene, exact: Float64, label: UInt8, conductor: NDArray[np.int32],
) -> Sightings:
    """
    Reduce the points of a survey to its sightings.

    Parameters
    ----------
    scene : Scene
        What is surveyed.
    exact : ndarray
        (N, 3) true positions of the returns [m].
    label : ndarray
        (N,) ASPRS classes.
    conductor : ndarray
        (N,) number of the conductor in the scene, -1 for other points.

    Returns
    -------
    Sightings

    """
    order = np.argsort(conductor, kind='stable')
    bounds = np.searchsorted(conductor[order], np.arange(len(scene.conductors) + 1))
    wire_x = []
    for number, item in enumerate(scene.conductors):
        points = exact[order[bounds[number]:bounds[number + 1]]]
        wire_x.append(measure_along(points, item))
    other = np.flatnonzero(np.isin(label, (Label.VEGETATION, Label.BUILDING, Label.OTHER)))
    other = other[_is_near(scene, exact[other])]
    return Sightings(
        wire_x=tuple(wire_x), num_points=np.diff(bounds).astype(np.int64),
        near=exact[other], near_label=label[other],
        post_points=count_post_points(scene, exact[label == Label.TOWER]),
    )


def count_post_points(scene: Scene, points: Float64) -> Int64:
    """Count the points (N, 3) of supports by the nearest one in plan, within REACH."""
    if not scene.posts or not len(points):
        return np.zeros(len(scene.posts), dtype=np.int64)
    feet = np.array([post.position[:2] for post in scene.posts])
    distance, nearest = cKDTree(feet).query(points[:, :2], distance_upper_bound=REACH)
    return np.bincount(nearest[np.isfinite(distance)], minlength=len(feet)).astype(np.int64)


def _is_near(scene: Scene, points: Float64) -> NDArray[np.bool_]:
    if not scene.conductors or not len(points):
        return np.zeros(len(points), dtype=bool)
    tree = cKDTree(np.vstack([item.sample(1.0) for item in scene.conductors]))
    distance, _ = tree.query(points, distance_upper_bound=NEAR)
    return np.isfinite(distance)


def measure_along(points: Float64, item: Conductor) -> Float64:
    """Return the distances (N,) along a conductor of points (N, 3), in plan from its start [m]."""
    along = (item.end - item.start)[:2] / item.length
    return np.asarray((points[:, :2] - item.start[:2]) @ along)


def measure_seen(x: Float64, length: float, bin_size: float) -> tuple[float, float, float]:
    """Return the share of bins with returns, and the first and last x seen [m]."""
    num = max(1, round(length / bin_size))
    inside = x[(x >= 0.0) & (x <= length)]
    if not len(inside):
        return 0.0, 0.0, 0.0
    cells = np.unique(np.minimum((inside / length * num).astype(np.int64), num - 1))
    return len(cells) / num, float(inside.min()), float(inside.max())


def make_truth(
    scene: Scene, sightings: Sightings, *, kind: str, frame_id: str, bin_size: float,
    noise: float, origin: Sequence[float] = (0.0, 0.0, 0.0),
) -> dict[str, Any]:
    """
    Return the content of ``truth.json``.

    Parameters
    ----------
    scene : Scene
        What is surveyed.
    sightings : Sightings
        From `collect_sightings`.
    kind : str
        'map' or 'flight'.
    frame_id : str
        Frame of all coordinates.
    bin_size : float
        Size of the bins by which the share of a span seen is counted [m].
    noise : float
        Standard deviation of the survey, which decides which hazards are too close to call [m].
    origin : sequence of float
        Added to all coordinates [m].

    Returns
    -------
    dict
        JSON-serialisable.

    """
    shift = np.asarray(origin, dtype=np.float64)
    tree = sightings.near_label == Label.VEGETATION
    vegetation, structure = sightings.near[tree], sightings.near[~tree]
    spans = []
    for number, item in enumerate(scene.conductors):
        seen, first, last = measure_seen(sightings.wire_x[number], item.length, bin_size)
        spans.append({
            **describe_conductor(item, shift), 'seen': seen, 'seen_from': first,
            'seen_to': last, 'num_points': int(sightings.num_points[number]),
            'min_vegetation_distance': _find_nearest(vegetation, item, (first, last)),
            'min_structure_distance': _find_nearest(structure, item, (first, last)),
        })
    return {
        'frame_id': frame_id, 'scene': scene.name, 'seed': scene.seed, 'kind': kind,
        'origin': shift.tolist(), 'noise': noise, 'bin_size': bin_size,
        'lines': _list_lines(scene), 'spans': spans,
        'supports': [
            {'position': (post.position + shift).tolist(), 'height': post.height,
             'kind': post.kind, 'lines': list(post.line_ids), 'seen': bool(count >= LEAST_SEEN),
             'num_points': int(count)}
            for post, count in zip(scene.posts, sightings.post_points, strict=True)
        ],
        'hazards': [*_list_near_hazards(scene, sightings, noise, shift),
                    *_list_ground_hazards(scene, noise, shift)],
        'planted': [
            {'line_id': item.line_id, 'span_id': item.span_id,
             'position': (item.position + shift).tolist(), 'hull_clearance': item.clearance}
            for item in scene.planted
        ],
    }


def _find_nearest(
    points: Float64, item: Conductor, seen: tuple[float, float],
) -> float | None:
    """Return the distance of the nearest point from the stretch seen [m], None if too short."""
    if not len(points) or seen[1] - seen[0] < 1.0:
        return None
    return float(measure_distances(points, item, stretch=seen).min())


def describe_conductor(item: Conductor, shift: Float64) -> dict[str, Any]:
    """Return a conductor with the keys of ``spans.json``, shifted by ``shift`` (3,) [m]."""
    return {
        'line_id': item.line_id, 'span_id': item.span_id, 'bundle_id': item.bundle_id,
        'start': (item.start + shift).tolist(), 'end': (item.end + shift).tolist(),
        'azimuth': item.azimuth, 'length': item.length, 'a': item.a + float(shift[2]),
        'b': item.b, 'c': item.c,
        'quadratic': [*item.quadratic[:2], item.quadratic[2] + float(shift[2])],
        'sag': item.sag, 'lowest': (item.lowest + shift).tolist(),
    }


def _list_lines(scene: Scene) -> list[dict[str, Any]]:
    lines: dict[int, dict[str, Any]] = {}
    for item in scene.conductors:
        row = lines.setdefault(item.line_id, {
            'line_id': item.line_id, 'bundle_id': item.bundle_id,
            'diameter': 2 * item.radius, 'spans': [],
        })
        row['spans'].append(item.span_id)
    return [lines[key] for key in sorted(lines)]


def _list_near_hazards(
    scene: Scene, sightings: Sightings, noise: float, shift: Float64,
) -> list[dict[str, Any]]:
    """List the vegetation and structures near conductors, grouped into hazards."""
    rules = HazardSettings()
    limit = rules.warning_distance
    if not scene.conductors:
        return []
    gaps = np.vstack([
        *(measure_distances(sightings.near, item) for item in scene.conductors),
    ])
    nearest = gaps.argmin(axis=0) if gaps.size else np.zeros(0, dtype=np.int64)
    distance = gaps.min(axis=0) if gaps.size else np.zeros(0)
    spans = np.array([item.span_id for item in scene.conductors])[nearest]
    tree = sightings.near_label == Label.VEGETATION
    hazards = []
    for kind, group in (('vegetation', tree), ('structure', ~tree)):
        for span_id in np.unique(spans):
            index = np.flatnonzero(group & (spans == span_id) & (distance < limit + AMBIGUOUS))
            for part in _group(sightings.near[index], rules.group_distance):
                chosen = index[part]
                worst = chosen[distance[chosen].argmin()]
                item = scene.conductors[nearest[worst]]
                clearance = float(distance[worst])
                num_points = int((distance[chosen] < limit).sum())
                points = sightings.near[chosen] + shift
                others = gaps[:, chosen].min(axis=1)
                hazards.append({
                    'kind': kind, 'line_id': item.line_id, 'span_id': item.span_id,
                    'position': (sightings.near[worst] + shift).tolist(),
                    'clearance': clearance, 'limit': limit,
                    'severity': 'critical' if clearance < rules.critical_distance else 'warning',
                    'required': bool(
                        kind == 'vegetation' and clearance < limit - 2 * noise
                        and num_points >= rules.min_points
                    ),
                    'num_points': num_points,
                    'extent': [points.min(axis=0).tolist(), points.max(axis=0).tolist()],
                    'conductors': [
                        {'line_id': other.line_id, 'span_id': other.span_id,
                         'clearance': float(others[number])}
                        for number, other in enumerate(scene.conductors)
                        if others[number] < limit + AMBIGUOUS
                    ],
                })
    return hazards


def _group(points: Float64, distance: float) -> list[Int64]:
    """Return the indices of each group of points connected within ``distance`` [m]."""
    if not len(points):
        return []
    cells, inverse = np.unique((points // 0.25).astype(np.int64), axis=0, return_inverse=True)
    inverse = inverse.ravel()
    pairs = cKDTree(cells * 0.25).query_pairs(distance, output_type='ndarray')
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(cells), len(cells)))
    count, group = connected_components(graph, directed=False)
    return [np.flatnonzero(group[inverse] == number) for number in range(count)]


def _list_ground_hazards(scene: Scene, noise: float, shift: Float64) -> list[dict[str, Any]]:
    """List the spans that hang too low above the ground, one hazard per span."""
    limit = HazardSettings().ground_distance
    lowest: dict[int, dict[str, Any]] = {}
    for item in scene.conductors:
        curve = item.sample(0.5)
        height = curve[:, 2] - scene.terrain.heights(curve[:, :2])
        at = int(height.argmin())
        clearance = float(height[at])
        known = lowest.get(item.span_id)
        if clearance >= limit + AMBIGUOUS or (known and known['clearance'] <= clearance):
            continue
        low = np.flatnonzero(height < limit + AMBIGUOUS)
        foot = curve - np.column_stack([np.zeros((len(curve), 2)), height])
        lowest[item.span_id] = {
            'kind': 'ground', 'line_id': item.line_id, 'span_id': item.span_id,
            'position': (foot[at] + shift).tolist(), 'clearance': clearance, 'limit': limit,
            'severity': 'critical', 'required': clearance < limit - AMBIGUOUS,
            'num_points': 0,
            'extent': [(foot[low].min(axis=0) + shift).tolist(),
                       (foot[low].max(axis=0) + shift).tolist()],
            'conductors': [{'line_id': item.line_id, 'span_id': item.span_id,
                            'clearance': clearance}],
        }
    return [lowest[key] for key in sorted(lowest)]
