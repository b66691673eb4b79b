# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest

from plc_inspect.errors import DataError
from plc_inspect.offline.readers.pcd import read_pcd

HEADER = """# .PCD v0.7 - Point Cloud Data file format
VERSION 0.7
FIELDS {fields}
SIZE {sizes}
TYPE {types}
COUNT {counts}
WIDTH {width}
HEIGHT {height}
VIEWPOINT 0 0 0 1 0 0 0
POINTS {points}
DATA {encoding}
"""
POINTS = np.array([[1.5, -2.25, 3.125], [4.0, 5.0, 6.5], [np.nan, 7.0, 8.0], [0.0, -0.5, 9.0]])


def make_header(encoding, num_points=4, **changes):
    """Describe points of normal (3 floats), intensity (uint16), x (double), z and y (float)."""
    values = {
        'fields': 'normal intensity x z y', 'sizes': '4 2 8 4 4', 'types': 'F U F F F',
        'counts': '3 1 1 1 1', 'width': num_points, 'height': 1, 'points': num_points,
        'encoding': encoding,
    }
    return HEADER.format(**(values | changes)).encode()


def make_records():
    kinds = [('normal', '<f4', 3), ('intensity', '<u2'), ('x', '<f8'), ('z', '<f4'), ('y', '<f4')]
    records = np.zeros(4, kinds)
    records['normal'] = 0.577
    records['intensity'] = [1, 2, 3, 4]
    for axis, name in enumerate('xyz'):
        records[name] = POINTS[:, axis]
    return records


def compress_with_repeats(data):
    """Pack into LZF, greedily, with short and long references and literal runs."""
    out, literal, i = bytearray(), bytearray(), 0

    def flush():
        for start in range(0, len(literal), 32):
            run = literal[start : start + 32]
            out.extend([len(run) - 1, *run])
        literal.clear()

    while i < len(data):
        best, distance = 0, 0
        for back in range(1, min(i, 8191) + 1):
            length = 0
            while length < 264 and i + length < len(data) and (
                data[i + length] == data[i - back + length]
            ):
                length += 1
            if length > best:
                best, distance = length, back
        if best < 3:
            literal.append(data[i])
            i += 1
            continue
        flush()
        offset, length = distance - 1, best - 2
        if length < 7:
            out.extend([length << 5 | offset >> 8, offset & 255])
        else:
            out.extend([7 << 5 | offset >> 8, length - 7, offset & 255])
        i += best
    flush()
    return bytes(out)


def pack(records):
    plain = b''.join(np.ascontiguousarray(records[name]).tobytes() for name in records.dtype.names)
    packed = compress_with_repeats(plain)
    return np.array([len(packed), len(plain)], '<u4').tobytes() + packed


def write(tmp_path, data):
    path = tmp_path / 'cloud.pcd'
    path.write_bytes(data)
    return path


def make_data(encoding):
    records = make_records()
    if encoding == 'ascii':
        rows = [
            ' '.join([*map(str, r['normal']), str(r['intensity']), *(str(r[n]) for n in 'xzy')])
            for r in records
        ]
        return '\n'.join([*rows, '']).encode()
    return records.tobytes() if encoding == 'binary' else pack(records)


@pytest.mark.parametrize('encoding', ['ascii', 'binary', 'binary_compressed'])
def test_encodings(encoding, tmp_path):
    path = write(tmp_path, make_header(encoding) + make_data(encoding))
    np.testing.assert_array_equal(read_pcd(path), POINTS)


def test_long_compressed_runs(tmp_path):
    rng = np.random.default_rng(0)
    values = np.repeat(rng.normal(size=40).astype('<f4'), 30).reshape(-1, 3)
    records = np.zeros(len(values), [(name, '<f4') for name in 'xyz'])
    for axis, name in enumerate('xyz'):
        records[name] = values[:, axis]
    header = make_header(
        'binary_compressed', len(values), fields='x y z', sizes='4 4 4', types='F F F',
        counts='1 1 1',
    )
    np.testing.assert_array_equal(read_pcd(write(tmp_path, header + pack(records))), values)


