# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Small things for tests of the monitor: a stream made by hand, without a node."""

import dataclasses
from functools import cache

from factories import make_inspection, make_span
import numpy as np

from plc_inspect.results import Severity
from plc_inspect.stream.blocks import pack_blocks, thin_points
from plc_inspect.stream.frame import CLOUD, Frame, pack_frame
from plc_inspect.stream.summary import make_tables, Status, SummaryTables
from plc_inspect.stream.summary_writer import EVERYTHING, Share, SummaryWriter

TEXTS = ('odom', 'scans and odometry come in', '6% of the map in use', 'all is well')
NO_TABLES = SummaryTables()
CHANGES = Share()
HEALTH = {
    'scan_rate': 10.0, 'scans_lost': 4.0, 'scan_age': 0.1, 'odometry_age': 0.02,
    'sharpness': 0.9,
}


@cache
def make_result():
    """Make results by hand, once."""
    return make_inspection(num_ground=500).result


def make_hazards(count=3):
    """Make hazards of falling severity, with clearances of their own."""
    (hazard,) = make_result().hazards
    return [
        dataclasses.replace(
            hazard, hazard_id=k, clearance=1.234 + k, severity=Severity(3 - k % 3),
            line_id=k % 3,
        )
        for k in range(count)
    ]


def make_rows(num_spans=6, num_hazards=3):
    """Make tables of some spans, supports and hazards."""
    result = make_result()
    spans = list(result.spans)
    while len(spans) < num_spans:
        k = len(spans)
        spans.append(make_span(k % 3, k // 3, (120.0 * k, 0.0, 15.0), (120.0 * k + 119, 0, 16.0)))
    return make_tables(
        [(span, False) for span in spans[:num_spans]], result.supports, make_hazards(num_hazards)
    )


class Source:
    """A node's stream, message by message."""

    def __init__(self, session=7, resets=0):
        self.session, self.resets = session, resets
        self.writer = SummaryWriter(session)
        self.tables = make_rows()
        self.sequence = 0

    def summary(self, uptime, *, keyframe=False, tables=None, share=CHANGES, **status):
        """Return the next message of the summary: everything, or a share of it."""
        self.tables = self.tables if tables is None else tables
        values = {
            'tick_uptime': uptime, 'vehicle_uptime': uptime, 'health_uptime': uptime,
            'vehicle': (10.0 + uptime, 2.0, 30.0), 'stamp_ns': round(1e9 * (1000 + uptime)),
            'resets': self.resets, 'health': dict(HEALTH),
        }
        return self.writer.write(
            self.tables, Status(**(values | status)), TEXTS, uptime,
            EVERYTHING if keyframe else share,
        )

    def cloud(self, uptime, points=None, *, overview=False, voxel=0.5, total=1):
        """Return the next message of the corridor, of some points."""
        points = np.array([[1.0, 2.0, 3.0]] if points is None else points)
        count = len(points)
        cells = thin_points(
            points, np.full(count, 5, np.uint8), np.full(count, 2.0, np.float32), voxel
        )
        blocks = {
            tuple(key): cells.codes[low:high] for key, low, high in zip(
                cells.blocks.tolist(), cells.starts, cells.starts[1:], strict=False
            )
        }
        body = pack_blocks(blocks, overview=overview, voxel=voxel, total=total)
        self.sequence += 1
        return pack_frame(Frame(kind=CLOUD, flags=0, session=self.session,
                                sequence=self.sequence - 1, uptime=uptime, body=body))
