# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The stages that decide what is a line, in the paper's order."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.catenary.curve import Curve
from plc_inspect.core.catenary.cutting import find_doubtful
from plc_inspect.core.catenary.duplicates import find_along
from plc_inspect.core.clustering.clustering import cluster, ClusteringResult
from plc_inspect.core.evidence.conductors import ConductorResult, model_conductors
from plc_inspect.core.evidence.endings import cut_ends
from plc_inspect.core.evidence.judge import SIDE
from plc_inspect.core.evidence.searches import Searches
from plc_inspect.core.extraction.alignment import align, AlignmentResult
from plc_inspect.core.extraction.height import extract_high, HeightResult
from plc_inspect.core.extraction.linearity import (
    anchor,
    find_candidates,
    LinearityResult,
    measure_scales,
    STEEPEST_DEG,
)
from plc_inspect.core.extraction.off_ground import gather_off_ground, OffGround
from plc_inspect.core.extraction.outliers import OutlierResult, remove_outliers
from plc_inspect.core.ground.ground_grid import GroundGrid
from plc_inspect.core.ground.ground_surface import measure_surface, Surface
from plc_inspect.core.spans.adoption import adopt, find_borne
from plc_inspect.core.spans.crossarms import find_crossarms
from plc_inspect.core.spans.ground_revision import raise_ground, renumber_points, revise_ground
from plc_inspect.core.spans.layout import find_layout, Layout
from plc_inspect.core.spans.point_claims import settle_strays
from plc_inspect.core.spans.route import EAST, trace_routes
from plc_inspect.core.spans.service_drops import add_taps
from plc_inspect.core.spans.spans import build_spans, SpanResult, spread_spans, tell_evidence
from plc_inspect.core.spans.standing_poles import find_poles
from plc_inspect.core.stage_log import StageLog, StageMemory
from plc_inspect.core.stage_reports import (
    report_alignment,
    report_catenary,
    report_clustering,
    report_height,
    report_linearity,
    report_outliers,
    report_supports,
)
from plc_inspect.core.whole import make_draws, unpack, Whole
from plc_inspect.results import Float64

