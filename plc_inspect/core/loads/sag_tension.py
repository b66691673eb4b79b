# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Mechanics of one span: catenary, change of state, ice, wind and blow-out.

Lengths in metres, forces in newtons, temperatures in degrees Celsius, angles in radians.  c is
the catenary constant H / w: horizontal tension over weight per length.
"""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from plc_inspect.errors import DataError
from plc_inspect.results import Float64

AIR_DENSITY = 1.225
"""
Density of dry air at 15 degrees Celsius and sea level [kg/m3].
Source: International Standard Atmosphere; docs/physics.md.
"""
DRAG = 1.0
"""Drag coefficient of a stranded conductor.  Source: docs/physics.md."""
ICE_WEIGHT = 6000.0
"""Weight of ice per volume, as used for overhead lines [N/m3].  Source: docs/physics.md."""
REFERENCE_TEMPERATURE = 15.0
"""
Temperature of the length to which strain refers [degrees Celsius].
Source: derived: any value will do, as it cancels (docs/physics.md).
"""
COLDEST = -100.0
"""Least temperature of a conductor [degrees Celsius].  Source: judgement; not measured."""
HOTTEST_CASE = 400.0
"""Greatest temperature of a conductor [degrees Celsius].  Source: judgement; not measured."""
MOST_ICE = 0.5
"""Greatest thickness of ice [m].  Source: judgement; not measured."""
MOST_WIND = 100.0
"""Greatest wind speed [m/s].  Source: judgement; not measured."""
CONSTANT_TOLERANCE = 1e-12, 1e-13
"""
Absolute and relative tolerance of the logarithm of the catenary constant.
Source: numerical: a little above rounding.
"""
DEEPEST = 4.0
"""
Greatest ratio of the length of a span to its catenary constant that is solved for.
Source: judgement; not measured.
"""
FLATTEST = 1e3
"""
Greatest ratio of the constant solved for to the surveyed one, or to the length of the span.
Source: numerical: upper end of the bracket.
"""
LEAST_LENGTH = 1e-9
"""
Least length of a span in plan, as a divisor [m].
Source: numerical: avoids a division by 0.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Conductor:
    """Mechanical data of a conductor."""

    name: str
    diameter: float
    """[m]."""
    weight: float
    """Weight per length [N/m]."""
    stiffness: float
    """Modulus of elasticity times cross-section, EA [N]."""
    expansion: float
    """Coefficient of linear expansion [1/K]."""
    source: str = ''

    def __post_init__(self) -> None:
        """Raise DataError unless all values are positive and finite."""
        for name in ('diameter', 'weight', 'stiffness', 'expansion'):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise DataError(f'conductor {self.name}: {name} must be positive, got {value!r}')


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """Weather and load for which a line is evaluated."""

    name: str
    temperature: float
    """Temperature of the conductor [degrees Celsius]."""
    ice: float = 0.0
    """Radial thickness of ice [m]."""
    wind: float = 0.0
    """Wind speed across the line [m/s]."""

    def __post_init__(self) -> None:
        """Raise DataError for values outside the limits."""
        for name, low, high, unit in (
            ('temperature', COLDEST, HOTTEST_CASE, 'C'),
            ('ice', 0.0, MOST_ICE, 'm'),
            ('wind', 0.0, MOST_WIND, 'm/s'),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise DataError(
                    f'case {self.name}: {name} must lie in [{low:g}, {high:g}] {unit},'
                    f' got {value!r}'
                )


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """A span after a change of state, in the plane of its load."""

    c: float
    """Horizontal tension over resultant load [m]."""
    tension: float
    """Horizontal tension [N]."""
    load: float
    """Resultant load per length, of weight, ice and wind [N/m]."""
    swing: float
    """Blow-out: angle of the load from the vertical [rad]."""
    length: float
    """Distance between the ends across the load, in its plane [m]."""
    rise: float
    """Height of the second end above the first, against the load [m]."""

    @property
    def sag(self) -> float:
        """Greatest distance from chord to curve along the load [m]."""
        return measure_sag(self.length, self.rise, self.c)


def solve_vertex(length: float, rise: float, c: float) -> float:
    """Return b, the x of the vertex of the catenary through (0, 0) and (length, rise) [m]."""
    return length / 2 - c * math.asinh(rise / (2 * c * math.sinh(length / (2 * c))))


def height_at(x: Float64, length: float, rise: float, c: float) -> Float64:
    """Return the heights at x of the catenary through (0, 0) and (length, rise) [m]."""
    b = solve_vertex(length, rise, c)
    result: Float64 = c * (np.cosh((np.asarray(x, np.float64) - b) / c) - math.cosh(b / c))
    return result


def measure_sag(length: float, rise: float, c: float) -> float:
    """Return the greatest vertical distance from chord to catenary [m]."""
    b = solve_vertex(length, rise, c)
    x = b + c * math.asinh(rise / length)
    return rise * x / length - c * (math.cosh((x - b) / c) - math.cosh(b / c))


def measure_length(length: float, rise: float, c: float) -> float:
    """Return the length of the curve [m]."""
    return math.hypot(rise, 2 * c * math.sinh(length / (2 * c)))


def measure_tension(length: float, rise: float, c: float, load: float) -> float:
    """Return the mean tension along the curve [N]."""
    b = solve_vertex(length, rise, c)
    low, high = -b / c, (length - b) / c
    work = high - low + (math.sinh(2 * high) - math.sinh(2 * low)) / 2
    return load * c * c * work / (2 * measure_length(length, rise, c))


def ruling_span(lengths: Sequence[float]) -> float:
    """Return the ruling span, equivalent to a section between two tension supports [m]."""
    if not lengths or min(lengths) <= 0:
        raise DataError(f'a ruling span needs positive lengths, got {list(lengths)}')
    return math.sqrt(sum(value**3 for value in lengths) / sum(lengths))


def ice_load(thickness: float, diameter: float) -> float:
    """Return the weight of ice per length [N/m]."""
    return ICE_WEIGHT * math.pi * thickness * (thickness + diameter)


def wind_load(speed: float, diameter: float, ice: float = 0.0) -> float:
    """Return the force per length of wind across a conductor [N/m]."""
    return 0.5 * AIR_DENSITY * DRAG * speed**2 * (diameter + 2 * ice)


def change_state(
    length: float, rise: float, c: float, temperature: float, conductor: Conductor, case: Case
) -> State:
    """
    Return the state of a surveyed span at the temperature and load of a case.

    The length of the conductor follows temperature and mean tension (elastic, without creep); its
    ends stay in place.  Wind blows across the line and swings the curve into its load's plane.

    Parameters
    ----------
    length, rise : float
        Horizontal distance of the ends, and height of the second above the first [m].
    c : float
        Catenary constant as surveyed, without ice or wind [m].
    temperature : float
        Temperature of the conductor when surveyed [degrees Celsius].
    conductor : Conductor
        Of the span.
    case : Case
        What to evaluate.

    Returns
    -------
    State

    Raises
    ------
    DataError
        Length or constant is not positive and finite, or the span sags too deep to solve.

    """
    if not (length > 0 and c > 0 and math.isfinite(length) and math.isfinite(c)):
        raise DataError(f'a span of {length:g} m with c = {c:g} m has no state')
    # load, and the plane that it swings the span into
    stiffness, expansion = conductor.stiffness, conductor.expansion
    weight = conductor.weight + ice_load(case.ice, conductor.diameter)
    wind = wind_load(case.wind, conductor.diameter, case.ice)
    load, swing = math.hypot(weight, wind), math.atan2(wind, weight)
    swung = math.hypot(length, rise * math.sin(swing))
    lifted = rise * math.cos(swing)

    def strain(degrees: float, tension: float) -> float:
        return 1.0 + expansion * (degrees - REFERENCE_TEMPERATURE) + tension / stiffness

    # unstressed length at the reference temperature, from the survey
    free = measure_length(length, rise, c) / strain(
        temperature, measure_tension(length, rise, c, conductor.weight)
    )

    def excess(log_c: float) -> float:
        value = math.exp(log_c)
        tension = measure_tension(swung, lifted, value, load)
        return measure_length(swung, lifted, value) - free * strain(case.temperature, tension)

    # the constant at which the curve is as long as the strained conductor
    low, high = math.log(swung / DEEPEST), math.log(max(c, swung) * FLATTEST)
    if excess(low) < 0 or excess(high) > 0:
        raise DataError(
            f'case {case.name}: a span of {length:.1f} m with c = {c:.0f} m has no state with'
            f' conductor {conductor.name}'
        )
    from scipy.optimize import brentq  # imported here, as it takes half a second

    absolute, relative = CONSTANT_TOLERANCE
    new = math.exp(float(brentq(excess, low, high, xtol=absolute, rtol=relative)))
    return State(c=new, tension=new * load, load=load, swing=swing, length=swung, rise=lifted)
