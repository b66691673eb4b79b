# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Motion correction of a scan: transforms every point by the pose of its own time.

Between two poses the position moves linearly and the orientation turns at a constant rate about
one axis (slerp), evaluated exactly for every point, without bins in time.
"""

from dataclasses import dataclass
import math

from numba import njit
import numpy as np
from numpy.typing import NDArray

from plc_inspect.core.mapping.pose_buffer import bracket_stamps, PoseBuffer
from plc_inspect.errors import DataError
from plc_inspect.results import Float32, Float64, Int64, UInt8


@dataclass(frozen=True, slots=True, eq=False)
class DeskewedScan:
    """Points of one scan in the map frame."""

    points: Float64
    """(N, 3) map frame [m], NaN where ``bracket`` is not OK."""
    bracket: UInt8
    """(N,) ``pose_buffer.Bracket``, why each point has a pose or none."""

    @property
    def complete(self) -> bool:
        """Whether every point has a pose."""
        return not self.bracket.any()


def deskew(
    xyz: Float32, stamps_ns: NDArray[np.int64], poses: PoseBuffer, T_base_lidar: Float64
) -> DeskewedScan:
    """
    Transform points into the map frame, each with the pose at its own stamp.

    O(N) for stamps that are nearly in order, about 1 ms for 30,000 points.

    Parameters
    ----------
    xyz : Float32
        (N, 3) points in the lidar frame [m].
    stamps_ns : NDArray[np.int64]
        (N,) time at which each point was measured [ns].
    poses : PoseBuffer
        Poses ``T_map_base``.
    T_base_lidar : Float64
        (4, 4) pose of the lidar in the base frame.

    Returns
    -------
    DeskewedScan
        N points and the bracket of each; a point without pose is NaN, never guessed.

    Raises
    ------
    DataError
        The arrays do not belong together.

    """
    points = np.ascontiguousarray(xyz, dtype=np.float32)
    stamps = np.ascontiguousarray(stamps_ns, dtype=np.int64)
    if points.shape != (len(stamps), 3):
        raise DataError(f'{len(stamps)} stamps for points of shape {points.shape}')
    if T_base_lidar.shape != (4, 4):
        raise DataError(f'T_base_lidar must have shape (4, 4), got {T_base_lidar.shape}')
    known = poses.arrays()
    upper, bracket = bracket_stamps(stamps, known.stamps, known.intervals)
    transform = np.ascontiguousarray(T_base_lidar, dtype=np.float64)
    result = _transform(
        points, stamps, known.stamps, known.positions, known.quaternions, upper, bracket,
        transform,
    )
    return DeskewedScan(result, bracket)


@njit(cache=True, nogil=True)
def _transform(
    xyz: Float32,
    stamps: Int64,
    pose_stamps: Int64,
    positions: Float64,
    quaternions: Float64,
    upper: Int64,
    bracket: UInt8,
    mount: Float64,
) -> Float64:
    result = np.empty((len(xyz), 3), dtype=np.float64)
    current = -1
    rotation = np.empty((3, 3))
    axis = np.zeros(3)
    angle = 0.0
    for i in range(len(xyz)):
        if bracket[i] != 0:
            result[i, :] = np.nan
            continue
        # rotation and turn are the same for all points between two poses
        k = upper[i]
        if k != current:
            current = k
            _set_rotation(quaternions[k - 1], rotation)
            angle = _set_turn(quaternions[k - 1], quaternions[k], axis)
        share = (stamps[i] - pose_stamps[k - 1]) / (pose_stamps[k] - pose_stamps[k - 1])
        x, y, z = np.float64(xyz[i, 0]), np.float64(xyz[i, 1]), np.float64(xyz[i, 2])
        # from the lidar into the base
        bx = mount[0, 0] * x + mount[0, 1] * y + mount[0, 2] * z + mount[0, 3]
        by = mount[1, 0] * x + mount[1, 1] * y + mount[1, 2] * z + mount[1, 3]
        bz = mount[2, 0] * x + mount[2, 1] * y + mount[2, 2] * z + mount[2, 3]
        # turn by share * angle about the axis of the relative rotation (Rodrigues)
        sine, versine = math.sin(share * angle), 1.0 - math.cos(share * angle)
        cx = axis[1] * bz - axis[2] * by
        cy = axis[2] * bx - axis[0] * bz
        cz = axis[0] * by - axis[1] * bx
        tx = bx + sine * cx + versine * (axis[1] * cz - axis[2] * cy)
        ty = by + sine * cy + versine * (axis[2] * cx - axis[0] * cz)
        tz = bz + sine * cz + versine * (axis[0] * cy - axis[1] * cx)
        # into the map, by the pose before and the share of the motion since
        for j in range(3):
            start = positions[k - 1, j]
            result[i, j] = (
                rotation[j, 0] * tx + rotation[j, 1] * ty + rotation[j, 2] * tz
                + start + share * (positions[k, j] - start)
            )
    return result


@njit(cache=True, nogil=True)
def _set_rotation(quaternion: Float64, rotation: Float64) -> None:
    x, y, z, w = quaternion
    rotation[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    rotation[0, 1] = 2.0 * (x * y - z * w)
    rotation[0, 2] = 2.0 * (x * z + y * w)
    rotation[1, 0] = 2.0 * (x * y + z * w)
    rotation[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    rotation[1, 2] = 2.0 * (y * z - x * w)
    rotation[2, 0] = 2.0 * (x * z - y * w)
    rotation[2, 1] = 2.0 * (y * z + x * w)
    rotation[2, 2] = 1.0 - 2.0 * (x * x + y * y)


@njit(cache=True, nogil=True)
def _set_turn(first: Float64, second: Float64, axis: Float64) -> float:
    """Set the axis of conj(first) * second, in the frame of first; return its angle [rad]."""
    x = first[3] * second[0] - first[0] * second[3] - first[1] * second[2] + first[2] * second[1]
    y = first[3] * second[1] - first[1] * second[3] - first[2] * second[0] + first[0] * second[2]
    z = first[3] * second[2] - first[2] * second[3] - first[0] * second[1] + first[1] * second[0]
    w = first[3] * second[3] + first[0] * second[0] + first[1] * second[1] + first[2] * second[2]
    norm = math.sqrt(x * x + y * y + z * z)
    axis[:] = 0.0
    if norm == 0.0:
        return 0.0
    sign = 1.0 if w >= 0.0 else -1.0
    axis[0], axis[1], axis[2] = sign * x / norm, sign * y / norm, sign * z / norm
    return 2.0 * math.atan2(norm, abs(w))
