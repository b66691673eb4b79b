# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Truth for the evaluation: from ``truth.json``, or the classes of a labelled cloud."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plc_inspect.errors import DataError
from plc_inspect.offline.readers.laz import read_labelled
from plc_inspect.offline.readers.wire_truth import read_truth_file
from plc_inspect.sim.evaluation.curves import Curve, parse_curve

Float64 = NDArray[np.float64]
UInt8 = NDArray[np.uint8]

LEAST_STRETCH = 1.0
"""Least length of a stretch over which a span is compared, otherwise the whole span is [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrueSpan:
    """One true conductor-span."""

    curve: Curve
    sag: float
    bundle_id: int
    seen: float
    """Share of its length with returns."""
    stretch: tuple[float, float]
    """First and last x with returns [m]; the whole span if there are none."""
    min_vegetation_distance: float | None
    min_structure_distance: float | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrueHazard:
    """One true hazard."""

    kind: str
    position: Float64
    extent: Float64
    """(2, 3) lower and upper corner [m]."""
    clearance: float
    required: bool
    """Whether it is clearly a hazard, and must be found."""
    conductors: dict[tuple[int, int], float]
    """Clearance [m] of the conductors near it, by (line_id, span_id)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Truth:
    """The truth of one survey."""

    name: str
    spans: tuple[TrueSpan, ...]
    supports: Float64
    """(S, 3) feet [m]."""
    support_seen: NDArray[np.bool_]
    """(S,) whether the survey came near the support."""
    hazards: tuple[TrueHazard, ...]
    labels: UInt8 | None
    """(N,) ASPRS classes of the input's points, 0 for points left out; None if unknown."""
    places: Float64 | None = None
    """(N, 3) coordinates of these points, in any unit; None where they are not compared."""
    only_labels: bool = False
    """Whether only the classes are known."""


def read_truth(path: Path) -> Truth:
    """
    Read the truth of a survey.

    Parameters
    ----------
    path : Path
        A ``truth.json``, a folder that holds one, or a labelled LAS or LAZ file.

    Returns
    -------
    Truth
        With the labels of ``map.laz`` if that lies beside the ``truth.json`` of a map.

    Raises
    ------
    DataError
        The file is missing or malformed.

    """
    path = Path(path)
    if path.suffix.lower() in ('.las', '.laz'):
        none = np.zeros((0, 3))
        labels, places = read_labelled(path)
        return Truth(
            name=path.name, spans=(), supports=none, support_seen=np.zeros(0, dtype=bool),
            hazards=(), labels=labels, places=places, only_labels=True,
        )
    content, cloud = read_truth_file(path)
    if cloud is None:
        return parse_truth(content)
    labels, places = read_labelled(cloud)
    return replace(parse_truth(content, labels), places=places)


def parse_truth(content: Mapping[str, Any], labels: UInt8 | None = None) -> Truth:
    """
    Return the truth that a ``truth.json`` holds.

    Parameters
    ----------
    content : mapping
        The parsed file, or the result of `plc_inspect.sim.surveys.truth.make_truth`.
    labels : ndarray, optional
        (N,) uint8 ASPRS classes of the input's points in input order.

    Returns
    -------
    Truth

    Raises
    ------
    DataError
        A key is missing or has a value of the wrong kind.

    """
    try:
        supports = content['supports']
        return Truth(
            name=str(content.get('scene', '')),
            spans=tuple(_parse_span(row) for row in content['spans']),
            supports=_places([row['position'] for row in supports], (-1, 3)),
            support_seen=np.array([bool(row.get('seen', True)) for row in supports], dtype=bool),
            hazards=tuple(_parse_hazard(row) for row in content['hazards']),
            labels=labels,
        )
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        raise DataError(f'the truth cannot be read: {error!r}') from error


def _parse_span(row: Mapping[str, Any]) -> TrueSpan:
    curve = parse_curve(row)
    stretch = (
        max(_number(row.get('seen_from', 0.0)), 0.0),
        min(_number(row.get('seen_to', curve.length)), curve.length),
    )
    if stretch[1] - stretch[0] < LEAST_STRETCH:
        stretch = (0.0, curve.length)
    return TrueSpan(
        curve=curve, sag=_number(row['sag']), bundle_id=int(row.get('bundle_id', -1)),
        seen=_number(row.get('seen', 1.0)), stretch=stretch,
        min_vegetation_distance=_number_or_none(row.get('min_vegetation_distance')),
        min_structure_distance=_number_or_none(row.get('min_structure_distance')),
    )


def _number(value: Any) -> float:
    """Return a finite number; TypeError or ValueError for all else."""
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f'{value} is no number')
    return number


def _number_or_none(value: Any) -> float | None:
    return None if value is None else _number(value)


def _places(value: Any, shape: tuple[int, ...]) -> Float64:
    """Return finite coordinates; TypeError or ValueError for all else."""
    places = np.array(value, dtype=np.float64).reshape(shape)
    if not np.isfinite(places).all():
        raise ValueError(f'{value} is no place')
    return places


def _parse_hazard(row: Mapping[str, Any]) -> TrueHazard:
    return TrueHazard(
        kind=str(row['kind']), position=_places(row['position'], (3,)),
        extent=_places(row['extent'], (2, 3)), clearance=_number(row['clearance']),
        required=bool(row.get('required', True)),
        conductors={
            (int(item['line_id']), int(item['span_id'])): float(item['clearance'])
            for item in row.get('conductors', ())
        },
    )
