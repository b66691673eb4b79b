# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Constants of the core: the page lists them all, and each says where its value comes from."""

import ast
from pathlib import Path
import re

import pytest

from tools.make_constants import CORE, KINDS, list_constants, PAGE, render_page, walk_core

ROOT = Path(__file__).parents[1]
LEAST_CONSTANTS = 600
"""A search that finds fewer looks in the wrong place."""
PLAIN = {0.0, 0.5, 1.0, 2.0}
"""Floats that need no name where values are compared: signs, halves and doubles."""
MOST_PLAIN = 3
"""Whole numbers up to this need none either: counts of axes, of ends, of pairs."""
UNNAMED = {'live/warm_up.py'}
"""Made-up data: its numbers decide nothing."""
CONSTANTS = walk_core()
TOY = '''
import math
import numpy as np

REACH = 3.0
"""
Distance at most [m].
Source: paper, Table 1.
"""
_NUM_PARTS: int = 1 << 4
"""Parts.  Source: numerical: time alone depends on it."""
ANGLE = math.radians(5.0)
LOW, HIGH = -1.0, REACH * 2
"""Bounds of a share."""
ROOM = {'pole': 1.5, 'tower': 5.0}
SMALL = np.float32(0.01)
NAME = 'text'
KINDS = ('a', 'b')
TABLE = np.zeros(4)
YES = True
lower = 4.0


def f(x):
    LOCAL = 3.0
    return x < LOCAL
'''


def list_flaws(constant):
    """List what is missing in the docstring of a constant."""
    flaws = []
    if not constant.about.endswith('.') or len(constant.about) < 2:
        flaws.append('does not say what it is')
    if not constant.source.endswith('.') or len(constant.source) < 2:
        flaws.append('does not end with its source')
    if constant.text.count('Source:') > 1:
        flaws.append('has two sources')
    for path in re.findall(r'(?:bench|docs|test|tools)/[\w/]+\.\w+', constant.source):
        if not (ROOT / path).is_file():
            flaws.append(f'names {path}, which is not there')
    return flaws


def list_literals(tree):
    """List the numbers that values are compared with and that have no name."""
    found = []
    for node in ast.walk(tree):
        if not isinstance(node, ast.Compare):
            continue
        for side in (node.left, *node.comparators):
            value = ast.literal_eval(side) if is_literal(side) else 0
            plain = abs(value) <= MOST_PLAIN if type(value) is int else abs(value) in PLAIN
            if not plain:
                found.append(f'line {node.lineno}: {ast.unparse(node)}')
    return found


def is_literal(node):
    """Tell whether a node is a number, maybe with a sign."""
    if isinstance(node, ast.UnaryOp):
        return isinstance(node.op, ast.USub) and is_literal(node.operand)
    return isinstance(node, ast.Constant) and type(node.value) in (int, float)


def test_the_page_is_up_to_date():
    assert PAGE.read_text(encoding='utf-8') == render_page(CONSTANTS), 'run make settings'


def test_the_search_finds_all_constants():
    assert len(CONSTANTS) >= LEAST_CONSTANTS


def test_numbers_are_told_from_other_constants():
    found = list_constants(TOY, 'toy.py')
    assert [(item.name, item.value) for item in found] == [
        ('REACH', '3.0'), ('_NUM_PARTS', '1 << 4'), ('ANGLE', 'math.radians(5.0)'),
        ('LOW', '-1.0'), ('HIGH', 'REACH * 2'), ('ROOM', "{'pole': 1.5, 'tower': 5.0}"),
        ('SMALL', 'np.float32(0.01)'),
    ]
    reach, parts, angle = found[:3]
    assert (reach.about, reach.unit, reach.source, reach.kind) == (
        'Distance at most [m].', 'm', 'paper, Table 1.', 'paper',
    )
    assert (parts.about, parts.unit, parts.kind) == ('Parts.', '', 'numerical')
    assert (angle.text, angle.source, angle.kind) == ('', '', '')


@pytest.mark.parametrize(('docstring', 'count'), [
    ('', 2),
    ('"""Distance at most [m]."""', 1),
    ('"""Source: paper, Table 1."""', 1),
    ('"""Distance at most [m].  Source: """', 1),
    ('"""Distance at most [m].  Source: bench/no_such.py."""', 1),
    ('"""Distance at most [m].  Source: docs/tuning.md."""', 0),
])
def test_the_check_finds_what_is_missing(docstring, count):
    constant, = list_constants(f'REACH = 3.0\n{docstring}\n')
    assert len(list_flaws(constant)) == count


@pytest.mark.parametrize('constant', [
    pytest.param(item, id=f'{item.module}:{item.name}')
    for item in CONSTANTS
])
def test_every_constant_says_where_its_value_comes_from(constant):
    assert list_flaws(constant) == []


def test_kinds_of_sources_are_told_apart():
    assert {item.kind for item in CONSTANTS} == set(KINDS)


@pytest.mark.parametrize(('source', 'count'), [
    ('x > 0.6', 1), ('x > -0.6', 1), ('0.1 < x < 7', 2), ('x >= 20', 1),
    ('x > 0.0 and x < 0.5 and len(x) != 3', 0), ('x > LIMIT', 0), ('x == "a"', 0),
])
def test_the_check_finds_bare_numbers(source, count):
    assert len(list_literals(ast.parse(source))) == count


@pytest.mark.parametrize('path', [
    path for path in sorted(CORE.rglob('*.py'))
    if path.relative_to(CORE).as_posix() not in UNNAMED
], ids=lambda path: path.relative_to(CORE).as_posix())
def test_decisions_compare_with_named_constants(path):
    assert list_literals(ast.parse(path.read_text(encoding='utf-8'))) == []
