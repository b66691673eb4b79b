# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Real clouds beside the repository; skipped, saying so, where they are absent."""

from functools import cache
from pathlib import Path

import laspy
import numpy as np
import pytest
from scipy.spatial import cKDTree

from plc_inspect.core.pipeline import Pipeline
from plc_inspect.results import PointClass

FOLDER = Path(__file__).resolve().parents[2] / 'shared' / 'data' / 'real'
US_FOOT = 1200 / 3937


@cache
def inspect(name, scale=1.0):
    """Return the points [m], the labels and the result of one real cloud."""
    path = FOLDER / f'{name}.laz'
    if not path.is_file():
        pytest.skip(f'{path} is absent: real clouds are not part of the repository')
    cloud = laspy.read(path)
    points = np.column_stack([cloud.x, cloud.y, cloud.z]).astype(np.float64) * scale
    return points, np.array(cloud.classification), Pipeline().run(points)


def count_wire(label, result):
    """Return precision, recall and F1 of wire points; class 0 is left out."""
    judged = label != 0
    wire, found = (label == PointClass.WIRE)[judged], (result.line_id >= 0)[judged]
    hits = int((wire & found).sum())
    return hits / found.sum(), hits / wire.sum(), 2 * hits / (wire.sum() + found.sum())


def test_airborne_high_voltage():
    points, label, result = inspect('ahn_12BZ1_21')
    assert count_wire(label, result)[2] >= 0.95
    assert result.num_lines == 8
    spans = {}
    for span in result.spans:
        spans.setdefault(span.line_id, []).append(span.span_id)
    assert all(len(own) == len(set(own)) == 2 for own in spans.values())
    # both circuits hang between the same supports
    assert len({tuple(own) for own in spans.values()}) <= 2
    assert len(points) == result.num_points


@pytest.mark.slow
@pytest.mark.parametrize('name', [
    'oakland_part2_ad', 'oakland_part3_aj', 'autzen_parking_no_wires',
    'forest_bcts_1_no_wires', 'forest_mixedconifer_no_wires',
])
def test_no_line_where_there_is_none(name):
    _, _, result = inspect(name)
    assert result.spans == result.hazards == ()
    assert (result.line_id == -1).all()


@pytest.mark.parametrize('name', ['oakland_part3_an', 'oakland_part2_ai'])
def test_wires_of_a_street(name):
    _, label, result = inspect(name)
    assert min(count_wire(label, result)) >= 0.85


def test_residual_of_an_earth_wire_in_feet():
    points, _, result = inspect('earthwire_us_feet', US_FOOT)
    assert result.num_lines == 1
    assert len(result.spans) >= 3
    for span in result.spans:
        assert span.rmse <= 0.03
    wire = result.line_id >= 0
    assert np.sqrt(np.mean(result.residual[wire] ** 2)) <= 0.06
    assert len(points) == len(wire)


def test_hazards_cover_what_was_pasted_under_the_line():
    points, label, result = inspect('ahn_12BZ1_21_pasted_trees')
    wire = points[label == PointClass.WIRE]
    pasted = points[np.isin(label, (5, 26))]
    distance, _ = cKDTree(wire).query(pasted, distance_upper_bound=4.0)
    offending = pasted[distance < 4.0]
    assert len(offending) > 7000
    covered = np.zeros(len(offending), dtype=bool)
    for hazard in result.hazards:
        low, high = hazard.extent[0] - 0.05, hazard.extent[1] + 0.05
        covered |= ((offending >= low) & (offending <= high)).all(axis=1)
    assert covered.mean() >= 0.95
    for hazard in result.hazards:
        assert hazard.clearance < 4.0
        # a hazard is where something was pasted
        nearest, _ = cKDTree(pasted).query(hazard.position)
        assert nearest < 0.01
