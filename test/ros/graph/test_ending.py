# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What rclpy raises while ROS is shut down is no failure of a callback."""

import pytest
import rclpy
from rclpy.context import Context
from std_msgs.msg import Empty

from plc_inspect.ros.graph.domain import take_domain
from plc_inspect.ros.graph.ending import survive


@pytest.fixture
def publisher():
    context = Context()
    rclpy.init(context=context, domain_id=take_domain())
    node = rclpy.create_node('ending', context=context)
    yield node.create_publisher(Empty, 'nothing', 1), context
    node.destroy_node()
    context.try_shutdown()


def test_a_message_after_the_end_is_no_failure(publisher):
    own, context = publisher
    told = []
    survive(lambda: own.publish(Empty()), told.append, context)
    context.shutdown()
    survive(lambda: own.publish(Empty()), told.append, context)
    assert told == []


def test_errors_of_our_own_are_told_before_and_after(publisher):
    _, context = publisher
    told = []

    def fail():
        raise ValueError('no')

    survive(fail, told.append, context)
    context.shutdown()
    survive(fail, told.append, context)
    assert [str(error) for error in told] == ['no', 'no']
