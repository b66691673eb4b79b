# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A grid finds what one run over all of its points finds, wherever it is cut."""

from dataclasses import replace
import errno
import hashlib
from itertools import pairwise
import json
import re
import shutil

from factories import make_inspection
from grid.grids import GIGABYTES, inspect, make_line, open_run, ORIGIN, write_las
import laspy
import numpy as np
from pyarrow import parquet
import pyogrio
import pytest
from scipy.spatial import cKDTree
from toys import make_ground, make_wire

from plc_inspect import __version__
from plc_inspect.config import Settings
from plc_inspect.core.coverage.airspace import SAFE
from plc_inspect.core.extraction.height import extract_high
from plc_inspect.core.line_finder import find_lines
from plc_inspect.core.pipeline import enter_frame, Pipeline
from plc_inspect.core.stage_log import StageLog
from plc_inspect.errors import DataError
from plc_inspect.grid import run as grid_run
from plc_inspect.grid import survey_grid, whole_values
from plc_inspect.grid.cells import cut
from plc_inspect.grid.cells.room import open_room
from plc_inspect.grid.engine import call, OwnProcess, Task
from plc_inspect.grid.ledger import Ledger
from plc_inspect.grid.stage import Stage
from plc_inspect.grid.tiles import tile_run
from plc_inspect.grid.tiles.survey_whole import load_surface, measure_candidates, measure_ground
from plc_inspect.grid.tiles.tile_run import inspect_tile
from plc_inspect.offline.readers.clouds import read_cloud
from plc_inspect.offline.records.coverage_record import ENOUGH, review_coverage
from plc_inspect.offline.records.results_reader import parse_span, read_table
from plc_inspect.offline.records.units import Units

CUTS = [{'edge': 45.0, 'tile_edge': 90.0, 'shift': (0.0, 0.0), 'halo': 130.0},
        {'edge': 37.0, 'tile_edge': 80.0, 'shift': (17.3, 5.1), 'halo': 130.0},
        # at first the halo ends just behind a support, where conductors are bent
        {'edge': 45.0, 'tile_edge': 45.0, 'shift': (8.0, 3.0), 'halo': 50.0}]


@pytest.fixture(scope='module')
def cloud(tmp_path_factory):
    """Write the line as one file."""
    return write_las(tmp_path_factory.mktemp('cloud') / 'line.las', make_line(), 'EPSG:25832')


@pytest.fixture(scope='module')
def merged(cloud):
    """Inspect it in one run."""
    return Pipeline().run(read_cloud(cloud).points)


def collect(folder):
    """Return coordinates, classes, lines and spans of all tiles, sorted by coordinates."""
    parts = []
    for path in sorted(folder.glob('tiles/*/points.laz')):
        las = laspy.read(path)
        parts.append(np.column_stack([
            las.X, las.Y, las.Z, las.classification, las.line_id, las.span_id,
            las.original_classification, las.intensity,
        ]))
    table = np.concatenate(parts)
    return table[np.lexsort(table[:, 2::-1].T)]


@pytest.mark.slow
@pytest.mark.parametrize('cut', CUTS)
def test_a_grid_is_equal_to_the_merged_cloud(cut, cloud, merged, tmp_path):
    summary, jobs = inspect(tmp_path / 'out', [cloud], **cut)
    joined = summary.joined
    assert len(jobs) > 5
    assert summary.failures == ()
    assert joined.num_unmatched == 0
    assert len(merged.spans) == 12
    assert len(merged.hazards) > 0
    assert len(joined.spans) == len(merged.spans)
    for own, other in zip(joined.spans, merged.spans, strict=True):
        assert (own.line_id, own.span_id) == (other.line_id, other.span_id)
        np.testing.assert_allclose(own.start, other.start, atol=1e-3)
        np.testing.assert_allclose(own.end, other.end, atol=1e-3)
        assert own.sag == pytest.approx(other.sag, abs=1e-3)
        assert (own.open_start, own.open_end) == (other.open_start, other.open_end)
    assert [item.line_ids for item in joined.supports] == [
        item.line_ids for item in merged.supports
    ]
    for own, other in zip(joined.hazards, merged.hazards, strict=True):
        assert (own.kind, own.severity, own.span_id) == (other.kind, other.severity, other.span_id)
        assert own.clearance == pytest.approx(other.clearance, abs=1e-3)
    table = collect(tmp_path / 'out')
    las = laspy.read(cloud)
    whole = np.column_stack([
        las.X, las.Y, las.Z, merged.classification, merged.line_id, merged.span_id,
        las.classification, las.intensity,
    ])
    whole = whole[np.lexsort(whole[:, 2::-1].T)]
    np.testing.assert_array_equal(table[:, :3], whole[:, :3])
    np.testing.assert_array_equal(table[:, 4:], whole[:, 4:])
    assert (table[:, 3] != whole[:, 3]).sum() <= 1e-4 * len(whole)


