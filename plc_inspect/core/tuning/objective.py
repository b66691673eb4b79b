# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Scores settings by their result: by its quality without labels, by F1 with labels.

docs/tuning.md states the objective and the reasons for it.
"""

from collections.abc import Sequence
import dataclasses
from dataclasses import dataclass
import math

import numpy as np
from scipy.spatial import cKDTree

from plc_inspect.config import HazardSettings, Settings
from plc_inspect.core.catenary.nearest_span import find_near
from plc_inspect.core.pipeline import enter_frame, Pipeline
from plc_inspect.core.spans.span_model import SpanModel, tabulate
from plc_inspect.core.stage_log import StageMemory
from plc_inspect.core.tuning.parameters import get_values, INITIAL, measure_distance, put_values
from plc_inspect.results import Bool, Float64, Int64

RESIDUAL_SCALE = 0.3
"""Spread of points about a curve that scores one half [m].  Source: judgement; not measured."""
AGAIN_DISTANCE = 0.3
"""
Greatest distance of a position that another curve finds again [m].
Source: judgement; not measured.
"""
EXPLAINED_DISTANCE = 1.0
"""Greatest distance of evidence explained by a curve [m].  Source: judgement; not measured."""
METRE = 1.0
"""Edge of the cells in which evidence is counted [m].  Source: derived: lengths are in metres."""
NUM_STATIONS = 9
"""Positions at which a span is compared with others.  Source: judgement; not measured."""
TILE = 100.0
"""
Edge of the tiles from which the part of a large cloud is chosen [m].
Source: judgement; not measured.
"""
HALF = 0.5
"""Share of points in which spans must be found again.  Source: judgement; not measured."""
PRIOR = 0.5
"""
Greatest loss of score by distance from the initial values of Table 1, without labels.
Source: judgement; not measured.
"""
TIE_BREAK = 0.05
"""The same with labels.  Source: judgement; not measured."""
FOUND_ONCE = 0.75
"""
Score of a span that is not found again, relative to one that is.
Source: chosen on oakland_part3_an and oakland_part2_ai (docs/tuning.md).
"""
LEAST_STABLE = 0.5
"""
Least share of a span found again in half of the points.
Source: judgement; not measured.
"""
TOLD = 1e-4
"""Least difference of figures that is reported.  Source: derived: the last digit shown."""
LEAST = 1e-9
"""Least distance or length as a divisor [m].  Source: numerical: avoids a division by 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """The score of one choice of settings, and its parts; shares are 0 to 1."""

    value: float
    """To be maximised."""
    seen: float = 0.0
    """Share of the metres that look like a conductor that are on a span with points."""
    fit: float = 0.0
    """1 if the points of spans lie on their catenaries."""
    separation: float = 0.0
    """1 if conductors are far apart compared with the spread of their points."""
    stability: float = 0.0
    """Share of spans, by length, that is found again in half of the points."""
    num_spans: int = 0
    num_stable: int = 0
    """Spans that are found again."""
    f1: float = math.nan
    """F1 of wire points; NaN without labels."""

    def explain(self, before: 'Score') -> str:
        """Describe the differences from an earlier score."""
        parts = [
            f'{name} {getattr(before, name):.4f} -> {getattr(self, name):.4f}'
            for name in ('seen', 'fit', 'separation', 'stability', 'f1')
            if abs(getattr(before, name) - getattr(self, name)) >= TOLD
        ]
        if before.num_spans != self.num_spans:
            parts.append(f'spans {before.num_spans} -> {self.num_spans}')
        return ', '.join(parts) or 'equally good, and closer to the initial values of Table 1'


NOTHING = Score(value=0.0)


