# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Folders that are written whole or not at all."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
import shutil
import tempfile

from plc_inspect.errors import DataError

_SUFFIXES = ('.mcap', '.yaml', '.json', '.laz')


@contextmanager
def open_folder(path: Path, force: bool) -> Iterator[Path]:
    """
    Yield a folder to write into; it becomes ``path`` if the block ends without an error.

    Parameters
    ----------
    path : Path
        The folder to make; its parents are made as well.
    force : bool
        Replace what is there, if it holds nothing but files of a survey.

    Raises
    ------
    DataError
        ``path`` exists and ``force`` is not set, it holds other files, or it cannot be made.

    """
    path = Path(path)
    if path.is_symlink() or (path.exists() and not path.is_dir()):
        raise DataError(f'{path} exists and is not a folder')
    if path.exists() and not force:
        raise DataError(f'{path} exists; --force replaces it')
    if path.exists():
        foreign = sorted({file.name for file in path.iterdir() if file.suffix not in _SUFFIXES})
        if foreign:
            raise DataError(f'{path} is not replaced: it holds {foreign[0]}, which is no survey')
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        aside = Path(tempfile.mkdtemp(prefix=f'.{path.name}.', dir=path.parent))
    except OSError as error:
        raise DataError(f'cannot write {path}: {error.strerror}') from error
    try:
        aside.chmod(0o755)
        yield aside
        if path.exists():
            old = aside.with_name(f'{aside.name}.old')
            path.rename(old)
            aside.rename(path)
            shutil.rmtree(old)
        else:
            aside.rename(path)
    except BaseException:
        shutil.rmtree(aside, ignore_errors=True)
        raise
