# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Why nothing goes into the map, told of an accumulator that was fed so."""

from dataclasses import replace

import numpy as np
import pytest

from plc_inspect.config import InputSettings, Settings
from plc_inspect.core.mapping.accumulator import Accumulator
from plc_inspect.core.mapping.standstill import explain_standstill

MS = 1_000_000
START = 1_700_000_000_000_000_000
POINTS = np.full((5, 3), 5, np.float32)


def fly(
    *, lead=0.0, pose_step=20, distance=1.0, scans=True, poses=True, quaternion=(0, 0, 0, 1.0),
    layouts=('xyz',), seconds=2, points=POINTS, times=(-0.04, 0),
):
    """Return what an accumulator counted of scans at 10 Hz."""
    accumulator = Accumulator(Settings())
    for ms in range(0, seconds * 1000, 10):
        now = ms * 1e-3
        if poses and ms % pose_step == 0:
            accumulator.add_pose(START + ms * MS, (0, 0, 0), quaternion, now=now)
        if scans and ms % 100 == 50:
            layout = layouts[min(ms // 100, len(layouts) - 1)]
            accumulator.add_scan(
                START + ms * MS + round(lead * 1e9), points * distance,
                np.linspace(*times, len(points)),
                layout=layout, now=now,
            )
    return accumulator.counters()


@pytest.mark.parametrize(('options', 'malformed', 'text'), [
    ({'lead': 18.0}, {}, 'scan stamps are 18.0 s ahead of odometry'),
    ({'lead': 3.0}, {}, '3.0 s ahead of odometry: set both by one clock, or the odometry'),
    ({'lead': -1.6e9}, {}, 'stamps of scans count from a start, such as power-on'),
    ({'pose_step': 340}, {}, 'odometry comes every 0.34 s; over more than 0.25 s'),
    ({'distance': 1e-9}, {}, 'no point of the scans lies between 1.5 and 100 m'),
    ({'points': POINTS[:0]}, {}, 'the scans hold no points'),
    ({'points': POINTS * np.nan}, {}, 'no point of the scans has finite coordinates and a finite'),
    ({'times': (np.nan, np.nan)}, {}, 'no point of the scans has finite coordinates and a finite'),
    ({'poses': False}, {}, 'no odometry came in'),
    ({'poses': False}, {'odometry': 'stamp of 0 s'}, 'all poses are malformed: stamp of 0 s'),
    ({'quaternion': (0, 0, 0, 0)}, {}, 'all poses are rejected: quaternion not of unit length'),
    ({'scans': False}, {}, 'no scan came in'),
    ({'scans': False}, {'scan': 'row_step 3'}, 'all scans are malformed: row_step 3'),
])
def test_cause_is_named(options, malformed, text):
    counters = fly(**options)
    assert counters.num_points_inserted == 0
    assert text in explain_standstill(counters, None, malformed, InputSettings())


def test_a_full_map_is_the_cause():
    full = replace(fly(), num_points_inserted=0, points_dropped={'map full': 9, 'too far': 3})
    assert explain_standstill(full, None, {}, InputSettings()).startswith('the map is full')


def test_only_what_came_since_counts():
    before = fly(lead=18.0)
    now = fly(lead=18.0, layouts=('xyz',) * 20 + ('yxz',), seconds=4)
    text = explain_standstill(now, before, {}, InputSettings())
    assert text == 'scans dropped: x, y, z in another order than before'
