# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Bars and pipes: wider than noise, and seen from one side, so their cross-section is an arc."""

import numpy as np

from plc_inspect.core.catenary.curve import Curve
from plc_inspect.results import Float64

ARC_SHARE = 0.25
"""
Share of the scatter across the flat of a cross-section that an arc explains, at least.
Source: measured: pipes of random racks 0.33 to 0.56; of 22 curves of six real clouds that lie on
conductors without a proven curvature, one has more than 0.15, of 12 points (ARC_SIGMAS: 2.6).
"""
ARC_SIGMAS = 5.0
"""
Standard deviations by which the arc's curvature differs from none, at least.
Source: judgement: three points of noise less than any pipe has; those of racks have 9 to 20.
"""
LEAST_POINTS = 8
"""Points of an arc, at least.  Source: derived: twice as many as it has parameters."""


def is_bar(points: Float64, curve: Curve) -> bool:
    """
    Tell whether the points of a curve lie on one side of a round bar.

    In the cross-section those of a conductor are noise about one place, or about a few, those of
    a bundle.  A bar or pipe is wider than the noise, and hides its own far side: across its flat
    they lie on an arc.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    curve : Curve
        The curve, with its points.

    Returns
    -------
    bool

    """
    own = points[curve.points]
    if len(own) < LEAST_POINTS:
        return False
    x, aside = curve.local(own)
    section = np.column_stack([aside, own[:, 2] - curve.fit.height(x)])
    section -= section.mean(axis=0)
    _, axes = np.linalg.eigh(section.T @ section)
    across, wide = (section @ axes).T
    # an arc is a parabola over the wider axis; a slope over it is none, as it is a main axis
    terms = np.column_stack([np.ones(len(own)), wide, wide * wide])
    inverse = np.linalg.pinv(terms.T @ terms)
    shape = inverse @ (terms.T @ across)
    rest = float(((across - terms @ shape) ** 2).sum())
    total = float(across @ across)
    sigma = np.sqrt(rest / (len(own) - terms.shape[1]) * inverse[2, 2])
    return bool(
        rest <= (1.0 - ARC_SHARE) * total and abs(shape[2]) >= ARC_SIGMAS * sigma and total > 0.0
    )
