# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The frame of a span in which its figures are drawn: along its lines and across them."""

from dataclasses import dataclass

import numpy as np

from plc_inspect.offline.records.units import Record
from plc_inspect.offline.report.point_scene import Scene
from plc_inspect.results import Float64, Int64

MARGIN_SHARE = 0.04
"""Room beyond the ends of a span, as a share of its length."""
LEAST_MARGIN = 4.0
"""Least such room [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpanFrame:
    """The lines of one span and a frame along the longest of them, in the units of the input."""

    spans: list[Record]
    """One record for each line."""
    origin: Float64
    """(2,) start of the longest line."""
    along: Float64
    """(2,) unit vector of the longest line."""
    across: Float64
    """(2,) unit vector to the left of it."""
    ends: Float64
    """(2 K, 2) both ends of each line in plan."""
    margin: float
    """Space drawn beyond the ends."""

    @property
    def stations(self) -> Float64:
        """(2 K,) how far along the span the ends are."""
        result: Float64 = (self.ends - self.origin) @ self.along
        return result

    @property
    def offsets(self) -> Float64:
        """(2 K,) how far across the span the ends are."""
        result: Float64 = (self.ends - self.origin) @ self.across
        return result

    def locate(
        self, scene: Scene, low: float, high: float, reach: float
    ) -> tuple[Int64, Float64, Float64]:
        """
        Find the points of a scene beside a part of the span.

        Parameters
        ----------
        scene : Scene
            What is shown.
        low, high : float
            Where the part begins and ends along the span.
        reach : float
            Distance from the outer lines.

        Returns
        -------
        rows : (N,) int64
            Rows of the points, ascending: those of the part within reach and some beyond.
        along, across : (N,) float64
            Their places in this frame.

        """
        rows = np.sort(scene.index.strip(
            self.origin + low * self.along, self.origin + high * self.along,
            reach + float(np.abs(self.offsets).max()),
        )).astype(np.int64)
        apart = scene.points[rows, :2] - self.origin
        return rows, apart @ self.along, apart @ self.across


def find_frame(scene: Scene, span_id: int) -> SpanFrame:
    """Return the frame of a span of a scene."""
    spans = [span for span in scene.spans if span['span_id'] == span_id]
    longest = max(spans, key=lambda span: span['length'])
    origin, end = np.array(longest['start'][:2]), np.array(longest['end'][:2])
    along = (end - origin) / max(float(np.linalg.norm(end - origin)), 1e-9)
    ends = np.array([span[name][:2] for span in spans for name in ('start', 'end')])
    stations = (ends - origin) @ along
    return SpanFrame(
        spans=spans, origin=origin, along=along, across=np.array([-along[1], along[0]]),
        ends=ends,
        margin=max(
            MARGIN_SHARE * (stations.max() - stations.min()), LEAST_MARGIN * scene.metre
        ),
    )
