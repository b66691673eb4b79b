# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Tasks that workers of other processes import."""

import os
import time

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
