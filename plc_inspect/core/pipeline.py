# Copyright 2026 plc_inspect contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The pipeline: from one cloud to conductors, corridor and hazards."""

from collections.abc import Callable
import dataclasses
import math
import time
from typing import Any

import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.alignment import align, AlignmentResult
from plc_inspect.core.clearance import describe_rules, RuleSet
from plc_inspect.core.clustering import cluster, ClusteringResult
from plc_inspect.core.conductors import model_conductors
from plc_inspect.core.corridor import CorridorResult, extract_corridor
from plc_inspect.core.hazards import add_ground_clearance, choose_rules, find_hazards
from plc_inspect.core.height import extract_high, free_ground, HeightResult
from plc_inspect.core.labels import choose_surroundings, label
from plc_inspect.core.linearity import anchor, find_candidates, LinearityResult
from plc_inspect.core.off_ground import CELL, gather_off_ground, OffGround
from plc_inspect.core.outliers import OutlierResult, remove_outliers
from plc_inspect.core.plan_index import build_plan_index
from plc_inspect.core.route import trace_routes
from plc_inspect.core.spans import (
    build_spans,
    claim_strays,
    FREE_RADIUS,
    SpanResult,
    spread_spans,
)
from plc_inspect.core.supports import find_layout
from plc_inspect.core.trace import Trace
from plc_inspect.errors import DataError
from plc_inspect.results import (
    Float64,
    InspectionResult,
    Int32,
    StageReport,
)

Progress = Callable[[str, float], None]
STAGES = (
    'height',
    'linearity',
    'outliers',
    'alignment',
    'clustering',
    'catenary',
    'supports',
    'corridor',
    'hazards',
)


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
        if points.ndim != 2 or points.shape[1] != 3:
            raise DataError(f'points must have the shape (N, 3), got {points.shape}')
        own = np.ascontiguousarray(points, dtype=np.float64)
        if not own.flags.writeable:  # another type to numba, which would compile all anew
            own = own.copy()
        return _Run(own, self.settings, self.rules, progress).run()


