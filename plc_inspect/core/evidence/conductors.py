# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Curves of conductors from tracks: split at supports, fitted, bridged over gaps."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plc_inspect.config import CatenarySettings
from plc_inspect.core.catenary.bridging import bridge
from plc_inspect.core.catenary.bundles import BUNDLE_SHARE, merge_bundles, widen, widen_to
from plc_inspect.core.catenary.curve import Curve
from plc_inspect.core.catenary.cutting import cut_turned
from plc_inspect.core.catenary.duplicates import drop_duplicates, find_along, is_thick
from plc_inspect.core.catenary.growing import extend
from plc_inspect.core.catenary.mixed import find_mixed
from plc_inspect.core.catenary.track_fit import fit_tracks
from plc_inspect.core.catenary.twins import part_twins
from plc_inspect.core.clustering.clustering import ClusteringResult
from plc_inspect.core.evidence.built import RAIL
from plc_inspect.core.evidence.groups import cut_groups
from plc_inspect.core.evidence.judge import FREE_SHARE, Judge, SIDE, Verdict
from plc_inspect.core.evidence.searches import has_gaps, Searches
from plc_inspect.core.evidence.validation import (
    BUILT,
    CROWDED,
    list_evidence,
    prove_sag,
    UNTIDY,
)
from plc_inspect.core.ground.ground_grid import GroundGrid
from plc_inspect.core.numerics.plan_index import PlanIndex
from plc_inspect.core.numerics.threads import call_each
from plc_inspect.errors import FitError
from plc_inspect.results import Bool, Float64, Int64


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConductorResult:
    """Curves that are conductors, and those that may be."""

    curves: tuple[Curve, ...]
    """Longest first."""
    doubtful: tuple[Curve, ...]
    """
    With too little evidence of their own; conductors if they continue one at a support.
    """
    crowded: tuple[Curve, ...]
    """The same with other things close about them, which may be conductors themselves."""
    objections: dict[str, int]
    """Why the others were dropped, and how many."""
    wire: Bool
    """(N,) points that do not clutter a curve, as they are wires themselves."""


def model_conductors(
    points: Float64,
    index: PlanIndex,
    clustering: ClusteringResult,
    sight: GroundGrid,
    settings: CatenarySettings,
    rng: np.random.Generator,
    searches: Searches | None = None,
) -> ConductorResult:
    """
    Model every conductor of the tracks by a catenary, span by span.

    Curves take in the points along them, sub-conductors that cannot be told apart become one,
    the model bridges gaps, and what lacks the evidence of a conductor is dropped.  Of what is
    left, a curve over several conductors gives way to one for each, and further searches add to
    what is known.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    index : PlanIndex
        Of the points off the ground.
    clustering : ClusteringResult
        Segments and tracks.
    sight : GroundGrid
        Ground that was seen.
    settings : CatenarySettings
        Settings of this stage.
    rng : numpy.random.Generator
        For MSAC.
    searches : Searches or None
        Further ones, none by default.

    Returns
    -------
    ConductorResult

    """
    curves, judge = judge_curves(points, index, clustering, sight, settings, rng, searches)
    kept: list[Curve] = []
    waiting: list[int] = []
    objections: dict[str, int] = {}
    for number, (curve, verdict) in enumerate(zip(curves, judge.verdicts, strict=True)):
        if not verdict.objection:
            kept.append(curve)
            continue
        objections[verdict.objection] = objections.get(verdict.objection, 0) + 1
        if _may_continue(curve, verdict, settings):
            waiting.append(number)
    doubtful: list[Curve] = []
    crowded: list[Curve] = []
    # what may go on a conductor may pass below a roof
    built = judge.name_built(np.array(waiting, dtype=np.int64), below=RAIL)
    for number, name in zip(waiting, built, strict=True):
        if not name:
            crowding = judge.verdicts[number].profile.crowding
            (doubtful if crowding <= settings.max_crowding else crowded).append(curves[number])
    joined = bridge(points, kept, settings)  # a later search may have found the other part
    return ConductorResult(
        curves=part_twins(points, joined, settings),
        doubtful=part_twins(points, doubtful, settings), crowded=tuple(crowded), wire=judge.wire,
        objections=dict(sorted(objections.items())),
    )


