# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Results of the pipeline as the evaluation takes them, from a folder or from memory."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from plc_inspect.errors import DataError
from plc_inspect.offline.records.results_reader import (
    parse_hazard,
    parse_span,
    parse_units,
    read_points,
    read_table,
    understanding,
)
from plc_inspect.results import Hazard, InspectionResult, Span
from plc_inspect.sim.evaluation.curves import check_curve, Curve, from_span

Float64 = NDArray[np.float64]
UInt8 = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FoundSpan:
    """One estimated conductor-span."""

    curve: Curve
    sag: float
    open_ended: bool
    """Whether an end is only the last point seen."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FoundHazard:
    """One reported hazard."""

    kind: str
    line_id: int
    span_id: int
    position: Float64
    clearance: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Survey:
    """The results that are evaluated."""

    spans: tuple[FoundSpan, ...]
    supports: Float64
    """(S, 3) feet [m]."""
    hazards: tuple[FoundHazard, ...]
    points: Float64
    """(N, 3) all points [m]; rows may be NaN."""
    classification: UInt8
    """(N,) ASPRS classes by the pipeline."""
    clearance: Float64
    """(N,) distance to the nearest conductor [m], NaN beyond the corridor."""


def from_result(result: InspectionResult, points: Float64) -> Survey:
    """
    Return the survey of a result in memory.

    Parameters
    ----------
    result : InspectionResult
        Of the cloud ``points``.
    points : ndarray
        (N, 3) float64, the pipeline's input [m].

    Returns
    -------
    Survey

    Raises
    ------
    DataError
        The result has another number of points.

    """
    if len(points) != result.num_points:
        raise DataError(f'a result of {result.num_points} points for a cloud of {len(points)}')
    return Survey(
        spans=tuple(_describe_span(item) for item in result.spans),
        supports=np.array([item.position for item in result.supports]).reshape(-1, 3),
        hazards=tuple(_describe_hazard(item) for item in result.hazards),
        points=points, classification=result.classification,
        clearance=result.clearance.astype(np.float64),
    )


def read_survey(folder: Path) -> Survey:
    """
    Read a results folder, in metres.

    Raises
    ------
    DataError
        The folder or one of its files is missing or malformed.

    """
    folder = Path(folder)
    spans, supports, hazards = (
        read_table(folder, name) for name in ('spans', 'supports', 'hazards')
    )
    las, points = read_points(folder, 'clearance')
    with understanding(folder / 'spans.json'):
        units = parse_units(spans['metres_per_unit'])
        found = [parse_span(row, units) for row in spans['spans']]
    with understanding(folder / 'supports.json'):
        feet = [np.array(row['position'], dtype=np.float64) for row in supports['supports']]
        places = units.to_metres(np.array(feet).reshape(-1, 3))
    with understanding(folder / 'hazards.json'):
        raised = [parse_hazard(row, units) for row in hazards['hazards']]
    return Survey(
        spans=tuple(_describe_span(item) for item in found), supports=places,
        hazards=tuple(_describe_hazard(item) for item in raised), points=units.to_metres(points),
        classification=np.array(las.classification, dtype=np.uint8),
        clearance=np.array(las['clearance'], dtype=np.float64),
    )


def _describe_span(span: Span) -> FoundSpan:
    return FoundSpan(
        curve=check_curve(from_span(span)), sag=span.sag,
        open_ended=span.open_start or span.open_end,
    )


def _describe_hazard(hazard: Hazard) -> FoundHazard:
    return FoundHazard(
        kind=hazard.kind.name.lower(), line_id=hazard.line_id, span_id=hazard.span_id,
        position=hazard.position, clearance=hazard.clearance,
    )