class _Run:
    """One pass of a cloud through the stages, collecting what each one did."""

    def __init__(
        self, points: Float64, settings: Settings, rules: RuleSet, progress: Progress | None
    ) -> None:
        self.points = points
        self.settings = settings
        self.rules = rules
        self.progress = progress
        self.stages: list[StageReport] = []
        self.started = time.perf_counter()

    def report(self, num_in: int, num_kept: int, dropped: dict[str, int], **values: Any) -> None:
        """Close the current stage."""
        now = time.perf_counter()
        self.stages.append(
            StageReport(
                name=STAGES[len(self.stages)],
                num_in=num_in,
                num_kept=num_kept,
                dropped={reason: count for reason, count in dropped.items() if count},
                values=values,
                seconds=now - self.started,
            )
        )
        self.started = now
        if self.progress is not None and len(self.stages) < len(STAGES):
            self.progress(STAGES[len(self.stages)], len(self.stages) / len(STAGES))

    def run(self) -> Trace:
        """Run all stages."""
        points, settings = self.points, self.settings
        if self.progress is not None:
            self.progress(STAGES[0], 0.0)
        height = self._height()
        cloud = self._gather(height)
        if len(points) - height.num_not_finite < settings.segment.min_points:
            cloud = dataclasses.replace(cloud, high=cloud.high[:0])
        candidates, outliers, inliers = self._candidates(cloud)
        alignment = align(inliers, settings.alignment)
        self.report(
            len(inliers.position),
            int(alignment.voted.sum()),
            {'too few in line': int((~alignment.voted).sum())},
            min_votes=settings.alignment.min_votes,
            windows=len(alignment.azimuth),
            azimuths_deg=_azimuth_histogram(alignment.azimuth),
        )
        clustering = self._clusters(cloud, inliers, alignment)
        rng = np.random.default_rng(0)
        conductors = model_conductors(
            cloud.points, cloud.index, clustering, settings.catenary, rng
        )
        self.report(
            clustering.num_tracks,
            len(conductors.curves),
            conductors.objections,
            constants=[round(curve.fit.c, 1) for curve in conductors.curves],
            rmse=[round(curve.fit.rmse, 4) for curve in conductors.curves],
        )
        in_beads = cloud.place[clustering.beads.points]
        used = len(cloud.high) > 0
        curves, doubtful = conductors.curves, conductors.doubtful
        height, found = free_ground(points, height, curves, settings.height), height
        before = cloud
        if height is not found:
            cloud = self._gather(height)
            curves, doubtful = cloud.adopt(before, curves), cloud.adopt(before, doubtful)
        layout = find_layout(cloud.points, curves, doubtful, settings.supports)
        spans = build_spans(cloud, layout, trace_routes(layout), settings, rng)
        spans = spread_spans(claim_strays(cloud, spans), cloud)
        self.report(
            len(layout.joints),
            len(spans.supports),
            {},
            spans=len(spans.models),
            kinds=[support.kind for support in spans.supports],
        )
        wire = spans.line_id >= 0
        corridor = extract_corridor(
            points,
            height.height,
            wire,
            [model.curve for model in spans.models],
            np.array([min(model.start_x, model.end_x) for model in spans.models]),
            np.array([max(model.start_x, model.end_x) for model in spans.models]),
            settings.corridor,
            least_reach=max(self.rules.reach('vegetation', 'building'), FREE_RADIUS),
        )
        self.report(
            len(points),
            len(corridor.points),
            {'beyond the search radius': len(points) - len(corridor.points)},
            radius=[round(float(value), 2) for value in corridor.radius],
            complex_case=[bool(value) for value in corridor.complex_case],
        )
        result = self._finish(
            height, candidates, outliers, alignment, in_beads, spans, corridor, used
        )
        return Trace(
            result=result,
            height=height,
            cloud=before,
            candidates=candidates,
            outliers=outliers,
            inliers=inliers,
            alignment=alignment,
            clustering=clustering,
            conductors=conductors,
            models=spans.models,
            corridor=corridor,
        )

    def _height(self) -> HeightResult:
        settings = self.settings.height
        height = extract_high(self.points, settings)
        num_high = int(height.high.sum())
        self.report(
            len(self.points),
            num_high,
            {
                'not finite': height.num_not_finite,
                'too low': len(self.points) - height.num_not_finite - num_high,
            },
            threshold=height.threshold if math.isfinite(height.threshold) else None,
            histogram=height.histogram.tolist(),
            edges=[float(height.edges[0]), float(height.edges[-1])],
            cell_size=height.cell_size,
        )
        return height

    def _gather(self, height: HeightResult) -> OffGround:
        return gather_off_ground(self.points, height, self.settings.height.beta / 2)

    def _candidates(
        self, cloud: OffGround
    ) -> tuple[LinearityResult, OutlierResult, LinearityResult]:
        settings = self.settings
        origin = anchor(cloud.points, cloud.high, settings.linearity)
        candidates = find_candidates(cloud.points, cloud.high, origin, settings.linearity)
        self.report(
            sum(candidates.num_voxels),
            len(candidates.position),
            {'not linear': sum(candidates.num_voxels) - len(candidates.position)},
            threshold=settings.linearity.threshold,
            max_inclination_deg=settings.linearity.max_inclination_deg,
            neighborhoods=list(candidates.sizes),
            voxels=list(candidates.num_voxels),
            points_in_bulk=candidates.num_bulk,
            likeness_of_all=candidates.histogram,
            likeness=np.histogram(candidates.linear, bins=20, range=(0.5, 1.0))[0].tolist(),
        )
        outliers = remove_outliers(candidates.position, settings.outliers)
        keep = outliers.keep
        inliers = LinearityResult(
            position=candidates.position[keep],
            direction=candidates.direction[keep],
            size=candidates.size[keep],
            linear=candidates.linear[keep],
            count=candidates.count[keep],
            sizes=candidates.sizes,
            num_voxels=candidates.num_voxels,
            num_bulk=candidates.num_bulk,
        )
        self.report(
            len(keep),
            int(keep.sum()),
            {'far from the others': int((~keep).sum())},
            mean=outliers.mean,
            sigma=outliers.sigma,
            threshold=outliers.threshold if math.isfinite(outliers.threshold) else None,
        )
        return candidates, outliers, inliers

    def _clusters(
        self, cloud: OffGround, inliers: LinearityResult, alignment: AlignmentResult
    ) -> ClusteringResult:
        index = build_plan_index(cloud.points, cloud.high, CELL)
        clustering = cluster(
            cloud.points, index, inliers.position, alignment, self.settings.clustering
        )
        self.report(
            clustering.num_clusters,
            len(clustering.beads),
            {'not one conductor': max(clustering.num_clusters - len(clustering.beads), 0)},
            eps=clustering.eps,
            min_points=clustering.min_points,
            tracks=clustering.num_tracks,
        )
        return clustering

    def _finish(
        self,
        height: HeightResult,
        candidates: LinearityResult,
        outliers: OutlierResult,
        alignment: AlignmentResult,
        in_beads: Int32,
        spans: SpanResult,
        corridor: CorridorResult,
        used: bool,
    ) -> InspectionResult:
        points = self.points
        around = choose_surroundings(height.height, spans, corridor)
        near = corridor.near[around]
        hazards, foliage = find_hazards(
            points,
            near,
            corridor.near_distance[around].astype(np.float64),
            corridor.near_span[around].astype(np.int64),
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
            points, height, candidates, outliers, alignment, in_beads, spans, corridor,
            near[foliage], used=used,
        )
        self.report(
            len(near),
            len(hazards),
            {},
            **describe_rules(self.rules),
        )
        return InspectionResult(
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


def _azimuth_histogram(azimuth: Float64) -> list[int]:
    """Windows per 10 degrees of azimuth, from -90 degrees on."""
    counts, _ = np.histogram(np.degrees(azimuth), bins=18, range=(-90.0, 90.0))
    result: list[int] = counts.tolist()
    return result
