# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The curve of a span's record as points."""

import numpy as np
from numpy.typing import NDArray

from plc_inspect.offline.records.units import Record

TOLERANCE = 0.005
"""Greatest distance of a drawn polyline from its catenary [m]."""


def trace_span(row: Record, tolerance: float, ratio: float = 1.0) -> NDArray[np.float64]:
    """
    Return the curve of a span's record as points, equally spaced.

    Parameters
    ----------
    row : dict
        As ``spans.json`` holds it.
    tolerance : float
        Greatest distance of the curve from the lines between points [horizontal unit].
    ratio : float
        Vertical units in a horizontal one.

    Returns
    -------
    (N, 3) float64
        In the units of the record.

    """
    start, end = np.array(row['start'], float), np.array(row['end'], float)
    # a chord over a step lies step^2 / 8 times the second derivative above the curve
    steepest = max(abs(row['b']), abs(row['length'] - row['b'])) / row['c']
    step = np.sqrt(8.0 * tolerance * row['c'] / np.cosh(steepest))
    x = np.linspace(0.0, row['length'], max(2, int(np.ceil(row['length'] / step)) + 1))
    line = start + (x / max(row['length'], 1e-9))[:, None] * (end - start)
    lift = np.cosh((x - row['b']) / row['c'])
    chord = lift[0] + (x / max(row['length'], 1e-9)) * (lift[-1] - lift[0])
    line[:, 2] += row['c'] * (lift - chord) * ratio
    return line
