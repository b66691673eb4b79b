# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Cut inputs into cells on disk, each in one pass and with bounded memory."""

from collections import Counter
from collections.abc import Iterator, Sequence
import hashlib
import json
from pathlib import Path
from typing import Any

import laspy
import numpy as np

from plc_inspect.core.cloud_frame import sum_moments
from plc_inspect.core.extraction.stray_points import StrayGrid
from plc_inspect.core.ground.ground_surface import bounds
from plc_inspect.errors import DataError
from plc_inspect.grid.cells.layout import CellGrid
from plc_inspect.grid.cells.room import publish
from plc_inspect.grid.cells.sources import Source
from plc_inspect.offline.export.points_file import ORIGINAL
from plc_inspect.offline.readers.clouds import (
    convert_to_metres,
    MOST_FAR,
    MOST_FAR_SHARE,
    scale_grid,
)
from plc_inspect.offline.readers.copc import iterate_copc
from plc_inspect.offline.readers.laz import open_las, WITHHELD
from plc_inspect.offline.readers.plain_clouds import is_plain, iterate_points
from plc_inspect.printable import make_one_line
from plc_inspect.results import Float64

CHUNK = 1_000_000
"""Points read at a time."""
PART = 10_000_000
"""Points of an input that one task cuts; a larger file is cut by several."""
ATTRIBUTES = np.dtype([
    ('intensity', '<u2'), ('returns', 'u1'), ('flags', 'u1'), ('classification', 'u1'),
    ('user_data', 'u1'), ('scan_angle', '<i2'), ('point_source_id', '<u2'), ('gps_time', '<f8'),
    ('red', '<u2'), ('green', '<u2'), ('blue', '<u2'), ('nir', '<u2'),
])
"""Attributes kept with each point: the fields of LAS point format 8."""
WITHHELD_PLACES = np.dtype([('row', '<u4'), ('place', '<f8', 3)])
"""Where withheld points are [m]: they are NaN among the coordinates of their cell."""
RETURN_BITS = 4
_SCAN_ANGLE_STEP = 0.006
"""Degrees in one unit of ``scan_angle`` (LAS 1.4 R15, table 15)."""

STATISTICS = (
    'part', 'num_points', 'num_lost', 'num_far', 'num_withheld', 'farthest', 'moments', 'strays',
    'cells', 'sha256',
)
"""What is known of a part; cells of a version that knew less are cut anew."""
Stats = dict[str, Any]
"""Statistics of the points that one task cut, JSON-serialisable."""


def name_part(source: int, part: int) -> str:
    """Return the name of a part of an input; names sort in the order of the points."""
    return f's{source:06d}_{part:04d}'


