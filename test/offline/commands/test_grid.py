# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""``plc_survey`` over a grid: what makes one, exit codes, messages."""

from contextlib import chdir, nullcontext
import errno
import fcntl
import json
import os
from pathlib import Path
import shutil
import struct

from grid.formats import write_copc, write_e57, write_pcd, write_ply, write_xyz
from grid.grids import make_line, ORIGIN, write_las
import laspy
import numpy as np
from pyarrow import parquet
import pyogrio
import pyproj
import pytest

from plc_inspect import __version__
from plc_inspect.errors import DataError
from plc_inspect.grid import engine
from plc_inspect.grid import run as grid_run
from plc_inspect.grid.cells import cut, layout
from plc_inspect.grid.cells.inputs import expand_inputs
from plc_inspect.grid.cells.sources import read_sources
from plc_inspect.grid.ledger import Ledger
from plc_inspect.offline.commands import survey
from plc_inspect.offline.commands.compare import main as compare
from plc_inspect.offline.commands.survey import main
from plc_inspect.offline.readers.clouds import count_points

OPTIONS = ['--halo', '60', '--memory', '2', '--quiet']


def refuse(capsys, *arguments):
    """Return the one line that a refused command prints."""
    assert main([str(item) for item in arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Write a tile with a line in it, and one of bare ground."""
    folder = tmp_path_factory.mktemp('tiles')
    points = make_line(1)
    write_las(folder / 'a.laz', points)
    write_las(folder / 'b.las', points[-500:] + np.array([150.0, 0.0, 0.0]))
    return folder


def test_a_folder_is_a_grid_and_a_damaged_tile_is_told(folder, tmp_path, capsys):
    (tmp_path / 'tiles').mkdir()
    for path in folder.iterdir():
        (tmp_path / 'tiles' / path.name).write_bytes(path.read_bytes())
    (tmp_path / 'tiles' / 'c.las').write_bytes((folder / 'b.las').read_bytes()[:-900])
    out = tmp_path / 'out'
    assert main([str(tmp_path / 'tiles'), '-o', str(out), *OPTIONS]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert 'c.las is truncated: its header counts 500 points' in lines[0]
    assert lines[1] == 'plc_survey: 1 failed: the results lack what they would add'
    run = json.loads((out / 'run.json').read_text())
    assert (run['num_lines'], run['num_spans']) == (3, 3)
    assert 'c.las' in (out / 'index.html').read_text()
    (tmp_path / 'tiles' / 'c.las').unlink()
    assert main([str(tmp_path / 'tiles'), '-o', str(out), *OPTIONS]) == 0
    assert 'c.las' not in (out / 'index.html').read_text()


def test_formats_may_be_mixed(folder, tmp_path, monkeypatch):
    (tmp_path / 'tiles').mkdir()
    tiles = tmp_path / 'tiles'
    points = make_line(1)
    own = np.array_split(points, 4)
    write_copc(tiles / 'a.copc.laz', own[0])
    write_ply(tiles / 'b.ply', own[1])
    write_xyz(tiles / 'c.xyz', own[2])
    shift = np.floor(points.min(axis=0))
    write_e57(tiles / 'd.e57', own[3] - shift, translation=shift)
    write_xyz(tiles / 'list.csv', own[0], mark=',')  # of a folder tables are not taken
    monkeypatch.setattr(cut, 'PART', 1000)  # else one part of a COPC file is all of it
    out = tmp_path / 'out'
    assert main([str(tiles), '-o', str(out), *OPTIONS]) == 0
    run = json.loads((out / 'run.json').read_text())
    assert run['num_points'] == len(points)
    assert run['input']['num_sources'] == 4
    single = write_las(tmp_path / 'all.las', points)
    assert main([str(single), '-o', str(tmp_path / 'single'), '--quiet']) == 0
    spans, other = (
        json.loads((own / 'spans.json').read_text())['spans']
        for own in (out, tmp_path / 'single')
    )
    assert len(spans) == len(other) == 3
    for one, two in zip(spans, other, strict=True):
        assert one['sag'] == pytest.approx(two['sag'], abs=1e-3)


def test_points_that_an_index_does_not_lead_to_are_missed(tmp_path, monkeypatch, capsys):
    """Parts of a COPC file are found within the bounds of its header, be they wrong."""
    points = make_line(1)
    path = write_copc(tmp_path / 'a.copc.laz', points)
    write_las(tmp_path / 'b.las', points[:100])
    content = bytearray(path.read_bytes())
    struct.pack_into('<d', content, 179 + 32, points[:, 2].max() - 3.0)  # the greatest z
    path.write_bytes(content)
    monkeypatch.setattr(cut, 'PART', 1000)
    out = tmp_path / 'out'
    assert main([str(path), str(tmp_path / 'b.las'), '-o', str(out), *OPTIONS]) == 2
    assert f'its header counts {len(points)}: write it anew' in capsys.readouterr().err
    assert json.loads((out / 'run.json').read_text())['num_points'] == 100


def test_an_empty_tile_is_no_place(tmp_path, capsys):
    points = make_line(1)
    first, second = write_las(tmp_path / 'a.las', points), tmp_path / 'b.las'
    write_las(second, points[:0])
    (tmp_path / 'c.xyz').touch()
    out = tmp_path / 'out'
    assert main([str(first), str(second), str(tmp_path / 'c.xyz'), '-o', str(out),
                 *OPTIONS[:-1]]) == 0
    run = json.loads((out / 'run.json').read_text())
    assert (run['num_points'], run['num_spans'], run['num_tiles']) == (len(points), 3, 1)
    assert run['input']['num_sources'] == 1
    assert run['notes'] == [
        f'{first} has no coordinate reference system: metres assumed',
        f'{second} holds no point', f'{tmp_path / "c.xyz"} holds no point',
    ]
    assert f'{run["notes"][0]} (and 2 more, see run.json)' in capsys.readouterr().out


def test_chunks_that_the_header_does_not_count_are_told(tmp_path, capsys):
    points = make_line(1)
    path, out = tmp_path / 'a.laz', tmp_path / 'out'
    data = bytearray(write_las(path, points).read_bytes())
    data[247:255] = bytes(8)
    path.write_bytes(data)
    write_las(tmp_path / 'b.laz', points)
    assert main([str(path), str(tmp_path / 'b.laz'), '-o', str(out), *OPTIONS]) == 2
    assert (
        f'{path} holds more than the 0 points that its header counts: 1 chunks of 50000 points:'
        ' write it anew'
    ) in capsys.readouterr().err


def test_bounds_that_lie_are_told(tmp_path, capsys):
    path = write_las(tmp_path / 'a.las', make_line(1))
    data = bytearray(path.read_bytes())
    data[179:187] = struct.pack('<d', ORIGIN[0] + 20.0)  # greatest x
    path.write_bytes(bytes(data))
    good = write_las(tmp_path / 'b.las', make_line(1))
    out = tmp_path / 'out'
    assert main([str(path), str(good), '-o', str(out), *OPTIONS]) == 2
    assert 'points lie outside the bounds in its header' in capsys.readouterr().err
    data[179:187] = struct.pack('<d', np.nan)
    path.write_bytes(bytes(data))
    line = refuse(capsys, path, '-o', tmp_path / 'none', '--halo', '60')
    assert 'its header holds bounds from' in line
    assert not (tmp_path / 'none').exists()


def test_points_on_no_earth_are_told_and_too_many_are_refused(tmp_path, capsys):
    points = make_line(1)
    single, out = tmp_path / 'a.xyz', tmp_path / 'out'
    points[:90] = 1e12
    points[90:100] = np.nan
    write_xyz(single, points)
    assert main([str(single), '-o', str(out), *OPTIONS[:-1]]) == 0
    note = (
        f'{single}: 100 of {len(points)} points were left out: 10 are not finite, 90 lie farther'
        ' out than any place on Earth'
    )
    head = json.loads((out / 'run.json').read_text())
    assert (head['num_not_on_earth'], head['notes'][1:]) == (100, [note])
    assert '(and 1 more, see run.json)' in capsys.readouterr().out
    num_far = len(points) // 2
    points[:num_far] = 1e12
    write_xyz(single, points)
    text = (
        f'{single}: {num_far} of {len(points)} points have coordinates up to 1e+12 m, which no'
        ' coordinate reference system has'
    )
    for options, head in (([], ''), (OPTIONS, 'none of 1 inputs can be used: ')):
        line = refuse(capsys, single, '-o', tmp_path / 'none', *options)
        assert line == f'plc_survey: {head}{text}'
    good = write_las(tmp_path / 'b.las', make_line(1))
    assert main([str(single), str(good), '-o', str(out), *OPTIONS]) == 2
    assert capsys.readouterr().err.splitlines()[0] == f'plc_survey: {text}'
    head = json.loads((out / 'run.json').read_text())
    assert (head['num_points'], head['num_not_on_earth']) == (len(points), 0)


def test_a_tile_that_is_delivered_twice_is_told(folder, tmp_path):
    paths = [folder / 'a.laz', folder / 'b.las', tmp_path / 'a.las']
    laspy.read(paths[0]).write(paths[2])
    out = tmp_path / 'out'
    assert main([*map(str, paths), '-o', str(out), *OPTIONS]) == 0
    *_, note = json.loads((out / 'run.json').read_text())['notes']
    assert note == (
        f'{paths[0]} and {paths[2]} hold {len(make_line(1))} points within the same bounds: if'
        ' they are one tile, its points are counted twice; leave one out'
    )


@pytest.mark.slow
def test_one_far_point_does_not_make_cells_too_large(tmp_path, monkeypatch, capsys):
    """Cells laid by the bounds of the input would hold the whole line, more than is allowed."""
    monkeypatch.setattr(grid_run, 'count_allowed', lambda memory: 25_000)
    monkeypatch.setattr(layout, 'MOST_CELLS', 100_000)
    points = make_line()
    far = points[:1] + np.array([-400_000.0, 90_000.0, 0.0])
    paths = [write_las(tmp_path / 'a.las', points), tmp_path / 'b.xyz']
    write_xyz(paths[1], far)
    options = ['--halo', '60', '--memory', '2', '--quiet']
    out, plain = tmp_path / 'out', tmp_path / 'plain'
    assert main([*map(str, paths), '-o', str(out), *options]) == 0
    assert main([str(paths[0]), '-o', str(plain), *options]) == 0
    head, other = (
        json.loads((folder / 'run.json').read_text()) for folder in (out, plain)
    )
    assert head['num_points'] == len(points) + 1
    assert head['num_tiles'] > 3
    for name in ('num_spans', 'num_supports', 'num_hazards'):
        assert head[name] == other[name] > 0
    assert sum(
        laspy.open(path).header.point_count for path in out.glob('tiles/*/points.laz')
    ) == len(points) + 1
    stamps = {path: path.stat().st_mtime_ns for path in out.glob('work/*/*/stats.json')}
    assert main([*map(str, paths), '-o', str(out), *options]) == 0  # nothing is cut again
    assert stamps == {path: path.stat().st_mtime_ns for path in stamps}
    monkeypatch.setattr(grid_run, 'count_allowed', lambda memory: 1_000)
    assert 'points lie within 60 m of a tile of' in refuse(capsys, *paths, '-o', out, *options)


def test_workers_may_run_elsewhere(folder, tmp_path, monkeypatch):
    """A relative folder of results is that of the command, and not of the worker."""
    class Elsewhere(engine.OwnProcess):
        def run(self, tasks):
            for task in tasks:
                with chdir(tmp_path / 'elsewhere'):
                    outcome = engine.call(task)
                yield outcome

    (tmp_path / 'elsewhere').mkdir()
    monkeypatch.setattr(engine, 'open_engine', lambda *_: nullcontext(Elsewhere(2e9)))
    monkeypatch.chdir(tmp_path)
    assert main([str(folder), '-o', 'out', *OPTIONS]) == 0
    assert (tmp_path / 'out/index.html').is_file()
    assert not list((tmp_path / 'elsewhere').iterdir())


def test_memory_is_asked_before_workers_start(folder, tmp_path, monkeypatch, capsys):
    def start(*_):
        raise AssertionError

    monkeypatch.setattr(engine, 'open_engine', start)
    monkeypatch.setattr(engine, 'measure_available', lambda: 8e9)
    for options, each in ((['--workers', '1000'], '0.01'), (['--memory', '0.3'], '0.30')):
        line = refuse(capsys, folder, '-o', tmp_path / 'out', *options)
        assert line.endswith(
            f'{each} GB for a worker are too few: allow 1.0 GB or more (--memory), or fewer'
            ' workers'
        )


def test_a_grid_in_other_units_is_that_of_a_first_run(tmp_path):
    """What was measured of the whole in the old ones is measured anew."""
    path = tmp_path / 'a.xyz'
    write_xyz(path, (make_line(1) - ORIGIN + 50.0) / 0.3048)
    arguments = [str(path), '-o', str(tmp_path / 'out'), *OPTIONS]
    assert main(arguments) == 0
    for options in (['--units', 'ft'], ['--crs', 'EPSG:2992']):
        assert main([*arguments, *options]) == 0
        own = [str(path), '-o', str(tmp_path / 'fresh'), *OPTIONS, '--force', *options]
        assert main(own) == 0
        whole, other = (
            json.loads((folder / 'run.json').read_text())['whole']['whole']
            for folder in (tmp_path / 'out', tmp_path / 'fresh')
        )
        assert whole == other
        for name in ('spans.json', 'hazards.json'):
            assert (tmp_path / 'out' / name).read_bytes() == (
                tmp_path / 'fresh' / name
            ).read_bytes()


def test_an_index_names_its_tiles(folder, tmp_path):
    features = [
        {'type': 'Feature', 'geometry': None, 'properties': {'location': str(folder / name)}}
        for name in ('a.laz', 'b.las')
    ]
    index = tmp_path / 'index.geojson'
    index.write_text(json.dumps({'type': 'FeatureCollection', 'features': features}))
    out = tmp_path / 'out'
    assert main([str(index), '-o', str(out), *OPTIONS]) == 0
    assert json.loads((out / 'run.json').read_text())['input']['num_sources'] == 2


def test_inputs_that_are_none_are_refused(folder, tmp_path, capsys):
    out = tmp_path / 'out'
    (tmp_path / 'empty').mkdir()
    assert 'holds no cloud' in refuse(capsys, tmp_path / 'empty', '-o', out)
    assert 'matches no file' in refuse(capsys, tmp_path / '*.laz', '-o', out)
    assert 'does not exist' in refuse(capsys, folder / 'a.laz', folder / 'no.laz', '-o', out)
    assert not out.exists()


@pytest.mark.parametrize(('text', 'message'), [
    ('[]', 'is not a tile index: no GeoJSON features'),
    ('{"features": [', 'is not a tile index: no GeoJSON features'),
    ('{"features": []}', 'holds no cloud'),
    ('{"features": [{"properties": {"name": "x"}}]}',
     'feature 1: no path of a tile; expected one of location'),
    ('{"features": [{"properties": {"location": 5}}]}', 'feature 1: 5 is not the path of a tile'),
    ('{"features": [{"properties": {"location": "x.las"}}]}',
     'names x.las, which does not exist'),
    ('{"features": [{"assets": {"thumbnail": {"href": "x.png"}}}]}',
     'names x.png, which does not exist'),
    ('{"features": [{"assets": [5]}]}', 'is not a tile index: no GeoJSON features'),
    ('{"features": [{"properties": {"location": "."}}]}', 'names ., which is not a file'),
    ('{"features": [{"properties": {"location": "https://a.org/x.las"}}]}',
     'names https://a.org/x.las, which is not a file'),
])
def test_a_wrong_index_is_refused(text, message, tmp_path, capsys):
    (tmp_path / 'index.json').write_text(text)
    assert message in refuse(capsys, tmp_path / 'index.json', '-o', tmp_path / 'out')
    assert not (tmp_path / 'out').exists()


@pytest.mark.filterwarnings('error')
def test_a_damaged_geopackage_is_refused(tmp_path, capsys):
    index = tmp_path / 'index.gpkg'
    index.write_bytes(b'SQLite format 3\0' + b'x' * 500)
    assert 'index.gpkg is not a tile index' in refuse(capsys, index, '-o', tmp_path / 'out')


def test_an_index_may_hold_urls_of_files(folder, tmp_path):
    tile = tmp_path / 'a tile.laz'
    tile.write_bytes((folder / 'a.laz').read_bytes())
    index = tmp_path / 'index.json'
    index.write_text(json.dumps({'features': [{'properties': {'href': tile.as_uri()}}]}))
    assert '%20' in index.read_text()
    assert expand_inputs([str(index)]) == [tile]


def test_a_search_passes_over_results(folder, tmp_path, capsys):
    """Else a second run would take the points of the first, and its cells as text."""
    tiles = tmp_path / 'tiles'
    shutil.copytree(folder, tiles)
    for run, item in (('run', tiles), ('pattern', tiles / '**' / '*.laz')):
        for _ in range(2):
            assert main([str(item), '-o', str(tiles / run), *OPTIONS]) == 0
    assert main([str(tiles / 'a.laz'), '-o', str(tiles / 'single'), '--quiet']) == 0
    (tiles / '.hidden').mkdir()
    for name in ('._a.laz', '.hidden/b.laz', '.points.laz.abc.partial'):
        (tiles / name).write_bytes(b'no cloud')
    own = [tiles / 'a.laz', tiles / 'b.las']
    for out in (tmp_path / 'out', tiles / 'run'):
        assert expand_inputs([str(tiles)], out) == own
        assert expand_inputs([str(tiles / '**' / '*.la[sz]')], out) == own
    for pattern in ('*', '**', '*/*', '*/*/*'):
        if pattern == '*/*/*':  # only results are as deep
            with pytest.raises(DataError, match=r'holds no cloud beside results of earlier runs$'):
                expand_inputs([f'{tmp_path}/{pattern}'])
        else:
            assert expand_inputs([f'{tmp_path}/{pattern}']) == own
    for pattern, expected in (
        ('run/tiles/*/points.laz', {'run'}), ('**/points.laz', {'run', 'pattern', 'single'}),
        ('run/tiles', {'run'}),
    ):
        found = expand_inputs([str(tiles / pattern)], tmp_path / 'out')
        assert {path.relative_to(tiles).parts[0] for path in found} == expected
        assert {path.name for path in found} <= {'points.laz'}
    line = refuse(capsys, tiles / 'run', '-o', tmp_path / 'out', *OPTIONS)
    assert line.endswith(
        f"run holds no cloud beside results of earlier runs: name those as '{tiles}/run/**/"
        "points.laz'"
    )


def test_inputs_in_the_folder_of_results_are_refused(folder, tmp_path, capsys):
    """Its files are replaced: with --force the input would be lost."""
    for name, options in (('single', ['--quiet']), ('grid', OPTIONS)):
        out, link = tmp_path / name, tmp_path / f'{name}.laz'
        assert main([str(folder / 'a.laz'), '-o', str(out), *options]) == 0
        (points,) = out.rglob('points.laz')
        link.symlink_to(points)
        for item in (points, link):
            line = refuse(capsys, item, '-o', out, '--force', *options)
            assert line.endswith(
                f'{item} lies in {out}, where the results go: name another folder'
            )
        assert points.is_file()


def test_force_leaves_a_running_grid_alone(folder, tmp_path, capsys):
    out = tmp_path / 'out'
    assert main([str(folder), '-o', str(out), *OPTIONS]) == 0
    before = {path: path.stat().st_mtime_ns for path in out.rglob('*') if path.is_file()}
    with Ledger(out, __version__):
        line = refuse(capsys, folder, '-o', out, *OPTIONS, '--force')
    assert line.endswith('out is in use by another run')
    after = {path: path.stat().st_mtime_ns for path in out.rglob('*') if path.is_file()}
    assert {path for path in before if path.suffix != '.sqlite' and 'sqlite-' not in path.name} \
        <= {path for path, stamp in after.items() if before.get(path) == stamp}
    assert main([str(folder), '-o', str(out), *OPTIONS, '--force']) == 0
    assert (out / 'run.json').stat().st_mtime_ns > before[out / 'run.json']


def test_a_grid_killed_in_a_write_is_resumed(folder, tmp_path):
    """What was half-written is removed, but for what another process holds."""
    out = tmp_path / 'out'
    assert main([str(folder), '-o', str(out), *OPTIONS]) == 0
    (tile,) = {path.parent for path in out.glob('tiles/*/points.laz')}
    rooms = [out / '.grid.gpkg.abc.partial', tile / '.points.laz.abc.partial']
    for options in ([], ['--force']):
        for room in rooms:
            room.mkdir(exist_ok=True, parents=True)
        held = os.open(rooms[0], os.O_RDONLY)
        fcntl.flock(held, fcntl.LOCK_SH)
        assert main([str(folder), '-o', str(out), *OPTIONS, *options]) == 0
        os.close(held)
        assert [room.exists() for room in rooms] == [True, False]
        assert main([str(folder), '-o', str(out), *OPTIONS]) == 0
        assert not list(out.rglob('*.partial'))


def test_a_link_is_taken_by_its_own_name(folder, tmp_path):
    """Stores of large files name them by a digest, without a suffix."""
    tiles = tmp_path / 'tiles'
    tiles.mkdir()
    shutil.copy(folder / 'a.laz', tmp_path / 'd41d8cd9')
    for name in ('a.laz', 'b.laz'):
        (tiles / name).symlink_to(tmp_path / 'd41d8cd9')
    out = tmp_path / 'out'
    assert expand_inputs([str(tiles / 'b.laz'), str(tiles)], out) == [tiles / 'b.laz']
    assert main([str(tiles), '-o', str(out), *OPTIONS]) == 0
    assert json.loads((out / 'run.json').read_text())['num_spans'] == 3


def test_the_cloud_of_an_index_is_the_asset_that_is_one(folder, tmp_path):
    """Beside it there may be a picture; and the file may begin with a byte order mark."""
    index = tmp_path / 'index.vpc'
    picture, cloud = {'href': 'a.png'}, {'href': str(folder / 'a.laz')}
    for assets in (
        {'thumbnail': picture, 'cloud': cloud}, {'data': cloud}, {'data': picture, 'more': cloud},
    ):
        index.write_text(json.dumps({'features': [{'assets': assets}]}), encoding='utf-8-sig')
        assert expand_inputs([str(index)]) == [folder / 'a.laz']


def test_inputs_of_which_none_is_usable_leave_nothing(folder, tmp_path, capsys):
    out = tmp_path / 'out'
    text = tmp_path / 'a.xyz'
    text.write_text('1.0 2.0 3.0\n1.0 hello 3.0\n')
    line = refuse(capsys, text, '-o', out, *OPTIONS)
    assert line.endswith("a.xyz, row 2: 'hello' is not a number: 1.0 hello 3.0")
    text.write_text('nan nan nan\n')
    assert 'holds no finite point, of 1' in refuse(capsys, text, '-o', out, *OPTIONS)
    text.write_text('')
    assert 'none of 1 inputs holds a point' in refuse(capsys, text, '-o', out, *OPTIONS)
    header = tmp_path / 'a.las'
    content = bytearray((folder / 'b.las').read_bytes())
    content[104] = 99  # the point format
    header.write_bytes(content)
    assert 'a.las cannot be read, is it truncated? ' in refuse(capsys, header, '-o', out, *OPTIONS)
    tile = tmp_path / 'a.laz'
    content = (folder / 'a.laz').read_bytes()
    tile.write_bytes(content[:len(content) // 2])
    line = refuse(capsys, tile, '-o', out, *OPTIONS)
    assert f'none of 1 inputs can be used: {tile} cannot be read, is it truncated?' in line
    assert not out.exists()
    assert main([str(folder / 'a.laz'), str(text), '-o', str(out), *OPTIONS]) == 0
    capsys.readouterr()
    line = refuse(capsys, folder / 'b.las', '-o', out, *OPTIONS)
    assert line.endswith(
        f'out holds results of 1 of 1 inputs that are not named any more, as {folder}/a.laz: name'
        ' them as well, or another folder; --force begins anew'
    )
    assert (out / 'index.html').exists()
    assert 'none of 1 inputs can be used' in refuse(capsys, tile, '-o', out, *OPTIONS, '--force')
    assert (out / 'ledger.sqlite').exists()  # of an earlier run


def test_the_ledger_tells_which_inputs_are_in_the_grid_now(folder, tmp_path, capsys):
    def list_inputs():
        rows = parquet.read_table(out / 'ledger.parquet').to_pylist()
        return {
            Path(row['name']).name: (row['state'], bool(row['sha256']), row['error'] or '')
            for row in rows if row['stage'] == 'input'
        }

    tiles, out = tmp_path / 'tiles', tmp_path / 'out'
    shutil.copytree(folder, tiles)
    arguments = [str(tiles), '-o', str(out), *OPTIONS]
    assert main(arguments) == 0
    assert list_inputs() == dict.fromkeys(('a.laz', 'b.las'), ('done', True, ''))
    for name, what in (('a.laz', 'cannot be read, is it truncated?'), ('b.las', 'is truncated')):
        content = (tiles / name).read_bytes()
        (tiles / name).write_bytes(content[:len(content) - 2000])
        assert main(arguments) == 2
        state, has_digest, error = list_inputs()[name]
        assert (state, has_digest) == ('failed', False)
        assert what in error
        (tiles / name).write_bytes(content)
    (tiles / 'b.las').write_bytes(b'')
    assert main(arguments) == 2
    (tiles / 'b.las').unlink()
    assert main(arguments) == 0
    assert list_inputs() == {'a.laz': ('done', True, '')}


def test_a_full_disk_is_told(folder, tmp_path, monkeypatch, capsys):
    """Neither the input nor the program is to blame."""
    def fail(*arguments):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    out = tmp_path / 'out'
    for module, name, text in (
        (cut, '_write', f'none of 1 inputs can be used: {out}/work/cells'),
        (grid_run, 'write_catalogue', out),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(module, name, fail)
            line = refuse(capsys, folder / 'a.laz', '-o', out, *OPTIONS)
        assert line == f'plc_survey: {text} cannot be written: No space left on device'
    assert main([str(folder / 'a.laz'), '-o', str(out), *OPTIONS]) == 0


def test_names_that_are_not_utf8_are_refused(folder, tmp_path, capsys):
    tile = tmp_path / os.fsdecode(b'n\xff.laz')
    tile.write_bytes((folder / 'a.laz').read_bytes())
    text = r'n\udcff.laz: its name is not UTF-8, as names in the ledger are: rename it'
    assert refuse(capsys, folder, tile, '-o', tmp_path / 'out', *OPTIONS).endswith(text)
    line = refuse(capsys, folder, '-o', tmp_path / os.fsdecode(b'n\xff'), *OPTIONS)
    assert r'n\udcff: its name is not UTF-8' in line
    assert list(tmp_path.iterdir()) == [tile]


def test_an_error_names_its_file_once(folder, tmp_path, capsys):
    text = tmp_path / 'a.xyz'
    text.write_text('1.0 hello 3.0\n')
    out = tmp_path / 'out'
    assert main([str(folder / 'a.laz'), str(text), '-o', str(out), *OPTIONS]) == 2
    assert capsys.readouterr().err.splitlines() == [
        f"plc_survey: {text}, row 1: 'hello' is not a number: 1.0 hello 3.0",
        'plc_survey: 1 failed: the results lack what they would add',
    ]


def test_z_that_points_down_is_told(tmp_path, capsys):
    points = make_line(1) * [1.0, 1.0, -1.0]
    path = write_las(tmp_path / 'a.las', points)
    text = f'z from {points[:, 2].min():.6g} to {points[:, 2].max():.6g} is below 0 throughout'
    for options in (OPTIONS[:-1], [*OPTIONS[:-1], '--units', 'm']):
        assert main([str(path), '-o', str(tmp_path / 'out'), '--force', *options]) == 0
        assert text in capsys.readouterr().out
        assert text in json.loads((tmp_path / 'out' / 'run.json').read_text())['notes'][0]


def test_systems_must_agree(tmp_path, capsys):
    points = make_line(1)
    first = write_las(tmp_path / 'a.las', points, 'EPSG:25832')
    second = write_las(tmp_path / 'b.las', points, 'EPSG:25833')
    line = refuse(capsys, first, second, '-o', tmp_path / 'out')
    assert 'different coordinate reference systems' in line
    assert 'zone 32N' in line
    assert 'zone 33N' in line
    line = refuse(capsys, first, write_las(second, points), '-o', tmp_path / 'out')
    assert line.endswith('zone 32N, none): convert them to one, or give --crs')
    options = ('-o', tmp_path / 'out', *OPTIONS)
    assert '--units is for clouds without a CRS: that of' in refuse(
        capsys, first, *options, '--units', 'm'
    )
    assert "unknown coordinate reference system 'EPSG:1'" in refuse(
        capsys, first, *options, '--crs', 'EPSG:1'
    )
    assert not (tmp_path / 'out').exists()


def test_one_system_may_be_spelled_in_two_ways(tmp_path, capsys):
    points = make_line(1)
    first = write_las(tmp_path / 'a.las', points[::2], 'EPSG:25832')
    text = pyproj.CRS(25832).to_wkt('WKT1_GDAL')
    second = write_las(
        tmp_path / 'b.las', points[1::2], text.replace('ETRS89 / UTM zone 32N', 'Zone 32', 1)
    )
    arguments = [str(first), str(second), '-o', str(tmp_path / 'out'), *OPTIONS]
    assert main([*arguments, '--geo']) == 0
    assert json.loads((tmp_path / 'out/run.json').read_text())['num_spans'] == 3


def test_a_grid_that_must_have_a_place_is_refused_without_one(tmp_path, capsys):
    path = write_las(tmp_path / 'a.las', make_line(1))
    for options, name in ((['--quiet'], 'a.las'), (OPTIONS, str(path))):
        line = refuse(capsys, path, '-o', tmp_path / 'out', '--geo', *options)
        assert line == (
            f'plc_survey: {name} has no projected coordinate reference system: give one (--crs for'
            ' a cloud, --origin for a flight)'
        )
    assert not (tmp_path / 'out').exists()


@pytest.mark.parametrize('kind', ['las', 'laz'])
def test_a_grid_takes_the_system_in_an_extended_record(kind, tmp_path):
    las = laspy.read(write_las(
        tmp_path / 'a.las', make_line(1) / 0.3048, offsets=np.floor(ORIGIN / 0.3048)
    ))
    wkt = pyproj.CRS('EPSG:2992').to_wkt('WKT1_GDAL').encode() + b'\0'
    las.evlrs = laspy.vlrs.vlrlist.VLRList([laspy.VLR('LASF_Projection', 2112, '', wkt)])
    las.header.global_encoding.wkt = True
    path = tmp_path / f'b.{kind}'
    las.write(path)
    (with_system, without), _ = read_sources([path, tmp_path / 'a.las'])
    assert pyproj.CRS(with_system.crs).to_epsg() == 2992
    assert with_system.units == (0.3048, 0.3048)
    assert with_system.low == pytest.approx(make_line(1).min(axis=0), abs=1e-3)
    assert without.crs == ''


def test_a_header_must_count_its_points(tmp_path, capsys):
    path = write_las(tmp_path / 'a.las', make_line(1))
    data = bytearray(path.read_bytes())
    count = int.from_bytes(data[247:255], 'little')
    data[247:255] = (count - 7).to_bytes(8, 'little')
    path.write_bytes(bytes(data))
    for options in (['--memory', '2'], []):  # as a grid, and as a single cloud
        line = refuse(capsys, path, '-o', tmp_path / 'out', *options)
        assert f'holds {count} points and its header counts {count - 7}' in line
    assert not (tmp_path / 'out').exists()


@pytest.mark.slow
def test_grids_are_compared(tmp_path, capsys):
    points = make_line(2)
    before = write_las(tmp_path / 'before.las', points, 'EPSG:25832')
    assert main([str(before), '-o', str(tmp_path / 'before'), '--tile', '90', *OPTIONS]) == 0
    tree = (points[:, 2] > ORIGIN[2] + 0.5) & (points[:, 2] < ORIGIN[2] + 11.3)
    points[tree, 2] += 0.4
    after = write_las(tmp_path / 'after.las', points, 'EPSG:25832')
    out = tmp_path / 'after'
    assert main([str(after), '-o', str(out), '--tile', '70', *OPTIONS,
                 '--baseline', str(tmp_path / 'before')]) == 0
    record = json.loads((out / 'changes.json').read_text())
    assert (len(record['spans']), record['lost_spans'], record['added_spans']) == (6, [], [])
    assert len(record['kept_hazards']) == 1
    assert [row['median'] for row in record['growth']] == [pytest.approx(0.4, abs=0.01)]
    assert 'Changes since before' in (out / 'index.html').read_text()
    assert compare(['--quiet', str(tmp_path / 'before'), str(out), '-o',
                    str(tmp_path / 'changes.json')]) == 0
    assert json.loads((tmp_path / 'changes.json').read_text()) == record
    # a grid and a single survey are compared as well, and a grid elsewhere is refused by name
    assert main([str(before), '-o', str(tmp_path / 'single'), '--quiet']) == 0
    assert compare(['--quiet', str(tmp_path / 'single'), str(out), '-o',
                    str(tmp_path / 'both.json')]) == 0
    both = json.loads((tmp_path / 'both.json').read_text())
    assert both['growth'] == record['growth']
    (tmp_path / 'before/index.html').rename(tmp_path / 'index.html')  # as while a run goes on
    capsys.readouterr()
    assert compare([str(tmp_path / 'before'), str(out)]) == 2
    assert 'is a grid whose last run has not come to its end' in capsys.readouterr().err
    (tmp_path / 'index.html').rename(tmp_path / 'before/index.html')
    far = write_las(tmp_path / 'far.las', points + 900.0, 'EPSG:25832')
    assert main([str(far), '-o', str(tmp_path / 'far'), *OPTIONS,
                 '--baseline', str(tmp_path / 'before')]) == 2
    said = capsys.readouterr().err
    assert 'do not overlap: none of 6 spans before is one of 6 after' in said
    assert 'points are missing' not in said
    assert 'Not inspected' not in (tmp_path / 'far' / 'index.html').read_text()
    other = write_las(tmp_path / 'other.las', points, 'EPSG:25833')
    line = refuse(capsys, other, '-o', tmp_path / 'other', *OPTIONS,
                  '--baseline', tmp_path / 'before')
    assert 'surveys are compared in one reference system' in line
    assert not (tmp_path / 'other').exists()


def test_the_geopackage_keeps_the_vertical_system(tmp_path):
    path = write_las(tmp_path / 'a.las', make_line(1), 'EPSG:25832+7837')
    out = tmp_path / 'out'
    assert main([str(path), '-o', str(out), *OPTIONS]) == 0
    for layer in ('spans', 'supports', 'hazards'):
        crs = pyproj.CRS(pyogrio.read_info(out / 'grid.gpkg', layer=layer)['crs'])
        assert crs.sub_crs_list[1].name == 'DHHN2016 height'


@pytest.mark.parametrize(('name', 'write'), [
    ('a.las', write_las), ('a.copc.laz', write_copc), ('a.ply', write_ply), ('a.e57', write_e57),
    ('a.pcd', write_pcd), ('a.xyz', write_xyz), ('a.csv', write_xyz),
])
def test_a_cloud_larger_than_memory_is_told_before_it_is_read(
    name, write, tmp_path, capsys, monkeypatch
):
    path, num = tmp_path / name, len(make_line(1))
    write(path, make_line(1))
    found = count_points(path)
    assert found == pytest.approx(num, rel=0.1 if name[-3:] in ('xyz', 'csv') else 0.0)
    monkeypatch.setattr(survey, 'LARGEST_UNASKED', 0)
    monkeypatch.setattr(survey, 'BYTES_PER_POINT', 1_000_000)
    monkeypatch.setattr(engine, 'measure_available', lambda: 2.5e9)
    line = refuse(capsys, path, '-o', tmp_path / 'out')
    assert f'holds {found:,} points: one run over all of them takes' in line
    assert line.endswith('2.5 GB are free: survey it in tiles, as with --memory 2.0')
    assert not (tmp_path / 'out').exists()
    monkeypatch.setattr(survey, 'BYTES_PER_POINT', 150)
    survey.check_memory(path)
    path.write_bytes(b'x' * 3000)  # told where it is read
    survey.check_memory(path)


def test_wrong_options_are_refused(folder, tmp_path, capsys):
    out, cloud = tmp_path / 'out', folder / 'a.laz'
    assert '--workers must be 1 or more' in refuse(capsys, cloud, '-o', out, '--workers', '0')
    with pytest.raises(SystemExit, match='2'):
        refuse(capsys, cloud, '-o', out, '--workers', '2', '--scheduler', 'tcp://127.0.0.1:8786')
    assert '--scheduler: not allowed with argument --workers' in capsys.readouterr().err
    assert 'are too few' in refuse(capsys, cloud, '-o', out, '--memory', '0.5')
    for value in ('nan', '0', '1e300'):
        line = refuse(capsys, cloud, '-o', out, '--memory', value)
        assert f'--memory must be 0.1 or more, at most 1e+09, got {float(value):g}' in line
    assert 'for a single cloud' in refuse(capsys, cloud, '-o', out, '--halo', '60', '--pdf')
    assert 'not a results folder' in refuse(
        capsys, cloud, '-o', out, '--halo', '60', '--baseline', folder
    )
    out.touch()
    assert 'out exists and is not a folder' in refuse(capsys, cloud, '-o', out, '--halo', '60')
    out.unlink()
    out.symlink_to(tmp_path / 'nowhere')
    assert 'out exists and is not a folder' in refuse(capsys, cloud, '-o', out, '--halo', '60')
    out.unlink()
    out.mkdir()
    (out / 'ledger.sqlite').write_text('no database, though of some length\n' * 9)
    line = refuse(capsys, cloud, '-o', out, '--halo', '60', '--memory', '2')
    assert 'ledger.sqlite is damaged' in line
    assert line.endswith('; --force begins anew')
    assert main([str(cloud), '-o', str(out), *OPTIONS, '--force']) == 0
    shutil.rmtree(out)
    out.mkdir()
    (out / 'mine.txt').touch()
    assert 'mine.txt is not one of its files' in refuse(capsys, cloud, '-o', out, '--halo', '60')
    assert 'mine.txt is not one of its files' in refuse(
        capsys, cloud, '-o', out, '--halo', '60', '--force'
    )
    assert (out / 'mine.txt').exists()


@pytest.mark.slow
@pytest.mark.parametrize(('usual', 'is_local'), [(100, True), (6_000_000, False)])
def test_many_tiles_are_inspected_by_a_local_cluster(
    usual, is_local, folder, tmp_path, monkeypatch
):
    """The ledger tells in which process each task ran."""
    monkeypatch.setattr(layout, 'USUAL_POINTS', usual)
    monkeypatch.setattr(engine, 'measure_available', lambda: 9e9)
    monkeypatch.setattr(engine.os, 'sched_getaffinity', lambda _: {0, 1})
    out = tmp_path / 'out'
    assert main([str(folder), '-o', str(out), *OPTIONS]) == 0
    with Ledger(out, __version__) as ledger:
        processes = {
            entry['worker'] for entry in ledger.list_entries() if entry['stage'] != 'input'
        }
    own = f'{os.uname().nodename} {os.getpid()}'
    assert (processes == {own}) is not is_local
    assert (own in processes) is not is_local
