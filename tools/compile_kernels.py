#!/usr/bin/env python3
# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Compiles the kernels that are not on disk yet, on two cores."""

import multiprocessing
import sys
import time

import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.coverage.seen_ground import see_ground
from plc_inspect.core.live.warm_up import make_sample, warm_up_intake, warm_up_pipeline


def main() -> int:
    """Run all of them once."""
    began = time.monotonic()
    intake = multiprocessing.get_context('spawn').Process(target=warm_up_intake)
    intake.start()
    for rare in (False, True):
        warm_up_pipeline(Settings(), rare=rare)
    points = make_sample()
    see_ground(points, np.zeros(len(points), dtype=np.bool_))
    intake.join()
    print(f'kernels: ready after {time.monotonic() - began:.0f} s')
    return int(intake.exitcode != 0)


if __name__ == '__main__':
    sys.exit(main())
