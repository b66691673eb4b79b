# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Power line inspection from LiDAR: conductors, corridor and hazards."""

__version__ = '0.1.0'
