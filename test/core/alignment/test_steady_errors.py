# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest

from plc_inspect.core.alignment.registration import Fit
from plc_inspect.core.alignment.rigid_move import RigidMove
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


def judge(errors, degrees, age, sigma=0.1):
    """Let headings be judged, of fits one after the other, to cells of one age [s]."""
    for turn in degrees:
        covariance = np.diag([1e-4, 1e-4, 1e-4, np.radians(sigma) ** 2])
        fit, free = (
            Fit(move=move, covariance=covariance, matched=200, fitting=200, age=age)
            for move in (RigidMove(), RigidMove(np.zeros(3), np.radians(turn), np.zeros(3)))
        )
        errors.judge_heading(fit, free)


@pytest.mark.parametrize('age', [5.0, 60.0])
@pytest.mark.parametrize('rate', [-1.0, 0.5])
def test_a_heading_that_turns_is_doubted(age, rate):
    """Also over what was seen long before, where it turned until the end and nothing was said."""
    errors = SteadyErrors()
    judge(errors, np.zeros(5), age)
    judge(errors, rate * 0.6 * np.arange(1, 6), age)
    assert 'heading' in errors.doubt


@pytest.mark.parametrize('begin', [0.0, 3.0, -17.0])
def test_slow_drift_since_then_is_no_turn(begin):
    """Back over its own way, a drift of 0.05 degrees/s shows twice as fast."""
    errors, rng = SteadyErrors(), np.random.default_rng(4)
    judge(errors, rng.normal(0.0, 0.05, 5), 4.0)
    judge(errors, begin + 0.06 * np.arange(100) + rng.normal(0.0, 0.05, 100), 60.0)
    assert errors.doubt == ''


def test_what_one_return_left_is_no_turn_later():
    errors, rng = SteadyErrors(), np.random.default_rng(5)
    for begin in (0.0, 2.0, 4.0):
        judge(errors, begin + rng.normal(0.0, 0.05, 20), 60.0)
        judge(errors, begin + rng.normal(0.0, 0.05, 20), 4.0)
        errors.step()
    assert errors.doubt == ''


def test_a_map_that_begins_anew_does_not_make_the_heading_right():
    errors = SteadyErrors()
    judge(errors, 0.6 * np.arange(9), 60.0)
    doubt = errors.doubt
    errors.give_up()
    assert errors.doubt == doubt != ''
    errors.clear()
    errors.hear(estimate(ROLL))
    errors.hear(estimate(ROLL))
    assert errors.doubt != ''
    errors.give_up()
    assert errors.doubt == ''
