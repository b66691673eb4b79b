# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Boxes along the axes."""

import numpy as np

from plc_inspect.results import Float64


def measure_box_gap(first: Float64, second: Float64) -> float:
    """
    Return the distance between two boxes, 0 if they touch or overlap.

    Parameters
    ----------
    first, second : (2, 3) float64
        Lower and upper corner of each [m].

    Returns
    -------
    float
        Distance between their nearest points [m].

    """
    apart = np.maximum(first[0] - second[1], second[0] - first[1])
    return float(np.linalg.norm(np.maximum(apart, 0.0)))
