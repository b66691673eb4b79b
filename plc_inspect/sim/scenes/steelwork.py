# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Lattice beams of towers, cranes, masts and gantries."""

from dataclasses import dataclass
from itertools import pairwise
import math

import numpy as np
from numpy.typing import NDArray

from plc_inspect.sim.scenes.scene import Label, SceneBuilder

Float64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lattice:
    """The shape of a lattice beam of four chords."""

    widths: tuple[float, float]
    """Widths at its start and end [m]."""
    panel: float
    """Length of a panel of bracing [m]."""
    radius: float
    """Radius of a chord [m]; braces are thinner."""
    side: Float64
    """(3,) unit vector across the beam."""
    front: Float64
    """(3,) unit vector across the beam and ``side``."""
    label: Label = Label.TOWER


def add_lattice(builder: SceneBuilder, start: Float64, end: Float64, shape: Lattice) -> None:
    """Add four chords with cross-bracing from start (3,) to end (3,) [m]."""
    num = max(2, math.ceil(float(np.linalg.norm(end - start)) / shape.panel))
    rings = []
    for i in range(num + 1):
        share = 1.0 - (1.0 - i / num)
        half = 0.5 * (shape.widths[0] + share * (shape.widths[1] - shape.widths[0]))
        centre = start + share * (end - start)
        rings.append([
            centre + half * (u * shape.side + v * shape.front)
            for u, v in ((1, 1), (1, -1), (-1, -1), (-1, 1))
        ])
    for low, high in pairwise(rings):
        for k in range(4):
            n = (k + 1) % 4
            builder.add_strut(low[k], high[k], shape.radius, shape.label)
            builder.add_strut(low[k], high[n], 0.6 * shape.radius, shape.label)
            builder.add_strut(high[k], high[n], 0.6 * shape.radius, shape.label)
