# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Reads which points of a cloud are wire: from labels, or from the spans of a truth.json."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from plc_inspect.errors import DataError
from plc_inspect.offline.readers.json_file import read_json
from plc_inspect.offline.readers.laz import read_labelled
from plc_inspect.results import Bool, catenary_heights, Float64, PointClass

WIRE_DISTANCE = 0.25
"""Greatest distance of wire points from a true conductor [m]."""
DOUBT_DISTANCE = 0.5
"""Distance from a true conductor up to which other points are left out [m]."""
ATTACHMENT_DISTANCE = 1.5
"""Distance from the end of a conductor below which points may be wire or insulator [m]."""
LEAST_LENGTH = 1e-9
"""Least length of a conductor in plan, as a divisor [m]."""
SAME_PLACE = 0.1
"""Greatest distance of a point from itself in another file, by the steps of coordinates [m]."""
STEP = 0.05
"""Spacing of the points that stand for a true conductor [m]."""


def read_wire_truth(path: Path, points: Float64) -> tuple[Bool, Bool]:
    """
    Read which points of a cloud are wire.

    Parameters
    ----------
    path : Path
        A labelled LAS or LAZ file of the same points in the same order, a ``truth.json`` of the
        simulator, or a folder that holds one.
    points : (N, 3) float64
        Coordinates [m].

    Returns
    -------
    wire, left_out : (N,) bool
        Points of class 14 or near a true conductor; points of class 0, or of which the truth
        says nothing certain.

    Raises
    ------
    DataError
        The truth is missing, malformed, or has other points, or in another order.

    """
    if path.suffix.lower() in ('.las', '.laz'):
        label, places = read_labelled(path)
        if len(label) != len(points):
            raise DataError(f'{path} has {len(label)} points, the cloud {len(points)}')
        check_order(points, places)
        return label == PointClass.WIRE, label == 0
    content, cloud = read_truth_file(path)
    if cloud is not None:
        return read_wire_truth(cloud, points)
    try:
        curves = [_place(row) for row in content['spans']]
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(f'{path}: the truth cannot be read: {error!r}') from error
    return label_points(points, curves)


def check_order(points: Float64, places: Float64) -> None:
    """
    Raise DataError unless labelled points are those of a cloud, in its order.

    Parameters
    ----------
    points : (N, 3) float64
        Of the cloud [m]; rows that are not finite are not compared.
    places : (N, 3) float64
        Of the labelled cloud, in any unit.

    """
    finite = np.flatnonzero(np.isfinite(points).all(axis=1))
    if not len(finite):
        return
    own, other = points[finite], places[finite]
    extent, width = np.ptp(own, axis=0), np.ptp(other, axis=0)
    metres = np.divide(extent, width, out=np.ones(3), where=width > 0.0)
    apart = np.abs((other - other[0]) * metres - (own - own[0])).max(axis=1)
    worst = int(apart.argmax())
    if apart[worst] > SAME_PLACE:
        raise DataError(
            f'the labelled cloud holds other points, or in another order: point {finite[worst]} is'
            f' {apart[worst]:.2f} m away'
        )


def read_truth_file(path: Path) -> tuple[dict[str, Any], Path | None]:
    """
    Read a ``truth.json``, given its path or its folder.

    Returns
    -------
    content : dict
        The content of the file.
    cloud : Path or None
        The labelled ``map.laz`` beside it, if it is the truth of a map.

    Raises
    ------
    DataError
        The file is missing or not JSON.

    """
    path = path / 'truth.json' if path.is_dir() else path
    content = read_json(path)
    cloud = path.parent / 'map.laz'
    return content, cloud if content.get('kind') == 'map' and cloud.is_file() else None


def count_samples(length: float) -> int:
    """Return the number of points that stand for a conductor of a length [m], STEP apart."""
    return max(2, int(length / STEP))


def _place(row: dict[str, Any]) -> Float64:
    """Return (K, 3) points of one true conductor, from start to end [m]."""
    start, end = np.array(row['start'], float), np.array(row['end'], float)
    a, b, c = float(row['a']), float(row['b']), float(row['c'])
    length = float(np.hypot(*(end - start)[:2]))
    x = np.linspace(0.0, length, count_samples(length))
    places: Float64 = start + (x / max(length, LEAST_LENGTH))[:, None] * (end - start)
    places[:, 2] = catenary_heights(a, b, c, x)
    return places


def label_points(points: Float64, curves: Sequence[Float64]) -> tuple[Bool, Bool]:
    """
    Tell by their distance from true conductors which points are wire.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    curves : sequence of (K, 3) float64
        Points of each conductor, from start to end, about STEP apart [m].

    Returns
    -------
    wire, left_out : (N,) bool
        Every point within DOUBT_DISTANCE of a conductor is one of them, or both.

    """
    wire = np.zeros(len(points), dtype=np.bool_)
    left_out: Bool = np.logical_not(np.isfinite(points).all(axis=1))
    if not curves or not len(points):
        return wire, left_out
    finite = np.flatnonzero(~left_out)
    distance, _ = cKDTree(np.vstack(curves)).query(
        points[finite], distance_upper_bound=DOUBT_DISTANCE
    )
    near, distance = finite[np.isfinite(distance)], distance[np.isfinite(distance)]
    ends = np.vstack([curve[[0, -1]] for curve in curves])
    at_end, _ = cKDTree(ends).query(points[near])
    wire[near] = distance <= WIRE_DISTANCE
    left_out[near] = (distance > WIRE_DISTANCE) | (at_end < ATTACHMENT_DISTANCE)
    return wire, left_out
