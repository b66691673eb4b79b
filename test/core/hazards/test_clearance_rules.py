# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Rule sets: the plain one, those of config/rules, and what is wrong with bad ones."""

from pathlib import Path

from factories import find_nearby, make_model, make_span_result
import numpy as np
import pytest
from toys import make_tree, make_wire
import yaml

from plc_inspect.config import CorridorSettings, HazardSettings, Settings
from plc_inspect.core.hazards.clearance_rules import (
    describe_rules,
    Limit,
    parse_rules,
    plain_rules,
)
from plc_inspect.core.hazards.hazards import find_hazards
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.errors import ConfigError
from plc_inspect.results import HazardKind, Severity

RULES = Path(__file__).parents[3] / 'config' / 'rules'
FOOT = 0.3048


def read(name):
    return yaml.safe_load((RULES / f'{name}.yaml').read_text(encoding='utf-8'))


def make(**changes):
    limit = {'feature': 'vegetation', 'distance': 2.5}
    return {'name': 'own', 'title': 'own rule', 'edition': '1', 'source': 'a letter',
            'limits': [limit]} | changes


def test_plain_rules_are_those_of_the_settings():
    rules = plain_rules(HazardSettings(warning_distance=3.0, critical_distance=1.0))
    (limit,) = rules.find('vegetation')
    assert limit.distance == 3.0
    assert limit.judge(0.99) == Severity.CRITICAL
    assert limit.judge(1.0) == Severity.WARNING
    assert limit.judge(3.0) is None
    assert rules.find('fall_in') == ()
    assert 'no authority' in rules.source
    assert rules.voltage == 'unknown'
    assert rules.reach('vegetation', 'building') == 3.0
    assert rules.reach('water') == 0.0


def test_plain_rules_must_not_contradict_themselves():
    with pytest.raises(ConfigError, match=r'2 m is greater than hazards.warning_distance 1 m'):
        plain_rules(HazardSettings(warning_distance=1.0, critical_distance=2.0))


@pytest.mark.parametrize(('voltage', 'elevation', 'feet'), [
    (230.0, 0.0, 4.0), (230.0, 152.4, 4.0), (230.0, 153.0, 4.1), (345.0, 800.0, 4.5),
    (765.0, 1500.0, 12.4),
])
def test_nerc_by_voltage_and_elevation(voltage, elevation, feet):
    settings = HazardSettings(voltage=voltage, elevation=elevation)
    rules = parse_rules(read('nerc_fac_003_4'), settings)
    (limit,) = list_own(rules)
    assert limit.distance == pytest.approx(feet * FOOT)
    assert limit.judge(0.99 * feet * FOOT) == Severity.CRITICAL
    assert limit.judge(2.4 * feet * FOOT) == Severity.WARNING
    assert limit.judge(6.2 * feet * FOOT) == Severity.NOTICE
    assert limit.judge(6.3 * feet * FOOT) is None
    assert rules.voltage == f'{voltage:g} kV'
    assert 'second-hand' in limit.source


def list_own(rules):
    """Return the limits of a rule set that are its own."""
    return [limit for limit in rules.limits if not limit.title]


@pytest.mark.parametrize(('voltage', 'feet'), [
    (2.4, (4, 6.5)), (71.9, (4, 6.5)), (72.0, (6, 10)), (115.0, (10, 20)), (300.0, (15, 20)),
    (500.0, (15, 20)),
])
def test_go95_by_voltage(voltage, feet):
    for case, value in zip((13, 14), feet, strict=True):
        rules = parse_rules(read(f'go95_case_{case}'), HazardSettings(voltage=voltage))
        (limit,) = list_own(rules)
        assert limit.distance == pytest.approx(value * FOOT)


def test_unknown_voltage_is_said_and_never_guessed():
    rules = parse_rules(read('sweden'), HazardSettings())
    assert [limit.feature for limit in list_own(rules)] == ['fall_in']
    assert rules.voltage == 'unknown'
    assert len(rules.not_applied) == 2
    assert all('voltage is unknown' in text for text in rules.not_applied)
    with pytest.raises(ConfigError, match=r'no limit for a line of unknown voltage.*give hazards'):
        parse_rules(read('go95_case_13'), HazardSettings())


