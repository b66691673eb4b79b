# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Cells and blocks of the thinned corridor, against a plain reckoning."""

import math

from hypothesis import given, settings, strategies
import numpy as np
import pytest

from plc_inspect.errors import DataError
from plc_inspect.stream.blocks import (
    coarsen,
    count_changes,
    find_home,
    join_codes,
    merge_codes,
    pack_blocks,
    place_cells,
    read_cloud,
    split_codes,
    thin_points,
)
from plc_inspect.stream.frame import CLOUD, Frame, pack_frame


def thin(points, kind=5, clearance=2.0, voxel=0.5):
    """Thin points of one class and clearance, or of many; return codes by block."""
    points = np.array(points, float).reshape(-1, 3)
    kind = np.broadcast_to(np.array(kind, np.uint8), len(points))
    clearance = np.broadcast_to(np.array(clearance, np.float32), len(points))
    cells = thin_points(points, kind, clearance, voxel)
    return {
        tuple(key): cells.codes[low:high] for key, low, high in zip(
            cells.blocks.tolist(), cells.starts[:-1], cells.starts[1:], strict=True
        )
    }


def show(blocks, voxel=0.5):
    """Return cells by their place."""
    cells = {}
    for key, codes in blocks.items():
        for point, kind, near in zip(*place_cells(key, codes, voxel), strict=True):
            place = tuple(np.floor(point / voxel).astype(int).tolist())
            assert place not in cells
            cells[place] = int(kind), float(near)
    return cells


def send(blocks, **changes):
    """Return blocks as they come in."""
    values = {'overview': False, 'voxel': 0.5, 'total': 9} | changes
    return read_cloud(pack_frame(Frame(
        kind=CLOUD, flags=0, session=1, sequence=0, uptime=1.0,
        body=pack_blocks(blocks, **values),
    )))


def test_nothing_gives_nothing():
    assert thin([]) == {}
    assert send({}).blocks == {}


def test_one_point_is_one_cell_also_below_zero():
    assert show(thin([[0.2, 0.3, -0.1]])) == {(0, 0, -1): (5, 2.0)}
    blocks = thin([[-0.2, -8.3, 100.1]])
    assert list(blocks) == [(-1, -2)]
    assert show(blocks) == {(-1, -17, 200): (5, 2.0)}


def test_a_cell_is_its_point_that_is_nearest_to_a_conductor():
    blocks = thin([[0.1, 0.1, 0.1], [0.2, 0.1, 0.1], [0.3, 0.1, 0.1]], [2, 5, 14],
                  [3.0, 0.61, math.nan])
    assert show(blocks) == {(0, 0, 0): (5, pytest.approx(0.6))}
    ((_, near),) = show(thin([[0.1, 0.1, 0.1]], 2, 70.0)).values()
    assert math.isnan(near)


@settings(max_examples=25, deadline=None)
@given(strategies.integers(0, 2**32 - 1), strategies.sampled_from([0.3, 0.5, 2.0]))
def test_cells_are_those_of_a_plain_reckoning(seed, voxel):
    rng = np.random.default_rng(seed)
    points = rng.uniform((-40.0, -9.0, -5.0), (40.0, 9.0, 20.0), (rng.integers(1, 400), 3))
    kind = rng.choice([2, 5, 14], len(points)).astype(np.uint8)
    clearance = (rng.integers(0, 60, len(points)) * 0.2).astype(np.float32)
    kept = points.copy(), kind.copy(), clearance.copy()
    plain = {}
    for point, near in zip(points, clearance, strict=True):
        place = tuple(np.floor(point / voxel).astype(int).tolist())
        plain[place] = min(plain.get(place, math.inf), float(near))
    found = show(thin(points, kind, clearance, voxel), voxel)
    assert {place: near for place, (_, near) in found.items()} == pytest.approx(plain)
    order = rng.permutation(len(points))
    again = show(thin(points[order], kind[order], clearance[order], voxel), voxel)
    assert {place: near for place, (_, near) in again.items()} == pytest.approx(plain)
    for before, now in zip(kept, (points, kind, clearance), strict=True):
        np.testing.assert_array_equal(before, now)


