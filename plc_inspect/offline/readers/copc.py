# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Reads parts of COPC files (cloud-optimised LAZ) by their index."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
import os
from pathlib import Path
import struct
from typing import Any

import laspy
from laspy.copc import Bounds, CopcReader, HierarchyPage, load_octree_for_query
import numpy as np

from plc_inspect.offline.readers.laz import ITEMS, open_las, panics_as_errors
from plc_inspect.results import Int64

MOST_NODES = 4_000_000
"""Greatest number of points decompressed at once, unless one node holds more."""
LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}
"""Number of layers by kind of item; extra bytes, 14, have one each (LAZ specification 1.4)."""
THINNEST = 1.0
"""Least width of a slab that is divided into two [units of the file]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Slab:
    """A range of integer x of a file, without the last."""

    first: int
    last: int


def is_copc(header: laspy.LasHeader) -> bool:
    """Tell whether a LAZ file has a COPC index."""
    return bool(header.vlrs) and type(header.vlrs[0]).__name__ == 'CopcInfoVlr'


def lay_slabs(header: laspy.LasHeader, num: int) -> list[Slab]:
    """Divide a file along x into slabs that together hold each point once."""
    low, high = (
        round((end[0] - header.offsets[0]) / header.scales[0])
        for end in (header.mins, header.maxs)
    )
    edges = np.linspace(low, high + 1, num + 1).round().astype(np.int64).tolist()
    limit = np.iinfo(np.int32)
    edges[0], edges[-1] = int(limit.min), int(limit.max) + 1
    return [Slab(first=a, last=b) for a, b in pairwise(edges)]


def iterate_copc(path: Path, part: int, num_parts: int) -> Iterator[laspy.ScaleAwarePointRecord]:
    """
    Yield the points of one part of a COPC file; all parts together hold each point once.

    Parameters
    ----------
    path : Path
        The file.
    part : int
        Number of the part, from 0.
    num_parts : int
        Number of parts into which the file is divided along x.

    Yields
    ------
    laspy.ScaleAwarePointRecord
        Points of a slab, in the order of the index.

    Errors are those of `laz.open_las`.

    """
    with open_las(path):  # refuses files that would end the process
        pass
    with _open_indexed(path) as reader:
        waiting = [lay_slabs(reader.header, num_parts)[part]]
        while waiting:
            slab = waiting.pop()
            bounds = _find_bounds(reader.header, slab)
            nodes = load_octree_for_query(
                reader.source, reader.copc_info, reader.root_page, query_bounds=bounds
            )
            total = sum(node.point_count for node in nodes)
            halves = _halve(reader.header, slab)
            if total > MOST_NODES and halves:
                waiting += halves
                continue
            if not total:
                continue
            points = reader.query(bounds=bounds)
            x: Int64 = np.asarray(points.X).astype(np.int64)
            inside = (x >= slab.first) & (x < slab.last)
            yield points if inside.all() else points[inside]


def count_indexed(path: Path) -> int:
    """
    Return the number of points in the index of a COPC file.

    Errors are those of `laz.open_las`.
    """
    with _open_indexed(path) as reader:
        nodes: list[Any] = load_octree_for_query(
            reader.source, reader.copc_info, reader.root_page
        )
        return sum(int(node.point_count) for node in nodes)


@contextmanager
def _open_indexed(path: Path) -> Iterator[CopcReader]:
    """
    Open a COPC file, and check its whole index.

    laspy trusts a damaged index: it allocates the memory named there, and may read the same page
    for ever.
    """
    with path.open('rb') as file:
        size = os.fstat(file.fileno()).st_size
        info = laspy.LasHeader.read_from(file).vlrs[0]
    # the root page, and the box of the octree
    _check_range('its index', info.hierarchy_root_offset, info.hierarchy_root_size, size)
    if not np.isfinite([*info.center, info.halfsize]).all():
        raise ValueError(f'the box of its index is {info.halfsize:g} about {info.center}')
    with panics_as_errors(), CopcReader.open(str(path)) as reader:
        # read all further pages, each once
        entries = reader.root_page.entries
        pages = [key for key, entry in entries.items() if entry.point_count < 0]
        while pages:
            key = pages.pop()
            entry = entries[key]
            _check_range('a page of its index', entry.offset, entry.byte_size, size)
            reader.source.seek(entry.offset)
            page = HierarchyPage.from_bytes(reader.source.read(entry.byte_size)).entries
            if key not in page or page[key].point_count < 0 or len(page) > len(
                page.keys() - entries.keys()
            ) + 1:
                raise ValueError('a page of its index leads back to itself')
            entries.update(page)
            pages += [own for own, entry in page.items() if entry.point_count < 0]
        # counts and byte ranges of the nodes
        total = sum(entry.point_count for entry in entries.values())
        if total > reader.header.point_count:
            raise ValueError(
                f'its index counts {total} points, its header {reader.header.point_count}'
            )
        num_layers = _count_layers(reader.laszip_vlr.record_data)
        for entry in entries.values():
            _check_range('a node', entry.offset, entry.byte_size, size)
            if entry.point_count:
                _check_layers(reader, entry, num_layers)
        yield reader


def _count_layers(options: bytes) -> int:
    """Return the number of layers of a chunk of LAZ, from its list of items."""
    (num_items,) = struct.unpack_from('<H', options, ITEMS - 2)
    items = [struct.unpack_from('<HH', options, ITEMS + 6 * k) for k in range(num_items)]
    return sum(LAYERS.get(kind, size) for kind, size in items)


def _check_layers(reader: CopcReader, entry: Any, num_layers: int) -> None:
    """Refuse layers larger than their node: lazrs would allocate as much memory."""
    before = reader.header.point_format.size + 4
    reader.source.seek(entry.offset)
    data = reader.source.read(before + 4 * num_layers)
    sizes = np.frombuffer(data[before : before + 4 * num_layers], '<u4')
    if len(sizes) < num_layers or len(data) + int(sizes.sum(dtype=np.int64)) > entry.byte_size:
        raise ValueError(f'a node of {entry.byte_size} bytes has layers of {sizes.tolist()}')


def _check_range(what: str, offset: int, length: int, size: int) -> None:
    """Raise ValueError if a range lies beyond the end of a file."""
    if offset < 0 or length < 0 or offset + length > size:
        raise ValueError(f'{what} has {length} bytes from {offset} on, the file has {size}')


def _find_bounds(header: laspy.LasHeader, slab: Slab) -> Bounds:
    """Return the box of a slab, one step wider, within that of the file."""
    scale, offset = float(header.scales[0]), float(header.offsets[0])
    low, high = np.array(header.mins) - 1.0, np.array(header.maxs) + 1.0
    low[0] = max(low[0], (slab.first - 1) * scale + offset)
    high[0] = min(high[0], slab.last * scale + offset)
    return Bounds(mins=low, maxs=high)


def _halve(header: laspy.LasHeader, slab: Slab) -> list[Slab]:
    """Return the halves of the part of a slab within the file, none if it is thin."""
    scale, offset = float(header.scales[0]), float(header.offsets[0])
    first = max(slab.first, round((header.mins[0] - offset) / scale) - 1)
    last = min(slab.last, round((header.maxs[0] - offset) / scale) + 2)
    if (last - first) * scale < 2 * THINNEST:
        return []
    middle = (first + last) // 2
    return [Slab(first=middle, last=slab.last), Slab(first=slab.first, last=middle)]
