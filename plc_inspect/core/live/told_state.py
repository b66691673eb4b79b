# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What is known, as it is told: in the frame of the odometry as it is now."""

from dataclasses import replace

from plc_inspect.core.alignment.moved_results import move_hazard, move_span, move_support
from plc_inspect.core.alignment.rigid_move import RigidMove
from plc_inspect.core.live.session import LiveState


def move_state(state: LiveState, move: RigidMove) -> LiveState:
    """Return a state elsewhere, but for ``around``, which stays; the same where nothing moves."""
    if move.trivial:
        return state
    return replace(
        state,
        spans=tuple(
            replace(item, span=move_span(item.span, move), points=move.apply(item.points))
            for item in state.spans
        ),
        supports=tuple(move_support(item, move) for item in state.supports),
        hazards=tuple(move_hazard(item, move) for item in state.hazards),
        corridor=replace(state.corridor, points=move.apply(state.corridor.points)),
    )
