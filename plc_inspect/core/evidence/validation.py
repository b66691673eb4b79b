# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Evidence that a curve is a conductor, and not an edge that happens to be straight."""

from collections.abc import Iterator
import math

from plc_inspect.checks import Check
from plc_inspect.config import CatenarySettings
from plc_inspect.core.catenary.curve import Curve
from plc_inspect.core.catenary.duplicates import is_thick, measure_thickness, THICK
from plc_inspect.core.catenary.profile import Profile
from plc_inspect.core.evidence.free_length import FreeLength

UNPROVEN = 'curvature not proven'
CROWDED = 'not free in the air'
TIED = 'tied to another line along its length'
STAY = 'a stay: of a beam below it, of a mast, or steep and straight'
HELD = 'touched at regular intervals, or along the edge of a deck or roof'
BORNE = 'borne by poles as a pipe is, or in its middle as an arm'
SCAN_LINE = 'one scan line over a surface: its points lie in a plane'
BAR = 'a bar or pipe: its points lie on one side of it'
WALL = 'on a wall: what is below it fills the same plane'
RIGID = (HELD, SCAN_LINE, BAR, WALL)
"""
What `built.name_built` tells of a curve.
Source: derived: the four above.
"""
BUILT = (TIED, STAY, *RIGID)
"""
Parts of something else: no evidence of a conductor helps them.
Source: derived: the five above.
"""
PLANE_RATIO = 0.1
"""
The points of a conductor scatter across it both ways, the lesser way at least by this share of the
other: a beam is as wide as it is long.
Source: measured: 556 curves on conductors of eight real clouds and 28 random scenes have 0.19 and
more, scan lines over roofs and racks 0.005 to 0.03.
"""
PLANE_SCATTER = 0.03
"""
That tells something where the greater way is more than this [m].
Source: data sheet: noise of ranges of the Puck Lite; what scatters less may be smooth.
"""
UNTIDY = 'thick, with other things at its surface'
DEEP = 'deeper than a conductor'
SLACK_RATIO = 2.5
"""
A conductor below others of its span may sag so many times ``max_sag_ratio``, as one that slipped.
Source: judgement: by a fifth of the span; at more it is on the ground.
"""
BONUS = 8.0
"""
Metres of evidence that a proven curvature is worth, or a conductor beside.
Source: measured: with them 4 free metres prove a curve, and 12 without; on the real clouds without
wires no straight thin curve had more than 9.4, `bench/frames.py`.
"""
THICK_COST = 50.0
"""
Metres of evidence against a curve for each THICK by which it is thicker than that.
Source: measured: on a plant and a building site pipes, kerbs and chords of 0.13 to 0.3 m have up
to 24, 54 and 71 free metres; bundles of 0.22 m have 200, three low-voltage wires in 0.16 m 31.
"""
PROVEN_SHARE = 0.3
"""
Share of that cost where the sag is proven.
Source: measured: pipes, kerbs and chords have no proven sag; three wires 0.3 m apart in strips
askew, 0.26 m thick, have 21 to 41 free metres (random scene 308037).
"""
STRAIGHT_THICK = 0.06
"""
The same cost begins here where a curve is straight, in proportion to how sure that is [m].
Source: derived: half of THICK; pipes of 0.25 m and more spread by this, conductors by their noise.
"""
CLOSE_RATIO = 2.0
"""
A free metre of the close ring stands for so many of the wide one, where both are asked of a curve.
Source: judgement; with few points a metre the close ring tells half as much as the wide one.
"""
STRAIGHT_CLUTTER = 0.5
"""
Share of ``max_clutter`` of its length that may be cluttered where a curve is straight.
Source: judgement; not measured.
"""
UNTIDY_RATIO = 4.0 / 3.0
"""A thick curve alone may have this many times ``max_crowding``.  Source: judgement."""
UNSEEN_RATIO = 3.0
"""A free metre below which nothing was seen counts one in so many.  Source: judgement."""
STRAIGHTEST, SURE = 3000.0, 2.0
"""
A curve that is straighter than this catenary constant [m], by two standard deviations, counts
against a conductor what a proven curvature counts for it.
Source: judgement; conductors are strung at 300 to 2500 m; pipes, beams and rails are straight.
"""
MISLAID = 0.03
"""
Error of a sag, beyond that of the fit, where strips or poses are mislaid (standard deviation) [m].
Source: judgement: strips of a survey are 2 to 5 cm apart.
"""
MOST_STRAIGHT = 3.5
"""
Surely straight counts at most so many times what a proven curvature does.
Source: judgement: a curve may lie over two spans and the support between; what is free all along
outweighs it, and what is half cluttered, as the pipes of a rack, does not.
"""
DEEPEST = 200.0
"""
A cable with a proven curvature that is held is no conductor below this catenary constant [m].
Source: derived: main cables of bridges sag by a tenth of their span, those of 150 m have 190 m;
conductors with spacers or diverters, and messengers of railways, have 300 m and more.
"""
LEAST_CONSTANT = 75.0
"""
Least catenary constant that proves a conductor [m].
Source: derived: a service drop of 1.4 N/m strung at 100 N; arcs of scan lines on roofs have less.
"""


