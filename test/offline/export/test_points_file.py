# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""``points.laz``: nothing of the input is lost, and the result is in it."""

from pathlib import Path
import resource

from factories import make_empty_result, make_inspection
import laspy
import numpy as np
import pytest

from plc_inspect.errors import DataError
from plc_inspect.offline.export.points_file import lay_grid, put_on_grid, write_points
from plc_inspect.offline.records.units import Units

UTM = (615_300.0, 5_712_000.0, 30.0)
REAL = Path(__file__).parents[4] / 'shared/data/real'


def make_las(point_format, num_points=50, version=None, seed=3):
    """Make LAS points with every dimension of the format filled."""
    rng = np.random.default_rng(seed)
    header = laspy.LasHeader(
        point_format=point_format, version=version or ('1.4' if point_format > 5 else '1.2')
    )
    header.scales, header.offsets = np.array([0.01, 0.01, 0.001]), np.array([6e5, 5.7e6, 0.0])
    header.add_extra_dims([
        laspy.ExtraBytesParams('amplitude', np.float32, 'of the echo'),
        laspy.ExtraBytesParams('span_id', np.uint8, 'someone else'),
    ])
    las = laspy.LasData(header)
    las.points = laspy.ScaleAwarePointRecord.zeros(num_points, header=header)
    for name in las.point_format.dimension_names:
        info = las.point_format.dimension_by_name(name)
        if name in ('X', 'Y', 'Z'):
            las[name] = rng.integers(-(10**6), 10**6, num_points)
        elif info.kind.name == 'FloatingPoint':
            las[name] = rng.random(num_points)
        elif name in ('scan_angle_rank', 'scan_angle'):
            las[name] = rng.integers(-90, 90, num_points)
        else:
            high = 2 ** min(info.num_bits, 15) if info.num_bits > 1 else 2
            las[name] = rng.integers(0, high, num_points)
    return las


def inspect_las(las, **changes):
    """Make a run over LAS points in which nothing was found."""
    points = np.column_stack((las.x, las.y, las.z))
    return make_inspection(
        result=make_empty_result(len(points)), points=points, las=las, **changes
    )


@pytest.mark.parametrize('point_format', [0, 1, 2, 3, 6, 7, 8])
def test_las_attributes_are_kept(tmp_path, point_format):
    las = make_las(point_format)
    before = las.points.array.copy()
    inspection = inspect_las(las)
    assert write_points(tmp_path / 'points.laz', inspection) == 50
    out = laspy.read(tmp_path / 'points.laz')
    assert out.header.version == '1.4'
    assert out.point_format.id == {0: 6, 1: 6, 2: 7, 3: 7}.get(point_format, point_format)
    same = set(las.point_format.dimension_names) - {
        'classification', 'span_id', 'scan_angle_rank'
    }
    for name in same:
        np.testing.assert_array_equal(np.asarray(out[name]), np.asarray(las[name]), err_msg=name)
    if point_format < 6:
        np.testing.assert_allclose(
            np.asarray(out['scan_angle']) * 0.006, np.asarray(las['scan_angle_rank']), atol=0.003
        )
    np.testing.assert_array_equal(out.header.scales, las.header.scales)
    known = np.where(
        np.asarray(las.withheld) != 0, las.classification, inspection.result.classification
    )
    np.testing.assert_array_equal(out.classification, known)
    np.testing.assert_array_equal(out['original_classification'], np.asarray(las.classification))
    np.testing.assert_array_equal(out['span_id'], inspection.result.span_id)
    np.testing.assert_array_equal(before, las.points.array)


def test_the_class_before_the_first_survey_stays(tmp_path):
    """A points.laz that is surveyed again tells it still."""
    las = make_las(7)
    write_points(tmp_path / 'first.laz', inspect_las(las))
    first = laspy.read(tmp_path / 'first.laz')
    assert (np.asarray(first.classification) != las.classification).any()
    write_points(tmp_path / 'again.laz', inspect_las(first))
    again = laspy.read(tmp_path / 'again.laz')
    np.testing.assert_array_equal(again['original_classification'], las.classification)
    assert first.point_format == again.point_format


