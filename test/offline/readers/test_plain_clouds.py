# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""E57, PLY, text and COPC: what they hold is read, what is wrong with them is said."""

import builtins
import struct

from grid.formats import write_copc, write_e57, write_ply, write_xyz
import numpy as np
import pyproj
import pytest

from plc_inspect.errors import DataError
from plc_inspect.grid.cells.sources import read_sources
from plc_inspect.offline.readers import copc
from plc_inspect.offline.readers.clouds import load_las, read_cloud
from plc_inspect.offline.readers.plain_clouds import iterate_points

POINTS = np.round(np.random.default_rng(3).uniform([0, 0, 10], [400, 100, 40], (1500, 3)), 3)
FAR = POINTS + np.array([500_000.0, 5_700_000.0, 0.0])


def refuse(path):
    """Return the message with which a file is refused."""
    with pytest.raises(DataError) as refusal:
        read_cloud(path)
    assert '\n' not in str(refusal.value)
    assert str(path) in str(refusal.value)
    return str(refusal.value)


@pytest.mark.parametrize(('name', 'write', 'options'), [
    ('a.ply', write_ply, {}),
    ('a.PLY', write_ply, {'text': True}),
    ('a.xyz', write_xyz, {}),
    ('b.xyz', write_xyz, {'head': '//X Y Z'}),
    ('a.csv', write_xyz, {'mark': ',', 'head': '"x","y","z"'}),
    ('b.csv', write_xyz, {'mark': ';'}),
    ('c.csv', write_xyz, {'mark': '\t', 'head': '# made by hand'}),
])
def test_coordinates_are_read_as_they_are(name, write, options, tmp_path):
    cloud = read_cloud(write(tmp_path / name, FAR, **options))
    np.testing.assert_array_equal(cloud.points, FAR)
    assert 'metres assumed' in cloud.note


def test_columns_are_found_by_their_names(tmp_path):
    path = tmp_path / 'a.csv'
    path.write_text('Z,id,Y,X,note\n3,0,2,1,a\n\n# no row\n6,1,5,4,b\n')
    np.testing.assert_array_equal(read_cloud(path).points, [[1, 2, 3], [4, 5, 6]])


@pytest.mark.parametrize('rows', [
    'x,y,z\n1,2,3,\n4,5,6\n', 'x;y;z;note\n1;2;3;"a; b"\n4;5;6;c\n',
    'x y z n\n1 2 3 "a b"\n4 5 6 c\n',
    '# Fields: x y z n\n1 2 3 9\n4 5 6 9\n', '//X Y Z R\n1 2 3 9\n4 5 6 9\n',
    'x,y,z,n\n1,2,3\n4,5,6\n', 'x\ty\tz\t\n1\t2\t3\t\n4\t5\t6\t\n', 'x y z\n1 2 3 # 4 5\n4 5 6\n',
])
def test_named_columns_may_be_quoted_empty_or_missing_at_the_end(rows, tmp_path):
    path = tmp_path / 'a.csv'
    path.write_text(rows)
    np.testing.assert_array_equal(read_cloud(path).points, [[1, 2, 3], [4, 5, 6]])


def test_some_points_at_a_time_are_all_points(tmp_path):
    for path in (write_ply(tmp_path / 'a.ply', POINTS), write_xyz(tmp_path / 'a.xyz', POINTS),
                 write_e57(tmp_path / 'a.e57', POINTS)):
        parts = list(iterate_points(path, 400))
        assert [len(part) for part in parts] == [400, 400, 400, 300]
        np.testing.assert_allclose(np.concatenate(parts), POINTS, atol=1e-4)


def test_points_of_e57_stand_where_the_pose_of_their_scan_puts_them(tmp_path):
    quarter = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])  # about z
    path = write_e57(
        tmp_path / 'a.e57', POINTS, rotation=quarter, translation=np.array([5e5, 5.7e6, 0.0]),
        cartesianInvalidState=(np.arange(len(POINTS)) % 5 == 0).astype(np.int8),
    )
    cloud = read_cloud(path)
    expected = np.column_stack([5e5 - POINTS[:, 1], 5.7e6 + POINTS[:, 0], POINTS[:, 2]])
    valid = np.arange(len(POINTS)) % 5 != 0
    np.testing.assert_allclose(cloud.points[valid], expected[valid], atol=1e-4)
    assert cloud.num_not_finite == (~valid).sum()


