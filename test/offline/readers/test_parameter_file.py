# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Parameter files: both layouts in, the same settings out."""

import pytest
import yaml

from plc_inspect.config import Settings
from plc_inspect.errors import ConfigError
from plc_inspect.offline.readers.parameter_file import read_settings, render_table, render_yaml
from plc_inspect.setting_names import describe, update


def write(folder, text):
    """Write a parameter file and return its path."""
    path = folder / 'params.yaml'
    path.write_text(text, encoding='utf-8')
    return path


def test_no_file_gives_the_defaults(tmp_path):
    assert read_settings(None) == Settings()
    assert read_settings(write(tmp_path, '')) == Settings()


@pytest.mark.parametrize('head', [
    '/**:\n  ros__parameters:\n', 'plc_inspect:\n  ros__parameters:\n',
    '/plc_inspect:\n  ros__parameters:\n', 'x:\n  y:\n',
])
def test_layouts(tmp_path, head):
    body = '    height:\n      beta: 6\n    map.voxel_size: 0.2\n'
    path = write(tmp_path, head + body)
    if head.startswith('x'):
        with pytest.raises(ConfigError, match=r"params\.yaml: unknown setting 'x\.y\.height"):
            read_settings(path)
        return
    expected = update(Settings(), {'height.beta': 6.0, 'map.voxel_size': 0.2})
    assert read_settings(path) == expected
    plain = write(tmp_path, 'height:\n  beta: 6\nmap:\n  voxel_size: 0.2\n')
    assert read_settings(plain) == expected


def test_own_name_wins_over_wildcard_and_node_parameters_are_left_out(tmp_path):
    path = write(tmp_path, """
/plc_inspect:
  ros__parameters: {height.beta: 7.0, use_sim_time: true}
/**:
  ros__parameters: {height: {beta: 6.0, num_bins: 50}, qos_overrides: {/x: {depth: 1}}}
/velodyne:
  ros__parameters: {rpm: 600.0}
""")
    settings = read_settings(path)
    assert (settings.height.beta, settings.height.num_bins) == (7.0, 50)


def test_assignments_win_and_the_last_one_counts(tmp_path):
    path = write(tmp_path, 'height: {beta: 6}\n')
    settings = read_settings(path, [
        'height.beta=7', 'height.beta=8.5', 'input.lidar_xyz=[0, 0, 1e-1]',
        'corridor.environment=open', 'height.cell_size=5e-1', 'input.scan_topic=/points',
    ])
    assert settings.height.beta == 8.5
    assert settings.input.lidar_xyz == (0.0, 0.0, 0.1)
    assert settings.corridor.environment == 'open'
    assert settings.height.cell_size == 0.5
    assert settings.input.scan_topic == '/points'


@pytest.mark.parametrize(('assignment', 'words'), [
    ('height.beta', 'section.name=value'),
    ('=5', 'section.name=value'),
    ('height.beta=many', 'many'),
    ('height.beta=0.5', '[1, 50] m'),
    ('height.beta=nan', 'nan'),
    ('height.gamma=5', "unknown setting 'height.gamma'"),
    ('height=5', "unknown setting 'height'"),
    ('height.num_bins=10.5', 'int'),
    ('height.beta=[', 'not a value'),
    ('input.lidar_xyz=[1, 2]', '3 numbers'),
    ('corridor.environment=lush', 'auto, complex, open'),
])
def test_bad_assignments(assignment, words):
    with pytest.raises(ConfigError) as caught:
        read_settings(None, [assignment])
    assert words in str(caught.value)


@pytest.mark.parametrize(('text', 'words'), [
    ('- 1\n- 2\n', 'list'),
    ('a: [', 'not a YAML file'),
    ('height: {beta: 5}\nhigh: {beta: 5}\n', "unknown setting 'high.beta'"),
    ('/velodyne:\n  ros__parameters: {rpm: 600}\n', '/velodyne only'),
    ('/**:\n  ros__parameters: 5\n', 'not a mapping'),
    ('height: {beta: 500}\n', 'beta'),
])
def test_bad_files(tmp_path, text, words):
    path = write(tmp_path, text)
    with pytest.raises(ConfigError) as caught:
        read_settings(path)
    assert words in str(caught.value)
    assert str(path) in str(caught.value)


def test_file_that_cannot_be_read(tmp_path):
    with pytest.raises(ConfigError, match='No such file'):
        read_settings(tmp_path / 'none.yaml')
    (tmp_path / 'bytes.yaml').write_bytes(b'\xff\xfe\x00a')
    with pytest.raises(ConfigError, match='not text'):
        read_settings(tmp_path / 'bytes.yaml')


def test_what_is_written_is_read_back(tmp_path):
    settings = update(Settings(), {
        'height.beta': 6.25, 'input.lidar_xyz': [1e-05, -2.0, 3.0], 'input.scan_topic': 'a b: c',
        'map.max_voxels': 5000,
    })
    assert read_settings(write(tmp_path, render_yaml(settings))) == settings


def test_ros_reads_the_types_that_are_meant():
    parameters = yaml.safe_load(render_yaml(Settings()))['/**']['ros__parameters']
    for name, default, _ in describe():
        section, _, key = name.partition('.')
        value = parameters[section][key]
        if isinstance(default, tuple):
            assert [type(item) for item in value] == [type(item) for item in default], name
        else:
            assert type(value) is type(default), name


def test_table_has_every_setting():
    table = render_table()
    for name, _, meta in describe():
        assert f'| `{name.partition(".")[2]}` |' in table
        assert meta['description'] in table
