# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""One finished run, and its plain records in units of the input."""

from collections.abc import Mapping
from dataclasses import dataclass, field
import math
from typing import Any, TYPE_CHECKING

import laspy
import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.hazards.clearance_rules import RuleSet
from plc_inspect.core.loads.load_cases import WhatIf
from plc_inspect.offline.records.sentences import describe_place
from plc_inspect.offline.records.units import Record, Units
from plc_inspect.results import (
    Float64,
    Hazard,
    InspectionResult,
    PointClass,
    Span,
    Support,
)

if TYPE_CHECKING:
    from plc_inspect.offline.records.change_list import Changes

@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Inspection:
    """Input, processing and result of a run: all that a results folder needs."""

    result: InspectionResult
    points: Float64
    """(N, 3) the pipeline's input [m]; rows may hold NaN."""
    settings: Settings
    source: str
    """Name of the input, as the user gave it."""
    command: str
    """Name of the executable."""
    frame_id: str = ''
    """Frame of the coordinates; empty for a cloud, whose frame is its CRS."""
    crs: str = ''
    """WKT of the coordinates; empty where it is unknown."""
    units: Units = field(default_factory=Units)
    las: laspy.LasData | None = None
    """The points as read, in the same order; None if they are not from a LAS file."""
    georeference: str = ''
    """WKT of the frame of a flight with a known origin; unused if ``crs`` is given."""
    altitude: float = 0.0
    """Height of the frame's z = 0 above sea level [m], for a flight whose origin is known."""
    rules: RuleSet | None = None
    """The clearance rules, None for the plain ones of the settings."""
    what_if: WhatIf | None = None
    """All spans in other load cases, None if none was requested."""
    changes: 'Changes | None' = None
    """Changes since an earlier survey, None without one."""
    checksum: str = ''
    """SHA-256 of the input, hexadecimal; empty if it is not a file."""
    way: Float64 | None = None
    """(K, 4) time [s] and position [m] of the vehicle along its path, None unknown."""
    earlier: tuple['Inspection', ...] = ()
    """Of a flight, the maps that ended before its last one did."""
    counts: Mapping[str, Any] = field(default_factory=dict)
    """Counts of the reader: read and dropped, JSON-serialisable."""
    seconds: Mapping[str, float] = field(default_factory=dict)
    """Wall time of the steps around the pipeline."""


def describe_coarse_ground(inspection: Inspection) -> str:
    """Say that the ground is coarser than was set, as the cloud is too wide; '' if it is not."""
    wanted = inspection.settings.height.cell_size
    cell = max(
        (stage.values.get('cell_size', 0.0) for stage in inspection.result.stages), default=0.0
    )
    return '' if cell <= wanted else (
        'the points cover so much, or lie so far apart, that the ground has cells of'
        f' {cell:.1f} m in place of {wanted:g} m: heights above it and hazards may be missing or'
        ' wrong; survey such a cloud in tiles, as by plc_survey with --tile 2000'
    )


def describe_span(span: Span, units: Units) -> Record:
    """
    Return one span as ``spans.json`` holds it.

    Lengths and coordinates are in ``units``, azimuth in radians.
    """
    scale = units.horizontal
    a2, a1, a0 = span.quadratic
    return {
        'line_id': span.line_id,
        'span_id': span.span_id,
        'start': _list(units.from_metres(span.start)),
        'end': _list(units.from_metres(span.end)),
        'azimuth': _number(span.azimuth),
        'length': _number(span.length / scale),
        'a': _number(span.a / scale),
        'b': _number(span.b / scale),
        'c': _number(span.c / scale),
        'quadratic': [_number(a2 * scale), _number(a1), _number(a0 / scale)],
        'sag': _number(span.sag / scale),
        'lowest': _list(units.from_metres(span.lowest)),
        'open_start': bool(span.open_start),
        'open_end': bool(span.open_end),
        'rmse': _number(span.rmse / scale),
        'num_points': int(span.num_points),
        'coverage': _number(span.coverage),
        'sigma': {
            name: _number(span.sigma.get(name, math.nan) / scale)
            for name in ('a', 'b', 'c', 'sag')
        },
        'ground_clearance': _number(span.ground_clearance / scale),
        'ground_along': _number(span.ground_along / scale),
        'evidence': _number(span.evidence / scale),
    }


