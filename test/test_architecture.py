# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The rooms of the design: core is arrays in, results out; ros does no mathematics."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path
import re

import pytest

ROOT = Path(__file__).parents[1] / 'plc_inspect'
CORE = sorted((ROOT / 'core').rglob('*.py'))
MODULES = sorted(ROOT.rglob('*.py'))
LEAST_CORE, LEAST_MODULES = 90, 200
"""A search that finds fewer looks in the wrong place."""
LEAST_PACKAGES = 30
LEAST_PLACES = 60
LEAST_IMPORTS = 1500
MOST_LINES, MOST_MODULES, MOST_ARGUMENTS = 400, 16, 7
LEAST_FUNCTIONS = {
    'core.numerics': 12, 'core.alignment': 30, 'core.setup': 20, 'core.voxel_buffer': 25,
    'core.mapping': 30, 'core.ground': 15, 'core.extraction': 20,
    'core.clustering': 10, 'core.catenary': 25, 'core.evidence': 12, 'core.spans': 60,
    'core.hazards': 40,
    'core': 20, 'core.loads': 30, 'core.tracking': 40, 'core.coverage': 20, 'core.live': 25,
    'core.explain': 60, 'core.tuning': 30,
    'messages': 20, 'stream': 30, 'flight_record': 60,
    'offline.readers': 60, 'offline.records': 30,
    'offline.report': 60, 'offline.export': 30,
    'grid.cells': 25, 'grid.tiles': 20, 'grid': 40, 'offline.commands': 60,
    'security': 30, 'ros.graph': 5, 'ros.results': 25, 'ros.background': 15, 'ros.node': 50,
    'monitor.picture': 40, 'monitor.record': 10,
    'monitor.replay': 12, 'monitor.terminal': 20, 'monitor.web': 50,
    'sim.scenes': 60, 'sim.surveys': 50,
    'sim.random_scenes': 60, 'sim.evaluation': 40, 'sim': 6,
}
"""Packages whose calls take few arguments, and the least number of functions in each."""
SCRIPTS = [*(ROOT.parent / 'bench').rglob('*.py'), *(ROOT.parent / 'test').rglob('*.py')]
LAYERS = [
    '',
    'core.numerics', 'core.alignment', 'core.setup', 'core.voxel_buffer', 'core.mapping',
    'core.ground', 'core.extraction', 'core.clustering',
    'core.catenary',
    'core.evidence',
    'core.spans', 'core.hazards', 'core',
    'core.loads', 'core.tracking', 'core.coverage', 'core.live', 'core.explain', 'core.tuning',
    'messages', 'stream', 'flight_record',
    'offline.readers', 'offline.records', 'offline.report', 'offline.export', 'offline.terminal',
    'grid.cells', 'grid.tiles', 'grid',
    'offline.commands',
    'sim.scenes', 'sim.surveys', 'sim.random_scenes', 'sim.evaluation', 'sim',
    'security',
    'ros.graph', 'ros.results', 'ros.background', 'ros.node', 'ros',
    'monitor.picture', 'monitor.record', 'monitor.replay', 'monitor.terminal', 'monitor.web',
    'monitor',
]
"""Packages from the ground up: each may import from those before it and none from those after."""
HEAD = (
    '# Copyright 2026 plc_inspect contributors\n# SPDX-License-Identifier: Apache-2.0\n\n"""'
)
CORE_IMPORTS = {
    'array', 'bisect', 'cma', 'collections', 'concurrent', 'dataclasses', 'enum', 'functools',
    'heapq', 'itertools', 'math', 'numba', 'numpy', 'plc_inspect', 'scipy', 'sklearn',
    'statistics', 'threading', 'time', 'typing', 'warnings',
}
NOT_IN_CORE = {'messages', 'monitor', 'offline', 'ros', 'sim', 'stream'}
FORBIDDEN_CALLS = {'open', 'print', 'input', 'exit', 'quit', 'eval', 'exec', 'breakpoint'}
FILE_METHODS = {
    'fromfile', 'genfromtxt', 'load', 'loadtxt', 'memmap', 'read_bytes', 'read_text', 'save',
    'savetxt', 'savez', 'savez_compressed', 'tofile', 'write_bytes', 'write_text',
}


