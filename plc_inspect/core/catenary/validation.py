# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Evidence that a curve is a conductor, and not an edge that happens to be straight."""

from collections.abc import Iterator
from dataclasses import dataclass
import math

from plc_inspect.config import CatenarySettings
from plc_inspect.core.catenary.curve import Curve
from plc_inspect.core.catenary.duplicates import is_thick
from plc_inspect.core.catenary.free_length import FreeLength
from plc_inspect.core.catenary.growing import Profile

UNPROVEN = 'curvature not proven'
CROWDED = 'not free in the air'
STRAIGHT_RATIO, SAGGING_RATIO = 3.0, 0.5
"""Of ``min_free_length`` a straight curve needs the one share, one that sags the other."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """One figure of a curve and the limit that a conductor keeps."""

    setting: str
    """Of `CatenarySettings`, the limit."""
    value: float
    limit: float
    is_least: bool
    """The value must not be less than the limit, else not more."""
    objection: str
    """What is said where it is not kept."""
    scale: float = 1.0
    """Value and limit are of the setting times this."""

    @property
    def kept(self) -> bool:
        """Whether a conductor could have this value."""
        return not (self.value < self.limit if self.is_least else self.value > self.limit)


def find_objection(
    curve: Curve, profile: Profile, free: FreeLength, settings: CatenarySettings
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

    """
    found = (
        item.objection for item in list_evidence(curve, profile, free, settings) if not item.kept
    )
    return next(found, '')


def list_evidence(
    curve: Curve, profile: Profile, free: FreeLength, settings: CatenarySettings
) -> Iterator[Evidence]:
    """
    Yield all that is asked of a conductor, in the order of objections.

    A thin curve that is free along its length needs no curvature as proof: nothing else is
    straight, thin and alone in the air.  Where the curvature proves the conductor, things may be
    near it as long as few touch it.
    """
    def weigh(
        setting: str, value: float, objection: str, scale: float = 1.0
    ) -> Evidence:
        return Evidence(
            setting=setting,
            value=value,
            limit=getattr(settings, setting) * scale,
            is_least=setting.startswith('min_'),
            objection=objection,
            scale=scale,
        )

    yield weigh('min_length', curve.length, 'too short')
    yield weigh('min_points', curve.num_points, 'too few points')
    yield weigh('min_coverage', profile.coverage, 'seen in too few places')
    sigma = math.sqrt(max(float(curve.fit.covariance[2, 2]), 0.0))
    sags = (
        weigh('min_significance', float(curve.fit.shape[2]), UNPROVEN, sigma),
        weigh('max_constant', curve.fit.c, 'straighter than a conductor'),
    )
    straight = STRAIGHT_RATIO * settings.min_free_length
    if all(item.kept for item in sags):
        evidence = max(free.close, free.wide), SAGGING_RATIO
    else:
        evidence = free.wide, STRAIGHT_RATIO
    if evidence[1] == SAGGING_RATIO or is_thick(curve) or free.wide < straight:
        yield from sags
    yield weigh(
        'max_sag_ratio', curve.fit.sag(curve.low, curve.high)[0], 'deeper than a conductor',
        curve.length,
    )
    yield weigh('min_free_length', evidence[0], CROWDED, evidence[1])
    yield weigh('max_clutter', -free.wide, CROWDED, curve.length)
