# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The pipeline: from one cloud to conductors, corridor and hazards."""


import itertools

import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.cloud_frame import CloudFrame, find_cloud_frame
from plc_inspect.core.corridor import CorridorResult, extract_corridor
from plc_inspect.core.evidence.roof_rows import are_roof_rows
from plc_inspect.core.extraction.dust import find_dust, find_lone
from plc_inspect.core.extraction.stray_points import leave_out_strays
from plc_inspect.core.ground.ground_surface import Surface
from plc_inspect.core.hazards.clearance_rules import RuleSet
from plc_inspect.core.hazards.encroachments import Nearby
from plc_inspect.core.hazards.hazards import (
    choose_rules,
    complete_spans,
    find_hazards,
    HazardResult,
)
from plc_inspect.core.hazards.line_parts import DoubtfulCurves, POLE_REACH
from plc_inspect.core.labels import choose_surroundings, label, Labels
from plc_inspect.core.line_finder import find_lines, FoundLines, keep_surface
from plc_inspect.core.numerics.arrays import take_rows
from plc_inspect.core.numerics.threads import call_in_few
from plc_inspect.core.spans.route import EAST
from plc_inspect.core.stage_log import Progress, StageLog, StageMemory
from plc_inspect.core.stage_reports import report_corridor, report_hazards
from plc_inspect.core.trace import Trace
from plc_inspect.core.whole import Whole
from plc_inspect.errors import DataError
from plc_inspect.results import Float64, InspectionResult, Int64


