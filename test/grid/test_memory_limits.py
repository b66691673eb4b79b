# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What the limits of a container, or of a shell, leave of the memory of a machine."""

import math
import resource
import subprocess
import sys

import pytest

from plc_inspect.grid import engine
from plc_inspect.grid.engine import measure_available
from plc_inspect.grid.memory_limits import measure_left


def lay_groups(root, line, groups):
    """Write control groups: their place, and what their files hold."""
    (root / 'proc/self').mkdir(parents=True)
    (root / 'proc/self/cgroup').write_text(f'{line}\n', encoding='ascii')
    for place, files in groups.items():
        folder = root / 'sys/fs/cgroup' / place
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            (folder / name).write_text(f'{text}\n', encoding='ascii')


@pytest.mark.parametrize(('line', 'groups', 'expected'), [
    # version 2; a group without a limit in one that has one
    ('0::/pod/own', {
        'pod/own': {'memory.max': 'max', 'memory.current': 900, 'memory.stat': 'inactive_file 1'},
        'pod': {
            'memory.max': 8000, 'memory.current': 1000,
            'memory.stat': 'anon 700\ninactive_file 200',
        },
    }, 7200),
    # in a container it is the root, whatever its name on the host is
    ('0::/../../host', {
        '': {'memory.max': 5000, 'memory.current': 500, 'memory.stat': 'inactive_file 0'},
    }, 4500),
    # version 1
    ('4:cpu,memory:/a', {
        'memory/a': {
            'memory.limit_in_bytes': 3000, 'memory.usage_in_bytes': 2000,
            'memory.stat': 'total_inactive_file 500',
        },
        'memory': {
            'memory.limit_in_bytes': 9223372036854771712, 'memory.usage_in_bytes': 4000,
            'memory.stat': 'total_inactive_file 0',
        },
    }, 1500),
    ('2:cpu:/a', {}, math.inf),
    ('0::/', {'': {'memory.stat': 'inactive_file 0'}}, math.inf),
])
def test_the_tightest_group_counts(line, groups, expected, tmp_path):
    lay_groups(tmp_path, line, groups)
    assert measure_left(tmp_path) == expected


def test_where_there_are_no_groups_all_is_left(tmp_path):
    assert measure_left(tmp_path) == math.inf


def test_the_free_memory_is_that_within_the_limits(monkeypatch):
    monkeypatch.setattr(engine, 'measure_left', lambda: 1e9)
    assert measure_available() <= 0.9e9
    monkeypatch.setattr(engine, 'measure_left', lambda: -1e9)
    assert measure_available() == 0.0


def test_the_address_space_of_a_shell_is_one():
    text = 'from plc_inspect.grid.engine import measure_available; print(measure_available())'
    done = subprocess.run(
        [sys.executable, '-c', text], capture_output=True, text=True, check=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30)),
    )
    assert 0.0 < float(done.stdout) < 0.9 * (4 << 30)
