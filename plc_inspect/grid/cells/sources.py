# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The inputs of a grid, as their headers describe them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import laspy
import numpy as np

from plc_inspect.core.numerics.arrays import MOST_COORDINATE
from plc_inspect.errors import DataError
from plc_inspect.offline.export.points_file import describe_replaced, holds_original
from plc_inspect.offline.readers.clouds import (
    choose_units,
    find_las_crs,
    find_plain_crs,
    measure_units,
    parse_crs,
    render_wkt,
)
from plc_inspect.offline.readers.copc import count_indexed, is_copc
from plc_inspect.offline.readers.laz import open_checked
from plc_inspect.offline.readers.plain_clouds import is_plain, iterate_points
from plc_inspect.offline.readers.plausibility import question_place
from plc_inspect.printable import make_one_line
from plc_inspect.results import Float64


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """One input file, as its header describes it."""

    path: str
    number: int
    """Number among all inputs; the points of a grid are in this order."""
    num_points: int
    low: tuple[float, float, float]
    """Least coordinates [m]."""
    high: tuple[float, float, float]
    crs: str
    """WKT, '' where none is known."""
    units: tuple[float, float]
    """Metres in one horizontal and one vertical unit."""
    scales: tuple[float, float, float]
    """Resolution of its coordinates, in units of the file; 0 if it has none."""
    offsets: tuple[float, float, float]
    size: int
    """[bytes]"""
    changed: int
    """Modification time [ns]."""
    is_indexed: bool = False
    """It is a COPC file, whose index finds its parts."""
    point_format: int = 6
    """That of LAS 1.4 which holds its attributes: 6, 7 with colours, 8 with near infrared."""
    time_type: int | None = None
    """Of its GPS times in LAS: 0 seconds of the week, 1 standard time; None where it has none."""
    note: str = ''
    """Assumptions about its coordinates, and what of it is replaced, '' if none."""
    holds_original: bool = False
    """It was written here, with the classes of its first input."""

    @property
    def state(self) -> str:
        """Path, size and modification time: differs when the file has changed."""
        return f'{self.path} {self.size} {self.changed}'


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """An input that cannot be used."""

    path: str
    error: str


def read_sources(
    paths: Sequence[Path], crs: str | None = None, unit: float | None = None
) -> tuple[list[Source], list[Refusal]]:
    """
    Read the headers of all inputs.

    Parameters
    ----------
    paths : sequence of Path
        Of `inputs.expand_inputs`.
    crs : str or None
        CRS instead of that of the files.
    unit : float or None
        Metres in one unit of files without a CRS.

    Returns
    -------
    sources : list of Source
        Usable inputs; some may hold no points.
    refusals : list of Refusal
        Unusable inputs, with the reason.

    Raises
    ------
    ConfigError
        ``crs`` is unknown, or ``unit`` is given for a file that has a CRS.

    """
    given = None
    if crs is not None:
        system = parse_crs(crs)
        given = (render_wkt(system), measure_units(system, Path(crs)))
    known: dict[bytes, tuple[str, tuple[float, float]]] = {}
    sources, refusals = [], []
    for number, path in enumerate(paths):
        try:
            sources.append(_question(_read_source(path, number, given, known), unit))
        except DataError as error:
            refusals.append(Refusal(path=str(path), error=str(error)))
        except OSError as error:
            text = f'{path} cannot be read: {error.strerror or error}'
            refusals.append(Refusal(path=str(path), error=text))
    return sources, refusals


