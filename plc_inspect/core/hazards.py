# Copyright 2026 plc_inspect contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Hazards: clearance rules, conductors too near each other, abnormal sag."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

from numba import njit, prange
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from plc_inspect.config import HazardSettings
from plc_inspect.core.curve import Curve
from plc_inspect.core.linearity import measure_likeness
from plc_inspect.core.voxels import build_voxels, find_slot, pack
from plc_inspect.results import Bool, Float64, Hazard, HazardKind, Int64, Severity, Span

POINT_SIGMA = 0.03
"""Standard deviation of one measured point, of the sensor's data sheet [m]."""
PLANAR = 0.45
"""Planar likeness from which a neighbourhood is a surface, not foliage."""
RULE = 'plain distances'
EDITION = 'plc_inspect 0.1'
SOURCE = 'settings of section hazards; no authority'


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpanModel:
    """A span with the curve behind it, in the orientation of its route."""

    span: Span
    curve: Curve
    start_x: float
    """x of the curve at the span's start [m]; greater than end_x where reversed."""
    end_x: float

    def along(self, x: Float64) -> Float64:
        """Return the distance from the start of the span at the curve's x [m]."""
        return np.abs(np.asarray(x) - self.start_x)


def find_hazards(
    points: Float64,
    near: Int64,
    distance: Float64,
    owner: Int64,
    models: Sequence[SpanModel],
    ground_below: Sequence[Float64],
    settings: HazardSettings,
) -> tuple[tuple[Hazard, ...], Bool]:
    """
    Find the places where a rule of the plain default set is broken.

    Parameters
    ----------
    points : (N, 3) float64 [m]
    near : (K,) indices of corridor points off the ground that are neither wire nor support
    distance : (K,) distance to the nearest span [m]
    owner : (K,) which of the models that is
    models : spans with their curves
    ground_below : for each model the (S, 2) stations: distance from its start and height of the
        conductor above ground [m]; empty where the ground is not known
    settings : HazardSettings

    Returns
    -------
    hazards : tuple of Hazard, numbered in order of span, line and place
    surface : (K,) bool, points of surfaces such as roofs and walls rather than of foliage

    """
    surface = is_surface(points, near)
    found = _encroachments(points, near, distance, owner, surface, models, settings)
    found += _low_conductors(models, ground_below, settings)
    found += _interference(models, settings)
    found += _abnormal_sag(models, settings)
    found.sort(key=lambda item: (item['span_id'], item['line_id'], item['along_span'], item['kind']))
    return tuple(Hazard(hazard_id=number, **item) for number, item in enumerate(found)), surface


def is_surface(points: Float64, chosen: Int64) -> Bool:
    """
    Tell points of roofs and walls from foliage by the planar likeness about them.

    Parameters
    ----------
    points : (N, 3) float64 [m]
    chosen : (K,) indices

    Returns
    -------
    (K,) bool

    """
    if not len(chosen):
        return np.zeros(0, dtype=bool)
    own = points[chosen]
    origin = own.min(axis=0) - 2.0
    voxels = build_voxels(own, np.arange(len(own)), origin, 0.5)
    likeness = measure_likeness(voxels)
    surface = (
        (likeness.planar >= PLANAR) & (likeness.spherical <= 0.08) & (likeness.count >= 5)
    )
    result: Bool = _look_up(
        own, origin, voxels.size, voxels.table_key, voxels.table_slot, surface
    )
    return result


@njit(cache=True, parallel=True, nogil=True)
def _look_up(points, origin, size, table_key, table_slot, values):  # type: ignore[no-untyped-def]
    """Value of the voxel that each point lies in."""
    result = np.empty(len(points), dtype=values.dtype)
    for i in prange(len(points)):
        key = pack(
            int((points[i, 0] - origin[0]) / size),
            int((points[i, 1] - origin[1]) / size),
            int((points[i, 2] - origin[2]) / size),
        )
        result[i] = values[find_slot(table_key, table_slot, key)]
    return result


