# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Cranes, masts, gantries, pipes and bridges: long, thin and straight, but no power lines."""

from dataclasses import replace
from itertools import pairwise
import math

import numpy as np
from numpy.typing import NDArray

from plc_inspect.sim.scenes.scene import Label, SceneBuilder, UP
from plc_inspect.sim.scenes.steelwork import add_lattice, Lattice

Float64 = NDArray[np.float64]


def _face(azimuth: float) -> tuple[Float64, Float64]:
    """Return unit vectors (3,) along a direction and to its left."""
    u = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    return u, np.array([-u[1], u[0], 0.0])


def _stand(builder: SceneBuilder, xy: Float64) -> Float64:
    return np.array([xy[0], xy[1], builder.ground(xy[:2])])


def add_tower_crane(builder: SceneBuilder, xy: Float64) -> None:
    """Add a tower crane: mast, jib and counter-jib of lattice, tie bars and a hoist rope."""
    rng = builder.rng
    u, v = _face(rng.uniform(-math.pi, math.pi))
    foot, high = _stand(builder, xy), rng.uniform(22.0, 50.0)
    jib, counter = rng.uniform(25.0, 60.0), rng.uniform(9.0, 16.0)
    width = rng.uniform(1.2, 2.0)
    deck = foot + high * UP
    peak = deck + rng.uniform(5.0, 9.0) * UP
    mast = Lattice(
        widths=(width, width), panel=2.2, radius=0.06, side=u, front=v, label=Label.OTHER,
    )
    add_lattice(builder, foot, deck, mast)
    add_lattice(builder, deck, peak, replace(mast, widths=(width, 0.3)))
    for reach in (jib, -counter):
        add_lattice(builder, deck, deck + reach * u, replace(
            mast, widths=(1.3, 0.9 if reach > 0 else 1.3), side=UP,
        ))
        for share in (0.45, 0.9):
            builder.add_strut(peak, deck + share * reach * u + 0.6 * UP, 0.03, Label.OTHER)
    trolley = deck + rng.uniform(0.3, 0.9) * jib * u
    builder.add_strut(trolley, trolley - rng.uniform(5.0, high - 6.0) * UP, 0.015, Label.OTHER)


def add_guyed_mast(builder: SceneBuilder, xy: Float64) -> None:
    """Add a lattice mast with straight stays on three sides, at two or three levels."""
    rng = builder.rng
    u, v = _face(rng.uniform(-math.pi, math.pi))
    foot, high = _stand(builder, xy), rng.uniform(15.0, 60.0)
    top = foot + high * UP
    add_lattice(builder, foot, top, Lattice(
        widths=(0.6, 0.6), panel=1.5, radius=0.03, side=u, front=v, label=Label.OTHER,
    ))
    levels = np.linspace(1.0, 0.4, int(rng.integers(2, 4)))
    reach = high * rng.uniform(0.35, 0.7)
    for turn in (0.0, 2.0 * math.pi / 3.0, 4.0 * math.pi / 3.0):
        anchor = foot[:2] + reach * (math.cos(turn) * u + math.sin(turn) * v)[:2]
        for share in levels:
            builder.add_strut(_stand(builder, anchor), foot + share * high * UP, 0.012,
                              Label.OTHER)


def add_gantry(builder: SceneBuilder, xy: Float64, azimuth: float) -> None:
    """Add an overhead sign gantry: two columns, a beam of lattice and boards."""
    rng = builder.rng
    u, v = _face(azimuth + 0.5 * math.pi)
    half, high = 0.5 * rng.uniform(12.0, 32.0), rng.uniform(5.5, 7.5)
    base = _stand(builder, xy)
    for side in (-1.0, 1.0):
        foot = _stand(builder, (base + side * half * u)[:2])
        builder.add_strut(foot, base + side * half * u + (high + 0.6) * UP, 0.2, Label.OTHER)
    add_lattice(builder, base - half * u + high * UP, base + half * u + high * UP, Lattice(
        widths=(0.9, 0.9), panel=1.5, radius=0.05, side=UP, front=v, label=Label.OTHER,
    ))
    for _ in range(int(rng.integers(1, 4))):
        middle = base + rng.uniform(-0.7, 0.7) * half * u + 0.6 * v + (high - 0.6) * UP
        wide = rng.uniform(1.0, 2.5)
        builder.add_face(np.array([
            middle - wide * u, middle + wide * u, middle + wide * u + 2.2 * UP,
            middle - wide * u + 2.2 * UP,
        ]), Label.OTHER)


