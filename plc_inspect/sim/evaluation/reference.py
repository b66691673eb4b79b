# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Truth as the evaluation reads it: ``truth.json`` or the classes of a labelled cloud."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plc_inspect.errors import DataError
from plc_inspect.offline.readers.json_file import read_json
from plc_inspect.offline.readers.laz import read_classes
from plc_inspect.sim.evaluation.curves import Curve, parse_curve

Float64 = NDArray[np.float64]
UInt8 = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrueSpan:
    """One conductor-span that was there."""

    curve: Curve
    sag: float
    bundle_id: int
    seen: float
    """Share of its length with returns."""
    stretch: tuple[float, float]
    """First and last place seen, from the start [m]; all of it where nothing was seen."""
    min_vegetation_distance: float | None
    min_structure_distance: float | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrueHazard:
    """One place where something was too near."""

    kind: str
    position: Float64
    extent: Float64
    """(2, 3) lower and upper corner [m]."""
    clearance: float
    required: bool
    """Far enough beyond the limit that it must be found."""
    conductors: dict[tuple[int, int], float]
    """Clearance [m] by (line_id, span_id) of the conductors that are near it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Truth:
    """What was there."""

    name: str
    spans: tuple[TrueSpan, ...]
    supports: Float64
    """(S, 3) feet [m]."""
    support_seen: NDArray[np.bool_]
    """(S,) whether the survey came near the support."""
    hazards: tuple[TrueHazard, ...]
    labels: UInt8 | None
    """(N,) ASPRS classes of the input's points, 0 left out; None where unknown."""
    only_labels: bool = False
    """Nothing is known but the classes."""


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
        With the labels of ``map.laz`` where that lies beside a ``truth.json`` of a map.

    Raises
    ------
    DataError
        The file is missing or malformed.

    """
    path = Path(path)
    if path.suffix.lower() in ('.las', '.laz'):
        none = np.zeros((0, 3))
        return Truth(
            name=path.name, spans=(), supports=none, support_seen=np.zeros(0, dtype=bool),
            hazards=(), labels=read_classes(path), only_labels=True,
        )
    path = path / 'truth.json' if path.is_dir() else path
    content = read_json(path)
    cloud = path.parent / 'map.laz'
    labels = read_classes(cloud) if content.get('kind') == 'map' and cloud.is_file() else None
    return parse_truth(content, labels)


def parse_truth(content: Mapping[str, Any], labels: UInt8 | None = None) -> Truth:
    """
    Return the truth that a ``truth.json`` holds.

    Parameters
    ----------
    content : mapping
        The parsed file, or what `plc_inspect.sim.surveys.truth.make_truth` returns.
    labels : ndarray, optional
        (N,) uint8 ASPRS classes of the input's points in input order.

    Returns
    -------
    Truth

    Raises
    ------
    DataError
        A key is missing or holds the wrong kind of value.

    """
    try:
        supports = content['supports']
        return Truth(
            name=str(content.get('scene', '')),
            spans=tuple(_parse_span(row) for row in content['spans']),
            supports=np.array(
                [row['position'] for row in supports], dtype=np.float64,
            ).reshape(-1, 3),
            support_seen=np.array([bool(row.get('seen', True)) for row in supports], dtype=bool),
            hazards=tuple(_parse_hazard(row) for row in content['hazards']),
            labels=labels,
        )
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(f'the truth cannot be read: {error!r}') from error


def _parse_span(row: Mapping[str, Any]) -> TrueSpan:
    curve = parse_curve(row)
    stretch = (float(row.get('seen_from', 0.0)), float(row.get('seen_to', curve.length)))
    if stretch[1] - stretch[0] < 1.0:
        stretch = (0.0, curve.length)
    return TrueSpan(
        curve=curve, sag=float(row['sag']), bundle_id=int(row.get('bundle_id', -1)),
        seen=float(row.get('seen', 1.0)), stretch=stretch,
        min_vegetation_distance=row.get('min_vegetation_distance'),
        min_structure_distance=row.get('min_structure_distance'),
    )


def _parse_hazard(row: Mapping[str, Any]) -> TrueHazard:
    return TrueHazard(
        kind=str(row['kind']), position=np.array(row['position'], dtype=np.float64).reshape(3),
        extent=np.array(row['extent'], dtype=np.float64).reshape(2, 3),
        clearance=float(row['clearance']), required=bool(row.get('required', True)),
        conductors={
            (int(item['line_id']), int(item['span_id'])): float(item['clearance'])
            for item in row.get('conductors', ())
        },
    )
