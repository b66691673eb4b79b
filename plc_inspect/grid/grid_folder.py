# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The results folder of a grid, or of many flights, in which one run works at a time."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
import errno
from pathlib import Path
import shutil

from plc_inspect import __version__
from plc_inspect.errors import DataError
from plc_inspect.grid.ledger import Ledger
from plc_inspect.grid.ledger_table import TABLE
from plc_inspect.grid.results import TILE_FOLDER
from plc_inspect.grid.run import WORK
from plc_inspect.grid.tiles.tile_job import CELLS
from plc_inspect.offline.export.file_names import LEDGER
from plc_inspect.printable import check_name
from plc_inspect.whole_files import find_target, sweep_partial

LOG = 'progress.log'
LEDGER_FILES = (LEDGER, f'{LEDGER}-wal', f'{LEDGER}-shm', f'{LEDGER}-journal')
FILES = (
    *LEDGER_FILES, TABLE, LOG, 'run.json',
    'spans.json', 'spans.csv', 'supports.json', 'supports.csv', 'hazards.json', 'hazards.csv',
    'grid.gpkg', 'changes.json', 'index.html', WORK, TILE_FOLDER,
)
"""Files of a results folder of a grid."""
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)
"""Errors that say that nothing can be written, and not where."""


def check_grid_folder(folder: Path, files: Sequence[str] = FILES) -> None:
    """
    Raise DataError unless a grid can be written to, or resumed in, a folder with a name in UTF-8.

    Its folder holds ``files``, what a killed run left of them half-written, and nothing else.
    """
    check_name(folder)
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise DataError(f'{folder} exists and is not a folder')
    if not folder.exists():
        return
    held = {item.name for item in folder.iterdir()}
    foreign = sorted(name for name in held if (find_target(name) or name) not in files)
    if held and (foreign or LEDGER not in held):
        raise DataError(
            f'{folder} holds no grid that can be resumed: {(foreign or sorted(held))[0]}'
            ' is not one of its files; name another folder'
        )


@contextmanager
def open_grid_folder(
    folder: Path, force: bool, files: Sequence[str] = FILES
) -> Iterator[Ledger]:
    """
    Open a folder for one run, free of what a killed one left half-written.

    Parameters
    ----------
    folder : Path
        Made if it is missing.
    force : bool
        Remove an earlier grid.
    files : sequence of str
        What the folder may hold.

    Yields
    ------
    Ledger
        Locked against other runs until the end of the block.

    Raises
    ------
    DataError
        The folder holds something else or cannot be written, or another run works in it.

    """
    check_grid_folder(folder, files)
    with _make_folder(folder), Ledger(folder, __version__, force) as ledger:
        if force:
            _empty(folder, files)
        for place in (folder, *(folder / name for name in files if name != WORK)):
            if place.is_dir():
                for own in (place, *filter(Path.is_dir, place.iterdir())):
                    sweep_partial(own)
        yield ledger


def check_all_named(folder: Path, held: Sequence[str], paths: Sequence[Path]) -> None:
    """Raise DataError if results of inputs that are held would be lost: they are not named."""
    named = {str(path) for path in paths}
    lost = [path for path in held if path not in named]
    if lost:
        raise DataError(
            f'{folder} holds results of {len(lost)} of {len(held)} inputs that are not named any'
            f' more, as {lost[0]}: name them as well, or another folder; --force begins anew'
        )


def _empty(folder: Path, files: Sequence[str]) -> None:
    """Remove all but the ledger, which is locked."""
    for name in files:
        path = folder / name
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        elif name not in LEDGER_FILES:
            path.unlink(missing_ok=True)


@contextmanager
def _make_folder(folder: Path) -> Iterator[None]:
    """Make the folder; remove it if an error leaves nothing in it that a run could go on with."""
    is_new = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    try:
        yield
    except (DataError, OSError) as error:
        kept = *(folder / WORK / CELLS).glob('s*'), *folder.glob('*/*/run.json')
        if is_new and not kept:
            shutil.rmtree(folder, ignore_errors=True)
        if isinstance(error, OSError) and error.errno in NO_ROOM:
            raise DataError(f'{folder} cannot be written: {error.strerror}') from error
        raise
