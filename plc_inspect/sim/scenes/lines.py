# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Power lines of the simulated scenes: styles, supports and conductors."""

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from plc_inspect.sim.scenes.conductors import Conductor, hang, solve_constant
from plc_inspect.sim.scenes.routes import face_ahead
from plc_inspect.sim.scenes.scene import Label, Post, SceneBuilder, UP
from plc_inspect.sim.scenes.steelwork import add_lattice, Lattice

Float64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class LineStyle:
    """The construction of a line."""

    phases: tuple[tuple[float, float], ...]
    """Lateral offset to the left and height above the foot of each phase attachment [m]."""
    earth_wires: tuple[tuple[float, float], ...] = ()
    support: str = 'pole'
    """'pole', 'portal' (two columns and a beam) or 'lattice' (one body with arms)."""
    insulator: float = 0.2
    """Length of the insulators [m]; they hang from towers and stand on poles."""
    radius: float = 0.006
    """Radius of a phase conductor [m]."""
    earth_radius: float = 0.007
    sag_ratio: tuple[float, float] = (0.015, 0.025)
    """Least and greatest sag of a span as a share of its length."""
    bundle: float = 0.0
    """Distance between the two sub-conductors of a phase [m], 0 for a single conductor."""


HIGH_VOLTAGE = LineStyle(
    phases=((-9.0, 21.0), (0.0, 21.0), (9.0, 21.0)), earth_wires=((-5.5, 28.5), (5.5, 28.5)),
    support='portal', insulator=2.5, radius=0.0145, sag_ratio=(0.024, 0.034),
)
DOUBLE_CIRCUIT = LineStyle(
    phases=((-6.0, 20.0), (-7.5, 26.0), (-5.5, 32.0), (6.0, 20.0), (7.5, 26.0), (5.5, 32.0)),
    earth_wires=((0.0, 40.0),), support='lattice', insulator=2.0, radius=0.0145,
    sag_ratio=(0.024, 0.03),
)
BUNDLES = LineStyle(
    phases=((-8.0, 22.0), (0.0, 22.0), (8.0, 22.0)), earth_wires=((-5.0, 29.0), (5.0, 29.0)),
    support='portal', insulator=2.5, radius=0.0145, sag_ratio=(0.025, 0.03), bundle=0.4,
)
MEDIUM_VOLTAGE = LineStyle(
    phases=((-1.2, 10.5), (0.0, 10.5), (1.2, 10.5)), radius=0.0075, sag_ratio=(0.016, 0.022),
)
LOW_VOLTAGE = LineStyle(
    phases=((-0.6, 8.0), (-0.2, 8.0), (0.2, 8.0), (0.6, 8.0)), insulator=0.12, radius=0.005,
    sag_ratio=(0.01, 0.018),
)
RACK = LineStyle(
    phases=((0.3, 8.4), (0.3, 8.0), (0.3, 7.6), (0.3, 7.2)), insulator=0.12, radius=0.005,
    sag_ratio=(0.01, 0.018),
)


def add_line(builder: SceneBuilder, style: LineStyle, route: Float64) -> None:
    """
    Add a line with a support at each vertex of a route.

    Line and span ids go on where the builder's last line ended.  All conductors of a span have
    one catenary constant, drawn from the style's range of sag.

    Parameters
    ----------
    builder : SceneBuilder
        Takes the parts.
    style : LineStyle
        Construction of the line.
    route : ndarray
        (K, 2) float64 feet of the supports [m].

    """
    first_line, first_span = builder.next_ids()
    strings = _list_strings(style)
    line_ids = tuple(range(first_line, first_line + len(strings)))
    attachments = []
    for i, foot in enumerate(route):
        ahead = face_ahead(route, i)[2]
        left = np.array([-ahead[1], ahead[0], 0.0])
        base = np.array([foot[0], foot[1], builder.ground(foot)])
        attachments.append([base + y * left + [0.0, 0.0, z] for y, z, _, _ in strings])
        height = _add_support(builder, style, base, left)
        builder.posts.append(Post(
            position=base, height=height, line_ids=line_ids,
            kind='pole' if style.support == 'pole' else 'tower',
        ))
    for i in range(len(route) - 1):
        length = float(np.hypot(*(route[i + 1] - route[i])))
        c = solve_constant(length, builder.rng.uniform(*style.sag_ratio) * length)
        for k, (_, _, radius, bundle) in enumerate(strings):
            builder.conductors.append(Conductor(
                start=attachments[i][k], end=attachments[i + 1][k], c=c, radius=radius,
                line_id=first_line + k, span_id=first_span + i,
                bundle_id=-1 if bundle < 0 else first_line + bundle,
            ))


def add_drop(
    builder: SceneBuilder, start: Float64, end: Float64, *, sag_ratio: float = 0.012,
    radius: float = 0.008,
) -> None:
    """
    Add a service drop: one conductor from an existing support to a house or out of the survey.

    It forms a line and a span of its own.

    Parameters
    ----------
    builder : SceneBuilder
        Takes the conductor.
    start, end : ndarray
        (3,) float64 attachments [m].
    sag_ratio : float
        Sag as a share of the length.
    radius : float
        Radius of the conductor [m].

    """
    line_id, span_id = builder.next_ids()
    builder.conductors.append(hang(
        start, end, sag_ratio, radius=radius, line_id=line_id, span_id=span_id,
    ))


