# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Read back the files of a results folder that `write_results` wrote."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import math
from pathlib import Path

import laspy
import numpy as np

from plc_inspect.errors import DataError
from plc_inspect.offline.readers.clouds import load_las
from plc_inspect.offline.readers.json_file import read_json
from plc_inspect.offline.records.units import Record, Units
from plc_inspect.printable import make_one_line
from plc_inspect.results import Float64, Hazard, HazardKind, Severity, Span


def read_run(folder: Path) -> Record:
    """
    Read ``run.json``.

    Raises
    ------
    DataError
        The folder or the file is missing, or the file is malformed.

    """
    return read_json(_find(folder, 'run.json'))


def read_table(folder: Path, name: str) -> Record:
    """
    Read ``spans.json``, ``supports.json`` or ``hazards.json``.

    Parameters
    ----------
    folder : Path
        The results folder.
    name : str
        'spans', 'supports' or 'hazards'.

    Returns
    -------
    dict
        The file: its head, and under ``name`` a list of records in units of the input.

    Raises
    ------
    DataError
        The folder or the file is missing, or the file is malformed.

    """
    path = _find(folder, f'{name}.json')
    content = read_json(path)
    rows = content.get(name)
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise DataError(f'{path} holds no {name}')
    return content


def read_points(folder: Path, *needed: str) -> tuple[laspy.LasData, Float64]:
    """
    Read ``points.laz``.

    Parameters
    ----------
    folder : Path
        The results folder.
    *needed : str
        Extra dimensions that must exist.

    Returns
    -------
    laspy.LasData
        The points with their dimensions.
    (N, 3) float64
        Their coordinates in the units of the folder; see `Units.to_metres`.

    Raises
    ------
    DataError
        The folder or the file is missing, or the file is malformed.

    """
    path = _find(folder, 'points.laz')
    las, points = load_las(path)
    for name in needed:
        if name not in las.point_format.extra_dimension_names:
            raise DataError(f'{path} holds no {name}')
    return las, points


def parse_units(metres_per_unit: Sequence[float]) -> Units:
    """Return the units of a folder from ``metres_per_unit``; see `understanding` for errors."""
    horizontal, vertical = map(float, metres_per_unit)
    if not (0.0 < horizontal < math.inf and 0.0 < vertical < math.inf):
        raise ValueError(f'metres_per_unit is {horizontal:g}, {vertical:g}, not above 0')
    return Units(horizontal=horizontal, vertical=vertical)


def parse_span(row: Record, units: Units) -> Span:
    """Return the span of a record of ``spans.json`` [m]; see `understanding` for errors."""
    scale, number = units.horizontal, _scaler(units.horizontal)
    a2, a1, a0 = row['quadratic']
    return Span(
        line_id=row['line_id'], span_id=row['span_id'], start=_place(row['start'], units),
        end=_place(row['end'], units), azimuth=number(row['azimuth']) / scale,
        length=number(row['length']), a=number(row['a']), b=number(row['b']), c=number(row['c']),
        quadratic=(a2 / scale, a1, a0 * scale), sag=number(row['sag']),
        lowest=_place(row['lowest'], units), open_start=bool(row['open_start']),
        open_end=bool(row['open_end']), rmse=number(row['rmse']),
        num_points=int(row['num_points']), coverage=number(row['coverage']) / scale,
        sigma={name: number(value) for name, value in row['sigma'].items()},
        ground_clearance=number(row.get('ground_clearance')),
        ground_along=number(row.get('ground_along')), evidence=number(row.get('evidence')),
    )


def parse_hazard(row: Record, units: Units) -> Hazard:
    """Return the hazard of a record of ``hazards.json`` [m]; see `understanding` for errors."""
    number = _scaler(units.horizontal)
    return Hazard(
        hazard_id=row['hazard_id'], line_id=row['line_id'], span_id=row['span_id'],
        kind=HazardKind[row['kind'].upper()], severity=Severity[row['severity'].upper()],
        position=_place(row['position'], units), clearance=number(row['clearance']),
        required=number(row['required']), horizontal=number(row['horizontal']),
        vertical=number(row['vertical']), sigma=number(row['sigma']),
        along_span=number(row['along_span']), num_points=row['num_points'],
        extent=np.stack([_place(corner, units) for corner in row['extent']]), rule=row['rule'],
        edition=row['edition'], source=row['source'], voltage=row.get('voltage', 'unknown'),
        other_line_id=row.get('other_line_id', -1), years=_scaler(1.0)(row.get('years')),
        support_id=row.get('support_id', -1), from_support=number(row.get('from_support')),
        height=number(row.get('height')) / units.horizontal * units.vertical,
        note=row.get('note', ''), confidence=row.get('confidence', 1.0),
    )


@contextmanager
def understanding(path: Path) -> Iterator[None]:
    """Raise DataError if a file lacks the keys and values that the block reads."""
    try:
        yield
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        text = make_one_line(error)
        text = f'it has no {text}' if isinstance(error, KeyError) else text
        raise DataError(f'{path} is not understood: {text}') from error


def _find(folder: Path, name: str) -> Path:
    """Return the path of an existing file of a folder."""
    path = folder / name
    if not path.is_file():
        raise DataError(f'{folder}: no such results folder' if not folder.is_dir() else
                        f'{folder} is not a results folder: it has no {name}')
    return path


def _scaler(scale: float) -> Callable[[float | None], float]:
    """Return a function that turns a value of a file into metres, null into NaN."""
    return lambda value: math.nan if value is None else float(value) * scale


def _place(values: Sequence[float], units: Units) -> Float64:
    x, y, z = values
    return units.to_metres(np.array([x, y, z], dtype=np.float64))