def add_pipe_rack(builder: SceneBuilder, xy: Float64, azimuth: float) -> None:
    """Add pipes side by side on frames, in one or two tiers."""
    rng = builder.rng
    u, v = _face(azimuth)
    length, width = rng.uniform(20.0, 70.0), rng.uniform(2.0, 5.0)
    base = _stand(builder, xy)
    tiers = rng.uniform(3.5, 6.0) + 1.8 * np.arange(int(rng.integers(1, 3)))
    for along in np.arange(-0.5, 0.51, 1.0 / max(2, round(length / 6.0))) * length:
        for side in (-0.5, 0.5):
            leg = base + along * u + side * width * v
            builder.add_strut(_stand(builder, leg[:2]), leg + tiers[-1] * UP, 0.12, Label.OTHER)
        for tier in tiers:
            middle = base + along * u + (tier - 0.15) * UP
            builder.add_strut(middle - 0.5 * width * v, middle + 0.5 * width * v, 0.1, Label.OTHER)
    for tier in tiers:
        for across in rng.uniform(-0.45, 0.45, int(rng.integers(2, 7))) * width:
            radius = rng.uniform(0.04, 0.25)
            middle = base + across * v + (tier + radius) * UP
            builder.add_strut(middle - 0.5 * length * u, middle + 0.5 * length * u, radius,
                              Label.OTHER)


def _add_deck(builder: SceneBuilder, base: Float64, azimuth: float, half: float) -> None:
    """Add the deck of a bridge, 4 m to both sides of its axis, with rails."""
    u, v = _face(azimuth)
    ring = np.array([base + a * half * u + b * 4.0 * v
                     for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))])
    builder.add_face(ring, Label.OTHER)
    builder.add_face(ring - 0.8 * UP, Label.OTHER)
    for side in (-4.0, 4.0):
        for up in (0.5, 1.1):
            rail = base + side * v + up * UP
            builder.add_strut(rail - half * u, rail + half * u, 0.03, Label.OTHER)


def add_stayed_bridge(builder: SceneBuilder, xy: Float64, azimuth: float) -> None:
    """Add a bridge whose deck hangs from one pylon on straight stays."""
    rng = builder.rng
    u, v = _face(azimuth)
    half, high = rng.uniform(30.0, 60.0), rng.uniform(5.0, 9.0)
    base = _stand(builder, xy) + high * UP
    _add_deck(builder, base, azimuth, half)
    peak = rng.uniform(0.35, 0.55) * half
    for side in (-4.3, 4.3):
        foot = base + side * v
        builder.add_strut(foot - (high + 3.0) * UP, foot + peak * UP, 0.6, Label.OTHER)
        for share in np.linspace(0.2, 0.95, int(rng.integers(4, 9))):
            for way in (-1.0, 1.0):
                builder.add_strut(foot + way * share * half * u,
                                  foot + (0.5 + 0.48 * share) * peak * UP, 0.05, Label.OTHER)


def add_suspension_bridge(builder: SceneBuilder, xy: Float64, azimuth: float) -> None:
    """Add a bridge on two parabolic cables with hangers, as for pedestrians and pipes."""
    rng = builder.rng
    u, v = _face(azimuth)
    half, high = rng.uniform(20.0, 60.0), rng.uniform(4.0, 8.0)
    base = _stand(builder, xy) + high * UP
    _add_deck(builder, base, azimuth, half)
    dip = rng.uniform(0.1, 0.2) * half * 2.0
    for side in (-4.2, 4.2):
        x = np.linspace(-half, half, 2 * int(half / 4.0) + 1)
        nodes = base + side * v + x[:, None] * u + (1.0 + dip * (x[:, None] / half) ** 2) * UP
        for low, high_end in pairwise(nodes):
            builder.add_strut(low, high_end, 0.06, Label.OTHER)
        for place, node in zip(x, nodes, strict=True):
            builder.add_strut(base + side * v + place * u, node, 0.012, Label.OTHER)
        for way in (-1.0, 1.0):
            foot = base + side * v + way * half * u
            builder.add_strut(foot - (high + 3.0) * UP, foot + (1.0 + dip) * UP, 0.4, Label.OTHER)
            back = (foot + way * 1.2 * dip * u)[:2]
            builder.add_strut(_stand(builder, back), foot + (1.0 + dip) * UP, 0.06, Label.OTHER)
