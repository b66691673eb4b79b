# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Survey folders that are written whole or not at all."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from plc_inspect.errors import DataError
from plc_inspect.whole_files import check_folder, replace_folder

FILES = {'flight.mcap', 'metadata.yaml', 'map.laz', 'truth.json'}
"""Names of the files of a survey: other recordings and clouds are not replaced."""


@contextmanager
def open_folder(path: Path, force: bool) -> Iterator[Path]:
    """
    Yield a folder to write to; it becomes ``path`` if the block ends without an error.

    Parameters
    ----------
    path : Path
        The folder to create, with its parents.
    force : bool
        Replace an existing folder if it holds only files of a survey.

    Raises
    ------
    DataError
        ``path`` exists and ``force`` is not set, it holds other files, or cannot be created.

    """
    path = Path(path)
    _check(path, force)
    with replace_folder(path, lambda: _check(path, force)) as aside:
        yield aside


def _check(path: Path, force: bool) -> None:
    check_folder(path, force)
    if path.exists():
        foreign = sorted({file.name for file in path.iterdir()} - FILES)
        if foreign:
            raise DataError(f'{path} is not replaced: it holds {foreign[0]}, which is no survey')
