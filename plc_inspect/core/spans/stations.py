# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Supports as conductors tell of them: joints side by side, and what passes unbroken."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from plc_inspect.config import SupportSettings
from plc_inspect.core.catenary.curve import Curve
from plc_inspect.core.catenary.cutting import cut_curve, measure_bend
from plc_inspect.core.numerics.disjoint_sets import unite
from plc_inspect.core.spans.joints import Joint, MIN_RISE, TURN_SIGMAS
from plc_inspect.core.spans.standing_poles import ARM, StandingPole
from plc_inspect.results import Float64

PARALLEL = math.radians(15.0)
"""
Conductors of one span differ by less in azimuth.
Source: judgement; holds from 7.5 to 30 degrees on bench/constants.py.
"""
HEIGHT_ROOM = 20.0
"""
A conductor passes a support at most this far above or below those that end there [m].
Source: derived: earth wire to lowest conductor of a tower with two circuits on three levels.
"""
UNSEEN = 0.5
"""
Of a pole at most so much of the height that was seen stands above it unseen.
Source: judgement: three wires of a street hang 1.5 m above what was seen of their pole of 9 m.
"""
SKEW = 0.3
"""
Attachments lie apart along the line by this share of what they do across it, or less.
Source: judgement; not measured.
"""
MOST_ASIDE, MOST_ABOVE = 5.0, 10.0
"""
What meets farther aside, and farther above or below all others that do, hangs elsewhere [m].
Source: derived: levels of a tower are 7 to 10 m apart; a line of low voltage beside one, which a
tower may bear below, hangs 12 m lower (planted hazards 268000).
"""
POLE_RISE = 2.0
"""
Height above the highest conductor of a line that it holds to which a pole rises, at most, that
gives none of them a kink [m].
Source: measured: slender trees that passed for poles on random scenes rose 3.4 and 3.8 m above,
poles of four real clouds at most 1.8 m.
"""
LEAST_SIGMA = 1e-6
"""Standard deviation of a bend, at least.  Source: numerical: avoids a division by 0."""

Lack = tuple[float, float]  # of the bend that a support gives, as a slope, and its sigma


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Station:
    """A support as the conductors tell of it."""

    position: Float64
    """(2,) plan position: the middle of the attachments [m]."""
    direction: float
    """Azimuth of the line, modulo pi [rad]."""
    attachments: Float64
    """(K, 3) where conductors meet at it [m]."""
    ceiling: float = math.inf
    """Nothing that passes higher hangs at it [m]; infinite where no poles hold all of these."""

    def may_hold(self, z: float) -> bool:
        """Tell whether a conductor that passes at a height [m] may hang at it."""
        height = self.attachments[:, 2]
        top = min(float(height.max()) + HEIGHT_ROOM, self.ceiling)
        return float(height.min()) - HEIGHT_ROOM < z < top


def group_joints(
    joints: Sequence[Joint], settings: SupportSettings
) -> tuple[tuple[Joint, ...], ...]:
    """Collect the joints that lie side by side across the line: those of one support."""
    pairs = []
    for i, first in enumerate(joints):
        for j in range(i):
            second = joints[j]
            if abs(math.sin(first.direction - second.direction)) > math.sin(PARALLEL):
                continue
            apart = second.position[:2] - first.position[:2]
            along = apart[0] * math.cos(first.direction) + apart[1] * math.sin(first.direction)
            across = apart[1] * math.cos(first.direction) - apart[0] * math.sin(first.direction)
            slack = settings.radius + SKEW * abs(across)
            places = first.position[None], second.position[None]
            if abs(along) <= slack and abs(across) <= settings.width and not hang_apart(*places):
                pairs.append((i, j))
    groups: dict[int, list[Joint]] = {}
    for number, joint in zip(unite(pairs, len(joints)).tolist(), joints, strict=True):
        groups.setdefault(number, []).append(joint)
    return tuple(tuple(group) for group in groups.values())


def hang_apart(first: Float64, second: Float64) -> bool:
    """Tell whether no attachments of two sets, (K, 3) and (M, 3) [m], may be of one support."""
    apart = np.abs(first[:, None, :] - second[None, :, :])
    aside = np.hypot(apart[..., 0], apart[..., 1])
    return bool(((aside > MOST_ASIDE) & (apart[..., 2] > MOST_ABOVE)).all())


