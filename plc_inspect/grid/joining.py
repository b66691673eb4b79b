# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Join the results of all tiles: each span once, lines numbered over the whole grid.

Where two tiles share a span, their lines are one line; this links lines from tile to tile.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

import numpy as np
from scipy.spatial import cKDTree
import shapely

from plc_inspect.core.numerics.disjoint_sets import unite
from plc_inspect.grid.same_spans import list_places, match_spans, Place
from plc_inspect.grid.tiles.plain_results import FoundTile, is_within, MARGIN
from plc_inspect.results import Bool, Float64, Hazard, Span, SpanKey, Support

SAME_SUPPORT = 0.5
"""Supports of two tiles within this distance are one support [m].  Source: judgement."""
MEETING = 15.0
"""
Greatest distance of the ends of two spans of one line at one support [m].
Source: judgement.
"""
LAYER_GAP = 0.8
"""As core.spans.route [m].  Source: judgement."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JoinedGrid:
    """What was found in a grid."""

    spans: tuple[Span, ...]
    """Ordered by line, then span."""
    supports: tuple[Support, ...]
    hazards: tuple[Hazard, ...]
    span_tiles: tuple[int, ...]
    """Number of the tile that each span belongs to."""
    hazard_tiles: tuple[int, ...]
    numbers: dict[int, dict[SpanKey, SpanKey]]
    """For each tile number: the tile's own span key to the key in the grid."""
    vegetation: dict[SpanKey, float | None]
    """Distance of each span to its nearest vegetation [m], None if there is none near."""
    num_unmatched: int
    """
    Spans found near a tile that no tile keeps: cut off, or not found in the tile they belong to.
    """


def join_tiles(tiles: Sequence[FoundTile]) -> JoinedGrid:
    """
    Join the tiles of a grid.

    Parameters
    ----------
    tiles : sequence of FoundTile
        What was found in each.

    Returns
    -------
    JoinedGrid

    """
    places = list_places(tiles)
    same = match_spans(tiles, places)
    winners = _choose_winners(tiles, places, same)
    line = _unite_numbers(tiles, places, same, 'line_id')
    group = _unite_numbers(tiles, places, same, 'span_id')
    chosen = sorted(winners.values())
    spans = [tiles[places[k][0]].spans[places[k][1]] for k in chosen]
    lines, groups = [line[k] for k in chosen], [group[k] for k in chosen]
    order, entry = _order_groups(spans, lines, groups)
    rank = {number: place for place, number in enumerate(order)}
    turned = [_is_turned(span, entry[own]) for span, own in zip(spans, groups, strict=True)]
    line_number = _number_lines(spans, turned, lines, [rank[own] for own in groups])
    final: dict[int, Span] = {}
    for k, span, is_turned, own, at in zip(chosen, spans, turned, lines, groups, strict=True):
        final[k] = replace(
            turn_span(span) if is_turned else span, line_id=line_number[own], span_id=rank[at]
        )
    final = _settle_twins(final)
    numbers, num_unmatched = _list_numbers(tiles, places, same, winners, final)
    every_line = {
        (places[k][0], tiles[places[k][0]].spans[places[k][1]].line_id): line_number[line[k]]
        for k in range(len(places)) if line[k] in line_number
    }
    supports, support_numbers = _join_supports(tiles, every_line)
    hazards = _join_hazards(
        tiles, {places[k]: span for k, span in final.items()},
        {places[k] for k, is_turned in zip(chosen, turned, strict=True) if is_turned},
        every_line, support_numbers,
    )
    ordered = sorted(final, key=lambda k: (final[k].line_id, final[k].span_id))
    return JoinedGrid(
        spans=tuple(final[k] for k in ordered),
        supports=supports,
        hazards=tuple(hazard for _, hazard in hazards),
        span_tiles=tuple(tiles[places[k][0]].number for k in ordered),
        hazard_tiles=tuple(tiles[tile].number for tile, _ in hazards),
        numbers=numbers,
        vegetation={
            (final[k].line_id, final[k].span_id): _find_vegetation(tiles, places[k]) for k in final
        },
        num_unmatched=num_unmatched,
    )


def _find_vegetation(tiles: Sequence[FoundTile], place: Place) -> float | None:
    span = tiles[place[0]].spans[place[1]]
    return tiles[place[0]].vegetation.get((span.line_id, span.span_id))


def _choose_winners(
    tiles: Sequence[FoundTile], places: Sequence[Place], same: np.ndarray
) -> dict[int, int]:
    """
    Return which copy of each span is kept: that of the first tile that claims it.

    If its middle lies in no tile (no points there), the first tile that found it keeps it.
    """
    if not places:
        return {}
    middles = np.array([tiles[tile].middles[span] for tile, span in places])
    winners: dict[int, int] = {}
    for k, is_own in enumerate(_claim(tiles, [tile for tile, _ in places], middles).tolist()):
        if is_own:
            winners.setdefault(int(same[k]), k)
    for k in np.flatnonzero(~_find_covered(tiles, middles)).tolist():
        winners.setdefault(int(same[k]), k)
    return winners


