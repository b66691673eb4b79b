# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Attributes of points from an input to the file of a tile, and points near a section; damage."""

import json
import struct

from grid.formats import write_copc, write_xyz
from grid.grids import inspect, make_line, ORIGIN, write_las
import laspy
from laspy.header import GpsTimeType
import numpy as np
import pytest

from plc_inspect.errors import DataError
from plc_inspect.grid.cells import cut
from plc_inspect.grid.cells.cut import ATTRIBUTES, FLAG_BITS, read_part
from plc_inspect.grid.cells.pieces import Piece, read_attributes, read_points
from plc_inspect.grid.cells.sources import read_sources
from plc_inspect.grid.results import choose_format
from plc_inspect.grid.tiles.section_report import is_near
from plc_inspect.grid.tiles.tile_points import _put_attributes
from plc_inspect.offline.export.points_file import describe_original, ORIGINAL

COLOURS = ('red', 'green', 'blue', 'nir')
STANDARD, WEEK = GpsTimeType.STANDARD, GpsTimeType.WEEK_TIME
PLAIN = ('intensity', 'user_data', 'point_source_id', 'gps_time')


def write_random(path, point_format, num=300):
    """Write points whose attributes take all values."""
    rng = np.random.default_rng(point_format)
    header = laspy.LasHeader(version='1.4', point_format=point_format)
    header.scales = np.full(3, 0.001)
    las = laspy.LasData(header)
    las.x, las.y, las.z = rng.uniform(0.0, 50.0, (3, num))
    for field, (kind, _) in las.points.array.dtype.fields.items():
        if field not in 'XYZ':
            las.points.array[field] = (
                rng.uniform(0.0, 1e9, num) if kind.kind == 'f'
                else rng.integers(np.iinfo(kind).min, np.iinfo(kind).max + 1, num)
            )
    las.write(path)
    return las


@pytest.mark.parametrize('point_format', [0, 1, 3, 6, 7, 8])
def test_attributes_reach_the_points_of_a_tile(point_format, tmp_path):
    las = write_random(tmp_path / 'a.las', point_format)
    ((source,), _) = read_sources([tmp_path / 'a.las'])
    (_, attributes), = read_part(source, 0)
    assert source.point_format == {0: 6, 1: 6, 3: 7}.get(point_format, point_format)
    header = laspy.LasHeader(version='1.4', point_format=8)
    header.add_extra_dims([describe_original()])
    record = laspy.ScaleAwarePointRecord.zeros(len(attributes), header=header)
    _put_attributes(record, attributes)
    held = set(las.point_format.dimension_names)
    for name in (*PLAIN, *COLOURS, *FLAG_BITS, 'return_number', 'number_of_returns',
                 'scanner_channel'):
        expected = np.asarray(las[name]) if name in held else 0
        np.testing.assert_array_equal(np.asarray(record[name]), expected, name)
    np.testing.assert_array_equal(record[ORIGINAL], las.classification)
    degrees = (
        las.scan_angle_rank if 'scan_angle_rank' in held else las.scan_angle * 0.006
    )
    np.testing.assert_allclose(record['scan_angle'] * 0.006, degrees, atol=0.0031)


def test_points_near_a_section_are_those_in_its_strips():
    rng = np.random.default_rng(3)
    strips = []
    for way in rng.uniform(0.0, 2 * np.pi, 12):
        axes = np.array([[np.cos(way), np.sin(way)], [-np.sin(way), np.cos(way)]])
        strips.append((axes @ rng.uniform(5e5, 5e5 + 900.0, 2), axes,
                       rng.uniform([10.0, 80.0], [400.0, 150.0])))
    points = rng.uniform(5e5 - 500.0, 5e5 + 1500.0, (20_000, 3))
    points[:3] = np.nan
    expected = np.zeros(len(points), dtype=bool)
    for low, axes, size in strips:
        place = points[:, :2] @ axes.T - low
        expected |= ((place >= 0.0) & (place <= size)).all(axis=1)
    assert 1000 < expected.sum() < 15_000
    np.testing.assert_array_equal(is_near(strips, points), expected)


@pytest.mark.parametrize('core', [[7, 8], [8]])
@pytest.mark.parametrize(('num_values', 'num_keys'), [(15, 4), (15, 6), (14, 5)])
def test_a_damaged_cell_is_told(num_values, num_keys, core, tmp_path):
    (tmp_path / 's0').mkdir()
    for cell in (7, 8):
        np.zeros(15).tofile(tmp_path / 's0' / f'{cell}.xyz')
        np.arange(5, dtype='<u4').tofile(tmp_path / 's0' / f'{cell}.idx')
        np.zeros(5, dtype=ATTRIBUTES).tofile(tmp_path / 's0' / f'{cell}.att')
    pieces = [Piece(cell=7, part='s0', first=0), Piece(cell=8, part='s0', first=5)]
    assert len(read_points(tmp_path, pieces, core, (-1.0, -1.0, 1.0, 1.0)).points) == 10
    np.zeros(num_values).tofile(tmp_path / 's0' / '7.xyz')
    np.arange(num_keys, dtype='<u4').tofile(tmp_path / 's0' / '7.idx')
    with pytest.raises(DataError, match='s0: cell 7 is damaged'):
        read_points(tmp_path, pieces, core, (-1.0, -1.0, 1.0, 1.0))
    with pytest.raises(DataError, match='s0: cell 7 is damaged'):
        read_attributes(tmp_path, pieces)