def parse(path):
    """Return the syntax tree of a module."""
    return ast.parse(path.read_text(encoding='utf-8'), filename=str(path))


def list_imports(tree):
    """List the full names of all modules that a tree imports, at any depth."""
    names = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, 'relative import'
            names += [f'{node.module}.{alias.name}' for alias in node.names]
    return names


def list_offences(tree):
    """List what core may not do, with line numbers."""
    offences = []
    for name in list_imports(tree):
        if name.partition('.')[0] not in CORE_IMPORTS:
            offences.append(f'imports {name}')
        if name.startswith('plc_inspect.') and name.split('.')[1] in NOT_IN_CORE:
            offences.append(f'imports {name}')
    for node in ast.walk(tree):
        if isinstance(node, ast.Assert):
            offences.append(f'line {node.lineno}: assert')
        if not isinstance(node, ast.Call):
            continue
        if isinstance(node.func, ast.Name) and node.func.id in FORBIDDEN_CALLS:
            offences.append(f'line {node.lineno}: {node.func.id}()')
        if isinstance(node.func, ast.Attribute) and node.func.attr in FILE_METHODS:
            offences.append(f'line {node.lineno}: .{node.func.attr}()')
    return offences


def test_the_search_finds_all_packages():
    assert len(CORE) >= LEAST_CORE
    assert len(MODULES) >= LEAST_MODULES


@pytest.mark.parametrize('path', CORE, ids=lambda path: path.stem)
def test_core_knows_no_ros_no_files_no_output(path):
    assert list_offences(parse(path)) == []


@pytest.mark.parametrize(('source', 'count'), [
    ('import rclpy', 1),
    ('from sensor_msgs.msg import PointCloud2', 1),
    ('import logging', 1),
    ('def f():\n    from plc_inspect.offline import clouds', 1),
    ('from plc_inspect.messages.rows import LINES', 1),
    ('import plc_inspect.monitor.picture.model', 1),
    ('import os', 1),
    ('from pathlib import Path', 1),
    ('print(1)', 1),
    ('open("x")', 1),
    ('np.load("x")', 1),
    ('assert x', 1),
    ('import numpy as np\nfrom plc_inspect.errors import DataError\nx = np.zeros(3)', 0),
])
def test_the_check_finds_what_it_should(source, count):
    assert len(list_offences(ast.parse(source))) == count