def _claim(tiles: Sequence[FoundTile], owners: Sequence[int], places: Float64) -> Bool:
    """Tell which places, each of one tile by its place in the list, that tile claims."""
    claimed = np.zeros(len(places), dtype=bool)
    for own in sorted(set(owners)):
        mine = np.flatnonzero(np.array(owners) == own)
        claimed[mine] = is_within(tiles[own].territory, places[mine])
    return claimed


def _find_covered(tiles: Sequence[FoundTile], places: Float64) -> Bool:
    """Tell the places that lie in any tile."""
    tree = shapely.STRtree(shapely.box(*np.array([tile.territory for tile in tiles]).T))
    at, _ = tree.query(shapely.points(places[:, :2]), predicate='dwithin', distance=2 * MARGIN)
    covered = np.zeros(len(places), dtype=bool)
    covered[at] = True
    return covered


def _unite_numbers(
    tiles: Sequence[FoundTile], places: Sequence[Place], same: np.ndarray, name: str
) -> list[int]:
    """Return a number of the grid for the line, or the span, of each place."""
    node: dict[tuple[int, int], int] = {}
    own = []
    for tile, span in places:
        key = (tile, getattr(tiles[tile].spans[span], name))
        own.append(node.setdefault(key, len(node)))
    first: dict[int, int] = {}
    pairs = []
    for k, cluster in enumerate(same.tolist()):
        other = first.setdefault(cluster, own[k])
        if other != own[k]:
            pairs.append((other, own[k]))
    root = unite(sorted(set(pairs)), len(node))
    return [int(root[item]) for item in own]


def _order_groups(
    spans: Sequence[Span], lines: Sequence[int], groups: Sequence[int]
) -> tuple[list[int], dict[int, Float64]]:
    """Order spans along their routes from the west, and find the end at which each is entered."""
    members: dict[int, list[int]] = {}
    for k, own in enumerate(groups):
        members.setdefault(own, []).append(k)
    meets: dict[int, dict[int, Float64]] = {own: {} for own in members}
    if spans:
        ends = np.array([end[:2] for span in spans for end in (span.start, span.end)])
        for i, j in sorted(cKDTree(ends).query_pairs(MEETING)):
            a, b = i // 2, j // 2
            if lines[a] == lines[b] and groups[a] != groups[b]:
                meets[groups[a]].setdefault(groups[b], (ends[i] + ends[j]) / 2)
                meets[groups[b]].setdefault(groups[a], (ends[i] + ends[j]) / 2)
    centers = {
        own: np.mean([(spans[k].start[:2] + spans[k].end[:2]) / 2 for k in parts], axis=0)
        for own, parts in members.items()
    }

    def place(own: int) -> tuple[float, ...]:
        return tuple(centers[own].tolist())

    order: list[int] = []
    entry: dict[int, Float64] = {}
    for first in sorted(members, key=lambda own: (len(meets[own]) > 1, *place(own))):
        if first in entry:
            continue
        span = spans[members[first][0]]
        sides = sorted((span.start[:2], span.end[:2]), key=lambda end: tuple(end.tolist()))
        nexts = list(meets[first].values())
        entry[first] = sides[0] if not nexts else max(
            sides, key=lambda end: float(np.linalg.norm(end - nexts[0]))
        )
        queue = deque([first])
        while queue:
            own = queue.popleft()
            order.append(own)
            fresh = [other for other in sorted(meets[own], key=place) if other not in entry]
            for other in fresh:
                entry[other] = meets[own][other]
            queue.extend(fresh)
    return order, entry


def _is_turned(span: Span, entry: Float64) -> bool:
    apart = [float(np.linalg.norm(end[:2] - entry)) for end in (span.start, span.end)]
    return apart[1] < apart[0]


def turn_span(span: Span) -> Span:
    """Return a span that runs the other way: its end is its start."""
    (a2, a1, a0), length = span.quadratic, span.length
    return replace(
        span,
        start=span.end,
        end=span.start,
        azimuth=math.remainder(span.azimuth + math.pi, 2 * math.pi),
        b=length - span.b,
        quadratic=(a2, -(2 * a2 * length + a1), a2 * length**2 + a1 * length + a0),
        open_start=span.open_end,
        open_end=span.open_start,
        ground_along=length - span.ground_along,
    )


def _number_lines(
    spans: Sequence[Span], turned: Sequence[bool], lines: Sequence[int], ranks: Sequence[int]
) -> dict[int, int]:
    """Give lines numbers by first span, then by layer from the top, then from left to right."""
    members: dict[int, list[int]] = {}
    for k, rank in enumerate(ranks):
        members.setdefault(rank, []).append(k)
    keys: dict[int, tuple[float, ...]] = {}
    for rank, own in sorted(members.items()):
        middles = np.array([(spans[k].start + spans[k].end) / 2 for k in own])
        ways = np.array([spans[k].azimuth + (math.pi if turned[k] else 0.0) for k in own])
        way = math.atan2(float(np.sin(ways).sum()), float(np.cos(ways).sum()))
        left = middles[:, :2] @ np.array([-math.sin(way), math.cos(way)])
        down = np.argsort(-middles[:, 2], kind='stable')
        layer = np.empty(len(own))
        layer[down] = np.concatenate(
            [[0.0], np.cumsum(np.diff(middles[down, 2]) < -LAYER_GAP).astype(np.float64)]
        )
        for place, k in enumerate(own):
            key = (float(rank), float(layer[place]), -round(float(left[place]), 3))
            keys[lines[k]] = min(keys.get(lines[k], key), key)
    return {old: new for new, old in enumerate(sorted(keys, key=lambda own: keys[own]))}