def test_an_index_of_copc_must_lead_to_what_the_header_counts(tmp_path):
    path = write_copc(tmp_path / 'a.copc.laz', make_line(1))
    data = bytearray(path.read_bytes())
    count = int.from_bytes(data[247:255], 'little')
    data[247:255] = (count + 9).to_bytes(8, 'little')
    path.write_bytes(data)
    _, (refusal,) = read_sources([path])
    assert refusal.error == (
        f'{path} is damaged: its index leads to {count} points, its header counts {count + 9}'
    )
    struct.pack_into('<Q', data, 375 + 54 + 48, 2**32)
    path.write_bytes(data)
    _, (refusal,) = read_sources([path])
    assert 'a.copc.laz has no readable index of COPC: its index has 4294967296' in refusal.error


def read_tiles(folder):
    """Return the coordinates in the points files of all tiles, sorted."""
    return sort(np.concatenate([laspy.read(path).xyz for path in folder.glob('tiles/*/*.laz')]))


def sort(points):
    """Return points in an order that the last bits do not change."""
    return points[np.lexsort(np.round(points, 3).T)]


def test_a_point_far_away_leaves_the_others_exact(tmp_path):
    """It is farther from them than 32 bits hold millimetres."""
    first, second = np.array_split(make_line(1), 2)
    first = np.concatenate([first, [ORIGIN - [0.0, 2.2e6, 0.0]]])
    paths = [write_xyz(tmp_path / 'a.xyz', first), write_xyz(tmp_path / 'b.xyz', second)]
    inspect(tmp_path / 'out', paths)
    np.testing.assert_allclose(
        read_tiles(tmp_path / 'out'), sort(np.concatenate([first, second])), rtol=0, atol=1e-6
    )


def test_tiles_are_as_fine_as_the_finest_input_that_they_can_hold(tmp_path):
    """Two tiles whose own grids use all of the 32 bits: no grid of that scale holds both."""
    points = make_line(1)
    middle = np.median(points[:, 0])
    paths = []
    for name, own in (('a', points[points[:, 0] < middle]), ('b', points[points[:, 0] >= middle])):
        center = np.round((own.min(axis=0) + own.max(axis=0)) / 2)
        scale = np.ptp(own[:, 0]) / 2**32 * 1.1
        paths.append(write_las(tmp_path / f'{name}.laz', own, scales=np.full(3, scale),
                               offsets=center))
    inspect(tmp_path / 'out', paths)
    np.testing.assert_allclose(read_tiles(tmp_path / 'out'), sort(points), rtol=0, atol=1e-6)


@pytest.mark.parametrize('order', [1, -1])
def test_a_coarse_input_does_not_coarsen_the_others(order, tmp_path):
    points = make_line(1)
    coarse = np.round(points[:500] * 4) / 4
    paths = [
        write_las(tmp_path / 'a.las', coarse, scales=np.full(3, 0.25), offsets=np.zeros(3)),
        write_las(tmp_path / 'b.las', points[500:]),
    ][::order]
    inspect(tmp_path / 'out', paths)
    found = read_tiles(tmp_path / 'out')
    np.testing.assert_allclose(
        found, sort(np.concatenate([coarse, points[500:]])), rtol=0, atol=1e-6
    )


def test_the_format_of_tiles_is_that_of_the_first_of_the_finest_inputs(tmp_path):
    points = make_line(1)[:10]
    scales = [(0.01, 0.01, 0.001), (0.001, 0.01, 0.01)]
    paths = [
        write_las(tmp_path / f'{number}.las', points, scales=np.array(own),
                  offsets=np.floor(ORIGIN) + number)
        for number, own in enumerate(scales)
    ]
    sources, _ = read_sources(paths)
    form = choose_format(sources)
    assert form.scales == (0.001, 0.01, 0.001)
    assert form.offsets == (500_001.0, 5_700_000.0, 40.0)
    with_text, _ = read_sources([write_xyz(tmp_path / 'c.xyz', points), *paths[::-1]])
    assert choose_format(with_text).scales == (0.001, 0.001, 0.001)
    assert choose_format(with_text).offsets == (500_001.0, 5_700_001.0, 40.0)
    only_text = choose_format(with_text[:1])
    assert only_text.offsets == tuple(np.floor(points.min(axis=0)))


