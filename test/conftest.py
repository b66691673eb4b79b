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
    'core/live/test_warm_up.py',
    'test_architecture.py', 'sim/random_scenes', 'sim/scenes', 'core/numerics', 'core/catenary',
    'core/spans', 'core/hazards', 'core/test_corridor.py', 'sim', 'core/mapping',
    'offline/readers', 'messages', 'stream', 'test_constants.py', 'test_package.py', 'tools',
    'core/loads', 'core/setup', 'core/tracking', 'core/alignment', 'core/voxel_buffer',
    'offline/records', 'offline/report', 'offline/export', 'core/extraction', 'core/clustering',
    'flight_record', 'test_scenes.py', 'bench',
)
WHOLE = (
    'core/catenary/test_conductors.py', 'core/spans/test_crowding.py',
    'core/spans/test_service_drops.py', 'core/hazards/test_surfaces.py',
    'core/alignment/test_rigid_move.py', 'offline/report/test_stage_figures.py',
    'sim/evaluation',
)
LAST = ('ros/test_processes.py', 'monitor/web/test_flights.py', 'monitor/web/test_page.py',
    'ros', 'monitor',
)
"""
Files and folders in the order in which they are begun, those not named between both; WHOLE are
those of FIRST that run the whole pipeline, and wait with those not named.

Where nothing is compiled yet, one process compiles the kernels of the pipeline in the first file,
stage by stage.  The other begins with what needs none of them, then tests the last stages, so that
these are compiled when the first process comes to them; what needs all stages comes after that, so
that nothing is compiled twice.  Nodes in processes of their own come when all is compiled, and the
longest of them first, so that both end together.
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
    """Return the place of a file: by FIRST, 0 where none names it or WHOLE does, by LAST."""
    parts = [path, *path.parents]
    if any(HERE / name in parts for name in WHOLE):
        return 0
    for names, start in ((FIRST, -len(FIRST)), (LAST, 1)):
        for k, name in enumerate(names):
            if HERE / name in parts:
                return start + k
    return 0


@pytest.fixture(scope='session', autouse=True)
def _home(tmp_path_factory):
    """Keep results and records that have no place of their own out of the user's home."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_HOME', str(tmp_path_factory.mktemp('ros_home')))
        yield
