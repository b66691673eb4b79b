# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import pytest

from plc_inspect.grid.engine import call, Task
from plc_inspect.interrupts import interruptible


def fail_with(cause):
    """Raise what Python raises for a kernel, and what it calls, that end with an exception set."""
    try:
        raise SystemError('returned a result with an exception set') from cause
    except SystemError as error:
        raise SystemError('returned a result with an exception set') from error


def test_a_kernel_that_was_interrupted_is_an_interrupt():
    with pytest.raises(KeyboardInterrupt), interruptible():
        fail_with(KeyboardInterrupt())
    with pytest.raises(SystemExit, match='143'), interruptible():  # as by SIGTERM
        fail_with(SystemExit(143))
    with pytest.raises(SystemError), interruptible():
        fail_with(ValueError())


def test_a_task_that_is_interrupted_ends_the_run_and_not_only_itself():
    for cause in (KeyboardInterrupt(), SystemExit(143)):
        with pytest.raises(type(cause)):
            call(Task(name='tile', function=fail_with, arguments=(cause,)))
    assert 'SystemError' in call(
        Task(name='tile', function=fail_with, arguments=(ValueError(),))
    ).error