@pytest.mark.parametrize('point_format', [6, 7, 8])
def test_tiles_have_the_attributes_of_a_single_survey(point_format, tmp_path):
    points = make_line(1)
    las = laspy.convert(laspy.read(write_las(tmp_path / 'a.las', points)),
                        point_format_id=point_format)
    rng = np.random.default_rng(point_format)
    las.scanner_channel = rng.integers(0, 4, len(points))
    las.overlap = rng.integers(0, 2, len(points))
    las.edge_of_flight_line = rng.integers(0, 2, len(points))
    if point_format == 8:
        las.nir = rng.integers(0, 65_536, len(points))
    las.write(tmp_path / 'a.las')
    inspect(tmp_path / 'out', [tmp_path / 'a.las'])
    (path,) = tmp_path.glob('out/tiles/*/points.laz')
    tile = laspy.read(path)
    assert tile.point_format.id == point_format
    for name in set(las.point_format.dimension_names) - {'classification'}:
        np.testing.assert_array_equal(np.asarray(tile[name]), np.asarray(las[name]), name)


@pytest.mark.parametrize('software', ['other', 'plc_inspect'])
def test_original_classes_are_those_of_files_written_here(software, tmp_path):
    las = laspy.read(write_las(tmp_path / 'a.las', make_line(1)))
    las.add_extra_dim(laspy.ExtraBytesParams(name=ORIGINAL, type=np.uint8))
    las[ORIGINAL] = np.full(len(las), 77, dtype=np.uint8)
    las.header.generating_software = software
    las.write(tmp_path / 'a.las')
    ((source,), _) = read_sources([tmp_path / 'a.las'])
    (_, attributes), = read_part(source, 0)
    is_own = software == 'plc_inspect'
    assert (f'extra dimensions {ORIGINAL} of {source.path} are replaced' in source.note) != is_own
    np.testing.assert_array_equal(
        attributes['classification'], las[ORIGINAL] if is_own else las.classification)


def test_withheld_points_take_no_part_and_are_in_the_tiles(tmp_path, monkeypatch):
    monkeypatch.setattr(cut, 'CHUNK', 5000)
    points = make_line(1)
    plain, _ = inspect(tmp_path / 'plain', [write_las(tmp_path / 'plain.las', points)])
    # a blanket 0.3 m below a conductor
    noise = points[::7] * [1.0, 1.0, 0.0] + [0.0, 0.0, points[:, 2].min() + 12.0]
    number = np.arange(0, len(points), 7)
    las = laspy.read(write_las(tmp_path / 'noisy.las', np.insert(points, number, noise, axis=0)))
    las.withheld = np.insert(np.zeros(len(points), np.uint8), number, 1)
    las.write(tmp_path / 'noisy.las')
    noisy, jobs = inspect(tmp_path / 'noisy', [tmp_path / 'noisy.las'], edge=60.0, tile_edge=60.0)
    assert len(jobs) > 1
    assert noisy.num_withheld == len(noise)
    run = json.loads((tmp_path / 'noisy/run.json').read_text(encoding='utf-8'))
    assert (run['num_withheld'], run['num_not_on_earth']) == (len(noise), 0)
    assert len(noisy.joined.spans) == len(plain.joined.spans) == 3
    assert [item.clearance for item in noisy.joined.hazards] == pytest.approx(
        [item.clearance for item in plain.joined.hazards], abs=2e-3)
    names = ('X', 'Y', 'Z', 'intensity', 'withheld')
    tiles = [laspy.read(path) for path in tmp_path.glob('noisy/tiles/*/points.laz')]
    table = np.concatenate([
        np.column_stack([*(tile[name] for name in names), tile.original_classification])
        for tile in tiles
    ])
    expected = np.column_stack([*(las[name] for name in names), las.classification])
    for own in (table, expected):
        own[:] = own[np.lexsort(own.T)]
    np.testing.assert_array_equal(table, expected)
    for tile in tiles:
        held = np.asarray(tile.withheld, dtype=bool)
        np.testing.assert_array_equal(
            tile.classification[held], tile.original_classification[held])
        assert (tile.line_id[held] == -1).all()
        assert np.isnan(tile.clearance[held]).all()


@pytest.mark.slow
def test_tiles_say_what_their_times_are(tmp_path):
    line, other = make_line(1), make_line(1) + np.array([0.0, 500.0, 0.0])
    paths = []
    for name, points, kind in (('a.las', line, STANDARD), ('b.las', other, WEEK)):
        las = laspy.convert(laspy.read(write_las(tmp_path / name, points)), point_format_id=6)
        las.gps_time = np.arange(len(points)) * 1e-4
        las.header.global_encoding.gps_time_type = kind
        las.write(tmp_path / name)
        paths.append(tmp_path / name)
    text = write_xyz(tmp_path / 'c.xyz', line)
    for number, (own, kind, is_told) in enumerate([
        ([text, paths[0]], STANDARD, False), ([paths[1]], WEEK, False), (paths, STANDARD, True),
    ]):
        summary, _ = inspect(tmp_path / str(number), own, tile_edge=200.0)
        assert any('GPS times are seconds' in note for note in summary.notes) == is_told
        tiles = list(tmp_path.glob(f'{number}/tiles/*/points.laz'))
        assert tiles
        for path in tiles:
            with laspy.open(path) as reader:
                assert reader.header.global_encoding.gps_time_type == kind
