# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import math
from pathlib import Path
import re
import struct

import hypothesis
from hypothesis import given
from hypothesis import strategies as st
import laspy
import numpy as np
import pyproj
import pytest

from plc_inspect.errors import ConfigError, DataError
from plc_inspect.grid.cells.sources import read_sources
from plc_inspect.grid.survey_grid import check_together
from plc_inspect.offline.readers.clouds import read_cloud

REAL = Path(__file__).parents[4] / 'shared' / 'data' / 'real'
US_FOOT = 1200 / 3937


def write_las(path, points, crs=None, version='1.4', offset=(5e5, 6e6, 0)):
    header = laspy.LasHeader(point_format=6 if version == '1.4' else 1, version=version)
    header.scales, header.offsets = np.full(3, 0.001), np.array(offset, float)
    if crs is not None:
        header.add_crs(pyproj.CRS(crs))
    las = laspy.LasData(header)
    las.x, las.y, las.z = np.asarray(points, float).T.reshape(3, -1)
    las.intensity = np.arange(len(points)) % 1000
    las.write(path)
    return path


def make_points(num_points=200, corner=(500_000, 6_000_000, 50)):
    points = np.array(corner) + np.random.default_rng(0).uniform(0, 100, (num_points, 3))
    return points.round(3)


@pytest.mark.parametrize('suffix', ['.las', '.laz', '.LAZ'])
@pytest.mark.parametrize('version', ['1.2', '1.4'])
def test_utm_coordinates_lose_nothing(suffix, version, tmp_path):
    points = make_points()
    path = write_las(tmp_path / f'cloud{suffix}', points, version=version)
    cloud = read_cloud(path)
    np.testing.assert_allclose(cloud.points, points, rtol=0, atol=1e-6)
    assert cloud.points.dtype == np.float64
    assert (cloud.crs, cloud.metres_per_unit, cloud.num_not_finite) == ('', (1.0, 1.0), 0)
    assert cloud.las.intensity.tolist() == list(range(200))


@pytest.mark.parametrize(
    ('crs', 'horizontal', 'vertical'),
    [
        ('EPSG:32633', 1.0, 1.0),
        ('EPSG:2225', US_FOOT, US_FOOT),
        ('EPSG:2992', 0.3048, 0.3048),
        ('EPSG:2225+6360', US_FOOT, US_FOOT),
        ('EPSG:2225+5703', US_FOOT, 1.0),
        ('EPSG:32610+8228', 1.0, 0.3048),
    ],
)
@pytest.mark.parametrize('override', [False, True])
def test_units_follow_the_crs(crs, horizontal, vertical, override, tmp_path):
    points = make_points()
    path = write_las(tmp_path / 'cloud.las', points, crs='EPSG:3006' if override else crs)
    cloud = read_cloud(path, crs if override else None)
    assert cloud.metres_per_unit == pytest.approx((horizontal, vertical), rel=1e-12)
    scale = np.array([horizontal, horizontal, vertical])
    np.testing.assert_allclose(cloud.points, points * scale, rtol=0, atol=1e-6)
    assert pyproj.CRS(cloud.crs).name == pyproj.CRS(crs).name


def make_geo_keys(*keys):
    numbers = [1, 1, 0, len(keys)]
    for key, value in keys:
        numbers += [key, 0, 1, value]
    data = np.array(numbers, '<u2').tobytes()
    return laspy.VLR('LASF_Projection', 34735, '', data)


@pytest.mark.parametrize(
    ('keys', 'units'),
    [
        ([(3072, 2992), (4099, 9001)], (0.3048, 1.0)),
        ([(3072, 2992)], (0.3048, 0.3048)),
        ([(3072, 32767), (3076, 9003)], (US_FOOT, US_FOOT)),
        ([(3076, 9003), (4099, 9002)], (US_FOOT, 0.3048)),
        ([(1024, 1)], (1.0, 1.0)),
    ],
)
def test_units_of_geotiff_keys(keys, units, tmp_path):
    header = laspy.LasHeader(point_format=1, version='1.2')
    header.scales = np.full(3, 0.001)
    header.vlrs.append(make_geo_keys(*keys))
    las = laspy.LasData(header)
    las.x, las.y, las.z = np.ones((3, 4))
    las.write(tmp_path / 'cloud.las')
    assert read_cloud(tmp_path / 'cloud.las').metres_per_unit == pytest.approx(units, rel=1e-12)


