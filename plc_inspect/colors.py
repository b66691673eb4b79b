# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Colours, shapes and words of severities, lines and supports: one table for all that is drawn.

Monitor, report, markers, KML and DXF take them from here.  Severities differ for colour-blind eyes
as well (``test/monitor/web/test_colors.py``), and are never shown by colour alone.
"""

from dataclasses import dataclass

LINE_COLORS = (
    '#0072b2', '#d55e00', '#8e44ad', '#c2185b', '#00838f', '#e69f00', '#5d4037', '#3f51b5',
)
"""Colours of conductors by line_id, repeated cyclically."""


@dataclass(frozen=True, slots=True)
class Look:
    """How a severity is drawn and named."""

    name: str
    color: str
    ink: str
    """Colour of text on it."""
    shape: str
    corners: int
    """Corners of the shape; 0 for a circle."""
    word: str


LOOKS = {look.name: look for look in (
    Look('critical', '#c1121f', '#ffffff', 'octagon', 8, 'CRITICAL'),
    Look('warning', '#e69f00', '#000000', 'triangle', 3, 'Warning'),
    Look('notice', '#2b6cc4', '#ffffff', 'diamond', 4, 'Notice'),
    Look('ok', '#7fd1b9', '#000000', 'circle', 0, 'OK'),
)}
"""
Looks by name, the worst first.
Source: of 700 combinations of reds, oranges, blues and greens the one whose least distance, as
seen with normal, deuteranopic, protanopic and tritanopic eyes, is the greatest: 28 in CAM02-UCS,
where the colours before had 9.
"""
SEVERITY_COLORS = {name: look.color for name, look in LOOKS.items() if name != 'ok'}
"""Colours of hazards, the worst first."""
OK_COLOR = LOOKS['ok'].color
SUPPORT_COLOR = '#9999a6'
TEXT_COLOR = '#ffffff'


def line_color(line_id: int) -> str:
    """Return the colour of a line, as ``#rrggbb``."""
    return LINE_COLORS[line_id % len(LINE_COLORS)]


def severity_color(name: str) -> str:
    """Return the colour of a severity, or of ``ok``, by its lower-case name."""
    return LOOKS[name].color


def parse_color(color: str) -> tuple[int, int, int]:
    """Return red, green and blue of ``#rrggbb``, 0 to 255."""
    return int(color[1:3], 16), int(color[3:5], 16), int(color[5:7], 16)
