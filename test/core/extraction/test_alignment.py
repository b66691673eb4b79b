# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from toys import make_tree, make_wire, turn

from plc_inspect.config import AlignmentSettings, LinearitySettings
from plc_inspect.core.extraction import alignment
from plc_inspect.core.extraction.alignment import align
from plc_inspect.core.extraction.linearity import find_candidates, LinearityResult
from plc_inspect.errors import ConfigError

SETTINGS = AlignmentSettings()


def make_candidates(position, direction):
    position = np.asarray(position, float).reshape(-1, 3)
    direction = np.broadcast_to(np.asarray(direction, float), position.shape).copy()
    num = len(position)
    return LinearityResult(
        position=position, direction=direction, size=np.ones(num), linear=np.ones(num),
        count=np.full(num, 9), sizes=(1.0,), num_voxels=(num,),
    )


def find(points):
    origin = points.min(axis=0) - 1.0
    return find_candidates(points, np.arange(len(points)), origin, LinearitySettings())


def measure_turn(first, second):
    """Angle between two undirected azimuths."""
    return np.abs((first - second + np.pi / 2) % np.pi - np.pi / 2)


def test_toy_case_by_hand():
    # every metre along x: the one at 0 sees others from 0 to 7 in the bins of 1 m above 0
    candidates = make_candidates([[x, 0.0, 10.0] for x in range(21)], (1.0, 0.0, 0.0))
    result = align(candidates, SETTINGS)
    assert result.votes[0] == 8
    assert result.votes[10] == 15  # -7 to 7: those at 8 m are beyond the reach
    assert result.voted.all()
    np.testing.assert_allclose(result.azimuth, 0.0, atol=1e-9)
    np.testing.assert_allclose(result.slope, 0.0, atol=1e-9)
    # tiles of 8 m: 0 to 7, 8 to 15, 16 to 20
    assert np.diff(result.seed_start).tolist() == [8, 8, 5]
    assert sorted(result.seeds.tolist()) == list(range(21))


def test_votes_by_brute_force():
    candidates = find(np.vstack([
        make_wire((0.0, 0.0, 20.0), (60.0, 25.0, 22.0)), make_tree(30.0, 9.0, 19.0),
    ]))
    votes = align(candidates, SETTINGS).votes
    for number in range(0, len(votes), 5):
        apart = candidates.position - candidates.position[number]
        axis = candidates.direction[number]
        along = apart @ axis
        off = np.sqrt(np.maximum((apart**2).sum(axis=1) - along**2, 0.0))
        good = (np.abs(along) < SETTINGS.reach) & (off <= 0.3 + 0.08 * np.abs(along))
        good &= np.abs(candidates.direction @ axis) >= 0.97
        bins = np.floor((along[good] + SETTINGS.reach) * 16 / (2 * SETTINGS.reach))
        assert votes[number] == len(np.unique(np.minimum(bins, 15)))


def test_the_azimuth_is_steadier_than_that_of_one_neighbourhood():
    wire = make_wire((0.0, 0.0, 20.0), (80.0, 40.0, 21.0), noise=0.04)
    candidates = find(wire)
    result = align(candidates, SETTINGS)
    truth = np.arctan2(40, 80)
    single = np.arctan2(candidates.direction[:, 1], candidates.direction[:, 0])
    spread = np.sqrt(np.mean(measure_turn(result.azimuth, truth) ** 2))
    assert np.degrees(spread) < 1.0
    assert spread < 0.5 * np.sqrt(np.mean(measure_turn(single, truth) ** 2))


def test_a_lone_candidate_is_dropped():
    candidates = make_candidates(
        [*([x, 0.0, 10.0] for x in range(21)), [10.0, 30.0, 10.0]], (1.0, 0.0, 0.0)
    )
    result = align(candidates, SETTINGS)
    assert result.voted.tolist() == [True] * 21 + [False]
    assert 21 not in result.seeds


def test_others_across_the_direction_do_not_vote():
    candidates = make_candidates([[x, 0.0, 10.0] for x in range(21)], (0.0, 1.0, 0.0))
    assert not align(candidates, SETTINGS).voted.any()


def test_a_line_that_turns_has_both_azimuths():
    points = np.vstack([
        make_wire((0.0, 0.0, 20.0), (60.0, 0.0, 20.0)),
        make_wire((60.0, 0.0, 20.0), (112.0, 30.0, 20.0), seed=1),
    ])
    azimuth = np.degrees(align(find(points), SETTINGS).azimuth)
    assert (np.abs(azimuth) < 1.5).sum() >= 6
    assert (np.abs(azimuth - 30.0) < 1.5).sum() >= 6