class Pipeline:
    """All stages with one set of settings; keeps no state between runs."""

    def __init__(
        self, settings: Settings | None = None, rules: RuleSet | None = None,
        way: Float64 | None = None,
    ) -> None:
        """
        Take the settings, by default those of config.py, the clearance rules, and a flown way.

        Without rules they are the plain ones of the settings; ConfigError is raised where the
        settings name others.  The way is (W, 3), in the frame of the points, where the lidar was;
        about it returns of dust, rain and insects are left out of lines and hazards [m].
        """
        self._way = np.zeros((0, 3)) if way is None else way
        self.settings = settings or Settings()
        self.rules = choose_rules(self.settings.hazards, rules)

    def run(self, points: Float64, progress: Progress | None = None) -> InspectionResult:
        """
        Find conductors, corridor and hazards in one cloud.

        Parameters
        ----------
        points : (N, 3) float64, map frame, z up [m]
            Rows that are not finite, and those of isolated points far away, are counted and left
            out.
        progress : callable or None
            Called with the name of a stage and the share of stages done before it.

        Returns
        -------
        InspectionResult
            Arrays are parallel to ``points``.  The same points and settings give the same
            result, whatever the number of threads, and up to rounding wherever the cloud lies
            and however it is turned about the vertical.

        Raises
        ------
        DataError
            ``points`` is not an (N, 3) array, or its extent is beyond what voxels can number.

        """
        log = StageLog(progress)
        points, frame, log.num_strays = enter_frame(points)
        own = Pipeline(self.settings, self.rules, frame.enter(self._way))
        trace = own._trace(points, log, frame.east)
        return frame.leave_result(trace.result, trace.offending)

    def run_part(
        self, points: Float64, number: Int64, whole: Whole, progress: Progress | None = None,
        surface: Surface | None = None,
    ) -> InspectionResult:
        """
        Find what `run` does, in a part of a cloud, as it is in the whole.

        Parameters
        ----------
        points : (N, 3) float64, map frame, z up [m]
            The points of the whole in some area, in their order; strays of the whole are NaN.
        number : (N,) int64
            Place of each point in the whole, ascending.
        whole : Whole
            What is known of it.
        progress : callable or None
            As for `run`.
        surface : Surface or None
            The ground below these points in the frame of the whole, where it is known already.

        Returns
        -------
        InspectionResult
            That of the whole away from the edge of the part, but for numbers of lines and spans;
            up to rounding.

        """
        frame = whole.frame
        own = frame.enter(_check(points))
        probes = np.flatnonzero(number % whole.probe_step == 0)
        memory = StageMemory(room=1)
        if surface is not None:
            keep_surface(memory, surface, self.settings)
        trace = self._trace(own, StageLog(progress, memory), frame.east, whole, probes)
        return frame.leave_result(trace.result, trace.offending)

    def trace(
        self, points: Float64, progress: Progress | None = None, east: Float64 = EAST
    ) -> Trace:
        """
        Do what `run` does in the frame of the points, and return what each stage found as well.

        The result is that of `run` where the points are in their own frame, `enter_frame`; lines
        and spans are numbered along ``east``, a unit vector in plan.
        """
        log = StageLog(progress)
        points, log.num_strays = leave_out_strays(_check(points))
        return self._trace(points, log, east)

    def _trace(
        self, points: Float64, log: StageLog, east: Float64, whole: Whole | None = None,
        probes: Int64 | None = None,
    ) -> Trace:
        return call_in_few(
            len(points), lambda: self._find_all(points, log, east, whole, probes)
        )

    def _find_all(
        self, points: Float64, log: StageLog, east: Float64, whole: Whole | None,
        probes: Int64 | None,
    ) -> Trace:
        # Returns of dusty air, about the way alone: they blur the lines that lie in them.
        is_lone = find_lone(points, self._way)
        lone = points[is_lone]
        log.num_lone = len(lone)
        if len(lone):
            points = np.where(is_lone[:, None], np.nan, points)
        lines = find_lines(points, self.settings, log, east, whole)
        height, spans = lines.height.height, lines.spans

        # Eq. 9: what is near the conductors, at least as far as rules and parts of lines reach.
        least_reach = self.settings.catenary.bundle_width + max(
            self.rules.reach('vegetation', 'building'), POLE_REACH
        )
        corridor = log.run(
            None,
            lambda: extract_corridor(
                points, height, spans.line_id >= 0, spans.models, self.settings.corridor,
                least_reach, probes,
            ),
            lambda result: report_corridor(result, len(points)),
        )

        # Hazards, and with them what the points about the conductors are.
        nearby = choose_surroundings(height, spans, corridor)
        if len(self._way):
            nearby = nearby.take(~find_dust(take_rows(points, nearby.index), self._way, lone))
        found, labels = log.run(
            None,
            lambda: self._judge(points, lines, corridor, nearby),
            lambda result: report_hazards(result[0], len(nearby.index), self.rules),
        )
        result = InspectionResult(
            spans=complete_spans(found.models, found.ground_below),
            supports=spans.supports,
            hazards=found.hazards,
            line_id=spans.line_id,
            span_id=labels.span_id,
            residual=spans.residual,
            clearance=labels.clearance,
            classification=labels.classification,
            decision=labels.decision,
            ground_height=height,
            corridor=corridor.points,
            corridor_line_id=labels.corridor_line_id,
            corridor_span_id=labels.corridor_span_id,
            stages=tuple(log.reports),
        )
        return Trace(
            lines=lines, corridor=corridor, result=result, offending=found.offending,
        )

    def _judge(
        self, points: Float64, lines: FoundLines, corridor: CorridorResult, nearby: Nearby
    ) -> tuple[HazardResult, Labels]:
        alone, crowded = lines.conductors.doubtful, lines.conductors.crowded
        on_roof = are_roof_rows(alone, lines.sight)
        row_on_roof = are_roof_rows(alone + crowded, lines.sight)[len(alone):]
        found = find_hazards(
            points, lines.height.height, nearby, lines.spans, self.settings.hazards, self.rules,
            DoubtfulCurves(
                alone=tuple(itertools.compress(alone, ~on_roof)),
                crowded=tuple(itertools.compress(crowded, ~row_on_roof)),
                sight=lines.sight,
            ),
        )
        return found, label(lines, corridor, nearby, found.foliage)

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
        log = StageLog(memory=memory)
        points, log.num_strays = leave_out_strays(_check(points))
        return find_lines(points, self.settings, log)


def enter_frame(points: Float64) -> tuple[Float64, CloudFrame, int]:
    """
    Bring a cloud into its own frame, without isolated points far away.

    Parameters
    ----------
    points : (N, 3) float64
        Map frame [m].

    Returns
    -------
    points : (N, 3) float64
        In the frame [m]; NaN where they were left out.
    frame : CloudFrame
    num_strays : int
        Points that were left out.

    """
    points, num_strays = leave_out_strays(_check(points))
    frame = find_cloud_frame(points)
    return frame.enter(points), frame, num_strays


def _check(points: Float64) -> Float64:
    """Return the points as the kernels want them."""
    if points.ndim != 2 or points.shape[1] != 3:
        raise DataError(f'points must have the shape (N, 3), got {points.shape}')
    own = np.ascontiguousarray(points, dtype=np.float64)
    return own if own.flags.writeable else own.copy()  # else numba would compile all anew