def describe_support(support: Support, units: Units) -> Record:
    """Return one support as ``supports.json`` holds it."""
    return {
        'support_id': support.support_id,
        'position': _list(units.from_metres(support.position)),
        'height': _number(support.height / units.vertical),
        'kind': support.kind,
        'lines': [int(line_id) for line_id in support.line_ids],
    }


def describe_hazard(hazard: Hazard, units: Units) -> Record:
    """
    Return one hazard as ``hazards.json`` holds it.

    ``kind`` and ``severity`` are the lower-case names of ``HazardKind`` and ``Severity``; ``text``
    is a sentence with all of it, in the horizontal unit.
    """
    scale = units.horizontal
    record: Record = {
        'hazard_id': hazard.hazard_id,
        'line_id': hazard.line_id,
        'span_id': hazard.span_id,
        'kind': hazard.kind.name.lower(),
        'severity': hazard.severity.name.lower(),
        'position': _list(units.from_metres(hazard.position)),
        'clearance': _number(hazard.clearance / scale),
        'required': _number(hazard.required / scale),
        'horizontal': _number(hazard.horizontal / scale),
        'vertical': _number(hazard.vertical / scale),
        'sigma': _number(hazard.sigma / scale),
        'along_span': _number(hazard.along_span / scale),
        'num_points': int(hazard.num_points),
        'extent': [_list(corner) for corner in units.from_metres(hazard.extent)],
        'rule': hazard.rule,
        'edition': hazard.edition,
        'source': hazard.source,
        'voltage': hazard.voltage,
        'other_line_id': hazard.other_line_id,
        'support_id': hazard.support_id,
        'from_support': _number(hazard.from_support / scale),
        'height': _number(hazard.height / units.vertical),
        'years': _number(hazard.years),
        'note': hazard.note,
        'confidence': _number(hazard.confidence),
    }
    flat = record | {'height': _number(hazard.height / scale)}  # a sentence has one unit
    return record | {'text': describe_place(flat, units.name)}


def measure_clearances(
    result: InspectionResult, min_points: int
) -> dict[tuple[int, int], float | None]:
    """
    Return the distance of each span to the vegetation to which it is the nearest [m].

    Keys are (line_id, span_id).  The distance is that of the ``min_points``-th nearest point,
    because fewer points make no hazard; None if the span has fewer points in its corridor.
    """
    is_tree = result.classification[result.corridor] == PointClass.VEGETATION
    distances = result.clearance[result.corridor][is_tree]
    line_id, span_id = result.corridor_line_id[is_tree], result.corridor_span_id[is_tree]
    width = int(span_id.max(initial=0)) + 1
    owner = line_id.astype(np.int64) * width + span_id
    # the smallest integer type, for which numpy uses a radix sort
    order = np.argsort(owner.astype(np.min_scalar_type(owner.max(initial=0))), kind='stable')
    owner = owner[order]
    begin = np.flatnonzero(np.diff(owner, prepend=-1))
    parts = np.split(distances[order], begin)[1:]
    found = {
        divmod(own, width): float(np.partition(near, min_points - 1)[min_points - 1])
        for own, near in zip(owner[begin].tolist(), parts, strict=True)
        if len(near) >= min_points
    }
    return {
        (span.line_id, span.span_id): found.get((span.line_id, span.span_id))
        for span in result.spans
    }


def flatten(record: Record) -> Record:
    """
    Return a record as one row of a table.

    Coordinates become ``name_x``, ``name_y``, ``name_z``; mappings become ``name_key``; the
    quadratic becomes ``a2``, ``a1``, ``a0`` and an extent ``min_x`` ... ``max_z``.
    """
    row: Record = {}
    for name, value in record.items():
        if name == 'quadratic':
            row.update(zip(('a2', 'a1', 'a0'), value, strict=True))
        elif name == 'extent':
            for corner, values in zip(('min', 'max'), value, strict=True):
                row.update(_spread(corner, values))
        elif isinstance(value, dict):
            row.update({f'{name}_{key}': element for key, element in value.items()})
        elif isinstance(value, list) and name in ('start', 'end', 'lowest', 'position'):
            row.update(_spread(name, value))
        else:
            row[name] = value
    return row


def _spread(name: str, values: list[float]) -> Record:
    return {f'{name}_{axis}': value for axis, value in zip('xyz', values, strict=True)}


def _number(value: float) -> float | None:
    """Return a float, or None for NaN and infinity, which JSON lacks."""
    return float(value) if math.isfinite(value) else None


def _list(values: Float64) -> list[float | None]:
    return [_number(value) for value in values.tolist()]