def write_keys(path, *keys):
    """Write points with GeoTIFF keys."""
    header = laspy.LasHeader(point_format=1, version='1.2')
    header.vlrs.append(make_geo_keys(*keys))
    las = laspy.LasData(header)
    las.x, las.y, las.z = np.full((3, 4), 12_000.0)
    las.write(path)
    return path


@pytest.mark.parametrize(('keys', 'message'), [
    ([(3072, 26910), (3076, 9003)],
     'its GeoTIFF keys contradict: one unit of NAD83 / UTM zone 10N is 1 m, of key 3076 0.304801 m'
     ': give --crs'),
    ([(3072, 2992), (3076, 9001)], 'is 0.3048 m, of key 3076 1 m: give --crs'),
    ([(2048, 4269), (3072, 32767), (3076, 9003)],
     'its CRS is user-defined (GeoTIFF key 3072 is 32767), based on NAD83: give --crs'),
    ([(2048, 4269)], 'coordinates in NAD83 are not lengths east, north and up'),
])
def test_keys_that_do_not_say_where_points_are(keys, message, tmp_path):
    path = write_keys(tmp_path / 'cloud.las', *keys)
    with pytest.raises(DataError, match=re.escape(message)):
        read_cloud(path)
    assert read_cloud(path, 'EPSG:2992').metres_per_unit == (0.3048, 0.3048)


def test_the_two_feet_do_not_contradict(tmp_path):
    path = write_keys(tmp_path / 'cloud.las', (3072, 2992), (3076, 9003))
    assert read_cloud(path).metres_per_unit == (0.3048, 0.3048)


def test_wkt_goes_before_keys(tmp_path):
    las = laspy.read(write_keys(tmp_path / 'cloud.las', (3072, 26910), (3076, 9003)))
    wkt = pyproj.CRS('EPSG:2992').to_wkt('WKT1_GDAL')
    las.header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(wkt))
    las.write(tmp_path / 'both.las')
    assert read_cloud(tmp_path / 'both.las').metres_per_unit == (0.3048, 0.3048)


def test_a_unit_of_z_alone_is_told(tmp_path):
    path = write_keys(tmp_path / 'cloud.las', (4099, 9002))
    cloud = read_cloud(path)
    text = 'metres assumed for x and y, z is in units of 0.3048 m by its GeoTIFF key'
    assert cloud.note.endswith(text)
    assert cloud.metres_per_unit == (1.0, 0.3048)
    ((source,), _) = read_sources([path])
    assert source.note.endswith(text)
    assert source.low == pytest.approx((12_000.0, 12_000.0, 3657.6))
    cloud = read_cloud(path, unit=0.3048)
    ((source,), _) = read_sources([path], unit=0.3048)
    assert cloud.note == source.note == ''
    assert source.low == tuple(cloud.points[0]) == pytest.approx((3657.6,) * 3)


@pytest.mark.parametrize(('keys', 'heights', 'units'), [
    ([(3072, 2992), (4096, 5703)], 'NAVD88 height', (0.3048, 1.0)),
    ([(3072, 2992), (4096, 6360), (4099, 9003)], 'NAVD88 height (ftUS)', (0.3048, US_FOOT)),
    ([(3072, 2992), (4096, 5703), (4099, 9002)], '', (0.3048, 0.3048)),  # they disagree
    ([(3072, 2992), (4096, 5103)], '', (0.3048, 0.3048)),  # the number of a datum
    ([(3072, 25832), (4099, 9002)], 'heights', (1.0, 0.3048)),  # a unit without a system
    ([(3072, 25832), (4096, 5703), (4099, 9003)], 'heights', (1.0, US_FOOT)),
])
def test_the_vertical_system_of_geotiff_keys(keys, heights, units, tmp_path):
    header = laspy.LasHeader(point_format=1, version='1.2')
    header.vlrs.append(make_geo_keys(*keys))
    laspy.LasData(header).write(tmp_path / 'cloud.las')
    cloud = read_cloud(tmp_path / 'cloud.las')
    assert cloud.metres_per_unit == pytest.approx(units, rel=1e-12)
    parts = pyproj.CRS(cloud.crs).sub_crs_list
    assert [part.name for part in parts[1:]] == ([heights] if heights else [])
    again = read_cloud(write_las(tmp_path / 'again.laz', make_points(), crs=cloud.crs))
    assert again.metres_per_unit == pytest.approx(units, rel=1e-12)