def _list_strings(style: LineStyle) -> list[tuple[float, float, float, int]]:
    """Return lateral offset, height, radius and bundle of each conductor."""
    shifts = (-0.5 * style.bundle, 0.5 * style.bundle) if style.bundle else (0.0,)
    strings = [
        (y + shift, z, style.radius, index if style.bundle else -1)
        for index, (y, z) in enumerate(style.phases) for shift in shifts
    ]
    return strings + [(y, z, style.earth_radius, -1) for y, z in style.earth_wires]


def _add_support(builder: SceneBuilder, style: LineStyle, base: Float64, left: Float64) -> float:
    if style.support == 'pole':
        return _add_pole(builder, style, base, left)
    ahead = np.array([left[1], -left[0], 0.0])
    if style.support == 'portal':
        return _add_portal(builder, style, base, left, ahead)
    return _add_lattice(builder, style, base, left, ahead)


def _add_pole(builder: SceneBuilder, style: LineStyle, base: Float64, left: Float64) -> float:
    offsets = sorted({y for y, _ in style.phases})
    levels = sorted({z for _, z in style.phases})
    upright = len(offsets) == 1
    top = levels[-1] + (0.3 if upright else -style.insulator - 0.02)
    builder.add_strut(base, base + top * UP, 0.13, Label.TOWER)
    for z in levels:
        if upright:
            arm = base + z * UP
            builder.add_strut(arm, arm + offsets[0] * left, 0.03, Label.TOWER)
            continue
        arm = base + (z - style.insulator) * UP
        reach = max(abs(y) for y in offsets) + 0.1
        builder.add_strut(arm - reach * left, arm + reach * left, 0.05, Label.TOWER)
        for y in offsets:
            foot = arm + y * left
            builder.add_strut(foot, foot + (style.insulator - 0.02) * UP, 0.04, Label.TOWER)
    return max(top, levels[-1])


def _add_strings(builder: SceneBuilder, style: LineStyle, base: Float64, left: Float64) -> None:
    """Add the hanging insulators of a tower and the yokes of its bundles."""
    for y, z in style.phases:
        low = base + y * left + (z + 0.05) * UP
        builder.add_strut(low, low + style.insulator * UP, 0.1, Label.TOWER)
        half = 0.5 * style.bundle
        if half:
            builder.add_strut(low - half * left, low + half * left, 0.03, Label.TOWER)


def _add_portal(
    builder: SceneBuilder, style: LineStyle, base: Float64, left: Float64, ahead: Float64,
) -> float:
    beam = max(z for _, z in style.phases) + style.insulator
    reach = max(abs(y) for y, _ in style.phases) + 0.8
    peak = max(z for _, z in style.earth_wires)
    leg = Lattice(widths=(1.4, 0.9), panel=1.8, radius=0.06, side=left, front=ahead)
    horn = Lattice(widths=(0.9, 0.15), panel=1.5, radius=0.04, side=left, front=ahead)
    for y, _ in style.earth_wires:
        foot = base + y * left
        foot[2] = builder.ground(foot[:2])
        top = base + y * left + beam * UP
        add_lattice(builder, foot, top, leg)
        add_lattice(builder, top, base + y * left + (peak - 0.1) * UP, horn)
    add_lattice(builder, base - reach * left + (beam + 0.5) * UP,
                base + reach * left + (beam + 0.5) * UP,
                Lattice(widths=(0.9, 0.9), panel=1.8, radius=0.05, side=UP, front=ahead))
    _add_strings(builder, style, base, left)
    return peak


def _add_lattice(
    builder: SceneBuilder, style: LineStyle, base: Float64, left: Float64, ahead: Float64,
) -> float:
    lowest = min(z for _, z in style.phases)
    peak = max(z for _, z in (*style.phases, *style.earth_wires))
    waist = base + (lowest - 1.0) * UP
    neck, tip = base + (peak - 3.0) * UP, base + (peak - 0.1) * UP
    for low, high, widths, panel, radius in (
        (base, waist, (0.2 * peak, 2.2), 4.0, 0.1), (waist, neck, (2.2, 1.2), 2.0, 0.08),
        (neck, tip, (1.2, 0.2), 1.5, 0.05),
    ):
        add_lattice(builder, low, high, Lattice(
            widths=widths, panel=panel, radius=radius, side=left, front=ahead,
        ))
    for y, z in style.phases:
        tip = base + y * left + (z + style.insulator + 0.05) * UP
        root = base + math.copysign(0.7, y) * left + (z + style.insulator + 0.05) * UP
        for v in (-0.7, 0.7):
            builder.add_strut(root + v * ahead, tip, 0.05, Label.TOWER)
            builder.add_strut(root + v * ahead + 1.6 * UP, tip, 0.05, Label.TOWER)
        for share in (0.3, 0.6):
            low = root + share * (tip - root)
            for v in (-0.7, 0.7):
                side = v * (1 - share) * ahead
                builder.add_strut(low + side, low + side + 1.6 * (1 - share) * UP, 0.03,
                                  Label.TOWER)
    _add_strings(builder, style, base, left)
    return peak
