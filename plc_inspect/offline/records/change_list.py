# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What changed between two surveys."""

from dataclasses import dataclass

from plc_inspect.core.tracking.comparison import Change, Comparison
from plc_inspect.offline.records.limits import LimitChange
from plc_inspect.results import Hazard


@dataclass(frozen=True, slots=True, kw_only=True)
class Growth:
    """Growth of the canopy beside one span, where both surveys saw it."""

    span_id: int
    """In the second survey."""
    median: float
    """[m]."""
    highest: float
    """95th percentile [m]."""
    num_cells: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Changes:
    """Two surveys compared."""

    before: str
    """Name of the first survey."""
    comparison: Comparison
    vegetation: dict[tuple[int, int], Change]
    """Distance to the nearest vegetation of each span, by the ids of the second survey."""
    growth: tuple[Growth, ...]
    limits: tuple[LimitChange, ...] = ()
    """Those that differ."""
    unjudged_before: tuple[Hazard, ...] = ()
    """Hazards only of the first survey, which the limits of the second might not have raised."""
    unjudged: tuple[Hazard, ...] = ()
    """Hazards only of the second survey, which the limits of the first might not have raised."""
