# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The ledger of a grid: finished tasks with what they depend on, and failures; an SQLite file."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, ExitStack
import hashlib
import json
from pathlib import Path
import sqlite3
from typing import Any, Self

from plc_inspect.errors import DataError
from plc_inspect.offline.export.results_folder import LEDGER

DONE, FAILED = 'done', 'failed'
_TABLES = """
CREATE TABLE IF NOT EXISTS fact (name TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS source (
  path TEXT PRIMARY KEY, number INTEGER UNIQUE NOT NULL, num_points INTEGER, sha256 TEXT,
  error TEXT);
CREATE TABLE IF NOT EXISTS task (
  stage TEXT NOT NULL, name TEXT NOT NULL, key TEXT NOT NULL, state TEXT NOT NULL,
  version TEXT NOT NULL, finished TEXT NOT NULL, seconds REAL, worker TEXT, error TEXT,
  answer TEXT, PRIMARY KEY (stage, name));
"""
_DROP = 'DROP TABLE IF EXISTS fact; DROP TABLE IF EXISTS source; DROP TABLE IF EXISTS task;'


class _Damaged(DataError):
    """The file is no database."""


class Ledger:
    """
    The ledger of one grid; one process writes it.

    A context manager.  Each call returns when its entry is on disk.
    """

    def __init__(self, folder: Path, version: str, is_new: bool = False) -> None:
        """Open the ledger in an existing folder, or a new one in place of what it holds."""
        self._version = version
        self._file = folder / LEDGER
        try:
            self._open(is_new)
        except _Damaged as error:
            if not is_new:
                raise DataError(f'{error}; --force begins anew') from error
            for path in folder.glob(f'{LEDGER}*'):
                path.unlink()
            self._open(is_new)

    def _open(self, is_new: bool) -> None:
        with ExitStack() as opened:
            try:
                self._database = sqlite3.connect(self._file, isolation_level=None, timeout=1.0)
                opened.callback(self._database.close)
                self._database.execute('PRAGMA journal_mode=WAL')
                self._database.execute('PRAGMA locking_mode=EXCLUSIVE')
                self._database.executescript(_DROP + _TABLES if is_new else _TABLES)
            except sqlite3.OperationalError as error:
                if 'locked' in str(error):
                    raise DataError(f'{self._file.parent} is in use by another run') from error
                raise DataError(f'{self._file} cannot be opened: {error}') from error
            except sqlite3.DatabaseError as error:
                raise _Damaged(f'{self._file} is damaged: {error}') from error
            opened.pop_all()

    def __enter__(self) -> Self:
        """Return the ledger."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close it."""
        self._database.execute('PRAGMA locking_mode=NORMAL')
        self._database.execute('SELECT COUNT(*) FROM fact').fetchone()
        self._database.close()

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """Make all entries of the block in one transaction."""
        self._database.execute('BEGIN')
        try:
            yield
        except BaseException:
            self._database.execute('ROLLBACK')
            raise
        self._database.execute('COMMIT')

    def find_fact(self, name: str) -> Any:
        """Return a fact of the grid, None where it is not known."""
        row = self._database.execute('SELECT value FROM fact WHERE name = ?', (name,)).fetchone()
        return None if row is None else json.loads(row[0])

    def keep_fact(self, name: str, value: Any) -> None:
        """Enter a fact of the grid, JSON-serialisable."""
        self._database.execute(
            'INSERT OR REPLACE INTO fact VALUES (?, ?)', (name, json.dumps(value))
        )

    def number_sources(self, paths: Sequence[str]) -> dict[str, int]:
        """Return the numbers of inputs: known inputs keep theirs, new ones follow."""
        known = dict(self._database.execute('SELECT path, number FROM source'))
        following = 1 + max(known.values(), default=-1)
        with self.at_once():
            for path in paths:
                if path not in known:
                    known[path] = following
                    following += 1
                    self._database.execute(
                        'INSERT INTO source (path, number) VALUES (?, ?)', (path, known[path])
                    )
        return {path: known[path] for path in paths}

    def describe_source(
        self, path: str, num_points: int | None = None, sha256: str = '', error: str = ''
    ) -> None:
        """Enter what is known of an input; arguments left out keep their old value."""
        self._database.execute(
            'UPDATE source SET num_points = COALESCE(?, num_points), '
            "sha256 = COALESCE(NULLIF(?, ''), sha256), error = ? WHERE path = ?",
            (num_points, sha256, error, path),
        )

    def find_task(self, stage: str, name: str) -> tuple[str, dict[str, Any]] | None:
        """Return key and answer of a finished task, None if it is not finished."""
        row = self._database.execute(
            'SELECT key, answer FROM task WHERE stage = ? AND name = ? AND state = ?',
            (stage, name, DONE),
        ).fetchone()
        return None if row is None else (row[0], json.loads(row[1]))

    def keep_task(
        self, stage: str, name: str, key: str, answer: dict[str, Any] | None, error: str = '',
        *, seconds: float = 0.0, worker: str = '',
    ) -> None:
        """Enter a finished task, or a failed one, whose answer is None."""
        self._database.execute(
            'INSERT OR REPLACE INTO task VALUES '
            "(?, ?, ?, ?, ?, strftime('%Y-%m-%dT%H:%M:%SZ', 'now'), ?, ?, ?, ?)",
            (stage, name, key, FAILED if answer is None else DONE, self._version, seconds, worker,
             error, json.dumps(answer)),
        )

    def forget(self, stage: str, name: str) -> None:
        """Forget a task."""
        self._database.execute('DELETE FROM task WHERE stage = ? AND name = ?', (stage, name))

    def drop_others(self, stage: str, names: Sequence[str]) -> list[str]:
        """Forget the tasks of a stage that are not named, and return their names."""
        known = {row[0] for row in self._database.execute(
            'SELECT name FROM task WHERE stage = ?', (stage,)
        )}
        others = sorted(known - set(names))
        with self.at_once():
            for name in others:
                self._database.execute(
                    'DELETE FROM task WHERE stage = ? AND name = ?', (stage, name)
                )
        return others

    def list_entries(self) -> list[dict[str, Any]]:
        """Return all inputs, then all tasks, as mappings from column to value."""
        sources = self._read(
            "SELECT 'input' AS stage, path AS name, num_points, sha256, error, "
            "CASE WHEN COALESCE(error, '') = '' THEN ? ELSE ? END AS state "
            'FROM source ORDER BY number', DONE, FAILED,
        )
        return [*sources, *self._read('SELECT * FROM task ORDER BY stage, name')]

    def _read(self, query: str, *values: str) -> list[dict[str, Any]]:
        cursor = self._database.execute(query, values)
        names = [column[0] for column in cursor.description]
        return [dict(zip(names, row, strict=True)) for row in cursor]

    def list_failures(self) -> list[tuple[str, str, str]]:
        """Return stage, name and error of all tasks that failed."""
        return list(self._database.execute(
            'SELECT stage, name, error FROM task WHERE state = ? ORDER BY stage, name', (FAILED,)
        ))


def make_key(*parts: Any) -> str:
    """Return a digest of plain values."""
    text = json.dumps(parts, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()
