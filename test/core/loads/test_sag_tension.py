# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The numbers of a level span worked out by hand, and states that must be their own opposite."""

import math

from hypothesis import given, settings, strategies
import numpy as np
import pytest
from scipy.optimize import brentq

from plc_inspect.core.loads.sag_tension import (
    Case,
    change_state,
    Conductor,
    height_at,
    ice_load,
    measure_length,
    measure_sag,
    measure_tension,
    ruling_span,
    solve_vertex,
    wind_load,
)
from plc_inspect.errors import DataError

CONDUCTOR = Conductor(
    name='test', diameter=0.028, weight=15.0, stiffness=36e6, expansion=19.3e-6,
)
SPAN, SAG, WARM = 320.0, 9.2, 14.0
TENSION = 15.0 * SPAN**2 / (8 * SAG)


def parabola(temperature, weight=15.0):
    """
    Return tension [N] and sag [m] of the level span after a change, by the textbook's parabola.

    H2 - (w2 S)^2 EA / 24 H2^2 = H1 - (w1 S)^2 EA / 24 H1^2 - alpha EA (T2 - T1)
    """
    stiffness = CONDUCTOR.stiffness
    known = TENSION - (15.0 * SPAN) ** 2 * stiffness / (24 * TENSION**2)
    known -= CONDUCTOR.expansion * stiffness * (temperature - WARM)
    load = (weight * SPAN) ** 2 * stiffness / 24
    high = max(abs(known), 1.0) + load ** (1 / 3) + 1.0
    tension = brentq(lambda h: h**3 - known * h**2 - load, 1e-3, high, xtol=1e-9, rtol=1e-14)
    return tension, weight * SPAN**2 / (8 * tension)


@pytest.mark.parametrize(('temperature', 'sag'), [
    (0, 8.69), (20, 9.41), (40, 10.10), (60, 10.75), (80, 11.37), (100, 11.97), (-5, 8.51),
    (14, 9.20),
])
def test_sag_at_temperatures(temperature, sag):
    tension, found = parabola(temperature)
    assert found == pytest.approx(sag, abs=0.01)
    deeper = measure_sag(SPAN, 0.0, tension / 15.0) - found
    assert 0.006 < deeper < 0.024


def test_sag_under_ice():
    load = ice_load(0.01, 0.028)
    assert load == pytest.approx(7.16, abs=0.005)
    assert parabola(-5.0, 15.0 + load)[1] == pytest.approx(9.04, abs=0.01)


def test_catenary_of_a_level_span():
    c = 600.0
    assert measure_sag(200.0, 0.0, c) == pytest.approx(c * (math.cosh(200 / 2 / c) - 1))
    assert measure_length(200.0, 0.0, c) == pytest.approx(2 * c * math.sinh(200 / 2 / c))
    assert 0.01 < measure_sag(200.0, 0.0, 600.0) - 200**2 / 8 / 600 < 0.02
    assert 0.13 < measure_sag(400.0, 0.0, 800.0) - 400**2 / 8 / 800 < 0.16


@pytest.mark.parametrize('rise', [-60.0, 0.0, 25.0, 150.0])
def test_inclined_catenary_against_its_samples(rise):
    length, c = 300.0, 900.0
    x = np.linspace(0.0, length, 200_001)
    z = height_at(x, length, rise, c)
    assert z[0] == pytest.approx(0.0, abs=1e-9)
    assert z[-1] == pytest.approx(rise, abs=1e-9)
    chord = rise * x / length
    assert measure_sag(length, rise, c) == pytest.approx((chord - z).max(), abs=1e-6)
    steps = np.hypot(np.diff(x), np.diff(z))
    assert measure_length(length, rise, c) == pytest.approx(steps.sum(), abs=1e-6)
    b = solve_vertex(length, rise, c)
    middle = (x[1:] + x[:-1]) / 2
    tension = 15.0 * c * np.cosh((middle - b) / c)
    mean = float((tension * steps).sum() / steps.sum())
    assert measure_tension(length, rise, c, 15.0) == pytest.approx(mean, rel=1e-9)


def test_the_catenary_agrees_with_the_parabola():
    c = TENSION / 15.0
    for degrees in (-5.0, 40.0, 100.0):
        state = change_state(SPAN, 0.0, c, WARM, CONDUCTOR, Case(name='', temperature=degrees))
        tension, _ = parabola(degrees)
        assert state.tension == pytest.approx(tension, rel=2e-3)
        assert state.sag == pytest.approx(measure_sag(SPAN, 0.0, tension / 15.0), abs=0.012)
        assert state.swing == 0.0


@settings(max_examples=60, deadline=None)
@given(
    length=strategies.floats(30.0, 500.0), slope=strategies.floats(-0.4, 0.4),
    ratio=strategies.floats(0.01, 0.06), first=strategies.floats(-20.0, 40.0),
    second=strategies.floats(-20.0, 90.0),
)
def test_there_and_back_again(length, slope, ratio, first, second):
    c = length / (8 * ratio)
    rise = slope * length
    same = change_state(length, rise, c, first, CONDUCTOR, Case(name='', temperature=first))
    assert same.c == pytest.approx(c, rel=1e-8)
    there = change_state(length, rise, c, first, CONDUCTOR, Case(name='', temperature=second))
    back = change_state(length, rise, there.c, second, CONDUCTOR, Case(name='', temperature=first))
    assert back.c == pytest.approx(c, rel=1e-8)
    assert (there.sag - same.sag) * (second - first) >= -1e-9


def test_wind_swings_and_ice_weighs():
    c = TENSION / 15.0
    assert wind_load(20.0, 0.028) == pytest.approx(0.5 * 1.225 * 400 * 0.028)
    calm = change_state(SPAN, 0.0, c, WARM, CONDUCTOR, Case(name='', temperature=WARM))
    storm = Case(name='', temperature=WARM, wind=20.0)
    blown = change_state(SPAN, 20.0, c, WARM, CONDUCTOR, storm)
    assert math.tan(blown.swing) == pytest.approx(wind_load(20.0, 0.028) / 15.0)
    assert blown.rise == pytest.approx(20.0 * math.cos(blown.swing))
    assert blown.length**2 + blown.rise**2 == pytest.approx(SPAN**2 + 20.0**2)
    iced = change_state(
        SPAN, 0.0, c, WARM, CONDUCTOR, Case(name='', temperature=WARM, ice=0.02)
    )
    assert iced.load == pytest.approx(15.0 + ice_load(0.02, 0.028))
    assert iced.sag > calm.sag
    assert iced.tension > calm.tension


def test_ruling_span():
    assert ruling_span([300.0]) == pytest.approx(300.0)
    assert ruling_span([100.0, 300.0]) == pytest.approx(math.sqrt(2.8e7 / 400.0))
    for bad in ([], [100.0, 0.0]):
        with pytest.raises(DataError, match='positive lengths'):
            ruling_span(bad)


def test_bad_values():
    with pytest.raises(DataError, match='weight must be positive, got -1'):
        Conductor(name='x', diameter=0.02, weight=-1.0, stiffness=1e7, expansion=2e-5)
    with pytest.raises(DataError, match=r'ice must lie in \[0, 0.5\] m, got 10'):
        Case(name='x', temperature=0.0, ice=10.0)
    with pytest.raises(DataError, match='temperature must lie'):
        Case(name='x', temperature=math.nan)
    with pytest.raises(DataError, match='has no state'):
        change_state(0.0, 0.0, 800.0, 15.0, CONDUCTOR, Case(name='x', temperature=15.0))