def count_parts(source: Source) -> int:
    """Return into how many parts an input is divided."""
    if is_plain(source.path):
        return 1
    return max(-(-source.num_points // PART), 1)


def find_unusable(sources: Sequence[Source], answers: dict[str, Stats]) -> dict[str, str]:
    """
    Find inputs that are wrong as a whole, though each of their parts was cut.

    They are indexed and their parts together do not hold the number of points in their header; or
    more of their points lie beyond MOST_COORDINATE than strays do, as in `read_cloud`.

    Parameters
    ----------
    sources : sequence of Source
        The inputs.
    answers : dict
        Of `cut_part`, by the names of parts.

    Returns
    -------
    dict
        Error message for each part of such an input.

    """
    found: dict[str, str] = {}
    for source in sources:
        names = [name_part(source.number, part) for part in range(count_parts(source))]
        parts = [answers[name] for name in names if name in answers]
        held, num_far = (sum(part[name] for part in parts) for name in ('num_points', 'num_far'))
        if source.is_indexed and len(parts) == len(names) and held != source.num_points:
            found |= dict.fromkeys(names, (
                f'{source.path}: by its index {held} points lie within its bounds, its header'
                f' counts {source.num_points}: write it anew'
            ))
        elif num_far > max(MOST_FAR, MOST_FAR_SHARE * held):
            farthest = max(part['farthest'] for part in parts)
            found |= {name: (
                f'{source.path}: {num_far} of {held} points have coordinates up to'
                f' {farthest:.3g} m, which no coordinate reference system has'
            ) for name in names if name in answers}
    return found


def describe_lost(sources: Sequence[Source], answers: dict[str, Stats]) -> list[str]:
    """Return a note on each input of which points were left out."""
    notes = []
    for source in sources:
        names = [name_part(source.number, part) for part in range(count_parts(source))]
        parts = [answers[name] for name in names if name in answers]
        held, num_lost, num_far = (
            sum(part[name] for part in parts) for name in ('num_points', 'num_lost', 'num_far')
        )
        if num_lost:
            notes.append(
                f'{source.path}: {num_lost} of {held} points were left out: {num_lost - num_far}'
                f' are not finite, {num_far} lie farther out than any place on Earth'
            )
    return notes


def cut_part(
    room: str,
    folder: str,
    source: Source,
    part: int,
    grid: CellGrid,
    reference: tuple[float, float, float],
    strays: StrayGrid | None,
) -> Stats:
    """
    Write the points of a part of an input into a file for each cell.

    Parameters
    ----------
    room : str
        Where the run writes aside.
    folder : str
        Exists; receives a folder of the part's name, which appears once it is complete.
    source : Source
        The input.
    part : int
        Which part of it.
    grid : CellGrid
        The cells.
    reference : tuple of float
        Near the points [m].
    strays : StrayGrid or None
        Counts points per coarse cell, to find stray ones.

    Returns
    -------
    dict
        Points by cell, moments and strays.

    Raises
    ------
    DataError
        The input cannot be read, or the folder not written.

    """
    name = name_part(source.number, part)
    stats = _Stats(grid, np.array(reference), strays)
    written = 0
    try:
        with publish(Path(room), Path(folder) / name) as aside:
            aside.mkdir()
            for points, attributes in read_part(source, part):
                withheld = attributes['flags'] & np.uint8(WITHHELD)
                places = points
                if withheld.any():
                    places = points.copy()
                    convert_to_metres(places, *source.units)
                    points[withheld != 0] = np.nan
                stats.add(points, source, int(np.count_nonzero(withheld)))
                index = np.arange(written, written + len(points))
                _write(aside, points, places, attributes, stats, index)
                written += len(points)
            if stats.num_outside:
                raise DataError(
                    f'{source.path}: {stats.num_outside} of {written} points lie outside the'
                    ' bounds in its header, by more than 1 m: rewrite the file'
                )
            digest = _hash(source.path) if part == 0 else ''
            result = stats.render(name, written) | {'sha256': digest}
            (aside / 'stats.json').write_text(json.dumps(result), encoding='utf-8')
    except OSError as error:  # those of the input are DataError
        raise DataError(f'{folder} cannot be written: {error.strerror or error}') from error
    return result


def _hash(path: str) -> str:
    try:
        with open(path, 'rb') as file:
            return hashlib.file_digest(file, 'sha256').hexdigest()
    except OSError as error:
        raise DataError(f'{path} cannot be read: {error.strerror or error}') from error


class _Stats:
    """Collects the statistics of the points of a part."""

    def __init__(self, grid: CellGrid, reference: Float64, strays: StrayGrid | None) -> None:
        self.grid = grid
        self._reference, self._strays = reference, strays
        self._moments = np.zeros(11)
        self._stray_counts: np.ndarray | None = None
        self.cells: Counter[int] = Counter()
        """Points in each cell."""
        self.num_lost, self.num_far, self.num_outside, self.num_withheld = 0, 0, 0, 0
        self.farthest = 0.0
        """Greatest coordinate of a point too far out [m]."""

    def add(self, points: Float64, source: Source, num_withheld: int) -> None:
        """Convert to metres, set impossible coordinates to NaN as withheld ones are, and count."""
        not_finite, far, farthest = convert_to_metres(points, *source.units)
        self.num_lost += not_finite + far - num_withheld
        self.num_withheld += num_withheld
        self.num_far += far
        self.farthest = max(self.farthest, farthest)
        self._moments += sum_moments(points, self._reference)
        if self._strays is not None:
            counts = self._strays.count(points)
            self._stray_counts = counts + (0 if self._stray_counts is None else self._stray_counts)
        least, most = np.array(source.low) - 1.0, np.array(source.high) + 1.0
        low, high, _ = bounds(points)
        if (low < least).any() or (high > most).any():
            outside = (points < least) | (points > most)
            self.num_outside += int(outside.any(axis=1).sum())

    def render(self, name: str, num: int) -> Stats:
        """Return all as plain values."""
        strays = {}
        if self._stray_counts is not None:
            used = np.flatnonzero(self._stray_counts)
            strays = dict(zip(map(str, used.tolist()), self._stray_counts[used].tolist(),
                              strict=True))
        return {
            'part': name, 'num_points': num, 'num_lost': self.num_lost,
            'num_far': self.num_far, 'num_withheld': self.num_withheld,
            'farthest': self.farthest,
            'moments': self._moments.tolist(),
            'strays': strays,
            'cells': {str(cell): num for cell, num in sorted(self.cells.items())},
        }


def _write(
    folder: Path, points: Float64, places: Float64, attributes: np.ndarray, stats: _Stats,
    index: np.ndarray,
) -> None:
    """Append points to the files of their cells; places are those of withheld points as well."""
    has_withheld = places is not points
    good = np.isfinite(places[:, 0])
    if not good.all():
        points, attributes, index = points[good], attributes[good], index[good]
        places = places[good] if has_withheld else points
    if not len(points):
        return
    cell = stats.grid.number(places[:, 0], places[:, 1])
    order = np.argsort(cell, kind='stable')
    cell, points = np.take(cell, order), np.take(points, order, axis=0)  # points[order] is slow
    places = np.take(places, order, axis=0) if has_withheld else points
    attributes, index = np.take(attributes, order), np.take(index, order).astype(np.uint32)
    first = np.flatnonzero(np.diff(cell, prepend=-1))
    for begin, end in zip(first.tolist(), [*first[1:].tolist(), len(cell)], strict=True):
        number = int(cell[begin])
        if has_withheld:
            _write_withheld(
                folder / f'{number}.wit', points[begin:end], places[begin:end],
                stats.cells[number],
            )
        stats.cells[number] += end - begin
        for suffix, values in (('xyz', points), ('idx', index), ('att', attributes)):
            with (folder / f'{number}.{suffix}').open('ab') as file:
                file.write(values[begin:end].view(np.uint8).data)


def _write_withheld(path: Path, points: Float64, places: Float64, first: int) -> None:
    """Append the places of withheld points, if any, and their rows in the file of the cell."""
    rows = np.flatnonzero(np.isnan(points[:, 0]))
    if not len(rows):
        return
    records = np.empty(len(rows), dtype=WITHHELD_PLACES)
    records['row'], records['place'] = first + rows, places[rows]
    with path.open('ab') as file:
        file.write(records.view(np.uint8).data)


def read_part(source: Source, part: int) -> Iterator[tuple[Float64, np.ndarray]]:
    """
    Yield the points of a part of an input, chunk by chunk.

    Parameters
    ----------
    source : Source
        The input.
    part : int
        Which part of it, of `count_parts`.

    Yields
    ------
    points : (N, 3) float64
        In units of the file.
    attributes : (N,) ATTRIBUTES

    Raises
    ------
    DataError
        The input cannot be read.

    """
    path = Path(source.path)
    first, last = part * PART, min((part + 1) * PART, source.num_points)
    num_parts = count_parts(source)
    try:
        if is_plain(path):
            for points in iterate_points(path, CHUNK):
                yield points, np.zeros(len(points), dtype=ATTRIBUTES)
            return
        if source.is_indexed and num_parts > 1:
            for chunk in iterate_copc(path, part, num_parts):
                yield _take_points(chunk), _take_attributes(chunk, source.holds_original)
            return
        with open_las(path) as reader:
            reader.seek(first)
            while first < last:
                chunk = reader.read_points(min(CHUNK, last - first))
                if not len(chunk):
                    raise DataError(
                        f'{path} is truncated: {first} points, its header says'
                        f' {source.num_points}'
                    )
                first += len(chunk)
                yield _take_points(chunk), _take_attributes(chunk, source.holds_original)
    except DataError:
        raise
    except OSError as error:
        raise DataError(f'{path} cannot be read: {error.strerror or error}') from error
    except Exception as error:  # laspy lets errors of lazrs, struct and numpy through
        text = make_one_line(error) or type(error).__name__
        raise DataError(f'{path} cannot be read, is it truncated? {text}') from error


def _take_points(chunk: laspy.ScaleAwarePointRecord) -> Float64:
    x, y, z = (np.ascontiguousarray(chunk.array[name]) for name in 'XYZ')
    return scale_grid(x, y, z, np.array(chunk.scales), np.array(chunk.offsets))


def _take_attributes(
    chunk: laspy.ScaleAwarePointRecord, holds_original: bool
) -> np.ndarray:
    """Return the attributes of points of any format as those of point format 8."""
    result = np.zeros(len(chunk), dtype=ATTRIBUTES)
    names = set(chunk.point_format.dimension_names)
    for name in ('intensity', 'classification', 'user_data', 'point_source_id', 'gps_time',
                 'red', 'green', 'blue', 'nir'):
        if name in names:
            result[name] = chunk[name]
    if holds_original:  # of an earlier survey
        result['classification'] = chunk.array[ORIGINAL]
    if 'scan_angle' in names:  # formats 6 to 10, whose bytes hold returns and flags as here
        result['scan_angle'] = chunk['scan_angle']
        result['returns'] = chunk.array['bit_fields']
        result['flags'] = chunk.array['classification_flags']
        return result
    degrees = np.asarray(chunk['scan_angle_rank'], np.float64)
    result['scan_angle'] = np.rint(degrees / _SCAN_ANGLE_STEP).astype(np.int16)
    result['returns'] = np.asarray(chunk['return_number']) | (
        np.asarray(chunk['number_of_returns']) << RETURN_BITS
    )
    flags = np.zeros(len(chunk), dtype=np.uint8)
    for name, bit in FLAG_BITS.items():
        if name in names:
            flags |= np.asarray(chunk[name]).astype(np.uint8) << bit
    result['flags'] = flags
    return result


FLAG_BITS = {
    'synthetic': 0, 'key_point': 1, 'withheld': 2, 'overlap': 3, 'scan_direction_flag': 6,
    'edge_of_flight_line': 7,
}
"""Bits of ``flags``, a byte of point formats 6 to 10 that holds the scanner channel as well."""