def group_points(points: Float64, reach: float) -> Int64:
    """Label of the connected group of each point, links up to ``reach``; O(N log N)."""
    if not len(points):
        return np.zeros(0, dtype=np.int64)
    cell = reach / 4
    _, first, inverse = np.unique(
        np.floor(points / cell).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    pairs = cKDTree(points[first]).query_pairs(reach, output_type='ndarray')
    graph = coo_matrix(
        (np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(first), len(first))
    )
    _, label = connected_components(graph, directed=False)
    result: Int64 = label[inverse.ravel()].astype(np.int64)
    return result


def _encroachments(
    points: Float64,
    near: Int64,
    distance: Float64,
    owner: Int64,
    surface: Bool,
    models: Sequence[SpanModel],
    settings: HazardSettings,
) -> list[dict]:
    close = distance < settings.warning_distance
    near, distance, owner, surface = near[close], distance[close], owner[close], surface[close]
    result = []
    for kind, mask in (
        (HazardKind.VEGETATION, ~surface),
        (HazardKind.STRUCTURE, surface),
    ):
        members = near[mask]
        label = group_points(points[members], settings.group_distance)
        for group in range(int(label.max(initial=-1)) + 1):
            own = np.flatnonzero(label == group)
            if len(own) < settings.min_points:
                continue
            own_distance = distance[mask][own]
            worst = int(np.argmin(own_distance))
            model = models[int(owner[mask][own][worst])]
            result.append(
                _encroachment(
                    points[members[own]], worst, float(own_distance[worst]), model, kind, settings
                )
            )
    return result


def _encroachment(
    own: Float64,
    worst: int,
    clearance: float,
    model: SpanModel,
    kind: HazardKind,
    settings: HazardSettings,
) -> dict:
    position = own[worst]
    x, y = model.curve.local(position[None, :])
    low, high = sorted((model.start_x, model.end_x))
    inside = float(np.clip(x[0], low, high))
    vertical = float(model.curve.fit.height(inside)) - float(position[2])
    horizontal = math.hypot(float(y[0]), float(x[0]) - inside)
    critical = clearance < settings.critical_distance
    return {
        'line_id': model.span.line_id,
        'span_id': model.span.span_id,
        'kind': kind,
        'severity': Severity.CRITICAL if critical else Severity.WARNING,
        'position': position.copy(),
        'clearance': clearance,
        'required': settings.warning_distance,
        'horizontal': horizontal,
        'vertical': vertical,
        'sigma': _sigma(model, inside),
        'along_span': float(model.along(inside)),
        'num_points': len(own),
        'extent': np.stack([own.min(axis=0), own.max(axis=0)]),
        **_rule(),
    }


def _rule() -> dict:
    return {'rule': RULE, 'edition': EDITION, 'source': SOURCE}


def _sigma(model: SpanModel, x: float) -> float:
    return math.hypot(float(model.curve.prediction_sigma(np.array([x]))[0]), POINT_SIGMA)


def _low_conductors(
    models: Sequence[SpanModel], ground_below: Sequence[Float64], settings: HazardSettings
) -> list[dict]:
    result = []
    for model, stations in zip(models, ground_below):
        if not len(stations):
            continue
        worst = int(np.argmin(stations[:, 1]))
        along, clearance = (float(value) for value in stations[worst])
        if clearance >= settings.ground_distance:
            continue
        direction = 1.0 if model.end_x > model.start_x else -1.0
        x = model.start_x + direction * along
        above = model.curve.position(x)[0]
        position = above - np.array([0.0, 0.0, clearance])
        below = stations[:, 1] < settings.ground_distance
        run = model.curve.position(model.start_x + direction * stations[below, 0])
        run[:, 2] -= stations[below, 1]
        result.append(
            {
                'line_id': model.span.line_id,
                'span_id': model.span.span_id,
                'kind': HazardKind.GROUND,
                'severity': Severity.WARNING,
                'position': position,
                'clearance': clearance,
                'required': settings.ground_distance,
                'horizontal': 0.0,
                'vertical': clearance,
                'sigma': _sigma(model, x),
                'along_span': along,
                'num_points': int(below.sum()),
                'extent': np.stack([run.min(axis=0), run.max(axis=0)]),
                **_rule(),
            }
        )
    return result


def _interference(models: Sequence[SpanModel], settings: HazardSettings) -> list[dict]:
    """Conductors of a span that come much nearer in it than where they are held."""
    result = []
    for i, first in enumerate(models):
        for second in models[:i]:
            if first.span.span_id != second.span.span_id:
                continue
            x = np.linspace(first.start_x, first.end_x, 41)
            at = first.curve.position(x)
            other_x, across = second.curve.local(at)
            low, high = sorted((second.start_x, second.end_x))
            inside = (other_x >= low) & (other_x <= high)
            if inside.sum() < 10:
                continue
            gap = at[:, 2] - second.curve.fit.height(other_x)
            apart = np.where(inside, np.hypot(across, gap), np.inf)
            held = [apart[k] for k in (np.flatnonzero(inside)[0], np.flatnonzero(inside)[-1])]
            required = settings.interference_ratio * float(min(held))
            worst = int(np.argmin(apart))
            sigma = math.hypot(_sigma(first, float(x[worst])), _sigma(second, float(other_x[worst])))
            if apart[worst] >= required - 2 * sigma:
                continue
            result.append(
                {
                    'line_id': first.span.line_id,
                    'span_id': first.span.span_id,
                    'kind': HazardKind.INTERFERENCE,
                    'severity': Severity.WARNING,
                    'position': at[worst],
                    'clearance': float(apart[worst]),
                    'required': required,
                    'horizontal': abs(float(across[worst])),
                    'vertical': float(gap[worst]),
                    'sigma': sigma,
                    'along_span': float(first.along(x[worst])),
                    'num_points': 0,
                    'extent': np.stack([at[worst], at[worst]]),
                    **_rule(),
                }
            )
    return result


def _abnormal_sag(models: Sequence[SpanModel], settings: HazardSettings) -> list[dict]:
    """Conductors that sag much more than the others of their span."""
    result = []
    for model in models:
        peers = [
            other.span.sag / max(other.span.length, 1.0) ** 2
            for other in models
            if other.span.span_id == model.span.span_id and other is not model
            and other.span.length > 0.7 * model.span.length
        ]
        if len(peers) < 2:
            continue
        usual = float(np.median(peers)) * model.span.length**2
        excess = model.span.sag - usual
        tolerated = settings.sag_deviation * usual
        sigma = max(model.span.sigma['sag'], 0.01)
        if excess <= tolerated + 3 * sigma or excess < 0.15:
            continue
        lowest = model.span.lowest
        x, _ = model.curve.local(lowest[None, :])
        result.append(
            {
                'line_id': model.span.line_id,
                'span_id': model.span.span_id,
                'kind': HazardKind.SAG,
                'severity': Severity.WARNING,
                'position': lowest.copy(),
                'clearance': excess,
                'required': tolerated,
                'horizontal': 0.0,
                'vertical': excess,
                'sigma': sigma,
                'along_span': float(model.along(x[0])),
                'num_points': model.span.num_points,
                'extent': np.stack([lowest, lowest]),
                **_rule(),
            }
        )
    return result
