# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Which limit a point breaks."""

from factories import make_span
import numpy as np
import pytest
from toys import make_curve, make_wire

from plc_inspect.core.hazards.breaches import find_breaches
from plc_inspect.core.hazards.clearance_rules import Limit
from plc_inspect.core.spans.span_model import SpanModel
from plc_inspect.results import Severity


@pytest.mark.parametrize(('aside', 'is_near'), [(3.1, True), (-3.1, True), (3.4, False)])
def test_horizontal_limits_are_from_the_outer_sub_conductor(aside, is_near):
    curve = make_curve(make_wire((0.0, 0.0, 15.0), (90.0, 0.0, 15.0), noise=0.0))
    model = SpanModel(
        span=make_span(0, 0, (0.0, 0.0, 15.0), (90.0, 0.0, 15.0)), curve=curve,
        start_x=curve.low, end_x=curve.high, strands=np.array([[-0.3, 0.0], [0.3, 0.0]]),
    )
    limit = Limit(
        feature='building', distance=3.0, tiers=((Severity.CRITICAL, 3.0),),
        measure='horizontal',
    )
    points = np.array([[45.0, aside, 5.0]])
    found = find_breaches(points, np.array([9.0]), np.zeros(1, dtype=np.int64), [model], [limit])
    assert (found.severity[0] > 0) == is_near
    if is_near:
        assert found.value[0] == pytest.approx(abs(aside) - 0.3, abs=0.01)
