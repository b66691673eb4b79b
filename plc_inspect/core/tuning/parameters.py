# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The tuned settings: those of Table 1 of the paper, with its conditions as bounds."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from plc_inspect.config import Settings
from plc_inspect.results import Float64
from plc_inspect.setting_names import describe, update

Values = tuple[float, ...]
"""One value for each parameter of SPACE, in its order."""

DIGITS = 3
"""Significant digits of a tuned value.  Source: judgement; not measured."""
LEAST = 1e-9
"""Least value whose logarithm is taken.  Source: numerical: avoids that of 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """One setting that is tuned."""

    name: str
    """Dotted, as in ``height.beta``."""
    symbol: str
    """Symbol in the paper."""
    initial: float
    """Initial value of Table 1, or the default if the stage differs from the paper's."""
    low: float
    high: float
    """Condition of Table 1 within the range of the setting; where it leaves a side open, a
    factor of five."""
    is_log: bool
    """Whether steps are factors, not differences."""
    unit: str = ''

    @property
    def is_whole(self) -> bool:
        """Whether only whole numbers are valid."""
        return self.name in _WHOLE

    def place(self, value: float) -> float:
        """Return the place of a value between the bounds, 0 to 1."""
        low, high, value = (self._scale(item) for item in (self.low, self.high, value))
        return min(max((value - low) / (high - low), 0.0), 1.0)

    def value(self, place: float) -> float:
        """Return the value at a place between the bounds, rounded to a valid one."""
        low, high = self._scale(self.low), self._scale(self.high)
        raw = low + min(max(place, 0.0), 1.0) * (high - low)
        return self.round(math.exp(raw) if self.is_log else raw)

    def round(self, value: float) -> float:
        """Return the nearest valid value within the bounds."""
        value = float(f'{value:.{DIGITS}g}')
        value = float(round(value)) if self.is_whole else value
        return min(max(value, self.low), self.high)

    def _scale(self, value: float) -> float:
        return math.log(max(value, LEAST)) if self.is_log else value


_WHOLE = {name for name, default, _ in describe() if type(default) is int}

SPACE = (
    Parameter(name='height.num_bins', symbol='nbin', initial=100.0, low=10.0, high=500.0,
              is_log=True),
    Parameter(name='height.beta', symbol='beta', initial=4.0, low=3.0, high=20.0, is_log=True,
              unit='m'),
    Parameter(name='linearity.threshold', symbol='LN_thres', initial=0.82, low=0.5, high=1.0,
              is_log=False),
    Parameter(name='linearity.max_inclination_deg', symbol='alpha_thres', initial=20.0, low=1.0,
              high=20.0, is_log=False, unit='deg'),
    Parameter(name='outliers.sigma', symbol='Filt_thres', initial=4.0, low=4.0, high=20.0,
              is_log=True),
    Parameter(name='clustering.eps', symbol='eps', initial=0.2, low=0.1, high=1.0, is_log=True,
              unit='m'),
    Parameter(name='clustering.min_points', symbol='min_pts', initial=50.0, low=30.0, high=250.0,
              is_log=True),
)
"""The parameters that decide which lines are found, stage by stage."""

RADIUS = 'corridor.radius'
"""The eighth setting of Table 1: no line depends on it, and its condition fixes it."""

STAGES = (
    ('height.num_bins', 'height.beta'),
    ('linearity.threshold', 'linearity.max_inclination_deg'),
    ('outliers.sigma',),
    ('clustering.eps', 'clustering.min_points'),
)
"""Parameters of one stage depend on each other, so a grid varies them together."""


def get_values(settings: Settings) -> Values:
    """Return the values of the tuned parameters, clipped to their bounds."""
    return tuple(item.round(get_value(settings, item.name)) for item in SPACE)


def get_value(settings: Settings, name: str) -> float:
    """Return one number of the settings by its dotted name."""
    section, _, key = name.partition('.')
    return float(getattr(getattr(settings, section), key))


def put_values(settings: Settings, values: Sequence[float]) -> Settings:
    """Return settings with these values of the tuned parameters."""
    return update(settings, {
        item.name: int(value) if item.is_whole else float(value)
        for item, value in zip(SPACE, values, strict=True)
    })


def to_places(values: Sequence[float]) -> Float64:
    """Return the (P,) places of values between their bounds, 0 to 1."""
    return np.array([item.place(value) for item, value in zip(SPACE, values, strict=True)])


def to_values(places: Sequence[float] | Float64) -> Values:
    """Return the values at (P,) places between the bounds."""
    return tuple(item.value(float(place)) for item, place in zip(SPACE, places, strict=True))


INITIAL: Values = tuple(item.initial for item in SPACE)


def measure_distance(values: Sequence[float]) -> float:
    """Return the mean square distance of values from the initial ones, 0 to 1."""
    return float(np.mean((to_places(values) - to_places(INITIAL)) ** 2))


def settle_radius(radius: float, lowest: Sequence[float]) -> float:
    """
    Return the search radius that Table 1 allows, r > a0.

    Parameters
    ----------
    radius : float
        Radius as set [m]; 0 means Eq. 9, span by span.
    lowest : sequence of float
        Height of the lowest point of each span above ground, a0 [m]; NaN where unknown.

    Returns
    -------
    float
        The radius if it exceeds all known a0, else 0 [m].

    """
    known = [value for value in lowest if math.isfinite(value)]
    return radius if known and radius > max(known) else 0.0