def test_keys_and_wkt_of_one_system_are_one(tmp_path):
    keys = write_keys(tmp_path / 'keys.las', (3072, 2264), (4099, 9003))
    wkt = write_las(tmp_path / 'wkt.las', make_points(), crs='EPSG:2264')
    sources, refusals = read_sources([keys, wkt])
    assert refusals == []
    check_together(sources, refusals)
    assert sources[0].units == sources[1].units == pytest.approx((US_FOOT, US_FOOT))


def test_a_system_of_heights_alone_is_refused(tmp_path):
    path = write_las(tmp_path / 'cloud.las', make_points())
    with pytest.raises(DataError, match='is a system of heights alone'):
        read_cloud(path, 'EPSG:6360')


@pytest.mark.parametrize(('place', 'value'), [
    (131, 0.0), (139, math.nan), (147, math.inf), (155, math.nan), (171, -math.inf),
])
def test_steps_and_offsets_that_make_no_coordinates_are_refused(place, value, tmp_path):
    path = write_las(tmp_path / 'cloud.las', make_points())
    data = bytearray(path.read_bytes())
    struct.pack_into('<d', data, place, value)
    path.write_bytes(data)
    with pytest.raises(DataError, match='is damaged: by its header coordinates come in steps'):
        read_cloud(path)
    sources, (refusal,) = read_sources([path])
    assert sources == []
    assert 'in steps of' in refusal.error


def test_degrees_are_refused(tmp_path):
    path = write_las(tmp_path / 'cloud.las', make_points(), crs='EPSG:4326')
    with pytest.raises(DataError, match='project the cloud first'):
        read_cloud(path)
    assert read_cloud(path, 'EPSG:32633').metres_per_unit == (1.0, 1.0)


def test_depths_are_refused(tmp_path):
    path = write_las(tmp_path / 'cloud.las', make_points())
    with pytest.raises(DataError, match='NAVD88 depth points down: turn its sign'):
        read_cloud(path, 'EPSG:32633+6357')


def test_unknown_crs_is_a_config_error(tmp_path):
    path = write_las(tmp_path / 'cloud.las', make_points())
    with pytest.raises(ConfigError, match="'EPSG:999999'"):
        read_cloud(path, 'EPSG:999999')


@pytest.mark.parametrize('suffix', ['.las', '.laz', '.pcd'])
@pytest.mark.parametrize('num_points', [0, 1, 3])
def test_few_points(suffix, num_points, tmp_path):
    points = make_points(num_points)
    path = tmp_path / f'cloud{suffix}'
    if suffix == '.pcd':
        lines = [f'{x} {y} {z}' for x, y, z in points]
        path.write_text('\n'.join([
            'VERSION .7', 'FIELDS x y z', 'SIZE 8 8 8', 'TYPE F F F', f'WIDTH {num_points}',
            'HEIGHT 1', 'DATA ascii', *lines, '',
        ]))
    else:
        write_las(path, points)
    cloud = read_cloud(path)
    assert cloud.points.shape == (num_points, 3)
    np.testing.assert_allclose(cloud.points, points, rtol=0, atol=1e-9)


def test_points_that_are_not_finite_stay_in_place_as_nan(tmp_path):
    path = tmp_path / 'cloud.pcd'
    points = np.arange(30, dtype=np.float32).reshape(10, 3)
    points[2, 1], points[7, 0], points[7, 2] = np.nan, np.inf, -np.inf
    header = 'FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 10\nHEIGHT 1\n'
    path.write_bytes(f'{header}POINTS 10\nDATA binary\n'.encode() + points.tobytes())
    cloud = read_cloud(path)
    assert cloud.num_not_finite == 2
    assert np.flatnonzero(np.isnan(cloud.points).all(axis=1)).tolist() == [2, 7]
    assert np.isfinite(np.delete(cloud.points, [2, 7], axis=0)).all()
    assert cloud.las is None


