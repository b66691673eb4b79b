# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Small clouds and curves made by formula, for tests worked by hand."""

from itertools import pairwise

import numpy as np

from plc_inspect.config import AlignmentSettings, ClusteringSettings, LinearitySettings
from plc_inspect.core.catenary.curve import fit_curve
from plc_inspect.core.clustering.clustering import cluster
from plc_inspect.core.extraction.alignment import align
from plc_inspect.core.extraction.linearity import find_candidates
from plc_inspect.core.ground.ground_grid import make_grid
from plc_inspect.core.numerics.plan_index import build_plan_index


def hang(x, length, start_z, end_z, c):
    """Return the heights of a catenary through both ends of a span, by physics."""
    b = length / 2 - c * np.arcsinh((end_z - start_z) / (2 * c * np.sinh(length / (2 * c))))
    return start_z + c * (np.cosh((x - b) / c) - np.cosh(b / c))


def make_wire(start, end, c=800.0, per_metre=8.0, noise=0.02, seed=0, parts=((0.0, 1.0),)):
    """Make the points of one conductor; ``parts`` are the shares of it that are seen."""
    rng = np.random.default_rng(seed)
    start, end = np.array(start, float), np.array(end, float)
    run = end[:2] - start[:2]
    length = float(np.hypot(*run))
    x = np.concatenate([
        np.sort(rng.uniform(low * length, high * length, int((high - low) * length * per_metre)))
        for low, high in parts
    ])
    points = np.empty((len(x), 3))
    points[:, :2] = start[:2] + x[:, None] * run / length
    points[:, 2] = hang(x, length, start[2], end[2], c)
    return points + rng.normal(0.0, noise, points.shape)


def make_ground(low, high, per_square_metre=3.0, noise=0.02, seed=100, height=None):
    """Make ground points in a plan box; ``height`` is z as a function of x and y."""
    rng = np.random.default_rng(seed)
    num = int(np.prod(np.subtract(high, low)) * per_square_metre)
    xy = rng.uniform(low, high, (num, 2))
    z = np.zeros(num) if height is None else height(xy[:, 0], xy[:, 1])
    return np.column_stack([xy, z + rng.normal(0.0, noise, num)])


def make_tree(x, y, top, bottom=1.0, radius=1.5, num=1500, seed=200):
    """Make the points of an egg-shaped crown."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(num, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    points *= radius * rng.random((num, 1)) ** 0.33
    points[:, 2] *= (top - bottom) / 2 / radius
    return points + np.array([x, y, (top + bottom) / 2])


def make_sight(points, seen=True, margin=5.0):
    """Make a grid of ground that was seen, or was not, below all points."""
    low, high = np.zeros(2), np.zeros(2)
    if len(points):
        low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    columns, rows = (np.ceil(high - low + 2 * margin)).astype(int)
    height = np.zeros((rows, columns), dtype=np.float32)
    return make_grid(height, np.full(height.shape, seen), low - margin, 1.0)


def make_pole(x, y, height, seed=300):
    """Make the points of a pole with a cross-arm along y on top of it."""
    rng = np.random.default_rng(seed)
    pole = rng.uniform((-0.15, -0.15, 0.0), (0.15, 0.15, height), (300, 3))
    arm = rng.uniform((-0.1, -3.2, height - 0.7), (0.1, 3.2, height - 0.5), (100, 3))
    return np.vstack([pole, arm]) + np.array([x, y, 0.0])


def make_line_cloud(
    spans=(100.0, 110.0), offsets=(-3.0, 0.0, 3.0), height=15.0, c=800.0, per_metre=8.0,
    half_width=25.0, noise=0.02, poles=True, seed=0, more=(),
):
    """
    Make a straight line over flat ground, from the origin along x.

    Returns
    -------
    points : (N, 3) float64
    label : (N,) int, 14 wire, 2 ground, 15 pole, 1 the clouds of ``more``

    """
    ends = np.concatenate([[0.0], np.cumsum(spans)])
    parts = [(2, make_ground(
        (-20.0, -half_width), (ends[-1] + 20.0, half_width), noise=noise, seed=1000 + seed
    ))]
    for number, (low, high) in enumerate(pairwise(ends)):
        for conductor, offset in enumerate(offsets):
            parts.append((14, make_wire(
                (low, offset, height), (high, offset, height), c, per_metre, noise,
                2000 + 100 * seed + 10 * number + conductor,
            )))
    if poles:
        parts += [(15, make_pole(x, 0.0, height + 1.0, 3000 + seed)) for x in ends]
    parts += [(1, cloud) for cloud in more]
    return (
        np.vstack([cloud for _, cloud in parts]),
        np.concatenate([np.full(len(cloud), label) for label, cloud in parts]),
    )


def turn(points, yaw, shift=(0.0, 0.0, 0.0)):
    """Return the points turned by ``yaw`` [rad] about z and then moved."""
    cosine, sine = np.cos(yaw), np.sin(yaw)
    x, y = points[:, 0], points[:, 1]
    turned = np.column_stack([cosine * x - sine * y, sine * x + cosine * y, points[:, 2]])
    return turned + np.asarray(shift, float)


def make_curve(points, chosen=None, tolerance=0.1):
    """Fit a curve to the chosen points, by default to all."""
    if chosen is None:
        chosen = np.arange(len(points))
    return fit_curve(points, chosen, tolerance=tolerance)


def make_index(points, cell=2.0):
    """Index all points by plan cell."""
    return build_plan_index(points, np.arange(len(points)), cell)


def find_tracks(points, chosen=None, clustering=None):
    """Run the stages from candidates to tracks on the chosen points, by default on all."""
    chosen = np.arange(len(points)) if chosen is None else chosen
    origin = points[chosen].min(axis=0) - 1.0 if len(chosen) else np.zeros(3)
    candidates = find_candidates(points, chosen, origin, LinearitySettings())
    windows = align(candidates, AlignmentSettings())
    index = build_plan_index(points, chosen, 2.0)
    return cluster(
        points, index, candidates.position, windows, clustering or ClusteringSettings()
    )


def make_route(supports, offsets=(-3.0, 0.0, 3.0), height=15.0, c=800.0, **changes):
    """
    Make the conductors of a line over given supports (K, 2), and fit a curve to each.

    Returns
    -------
    points : (N, 3) float64
    curves : list of Curve, span by span, then by offset to the left

    """
    supports = np.array(supports, float)
    runs = np.diff(supports, axis=0)
    runs /= np.linalg.norm(runs, axis=1, keepdims=True)
    normals = np.column_stack([-runs[:, 1], runs[:, 0]])
    joints = np.vstack([normals[:1], normals[:-1] + normals[1:], normals[-1:]])
    joints /= np.linalg.norm(joints, axis=1, keepdims=True)
    wires = [
        make_wire(
            [*(supports[span] + offset * joints[span]), height],
            [*(supports[span + 1] + offset * joints[span + 1]), height],
            c, **{'seed': 10 * span + number, **changes},
        )
        for span in range(len(runs)) for number, offset in enumerate(offsets)
    ]
    points = np.vstack(wires)
    ends = np.cumsum([0, *map(len, wires)])
    return points, [make_curve(points, np.arange(low, high)) for low, high in pairwise(ends)]
