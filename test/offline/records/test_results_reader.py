# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A results folder read back is what was written, and what is wrong with one is told."""

import dataclasses
import math
import shutil

from factories import make_inspection
import laspy
import numpy as np
import pytest

from plc_inspect.config import Settings
from plc_inspect.errors import DataError
from plc_inspect.offline.export.results_folder import write_results
from plc_inspect.offline.records.results_reader import (
    parse_hazard,
    parse_span,
    parse_units,
    read_points,
    read_run,
    read_table,
    understanding,
)
from plc_inspect.offline.records.units import Units
from plc_inspect.results import HazardKind
from plc_inspect.setting_names import to_mapping

UNITS = {
    'metres': Units(), 'feet': Units(horizontal=0.3048, vertical=0.3048),
    'both': Units(horizontal=1200.0 / 3937.0, vertical=1.0),
}


def make_run(units):
    """Make a run whose hazard has all that a hazard can have."""
    run = make_inspection(units=units, num_ground=200)
    hazard = dataclasses.replace(
        run.result.hazards[0], kind=HazardKind.CROSSING, voltage='110 kV', other_line_id=2,
        support_id=1, from_support=12.5, height=3.25, years=4.5, note='assumed',
    )
    result = dataclasses.replace(run.result, hazards=(*run.result.hazards, hazard))
    return dataclasses.replace(run, result=result)


@pytest.fixture(scope='module')
def folders(tmp_path_factory):
    """Write one run in several units."""
    room = tmp_path_factory.mktemp('results')
    for name, units in UNITS.items():
        write_results(room / name, make_run(units))
    return room


def assert_same(read, made):
    """Compare two frozen results field by field."""
    for name in (field.name for field in dataclasses.fields(made)):
        one, other = getattr(read, name), getattr(made, name)
        if isinstance(other, dict):
            one, other = list(one.values()), list(other.values())
        if isinstance(other, str):
            assert one == other, name
        else:
            np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-9, err_msg=name)


@pytest.mark.parametrize('name', UNITS)
def test_spans_and_hazards_come_back_in_metres(folders, name):
    units, result = UNITS[name], make_run(UNITS[name]).result
    for table, parse in (('spans', parse_span), ('hazards', parse_hazard)):
        content = read_table(folders / name, table)
        assert parse_units(content['metres_per_unit']) == units
        assert content[table]
        for row, made in zip(content[table], getattr(result, table), strict=True):
            assert_same(parse(row, units), made)


@pytest.mark.parametrize('name', UNITS)
def test_points_come_back_in_metres(folders, name):
    made = make_run(UNITS[name])
    las, points = read_points(folders / name, 'span_id', 'decision')
    np.testing.assert_array_equal(points, las.xyz)
    before = points.copy()
    np.testing.assert_allclose(UNITS[name].to_metres(points), made.points, atol=1e-3)
    np.testing.assert_array_equal(points, before)
    np.testing.assert_array_equal(las['span_id'], made.result.span_id)
    np.testing.assert_array_equal(las.classification, made.result.classification)


def test_the_run_comes_back(folders):
    run = read_run(folders / 'metres')
    assert run['settings'] == to_mapping(Settings())
    assert len(read_table(folders / 'metres', 'supports')['supports']) == run['num_supports'] == 3


READERS = {
    'run.json': read_run,
    'spans.json': lambda folder: read_table(folder, 'spans'),
    'points.laz': lambda folder: read_points(folder, 'decision'),
}


@pytest.mark.parametrize('name', READERS)
def test_what_is_missing_is_named(folders, tmp_path, name):
    with pytest.raises(DataError, match='nothing: no such results folder'):
        READERS[name](tmp_path / 'nothing')
    with pytest.raises(DataError, match=f'is not a results folder: it has no {name}'):
        READERS[name](tmp_path)
    shutil.copy(folders / 'metres' / name, tmp_path)
    READERS[name](tmp_path)


@pytest.mark.parametrize(('data', 'message'), [
    (b'{', 'spans.json is not JSON'), (b'[]', 'spans.json holds a list, not an object'),
    (b'{}', 'spans.json holds no spans'), (b'{"spans": [1]}', 'spans.json holds no spans'),
    (b'\xff{}', 'spans.json cannot be read: not text'),
])
def test_what_is_malformed_is_told(tmp_path, data, message):
    (tmp_path / 'spans.json').write_bytes(data)
    with pytest.raises(DataError, match=message):
        read_table(tmp_path, 'spans')


def test_points_of_others_are_no_results(tmp_path):
    las = laspy.LasData(laspy.LasHeader(point_format=6, version='1.4'))
    las.x = np.arange(3.0)
    las.write(tmp_path / 'points.laz')
    with pytest.raises(DataError, match=r'points\.laz holds no clearance'):
        read_points(tmp_path, 'clearance')


def test_what_a_record_lacks_is_told(folders, tmp_path):
    row = read_table(folders / 'metres', 'spans')['spans'][0]
    del row['sag']
    with pytest.raises(DataError, match="x is not understood: it has no 'sag'"), \
            understanding(tmp_path / 'x'):
        parse_span(row, Units())
    with pytest.raises(DataError, match='is not understood: not enough'), \
            understanding(tmp_path / 'x'):
        parse_units([1.0])


@pytest.mark.parametrize('units', [[0.0, 1.0], [1.0, -0.3048], [math.nan, 1.0], [1.0, math.inf]])
def test_units_that_no_cloud_has_are_refused(units, tmp_path):
    with pytest.raises(DataError, match=r'metres_per_unit is .*, not above 0'), \
            understanding(tmp_path / 'x'):
        parse_units(units)


def test_a_count_beyond_all_numbers_is_refused(folders, tmp_path):
    row = read_table(folders / 'metres', 'spans')['spans'][0] | {'num_points': math.inf}
    with pytest.raises(DataError, match='is not understood: '), understanding(tmp_path / 'x'):
        parse_span(row, Units())
