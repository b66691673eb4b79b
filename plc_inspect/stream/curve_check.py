# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Refuses rows of the summary that nobody could draw."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from plc_inspect.errors import DataError
from plc_inspect.results import catenary_heights

NO_LENGTH = -(1 << 31)
"""A length that is not known."""
HIGHEST = 1e7
"""No curve is farther from the height 0 [m]."""


def check_curves(spans: NDArray[Any]) -> None:
    """
    Refuse spans of which nobody could draw the curve.

    Parameters
    ----------
    spans : (N,) SPANS
        Rows of the summary.

    Raises
    ------
    DataError
        An end is not known, or a height is beyond HIGHEST.

    """
    start, end = (
        np.column_stack([spans[f'{side}_{axis}'].astype(np.float64) for axis in 'xyz'])
        for side in ('start', 'end')
    )
    length = np.hypot(*(end - start)[:, :2].T) * 1e-3
    a, b, c = (spans[name].astype(np.float64) for name in 'abc')
    good = (start != NO_LENGTH).all(axis=1) & (end != NO_LENGTH).all(axis=1)
    with np.errstate(all='ignore'):
        for share in (0.0, 0.5, 1.0):
            good &= np.abs(catenary_heights(a, b, c, share * length)) <= HIGHEST  # NaN is not
    if not good.all():
        row = spans[np.flatnonzero(~good)[0]]
        raise DataError(
            f'line {row["line_id"]} span {row["span_id"]} has a curve that cannot be: '
            f'a {row["a"]:g}, b {row["b"]:g}, c {row["c"]:g} m'
        )


def check_places(rows: NDArray[Any], key: str) -> None:
    """
    Refuse rows whose position is not known.

    Parameters
    ----------
    rows : (N,) SUPPORTS or HAZARDS
        Rows of the summary.
    key : str
        Name of the column with their number, such as ``hazard_id``.

    Raises
    ------
    DataError
        A position is not known.

    """
    unknown = np.any([rows[axis] == NO_LENGTH for axis in 'xyz'], axis=0)
    if unknown.any():
        number = rows[key][np.flatnonzero(unknown)[0]]
        raise DataError(f'{key.removesuffix("_id")} {number} has no position')
