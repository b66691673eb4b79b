# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""HTML, styles and programs are in files of their own, which are escaped and complete."""

import ast
from pathlib import Path
import re
import subprocess
import sys

import jinja2
import pytest

from plc_inspect.colors import LOOKS, SEVERITY_COLORS
from plc_inspect.monitor.web.template import FOLDER, list_files, render
from plc_inspect.monitor.web.values import format_metres

ROOT = Path(__file__).parents[3]
MONITOR = ROOT / 'plc_inspect' / 'monitor'
MODULES = sorted(MONITOR.rglob('*.py'))
OWN = sorted(path for path in FOLDER.iterdir() if path.is_file())
LEAST_MODULES, LEAST_FILES = 20, 8
"""A search that finds fewer looks in the wrong place."""
MOST_BYTES = 1_000_000
"""Of all that a browser loads, before it is compressed."""
TAG = re.compile(r'</|/>|<!|<[a-z][a-z0-9]*([\s>]|$)', re.IGNORECASE)
"""Also one that a replacement field of an f-string interrupts."""
WITHOUT_PAGE = """
import sys
import plc_inspect.monitor.command, plc_inspect.monitor.station
import plc_inspect.monitor.record.recorder
import plc_inspect.monitor.terminal.screen, plc_inspect.monitor.terminal.snapshot
print(*sorted({'jinja2', 'aiohttp'} & set(sys.modules)))
"""


def list_markup(tree):
    """List the strings with tags in them, those that stand alone as docstrings left out."""
    docstrings = {
        id(node.value) for node in ast.walk(tree)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    return [
        f'line {node.lineno}: {node.value!r}' for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and id(node) not in docstrings
        and TAG.search(decode(node.value))
    ]


def decode(value):
    """Return the text of a constant, nothing where it is none."""
    if isinstance(value, bytes):
        return value.decode('latin-1')
    return value if isinstance(value, str) else ''


def draw():
    """Return the page."""
    return render('index.html', nonce='n', looks=LOOKS.values(), table={}, known=['/uav'],
                  ramp=('#000',), near=2, far=15)


def test_the_search_finds_all_modules_and_files():
    assert len(MODULES) >= LEAST_MODULES
    assert len(OWN) >= LEAST_FILES


@pytest.mark.parametrize('path', MODULES, ids=lambda path: str(path.relative_to(MONITOR)))
def test_modules_hold_no_markup(path):
    assert list_markup(ast.parse(path.read_text(encoding='utf-8'))) == []


@pytest.mark.parametrize(('source', 'count'), [
    ("x = '<p>text'", 1),
    ("x = f'<b>{y}</b>'", 2),
    ("x = f'<div{style}>'", 1),
    ("x = f'<circle r=\"{y}\"/>'", 2),
    ("x = b'<h1>'", 1),
    ("x = '<!DOCTYPE html>'", 1),
    ("f('a' '<br>')", 1),
    ("x = 'text'\n'''Documents <b>x</b>.'''", 0),
    ("def f():\n    '''Return <p>.'''", 0),
    ("x = f'{a} < {b}' + 'a <= b' + 'a<5' + '<'", 0),
])
def test_the_check_finds_what_it_should(source, count):
    assert len(list_markup(ast.parse(source))) == count


@pytest.mark.parametrize('path', OWN, ids=lambda path: path.name)
def test_files_have_their_head_and_bring_nothing_in_unescaped(path):
    text = path.read_text(encoding='utf-8')
    first, second = text.split('\n')[:2]
    assert 'Copyright 2026 plc_inspect contributors' in first
    assert 'SPDX-License-Identifier: Apache-2.0' in second
    for word in ('|safe', '| safe', 'autoescape', 'innerHTML', 'insertAdjacentHTML', 'eval('):
        assert word not in text
    if path.suffix == '.html':
        jinja2.Environment().parse(text)


def test_severities_have_no_colours_of_their_own():
    text = ''.join(path.read_text(encoding='utf-8') for path in OWN)
    for color in SEVERITY_COLORS.values():
        assert color not in text
        assert color in draw()


def test_values_are_escaped_and_none_is_missing():
    assert '&lt;b&gt;&amp;' in render('door.html', message='<b>&', nonce='n')
    with pytest.raises(jinja2.UndefinedError, match='message'):
        render('door.html', nonce='n')


def test_the_page_loads_only_what_is_served_and_is_small():
    served = list_files()
    assert sum(len(data) for _, data in served.values()) + len(draw()) < MOST_BYTES
    page = draw()
    names = set(re.findall(r'(?:src|href)="(/[^"]+)"', page))
    for path, (kind, data) in served.items():
        if kind == 'text/javascript' and '/vendor/' not in path:
            found = re.findall(r"(?:from |import\()'([^']+)'", data.decode())
            names |= {
                name.replace('./', '/', 1) if name[0] == '.' else f'/vendor/{name}'
                for name in found if name != 'three'
            }
    assert len(names) >= 13
    assert names <= set(served)
    assert not re.search(r'https?://(?!www\.w3\.org)', page)


def test_vendored_files_have_their_licence():
    text = (FOLDER / 'vendor' / 'three' / 'LICENSE').read_text(encoding='utf-8')
    assert text.startswith('The MIT License')


def test_lengths_are_written_with_their_deviation():
    assert format_metres(1.234) == '1.23 m'
    assert format_metres(1.234, 0.056) == '1.23 \u00b1 0.06 m'
    assert format_metres(float('nan'), 0.1) == '-'


def test_terminal_and_scripts_load_no_page():
    done = subprocess.run([sys.executable, '-c', WITHOUT_PAGE], capture_output=True, text=True,
                          check=True, timeout=60, cwd=ROOT)
    assert done.stdout.strip() == ''
