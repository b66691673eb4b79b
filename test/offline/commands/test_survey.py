# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""``plc_survey``: exit codes, messages, and a folder that is whole or not there."""

import fcntl
import json
import os
from pathlib import Path
import signal
import struct
import subprocess
import sys
import termios
import textwrap
import types

from factories import make_empty_result, make_inspection
import laspy
import numpy as np
import pytest

from plc_inspect.config import Settings
from plc_inspect.offline.commands import survey as command
from plc_inspect.offline.commands.explain import read_folder
from plc_inspect.offline.commands.survey import main
from plc_inspect.offline.export.file_names import FILES
from plc_inspect.offline.readers.clouds import read_cloud
from plc_inspect.results import PointClass

ROOT = Path(__file__).parents[3]
UTM = (615_300.0, 5_712_000.0, 30.0)


class StandIn:
    """A pipeline that finds the lines of ``make_inspection`` whatever it is given."""

    result = None
    given = None

    def __init__(self, settings, rules=None):
        self.settings = settings

    def run(self, points, progress=None):
        """Return the prepared result, or an empty one where the count does not fit."""
        type(self).given = points.copy()
        if isinstance(self.result, BaseException):
            raise self.result
        if progress is not None:
            progress('height', 0.5)
        if self.result is None or self.result.num_points != len(points):
            return make_empty_result(len(points))
        return self.result


@pytest.fixture
def pipeline(monkeypatch):
    """Put a stand-in in the place of the pipeline."""
    module = types.ModuleType('plc_inspect.core.pipeline')
    module.Pipeline = type('Pipeline', (StandIn,), {})
    monkeypatch.setitem(sys.modules, 'plc_inspect.core.pipeline', module)
    return module.Pipeline


def write_las(path, points, classes=None, scale=1e-3):
    """Write points as a LAS or LAZ file."""
    header = laspy.LasHeader(point_format=6, version='1.4')
    header.scales = np.full(3, scale)
    header.offsets = np.floor(points.min(axis=0)) if len(points) else np.zeros(3)
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    if classes is not None:
        las.classification = classes
    las.write(path)
    return path


def run(*argv):
    """Run the command in this process and return its exit code."""
    try:
        return main([str(item) for item in argv])
    except SystemExit as error:
        return error.code


def nearest_tree(result):
    """Return the distance of the third nearest tree point to a conductor."""
    return np.sort(result.clearance[result.classification == PointClass.VEGETATION])[2]


def check_refusal(code, capfd, *words):
    """Check exit code 2 and one line on stderr that holds the words."""
    out, err = capfd.readouterr()
    assert code == 2
    assert out == ''
    assert err.count('\n') == 1, err
    assert err.startswith('plc_survey: ')
    for word in words:
        assert str(word) in err


def test_a_point_far_from_all_others_costs_decimals_only(tmp_path, pipeline, capfd):
    points = np.concatenate([make_inspection(origin=UTM).points, np.zeros((1, 3))])
    cloud = tmp_path / 'cloud.xyz'
    np.savetxt(cloud, points, fmt='%.3f')
    assert run(cloud, '-o', tmp_path / 'out') == 0
    assert (
        f'\nnote: coordinates span {points[:, 1].max():.6g}, which LAS holds in steps of 0.01 in'
        ' points.laz: is a point far from all others?\n'
    ) in capfd.readouterr().out
    found = laspy.read(tmp_path / 'out' / 'points.laz').xyz
    np.testing.assert_allclose(found, points, rtol=0, atol=0.0056)


def test_a_name_that_is_not_utf8_is_written_as_far_as_it_can_be(tmp_path, pipeline, capfd):
    inspection = make_inspection(num_ground=200)
    pipeline.result = inspection.result
    cloud = tmp_path / os.fsdecode(b'n\xff.las')
    write_las(tmp_path / 'cloud.las', inspection.points).rename(cloud)
    assert run(cloud, '-o', tmp_path / 'out') == 0
    out, err = capfd.readouterr()
    assert err == ''
    assert out.startswith('n\ufffd.las: ')
    assert f'note: {tmp_path}/n\\udcff.las has no coordinate reference system' in out
    record = json.loads((tmp_path / 'out' / 'run.json').read_text(encoding='utf-8'))
    assert 'n\ufffd.las' in json.dumps(record, ensure_ascii=False)