def _read_source(
    path: Path,
    number: int,
    given: tuple[str, tuple[float, float]] | None,
    known: dict[bytes, tuple[str, tuple[float, float]]],
) -> Source:
    stat, is_indexed, point_format, time_type = path.stat(), False, 6, None
    note, has_original = '', False
    if is_plain(path):
        num, low, high = _measure_plain(path)
        wkt, units = given or _find_plain_system(path)
        low, high = low * [units[0], units[0], units[1]], high * [units[0], units[0], units[1]]
        scales = offsets = np.zeros(3)
    else:
        with open_checked(path) as reader:
            header = reader.header
        if is_copc(header):
            _check_index(path, header)
        num = int(header.point_count)
        records = [*header.vlrs, *(header.evlrs or [])]
        key = b''.join(vlr.record_data_bytes() for vlr in records if _is_crs(vlr))
        if given is None and key not in known:
            known[key] = find_las_crs(header, path)
        wkt, units = given or known[key]
        scale = np.array([units[0], units[0], units[1]])
        low, high = _find_bounds(path, header, scale)
        is_indexed = is_copc(header)
        note, has_original = describe_replaced(str(path), header), holds_original(header)
        names = set(header.point_format.dimension_names)
        point_format = 8 if 'nir' in names else 7 if 'red' in names else 6
        if 'gps_time' in names:
            time_type = int(header.global_encoding.gps_time_type)
        scales, offsets = np.array(header.scales), np.array(header.offsets)
    return Source(
        path=str(path), number=number, num_points=num, low=_triple(low), high=_triple(high),
        crs=wkt, units=units, scales=_triple(scales), offsets=_triple(offsets),
        size=stat.st_size, changed=stat.st_mtime_ns, is_indexed=is_indexed,
        point_format=point_format, time_type=time_type, note=note, holds_original=has_original,
    )


def _measure_plain(path: Path) -> tuple[int, Float64, Float64]:
    """Return number of points and bounds of a file whose header holds neither."""
    num, low, high = 0, np.full(3, np.inf), np.full(3, -np.inf)
    for points in iterate_points(path):
        num += len(points)
        good = points[(np.abs(points) < MOST_COORDINATE).all(axis=1)]
        low = np.minimum(low, good.min(axis=0, initial=np.inf))
        high = np.maximum(high, good.max(axis=0, initial=-np.inf))
    if num and not np.isfinite(low).all():
        raise DataError(f'{path} holds no finite point, of {num}')
    return num, low if num else np.zeros(3), high if num else np.zeros(3)


def _find_plain_system(path: Path) -> tuple[str, tuple[float, float]]:
    system = find_plain_crs(path)
    return ('', (1.0, 1.0)) if system is None else (
        render_wkt(system), measure_units(system, path)
    )


def _question(source: Source, unit: float | None) -> Source:
    """Return an input in the given unit; DataError if its coordinates are impossible in it."""
    units = choose_units(Path(source.path), source.crs, source.units, unit)
    if not source.num_points:
        return replace(source, note=f'{source.path} holds no point')
    if source.crs:
        return source
    horizontal, vertical = (new / old for new, old in zip(units, source.units, strict=True))
    scales = (horizontal, horizontal, vertical)
    is_said = unit is not None or units[0] != 1.0
    low, high = (
        [value / size for value, size in zip(ends, (*source.units[:1] * 2, source.units[1]),
                                             strict=True)]
        for ends in (source.low, source.high)
    )
    return replace(
        source, units=units, low=_triple(np.multiply(source.low, scales)),
        high=_triple(np.multiply(source.high, scales)),
        note='; '.join(filter(None, (
            question_place(source.path, low, high, units, is_said), source.note,
        ))),
    )


def _triple(values: Any) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _is_crs(vlr: Any) -> bool:
    return str(vlr.user_id).startswith('LASF_Projection')


def _find_bounds(path: Path, header: laspy.LasHeader, scale: Float64) -> tuple[Float64, Float64]:
    """Return the bounds in a header [m]; DataError if they are invalid."""
    low, high = np.array(header.mins) * scale, np.array(header.maxs) * scale
    if header.point_count and not (
        (low <= high).all() and (np.abs([low, high]) < MOST_COORDINATE).all()
    ):
        raise DataError(
            f'{path}: its header holds bounds from {_render(header.mins)} to '
            f'{_render(header.maxs)}, which are invalid: rewrite the file'
        )
    return low, high


def _render(values: Any) -> str:
    return '(' + ', '.join(f'{value:.6g}' for value in values) + ')'


def _check_index(path: Path, header: laspy.LasHeader) -> None:
    """Refuse a COPC file whose index leads to other points than its header counts."""
    try:
        indexed = count_indexed(path)
    except Exception as error:  # laspy lets errors of struct and numpy through
        text = make_one_line(error) or type(error).__name__
        raise DataError(f'{path} has no readable index of COPC: {text}') from error
    if indexed != header.point_count:
        raise DataError(
            f'{path} is damaged: its index leads to {indexed} points, its header counts'
            f' {header.point_count}'
        )
