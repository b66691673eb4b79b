# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Ctrl-C and SIGTERM while a kernel runs."""

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt or SystemExit in place of the SystemError of a kernel it ended."""
    try:
        yield
    except SystemError as error:
        cause = error.__cause__
        while isinstance(cause, SystemError):
            cause = cause.__cause__
        if isinstance(cause, KeyboardInterrupt | SystemExit):
            raise cause from None
        raise
