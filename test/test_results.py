# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Curves of spans: heights and positions along them."""

import math

import numpy as np
import pytest
from spans import make_result, make_span

from plc_inspect.errors import DataError
from plc_inspect.results import catenary_heights


def test_heights_by_hand():
    """At the vertex z is a + c; one c beside it, a + c cosh(1)."""
    z = catenary_heights(-90.0, 30.0, 100.0, np.array([30.0, 130.0, -70.0]))
    assert z == pytest.approx([10.0, -90.0 + 100.0 * math.cosh(1.0), z[1]], abs=1e-12)


def test_curves_side_by_side_equal_one_by_one():
    a, b, c = np.array([[5.0, 7.0], [10.0, -20.0], [300.0, 800.0]])
    x = np.array([40.0, 55.0])
    both = catenary_heights(a, b, c, x)
    for k in range(2):
        assert both[k] == catenary_heights(a[k], b[k], c[k], x[k:k + 1])[0]


@pytest.mark.parametrize('end', [(120.0, 0.0, 14.0), (-60.0, 80.0, 22.0), (0.0, -90.0, 3.0)])
def test_a_span_runs_from_its_start_to_its_end(end):
    span = make_span((0.0, 0.0, 14.0), end)
    x = np.array([0.0, span.length, min(max(span.b, 0.0), span.length)])
    before = x.copy()
    places = span.positions(x)
    assert places == pytest.approx(np.array([span.start, span.end, span.lowest]), abs=1e-9)
    assert places[:, 2].tobytes() == span.heights(x).tobytes()
    assert x.tobytes() == before.tobytes()


def test_no_place_gives_no_point():
    span = make_span((0.0, 0.0, 14.0), (120.0, 0.0, 14.0))
    none = np.empty(0)
    assert span.heights(none).shape == (0,)
    assert span.positions(none).shape == (0, 3)


def test_no_two_spans_of_a_line_have_the_same_number():
    spans = [make_span((0.0, 0.0, 9.0), (50.0, 0.0, 9.0), 1, 4) for _ in range(2)]
    make_result(spans[:1])
    with pytest.raises(DataError, match='two spans of line 1 have the number 4'):
        make_result(spans)
