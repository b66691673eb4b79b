# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Convert poses to arrays, by attribute only, so messages of rclpy and rosbags both work.

Nothing of ROS is imported here.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from plc_inspect.config import InputSettings
from plc_inspect.core.setup.moving_frames import MovingFrames
from plc_inspect.core.setup.transforms import StampedTransform
from plc_inspect.errors import DataError
from plc_inspect.messages.scans import stamp_from_header
from plc_inspect.results import Float64

POSE_TYPES = {
    'Odometry': 'nav_msgs/msg/Odometry',
    'PoseStamped': 'geometry_msgs/msg/PoseStamped',
    'PoseWithCovarianceStamped': 'geometry_msgs/msg/PoseWithCovarianceStamped',
}
"""Values of input.odometry_type to message types; the first type found is used."""
AUTO, TF = 'auto', 'tf'
TF_TYPES = ('tf2_msgs/msg/TFMessage', 'tf/msg/tfMessage')
TF_TOPIC, STATIC_TOPIC = '/tf', '/tf_static'


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StampedPose:
    """One pose of the vehicle, with unchecked values."""

    stamp_ns: int
    """Header stamp [ns]."""
    frame_id: str
    """Frame of the position and orientation."""
    child_frame_id: str
    """Frame of the vehicle's base, '' if the message has none."""
    position: Float64
    """(3,) [m]."""
    quaternion: Float64
    """(4,) x y z w."""


def pose_from_message(message: Any) -> StampedPose:
    """
    Read a message of one of POSE_TYPES.

    Parameters
    ----------
    message : Odometry, PoseStamped or PoseWithCovarianceStamped
        Of rclpy or rosbags.

    Returns
    -------
    StampedPose
        Stamp, frames and pose.

    Raises
    ------
    DataError
        The stamp is invalid.

    """
    pose = getattr(message.pose, 'pose', message.pose)
    return StampedPose(
        stamp_ns=stamp_from_header(message.header),
        frame_id=message.header.frame_id,
        child_frame_id=getattr(message, 'child_frame_id', ''),
        position=_read(pose.position, 'xyz'),
        quaternion=_read(pose.orientation, 'xyzw'),
    )


def transforms_from_message(message: Any) -> list[StampedTransform]:
    """
    Read a tf2_msgs/TFMessage of /tf_static, where stamps have no meaning.

    Parameters
    ----------
    message : tf2_msgs/TFMessage
        Of rclpy or rosbags.

    Returns
    -------
    list[StampedTransform]
        With stamps of 0.

    """
    return [_read_transform(item) for item in message.transforms]


def poses_from_transforms(
    message: Any, moving: MovingFrames, source: InputSettings
) -> Iterator[StampedPose]:
    """
    Yield the poses that a tf2_msgs/TFMessage gives; a bad transform costs itself alone.

    Parameters
    ----------
    message : tf2_msgs/TFMessage
        Of /tf.
    moving : MovingFrames
        Receives the transforms.
    source : InputSettings
        ``map_frame`` and ``base_frame``.

    Raises
    ------
    DataError
        In the end: a transform that gives a pose is invalid, or more than one between map and
        base moves.

    """
    first: DataError | None = None
    for item in message.transforms:
        try:
            pose = moving.add(_read_transform(item))
            stamp_ns = 0 if pose is None else stamp_from_header(item.header)
        except DataError as error:
            first = first or error
            continue
        if pose is not None:
            yield StampedPose(
                stamp_ns=stamp_ns, frame_id=source.map_frame,
                child_frame_id=source.base_frame, position=pose[0], quaternion=pose[1],
            )
    if first is not None:
        raise first


def _read_transform(item: Any) -> StampedTransform:
    return StampedTransform(
        stamp_ns=0,
        parent=item.header.frame_id,
        child=item.child_frame_id,
        position=_read(item.transform.translation, 'xyz'),
        quaternion=_read(item.transform.rotation, 'xyzw'),
    )


def _read(item: Any, names: str) -> Float64:
    return np.array([getattr(item, name) for name in names], dtype=np.float64)
