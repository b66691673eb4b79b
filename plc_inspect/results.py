# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Results of the pipeline: frozen, complete, without ROS or files.

Lengths are metres, angles radians, coordinates in the frame of the input cloud.  Arrays that
belong to points are parallel to the cloud that was given to the pipeline.
"""

from dataclasses import dataclass, field
import enum
from itertools import pairwise
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plc_inspect.errors import DataError

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]
Int32 = NDArray[np.int32]
Int64 = NDArray[np.int64]
UInt8 = NDArray[np.uint8]
Bool = NDArray[np.bool_]

SpanKey = tuple[int, int]
"""line_id and span_id."""


class PointClass(enum.IntEnum):
    """ASPRS LAS 1.4 classes that the pipeline writes."""

    OTHER = 1
    GROUND = 2
    VEGETATION = 5
    WIRE = 14
    TOWER = 15


class Decision(enum.IntEnum):
    """The stage that decided a point's class; in ``points.laz`` as ``decision``."""

    NOT_FINITE = 0
    GROUND = 1
    TOO_LOW = 2
    NOT_LINEAR = 3
    OUTLIER = 4
    NO_SECTION = 5
    NO_CLUSTER = 6
    NO_CATENARY = 7
    WIRE = 8
    SUPPORT = 9


class HazardKind(enum.IntEnum):
    """Kind of a hazard; ``kind`` in files and messages."""

    VEGETATION = 1
    GROUND = 2
    STRUCTURE = 3
    INTERFERENCE = 4
    SAG = 5
    CROSSING = 6
    FALL_IN = 7
    MISSING = 8
    """A conductor over one span."""


MEASURE_NOTES = {'horizontal': 'measured horizontally', 'vertical': 'measured vertically'}
"""Notes of hazards whose rule measures a part of the distance."""


class Severity(enum.IntEnum):
    """Severity of a hazard; ``severity`` in files and messages."""

    NOTICE = 1
    WARNING = 2
    CRITICAL = 3


def catenary_heights(
    a: float | Float64, b: float | Float64, c: float | Float64, x: Float64
) -> Float64:
    """
    Return z(x) = a + c cosh((x - b) / c), the heights of a catenary (paper Eq. 6).

    Parameters
    ----------
    a, b, c : float or (N,) float64
        Vertical offset, place of the vertex and catenary constant [m].
    x : (N,) float64
        Horizontal distances from the start [m].

    Returns
    -------
    (N,) float64
        z [m].

    """
    heights: Float64 = a + c * np.cosh((x - b) / c)
    return heights


