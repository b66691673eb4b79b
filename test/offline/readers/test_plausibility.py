# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Coordinates that cannot be metres are refused, and assumptions are told."""

from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from plc_inspect.errors import ConfigError, DataError
from plc_inspect.offline.readers.plausibility import (
    check_precision,
    parse_unit,
    question_place,
)


@pytest.mark.parametrize(('low', 'high', 'unit', 'text'), [
    ((5.01, 52.1, 3.0), (5.02, 52.107, 41.0), None, 'y 52.1 to 52.107 are degrees'),
    ((3.9e6, 3.0e5, 5.0e6), (3.901e6, 3.01e5, 5.001e6), None, 'as geocentric coordinates do'),
    ((5e5, 5e6, 9_500.0), (5.01e5, 5.001e6, 9_600.0), None, 'z from 9500 to 9600 is not a height'),
    ((5e5, 5e6, -4e4), (5.01e5, 5.001e6, -3e4), 1.0, 'is not a height on Earth in metres'),
])
def test_what_cannot_be_is_refused(low, high, unit, text):
    with pytest.raises(DataError, match=text):
        question_place('a.las', low, high, (unit or 1.0,) * 2, unit is not None)


@pytest.mark.parametrize(('low', 'high', 'unit', 'expected'), [
    ((5e5, 5e6, 30.0), (5.01e5, 5.001e6, 60.0), None, 'metres assumed'),
    ((1.91e6, 6.06e5, 300.0), (1.92e6, 6.07e5, 355.0), None, 'x of 1.92e+06 may be feet'),
    ((-105.0, -103.0, -9.0), (-53.0, -66.0, 13.0), None, 'metres assumed'),
    ((5e5, 5e6, 30.0), (5.01e5, 5.001e6, 1e5), None, 'metres assumed'),
    ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), None, 'metres assumed'),
])
def test_what_may_be_is_told(low, high, unit, expected):
    assert expected in question_place('a.las', low, high, (unit or 1.0,) * 2, unit is not None)


def test_a_unit_of_z_alone_is_told():
    low, high = (5e5, 5e6, 3000.0), (5.01e5, 5.001e6, 12_000.0)
    assert question_place('a.las', low, high, (1.0, 0.3048), False) == (
        'a.las has no coordinate reference system: metres assumed for x and y, z is in units of'
        ' 0.3048 m by its GeoTIFF key'
    )
    with pytest.raises(DataError, match='z from 30000 to 39000 is not a height on Earth in that'):
        question_place('a.las', (*low[:2], 3e4), (*high[:2], 3.9e4), (1.0, 0.3048), False)


def test_what_was_said_is_not_told():
    low, high = (1.91e6, 6.06e5, 9e3), (1.92e6, 6.07e5, 2e4)
    assert question_place('a.las', low, high, (0.3048, 0.3048), True) == ''


def test_units_have_names():
    assert parse_unit(None) is None
    assert parse_unit('ft') == 0.3048
    with pytest.raises(ConfigError, match="--units must be one of m, ft, us-ft, got 'yard'"):
        parse_unit('yard')


@pytest.mark.parametrize(('kinds', 'is_coarse'), [
    ('f8 f8 f8', False), ('f8 f8 f4', False), ('i4 f8 f8', False), ('f4 f8 f8', True),
    ('f8 >f4 f8', True), ('f8 f2 f8', True),
])
def test_only_columns_in_single_precision_can_be_coarse(kinds, is_coarse):
    points = np.array([[500_000.0, 5_400_000.0, 100.0]])
    with pytest.raises(DataError, match='in single precis') if is_coarse else nullcontext():
        check_precision(Path('a.ply'), points, kinds.split())


@pytest.mark.parametrize('value', [np.nan, np.inf, 3e38, 1e9])
def test_what_is_not_on_earth_says_nothing_about_precision(value):
    points = np.array([[1.0, 2.0, 3.0], [value, 2.0, 3.0]])
    check_precision(Path('a.ply'), points, ['f4'] * 3)
    check_precision(Path('a.ply'), points[:0], ['f4'] * 3)
