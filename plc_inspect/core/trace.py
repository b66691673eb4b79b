# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What every stage found in one run of the pipeline."""

from dataclasses import dataclass

from plc_inspect.core.corridor import CorridorResult
from plc_inspect.core.line_finder import FoundLines
from plc_inspect.core.spans.span_model import SpanModel
from plc_inspect.results import Float64, InspectionResult


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trace:
    """The result of one run, and what the stages gave each other on the way."""

    lines: FoundLines
    corridor: CorridorResult
    result: InspectionResult
    offending: tuple[Float64, ...]
    """(K, 3) points of each hazard [m]."""

    @property
    def models(self) -> tuple[SpanModel, ...]:
        """Spans with their curves, in the order of those of the result."""
        return self.lines.spans.models