NO_STRANDS: Float64 = np.zeros((1, 2))
"""(1, 2) place of the one conductor where there is no bundle [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Span:
    """
    One conductor between two supports, modelled by a catenary.

    z(x) = a + c cosh((x - b) / c), where x is the horizontal distance from ``start`` towards
    ``end`` and z is in the frame of the cloud (paper Eq. 6).
    """

    line_id: int
    span_id: int
    start: Float64
    """(3,) first end, on the curve [m]."""
    end: Float64
    """(3,) second end, on the curve [m]."""
    azimuth: float
    """Direction from start to end, counter-clockwise from x (REP-103) [rad]."""
    length: float
    """Horizontal distance from start to end [m]."""
    a: float
    b: float
    c: float
    quadratic: tuple[float, float, float]
    """a2, a1, a0 of the quadratic form over the same x."""
    sag: float
    """Greatest vertical distance from chord to curve [m]."""
    lowest: Float64
    """(3,) lowest point of the curve between start and end [m]."""
    open_start: bool
    """The span goes on beyond ``start``, which is only the last point seen."""
    open_end: bool
    rmse: float
    """Root mean square vertical residual of the inliers [m]."""
    num_points: int
    coverage: float
    """Share of the length that holds points, 0 to 1."""
    sigma: dict[str, float]
    """Standard deviations of a, b, c and sag [m]."""
    ground_clearance: float = math.nan
    """Least height of the curve above ground [m], NaN unknown."""
    ground_along: float = math.nan
    """Horizontal distance from the start to where that is [m], NaN unknown."""
    strands: Float64 = field(default_factory=lambda: NO_STRANDS)
    """
    (S, 2) places of its sub-conductors to the left of the way from start to end and above the
    curve [m]; one at 0, 0 where there is no bundle, or they cannot be told apart.
    """
    evidence: float = math.nan
    """
    Evidence that it is a conductor [m], NaN unknown; a span that continues no other needs
    ``catenary.min_evidence``.
    """

    @property
    def sigma_sag(self) -> float:
        """Standard deviation of the sag [m]."""
        return self.sigma['sag']

    def heights(self, x: Float64) -> Float64:
        """
        Return the heights of the curve.

        Parameters
        ----------
        x : (N,) float64
            Horizontal distances from the start towards the end [m].

        Returns
        -------
        (N,) float64
            z [m].

        """
        return catenary_heights(self.a, self.b, self.c, x)

    def positions(self, x: Float64) -> Float64:
        """
        Return points of the curve.

        Parameters
        ----------
        x : (N,) float64
            Horizontal distances from the start towards the end [m].

        Returns
        -------
        (N, 3) float64
            In the frame of the cloud [m].

        """
        unit = (self.end - self.start)[:2] / self.length
        return np.column_stack([self.start[:2] + x[:, None] * unit, self.heights(x)])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Support:
    """A tower or pole that carries conductors."""

    support_id: int
    position: Float64
    """(3,) foot of the support on the ground [m]."""
    height: float
    """Height of the highest point of the support or attachment above the foot [m]."""
    kind: str
    """'tower', 'pole', or 'unseen' if only its conductors were seen."""
    line_ids: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hazard:
    """One place where a clearance rule is broken."""

    hazard_id: int
    line_id: int
    span_id: int
    kind: HazardKind
    severity: Severity
    position: Float64
    """(3,) the offending point nearest to the conductor [m]."""
    clearance: float
    """Measured distance to the conductor [m]; for SAG, the sag in excess of its peers; for
    MISSING, the length of which anything was seen."""
    required: float
    """Distance that the rule asks for [m]; for SAG, the deviation that is tolerated; for
    MISSING, the length of the span."""
    horizontal: float
    """Horizontal part of the clearance [m]."""
    vertical: float
    """Vertical part of the clearance, positive where the conductor is above [m]."""
    sigma: float
    """Standard deviation of the clearance [m]."""
    along_span: float
    """Horizontal distance from the start of the span [m]."""
    num_points: int
    extent: Float64
    """(2, 3) lower and upper corner of the offending points [m]."""
    rule: str
    edition: str
    source: str
    voltage: str = 'unknown'
    """Voltage that the rule was chosen for, as '110 kV'."""
    other_line_id: int = -1
    """The other conductor of INTERFERENCE and CROSSING, the one that is MISSING; -1 none."""
    support_id: int = -1
    """Nearest support along the span, -1 unknown."""
    from_support: float = math.nan
    """Horizontal distance along the span from that support [m], NaN unknown."""
    height: float = math.nan
    """Height of the offending object above the ground [m], NaN where it is no object."""
    years: float = math.nan
    """Years until growth breaks the most severe tier of the rule, NaN unknown."""
    note: str = ''
    """Assumptions."""
    confidence: float = 1.0
    """Probability that the limit is broken, 0 to 1."""

    @property
    def measured(self) -> float:
        """What the rule measures, against ``required``: the clearance, or a part of it [m]."""
        notes = self.note.split('; ')
        parts = {'horizontal': self.horizontal, 'vertical': abs(self.vertical)}
        own = (part for name, part in parts.items() if MEASURE_NOTES[name] in notes)
        return next(own, self.clearance)


@dataclass(frozen=True, slots=True, kw_only=True)
class StageReport:
    """Counts and values of one stage: what it kept and dropped, and why."""

    name: str
    num_in: int
    num_kept: int
    dropped: dict[str, int] = field(default_factory=dict)
    """Reason to count."""
    values: dict[str, Any] = field(default_factory=dict)
    """Thresholds used and values derived from the data, JSON-serialisable."""
    seconds: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InspectionResult:
    """Everything that one run of the pipeline found in one cloud of N points."""

    spans: tuple[Span, ...]
    """Ordered by line_id, then span_id."""
    supports: tuple[Support, ...]
    hazards: tuple[Hazard, ...]
    line_id: Int32
    """(N,) conductor of each point, -1 none."""
    span_id: Int32
    """(N,) span of each point, -1 none; set for wire and corridor points."""
    residual: Float32
    """(N,) distance of a wire point to its curve [m], NaN elsewhere."""
    clearance: Float32
    """(N,) distance to the nearest conductor [m], NaN beyond the corridor."""
    classification: UInt8
    """(N,) PointClass."""
    decision: UInt8
    """(N,) Decision."""
    ground_height: Float32
    """(N,) height above local ground [m]."""
    corridor: Int64
    """(K,) ascending indices of the points of the corridor (PLC), wires included."""
    corridor_line_id: Int32
    """(K,) nearest conductor of each corridor point."""
    corridor_span_id: Int32
    """(K,) nearest span of each corridor point."""
    stages: tuple[StageReport, ...]

    def __post_init__(self) -> None:
        """Raise DataError if two spans have the same line_id and span_id."""
        keys = sorted((span.line_id, span.span_id) for span in self.spans)
        for first, second in pairwise(keys):
            if first == second:
                raise DataError(f'two spans of line {first[0]} have the number {first[1]}')

    @property
    def num_points(self) -> int:
        """Number of points of the cloud."""
        return len(self.line_id)

    @property
    def num_lines(self) -> int:
        """Number of different conductors."""
        return len({span.line_id for span in self.spans})
