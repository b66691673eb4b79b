# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Construction of the random lines: voltage, arrangement of conductors, supports and tension.

Dimensions are those of overhead lines in service: low voltage 0.3 to 0.5 m between wires on poles
of 7 to 9 m, medium voltage about 1 m on 9 to 13 m, high voltage 4 to 9 m on towers.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]
Places = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """The construction of one line."""

    name: str
    phases: Places
    """Offset to the left and height above the foot of each phase attachment [m]."""
    column: str
    """'pole', 'tube' (steel pole with arms), 'lattice' or 'portal'."""
    insulator: float
    """Length of the insulators [m]; they stand on poles and hang from everything else."""
    radius: float
    """Radius of a phase conductor [m]."""
    constant: float
    """Catenary constant of the phases, the same in all spans, as tension equalises [m]."""
    spans: tuple[float, float]
    """Shortest and longest span [m]."""
    clearance: float
    """Least height of a conductor above the ground [m]."""
    earth_wires: Places = ()
    earth_radius: float = 0.006
    earth_share: float = 1.15
    """Catenary constant of earth wires, relative to that of phases: they sag less."""
    bundle: int = 1
    """Number of sub-conductors of a phase."""
    spacing: float = 0.4
    """Distance between the sub-conductors of a phase [m]."""

    @property
    def reach(self) -> float:
        """Greatest offset of a conductor from the axis of the line [m]."""
        return max(abs(y) for y, _ in (*self.phases, *self.earth_wires))

    @property
    def top(self) -> float:
        """Height of the highest attachment above the foot [m]."""
        return max(z for _, z in (*self.phases, *self.earth_wires))

    @property
    def is_upright(self) -> bool:
        """Whether the phases of a pole hang one above the other on one side."""
        return len(self.phases) > 1 and len({y for y, _ in self.phases}) == 1


@dataclass(frozen=True, slots=True, kw_only=True)
class String:
    """One conductor of a line, from support to support."""

    offset: float
    height: float
    radius: float
    constant: float
    bundle: int
    """Number of its phase, -1 without a bundle."""


def list_strings(layout: Layout) -> list[String]:
    """Return the conductors of a layout: all of each phase, then the earth wires."""
    strings = [
        String(
            offset=y + dy, height=z + dz, radius=layout.radius, constant=layout.constant,
            bundle=number if layout.bundle > 1 else -1,
        )
        for number, (y, z) in enumerate(layout.phases)
        for dy, dz in place_bundle(layout.bundle, layout.spacing)
    ]
    return strings + [
        String(offset=y, height=z, radius=layout.earth_radius,
               constant=layout.constant * layout.earth_share, bundle=-1)
        for y, z in layout.earth_wires
    ]


def place_bundle(num: int, spacing: float) -> Places:
    """Return the positions of sub-conductors about their phase: offset and height [m]."""
    half = 0.5 * spacing
    if num == 1:
        return ((0.0, 0.0),)
    if num == 2:
        return ((-half, 0.0), (half, 0.0))
    if num == 3:
        return ((-half, 0.0), (half, 0.0), (0.0, -0.866 * spacing))
    return ((-half, 0.0), (half, 0.0), (-half, -spacing), (half, -spacing))


def draw_layout(rng: np.random.Generator, levels: tuple[str, ...]) -> Layout:
    """Return a random layout of one of some voltages: 'low', 'medium' and 'high'."""
    draw = {'low': _draw_low, 'medium': _draw_medium, 'high': _draw_high}
    return draw[levels[int(rng.integers(len(levels)))]](rng)


def _draw_low(rng: np.random.Generator) -> Layout:
    top, kind = rng.uniform(7.0, 9.0), rng.choice(['flat', 'rack', 'cable'], p=[0.45, 0.4, 0.15])
    num = int(rng.integers(2, 6))
    gap = rng.uniform(0.3, 0.5)
    radius = rng.uniform(0.004, 0.007)
    if kind == 'flat':
        phases = _spread(num, gap, top)
    elif kind == 'rack':
        phases = tuple((0.25, top - gap * i) for i in range(num))
    else:
        phases, radius = ((0.0, top),), rng.uniform(0.015, 0.025)
    return Layout(
        name=f'low {kind}', phases=phases, column='pole', insulator=0.12, radius=radius,
        constant=rng.uniform(200.0, 500.0), spans=(20.0, 60.0), clearance=4.5,
    )


def _draw_medium(rng: np.random.Generator) -> Layout:
    top, kind = rng.uniform(9.0, 13.0), rng.choice(['flat', 'triangle', 'upright'])
    gap = rng.uniform(0.7, 1.5)
    if kind == 'flat':
        phases = _spread(3, gap, top)
    elif kind == 'triangle':
        phases = ((-gap, top - 0.8 * gap), (0.0, top), (gap, top - 0.8 * gap))
    else:
        phases = tuple((0.5, top - gap * i) for i in range(3))
    return Layout(
        name=f'medium {kind}', phases=phases, column='pole', insulator=0.25,
        radius=rng.uniform(0.005, 0.009), constant=rng.uniform(500.0, 1000.0),
        spans=(40.0, 140.0), clearance=5.5,
    )


def _draw_high(rng: np.random.Generator) -> Layout:
    kind = rng.choice(['portal', 'triangle', 'double', 'danube', 'tube'])
    low, step, arm = rng.uniform(15.0, 24.0), rng.uniform(4.0, 7.0), rng.uniform(3.5, 7.0)
    bundle = int(rng.choice([1, 2, 3, 4], p=[0.5, 0.3, 0.1, 0.1]))
    hang = rng.uniform(1.2, 3.0)
    column = 'lattice'
    phases: Places
    earth: Places = ((0.0, low + 2 * step + hang + rng.uniform(3.0, 6.0)),)
    if kind == 'portal':
        gap = rng.uniform(5.0, 9.5)
        phases, column = _spread(3, gap, low), 'portal'
        peak = low + hang + rng.uniform(3.0, 5.5)
        earth = ((-0.6 * gap, peak), (0.6 * gap, peak))
    elif kind == 'triangle':
        phases = ((-arm, low), (arm, low), (arm - 0.8, low + step))
        earth = ((0.0, low + step + hang + rng.uniform(3.0, 5.0)),)
    elif kind == 'danube':
        phases = tuple(
            (side * y, low + z) for side in (-1, 1)
            for y, z in ((arm, 0.0), (arm + 4.5, 0.0), (arm + 1.5, step))
        )
        earth = ((0.0, low + step + hang + rng.uniform(3.0, 6.0)),)
    else:
        column = 'tube' if kind == 'tube' else 'lattice'
        middle = arm + rng.uniform(0.0, 1.5)
        sides = (-1, 1) if kind == 'double' or rng.random() < 0.5 else (-1,)
        phases = tuple(
            (side * y, low + z) for side in sides
            for y, z in ((arm, 0.0), (middle, step), (arm - 0.5, 2 * step))
        )
    return Layout(
        name=f'high {kind}', phases=phases, column=column, insulator=hang,
        radius=rng.uniform(0.011, 0.017), constant=rng.uniform(900.0, 1900.0),
        spans=(120.0, 400.0), clearance=6.5, earth_wires=earth,
        earth_radius=rng.uniform(0.004, 0.008), earth_share=rng.uniform(1.05, 1.3),
        bundle=bundle, spacing=rng.uniform(0.3, 0.5),
    )


def _spread(num: int, gap: float, height: float) -> Places:
    """Return positions side by side, centred over the axis [m]."""
    return tuple((gap * (i - 0.5 * (num - 1)), height) for i in range(num))
