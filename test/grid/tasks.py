# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Tasks that workers of other processes import."""

import logging
import os
import resource
import time

import numba
import numpy as np

from plc_inspect.errors import DataError

DEADLINE = 30.0


def sleep_and_tell(folder, number):
    """Leave a file that names the process, and answer when told so."""
    with open(f'{folder}/{number}.{os.getpid()}', 'w', encoding='ascii'):
        pass
    deadline = time.monotonic() + DEADLINE
    while not os.path.exists(f'{folder}/go') and time.monotonic() < deadline:
        time.sleep(0.02)
    return {'number': number, 'process': os.getpid()}


def fail():
    """Fail by a defect."""
    raise ZeroDivisionError('by zero')


def refuse():
    """Fail by bad data."""
    raise DataError('no such thing')


def fill_twice(num, size):
    """Tell how many pages are mapped while arrays are filled a second time."""
    for _ in range(2):
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        arrays = [np.ones(size, dtype=np.uint8) for _ in range(num)]
        del arrays
    return {'mapped': resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before}


def tell_of_loss():
    """Log as a worker that ends does, which has let go of the level that its handlers had."""
    for handler in logging.getLogger('distributed').handlers:
        handler.setLevel(logging.NOTSET)
    logging.getLogger('distributed.worker').error('the scheduler is lost')
    return {'process': os.getpid()}


def tell_threads():
    """Tell how many threads kernels have here, and in which process."""
    return {'threads': numba.config.NUMBA_NUM_THREADS, 'process': os.getpid()}
