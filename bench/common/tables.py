# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Tables of figures, on the terminal and in the documentation, with the floors they must keep."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
import math
from pathlib import Path

from plc_inspect.whole_files import replace_file

MISSED = '**missed**'


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """One figure and the floor or ceiling that it must keep."""

    data: str
    measure: str
    value: float
    limit: tuple[float, float]
    """Least and greatest value that pass."""
    unit: str = ''
    """'m', 's', '%' of a share, or '' for a number."""
    remark: str = ''

    @property
    def passed(self) -> bool:
        """Whether the figure lies within its limits; one that does not exist does not."""
        return self.limit[0] <= self.value <= self.limit[1]

    def row(self) -> tuple[str, ...]:
        """Return data, measure, figure, floor, mark and remark."""
        low, high = self.limit
        if math.isfinite(low) and math.isfinite(high) and low != high:
            floor = f'{self._format(low)} to {self._format(high)}'
        elif low == high:
            floor = self._format(low)
        else:
            floor = f'>= {self._format(low)}' if math.isfinite(low) else (
                f'<= {self._format(high)}')
        mark = 'ok' if self.passed else MISSED
        return self.data, self.measure, self._format(self.value), floor, mark, self.remark

    def _format(self, value: float) -> str:
        if math.isnan(value):
            return '-'
        if self.unit == '%':
            return f'{value:.1%}'
        text = f'{value:.3f}'.rstrip('0').rstrip('.') if value % 1 else f'{value:.0f}'
        return f'{text} {self.unit}'.rstrip()


CHECK_COLUMNS = ('data', 'measure', 'figure', 'floor', '', 'where')


def at_least(data: str, measure: str, value: float, floor: float, unit: str = '',
             remark: str = '') -> Check:
    """Return a check against a floor."""
    return Check(data=data, measure=measure, value=value, limit=(floor, math.inf), unit=unit,
                 remark=remark)


def at_most(data: str, measure: str, value: float, ceiling: float, unit: str = '',
            remark: str = '') -> Check:
    """Return a check against a ceiling."""
    return Check(data=data, measure=measure, value=value, limit=(-math.inf, ceiling), unit=unit,
                 remark=remark)


def render_table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table whose columns are padded, so that it reads as text as well."""
    lines = [tuple(columns), *(tuple(row) for row in rows)]
    widths = [max(3, *(len(line[k]) for line in lines)) for k in range(len(columns))]
    padded = [
        '| ' + ' | '.join(text.ljust(width) for text, width in zip(line, widths, strict=True))
        + ' |' for line in lines
    ]
    rule = '| ' + ' | '.join('-' * width for width in widths) + ' |'
    return '\n'.join([padded[0], rule, *padded[1:]])


def replace_section(path: Path, name: str, text: str) -> None:
    """
    Put text between the markers of one section of a Markdown file, made if it is missing.

    The rest of the file is left as it is.  The markers are the comments ``begin NAME`` and
    ``end NAME``.
    """
    begin, end = f'<!-- begin {name} -->', f'<!-- end {name} -->'
    old = path.read_text(encoding='utf-8') if path.is_file() else ''
    block = f'{begin}\n{text.strip()}\n{end}'
    if begin in old and end in old:
        head, _, rest = old.partition(begin)
        tail = rest.partition(end)[2]
        new = f'{head}{block}{tail}'
    else:
        new = f'{old.rstrip()}\n\n{block}\n'.lstrip()
    with replace_file(path) as aside:
        aside.write_text(new, encoding='utf-8')


def format_figure(value: float, digits: int = 3) -> str:
    """Return a number for a table, '-' where it does not exist."""
    return '-' if math.isnan(value) else f'{value:.{digits}f}'
