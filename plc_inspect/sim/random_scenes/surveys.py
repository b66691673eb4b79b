# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Surveys of random scenes: sensors, their sampling and their errors."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plc_inspect.sim.scenes.routes import shift_route
from plc_inspect.sim.surveys.raycast import Beam

Float64 = NDArray[np.float64]

RETURNS = 6
"""Greatest number of returns of a beam: a rack of wires, a crown and the ground."""
PASSING = 0.6
"""Share of beams that continue behind a leaf or strut."""
MOST_PULSES = 8e5
"""Approximate number of pulses of an airborne survey; limits the time of a scene."""
MOST_BEAMS = 1.5e6
"""Approximate number of beams of a mobile survey or a flight, most of which hit nothing."""
SHORTEST = 60.0
"""Least length of a survey, whatever its time [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Zigzag:
    """An airborne survey: strips of zigzag scan lines."""

    density: float
    """Pulses per square metre of all strips."""
    line_spacing: float
    """Spacing of the scan lines of one strip [m]."""
    reach: float
    """Greatest distance in plan of a pulse from a wire that it hits: half the footprint [m]."""
    altitude: float
    """Height above the ground [m]."""
    num_strips: int
    misalignment: float
    """Standard deviation of the offset of a strip along each axis [m]."""
    heading: float
    """Direction of the strips relative to the line [rad]."""

    @property
    def text(self) -> str:
        """Short description."""
        return (f'airborne {self.density:.0f}/m2, {self.num_strips} strips, lines'
                f' {self.line_spacing:.2f} m')

    @property
    def axis(self) -> float:
        """Share of the way from the wire to the axis of its beam at which a return lies."""
        return 0.25

    @property
    def beam(self) -> Beam:
        """Shape of the beam."""
        return Beam(divergence=0.0, exit_width=0.3, wire_reach=self.reach, max_returns=RETURNS,
                    pass_share=PASSING)

    def find_length(self, half_width: float) -> float:
        """Return the greatest length of a corridor of this half width [m]."""
        return MOST_PULSES / self.density / (2.0 * half_width)


@dataclass(frozen=True, slots=True, kw_only=True)
class PushBroom:
    """A mobile survey: a car beside the line, with a scanner that rotates across the road."""

    spacing: float
    """Spacing of the scan lines [m]."""
    step: float
    """Angle between beams, which is also their divergence [rad]."""
    lateral: float
    """Offset of the car to the left of the line [m]."""
    tilt: float
    """Angle between the plane of the scanner and the cross-section [rad]."""
    drift: float
    """Standard deviation of the drift of the pose after 100 m [m]."""

    @property
    def text(self) -> str:
        """Short description."""
        return f'mobile at {self.lateral:.0f} m, lines {self.spacing:.2f} m'

    @property
    def axis(self) -> float:
        """Share of the way from the wire to the axis of its beam at which a return lies."""
        return 1.0

    @property
    def beam(self) -> Beam:
        """Shape of the beam."""
        return Beam(
            divergence=self.step, exit_width=0.01, wire_fraction=0.1, wire_range=50.0,
            max_returns=RETURNS, pass_share=PASSING,
        )

    def find_length(self, half_width: float) -> float:
        """Return the greatest length of a corridor of this half width [m]."""
        del half_width
        return max(SHORTEST, MOST_BEAMS * self.spacing * self.step / (2.0 * np.pi))


@dataclass(frozen=True, slots=True, kw_only=True)
class PuckFlight:
    """A flight along the line with a Puck Lite, mapped by drifting odometry."""

    lateral: float
    """Offset of the flight to the left of the line [m]."""
    height: float
    """Height above the phases [m]."""
    advance: float
    """Distance between scans that are kept [m]."""
    drift: float
    """Slip of the odometry per distance."""

    @property
    def text(self) -> str:
        """Short description."""
        return f'puck at {self.lateral:.0f} m, a scan every {self.advance:.1f} m'

    @property
    def axis(self) -> float:
        """Share of the way from the wire to the axis of its beam at which a return lies."""
        return 1.0

    @property
    def beam(self) -> Beam:
        """Shape of the beam."""
        return Beam(max_returns=RETURNS, pass_share=PASSING)

    def find_length(self, half_width: float) -> float:
        """Return the greatest length of a corridor of this half width [m]."""
        del half_width
        return max(SHORTEST, MOST_BEAMS / 15_000.0 * self.advance)


Pattern = Zigzag | PushBroom | PuckFlight


@dataclass(frozen=True, slots=True, kw_only=True)
class Survey:
    """A sensor, its use and its errors."""

    pattern: Pattern
    levels: tuple[str, ...]
    """Voltages of the lines that are surveyed with it."""
    widths: tuple[float, float]
    """Least and greatest half width of the corridor [m]."""
    noise: float
    """Standard deviation of short ranges [m]."""
    noise_growth: float
    """Growth of the standard deviation with range [m/m]."""
    jitter: float
    """Standard deviation of the direction of a beam [rad]."""
    mixed: float
    """Share of beams with two close returns that give one in between."""
    dropout: float
    """Greatest share of wire returns of a conductor that are too weak."""

    def find_road(self, route: Float64) -> Float64 | None:
        """Return the path (K, 2) beside a route that a car or low flight needs, or None [m]."""
        if isinstance(self.pattern, Zigzag):
            return None
        return shift_route(route, self.pattern.lateral)


def draw_survey(rng: np.random.Generator) -> Survey:
    """Draw a survey: of five, three are airborne, one mobile, one a flight with a Puck Lite."""
    kind = rng.choice(['airborne', 'mobile', 'puck'], p=[0.6, 0.2, 0.2])
    mixed, dropout = float(rng.choice([0.0, 0.02, 0.05])), float(rng.uniform(0.0, 0.6))
    if kind == 'mobile':
        return Survey(
            pattern=PushBroom(
                spacing=_draw_log(rng, 0.04, 0.3), step=float(np.radians(rng.uniform(0.25, 0.5))),
                lateral=float(rng.choice([-1.0, 1.0]) * rng.uniform(2.5, 9.0)),
                tilt=float(rng.uniform(0.0, 0.5)), drift=float(rng.uniform(0.0, 0.05)),
            ),
            levels=('low', 'low', 'medium'), widths=(14.0, 28.0),
            noise=float(rng.uniform(0.005, 0.02)), noise_growth=float(rng.uniform(0.0, 4e-4)),
            jitter=float(rng.uniform(0.0, 3e-4)), mixed=mixed, dropout=0.5 * dropout,
        )
    if kind == 'puck':
        return Survey(
            pattern=PuckFlight(
                lateral=float(rng.choice([-1.0, 1.0]) * rng.uniform(2.0, 22.0)),
                height=float(rng.uniform(2.5, 8.0)), advance=float(rng.uniform(0.4, 1.0)),
                drift=float(rng.uniform(0.0, 0.006)),
            ),
            levels=('low', 'medium', 'high', 'high'), widths=(40.0, 60.0),
            noise=0.03, noise_growth=float(rng.uniform(0.0, 3e-4)),
            jitter=float(rng.uniform(0.0, 5e-4)), mixed=0.0, dropout=0.3 * dropout,
        )
    return Survey(
        pattern=_draw_zigzag(rng), levels=('low', 'medium', 'high'), widths=(15.0, 40.0),
        noise=float(rng.uniform(0.01, 0.03)), noise_growth=float(rng.uniform(0.0, 5e-5)),
        jitter=float(rng.uniform(0.0, 5e-5)), mixed=mixed, dropout=dropout,
    )


def _draw_zigzag(rng: np.random.Generator) -> Zigzag:
    """Draw an airborne survey with 3 to 60 points per metre of wire: 2 x reach x density."""
    reach = rng.uniform(0.2, 0.45)
    density = float(np.clip(_draw_log(rng, 3.0, 60.0) / (2.0 * reach), 4.0, 90.0))
    # along a scan line, pulses are 5 cm to 1 m apart
    num_strips = int(rng.integers(1, 4))
    widest = min(1.5, 20.0 / (density / num_strips))
    narrowest = min(max(0.15, 1.0 / (density / num_strips)), widest)
    return Zigzag(
        density=density, reach=float(reach), num_strips=num_strips,
        line_spacing=_draw_log(rng, narrowest, widest),
        altitude=float(rng.uniform(60.0, 400.0)), misalignment=float(rng.uniform(0.0, 0.05)),
        heading=float(rng.normal(0.0, 0.1)),
    )


def _draw_log(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a number whose logarithm is uniform between those of low and high."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