@pytest.mark.slow
def test_spans_that_memory_cuts_off_are_told_and_looked_at_again(tmp_path, monkeypatch):
    path = write_las(tmp_path / 'line.las', make_line(1))
    cut = {'edge': 45.0, 'tile_edge': 45.0, 'halo': 20.0}
    with monkeypatch.context() as patch:
        patch.setattr(grid_run, 'count_allowed', lambda memory: 11_000)
        summary, _ = inspect(tmp_path / 'out', [path], **cut)
    note = summary.notes[-1]
    assert re.match(r'spans near \d+ tiles are cut off by halos of 30 m and more, and mem', note)
    told = []
    summary, jobs = inspect(tmp_path / 'out', [path], told, **cut)
    assert not any('cut off' in note for note in summary.notes)
    assert next(done for step, done, *_ in told if step == 'tile') < len(jobs)
    whole = Pipeline().run(read_cloud(path).points)
    assert [own.sag for own in summary.joined.spans] == pytest.approx(
        [own.sag for own in whole.spans], abs=1e-3
    )
    told.clear()
    inspect(tmp_path / 'out', [path], told, **cut)  # and not once more
    assert [step[1:] for step in told if step[0] == 'tile'] == [(len(jobs), len(jobs), 0)]


@pytest.mark.slow
def test_the_page_opens_the_reports_of_sections(cloud, merged, tmp_path):
    """They tell of each span what one run over the merged cloud tells, across tiles."""
    # the middle of the first span lies on the border of two tiles
    summary, jobs = inspect(tmp_path / 'out', [cloud], edge=60.0, tile_edge=60.0, halo=130.0)
    page = (tmp_path / 'out' / 'index.html').read_text()
    links = re.findall(r'href="(tiles/[^"#]+/report\.html)#(hazard-\d+)"', page)
    assert len(links) == len(merged.hazards) > 0
    for place, anchor in links:
        assert f'id="{anchor}"' in (tmp_path / 'out' / place).read_text()
    for name in re.findall(r'href="(tiles/[^"#]+)', page):
        assert (tmp_path / 'out' / name).is_file()
    counts = re.findall(r'</a></td><td class="n">[\d,]+</td><td class="n">(\d+)</td>', page)
    assert len(counts) == len(jobs)
    assert sum(map(int, counts)) == len(merged.spans)
    told = re.findall(r'(critical|warning|notice)</span></td><td>', page)
    assert told == sorted(told, key=('critical', 'warning', 'notice').index)

    points = read_cloud(cloud).points
    coverage = review_coverage(make_inspection(result=merged, points=points)).coverage
    own = {
        item.section.span_id: (item.is_enough, sum(gap.length for gap in item.gaps))
        for item in coverage.sections
    }
    found = {}
    for path in (tmp_path / 'out').glob('tiles/*/coverage.json'):
        record = json.loads(path.read_text())
        for item in record['sections']:
            lengths = [record['gaps'][number]['length'] for number in item['gaps']]
            found[item['span_id']] = item['verdict'] == ENOUGH, sum(lengths)
    assert found.keys() == own.keys()
    for span_id, (is_enough, length) in own.items():
        assert found[span_id] == (is_enough, pytest.approx(length, abs=0.01))
    assert len({enough for enough, _ in own.values()}) == 2
    assert summary.sight['num_enough'] == sum(enough for enough, _ in own.values())
    assert summary.sight['num_sections'] == len(own)
    assert summary.sight['of_conductors'] == pytest.approx(1.0, abs=0.05)
    assert len(list((tmp_path / 'out').glob('tiles/*/report.html'))) < len(jobs)


