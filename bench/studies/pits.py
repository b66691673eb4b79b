# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Lays returns below meadows, and ground below crops, in lanes and in ditches, and filters both.

Prints which share of the ground that is there was seen as such, mean and worst of the seeds, and
how far below it the ground was estimated.
"""

import argparse
from collections.abc import Callable
from pathlib import Path
import sys

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from random_scenes import parse_seeds

from plc_inspect.core.ground.ground_filter import estimate_ground
from plc_inspect.results import Bool, Float64

SIZE = 100
"""Edge of a scene in cells of 1 m."""
EDGE = 5
"""Cells at the edges of a scene that are not counted."""
DEEPEST, SHALLOWEST = 6.0, 0.5
"""Depth of returns from below the ground [m]."""
NOISE, TOP_NOISE = 0.05, 0.07
"""Standard deviation of the lowest points of cells, on the ground and on what covers it [m]."""

Scene = tuple[Float64, Float64, Bool]
"""True height of the ground and lowest points [m], and the cells that show the ground."""
Rng = np.random.Generator


def lay_ground(rng: Rng, slope: float) -> tuple[Float64, Float64]:
    """Return the true height of hilly ground and its lowest points [m]."""
    row, column = np.mgrid[:SIZE, :SIZE]
    true = slope * (0.8 * row - 0.6 * column) + 0.8 * np.sin(row / 9.0) * np.cos(column / 11.0)
    return true, true + rng.normal(0.0, NOISE, true.shape)


def lay_returns(rng: Rng, slope: float, density: float, share: float, evenly: bool) -> Scene:
    """Lay some of so many returns a cell below the ground, evenly or ever fewer with depth."""
    true, lowest = lay_ground(rng, slope)
    num = rng.poisson(density * share, true.shape)
    for row, column in np.argwhere(num):
        size = num[row, column]
        depth = (rng.uniform(SHALLOWEST, DEEPEST, size) if evenly
                 else SHALLOWEST + rng.exponential(0.7, size))
        lowest[row, column] = min(lowest[row, column], true[row, column] - depth.max())
    return true, lowest, num == 0


def lay_crop(rng: Rng, slope: float, height: float, share: float) -> Scene:
    """Cover the ground by a crop or net in gaps of which a share of its cells shows ground."""
    true, lowest = lay_ground(rng, slope)
    field = np.zeros(true.shape, dtype=bool)
    field[20:80, 20:80] = True
    gaps = rng.random(true.shape) < share
    top = true + height + rng.normal(0.0, TOP_NOISE, true.shape)
    return true, np.where(field & ~gaps, top, lowest), field & gaps


def lay_lane(rng: Rng, height: float, wide: float, angle: float) -> Scene:
    """Put a roof over the ground, with a lane through it that is closed at both ends."""
    true, lowest = lay_ground(rng, 0.1)
    along, aside = turn(angle)
    roof = (abs(along) < 20.0) & (abs(aside) < 14.0)
    lane = (abs(along) < 15.0) & (abs(aside) < wide / 2.0)
    top = true + height + rng.normal(0.0, TOP_NOISE, true.shape)
    return true, np.where(roof & ~lane, top, lowest), lane


def lay_ditch(rng: Rng, deep: float, wide: float, angle: float) -> Scene:
    """Cut a ditch into the ground whose sides meet at its bottom."""
    true, lowest = lay_ground(rng, 0.1)
    cut = np.clip(1.0 - abs(turn(angle)[1]) / (wide / 2.0), 0.0, 1.0) * deep
    return true - cut, lowest - cut, cut > deep / 2.0


def turn(angle: float) -> tuple[Float64, Float64]:
    """Return places along and across a direction, from the middle of the scene [m]."""
    row, column = np.mgrid[:SIZE, :SIZE] - SIZE / 2.0
    return (row * np.cos(angle) + column * np.sin(angle),
            column * np.cos(angle) - row * np.sin(angle))


def list_scenes() -> dict[str, Callable[[Rng], Scene]]:
    """Return what is laid, by its name."""
    scenes: dict[str, Callable[[Rng], Scene]] = {}
    for evenly in (True, False):
        for density, share in ((3, 0.005), (10, 0.005), (30, 0.005), (3, 0.017), (10, 0.017)):
            name = f'{100 * share:.1f} % of {density} returns {"evenly" if evenly else "fading"}'
            for slope in (0.0, 0.4):
                scenes[f'{name}, slope {slope}'] = (
                    lambda rng, slope=slope, density=density, share=share, evenly=evenly:
                    lay_returns(rng, slope, density, share, evenly))
    for height in (0.8, 3.5):
        for share in (0.04, 0.08, 0.15, 0.25):
            scenes[f'crop of {height} m, ground in {100 * share:.0f} %'] = (
                lambda rng, height=height, share=share: lay_crop(rng, 0.3, height, share))
    for wide in (1.0, 2.0, 4.0):
        for angle in (0.0, 0.4, 0.78):
            scenes[f'lane of {wide} m between roofs, {angle} rad'] = (
                lambda rng, wide=wide, angle=angle: lay_lane(rng, 3.0, wide, angle))
            scenes[f'ditch 1 m deep, {wide} m wide, {angle} rad'] = (
                lambda rng, wide=wide, angle=angle: lay_ditch(rng, 1.0, wide, angle))
    return scenes


def main() -> int:
    """Print a line for each kind of scene."""
    parser = argparse.ArgumentParser(description='Returns below the ground, and ground in gaps.')
    parser.add_argument('--seeds', type=parse_seeds, default='0:4', metavar='A:B')
    arguments = parser.parse_args()
    inner = np.s_[EDGE:-EDGE, EDGE:-EDGE]
    for name, make in list_scenes().items():
        shares, below = [], []
        for seed in arguments.seeds:
            true, lowest, shown = make(np.random.default_rng(seed))
            ground, seen = estimate_ground(lowest.astype(np.float32), 1.0, 1.0)
            shares.append(seen[inner][shown[inner]].mean())
            below.append(float(np.nanmax((true - ground)[inner])))
        print(f'{name:44s} seen {np.mean(shares):.2f}, worst {min(shares):.2f};'
              f' at most {max(below):5.2f} m too low', flush=True)
    return 0


if __name__ == '__main__':
    sys.exit(main())
