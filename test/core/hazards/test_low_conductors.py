# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Ground below conductors: what was not seen raises nothing, hills and banks do."""

import dataclasses

from factories import make_model
import numpy as np
import pytest

from plc_inspect.config import HazardSettings
from plc_inspect.core.hazards.clearance_rules import plain_rules
from plc_inspect.core.hazards.low_conductors import find_low_conductors, keep_seen

RULES = plain_rules(HazardSettings())
ENDS = ((0.0, 0.0, 12.0), (100.0, 0.0, 12.0))
CONSTANT = 2000.0


def measure(model, ground):
    """Return stations above ground [m] that is given along the span."""
    along = np.linspace(0.0, 100.0, 101)
    direction = 1.0 if model.end_x > model.start_x else -1.0
    height = model.curve.fit.height(model.start_x + direction * along)
    return np.column_stack([along, height - ground(along)])


def find(model, ground):
    return find_low_conductors([model], [measure(model, ground)], (), RULES)


@pytest.mark.parametrize('backwards', [False, True])
@pytest.mark.parametrize(('low', 'high'), [(40.0, 60.0), (42.0, 58.0), (0.0, 30.0), (55.0, 100.0)])
@pytest.mark.parametrize('gap', [0.03, 0.8, -0.2])
def test_the_conductor_is_not_its_own_ground(backwards, low, high, gap):
    model = make_model(*(ENDS[::-1] if backwards else ENDS), c=CONSTANT)
    conductor = measure(model, lambda along: 0.0 * along)[:, 1]

    def ground(along):
        return np.where((along > low) & (along < high), conductor - gap, 0.0)

    found = find(model, ground)
    # of a long stretch by itself, only what touches the conductor is known not to be ground
    assert not [item for item in found if item['clearance'] < 0.5]
    if high - low < 2.0 * 10.0:
        assert not found


@pytest.mark.parametrize('backwards', [False, True])
def test_hills_and_banks_are_ground(backwards):
    model = make_model(*(ENDS[::-1] if backwards else ENDS), c=CONSTANT)
    (hill,) = find(model, lambda along: 9.0 * np.exp(-((along - 50.0) / 20.0) ** 2))
    assert 1.5 < hill['clearance'] < 3.0
    (bank,) = find(model, lambda along: 7.0 + 0.9 * (along > 50.0))
    assert 2.5 < bank['clearance'] < 4.0


def test_no_ground_and_a_bundle():
    model = make_model(*ENDS, c=CONSTANT)
    assert find_low_conductors([model], [np.zeros((0, 2))], (), RULES) == []
    assert keep_seen(model, np.zeros((0, 2))).shape == (0, 2)
    quad = dataclasses.replace(model, strands=np.array([[0.0, 0.2], [0.0, -0.2]]))
    (own,), (lower,) = (find(item, lambda along: 7.0 + 0.0 * along) for item in (model, quad))
    assert lower['clearance'] == pytest.approx(own['clearance'] - 0.2)
    np.testing.assert_allclose(lower['position'][2], 7.0, atol=0.01)
