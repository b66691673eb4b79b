# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Write folders and files atomically: completely or not at all.

They are written beside their target and renamed, so they are never seen half-written; an old one
is removed only when the new one is complete.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
import fcntl
import glob
import os
from pathlib import Path
import shutil
import tempfile

from plc_inspect.errors import DataError

PARTIAL = '.partial'
"""Suffix of folders that are being written."""


def check_folder(folder: Path, force: bool) -> None:
    """Raise DataError if a file is in the way, or a folder without ``force``."""
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise DataError(f'{folder} exists and is not a folder')
    if folder.exists() and not force:
        raise DataError(f'{folder} exists; --force replaces it')


def check_outside(paths: Sequence[Path], folder: Path) -> None:
    """Raise DataError if one of the inputs lies in the folder that is to be written."""
    place = folder.resolve()
    for path in paths:
        for own in (path.absolute(), path.resolve()):  # of a link, the file that it leads to
            if place in own.parents or (place == own and own.is_dir()):
                raise DataError(
                    f'{path} lies in {folder}, where the results go: name another folder'
                )


def check_file(path: Path, force: bool) -> None:
    """Raise DataError unless a file can be written at ``path``; one that exists needs force."""
    if path.is_dir():
        raise DataError(f'{path} is a folder')
    if path.exists() and not force:
        raise DataError(f'{path} exists; --force replaces it')
    parent = path.absolute().parent
    if not parent.is_dir() or not os.access(parent, os.W_OK | os.X_OK):
        raise DataError(f'{path} cannot be written: {parent} is not a writable folder')


@contextmanager
def replace_folder(
    folder: Path, check: Callable[[], None] = lambda: None
) -> Iterator[Path]:
    """
    Write a folder; missing parents are made.

    Parameters
    ----------
    folder : Path
        The place.
    check : callable
        Raises DataError if what is there must stay; called when the new folder is complete, as
        another process may have put it there meanwhile.

    Yields
    ------
    Path
        An empty folder, which is renamed to ``folder`` at the end of the block, unless it raised.

    Raises
    ------
    DataError
        It cannot be written.

    """
    place = folder.absolute()
    with _name_errors(folder):
        place.parent.mkdir(parents=True, exist_ok=True)
        with _make_room(place) as room:
            aside, old = room / 'new', room / 'old'
            aside.mkdir()
            yield aside
            check()
            try:
                if place.exists():
                    place.rename(old)
                aside.rename(place)
            except BaseException:
                if old.exists() and not place.exists():
                    old.rename(place)
                raise


@contextmanager
def replace_file(path: Path, check: Callable[[], None] = lambda: None) -> Iterator[Path]:
    """
    Write a file into an existing folder.

    Parameters
    ----------
    path : Path
        The place.
    check : callable
        As for `replace_folder`.

    Yields
    ------
    Path
        Path of a temporary file, which is renamed to ``path`` at the end of the block, unless it
        raised.

    Raises
    ------
    DataError
        It cannot be written.

    """
    place = path.absolute()
    with _name_errors(path), _make_room(place) as room:
        aside = room / place.name
        yield aside
        check()
        aside.replace(place)


@contextmanager
def _make_room(place: Path) -> Iterator[Path]:
    """Yield an empty folder beside a target, on the same file system, locked meanwhile."""
    with tempfile.TemporaryDirectory(
        prefix=f'.{place.name}.', suffix=PARTIAL, dir=place.parent
    ) as room:
        number = os.open(room, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            with suppress(OSError):  # not all file systems can
                fcntl.flock(number, fcntl.LOCK_SH | fcntl.LOCK_NB)
            yield Path(room)
        finally:
            os.close(number)


def find_target(name: str) -> str:
    """Return the name of the file that is half-written as ``name``, '' if it is none such."""
    if not (name.startswith('.') and name.endswith(PARTIAL)):
        return ''
    return name[1 : -len(PARTIAL)].rpartition('.')[0]


def sweep_partial(folder: Path, name: str = '') -> list[Path]:
    """
    Remove half-written leftovers of killed runs, and restore what they had moved away.

    Parameters
    ----------
    folder : Path
        Folder to search; a missing one counts as empty.
    name : str
        Name of the file or folder that was being written, '' any.

    Returns
    -------
    list[Path]
        Removed paths; those that another process holds, or that cannot be removed, stay.

    """
    removed = []
    for room in sorted(folder.glob(f'.{glob.escape(name) or "*"}.*{PARTIAL}')):
        own = name or find_target(room.name)
        with suppress(OSError):
            number = os.open(room, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
            try:
                fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
                place = folder / own
                if (room / 'old').exists() and not place.exists():
                    (room / 'old').rename(place)
                shutil.rmtree(room)
                removed.append(room)
            finally:
                os.close(number)
    return removed


@contextmanager
def _name_errors(path: Path) -> Iterator[None]:
    """Raise system errors as DataError that names the path."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise DataError(f'{path} cannot be written: {reason}') from error
