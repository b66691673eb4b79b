# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Wall time, processor time and extra memory of a call; busy programs beside it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, ExitStack
import ctypes
from dataclasses import dataclass
import gc
import math
import os
from pathlib import Path
import subprocess
import sys
import time
from typing import Generic, TypeVar

T = TypeVar('T')


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured(Generic[T]):
    """What a call returned and what it took."""

    value: T
    seconds: float
    cpu_seconds: float
    """Of all threads."""
    extra_bytes: float
    """Greatest resident memory during the call beyond that before it, NaN if not known."""


def compile_once(room: Path) -> dict[str, str]:
    """
    Return an environment for processes whose modules are compiled once, as by an installation.

    The first of them to load a module compiles it, into ``room``, whatever the shell says of that.
    """
    return os.environ | {'PYTHONDONTWRITEBYTECODE': '', 'PYTHONPYCACHEPREFIX': str(room)}


def measure(call: Callable[[], T], *, memory: bool = True) -> Measured[T]:
    """
    Call a function and measure it.

    The peak is the kernel's own (``VmHWM``, reset through ``clear_refs``), so that nothing has to
    be sampled meanwhile; it is known on Linux only.  To see it, what is free is given back to the
    system first, which has to find it again during the call: without ``memory`` that is left out,
    and times are those of a process that has run before.
    """
    gc.collect()
    can_reset = False
    if memory:
        _return_freed_memory()
        can_reset = _reset_peak()
    before = _read_status('VmRSS')
    started, cpu_started = time.perf_counter(), time.process_time()
    value = call()
    seconds, cpu_seconds = time.perf_counter() - started, time.process_time() - cpu_started
    peak = _read_status('VmHWM') if can_reset else math.nan
    return Measured(
        value=value, seconds=seconds, cpu_seconds=cpu_seconds, extra_bytes=peak - before,
    )


def _return_freed_memory() -> None:
    """Give what the allocator keeps for later back to the kernel, or it would hide the peak."""
    trim = getattr(ctypes.CDLL(None), 'malloc_trim', None)
    if trim is not None:
        trim(0)


def _reset_peak() -> bool:
    try:
        Path('/proc/self/clear_refs').write_text('5')
    except OSError:
        return False
    return True


def _read_status(key: str) -> float:
    """Return a memory figure of this process [bytes], NaN where there is no /proc."""
    try:
        lines = Path('/proc/self/status').read_text(encoding='ascii').splitlines()
    except OSError:
        return math.nan
    for line in lines:
        if line.startswith(f'{key}:'):
            return 1024.0 * float(line.split()[1])
    return math.nan


@contextmanager
def keep_busy(count: int) -> Iterator[None]:
    """Keep so many processes busy beside."""
    with ExitStack() as stack:
        for _ in range(count):
            process = subprocess.Popen([sys.executable, '-c', 'while True: pass'])
            stack.callback(process.wait)
            stack.callback(process.kill)
        yield
