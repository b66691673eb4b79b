# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Wires told by their shape alone: those along a span, and what is thin and straight by itself.

In the frame of a span (x along it, y across, w above its sag) each wire beside it is a dot that
stays in its place from slab to slab, and wires too close to be told apart are a row; foliage is
neither.
"""

from collections.abc import Sequence

from numba import njit
import numpy as np

from plc_inspect.core.numerics.disjoint_sets import unite
from plc_inspect.core.numerics.grouping import group_cells
from plc_inspect.core.numerics.near_pairs import find_pairs
from plc_inspect.results import Bool, Float64, Int64

TUBE = 0.3
"""
Distance from a wire that was not modelled within which points are of it [m].
Source: derived: three standard deviations of a point of a wire, up to 0.1 m (bench/hazards.py).
"""
GONE_ON = 10.0
"""
Length by which a curve goes on beyond its end, where that is known or the curve is doubtful [m].
Source: judgement; not measured.
"""
SLAB = 2.0
"""Length of the slabs whose cross-sections are looked at [m].  Source: judgement; not measured."""
CELL = 0.2
"""
Edge of the cells of a cross-section; what lies in cells that touch is one thing [m].
Source: derived: a wire scatters over two or three, with a cell left free about it.
"""
WIDEST = 1.0
"""Extent of a dot at most, across or vertically [m].  Source: judgement; a slope of 0.3."""
THIN = 0.12
"""
Standard deviation of the points of a dot about a line at most, across and vertically [m].
Source: chosen on bench/hazards.py.
"""
LINK_LENGTH = 6.0
"""Distance along the line up to which dots are of one wire [m].  Source: judgement."""
LINK = 0.3
"""Distance in the cross-section up to which dots are of one wire [m].  Source: judgement."""
FREE_LENGTH = 4.0
"""
Metres over which a wire must hang free of all else.
Source: chosen on bench/hazards.py.
"""
FREE_SHARE = 0.5
"""Share of its metres over which a wire must hang free.  Source: judgement; not measured."""
CLEARING = 0.8
"""Distance about a free place that is empty [m].  Source: chosen on bench/hazards.py."""
CLUTTER = 0.25
"""
Points about a free place at most, as a share of those on the wire.
Source: judgement; not measured.
"""
FILLED = 0.5
"""
Share of the metres of a wire with others beside it that hold points of it and hang free, at least.
Source: chosen on uniform foliage of 0.3 to 8 points/m3, which fills a third.
"""
ROW = 1.8
"""
Extent of the points of a row of wires at most, across or vertically [m].
Source: derived: four wires of a low-voltage line, 0.4 to 0.5 m apart, and TUBE for their scatter.
"""
ROW_LENGTH = 10.0
"""
Metres over which a row must hang free of all else.
Source: judgement; a strip of a roof or wall is seldom as narrow over as much.
"""
LEVEL = 0.15
"""
Distance above and below a wire, or to either side, within which others hang level or plumb [m].
Source: derived: three standard deviations of a point of a wire, up to 0.05 m.
"""
ROUNDS = 3
"""Rounds of fitting a wire to its dots.  Source: numerical: few change after the second."""
STRAIGHT_LENGTH = 1.5
"""
Length of what is straight at least, by the scatter of the points along it [m].
Source: judgement; twigs that reach out of a crown are of the crown.
"""
LEAST_POINTS = 10
"""Points of what is straight at least.  Source: judgement; a few may lie in line by chance."""
ON_LINE = 0.06
"""
Standard deviation of points about a straight line that they are of, at most, along each axis [m].
Source: derived: twice the noise of the sensor; of three leaves in a metre one in fifty lie so.
"""
SLOPES = np.arange(-25, 26) * 0.02
"""
Slopes of parallel lines against a span that are tried.
Source: derived: half a step is ON_LINE over 6 m; as line_parts.PARALLEL, and more at a support.
"""
LINES_APART = 0.25
"""Distance of parallel lines at least [m].  Source: derived: wires of racks are 0.3 m apart."""
LEAST_ON_LINE, MOST_ON_LINES = 4, 0.9
"""
Points on each of a few parallel lines, and share of all points that are, at least.
Source: measured: of even points as thin one way, a scan line over a crown, 1.5 % of 10 and 0.5 %
of 20 are such by chance, and 78 % of 20 and all of 30 on two to four wires 0.35 m apart.
"""
STEEPEST = 0.7
"""
Vertical part of its direction at most.
Source: derived: 45 degrees; what stands steeper is told by columns.
"""
LENGTH_OF_SIGMA = 3.46
"""
Length of what is even, in standard deviations of its places.
Source: derived: the square root of 12.
"""


def find_wires(places: Float64) -> list[Int64]:
    """
    Find wires that run along a span, and rows of wires too close to be told apart.

    Parameters
    ----------
    places : (K, 3) float64
        Along the span, across it and above its sag [m].

    Returns
    -------
    list of (J,) int64
        The points of each wire or row.

    """
    result = []
    for dots, half, length in _find_dots(places):
        if len(dots) < 2:
            continue
        scale = np.array([LINK / LINK_LENGTH, 1.0, 1.0])
        track = unite(find_pairs(dots * scale, LINK), len(dots))
        _, low, high, _, _ = measure_groups(dots, track)
        for number in np.flatnonzero(high[:, 0] - low[:, 0] >= length - SLAB).tolist():
            own = track == number
            wire = _follow(places, dots[own], np.median(half[own], axis=0), length)
            if wire is not None:
                result.append(wire)
    return result


def tell_thin(points: Float64, thing: Int64) -> tuple[Bool, Bool]:
    """
    Tell the things that are thin, and those that are long and straight beside.

    Parameters
    ----------
    points : (K, 3) float64
        Coordinates [m].
    thing : (K,) int64
        Which of T things each point is of, from 0.

    Returns
    -------
    thin, straight : (T,) bool

    """
    size, variance, axes = _measure_spread(points, thing)
    thin = np.sqrt(variance[:, 1]) <= THIN
    straight = thin & (size >= LEAST_POINTS) & (np.abs(axes[:, 2, 2]) <= STEEPEST)
    straight &= LENGTH_OF_SIGMA * np.sqrt(variance[:, 2]) >= STRAIGHT_LENGTH
    return thin, straight


def are_parallel(places: Float64) -> bool:
    """
    Tell whether points lie on a few parallel lines beside each other, and hardly any between.

    Parameters
    ----------
    places : (J, 3) float64
        Along a span, across it and above its sag [m].

    """
    off = places - places.mean(axis=0)
    wider = off[:, 1:].std(axis=0).argmax() + 1
    # at the slope of the lines most of them lie together
    place = off[:, wider] - SLOPES[:, None] * off[:, :1].T
    cell = np.floor(place / ON_LINE).astype(np.int64)
    together = [int((np.unique(own, return_counts=True)[1] ** 2).sum()) for own in cell]
    best = np.sort(place[int(np.argmax(together))])
    lines = [
        line for line in np.split(best, np.flatnonzero(np.diff(best) > LEVEL) + 1)
        if len(line) >= LEAST_ON_LINE and line.std() <= ON_LINE
    ]
    apart = np.diff([line.mean() for line in lines])
    return (
        float(best[-1] - best[0]) <= ROW and bool((apart >= LINES_APART).all())
        and sum(map(len, lines)) >= MOST_ON_LINES * len(best)
    )


def find_lines(points: Float64, thing: Int64, least: int) -> Bool:
    """
    Tell the things whose points all lie on one straight line, to their noise.

    Few points that do so are of a pole, a stay or a wire: those of foliage do by chance alone.

    Parameters
    ----------
    points : (K, 3) float64
        Coordinates [m].
    thing : (K,) int64
        Which of T things each point is of, from 0.
    least : int
        Points of such a thing at least, more than 2.

    Returns
    -------
    (T,) bool

    """
    size, variance, _ = _measure_spread(points, thing)
    enough = size >= least
    # a line through two points leaves no scatter
    aside = np.sqrt(variance[:, :2].sum(axis=1) * size / np.maximum(size - 2, 1) / 2.0)
    length = LENGTH_OF_SIGMA * np.sqrt(variance[:, 2])
    result: Bool = enough & (aside <= ON_LINE) & (length >= STRAIGHT_LENGTH)
    return result


def _measure_spread(points: Float64, thing: Int64) -> tuple[Int64, Float64, Float64]:
    """Return the size of each thing (T,), its variances (T, 3), ascending, and their axes."""
    size = np.bincount(thing)
    mean = np.column_stack([np.bincount(thing, weights=axis) for axis in points.T]) / size[:, None]
    away = points - mean[thing]
    spread = np.empty((len(size), 3, 3))
    for row in range(3):
        for column in range(3):
            product = away[:, row] * away[:, column]
            spread[:, row, column] = np.bincount(thing, weights=product) / size
    variance, axes = np.linalg.eigh(spread)
    return size, np.maximum(variance, 0.0), axes


@njit(cache=True, nogil=True)
def measure_groups(places, group):  # type: ignore[no-untyped-def]
    """
    Measure G groups of places.

    Returned are (G, 3) means, lower and upper corners, and (G, 2) slopes along the first axis and
    standard deviations about them, across and vertically.
    """
    num = group.max() + 1
    count, mean = np.zeros(num), np.zeros((num, 3))
    low, high = np.full((num, 3), np.inf), np.full((num, 3), -np.inf)
    for i in range(len(places)):
        k = group[i]
        count[k] += 1.0
        for axis in range(3):
            mean[k, axis] += places[i, axis]
            low[k, axis] = min(low[k, axis], places[i, axis])
            high[k, axis] = max(high[k, axis], places[i, axis])
    for k in range(num):
        mean[k] /= count[k]
    square, slope, spread = np.zeros(num), np.zeros((num, 2)), np.zeros((num, 2))
    for i in range(len(places)):
        k = group[i]
        along = places[i, 0] - mean[k, 0]
        square[k] += along * along
        for axis in range(2):
            slope[k, axis] += along * (places[i, axis + 1] - mean[k, axis + 1])
    for k in range(num):
        slope[k] /= max(square[k], CELL * CELL)
    for i in range(len(places)):
        k = group[i]
        for axis in range(2):
            off = places[i, axis + 1] - mean[k, axis + 1]
            off -= slope[k, axis] * (places[i, 0] - mean[k, 0])
            spread[k, axis] += off * off
    for k in range(num):
        spread[k] = np.sqrt(spread[k] / count[k])
    return mean, low, high, slope, spread


def _find_dots(places: Float64) -> list[tuple[Float64, Float64, float]]:
    """
    Find what is small in the cross-section of a slab: dots, and rows that are thin one way.

    Returned are (D, 3) middles, (D, 2) half widths that are more than those of a wire, and the
    length over which such must hang free.
    """
    own = group_cells(places, np.array([SLAB, CELL, CELL]), across=True)
    mean, low, high, _, spread = measure_groups(places, own)
    extent = (high - low)[:, 1:]
    thin = (extent <= WIDEST).all(axis=1) & (spread <= THIN).all(axis=1)
    row = ~thin & (extent <= ROW).all(axis=1) & (spread <= THIN).any(axis=1)
    middle = np.column_stack([mean[:, 0], 0.5 * (low + high)[:, 1:]])
    half = np.where(spread > THIN, 0.5 * extent, 0.0)
    return [(mean[thin], np.zeros((int(thin.sum()), 2)), FREE_LENGTH),
            (middle[row], half[row], ROW_LENGTH)]


def _follow(places: Float64, dots: Float64, half: Float64, length: float) -> Int64 | None:
    """Return the points of a wire, or a row of some half widths, through dots, None if none."""
    kept = dots
    for _ in range(ROUNDS):
        if len(kept) < 2 or np.ptp(kept[:, 0]) < length - SLAB:
            return None
        middle, degree = kept[:, 0].mean(), 2 if np.ptp(kept[:, 0]) > LINK_LENGTH else 1
        curve = [np.polynomial.polynomial.polyfit(kept[:, 0] - middle, axis, degree)
                 for axis in kept[:, 1:].T]
        kept = dots[np.hypot(*_measure(dots, curve, middle).T) <= TUBE]
    low, high = kept[:, 0].min() - SLAB / 2, kept[:, 0].max() + SLAB / 2
    about = np.flatnonzero((places[:, 0] >= low) & (places[:, 0] <= high))
    off = np.maximum(_measure(places[about], curve, middle) - half, 0.0)
    metre = (places[about, 0] - low).astype(np.int64)
    for beside in (False, True):
        free, share = find_free(metre, off, TUBE, beside=beside)
        if free.sum() >= length and share >= FREE_SHARE:
            break
    else:
        return None
    if beside and free.sum() < FILLED * (high - low):
        return None
    beyond = min(GONE_ON, high - low)
    about = np.flatnonzero((places[:, 0] >= low - beyond) & (places[:, 0] <= high + beyond))
    off = np.maximum(_measure(places[about], curve, middle) - half, 0.0)
    return about[np.hypot(*off.T) <= TUBE]


def find_free(
    metre: Int64, off: Float64, tube: Float64 | float, *, most: float = CLUTTER,
    beside: bool = False, fuller: bool = False,
) -> tuple[Bool, float]:
    """
    Find the metres over which a wire hangs free of all else.

    Parameters
    ----------
    metre : (K,) int64
        Where along the wire points are, from 0 [m].
    off : (K, 2) float64
        How far from it, across and vertically; with signs where the fuller side counts [m].
    tube : (K,) float64 or float
        Distance up to which points are on the wire [m].  A wider one holds the more of a surface,
        so what is about it counts in proportion.
    most : float
        Points about it at most, as a share of those on it.
    beside : bool
        Others may hang level with it, or plumb above and below it; foliage is all around.
    fuller : bool
        What is about it counts as twice that on its fuller side: at an edge, half is missing.

    Returns
    -------
    free : (M,) bool
        Metres that hold points of the wire and hardly any beside.
    share : float
        Of the metres that hold points of the wire, 0 where none do.

    """
    away, num = np.hypot(*off.T), int(metre.max(initial=-1)) + 1
    on = np.bincount(metre[away <= tube], minlength=num)
    clutter = np.flatnonzero((away > tube) & (away <= tube + CLEARING - TUBE))
    where, axes = metre[clutter], off[clutter].T
    weight = np.broadcast_to(tube / TUBE, len(metre))[clutter]
    if fuller:
        sides = [side * axis > 0.0 for axis in axes for side in (-1.0, 1.0)]
    else:
        level = (tube + LEVEL - TUBE) if beside else -1.0
        sides = [np.abs(axis) > level for axis in axes]
    counts = [np.bincount(where[side], weight[side], minlength=num) for side in sides]
    about = 2.0 * np.max(counts, axis=0) if fuller else np.min(counts, axis=0)
    free = (on > 0) & (about <= most * on)
    return free, float(free.sum() / max((on > 0).sum(), 1))


def _measure(places: Float64, curve: Sequence[Float64], middle: float) -> Float64:
    """Return (K, 2) how far places lie from a curve, across and vertically [m]."""
    x = places[:, 0] - middle
    result: Float64 = np.abs(places[:, 1:] - np.column_stack([
        np.polynomial.polynomial.polyval(x, axis) for axis in curve
    ]))
    return result
