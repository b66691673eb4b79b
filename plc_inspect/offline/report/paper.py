# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The report on paper: size, contents with page numbers, PDF."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
import importlib.util
from pathlib import Path

from plc_inspect.errors import ConfigError
from plc_inspect.offline.records.units import Record
from plc_inspect.offline.report.browser import find_browser, print_pdf

SIZES = ('A4', 'Letter')
"""Of paper, as style sheets name them."""
PACKAGE = 'pypdf'
"""Package that finds the pages of the parts of the report."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Paper:
    """Paper of a printed report."""

    size: str
    """One of SIZES."""
    pages: Mapping[str, int] = field(default_factory=dict)
    """First page of each part, by its anchor; empty if not known yet."""


def check_printing(size: str) -> None:
    """Raise ConfigError unless a report can be printed on paper of that size."""
    if size not in SIZES:
        raise ConfigError(f'--paper must be one of {", ".join(SIZES)}, got {size!r}')
    find_browser()
    if importlib.util.find_spec(PACKAGE) is None:
        raise ConfigError(
            f"--pdf needs the Python package {PACKAGE}: pip install 'plc_inspect[pdf]'"
        )


def list_contents(
    sheets: Sequence[Record], *, worst: bool, coverage: bool, what_if: bool, changes: bool
) -> list[tuple[str, str, bool]]:
    """
    Return the contents of a printed report.

    Parameters
    ----------
    sheets : sequence of dict
        Of the hazards, as they are printed.
    worst, coverage, what_if, changes : bool
        Whether these parts exist.

    Returns
    -------
    list of tuple
        Anchor, title, and whether it is a subsection of the one before.

    """
    parts = [
        ('worst', 'The worst hazards', worst), ('map-view', 'Map', True),
        ('hazards', 'Hazards', True), *((
            f'sheet-{item["hazard_id"]}',
            f'Hazard {item["hazard_id"]}: {item["severity"]}, {item["kind"].replace("_", " ")}',
            True,
        ) for item in sheets), ('coverage', 'Coverage', coverage),
        ('what-if', 'What if', what_if), ('changes', 'Changes', changes),
        ('spans', 'Spans', True), ('supports', 'Supports', True),
        ('stages', 'How it was found', True), ('settings', 'Settings', True),
    ]
    return [(name, title, name.startswith('sheet-')) for name, title, is_there in parts
            if is_there]


def quote_css(text: str) -> str:
    """Return a text as it may stand between quotes in a style sheet."""
    kept = (char if char.isalnum() or char in ' .-_' else f'\\{ord(char):06x}' for char in text)
    return ''.join(kept)


def print_report(render: Callable[[Paper], str], size: str, path: Path) -> None:
    """
    Print a report with contents, in two passes: the first finds the pages of its parts.

    Parameters
    ----------
    render : callable
        Returns the page for some paper.
    size : str
        One of SIZES.
    path : Path
        The PDF to write.

    Raises
    ------
    ConfigError
        No Chromium, or no pypdf, is installed.
    DataError
        The page could not be printed.

    """
    check_printing(size)
    page = path.with_name(f'{path.stem}.print.html')
    try:
        page.write_text(render(Paper(size=size)), encoding='utf-8')
        print_pdf(page, path)
        page.write_text(render(Paper(size=size, pages=find_pages(path))), encoding='utf-8')
        print_pdf(page, path)
    finally:
        page.unlink(missing_ok=True)


def find_pages(path: Path) -> dict[str, int]:
    """Return the page of a PDF, from 1, of each link target."""
    import pypdf

    with path.open('rb') as file:
        reader = pypdf.PdfReader(file)
        return {
            name.lstrip('/'): 1 + number for name, place in reader.named_destinations.items()
            if (number := reader.get_destination_page_number(place)) is not None
        }
