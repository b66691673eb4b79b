# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Rows to messages of rclpy."""

import array
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from plc_inspect.messages.rows import list_fields


def make_cloud(header: Header, rows: NDArray[Any]) -> PointCloud2:
    """
    Pack rows into a cloud.

    Parameters
    ----------
    header : Header
        Frame and stamp of the data.
    rows : NDArray
        (N,) of a structured dtype, packed, little-endian.

    Returns
    -------
    PointCloud2
        Unorganised.

    """
    message = PointCloud2(
        header=header,
        height=1,
        width=len(rows),
        fields=_make_fields(rows.dtype),
        is_bigendian=False,
        point_step=rows.dtype.itemsize,
        row_step=rows.dtype.itemsize * len(rows),
        is_dense=True,
    )
    message.data = array.array('B', rows.tobytes())
    return message


@cache
def _make_fields(layout: np.dtype[Any]) -> list[PointField]:
    """Return the fields of rows; made once, as ~/proximity comes with each pose."""
    return [
        PointField(name=name, offset=offset, datatype=datatype, count=1)
        for name, offset, datatype in list_fields(layout)
    ]
