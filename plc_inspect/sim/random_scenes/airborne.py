# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Airborne scanner of the random scenes: strips of zigzag scan lines."""

from collections.abc import Iterator
import math

import numpy as np
from numpy.typing import NDArray

from plc_inspect.sim.random_scenes.returns import Beams, Scanner
from plc_inspect.sim.random_scenes.surveys import Zigzag

Float64 = NDArray[np.float64]

_BATCH = 400_000
_ABOVE = 20.0
"""Least height of the scanner above all objects, and reach of beams below ground [m]."""
_WIDEST = 0.45
"""Tangent of the greatest angle from the vertical: 24 degrees."""


def fly_strips(
    scanner: Scanner, pattern: Zigzag, rng: np.random.Generator,
) -> Iterator[Beams]:
    """
    Yield the pulses of a survey, strip by strip for each edge of the route.

    The flight follows the line from edge to edge.  The scan lines of a strip zigzag over its whole
    width, so they are evenly spaced in the middle and in pairs at the edges.  Strips look from
    different sides, and each is displaced as a whole by its misalignment.
    """
    offsets = rng.normal(0.0, pattern.misalignment, (pattern.num_strips, 3))
    turns = pattern.heading + rng.normal(0.0, 0.03, pattern.num_strips)
    for edge in range(len(scanner.scene.route) - 1):
        for offset, turn in zip(offsets, turns, strict=True):
            yield from _sweep(scanner, pattern, edge, (float(turn), offset), rng)


def _sweep(
    scanner: Scanner, pattern: Zigzag, edge: int, strip: tuple[float, Float64],
    rng: np.random.Generator,
) -> Iterator[Beams]:
    """Yield the pulses of one strip along one edge of the route."""
    scene, (turn, offset) = scanner.scene, strip
    start, end = scene.route[edge:edge + 2]
    heading = math.atan2(*(end - start)[::-1]) + turn
    frame = np.array([[math.cos(heading), math.sin(heading)],
                      [-math.sin(heading), math.cos(heading)]])
    # at a bend the corridor extends beyond the end of an edge, by less than its half width
    local = np.vstack([np.zeros(2), frame @ (end - start)])
    low = local.min(axis=0) - 1.2 * scene.half_width
    high = local.max(axis=0) + 1.2 * scene.half_width
    width = float(high[1] - low[1])
    per_line = max(2, round(width * pattern.line_spacing * pattern.density / pattern.num_strips))
    num = int((high[0] - low[0]) / pattern.line_spacing) * per_line
    track, phase = rng.uniform(low[1], high[1]), rng.uniform(0.0, 2.0)
    for first in range(0, num, _BATCH):
        beat = np.arange(first, min(first + _BATCH, num)) / per_line
        swing = np.abs(np.mod(beat + phase, 2.0) - 1.0)
        plan = low + np.column_stack([pattern.line_spacing * beat, width * swing])
        xy = start + plan @ frame
        kept = scanner.coverage.find(xy) == edge
        xy, plan = xy[kept], plan[kept]
        if not len(xy):
            continue
        ground = np.column_stack([xy, scene.terrain.heights(xy)])
        # the scanner is above the track, beside the pulse, but no farther aside than _WIDEST
        high_up = max(pattern.altitude, scanner.ceiling + _ABOVE - float(ground[:, 2].mean()))
        aside = np.clip(plan[:, 1] - track, -_WIDEST * high_up, _WIDEST * high_up)
        down = np.column_stack([np.zeros(len(plan)), aside]) @ frame
        directions = np.column_stack([down, np.full(len(plan), -high_up)])
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        back = (scanner.ceiling + 1.0 - ground[:, 2]) / -directions[:, 2]
        yield Beams(
            origins=ground - back[:, None] * directions, directions=directions,
            reach=back + _ABOVE, skipped=high_up / -directions[:, 2] - back, offset=offset,
        )
