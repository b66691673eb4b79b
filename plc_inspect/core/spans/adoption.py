# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Second looks: curves that supports prove to be conductors, or to be none."""

from collections.abc import Iterator, Sequence
import math

import numpy as np

from plc_inspect.config import CatenarySettings, Settings
from plc_inspect.core.catenary.bundles import widen_to
from plc_inspect.core.catenary.curve import Curve, find_near, pack_curves
from plc_inspect.core.catenary.curve_row import COS, SIN
from plc_inspect.core.catenary.duplicates import is_thick
from plc_inspect.core.catenary.profile import Profile, profile_curve
from plc_inspect.core.evidence.built import LONGEST_BAY
from plc_inspect.core.evidence.conductors import ConductorResult
from plc_inspect.core.evidence.contacts import is_regular
from plc_inspect.core.evidence.roof_rows import are_roof_rows
from plc_inspect.core.evidence.validation import may_be_held, prove_sag
from plc_inspect.core.extraction.off_ground import OffGround
from plc_inspect.core.ground.ground_grid import GroundGrid
from plc_inspect.core.numerics.threads import call_each
from plc_inspect.core.spans.joints import choose_pairs, meet_ends
from plc_inspect.core.spans.standing_poles import ARM, BESIDE, StandingPole
from plc_inspect.errors import FitError
from plc_inspect.results import Bool, Float64

ADOPTION_MISS = 0.3
"""
A doubtful curve meets a believed one within this [m].
Source: judgement; holds from 0.15 to 0.6 on bench/constants.py.
"""
ALIKE = math.cos(math.radians(30.0))
"""
Cosine of the turn from a conductor to what goes on from it over a roof, at least.
Source: judgement: rows of a scanner run any way; lines over ground that was not seen go on.
"""
LEAST_BAYS = 2
"""
Even intervals between poles that bear a pipe, at least.
Source: derived: one more that agrees with one; lines have no three poles so close.
"""
SURE_BAYS = 4
"""
As many that bear a pipe which seems to sag, as drift makes it do.
Source: derived: no line has five poles so close; random_scenes.py, 345019: 51 m on nine of them,
with a sag of 0.1 m.
"""
LONGEST_ARM = 24.0
"""
Length of what a pole bears by its middle, at most [m].
Source: judgement: arms of monopoles for 500 kV reach 8 to 10 m to each side.
"""
OFF_MIDDLE = 0.15
"""
Distance of the pole from the middle of its arm, as a share of the arm.
Source: judgement: the ends of one that is seen in part lie askew.
"""
ARM_END, HANGING, STANDING = 2.0, 5.0, 1.5
"""
Distance in plan of a conductor from the end of an arm, and below and above it, at most [m].
Source: judgement: conductors hang near the end of an arm, from strings of up to 4.5 m at 500 kV,
or stand on posts of insulators.
"""
ACROSS = math.sin(math.radians(45.0))
"""Sine of the turn from an arm to a conductor on it, at least.  Source: judgement."""


def find_borne(
    curves: Sequence[Curve], poles: Sequence[StandingPole], settings: CatenarySettings
) -> tuple[Curve, ...]:
    """
    Return the curves that poles bear as they bear pipes and rails, or their own arms.

    A pipe rests on them at even short intervals, an arm in its middle, with conductors across it
    at both of its ends.
    """
    borne = []
    for curve in curves:
        places = [curve.local_place(pole.position) for pole in poles if pole.holds(curve)]
        places = [item for item in places if curve.low - ARM <= item[0] <= curve.high + ARM]
        x = sorted(x for x, _ in places)
        least = LEAST_BAYS if may_be_held(curve, settings) else SURE_BAYS
        if is_regular(np.diff(x), LONGEST_BAY, least) or (
            prove_sag(curve, settings) < 1.0 and _is_arm(curve, places, curves)
        ):
            borne.append(curve)
    return tuple(borne)


def _is_arm(
    curve: Curve, poles: Sequence[tuple[float, float]], curves: Sequence[Curve]
) -> bool:
    """
    Tell whether a curve is held in its middle alone, and others pass across its ends.

    Of the poles that hold it there are x along it and y across it (P, 2) [m].
    """
    middle, most = 0.5 * (curve.low + curve.high), OFF_MIDDLE * curve.length
    if curve.length > LONGEST_ARM or not poles or not all(
        abs(x - middle) <= most and abs(y) <= BESIDE for x, y in poles
    ):
        return False
    first, last = (
        {number for number, other in enumerate(curves) if _passes_across(other, curve, end)}
        for end in curve.position(np.array([curve.low, curve.high]))
    )
    return bool(first and last) and len(first | last) > 1


def _passes_across(curve: Curve, arm: Curve, end: Float64) -> bool:
    """Tell whether a curve passes near the end of an arm (3,) [m], or ends there."""
    if abs(curve.row[SIN] * arm.row[COS] - curve.row[COS] * arm.row[SIN]) < ACROSS:
        return False
    x, y = curve.local_place(end)
    near = abs(y) <= ARM_END and curve.low - ARM_END <= x <= curve.high + ARM_END
    return near and -HANGING <= float(curve.fit.height(x)) - float(end[2]) <= STANDING


