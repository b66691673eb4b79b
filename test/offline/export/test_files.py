# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Files for other tools: they open, and what is in them is where it should be."""

import csv
import dataclasses
import json
import os
from pathlib import Path
import re
import shutil
import subprocess
import sys

import ezdxf
from factories import make_inspection
import laspy
import numpy as np
import pyogrio
import pyproj
import pytest
from rosbags.highlevel import AnyReader
import shapely

from plc_inspect.colors import parse_color, severity_color
from plc_inspect.errors import ConfigError
from plc_inspect.grid.cells.inputs import expand_inputs
from plc_inspect.messages import rows as layouts
from plc_inspect.messages.rows import read_rows
from plc_inspect.offline.commands.request import locate_flight
from plc_inspect.offline.export.files import write_records
from plc_inspect.offline.export.geo import write_layer
from plc_inspect.offline.export.results_folder import write_results
from plc_inspect.offline.readers.clouds import render_wkt
from plc_inspect.offline.records.georeference import make_origin_crs
from plc_inspect.offline.records.inspection import describe_span
from plc_inspect.offline.records.span_curve import trace_span
from plc_inspect.offline.records.units import Units

UTM = np.array([500_000.0, 5_650_000.0, 100.0])


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Write a run in UTM zone 32."""
    path = tmp_path_factory.mktemp('files') / 'out'
    write_results(path, make_inspection(UTM, crs=pyproj.CRS('EPSG:25832').to_wkt()))
    return path


def read(path, layer=None):
    meta, _, geometry, values = pyogrio.raw.read(path, layer=layer)
    return (meta, shapely.from_wkb(geometry),
            dict(zip(meta['fields'], values, strict=True)))


@pytest.mark.parametrize('name', ['spans.geojson', 'results.gpkg', 'results.kml'])
def test_layers_land_at_the_right_place(folder, name):
    meta, shapes, values = read(folder / name, 'results' if name.endswith('kml') else 'spans')
    inspection = make_inspection(UTM)
    to_utm = pyproj.Transformer.from_crs(
        'EPSG:25832' if name.endswith('gpkg') else 'EPSG:4326', 'EPSG:25832', always_xy=True
    )
    for shape, span in zip(shapes[:6], inspection.result.spans, strict=True):
        line = shapely.get_coordinates(shape, include_z=True)
        for place, end in ((line[0], span.start), (line[-1], span.end)):
            x, y = to_utm.transform(place[0], place[1])
            assert (x, y, place[2]) == pytest.approx(end, abs=0.01)
        assert line[:, 2].min() == pytest.approx(span.lowest[2], abs=0.01)
    if name.endswith('gpkg'):
        assert pyproj.CRS(meta['crs']) == pyproj.CRS('EPSG:25832')
    if not name.endswith('kml'):
        assert values['sag'] == pytest.approx([span.sag for span in inspection.result.spans])
        assert values['open_end'].tolist() == [False, True] * 3


def test_hazards_and_supports(folder):
    hazard = make_inspection(UTM).result.hazards[0]
    _, shapes, values = read(folder / 'results.gpkg', 'hazards')
    assert shapely.get_coordinates(shapes, include_z=True)[0] == pytest.approx(hazard.position)
    assert values['rule'][0] == hazard.rule
    assert values['kind'][0] == 'vegetation'
    assert [name for name, _ in pyogrio.list_layers(folder / 'results.gpkg')] == [
        'spans', 'supports', 'hazards',
    ]
    _, shapes, values = read(folder / 'supports.geojson')
    assert len(shapes) == 3
    assert values['lines'][0] == '0 1 2'


def test_no_files_without_a_reference_system(tmp_path):
    write_results(tmp_path / 'plain', make_inspection())
    assert not list((tmp_path / 'plain').glob('*.geojson'))
    assert (tmp_path / 'plain' / 'catenaries.dxf').exists()
    broken = make_inspection(crs='LOCAL_CS["somewhere",UNIT["metre",1]]')
    write_results(tmp_path / 'local', broken)
    assert not list((tmp_path / 'local').glob('*.kml'))


def test_a_flight_with_a_known_origin(tmp_path):
    place = locate_flight('59.33,18.07,25')
    write_results(tmp_path / 'out', make_inspection(frame_id='odom', **place))
    _, shapes, _ = read(tmp_path / 'out' / 'spans.geojson')
    lon, lat, z = shapely.get_coordinates(shapes[0], include_z=True)[0]
    east, north, up = make_inspection().result.spans[0].start
    azimuth, _, distance = pyproj.Geod(ellps='WGS84').inv(18.07, 59.33, lon, lat)
    assert distance == pytest.approx(np.hypot(east, north), abs=0.01)
    if distance > 1.0:
        assert np.radians(azimuth) == pytest.approx(np.arctan2(east, north), abs=1e-4)
    assert z == pytest.approx(up + 25.0, abs=0.001)


@pytest.mark.parametrize('text', ['1,2', 'a,b,c', '91,0,0', '0,200,0', '0,0,nan'])
def test_bad_origins(text):
    with pytest.raises(ConfigError, match='origin'):
        locate_flight(text)


def test_origin_crs_is_metric():
    system = pyproj.CRS.from_wkt(make_origin_crs(59.33, 18.07))
    assert system.is_projected
    assert {axis.unit_name for axis in system.axis_info} == {'metre'}


@pytest.mark.slow
def test_dxf_is_the_same_in_every_process(folder, tmp_path):
    code = (
        'import json, sys\n'
        'from pathlib import Path\n'
        'from types import SimpleNamespace\n'
        'from plc_inspect.offline.export.dxf import write_dxf\n'
        'from plc_inspect.offline.records.inspection import Units\n'
        'folder, path = map(Path, sys.argv[1:])\n'
        'names = "spans", "supports", "hazards"\n'
        'records = {n: json.loads((folder / f"{n}.json").read_text())[n] for n in names}\n'
        'write_dxf(path, SimpleNamespace(units=Units(horizontal=1.0, vertical=1.0)), records)\n'
    )
    found = set()
    for seed in '1234':  # the order of sets of names
        path = tmp_path / f'{seed}.dxf'
        subprocess.run(
            [sys.executable, '-c', code, str(folder), str(path)], check=True, timeout=60,
            env=os.environ | {'PYTHONHASHSEED': seed},
        )
        found.add(path.read_bytes())
    assert len(found) == 1


def test_dxf_passes_its_audit_and_holds_the_curves(folder):
    document = ezdxf.readfile(folder / 'catenaries.dxf')
    audit = document.audit()
    assert not audit.errors
    assert not audit.fixes
    space = document.modelspace()
    spans = make_inspection(UTM).result.spans
    for line_id in range(3):
        curves = space.query(f'POLYLINE[layer=="LINE_{line_id}"]')
        assert len(curves) == 2
        first = np.array([vertex.dxf.location.xyz for vertex in curves[0].vertices])
        span = next(item for item in spans if item.line_id == line_id)
        assert first[0] == pytest.approx(span.start)
        assert first[-1] == pytest.approx(span.end)
        assert first[:, 2].min() == pytest.approx(span.lowest[2], abs=0.01)
    assert len(space.query('LINE[layer=="SUPPORTS"]')) == 3
    assert len(space.query('POINT[layer=="HAZARDS"]')) == 1
    assert document.header['$INSUNITS'] == 6


def test_curve_of_a_record_with_feet_for_z():
    span = make_inspection().result.spans[0]
    record = describe_span(span, Units(horizontal=1.0, vertical=0.3048))
    curve = trace_span(record, 0.001, 1.0 / 0.3048)
    assert curve[:, 2].min() * 0.3048 == pytest.approx(span.lowest[2], abs=0.001)


@pytest.mark.parametrize(('c', 'rise'), [(60.0, 0.0), (900.0, 80.0), (5000.0, -30.0)])
def test_lines_between_points_of_a_curve_keep_its_tolerance(c, rise):
    length = 200.0
    b = length / 2 - c * np.arcsinh(rise / (2 * c * np.sinh(length / 2 / c)))
    ends = c * np.cosh((np.array([0.0, length]) - b) / c)
    record = {
        'start': [0.0, 0.0, ends[0]], 'end': [length, 0.0, ends[1]], 'length': length, 'b': b,
        'c': c,
    }
    curve = trace_span(record, 0.005)
    x = np.linspace(0.0, length, 20001)
    off = np.interp(x, curve[:, 0], curve[:, 2]) - c * np.cosh((x - b) / c)
    assert 0.0025 < off.max() < 0.005001  # no more points than needed
    assert off.min() > -1e-9


def test_playback_holds_the_topics_in_a_local_frame(folder):
    inspection = make_inspection(UTM)
    with AnyReader([folder / 'results.mcap']) as reader:
        content = {
            connection.topic: reader.deserialize(data, connection.msgtype)
            for connection, _, data in reader.messages()
        }
    assert set(content) == {
        '/tf_static', *(f'/plc_inspect/{name}' for name in
                        ('lines', 'corridor', 'catenaries', 'hazards', 'markers')),
    }
    shift = content['/tf_static'].transforms[0].transform.translation
    origin = np.array([shift.x, shift.y, shift.z])
    for name, count in (('lines', 1440), ('catenaries', 6), ('hazards', 1)):
        message = content[f'/plc_inspect/{name}']
        assert message.header.frame_id == 'plc_local'
        rows = read_rows(message)
        assert len(rows) == message.width == count
        assert rows.dtype == getattr(layouts, name.upper())
        if name == 'catenaries':
            start = np.array([rows[f'start_{axis}'][0] for axis in 'xyz']) + origin
            assert start == pytest.approx(inspection.result.spans[0].start, abs=1e-3)
        if name == 'hazards':
            place = np.array([rows[axis][0] for axis in 'xyz']) + origin
            assert place == pytest.approx(inspection.result.hazards[0].position, abs=1e-3)
    kinds = [marker.ns for marker in content['/plc_inspect/markers'].markers]
    assert {kind: kinds.count(kind) for kind in kinds} == {
        'catenaries': 6, 'supports': 3, 'hazards': 1, 'hazard_texts': 1,
    }


def test_points_open_in_laspy_with_their_reference_system(folder):
    las = laspy.read(folder / 'points.laz')
    assert pyproj.CRS(las.header.parse_crs()).to_epsg() == 25832
    assert {'line_id', 'span_id', 'clearance', 'decision'} <= set(las.point_format.dimension_names)


def test_points_open_in_the_reference_implementation_of_laz(folder):
    with laspy.open(folder / 'points.laz', laz_backend=laspy.LazBackend.Laszip) as file:
        decoded = file.read()
    own = laspy.read(folder / 'points.laz', laz_backend=laspy.LazBackend.Lazrs)
    for name in own.point_format.dimension_names:
        np.testing.assert_array_equal(decoded[name], own[name])


def test_points_open_in_pdal(folder):
    pdal = shutil.which('pdal')
    if pdal is None:
        pytest.skip('pdal is not installed')
    done = subprocess.run([pdal, 'info', '--summary', str(folder / 'points.laz')],
                          capture_output=True, check=True, text=True, timeout=120)
    summary = json.loads(done.stdout)['summary']
    assert summary['num_points'] == len(laspy.read(folder / 'points.laz').points)
    assert {'line_id', 'span_id', 'clearance', 'decision'} <= {
        name.strip() for name in summary['dimensions'].split(',')
    }


def test_a_geopackage_keeps_the_vertical_system(tmp_path):
    crs = pyproj.CRS('EPSG:7415').to_wkt()
    write_results(tmp_path / 'out', make_inspection(crs=crs, origin=(155e3, 463e3, 0.0)))
    for layer in ('spans', 'supports', 'hazards'):
        info = pyogrio.read_info(tmp_path / 'out/results.gpkg', layer=layer)
        assert pyproj.CRS(info['crs']).sub_crs_list[1].name == 'NAP height'


def test_a_system_whose_axes_begin_with_north_keeps_its_number(tmp_path, capfd):
    crs = render_wkt(pyproj.CRS('EPSG:2193'))
    write_results(tmp_path / 'out', make_inspection(crs=crs, origin=(1.6e6, 5.5e6, 0.0)))
    assert pyogrio.read_info(tmp_path / 'out/results.gpkg', layer='spans')['crs'] == 'EPSG:2193'
    _, shapes, values = read(tmp_path / 'out/results.gpkg', 'supports')
    assert shapes[0].x == values['position_x'][0] == pytest.approx(1.6e6, abs=1e3)
    assert 'Warning' not in capfd.readouterr().err


@pytest.mark.parametrize('name', ['a!b', 'old.zip', 'http:x', 'a?b#c'])
def test_folders_are_no_archives_or_addresses(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    crs = pyproj.CRS('EPSG:25832').to_wkt()
    write_results(Path(name), make_inspection(crs=crs, origin=(5e5, 5.7e6, 0.0)))
    Path(name).rename('plain')
    assert len(read('plain/results.gpkg', 'hazards')[1]) == 1
    for own in ('spans.geojson', 'results.kml', 'refly.geojson'):
        assert (tmp_path / 'plain' / own).is_file()


def test_an_index_may_lie_in_a_folder_of_any_name(tmp_path):
    place, tile = tmp_path / 'index.gpkg', tmp_path / 'a!b' / 'tile.las'
    write_layer(place, 'GPKG', 'tiles', [shapely.Point(0, 0, 0)], [{'location': tile.name}],
                'EPSG:25832')
    tile.parent.mkdir()
    tile.touch()
    place.rename(tile.with_name(place.name))
    assert expand_inputs([str(tile.with_name(place.name))]) == [tile]


def test_supports_as_a_table(folder):
    rows = (folder / 'supports.csv').read_text(encoding='utf-8').splitlines()
    assert rows[0] == (
        'support_id,position_x [m],position_y [m],position_z [m],height [m],kind,lines'
    )
    assert len(rows) == 4
    spans = json.loads((folder / 'spans.json').read_text(encoding='utf-8'))['spans']
    assert spans[0]['vegetation_clearance'] > 0


def test_heights_are_in_the_unit_that_is_named_beside_them(tmp_path):
    """With x and y in feet and z in metres: metres in the columns, feet in the sentence."""
    foot = 1200.0 / 3937.0
    run = make_inspection(units=Units(horizontal=foot, vertical=1.0))
    hazard = dataclasses.replace(run.result.hazards[0], height=13.9)
    write_records(tmp_path, dataclasses.replace(
        run, result=dataclasses.replace(run.result, hazards=(hazard,))
    ))
    (record,) = json.loads((tmp_path / 'hazards.json').read_text(encoding='utf-8'))['hazards']
    assert record['height'] == 13.9
    assert 'vegetation, 45.6 ftUS high, at ' in record['text']
    tables = {
        name: list(csv.DictReader((tmp_path / f'{name}.csv').open(encoding='utf-8')))
        for name in ('hazards', 'supports')
    }
    assert tables['hazards'][0]['height [m]'] == '13.9'
    assert float(tables['hazards'][0]['required [ftUS]']) == pytest.approx(2.0 / foot)
    assert tables['supports'][0]['height [m]'] == '17.0'


def test_hazards_have_the_colours_of_their_severities(folder):
    text = (folder / 'results.kml').read_text(encoding='utf-8')
    hazards = json.loads((folder / 'hazards.json').read_text(encoding='utf-8'))['hazards']
    assert hazards
    document = ezdxf.readfile(folder / 'catenaries.dxf')
    points = [item for item in document.modelspace() if item.dxftype() == 'POINT']
    for hazard, point in zip(hazards, points, strict=True):
        color = severity_color(hazard['severity'])
        assert point.rgb == parse_color(color)
        assert re.search(rf'<name>{hazard["severity"]} {hazard["kind"]} {hazard["hazard_id"]}'
                         rf'</name>.*?<styleUrl>#{hazard["severity"]}</styleUrl>', text, re.DOTALL)
        kml = f'ff{color[5:7]}{color[3:5]}{color[1:3]}'  # alpha, blue, green, red
        assert f'<Style id="{hazard["severity"]}"><IconStyle><color>{kml}' in text


def test_what_the_rule_measures_is_in_all_files(tmp_path):
    """Not the distance in space, which may be far above the limit that is broken."""
    run = make_inspection(UTM, crs=pyproj.CRS('EPSG:25832').to_wkt())
    hazard = dataclasses.replace(
        run.result.hazards[0], clearance=77.5, horizontal=1.25, note='measured horizontally'
    )
    write_results(tmp_path / 'out', dataclasses.replace(
        run, result=dataclasses.replace(run.result, hazards=(hazard,))
    ))
    kml = (tmp_path / 'out/results.kml').read_text(encoding='utf-8')
    assert '1.25 m measured horizontally, 2.00 m required by' in kml
    texts = ezdxf.readfile(tmp_path / 'out/catenaries.dxf').modelspace().query('TEXT')
    assert [item.dxf.text for item in texts] == ['0 vegetation 1.25']
    page = (tmp_path / 'out/report.html').read_text(encoding='utf-8')
    assert '<b>1.25</b>' in page
    assert '77.5' not in page


def test_a_line_across_the_antimeridian_is_cut_there_at_its_height(tmp_path):
    origin = (819_000.0, 8_095_800.0, 400.0)
    run = make_inspection(origin, crs=pyproj.CRS('EPSG:32760').to_wkt())
    write_results(tmp_path / 'out', run)
    for name, num in (('spans.geojson', 3), ('results.kml', 3), ('coverage.geojson', 1)):
        _, shapes, _ = read(tmp_path / 'out' / name)
        cut = [shape for shape in shapes if shape.geom_type == 'MultiLineString']
        assert len(cut) == num
        for shape in cut:
            before, after = (
                shapely.get_coordinates(part, include_z=True) for part in shape.geoms
            )
            assert (before[:, 0] > 0).all()
            assert (after[:, 0] < 0).all()
            assert before[-1] == pytest.approx(after[0] + [360.0, 0.0, 0.0], abs=1e-8)
            assert before[-1, 2] == pytest.approx(before[-2, 2], abs=2.0)
