# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Writes ``points.laz``: every point with its class, conductor, clearance and decision."""

from dataclasses import dataclass
from pathlib import Path

import laspy
from lazrs import LazrsError
import numpy as np
from numpy.typing import NDArray

from plc_inspect.core.ground.ground_surface import bounds
from plc_inspect.errors import DataError
from plc_inspect.offline.readers.laz import find_withheld
from plc_inspect.offline.records.inspection import Inspection
from plc_inspect.results import InspectionResult

CHUNK_SIZE = 1_000_000
EXTRA_DIMENSIONS = (
    ('line_id', np.int32, 'conductor, -1 none'),
    ('span_id', np.int32, 'span, -1 none'),
    ('clearance', np.float32, 'to nearest conductor [m]'),
    ('decision', np.uint8, 'stage that decided'),
)
ORIGINAL = 'original_classification'
"""Extra dimension: the class of a point before its first inspection."""
SOFTWARE = 'plc_inspect'
"""Generating software in the headers of all LAS files that are written here."""
_MODERN_FORMAT = {0: 6, 1: 6, 2: 7, 3: 7, 4: 9, 5: 10}
"""Point formats of LAS 1.4 that replace old ones without loss."""
_SCAN_ANGLE_STEP = 0.006
"""Degrees in one unit of ``scan_angle`` (LAS 1.4 R15, table 15)."""
_LARGEST = 2**31 - 1
_FINE, _WIDE = 1e-4, 1e-3
"""
Steps of coordinates, and those of clouds wider than 214 km [units of the file].
Source: judgement: a hundredth and a tenth of the noise of a lidar.
"""
_STRIDE = 1_000_000
"""
An offset moves by a multiple of so many steps.
Source: derived: of a step of 1 mm they are 1 km, and a coarser step up to that divides it.
"""
_Grid = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Offsets and scales (3,) of a LAS file."""
_COPC = 'copc'
"""User of records that index the points of a COPC file; those that are written lie elsewhere."""
_PROJECTION = 'LASF_Projection'
"""User of records that hold a coordinate reference system."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Head:
    """Leading fields with the same layout in two record types."""

    names: frozenset[str]
    size: int
    """[bytes]"""


def write_points(path: Path, inspection: Inspection) -> int:
    """
    Write the points of one run as LAZ 1.4, point format 6 or later.

    Points of a LAS file are all written in their order with all their attributes; the class and
    extra dimensions with our names are replaced.  The input's class is kept in another dimension,
    unless the input was written here and holds an original class; withheld points keep it.
    Coordinates stay on the grid of the input, so they are exact.  Of other inputs, only finite
    points are written.

    Parameters
    ----------
    path : Path
        A file that does not exist yet.
    inspection : Inspection
        The run.

    Returns
    -------
    The number of points written.

    Raises
    ------
    DataError
        The result does not belong to the points, or the file cannot be written.

    """
    result = inspection.result
    num_points = len(inspection.points)
    if result.num_points != num_points:
        raise DataError(f'a result of {result.num_points} points for {num_points} points')
    if inspection.las is not None and len(inspection.las.points) != num_points:
        raise DataError(f'{len(inspection.las.points)} LAS points for {num_points} points')
    try:
        if inspection.las is None:
            return _write_coordinates(path, inspection)
        _write_las(path, inspection.las, inspection)
    except (LazrsError, laspy.errors.LaspyException) as error:  # also a full disk
        raise DataError(f'{path.name} cannot be written, is the disk full? {error}') from error
    return num_points


