# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest

from plc_inspect.core.alignment.steady_errors import Steady, SteadyErrors

NONE = np.zeros(6)
ROLL = np.array([0.0, 0.0, 0.0, -0.037, 0.0, 0.0])
TURN = np.array([0.0, 0.0, 0.02, 0.0, 0.0, 0.0])


def estimate(values, sigma=0.001):
    """Return what planes tell [s, -, rad/s, rad]."""
    return Steady(values, np.full(6, sigma), np.full(6, 9.6), 7.0)


@pytest.mark.parametrize(('values', 'told'), [(ROLL, '-2.1 degrees of roll'),
                                              (TURN, '1.1 degrees/s')])
def test_what_two_estimates_agree_on_is_doubted(values, told):
    errors = SteadyErrors()
    errors.hear(estimate(values))
    assert errors.doubt == ''
    errors.hear(estimate(values))
    assert told in errors.doubt


@pytest.mark.parametrize('values', [ROLL, TURN])
@pytest.mark.parametrize('between', ['same', 'unsure', 'other way', 'nothing'])
def test_one_estimate_holds_nothing_back(values, between):
    """A good flight over slopes was turned by 2.1 degrees for two seconds, and lost whole."""
    errors, sure = SteadyErrors(), estimate(values)
    errors.hear(sure)
    errors.hear({
        'same': sure, 'unsure': estimate(values, 0.1), 'other way': estimate(-values),
        'nothing': None,
    }[between])
    assert errors.doubt == ''
    if between != 'other way':
        errors.hear(estimate(-values))
    assert errors.doubt == ''


def test_a_map_that_begins_anew_counts_anew():
    errors = SteadyErrors()
    errors.hear(estimate(ROLL))
    errors.clear()
    errors.hear(estimate(ROLL))
    assert errors.doubt == ''
