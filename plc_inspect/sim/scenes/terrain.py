# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Terrain of the simulated scenes: a bilinear height field."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Terrain:
    """Heights on a regular grid, bilinear between nodes and constant beyond its edge."""

    x0: float
    y0: float
    cell: float
    """Spacing of the grid [m]."""
    grid: Float64
    """(ny, nx) heights of the nodes [m]."""

    def heights(self, xy: Float64) -> Float64:
        """Return the ground heights (N,) [m] at xy (N, 2) [m]."""
        ny, nx = self.grid.shape
        u = np.clip((xy[:, 0] - self.x0) / self.cell, 0.0, nx - 1.000001)
        v = np.clip((xy[:, 1] - self.y0) / self.cell, 0.0, ny - 1.000001)
        i, j = u.astype(np.int64), v.astype(np.int64)
        u, v = u - i, v - j
        g = self.grid
        return (
            g[j, i] * (1 - u) * (1 - v) + g[j, i + 1] * u * (1 - v)
            + g[j + 1, i] * (1 - u) * v + g[j + 1, i + 1] * u * v
        )

    def height(self, x: float, y: float) -> float:
        """Return the ground height at one position [m]."""
        return float(self.heights(np.array([[x, y]]))[0])


def make_terrain(
    rng: np.random.Generator, bounds: tuple[float, float, float, float], relief: float,
    wavelength: float = 400.0, *, roughness: float = 0.05, cell: float = 2.0,
    valley: tuple[float, float, float] | None = None,
) -> Terrain:
    """
    Make rolling terrain.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of all randomness.
    bounds : tuple of float
        x0, y0, x1, y1 to cover [m].
    relief : float
        Approximate height of hills above valleys [m].
    wavelength : float
        Distance from hill to hill [m]; two shorter waves are added.
    roughness : float
        Standard deviation of the nodes about the smooth surface [m].
    cell : float
        Spacing of the grid [m].
    valley : tuple of float, optional
        x of the axis, depth and half width of a valley along y [m].

    Returns
    -------
    Terrain

    """
    x0, y0, x1, y1 = bounds
    x = np.arange(x0, x1 + 2 * cell, cell)
    y = np.arange(y0, y1 + 2 * cell, cell)
    xx, yy = np.meshgrid(x, y)
    z = np.zeros_like(xx)
    for octave in range(3):
        for _ in range(2):
            angle, phase = rng.uniform(0.0, 2 * np.pi, 2)
            k = 2 * np.pi / (wavelength * rng.uniform(0.8, 1.25) / 2.2**octave)
            wave = np.sin(k * (xx * np.cos(angle) + yy * np.sin(angle)) + phase)
            z += relief / 4 / 2.8**octave * wave
    if valley is not None:
        axis, depth, half = valley
        z -= depth * np.exp(-(((xx - axis) / half) ** 4))
    z += rng.normal(0.0, roughness, z.shape) if roughness > 0 else 0.0
    return Terrain(x0=x0, y0=y0, cell=cell, grid=np.ascontiguousarray(z))