def test_features_without_a_limit_at_the_voltage_are_named():
    rules = parse_rules(read('sweden'), HazardSettings(voltage=220.0))
    assert [limit.feature for limit in list_own(rules)] == ['fall_in']
    assert rules.not_applied == (
        'vegetation: no limit for 220 kV', 'building: no limit for 220 kV',
    )
    assert parse_rules(read('sweden'), HazardSettings(voltage=20.0)).not_applied == ()


def test_voltage_and_elevation_beyond_the_table():
    rules = parse_rules(read('nerc_fac_003_4'), HazardSettings(voltage=400.0, elevation=0.0))
    assert not list_own(rules)
    assert rules.uncovered == ('vegetation', 'building', 'ground', 'line')
    with pytest.raises(ConfigError, match=r'give hazards\.elevation'):
        parse_rules(read('nerc_fac_003_4'), HazardSettings(voltage=230.0))
    with pytest.raises(ConfigError, match='2000 m above sea level, only up to 1524 m'):
        parse_rules(read('nerc_fac_003_4'), HazardSettings(voltage=230.0, elevation=2000.0))


def test_the_plain_distances_hold_where_a_rule_set_has_none():
    settings = HazardSettings(voltage=220.0, warning_distance=6.0, critical_distance=3.0)
    rules = parse_rules(read('sweden'), settings)
    (limit,) = rules.find('vegetation')
    assert limit.tiers == ((Severity.CRITICAL, 3.0), (Severity.WARNING, 6.0))
    assert limit.title == 'plain distances'
    assert limit.note == 'sweden has no limit for this at 220 kV'
    assert 'no authority' in limit.source
    assert rules.gaps == (
        'not covered by sweden at 220 kV: vegetation, building, ground, line'
        ' (the plain distances hold instead)'
    )
    assert describe_rules(rules)['not_covered'] == rules.gaps
    assert parse_rules(read('en50423_cz'), settings).uncovered == ('building',)
    assert plain_rules(settings).gaps == ''


def list_voltages(content):
    """Return voltages at, below and above each that a rule set names, and 0."""
    named = {0.4, 1000.0}
    for row in content['limits']:
        kv = row.get('kv', [])
        named |= {value for value in (kv if isinstance(kv, list) else [kv]) if value < 1e6}
    around = {value + step for value in named for step in (-0.1, 0.0, 0.1)}
    return [0.0, *sorted(value for value in around if value > 0.0)]


@pytest.mark.parametrize('name', sorted(path.stem for path in RULES.glob('*.yaml')))
def test_a_tree_at_a_hand_is_critical_by_every_rule_set_at_every_voltage(name):
    content = read(name)
    voltages = list_voltages(content)
    assert len(voltages) > 5
    done = 0
    for voltage in voltages:
        settings = HazardSettings(voltage=voltage, elevation=10.0)
        try:
            rules = parse_rules(content, settings)
        except ConfigError:  # asks for the voltage
            continue
        done += voltage > 0.0
        for side in ((0.0, -0.3), (0.3, 0.0), (0.0, 0.3), (0.2, -0.2)):
            assert judge_tree(rules, settings, side) == Severity.CRITICAL, (voltage, side)
    assert done == len(voltages) - 1


def judge_tree(rules, settings, side):
    """Return the severity of a crown that goes away from a conductor from one side of it on."""
    model = make_model((0.0, 0.0, 12.0), (100.0, 0.0, 12.0))
    away = np.array(side) / np.hypot(*side)
    rng = np.random.default_rng(2)
    reach = np.concatenate([[0.0, 0.01, 0.02], rng.uniform(0.0, 4.0, 900)])
    points = np.column_stack([
        50.0 + rng.uniform(-0.3, 0.3, len(reach)) * (reach > 0.1),
        *(np.array(side)[:, None] + away[:, None] * reach
          + rng.uniform(-0.4, 0.4, (2, len(reach))) * np.minimum(reach, 1.0)),
    ])
    points[:, 2] += float(model.curve.fit.height(model.curve.local(np.array([[50.0, 0.0]]))[0])[0])
    found = find_hazards(
        points, None, find_nearby(points, [model], 20.0), make_span_result([model], len(points)),
        settings, rules,
    ).hazards
    beside = (HazardKind.VEGETATION, HazardKind.STRUCTURE)
    return max((item.severity for item in found if item.kind in beside), default=None)


