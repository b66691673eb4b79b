# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Writes labelled clouds as LAS 1.4."""

from collections.abc import Sequence
from pathlib import Path

import laspy
import numpy as np
from numpy.typing import NDArray

from plc_inspect.sim.surveys.airborne import LabelledCloud

Float64 = NDArray[np.float64]


def write_cloud(
    path: Path, cloud: LabelledCloud, origin: Sequence[float] = (0.0, 0.0, 0.0),
) -> None:
    """
    Write a labelled cloud.

    Parameters
    ----------
    path : Path
        Path that ends in .las or .laz.
    cloud : LabelledCloud
        The cloud.
    origin : sequence of float
        Added to the coordinates, which are stored to the millimetre [m].

    """
    header = laspy.LasHeader(point_format=6, version='1.4')
    header.scales = np.full(3, 0.001)
    header.offsets = np.floor(np.asarray(origin, dtype=np.float64))
    header.add_extra_dims([
        laspy.ExtraBytesParams('line_id', np.int32, 'conductor, -1 none'),
        laspy.ExtraBytesParams('span_id', np.int32, 'span, -1 none'),
    ])
    las = laspy.LasData(header)
    for axis, name in enumerate('xyz'):
        setattr(las, name, cloud.points[:, axis] + origin[axis])
    las.classification = cloud.label
    las['line_id'], las['span_id'] = cloud.line_id, cloud.span_id
    las.write(str(path))
