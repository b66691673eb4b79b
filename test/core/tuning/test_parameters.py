# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The space of Table 1: bounds, rounding, and places between the bounds."""

import numpy as np
import pytest

from plc_inspect.config import Settings
from plc_inspect.core.tuning.parameters import (
    get_value,
    get_values,
    INITIAL,
    measure_distance,
    put_values,
    settle_radius,
    SPACE,
    STAGES,
    to_places,
    to_values,
)
from plc_inspect.errors import ConfigError
from plc_inspect.setting_names import describe


def test_bounds_lie_within_the_ranges_of_the_settings():
    meta = {name: item for name, _, item in describe()}
    for item in SPACE:
        assert meta[item.name]['low'] <= item.low < item.high <= meta[item.name]['high']
        assert item.low <= item.initial <= item.high
    assert [name for stage in STAGES for name in stage] == [item.name for item in SPACE]


def test_conditions_are_those_of_table_1():
    bounds = {item.symbol: (item.low, item.high) for item in SPACE}
    assert bounds['nbin'][1] == 500
    assert bounds['beta'][0] == 3
    assert bounds['LN_thres'] == (0.5, 1.0)
    assert bounds['alpha_thres'][1] == 20
    assert bounds['Filt_thres'][0] == 4
    assert bounds['eps'][0] == 0.1
    assert bounds['min_pts'][0] == 30


def test_defaults_are_the_initial_values():
    assert get_values(Settings()) == INITIAL
    assert put_values(Settings(), INITIAL) == Settings()
    assert measure_distance(INITIAL) == 0.0


def test_places_and_values_are_inverse_up_to_rounding():
    rng = np.random.default_rng(0)
    for places in rng.random((50, len(SPACE))):
        values = to_values(places)
        np.testing.assert_allclose(to_places(values), places, atol=0.02)
        assert to_values(to_places(values)) == values
        put_values(Settings(), values)  # raises where a value cannot be set


def test_factors_take_equal_steps():
    eps = next(item for item in SPACE if item.symbol == 'eps')
    assert eps.place(0.2) - eps.place(0.1) == pytest.approx(eps.place(0.4) - eps.place(0.2))
    assert (eps.value(-1.0), eps.value(2.0)) == (0.1, 1.0)


def test_what_is_out_of_bounds_is_put_at_the_bound():
    settings = put_values(Settings(), INITIAL)
    settings = type(settings)(
        height=type(settings.height)(beta=2.0), outliers=type(settings.outliers)(sigma=1.0)
    )
    values = dict(zip((item.symbol for item in SPACE), get_values(settings), strict=True))
    assert (values['beta'], values['Filt_thres']) == (3.0, 4.0)
    assert get_value(settings, 'height.beta') == 2.0
    with pytest.raises(ConfigError):
        put_values(settings, [0.0] * len(SPACE))


def test_the_farther_from_table_1_the_greater_the_distance():
    far = list(INITIAL)
    far[5] = 0.4
    farther = list(far)
    farther[5] = 1.0
    assert 0.0 < measure_distance(far) < measure_distance(farther) <= 1.0 / len(SPACE)


@pytest.mark.parametrize(('radius', 'lowest', 'expected'), [
    (0.0, [8.0], 0.0), (0.6, [8.0, 9.0], 0.0), (8.5, [8.0, 9.0], 0.0), (9.5, [8.0, 9.0], 9.5),
    (9.5, [np.nan, 9.0], 9.5), (9.5, [], 0.0), (9.5, [np.nan], 0.0),
])
def test_the_radius_must_exceed_the_lowest_point_of_every_span(radius, lowest, expected):
    assert settle_radius(radius, lowest) == expected