def test_the_reference_system_of_e57_is_read(tmp_path):
    path = write_e57(tmp_path / 'a.e57', POINTS, crs=pyproj.CRS('EPSG:2992').to_wkt())
    cloud = read_cloud(path)
    assert pyproj.CRS(cloud.crs).to_epsg() == 2992
    assert cloud.metres_per_unit == (0.3048, 0.3048)
    assert cloud.note == ''
    assert read_cloud(path, 'EPSG:25832').metres_per_unit == (1.0, 1.0)
    (source,), refusals = read_sources([path])
    assert refusals == []
    assert (source.crs, source.units) == (cloud.crs, (0.3048, 0.3048))
    assert 'has an unreadable CRS' in refuse(
        write_e57(tmp_path / 'b.e57', POINTS, crs='somewhere')
    )


@pytest.mark.parametrize(('rows', 'message'), [
    ('1 2\n', 'row 1: 2 columns, 3 are needed'),
    ('1 2 3\n4 5 6\n7 8\n', 'row 3: 2 columns, 3 are needed; is it truncated? 7 8'),
    ('1 2 3\n4 five 6\n', "row 2: 'five' is not a number: 4 five 6"),
    ('1,5 2,5 3,5 4\n', 'is not a number'),
    ('a,b,c\n1,2,3\n', "has no column 'x' in its first row: a, b, c"),
    ('x,y,x,z\n1,2,3,4\n', "has 2 columns 'x' in its first row"),
    ('X,Y,Z\n# decimals\n\n980,957,1971,921,51,842\n', 'row 4: 6 columns, 3 are named; name each,'
     ' and write decimals with points: 980,957,1971,921,51,842'),
    ('"x" "y" "z"\n"1" 980.9 1971.9 51.8\n', 'row 2: 4 columns, 3 are named'),
    ('# columns x y z n\n980.9 1971.9 51.8 9\n', 'row 2: 4 columns, 5 are named'),
    ('1.00 2.00 3.00\n4.00 5.00 6.0', 'row 2, the last, has fewer decimals than others'),
    ('1.00 2.00 3.00\n \n#\n4.00 5.00 6.0', 'row 4, the last, has fewer decimals than others'),
    ('\0\1\2\n', 'has no column'),
    ('9' * 200_000, 'a row has 100001 characters'),
])
def test_text_that_is_wrong_is_refused_with_its_row(rows, message, tmp_path):
    path = tmp_path / 'a.xyz'
    path.write_text(rows)
    assert message in refuse(path)


@pytest.mark.parametrize('mark', [' ', ','])
@pytest.mark.parametrize('end', ['', ' ', '\n ', '\n\n  ', '\n# the end', ' # 2 points'])
def test_what_is_no_point_is_not_cut_off(end, mark, tmp_path):
    path = tmp_path / 'a.xyz'
    path.write_text(f'1.00 2.00 3.00\n4.00 5.00 6.00{end}'.replace(' ', mark, 4))
    assert read_cloud(path).points.shape == (2, 3)


def test_what_is_not_finite_is_counted(tmp_path):
    path = tmp_path / 'a.xyz'
    path.write_text('1 2 3\nnan 5 6\n7 inf 9\n')
    cloud = read_cloud(path)
    assert cloud.num_not_finite == 2
    assert np.isnan(cloud.points[1:]).all()


def test_an_empty_file_has_no_point(tmp_path):
    path = tmp_path / 'a.xyz'
    path.touch()
    assert read_cloud(path).points.shape == (0, 3)


