# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The command ``plc_play``: publishes a recording on the ROS graph, in its own timing."""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import importlib
import math
from pathlib import Path
import sys
import time
from typing import Any

from plc_inspect.errors import ConfigError, DataError, explain_missing, PlcInspectError
from plc_inspect.messages.poses import STATIC_TOPIC, TF_TYPES
from plc_inspect.offline.commands.command_line import parse_with_ros, Parser, positive
from plc_inspect.offline.readers.bags import Recording
from plc_inspect.printable import make_one_line
from plc_inspect.ros.graph.ending import was_cut_short
from plc_inspect.ros.graph.tf_messages import import_tf, make_fixed
from plc_inspect.ros.graph.transport import explain_start, lacks_plugins, prepare_transport

NAME = 'plc_play'
DONE, BAD_INPUT = 0, 2
CLOCK_PERIOD = 0.01
"""Recorded time between two messages of /clock at rate 1 [s]."""
NO_TF = 'tf2_msgs cannot be imported (install ros-jazzy-tf2-msgs)'
LEAD = 1.0
"""Time for the subscribers to find the publishers, at most [s]."""


@dataclass(frozen=True, slots=True)
class Due:
    """One message and when it is to be sent."""

    offset: float
    """Recorded time since the start [s]."""
    log_stamp_ns: int
    topic: str
    raw: bytes
    """As ROS 2 serialises it."""


def main(argv: Sequence[str] | None = None) -> int:
    """Play a recording; return 0 done, 2 bad usage or a recording that cannot be read."""
    arguments = _parse(argv)
    try:
        prepare_transport()
        return _run(arguments)
    except PlcInspectError as error:
        print(f'{NAME}: {make_one_line(error)}', file=sys.stderr)
    except ModuleNotFoundError as error:
        print(f'{NAME}: {explain_missing(error)}', file=sys.stderr)
    return BAD_INPUT


def _run(arguments: argparse.Namespace) -> int:
    with Recording(
        arguments.bag, arguments.scan_topic, arguments.odometry_topic
    ) as recording:
        if arguments.start >= max(recording.duration, 1e-9):
            raise DataError(
                f'--start {arguments.start:g} s is beyond the end, {recording.duration:.1f} s'
            )
        import rclpy

        rclpy.init(args=['--ros-args', *arguments.ros] if arguments.ros else None)
        try:
            player = Player(recording, arguments.scan_topic)
        except PlcInspectError:
            rclpy.utilities.try_shutdown()
            raise
        except Exception as error:  # a signal came while it was set up
            if lacks_plugins(error):
                raise ConfigError(explain_start(error)) from error
            if not was_cut_short(error):
                raise
            return DONE
        try:
            player.wait_for_subscribers(arguments.wait)
            count = player.play(arguments.rate, arguments.start)
            if not count and rclpy.utilities.ok():  # other topics go on for longer
                raise DataError(f'no scan or pose lies beyond --start {arguments.start:g} s')
            while arguments.loop and rclpy.utilities.ok():
                count += player.play(arguments.rate, arguments.start)
            if not arguments.quiet:
                print(f'{NAME}: {count} messages played')
        except KeyboardInterrupt:
            pass
        except Exception as error:
            if not was_cut_short(error):
                raise
        finally:
            player.close()
            rclpy.utilities.try_shutdown()
    return DONE


