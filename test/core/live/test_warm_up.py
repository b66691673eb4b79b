# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""After the warm-up a flight has nothing to load, or even to compile."""

import os
from pathlib import Path
import subprocess
import sys

import pytest

from plc_inspect.config import Settings
from plc_inspect.core.live.warm_up import warm_up_pipeline

ROOT = Path(__file__).parents[3]
FLIGHT = """
import importlib
from pathlib import Path
import pkgutil
import sys

from common.flown_ticks import fly_along
from numba.core.dispatcher import Dispatcher
import numpy as np
from common.surveys import make_map

from plc_inspect import core
from plc_inspect.config import Settings
from plc_inspect.core.live.warm_up import warm_up_intake, warm_up_pipeline


def list_kernels():
    modules = [
        importlib.import_module(item.name)
        for item in pkgutil.walk_packages(core.__path__, 'plc_inspect.core.')
    ]
    assert len(modules) > 90, len(modules)
    kernels = {
        f'{module.__name__}.{name}{signature}'
        for module in modules for name, item in vars(module).items()
        if isinstance(item, Dispatcher) for signature in item.signatures
    }
    assert len(kernels) > 100, len(kernels)
    return kernels


warm_up_intake()
warm_up_pipeline(Settings())
warm_up_pipeline(Settings(), rare=True)
before = list_kernels()
points = make_map(Path(sys.argv[1]), 'low_voltage', density=20.0).points
num_ticks = sum(1 for _ in fly_along(points, np.random.default_rng(0)))
for kernel in sorted(list_kernels() - before):
    print('new:', kernel)
print('ticks:', num_ticks)
"""
ASSIGNMENT = """
import sys

from plc_inspect.config import Settings
from plc_inspect.core.live.warm_up import warm_up_pipeline
import plc_inspect.ros.node.onboard
import plc_inspect.ros.node.inspect_node

known = ('scipy.optimize', 'scipy.special', 'scipy.spatial')
print(sorted(module for module in known if module in sys.modules))
warm_up_pipeline(Settings(), rare=False)
print(sorted(module for module in known if module in sys.modules))
warm_up_pipeline(Settings(), rare=True)
print(sorted(module for module in known[:2] if module in sys.modules))
"""


def run(program, *arguments):
    """Run a program in a process of its own and return its lines."""
    path = os.pathsep.join([str(ROOT), str(ROOT / 'bench')])
    done = subprocess.run(
        [sys.executable, '-c', program, *arguments], capture_output=True, text=True,
        env=os.environ | {'PYTHONPATH': path}, check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_it_finds_its_lines():
    assert warm_up_pipeline(Settings()) == 6
    assert warm_up_pipeline(Settings(), rare=True) == 10


@pytest.mark.slow
def test_a_flight_meets_nothing_new(tmp_path):
    *new, last = run(FLIGHT, str(tmp_path))
    assert new == []
    assert int(last.removeprefix('ticks: ')) > 15


@pytest.mark.slow
def test_scipy_is_loaded_after_the_start_and_before_it_is_asked():
    assert run(ASSIGNMENT) == ['[]', '[]', "['scipy.optimize', 'scipy.special']"]