def test_lines_that_cross_have_two_windows_in_one_tile():
    points = np.vstack([
        make_wire((-30.0, 4.0, 20.0), (38.0, 4.0, 20.0)),
        make_wire((4.0, -30.0, 24.0), (4.0, 38.0, 24.0), seed=1),
    ])
    result = align(find(points), SETTINGS)
    here = (np.abs(result.center[:, :2] - 4.0) < 4.0).all(axis=1)
    azimuth = result.azimuth[here]
    assert len(azimuth) == 2
    assert measure_turn(azimuth[0], azimuth[1]) == pytest.approx(np.pi / 2, abs=0.03)


@pytest.mark.parametrize('degrees', [-90, -89.9, 0, 45, 89.9, 90, 91, 180])
def test_yaw_turns_the_azimuth_and_keeps_the_slope(degrees):
    wire = make_wire((0.0, 0.0, 20.0), (80.0, 0.0, 26.0), c=1e5)
    result = align(find(turn(wire, np.radians(degrees))), SETTINGS)
    assert np.degrees(measure_turn(result.azimuth, np.radians(degrees))).max() < 2.0
    assert (result.azimuth > -np.pi / 2 - 1e-9).all()
    assert (result.azimuth <= np.pi / 2 + 1e-9).all()
    turned = np.cos(result.azimuth - np.radians(degrees)) < 0
    np.testing.assert_allclose(np.where(turned, -result.slope, result.slope), 6 / 80, atol=0.03)


def test_azimuths_on_both_sides_of_the_wrap_are_one_window():
    angles = np.radians(np.tile([89.0, -89.0], 10))
    position = np.array([[0.1, 0.35 * k, 10.0] for k in range(20)])
    direction = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(20)])
    result = align(make_candidates(position, direction), SETTINGS)
    assert result.voted.all()
    assert len(result.azimuth) == 1
    assert abs(np.degrees(result.azimuth[0])) == pytest.approx(90.0, abs=0.5)


def test_kernel_stays_inside_its_arrays(monkeypatch):
    # run as plain Python, where an index beyond an array raises; the last candidate makes
    # the grid higher than the line, which leaves it at the right
    axis = np.array([np.cos(0.5), np.sin(0.5), 0.0])
    position = np.array([0.0, 0.0, 10.0]) + np.arange(0.0, 30.0, 0.5)[:, None] * axis
    position = np.vstack([position, position[-1] + [-20.0, 5.0, 0.0]])
    candidates = make_candidates(position, axis)
    compiled = align(candidates, SETTINGS)
    monkeypatch.setattr(alignment, '_vote', alignment._vote.py_func)
    plain = align(candidates, SETTINGS)
    np.testing.assert_array_equal(plain.votes, compiled.votes)
    np.testing.assert_allclose(plain.azimuth, compiled.azimuth, atol=1e-9)


@pytest.mark.parametrize('num', [0, 1])
def test_few_candidates(num):
    result = align(make_candidates(np.ones((num, 3)), (1.0, 0.0, 0.0)), SETTINGS)
    assert result.voted.shape == result.votes.shape == (num,)
    assert result.center.shape == (0, 3)
    assert result.azimuth.shape == result.slope.shape == (0,)
    assert result.seed_start.tolist() == [0]
    assert not result.voted.any()


def test_duplicates_are_one_vote():
    candidates = make_candidates(np.tile([1.0, 2.0, 3.0], (30, 1)), (1.0, 0.0, 0.0))
    assert align(candidates, SETTINGS).votes.tolist() == [1] * 30


def test_order_and_input():
    candidates = find(make_wire((0.0, 0.0, 20.0), (60.0, 25.0, 22.0)))
    before = candidates.position.copy(), candidates.direction.copy()
    one = align(candidates, SETTINGS)
    np.testing.assert_array_equal(candidates.position, before[0])
    np.testing.assert_array_equal(candidates.direction, before[1])
    order = np.random.default_rng(0).permutation(len(before[0]))
    other = align(make_candidates(before[0][order], before[1][order]), SETTINGS)
    np.testing.assert_array_equal(other.votes, one.votes[order])
    np.testing.assert_allclose(np.sort(other.azimuth), np.sort(one.azimuth), atol=1e-6)


@pytest.mark.parametrize('change', [
    {'reach': 1.0}, {'min_votes': 17}, {'tile_size': 0.0}, {'half_length': 0.0},
    {'max_turn_deg': 0.0},
])
def test_bad_settings(change):
    with pytest.raises(ConfigError, match=next(iter(change))):
        AlignmentSettings(**change)