def test_folder_table_and_report(tmp_path, pipeline, capfd):
    inspection = make_inspection(origin=UTM)
    pipeline.result = inspection.result
    cloud = write_las(tmp_path / 'cloud.laz', inspection.points)
    assert run(cloud, '-o', tmp_path / 'out') == 0
    out, err = capfd.readouterr()
    assert err == ''
    assert sorted(item.name for item in (tmp_path / 'out').iterdir()) == sorted(FILES)
    lines = out.splitlines()
    assert lines[0].startswith('cloud.laz: 23,840 points, 3 lines, 2 spans, 3 supports, 1 hazard')
    assert lines[2].split()[:4] == ['line', 'span', 'length', '[m]']
    assert lines[3].split() == ['0', '0', '120.00', '3.00', '0.012', '0.025', '240', '95', '%',
                                f'{nearest_tree(inspection.result):.2f}']
    assert any(line.split()[:3] == ['0', 'critical', 'vegetation'] for line in lines)
    assert lines[-1] == f'report: {tmp_path / "out/report.html"}'
    np.testing.assert_allclose(pipeline.given, inspection.points, rtol=0, atol=1e-3)


@pytest.mark.parametrize('point_format', [3, 6])
def test_withheld_points_take_no_part_and_are_written(tmp_path, pipeline, capfd, point_format):
    points = np.random.default_rng(1).random((30, 3)) * 10
    path = write_las(tmp_path / 'cloud.las', points, classes=np.arange(30) % 19)
    las = laspy.convert(laspy.read(path), point_format_id=point_format)
    las.withheld = np.arange(30) % 10 == 8
    las.intensity = np.arange(30)
    las.write(path)
    assert run(path, '-o', tmp_path / 'out') == 0
    np.testing.assert_array_equal(np.isnan(pipeline.given).any(axis=1), las.withheld)
    assert '30 points (3 withheld, left out), ' in capfd.readouterr().out
    counts = json.loads((tmp_path / 'out/run.json').read_text(encoding='utf-8'))['input']['counts']
    assert (counts['num_points'], counts['num_not_finite'], counts['num_withheld']) == (30, 0, 3)
    out = laspy.read(tmp_path / 'out/points.laz')
    for name in ('X', 'Y', 'Z', 'intensity', 'withheld'):
        np.testing.assert_array_equal(np.asarray(out[name]), np.asarray(las[name]), name)
    held = np.asarray(las.withheld, dtype=bool)
    np.testing.assert_array_equal(out.classification[held], las.classification[held])
    assert (np.asarray(out.classification)[~held] == PointClass.GROUND).all()
    # and of the written file again
    assert read_cloud(tmp_path / 'out/points.laz').num_withheld == 3
    assert np.isnan(read_folder(tmp_path / 'out').points[held]).all()


@pytest.mark.parametrize('kind', [np.uint8, np.int32])
def test_dimensions_of_other_software_are_replaced_and_named(tmp_path, pipeline, capfd, kind):
    points, classes = np.random.default_rng(1).random((30, 3)) * 10, np.arange(30) % 19
    las = laspy.read(write_las(tmp_path / 'cloud.las', points, classes=classes))
    for name in ('clearance', 'original_classification', 'mine'):
        las.add_extra_dim(laspy.ExtraBytesParams(name=name, type=kind))
        las[name] = np.full(30, 77, dtype=kind)
    las.write(tmp_path / 'cloud.las')
    assert run(tmp_path / 'cloud.las', '-o', tmp_path / 'out') == 0
    text = ('extra dimensions clearance, original_classification of cloud.las are replaced in'
            ' points.laz: rename them to keep them')
    assert f'note: {text}\n' in capfd.readouterr().out
    record = json.loads((tmp_path / 'out/run.json').read_text(encoding='utf-8'))
    assert record['input']['counts']['replaced'] == text
    # what is written here is known, and keeps the classes of its first input
    assert run(tmp_path / 'out/points.laz', '-o', tmp_path / 'again') == 0
    assert 'replaced' not in capfd.readouterr().out
    for folder in ('out', 'again'):
        out = laspy.read(tmp_path / folder / 'points.laz')
        np.testing.assert_array_equal(out.original_classification, classes)
        assert (out.mine == 77).all()
        assert np.isnan(out.clearance).all()


