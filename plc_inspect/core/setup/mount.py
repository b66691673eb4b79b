# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""How the lidar is mounted: as the settings say, else as /tf_static does."""

from dataclasses import dataclass

import numpy as np

from plc_inspect.config import InputSettings
from plc_inspect.core.setup.transforms import (
    clean_frame,
    FrameTree,
    make_transform,
    measure_apart,
    split_transform,
)
from plc_inspect.results import Float64

SAME_PLACE = 0.02
"""
Mounts that differ by less are the same [m].
Source: derived: less than the noise of the sensor, 0.03 m.
"""
SAME_TURN_DEG = 0.2
"""
Mounts that differ by less are the same [degrees].
Source: derived: 0.1 m at 30 m, a voxel of the map.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Mount:
    """The pose of the lidar in the frame of the vehicle's base."""

    transform: Float64
    """(4, 4) ``T_base_lidar``."""
    source: str
    """Where it comes from."""
    doubt: str = ''
    """What does not fit, '' nothing."""

    def describe(self) -> str:
        """Return it in one line."""
        place, turn = split_transform(self.transform)
        return (
            f'xyz {_list(place, 3)} m, roll pitch yaw {_list(turn, 1)} degrees, from {self.source}'
        )

    def equals(self, other: 'Mount') -> bool:
        """Tell whether another mount puts points to the same places."""
        return bool(np.array_equal(self.transform, other.transform))


def choose_mount(settings: InputSettings, frames: FrameTree, base: str, lidar: str) -> Mount:
    """
    Return the mount of the lidar.

    Parameters
    ----------
    settings : InputSettings
        ``lidar_xyz`` and ``lidar_rpy_deg`` win where any of them is not 0; ``use_tf``.
    frames : FrameTree
        Fixed frames of the vehicle.
    base : str
        Frame of the odometry's child; '' is ``settings.base_frame``.
    lidar : str
        Frame of the scans.

    Returns
    -------
    Mount

    """
    given = make_transform(settings.lidar_xyz, settings.lidar_rpy_deg)
    base, lidar = clean_frame(base or settings.base_frame), clean_frame(lidar)
    told = frames.find(base, lidar) if settings.use_tf else None
    if any(settings.lidar_xyz) or any(settings.lidar_rpy_deg):
        doubt = ''
        if told is not None:
            apart, turned = measure_apart(given, told)
            if apart > SAME_PLACE or turned > SAME_TURN_DEG:
                doubt = (
                    f'input.lidar_xyz and input.lidar_rpy_deg are {apart:.2f} m and {turned:.1f} '
                    f'degrees off the way from {base} to {lidar} in /tf_static; the settings hold'
                )
        return Mount(given, 'input.lidar_xyz and input.lidar_rpy_deg', doubt)
    if told is not None:
        return Mount(told, '/tf_static' if base != lidar else 'the frames, which are one')
    doubt = ''
    if settings.use_tf and frames.frames and lidar:
        doubt = (
            f'no way leads from {base} to {lidar} in /tf_static (frames: '
            f'{", ".join(frames.frames[:8])}): the lidar is taken to be mounted straight; set '
            'input.base_frame or input.lidar_rpy_deg'
        )
    return Mount(given, 'no setting and no /tf_static: straight', doubt)


def _list(values: Float64, digits: int) -> str:
    return ' '.join(f'{value + 0.0:.{digits}f}' for value in np.round(values, digits))