def judge_curves(
    points: Float64,
    index: PlanIndex,
    clustering: ClusteringResult,
    sight: GroundGrid,
    settings: CatenarySettings,
    rng: np.random.Generator,
    searches: Searches | None = None,
) -> tuple[tuple[Curve, ...], Judge]:
    """
    Return all curves of the tracks, and what is believed of them.

    Those that ran over a support side by side are cut first.  A thick curve that is no conductor
    may lie over several: then its parts are tried, and those that are conductors take its place;
    of one that hangs and is free, none clutters another.  Where nothing but too little evidence
    speaks against a curve, it is searched again in shorter windows, and a sparse one by all
    points along it; then come steep conductors, sparse ones in longer windows, those beside
    others that are known, and at last bands of wires as wide as bundles.  Of what is known these
    take back only what proves to be built, as stays of a crane whose jib is found then.  The
    arguments are those of `model_conductors`.
    """
    curves, parts = find_curves(points, index, clustering, settings, rng)
    curves = cut_groups(points, curves, sight, SIDE, settings)
    curves = _unmix(points, index, curves, settings, rng)
    judge = Judge(points, index, sight, curves, settings)
    judge.decide()
    freed = _find_within(curves, judge.verdicts, parts, settings)
    if freed:
        believed, spared = judge.believed, _list_bundles(curves, judge.verdicts, settings)
        fresh = _keep_new(points, freed, settings, believed)
        won = [curve for curve, _ in judge.try_more(fresh, spared=spared)]
        if won:
            known = {id(curve) for curve in believed}
            rest = [curve for curve in curves if id(curve) not in known]
            curves = drop_duplicates(points, rest, settings, [*believed, *won])
            judge = Judge(points, index, sight, curves, settings)
            judge.spare(spared)
            judge.decide()
    if searches is None:
        return tuple(judge.curves), judge
    unsure = [
        curve for curve, verdict in zip(judge.curves, judge.verdicts, strict=True)
        if verdict.objection and _may_continue(curve, verdict, settings)
    ]
    if unsure:
        looks = searches.look_again(unsure), searches.look_along(unsure, judge.believed)
        found = tuple(
            curve for tracks in looks
            for curve in find_curves(points, index, tracks, settings, rng)[0]
        )
        judge.add(judge.try_again(_keep_new(points, found, settings, judge.believed)))
    found, _ = find_curves(points, index, searches.look_steeply(judge.believed), settings, rng)
    judge.add(judge.try_again(_keep_new(points, found, settings, judge.believed)))
    found, _ = find_curves(points, index, searches.look_sparsely(judge.believed), settings, rng)
    sparse = [curve for curve in found if has_gaps(points, index, curve)]
    judge.add(judge.try_more(_keep_new(points, sparse, settings, judge.believed)))
    if believed := judge.believed:
        tracks = searches.look_beside(believed, judge.rejected)
        found, _ = find_curves(points, index, tracks, settings, rng)
        fresh = _keep_new(points, found, settings, believed)
        judge.add(judge.try_more(fresh, beside=False))  # that has led to them already
    if wide := _widen_rest(points, index, judge, settings):
        judge.add(judge.try_more(_keep_new(points, wide, settings, judge.believed)))
    judge.untie(anew=True)  # of all that was rejected
    return tuple(judge.curves), judge


def _widen_rest(
    points: Float64, index: PlanIndex, judge: Judge, settings: CatenarySettings
) -> list[Curve]:
    """Return as wide as bundles what surely hangs and is free but for what is at its surface."""
    result = []
    for curve, verdict in zip(judge.curves, judge.verdicts, strict=True):
        if (
            verdict.objection == UNTIDY and prove_sag(curve, settings) == 1.0
            and verdict.free.wide >= FREE_SHARE * curve.length
        ):
            try:
                wide = widen_to(points, index, curve, BUNDLE_SHARE * settings.bundle_width)
            except FitError:
                continue
            result.append(wide)
    return result


def _keep_new(
    points: Float64, curves: Sequence[Curve], settings: CatenarySettings,
    believed: Sequence[Curve],
) -> list[Curve]:
    """Return those curves that are no duplicates of each other, or of what is believed."""
    known = {id(curve) for curve in believed}
    return [
        curve for curve in drop_duplicates(points, curves, settings, believed)
        if id(curve) not in known
    ]