def test_quiet_prints_nothing(tmp_path, pipeline, capfd):
    cloud = write_las(tmp_path / 'cloud.las', np.random.default_rng(1).random((20, 3)))
    assert run(cloud, '-o', tmp_path / 'out', '--quiet') == 0
    assert capfd.readouterr() == ('', '')


def test_no_line_is_said(tmp_path, pipeline, capfd):
    cloud = write_las(tmp_path / 'cloud.las', np.random.default_rng(1).random((20, 3)))
    assert run(cloud, '-o', tmp_path / 'out') == 0
    assert 'no power line was found' in capfd.readouterr().out


def test_settings_and_crs_arrive(tmp_path, pipeline):
    points = np.random.default_rng(1).random((20, 3)) * 10
    cloud = write_las(tmp_path / 'cloud.las', points)
    (tmp_path / 'p.yaml').write_text('height: {beta: 6}\n', encoding='utf-8')
    code = run(cloud, '-o', tmp_path / 'out', '--params', tmp_path / 'p.yaml',
               '--set', 'height.num_bins=50', '--crs', 'EPSG:2992')
    assert code == 0
    content = json.loads((tmp_path / 'out/run.json').read_text(encoding='utf-8'))
    assert content['settings']['height']['beta'] == 6.0
    assert content['settings']['height']['num_bins'] == 50
    assert content['input']['metres_per_unit'] == [0.3048, 0.3048]
    np.testing.assert_allclose(pipeline.given, points * 0.3048, atol=1e-3)
    out = laspy.read(tmp_path / 'out/points.laz')
    np.testing.assert_allclose(out.xyz, points, atol=1e-3)
    assert out.header.parse_crs().to_epsg() == 2992


def test_missing_file(tmp_path, pipeline, capfd):
    check_refusal(run(tmp_path / 'no.laz', '-o', tmp_path / 'out'), capfd, 'no.laz')
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('share', [0.0, 0.02, 0.5, 0.95])
def test_truncated_laz(tmp_path, pipeline, capfd, share):
    points = np.random.default_rng(1).random((20_000, 3))
    cloud = write_las(tmp_path / 'cloud.laz', points)
    data = cloud.read_bytes()
    cloud.write_bytes(data[: int(share * len(data))])
    check_refusal(run(cloud, '-o', tmp_path / 'out'), capfd, 'cloud.laz')
    assert [item.name for item in tmp_path.iterdir()] == ['cloud.laz']


@pytest.mark.parametrize('num_points', [0, 3])
def test_too_few_points(tmp_path, pipeline, capfd, num_points):
    cloud = write_las(tmp_path / 'cloud.laz', np.random.default_rng(1).random((num_points, 3)))
    check_refusal(
        run(cloud, '-o', tmp_path / 'out'), capfd, f'{num_points} finite points', '= 10'
    )
    assert [item.name for item in tmp_path.iterdir()] == ['cloud.laz']


def test_points_that_are_not_finite_are_counted(tmp_path, pipeline):
    rows = ['1 2 3'] * 12 + ['nan 1 2', 'inf 0 0']
    header = textwrap.dedent(f"""\
        VERSION 0.7
        FIELDS x y z
        SIZE 4 4 4
        TYPE F F F
        COUNT 1 1 1
        WIDTH {len(rows)}
        HEIGHT 1
        VIEWPOINT 0 0 0 1 0 0 0
        POINTS {len(rows)}
        DATA ascii
        """)
    cloud = tmp_path / 'cloud.pcd'
    cloud.write_text(header + '\n'.join(rows) + '\n', encoding='ascii')
    assert run(cloud, '-o', tmp_path / 'out') == 0
    content = json.loads((tmp_path / 'out/run.json').read_text(encoding='utf-8'))
    assert content['input']['counts'] == {
        'num_points': 14, 'num_not_finite': 2, 'num_withheld': 0,
    }
    assert content['num_points_written'] == 12