def adopt(
    cloud: OffGround, conductors: ConductorResult, sight: GroundGrid, settings: Settings
) -> tuple[Curve, ...]:
    """
    Find the curves that continue a conductor at a support, best seen first.

    A conductor goes on beyond its support, so a curve that meets it there needs no evidence of
    its own but that it is not one of many lines in a crown.  It is what the conductor is: the
    continuation of a bundle takes in all sub-conductors.  Others that continue conductors beside
    it are no crown.  The rows of a roof at which a service drop ends run another way.

    Parameters
    ----------
    cloud : OffGround
        Points of the curves.
    conductors : ConductorResult
        Curves that are believed, and those that may be.
    sight : GroundGrid
        Where the ground was seen.
    settings : Settings
        Of all stages.

    Returns
    -------
    tuple of Curve

    """
    # all that may go on, best seen first
    crowded = _clear(cloud, conductors, settings)
    waiting = sorted(
        [*conductors.doubtful, *crowded], key=lambda curve: (-curve.num_points, *curve.origin)
    )
    meetings = _Meetings(conductors.curves, waiting, settings.supports.max_reach)
    num, on_roof = len(conductors.curves), are_roof_rows(waiting, sight)

    def list_fit() -> Iterator[int]:
        for number, curve, partner in meetings.find_all():
            if not on_roof[number - num] or _run_alike(curve, partner):
                yield number

    # what is adopted may be gone on from in its turn
    while (adopted := next(list_fit(), None)) is not None:
        meetings.believe(adopted)
    return tuple(meetings.believed[num:])


def _run_alike(one: Curve, other: Curve) -> bool:
    """Tell whether two curves run the same way in plan, but for ALIKE."""
    cosine = one.row[COS] * other.row[COS] + one.row[SIN] * other.row[SIN]
    return abs(float(cosine)) >= ALIKE


class _Meetings:
    """Where curves that wait meet those that are believed; each two are looked at once."""

    def __init__(self, believed: Sequence[Curve], waiting: Sequence[Curve], reach: float) -> None:
        self._curves = [*believed, *waiting]
        self._known = list(range(len(believed)))
        self._rows, self._reach = pack_curves(self._curves), reach
        self._pairs, self._values = meet_ends(self._rows, len(believed), reach)

    @property
    def believed(self) -> list[Curve]:
        """In the order in which they came to be so."""
        return [self._curves[number] for number in self._known]

    def believe(self, number: int) -> None:
        """Believe one that waited."""
        self._known.append(number)
        order = np.append(number, np.setdiff1d(np.arange(len(self._curves)), self._known))
        pairs, values = meet_ends(self._rows[order], 1, self._reach)
        pairs[:, [0, 2]] = order[pairs[:, [0, 2]]]
        self._pairs = np.concatenate((self._pairs, pairs))
        self._values = np.concatenate((self._values, values))

    def find_all(self) -> Iterator[tuple[int, Curve, Curve]]:
        """Yield those that continue one that is believed, by number, and that one."""
        close = self._values[:, 2] < ADOPTION_MISS
        for number in np.setdiff1d(self._pairs[close, 2], self._known).tolist():
            partner = self._find_partner(number)
            if partner is not None:
                yield number, self._curves[number], partner

    def _find_partner(self, number: int) -> Curve | None:
        """Return the curve that one meets at a support, if no other meets it better there."""
        # those it may meet, and those that these may meet instead
        near = find_near([self._curves[number]], 4 * self._reach, self.believed).item
        around = [*np.array(self._known, dtype=np.int64)[near].tolist(), number]
        place = np.full(len(self._curves), -1)
        place[around] = np.arange(len(around))
        both = place[self._pairs[:, [0, 2]]]
        within = (both >= 0).all(axis=1)
        pairs, values = self._pairs[within], self._values[within]
        pairs[:, [0, 2]] = both[within]
        for k in choose_pairs(self._rows[around], pairs, values):
            if pairs[k, 2] == len(near) and values[k, 2] < ADOPTION_MISS:
                return self._curves[around[pairs[k, 0]]]
        return None


def _clear(
    cloud: OffGround, conductors: ConductorResult, settings: Settings
) -> tuple[Curve, ...]:
    """Return the crowded curves that are free once all that continue conductors are left out."""
    # those that continue a conductor, as wide as it is
    going_on: list[Curve] = []
    meetings = _Meetings(conductors.curves, conductors.crowded, settings.supports.max_reach)
    for _, curve, partner in meetings.find_all():
        if is_thick(partner) and not is_thick(curve):
            try:  # from a sub-conductor at the rim of the bundle to its middle
                for reach_across in (2.0 * partner.tolerance, partner.tolerance):
                    curve = widen_to(cloud.points, cloud.index, curve, reach_across)
            except FitError:
                continue
        going_on.append(curve)

    def profile(curve: Curve, ignore: Bool) -> Profile:
        return profile_curve(
            cloud.points, cloud.index, curve, curve.low, curve.high, ignore=ignore
        )

    # their points, too, are no clutter about the others
    wire = conductors.wire.copy()
    for chosen in call_each(lambda k: profile(going_on[k], wire).chosen, len(going_on)):
        wire[chosen] = True
    crowding = call_each(lambda k: profile(going_on[k], wire).crowding, len(going_on))
    limit = settings.catenary.max_crowding
    return tuple(
        curve for curve, share in zip(going_on, crowding, strict=True) if share <= limit
    )
