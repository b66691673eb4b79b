# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Lists the constants of the core, and where their values come from, as ``docs/constants.md``.

The docstring of a constant says what it is, with its unit in brackets, and ends with a sentence
that begins with ``Source:``.  ``make settings`` runs this.
"""

import ast
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
import re

ROOT = Path(__file__).parents[1]
CORE = ROOT / 'plc_inspect' / 'core'
PAGE = ROOT / 'docs' / 'constants.md'
KINDS = {
    'paper': 'the paper',
    'derived': 'follows from other figures, which are named',
    'chosen on': 'chosen by the figures of a bench',
    'measured': 'set between what was measured, on a bench or on real clouds',
    'numerical': 'sizes of buffers and blocks, bounds of time, tolerances of arithmetic',
    'judgement': 'plausible, and no measurement chose it; some say how far they can be moved',
    'reference': 'data sheets, standards and documents',
}
"""Beginnings of sources, and what they mean; what begins with none of them is a reference."""
_HEAD = """\
# Constants

All numbers at the top of the modules of `plc_inspect/core/`, with the source of their values. What
a user may change is a setting, see [settings.md](settings.md); these are not. Values stand as in
the code.

This page is made by `make settings`, which runs `python tools/make_constants.py`.
"""
_NAME = re.compile(r'_?[A-Z][A-Z0-9_]*')
_UNIT = re.compile(r'\s*\[([A-Za-z][^\[\],]*)\]')


@dataclass(frozen=True, slots=True, kw_only=True)
class Constant:
    """A number at the top of a module."""

    module: str
    """Path below ``plc_inspect/core``."""
    name: str
    value: str
    """As it stands in the code."""
    text: str
    """Docstring in one line, '' without one."""

    @property
    def about(self) -> str:
        """What it is: the docstring without its source."""
        return self.text.partition('Source:')[0].strip()

    @property
    def unit(self) -> str:
        """What stands in brackets, '' of counts and ratios."""
        found = _UNIT.search(self.about)
        return found[1] if found else ''

    @property
    def source(self) -> str:
        """Where the value comes from, '' unknown."""
        return self.text.partition('Source:')[2].strip()

    @property
    def kind(self) -> str:
        """Which of KINDS the source is, '' unknown."""
        first = (kind for kind in KINDS if self.source.startswith(kind))
        return next(first, 'reference') if self.source else ''


def list_constants(text: str, module: str = '') -> list[Constant]:
    """Return the constants of one module, in their order, from its source code."""
    body = ast.parse(text).body
    return [
        Constant(
            module=module, name=name,
            value=' '.join((ast.get_source_segment(text, value) or '').split()),
            text=' '.join(_read_text(after).split()),
        )
        for node, after in pairwise([*body, ast.Pass()])
        for name, value in _read_names(node)
        if _NAME.fullmatch(name) and _is_number(value)
    ]


def walk_core(root: Path = CORE) -> list[Constant]:
    """Return the constants of all modules below a folder, by package and module."""
    paths = sorted(root.rglob('*.py'), key=lambda path: (path.parent, path.name))
    return [
        item for path in paths
        for item in list_constants(
            path.read_text(encoding='utf-8'), path.relative_to(root).as_posix()
        )
    ]


def render_page(constants: Sequence[Constant]) -> str:
    """Return the page of the documentation that lists constants."""
    count = Counter(item.kind for item in constants)
    lines = [_HEAD, '| source | constants | meaning |', '| --- | --- | --- |']
    lines += [f'| {kind} | {count[kind]} | {meaning} |' for kind, meaning in KINDS.items()]
    package = module = ''
    for item in constants:
        own = item.module.rpartition('/')[0] or 'core'
        if own != package:
            package = own
            lines += ['', f'## {package}']
        if item.module != module:
            module = item.module
            lines += [
                '', f'### {Path(module).stem}', '',
                '| constant | value | unit | meaning | source |',
                '| --- | --- | --- | --- | --- |',
            ]
        about = _UNIT.sub('', item.about, count=1).rstrip('.')
        cells = (f'`{item.name}`', f'`{item.value}`', item.unit, about, item.source.rstrip('.'))
        lines.append('| ' + ' | '.join(cell.replace('|', r'\|') for cell in cells) + ' |')
    return '\n'.join(lines) + '\n'


def main() -> None:
    """Write the page."""
    PAGE.write_text(render_page(walk_core()), encoding='utf-8')


def _read_names(node: ast.stmt) -> Iterator[tuple[str, ast.expr]]:
    """Yield the names that a statement sets, each with its value."""
    if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
        return
    for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
        if isinstance(target, ast.Name):
            yield target.id, node.value
        elif isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
            for name, value in zip(target.elts, node.value.elts, strict=True):
                if isinstance(name, ast.Name):
                    yield name.id, value


def _read_text(node: ast.stmt) -> str:
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
        return str(node.value.value)
    return ''


def _is_number(node: ast.expr) -> bool:
    """Tell numbers, and what is made of nothing else: terms, tuples and tables of them."""
    if isinstance(node, ast.Constant):
        return type(node.value) in (int, float)
    if isinstance(node, ast.Name):
        return _NAME.fullmatch(node.id) is not None
    if isinstance(node, ast.UnaryOp):
        return _is_number(node.operand)
    if isinstance(node, ast.BinOp):
        return _is_number(node.left) and _is_number(node.right)
    if isinstance(node, ast.Tuple | ast.List):
        return bool(node.elts) and all(map(_is_number, node.elts))
    if isinstance(node, ast.Dict):
        return bool(node.values) and all(map(_is_number, node.values))
    if isinstance(node, ast.Attribute):
        return ast.unparse(node) in ('math.pi', 'np.pi')
    if isinstance(node, ast.Call):
        is_scalar = ast.unparse(node.func).startswith(('math.', 'np.float', 'np.int', 'np.uint'))
        return is_scalar and all(map(_is_number, node.args))
    return False


if __name__ == '__main__':
    main()