@pytest.mark.parametrize(('arguments', 'words'), [
    (['--set', 'height.gamma=5'], ['height.gamma']),
    (['--set', 'height.beta=-1'], ['beta', '-1']),
    (['--set', 'height.beta'], ['height.beta']),
    (['--params', 'none.yaml'], ['none.yaml']),
    (['--crs', 'EPSG:0'], ['EPSG:0']),
    (['--crs', 'EPSG:4326'], ['WGS 84']),
    (['--colour'], ['--colour']),
])
def test_bad_usage(tmp_path, pipeline, capfd, arguments, words):
    cloud = write_las(tmp_path / 'cloud.las', np.random.default_rng(1).random((20, 3)))
    check_refusal(run(cloud, '-o', tmp_path / 'out', *arguments), capfd, *words)
    assert [item.name for item in tmp_path.iterdir()] == ['cloud.las']


def test_output_is_needed(tmp_path, pipeline, capfd):
    check_refusal(run(tmp_path / 'cloud.las'), capfd, '--output')


def test_existing_folder(tmp_path, pipeline, capfd):
    cloud = write_las(tmp_path / 'cloud.las', np.random.default_rng(1).random((20, 3)))
    assert run(cloud, '-o', tmp_path / 'out', '--quiet') == 0
    check_refusal(run(cloud, '-o', tmp_path / 'out'), capfd, 'out', '--force')
    assert run(cloud, '-o', tmp_path / 'out', '--quiet', '--force') == 0


def test_parent_that_is_not_writable(tmp_path, pipeline, capfd, monkeypatch):
    cloud = write_las(tmp_path / 'cloud.las', np.random.default_rng(1).random((20, 3)))
    (tmp_path / 'locked').mkdir(mode=0o500)
    if os.geteuid() == 0:  # root may write everywhere, so the answer is given for it
        monkeypatch.setattr(os, 'access', lambda path, mode: 'locked' not in str(path))
    check_refusal(run(cloud, '-o', tmp_path / 'locked/out'), capfd, 'permission', 'locked')


def test_parent_that_is_a_file(tmp_path, pipeline, capfd):
    cloud = write_las(tmp_path / 'cloud.las', np.random.default_rng(1).random((20, 3)))
    check_refusal(run(cloud, '-o', cloud / 'out'), capfd, 'cannot be written')


def test_interruption_is_quiet(tmp_path, pipeline, capfd):
    pipeline.result = KeyboardInterrupt()
    cloud = write_las(tmp_path / 'cloud.las', np.random.default_rng(1).random((20, 3)))
    assert run(cloud, '-o', tmp_path / 'out') == 130
    assert capfd.readouterr() == ('', '')
    assert [item.name for item in tmp_path.iterdir()] == ['cloud.las']


def test_a_defect_keeps_its_traceback(tmp_path, pipeline):
    pipeline.result = ZeroDivisionError('a bug')
    cloud = write_las(tmp_path / 'cloud.las', np.random.default_rng(1).random((20, 3)))
    with pytest.raises(ZeroDivisionError):
        run(cloud, '-o', tmp_path / 'out')
    assert [item.name for item in tmp_path.iterdir()] == ['cloud.las']


