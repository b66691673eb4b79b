# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Power line inspection from LiDAR: conductors, corridor and hazards."""

import os

__version__ = '0.1.0'

# Threads of libgomp that wait must sleep: spinning at each barrier, beside other processes, they
# keep the thread they wait for from its core.  It is read once, when numba loads the library.
os.environ.setdefault('OMP_WAIT_POLICY', 'passive')