def find_objection(
    curve: Curve,
    profile: Profile,
    free: FreeLength,
    settings: CatenarySettings,
    *,
    beside: bool = False,
) -> str:
    """
    Return why a curve is not believed to be a conductor, or an empty string.

    A conductor is long, seen along most of its length, hangs with a curvature that its points
    prove, sags no more than lines do, and has air about it.  Roof ridges, rails and walls are
    straight or go on beside the axis; arcs of single scan lines are too deep or too short.

    Parameters
    ----------
    curve : Curve
        The curve.
    profile : Profile
        Of the curve between its ends.
    free : FreeLength
        Metres of it that hang free in the air.
    settings : CatenarySettings
        Settings of this stage.
    beside : bool
        Whether it runs beside a conductor, where others are to be expected.

    """
    found = (
        item.objection
        for item in list_evidence(curve, profile, free, settings, beside=beside)
        if not item.kept
    )
    return next(found, '')


def prove_sag(curve: Curve, settings: CatenarySettings) -> float:
    """
    Return how far the curvature proves a conductor: 1 fully, 0 not, -1 and less surely straight.

    What is surely straight goes with the square of how sure that is, as likelihoods do.
    """
    sags = LEAST_CONSTANT <= curve.fit.c <= settings.max_constant
    proof = min(_measure_bend(curve, settings), 1.0) if sags else 0.0
    if proof == 1.0 or not is_straight(curve, STRAIGHTEST):
        return proof
    # with the curvature of such a sag
    sigma = math.hypot(_measure_sigma(curve), 8.0 * MISLAID / curve.length**2)
    deviations = (1.0 / STRAIGHTEST - float(curve.fit.shape[2])) / sigma
    return -min(max(deviations / SURE, 1.0)**2, MOST_STRAIGHT)


def is_bent(curve: Curve, settings: CatenarySettings) -> bool:
    """Tell whether a curve surely hangs, be it as deep as no conductor does."""
    return curve.fit.c <= settings.max_constant and _measure_bend(curve, settings) >= 1.0


def _measure_bend(curve: Curve, settings: CatenarySettings) -> float:
    """Return the significance of a curvature, by the one that is asked."""
    sigma = _measure_sigma(curve)
    return float(curve.fit.shape[2]) / sigma / settings.min_significance if sigma > 0.0 else 0.0


def _measure_sigma(curve: Curve) -> float:
    """Return the standard deviation of a curvature [1/m]."""
    return math.sqrt(max(float(curve.fit.covariance[2, 2]), 0.0))