def _settle_twins(final: dict[int, Span]) -> dict[int, Span]:
    """Move spans that share line and number, which must be unique, to lines of their own."""
    taken: set[SpanKey] = set()
    next_line = 1 + max((span.line_id for span in final.values()), default=-1)
    result = {}
    for k, span in sorted(final.items()):
        own = span
        if (span.line_id, span.span_id) in taken:
            own = replace(span, line_id=next_line)
            next_line += 1
        taken.add((own.line_id, own.span_id))
        result[k] = own
    return result


def _list_numbers(
    tiles: Sequence[FoundTile], places: Sequence[Place], same: np.ndarray,
    winners: dict[int, int], final: dict[int, Span],
) -> tuple[dict[int, dict[SpanKey, SpanKey]], int]:
    """Return for each tile the numbers of its spans in the grid, and how many have none."""
    numbers: dict[int, dict[SpanKey, SpanKey]] = {tile.number: {} for tile in tiles}
    num_unmatched = 0
    for k, (tile, span) in enumerate(places):
        winner = winners.get(int(same[k]))
        if winner is None:
            num_unmatched += 1
            continue
        own, new = tiles[tile].spans[span], final[winner]
        numbers[tiles[tile].number][own.line_id, own.span_id] = (new.line_id, new.span_id)
    return numbers, num_unmatched


def _join_supports(
    tiles: Sequence[FoundTile], every_line: dict[tuple[int, int], int]
) -> tuple[tuple[Support, ...], dict[tuple[int, int], int]]:
    """Return each support once, and the number of each tile's supports in the grid."""
    found = [
        (tile, number, support)
        for tile, own in enumerate(tiles) for number, support in enumerate(own.supports)
    ]
    if not found:
        return (), {}
    plan = np.array([support.position[:2] for *_, support in found])
    pairs = [
        pair for pair in sorted(cKDTree(plan).query_pairs(SAME_SUPPORT))
        if found[pair[0]][0] != found[pair[1]][0]
    ]
    root = unite(pairs, len(found)).tolist()
    kept: dict[int, int] = {}
    for k in np.flatnonzero(_claim(tiles, [tile for tile, *_ in found], plan)).tolist():
        kept.setdefault(root[k], k)
    for k in np.flatnonzero(~_find_covered(tiles, plan)).tolist():
        tile, _, support = found[k]
        if any((tile, line) in every_line for line in support.line_ids):
            kept.setdefault(root[k], k)
    order = sorted(kept, key=lambda own: (
        min([every_line.get((found[kept[own]][0], line), 2**31)
             for line in found[kept[own]][2].line_ids], default=2**31),
        *plan[kept[own]].tolist(),
    ))
    rank = {own: number for number, own in enumerate(order)}
    supports = []
    for own in order:
        tile, _, support = found[kept[own]]
        lines = {every_line[tile, line] for line in support.line_ids if (tile, line) in every_line}
        supports.append(replace(
            support, support_id=rank[own], line_ids=tuple(sorted(lines))
        ))
    numbers = {
        (tile, support.support_id): rank[root[k]]
        for k, (tile, _, support) in enumerate(found) if root[k] in rank
    }
    return tuple(supports), numbers


def _join_hazards(
    tiles: Sequence[FoundTile], final: dict[Place, Span], turned: set[Place],
    every_line: dict[tuple[int, int], int], support_numbers: dict[tuple[int, int], int],
) -> list[tuple[int, Hazard]]:
    """Return the hazards of all spans that were kept, each with the tile of its span."""
    found = []
    for tile, own in enumerate(tiles):
        at = {(span.line_id, span.span_id): k for k, span in enumerate(own.spans)}
        for hazard in own.hazards:
            place = (tile, at[hazard.line_id, hazard.span_id])
            if place not in final:
                continue
            span = final[place]
            along = hazard.along_span
            support = support_numbers.get((tile, hazard.support_id), -1)
            found.append((tile, replace(
                hazard,
                line_id=span.line_id,
                span_id=span.span_id,
                along_span=span.length - along if place in turned else along,
                other_line_id=every_line.get((tile, hazard.other_line_id), -1),
                support_id=support,
                from_support=math.nan if support < 0 else hazard.from_support,
            )))
    found.sort(key=lambda item: (
        item[1].span_id, item[1].line_id, item[1].along_span, item[1].kind,
    ))
    return [(tile, replace(hazard, hazard_id=number))
            for number, (tile, hazard) in enumerate(found)]
