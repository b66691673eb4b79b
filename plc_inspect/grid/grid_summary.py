# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What a finished grid came to."""

from dataclasses import dataclass

from plc_inspect.grid.joining import JoinedGrid
from plc_inspect.offline.records.change_list import Changes
from plc_inspect.offline.records.units import Units


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GridSummary:
    """Totals of a finished grid."""

    joined: JoinedGrid
    num_points: int
    num_tiles: int
    kilometres: float
    """Length of the line: the sum over all span groups [km]."""
    units: Units
    failures: tuple[tuple[str, str, str], ...]
    """Stage, name and error of each failed task."""
    num_defects: int
    sight: dict[str, float]
    """
    Of the spans of the line how many were looked at, ``num_sections``, and seen well enough to
    rule out a hazard, ``num_enough``; ``gap_length`` of the others [m]; ``of_conductors``, the
    share of their length that holds points, NaN where there is none.
    """
    notes: tuple[str, ...] = ()
    """Assumptions about the inputs."""
    missing: str = ''
    """Why a file is missing from the results, '' if none is."""
    changes: Changes | None = None
    """Changes since an earlier survey, None without one."""
    num_withheld: int = 0
    """Points that count as deleted, and take no part."""
