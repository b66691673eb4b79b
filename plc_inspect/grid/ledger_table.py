# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The ledger of a grid as one table, ``ledger.parquet``, for programs that read tables."""

from importlib.util import find_spec
import json
from pathlib import Path
from typing import Any

from plc_inspect.config import Settings
from plc_inspect.grid.ledger import Ledger
from plc_inspect.setting_names import to_mapping
from plc_inspect.whole_files import replace_file

TABLE = 'ledger.parquet'
NOT_WRITTEN = f'{TABLE} is not written without pyarrow: pip install plc_inspect[grid]'
"""Note for the user."""
FIGURES = (
    'num_points', 'num_read', 'num_spans', 'num_cut', 'looks', 'peak_memory', 'expected_memory',
)
"""Counts, and memory [bytes], of an answer that get a column of their own."""


def write_ledger_table(ledger: Ledger, folder: Path, settings: Settings) -> str:
    """
    Write all inputs and tasks as rows of one table.

    Parameters
    ----------
    ledger : Ledger
        Of the grid.
    folder : Path
        Takes the file.
    settings : Settings
        Kept beside the table, as JSON.

    Returns
    -------
    str
        Why the table was not written, '' if it was.

    """
    (folder / TABLE).unlink(missing_ok=True)
    if find_spec('pyarrow') is None:
        return NOT_WRITTEN
    import pyarrow
    from pyarrow import parquet

    text, number, count = pyarrow.string(), pyarrow.float64(), pyarrow.int64()
    schema = pyarrow.schema(
        [
            *((name, text) for name in ('stage', 'name', 'state', 'error', 'version', 'key')),
            ('finished', text), ('seconds', number), ('worker', text), ('sha256', text),
            ('halo', number), *((name, count) for name in FIGURES), ('answer', text),
        ],
        metadata={'settings': json.dumps(to_mapping(settings), sort_keys=True)},
    )
    rows = [_lay_row(entry) for entry in ledger.list_entries()]
    with replace_file(folder / TABLE) as aside:
        parquet.write_table(pyarrow.Table.from_pylist(rows, schema=schema), aside)
    return ''


def _lay_row(entry: dict[str, Any]) -> dict[str, Any]:
    answer = json.loads(entry.get('answer') or 'null') or {}
    figures = {name: answer[name] for name in (*FIGURES, 'halo') if name in answer}
    return {'sha256': answer.get('sha256')} | figures | entry
