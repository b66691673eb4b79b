# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Power line inspection from LiDAR: conductors, corridor and hazards."""

import os

__version__ = '0.1.0'

# Threads of libgomp that wait spin for a moment and then sleep: spinning on, beside other
# processes, they keep the thread they wait for from its core.  Low voltage of bench/table2.py on
# two cores, one of them busy: 0.35 s as libgomp does it, 0.25 s so; with both free 0.16 s, and
# 0.17 s without spinning.  libgomp reads it once, when numba loads it.
if 'OMP_WAIT_POLICY' not in os.environ:
    os.environ.setdefault('GOMP_SPINCOUNT', '2000')
