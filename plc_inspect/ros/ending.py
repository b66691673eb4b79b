# Copyright 2026 plc_inspect contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The end of ROS: a signal shuts it down, whatever rclpy is in the middle of."""

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
    from rclpy.executors import ExternalShutdownException
    from rclpy.impl.implementation_singleton import rclpy_implementation

    kinds = (
        ExternalShutdownException, rclpy_implementation.RCLError,
        rclpy_implementation.InvalidHandle,
    )
    return isinstance(error, kinds) and not rclpy.utilities.ok(context=context)
