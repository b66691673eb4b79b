# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What all tests start from, and in which order they run."""

from pathlib import Path
import signal

# In the background of a shell interrupts are ignored, and programs that tests start would
# inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)

HERE = Path(__file__).parent
FIRST = (
    'core/live/test_warm_up.py',
    'test_architecture.py', 'sim', 'core/numerics', 'core/mapping', 'offline/readers', 'messages',
    'stream', 'test_constants.py', 'test_package.py',
    'ros/test_processes.py', 'monitor/web/test_page.py', 'test_scenes.py', 'bench', 'ros',
    'monitor',
)
"""
Files and folders in the order in which they are begun.

Where nothing is compiled yet, one process compiles the kernels of the pipeline in the first file
while the other has work that needs none of them; then comes what takes longest, so that both end
together.
"""


def pytest_configure(config):
    """Keep xdist from an order of its own: files with the most tests first."""
    config.option.loadscopereorder = False


def pytest_collection_modifyitems(items):
    """Put tests into order; those of one file stay together as they are."""
    items.sort(key=lambda item: find_rank(item.path))


def find_rank(path):
    """Return the place of a file in FIRST, behind all of them if it is not there."""
    parts = [path, *path.parents]
    return next((k for k, name in enumerate(FIRST) if HERE / name in parts), len(FIRST))
