# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Launch files and viewer configurations name only what exists; they cannot run here."""

import ast
import json
import os
from pathlib import Path
import re
from runpy import run_path
import sys
from types import SimpleNamespace
import xml.etree.ElementTree as ElementTree

import pytest
import yaml

from plc_inspect.ros.graph.transport import CHOICES, prepare_transport, PROFILE, VARIABLE
from plc_inspect.setting_names import describe

ROOT = Path(__file__).parents[2]
LAUNCH = sorted((ROOT / 'launch').glob('*.launch.py'))
TOPICS = {f'/plc_inspect/{name}' for name in ('lines', 'corridor', 'catenaries', 'hazards',
                                              'markers')}
SETUP = (ROOT / 'setup.py').read_text(encoding='utf-8')


def list_strings(tree):
    """List all string constants of a tree."""
    return [node.value for node in ast.walk(tree)
            if isinstance(node, ast.Constant) and isinstance(node.value, str)]


@pytest.mark.parametrize('path', LAUNCH, ids=lambda path: path.name)
def test_launch_files_name_what_exists(path):
    text = path.read_text(encoding='utf-8')
    tree = ast.parse(text)
    compile(tree, str(path), 'exec')
    functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    assert 'generate_launch_description' in functions
    for executable in re.findall(r"package='plc_inspect',\s+executable='(\w+)'", text):
        assert f"'{executable}':" in SETUP, executable
    strings = list_strings(tree)
    for folder, name in re.findall(r"share, '(\w+)', '([\w.]+)'", text):
        assert (ROOT / folder / name).is_file(), name
    settings = {name for name, _, _ in describe()}
    for string in strings:
        if re.fullmatch(r'(output|input|map|segment|height)\.\w+', string):
            assert string in settings
    declared = re.findall(r"DeclareLaunchArgument\(\s*'(\w+)'", text)
    assert text.count('description=') == len(declared)
    used = re.findall(r"(?:LaunchConfiguration|_read)\((?:context, )?'(\w+)'\)", text)
    assert set(used) == set(declared)


def test_there_are_both_launch_files():
    assert [path.name for path in LAUNCH] == ['inspect.launch.py', 'replay.launch.py']


def test_transport_is_the_same_everywhere():
    text = (ROOT / 'launch/inspect.launch.py').read_text(encoding='utf-8')
    strings = list_strings(ast.parse(text))
    assert PROFILE in strings
    assert VARIABLE in strings
    root = ElementTree.parse(ROOT / 'config/fastdds.xml').getroot()
    space = '{http://www.eprosima.com}'
    kinds = {item.findtext(f'{space}transport_id'): item.findtext(f'{space}type')
             for item in root.iter(f'{space}transport_descriptor')}
    used = [item.text for item in next(root.iter(f'{space}userTransports'))]
    assert [kinds[name] for name in used] == ['SHM', 'UDPv4']


@pytest.mark.parametrize(('name', 'sets'), [
    (None, [VARIABLE]), ('FASTDDS_BUILTIN_TRANSPORTS', []), ('PLC_KEYS', []),
])
def test_launch_leaves_the_transport_to_the_keys(monkeypatch, name, sets):
    found = []

    def stub(module, **values):
        monkeypatch.setitem(sys.modules, module, SimpleNamespace(**values))

    def keep(variable, value):
        found.append(variable)

    def ignore(*arguments, **options):
        return None

    stub('ament_index_python', packages=None)
    stub('ament_index_python.packages', get_package_share_directory=lambda name: str(ROOT))
    stub('launch', LaunchDescription=ignore)
    stub('launch.actions', DeclareLaunchArgument=ignore, OpaqueFunction=ignore,
         SetEnvironmentVariable=keep)
    stub('launch.substitutions', LaunchConfiguration=ignore)
    stub('launch_ros', actions=None)
    stub('launch_ros.actions', Node=ignore)
    for variable in (*CHOICES, 'PLC_KEYS'):
        monkeypatch.delenv(variable, raising=False)
    if name is not None:
        monkeypatch.setenv(name, '/somewhere')
    run_path(str(ROOT / 'launch/inspect.launch.py'))['generate_launch_description']()
    assert found == sets


def test_transport_is_chosen_unless_the_user_did(monkeypatch):
    for name in CHOICES:
        monkeypatch.setenv(name, '')
    prepare_transport()
    assert Path(os.environ[VARIABLE]) == ROOT / 'config' / PROFILE
    monkeypatch.setenv(VARIABLE, '')
    monkeypatch.setenv('FASTDDS_BUILTIN_TRANSPORTS', 'UDPv4')
    prepare_transport()
    assert not os.environ[VARIABLE]


def test_rviz_shows_the_topics():
    content = yaml.safe_load((ROOT / 'config/inspect.rviz').read_text(encoding='utf-8'))
    displays = content['Visualization Manager']['Displays']
    shown = {item['Topic']['Value'] for item in displays if 'Topic' in item}
    assert TOPICS - {'/plc_inspect/catenaries', '/plc_inspect/hazards'} <= shown
    assert '/velodyne_points' in shown
    for item in displays:
        if item.get('Topic', {}).get('Value') in TOPICS:
            assert item['Topic']['Durability Policy'] == 'Transient Local'
            assert item['Topic']['Reliability Policy'] == 'Reliable'


def test_foxglove_shows_the_topics():
    content = json.loads((ROOT / 'config/foxglove.json').read_text(encoding='utf-8'))
    panels = content['configById']
    shown = {
        topic for name, panel in panels.items() if name.startswith('3D!')
        for topic, options in panel['topics'].items() if options['visible']
    }
    assert {'/plc_inspect/lines', '/plc_inspect/corridor', '/plc_inspect/markers'} <= shown

    def leaves(node):
        if isinstance(node, str):
            return {node}
        return leaves(node['first']) | leaves(node['second'])

    assert leaves(content['layout']) == set(panels)
    raw = {
        panel['topicPath'].partition('.')[0] for name, panel in panels.items()
        if name.startswith('RawMessages!')
    }
    assert raw <= TOPICS | {'/diagnostics'}
