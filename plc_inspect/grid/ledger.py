# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The ledger of a grid: finished tasks with what they depend on, and failures; an SQLite file."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, ExitStack, suppress
import hashlib
import json
from pathlib import Path
import sqlite3
from typing import Any, Self

from plc_inspect.errors import DataError
from plc_inspect.offline.export.file_names import LEDGER

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

    A context manager.  Each call returns when its entry is on disk, and raises DataError if it
    cannot be written.
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
        with suppress(sqlite3.Error):  # leaves the log of its last entries, which are kept
            self._database.execute('PRAGMA locking_mode=NORMAL')
            self._database.execute('SELECT COUNT(*) FROM fact').fetchone()
        self._database.close()

    def _ask(self, query: str, *values: Any) -> list[dict[str, Any]]:
        """Return the rows of a query; DataError if the file is damaged or not writable."""
        try:
            cursor = self._database.execute(query, values)
            names = [column[0] for column in cursor.description or ()]
            return [dict(zip(names, row, strict=True)) for row in cursor]
        except sqlite3.OperationalError as error:
            raise DataError(f'{self._file} cannot be written: {error}') from error
        except sqlite3.Error as error:
            raise DataError(f'{self._file} is damaged: {error}; --force begins anew') from error

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """Make all entries of the block in one transaction."""
        self._ask('BEGIN')
        try:
            yield
            self._ask('COMMIT')
        except BaseException:
            with suppress(DataError):  # a full disk has rolled back
                self._ask('ROLLBACK')
            raise

    def find_fact(self, name: str) -> Any:
        """Return a fact of the grid, None where it is not known."""
        rows = self._ask('SELECT value FROM fact WHERE name = ?', name)
        return json.loads(rows[0]['value']) if rows else None

    def keep_fact(self, name: str, value: Any) -> None:
        """Enter a fact of the grid, JSON-serialisable."""
        self._ask('INSERT OR REPLACE INTO fact VALUES (?, ?)', name, json.dumps(value))

    def list_sources(self) -> list[str]:
        """Return the paths of the inputs that were read."""
        return [row['path'] for row in self._ask(
            "SELECT path FROM source WHERE sha256 <> '' ORDER BY number"
        )]

    def number_sources(self, paths: Sequence[str]) -> dict[str, int]:
        """Return the numbers of inputs: known ones keep theirs, new ones follow, others go."""
        known = {row['path']: row['number'] for row in self._ask('SELECT * FROM source')}
        following = 1 + max(known.values(), default=-1)
        with self.at_once():
            for path in sorted(known.keys() - set(paths)):
                self._ask('DELETE FROM source WHERE path = ?', path)
            for path in paths:
                if path not in known:
                    known[path] = following
                    following += 1
                    self._ask(
                        'INSERT INTO source (path, number) VALUES (?, ?)', path, known[path]
                    )
        return {path: known[path] for path in paths}

    def describe_source(
        self, path: str, num_points: int | None = None, sha256: str = '', error: str = ''
    ) -> None:
        """Enter what is known of an input, in place of what was."""
        self._ask(
            'UPDATE source SET num_points = ?, sha256 = ?, error = ? WHERE path = ?',
            num_points, sha256, error, path,
        )

    def find_task(self, stage: str, name: str) -> tuple[str, dict[str, Any]] | None:
        """Return key and answer of a finished task, None if it is not finished."""
        rows = self._ask(
            'SELECT key, answer FROM task WHERE stage = ? AND name = ? AND state = ?',
            stage, name, DONE,
        )
        return (rows[0]['key'], json.loads(rows[0]['answer'])) if rows else None

    def keep_task(
        self, stage: str, name: str, key: str, answer: dict[str, Any] | None, error: str = '',
        *, seconds: float = 0.0, worker: str = '',
    ) -> None:
        """Enter a finished task, or a failed one, whose answer is None."""
        self._ask(
            'INSERT OR REPLACE INTO task VALUES '
            "(?, ?, ?, ?, ?, strftime('%Y-%m-%dT%H:%M:%SZ', 'now'), ?, ?, ?, ?)",
            stage, name, key, FAILED if answer is None else DONE, self._version, seconds, worker,
            error, json.dumps(answer),
        )

    def forget(self, stage: str, name: str) -> None:
        """Forget a task."""
        self._ask('DELETE FROM task WHERE stage = ? AND name = ?', stage, name)

    def drop_others(self, stage: str, names: Sequence[str]) -> list[str]:
        """Forget the tasks of a stage that are not named, and return their names."""
        known = {row['name'] for row in self._ask('SELECT name FROM task WHERE stage = ?', stage)}
        others = sorted(known - set(names))
        with self.at_once():
            for name in others:
                self.forget(stage, name)
        return others

    def list_entries(self) -> list[dict[str, Any]]:
        """Return all inputs, then all tasks, as mappings from column to value."""
        sources = self._ask(
            "SELECT 'input' AS stage, path AS name, num_points, sha256, error, "
            "CASE WHEN COALESCE(error, '') = '' THEN ? ELSE ? END AS state "
            'FROM source ORDER BY number', DONE, FAILED,
        )
        return [*sources, *self._ask('SELECT * FROM task ORDER BY stage, name')]

    def list_failures(self) -> list[tuple[str, str, str]]:
        """Return stage, name and error of all tasks that failed."""
        return [(row['stage'], row['name'], row['error']) for row in self._ask(
            'SELECT stage, name, error FROM task WHERE state = ? ORDER BY stage, name', FAILED
        )]


def make_key(*parts: Any) -> str:
    """Return a digest of plain values."""
    text = json.dumps(parts, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()
