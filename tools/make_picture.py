# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Draws the picture of the README from a results folder.

``make picture`` replays the demo flight and runs this.
"""

import argparse
from pathlib import Path

import laspy
import matplotlib as mpl
from matplotlib import pyplot
import numpy as np

from plc_inspect.colors import LINE_COLORS, SEVERITY_COLORS
from plc_inspect.offline.records.results_reader import read_table
from plc_inspect.results import PointClass

AZIMUTH_DEG = -115.0
ELEVATION_DEG = 32.0
COLORS = {
    PointClass.OTHER: '#b4b9bf',
    PointClass.GROUND: '#c9b48c',
    PointClass.VEGETATION: '#3f8f4f',
    PointClass.TOWER: '#3b4148',
}


def project(points, center):
    """Return the screen coordinates of points (N, 3) seen from afar, and their distance."""
    azimuth, elevation = np.radians([AZIMUTH_DEG, ELEVATION_DEG])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    away = -np.array([
        np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth),
        np.sin(elevation),
    ])
    up = np.cross(right, away)
    moved = points - center
    return moved @ right, moved @ up, moved @ away


def draw(folder, path):
    """Draw the points of a results folder with its catenaries and hazards."""
    las = laspy.read(folder / 'points.laz')
    points, kinds = np.array(las.xyz), np.array(las.classification)
    lines = np.array(las['line_id'])
    center = points.mean(axis=0)
    colors = np.full((len(points), 4), mpl.colors.to_rgba(COLORS[PointClass.OTHER]))
    for kind, color in COLORS.items():
        colors[kinds == kind] = mpl.colors.to_rgba(color)
    ground = kinds == PointClass.GROUND
    low, high = np.percentile(points[ground, 2], (2, 98)) if ground.any() else (0.0, 1.0)
    shade = np.clip((points[ground, 2] - low) / max(high - low, 1e-6), 0, 1)
    colors[ground, :3] *= (0.8 + 0.25 * shade)[:, np.newaxis]
    colors = np.clip(colors, 0.0, 1.0)
    x, y, depth = project(points, center)
    back = np.argsort(-depth)
    back = back[kinds[back] != PointClass.WIRE]
    figure, axes = pyplot.subplots(figsize=(12, 5.2), dpi=110)
    axes.scatter(x[back], y[back], s=0.35, c=colors[back], linewidths=0, rasterized=True)
    wire = np.flatnonzero(kinds == PointClass.WIRE)
    hue = np.array([mpl.colors.to_rgba(color) for color in LINE_COLORS])
    axes.scatter(
        x[wire], y[wire], s=1.5, c=hue[lines[wire] % len(hue)], linewidths=0, rasterized=True
    )
    for hazard in read_table(folder, 'hazards')['hazards']:
        across, up, _ = project(np.array([hazard['position']]), center)
        axes.plot(across, up, 'o', ms=15, mfc='none', mew=2.2,
                  mec=SEVERITY_COLORS[hazard['severity']])
    axes.set_aspect('equal')
    axes.set_axis_off()
    axes.margins(0.01)
    figure.subplots_adjust(0, 0, 1, 1)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, bbox_inches='tight', pad_inches=0.05, metadata={'Software': None})


def main():
    """Draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('folder', type=Path, help='results folder')
    parser.add_argument('picture', type=Path, help='PNG file to write')
    arguments = parser.parse_args()
    draw(arguments.folder, arguments.picture)


if __name__ == '__main__':
    main()
