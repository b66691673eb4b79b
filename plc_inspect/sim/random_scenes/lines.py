# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Random lines: routes, supports and conductors."""

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from plc_inspect.sim.random_scenes.layouts import Layout, list_strings
from plc_inspect.sim.random_scenes.supports import add_support, Stand
from plc_inspect.sim.scenes.conductors import Conductor
from plc_inspect.sim.scenes.routes import face_ahead, lay_route
from plc_inspect.sim.scenes.scene import Post, SceneBuilder
from plc_inspect.sim.scenes.terrain import Terrain

Float64 = NDArray[np.float64]

LARGEST_TURN_DEG = 60.0
TURNS = 0.35
"""Share of supports at which a line turns."""
APART = 2.5
"""Least distance between conductors of two lines, so that they do not flash over [m]."""
MOST_SPANS = 8
"""Greatest number of spans of a line; more only make scenes slower."""
TALLEST = 25.0
"""Greatest extension of a support; lines that need more are not built [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Line:
    """A line that is planned but not yet built."""

    layout: Layout
    stands: tuple[Stand, ...]
    conductors: tuple[Conductor, ...]

    @property
    def route(self) -> Float64:
        """(K, 2) feet of the supports [m]."""
        return np.array([stand.foot[:2] for stand in self.stands])

    def sample(self) -> Float64:
        """Return points (N, 3) of all conductors, at most half a metre apart [m]."""
        return np.vstack([item.sample(0.5) for item in self.conductors])


def draw_route(rng: np.random.Generator, layout: Layout, length: float) -> Float64:
    """Return a random route (K, 2) of about this length and at most `MOST_SPANS` spans [m]."""
    low, high = layout.spans
    typical = rng.uniform(low, high)
    spans: list[float] = []
    most = int(rng.integers(3, MOST_SPANS + 1))
    while not spans or (len(spans) < most and sum(spans) + 0.5 * typical < length):
        spans.append(float(np.clip(typical * rng.uniform(0.6, 1.4), low, high)))
    turns, heading = [], 0.0
    for _ in spans[1:]:
        turn = rng.normal(0.0, 1.0)
        if rng.random() < TURNS:
            turn = rng.uniform(-LARGEST_TURN_DEG, LARGEST_TURN_DEG)
        if abs(heading + turn) > 90.0:
            turn = -turn
        heading += turn
        turns.append(float(turn))
    return lay_route(tuple(spans), tuple(turns), float(rng.uniform(0.0, 360.0)))


def plan_line(
    rng: np.random.Generator, terrain: Terrain, layout: Layout, route: Float64,
    raised: float = 0.0,
) -> Line | None:
    """
    Plan a line whose conductors keep the ground clearance of its layout.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of all chance.
    terrain : Terrain
        What it stands on.
    layout : Layout
        How it is built.
    route : ndarray
        (K, 2) feet of its supports [m].
    raised : float
        Extension of all supports, to pass over another line [m].

    Returns
    -------
    Line or None
        None if supports would have to be too tall.

    """
    spread = 1.0 if layout.column == 'pole' else 5.0
    extension = raised + rng.uniform(0.0, spread, len(route))
    for _ in range(8):
        line = _hang(terrain, layout, route, extension)
        short = np.zeros(len(route))
        for item in line.conductors:
            curve = item.sample(2.0)
            height = float((curve[:, 2] - terrain.heights(curve[:, :2])).min())
            for end in (item.span_id, item.span_id + 1):
                short[end] = max(short[end], layout.clearance - height)
        if short.max() <= 0.0:
            return line
        extension = extension + np.maximum(1.05 * short, 0.0)
        if extension.max() > TALLEST + raised:
            return None
    return None


def _hang(terrain: Terrain, layout: Layout, route: Float64, extension: Float64) -> Line:
    strings = list_strings(layout)
    ground = terrain.heights(route)
    stands = []
    for i, xy in enumerate(route):
        before, after, ahead = face_ahead(route, i)
        pull = after - before
        turn = float(np.hypot(*pull))
        stands.append(Stand(
            foot=np.array([xy[0], xy[1], ground[i]]), left=np.array([-ahead[1], ahead[0], 0.0]),
            extension=float(extension[i]),
            # poles have a stay at turns from about 15 degrees
            guy=-pull / turn if turn > 0.26 and layout.column == 'pole' else None,
        ))
    conductors = [
        Conductor(
            line_id=k, span_id=i, start=stands[i].locate(string.offset, string.height),
            end=stands[i + 1].locate(string.offset, string.height), c=string.constant,
            radius=string.radius, bundle_id=string.bundle,
        )
        for i in range(len(route) - 1) for k, string in enumerate(strings)
    ]
    return Line(layout=layout, stands=tuple(stands), conductors=tuple(conductors))


def are_apart(first: Line, second: Line) -> bool:
    """Tell whether two lines are clear of each other's conductors and supports."""
    one, two = first.sample(), second.sample()
    gap, _ = cKDTree(one).query(two)
    if gap.min() < APART:
        return False
    for line, other in ((first, two), (second, one)):
        near, _ = cKDTree(other[:, :2]).query(line.route)
        if near.min() < line.layout.reach + 2.0:
            return False
    return True


def build_line(builder: SceneBuilder, line: Line) -> None:
    """Add a line, with the next free ids of the builder."""
    first_line, first_span = builder.next_ids()
    num = 1 + max(item.line_id for item in line.conductors)
    for item in line.conductors:
        builder.conductors.append(Conductor(
            line_id=first_line + item.line_id, span_id=first_span + item.span_id,
            start=item.start, end=item.end, c=item.c, radius=item.radius,
            bundle_id=-1 if item.bundle_id < 0 else first_line + item.bundle_id,
        ))
    for stand in line.stands:
        height = add_support(builder, line.layout, stand)
        builder.posts.append(Post(
            position=stand.foot, height=height,
            kind='pole' if line.layout.column == 'pole' else 'tower',
            line_ids=tuple(range(first_line, first_line + num)),
        ))


def cross(
    rng: np.random.Generator, line: Line, layout: Layout, length: float,
) -> Float64:
    """Return the route (K, 2) of a second line that crosses a span of the first."""
    route = line.route
    span = int(rng.integers(len(route) - 1))
    share = rng.uniform(0.3, 0.7)
    middle = route[span] + share * (route[span + 1] - route[span])
    other = draw_route(rng, layout, length)
    at = int(rng.integers(len(other) - 1))
    over = other[at] + rng.uniform(0.3, 0.7) * (other[at + 1] - other[at])
    wanted = math.atan2(*(route[span + 1] - route[span])[::-1]) + rng.choice([-1.0, 1.0]) * (
        rng.uniform(math.radians(40.0), math.radians(90.0))
    )
    turn = wanted - math.atan2(*(other[at + 1] - other[at])[::-1])
    cos, sin = math.cos(turn), math.sin(turn)
    return (other - over) @ np.array([[cos, sin], [-sin, cos]]) + middle
