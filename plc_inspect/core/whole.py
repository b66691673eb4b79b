# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What the stages need to know of a whole cloud to find in a part of it what is in the whole."""

from dataclasses import dataclass
from typing import cast

import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.cloud_frame import CloudFrame
from plc_inspect.results import Float64


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Whole:
    """
    The figures of a whole cloud on which the result of a part of it depends.

    All else that the stages do at a place depends on points near it alone.
    """

    frame: CloudFrame
    """In which all parts are looked at."""
    region: Float64
    """(2, 3) least and greatest x, y and z of all points, in the frame [m]."""
    peak: float
    """Where the histogram of heights has its peak [m]."""
    anchor: Float64
    """(2,) least x and y of all points off the ground, in the frame [m]."""
    spacing: tuple[float, float] | None
    """Mean and standard deviation of the distance of candidates to their neighbours [m]; None
    where there are too few to tell."""
    probe_step: int
    """Of the points of the whole every so many is one by which radii of the corridor are
    chosen."""


class EqualDraws:
    """
    The same random numbers for every fit.

    A curve is then fitted alike whichever others are found: in a part of a cloud as in the whole.
    """

    def __init__(self, num_trials: int) -> None:
        """Draw those of one fit."""
        self._own = np.random.default_rng(0).random((num_trials, 3))

    def random(self, shape: tuple[int, int]) -> Float64:
        """Return (N, 3) numbers from 0 to 1, over and over the same."""
        return np.resize(self._own, shape)


def make_draws(settings: Settings) -> np.random.Generator:
    """Return what fits are drawn from."""
    return cast(np.random.Generator, EqualDraws(settings.catenary.num_trials))


def unpack(
    whole: Whole | None,
) -> tuple[Float64 | None, float | None, Float64 | None, tuple[float, float] | None]:
    """Return region, peak, anchor and spacing of the whole, None where there is none."""
    if whole is None:
        return None, None, None, None
    return whole.region, whole.peak, whole.anchor, whole.spacing
