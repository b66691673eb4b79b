# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What changed in the map, taken again and again, adds up to the map."""

import numpy as np
import pytest

from plc_inspect.config import MapSettings
from plc_inspect.core.voxel_buffer.change_flags import LABELLED, MADE, TOUCHED
from plc_inspect.core.voxel_buffer.voxel_changes import find_doubles, StoredMap
from plc_inspect.core.voxel_buffer.voxel_map import VoxelMap
from plc_inspect.errors import DataError

NOTHING = np.zeros(256, dtype=np.bool_)
SETTINGS = MapSettings(max_voxels=50_000, voxel_size=0.5)


class Store:
    """Keeps of each slot what was told last."""

    def __init__(self):
        self.rows = {}

    def take(self, voxels, most=1000, **options):
        """Take all changes, a part at a time."""
        at = 0
        while at < voxels.num_slots:
            part, at = voxels.take_changes(at, most, **options)
            assert len(part.slots) <= most
            for k, slot in enumerate(part.slots.tolist()):
                self.rows[slot] = (
                    part.keys[k], part.counts[k], part.means[k], part.labels[k]
                )

    def build(self, voxels):
        """Return all of it as a stored map."""
        size = voxels.num_slots
        assert sorted(self.rows) == list(range(size))
        columns = zip(*(self.rows[slot] for slot in range(size)), strict=True)
        keys, counts, means, labels = (np.array(column) for column in columns)
        cell_keys, cell_state = voxels.cells.copy_state()
        return StoredMap(
            keys=keys, counts=counts, means=means, labels=labels, origin=voxels.origin,
            sequence=voxels.sequence, moved=True, cell_keys=cell_keys, cell_state=cell_state,
        )


def check_same(one, other):
    """Check that two maps hold the same, slot by slot, and find the same in their cells."""
    assert one.num_slots == other.num_slots
    assert one.centroids().tobytes() == other.centroids().tobytes()
    assert one.counts().tolist() == other.counts().tolist()
    assert one.cells.index.tolist() == other.cells.index.tolist()
    assert one.cells.count.tolist() == other.cells.count.tolist()
    assert one.cells.low.tolist() == other.cells.low.tolist()
    everything = np.arange(len(one.cells))
    for label in (0, 7):
        wanted = np.zeros(256, dtype=np.uint8)
        wanted[label] = 1
        found = [sorted(item.collect(everything, wanted).tolist()) for item in (one, other)]
        assert found[0] == found[1]


@pytest.mark.parametrize('drops', [False, True])
def test_changes_add_up_to_the_map_and_it_goes_on_the_same(drops):
    rng = np.random.default_rng(0)
    voxels, store = VoxelMap(SETTINGS), Store()
    for step in range(12):
        voxels.insert(rng.uniform(-15, 15, (2000, 3)) + np.array([3.0 * step, 0.0, 0.0]))
        if drops and step % 4 == 3:
            voxels.drop(step // 4, NOTHING)
            voxels.order_free()
        slots, points = voxels.copy_voxels(np.arange(0, voxels.num_slots, 7, dtype=np.int32))
        voxels.label(slots, points, np.full(len(slots), 7, dtype=np.uint8))
        store.take(voxels)
    other = VoxelMap(SETTINGS)
    other.restore(store.build(voxels))
    check_same(voxels, other)
    more = rng.uniform(-15, 15, (3000, 3))
    one, two = voxels.insert(more), other.insert(more)
    assert one == two
    check_same(voxels, other)


def test_nothing_is_told_twice_unless_it_is_asked_for():
    voxels, store = VoxelMap(SETTINGS), Store()
    voxels.insert(np.random.default_rng(1).uniform(-5, 5, (500, 3)))
    store.take(voxels)
    part, at = voxels.take_changes(0, 1000)
    assert (len(part.slots), at) == (0, voxels.num_slots)
    part, at = voxels.take_changes(3, 10, everything=True)
    assert part.slots.tolist() == list(range(3, 13))
    assert at == 13
    assert set(part.kinds.tolist()) == {TOUCHED | MADE | LABELLED}


def test_kinds_of_changes():
    voxels = VoxelMap(SETTINGS)
    voxels.insert(np.array([[0.1, 0.1, 0.1], [3.0, 0.1, 0.1], [6.0, 0.1, 0.1]]))
    voxels.take_changes(0, 10)
    voxels.insert(np.array([[0.2, 0.1, 0.1], [9.0, 0.1, 0.1]]))
    slots, points = voxels.copy_voxels(np.array([2], dtype=np.int32))
    voxels.label(slots, points, np.array([5], dtype=np.uint8))
    part, _ = voxels.take_changes(0, 10)
    assert dict(zip(part.slots.tolist(), part.kinds.tolist(), strict=True)) == {
        0: TOUCHED, 2: LABELLED, 3: TOUCHED | MADE
    }


def test_of_a_voxel_that_is_there_twice_the_fuller_one_stays():
    keys = np.array([5, 9, 5, 7, 9])
    counts = np.array([1, 4, 3, 2, 0], dtype=np.uint32)
    assert find_doubles(keys, counts).tolist() == [0]


def test_map_without_room_is_left_as_it_was():
    voxels, store = VoxelMap(SETTINGS), Store()
    voxels.insert(np.random.default_rng(1).uniform(-50, 50, (2000, 3)))
    store.take(voxels)
    small = VoxelMap(MapSettings(max_voxels=1000, voxel_size=0.5))
    small.insert(np.zeros((1, 3)))
    with pytest.raises(DataError, match='max_voxels is 1000'):
        small.restore(store.build(voxels))
    assert len(small) == 1
