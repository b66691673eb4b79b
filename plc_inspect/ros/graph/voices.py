# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
The voices of a log, one for each severity.

rclpy remembers the severity of each line of code that logs, and raises ValueError where it is
another one later.  Who is given a voice may call it from one line as any other.
"""

from rclpy.impl.rcutils_logger import RcutilsLogger


class Voices:
    """
    Functions that log a text, to be handed on.

    Parameters
    ----------
    logger : RcutilsLogger
        Of the node.

    """

    def __init__(self, logger: RcutilsLogger) -> None:
        self._logger = logger

    def info(self, text: str) -> None:
        """Log what happens."""
        self._logger.info(text)

    def warning(self, text: str) -> None:
        """Log what somebody should look at."""
        self._logger.warning(text)

    def error(self, text: str) -> None:
        """Log what went wrong."""
        self._logger.error(text)
