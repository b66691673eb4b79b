# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Constants of the core: the page lists them all."""

from tools.make_constants import list_constants, PAGE, render_page, walk_core

LEAST_CONSTANTS = 280
"""A search that finds fewer looks in the wrong place."""
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
