# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Damaged inputs of all readers end in a refusal, or are read; ``make fuzz`` does more of them."""

from pathlib import Path
import struct

from hypothesis import given, HealthCheck, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from plc_inspect.messages.typestore import MessageMaker
from tools.fuzz_targets import read_scan, run_target, STORE, TARGETS, WrongScanError

CORPUS = Path(__file__).parents[2] / 'tools' / 'corpus'
FAST = ('scan', 'pose', 'stream', 'spans', 'hazards', 'run')
NUM_FAST, NUM_SLOW = 150, 25
ODD = (0, 1, 127, 128, 255)
ODD_WORDS = (0, 1, 2**16, 2**31 - 1, 2**31, 2**32 - 1)


def read_seed(target):
    """Return the input of the corpus."""
    return (CORPUS / target / 'seed').read_bytes()


@st.composite
def damages(draw, seed):
    """Return the seed with some bytes changed, cut out, repeated, or the end lost."""
    data = bytearray(seed)
    for _ in range(draw(st.integers(1, 5))):
        place = draw(st.integers(0, max(len(data) - 1, 0)))
        kind = draw(st.integers(0, 4))
        if kind == 0 and data:
            data[place] = draw(st.sampled_from(ODD) | st.integers(0, 255))
        elif kind == 1:
            word = draw(st.sampled_from(ODD_WORDS) | st.integers(0, 2**32 - 1))
            data[place : place + 4] = struct.pack('<I', word)
        elif kind == 2:
            del data[place : place + draw(st.integers(1, 20))]
        elif kind == 3:
            data[place:place] = data[place : place + draw(st.integers(1, 40))]
        elif kind == 4:
            del data[place:]
    return bytes(data)


def test_every_target_has_its_input():
    assert {path.name for path in CORPUS.iterdir()} == set(TARGETS)
    assert sum(path.stat().st_size for path in CORPUS.rglob('*')) < 200_000


@pytest.mark.parametrize('target', TARGETS)
def test_the_input_is_taken(target):
    assert run_target(target, read_seed(target)) == ''


@pytest.mark.parametrize('target', TARGETS)
def test_damaged_inputs_are_refused_or_read(target):
    most = NUM_FAST if target in FAST else NUM_SLOW

    @settings(max_examples=most, deadline=None, derandomize=True, database=None,
              suppress_health_check=list(HealthCheck))
    @given(damages(read_seed(target)))
    def check(data):
        run_target(target, data)  # any error but a refusal fails

    check()


def test_another_decoder_watches_scans(monkeypatch):
    message = STORE.deserialize_cdr(read_seed('scan'), 'sensor_msgs/msg/PointCloud2')
    data = np.array(message.data)
    data[3] ^= 0x40
    message.data = data
    raw = bytes(MessageMaker().serialize(message, 'sensor_msgs/msg/PointCloud2'))
    read_scan(raw)
    monkeypatch.setattr('tools.fuzz_targets._decode', lambda message: [[1.0, 2.0, 3.0]])
    with pytest.raises(WrongScanError, match='1 points are there'):
        read_scan(raw)
