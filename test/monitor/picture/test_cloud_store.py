# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The corridor as far as it is known, while another thread looks at it."""

import sys
import threading
import time

import numpy as np
from stream_pieces import Source

from plc_inspect.monitor.picture.cloud_store import CloudStore
from plc_inspect.stream.blocks import read_cloud


def test_profiles_are_cut_out_while_blocks_come_and_go():
    source, store, failures = Source(), CloudStore(), []
    points = np.random.default_rng(0).uniform(0.0, [400.0, 20.0, 20.0], (2000, 3))
    message, end = read_cloud(source.cloud(1.0, points)), time.monotonic() + 1.5

    def cut_out():
        while time.monotonic() < end and not failures:
            try:
                store.cut_out(np.zeros(3), np.array([400.0, 0.0, 0.0]), 6.0)
            except (KeyError, RuntimeError, ValueError) as error:
                failures.append(error)

    thread, before = threading.Thread(target=cut_out), sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        thread.start()
        while thread.is_alive():
            store.put(message)
            store.clear()
    finally:
        sys.setswitchinterval(before)
        thread.join()
    assert not failures
    store.put(message)
    points, *_ = store.cut_out(np.zeros(3), np.array([400.0, 0.0, 0.0]), 6.0)
    assert len(points) > 100
