# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What all tests start from, and in which order they run."""

from pathlib import Path
import signal

import pytest

# In the background of a shell interrupts are ignored, and programs that tests start would
# inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)

HERE = Path(__file__).parent
FIRST = (
    'ros/test_processes.py', 'monitor/web/test_flights.py',
    'grid/test_survey_grid.py', 'bench/test_bench.py', 'offline/commands/test_tune.py',
    'core/live/test_warm_up.py', 'test_scenes.py', 'core/setup/test_steady_fit.py',
    'core/explain/test_point.py', 'sim/random_scenes',
    'security', 'monitor/web/test_page.py', 'offline/report/test_browser.py',
    'ros/node/test_faults.py', 'grid/test_interrupts.py', 'ros', 'grid', 'bench',
)
"""
Files and folders in the order in which they are begun, those not named after them.

The longest come first, so that all workers end together: while nodes in processes of their own
wait for real time to pass, the other workers compute, and nodes of more tests come after that.
The kernels are compiled before (``make tests``), or each worker would compile what others do.
"""

OVER_DDS = ('ros', 'monitor', 'security')
"""
Folders of tests with nodes and deadlines: where a busy machine loses a scan for them they are
done again, twice at most.
"""


def pytest_configure(config):
    """Keep xdist from an order of its own: files with the most tests first."""
    config.option.loadscopereorder = False


def pytest_collection_modifyitems(items):
    """Put tests into order; those of one file stay together as they are."""
    items.sort(key=lambda item: find_rank(item.path))
    for item in items:
        if any(HERE / name in item.path.parents for name in OVER_DDS):
            item.add_marker(pytest.mark.flaky(reruns=2))


def find_rank(path):
    """Return the place of a file in FIRST, that behind all where it is not named."""
    parts = [path, *path.parents]
    ranks = [rank for rank, name in enumerate(FIRST) if HERE / name in parts]
    return min(ranks, default=len(FIRST))


@pytest.fixture(scope='session', autouse=True)
def _home(tmp_path_factory):
    """Keep results and records that have no place of their own out of the user's home."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_HOME', str(tmp_path_factory.mktemp('ros_home')))
        yield
