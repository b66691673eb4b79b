# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Fixed transforms between frames, as of /tf_static, and the way from one to another."""

from collections import deque
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import ArrayLike

from plc_inspect.errors import DataError
from plc_inspect.results import Float64

QUATERNION_TOLERANCE = 0.01
"""Largest difference of a quaternion's length from 1.  Source: judgement; not measured."""


@dataclass(frozen=True, slots=True, eq=False)
class StampedTransform:
    """One transform, as a geometry_msgs/TransformStamped holds it; its values are not checked."""

    stamp_ns: int
    """[ns]."""
    parent: str
    child: str
    position: Float64
    """(3,) origin of the child in the parent [m]."""
    quaternion: Float64
    """(4,) x y z w."""


def make_transform(xyz: ArrayLike, rpy_deg: ArrayLike) -> Float64:
    """
    Build the pose of a sensor from its position and its roll, pitch and yaw.

    Rotations are about the fixed axes x, then y, then z (REP-103, as in URDF).

    Parameters
    ----------
    xyz : array_like
        (3,) position of the sensor in the base frame [m].
    rpy_deg : array_like
        (3,) roll, pitch, yaw [degrees].

    Returns
    -------
    Float64
        (4, 4) ``T_base_sensor``.

    """
    roll, pitch, yaw = np.radians(np.asarray(rpy_deg, dtype=np.float64))
    about_x = np.array(
        [[1, 0, 0], [0, math.cos(roll), -math.sin(roll)], [0, math.sin(roll), math.cos(roll)]]
    )
    about_y = np.array(
        [[math.cos(pitch), 0, math.sin(pitch)], [0, 1, 0], [-math.sin(pitch), 0, math.cos(pitch)]]
    )
    about_z = np.array(
        [[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0], [0, 0, 1]]
    )
    transform = np.eye(4)
    transform[:3, :3] = about_z @ about_y @ about_x
    transform[:3, 3] = np.asarray(xyz, dtype=np.float64)
    return transform


def split_transform(transform: Float64) -> tuple[Float64, Float64]:
    """
    Return position [m] and roll, pitch and yaw [degrees] of a transform.

    Parameters
    ----------
    transform : Float64
        (4, 4), as from ``make_transform``.

    Returns
    -------
    tuple[Float64, Float64]
        (3,) each.

    """
    turn = transform[:3, :3]
    pitch = math.asin(max(-1.0, min(1.0, -turn[2, 0])))
    if abs(turn[2, 0]) < 1.0 - 1e-9:
        roll, yaw = math.atan2(turn[2, 1], turn[2, 2]), math.atan2(turn[1, 0], turn[0, 0])
    else:  # looking straight up or down, roll and yaw are one turn
        roll, yaw = 0.0, math.atan2(-turn[0, 1], turn[1, 1])
    return transform[:3, 3].copy(), np.degrees([roll, pitch, yaw])


def measure_apart(one: Float64, other: Float64) -> tuple[float, float]:
    """Return the distance [m] and the angle [degrees] between two (4, 4) poses."""
    turn = one[:3, :3].T @ other[:3, :3]
    cosine = max(-1.0, min(1.0, (float(np.trace(turn)) - 1.0) / 2.0))
    return float(np.linalg.norm(one[:3, 3] - other[:3, 3])), math.degrees(math.acos(cosine))


def to_matrix(item: StampedTransform) -> Float64:
    """
    Return a transform as (4, 4) ``T_parent_child``.

    Raises
    ------
    DataError
        A value is not finite, or the quaternion is not of unit length.

    """
    x, y, z, w = item.quaternion
    norm = math.sqrt(float(item.quaternion @ item.quaternion))
    finite = np.isfinite(item.position).all() and math.isfinite(norm)
    if not finite or abs(norm - 1.0) > QUATERNION_TOLERANCE:
        raise DataError(
            f'the transform from {item.parent} to {item.child} is none: position '
            f'{item.position.tolist()}, quaternion {item.quaternion.tolist()}'
        )
    x, y, z, w = item.quaternion / norm
    result = np.eye(4)
    result[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    result[:3, 3] = item.position
    return result


def to_quaternion(turn: Float64) -> Float64:
    """Return a (3, 3) rotation as a quaternion x y z w."""
    # the eigenvector of the greatest eigenvalue (Bar-Itzhack 2000), stable for every angle
    xx, yy, zz = turn[0, 0], turn[1, 1], turn[2, 2]
    form = np.array([
        [xx - yy - zz, 0.0, 0.0, 0.0],
        [turn[0, 1] + turn[1, 0], yy - xx - zz, 0.0, 0.0],
        [turn[0, 2] + turn[2, 0], turn[1, 2] + turn[2, 1], zz - xx - yy, 0.0],
        [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1], xx + yy + zz],
    ])
    quaternion: Float64 = np.linalg.eigh(form)[1][:, -1]
    return quaternion


def clean_frame(name: str) -> str:
    """Return the name of a frame without the leading slash that tf once had."""
    return name.lstrip('/')


def _invert(transform: Float64) -> Float64:
    result = np.eye(4)
    result[:3, :3] = transform[:3, :3].T
    result[:3, 3] = -transform[:3, :3].T @ transform[:3, 3]
    return result


class FrameTree:
    """Transforms that do not change, by the names of their frames."""

    def __init__(self) -> None:
        self._edges: dict[str, dict[str, Float64]] = {}
        self._parents: dict[str, str] = {}

    def __contains__(self, frame: str) -> bool:
        """Tell whether a frame is known."""
        return clean_frame(frame) in self._edges

    @property
    def frames(self) -> list[str]:
        """Names of all frames, sorted."""
        return sorted(self._edges)

    def parent_of(self, frame: str) -> str | None:
        """Return the frame that a frame is fixed to, None where it is to none."""
        return self._parents.get(clean_frame(frame))

    def add(self, item: StampedTransform) -> None:
        """
        Take a transform; it replaces an older one of the same child.

        Raises
        ------
        DataError
            Its values are not those of a transform, or a frame would be fixed to itself.

        """
        transform = to_matrix(item)
        parent, child = clean_frame(item.parent), clean_frame(item.child)
        if parent == child:
            raise DataError(f'the frame {child!r} is fixed to itself')
        above = self._parents.get(parent)
        while above is not None:
            if above == child:
                raise DataError(
                    f'the frame {child!r} is fixed to {parent!r}, which is fixed to {child!r}: '
                    'one of both transforms is wrong, and the first holds'
                )
            above = self._parents.get(above)
        before = self._parents.get(child)
        if before is not None:
            del self._edges[before][child], self._edges[child][before]
        self._parents[child] = parent
        self._edges.setdefault(parent, {})[child] = transform
        self._edges.setdefault(child, {})[parent] = _invert(transform)

    def find(self, target: str, source: str) -> Float64 | None:
        """
        Return the pose of one frame in another.

        Parameters
        ----------
        target, source : str
            Names of frames.

        Returns
        -------
        Float64 or None
            (4, 4) ``T_target_source``, None where no way leads from one to the other.

        """
        target, source = clean_frame(target), clean_frame(source)
        reached: dict[str, Float64] = {target: np.eye(4)}
        waiting = deque([target])
        while waiting and source not in reached:
            frame = waiting.popleft()
            for other, transform in self._edges.get(frame, {}).items():
                if other not in reached:
                    reached[other] = reached[frame] @ transform
                    waiting.append(other)
        return reached.get(source)
