# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Reads points from text: one per row, columns separated by spaces, commas, semicolons or tabs."""

from collections.abc import Iterator, Sequence
from itertools import chain, islice
from pathlib import Path
import re

import numpy as np

from plc_inspect.errors import DataError
from plc_inspect.printable import make_one_line
from plc_inspect.results import Float64

_COMMENTS = ('#', '//')
_QUOTED = re.compile('"[^"]*"')
_MOST_TEXT = 80
"""Greatest number of characters of a row that are quoted."""
_MOST_LINES = 250_000
"""Rows held as text at a time.  Source: judgement: some 20 MB."""
_MOST_LINE = 100_000
"""Greatest length of a row in characters; a longer one is no point.  Source: judgement."""


def iterate_xyz(path: Path, most: int) -> Iterator[Float64]:
    """
    Yield the points of a text file.

    If the first row names the columns, x, y and z are used, otherwise the first three.

    Parameters
    ----------
    path : Path
        The file.
    most : int
        Greatest number of points yielded at once.

    Yields
    ------
    (N, 3) float64
        As in the file, including NaN.

    Raises
    ------
    DataError
        A row has too few columns or a value that is no number, a column x, y or z is missing, the
        first row of points has other columns than are named, or the text ends in the middle of a
        row.
    OSError
        The file cannot be opened.

    """
    with path.open(encoding='utf-8-sig', errors='replace') as file:
        rows = iter(lambda: file.readline(_MOST_LINE + 1), '')
        before, first = _find_first(rows)
        if not first:
            return
        mark = next((own for own in ';\t,' if own in first), None)
        names = [name.strip(' \t"\'').lower() for name in _strip(first).split(mark)]
        if any(_is_number(name) for name in names[:3]):
            columns = [0, 1, 2]
            rows, before = chain([first], rows), before - 1
            names = []
        else:
            columns = _find_columns(path, names)
        while lines := list(islice(rows, min(most, _MOST_LINES))):
            if names:
                _check_names(path, names, lines, mark, before)
                names = []
            points = _parse(path, lines, mark, columns, before)
            before += len(lines)
            if not lines[-1].endswith('\n') and _is_cut_off(lines, mark):
                raise DataError(
                    f'{path}, row {before}, the last, has fewer decimals than others and no line'
                    ' break: is it truncated? If not, end it with a line break'
                )
            yield points


def estimate_xyz(path: Path) -> int:
    """Return about how many rows a text file holds, by the length of its first ones."""
    with path.open('rb') as file:
        head = file.read(_MOST_LINE)
    return path.stat().st_size * head.count(b'\n') // max(len(head), 1)


def _find_first(file: Iterator[str]) -> tuple[int, str]:
    """Return number and text of the first row that holds points or names columns."""
    for number, line in enumerate(file, start=1):
        names = _strip(line).replace(',', ' ').replace(';', ' ').lower().split()
        is_comment = line.lstrip().startswith(_COMMENTS)
        if names and (not is_comment or {'x', 'y', 'z'} <= {name.strip('"\'') for name in names}):
            return number, line
    return 0, ''


def _strip(line: str) -> str:
    """Return a row without what stands before names in a comment: its mark, and a label."""
    text = line.strip()
    if text.startswith(_COMMENTS):
        text = text.lstrip(''.join(_COMMENTS)).rpartition(':')[2]
    return text.strip()


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _find_columns(path: Path, names: Sequence[str]) -> list[int]:
    for name in 'xyz':
        if names.count(name) != 1:
            shown = make_one_line(', '.join(names))[:_MOST_TEXT]
            number = 'no column' if name not in names else f'{names.count(name)} columns'
            raise DataError(f'{path} has {number} {name!r} in its first row: {shown}')
    return [names.index(name) for name in 'xyz']


def _check_names(
    path: Path, names: Sequence[str], lines: Sequence[str], mark: str | None, before: int
) -> None:
    """Refuse rows of other columns than are named, as which is which is not known."""
    for number, line in enumerate(lines, start=before + 1):
        text = _QUOTED.sub('text', _drop_comment(line)).rstrip(f'{mark or ""} \t')
        if not text:
            continue
        num = len(text.split(mark))
        may_lack = mark is not None or names[:3] == ['x', 'y', 'z']
        if num > len(names) or (num < len(names) and not may_lack):
            raise DataError(
                f'{path}, row {number}: {num} columns, {len(names)} are named; name each, and'
                f' write decimals with points: {make_one_line(line.strip())[:_MOST_TEXT]}'
            )
        return


def _parse(
    path: Path, lines: list[str], mark: str | None, columns: Sequence[int], before: int
) -> Float64:
    longest = max(map(len, lines))
    if longest > _MOST_LINE:
        raise DataError(f'{path} is not a text file of points: a row has {longest} characters')
    rows = [line for line in lines if not line.isspace()]
    if all(line.lstrip().startswith(_COMMENTS) for line in rows):
        return np.zeros((0, 3))
    marks = _COMMENTS if any('#' in line or '//' in line for line in rows) else None
    try:
        return np.loadtxt(
            rows, delimiter=mark, usecols=columns, comments=marks, ndmin=2, dtype=np.float64
        )
    except ValueError as error:
        raise DataError(f'{path}, {_find_fault(lines, mark, columns, before, error)}') from error


def _is_cut_off(lines: Sequence[str], mark: str | None) -> bool:
    """Tell whether the last number has fewer decimals than that of the point before."""
    points = filter(None, map(_drop_comment, reversed(lines)))
    if not _drop_comment(lines[-1]):
        return False
    last = next(points)
    return _count_decimals(last, mark) < _count_decimals(next(points, last), mark)


def _count_decimals(point: str, mark: str | None) -> int:
    return len(point.split(mark)[-1].partition('.')[2])


def _drop_comment(line: str) -> str:
    return line.partition('#')[0].partition('//')[0].strip()


def _find_fault(
    lines: Sequence[str], mark: str | None, columns: Sequence[int], before: int, error: ValueError
) -> str:
    """Describe the first faulty row."""
    for number, line in enumerate(lines, start=before + 1):
        text = _drop_comment(line)
        parts = text.split(mark) if text else []
        if not parts:
            continue
        shown = make_one_line(line.strip())[:_MOST_TEXT]
        if len(parts) <= max(columns):
            return (f'row {number}: {len(parts)} columns, {max(columns) + 1} are needed; is it'
                    f' truncated? {shown}')
        for column in columns:
            if not _is_number(parts[column]):
                return f'row {number}: {make_one_line(parts[column])!r} is not a number: {shown}'
    return f'rows {before + 1} to {before + len(lines)}: {make_one_line(error)}'
