# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Ctrl-C while a kernel runs."""

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt where a kernel was interrupted, which fails with SystemError."""
    try:
        yield
    except SystemError as error:
        cause = error.__cause__
        while isinstance(cause, SystemError):
            cause = cause.__cause__
        if isinstance(cause, KeyboardInterrupt):
            raise KeyboardInterrupt from error
        raise
