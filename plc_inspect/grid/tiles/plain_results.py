# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Results of a tile as files: spans, supports and hazards as JSON, points as arrays."""

from collections.abc import Mapping
import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np

from plc_inspect.grid.tiles.tile_job import TileJob
from plc_inspect.results import (
    Bool,
    Float64,
    Hazard,
    HazardKind,
    InspectionResult,
    Severity,
    Span,
    SpanKey,
    Support,
)

MARGIN = 0.5
"""Two tiles both claim spans within this distance of their border [m]; joining keeps one."""
POINT_FIELDS = ('line_id', 'span_id', 'clearance', 'classification', 'decision')
"""Fields of the points that go into points.laz."""
MOST_HEIGHT = 1000.0
"""Heights above ground are clipped to this [m].  Source: numerical: float16 holds 65504."""

Rectangle = tuple[float, float, float, float]


def is_within(territory: Rectangle, places: Float64) -> Bool:
    """
    Return which positions a tile claims.

    Parameters
    ----------
    territory : tuple of float
        Least x and y, greatest x and y of the tile [m].
    places : (N, 2+) float64
        [m]

    Returns
    -------
    (N,) bool

    """
    x, y = places[:, 0], places[:, 1]
    x0, y0, x1, y1 = territory
    inside: Bool = (x >= x0 - MARGIN) & (x < x1 + MARGIN)
    return inside & (y >= y0 - MARGIN) & (y < y1 + MARGIN)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FoundTile:
    """Results of one tile and its surroundings, with the tile's own numbers of lines and spans."""

    number: int
    name: str
    spans: tuple[Span, ...]
    middles: Float64
    """(S, 2) middle, in plan, of all conductors with the number of each span [m]."""
    supports: tuple[Support, ...]
    hazards: tuple[Hazard, ...]
    """Of the spans."""
    vegetation: dict[SpanKey, float | None]
    """Distance of each span to its nearest vegetation [m], None if there is none near."""
    territory: Rectangle
    """Least x and y, greatest x and y of the tile [m]."""


def write_found(
    job: TileJob, result: InspectionResult, core: Bool, kept: Bool, *, middles: Float64,
    territory: Rectangle, vegetation: Mapping[SpanKey, float | None],
) -> None:
    """
    Write the results of a tile.

    Parameters
    ----------
    job : TileJob
        The tile.
    result : InspectionResult
        Of N points and S spans.
    core : (N,) bool
        Points of the tile.
    kept : (S,) bool
        Spans to write.
    middles : (S, 2) float64
        See FoundTile.
    territory : tuple of float
        See FoundTile.
    vegetation : mapping
        Distance of each span to vegetation [m].

    """
    spans = [result.spans[k] for k in np.flatnonzero(kept).tolist()]
    keys = {(span.line_id, span.span_id) for span in spans}
    value = {
        'spans': [plain(span) for span in spans],
        'middles': middles[kept].tolist(),
        'territory': territory,
        'supports': [plain(item) for item in result.supports],
        'hazards': [
            plain(item) for item in result.hazards if (item.line_id, item.span_id) in keys
        ],
    }
    value['vegetation'] = [[*key, vegetation.get(key)] for key in sorted(keys)]
    arrays = {name: getattr(result, name)[core] for name in POINT_FIELDS}
    wire = np.flatnonzero(arrays['line_id'] >= 0)
    arrays |= {
        'wire': wire, 'residual': result.residual[core][wire],
        # for colours in reports alone
        'ground_height': result.ground_height[core].clip(-MOST_HEIGHT, MOST_HEIGHT).astype(
            np.float16
        ),
    }
    with job.publish('.labels.npz') as aside:
        np.savez(aside, **arrays)
    with job.publish('.json') as aside:
        aside.write_text(json.dumps(value), encoding='utf-8')


def has_found(place: Path) -> bool:
    """Tell whether the files of `write_found` for a tile are there."""
    return all(Path(f'{place}{suffix}').is_file() for suffix in ('.json', '.labels.npz'))


def read_found(place: Path, number: int) -> FoundTile:
    """Read the results that `write_found` wrote for a tile."""
    value = json.loads(Path(f'{place}.json').read_text(encoding='utf-8'))
    return FoundTile(
        number=number,
        name=place.name,
        spans=tuple(_make_span(item) for item in value['spans']),
        middles=np.array(value['middles']).reshape(-1, 2),
        territory=tuple(value['territory']),
        supports=tuple(
            Support(**item | {
                'position': np.array(item['position']), 'line_ids': tuple(item['line_ids']),
            })
            for item in value['supports']
        ),
        vegetation={(line, span): distance for line, span, distance in value['vegetation']},
        hazards=tuple(
            Hazard(**item | {
                'kind': HazardKind(item['kind']), 'severity': Severity(item['severity']),
                'position': np.array(item['position']), 'extent': np.array(item['extent']),
            })
            for item in value['hazards']
        ),
    )


def _make_span(item: dict[str, Any]) -> Span:
    places = {
        name: np.array(item[name]) for name in ('start', 'end', 'lowest', 'strands')
        if name in item  # strands are not, in results of before they were known
    }
    a2, a1, a0 = item['quadratic']
    return Span(**item | places | {'quadratic': (a2, a1, a0)})


def plain(item: Any) -> dict[str, Any]:
    """Return a frozen result as plain values; floats stay exact."""
    return {
        field.name: _value(getattr(item, field.name)) for field in dataclasses.fields(item)
    }


def _value(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, tuple):
        return [_value(part) for part in value]
    if isinstance(value, dict):
        return {key: _value(part) for key, part in value.items()}
    return int(value) if isinstance(value, HazardKind | Severity) else value