class Objective:
    """Scores settings on one cloud; keeps stage results that several settings share."""

    def __init__(
        self,
        points: Float64,
        *,
        seed: int = 0,
        truth: tuple[Bool, Bool] | None = None,
        room: int = 2,
        base: Settings | None = None,
    ) -> None:
        """
        Keep the cloud.

        Parameters
        ----------
        points : (N, 3) float64
            Map frame [m].
        seed : int
            Selects the half of the points in which spans must be found again.
        truth : tuple of two (N,) bool or None
            Points that are wire, and points that are left out; the score is then F1.
        room : int
            Number of results kept per stage.
        base : Settings or None
            Settings other than the tuned ones, by default those of config.py.

        """
        self.points = points = enter_frame(points)[0]
        """(N, 3) in the frame in which the pipeline runs [m]."""
        self.truth = truth
        half = np.random.default_rng(seed).random(len(points)) < HALF
        self._half = points[half]
        self._memory, self._half_memory = StageMemory(room), StageMemory(room)
        self._base = base or Settings()
        self._evidence: Float64 | None = None

    @property
    def evidence(self) -> Float64:
        """(E, 3) evidence with the values of Table 1, in the pipeline's frame [m]."""
        if self._evidence is None:
            settings = _without_rules(put_values(self._base, INITIAL))
            self._evidence = gather_evidence(self.points, settings, self._memory)
        return self._evidence

    def lowest(self, settings: Settings) -> list[float]:
        """Return the height of the lowest point of each span above ground, a0 [m]."""
        spans = Pipeline(_without_rules(settings)).find_lines(self.points, self._memory).spans
        return [
            float(below[:, 1].min()) if len(below) else math.nan for below in spans.ground_below
        ]

    def score(self, settings: Settings) -> Score:
        """Return the score of settings."""
        return self.evaluate(settings)[0]

    def evaluate(self, settings: Settings) -> tuple[Score, Int64]:
        """Return the score of settings, and the indices of the wire points, ascending."""
        settings = _without_rules(settings)
        pipeline = Pipeline(settings)
        spans = pipeline.find_lines(self.points, self._memory).spans
        wire = np.flatnonzero(spans.line_id >= 0)
        if self.truth is not None:
            f1 = measure_f1(spans.line_id >= 0, *self.truth)
            num = len(spans.models)
            value = _prefer(f1, settings, TIE_BREAK)
            score = Score(value=value, f1=f1, num_spans=num, num_stable=num)
            return score, wire
        if not spans.models:
            return NOTHING, wire
        again = pipeline.find_lines(self._half, self._half_memory).spans.models
        return judge(spans.models, again, self.evidence, settings), wire


def is_line(score: Score) -> bool:
    """Tell whether a score shows a line, not chance finds."""
    return score.num_stable > 0 and score.value > 0.0


def choose_part(points: Float64, evidence: Float64, most: int) -> Bool | None:
    """
    Choose the part of a large cloud to tune on: a square about the tile with most evidence.

    Parameters
    ----------
    points : (N, 3) float64
        In the frame of the evidence [m].
    evidence : (E, 3) float64
        What looks like a conductor [m].
    most : int
        Greatest number of points of the part.

    Returns
    -------
    (N,) bool or None
        None if the cloud is small enough or has no evidence.

    """
    if len(points) <= most or not len(evidence):
        return None
    tile, count = np.unique(np.floor(evidence[:, :2] / TILE), axis=0, return_counts=True)
    middle = (tile[np.argmax(count)] + 0.5) * TILE
    away = np.abs(points[:, :2] - middle).max(axis=1)
    away[~np.isfinite(points).all(axis=1)] = np.inf
    chosen: Bool = away < np.partition(away, most)[most]
    return chosen


def judge(
    models: Sequence[SpanModel],
    again: Sequence[SpanModel],
    evidence: Float64,
    settings: Settings,
) -> Score:
    """
    Return the score of spans without labels.

    Parameters
    ----------
    models : sequence of SpanModel
        Spans found in all points.
    again : sequence of SpanModel
        Spans found in half of the points.
    evidence : (E, 3) float64
        As from `gather_evidence` [m].
    settings : Settings
        Settings that found them; distance from the initial values of Table 1 costs up to PRIOR.

    Returns
    -------
    Score

    """
    if not models:
        return NOTHING
    # how well points fit their curves, and how far curves are apart
    length = np.array([model.span.length for model in models])
    coverage = np.array([model.span.coverage for model in models])
    spread = np.array([
        math.hypot(model.curve.fit.rmse, model.curve.lateral_rmse) for model in models
    ])
    fit = 1.0 / (1.0 + (spread / RESIDUAL_SCALE) ** 2)
    gap = measure_gaps(models)
    separation = np.clip(1.0 - spread / np.maximum(gap, LEAST), 0.0, 1.0)
    # what is found again, and what evidence no curve explains
    stability = measure_stability(models, again)
    explained, _, _ = find_near(evidence, tabulate(models), EXPLAINED_DISTANCE)
    total = float(length.sum()) + len(evidence) - len(explained)
    metres = length * coverage
    num_stable = int((stability >= LEAST_STABLE).sum())
    again_worth = FOUND_ONCE + (1.0 - FOUND_ONCE) * stability
    worth = float((metres * fit * separation * again_worth).sum()) / total if num_stable else 0.0
    weight = metres / max(float(metres.sum()), LEAST)
    return Score(
        value=_prefer(worth, settings, PRIOR),
        seen=float(metres.sum()) / total,
        fit=float(weight @ fit),
        separation=float(weight @ separation),
        stability=float(weight @ stability),
        num_spans=len(models),
        num_stable=num_stable,
    )


