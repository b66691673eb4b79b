# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What tiles found is joined into one grid."""

import math

import numpy as np
from spans import make_hazard, make_span, make_support

from plc_inspect.grid.joining import join_tiles, turn_span
from plc_inspect.grid.tiles.plain_results import FoundTile


def make_tile(number, territory, spans, supports=(), hazards=()):
    """Make what was found in one tile."""
    middles = [(span.start[:2] + span.end[:2]) / 2 for span in spans]
    return FoundTile(
        number=number, name=f't{number}', spans=tuple(spans), supports=tuple(supports),
        hazards=tuple(hazards), middles=np.array(middles).reshape(-1, 2), territory=territory,
        vegetation={(span.line_id, span.span_id): None for span in spans},
    )


def test_a_hazard_is_measured_from_a_support_of_the_grid_only():
    """The tile that a support stands in may not have found it."""
    span = make_span((10.0, 5.0, 20.0), (90.0, 5.0, 21.0))
    ends = [make_support((10.0, 5.0, 0.0), support_id=0), make_support((90.0, 5.0, 0.0),
                                                                      support_id=1)]
    hazards = [
        make_hazard((20.0, 5.0, 12.0), hazard_id=0, support_id=0, from_support=10.0),
        make_hazard((80.0, 5.0, 12.0), hazard_id=1, support_id=1, from_support=10.0,
                    along_span=70.0),
    ]
    joined = join_tiles([
        make_tile(0, (0.0, 0.0, 60.0, 60.0), [span], ends, hazards),
        make_tile(1, (60.0, 0.0, 120.0, 60.0), [span]),
    ])
    assert [item.position[0] for item in joined.supports] == [10.0]
    first, second = joined.hazards
    assert (first.support_id, first.from_support) == (0, 10.0)
    assert second.support_id == -1
    assert math.isnan(second.from_support)


def test_a_span_that_is_turned_hangs_as_before():
    span = make_span((10.0, 5.0, 20.0), (90.0, 45.0, 27.0))
    turned = turn_span(span)
    x = np.linspace(0.0, span.length, 9)
    np.testing.assert_allclose(turned.positions(x)[::-1], span.positions(x), atol=1e-9)
    a2, a1, a0 = turned.quadratic
    np.testing.assert_allclose(
        (a2 * x**2 + a1 * x + a0)[::-1], np.polyval(span.quadratic, x), atol=1e-9
    )