@pytest.mark.slow
def test_flights_over_gaps_keep_off_conductors_of_other_tiles(tmp_path):
    """A line that crosses 52 m beyond the open end belongs to another tile."""
    ends = ORIGIN + np.array([[427.0, 40.0, 18.0], [374.0, 190.0, 18.0]])
    across = make_wire(*ends, c=2000.0, seed=7)
    path = write_las(tmp_path / 'lines.las', np.vstack([make_line(), across]), 'EPSG:25832')
    inspect(tmp_path / 'out', [path], edge=45.0, tile_edge=90.0, halo=130.0)
    units = Units()
    spans = [parse_span(row, units) for row in read_table(tmp_path / 'out', 'spans')['spans']]
    assert len({span.line_id for span in spans}) == 4
    wires = cKDTree(np.vstack([
        span.positions(np.arange(0.0, span.length, 0.5)) for span in spans
    ]))
    flown = 0
    for path in (tmp_path / 'out').glob('tiles/*/coverage.json'):
        way = np.array([
            row['position'] for row in json.loads(path.read_text())['refly']['waypoints']
        ])
        for first, last in pairwise(way):
            steps = np.linspace(0.0, 1.0, 100)[:, None]
            assert wires.query(first + steps * (last - first))[0].min() >= SAFE - 0.01
            flown += 1
    assert flown > 10


def test_the_usual_distance_of_candidates_is_that_of_the_whole(tmp_path):
    """Also where some are alone in their tile, and their neighbours hundreds of metres away."""
    stump = make_wire((330.0, 390.0, 14.0), (332.0, 390.0, 14.0), per_metre=5.0) + ORIGIN
    ground = make_ground((310.0, 370.0), (360.0, 410.0), per_square_metre=0.8) + ORIGIN
    points = np.round(np.vstack([make_line(1), stump, ground]), 3)
    path = write_las(tmp_path / 'line.las', points)
    _, jobs = inspect(tmp_path / 'out', [path], edge=45.0, tile_edge=90.0, halo=130.0)
    assert len(jobs) >= 3
    with Ledger(tmp_path / 'out', __version__) as ledger:
        whole = ledger.find_fact('whole')['whole']
    own, frame, _ = enter_frame(read_cloud(path).points)
    found = find_lines(own, Settings(), StageLog(None), frame.east).outliers
    assert whole['spacing'] == pytest.approx([found.mean, found.sigma], rel=1e-9)
    assert not list((tmp_path / 'out' / 'work').glob('**/*candidates*'))


@pytest.mark.slow
@pytest.mark.parametrize('step', ['measure_bounds', 'measure_ground', 'measure_candidates'])
def test_values_of_the_whole_are_measured_to_the_end(step, cloud, tmp_path, monkeypatch):
    """Not kept from a run that failed at a tile, as on a full disk."""
    cut = {'edge': 45.0, 'tile_edge': 180.0, 'halo': 130.0}
    inspect(tmp_path / 'whole', [cloud], **cut)
    measure, failed = getattr(whole_values, step), []

    def fail_once(job, *more):
        if failed:
            return measure(job, *more)
        failed.append(job.tile.name)
        raise OSError(errno.ENOSPC, 'No space left on device')

    monkeypatch.setattr(whole_values, step, fail_once)
    first, _ = inspect(tmp_path / 'out', [cloud], **cut)
    assert any('No space left' in error for *_, error in first.failures)
    second, _ = inspect(tmp_path / 'out', [cloud], **cut)
    assert second.failures == ()
    runs = [json.loads((tmp_path / name / 'run.json').read_text()) for name in ('whole', 'out')]
    assert runs[0]['whole'] == runs[1]['whole']
    assert not list((tmp_path / 'out').glob('work/tiles/*.heights.npz'))


