# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Markers as messages of rclpy, and the deletion of those that are no more."""

from collections.abc import Sequence

from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from plc_inspect.messages.items import Place
from plc_inspect.messages.markers import Mark

MarkerKey = tuple[str, int]
"""Namespace and id."""


def make_marker(header: Header, mark: Mark) -> Marker:
    """
    Make the message of a mark.

    Parameters
    ----------
    header : Header
        Frame and stamp of the data.
    mark : Mark
        What is to be seen.

    Returns
    -------
    Marker
        Of action ADD.

    """
    red, green, blue, alpha = mark.rgba
    width, depth, height = mark.scale
    return Marker(
        header=header,
        ns=mark.namespace,
        id=mark.number,
        type=int(mark.kind),
        pose=Pose(position=_make_point(mark.position), orientation=Quaternion(w=1.0)),
        scale=Vector3(x=width, y=depth, z=height),
        color=ColorRGBA(r=red, g=green, b=blue, a=alpha),
        points=[_make_point(place) for place in mark.points.tolist()],
        text=mark.text,
    )


def add_deletions(
    header: Header, markers: Sequence[Marker], before: set[MarkerKey]
) -> tuple[MarkerArray, set[MarkerKey]]:
    """
    Complete markers with the deletion of those that were there before and are no more.

    Parameters
    ----------
    header : Header
        Frame and stamp of the data.
    markers : sequence of Marker
        Those that are to be seen.
    before : set[MarkerKey]
        Those that were.

    Returns
    -------
    tuple[MarkerArray, set[MarkerKey]]
        The message, and what is to be seen now.

    """
    now = {(marker.ns, marker.id) for marker in markers}
    gone = [
        Marker(header=header, ns=ns, id=number, action=Marker.DELETE)
        for ns, number in sorted(before - now)
    ]
    return MarkerArray(markers=[*gone, *markers]), now


def _make_point(place: Place) -> Point:
    x, y, z = place
    return Point(x=x, y=y, z=z)
