# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Match spans that two tiles both found in the overlap of their halos."""

from collections.abc import Sequence
import math

import numpy as np
import shapely

from plc_inspect.core.numerics.disjoint_sets import unite
from plc_inspect.grid.tiles.plain_results import FoundTile
from plc_inspect.results import Int64, Span

MOST_MISS = 0.15
"""
Greatest distance between two curves of one conductor [m].
Source: judgement: half the least distance of sub-conductors; the same points give 1e-9 m.
"""
LEAST_COMMON = 0.5
"""Least share of the shorter span that both must cover.  Source: judgement."""
STATIONS = (0.1, 0.5, 0.9)
"""
Positions in the common part at which two curves are compared, as shares of it.
Source: judgement.
"""

Place = tuple[int, int]
"""Tile, by its place in a list, and span of it."""


def list_places(tiles: Sequence[FoundTile]) -> list[Place]:
    """Return all spans of all tiles."""
    return [(tile, span) for tile, found in enumerate(tiles) for span in range(len(found.spans))]


def match_spans(tiles: Sequence[FoundTile], places: Sequence[Place]) -> Int64:
    """
    Group the spans of different tiles that are one span.

    Parameters
    ----------
    tiles : sequence of FoundTile
        What was found in each.
    places : sequence of tuple
        Of `list_places`.

    Returns
    -------
    (len(places),) int64
        Group of each span; spans that are one share a group.

    """
    if not places:
        return np.zeros(0, dtype=np.int64)
    spans = [tiles[tile].spans[span] for tile, span in places]
    chords = shapely.linestrings([[span.start[:2], span.end[:2]] for span in spans])
    tree = shapely.STRtree(chords)
    best: dict[tuple[int, int], tuple[float, int]] = {}
    for first, second in tree.query(chords, predicate='dwithin', distance=MOST_MISS).T.tolist():
        own, other = places[first][0], places[second][0]
        if own == other:
            continue
        miss = measure_miss(spans[first], spans[second])
        if miss is None:
            continue
        for key, value in (((first, other), (miss, second)), ((second, own), (miss, first))):
            best[key] = min(best.get(key, value), value)
    pairs = [
        (first, second) for (first, _), (_, second) in best.items()
        if best.get((second, places[first][0]), (0.0, -1))[1] == first
    ]
    result: Int64 = np.asarray(unite(sorted(pairs), len(places)), dtype=np.int64)
    return result


def measure_miss(first: Span, second: Span) -> float | None:
    """
    Return the distance of two spans over their common part, None if they are not one.

    Parameters
    ----------
    first, second : Span
        In one frame.

    Returns
    -------
    float or None
        [m]

    """
    unit = (first.end - first.start)[:2] / max(first.length, 1e-9)
    ends = [float((end[:2] - first.start[:2]) @ unit) for end in (second.start, second.end)]
    low, high = max(min(ends), 0.0), min(max(ends), first.length)
    if high - low < LEAST_COMMON * min(first.length, second.length):
        return None
    other = (second.end - second.start)[:2] / max(second.length, 1e-9)
    worst = 0.0
    for share in STATIONS:
        x = low + share * (high - low)
        at = first.start[:2] + x * unit
        apart = at - second.start[:2]
        along = float(apart @ other)
        across = float(apart[0] * other[1] - apart[1] * other[0])
        rise = float(first.heights(np.array([x]))[0] - second.heights(np.array([along]))[0])
        worst = max(worst, math.hypot(across, rise))
    return worst if worst <= MOST_MISS else None