def write_pcd(path, points):
    """Write points as an ascii PCD file of float64."""
    head = (f'FIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {len(points)}\nHEIGHT 1\n'
            f'POINTS {len(points)}\nDATA ascii\n')
    path.write_text(head + '\n'.join(' '.join(map(repr, row)) for row in points.tolist()) + '\n')
    return path


def test_coordinates_of_no_crs(tmp_path):
    points = make_points(1000)
    points[7] = [1e300, 0.0, 0.0]
    points[9] = [0.0, 2e8, 0.0]
    cloud = read_cloud(write_pcd(tmp_path / 'few.pcd', points))
    assert cloud.num_not_finite == 2
    assert np.flatnonzero(np.isnan(cloud.points).any(axis=1)).tolist() == [7, 9]
    with pytest.raises(DataError, match='1000 of 1000 points have coordinates up to 6e'):
        read_cloud(write_pcd(tmp_path / 'all.pcd', make_points(1000) * 1e289))


@pytest.mark.parametrize('suffix', ['.las', '.laz'])
@hypothesis.settings(deadline=None, max_examples=50)
@given(share=st.floats(0.0, 0.999))
def test_truncated_file_is_one_clear_error(suffix, share, tmp_path_factory):
    folder = tmp_path_factory.mktemp('truncated')
    data = write_las(folder / f'cloud{suffix}', make_points(2000)).read_bytes()
    path = folder / f'short{suffix}'
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(DataError, match=path.name) as error:
        read_cloud(path)
    assert '\n' not in str(error.value)


def test_truncated_chunk_table_does_not_end_the_process(tmp_path):
    # The decoder that laspy tries last, LASzip, does not survive some of these.
    data = write_las(tmp_path / 'cloud.laz', make_points(2000)).read_bytes()
    path = tmp_path / 'short.laz'
    for size in range(227, 1000, 11):
        path.write_bytes(data[:size])
        with pytest.raises(DataError, match=path.name):
            read_cloud(path)


def test_damaged_chunks_do_not_end_the_process(tmp_path):
    # The decoder aborts where it gets no memory: the table of chunks, its place, chunks too large.
    path = write_las(tmp_path / 'cloud.laz', make_points(2000))
    data = path.read_bytes()
    (first_point,) = struct.unpack_from('<I', data, 96)
    (table,) = struct.unpack_from('<q', data, first_point)
    for position, bit, message in (
        (table + 7, 7, '2147483649 chunks for 2000 points'),
        (first_point, 4, 'chunks for 2000 points'),
        (data.index(struct.pack('<I', 50_000), 375, first_point) + 3, 6, 'chunks of 1073791824'),
        (table + 8, 7, 'cloud.laz'),
    ):
        damaged = bytearray(data)
        damaged[position] ^= 1 << bit
        path.write_bytes(damaged)
        with pytest.raises(DataError, match=message) as error:
            read_cloud(path)
        assert '\n' not in str(error.value)


@pytest.mark.parametrize(('suffix', 'count', 'message'), [
    ('.las', 350_000_000, 'its header counts 350000000 points'),
    ('.laz', 350_000_000, '350000000 points in '),
    ('.laz', 60_000, '1 chunks for 60000 points'),
])
def test_no_room_is_made_for_points_that_are_not_there(
    tmp_path, monkeypatch, suffix, count, message
):
    path = write_las(tmp_path / f'cloud{suffix}', make_points(2000))
    data = bytearray(path.read_bytes())
    at, kind = (247, '<Q') if data[25] >= 4 else (107, '<I')
    assert struct.unpack_from(kind, data, at) == (2000,)
    struct.pack_into(kind, data, at, count)
    path.write_bytes(data)
    monkeypatch.setattr(laspy.LasReader, 'read', None)
    with pytest.raises(DataError, match=message):
        read_cloud(path)


