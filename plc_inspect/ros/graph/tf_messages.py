# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Messages of tf, which a robot without tf2_msgs does not have."""

from collections.abc import Iterable
from typing import Any

from plc_inspect.core.setup.transforms import clean_frame, StampedTransform


def import_tf() -> Any:
    """Return the class of tf2_msgs/TFMessage, None where it cannot be imported."""
    try:
        from tf2_msgs.msg import TFMessage
    except ImportError:
        return None
    return TFMessage


def make_fixed(kind: Any, transforms: Iterable[StampedTransform]) -> Any:
    """
    Make the one message of /tf_static that holds fixed transforms.

    Parameters
    ----------
    kind : type
        As from ``import_tf``.
    transforms : iterable of StampedTransform
        Of those of one child the last holds.

    Returns
    -------
    tf2_msgs/TFMessage

    """
    from geometry_msgs.msg import TransformStamped

    newest = {clean_frame(item.child): item for item in transforms}
    result = []
    for item in newest.values():
        message = TransformStamped(child_frame_id=item.child)
        message.header.frame_id = item.parent
        shift, turn = message.transform.translation, message.transform.rotation
        shift.x, shift.y, shift.z = item.position.tolist()
        turn.x, turn.y, turn.z, turn.w = item.quaternion.tolist()
        result.append(message)
    return kind(transforms=result)
