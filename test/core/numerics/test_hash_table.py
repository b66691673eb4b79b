# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Tables of keys against a dictionary, with keys of one hash and with chains of such."""

import numpy as np
import pytest

from plc_inspect.core.numerics.hash_table import (
    enter,
    find_slot,
    forget_key,
    hash_key,
    index_keys,
    make_table,
    size_table,
)


def make_alike(num, bits=4):
    """Return keys whose hashes have the same last bits, so that all want one place."""
    alike = []
    key = 0
    while len(alike) < num:
        if hash_key(key) & ((1 << bits) - 1) == 3:
            alike.append(key)
        key += 1
    return np.array(alike)


@pytest.mark.parametrize(('num', 'size'), [
    (0, 16), (8, 16), (9, 32), (1 << 20, 1 << 21), ((1 << 20) + 1, 1 << 22),
])
def test_at_most_half_of_a_table_is_used(num, size):
    assert size_table(num) == size
    if num < 100:
        assert make_table(num).tolist() == [0] * size


@pytest.mark.parametrize('seed', range(5))
def test_keys_are_found_at_their_slots_and_others_are_not(seed):
    rng = np.random.default_rng(seed)
    keys = np.unique(rng.integers(-2**62, 2**62, 500))
    rng.shuffle(keys)
    table = index_keys(keys, len(keys))
    assert [find_slot(key, table, keys) for key in keys] == list(range(len(keys)))
    assert all(find_slot(key + 1, table, keys) == -1 for key in keys if key + 1 not in keys)


def test_without_keys_nothing_is_found():
    keys = np.empty(0, dtype=np.int64)
    assert find_slot(5, index_keys(keys, 0), keys) == -1


def test_keys_that_want_one_place_stand_apart():
    keys = make_alike(8)
    table = index_keys(keys, 8)
    assert [find_slot(key, table, keys) for key in keys] == list(range(8))
    assert find_slot(make_alike(9)[-1], table, keys) == -1


@pytest.mark.parametrize('gone', range(8))
def test_what_is_forgotten_leaves_the_others_to_be_found(gone):
    keys = make_alike(8)
    table = index_keys(keys, 8)
    forget_key(keys[gone], table, keys)
    expected = [-1 if slot == gone else slot for slot in range(8)]
    assert [find_slot(key, table, keys) for key in keys] == expected
    enter(keys[gone], gone, table)
    assert [find_slot(key, table, keys) for key in keys] == list(range(8))


@pytest.mark.parametrize('seed', range(5))
def test_coming_and_going_against_a_dictionary(seed):
    rng = np.random.default_rng(seed)
    keys = np.unique(rng.integers(0, 5000, 300))
    table, known = make_table(len(keys)), {}
    for slot in rng.integers(0, len(keys), 3000).tolist():
        if known.pop(slot, None) is None:
            enter(keys[slot], slot, table)
            known[slot] = keys[slot]
        else:
            forget_key(keys[slot], table, keys)
    found = [find_slot(key, table, keys) for key in keys]
    assert found == [slot if slot in known else -1 for slot in range(len(keys))]
    assert np.count_nonzero(table) == len(known)


@pytest.mark.parametrize('shape', [(400, 400, 1), (400, 1, 400), (1, 400, 400), (54, 54, 54)])
@pytest.mark.parametrize(('bits', 'step'), [(21, 1), (21, 8), (20, 1), (21, 512)])
def test_neighbours_in_space_are_spread(shape, bits, step):
    places = np.stack(np.meshgrid(*map(np.arange, shape), indexing='ij'), axis=-1).reshape(-1, 3)
    column, row, layer = (places * step).T
    keys = (column << 2 * bits) | (row << bits) | layer
    mask = size_table(len(keys)) - 1
    home = np.array([hash_key(key) & mask for key in keys])
    assert np.bincount(home).max() <= 9
    assert len(np.unique(home)) > 0.7 * len(keys)
