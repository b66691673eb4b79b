# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The keep-out goes over the link as it was measured."""

import math

import numpy as np
import pytest
from stream_pieces import Source

from plc_inspect.core.live.proximity import Level, Proximity, Thing
from plc_inspect.errors import DataError
from plc_inspect.stream.nearness import NEARNESS, pack_nearness, read_nearness, tell_nearness
from plc_inspect.stream.summary import read_summary

FOUND = (
    Proximity(thing=Thing.CONDUCTOR, level=Level.WARNING, distance=13.0, line_id=2, span_id=5,
              position=np.array([500_012.0, 5_650_004.0, 103.0]), closest=9.5, closest_in=3.0,
              sigma=0.07, extended=True),
    Proximity(thing=Thing.SUPPORT, level=Level.CLEAR, position=np.full(3, np.nan)),
)
VEHICLE = 500_000.0, 5_650_000.0, 100.0


def test_it_comes_back_as_it_was_measured():
    near = tell_nearness(FOUND, VEHICLE, 8.0)
    message = read_summary(Source().summary(1.0, keyframe=True, near=near, heading=0.5,
                                            near_uptime=0.75))
    wire, support = message.status.near
    assert (wire.thing, wire.level, wire.line_id, wire.span_id) == (
        Thing.CONDUCTOR, Level.WARNING, 2, 5
    )
    assert wire.way == (12.0, 4.0, 3.0)  # the way is short however far the origin is
    assert wire.extended
    assert (wire.distance, wire.closest, wire.closest_in) == (13.0, 9.5, 3.0)
    assert wire.limit == 8.0
    assert wire.sigma == pytest.approx(0.07)
    assert support.level == Level.CLEAR
    assert math.isnan(support.distance)
    assert message.status.heading == 0.5
    assert message.status.near_uptime == 0.75
    assert read_summary(Source().summary(1.0)).status.near == ()


@pytest.mark.parametrize(('name', 'value', 'problem'), [
    ('thing', 9, 'thing 9'), ('level', 7, 'level 7'), ('distance', np.nan, 'distance of nan'),
])
def test_what_cannot_be_is_refused(name, value, problem):
    rows = pack_nearness(tell_nearness(FOUND[:1], VEHICLE, 8.0))
    assert rows.dtype == NEARNESS
    rows[name] = value
    with pytest.raises(DataError, match=problem):
        read_nearness(rows)