@pytest.mark.parametrize('count', [0, 40_000, 50_000])
def test_more_chunks_than_a_header_counts_are_told(count, tmp_path):
    path = write_las(tmp_path / 'cloud.laz', make_points(60_000))
    data = bytearray(path.read_bytes())
    struct.pack_into('<Q', data, 247, count)
    path.write_bytes(data)
    with pytest.raises(DataError) as error:
        read_cloud(path)
    assert str(error.value) == (
        f'{path} holds more than the {count} points that its header counts: 2 chunks of 50000'
        ' points: write it anew'
    )


@pytest.mark.parametrize('backend', [laspy.LazBackend.Lazrs, laspy.LazBackend.LazrsParallel])
@pytest.mark.parametrize('version', ['1.2', '1.4'])
@pytest.mark.parametrize('num_points', [0, 50_000, 100_000])
def test_chunks_may_be_full_or_none(backend, version, num_points, tmp_path):
    """The one backend writes a chunk of no points into an empty file."""
    las = laspy.read(write_las(tmp_path / 'cloud.las', make_points(num_points), version=version))
    las.write(tmp_path / 'cloud.laz', laz_backend=backend)
    assert len(read_cloud(tmp_path / 'cloud.laz').points) == num_points


def test_points_up_to_the_extended_records_are_counted(tmp_path):
    las = laspy.read(write_las(tmp_path / 'cloud.las', make_points(20)))
    las.evlrs = laspy.vlrs.vlrlist.VLRList([laspy.VLR('someone', 7, '', b'x' * 1000)])
    path = tmp_path / 'more.las'
    las.write(path)
    assert len(read_cloud(path).points) == 20
    data = bytearray(path.read_bytes())
    struct.pack_into('<Q', data, 247, 19)
    path.write_bytes(data)
    with pytest.raises(DataError, match='holds 20 points and its header counts 19: which is righ'):
        read_cloud(path)


def test_place_of_the_chunks_may_stand_at_the_end(tmp_path):
    # So it does in a file that was written as a stream.
    points = make_points(2000)
    path = write_las(tmp_path / 'cloud.laz', points)
    data = bytearray(path.read_bytes())
    (first_point,) = struct.unpack_from('<I', data, 96)
    (table,) = struct.unpack_from('<q', data, first_point)
    struct.pack_into('<q', data, first_point, -1)
    path.write_bytes(data + struct.pack('<q', table))
    np.testing.assert_allclose(read_cloud(path).points, points, rtol=0, atol=6e-4)
    data[table + 7] = 255
    path.write_bytes(data + struct.pack('<q', table))
    with pytest.raises(DataError, match='4278190081 chunks for 2000 points'):
        read_cloud(path)


@pytest.mark.parametrize(
    ('position', 'message'),
    [(96, 'truncated'), (100, 'variable length records'), (243, 'extended records')],
)
def test_damaged_header_is_not_believed(position, message, tmp_path):
    # laspy would look for four billion records.
    path = write_las(tmp_path / 'cloud.laz', make_points())
    data = bytearray(path.read_bytes())
    data[position : position + 4] = b'\xff' * 4
    path.write_bytes(data)
    with pytest.raises(DataError, match=message):
        read_cloud(path)


def test_what_is_no_cloud(tmp_path):
    (tmp_path / 'text.laz').write_text('hello ' * 100)
    (tmp_path / 'folder.laz').mkdir()
    for name, message in (
        ('missing.laz', 'does not exist'),
        ('text.laz', 'text.laz is not a LAS file'),
        ('folder.laz', 'is a folder'),
        ('cloud.obj', 'must end in .las, .laz, .pcd, .e57, .ply, .xyz, .csv'),
    ):
        with pytest.raises(DataError, match=message):
            read_cloud(tmp_path / name)


def test_real_earth_wire_in_us_feet():
    path = REAL / 'earthwire_us_feet.laz'
    if not path.exists():
        pytest.skip(f'real data {path.name} is not there')
    feet, metres = read_cloud(path), read_cloud(path, 'EPSG:2225')
    assert len(metres.points) == 2188
    np.testing.assert_allclose(metres.points, feet.points * US_FOOT, rtol=0, atol=1e-6)
