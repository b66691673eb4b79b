# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import pytest

from plc_inspect.offline.commands.command_line import interruptible


def fail_with(cause):
    """Raise what Python raises for a kernel, and what it calls, that end with an exception set."""
    try:
        raise SystemError('returned a result with an exception set') from cause
    except SystemError as error:
        raise SystemError('returned a result with an exception set') from error


def test_a_kernel_that_was_interrupted_is_an_interrupt():
    with pytest.raises(KeyboardInterrupt), interruptible():
        fail_with(KeyboardInterrupt())
    with pytest.raises(SystemError), interruptible():
        fail_with(ValueError())