class Player:
    """
    Publishes scans, poses, /clock and, once and latched, the fixed transforms of /tf_static.

    Parameters
    ----------
    recording : Recording
        Open.
    scan_topic : str
        Where to publish scans; the recording was opened with the same name.  Poses are published
        where and as they were recorded.

    Raises
    ------
    ConfigError
        Poses come from /tf, and tf2_msgs cannot be imported.

    """

    def __init__(self, recording: Recording, scan_topic: str) -> None:
        from rclpy.node import Node
        from rosgraph_msgs.msg import Clock
        from sensor_msgs.msg import PointCloud2

        from plc_inspect.ros.graph.qos import CLOCK, overridable, PLAYER

        self._recording = recording
        pose_class = _find_class(recording.pose_type)
        self._node = Node('plc_play')
        self._clock_type = Clock
        self._publishers = {
            '/' + topic.strip('/'): self._node.create_publisher(kind, topic, **overridable(PLAYER))
            for topic, kind in (
                (scan_topic, PointCloud2), (recording.pose_name, pose_class)
            )
        }
        self._clock = self._node.create_publisher(Clock, '/clock', CLOCK)
        self._publish_fixed(recording)

    def _publish_fixed(self, recording: Recording) -> None:
        """Publish the mount and whatever else does not move; whoever comes late gets it too."""
        from plc_inspect.ros.graph.qos import TF_STATIC

        if not recording.fixed_transforms:
            return
        kind = import_tf()
        if kind is None:
            print(
                f'{NAME}: {STATIC_TOPIC} of the recording is not published, {NO_TF}: set '
                'input.lidar_xyz and input.lidar_rpy_deg of the node', file=sys.stderr,
            )
            return
        publisher = self._node.create_publisher(kind, STATIC_TOPIC, TF_STATIC)
        publisher.publish(make_fixed(kind, recording.fixed_transforms))

    def wait_for_subscribers(self, timeout: float) -> bool:
        """Wait until scans and odometry have a subscriber, at most so long [s]."""
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            if all(item.get_subscription_count() for item in self._publishers.values()):
                return True
            time.sleep(0.02)
        return False

    def play(self, rate: float, start: float) -> int:
        """
        Publish the recording once.

        Parameters
        ----------
        rate : float
            Speed, 1 as recorded.
        start : float
            Recorded time to begin at [s].

        Returns
        -------
        int
            Messages published, /clock not counted.

        """
        context = self._node.context
        began: float | None = None
        tick = 0.0
        count = 0
        for item in _schedule(self._recording, start):
            if began is None:
                began, tick = time.monotonic() - (item.offset - start) / rate, item.offset
            while tick <= item.offset:
                if not self._sleep(began + (tick - start) / rate):
                    return count
                ahead = round((tick - item.offset) * 1e9)
                self._send_clock(item.log_stamp_ns + ahead)
                tick += CLOCK_PERIOD * max(1.0, rate)
            if not self._sleep(began + (item.offset - start) / rate) or not context.ok():
                return count
            self._publishers[item.topic].publish(item.raw)
            count += 1
        return count

    def close(self) -> None:
        """Destroy the node, after what was sent has had time to arrive."""
        for publisher in self._publishers.values():
            if self._node.context.ok():
                _wait_for_acknowledgement(publisher)
        self._node.destroy_node()

    def _sleep(self, until: float) -> bool:
        """Sleep until a steady time; return whether ROS is still up."""
        while (left := until - time.monotonic()) > 0:
            if not self._node.context.ok():
                return False
            time.sleep(min(left, 0.1))
        return bool(self._node.context.ok())

    def _send_clock(self, stamp_ns: int) -> None:
        from builtin_interfaces.msg import Time

        seconds, nanoseconds = divmod(max(stamp_ns, 0), 1_000_000_000)
        self._clock.publish(self._clock_type(clock=Time(sec=seconds, nanosec=nanoseconds)))


def _find_class(kind: str) -> Any:
    """Return the class of a type of poses, such as nav_msgs/msg/Odometry; as ``Player``."""
    if kind in TF_TYPES:
        if (found := import_tf()) is None:
            raise ConfigError(f'the poses of the recording are on /tf, but {NO_TF}')
        return found
    package, _, name = kind.split('/')
    return getattr(importlib.import_module(f'{package}.msg'), name)


def _wait_for_acknowledgement(publisher: Any) -> None:
    from rclpy.duration import Duration

    publisher.wait_for_all_acked(Duration(seconds=2))


def _schedule(recording: Recording, start: float) -> Iterator[Due]:
    first: int | None = None
    for message in recording.raw_messages():
        if first is None:
            first = message.log_stamp_ns
        offset = (message.log_stamp_ns - first) * 1e-9
        if offset >= start:
            yield Due(offset, message.log_stamp_ns, message.topic, message.raw)


def _not_negative(text: str) -> float:
    value = float(text)
    if not 0 <= value < math.inf:
        raise argparse.ArgumentTypeError(f'{text} is negative or no number')
    return value


def _parse(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = Parser(
        prog=NAME, description='Publishes the scans and odometry of a recording, with /clock.'
    )
    parser.add_argument(
        'bag', type=Path, metavar='BAG', help='a rosbag2 folder, .mcap, .db3 or ROS 1 .bag file'
    )
    parser.add_argument('--rate', type=positive, default=1.0, metavar='R',
                        help='speed, 1 as recorded')
    parser.add_argument('--loop', action='store_true', help='begin anew at the end, for ever')
    parser.add_argument('--start', type=_not_negative, default=0.0, metavar='S',
                        help='begin this far into the recording [s]')
    parser.add_argument('--wait', type=_not_negative, default=LEAD, metavar='S',
                        help='wait for subscribers at most so long (default: %(default)s)')
    parser.add_argument('--scan-topic', default='velodyne_points', metavar='TOPIC')
    parser.add_argument('--odometry-topic', default='odometry', metavar='TOPIC')
    parser.add_argument('--quiet', action='store_true', help='print errors only')
    return parse_with_ros(parser, argv)


if __name__ == '__main__':
    sys.exit(main())
