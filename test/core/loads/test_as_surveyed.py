# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The case 'as surveyed', and one that changes nothing, say what hazards and spans say."""

import math

import numpy as np
import pytest
from toys import make_line_cloud, make_tree
import yaml

from plc_inspect.config import HazardSettings
from plc_inspect.core.hazards.clearance_rules import parse_rules, plain_rules
from plc_inspect.core.loads.contact import find_contacts
from plc_inspect.core.loads.load_cases import evaluate_cases, SURVEYED
from plc_inspect.core.loads.sag_tension import Case, Conductor
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.results import HazardKind
from plc_inspect.shared_files import find_shared

CONDUCTOR = Conductor(
    name='test', diameter=0.028, weight=15.0, stiffness=36e6, expansion=19.3e-6,
)
STILL = Case(name='still', temperature=15.0)
HOT = Case(name='hot', temperature=60.0)
KINDS = {HazardKind.VEGETATION: 'vegetation', HazardKind.STRUCTURE: 'building',
         HazardKind.GROUND: 'ground'}


def tree_at_a_pole():
    return make_line_cloud(more=[make_tree(101.0, 5.0, 14.6, bottom=2.0)])[0]


def tree_beyond_the_end():
    return make_line_cloud(more=[make_tree(-5.0, 1.0, 17.0, bottom=8.0)])[0]


def tree_over_unseen_ground():
    points, label = make_line_cloud(spans=(100.0,), height=8.0)
    return np.vstack([points[label != 2], make_tree(50.0, 0.0, 5.0, bottom=2.0)])


def lorry():
    rng = np.random.default_rng(3)
    car = rng.uniform((48, -1.5, 0), (56, 1.2, 4.0), (4000, 3))
    face = rng.integers(0, 3, 4000)
    car[face == 0, 2], car[face == 1, 1], car[face == 2, 0] = 4.0, -1.5, 48.0
    return make_line_cloud(height=8.0, more=[car])[0]


def tree_below_bundle(half=0.2):
    parts = []
    for up in (-half, half):
        for aside in (-half, half):
            points, label = make_line_cloud(
                spans=(200.0,), offsets=(aside - 8.0, aside, aside + 8.0), height=25.0 + up,
                c=1200.0, per_metre=3.0, noise=0.08, poles=not parts,
                seed=int(9 + 100 * up + 10 * aside),
            )
            parts.append(points if not parts else points[label == 14])
    low = 25.0 - half - 1200.0 * (math.cosh(100.0 / 1200.0) - 1.0)
    return np.vstack([*parts, make_tree(100.0, 0.0, low - 3.0, bottom=2.0, radius=2.0)])


def low_over_a_hollow():
    points, label = make_line_cloud(height=8.0, spans=(100.0,))
    ground = label == 2
    aside = np.abs(points[:, 0] - 50.0)
    points[ground, 2] += 2.5 * np.exp(-((aside[ground] - 25.0) / 8.0) ** 2)
    return points[~(ground & (aside < 25.0))]


def house_beside():
    rng = np.random.default_rng(1)
    roof = rng.uniform((40, 5.0, 3.4), (50, 11.0, 3.42), (6000, 3))
    wall = rng.uniform((40, 5.0, 0), (50, 5.02, 3.4), (3000, 3))
    return make_line_cloud(more=[roof, wall])[0]


def tree_touching_below():
    low = 15.0 - 800.0 * (math.cosh(50.0 / 800.0) - 1.0)
    return make_line_cloud(more=[make_tree(50.0, 0.0, low - 0.44, bottom=2.0)])[0]


def many_trees():
    rng = np.random.default_rng(5)
    return make_line_cloud(more=[
        make_tree(x, rng.uniform(-5, 5), rng.uniform(9, 14), bottom=2.0, seed=int(x))
        for x in np.arange(10.0, 205.0, 12.0)
    ])[0]


def read_rules(name, voltage):
    content = yaml.safe_load(find_shared(f'rules/{name}.yaml').read_text(encoding='utf-8'))
    return parse_rules(content, HazardSettings(voltage=voltage))


PLAIN = plain_rules(HazardSettings())


@pytest.fixture(scope='module', params=[
    (tree_at_a_pole, None), (tree_beyond_the_end, None), (tree_over_unseen_ground, None),
    (lorry, None), (tree_below_bundle, None), (low_over_a_hollow, None),
    (house_beside, ('sweden', 20.0)), (many_trees, None),
    (tree_touching_below, ('en50423_cz', 22.0)),
], ids=lambda item: item[0].__name__)
def scene(request):
    """Return a cloud, its result and the rules."""
    make, named = request.param
    rules = read_rules(*named) if named else PLAIN
    points = make()
    return points, Pipeline(rules=rules).run(points), rules


def test_all_rows_are_what_hazards_and_spans_say(scene):
    points, result, rules = scene
    done = evaluate_cases(points, result, CONDUCTOR, 15.0, [STILL, HOT], rules, 3)
    assert result.spans
    objects = [item for item in result.hazards if item.kind in list(KINDS)[:2]]
    assert set(done.hazards) == {item.hazard_id for item in objects}
    for item in objects:
        surveyed, still, hot = done.hazards[item.hazard_id]
        assert surveyed == pytest.approx(item.clearance, abs=1e-6)
        assert still == pytest.approx(item.clearance, abs=1e-3)
        assert abs(hot - item.clearance) < 2.0
    spans = {(span.line_id, span.span_id): span for span in result.spans}
    for row in done.spans:
        surveyed, still, hot = row.outcomes
        assert (surveyed.case, still.case) == (SURVEYED, 'still')
        for kind, feature in KINDS.items():
            near, again = getattr(surveyed, feature), getattr(still, feature)
            assert again.severity == near.severity
            assert again.clearance == pytest.approx(near.clearance, abs=2e-3, nan_ok=True)
            check_row(near, kind, row, result.hazards)
        span = spans[row.line_id, row.span_id]
        of_it = [item.clearance for item in result.hazards if item.kind == HazardKind.GROUND
                 and (item.line_id, item.span_id) == (row.line_id, row.span_id)]
        expected = of_it[0] if of_it else span.ground_clearance
        assert surveyed.ground.clearance == pytest.approx(expected, abs=1e-6, nan_ok=True)


def check_row(near, kind, row, hazards):
    """Check one row as surveyed: it is of a hazard of the conductor, or of another object."""
    of_kind = [item for item in hazards if item.kind == kind]
    own = [item for item in of_kind
           if (item.line_id, item.span_id) == (row.line_id, row.span_id)]
    if own:
        assert near.severity >= max(item.severity for item in own)
    if near.severity is None:
        return
    is_own = [near.clearance == pytest.approx(item.clearance, abs=1e-6)
              and near.along == pytest.approx(item.along_span, abs=0.02)
              and near.severity == item.severity for item in own]
    # what is nearer still to another conductor is a hazard to that
    is_other = [item not in own and item.severity >= near.severity
                and (kind != HazardKind.VEGETATION or near.clearance >= item.clearance - 1e-6)
                for item in of_kind]
    assert any(is_own) or any(is_other)


def test_an_object_over_unseen_ground_is_touched():
    points = tree_over_unseen_ground()
    result = Pipeline().run(points)
    found = find_contacts(points, result, CONDUCTOR, 15.0, PLAIN)
    assert list(found) == [item.hazard_id for item in result.hazards]