def gather_evidence(points: Float64, settings: Settings, memory: StageMemory) -> Float64:
    """
    Return the evidence of conductors, one position for each metre.

    Evidence is found before any curve is fitted: cells with candidates that have enough votes, be
    they conductors, or edges and twigs in line by chance.  Sparse wires have few such cells, so
    each metre of a span found with these settings, away from all such cells, counts too.

    Parameters
    ----------
    points : (N, 3) float64
        Map frame [m].
    settings : Settings
        Settings of the stages.
    memory : StageMemory
        Memory of the stages for these points.

    Returns
    -------
    (E, 3) float64
        Means of the candidates of cells, and positions on spans [m].

    """
    lines = Pipeline(settings).find_lines(points, memory)
    places = lines.candidates.position[lines.outliers.keep][lines.alignment.voted]
    cells = np.zeros((0, 3))
    if len(places):
        _, cell = np.unique(np.floor(places / METRE), axis=0, return_inverse=True)
        cell = cell.reshape(-1)
        count = np.bincount(cell)
        cells = np.stack([np.bincount(cell, places[:, k]) / count for k in range(3)], axis=1)
    on_spans = [
        model.curve.position(np.arange(min(model.start_x, model.end_x) + METRE / 2,
                                       max(model.start_x, model.end_x), METRE))
        for model in lines.spans.models
    ]
    if not on_spans:
        return cells
    metres = np.concatenate(on_spans)
    if len(cells):
        metres = metres[cKDTree(cells).query(metres)[0] > EXPLAINED_DISTANCE]
    return np.concatenate([cells, metres])


def measure_gaps(models: Sequence[SpanModel]) -> Float64:
    """
    Return the distance of each span to the nearest other one between the same supports.

    Returns
    -------
    (S,) float64
        Median over positions on the span [m]; inf if there is no other.

    """
    result = np.full(len(models), np.inf)
    members: dict[int, list[int]] = {}
    for number, model in enumerate(models):
        members.setdefault(model.span.span_id, []).append(number)
    for group in members.values():
        for number in group:
            model = models[number]
            stations = _stations(model)
            for other in group:
                if other != number:
                    curve = models[other].curve
                    x, y = curve.local(stations)
                    apart = np.hypot(y, stations[:, 2] - curve.fit.height(x))
                    result[number] = min(result[number], float(np.median(apart)))
    return result


def measure_stability(models: Sequence[SpanModel], again: Sequence[SpanModel]) -> Float64:
    """Return the (S,) share of the positions on each span that other spans find again."""
    if not len(models) or not len(again):
        return np.zeros(len(models))
    stations = np.concatenate([_stations(model) for model in models])
    found, _, _ = find_near(stations, tabulate(again), AGAIN_DISTANCE)
    count = np.bincount(found // NUM_STATIONS, minlength=len(models))
    return count / NUM_STATIONS


def measure_f1(found: Bool, wire: Bool, left_out: Bool) -> float:
    """Return the F1 of (N,) wire points, 0 if none was found correctly."""
    keep = ~left_out
    right = int((found & wire & keep).sum())
    wrong = int(((found != wire) & keep).sum())
    return 2 * right / (2 * right + wrong) if right else 0.0


def _prefer(worth: float, settings: Settings, prior: float) -> float:
    """Reduce a score by the distance of the settings from the initial values of Table 1."""
    return worth * (1.0 - prior * measure_distance(get_values(settings)))


def _without_rules(settings: Settings) -> Settings:
    """Return settings without clearance rules, which do not influence lines."""
    return dataclasses.replace(settings, hazards=HazardSettings())


def _stations(model: SpanModel) -> Float64:
    share = (np.arange(NUM_STATIONS) + 0.5) / NUM_STATIONS
    return model.curve.position(model.start_x + share * (model.end_x - model.start_x))
