# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The frame of the stream, and what becomes of damaged messages."""

import struct
import zlib

from hypothesis import given, strategies
import numpy as np
import pytest

from plc_inspect.errors import DataError
from plc_inspect.stream import frame
from plc_inspect.stream.frame import (
    BodyReader,
    CLOUD,
    Frame,
    pack_frame,
    put_rows,
    put_text,
    SUMMARY,
    unpack_frame,
)

FRAME = Frame(kind=SUMMARY, flags=1, session=4_000_000_000, sequence=12, uptime=3.25,
              body=b'hello' * 50)
ROW = np.dtype([('a', '<i4'), ('b', 'u1'), ('c', '<f4')])


def test_a_frame_comes_back():
    assert unpack_frame(pack_frame(FRAME), SUMMARY) == FRAME
    assert len(pack_frame(FRAME)) < 50


@pytest.mark.parametrize(('data', 'text'), [
    (b'', 'message of 0 bytes'),
    (pack_frame(FRAME)[:10], 'message of 10 bytes'),
    (pack_frame(FRAME)[:-3], 'message 12 is cut off'),
    (b'PLCS\x09' + pack_frame(FRAME)[5:], 'stream of version 9'),
    (pack_frame(FRAME)[:20] + b'\xff\xff' + pack_frame(FRAME)[22:], 'message 12 is damaged'),
])
def test_what_is_damaged_is_refused(data, text):
    with pytest.raises(DataError, match=text):
        unpack_frame(data, SUMMARY)


def test_another_kind_is_refused():
    with pytest.raises(DataError, match="of kind b'PLCS', expected b'PLCC'"):
        unpack_frame(pack_frame(FRAME), CLOUD)


def test_what_would_unpack_to_too_much_is_refused(monkeypatch):
    monkeypatch.setattr(frame, 'LARGEST', 1000)
    bomb = pack_frame(FRAME)[:18] + zlib.compress(bytes(100_000))
    with pytest.raises(DataError, match='more than 1000 bytes'):
        unpack_frame(bomb, SUMMARY)


@given(strategies.binary(max_size=200))
def test_noise_is_refused(noise):
    for data in (noise, b'PLCS\x01' + noise):
        with pytest.raises(DataError):
            unpack_frame(data, SUMMARY)


@pytest.mark.parametrize('count', [0, 1, 5])
def test_rows_and_texts_come_back(count):
    rows = np.zeros(count, ROW)
    rows['a'], rows['b'], rows['c'] = np.arange(count) - 2, 7, 0.5
    reader = BodyReader(put_rows(rows) + put_text('Überspannung'))
    np.testing.assert_array_equal(reader.take_rows(ROW), rows)
    assert reader.take_text() == 'Überspannung'
    reader.finish()


def test_a_body_that_is_too_short_or_too_long_is_refused():
    with pytest.raises(DataError, match='ends before byte 49'):
        BodyReader(struct.pack('<I', 5)).take_rows(ROW)
    with pytest.raises(DataError, match='1 bytes too many'):
        BodyReader(b'x').finish()
