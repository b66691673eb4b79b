# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Colours of severities, lines and supports: one table for page, report, markers and files."""

LINE_COLORS = (
    '#0072b2', '#d55e00', '#8e44ad', '#c2185b', '#00838f', '#e69f00', '#5d4037', '#3f51b5',
)
"""Of conductors, by line_id; after the last the first comes again."""
SEVERITY_COLORS = {'critical': '#c62828', 'warning': '#ef7d00', 'notice': '#1565c0'}
"""Of hazards, the worst first."""
OK_COLOR = '#2e9e4f'
SUPPORT_COLOR = '#9999a6'
TEXT_COLOR = '#ffffff'


def line_color(line_id: int) -> str:
    """Return the colour of a line, as ``#rrggbb``."""
    return LINE_COLORS[line_id % len(LINE_COLORS)]


def severity_color(name: str) -> str:
    """Return the colour of a severity by its name in small letters; of ``ok`` too."""
    return OK_COLOR if name == 'ok' else SEVERITY_COLORS[name]


def parse_color(color: str) -> tuple[int, int, int]:
    """Return red, green and blue of ``#rrggbb``, 0 to 255."""
    return int(color[1:3], 16), int(color[3:5], 16), int(color[5:7], 16)
