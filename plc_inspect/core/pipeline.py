# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The pipeline: from one cloud to conductors, corridor and hazards."""

from dataclasses import fields

import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.corridor import extract_corridor
from plc_inspect.core.hazards.clearance_rules import describe_rules, RuleSet
from plc_inspect.core.hazards.hazards import add_ground_clearance, choose_rules, find_hazards
from plc_inspect.core.labels import choose_surroundings, label
from plc_inspect.core.line_finder import FoundLines, Progress, STAGES, Tracing
from plc_inspect.core.spans.point_claims import FREE_RADIUS
from plc_inspect.core.stage_log import StageMemory
from plc_inspect.core.trace import Trace
from plc_inspect.errors import DataError
from plc_inspect.results import Float64, InspectionResult


class Pipeline:
    """All stages with one set of settings; keeps no state between runs."""

    def __init__(self, settings: Settings | None = None, rules: RuleSet | None = None) -> None:
        """
        Take the settings, by default those of config.py, and the clearance rules.

        Without rules they are the plain ones of the settings; ConfigError is raised where the
        settings name others.
        """
        self.settings = settings or Settings()
        self.rules = choose_rules(self.settings.hazards, rules)

    def run(self, points: Float64, progress: Progress | None = None) -> InspectionResult:
        """
        Find conductors, corridor and hazards in one cloud.

        Parameters
        ----------
        points : (N, 3) float64, map frame, z up [m]
            Rows that are not finite are counted and left out.
        progress : callable or None
            Called with the name of a stage and the share of stages done before it.

        Returns
        -------
        InspectionResult
            Arrays are parallel to ``points``.  The same points and settings give the same
            result, whatever the number of threads.

        Raises
        ------
        DataError
            ``points`` is not an (N, 3) array, or its extent is beyond what voxels can number.

        """
        return self.trace(points, progress).result

    def trace(self, points: Float64, progress: Progress | None = None) -> Trace:
        """Do what `run` does, and return what each stage found as well."""
        return _Run(_check(points), self.settings, self.rules, progress).run()

    def find_lines(self, points: Float64, memory: StageMemory | None = None) -> FoundLines:
        """
        Run the stages up to the supports, which decide what is a line.

        Parameters
        ----------
        points : (N, 3) float64, map frame, z up [m]
            Rows that are not finite are left out.
        memory : StageMemory or None
            Of these points.  Stages whose settings, and those of all stages before them, are
            known to it do not run again; the result is the same.

        Returns
        -------
        FoundLines

        Raises
        ------
        DataError
            ``points`` is not an (N, 3) array, or its extent is beyond what voxels can number.

        """
        return _Run(_check(points), self.settings, self.rules, None, memory).find_lines()


def _check(points: Float64) -> Float64:
    """Return the points as the kernels want them."""
    if points.ndim != 2 or points.shape[1] != 3:
        raise DataError(f'points must have the shape (N, 3), got {points.shape}')
    own = np.ascontiguousarray(points, dtype=np.float64)
    return own if own.flags.writeable else own.copy()  # else numba would compile all anew


class _Run(Tracing):
    """One pass of a cloud through all stages."""

    def run(self) -> Trace:
        """Run all stages."""
        if self.progress is not None:
            self.progress(STAGES[0], 0.0)
        return self._finish(self.find_lines())

    def _finish(self, lines: FoundLines) -> Trace:
        points, height, spans = self.points, lines.height, lines.spans
        corridor = extract_corridor(
            points,
            height.height,
            spans.line_id >= 0,
            [model.curve for model in spans.models],
            np.array([model.low for model in spans.models]),
            np.array([model.high for model in spans.models]),
            self.settings.corridor,
            least_reach=max(self.rules.reach('vegetation', 'building'), FREE_RADIUS),
        )
        self.report(
            len(points),
            len(corridor.points),
            {'beyond the search radius': len(points) - len(corridor.points)},
            radius=[round(float(value), 2) for value in corridor.radius],
            complex_case=[bool(value) for value in corridor.complex_case],
        )
        near, distance, owner = choose_surroundings(height.height, spans, corridor)
        hazards, foliage = find_hazards(
            points,
            near,
            distance,
            owner,
            spans.models,
            spans.ground_below,
            self.settings.hazards,
            rules=self.rules,
            height=height.height,
            supports=spans.supports,
            line_id=spans.line_id,
            support=spans.support,
        )
        labels = label(
            height, lines.cloud, lines.candidates, lines.outliers, lines.alignment,
            lines.clustering.beads.points, spans, corridor, near, foliage,
        )
        self.report(
            len(near),
            len(hazards),
            {},
            **describe_rules(self.rules),
        )
        result = InspectionResult(
            spans=add_ground_clearance(spans.models, spans.ground_below),
            supports=spans.supports,
            hazards=hazards,
            line_id=spans.line_id,
            span_id=labels.span_id,
            residual=spans.residual,
            clearance=labels.clearance,
            classification=labels.classification,
            decision=labels.decision,
            ground_height=height.height,
            corridor=corridor.points,
            corridor_line_id=labels.corridor_line_id,
            corridor_span_id=labels.corridor_span_id,
            stages=tuple(self.stages),
        )
        found = {item.name: getattr(lines, item.name) for item in fields(lines)}
        return Trace(result=result, corridor=corridor, **found)
