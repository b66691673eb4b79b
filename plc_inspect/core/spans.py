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

"""Spans, supports and labels of points from the final curves."""

from collections.abc import Sequence
import dataclasses
from dataclasses import dataclass
import math

import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.catenary import fit_quadratic
from plc_inspect.core.collection import profile_curve
from plc_inspect.core.corridor import CorridorResult
from plc_inspect.core.curve import Curve, fit_curve
from plc_inspect.core.hazards import SpanModel
from plc_inspect.core.height import ground_at, HeightResult
from plc_inspect.core.plan_index import gather_strip, PlanIndex
from plc_inspect.core.route import Route, SIDE_BY_SIDE
from plc_inspect.core.structures import find_structure, Structure
from plc_inspect.core.supports import Layout
from plc_inspect.errors import FitError
from plc_inspect.results import Bool, Float32, Float64, Int32, Int64, Span, Support

END_SLACK = 0.3
"""Wire points may lie this far beyond the end of a span [m]."""
MAX_FINAL_POINTS = 20_000
"""Points that the final fit of a span uses at most."""
POLE_SLICE = (0.8, 0.8)
TOWER_SLICE = (2.0, 2.0)
"""Half thickness along the line, and reach beyond the attachments across it, of supports [m]."""
FREE_LENGTH = 2.0
"""Length of the parts of a span that are free of other things or not [m]."""
STRAY_RADIUS = 0.35
"""A conductor's own points stray this far from it [m]."""
FREE_RADIUS = 1.0
"""Something else begins within this distance wherever it touches a conductor [m]."""
FREE_SHARE = 0.1
"""A place is free where fewer than this share of its points, and two, are that far away."""
TERMINAL_SPREAD = 2.5
"""Open ends this near along the line end at one support [m]."""
HOLD_RADIUS = 3.0
HOLD_POINTS = 3
"""Insulators and arms leave this many points within HOLD_RADIUS of a conductor's end [m]."""
BEYOND = 5.0
"""The cloud must go on this far beyond a conductor that ends at a support [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpanResult:
    """Spans with their curves, supports, and labels of N points."""

    models: tuple[SpanModel, ...]
    """Ordered by line, then span."""
    supports: tuple[Support, ...]
    line_id: Int32
    """(N,) -1 where no wire."""
    span_id: Int32
    """(N,) -1 where no wire."""
    residual: Float32
    """(N,) distance to the curve [m], NaN where no wire."""
    support: Bool
    """(N,) points of towers and poles."""
    ground_below: tuple[Float64, ...]
    """For each model (S, 2): distance from its start and height above ground [m]."""


def build_spans(
    points: Float64,
    height: HeightResult,
    index: PlanIndex,
    layout: Layout,
    route: Route,
    settings: Settings,
    rng: np.random.Generator,
) -> SpanResult:
    """
    Fit each span once more to all its points, and say where it hangs.

    Points are collected along the curve between its supports, so those that earlier stages
    dropped come back; MSAC and least squares then give the final catenary and its covariance.

    Parameters
    ----------
    points : (N, 3) float64 [m]
    height : HeightResult
    index : PlanIndex of the points off the ground
    layout, route : the curves, and what they belong to
    settings : Settings
    rng : for MSAC

    Returns
    -------
    SpanResult

    """
    num = len(points)
    line_id = np.full(num, -1, dtype=np.int32)
    span_id = np.full(num, -1, dtype=np.int32)
    residual = np.full(num, np.nan, dtype=np.float32)
    finals = [
        _refit(points, index, layout, number, settings, rng)
        for number in range(len(layout.curves))
    ]
    for number, (curve, low, high) in enumerate(finals):
        chosen = profile_curve(points, index, curve, low - END_SLACK, high + END_SLACK).chosen
        x, y = curve.local(points[chosen])
        distance = np.hypot(
            y, (points[chosen, 2] - curve.fit.height(x)) / np.hypot(1.0, curve.fit.slope(x))
        ).astype(np.float32)
        nearer = ~(distance >= residual[chosen])
        chosen = chosen[nearer]
        line_id[chosen] = route.line_id[number]
        span_id[chosen] = route.span_id[number]
        residual[chosen] = distance[nearer]
    wire = line_id >= 0
    supports, support_mask, closed = _place_supports(
        points, height, index, wire, layout, route, finals
    )
    models = []
    for number, (curve, low, high) in enumerate(finals):
        own = np.flatnonzero((line_id == route.line_id[number]) & (span_id == route.span_id[number]))
        if len(own) < 3:
            continue
        is_open = tuple(
            station < 0 and (number, side) not in closed
            for station, side in (
                (layout.start_station[number], -1),
                (layout.end_station[number], 1),
            )
        )
        models.append(
            _model(
                points,
                curve,
                own,
                low,
                high,
                route.reverse[number],
                is_open,
                route.line_id[number],
                route.span_id[number],
                profile_curve(points, index, curve, low, high).coverage,
            )
        )
    models.sort(key=lambda model: (model.span.line_id, model.span.span_id))
    return SpanResult(
        models=tuple(models),
        supports=supports,
        line_id=line_id,
        span_id=span_id,
        residual=residual,
        support=support_mask & ~wire,
        ground_below=tuple(_ground_below(height, model) for model in models),
    )


def claim_strays(
    points: Float64, spans: SpanResult, corridor: CorridorResult
) -> SpanResult:
    """
    Give conductors the stray points about them, which would look like hazards.

    Mixed returns and the drift of poses put points some decimetres beside a conductor.  What
    grows or stands there goes on away from it, so strays are claimed only in places where next
    to nothing lies between STRAY_RADIUS and FREE_RADIUS.

    Parameters
    ----------
    points : (N, 3) float64 [m]
    spans : SpanResult
    corridor : CorridorResult of the same spans

    Returns
    -------
    SpanResult
        With labels, residuals and numbers of points brought up to date.

    """
    close = np.flatnonzero(corridor.near_distance <= FREE_RADIUS)
    close = close[~spans.support[corridor.near[close]]]
    line_id, span_id = spans.line_id.copy(), spans.span_id.copy()
    residual = spans.residual.copy()
    models = []
    for number, model in enumerate(spans.models):
        own = close[corridor.near_span[close] == number]
        found, distance = corridor.near[own], corridor.near_distance[own]
        x, _ = model.curve.local(points[found])
        place = (model.along(x) / FREE_LENGTH).astype(np.int64)
        wire = spans.line_id[found] >= 0
        stray = ~wire & (distance <= STRAY_RADIUS)
        num = int(place.max(initial=0)) + 1
        on = np.bincount(place[wire], minlength=num)
        away = np.bincount(place[~wire & ~stray], minlength=num)
        taken = stray & (away <= FREE_SHARE * on + 1)[place] & (on > 0)[place]
        line_id[found[taken]] = model.span.line_id
        span_id[found[taken]] = model.span.span_id
        residual[found[taken]] = distance[taken]
        record = dataclasses.replace(
            model.span, num_points=model.span.num_points + int(taken.sum())
        )
        models.append(dataclasses.replace(model, span=record))
    return dataclasses.replace(
        spans, models=tuple(models), line_id=line_id, span_id=span_id, residual=residual
    )


def _refit(
    points: Float64,
    index: PlanIndex,
    layout: Layout,
    number: int,
    settings: Settings,
    rng: np.random.Generator,
) -> tuple[Curve, float, float]:
    """Curve fitted to all points between its ends, and the x of the ends on it."""
    curve = layout.curves[number]
    low, high = float(layout.start_x[number]), float(layout.end_x[number])
    ends = curve.position(np.array([low, high]))
    for _ in range(2):
        chosen = profile_curve(points, index, curve, low, high).chosen
        try:
            refit = fit_curve(
                points,
                chosen,
                tolerance=curve.tolerance,
                num_trials=settings.catenary.num_trials,
                rng=rng,
                max_points=MAX_FINAL_POINTS,
                azimuth=curve.azimuth,
            )
        except FitError:
            break
        if refit.num_points < 0.8 * curve.num_points:
            break
        curve = refit
        low, high = (float(value) for value in curve.local(ends)[0])
        if layout.start_station[number] < 0:
            low = min(low, curve.low) if curve.low < low + 1.0 else curve.low
        if layout.end_station[number] < 0:
            high = max(high, curve.high) if curve.high > high - 1.0 else curve.high
    return curve, low, high


def _model(
    points: Float64,
    curve: Curve,
    own: Int64,
    low: float,
    high: float,
    reverse: bool,
    is_open: tuple[bool, ...],
    line: int,
    span: int,
    coverage: float,
) -> SpanModel:
    """Span in the orientation of its route."""
    start_x, end_x = (high, low) if reverse else (low, high)
    sign = -1.0 if reverse else 1.0
    start, end = curve.position(np.array([start_x, end_x]))
    sag, sigma_sag = curve.fit.sag(low, high)
    sigma_a, sigma_b, sigma_c = curve.fit.parameter_sigma()
    x, _ = curve.local(points[own])
    along = (x - start_x) * sign
    lowest = curve.position(curve.fit.lowest(low, high))[0]
    a2, a1, a0 = fit_quadratic(along, points[own, 2])
    open_low, open_high = is_open
    record = Span(
        line_id=line,
        span_id=span,
        start=start,
        end=end,
        azimuth=math.remainder(curve.azimuth + (math.pi if reverse else 0.0), 2 * math.pi),
        length=high - low,
        a=curve.fit.a,
        b=(curve.fit.b - start_x) * sign,
        c=curve.fit.c,
        quadratic=(a2, a1, a0),
        sag=sag,
        lowest=lowest,
        open_start=open_high if reverse else open_low,
        open_end=open_low if reverse else open_high,
        rmse=curve.fit.rmse,
        num_points=len(own),
        coverage=coverage,
        sigma={'a': sigma_a, 'b': sigma_b, 'c': sigma_c, 'sag': sigma_sag},
    )
    return SpanModel(span=record, curve=curve, start_x=start_x, end_x=end_x)


def _ground_below(height: HeightResult, model: SpanModel) -> Float64:
    num = max(int(model.span.length), 2) + 1
    x = np.linspace(model.start_x, model.end_x, num)
    at = model.curve.position(x)
    clearance = at[:, 2] - ground_at(height, at[:, :2])
    known = np.isfinite(clearance)
    return np.stack([model.along(x[known]), clearance[known]], axis=1)


def _place_supports(
    points: Float64,
    height: HeightResult,
    index: PlanIndex,
    wire: Bool,
    layout: Layout,
    route: Route,
    finals: Sequence[tuple[Curve, float, float]],
) -> tuple[tuple[Support, ...], Bool, set[tuple[int, int]]]:
    """Supports of all stations and of the open ends at which a structure stands."""
    mask = np.zeros(len(points), dtype=bool)
    found = []
    closed: set[tuple[int, int]] = set()
    ends = [
        (number, side, curve.position(high if side > 0 else low)[0])
        for number, (curve, low, high) in enumerate(finals)
        for side in (-1, 1)
    ]
    stations = [layout.start_station, layout.end_station]
    for station, record in enumerate(layout.stations):
        members = [end for end in ends if stations[(end[1] + 1) // 2][end[0]] == station]
        if not members:
            continue
        found.append((record.position, members))
    opened = [end for end in ends if stations[(end[1] + 1) // 2][end[0]] < 0]
    for members in _group_ends(opened, finals):
        found.append((np.mean([end[2][:2] for end in members], axis=0), members))
    supports = []
    for position, members in found:
        is_open = stations[(members[0][1] + 1) // 2][members[0][0]] < 0
        attachments = np.array([end[2] for end in members])
        base = float(ground_at(height, position[None, :])[0])
        structure = None
        if math.isfinite(base):
            structure = find_structure(
                points,
                height.height,
                index,
                wire,
                position,
                2.5 if len(members) < 3 else 4.0,
                float(attachments[:, 2].min()) - base,
            )
        is_pole = structure is not None and structure.kind == 'pole'
        held = len(members) > 1 and (
            structure is not None
            or _are_held(points, height, index, wire, members, finals)
        )
        if is_open and not is_pole and not held:
            continue
        if is_open:
            closed |= {(end[0], end[1]) for end in members}
        place = _settle(position, structure, members, finals)
        foot = float(ground_at(height, place[None, :])[0])
        top = float(attachments[:, 2].max())
        if structure is not None:
            top = max(top, structure.top)
        _mark(
            points,
            index,
            place,
            finals[members[0][0]][0].azimuth,
            attachments,
            structure.kind == 'pole' if structure is not None else len(members) < 3,
            mask,
        )
        if not math.isfinite(foot):
            foot = float(attachments[:, 2].min())
        supports.append(
            (
                min(route.span_id[end[0]] for end in members),
                max(route.span_id[end[0]] for end in members),
                tuple(sorted({route.line_id[end[0]] for end in members})),
                np.array([place[0], place[1], foot]),
                top - foot,
                structure.kind if structure is not None else 'unseen',
            )
        )
    supports.sort(key=lambda item: (item[0] + item[1], item[2], *item[3]))
    return (
        tuple(
            Support(support_id=number, position=place, height=tall, kind=kind, line_ids=lines)
            for number, (_, _, lines, place, tall, kind) in enumerate(supports)
        ),
        mask,
        closed,
    )


def _group_ends(
    ends: Sequence[tuple[int, int, Float64]],
    finals: Sequence[tuple[Curve, float, float]],
) -> list[list[tuple[int, int, Float64]]]:
    """Open ends that lie side by side across their line."""
    groups: list[list[tuple[int, int, Float64]]] = []
    for end in ends:
        azimuth = finals[end[0]][0].azimuth
        unit = np.array([math.cos(azimuth), math.sin(azimuth)])
        for group in groups:
            apart = np.array([other[2][:2] - end[2][:2] for other in group])
            if (
                np.abs(apart @ unit).max() <= TERMINAL_SPREAD
                and np.linalg.norm(apart, axis=1).min() <= SIDE_BY_SIDE
            ):
                group.append(end)
                break
        else:
            groups.append([end])
    return groups


def _are_held(
    points: Float64,
    height: HeightResult,
    index: PlanIndex,
    wire: Bool,
    members: Sequence[tuple[int, int, Float64]],
    finals: Sequence[tuple[Curve, float, float]],
) -> bool:
    """Tell conductors that end at arms or insulators from those that leave the cloud."""
    held = 0
    for number, side, end in members:
        azimuth = finals[number][0].azimuth
        unit = side * np.array([math.cos(azimuth), math.sin(azimuth)])
        if not math.isfinite(float(ground_at(height, (end[:2] + BEYOND * unit)[None, :])[0])):
            return False
        found = gather_strip(
            index.start, index.order, index.origin, index.cell_size, index.shape[0],
            index.shape[1], end[0], end[1], end[0], end[1], HOLD_RADIUS,
        )
        near = np.linalg.norm(points[found] - end, axis=1) <= HOLD_RADIUS
        held += int((near & ~wire[found]).sum()) >= HOLD_POINTS
    low, high = height.origin, height.origin + height.cell_size * np.array(height.ground.shape[::-1])
    inside = all(
        ((end[:2] > low + BEYOND) & (end[:2] < high - BEYOND)).all() for _, _, end in members
    )
    return inside and 2 * held >= len(members)


def _settle(
    position: Float64,
    structure: Structure | None,
    members: Sequence[tuple[int, int, Float64]],
    finals: Sequence[tuple[Curve, float, float]],
) -> Float64:
    """Plan position of a support: its pole, or along the line its tower's points."""
    if structure is None:
        return position
    if structure.kind == 'pole':
        return structure.position
    azimuth = finals[members[0][0]][0].azimuth
    unit = np.array([math.cos(azimuth), math.sin(azimuth)])
    along = float((structure.position - position) @ unit)
    return position + unit * min(max(along, -1.5), 1.5)


def _mark(
    points: Float64,
    index: PlanIndex,
    place: Float64,
    azimuth: float,
    attachments: Float64,
    is_pole: bool,
    mask: Bool,
) -> None:
    """
    Mark the points of a structure: a slice across the line as wide as the attachments.

    The slice is thin, so that a tree beside a support reaches out of it and stays a hazard.
    """
    along_arm, beside = POLE_SLICE if is_pole else TOWER_SLICE
    unit = np.array([math.cos(azimuth), math.sin(azimuth)])
    left = np.array([-unit[1], unit[0]])
    half = float(np.abs((attachments[:, :2] - place) @ left).max()) + beside
    reach = math.hypot(half, along_arm)
    found = gather_strip(
        index.start, index.order, index.origin, index.cell_size, index.shape[0], index.shape[1],
        place[0], place[1], place[0], place[1], reach,
    )
    apart = points[found, :2] - place
    mask[found[(np.abs(apart @ unit) <= along_arm) & (np.abs(apart @ left) <= half)]] = True
