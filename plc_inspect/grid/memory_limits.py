# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The memory that control groups, as those of a container, and the shell leave to this process."""

from collections.abc import Iterator
import math
from pathlib import Path
import resource

_GROUPS = 'proc/self/cgroup'
_PAGE = resource.getpagesize()
_VERSIONS = {
    '': ('sys/fs/cgroup', 'memory.max', 'memory.current', 'inactive_file'),
    'memory': (
        'sys/fs/cgroup/memory', 'memory.limit_in_bytes', 'memory.usage_in_bytes',
        'total_inactive_file',
    ),
}
"""
Of the controllers of a group: where it is, its limit, its use, and what of that can be freed.

Version 2 of control groups has no names of controllers in ``/proc/self/cgroup``, version 1 has.
"""


def measure_left(root: Path = Path('/')) -> float:
    """
    Return the memory that limits leave to this process [bytes], infinite where there are none.

    Parameters
    ----------
    root : Path
        Of the file system.

    """
    return min([*_measure_groups(root), _measure_space(root)])


def _measure_groups(root: Path) -> Iterator[float]:
    """Yield what each control group of this process leaves, from it to the outermost."""
    try:
        lines = (root / _GROUPS).read_text(encoding='utf-8').splitlines()
    except OSError:
        return
    for line in lines:
        _, controllers, place = line.split(':', 2)
        for name in controllers.split(','):
            if name not in _VERSIONS:
                continue
            base, limit, used, freed = _VERSIONS[name]
            top = root / base
            own = top / place.lstrip('/')
            # in a container the place may be that on its host
            for group in (own, *own.parents):
                left = _measure_group(group, limit, used, freed)
                if left is not None:
                    yield left
                if group == top:
                    break


def _measure_group(group: Path, limit: str, used: str, freed: str) -> float | None:
    try:
        most, held = ((group / name).read_text(encoding='ascii') for name in (limit, used))
        lines = (group / 'memory.stat').read_text(encoding='ascii').splitlines()
        stat = dict(line.split() for line in lines)
        return float(most) - float(held) + float(stat.get(freed, 0))
    except (OSError, ValueError):  # no limit: there is no file, or it says "max"
        return None


def _measure_space(root: Path) -> float:
    """Return what ``ulimit -v`` leaves of the address space."""
    most, _ = resource.getrlimit(resource.RLIMIT_AS)
    if most == resource.RLIM_INFINITY:
        return math.inf
    pages = (root / 'proc/self/statm').read_text(encoding='ascii').split()[0]
    return float(most - int(pages) * _PAGE)
