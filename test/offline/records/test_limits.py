# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Which hazards other limits would have raised."""

from dataclasses import replace

from factories import make_inspection
import pytest

from plc_inspect.config import HazardSettings, Settings
from plc_inspect.offline.records.limits import make_limits, read_limits, would_raise
from plc_inspect.results import HazardKind
from plc_inspect.setting_names import to_mapping

HAZARD = replace(
    make_inspection(num_ground=10).result.hazards[0], clearance=1.0, horizontal=0.0, vertical=1.0,
    sigma=0.01, num_points=5, required=2.0, confidence=0.6,
)
OWN = HazardSettings()


@pytest.mark.parametrize(('kind', 'changes', 'expected'), [
    ('vegetation', {}, True),
    ('vegetation', {'warning_distance': 1.1, 'critical_distance': 1.0}, False),
    ('vegetation', {'warning_distance': 1.1, 'critical_distance': 1.0, 'min_points': 1}, True),
    ('vegetation', {'warning_distance': 1.01, 'critical_distance': 1.0, 'min_points': 1}, False),
    ('vegetation', {'warning_distance': 5.0}, True),
    ('vegetation', {'warning_distance': 1.0, 'critical_distance': 1.0}, False),
    ('vegetation', {'min_points': 6}, False),
    ('ground', {'ground_distance': 0.9}, False),
    ('ground', {'min_points': 6}, True),
    ('crossing', {'crossing_distance': 0.0}, False),
    ('fall_in', {}, False),
    ('fall_in', {'fall_distance': 1.5}, True),
    ('interference', {}, True),
    ('interference', {'interference_ratio': 0.2}, False),
    ('sag', {'sag_deviation': 0.1}, True),
    ('sag', {'sag_deviation': 0.9}, False),
    ('sag', {'min_confidence': 0.7}, False),
    ('missing', {'warning_distance': 0.5, 'critical_distance': 0.5}, True),
])
def test_other_limits_raise_what_breaks_them(kind, changes, expected):
    hazard = replace(HAZARD, kind=HazardKind[kind.upper()])
    if kind == 'sag':
        hazard = replace(hazard, required=0.5)
    own, other = (make_limits(item, None) for item in (OWN, replace(OWN, **changes)))
    assert would_raise(hazard, own, other) is expected


def test_limits_that_are_not_known_any_more_raise_nothing():
    run = {'settings': to_mapping(Settings())}
    run['settings']['hazards']['rules'] = '/gone/rules.yaml'
    other = read_limits(run)
    assert other.rules is None
    assert not would_raise(HAZARD, make_limits(OWN, None), other)