def place_station(group: Sequence[Joint], poles: Sequence[StandingPole] = ()) -> Station:
    """Return the support of at least one joint, and of the poles that stand there."""
    attachments = np.array([joint.position for joint in group])
    doubled = np.array([2 * joint.direction for joint in group])
    direction = 0.5 * math.atan2(float(np.sin(doubled).mean()), float(np.cos(doubled).mean()))
    unit = np.array([math.cos(direction), math.sin(direction)])
    left = np.array([-unit[1], unit[0]])
    across = attachments[:, :2] @ left
    along = attachments[:, :2] @ unit
    middle = (float(across.min()) + float(across.max())) / 2
    return Station(
        position=unit * float(np.median(along)) + left * middle,
        direction=direction,
        attachments=attachments,
        ceiling=_find_ceiling(attachments, poles),
    )


def cut_at_poles(
    points: Float64, curves: Sequence[Curve], poles: Sequence[StandingPole], least: float
) -> list[Curve]:
    """
    Cut curves at the poles that hold them, where both parts are longer than ``least`` [m].

    What surely lacks the bend of a support, where something rises far above and no conductor of
    its line ends, passes a tree, or a pole of another line.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    curves : sequence of Curve
        Conductors.
    poles : sequence of StandingPole
        As from `standing_poles.find_poles`.
    least : float
        Least length of a part [m].

    Returns
    -------
    list of Curve

    """
    parts = list(curves)
    for pole in poles:
        held = [curve for curve in parts if pole.holds(curve)]
        parts = [part for curve in parts for part in _cut(points, curve, pole, held, least)]
    return parts


def cut_at_stations(
    points: Float64,
    curves: Sequence[Curve],
    stations: Sequence[Sequence[Joint]],
    settings: SupportSettings,
    poles: Sequence[StandingPole] = (),
) -> list[Curve]:
    """
    Cut curves that pass unbroken through a support at which their neighbours end.

    One that ends at a support of another line than theirs runs beside that line, and so does one
    that passes above the poles there, or is not bent where it would be if it hung there.  Where
    one conductor alone tells of the support, and all that pass are not bent taken together, none
    is cut: in two strips of a survey that lie askew it seems to end.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    curves : sequence of Curve
        Conductors.
    stations : sequence of sequence of Joint
        The joints of each support.
    settings : SupportSettings
        Widths and least lengths.
    poles : sequence of StandingPole
        What stands at curves.

    Returns
    -------
    list of Curve

    """
    places = [place_station(group, poles) for group in stations]
    passing = _measure_passing(points, curves, places, stations, settings)
    chosen = [
        _choose_bent(lacks, is_alone=len(group) == 1)
        for lacks, group in zip(passing, stations, strict=True)
    ]
    result = []
    for number, curve in enumerate(curves):
        parts = [curve]
        for station, bent in zip(places, chosen, strict=True):
            if number in bent:
                parts = [
                    piece for part in parts for piece in cut_curve(points, part, station.position)
                ]
        result += parts
    return result


def _cut(
    points: Float64, curve: Curve, pole: StandingPole, held: Sequence[Curve], least: float
) -> list[Curve]:
    """Cut a curve at a pole, if it is one of those ``held`` there, as in `cut_at_poles`."""
    if curve not in held or _measure_beyond(curve, pole) <= least:
        return [curve]
    line = [
        own for own in held
        if abs(math.sin(own.azimuth - curve.azimuth)) < math.sin(PARALLEL)
        and _measure_beyond(own, pole) >= -ARM
    ]
    top = max(float(own.fit.height(own.local_place(pole.position)[0])) for own in line)
    if max(pole.top, pole.around) > top + POLE_RISE and all(
        _measure_beyond(own, pole) > least for own in line
    ):
        x, _ = curve.local_place(pole.position)
        bend, sigma = measure_bend(points, curve, x)
        in_two = 0.5 * curve.length * float(curve.fit.shape[2])  # if it hung there
        if _are_unbent([(in_two - bend, sigma)]):
            return [curve]
    return cut_curve(points, curve, pole.position)


