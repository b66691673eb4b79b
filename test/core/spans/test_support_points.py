# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Guys of poles, and what leads to a pole and is none."""

import numpy as np
import pytest

from plc_inspect.config import Settings
from plc_inspect.core.extraction.height import extract_high
from plc_inspect.core.extraction.off_ground import gather_off_ground
from plc_inspect.core.spans.support_points import mark_guys

SETTINGS = Settings()
FOOT, TOP = np.zeros(3), 8.0


def make_line(start, end, num=90, noise=0.02, seed=1):
    """Return points on a straight line between two places."""
    rng = np.random.default_rng(seed)
    points = np.array(start) + rng.random((num, 1)) * (np.array(end) - np.array(start))
    return points + rng.normal(0.0, noise, points.shape)


def find_marked(own, *others, is_wire=False):
    """Return the share of some points above 2 m that are marked, and the number of others."""
    rng = np.random.default_rng(5)
    ground = np.column_stack([rng.uniform(-20.0, 20.0, (4000, 2)), rng.normal(0.0, 0.02, 4000)])
    pole = make_line(FOOT, (0.0, 0.0, TOP), 300, 0.05)
    points = np.vstack([own, pole, *others, ground])
    cloud = gather_off_ground(points, extract_high(points, SETTINGS.height), 2.0)
    mine = cloud.place < len(own)
    mask = np.zeros(len(cloud.points), dtype=bool)
    mark_guys(cloud, mine & is_wire, FOOT, TOP, mask)
    far = np.hypot(*cloud.points[:, :2].T) > 0.3
    return mask[mine & far].mean(), int(mask[~mine].sum())


GUY = (0.05, 0.0, 7.0), (3.0, 1.5, 0.0)


@pytest.mark.parametrize(('start', 'end'), [
    GUY, ((0.0, 0.0, 7.5), (0.0, -6.5, 0.0)), ((0.0, 0.05, 5.0), (-3.0, 1.0, 0.0)),
])
def test_a_guy_is_of_its_pole(start, end):
    share, others = find_marked(make_line(start, end))
    assert share > 0.9
    assert others == 0


@pytest.mark.parametrize(('start', 'end', 'num'), [
    ((0.9, 0.0, 7.0), (3.9, 1.5, 0.0), 90),  # past the pole
    ((0.0, 0.0, 3.6), (2.0, 1.0, 0.0), 90),  # to its lower half
    ((1.7, 0.85, 3.2), (3.0, 1.5, 0.0), 90),  # a rod beside it
    ((0.0, 0.0, 7.5), (12.0, 0.0, 0.0), 90),  # as a drop leads away
    (*GUY, 3),
])
def test_other_lines_at_a_pole_are_no_guys(start, end, num):
    assert find_marked(make_line(start, end, num))[0] == 0.0


def test_a_conductor_is_no_guy():
    assert find_marked(make_line(*GUY), is_wire=True) == (0.0, 0)


def test_of_a_crown_beside_a_pole_nothing_is_a_guy():
    crown = np.random.default_rng(7).normal((1.5, 0.8, 4.0), (1.0, 1.0, 1.5), (4000, 3))
    assert find_marked(make_line(*GUY), crown) == (0.0, 0)


def test_two_guys_at_a_hedge_are_told():
    other = make_line((0.0, 0.0, 7.0), (-2.0, 3.0, 0.0), seed=3)
    hedge = np.random.default_rng(7).uniform((2.0, 3.0, 0.0), (6.0, 4.0, 3.0), (3000, 3))
    share, others = find_marked(make_line(*GUY), other, hedge)
    assert share > 0.9
    assert 40 < others < 90
