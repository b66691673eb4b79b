# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The stages up to the supports: all that decides what is a line."""

from collections.abc import Callable, Hashable
import dataclasses
from dataclasses import dataclass
import math
import time
from typing import Any, TypeVar

import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.catenary.conductors import ConductorResult, model_conductors
from plc_inspect.core.clustering.clustering import cluster, ClusteringResult
from plc_inspect.core.extraction.alignment import align, AlignmentResult
from plc_inspect.core.extraction.ground_surface import measure_surface
from plc_inspect.core.extraction.height import extract_high, HeightResult
from plc_inspect.core.extraction.linearity import (
    anchor,
    find_candidates,
    LinearityResult,
    measure_scales,
)
from plc_inspect.core.extraction.off_ground import gather_off_ground, OffGround
from plc_inspect.core.extraction.outliers import OutlierResult, remove_outliers
from plc_inspect.core.hazards.clearance_rules import RuleSet
from plc_inspect.core.spans.ground_revision import renumber_points, revise_ground
from plc_inspect.core.spans.layout import find_layout
from plc_inspect.core.spans.point_claims import settle_strays
from plc_inspect.core.spans.route import trace_routes
from plc_inspect.core.spans.service_drops import add_taps
from plc_inspect.core.spans.spans import build_spans, SpanResult, spread_spans
from plc_inspect.core.stage_log import StageMemory
from plc_inspect.results import (
    Float64,
    StageReport,
)

Progress = Callable[[str, float], None]
T = TypeVar('T')
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FoundLines:
    """What the stages up to the supports found in N points."""

    height: HeightResult
    """Of the ground that was believed in the end."""
    cloud: OffGround
    """Points off the ground as the stages from linearity to catenary saw them."""
    candidates: LinearityResult
    outliers: OutlierResult
    inliers: LinearityResult
    """Candidates that are no outliers."""
    alignment: AlignmentResult
    clustering: ClusteringResult
    conductors: ConductorResult
    spans: SpanResult
    """With labels of all N points."""