def _measure_beyond(curve: Curve, pole: StandingPole) -> float:
    """Return how far a curve goes on to both sides of a pole, below 0 if it ends before [m]."""
    x, _ = curve.local_place(pole.position)
    return min(x - curve.low, curve.high - x)


def _are_unbent(lacks: Sequence[Lack]) -> bool:
    """Tell whether curves, L > 0 taken together, surely lack the bend of a support [-]."""
    lack, sigma = np.array(lacks).T
    sure = 1.0 / np.maximum(sigma, LEAST_SIGMA) ** 2
    return float(lack @ sure / sure.sum()) > MIN_RISE + TURN_SIGMAS / math.sqrt(float(sure.sum()))


def _find_ceiling(attachments: Float64, poles: Sequence[StandingPole]) -> float:
    """Return the height above which poles that hold all attachments hold nothing [m]."""
    ceiling = max((
        pole.top + UNSEEN * (pole.top - pole.base) for pole in poles
        if np.hypot(*(attachments[:, :2] - pole.position).T).min() <= ARM
    ), default=-math.inf)
    return ceiling if ceiling >= float(attachments[:, 2].max()) else math.inf


def _choose_bent(lacks: dict[int, Lack], *, is_alone: bool) -> set[int]:
    """Return which of the curves that pass a support may hang there; ``is_alone``: one joint."""
    if is_alone and lacks and _are_unbent(list(lacks.values())):
        return set()
    return {number for number, lack in lacks.items() if not _are_unbent([lack])}


def _measure_passing(
    points: Float64, curves: Sequence[Curve], places: Sequence[Station],
    stations: Sequence[Sequence[Joint]], settings: SupportSettings,
) -> list[dict[int, Lack]]:
    """Return for each support which curves pass it, and the bend that they lack there."""
    beyond, own = _list_next(len(curves), stations)
    margin = settings.min_span / 2
    result: list[dict[int, Lack]] = [{} for _ in places]
    for number, (curve, at) in enumerate(zip(curves, own, strict=True)):
        for station, others, group, found in zip(places, beyond, stations, result, strict=True):
            if at and others.isdisjoint(at.values()):
                continue
            if abs(math.sin(station.direction - curve.azimuth)) > math.sin(PARALLEL):
                continue
            x, y = curve.local_place(station.position)
            if abs(y) > settings.width or not curve.low + margin < x < curve.high - margin:
                continue
            if station.may_hold(float(curve.fit.height(x))):
                found[number] = _measure_lack(points, curve, x, curves, group)
    return result


def _list_next(
    num: int, stations: Sequence[Sequence[Joint]]
) -> tuple[list[set[int]], list[dict[int, int]]]:
    """Return the supports next to each one on its line, and those of each curve's sides."""
    own: list[dict[int, int]] = [{} for _ in range(num)]
    for station, group in enumerate(stations):
        for joint in group:
            for curve, side in zip(joint.curves, joint.sides, strict=True):
                own[curve][side] = station
    beyond = [
        {at for joint in group for curve in joint.curves for at in own[curve].values()} - {station}
        for station, group in enumerate(stations)
    ]
    return beyond, own


def _measure_lack(
    points: Float64, curve: Curve, x: float, curves: Sequence[Curve], joints: Sequence[Joint]
) -> Lack:
    """
    Measure by how much less a curve that passes a support at x is bent than if it hung there.

    The bend of a conductor of that support is known.  In the same spans the curve would bend more
    or less by half their lengths times the difference of the curvatures, and in proportion to the
    curvatures where the spans are level: the lesser size counts, as lengths may be seen in part.
    Where the support holds it down, the sizes of both bends count.
    """
    own = float(curve.fit.shape[2])
    bends = []
    for joint in joints:
        by_length, total = joint.kink, 0.0
        for number, side, end in zip(joint.curves, joint.sides, joint.x, strict=True):
            other = curves[number]
            length = end - other.low if side > 0 else other.high - end
            by_length += (own - float(other.fit.shape[2])) * length / 2
            total += float(other.fit.shape[2])
        bends.append(min(by_length, joint.kink * 2 * own / total, key=abs))
    bend, sigma = measure_bend(points, curve, x)
    known = float(np.median(bends))
    return (known - bend if known >= 0.0 else -known - abs(bend)), sigma