@pytest.mark.slow
@pytest.mark.parametrize('change', [{'halo': 190.0}, {}])
def test_ground_that_a_stopped_run_left_is_that_of_its_halo_and_inputs(
    change, cloud, tmp_path, monkeypatch
):
    cut = {'edge': 45.0, 'tile_edge': 180.0, 'halo': 130.0}

    def stop(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(survey_grid, 'inspect_tiles', stop)
        with pytest.raises(KeyboardInterrupt):
            inspect(tmp_path / 'out', [cloud], **cut)
    assert list((tmp_path / 'out').glob('work/tiles/*.heights.npz'))
    inspect(tmp_path / 'whole', [cloud], **cut | change)
    summary, _ = inspect(tmp_path / 'out', [cloud], **cut | change)
    assert summary.failures == ()
    np.testing.assert_array_equal(collect(tmp_path / 'out'), collect(tmp_path / 'whole'))
    assert not list((tmp_path / 'out').glob('work/tiles/*.heights.npz'))


@pytest.mark.slow
def test_tiles_take_the_ground_that_was_measured_with_the_whole(cloud, tmp_path, monkeypatch):
    cut = {'edge': 45.0, 'tile_edge': 180.0, 'halo': 130.0}
    loaded = []

    def load(job):
        loaded.append(job.tile.name)
        return load_surface(job)

    monkeypatch.setattr(tile_run, 'load_surface', load)
    inspect(tmp_path / 'kept', [cloud], **cut)
    assert len(loaded) > 1
    monkeypatch.setattr(tile_run, 'load_surface', lambda job: None)
    inspect(tmp_path / 'anew', [cloud], **cut)
    np.testing.assert_array_equal(collect(tmp_path / 'kept'), collect(tmp_path / 'anew'))


@pytest.mark.slow
def test_results_of_before_sub_conductors_were_known_are_read(cloud, tmp_path):
    cut = {'edge': 45.0, 'tile_edge': 180.0, 'halo': 130.0}
    inspect(tmp_path / 'out', [cloud], **cut)
    before = collect(tmp_path / 'out')
    held = 0
    for path in (tmp_path / 'out').glob('work/tiles/*.json'):
        value = json.loads(path.read_text())
        for span in value['spans']:
            del span['strands']
            held += 1
        path.write_text(json.dumps(value))
    assert held > 0
    summary, _ = inspect(tmp_path / 'out', [cloud], **cut)
    assert summary.failures == ()
    np.testing.assert_array_equal(collect(tmp_path / 'out'), before)


@pytest.mark.slow
@pytest.mark.parametrize('gone', ['work', 'work/cells/s000000_0000', 'coverage', 'labels'])
def test_what_was_removed_is_made_again(gone, cloud, tmp_path):
    cut = {'edge': 45.0, 'tile_edge': 180.0, 'halo': 130.0}
    folder = tmp_path / 'out'
    inspect(folder, [cloud], **cut)
    before = collect(folder)
    if gone in ('coverage', 'labels'):
        places = folder.glob({'coverage': 'tiles/*/coverage.json', 'labels': 'work/tiles/*.npz'}[
            gone
        ])
        for path in list(places):
            path.unlink()
    else:
        shutil.rmtree(folder / gone)
    for path in folder.glob('tiles/*/points.laz'):
        path.unlink()
    summary, _ = inspect(folder, [cloud], **cut)
    assert summary.failures == ()
    np.testing.assert_array_equal(collect(folder), before)
    for path in folder.glob('tiles/*/report.html'):
        assert (path.parent / 'coverage.json').is_file()


@pytest.mark.slow
def test_tasks_of_a_killed_run_leave_the_next_one_alone(cloud, tmp_path, monkeypatch):
    """Those that have begun go on in the workers of a cluster, beside those of that run."""
    class Recorder(OwnProcess):
        def run(self, tasks):
            begun.extend(tasks)
            return super().run(tasks)

    def stamp():
        return {path: path.stat().st_mtime_ns for path in work.glob('*/*')}

    def read_slowly(source, part):
        for points, attributes in read(source, part):
            yield points[::2], attributes[::2]
            with open_room(work):  # the next run begins
                yield points[1::2], attributes[1::2]

    begun, read, work = [], cut.read_part, tmp_path / 'out/work'
    inspect(tmp_path / 'out', [cloud], engine=Recorder(GIGABYTES), tile_edge=180.0, halo=130.0)
    before, tried = stamp(), {cut.cut_part, measure_ground, measure_candidates, inspect_tile}
    assert tried <= {task.function for task in begun}
    for task in begun:
        if task.function in tried:
            assert 'No such file or directory' in call(task).error
    monkeypatch.setattr(cut, 'read_part', read_slowly)
    with open_room(work) as room, pytest.raises(DataError, match='No such file or directory'):
        cut.cut_part(str(room), *begun[0].arguments[1:])
    assert stamp() == before


def test_heights_of_a_grid_are_those_of_the_whole(tmp_path):
    """Where ground was not seen it is filled in from afar: the peak of the histogram tells."""
    def rise(x, y):
        return 0.15 * x + 2.0 * np.sin(x / 30.0) + 0.1 * y

    ground = make_ground((0, 0), (400, 60), per_square_metre=0.8, height=rise)
    ground = ground[(ground[:, 0] < 150.0) | (ground[:, 0] > 180.0)]
    wire = make_wire((0.0, 30.0, 20.0), (400.0, 30.0, 80.0), c=3000.0, per_metre=3)
    path = write_las(tmp_path / 'gap.las', np.round(np.vstack([ground, wire]) + ORIGIN, 3))
    inspect(tmp_path / 'out', [path], edge=45.0, tile_edge=90.0, halo=300.0)
    with Ledger(tmp_path / 'out', __version__) as ledger:
        whole = ledger.find_fact('whole')['whole']
    own, *_ = enter_frame(read_cloud(path).points)
    found = extract_high(own, Settings().height)
    assert whole['peak'] + Settings().height.beta == pytest.approx(found.threshold, abs=1e-9)


@pytest.mark.slow
def test_a_grid_of_surveyed_points_keeps_the_class_of_before(cloud, tmp_path):
    inspect(tmp_path / 'first', [cloud], halo=250.0)
    tiles = sorted((tmp_path / 'first').glob('tiles/*/points.laz'))
    inspect(tmp_path / 'again', tiles, halo=250.0)
    before, again = collect(tmp_path / 'first'), collect(tmp_path / 'again')
    assert (before[:, 3] != before[:, 6]).any()
    np.testing.assert_array_equal(again[:, 6], before[:, 6])


@pytest.mark.slow
def test_points_have_colours_where_those_of_an_input_do(cloud, tmp_path):
    def read_formats():
        return {
            laspy.open(path).header.point_format.id
            for path in tmp_path.glob('out/tiles/*/points.laz')
        }

    inspect(tmp_path / 'out', [cloud], halo=250.0)
    assert read_formats() == {6}
    coloured = laspy.convert(laspy.read(cloud), point_format_id=7)
    coloured.write(tmp_path / 'coloured.laz')
    inspect(tmp_path / 'out', [cloud, tmp_path / 'coloured.laz'], halo=250.0)
    assert read_formats() == {7}


def test_the_largest_tasks_run_first(tmp_path):
    class Recorder(OwnProcess):
        def run(self, tasks):
            ran.extend(task.size for task in tasks)
            return iter(())

    ran = []
    with Ledger(tmp_path, __version__) as ledger:
        run = open_run(tmp_path, ledger, engine=Recorder(GIGABYTES))
        tasks = [
            Task(name=str(size), function=dict, arguments=(), size=size) for size in (3, 9, 1, 7)
        ]
        run.run('tile', tasks, {task.name: '' for task in tasks})
    assert ran == [9, 7, 3, 1]


def test_stages_that_run_together(tmp_path):
    class Last(OwnProcess):
        """Ends the tasks in the order opposite to that of a process."""

        def run(self, tasks):
            return iter([*super().run(tasks)][::-1])

    def fail():
        raise DataError('damaged')

    def make_stage(name, numbers):
        return Stage(name=name, keys=dict.fromkeys(map(str, numbers), ''), tasks=[
            Task(name=str(k), function=dict, arguments=([('stage', name)],)) for k in numbers
        ])

    told = []
    stages = [make_stage('first', range(2)), make_stage('second', range(3))]
    stages[1].tasks[2] = replace(stages[1].tasks[2], function=fail, arguments=())
    with Ledger(tmp_path, __version__) as ledger:
        run = open_run(tmp_path, ledger, told=told, engine=Last(GIGABYTES))
        answers = run.run_together(*stages)
        assert ledger.list_failures() == [('second', '2', 'damaged')]
    one, two = {'stage': 'first'}, {'stage': 'second'}
    assert answers == [{'0': one, '1': one}, {'0': two, '1': two}]
    assert run.failures == ['second 2: damaged']
    assert told[0] == ('first', 0, 2, 0)
    assert told[1] == ('second', 1, 3, 1)
    assert told[-1] == ('second', 3, 3, 1)
    assert ('second', 0, 3, 0) not in told  # whose time would begin too early
    with Ledger(tmp_path, __version__) as ledger:
        again = open_run(tmp_path, ledger, told=told)
        assert again.run_together(*stages) == answers
        assert again.failures == run.failures


@pytest.mark.slow
def test_the_folder_holds_tables_layers_and_a_page(cloud, tmp_path):
    points = read_cloud(cloud).points
    first = write_las(tmp_path / 'a.las', points[::2], 'EPSG:25832')
    second = write_las(tmp_path / 'b.laz', points[1::2], 'EPSG:25832')
    told = []
    summary, jobs = inspect(tmp_path / 'out', [first, second], told, halo=130.0, edge=60.0)
    folder = tmp_path / 'out'
    head = json.loads((folder / 'run.json').read_text())
    assert head['num_points'] == len(points)
    assert head['num_spans'] == len(summary.joined.spans)
    assert 0.3 < head['kilometres'] < 0.4
    for name in ('spans', 'supports', 'hazards'):
        info = pyogrio.read_info(folder / 'grid.gpkg', layer=name)
        assert info['features'] == len(getattr(summary.joined, name))
        assert 'EPSG:25832' in info['crs']
    assert (folder / 'spans.csv').read_text().startswith('line_id,span_id,start_x [m],')
    ledger = parquet.read_table(folder / 'ledger.parquet')
    rows = ledger.to_pylist()
    assert json.loads(ledger.schema.metadata[b'settings']) == head['settings']
    assert [(row['name'], row['sha256']) for row in rows if row['stage'] == 'input'] == [
        (str(path), hashlib.sha256(path.read_bytes()).hexdigest()) for path in (first, second)
    ]
    tiles = {row['name']: row for row in rows if row['stage'] == 'tile'}
    assert set(tiles) == {job.tile.name for job in jobs}
    assert sum(row['num_points'] for row in tiles.values()) == len(points)
    assert {(row['state'], row['version'], row['error']) for row in tiles.values()} == {
        ('done', __version__, ''),
    }
    assert min(row['seconds'] for row in tiles.values()) > 0.0
    page = (folder / 'index.html').read_text()
    assert jobs[0].tile.name in page
    assert 'vegetation' in page

    # nothing is done again, and one input that changed is
    told.clear()
    inspect(folder, [first, second], told, halo=130.0, edge=60.0)
    assert all(
        done == total for step, done, total, _ in told if not step.startswith('memory')
    )
    moved = points[1::2][:-40]
    write_las(second, moved, 'EPSG:25832')
    told.clear()
    again, _ = inspect(folder, [first, second], told, halo=130.0, edge=60.0)
    assert ('cut', 1, 2, 0) in told
    assert ('cut', 0, 2, 0) not in told
    assert again.num_points == len(points) - 40