def test_large_coordinates_in_double_precision(tmp_path):
    points = np.array([[512_345.678, 6_123_456.789, 123.456]])
    header = make_header(
        'binary', 1, fields='x y z', sizes='8 8 8', types='F F F', counts='1 1 1'
    )
    np.testing.assert_array_equal(read_pcd(write(tmp_path, header + points.tobytes())), points)


@pytest.mark.parametrize('encoding', ['binary', 'binary_compressed'])
def test_decimals_lost_in_single_precision_are_told(encoding, tmp_path):
    records = np.zeros(2, [(name, '<f4') for name in 'xyz'])
    records['y'] = 5_400_000.123
    header = make_header(
        encoding, 2, fields='x y z', sizes='4 4 4', types='F F F', counts='1 1 1'
    )
    path = write(tmp_path, header + (records.tobytes() if encoding == 'binary' else pack(records)))
    with pytest.raises(DataError) as error:
        read_pcd(path)
    assert str(error.value) == (
        f'{path}: coordinates up to 5400000 in single precision have steps of 0.5: write them in'
        ' double precision, or relative to a nearby origin'
    )


@pytest.mark.parametrize('encoding', ['ascii', 'binary', 'binary_compressed'])
def test_no_points(encoding, tmp_path):
    assert read_pcd(write(tmp_path, make_header(encoding, 0))).shape == (0, 3)


@pytest.mark.parametrize('encoding', ['ascii', 'binary', 'binary_compressed'])
def test_truncated_anywhere(encoding, tmp_path):
    whole = make_header(encoding) + make_data(encoding)
    for size in range(0, len(whole) - 5, 7):
        path = write(tmp_path, whole[:size])
        with pytest.raises(DataError, match=r'cloud\.pcd'):
            read_pcd(path)


@pytest.mark.parametrize(('encoding', 'count', 'message'), [
    ('ascii', 3, 'holds 4 points, its header says 3'),
    ('ascii', 0, 'holds 4 points, its header says 0'),
    ('binary', 3, 'holds 30 bytes behind the 3 points that its header counts, of 30 bytes each'),
    ('binary', 0, 'holds 120 bytes behind the 0 points'),
    ('binary_compressed', 3, 'unpacks to 120 bytes, its header says 90'),
])
def test_more_points_than_the_header_counts(encoding, count, message, tmp_path):
    path = write(tmp_path, make_header(encoding, count) + make_data(encoding))
    with pytest.raises(DataError, match=message):
        read_pcd(path)


def test_a_last_page_of_zeros_holds_no_points(tmp_path):
    """PCL before 1.8 made files longer than their points, and mapped them."""
    path = write(tmp_path, make_header('binary') + make_data('binary') + bytes(4000))
    np.testing.assert_array_equal(read_pcd(path), POINTS)


def test_damaged_compressed_data_never_read_or_write_outside(tmp_path):
    rng = np.random.default_rng(1)
    header, data = make_header('binary_compressed'), make_data('binary_compressed')
    num_errors = 0
    for _ in range(300):
        damaged = bytearray(data)
        damaged[rng.integers(8, len(data))] = rng.integers(256)
        try:
            assert read_pcd(write(tmp_path, header + damaged)).shape == (4, 3)
        except DataError:
            num_errors += 1
    assert 0 < num_errors < 300


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'fields': 'normal intensity x z w'}, "no field 'y'"),
        ({'fields': 'x y z'}, 'do not agree'),
        ({'types': 'F U F F Q'}, 'malformed'),
        ({'sizes': '4 2 8 4 three'}, 'malformed'),
        ({'sizes': '4 2 3 4 4'}, 'malformed'),
        ({'counts': '3 1 1 1 0'}, 'do not agree'),
        ({'points': 5}, '5 points are not 4 x 1'),
        ({'width': -4, 'points': -4}, 'are not'),
        ({'encoding': 'rot13'}, "unknown PCD encoding 'rot13'"),
    ],
)
def test_bad_header(changes, message, tmp_path):
    header = make_header(**({'encoding': 'binary'} | changes))
    path = write(tmp_path, header + make_data('binary'))
    with pytest.raises(DataError, match=message):
        read_pcd(path)


def test_not_a_pcd(tmp_path):
    with pytest.raises(DataError, match='not a PCD file'):
        read_pcd(write(tmp_path, b'\x00\xff' * 500))
