# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Which curves are conductors, all of them judged together: wires hang side by side."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
import math

import numpy as np

from plc_inspect.config import CatenarySettings
from plc_inspect.core.catenary.curve import Curve
from plc_inspect.core.catenary.duplicates import find_along, find_slack, is_thick
from plc_inspect.core.catenary.profile import Profile, profile_curve
from plc_inspect.core.evidence.built import name_built
from plc_inspect.core.evidence.free_length import FreeLength, measure_free_length, UNKNOWN
from plc_inspect.core.evidence.groups import find_groups, prove_together
from plc_inspect.core.evidence.stays import (
    find_chords,
    find_fans,
    find_hung,
    find_stays,
    is_beam,
    is_solid,
    STEEP,
    STEEP_CONSTANT,
)
from plc_inspect.core.evidence.ties import Ties
from plc_inspect.core.evidence.validation import (
    BUILT,
    CROWDED,
    DEEP,
    find_objection,
    is_straight,
    may_be_held,
    prove_sag,
    RIGID,
    STAY,
    TIED,
    UNPROVEN,
    UNTIDY,
)
from plc_inspect.core.evidence.walls import Walls
from plc_inspect.core.ground.ground_grid import GroundGrid
from plc_inspect.core.numerics.plan_index import PlanIndex
from plc_inspect.core.numerics.threads import call_each
from plc_inspect.results import Bool, Float64, Int64

