# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The templates of the page, and how they write numbers."""

import math
from typing import Any

import jinja2

from plc_inspect.colors import severity_color
from plc_inspect.monitor.picture.picture import name_severity
from plc_inspect.monitor.terminal.text import format_age, STALE
from plc_inspect.templates import open_templates


def render(name: str, **values: Any) -> str:
    """
    Fill in a template.

    Parameters
    ----------
    name : str
        File in ``templates``.
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
    return _TEMPLATES.get_template(name).render(values)


def format_metres(value: float, sigma: float = math.nan) -> str:
    """Return a length with its standard deviation where known, ``-`` for NaN [m]."""
    if math.isnan(value):
        return '-'
    return f'{value:.2f} m' if math.isnan(sigma) else f'{value:.2f} \u00b1 {sigma:.2f} m'


def _format_number(value: float, decimals: int = 2) -> str:
    return f'{value:.{decimals}f}'


def _format_percent(share: float) -> str:
    return f'{share:.0%}'


def _load_templates() -> jinja2.Environment:
    environment = open_templates('monitor/web/templates')
    environment.filters.update(
        age=format_age, metres=format_metres, number=_format_number, percent=_format_percent,
        severity=name_severity,
    )
    environment.globals.update(severity_color=severity_color, stale=STALE)
    return environment


_TEMPLATES = _load_templates()