def test_a_ply_file_must_hold_what_its_header_counts(tmp_path):
    for text in (False, True):
        path = write_ply(tmp_path / 'a.ply', POINTS, text=text)
        data = path.read_bytes()
        path.write_bytes(data[:len(data) // 2])
        assert 'its header counts 1500' in refuse(path)
        path.write_bytes(data + b'1 2 3\n')
        assert 'its header counts' in refuse(path)
        path.write_bytes(data.replace(b'element vertex', b'element face'))
        assert "no element 'vertex', only face" in refuse(path)
    assert "no property 'z', only x, y, q" in refuse(
        write_ply(tmp_path / 'b.ply', POINTS, names='xyq')
    )
    path.write_bytes(b'')
    assert 'damaged or truncated' in refuse(path)


def test_a_damaged_e57_file_is_refused(tmp_path):
    path = write_e57(tmp_path / 'a.e57', POINTS)
    data = path.read_bytes()
    path.write_bytes(data[:-2000])
    assert 'size in file header not same as actual' in refuse(path)
    path.write_bytes(data[:3000] + b'?' + data[3001:])
    assert 'checksum mismatch' in refuse(path)
    path.write_bytes(b'')
    assert 'is it damaged or truncated' in refuse(path)
    assert path.exists()


def test_decimals_lost_in_single_precision_are_told(tmp_path):
    ply = write_ply(tmp_path / 'a.ply', FAR, kind='f4')
    big = write_ply(tmp_path / 'big.ply', FAR, kind='>f4')
    for path in (ply, big, write_e57(tmp_path / 'a.e57', FAR)):
        assert 'in single precision have steps of 0.5:' in refuse(path)
    near = read_cloud(write_ply(tmp_path / 'b.ply', POINTS, kind='f4'))
    np.testing.assert_allclose(near.points, POINTS, atol=1e-4)


@pytest.mark.parametrize(('name', 'package', 'write'), [
    ('a.ply', 'plyfile', write_ply), ('a.e57', 'pye57', write_e57),
])
def test_a_missing_package_is_one_clear_error(name, package, write, tmp_path, monkeypatch):
    path = write(tmp_path / name, POINTS)
    load = builtins.__import__

    def refuse_one(module, *more):
        if module == package:
            raise ModuleNotFoundError(f'No module named {package!r}', name=package)
        return load(module, *more)

    monkeypatch.setattr(builtins, '__import__', refuse_one)
    assert refuse(path).endswith(
        f"needs the Python package {package}, which is missing: pip install 'plc_inspect[formats]'"
    )


def test_parts_of_a_copc_file_hold_each_point_once(tmp_path, monkeypatch):
    path = write_copc(tmp_path / 'a.copc.laz', FAR)
    las, points = load_las(path)
    assert copc.is_copc(las.header)
    assert copc.count_indexed(path) == len(FAR)
    monkeypatch.setattr(copc, 'MOST_NODES', 900)  # slabs are divided on the way
    parts = [
        np.array([record.X, record.Y, record.Z]) for part in range(3)
        for record in copc.iterate_copc(path, part, 3)
    ]
    assert len(parts) > 3
    found = np.concatenate(parts, axis=1).T
    expected = np.array([las.X, las.Y, las.Z]).T
    np.testing.assert_array_equal(
        found[np.lexsort(found.T)], expected[np.lexsort(expected.T)]
    )
    assert len(points) == len(FAR)


def test_an_index_that_is_damaged_is_refused(tmp_path):
    """And is not followed: in circles, or for as much memory as it asks for."""
    whole = write_copc(tmp_path / 'a.copc.laz', FAR).read_bytes()
    (index,) = struct.unpack_from('<Q', whole, 375 + 54 + 40)
    (root,) = struct.unpack_from('<Q', whole, index + 16)
    damages = {
        'leads back to itself': (index + 16, struct.pack('<Qii', index, 32, -1)),
        'its index has 4294967296 bytes': (375 + 54 + 48, struct.pack('<Q', 2**32)),
        'a node has': (index + 24, struct.pack('<i', 2**31 - 1)),
        'its index counts': (index + 28, struct.pack('<i', 2**31 - 1)),
        'has layers of': (root + 36 + 4, struct.pack('<I', 2**32 - 1)),
        'the box of its index': (375 + 54 + 24, struct.pack('<d', np.nan)),
    }
    for text, (place, data) in damages.items():
        path = tmp_path / 'damaged.copc.laz'
        path.write_bytes(whole[:place] + data + whole[place + len(data):])
        with pytest.raises(ValueError, match=text):
            copc.count_indexed(path)