MOST_SEARCHES = 4
"""
How often the cloud is searched where conductors that were found show that others lay for ground.
Source: judgement: each search frees 10 to 20 m more of a span, and takes as long as the first.
"""


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
    searches: Searches
    """Further searches, beyond those for the candidates."""
    alignment: AlignmentResult
    clustering: ClusteringResult
    sight: GroundGrid
    """Ground that was seen when conductors were judged."""
    conductors: ConductorResult
    borne: tuple[Curve, ...]
    """Those of the conductors' curves that poles bear as they bear pipes: none after all."""
    layout: Layout
    spans: SpanResult
    """With labels of all N points."""
    risen: HeightResult | None
    """Ground above which the cloud is to be searched again, None where it need not be."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Hung:
    """Conductors cut into spans, and the ground below them."""

    height: HeightResult
    borne: tuple[Curve, ...]
    layout: Layout
    spans: SpanResult


def find_lines(
    points: Float64,
    settings: Settings,
    log: StageLog,
    east: Float64 = EAST,
    whole: Whole | None = None,
) -> FoundLines:
    """
    Run the stages from the height histogram to the supports.

    Parameters
    ----------
    points : (N, 3) float64, map frame, z up [m]
        Contiguous and writeable; rows that are not finite are left out.
    settings : Settings
        Of all stages.
    log : StageLog
        Takes the reports; what its memory knows is not computed again.
    east : (2,) float64
        Unit vector in plan; lines and spans are numbered along it.
    whole : Whole or None
        The cloud of which these points are a part, in whose frame they are.

    Returns
    -------
    FoundLines

    """
    found = _find_once(points, settings, log, east, whole)
    for _ in range(MOST_SEARCHES - 1):
        if found.risen is None:
            break
        log.begin_again()
        found = _find_once(points, settings, log, east, whole, found.risen)
    return found


def _find_once(
    points: Float64, settings: Settings, log: StageLog, east: Float64, whole: Whole | None,
    ground: HeightResult | None = None,
) -> FoundLines:
    """Run the stages once, with the heights that an earlier run has left where it is given."""
    rng = make_draws(settings)
    _, _, anchored, usual = unpack(whole)

    # High elevation extraction: heights above local ground, and what is high enough for a wire.
    height = log.run(
        settings.height,
        lambda: ground or _measure_height(points, settings, log, whole),
        lambda result: report_height(result, log.num_strays, log.num_lone),
    )
    cloud = log.recall_after(
        'cloud', settings.segment.min_points, lambda: _gather(points, height, settings, anchored)
    )

    # Eqs. 1 to 3: places where points lie along a line, at several scales.
    linearity = settings.linearity
    origin = anchor(cloud.points, cloud.high, linearity)
    scales = log.recall_after(
        'scales',
        (settings.segment.min_points, linearity.voxel_size, linearity.num_scales,
         linearity.max_occupied),
        lambda: measure_scales(cloud.points, cloud.high, origin, linearity),
    )
    candidates = log.run(
        (settings.segment.min_points, linearity),
        lambda: find_candidates(cloud.points, cloud.high, origin, linearity, scales),
        lambda result: report_linearity(result, settings),
    )
    steep = log.recall_after('steep', None, lambda: find_candidates(
        cloud.points, cloud.high, origin, replace(linearity, max_inclination_deg=STEEPEST_DEG),
        scales, linearity.max_inclination_deg,
    ))

    # Filt_thres: candidates far from all others are no wire.
    outliers = log.run(
        settings.outliers,
        lambda: remove_outliers(candidates.position, settings.outliers, usual),
        report_outliers,
    )
    inliers = candidates.select(outliers.keep)
    searches = Searches(
        cloud=cloud, inliers=inliers, steep=steep, scales=scales, settings=settings
    )

    # Regularization, R_z: windows of the cloud in which lines run straight in one direction.
    alignment = log.run(
        settings.alignment, lambda: align(inliers, settings.alignment),
        lambda result: report_alignment(result, settings),
    )

    # Two-stage clustering: DBSCAN across the line, then what continues each other along it.
    clustering = log.run(
        settings.clustering,
        lambda: cluster(
            cloud.points, cloud.index_high(), inliers.position, alignment, settings.clustering
        ),
        report_clustering,
    )

    # Eqs. 6 and 7: catenaries, and which of them are conductors.
    sight = height.ground
    conductors = log.run(
        None,
        lambda: model_conductors(
            cloud.points, cloud.index, clustering, sight, settings.catenary, rng, searches,
        ),
        lambda result: report_catenary(result, clustering),
    )

    # Supports: where conductors hang, and the spans between them.
    hung = log.run(
        None,
        lambda: _hang(
            *_revise(points, height, cloud, conductors, settings, whole),
            (inliers, steep), settings, rng, east,
        ),
        lambda result: report_supports(result.layout, result.spans, len(result.borne)),
    )
    return FoundLines(
        height=hung.height,
        cloud=cloud,
        candidates=candidates,
        outliers=outliers,
        inliers=inliers,
        searches=searches,
        alignment=alignment,
        clustering=clustering,
        sight=sight,
        conductors=conductors,
        borne=hung.borne,
        layout=hung.layout,
        spans=hung.spans,
        risen=None if hung.height is height else raise_ground(
            points, height, hung.height, settings.height, unpack(whole)[0]
        ),
    )


def keep_surface(memory: StageMemory, surface: Surface, settings: Settings) -> None:
    """Keep a surface that is known already, so that `find_lines` does not measure it."""
    memory.keep('surface', _list_ground(settings), (surface,))


def _list_ground(settings: Settings) -> tuple[float, float]:
    """Return the settings that the surface depends on."""
    return settings.height.cell_size, settings.height.max_slope_deg


def _measure_height(
    points: Float64, settings: Settings, log: StageLog, whole: Whole | None
) -> HeightResult:
    """Return the heights above the lowest points."""
    region, peak, _, _ = unpack(whole)
    surface = log.recall(
        'surface', _list_ground(settings),
        lambda: measure_surface(points, settings.height, region=region),
    )
    return extract_high(points, settings.height, surface=surface, peak=peak)


def _gather(
    points: Float64, height: HeightResult, settings: Settings, anchored: Float64 | None
) -> OffGround:
    """Points off the ground; too few points have no high ones among them."""
    cloud = gather_off_ground(points, height, settings.height.beta / 2, anchored)
    if len(points) - height.num_not_finite < settings.segment.min_points:
        return replace(cloud, high=cloud.high[:0])
    return cloud


def _revise(
    points: Float64,
    height: HeightResult,
    cloud: OffGround,
    conductors: ConductorResult,
    settings: Settings,
    whole: Whole | None,
) -> tuple[HeightResult, OffGround, ConductorResult]:
    """Find the ground anew below the conductors, and with it the points off the ground."""
    region, _, anchored, _ = unpack(whole)
    # what hangs below a conductor may lie for ground as well
    rest = (*conductors.doubtful, *conductors.crowded)
    beside = np.flatnonzero(find_along(rest, conductors.curves, SIDE)).tolist()
    wires = [*conductors.curves, *(rest[number] for number in beside)]
    revised = revise_ground(points, height, wires, settings.height, region)
    if revised is height:
        return height, cloud, conductors
    own = gather_off_ground(points, revised, settings.height.beta / 2, anchored)
    wire = np.zeros(own.num_total, dtype=np.bool_)
    wire[cloud.place] = conductors.wire
    return revised, own, replace(
        conductors,
        curves=renumber_points(conductors.curves, cloud, own),
        doubtful=renumber_points(conductors.doubtful, cloud, own),
        crowded=renumber_points(conductors.crowded, cloud, own),
        wire=wire[own.place],
    )


def _hang(
    height: HeightResult,
    cloud: OffGround,
    conductors: ConductorResult,
    seeds: Sequence[LinearityResult],
    settings: Settings,
    rng: np.random.Generator,
    east: Float64,
) -> _Hung:
    """Find spans and supports."""
    arms = find_crossarms(cloud, conductors.curves, conductors.wire)
    told = find_doubtful(cloud.points, conductors.curves, settings.supports.width)
    poles = find_poles(cloud, conductors.curves, conductors.wire, arms, told)
    borne = find_borne(conductors.curves, poles, settings.catenary)
    conductors = replace(conductors, curves=cut_ends(
        cloud.points, cloud.index,
        [curve for curve in conductors.curves if curve not in borne], conductors.wire,
        np.array([pole.position for pole in poles]).reshape(-1, 2),
    ))
    layout = find_layout(
        cloud.points, conductors.curves, adopt(cloud, conductors, height.ground, settings),
        settings.supports, poles,
    )
    spans = build_spans(cloud, layout, trace_routes(layout, east), settings, rng)
    spans = add_taps(cloud, seeds, spans, settings)
    spans = settle_strays(cloud, spans)
    spans = tell_evidence(cloud, spans, height.ground, settings.catenary)
    spans = spread_spans(spans, cloud)
    return _Hung(height=height, borne=borne, layout=layout, spans=spans)
