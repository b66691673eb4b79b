# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""How random scenes are surveyed: the sensor, its sampling and its errors."""

from dataclasses import dataclass

import numpy as np

from plc_inspect.sim.surveys.raycast import Beam

MOST_POINTS = 8e5
"""Pulses of a survey, about; what bounds the time that a scene takes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Survey:
    """An airborne survey: strips of zigzag scan lines."""

    density: float
    """Pulses per square metre of all strips."""
    line_spacing: float
    """Distance of the scan lines of one strip [m]."""
    reach: float
    """A pulse within this of a wire in plan returns from it [m]: footprint and sensitivity."""
    altitude: float
    """Above the ground [m]."""
    num_strips: int
    misalignment: float
    """Standard deviation of the offset of a strip, each axis [m]."""
    noise: float
    """Standard deviation of a range near by [m]."""
    noise_growth: float
    """What it grows by with each metre of range."""
    jitter: float
    """Standard deviation of the direction of a beam [rad]."""
    mixed: float
    """Share of the beams with two near returns that give one in between."""
    dropout: float
    """Share of the wire returns of the worst seen conductor that are too weak."""
    heading: float
    """Direction of the strips against that of the line [rad]."""
    levels: tuple[str, ...] = ('low', 'medium', 'high')

    @property
    def largest_area(self) -> float:
        """Ground that is surveyed, at most about [m2]."""
        return MOST_POINTS / self.density

    @property
    def beam(self) -> Beam:
        """What decides which wires a pulse meets."""
        return Beam(divergence=0.0, exit_width=0.3, wire_reach=self.reach)

    def draw_half_width(self, rng: np.random.Generator) -> float:
        """Return half of the width of the corridor [m]."""
        return float(rng.uniform(15.0, 40.0))


def draw_survey(rng: np.random.Generator) -> Survey:
    """
    Draw an airborne survey.

    A wire takes 2 x reach x density points a metre: 3 to 60, evenly in its logarithm.
    """
    reach = rng.uniform(0.2, 0.45)
    sampling = np.exp(rng.uniform(np.log(3.0), np.log(60.0)))
    density = float(np.clip(sampling / (2.0 * reach), 4.0, 90.0))
    # Along a scan line pulses are 5 cm to a metre apart.
    num_strips = int(rng.integers(1, 4))
    widest = min(1.5, 20.0 / (density / num_strips))
    narrowest = max(0.15, 1.0 / (density / num_strips))
    return Survey(
        density=density, reach=float(reach), num_strips=num_strips,
        line_spacing=float(np.exp(rng.uniform(np.log(min(narrowest, widest)), np.log(widest)))),
        altitude=float(rng.uniform(60.0, 400.0)), misalignment=float(rng.uniform(0.0, 0.05)),
        noise=float(rng.uniform(0.01, 0.03)), noise_growth=float(rng.uniform(0.0, 5e-5)),
        jitter=float(rng.uniform(0.0, 5e-5)), mixed=float(rng.choice([0.0, 0.02, 0.1])),
        dropout=float(rng.uniform(0.0, 0.6)), heading=float(rng.normal(0.0, 0.1)),
    )
