# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Inspect one tile with its halo; the result is that of the whole grid.

A span belongs to the tile that holds the middle of its conductors.  A halo is wide enough if it
cuts off no span near the tile, and none beside or next to such a span; and if enough is seen of
what hangs beyond the latter, as that decides where they end, and they where the span ends.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
import time
from typing import Any

import numpy as np
import shapely

from plc_inspect.config import Settings
from plc_inspect.core.hazards.clearance_rules import RuleSet
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.core.whole import Whole
from plc_inspect.grid.cells.layout import BASE_BYTES, BYTES_PER_POINT, WIDEN
from plc_inspect.grid.tiles.plain_results import is_within, write_found
from plc_inspect.grid.tiles.survey_whole import load_surface
from plc_inspect.grid.tiles.tile_job import TileJob
from plc_inspect.offline.export.files import measure_peak_memory
from plc_inspect.offline.records.inspection import measure_clearances
from plc_inspect.results import Bool, Float64, InspectionResult, Span

MOST_HALO = 2000.0
"""Widest halo [m].  Source: judgement: the longest spans except crossings of fjords and rivers."""
NEAR_EDGE = 25.0
"""
A span end, or its support, within this distance of the edge of the halo is cut off [m].
Source: judgement: half the width of the largest towers, and their neighbours in the next metres.
"""
FAR_EDGE = 100.0
"""
The same for the spans beside and next to those near the tile [m].
Source: derived: curves of 100 m cross at a support within some centimetres, those of 36 m missed
it by 0.7 m, which moved the support at the other end of a span of 310 m by 7.5 mm.
"""
NEAR_TILE = 60.0
"""
Spans within this distance of a tile affect the labels of its points [m].
Source: judgement: the corridor.
"""
NEAR_SPAN = 30.0
"""Spans within this distance affect each other [m].  Source: judgement."""
Rectangle = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Look:
    """The result of one attempt at a tile."""

    result: InspectionResult
    core: Bool
    """(N,) points of the tile."""
    middles: Float64
    """(S, 2) middle, in plan, of all conductors with the number of each span [m]."""
    claimed: Bool
    """(S,) spans that belong to the tile."""
    near: Bool
    """(S,) spans near the tile, or near such a span."""
    num_cut: int
    """Number of those spans that the edge of the halo cuts off."""


def inspect_tile(
    job: TileJob, whole: Whole, settings: Settings, rules: RuleSet | None, most_points: int
) -> dict[str, Any]:
    """
    Inspect one tile and write its results to its files.

    Parameters
    ----------
    job : TileJob
        The tile.
    whole : Whole
        What is known of the grid.
    settings : Settings
        Of all stages.
    rules : RuleSet or None
        Clearance rules.
    most_points : int
        The halo is not widened beyond this number of points.

    Returns
    -------
    dict
        Figures for the ledger.

    """
    started = time.perf_counter()
    pipeline = Pipeline(settings, rules)
    (x, y), edge = job.grid.origin, job.grid.edge
    bound = (x, y, x + job.grid.columns * edge, y + job.grid.rows * edge)
    halo, looks = job.tile.halo, 0
    while True:
        found = job.read(halo)
        looks += 1
        outer = job.tile.rectangle(job.grid, halo)
        surface = None
        if looks == 1:
            with suppress(OSError):  # of an earlier run
                surface = load_surface(job)
        result = pipeline.run_part(found.points, found.number, whole, surface=surface)
        num_points = len(found.points)
        look = _judge(result, found.core, job.tile.rectangle(job.grid), outer, bound)
        wider = find_wider(halo, num_points, most_points)
        if not look.num_cut or wider is None:
            break
        halo = wider
    write_found(
        job, look.result, look.core, look.near | look.claimed,
        middles=look.middles, territory=job.tile.rectangle(job.grid),
        vegetation=measure_clearances(look.result, settings.hazards.min_points),
    )
    return {
        'num_points': int(look.core.sum()), 'num_read': num_points,
        'halo': halo, 'looks': looks,
        'num_spans': int(look.claimed.sum()), 'num_cut': look.num_cut,
        'seconds': time.perf_counter() - started, 'peak_memory': measure_peak_memory(),
        'expected_memory': BASE_BYTES + BYTES_PER_POINT * num_points,
    }


def find_wider(halo: float, num_points: int, most_points: int) -> float | None:
    """
    Return the halo to try after one that cuts off a span.

    Parameters
    ----------
    halo : float
        Around the tile so far [m].
    num_points : int
        Points in the tile with this halo.
    most_points : int
        As many as fit in memory.

    Returns
    -------
    float or None
        [m]; None where it would be too wide, or hold too many points.

    """
    wider = min(halo * WIDEN, MOST_HALO)
    return wider if wider > halo and num_points * (wider / halo) <= most_points else None


def _judge(
    result: InspectionResult, core: Bool, own: Rectangle, outer: Rectangle, bound: Rectangle
) -> _Look:
    spans = result.spans
    middles = _find_middles(spans)
    claimed = is_within(own, middles)
    near, num_cut = np.zeros(len(spans), dtype=bool), 0
    if spans:
        chords = shapely.linestrings([[span.start[:2], span.end[:2]] for span in spans])
        tile = shapely.box(*own)
        first = claimed | (shapely.distance(chords, tile) < NEAR_TILE)
        tree = shapely.STRtree(chords)
        here = np.flatnonzero(first)
        _, beside = tree.query(chords[here], predicate='dwithin', distance=NEAR_SPAN)
        near[here] = True
        near[beside] = True
        num_cut = sum(
            _is_cut(spans[number], outer, bound, NEAR_EDGE if first[number] else FAR_EDGE)
            for number in np.flatnonzero(near).tolist()
        )
    return _Look(
        result=result, core=core, middles=middles, claimed=claimed, near=near, num_cut=num_cut
    )


def _find_middles(spans: Sequence[Span]) -> Float64:
    """Return the (S, 2) plan middle of all conductors with the number of each span [m]."""
    middles: dict[int, list[Any]] = {}
    for span in spans:
        middles.setdefault(span.span_id, []).append((span.start[:2] + span.end[:2]) / 2)
    means = {number: np.mean(places, axis=0) for number, places in middles.items()}
    return np.array([means[span.span_id] for span in spans]).reshape(-1, 2)


def _is_cut(span: Span, outer: Rectangle, bound: Rectangle, reach: float) -> bool:
    """Return whether a span ends near the edge of the halo although the grid goes on."""
    for end in (span.start, span.end):  # one on a support as well: it is half seen at the edge
        for side in range(4):
            edge, limit = outer[side], bound[side]
            goes_on = edge > limit if side < 2 else edge < limit
            if goes_on and abs(float(end[side % 2]) - edge) < reach:
                return True
    return False
