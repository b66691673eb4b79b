# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""DXF of the catenaries, for line design tools."""

from collections import OrderedDict
from pathlib import Path

import ezdxf
import numpy as np

from plc_inspect.colors import parse_color, severity_color
from plc_inspect.offline.records.inspection import Inspection
from plc_inspect.offline.records.sentences import find_measured
from plc_inspect.offline.records.span_curve import TOLERANCE, trace_span
from plc_inspect.offline.records.units import Record

FILE = 'catenaries.dxf'
_UNITS = {'m': 6, 'ft': 2, 'ftUS': 21}
"""Name of the unit to $INSUNITS."""
_UNITLESS = 0


def write_dxf(path: Path, inspection: Inspection, records: dict[str, list[Record]]) -> None:
    """
    Write catenaries, supports and hazards as three-dimensional DXF R2010.

    Each line has a layer ``LINE_n`` with a polyline for every span; supports are vertical lines
    on ``SUPPORTS``, hazards points with a text on ``HAZARDS``.  Coordinates are those of the
    input.

    Parameters
    ----------
    path : Path
        The file.
    inspection : Inspection
        The run.
    records : dict
        'spans', 'supports' and 'hazards' as their JSON files hold them.

    """
    # no date or random identifiers, so that equal results give equal bytes
    ezdxf.options.write_fixed_meta_data_for_testing = True  # type: ignore[attr-defined]
    units = inspection.units
    document = ezdxf.new(  # type: ignore[attr-defined]
        'R2010', units=_UNITS.get(units.name, _UNITLESS)
    )
    space = document.modelspace()
    for name, color in (('SUPPORTS', 8), ('HAZARDS', 1)):
        document.layers.add(name, color=color)
    for row in records['spans']:
        layer = f'LINE_{row["line_id"]}'
        if layer not in document.layers:
            document.layers.add(layer, color=1 + row['line_id'] % 6)
        curve = trace_span(row, TOLERANCE / units.horizontal, units.horizontal / units.vertical)
        line = space.add_polyline3d(curve.tolist(), dxfattribs={'layer': layer})
        line.set_xdata('PLC_INSPECT', [
            (1000, f'span {row["span_id"]}'), (1040, row['a']), (1040, row['b']),
            (1040, row['c']), (1040, row['sag']),
        ])
    document.appids.add('PLC_INSPECT')
    for row in records['supports']:
        foot = np.array(row['position'], float)
        top = foot + np.array([0.0, 0.0, row['height'] or 0.0])
        space.add_line(foot.tolist(), top.tolist(), dxfattribs={'layer': 'SUPPORTS'})
    for row in records['hazards']:
        style = {'layer': 'HAZARDS', 'true_color': _true_color(row['severity'])}
        space.add_point(row['position'], dxfattribs=style)
        text = f'{row["hazard_id"]} {row["kind"]} {find_measured(row)[0]:.2f}'
        space.add_text(text, height=0.5 / units.horizontal, dxfattribs=style) \
            .set_placement(row['position'])
    # ezdxf adds these from a set, whose order varies between processes
    document.classes.add_required_classes(document.dxfversion)
    document.classes.classes = OrderedDict(sorted(document.classes.classes.items()))
    document.saveas(path)


def _true_color(severity: str) -> int:
    """Return the colour of a severity in the encoding of DXF: 0xRRGGBB."""
    red, green, blue = parse_color(severity_color(severity))
    return red << 16 | green << 8 | blue
