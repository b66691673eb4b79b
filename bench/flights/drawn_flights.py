# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Flights of which a seed draws everything: line, country, way, speed, sensor and odometry."""

import numpy as np

from plc_inspect.sim.random_scenes.scenes import make_random_scene
from plc_inspect.sim.random_scenes.surveys import draw_survey, PuckFlight, Survey
from plc_inspect.sim.scenes.catalogue import make_scene
from plc_inspect.sim.scenes.scene import Scene
from plc_inspect.sim.surveys.flight import Flight, PLANS
from plc_inspect.sim.surveys.puck import Puck
from plc_inspect.sim.surveys.trajectory import FlightPlan, OdometryErrors

SCENES = (
    'low_voltage', 'medium_voltage', 'contact', 'street', 'rack', 'angle', 'crossing', 'bundles',
    'double_circuit', 'high_voltage',
)
"""Half of the flights are along one of these, the others along a random line."""
SECONDS = 40.0
"""Length of a flight [s]."""


def draw_flight(seed: int) -> tuple[Scene, Flight, str]:
    """
    Draw a flight.

    Parameters
    ----------
    seed : int
        Of everything random.

    Returns
    -------
    Scene, Flight
    text : str
        What it is, in a few words.

    """
    rng = np.random.default_rng([seed, 3026])
    if rng.random() < 0.5:
        name = str(rng.choice(SCENES))
        scene, usual = make_scene(name, seed), PLANS[name]
        side = float(rng.choice([-1.0, 1.0]))
        lateral = side * max(1.5, usual.lateral * float(rng.uniform(0.6, 1.2)))
        height = usual.height + float(rng.uniform(-1.0, 3.0))
    else:
        scene = make_random_scene(seed, 'any', _draw_survey(rng))
        name = f'random {scene.name}'
        lateral = float(rng.choice([-1.0, 1.0]) * rng.uniform(2.0, 12.0))
        height = float(rng.uniform(2.5, 8.0))
    shuttle = bool(rng.random() < 0.6)
    plan = FlightPlan(
        speed=float(rng.uniform(3.0, 9.0)), lateral=lateral, height=height,
        margin=float(rng.uniform(0.0, 15.0)), sway_deg=float(rng.uniform(1.0, 3.0)),
        duration=SECONDS, shuttle=shuttle, turning=1.0 if shuttle else 0.0,
    )
    puck = Puck(
        rate=float(rng.choice([5.0, 10.0, 20.0])), noise=float(rng.uniform(0.02, 0.04)),
        view_width_deg=float(rng.choice([360.0, 360.0, 270.0])),
        stamp_first=bool(rng.random() < 0.5), max_range=float(rng.choice([60.0, 100.0])),
    )
    errors = OdometryErrors(
        drift=float(rng.uniform(0.001, 0.003)), attitude_deg=float(rng.uniform(0.02, 0.06)),
        jitter=float(rng.uniform(0.003, 0.01)),
    )
    rate = float(rng.choice([50.0, 100.0, 200.0]))
    text = (
        f'{name}, {plan.speed:.1f} m/s{", back" if shuttle else ""}, {plan.lateral:+.0f} and '
        f'{plan.height:.0f} m off, {puck.rate:g} and {rate:g} Hz, sway {plan.sway_deg:.1f}'
    )
    return scene, Flight(plan=plan, puck=puck, errors=errors, odometry_rate=rate), text


def _draw_survey(rng: np.random.Generator) -> Survey:
    """Draw surveys until one is a flight."""
    while True:
        survey = draw_survey(rng)
        if isinstance(survey.pattern, PuckFlight):
            return survey
