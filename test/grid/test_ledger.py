# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The ledger of a grid names what is wrong with its file, whatever is asked of it."""

import pytest

from plc_inspect.errors import DataError
from plc_inspect.grid.ledger import Ledger

FACTS = {'long': 'x' * 100_000}


def test_a_full_disk_is_told(tmp_path):
    with Ledger(tmp_path, '1') as ledger:
        ledger.keep_fact('kept', 1)
        ledger.number_sources(['/a.las'])
        ledger._database.execute('PRAGMA max_page_count = 8')
        message = rf'^{tmp_path}/ledger.sqlite cannot be written: database or disk is full$'
        for enter in (
            lambda: ledger.keep_fact('more', FACTS),
            lambda: ledger.keep_task('cut', 'a', 'key', FACTS),
            lambda: ledger.describe_source('/a.las', error=FACTS['long']),
            lambda: ledger.number_sources([f'/{number}' * 50 for number in range(1000)]),
        ):
            with pytest.raises(DataError, match=message):
                enter()
        assert ledger.number_sources(['/a.las']) == {'/a.las': 0}
    with Ledger(tmp_path, '1') as ledger:
        assert ledger.find_fact('kept') == 1
        assert ledger.find_fact('more') is None
        assert ledger.find_task('cut', 'a') is None


def test_a_page_that_is_damaged_is_told(tmp_path):
    with Ledger(tmp_path, '1') as ledger:
        ledger.keep_fact('long', FACTS)
    path = tmp_path / 'ledger.sqlite'
    content = bytearray(path.read_bytes())
    content[4096:8192] = b'x' * 4096
    path.write_bytes(content)
    with (
        Ledger(tmp_path, '1') as ledger,
        pytest.raises(DataError, match=r'is damaged: .*malformed; --force begins anew$'),
    ):
        ledger.find_fact('long')
    with Ledger(tmp_path, '1', is_new=True) as ledger:
        assert ledger.find_fact('long') is None
