# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Labels each point with class, decision, clearance and span."""

from collections.abc import Sequence
from dataclasses import dataclass

from numba import njit, prange
import numpy as np

from plc_inspect.core.corridor import CorridorResult
from plc_inspect.core.hazards.encroachments import Nearby
from plc_inspect.core.line_finder import FoundLines
from plc_inspect.core.numerics.arrays import find_true, take_found
from plc_inspect.core.numerics.hash_table import enter, find_slot, make_table
from plc_inspect.core.numerics.voxels import pack
from plc_inspect.core.spans.span_model import SpanModel
from plc_inspect.core.spans.spans import SpanResult
from plc_inspect.results import (
    Bool,
    Decision,
    Float32,
    Int32,
    PointClass,
    UInt8,
)

NOT_FINITE = np.uint8(Decision.NOT_FINITE)
GROUND = np.uint8(Decision.GROUND)
TOO_LOW = np.uint8(Decision.TOO_LOW)
NOT_LINEAR = np.uint8(Decision.NOT_LINEAR)
NO_CATENARY = np.uint8(Decision.NO_CATENARY)
WIRE = np.uint8(Decision.WIRE)
SUPPORT = np.uint8(Decision.SUPPORT)
"""Decisions as the kernels know them."""
CLASS_OTHER = np.uint8(PointClass.OTHER)
CLASS_GROUND = np.uint8(PointClass.GROUND)
CLASS_WIRE = np.uint8(PointClass.WIRE)
CLASS_TOWER = np.uint8(PointClass.TOWER)
CLASS_VEGETATION = np.uint8(PointClass.VEGETATION)
GROUND_BAND = 0.5
"""Height up to which points are ground [m].  Source: judgement; not measured."""
FAR_BELOW = -2.0
"""Height down to which points are ground [m].  Source: judgement; not measured."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Labels:
    """What N points are, and why."""

    classification: UInt8
    """(N,) PointClass."""
    decision: UInt8
    """(N,) Decision."""
    clearance: Float32
    """(N,) distance to the nearest conductor [m], NaN beyond the corridor."""
    span_id: Int32
    """(N,) span of wire and corridor points, -1 elsewhere."""
    corridor_line_id: Int32
    """(K,) nearest conductor of each corridor point; of a wire point, its own."""
    corridor_span_id: Int32
    """(K,) its span."""


def choose_surroundings(
    height: Float32, spans: SpanResult, corridor: CorridorResult
) -> Nearby:
    """
    Find the surroundings: points close to conductors that are objects of their own.

    Parameters
    ----------
    height : (N,) float32
        Above local ground [m], NaN unknown.
    spans : SpanResult
        Knows wire and support points.
    corridor : CorridorResult
        Knows the J points near the conductors.

    Returns
    -------
    Nearby
        Those of the J points that are off the ground, neither wire nor support, and not on a
        conductor.

    """
    around = find_true(_are_around(corridor.near, height, spans.line_id, spans.support))
    near, distance, span = take_found(
        around, corridor.near, corridor.near_distance, corridor.near_span
    )
    if len(spans.intruders):
        free = ~np.isin(near, spans.intruders)
        near, distance, span = near[free], distance[free], span[free]
    return Nearby(
        index=near, distance=distance.astype(np.float64), span=span.astype(np.int64)
    )


def label(lines: FoundLines, corridor: CorridorResult, nearby: Nearby, foliage: Bool) -> Labels:
    """
    Tell what each point is and which stage decided it.

    A high point that is neither wire nor support shares the fate of the best candidate in its
    cell of a metre.

    Parameters
    ----------
    lines : FoundLines
        What the stages up to the supports found.
    corridor : CorridorResult
        What is near the conductors.
    nearby : Nearby
        J surroundings of the conductors.
    foliage : (J,) bool
        Which of them are vegetation.

    Returns
    -------
    Labels

    """
    height, cloud, candidates, spans = lines.height, lines.cloud, lines.candidates, lines.spans
    outliers, alignment, near = lines.outliers, lines.alignment, nearby.index
    in_segments = lines.clustering.segments.points
    state = np.full(len(candidates.position), Decision.OUTLIER, dtype=np.uint8)
    state[np.flatnonzero(outliers.keep)] = np.where(
        alignment.voted, Decision.NO_CLUSTER, Decision.NO_SECTION
    )
    num = len(height.height)
    # made here and not in the kernels, as numpy asks for large pages of memory
    decision, classification = np.empty(num, dtype=np.uint8), np.empty(num, dtype=np.uint8)
    origin, table, keys, values = _index_states(candidates.position, state)
    used = len(cloud.high) > 0  # too few are not
    _settle(
        height.height, height.high, used, spans.line_id, spans.support, decision, classification
    )
    _settle_high(
        cloud.points, cloud.high, cloud.place, spans.line_id, spans.support,
        origin, table, keys, values, decision,
    )
    _put_foliage(near, foliage, classification)
    _settle_segments(cloud.place[in_segments], spans.line_id, spans.support, decision)
    clearance, span_id = np.empty(num, dtype=np.float32), np.empty(num, dtype=np.int32)
    corridor_line_id, corridor_span_id = np.empty((2, len(corridor.points)), dtype=np.int32)
    _spread(
        corridor.points, corridor.distance, corridor.span, spans.line_id, spans.span_id,
        *_ids(spans.models), clearance, span_id, corridor_line_id, corridor_span_id,
    )
    return Labels(
        classification=classification,
        decision=decision,
        clearance=clearance,
        span_id=span_id,
        corridor_line_id=corridor_line_id,
        corridor_span_id=corridor_span_id,
    )


def _ids(models: Sequence[SpanModel]) -> tuple[Int32, Int32]:
    return (
        np.array([model.span.line_id for model in models], dtype=np.int32),
        np.array([model.span.span_id for model in models], dtype=np.int32),
    )


@njit(cache=True, parallel=True, nogil=True)
def _are_around(near, height, line_id, support):  # type: ignore[no-untyped-def]
    """Tell which of some points are surroundings."""
    result = np.empty(len(near), dtype=np.bool_)
    for k in prange(len(near)):
        i = near[k]
        result[k] = (not (height[i] < GROUND_BAND)) & (line_id[i] < 0) & (not support[i])
    return result


@njit(cache=True, nogil=True)
def _put_foliage(near, foliage, classification):  # type: ignore[no-untyped-def]
    for k in range(len(near)):
        if foliage[k]:
            classification[near[k]] = CLASS_VEGETATION


@njit(cache=True, nogil=True)
def _index_states(position, state):  # type: ignore[no-untyped-def]
    """Return the greatest state of the candidates in each cell of a metre, as a hash table."""
    origin = np.full(3, np.inf)
    for k in range(len(position)):
        for axis in range(3):
            origin[axis] = min(origin[axis], position[k, axis])
    origin = np.floor(origin) - 1.0
    table = make_table(len(position))
    keys = np.empty(len(position), dtype=np.int64)
    values = np.zeros(len(position), dtype=np.uint8)
    num = 0
    for k in range(len(position)):
        key = pack(
            int(position[k, 0] - origin[0]),
            int(position[k, 1] - origin[1]),
            int(position[k, 2] - origin[2]),
        )
        slot = find_slot(key, table, keys)
        if slot < 0:
            slot = num
            num += 1
            keys[slot] = key
            enter(key, slot, table)
        values[slot] = max(values[slot], state[k])
    return origin, table, keys, values


@njit(cache=True, nogil=True, inline='always')
def _find_state(x, y, z, table, keys, values):  # type: ignore[no-untyped-def]
    """Return the state of the cell of a position, relative to the origin."""
    if not (x >= 0.0 and y >= 0.0 and z >= 0.0):
        return NOT_LINEAR
    slot = find_slot(pack(int(x), int(y), int(z)), table, keys)
    return values[slot] if slot >= 0 else NOT_LINEAR


@njit(cache=True, parallel=True, nogil=True)
def _settle(  # type: ignore[no-untyped-def]
    height, high, used, line_id, support, decision, classification
):
    """
    Set decision and class of each point by its height, wires and supports.

    Without branches, so that the compiler makes vector instructions.  High points that were
    searched are not linear, unless `_settle_high` finds more.
    """
    for i in prange(len(height)):
        above = height[i]
        settled = GROUND if above < GROUND_BAND else TOO_LOW
        settled = NOT_FINITE if np.isnan(above) & (not high[i]) else settled
        settled = NOT_LINEAR if high[i] & used else settled
        settled = SUPPORT if support[i] else settled
        kind = CLASS_GROUND if (above < GROUND_BAND) & (above >= FAR_BELOW) else CLASS_OTHER
        kind = CLASS_TOWER if support[i] else kind
        decision[i] = WIRE if line_id[i] >= 0 else settled
        classification[i] = CLASS_WIRE if line_id[i] >= 0 else kind


@njit(cache=True, parallel=True, nogil=True)
def _settle_high(  # type: ignore[no-untyped-def]
    points, high, place, line_id, support, origin, table, keys, values, decision
):
    """Set the decision of high points with candidates in their cells."""
    for k in prange(len(high)):
        m = high[k]
        state = _find_state(
            points[m, 0] - origin[0], points[m, 1] - origin[1], points[m, 2] - origin[2],
            table, keys, values,
        )
        if state != NOT_LINEAR and line_id[place[m]] < 0 and not support[place[m]]:
            decision[place[m]] = state


@njit(cache=True, nogil=True)
def _settle_segments(in_segments, line_id, support, decision):  # type: ignore[no-untyped-def]
    for i in in_segments:
        if line_id[i] < 0 and not support[i]:
            decision[i] = NO_CATENARY


@njit(cache=True, parallel=True, nogil=True)
def _spread(  # type: ignore[no-untyped-def]
    corridor, distance, owner, line_id, span_id, lines, spans,
    clearance, result, own_line, own_span,
):
    """Set clearance and span of each point, line and span of each corridor point."""
    for i in prange(len(line_id)):
        clearance[i] = np.nan
        result[i] = span_id[i]
    for k in prange(len(corridor)):
        i, s = corridor[k], owner[k]
        clearance[i] = distance[k]
        if line_id[i] >= 0:
            own_line[k], own_span[k] = line_id[i], span_id[i]
        else:
            own_line[k], own_span[k] = lines[s], spans[s]
            result[i] = spans[s]
