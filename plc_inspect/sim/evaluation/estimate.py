# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Results of the pipeline as the evaluation takes them, from a folder or from memory."""

from collections.abc import Mapping
from dataclasses import dataclass
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plc_inspect.errors import DataError
from plc_inspect.offline.records.results_reader import read_points, read_table
from plc_inspect.results import InspectionResult
from plc_inspect.sim.evaluation.curves import Curve, from_span, parse_curve

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
        spans=tuple(
            FoundSpan(curve=from_span(item), sag=item.sag,
                      open_ended=item.open_start or item.open_end)
            for item in result.spans
        ),
        supports=np.array([item.position for item in result.supports]).reshape(-1, 3),
        hazards=tuple(
            FoundHazard(
                kind=item.kind.name.lower(), line_id=item.line_id, span_id=item.span_id,
                position=item.position, clearance=item.clearance,
            )
            for item in result.hazards
        ),
        points=points, classification=result.classification,
        clearance=result.clearance.astype(np.float64),
    )


def read_survey(folder: Path) -> Survey:
    """
    Read a results folder, in its units.

    Raises
    ------
    DataError
        The folder or one of its files is missing or malformed.

    """
    folder = Path(folder)
    spans, supports, hazards = (
        read_table(folder, name)[name] for name in ('spans', 'supports', 'hazards')
    )
    las, points = read_points(folder, 'clearance')
    return Survey(
        spans=tuple(
            FoundSpan(
                curve=parse_curve(row), sag=_get_number(row, 'sag'),
                open_ended=bool(row.get('open_start')) or bool(row.get('open_end')),
            )
            for row in spans
        ),
        supports=np.array([_get_place(row) for row in supports]).reshape(-1, 3),
        hazards=tuple(
            FoundHazard(
                kind=str(row.get('kind')), line_id=int(row.get('line_id', -1)),
                span_id=int(row.get('span_id', -1)), position=_get_place(row),
                clearance=_get_number(row, 'clearance'),
            )
            for row in hazards
        ),
        points=points, classification=np.array(las.classification, dtype=np.uint8),
        clearance=np.array(las['clearance'], dtype=np.float64),
    )


def _get_number(row: Mapping[str, Any], key: str) -> float:
    value = row.get(key)
    return float(value) if isinstance(value, int | float) else math.nan


def _get_place(row: Mapping[str, Any]) -> Float64:
    try:
        place = np.array(row['position'], dtype=np.float64).reshape(3)
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(f'a position cannot be read: {error!r}') from error
    return place
