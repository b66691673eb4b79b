# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Random scenes from a seed: lines on uneven ground, and objects that look like lines."""

from typing import get_args, Literal

import numpy as np
from numpy.typing import NDArray

from plc_inspect.errors import DataError
from plc_inspect.sim.random_scenes import clutter
from plc_inspect.sim.random_scenes.drops import add_drops
from plc_inspect.sim.random_scenes.ground import draw_feet, lay_ground, RELIEFS
from plc_inspect.sim.random_scenes.layouts import draw_layout
from plc_inspect.sim.random_scenes.lines import (
    are_apart,
    build_line,
    cross,
    draw_route,
    Line,
    plan_line,
)
from plc_inspect.sim.random_scenes.surveys import Survey
from plc_inspect.sim.scenes.routes import extend_route, lay_route
from plc_inspect.sim.scenes.scene import Scene, SceneBuilder

Float64 = NDArray[np.float64]
Kind = Literal['any', 'clean', 'no-lines']
KINDS: tuple[str, ...] = get_args(Kind)

MARGIN = 150.0
"""Extent of the ground beyond the route, for beams and crossing lines [m]."""
TRIALS = 20
"""Greatest number of lines drawn until one can be built."""


def make_random_scene(seed: int, kind: Kind, survey: Survey) -> Scene:
    """
    Make a scene.

    Parameters
    ----------
    seed : int
        Seed of all randomness.
    kind : str
        'any'; 'clean': lines with nothing else within 2 m of them; 'no-lines': what looks like
        lines, and none.
    survey : Survey
        The survey, which limits the size of the scene.

    Returns
    -------
    Scene

    Raises
    ------
    DataError
        The kind is unknown.

    """
    if kind not in KINDS:
        raise DataError(f'unknown kind of scene {kind!r}; there are {", ".join(KINDS)}')
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    half_width = float(rng.uniform(*survey.widths))
    length = survey.pattern.find_length(half_width)
    relief = RELIEFS[int(rng.choice(len(RELIEFS), p=[0.4, 0.3, 0.3]))]
    if kind == 'no-lines':
        length = float(np.clip(length, 60.0, 400.0))
        route = lay_route((length,), (), float(rng.uniform(0.0, 360.0)))
        terrain = lay_ground(rng, route, draw_feet(rng, route, relief), relief, MARGIN)
        builder = SceneBuilder(name='no line', seed=seed, terrain=terrain, rng=rng)
        clutter.fill(builder, route, half_width, 0.0, survey.find_road(route))
        return builder.build(route, half_width)
    for _ in range(TRIALS):
        layout = draw_layout(rng, survey.levels)
        route = draw_route(rng, layout, length)
        half_width = max(half_width, layout.reach + 8.0)
        terrain = lay_ground(rng, route, draw_feet(rng, route, relief), relief, MARGIN)
        line = plan_line(rng, terrain, layout, route)
        if line is not None:
            break
    else:
        raise DataError(f'seed {seed} gives no line that can be built')
    builder = SceneBuilder(name=layout.name, seed=seed, terrain=terrain, rng=rng)
    build_line(builder, line)
    if kind == 'any' and rng.random() < 0.3:
        _add_crossing(builder, line, survey)
    if kind == 'any' and layout.name.startswith('low') and rng.random() < 0.5:
        add_drops(builder, line, half_width)
    clear = 3.0 if kind == 'clean' else float(rng.choice([4.7, 2.5, 1.0, 0.2]))
    clutter.fill(builder, route, half_width, clear, survey.find_road(route))
    # half of the surveys begin and end within a span, the others beyond the last support
    ends = [
        float(-rng.uniform(0.1, 0.4) * span if rng.random() < 0.5 else rng.uniform(3.0, 15.0))
        for span in np.hypot(*np.diff(route, axis=0)[[0, -1]].T)
    ]
    return builder.build(cut_route(extend_route(route, *ends), 1.2 * length), half_width)


def cut_route(route: Float64, length: float) -> Float64:
    """Return the first ``length`` of a route (K, 2), or all of it [m]."""
    ends = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(route, axis=0).T))])
    if ends[-1] <= length:
        return route
    last = [np.interp(length, ends, route[:, axis]) for axis in range(2)]
    return np.vstack([route[ends < length], last])


def _add_crossing(builder: SceneBuilder, line: Line, survey: Survey) -> None:
    """Add a second line that crosses above or below the first, if one fits."""
    rng = builder.rng
    for _ in range(TRIALS):
        layout = draw_layout(rng, survey.levels)
        route = cross(rng, line, layout, 1.6 * layout.spans[1])
        raised = float(rng.choice([0.0, 0.0, 5.0, 10.0]))
        other = plan_line(rng, builder.terrain, layout, route, raised)
        if other is not None and are_apart(line, other):
            build_line(builder, other)
            builder.name += f', {layout.name}'
            return
