# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The end of ROS: a signal shuts it down, whatever rclpy is in the middle of."""

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rclpy.context import Context


def was_cut_short(error: Exception, context: 'Context | None' = None) -> bool:
    """
    Tell whether rclpy raised an error only because ROS was shut down meanwhile.

    It asks whether all is well, and a signal may come between that and what it does then.

    Parameters
    ----------
    error : Exception
        What was raised.
    context : Context or None
        Of the call, None for that of ``rclpy.init``.

    Returns
    -------
    bool
        Never True of errors of our own, nor while ROS is up.

    """
    import rclpy
    from rclpy.exceptions import NotInitializedException
    from rclpy.executors import ExternalShutdownException
    from rclpy.impl.implementation_singleton import rclpy_implementation

    kinds = (
        ExternalShutdownException, NotInitializedException, rclpy_implementation.RCLError,
        rclpy_implementation.InvalidHandle,
    )
    return isinstance(error, kinds) and not rclpy.utilities.ok(context=context)


def survive(
    callback: Callable[[], None], tell: Callable[[Exception], None], context: 'Context'
) -> None:
    """
    Call something, and tell its error, unless that is only of ROS being shut down meanwhile.

    Parameters
    ----------
    callback : callable
        Called.
    tell : callable
        Told the error, if there is one.
    context : Context
        Of the calls.

    """
    try:
        callback()
    except Exception as error:
        if not was_cut_short(error, context):
            tell(error)
