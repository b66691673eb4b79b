# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import importlib
import math
from pathlib import Path
import sys
from types import SimpleNamespace

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / 'bench'))
Probe = importlib.import_module('node_load').Probe
sys.path.pop(0)


def test_results_of_another_clock_begin_anew():
    """Results that are held back bear the node's clock, years after that of a recording."""
    probe = Probe.__new__(Probe)
    probe._read, probe._offset, probe._newest = lambda message: np.zeros(1), 0.0, None
    probe._period = 1.0
    probe.latency, probe.rows = [], []
    for stamp, num in ((1000, 1), (1003, 4), (1003, 4), (1003 + 600, 5)):
        probe._on_catenaries(SimpleNamespace(header=SimpleNamespace(
            stamp=SimpleNamespace(sec=stamp, nanosec=0))))
        assert len(probe.latency) == num
    assert all(math.isfinite(late) for _, late in probe.latency)
