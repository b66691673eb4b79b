# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Writes a results folder atomically."""

from collections.abc import Sequence
import os
from pathlib import Path

from plc_inspect.errors import DataError
from plc_inspect.offline.export.file_names import BEFORE, FILES, OPTIONAL_FILES
from plc_inspect.offline.records.inspection import Inspection
from plc_inspect.whole_files import check_folder, check_outside, replace_folder


def check_results(
    folder: Path, force: bool = False, inputs: Sequence[Path] = ()
) -> None:
    """
    Raise DataError unless a results folder can be written at ``folder``.

    An existing folder needs ``force`` and may hold only the files of a results folder, because
    no other file is ever removed.  None of the inputs may lie in it.
    """
    check_outside(inputs, folder)
    check_folder(folder, force)
    if folder.exists():
        foreign = _list_foreign(folder)
        if foreign:
            raise DataError(
                f'{folder} is not replaced: it holds {len(foreign)} files that are not results,'
                f' such as {foreign[0]}'
            )
    ancestor = folder.absolute().parent
    while not ancestor.exists():
        ancestor = ancestor.parent
    if not ancestor.is_dir() or not os.access(ancestor, os.W_OK | os.X_OK):
        raise DataError(f'{folder} cannot be written: no permission to write in {ancestor}')


def _list_foreign(folder: Path) -> list[str]:
    """Return the names of what is in a folder and no result, ascending."""
    names, number = {item.name for item in folder.iterdir()}, 1
    found = names - {*FILES, *OPTIONAL_FILES}
    while (before := BEFORE.format(number)) in names and (folder / before).is_dir():
        found = found - {before} | {f'{before}/{name}' for name in _list_foreign(folder / before)}
        number += 1
    return sorted(found)


def write_results(
    folder: Path, inspection: Inspection, force: bool = False, paper: str = '', *,
    tables_only: bool = False,
) -> None:
    """
    Write the results folder of one run.

    It is written under a temporary name and then renamed, so ``folder`` is never incomplete; an
    old folder is replaced only when the new one is complete.

    Parameters
    ----------
    folder : Path
        Its path; missing parents are created.
    inspection : Inspection
        The run.
    force : bool
        Replace an existing results folder.
    paper : str
        Size of the paper on which the report is printed as well, one of `paper.SIZES`; '' not.
    tables_only : bool
        Write JSON and CSV alone, for where there is no room for more.

    Raises
    ------
    DataError
        The folder exists and ``force`` is not given, or it cannot be written.

    """
    from plc_inspect.offline.export.files import write_files, write_tables  # loads all formats
    from plc_inspect.offline.report.paper import print_report
    from plc_inspect.offline.report.report import render_report

    check_results(folder, force)
    with replace_folder(folder, lambda: check_results(folder, force)) as aside:
        if tables_only:
            write_tables(aside, inspection)
            return
        write_files(aside, inspection)
        for number, earlier in enumerate(inspection.earlier, 1):
            before = aside / BEFORE.format(number)
            before.mkdir()
            write_files(before, earlier)
        if paper:
            print_report(
                lambda own: render_report(inspection, paper=own), paper, aside / 'report.pdf'
            )