def may_be_held(curve: Curve, settings: CatenarySettings) -> bool:
    """Tell whether something that touches a curve at even intervals may hold it, and not hang."""
    return curve.fit.c < DEEPEST or prove_sag(curve, settings) < 1.0


def is_straight(curve: Curve, constant: float) -> bool:
    """Tell whether a curve is surely straighter than a catenary of a constant [m]."""
    return float(curve.fit.shape[2]) + SURE * _measure_sigma(curve) < 1.0 / constant


def is_scan_line(curve: Curve) -> bool:
    """Tell whether the points of a thin curve lie in one plane, as those of one scan line do."""
    less, more = sorted((curve.lateral_rmse, curve.fit.rmse))
    return not is_thick(curve) and more > PLANE_SCATTER and less < PLANE_RATIO * more


def add_up(
    curve: Curve, free: FreeLength, settings: CatenarySettings, *, beside: bool = False
) -> float:
    """
    Add up the evidence that a curve is a conductor [m].

    Those metres count that are free, and a bonus for a curvature that the points prove, in
    proportion, or for a conductor beside; so far one line beside counts nothing against it.  A
    thick curve costs more, the thicker it is, and so does one that is surely straight, the wider
    it is.
    """
    proof = prove_sag(curve, settings)
    free = free.spare(max(proof, float(beside)))
    if is_thick(curve):
        cost = THICK_COST * (measure_thickness(curve) / THICK - 1.0)
        if proof == 1.0:
            cost *= PROVEN_SHARE
        return min(free.close, free.wide) + BONUS * proof - cost
    evidence = free.open
    if proof == 1.0:
        evidence = max(free.open, free.close, free.wide / UNSEEN_RATIO)
    elif not beside:
        evidence = min(free.open, CLOSE_RATIO * free.close) + free.alone / UNSEEN_RATIO
    if proof >= 0.0:
        return evidence + BONUS * max(proof, float(beside))
    # across alone: what lies over two spans misses their points in height
    cost = THICK_COST * max(curve.lateral_rmse / STRAIGHT_THICK - 1.0, 0.0)
    return evidence + BONUS * (proof + beside) + cost * proof / MOST_STRAIGHT


def list_evidence(
    curve: Curve,
    profile: Profile,
    free: FreeLength,
    settings: CatenarySettings,
    *,
    beside: bool = False,
) -> Iterator[Check]:
    """
    Yield all that is asked of a conductor, in the order of objections.

    Evidence is added up in metres (`add_up`).  What is thick must be free of what touches it and
    of what is about it, the more of it the thicker it is, and not be straight.
    """
    def weigh(name: str, value: float, objection: str, scale: float = 1.0) -> Check:
        return Check(
            setting=f'catenary.{name}',
            value=value,
            limit=getattr(settings, name) * scale,
            is_least=name.startswith('min_'),
            objection=objection,
            scale=scale,
        )

    proof = prove_sag(curve, settings)
    yield weigh('min_length', curve.length, 'too short')
    yield weigh('min_points', curve.num_points, 'too few points')
    yield weigh('min_coverage', profile.coverage, 'seen in too few places')
    yield weigh(
        'max_sag_ratio', curve.fit.sag(curve.low, curve.high)[0], DEEP,
        curve.length * (SLACK_RATIO if beside else 1.0),
    )
    if is_thick(curve):
        yield weigh('max_constant', curve.fit.c, 'straighter than a conductor')
        yield weigh('max_crowding', profile.crowding, UNTIDY, UNTIDY_RATIO)
    lacking = CROWDED if proof == 1.0 else UNPROVEN
    yield weigh('min_evidence', add_up(curve, free, settings, beside=beside), lacking)
    free = free.spare(max(proof, float(beside)))
    if proof == 1.0 or beside:
        yield weigh('max_clutter', -free.wide, CROWDED, curve.length)
    else:
        yield weigh('max_clutter', free.cluttered, CROWDED, STRAIGHT_CLUTTER * curve.length)
