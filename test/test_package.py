# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The package's metadata agree with each other and with the code."""

import ast
import importlib
import os
from pathlib import Path
import re
import runpy
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import pytest

import plc_inspect

ROOT = Path(__file__).parents[1]
IMPORT_TO_KEY = {
    'aiohttp': 'python3-aiohttp',
    'cryptography': 'python3-cryptography',
    'jinja2': 'python3-jinja2',
    'markupsafe': 'python3-jinja2',
    'numba': 'python3-numba',
    'numpy': 'python3-numpy',
    'pyproj': 'python3-pyproj',
    'rosbags': 'python3-rosbags-pip',
    'scipy': 'python3-scipy',
    'shapely': 'python3-shapely',
    'sklearn': 'python3-sklearn',
    'tqdm': 'python3-tqdm',
    'yaml': 'python3-yaml',
}
IMPORT_TO_REQUIREMENT = {
    'markupsafe': 'jinja2', 'sklearn': 'scikit-learn', 'yaml': 'PyYAML', 'lazrs': 'laspy',
}
WITHOUT_KEY = {'cma', 'dask', 'distributed', 'ezdxf', 'laspy', 'lazrs', 'mcap', 'plyfile',
               'pyarrow', 'pye57', 'pyogrio', 'pypdf', 'rich', 'zstandard'}
OPTIONAL = ('grid', 'pdf', 'formats')
"""Extras without which one thing cannot be done, which says so."""


@pytest.fixture(scope='module')
def manifest():
    """Parse package.xml."""
    return ElementTree.parse(ROOT / 'package.xml').getroot()


@pytest.fixture(scope='module')
def metadata():
    """Return what setup.py gives to setuptools."""
    import setuptools

    given = {}
    original = setuptools.setup
    setuptools.setup = lambda **values: given.update(values)
    folder = Path.cwd()
    try:
        os.chdir(ROOT)
        runpy.run_path('setup.py')
    finally:
        os.chdir(folder)
        setuptools.setup = original
    return given


def list_imports():
    """List the top-level names of all that the package imports and that is not Python's own."""
    roots = set()
    for path in (ROOT / 'plc_inspect').rglob('*.py'):
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.Import):
                roots |= {alias.name.partition('.')[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                roots.add((node.module or '').partition('.')[0])
    return roots - set(sys.stdlib_module_names) - {'plc_inspect'}


def test_there_is_one_version(manifest, metadata):
    version = plc_inspect.__version__
    assert manifest.findtext('version') == version
    assert metadata['version'] == version
    changelog = (ROOT / 'CHANGELOG.rst').read_text(encoding='utf-8')
    assert re.findall(r'^(\d+\.\d+\.\d+)', changelog, re.MULTILINE)[0] == version


@pytest.mark.slow
def test_manifest_names_every_import(manifest):
    assert manifest.get('format') == '3'
    assert manifest.findtext('name') == 'plc_inspect'
    assert manifest.findtext('export/build_type') == 'ament_python'
    keys = {item.text for item in manifest.findall('exec_depend')}
    for name in list_imports() - WITHOUT_KEY:
        assert IMPORT_TO_KEY.get(name, name) in keys, name


@pytest.mark.slow
def test_setup_requires_every_import(metadata, manifest):
    extras = [item for name in OPTIONAL for item in metadata['extras_require'][name]]
    required = {
        re.split(r'[<>=\[]', item)[0] for item in (*metadata['install_requires'], *extras)
    }
    ros = {item.text for item in manifest.findall('exec_depend')} - set(IMPORT_TO_KEY.values())
    imported = list_imports() - ros
    assert len(imported) > 10
    for name in imported:
        assert IMPORT_TO_REQUIREMENT.get(name, name) in required, name


def test_commands_exist(metadata):
    scripts = metadata['entry_points']['console_scripts']
    assert scripts
    for script in scripts:
        name, target = script.split(' = ')
        module, function = target.split(':')
        assert callable(getattr(importlib.import_module(module), function)), name


def test_the_readme_names_every_command(metadata):
    text = (ROOT / 'README.md').read_text(encoding='utf-8')
    scripts = {item.split(' = ')[0] for item in metadata['entry_points']['console_scripts']}
    assert set(re.findall(r'^    (plc_\w+)', text, re.MULTILINE)) == scripts


def test_data_files_exist(metadata):
    placed = dict(metadata['data_files'])
    assert placed['share/ament_index/resource_index/packages'] == ['resource/plc_inspect']
    assert 'config/plc_inspect.yaml' in placed['share/plc_inspect/config']
    for files in placed.values():
        for file in files:
            assert (ROOT / file).is_file(), file


def test_templates_are_installed(metadata):
    package = ROOT / 'plc_inspect'
    patterns = metadata['package_data']['plc_inspect']
    installed = {path for pattern in patterns for path in package.glob(pattern)}
    templates = {
        path for folder in ('grid/templates', 'offline/report/templates', 'monitor/page')
        for path in (package / folder).rglob('*') if path.is_file()
    }
    assert templates == installed
    assert {path.relative_to(package).as_posix() for path in templates} >= {
        'offline/report/templates/report.html.j2', 'offline/report/templates/report.css',
        'monitor/page/index.html', 'monitor/page/style.css', 'monitor/page/main.js',
        'monitor/page/vendor/three/LICENSE',
    }


def test_all_packages_are_installed(metadata):
    expected = {
        '.'.join(path.parent.relative_to(ROOT).parts)
        for path in (ROOT / 'plc_inspect').rglob('__init__.py')
    }
    assert set(metadata['packages']) == expected


def test_licence_is_apache(manifest):
    assert manifest.findtext('license') == 'Apache-2.0'
    text = (ROOT / 'LICENSE').read_text(encoding='utf-8')
    assert 'Apache License\n                           Version 2.0' in text


@pytest.mark.parametrize('name', ['survey', 'replay', 'explain', 'tune', 'compare'])
def test_help_is_quick_and_complete(name):
    code = f"import sys; from plc_inspect.offline.commands.{name} import main; main(['--help'])"
    done = subprocess.run(
        [sys.executable, '-X', 'importtime', '-c', code],
        capture_output=True, text=True, check=True, timeout=60, cwd=ROOT,
    )
    assert done.stdout.startswith(f'usage: plc_{name}')
    assert '| plc_inspect.offline.commands.command_line' in re.sub(' +', ' ', done.stderr)
    assert 'numba' not in done.stderr


@pytest.mark.parametrize('path', ['tools/install', '.ci/run'])
def test_scripts_are_executable_bash(path):
    assert os.access(ROOT / path, os.X_OK)
    subprocess.run(['bash', '-n', str(ROOT / path)], check=True)