def test_result_is_in_the_file(tmp_path):
    inspection = make_inspection(origin=UTM)
    write_points(tmp_path / 'points.laz', inspection)
    out = laspy.read(tmp_path / 'points.laz')
    assert out.point_format.id == 6
    types = {item.name: np.dtype(item.dtype) for item in out.point_format.extra_dimensions}
    assert types == {
        'line_id': np.int32, 'span_id': np.int32, 'clearance': np.float32, 'decision': np.uint8,
    }
    for name in types:
        np.testing.assert_array_equal(out[name], getattr(inspection.result, name))
    np.testing.assert_allclose(out.xyz, inspection.points, rtol=0, atol=1e-3)


def test_points_that_are_not_finite_are_left_out(tmp_path):
    points = np.array([[0.0, 1.0, 2.0], [np.nan, 0.0, 0.0], [3.0, 4.0, np.inf], [5.0, 6.0, 7.0]])
    inspection = make_inspection(result=make_empty_result(4), points=points)
    assert write_points(tmp_path / 'points.laz', inspection) == 2
    out = laspy.read(tmp_path / 'points.laz')
    np.testing.assert_allclose(out.xyz, points[[0, 3]], atol=1e-3)


@pytest.mark.parametrize('num_points', [0, 1])
def test_few_points(tmp_path, num_points):
    points = np.full((num_points, 3), 1e6)
    inspection = make_inspection(result=make_empty_result(num_points), points=points)
    assert write_points(tmp_path / 'points.laz', inspection) == num_points
    np.testing.assert_array_equal(laspy.read(tmp_path / 'points.laz').xyz, points)


def test_chunks_equal_the_whole(tmp_path, monkeypatch):
    las = make_las(6, 1000)
    write_points(tmp_path / 'whole.laz', inspect_las(las))
    monkeypatch.setattr('plc_inspect.offline.export.points_file.CHUNK_SIZE', 77)
    write_points(tmp_path / 'chunks.laz', inspect_las(las))
    whole, chunks = (laspy.read(tmp_path / f'{name}.laz') for name in ('whole', 'chunks'))
    assert whole.points.array.tobytes() == chunks.points.array.tobytes()


def test_crs_replaces_that_of_the_input(tmp_path):
    import pyproj

    las = make_las(3)
    las.header.add_crs(pyproj.CRS.from_epsg(25832))
    assert any(type(vlr).__name__ == 'GeoKeyDirectoryVlr' for vlr in las.header.vlrs)
    wkt = pyproj.CRS.from_epsg(2992).to_wkt('WKT1_GDAL')
    write_points(tmp_path / 'points.laz', inspect_las(las, crs=wkt))
    out = laspy.read(tmp_path / 'points.laz')
    assert out.header.parse_crs().to_epsg() == 2992
    assert not any(type(vlr).__name__ == 'GeoKeyDirectoryVlr' for vlr in out.header.vlrs)
    assert out.header.global_encoding.wkt


@pytest.mark.parametrize('crs', ['EPSG:2992', ''])
def test_crs_replaces_that_in_an_extended_record(crs, tmp_path):
    import pyproj

    las = make_las(6)
    old = pyproj.CRS.from_epsg(25832).to_wkt('WKT1_GDAL').encode() + b'\0'
    las.evlrs = laspy.vlrs.vlrlist.VLRList([
        laspy.VLR('LASF_Projection', 2112, '', old), laspy.VLR('someone', 7, '', b'kept'),
    ])
    wkt = pyproj.CRS(crs).to_wkt('WKT1_GDAL') if crs else ''
    write_points(tmp_path / 'points.laz', inspect_las(las, crs=wkt))
    out = laspy.read(tmp_path / 'points.laz')
    assert out.header.parse_crs().to_epsg() == (2992 if crs else 25832)
    assert [vlr.user_id for vlr in out.evlrs] == (
        ['someone'] if crs else ['LASF_Projection', 'someone']
    )