def _write_las(path: Path, las: laspy.LasData, inspection: Inspection) -> None:
    if las.point_format.id in _MODERN_FORMAT:
        las = _modernise(las)
    header = laspy.LasHeader(version='1.4', point_format=las.point_format.id)
    header.scales, header.offsets = las.header.scales, las.header.offsets
    for name in (
        'creation_date', 'file_source_id', 'uuid', 'system_identifier', 'extra_header_bytes',
    ):
        setattr(header, name, getattr(las.header, name))
    header.global_encoding = las.header.global_encoding
    header.vlrs.extend(
        vlr for vlr in las.header.vlrs
        if type(vlr).__name__ != 'ExtraBytesVlr' and vlr.user_id != _COPC
    )
    ours = {name for name, *_ in EXTRA_DIMENSIONS}
    is_first = not holds_original(las.header)
    replaced = ours | {ORIGINAL} if is_first else ours
    header.add_extra_dims([
        laspy.ExtraBytesParams(
            name=item.name,
            type=item.dtype,
            description=item.description,
            offsets=item.offsets,
            scales=item.scales,
            no_data=item.no_data,
        )
        for item in las.point_format.extra_dimensions
        if item.name not in replaced
    ])
    if is_first:
        header.add_extra_dims([describe_original()])
    finish_header(header, inspection.crs)
    source = las.points.array
    kept = [name for name in header.point_format.dtype().names if name in source.dtype.names]
    kept = [name for name in kept if name not in replaced]
    same = _find_common_head(source.dtype, header.point_format.dtype())
    rest = [name for name in kept if name not in same.names]
    with open_points(path, header) as writer:
        for begin in range(0, len(source), CHUNK_SIZE):
            chunk = slice(begin, begin + CHUNK_SIZE)
            record = _make_record(header, len(source[chunk]))
            if same.size:
                _view_head(record.array, same)[:] = _view_head(source[chunk], same)
            for name in rest:
                record.array[name] = source[name][chunk]
            if is_first:
                record.array[ORIGINAL] = source['classification'][chunk]
            _put_result(record.array, inspection.result, chunk)
            withheld = find_withheld(record)
            if withheld is not None:
                own = source['classification'][chunk]
                record.array['classification'][withheld] = own[withheld]
            writer.write_points(record)
        dropped = (_COPC, _PROJECTION) if inspection.crs else (_COPC,)
        evlrs = laspy.vlrs.vlrlist.VLRList([
            vlr for vlr in las.evlrs or () if vlr.user_id not in dropped
        ])
        if evlrs:
            writer.write_evlrs(evlrs)


def _write_coordinates(path: Path, inspection: Inspection) -> int:
    rows = np.flatnonzero(np.isfinite(inspection.points).all(axis=1))
    header = laspy.LasHeader(version='1.4', point_format=6)
    points = inspection.units.from_metres(inspection.points[rows])
    if len(points):
        header.offsets, header.scales = _choose_grid(points.min(axis=0), points.max(axis=0))
    else:
        header.offsets, header.scales = np.zeros(3), np.full(3, _WIDE)
    header.creation_date = None  # equal points give equal bytes on any day
    finish_header(header, inspection.crs)
    with open_points(path, header) as writer:
        for begin in range(0, len(rows), CHUNK_SIZE):
            chunk = slice(begin, begin + CHUNK_SIZE)
            record = _make_record(header, len(rows[chunk]))
            for axis, name in enumerate('XYZ'):
                record.array[name] = put_on_grid(
                    points[chunk, axis], header.scales[axis], header.offsets[axis]
                )
            record['return_number'][:] = 1
            record['number_of_returns'][:] = 1
            _put_result(record.array, inspection.result, rows[chunk])
            writer.write_points(record)
    return len(rows)


def describe_steps(inspection: Inspection) -> str:
    """Say how coarse the coordinates of ``points.laz`` are for a wide cloud, '' up to 1 mm."""
    if inspection.las is not None:
        return ''
    low, high, num = bounds(inspection.points)
    if not num:
        return ''
    low, high = inspection.units.from_metres(low), inspection.units.from_metres(high)
    step = float(_choose_grid(low, high)[1].max())
    return '' if step <= _WIDE else (
        f'coordinates span {(high - low).max():.6g}, which LAS holds in steps of {step:g} in'
        ' points.laz: is a point far from all others?'
    )


def _choose_grid(low: NDArray[np.float64], high: NDArray[np.float64]) -> _Grid:
    """Return offsets and scales of a grid of 0.1 mm, or 1 mm and more for large extents."""
    low = np.floor(low)
    scale = _FINE if float(np.max(high - low)) / _FINE < _LARGEST else _WIDE
    return lay_grid(low, high, np.full(3, scale), low)


def lay_grid(
    low: NDArray[np.float64], high: NDArray[np.float64], scales: NDArray[np.float64],
    offsets: NDArray[np.float64],
) -> _Grid:
    """
    Return a grid whose 32 bits hold all coordinates: the given one if it does.

    Otherwise an axis first moves its offset by whole steps, which keeps coordinates exact, and
    then takes steps ten times as long.

    Parameters
    ----------
    low, high : (3,) float64
        Least and greatest coordinates, in units of the file.
    scales, offsets : (3,) float64
        The grid wanted, in the same units.

    Returns
    -------
    offsets, scales : (3,) float64

    """
    scales, offsets = scales.copy(), offsets.copy()
    for axis, ends in enumerate(np.column_stack([low, high])):
        while not _holds(ends, scales[axis], offsets[axis]):
            stride = _STRIDE * scales[axis]
            offsets[axis] += stride * np.rint((ends.mean() - offsets[axis]) / stride)
            if not _holds(ends, scales[axis], offsets[axis]):
                scales[axis] *= 10
    return offsets, scales


