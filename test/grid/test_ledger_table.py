# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

from grid.grids import make_line, write_las
from pyarrow import parquet

from plc_inspect.config import Settings
from plc_inspect.grid import ledger_table
from plc_inspect.grid.ledger import Ledger
from plc_inspect.grid.ledger_table import TABLE, write_ledger_table
from plc_inspect.offline.commands.survey import main


def test_failures_are_rows_with_their_errors(tmp_path):
    with Ledger(tmp_path, '1.2') as ledger:
        ledger.number_sources(['/a.las', '/b.las'])
        ledger.describe_source('/a.las', 10, 'abc')
        ledger.describe_source('/b.las', error='is truncated')
        ledger.keep_task('tile', 'x1', 'key', {'num_read': 7, 'halo': 500.0}, seconds=2.5)
        ledger.keep_task('tile', 'x2', 'key', None, 'no memory')
        assert write_ledger_table(ledger, tmp_path, Settings()) == ''
    rows = parquet.read_table(tmp_path / TABLE).to_pylist()
    told = [(row['stage'], row['name'], row['state'], row['error'] or '') for row in rows]
    assert told == [
        ('input', '/a.las', 'done', ''), ('input', '/b.las', 'failed', 'is truncated'),
        ('tile', 'x1', 'done', ''), ('tile', 'x2', 'failed', 'no memory'),
    ]
    assert (rows[0]['num_points'], rows[0]['sha256']) == (10, 'abc')
    assert (rows[2]['num_read'], rows[2]['halo'], rows[2]['seconds']) == (7, 500.0, 2.5)
    assert rows[3]['num_read'] is None


def test_what_cannot_be_written_is_said(tmp_path, monkeypatch, capfd):
    """Without pyarrow the table of an earlier run does not stay, and the run says so."""
    halves = [write_las(tmp_path / f'{name}.las', make_line(1)[begin::2])
              for begin, name in enumerate('ab')]
    arguments = [*map(str, halves), '-o', str(tmp_path / 'out')]
    assert main(arguments) == 0
    assert 'pyarrow' not in capfd.readouterr().out
    assert (tmp_path / 'out' / TABLE).is_file()
    monkeypatch.setattr(ledger_table, 'find_spec', lambda name: None)
    assert main(arguments) == 0
    assert ledger_table.NOT_WRITTEN in capfd.readouterr().out
    assert not (tmp_path / 'out' / TABLE).exists()