def test_sweden_measures_some_distances_on_the_level():
    rules = parse_rules(read('sweden'), HazardSettings(voltage=20.0))
    by_feature = {limit.feature: limit for limit in rules.limits}
    assert by_feature['vegetation'].measure == 'horizontal'
    assert by_feature['vegetation'].judge(1.9) == Severity.CRITICAL
    assert by_feature['vegetation'].judge(2.5) == Severity.WARNING
    assert by_feature['building'].distance == 5.0
    assert by_feature['fall_in'].distance == 3.5
    assert 'Svenska kraftnat' in by_feature['fall_in'].source


def test_sweden_holds_for_buildings_up_to_55_kv():
    for voltage, features in ((54.9, 1), (55.0, 1), (56.0, 0)):
        rules = parse_rules(read('sweden'), HazardSettings(voltage=voltage))
        assert [limit.measure for limit in rules.find('building')].count('horizontal') == features


@pytest.mark.parametrize(('aside', 'severity'), [
    (1.4, Severity.CRITICAL), (2.5, Severity.WARNING), (3.3, None),
])
@pytest.mark.parametrize('radius', [0.6, 20.0])
def test_what_is_near_horizontally_is_found_however_far_below(aside, severity, radius):
    """The conductor that is nearest in space hangs lower and farther off."""
    rng = np.random.default_rng(0)
    ground = rng.uniform((-10, -30, 0), (110, 30, 0.02), (30_000, 3))
    bush = make_tree(50.0, 1.5 + aside + 0.8, 6.3, bottom=3.0, radius=0.8)
    wires = [
        make_wire((0.0, 0.0, 11.0), (100.0, 0.0, 11.0), per_metre=40.0),
        make_wire((0.0, 1.5, 13.5), (100.0, 1.5, 13.5), per_metre=40.0, seed=1),
    ]
    settings = Settings(
        hazards=HazardSettings(voltage=20.0), corridor=CorridorSettings(radius=radius)
    )
    result = Pipeline(settings, parse_rules(read('sweden'), settings.hazards)).run(
        np.concatenate([ground, bush, *wires])
    )
    assert len(result.spans) == 2
    near = [item for item in result.hazards if item.kind == HazardKind.VEGETATION]
    assert [item.severity for item in near] == [severity] * (severity is not None)
    for item in near:
        assert item.measured == item.horizontal == pytest.approx(aside, abs=0.1)
        assert item.clearance > 5.0


@pytest.mark.parametrize(('height', 'is_found'), [(30.0, True), (50.0, False)])
def test_a_line_far_above_is_not_near_horizontally(height, is_found):
    tree = make_tree(30.0, 12.0, 6.0, radius=1.0)
    models = [make_model((0, 0, 8), (60, 0, 8), 0, 0, c=2000.0),
              make_model((30, -60, height), (30, 60, height), 1, 1, c=6000.0)]
    settings = HazardSettings(voltage=20.0)
    found = find_hazards(
        tree, None, find_nearby(tree, models, 30.0), make_span_result(models, len(tree)),
        settings, parse_rules(read('sweden'), settings),
    ).hazards
    assert [item.line_id for item in found] == [1] * is_found


def test_czech_annex_tells_under_from_beside_and_leaves_roads_out():
    rules = parse_rules(read('en50423_cz'), HazardSettings())
    assert {limit.where: limit.distance for limit in rules.find('vegetation')} == {
        'under': 0.5, 'beside': 0.6,
    }
    assert all(limit.judge(2.0) == Severity.WARNING for limit in rules.find('vegetation'))
    assert rules.find('ground')[0].distance == 5.6
    assert rules.find('line')[0].distance == 1.0
    assert rules.not_applied == ('road 6.60 m: roads cannot be told from points',)