class Tracing:
    """One pass of a cloud through the stages, collecting what each one did."""

    def __init__(
        self,
        points: Float64,
        settings: Settings,
        rules: RuleSet,
        progress: Progress | None,
        memory: StageMemory | None = None,
    ) -> None:
        self.points = points
        self.settings = settings
        self.rules = rules
        self.progress = progress
        self.memory = memory
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

    def find_lines(self) -> FoundLines:
        """Run the stages up to the supports."""
        settings = self.settings
        key: tuple[Hashable, ...] = (settings.segment.min_points, settings.height)
        height = self._once('height', key, self._height)
        cloud = self._once('cloud', key, lambda: self._gather(height))
        if len(self.points) - height.num_not_finite < settings.segment.min_points:
            cloud = dataclasses.replace(cloud, high=cloud.high[:0])
        found = self._once(
            'candidates', (*key, settings.linearity), lambda: self._candidates(cloud, key)
        )
        key = (*key, settings.linearity, settings.outliers, settings.alignment)
        outliers, inliers, alignment = self._once('windows', key, lambda: self._windows(found))
        key = (*key, settings.clustering)
        clustering = self._once(
            'clusters', key, lambda: self._clusters(cloud, inliers, alignment)
        )
        rng = np.random.default_rng(0)
        conductors = self._conductors(cloud, clustering, rng)
        spans, height = self._spans(cloud, height, inliers, conductors, rng)
        return FoundLines(
            height=height,
            cloud=cloud,
            candidates=found,
            outliers=outliers,
            inliers=inliers,
            alignment=alignment,
            clustering=clustering,
            conductors=conductors,
            spans=spans,
        )

    def _once(self, stage: str, key: Hashable, compute: Callable[[], T]) -> T:
        """Return what a stage gives, and its reports, from memory where that knows them."""
        if self.memory is None:
            return compute()
        known: tuple[T, list[StageReport]] | None = self.memory.find(stage, key)
        if known is None:
            before = len(self.stages)
            known = compute(), self.stages[before:]
            self.memory.keep(stage, key, known)
        else:
            self.stages += known[1]
            self.started = time.perf_counter()
        return known[0]

    def _conductors(
        self, cloud: OffGround, clustering: ClusteringResult, rng: np.random.Generator
    ) -> ConductorResult:
        conductors = model_conductors(
            cloud.points, cloud.index, clustering, self.settings.catenary, rng
        )
        self.report(
            clustering.num_tracks,
            len(conductors.curves),
            conductors.objections,
            constants=[round(curve.fit.c, 1) for curve in conductors.curves],
            rmse=[round(curve.fit.rmse, 4) for curve in conductors.curves],
        )
        return conductors

    def _spans(
        self,
        cloud: OffGround,
        height: HeightResult,
        candidates: LinearityResult,
        conductors: ConductorResult,
        rng: np.random.Generator,
    ) -> tuple[SpanResult, HeightResult]:
        """Find spans and supports; the ground may be found anew below the conductors."""
        points, settings = self.points, self.settings
        curves, doubtful = conductors.curves, conductors.doubtful
        height, found = revise_ground(points, height, curves, settings.height), height
        if height is not found:
            cloud, before = self._gather(height), cloud
            curves = renumber_points(curves, before, cloud)
            doubtful = renumber_points(doubtful, before, cloud)
        layout = find_layout(cloud.points, curves, doubtful, settings.supports)
        spans = build_spans(cloud, layout, trace_routes(layout), settings, rng)
        spans = add_taps(cloud, candidates, spans, settings)
        spans = spread_spans(settle_strays(cloud, spans), cloud)
        self.report(
            len(layout.joints),
            len(spans.supports),
            {},
            spans=len(spans.models),
            kinds=[support.kind for support in spans.supports],
        )
        return spans, height

    def _height(self) -> HeightResult:
        settings = self.settings.height
        surface = self._once(
            'surface',
            (settings.cell_size, settings.max_slope_deg),
            lambda: measure_surface(self.points, settings),
        )
        height = extract_high(self.points, settings, surface=surface)
        num_high = int(np.count_nonzero(height.high))
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

    def _candidates(self, cloud: OffGround, key: tuple[Hashable, ...]) -> LinearityResult:
        settings = self.settings
        linearity = settings.linearity
        origin = anchor(cloud.points, cloud.high, linearity)
        scales = self._once(
            'scales',
            (*key, linearity.voxel_size, linearity.num_scales, linearity.max_occupied),
            lambda: measure_scales(cloud.points, cloud.high, origin, linearity),
        )
        candidates = find_candidates(cloud.points, cloud.high, origin, linearity, scales)
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
        return candidates

    def _windows(
        self, candidates: LinearityResult
    ) -> tuple[OutlierResult, LinearityResult, AlignmentResult]:
        settings = self.settings
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
        alignment = align(inliers, settings.alignment)
        self.report(
            len(inliers.position),
            int(alignment.voted.sum()),
            {'too few in line': int((~alignment.voted).sum())},
            min_votes=settings.alignment.min_votes,
            windows=len(alignment.azimuth),
            azimuths_deg=_azimuth_histogram(alignment.azimuth),
        )
        return outliers, inliers, alignment

    def _clusters(
        self, cloud: OffGround, inliers: LinearityResult, alignment: AlignmentResult
    ) -> ClusteringResult:
        clustering = cluster(
            cloud.points, cloud.index_high(), inliers.position, alignment, self.settings.clustering
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


def _azimuth_histogram(azimuth: Float64) -> list[int]:
    """Windows per 10 degrees of azimuth, from -90 degrees on."""
    counts, _ = np.histogram(np.degrees(azimuth), bins=18, range=(-90.0, 90.0))
    result: list[int] = counts.tolist()
    return result