def _holds(values: NDArray[np.float64], scale: float = 1.0, offset: float = 0.0) -> bool:
    return bool((np.abs(values - offset) <= _LARGEST * scale).all())


def put_on_grid(values: NDArray[np.float64], scale: float, offset: float) -> NDArray[np.int32]:
    """Return coordinates (N,) as steps from the offset; DataError if 32 bits do not hold them."""
    steps = np.rint((values - offset) / scale)
    if not _holds(steps):
        raise DataError(
            f'coordinates from {values.min():.9g} to {values.max():.9g} are too far from'
            f' {offset:.9g} for LAS, which holds {_LARGEST} steps of {scale:g}'
        )
    return steps.astype(np.int32)


def _modernise(las: laspy.LasData) -> laspy.LasData:
    """Return the points in the LAS 1.4 format that keeps all their fields."""
    modern = laspy.convert(las, point_format_id=_MODERN_FORMAT[las.point_format.id])
    degrees = np.asarray(las['scan_angle_rank'], np.float64)
    modern['scan_angle'] = np.rint(degrees / _SCAN_ANGLE_STEP).astype(np.int16)
    return modern


def holds_original(header: laspy.LasHeader) -> bool:
    """Tell whether a file was written here, with the classes of its first input."""
    form = header.point_format
    return (
        is_own(header) and ORIGINAL in form.extra_dimension_names
        and form.dimension_by_name(ORIGINAL).dtype == np.uint8
    )


def is_own(header: laspy.LasHeader) -> bool:
    """Tell whether a file was written here, by its generating software."""
    return str(header.generating_software).strip('\0 ') == SOFTWARE


def describe_replaced(name: str, header: laspy.LasHeader) -> str:
    """Say which extra dimensions of a file of other software ours replace, '' if none."""
    if is_own(header):
        return ''
    ours = (*(item for item, *_ in EXTRA_DIMENSIONS), ORIGINAL)
    held = [item for item in ours if item in header.point_format.extra_dimension_names]
    return '' if not held else (
        f'extra dimensions {", ".join(held)} of {name} are replaced in points.laz: rename them to'
        ' keep them'
    )


def describe_original() -> laspy.ExtraBytesParams:
    """Return the extra dimension for the class of a point in the input."""
    return laspy.ExtraBytesParams(name=ORIGINAL, type=np.uint8, description='class in the input')


def finish_header(header: laspy.LasHeader, crs: str) -> None:
    """Add our extra dimensions, the CRS as WKT and the name of the software."""
    header.add_extra_dims([
        laspy.ExtraBytesParams(name=name, type=dtype, description=description)
        for name, dtype, description in EXTRA_DIMENSIONS
    ])
    header.generating_software = SOFTWARE
    if crs:
        for name in (
            'WktCoordinateSystemVlr',
            'GeoKeyDirectoryVlr',
            'GeoAsciiParamsVlr',
            'GeoDoubleParamsVlr',
        ):
            while header.vlrs.get(name):
                header.vlrs.extract(name)
        header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(crs))
        header.global_encoding.wkt = True


def open_points(path: Path, header: laspy.LasHeader) -> laspy.LasWriter:
    """Open a LAZ file for writing, with several threads if possible."""
    parallel = laspy.LazBackend.LazrsParallel
    backend = parallel if parallel.is_available() else None
    return laspy.open(path, mode='w', header=header, do_compress=True, laz_backend=backend)


def _make_record(header: laspy.LasHeader, size: int) -> laspy.ScaleAwarePointRecord:
    return laspy.ScaleAwarePointRecord.zeros(size, header=header)


def _find_common_head(first: np.dtype[np.void], second: np.dtype[np.void]) -> _Head:
    """Return the leading fields that two record types share."""
    names, size = [], 0
    for name in first.names or ():
        if second.fields is None or first.fields is None:
            break
        if name not in second.fields or first.fields[name] != second.fields[name]:
            break
        names.append(name)
        size = first.fields[name][1] + first.fields[name][0].itemsize
    return _Head(names=frozenset(names), size=size)


def _view_head(records: NDArray[np.void], head: _Head) -> NDArray[np.void]:
    """Return a view of the leading fields of records as one item, which numpy copies faster."""
    kind = np.dtype({
        'names': ['head'], 'formats': [f'V{head.size}'], 'offsets': [0],
        'itemsize': records.dtype.itemsize,
    })
    view: NDArray[np.void] = records.view(kind)['head']
    return view


def _put_result(
    array: NDArray[np.void], result: InspectionResult, rows: slice | NDArray[np.int64]
) -> None:
    array['classification'] = result.classification[rows]
    for name, *_ in EXTRA_DIMENSIONS:
        array[name] = getattr(result, name)[rows]
