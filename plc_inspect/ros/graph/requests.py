# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Calls of ~/segment and ~/save that wait: one job answers all that came before it began."""

from collections import deque
from collections.abc import Callable

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from plc_inspect.ros.graph.qos import REQUESTS

PACE = 0.02
"""
Time between two answers [s]: a client that keeps ten, as by default, may stand still for 0.2 s.
"""


class Requests:
    """
    The calls of one service that wait for a job.

    Parameters
    ----------
    node : Node
        Offers the service.
    name : str
        Of the service, below the node's name.
    wake : callable
        Called when somebody waits.

    """

    def __init__(self, node: Node, name: str, wake: Callable[[], object]) -> None:
        self._wake = wake
        self._node = node
        self._waiting: list[Future] = []
        self._served: list[Future] = []
        self._answers: deque[tuple[Future, tuple[bool, str]]] = deque()
        # A service that waits would keep all callbacks of its group from running.
        node.create_service(
            Trigger, f'~/{name}', self._take, qos_profile=REQUESTS,
            callback_group=ReentrantCallbackGroup(),
        )
        self._timer = node.create_timer(
            PACE, self._send, clock=Clock(clock_type=ClockType.STEADY_TIME), autostart=False
        )

    def __bool__(self) -> bool:
        """Tell whether anyone waits for a job that has not begun."""
        return bool(self._waiting)

    async def _take(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        future = Future(executor=self._node.executor)
        self._waiting.append(future)
        self._wake()
        response.success, response.message = await future
        return response

    def take(self) -> bool:
        """Let the job that begins now answer everyone who waits; return whether anyone does."""
        waits = bool(self._waiting)
        self._served += self._waiting
        self._waiting.clear()
        return waits

    def answer(self, success: bool, text: str) -> None:
        """Answer everyone whom the job that ended was to answer, and forget them."""
        if not self._served:
            return
        self._answers.extend((future, (success, text)) for future in self._served)
        self._served.clear()
        if self._timer.is_canceled():
            self._timer.reset()
            self._send()
        self._wake()

    def _send(self) -> None:
        if not self._answers:
            self._timer.cancel()
            return
        future, result = self._answers.popleft()
        future.set_result(result)


def refuse(reason: str, *services: Requests) -> None:
    """Tell everyone who waits for a job of any of the services why it cannot be done."""
    for item in services:
        item.take()
        item.answer(False, reason)