SIDE = 3.0
"""
Distance within which a piece runs beside a conductor [m].
Source: judgement; conductors of one low- or medium-voltage line are up to 1.5 m apart, and its
telecom wires hang 1 to 3 m below.
"""
MOST_OF_OTHERS = 0.5
"""
Share of what lies on a thick curve that may be of conductors beside it.
Source: measured: 0.09 to 0.4 where strips 0.2 m askew double two wires 0.5 m apart, 0.9 on a curve
through wires that cross it (random scenes 294010 and 296007).
"""
FREE_SHARE = 0.5
"""
Stays of a fan hang free along this share of their length, at least.
Source: judgement: gutters and ridges, which are as straight, have a roof beside them.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Verdict:
    """What is known of one curve, and why it is no conductor."""

    profile: Profile
    free: FreeLength
    objection: str
    """Empty for a conductor."""
    beside: bool
    """It was judged as one beside a conductor."""


class Judge:
    """Curves of one cloud, and what is believed of them so far."""

    def __init__(
        self,
        points: Float64,
        index: PlanIndex,
        sight: GroundGrid,
        curves: Sequence[Curve],
        settings: CatenarySettings,
        believed: Sequence[Verdict] = (),
    ) -> None:
        """Take the curves; what is believed of the first ones already is not judged again."""
        self._points, self._index, self._sight, self._settings = points, index, sight, settings
        self._ties, self._walls = Ties(points, index), Walls(points, index)
        self.curves = list(curves)
        """All that are judged; verdicts are in their order."""
        fresh = curves[len(believed):]
        profiles = call_each(
            lambda k: profile_curve(points, index, fresh[k], fresh[k].low, fresh[k].high),
            len(fresh),
        )
        self.wire: Bool = np.zeros(len(points), dtype=bool)
        """(N,) points that do not clutter a curve, as they are wires themselves."""
        self._spared = np.empty(0, dtype=np.int64)
        self._beams: list[tuple[Curve, FreeLength]] = []
        self.verdicts = [*believed, *(
            Verdict(
                profile=profile, free=UNKNOWN, beside=False,
                objection=find_objection(curve, profile, UNKNOWN, settings),
            )
            for curve, profile in zip(fresh, profiles, strict=True)
        )]
        self._mark(np.arange(len(believed)))

    def decide(self, *, beside: bool = True) -> None:
        """
        Judge all curves.

        A thin curve with all evidence but that it is free clutters no other one; and each that is
        free, once those are left out, frees its neighbours.  What is a truss is taken back, and
        at last short pieces beside a conductor are believed, and groups that are free but for
        each other, unless ``beside`` is False.
        """
        objections = np.array([verdict.objection for verdict in self.verdicts], dtype=object)
        proven = np.flatnonzero(objections == CROWDED)
        self._mark(proven)
        self._sweep(np.flatnonzero((objections != CROWDED) & (objections != '')), beside=False)
        self._try(proven, beside=False)
        self._sweep_thick()
        self.untie()
        self._unstay()
        self._unhold()
        if not beside:
            return
        self._sweep_beside()
        if self._try_groups():
            self._sweep_beside()
        self._unhold()
        self.untie()

    @property
    def believed(self) -> list[Curve]:
        """Curves that are conductors."""
        return [curve for curve, verdict in self._pairs() if not verdict.objection]

    @property
    def rejected(self) -> list[Curve]:
        """Curves that are none."""
        return [curve for curve, verdict in self._pairs() if verdict.objection]

    def spare(self, points: Int64) -> None:
        """Let some points clutter no curve, whatever becomes of those that they are of."""
        self._spared = points
        self.wire[points] = True

    def try_more(
        self, curves: Sequence[Curve], *, beside: bool = True, spared: Int64 | None = None
    ) -> list[tuple[Curve, Verdict]]:
        """
        Judge other curves with those that are believed; return those that are conductors.

        What was believed without a proven sag is so no more where it proves to be part of
        something built with them; nor is what is tied to them, or a stay.  With ``beside`` False,
        that they run beside one is no evidence.  Points that are ``spared`` clutter none of them.
        """
        known = np.flatnonzero([not verdict.objection for verdict in self.verdicts]).tolist()
        trial = Judge(
            self._points, self._index, self._sight,
            [*(self.curves[number] for number in known), *curves], self._settings,
            [self.verdicts[number] for number in known],
        )
        trial.spare(self._spared if spared is None else spared)
        trial._ties, trial._walls, trial._beams = self._ties.copy(), self._walls, self._beams
        trial.decide(beside=beside)
        for number, verdict in zip(known, trial.verdicts, strict=False):
            is_proven = prove_sag(self.curves[number], self._settings) == 1.0
            if verdict.objection in (STAY, TIED) or not is_proven:
                self.verdicts[number] = verdict
        return [
            item for item in zip(curves, trial.verdicts[len(known):], strict=True)
            if not item[1].objection
        ]

    def try_again(self, curves: Sequence[Curve]) -> list[tuple[Curve, Verdict]]:
        """
        Judge curves of places that were searched already; return those that are conductors.

        Looked at twice, what is straight has two chances to seem free: only a proven sag, or
        something beside it that is believed, is evidence then.
        """
        won: list[tuple[Curve, Verdict]] = []
        rest = self.try_more(curves)
        while True:
            known = [*self.believed, *(curve for curve, _ in won)]
            along = find_along([curve for curve, _ in rest], known, SIDE).tolist()
            sure = [
                is_beside or prove_sag(curve, self._settings) == 1.0
                for (curve, _), is_beside in zip(rest, along, strict=True)
            ]
            if not any(sure):
                return won
            won += [item for item, is_sure in zip(rest, sure, strict=True) if is_sure]
            rest = [item for item, is_sure in zip(rest, sure, strict=True) if not is_sure]

    def add(self, more: Sequence[tuple[Curve, Verdict]]) -> None:
        """Take more conductors with what is believed of them; longest curves stay first."""
        if not more:
            return
        every = [*self._pairs(), *more]
        every.sort(key=lambda item: (-item[0].length, *item[0].origin))
        self.curves = [curve for curve, _ in every]
        self.verdicts = [verdict for _, verdict in every]
        self._mark(np.flatnonzero([not verdict.objection for verdict in self.verdicts]))

    def _pairs(self) -> Iterator[tuple[Curve, Verdict]]:
        return zip(self.curves, self.verdicts, strict=True)

    def untie(self, *, anew: bool = False) -> None:
        """
        Take back what is tied together along its whole length: chords of a truss, rails, racks.

        Conductors beside each other have air between them.  What is tied to something taken back,
        or to a bar that is none of the bracing, is so too; what was compared is again if ``anew``.
        """
        self._ties = Ties(self._points, self._index) if anew else self._ties
        objection = np.array([verdict.objection for verdict in self.verdicts], dtype=object)
        known = np.flatnonzero(np.isin(objection, ['', CROWDED, UNPROVEN, UNTIDY, *BUILT]))
        sure = np.isin(objection, ['', *BUILT])
        own = np.zeros(len(self._points), dtype=bool)  # curves not believed may be the bracing
        for number in np.flatnonzero(sure).tolist():
            own[self.verdicts[number].profile.chosen] = True
        for number in np.flatnonzero(np.isin(objection, [CROWDED, UNPROVEN])).tolist():
            crowding = self.verdicts[number].profile.crowding
            sure[number] = crowding <= self._settings.max_crowding
            sure[number] &= not is_thick(self.curves[number])
        asked, curves = (objection == '')[known], [self.curves[k] for k in known.tolist()]
        hung = np.array([prove_sag(curve, self._settings) == 1.0 for curve in curves], dtype=bool)
        tied = self._ties.find(curves, own, asked, sure[known], hung)
        for number in known[tied & asked].tolist():
            self.verdicts[number] = replace(self.verdicts[number], objection=TIED)

    def _unstay(self) -> None:
        """Take back what is of a beam, fans out, or is steep and straight."""
        rest = [k for k, verdict in enumerate(self.verdicts) if verdict.objection != TIED]
        numbers = [
            number for number in rest if may_be_held(self.curves[number], self._settings)
        ]
        curves = [self.curves[number] for number in numbers]
        verdicts = [self.verdicts[number] for number in numbers]
        proofs = np.array([prove_sag(curve, self._settings) for curve in curves])
        straight, deep = proofs < 0.0, proofs == 1.0
        steep = np.array([
            abs(float(curve.fit.slope(0.5 * (curve.low + curve.high)))) > STEEP for curve in curves
        ], dtype=bool)
        bars = np.array([is_straight(curve, STEEP_CONSTANT) for curve in curves], dtype=bool)
        free = np.array([
            verdict.free.wide >= FREE_SHARE * curve.length
            for curve, verdict in zip(curves, verdicts, strict=True)
        ], dtype=bool)
        # beams of earlier searches hold what is found later
        self._beams = [*self._beams, *(
            (curve, verdict.free)
            for curve, verdict, proof in zip(curves, verdicts, proofs.tolist(), strict=True)
            if verdict.objection and is_beam(curve, verdict.free, proof)
        )]
        beams = [beam for beam, _ in self._beams]
        frames = [
            beam for beam, room in self._beams
            if beam.length >= self._settings.min_evidence and is_solid(beam, room)
        ]
        hanging = np.setdiff1d(rest, numbers)
        stays = find_stays(curves, straight | deep, beams) | find_chords(curves, frames)
        stays |= find_fans(curves, straight | steep, free & ~deep) | (steep & bars)
        hung = find_hung([self.curves[number] for number in hanging.tolist()], beams)
        for number in [*np.array(numbers, dtype=np.int64)[stays], *hanging[hung]]:
            self.verdicts[number] = replace(self.verdicts[number], objection=STAY)

    def _unhold(self) -> None:
        """
        Take back what is held evenly, lies along an edge or on a surface, or is a bar.

        What was taken back so is believed again where wires found since are all that held it.
        """
        known = np.flatnonzero([verdict.objection in ('', *RIGID) for verdict in self.verdicts])
        for number, objection in zip(known.tolist(), self.name_built(known), strict=True):
            self.verdicts[number] = replace(self.verdicts[number], objection=objection)

    def name_built(self, numbers: Int64, below: float = math.inf) -> list[str]:
        """Return of curves, by their numbers, what they are part of, as `built.name_built`."""
        return name_built(
            self._points, self._index, [self.curves[number] for number in numbers.tolist()],
            self.wire, self._walls, self._settings, below,
        )

    def _mark(self, numbers: Int64) -> None:
        for number in numbers.tolist():
            self.wire[self.verdicts[number].profile.chosen] = True

    def _sweep_thick(self) -> None:
        """Judge again what is thick and has a conductor at its surface, as of two strips askew."""
        thick = [
            number for number, verdict in enumerate(self.verdicts)
            if verdict.objection == UNTIDY
            and self.wire[verdict.profile.chosen].sum()
            <= MOST_OF_OTHERS * len(verdict.profile.chosen)
        ]
        along = find_along([self.curves[number] for number in thick], self.believed, SIDE)
        near = np.array(thick, dtype=np.int64)[along]
        self._look_anew(near.tolist())
        self._sweep(near, beside=False)

    def _sweep_beside(self) -> None:
        while self._sweep(self._find_beside(), beside=True):
            pass

    def _try_groups(self) -> bool:
        """Believe groups whose sags are proven together, if free but for each other; tell if."""
        rest = [number for number in range(len(self.curves)) if self._may_group(number)]
        known = [curve for curve in self.believed if not is_thick(curve)]
        found, verdicts = False, list(self.verdicts)
        for group, beside in find_groups(
            [self.curves[number] for number in rest], self._sight, SIDE, self._settings, known
        ):
            own = members = [rest[number] for number in group.tolist()]
            sure = [known[number] for number in beside.tolist()]
            while own and prove_together(
                [*(self.curves[number] for number in own), *sure], self._settings
            ):
                marked = np.concatenate([self.verdicts[k].profile.chosen for k in own])
                marked = marked[~self.wire[marked]]
                self.wire[marked] = True
                self._look_anew(own)
                won = self._try(np.array(own), beside=True).tolist()
                if won == own:
                    found = True
                    break
                self.wire[marked], own = False, won
                for number in members:
                    self.verdicts[number] = verdicts[number]
        return found

    def _may_group(self, number: int) -> bool:
        """Whether others beside a curve may be all that speaks against it."""
        curve, objection = self.curves[number], self.verdicts[number].objection
        if is_thick(curve):
            return objection in (UNTIDY, CROWDED) and prove_sag(curve, self._settings) == 1.0
        return objection in (UNPROVEN, CROWDED)

    def _look_anew(self, numbers: Sequence[int]) -> None:
        """Count what lies close about thick curves without the wires that are known now."""
        for number in numbers:
            curve = self.curves[number]
            if is_thick(curve):
                self.verdicts[number] = replace(self.verdicts[number], profile=profile_curve(
                    self._points, self._index, curve, curve.low, curve.high, ignore=self.wire,
                ))

    def _sweep(self, numbers: Int64, *, beside: bool) -> bool:
        """Judge curves over and over, as long as more of them are found free; tell if any was."""
        found = False
        while len(numbers) and len(won := self._try(numbers, beside=beside)):
            self._mark(won)
            numbers = np.setdiff1d(numbers, won)
            found = True
        return found

    def _try(self, numbers: Int64, *, beside: bool) -> Int64:
        """Judge curves with what is known now; return those that are conductors."""
        wanted = numbers.tolist()
        free = call_each(
            lambda k: measure_free_length(
                self._points, self._index, self.curves[wanted[k]], self.wire, self._sight
            ),
            len(wanted),
        )
        won = []
        for number, length in zip(wanted, free, strict=True):
            verdict = self.verdicts[number]
            objection = find_objection(
                self.curves[number], verdict.profile, length, self._settings, beside=beside
            )
            self.verdicts[number] = Verdict(
                profile=verdict.profile, free=length, objection=objection, beside=beside
            )
            if not objection:
                won.append(number)
        return np.array(won, dtype=np.int64)

    def _find_beside(self) -> Int64:
        """Return the curves that are thin, not believed, and beside one that is, or hang below."""
        rest = [
            number for number, verdict in enumerate(self.verdicts)
            if verdict.objection not in ('', *BUILT) and not is_thick(self.curves[number])
        ]
        curves, known = [self.curves[number] for number in rest], self.believed
        deep = np.array([self.verdicts[number].objection == DEEP for number in rest], dtype=bool)
        near = np.where(deep, find_slack(curves, known), find_along(curves, known, SIDE))
        return np.array(rest, dtype=np.int64)[near]