@pytest.mark.parametrize('path', MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_modules_are_short_and_have_their_head(path):
    text = path.read_text(encoding='utf-8')
    assert not text or text.startswith(HEAD)
    assert text.count('\n') < MOST_LINES


@pytest.mark.parametrize('path', [
    path for path in MODULES
    if not path.is_relative_to(ROOT / 'ros') and not path.is_relative_to(ROOT / 'monitor')
], ids=lambda path: str(path.relative_to(ROOT)))
def test_commands_and_messages_need_no_ros(path):
    roots = {name.partition('.')[0] for name in list_imports(parse(path))}
    assert not roots & {'rclpy', 'rclpy_message_converter', 'sensor_msgs', 'nav_msgs', 'std_msgs'}


def test_packages_hold_what_one_can_look_over():
    folders = {path.parent for path in [*MODULES, *SCRIPTS]}
    assert len(folders) >= LEAST_PACKAGES
    crowded = {
        str(folder.relative_to(ROOT.parent)): len(list(folder.glob('*.py')))
        for folder in folders
    }
    assert {name: count for name, count in crowded.items() if count > MOST_MODULES + 1} == {}


@pytest.mark.parametrize(('package', 'least'), LEAST_FUNCTIONS.items())
def test_calls_take_at_most_seven_arguments(package, least):
    functions = [
        (path.stem, function)
        for path in sorted(ROOT.joinpath(*package.split('.')).glob('*.py'))
        for function in ast.walk(parse(path))
        if isinstance(function, ast.FunctionDef) and not is_kernel(function)
    ]
    assert len(functions) >= least
    assert [
        f'{module}.{function.name} takes {count_arguments(function)}'
        for module, function in functions if count_arguments(function) > MOST_ARGUMENTS
    ] == []


@pytest.mark.parametrize(('source', 'count'), [
    ('def f(a, b, /, c, *args, d, e=1, **names): pass', 5),
    ('def f(self, a): pass', 1),
    ('def f(): pass', 0),
])
def test_arguments_are_counted_by_name(source, count):
    assert count_arguments(ast.parse(source).body[0]) == count


@pytest.mark.parametrize(('decorator', 'expected'), [
    ('njit', True), ('njit(cache=True)', True), ('numba.njit', True), ('property', False),
    ('dataclass(frozen=True)', False),
])
def test_kernels_are_told_by_their_decorator(decorator, expected):
    (function,) = ast.parse(f'@{decorator}\ndef f(): pass').body
    assert is_kernel(function) == expected


def test_imports_run_one_way():
    upward = []
    for path in MODULES:
        own = package_of(path)
        for name in find_modules(list_imports(parse(path))):
            other = package_of(ROOT.parent / (name.replace('.', '/') + '.py'))
            if LAYERS.index(other) > LAYERS.index(own):
                upward.append(f'{path.relative_to(ROOT)} imports {name}')
    assert upward == []


def test_no_modules_import_each_other():
    needed = {
        '.'.join(path.relative_to(ROOT.parent).with_suffix('').parts):
            find_modules(list_imports(parse(path)))
        for path in MODULES
    }
    assert sum(len(others) for others in needed.values()) >= LEAST_IMPORTS
    TopologicalSorter(needed).prepare()  # raises CycleError, with the circle


def test_every_package_has_its_layer():
    packages = {package_of(path) for path in MODULES if path.name != '__init__.py'}
    assert packages == set(LAYERS)


def package_of(path):
    """Return the package of a module by its dotted name; '' holds those beside the packages."""
    return '.'.join(path.relative_to(ROOT).parts[:-1])


def is_kernel(function):
    """Tell whether numba compiles a function."""
    return any(
        isinstance(node, ast.Name | ast.Attribute)
        and ast.unparse(node).rpartition('.')[2] == 'njit'
        for decorator in function.decorator_list for node in ast.walk(decorator)
    )


def count_arguments(function):
    """Count the arguments that a function names, without self."""
    given = function.args
    names = [item.arg for item in [*given.posonlyargs, *given.args, *given.kwonlyargs]]
    return len([name for name in names if name not in ('self', 'cls')])


def find_modules(names):
    """Return those of some imported names that are modules of ours, or hold such."""
    found = set()
    for name in names:
        while name.startswith('plc_inspect.'):
            if (ROOT.parent / (name.replace('.', '/') + '.py')).is_file():
                found.add(name)
                break
            name = name.rpartition('.')[0]
    return found


def test_the_page_of_the_architecture_names_what_there_is():
    text = (ROOT.parent / 'docs/architecture.md').read_text(encoding='utf-8')
    names = [name for name in re.findall(r'`([^` ]+)`', text) if re.fullmatch(r'[\w./*]+', name)]
    places = sorted({name for name in names if '/' in name})
    assert len(places) >= LEAST_PLACES
    missing = [
        name for name in places
        if not any(list(folder.glob(name.rstrip('/') + suffix))
                   for folder in (ROOT, ROOT.parent, ROOT / 'core', ROOT / 'sim', ROOT / 'ros',
                                  ROOT / 'grid', ROOT / 'monitor')
                   for suffix in ('', '.py'))
    ]
    assert missing == []
