# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Moves truth to where drifting odometry maps it.

A map built on drifting odometry lies in a bent frame.  For each conductor-span, the mean rigid
error (translation and yaw) of its returns moves the truth into that frame.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plc_inspect.sim.scenes.conductors import Conductor

Float64 = NDArray[np.float64]
Key = tuple[int, int]

LEAST_RETURNS = 20
"""Least number of returns of a span that has a placement of its own."""
REACH = 15.0
"""Greatest distance in plan of the end of a conductor from the foot of its support [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Placement:
    """A rotation about the vertical through ``centre``, and a translation."""

    centre: Float64
    """(3,) in the world [m]."""
    yaw: float
    shift: Float64
    """(3,) [m]."""
    num_points: int = 0
    horizontal_rms: float = 0.0
    """Residual of the drift in plan about this placement: the smear of the span [m]."""
    vertical_rms: float = 0.0

    def move(self, points: Float64) -> Float64:
        """Return the points (N, 3) as mapped by the odometry [m]."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return (points - self.centre) @ turn.T + self.centre + self.shift


class PlacementSums:
    """Sums over the returns of one conductor-span that give its placement."""

    def __init__(self, centre: Float64) -> None:
        """Begin with empty sums; ``centre`` (3,), near the span, keeps them small [m]."""
        self.centre = centre
        self._num = 0
        self._true = np.zeros(3)
        self._put = np.zeros(3)
        self._dot = self._cross = self._true2 = self._put2 = self._rise2 = 0.0

    def add(self, true: Float64, put: Float64) -> None:
        """Add true (N, 3) and mapped (N, 3) positions of returns [m]."""
        p, q = true - self.centre, put - self.centre
        self._num += len(p)
        self._true += p.sum(axis=0)
        self._put += q.sum(axis=0)
        self._dot += float((p[:, 0] * q[:, 0] + p[:, 1] * q[:, 1]).sum())
        self._cross += float((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum())
        self._true2 += float((p[:, :2] ** 2).sum())
        self._put2 += float((q[:, :2] ** 2).sum())
        self._rise2 += float(((q[:, 2] - p[:, 2]) ** 2).sum())

    def solve(self) -> Placement | None:
        """Return the least-squares placement; None with fewer than LEAST_RETURNS."""
        n = self._num
        if n < LEAST_RETURNS:
            return None
        p, q = self._true / n, self._put / n
        dot = self._dot - n * float(p[0] * q[0] + p[1] * q[1])
        cross = self._cross - n * float(p[0] * q[1] - p[1] * q[0])
        left = self._true2 - n * float(p[:2] @ p[:2]) + self._put2 - n * float(q[:2] @ q[:2])
        rise = float(q[2] - p[2])
        return Placement(
            centre=self.centre + p, yaw=float(np.arctan2(cross, dot)), shift=q - p, num_points=n,
            horizontal_rms=float(np.sqrt(max(0.0, left - 2 * np.hypot(dot, cross)) / n)),
            vertical_rms=float(np.sqrt(max(0.0, self._rise2 / n - rise**2))),
        )


def solve_placements(
    conductors: Sequence[Conductor], sums: Sequence[PlacementSums],
) -> dict[Key, Placement]:
    """Return the placements of the conductor-spans with enough returns, by line and span id."""
    return {
        (item.line_id, item.span_id): placement
        for item, own in zip(conductors, sums, strict=True)
        for placement in (own.solve(),) if placement is not None
    }


def place_truth(
    truth: Mapping[str, Any], placements: Mapping[Key, Placement], default: Placement,
) -> dict[str, Any]:
    """
    Return the truth of a flight in the odometry frame.

    Parameters
    ----------
    truth : mapping
        Truth in the world, from `plc_inspect.sim.surveys.truth.make_truth`.
    placements : mapping
        Placements of the conductor-spans that were seen, by (line_id, span_id).
    default : Placement
        Placement of all others.

    Returns
    -------
    dict
        Like ``truth``; spans, supports and hazards hold their shape in the world under 'world',
        and spans what the drift leaves under 'drift'.

    """
    def choose(key: Key) -> Placement:
        if key in placements:
            return placements[key]
        same = [item for (_, span_id), item in placements.items() if span_id == key[1]]
        return max(same, key=lambda item: item.num_points) if same else default

    return {
        **truth,
        'spans': [
            _place_span(row, choose((row['line_id'], row['span_id']))) for row in truth['spans']
        ],
        'supports': [
            _place_support(row, placements, truth['spans'], default) for row in truth['supports']
        ],
        'hazards': [
            _place_hazard(row, choose((row['line_id'], row['span_id'])))
            for row in truth['hazards']
        ],
        'planted': [
            {**row, 'position': _move(choose((row['line_id'], row['span_id'])), row['position'])}
            for row in truth['planted']
        ],
    }


def _move(placement: Placement, point: list[float]) -> list[float]:
    moved: list[float] = placement.move(np.array([point]))[0].tolist()
    return moved


def _place_span(row: dict[str, Any], placement: Placement) -> dict[str, Any]:
    kept = ('start', 'end', 'azimuth', 'a', 'quadratic', 'lowest')
    rise = float(placement.shift[2])
    return {
        **row, 'start': _move(placement, row['start']), 'end': _move(placement, row['end']),
        'lowest': _move(placement, row['lowest']), 'azimuth': row['azimuth'] + placement.yaw,
        'a': row['a'] + rise, 'quadratic': [*row['quadratic'][:2], row['quadratic'][2] + rise],
        'world': {key: row[key] for key in kept},
        'drift': {
            'shift': placement.shift.tolist(), 'yaw': placement.yaw,
            'horizontal_rms': placement.horizontal_rms, 'vertical_rms': placement.vertical_rms,
        },
    }


def _place_support(
    row: dict[str, Any], placements: Mapping[Key, Placement], spans: list[dict[str, Any]],
    default: Placement,
) -> dict[str, Any]:
    """Move a support by the mean placement of the conductors that it carries."""
    foot = np.array(row['position'])
    near = [
        placements[key].move(foot[None])[0]
        for span in spans
        for key in ((span['line_id'], span['span_id']),)
        if key in placements and span['line_id'] in row['lines'] and any(
            np.hypot(*(np.array(span[end]) - foot)[:2]) < REACH for end in ('start', 'end')
        )
    ]
    place = np.mean(near, axis=0) if near else default.move(foot[None])[0]
    return {**row, 'position': place.tolist(), 'world': {'position': row['position']}}


def _place_hazard(row: dict[str, Any], placement: Placement) -> dict[str, Any]:
    # all corners, as a long box that turns is wider
    box = placement.move(np.array(list(product(*zip(*row['extent'], strict=True)))))
    return {
        **row, 'position': _move(placement, row['position']),
        'extent': [box.min(axis=0).tolist(), box.max(axis=0).tolist()],
        'world': {'position': row['position'], 'extent': row['extent']},
    }
