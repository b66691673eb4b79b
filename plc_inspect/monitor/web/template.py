# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The files of the page: templates, and static files."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from plc_inspect.templates import open_templates

FOLDER = Path(__file__).parents[1] / 'page'
KINDS = {'.js': 'text/javascript', '.css': 'text/css', '': 'text/plain'}
"""Content types of static files, by suffix."""


def render(name: str, **values: Any) -> str:
    """
    Fill in a template.

    Parameters
    ----------
    name : str
        File in ``monitor/page``.
    **values
        What the template names; texts are escaped.

    Returns
    -------
    str
        HTML.

    Raises
    ------
    jinja2.UndefinedError
        The template names a value that is not there.

    """
    return _open().get_template(name).render(values)


@cache
def list_files() -> Mapping[str, tuple[str, bytes]]:
    """Return type and bytes of all files that browsers may ask for, by their paths."""
    return {
        f'/{path.relative_to(FOLDER)}': (KINDS[path.suffix], path.read_bytes())
        for path in sorted(FOLDER.rglob('*')) if path.is_file() and path.suffix in KINDS
    }


@cache
def _open() -> Any:
    return open_templates('monitor/page')
