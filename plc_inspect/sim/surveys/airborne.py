# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Airborne maps of a scene: labelled clouds, surveyed from above."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from plc_inspect.errors import DataError
from plc_inspect.results import catenary_heights
from plc_inspect.sim.scenes.scene import Scene
from plc_inspect.sim.surveys.ray_kernels import MISS
from plc_inspect.sim.surveys.raycast import Beam, build_world, cast, label_items

Float64 = NDArray[np.float64]
Int32 = NDArray[np.int32]
UInt8 = NDArray[np.uint8]

_BATCH = 500_000
_WIRE_WIDTH = 0.65
_ALTITUDE = 60.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LabelledCloud:
    """Points with their truth, in parallel arrays."""

    points: Float64
    """(N, 3) as measured, with noise [m]."""
    exact: Float64
    """(N, 3) true positions of the returns [m]."""
    label: UInt8
    """(N,) ASPRS classes."""
    line_id: Int32
    """(N,) line of a wire point, -1 for others."""
    span_id: Int32
    """(N,) span of a wire point, -1 for others."""
    conductor: Int32
    """(N,) number of the conductor in the scene, -1 for others."""

    def take(self, index: NDArray[np.int64] | NDArray[np.bool_]) -> 'LabelledCloud':
        """Return the points at indices or in a mask."""
        return LabelledCloud(
            points=self.points[index], exact=self.exact[index], label=self.label[index],
            line_id=self.line_id[index], span_id=self.span_id[index],
            conductor=self.conductor[index],
        )


def simulate_map(
    scene: Scene, density: float, rng: np.random.Generator, *, noise: float = 0.03,
    num_points: int | None = None,
) -> LabelledCloud:
    """
    Survey a scene from above.

    Pulses are spread evenly over the corridor from two overlapping strips that look up to 20
    degrees to either side.  A pulse continues behind wires and through gaps in crowns, with up to
    four returns.  A wire returns the pulses within 0.33 m of it, which gives about 0.65 x density
    points per metre of wire, as in dense overlapping strips.

    Parameters
    ----------
    scene : Scene
        What is surveyed.
    density : float
        Pulses per square metre of ground.
    rng : numpy.random.Generator
        Source of all randomness.
    noise : float
        Standard deviation of each coordinate [m].
    num_points : int, optional
        Exactly this number of points, drawn from a scan that is dense enough for it; ``density``
        is then only a lower bound.

    Returns
    -------
    LabelledCloud
        In scan order (along the corridor, then across), in the frame of the scene.

    Raises
    ------
    DataError
        The density is not positive.

    """
    if not density > 0 or (num_points is not None and num_points < 1):
        raise DataError(f'no map with {density:g} points/m2 and {num_points} points')
    if num_points is not None:
        density = max(density, 1.02 * num_points / scene.area)
    world, beam = build_world(scene), Beam(
        divergence=0.0, exit_width=0.3, wire_reach=0.5 * _WIRE_WIDTH, max_returns=4,
        pass_share=0.6,
    )
    labels = label_items(scene, world)
    top = max(float(world.top.max(initial=-np.inf)), float(world.ground_top.max())) + _ALTITUDE
    key = int(rng.integers(2**62))
    parts = []
    for number, xy in enumerate(_lay_pulses(scene, density, rng)):
        tilt = np.radians(rng.uniform(2.0, 20.0, len(xy))) * rng.choice([-1.0, 1.0], len(xy))
        heading = _across(scene)
        directions = np.column_stack([
            np.sin(tilt) * np.cos(heading), np.sin(tilt) * np.sin(heading), -np.cos(tilt),
        ])
        ground = np.column_stack([xy, scene.terrain.heights(xy)])
        back = (top - ground[:, 2]) / np.cos(tilt)
        origins = ground - back[:, None] * directions
        ranges, items = cast(world, origins, directions, back + 60.0, beam, key + number)
        beam_index, order = np.nonzero(items != MISS)
        item = items[beam_index, order]
        exact = origins[beam_index] + ranges[beam_index, order][:, None] * directions[beam_index]
        conductor = labels.conductor[item]
        wire = conductor >= 0
        exact[wire] = snap(exact[wire], world.curves[conductor[wire]])
        keep = scene.covers(exact[:, :2])
        cloud = LabelledCloud(
            points=exact + rng.normal(0.0, noise, exact.shape), exact=exact,
            label=labels.label[item], line_id=labels.line_id[item],
            span_id=labels.span_id[item], conductor=conductor,
        )
        parts.append(cloud.take(keep))
    cloud = join(parts)
    if num_points is None:
        return cloud
    if len(cloud.points) < num_points:
        return simulate_map(scene, 1.1 * density, rng, noise=noise, num_points=num_points)
    chosen = rng.choice(len(cloud.points), num_points, replace=False)
    chosen.sort()
    return cloud.take(chosen)


def _across(scene: Scene) -> float:
    """Return the direction [rad] across the corridor as a whole."""
    dx, dy = scene.route[-1] - scene.route[0]
    return float(np.arctan2(dy, dx)) + 0.5 * np.pi


def _lay_pulses(scene: Scene, density: float, rng: np.random.Generator) -> list[Float64]:
    """Return batches of positions on the ground (N, 2), each a strip of the corridor's box."""
    margin = scene.half_width
    low, high = scene.route.min(axis=0) - margin, scene.route.max(axis=0) + margin
    axis = int(np.argmax(high - low))
    total = float(np.prod(high - low)) * density
    edges = np.linspace(low[axis], high[axis], max(2, int(total / _BATCH) + 2))
    batches = []
    for first, last in pairwise(edges):
        box_low, box_high = low.copy(), high.copy()
        box_low[axis], box_high[axis] = first, last
        num = rng.poisson(float(np.prod(box_high - box_low)) * density)
        xy = rng.uniform(box_low, box_high, (num, 2))
        xy = xy[scene.covers(xy)]
        batches.append(xy[np.argsort(xy[:, axis] // 0.5, kind='stable')])
    return batches


def snap(points: Float64, curves: Float64) -> Float64:
    """Return the points (N, 3) moved onto catenaries (N, 8), at the same x along them [m]."""
    x = (points[:, 0] - curves[:, 3]) * curves[:, 5] + (points[:, 1] - curves[:, 4]) * curves[:, 6]
    x = np.clip(x, 0.0, curves[:, 7])
    z = catenary_heights(curves[:, 0], curves[:, 1], curves[:, 2], x)
    return np.column_stack([
        curves[:, 3] + x * curves[:, 5], curves[:, 4] + x * curves[:, 6], z,
    ])


def join(parts: Sequence[LabelledCloud]) -> LabelledCloud:
    """Return one or more clouds as one."""
    return LabelledCloud(
        points=np.vstack([item.points for item in parts]),
        exact=np.vstack([item.exact for item in parts]),
        label=np.concatenate([item.label for item in parts]),
        line_id=np.concatenate([item.line_id for item in parts]),
        span_id=np.concatenate([item.span_id for item in parts]),
        conductor=np.concatenate([item.conductor for item in parts]),
    )