def find_curves(
    points: Float64,
    index: PlanIndex,
    clustering: ClusteringResult,
    settings: CatenarySettings,
    rng: np.random.Generator,
    others: Sequence[Curve] = (),
    *,
    apart: bool = False,
) -> tuple[tuple[Curve, ...], tuple[Curve, ...]]:
    """
    Return all curves of the tracks, grown, joined and freed of duplicates, before evidence.

    They leave to ``others`` the points of these, and to each other where they are known to be
    ``apart``, as for `extend`.  Further returned are thin curves taken for parts of them.
    """
    curves = bridge(points, fit_tracks(points, clustering, settings, rng), settings)
    cut = _cut_turned(points, extend(points, index, curves, settings, others, apart=apart))
    grown = [part for parts in cut for part in parts]
    done = {id(curve) for curve in grown}
    curves = drop_duplicates(points, merge_bundles(points, grown, settings), settings)
    curves = merge_bundles(points, bridge(points, curves, settings), settings)
    fresh = [curve for curve in curves if id(curve) not in done]
    settled = [*others, *(curve for curve in curves if id(curve) in done)]
    again = iter(_cut_turned(points, extend(points, index, fresh, settings, settled, apart=apart)))
    long = [
        part for curve in curves for part in ([curve] if id(curve) in done else next(again))
    ]
    wide = call_each(lambda k: widen(points, index, long[k], settings), len(long))
    result = drop_duplicates(points, merge_bundles(points, wide, settings), settings)
    known = {id(curve) for curve in result}
    parts = tuple(curve for curve in grown if id(curve) not in known and not is_thick(curve))
    return result, parts


def _unmix(
    points: Float64, index: PlanIndex, curves: tuple[Curve, ...], settings: CatenarySettings,
    rng: np.random.Generator,
) -> tuple[Curve, ...]:
    """Give the curves of conductors the place of those that run from one into the next."""
    mixed, tracks = find_mixed(points, index, curves)
    if not mixed.any():
        return curves
    rest = [curve for curve, is_mixed in zip(curves, mixed.tolist(), strict=True) if not is_mixed]
    found, _ = find_curves(points, index, tracks, settings, rng, rest, apart=True)
    return drop_duplicates(points, [*rest, *found], settings)


def _cut_turned(points: Float64, curves: Sequence[Curve]) -> list[list[Curve]]:
    """Return the parts of each curve: itself, unless it turns at a support."""
    return call_each(lambda k: cut_turned(points, curves[k]), len(curves))


def _find_within(
    curves: Sequence[Curve], verdicts: Sequence[Verdict], parts: Sequence[Curve],
    settings: CatenarySettings,
) -> list[Curve]:
    """Return the parts along thick curves that are no conductors."""
    failed = [
        curve for curve, verdict in zip(curves, verdicts, strict=True)
        if verdict.objection not in ('', *BUILT) and is_thick(curve)
    ]
    along = find_along(parts, failed, settings.bundle_width)
    return [parts[k] for k in np.flatnonzero(along).tolist()]


def _list_bundles(
    curves: Sequence[Curve], verdicts: Sequence[Verdict], settings: CatenarySettings
) -> Int64:
    """Return the points of thick curves that hang, have air about them, and failed as thick."""
    chosen = [
        verdict.profile.chosen for curve, verdict in zip(curves, verdicts, strict=True)
        if verdict.objection == CROWDED and is_thick(curve)
        and prove_sag(curve, settings) == 1.0
        and verdict.free.wide >= FREE_SHARE * curve.length
    ]
    return np.unique(np.concatenate([np.empty(0, dtype=np.int64), *chosen]))


def _may_continue(curve: Curve, verdict: Verdict, settings: CatenarySettings) -> bool:
    """Whether nothing but too little evidence speaks against a curve."""
    evidence = list_evidence(curve, verdict.profile, verdict.free, settings)
    against = {item.setting for item in evidence if not item.kept}
    return verdict.objection not in BUILT and against <= {
        'catenary.max_constant', 'catenary.max_crowding', 'catenary.min_evidence',
        'catenary.max_clutter',
    }
