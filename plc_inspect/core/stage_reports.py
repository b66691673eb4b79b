# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What each stage reports of its result: counts, reasons, thresholds and histograms."""

import math

import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.clustering.clustering import ClusteringResult
from plc_inspect.core.corridor import CorridorResult
from plc_inspect.core.evidence.conductors import ConductorResult
from plc_inspect.core.evidence.validation import BORNE
from plc_inspect.core.extraction.alignment import AlignmentResult
from plc_inspect.core.extraction.dust import LONE
from plc_inspect.core.extraction.height import HeightResult
from plc_inspect.core.extraction.linearity import LinearityResult
from plc_inspect.core.extraction.outliers import OutlierResult
from plc_inspect.core.hazards.clearance_rules import describe_rules, RuleSet
from plc_inspect.core.hazards.hazards import HazardResult
from plc_inspect.core.spans.layout import Layout
from plc_inspect.core.spans.spans import SpanResult
from plc_inspect.core.stage_log import Outcome
from plc_inspect.results import Float64


def report_height(height: HeightResult, num_strays: int = 0, num_lone: int = 0) -> Outcome:
    """Count the high points; strays and lone returns are among those that are not finite."""
    num, num_high = len(height.height), int(np.count_nonzero(height.high))
    return Outcome(
        num_in=num,
        num_kept=num_high,
        dropped={
            'not finite': height.num_not_finite - num_strays - num_lone,
            'isolated, far away': num_strays,
            LONE: num_lone,
            'too low': num - height.num_not_finite - num_high,
        },
        values={
            'threshold': height.threshold if math.isfinite(height.threshold) else None,
            'histogram': height.histogram.tolist(),
            'edges': [float(height.edges[0]), float(height.edges[-1])],
            'cell_size': height.ground.cell_size,
        },
    )


def report_linearity(candidates: LinearityResult, settings: Settings) -> Outcome:
    """Count the candidates."""
    num, num_kept = sum(candidates.num_voxels), len(candidates.position)
    return Outcome(
        num_in=num,
        num_kept=num_kept,
        dropped={'not linear': num - num_kept},
        values={
            'threshold': settings.linearity.threshold,
            'max_inclination_deg': settings.linearity.max_inclination_deg,
            'neighborhoods': list(candidates.sizes),
            'voxels': list(candidates.num_voxels),
            'points_in_bulk': candidates.num_bulk,
            'likeness_of_all': candidates.histogram,
            'likeness': np.histogram(candidates.linear, bins=20, range=(0.5, 1.0))[0].tolist(),
        },
    )


def report_outliers(outliers: OutlierResult) -> Outcome:
    """Count the candidates that are near others."""
    keep = outliers.keep
    return Outcome(
        num_in=len(keep),
        num_kept=int(keep.sum()),
        dropped={'far from the others': int((~keep).sum())},
        values={
            'mean': outliers.mean,
            'sigma': outliers.sigma,
            'threshold': outliers.threshold if math.isfinite(outliers.threshold) else None,
        },
    )


def report_alignment(alignment: AlignmentResult, settings: Settings) -> Outcome:
    """Count the candidates that run with others."""
    return Outcome(
        num_in=len(alignment.voted),
        num_kept=int(alignment.voted.sum()),
        dropped={'too few in line': int((~alignment.voted).sum())},
        values={
            'min_votes': settings.alignment.min_votes,
            'windows': len(alignment.azimuth),
            'azimuths_deg': _azimuth_histogram(alignment.azimuth),
        },
    )


def report_clustering(clustering: ClusteringResult) -> Outcome:
    """Count the pieces that are one conductor each."""
    num, num_kept = clustering.num_clusters, len(clustering.segments)
    return Outcome(
        num_in=num,
        num_kept=num_kept,
        dropped={'not one conductor': max(num - num_kept, 0)},
        values={
            'eps': clustering.eps,
            'min_points': clustering.min_points,
            'tracks': clustering.num_tracks,
        },
    )


def report_catenary(conductors: ConductorResult, clustering: ClusteringResult) -> Outcome:
    """Count the curves that are believed."""
    return Outcome(
        num_in=clustering.num_tracks,
        num_kept=len(conductors.curves),
        dropped=conductors.objections,
        values={
            'constants': [round(curve.fit.c, 1) for curve in conductors.curves],
            'rmse': [round(curve.fit.rmse, 4) for curve in conductors.curves],
        },
    )


def report_supports(layout: Layout, spans: SpanResult, num_borne: int) -> Outcome:
    """Count joints and supports, and curves that poles bear."""
    return Outcome(
        num_in=len(layout.joints),
        num_kept=len(spans.supports),
        dropped={BORNE: num_borne},
        values={
            'spans': len(spans.models), 'kinds': [support.kind for support in spans.supports],
        },
    )


def report_corridor(corridor: CorridorResult, num_points: int) -> Outcome:
    """Count the points of the corridor."""
    return Outcome(
        num_in=num_points,
        num_kept=len(corridor.points),
        dropped={'beyond the search radius': num_points - len(corridor.points)},
        values={
            'radius': [round(float(value), 2) for value in corridor.radius],
            'complex_case': [bool(value) for value in corridor.complex_case],
        },
    )


def report_hazards(found: HazardResult, num_near: int, rules: RuleSet) -> Outcome:
    """Count the hazards, and name the rules."""
    return Outcome(
        num_in=num_near, num_kept=len(found.hazards),
        values=describe_rules(rules) | {'unmodelled_wires': found.num_unmodelled},
    )


def _azimuth_histogram(azimuth: Float64) -> list[int]:
    """Windows per 10 degrees of azimuth, from -90 degrees on."""
    counts, _ = np.histogram(np.degrees(azimuth), bins=18, range=(-90.0, 90.0))
    result: list[int] = counts.tolist()
    return result