def test_every_shipped_rule_set_names_itself_and_its_source():
    names = sorted(path.stem for path in RULES.glob('*.yaml'))
    assert len(names) >= 5
    for name in names:
        content = read(name)
        assert content['name'] == name
        assert content['source']
        voltages = [0.0, 20.0, 110.0, 230.0, 500.0]
        done = 0
        for voltage in voltages:
            try:
                rules = parse_rules(content, HazardSettings(voltage=voltage, elevation=10.0))
            except ConfigError:
                continue
            done += 1
            assert all(limit.source and limit.distance > 0 for limit in rules.limits)
            assert describe_rules(rules)['rules'] == content['title']
        assert done, name


@pytest.mark.parametrize(('content', 'message'), [
    ([], 'is a mapping'),
    ({}, 'no name'),
    (make(source=''), 'has no source'),
    (make(limits=[]), 'has no limits'),
    (make(limits='none'), 'must be a list'),
    (make(limits=['x']), 'limit 1 is no mapping'),
    (make(unit='yard'), "unit must be m or ft, got 'yard'"),
    (make(colour='red'), "unknown key 'colour'"),
    (make(limits=[{'feature': 'moon', 'distance': 1}]), "feature must be one of .*got 'moon'"),
    (make(limits=[{'feature': 'ground'}]), 'distance must be a number'),
    (make(limits=[{'feature': 'ground', 'distance': -1}]), 'must be a number from 0, got -1'),
    (make(limits=[{'feature': 'ground', 'distance': float('nan')}]), 'must be a number'),
    (make(limits=[{'feature': 'ground', 'distance': True}]), 'must be a number'),
    (make(limits=[{'feature': 'ground', 'distance': 1, 'kv': [9, 3]}]), 'kv from 9 to 3'),
    (make(limits=[{'feature': 'ground', 'distance': 1, 'kv': [9]}]), 'one voltage or'),
    (make(limits=[{'feature': 'ground', 'distance': 1, 'kv': ['10', '35']}]), "got '10'"),
    (make(limits=[{'feature': 'ground', 'distance': 1, 'kv': [1, None]}]), 'got None'),
    (make(limits=[{'feature': 'ground', 'distance': 10**400}]), 'must be a number'),
    (make(unit=['ft']), 'unit must be m or ft'),
    (make(limits=[{'feature': 'ground', 'distance': [2, 1]}], elevations=[900, 300]),
     'elevations must ascend'),
    (make(limits=[{'feature': 'ground', 'distance': [1, 2]}]), '2 distances need as many'),
    (make(limits=[{'feature': 'water', 'distance': 1}]), 'no limit that points can be held'),
    (make(tiers={'awful': 1.0}), "tier must be one of notice, warning, critical, got 'awful'"),
    (make(tiers={'critical': 2.0, 'warning': 1.0}), 'must not reach farther'),
    (make(tiers=[]), 'tiers must map'),
    (make(limits=[{'feature': 'line', 'distance': 1, 'where': 'beside'}]),
     'a limit of line cannot be distance and beside'),
    (make(limits=[{'feature': 'fall_in', 'distance': 1, 'measure': 'horizontal'}]),
     'a limit of fall_in cannot be horizontal and any'),
    (make(limits=[
        {'feature': 'ground', 'distance': 5, 'kv': [0, 50]},
        {'feature': 'ground', 'distance': 6, 'kv': [10, 110]},
    ]), 'contradicts itself: ground 5.00 m and 6.00 m'),
])
def test_bad_rule_sets_say_what_is_wrong(content, message):
    with pytest.raises(ConfigError, match=message):
        parse_rules(content, HazardSettings(voltage=20.0, elevation=100.0))


def test_tiers_multiply_the_distance_and_a_limit_may_have_its_own():
    rules = parse_rules(make(tiers={'critical': 1.0, 'notice': 3.0}, limits=[
        {'feature': 'vegetation', 'distance': 2.0},
        {'feature': 'ground', 'distance': 5.0, 'tiers': {'warning': 1.0}, 'source': 'other'},
    ]), HazardSettings())
    first, second = list_own(rules)
    assert first.tiers == ((Severity.CRITICAL, 2.0), (Severity.NOTICE, 6.0))
    assert first.source == 'a letter'
    assert second.tiers == ((Severity.WARNING, 5.0),)
    assert second.source == 'other'
    assert isinstance(first, Limit)
