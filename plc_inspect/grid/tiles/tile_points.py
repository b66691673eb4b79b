# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Write the points of one tile with their classes, lines and spans numbered over the grid."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import laspy
import numpy as np

from plc_inspect.core.ground.ground_surface import bounds
from plc_inspect.grid.cells.pieces import read_attributes
from plc_inspect.grid.tiles.plain_results import POINT_FIELDS
from plc_inspect.grid.tiles.tile_job import CELLS, list_pieces, TileJob
from plc_inspect.offline.export.points_file import (
    CHUNK_SIZE,
    describe_original,
    EXTRA_DIMENSIONS,
    finish_header,
    lay_grid,
    open_points,
    ORIGINAL,
    put_on_grid,
)
from plc_inspect.offline.readers.laz import WITHHELD
from plc_inspect.whole_files import replace_file


@dataclass(frozen=True, slots=True, kw_only=True)
class PointsFormat:
    """Format of the points files of all tiles."""

    crs: str
    units: tuple[float, float]
    """Metres in one horizontal and one vertical unit."""
    scales: tuple[float, float, float]
    """Resolution wanted, in units of the inputs; a tile that it cannot hold is coarser."""
    offsets: tuple[float, float, float]
    """Wanted; a tile too far from them has its own."""
    point_format: int
    """6, 7 with colours, or 8 with near infrared too."""
    time_type: int
    """Of GPS times: 0 seconds of the week, 1 standard time."""


def write_tile_points(
    job: TileJob, place: str, form: PointsFormat, numbers: Sequence[tuple[int, int, int, int]]
) -> dict[str, Any]:
    """
    Write the points of one tile as LAZ 1.4.

    Parameters
    ----------
    job : TileJob
        The tile, which was inspected.
    place : str
        The file.
    form : PointsFormat
        How.
    numbers : sequence of tuple
        Line and span in the tile, then in the grid.

    Returns
    -------
    dict
        Number of points, in all and by class.

    """
    folder = Path(job.folder)
    points, attributes = read_attributes(
        folder / CELLS, list_pieces(folder, job.tile.cells(job.grid))
    )
    with np.load(f'{job.place}.labels.npz') as known:
        labels = {name: known[name] for name in POINT_FIELDS}
    withheld = (attributes['flags'] & np.uint8(WITHHELD)) != 0
    labels['classification'][withheld] = attributes['classification'][withheld]
    labels['line_id'], labels['span_id'] = renumber(
        labels['line_id'], labels['span_id'], numbers
    )
    header = laspy.LasHeader(version='1.4', point_format=form.point_format)
    units = np.array([form.units[0], form.units[0], form.units[1]])
    low, high, _ = bounds(points)
    header.offsets, header.scales = lay_grid(
        low / units, high / units, np.array(form.scales), np.array(form.offsets)
    )
    header.global_encoding.gps_time_type = laspy.header.GpsTimeType(form.time_type)
    header.creation_date = None  # the same points give the same bytes on any day
    header.add_extra_dims([describe_original()])
    finish_header(header, form.crs)
    Path(place).parent.mkdir(parents=True, exist_ok=True)
    with replace_file(Path(place)) as aside, open_points(aside, header) as writer:
        for begin in range(0, len(points), CHUNK_SIZE):
            chunk = slice(begin, begin + CHUNK_SIZE)
            record = laspy.ScaleAwarePointRecord.zeros(len(points[chunk]), header=header)
            for axis, name in enumerate('XYZ'):
                record.array[name] = put_on_grid(
                    points[chunk, axis] / units[axis], header.scales[axis], header.offsets[axis]
                )
            _put_attributes(record, attributes[chunk])
            record.array['classification'] = labels['classification'][chunk]
            for name, *_ in EXTRA_DIMENSIONS:
                record.array[name] = labels[name][chunk]
            writer.write_points(record)
    classes, counts = np.unique(labels['classification'], return_counts=True)
    return {
        'num_points': len(points),
        'classes': dict(zip(map(str, classes.tolist()), counts.tolist(), strict=True)),
    }


def renumber(
    line_id: np.ndarray, span_id: np.ndarray, numbers: Sequence[tuple[int, int, int, int]]
) -> tuple[np.ndarray, np.ndarray]:
    """
    Renumber lines and spans of points from a tile to the grid.

    Parameters
    ----------
    line_id, span_id : (N,) int32
        By the numbers of a tile, -1 none.
    numbers : sequence of tuple
        Line and span in the tile, then in the grid.

    Returns
    -------
    (N,), (N,) int32
        Line and span in the grid, -1 none.

    """
    num_spans = 1 + max([int(span_id.max(initial=0)), *(item[1] for item in numbers)])
    num_lines = 1 + max([int(line_id.max(initial=0)), *(item[0] for item in numbers)])
    spans = np.full(num_spans + 1, -1, dtype=np.int32)  # the last one is for -1
    lines = np.full((num_lines + 1, num_spans + 1), -1, dtype=np.int32)
    for line, span, new_line, new_span in numbers:
        spans[span], lines[line, span] = new_span, new_line
    return lines[line_id, span_id], spans[span_id]


def _put_attributes(record: laspy.ScaleAwarePointRecord, attributes: np.ndarray) -> None:
    """Set all attributes that the point format has."""
    names = set(record.array.dtype.names)
    for name in ('intensity', 'user_data', 'scan_angle', 'point_source_id', 'gps_time',
                 'red', 'green', 'blue', 'nir'):
        if name in names:
            record.array[name] = attributes[name]
    record.array['bit_fields'] = attributes['returns']
    record.array['classification_flags'] = attributes['flags']
    record.array[ORIGINAL] = attributes['classification']