STUCK = """
import sys, time, types
module = types.ModuleType('plc_inspect.core.pipeline')
sys.modules[module.__name__] = module
import plc_inspect.offline.export.points_file as points_file
class Pipeline:
    def __init__(self, settings, rules=None): pass
    def run(self, points, progress=None):
        sys.path.append('test')
        from factories import make_empty_result
        return make_empty_result(len(points))
module.Pipeline = Pipeline
def wait(*_):
    print('writing', flush=True)
    for _ in range(1200):  # a signal just before a sleep does not end it
        time.sleep(0.05)
import plc_inspect.offline.export.files as results_files
results_files.write_points = wait
from plc_inspect.offline.commands.survey import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.slow
@pytest.mark.parametrize(('number', 'code'), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_signal_while_writing_leaves_nothing(tmp_path, number, code):
    cloud = write_las(tmp_path / 'cloud.las', np.random.default_rng(1).random((20, 3)))
    with subprocess.Popen(
        [sys.executable, '-c', STUCK, str(cloud), '-o', str(tmp_path / 'out')],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT,
    ) as process:
        assert process.stdout.readline() == 'writing\n'
        assert len(list(tmp_path.iterdir())) == 2
        process.send_signal(number)
        _, err = process.communicate(timeout=20)
    assert (process.returncode, err) == (code, '')
    assert [item.name for item in tmp_path.iterdir()] == ['cloud.las']


def test_lines_are_found_and_classes_in_the_file_do_not_matter(tmp_path):
    inspection = make_inspection(origin=UTM)
    rng = np.random.default_rng(2)
    classes = {'plain': None, 'scrambled': rng.integers(0, 20, len(inspection.points))}
    for name, values in classes.items():
        cloud = write_las(tmp_path / f'{name}.laz', inspection.points, values)
        assert run(cloud, '-o', tmp_path / name, '--quiet') == 0
    for name in ('spans.json', 'supports.json', 'hazards.json'):
        plain, scrambled = ((tmp_path / folder / name).read_bytes() for folder in classes)
        assert plain == scrambled, name
    plain, scrambled = (laspy.read(tmp_path / folder / 'points.laz') for folder in classes)
    for name in plain.points.array.dtype.names:
        if name != 'original_classification':
            assert plain.points.array[name].tobytes() == scrambled.points.array[name].tobytes()
    np.testing.assert_array_equal(scrambled.original_classification, classes['scrambled'])
    spans = json.loads((tmp_path / 'plain/spans.json').read_text(encoding='utf-8'))['spans']
    assert len(spans) == 6
    assert len({span['line_id'] for span in spans}) == 3
    expected = [(span.start + span.end) / 2 for span in inspection.result.spans]
    for span in spans:
        middle = (np.array(span['start']) + span['end']) / 2
        assert np.min(np.linalg.norm(np.array(expected) - middle, axis=1)) < 2.0
        assert span['sag'] == pytest.approx(3.0, abs=0.15)


def test_loading_beside_reading_changes_nothing(tmp_path, monkeypatch):
    cloud = write_las(tmp_path / 'cloud.las', make_inspection().points)
    loaded, load = [], command._load
    monkeypatch.setattr(command, '_load', lambda settings: loaded.append(load(settings)))
    plain = command.survey(cloud, Settings()).result
    assert not loaded
    monkeypatch.setattr(command, 'LARGE', 0)
    beside = command.survey(cloud, Settings()).result
    assert loaded == [None]
    assert len(plain.spans) == 6
    np.testing.assert_array_equal(plain.line_id, beside.line_id)


@pytest.mark.slow
def test_bar_on_a_terminal_only(tmp_path):
    cloud = write_las(tmp_path / 'cloud.las', np.random.default_rng(1).random((20, 3)))
    code = (
        'import sys; from plc_inspect.offline.commands.survey import main; '
        'sys.exit(main(sys.argv[1:]))'
    )
    outer, inner = os.openpty()
    fcntl.ioctl(inner, termios.TIOCSWINSZ, struct.pack('HHHH', 24, 80, 0, 0))
    os.set_blocking(outer, False)
    seen = {}
    for name, stream in (('terminal', inner), ('pipe', subprocess.PIPE)):
        done = subprocess.run(
            [sys.executable, '-c', code, str(cloud), '-o', str(tmp_path / name)],
            stdout=subprocess.PIPE, stderr=stream, cwd=ROOT, check=True, timeout=120,
        )
        seen[name] = done.stderr
    assert seen['pipe'] == b''
    assert b'%|' in os.read(outer, 100_000)
    os.close(inner)
    os.close(outer)
