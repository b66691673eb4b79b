# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Ground of the random scenes: a smooth surface through the feet of the supports."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator, RegularGridInterpolator

from plc_inspect.sim.scenes.routes import shift_route
from plc_inspect.sim.scenes.terrain import make_terrain, Terrain

Float64 = NDArray[np.float64]

_COARSE = 20.0
"""Spacing at which the smooth surface is computed, cubic in between [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Relief:
    """Unevenness of the ground."""

    grade: float
    """Standard deviation of the slope from support to support."""
    deviation: float
    """Greatest deviation of a foot from the chord of its neighbours, for long spans [m]."""
    waves: float
    """Height of hills that are independent of the line [m]."""


RELIEFS = (
    Relief(grade=0.01, deviation=0.5, waves=1.0),
    Relief(grade=0.05, deviation=8.0, waves=4.0),
    Relief(grade=0.12, deviation=20.0, waves=8.0),
)
"""Plain, rolling and hilly country."""


def draw_feet(rng: np.random.Generator, route: Float64, relief: Relief) -> Float64:
    """Return the ground heights (K,) [m] at the supports of a route (K, 2)."""
    spans = np.hypot(*np.diff(route, axis=0).T)
    base = np.concatenate([[0.0], np.cumsum(spans * rng.normal(0.0, relief.grade, len(spans)))])
    around = np.minimum(np.append(spans, spans[-1]), np.insert(spans, 0, spans[0]))
    # the full deviation needs spans of 200 m; shorter spans bend less
    return base + relief.deviation * np.minimum(around / 200.0, 1.0) * rng.uniform(
        -1.0, 1.0, len(route),
    )


def lay_ground(
    rng: np.random.Generator, route: Float64, feet: Float64, relief: Relief, margin: float,
) -> Terrain:
    """
    Return ground that passes through the feet of a line.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of all randomness.
    route : ndarray
        (K, 2) feet in plan [m].
    feet : ndarray
        (K,) heights of the feet [m].
    relief : Relief
        How uneven the ground is.
    margin : float
        Extent of the ground beyond the route [m].

    Returns
    -------
    Terrain

    """
    low, high = route.min(axis=0) - margin, route.max(axis=0) + margin
    terrain = make_terrain(
        rng, (float(low[0]), float(low[1]), float(high[0]), float(high[1])), relief.waves,
        rng.uniform(250.0, 600.0), roughness=rng.uniform(0.02, 0.08),
    )
    ny, nx = terrain.grid.shape
    x = terrain.x0 + terrain.cell * np.arange(nx)
    y = terrain.y0 + terrain.cell * np.arange(ny)
    # fix the ground beside the line as well, or a straight route leaves its slope open
    slope = rng.normal(0.0, relief.grade)
    nodes, heights = [route], [feet - terrain.heights(route)]
    for side in (-margin, margin):
        nodes.append(shift_route(route, side))
        heights.append(heights[0] + side * slope * rng.uniform(0.6, 1.4, len(route)))
    smooth = RBFInterpolator(np.vstack(nodes), np.concatenate(heights), kernel='linear')
    xc = np.linspace(x[0], x[-1], max(5, int((x[-1] - x[0]) / _COARSE)))
    yc = np.linspace(y[0], y[-1], max(5, int((y[-1] - y[0]) / _COARSE)))
    places = np.stack(np.meshgrid(xc, yc), axis=-1)
    coarse = smooth(places.reshape(-1, 2)).reshape(len(yc), len(xc))
    fine = RegularGridInterpolator((yc, xc), coarse, method='cubic')
    grid = fine(np.stack(np.meshgrid(y, x, indexing='ij'), axis=-1).reshape(-1, 2))
    return Terrain(
        x0=terrain.x0, y0=terrain.y0, cell=terrain.cell,
        grid=np.ascontiguousarray(terrain.grid + grid.reshape(ny, nx)),
    )