def test_coordinates_are_in_units_of_the_input(tmp_path):
    foot = 1200.0 / 3937.0
    points = np.array([[100.0, 200.0, 30.0], [101.0, 202.0, 33.0]])
    inspection = make_inspection(
        result=make_empty_result(2), points=points, units=Units(horizontal=foot, vertical=1.0)
    )
    write_points(tmp_path / 'points.laz', inspection)
    expected = points / [foot, foot, 1.0]
    np.testing.assert_allclose(laspy.read(tmp_path / 'points.laz').xyz, expected, atol=1e-3)


@pytest.fixture
def small_files():
    """Allow files of 1,000 bytes at most, as on a disk that is full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_full_disk_is_an_error_of_ours(tmp_path, small_files):
    with pytest.raises(DataError, match='cannot be written, is the disk full'):
        write_points(tmp_path / 'points.laz', make_inspection(num_ground=5000))


@pytest.mark.parametrize('num_points', [3, 5])
def test_result_of_other_points_is_refused(tmp_path, num_points):
    inspection = make_inspection(result=make_empty_result(4), points=np.zeros((num_points, 3)))
    with pytest.raises(DataError, match=f'4 points for {num_points} points'):
        write_points(tmp_path / 'points.laz', inspection)


def test_points_far_apart_are_in_coarser_steps(tmp_path):
    """As where one point of a cloud at UTM is the origin."""
    points = np.array([[0.0, 0.0, 0.0], [5e5, 5.4e6, 30.0], [5e5 + 0.25, 5.4e6 + 0.25, 30.123]])
    inspection = make_inspection(result=make_empty_result(3), points=points)
    assert write_points(tmp_path / 'points.laz', inspection) == 3
    out = laspy.read(tmp_path / 'points.laz')
    np.testing.assert_allclose(out.header.scales, [1e-3, 1e-2, 1e-3])
    np.testing.assert_allclose(out.xyz, points, rtol=0, atol=0.0051)


@pytest.mark.parametrize(('low', 'high', 'scale', 'offset', 'expected'), [
    (-2e6, 2e6, 0.001, 0.0, (0.0, 0.001)),  # holds: as given
    (0.0, (2**31 - 1) * 0.001, 0.001, 0.0, (0.0, 0.001)),
    (5.4e6, 5.4e6 + 50.0, 0.001, 0.25, (5_400_000.25, 0.001)),  # too far: moved by whole steps
    (0.0, 4.2e6, 0.001, 0.0, (2.1e6, 0.001)),
    (0.0, 4.4e6, 0.001, 0.0, (2.2e6, 0.01)),  # too wide: coarser
    (5e6, 5e6 + 1000.0, 1e-12, 0.0, (5_000_500.0, 1e-6)),
    (5e6, 5e6, 1e-30, 0.0, (5e6, None)),
])
def test_a_grid_holds_all_coordinates(low, high, scale, offset, expected):
    ends = np.array([[low] * 3, [high] * 3])
    offsets, scales = lay_grid(*ends, np.full(3, scale), np.full(3, offset))
    np.testing.assert_allclose(offsets, expected[0], rtol=0, atol=1e-8)
    if expected[1] is not None:
        np.testing.assert_allclose(scales, expected[1])
    for end in ends:
        steps = put_on_grid(end, scales[0], offsets[0])
        np.testing.assert_allclose(
            steps * scales[0] + offsets[0], end, rtol=1e-15, atol=scales[0] / 2
        )


@pytest.mark.parametrize('value', [2147484.0, np.nan])
def test_coordinates_beyond_a_grid_are_never_wrapped(value):
    with pytest.raises(DataError, match='are too far from 0 for LAS, which holds 2147483647 st'):
        put_on_grid(np.array([0.0, value]), 0.001, 0.0)


@pytest.mark.skipif(not REAL.is_dir(), reason='no ../shared/data/real beside the repository')
def test_real_cloud_keeps_every_bit(tmp_path):
    las = laspy.read(REAL / 'forest_mixedconifer_no_wires.laz')
    write_points(tmp_path / 'points.laz', inspect_las(las))
    out = laspy.read(tmp_path / 'points.laz')
    for name in set(las.points.array.dtype.names) - {'classification'}:
        np.testing.assert_array_equal(out.points.array[name], las.points.array[name])
