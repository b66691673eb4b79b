# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""COPC files, cloud-optimised LAZ: parts of them by their own index."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import laspy
from laspy.copc import Bounds, CopcReader, load_octree_for_query
import numpy as np

from plc_inspect.offline.readers.laz import open_las, panics_as_errors
from plc_inspect.results import Int64

MOST_NODES = 4_000_000
"""Points of the nodes that are decompressed at once, unless a node alone holds more."""
THINNEST = 1.0
"""A slab is not divided below this [units of the file]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Slab:
    """Steps of x of the grid of a file, the first included and the last not."""

    first: int
    last: int


def is_copc(header: laspy.LasHeader) -> bool:
    """Tell whether a LAZ file has an index of COPC."""
    return bool(header.vlrs) and type(header.vlrs[0]).__name__ == 'CopcInfoVlr'


def lay_slabs(header: laspy.LasHeader, num: int) -> list[Slab]:
    """Divide a file across x into slabs that hold each of its points once."""
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
    Yield the points of a part of a COPC file; all parts together hold each point once.

    Parameters
    ----------
    path : Path
        The file.
    part : int
        From 0.
    num_parts : int
        Into which the file is divided, across x.

    Yields
    ------
    laspy.ScaleAwarePointRecord
        Those of a slab, as its index finds them.

    Errors are those of `laz.open_las`.

    """
    with open_las(path):  # refuses what would end the process
        pass
    with panics_as_errors(), CopcReader.open(str(path)) as reader:
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
    """Return how many points the index of a COPC file leads to."""
    with panics_as_errors(), CopcReader.open(str(path)) as reader:
        nodes: list[Any] = load_octree_for_query(
            reader.source, reader.copc_info, reader.root_page
        )
        return sum(int(node.point_count) for node in nodes)


def _find_bounds(header: laspy.LasHeader, slab: Slab) -> Bounds:
    """Return the box of a slab, a step wider than it, within that of the file."""
    scale, offset = float(header.scales[0]), float(header.offsets[0])
    low, high = np.array(header.mins) - 1.0, np.array(header.maxs) + 1.0
    low[0] = max(low[0], (slab.first - 1) * scale + offset)
    high[0] = min(high[0], slab.last * scale + offset)
    return Bounds(mins=low, maxs=high)


def _halve(header: laspy.LasHeader, slab: Slab) -> list[Slab]:
    """Return the halves of what of a slab lies within the file, none where it is thin."""
    scale, offset = float(header.scales[0]), float(header.offsets[0])
    first = max(slab.first, round((header.mins[0] - offset) / scale) - 1)
    last = min(slab.last, round((header.maxs[0] - offset) / scale) + 2)
    if (last - first) * scale < 2 * THINNEST:
        return []
    middle = (first + last) // 2
    return [Slab(first=middle, last=slab.last), Slab(first=slab.first, last=middle)]