def test_blocks_come_back_from_a_message():
    rng = np.random.default_rng(0)
    blocks = thin(rng.uniform((-30, -30, -200), (30, 30, 300), (3000, 3)),
                  rng.choice([2, 5, 15], 3000), rng.uniform(0, 60, 3000))
    blocks[99, -99] = np.empty(0, np.uint64)
    message = send(blocks, overview=True, voxel=4.0, total=77)
    assert (message.overview, message.voxel, message.total) == (True, 4.0, 77)
    assert set(message.blocks) == set(blocks)
    for key, codes in blocks.items():
        np.testing.assert_array_equal(message.blocks[key], codes)


def test_codes_can_be_split_and_joined():
    values = [np.array(item) for item in ([0, 255, 7], [-3, 0, 900], [2, 5, 14], [0, 255, 9])]
    for there, back in zip(values, split_codes(join_codes(*values)), strict=True):
        np.testing.assert_array_equal(there, back)


def test_the_overview_stands_for_the_same_places():
    rng = np.random.default_rng(3)
    points = rng.uniform((-70, -70, -10), (70, 70, 25), (4000, 3))
    near = rng.uniform(0, 20, 4000).astype(np.float32)
    blocks = thin(points, 5, near)
    homes = {}
    for key, codes in blocks.items():
        homes.setdefault(find_home(key), []).append((key, codes))
    rough = show({home: coarsen(home, items) for home, items in homes.items()}, 4.0)
    plain = {}
    for point, value in zip(points, near, strict=True):
        place = tuple(np.floor(point / 4.0).astype(int).tolist())
        plain[place] = min(plain.get(place, math.inf), round(float(value) / 0.2) * 0.2)
    assert {place: value for place, (_, value) in rough.items()} == pytest.approx(plain)
    assert len(coarsen((0, 0), [((0, 0), np.empty(0, np.uint64))])) == 0


def test_changes_are_counted_but_not_tremors():
    (old,) = thin([[0.1, 0.1, 0.1], [0.6, 0.1, 0.1], [1.1, 0.1, 0.1]], 5, [1.0, 2.0, 3.0]).values()
    (near,) = thin([[0.1, 0.1, 0.1], [0.6, 0.1, 0.1], [1.1, 0.1, 0.1]], 5,
                   [1.2, 2.0, 2.8]).values()
    assert count_changes(old, near) == 0
    (new,) = thin([[0.1, 0.1, 0.1], [0.6, 0.1, 0.1], [2.1, 0.1, 0.1]], [2, 5, 5],
                  [1.0, 2.6, 3.0]).values()
    assert count_changes(old, new) == 4
    assert count_changes(old, old) == 0


def test_merging_keeps_what_is_not_replaced():
    (old,) = thin([[0.1, 0.1, 0.1], [0.6, 0.1, 0.1]], 5, [1.0, 2.0]).values()
    (new,) = thin([[0.6, 0.1, 0.1], [1.1, 0.1, 0.1]], 5, [4.0, 3.0]).values()
    merged = show({(0, 0): merge_codes(old, new)})
    assert merged == {
        (0, 0, 0): (5, 1.0), (1, 0, 0): (5, 4.0), (2, 0, 0): (5, pytest.approx(3.0)),
    }
    np.testing.assert_array_equal(merge_codes(np.empty(0, np.uint64), new), new)


def test_damaged_bodies_are_refused():
    body = pack_blocks(thin([[0.1, 0.1, 0.1]]), overview=False, voxel=0.5, total=1)
    bad_column = pack_blocks(
        {(0, 0): join_codes(*(np.array(v) for v in ([200, 290], [0, 0], [5, 5], [1, 1])))},
        overview=False, voxel=0.5, total=1,
    )
    no_voxel = pack_blocks({}, overview=False, voxel=0.0, total=1)
    least = [
        pack_blocks({}, overview=True, voxel=0.05, total=1),
        pack_blocks({}, overview=False, voxel=0.009, total=1),
    ]
    for bad in (body[:-1], body + b'x', b'', no_voxel, bad_column, *least):
        with pytest.raises(DataError):
            read_cloud(pack_frame(Frame(kind=CLOUD, flags=0, session=1, sequence=0, uptime=0.0,
                                        body=bad)))


@pytest.mark.parametrize(('overview', 'voxel'), [(False, 0.01), (True, 0.08), (False, 0.1)])
def test_smallest_cells_are_read(overview, voxel):
    body = pack_blocks({}, overview=overview, voxel=voxel, total=1)
    frame = Frame(kind=CLOUD, flags=0, session=1, sequence=0, uptime=0.0, body=body)
    assert read_cloud(pack_frame(frame)).voxel == voxel
