# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Reads E57 files (ASTM E2807): the points of all scans, in the frame of the file."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from plc_inspect.errors import DataError, say_needed
from plc_inspect.offline.readers.plausibility import check_precision
from plc_inspect.printable import make_one_line
from plc_inspect.results import Float64

_CARTESIAN = ('cartesianX', 'cartesianY', 'cartesianZ')
_SPHERICAL = ('sphericalRange', 'sphericalAzimuth', 'sphericalElevation')


def iterate_e57(path: Path, most: int) -> Iterator[Float64]:
    """
    Yield the points of an E57 file, scan by scan.

    Parameters
    ----------
    path : Path
        The file.
    most : int
        Greatest number of points yielded at once.

    Yields
    ------
    (N, 3) float64
        In the frame of the file, with the poses of scans applied [m]; NaN for points marked as
        invalid.

    Raises
    ------
    DataError
        pye57 is missing; the file is not an E57 file or is damaged; or a scan has no coordinates,
        or too coarse ones.

    """
    with _open(path) as file:
        for number in range(file.scan_count):
            yield from _iterate_scan(path, file, number, most)


def count_e57(path: Path) -> int:
    """Return how many points the headers of all scans of an E57 file count."""
    with _open(path) as file:
        return sum(int(file.get_header(k).point_count) for k in range(file.scan_count))


def find_e57_crs(path: Path) -> str:
    """Return the coordinate reference system in an E57 file as WKT, '' if none."""
    with _open(path) as file:
        root = file.root
        if not root.isDefined('coordinateMetadata'):
            return ''
        return str(root['coordinateMetadata'].value()).strip()


@contextmanager
def _open(path: Path) -> Iterator[Any]:
    try:
        import pye57
    except ModuleNotFoundError as error:
        raise say_needed(path, error) from error
    with path.open('rb'):  # errors of the system say more than those of libE57
        pass
    try:
        with pye57.E57(str(path)) as file:
            yield file
    except (DataError, OSError, MemoryError):
        raise
    except Exception as error:  # libE57 raises errors of its own
        text = make_one_line(error).partition(' (')[0] or type(error).__name__
        raise DataError(f'{path} cannot be read, is it damaged or truncated? {text}') from error


def _iterate_scan(path: Path, file: Any, number: int, most: int) -> Iterator[Float64]:
    head = file.get_header(number)
    names = next((own for own in (_CARTESIAN, _SPHERICAL) if set(own) <= set(head.point_fields)),
                 None)
    if names is None:
        raise DataError(
            f'{path}, scan {number + 1}: no coordinates, only {", ".join(head.point_fields)}'
        )
    valid = 'cartesianInvalidState' if names is _CARTESIAN else 'sphericalInvalidState'
    wanted = [*names, *([valid] if valid in head.point_fields else [])]
    size = max(min(most, head.point_count), 1)
    data, buffers = file.make_buffers(wanted, size)
    pose = head.rotation_matrix, head.translation
    kinds = [_find_kind(head, name) for name in names]
    reader, held = head.points.reader(buffers), 0
    try:
        while num := int(reader.read()):
            held += num
            own = np.column_stack([data[name][:num] for name in names])
            check_precision(path, own, kinds)
            points = own if names is _CARTESIAN else _to_cartesian(own)
            if head.has_pose():
                points = points @ pose[0].T + pose[1]
            if valid in data:
                points[data[valid][:num] != 0] = np.nan
            yield points
    finally:
        reader.close()
    if held != head.point_count:
        raise DataError(
            f'{path}, scan {number + 1} holds {held} points, its header counts {head.point_count}'
        )


def _find_kind(head: Any, name: str) -> str:
    """Return float32 for a column of a scan that is stored so, float64 for all others."""
    from pye57 import libe57

    kind = libe57.StructureNode(head.points.prototype())[name]
    is_single = isinstance(kind, libe57.FloatNode) and (
        kind.precision() == libe57.FloatPrecision.E57_SINGLE
    )
    return 'f4' if is_single else 'f8'


def _to_cartesian(points: Float64) -> Float64:
    """Return positions from range [m], azimuth and elevation [rad], as defined by E57."""
    distance, azimuth, elevation = points.T
    flat = distance * np.cos(elevation)
    return np.column_stack([
        flat * np.cos(azimuth), flat * np.sin(azimuth), distance * np.sin(elevation),
    ])
