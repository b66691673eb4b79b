# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What the flags of a voxel's changes mean, and how they lie in memory."""

import numpy as np

TOUCHED = np.uint8(1)
"""Points were added, or the voxel was removed.  Source: numerical: one bit each."""
MADE = np.uint8(2)
"""The slot holds another voxel.  Source: numerical: one bit each."""
LABELLED = np.uint8(4)
"""The label changed.  Source: numerical: one bit each."""
LANES = 8
"""Slots whose changes are examined together.  Source: numerical: bytes of a word."""
