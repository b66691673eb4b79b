# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Supports of the random lines: poles, steel poles, lattice towers and portals."""

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from plc_inspect.sim.random_scenes.layouts import Layout, place_bundle
from plc_inspect.sim.scenes.scene import Label, SceneBuilder, UP
from plc_inspect.sim.scenes.steelwork import add_lattice, Lattice

Float64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stand:
    """Position and orientation of a support."""

    foot: Float64
    """(3,) foot on the ground [m]."""
    left: Float64
    """(3,) unit vector across the line."""
    extension: float
    """Height added to its layout [m]."""
    guy: Float64 | None = None
    """(2,) unit vector towards the anchor of the stay of a pole, None without one."""

    @property
    def ahead(self) -> Float64:
        """(3,) unit vector along the line."""
        return np.array([self.left[1], -self.left[0], 0.0])

    def locate(self, offset: float, height: float) -> Float64:
        """Return the position (3,) of an attachment [m]."""
        return self.foot + offset * self.left + (height + self.extension) * UP


def add_support(builder: SceneBuilder, layout: Layout, stand: Stand) -> float:
    """Add a support, and return its height above the foot [m]."""
    if layout.column == 'pole':
        return _add_pole(builder, layout, stand)
    if layout.column == 'portal':
        return _add_portal(builder, layout, stand)
    return _add_tower(builder, layout, stand)


def _add_pole(builder: SceneBuilder, layout: Layout, stand: Stand) -> float:
    upright = layout.is_upright
    top = layout.top + 0.3 if upright or len(layout.phases) == 1 else layout.top - (
        layout.insulator + 0.02
    )
    builder.add_strut(stand.locate(0.0, -stand.extension), stand.locate(0.0, top), 0.14,
                      Label.TOWER)
    for z in sorted({z for _, z in layout.phases}):
        level = [y for y, other in layout.phases if other == z]
        if upright or len(layout.phases) == 1:
            tip = level[0] - math.copysign(0.04, level[0])
            builder.add_strut(stand.locate(0.0, z), stand.locate(tip, z), 0.03, Label.TOWER)
            continue
        arm = z - layout.insulator - 0.02
        if level != [0.0]:
            builder.add_strut(stand.locate(min(level) - 0.1, arm),
                              stand.locate(max(level) + 0.1, arm), 0.05, Label.TOWER)
        for y in level:
            builder.add_strut(stand.locate(y, arm), stand.locate(y, z - 0.03), 0.04, Label.TOWER)
    if stand.guy is not None:
        anchor = stand.foot[:2] + 0.45 * layout.top * stand.guy
        builder.add_strut(np.array([*anchor, builder.ground(anchor)]),
                          stand.locate(0.0, layout.top - 1.2), 0.008, Label.TOWER)
    return max(top, layout.top) + stand.extension


def _add_insulators(builder: SceneBuilder, layout: Layout, stand: Stand) -> None:
    """Add the insulators that hang from arms, and the yokes of bundles."""
    for y, z in layout.phases:
        builder.add_strut(stand.locate(y, z + 0.06), stand.locate(y, z + layout.insulator), 0.1,
                          Label.TOWER)
        if layout.bundle == 1:
            continue
        yoke = [stand.locate(y + dy, z + dz + 0.04)
                for dy, dz in place_bundle(layout.bundle, layout.spacing)]
        for corner in yoke:
            builder.add_strut(stand.locate(y, z + 0.06), corner, 0.02, Label.TOWER)


def _add_portal(builder: SceneBuilder, layout: Layout, stand: Stand) -> float:
    beam = layout.phases[0][1] + layout.insulator
    reach = max(abs(y) for y, _ in layout.phases) + 0.8
    for y, peak in layout.earth_wires:
        foot = stand.locate(y, 0.0)
        foot[2] = builder.ground(foot[:2])
        shape = Lattice(widths=(1.6, 0.9), panel=2.2, radius=0.06, side=stand.left,
                        front=stand.ahead)
        add_lattice(builder, foot, stand.locate(y, beam), shape)
        add_lattice(builder, stand.locate(y, beam), stand.locate(y, peak - 0.05), Lattice(
            widths=(0.9, 0.15), panel=1.5, radius=0.04, side=stand.left, front=stand.ahead,
        ))
    add_lattice(builder, stand.locate(-reach, beam + 0.5), stand.locate(reach, beam + 0.5),
                Lattice(widths=(0.9, 0.9), panel=1.8, radius=0.05, side=UP, front=stand.ahead))
    _add_insulators(builder, layout, stand)
    return layout.top + stand.extension


def _add_tower(builder: SceneBuilder, layout: Layout, stand: Stand) -> float:
    lowest = min(z for _, z in layout.phases)
    peak = layout.top
    tube = layout.column == 'tube'
    base = stand.locate(0.0, -stand.extension)
    if tube:
        builder.add_strut(base, stand.locate(0.0, 0.5 * peak), 0.45, Label.TOWER)
        builder.add_strut(stand.locate(0.0, 0.5 * peak), stand.locate(0.0, peak - 0.05), 0.25,
                          Label.TOWER)
    else:
        waist = stand.locate(0.0, lowest - 1.0)
        neck, tip = stand.locate(0.0, peak - 3.0), stand.locate(0.0, peak - 0.05)
        for low, high, widths, panel, radius in (
            (base, waist, (0.2 * (peak + stand.extension), 2.2), 4.0, 0.1),
            (waist, neck, (2.2, 1.2), 2.0, 0.08), (neck, tip, (1.2, 0.2), 1.5, 0.05),
        ):
            add_lattice(builder, low, high, Lattice(
                widths=widths, panel=panel, radius=radius, side=stand.left, front=stand.ahead,
            ))
    for y, z in layout.phases:
        _add_arm(builder, stand, y, z + layout.insulator, 0.2 if tube else 0.7)
    _add_insulators(builder, layout, stand)
    return peak + stand.extension


def _add_arm(builder: SceneBuilder, stand: Stand, offset: float, height: float,
             depth: float) -> None:
    """Add a tapered arm from the column to the hanging point of an insulator."""
    tip = stand.locate(offset, height)
    root = stand.locate(math.copysign(depth, offset), height)
    for v in (-depth, depth):
        low = root + v * stand.ahead
        high = low + min(1.6, 2.3 * depth) * UP
        builder.add_strut(low, tip, 0.05, Label.TOWER)
        builder.add_strut(high, tip, 0.05, Label.TOWER)
        for share in (0.3, 0.6):
            builder.add_strut(low + share * (tip - low), high + share * (tip - high), 0.03,
                              Label.TOWER)
