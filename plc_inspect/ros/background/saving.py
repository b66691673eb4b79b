# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Where the node's results go: checked beforehand, and written somewhere whatever happens."""

from dataclasses import dataclass
from pathlib import Path
import time
from typing import TYPE_CHECKING

from plc_inspect.errors import ConfigError, DataError
from plc_inspect.node_config import OutputSettings
from plc_inspect.printable import make_one_line
from plc_inspect.shared_files import find_home

if TYPE_CHECKING:
    from plc_inspect.offline.records.inspection import Inspection


@dataclass(frozen=True, slots=True, kw_only=True)
class Saved:
    """What became of the results."""

    folder: Path | None
    """Where they are, None where nothing could be written."""
    whole: bool
    """All files are there; otherwise the tables (JSON, CSV) at most."""
    problem: str = ''
    """What went wrong, '' if nothing."""

    def describe(self) -> str:
        """Return it in one line."""
        if self.folder is None:
            return f'not saved: {self.problem}'
        what = 'saved' if self.whole else 'saved the tables only'
        return f'{what} to {self.folder}' + (f'; {self.problem}' if self.problem else '')


def check_output(settings: OutputSettings) -> None:
    """
    Check that the results folder of the settings can be written.

    Raises
    ------
    ConfigError
        It is a file, holds what is not ours, or nobody may write there.

    """
    from plc_inspect.offline.export.results_folder import check_results

    if not settings.directory:
        return
    try:
        check_results(Path(settings.directory).expanduser(), force=True)
    except (DataError, OSError, ValueError, RuntimeError) as error:
        raise ConfigError(f'output.directory: {error}') from error


def choose_folder(settings: OutputSettings, stamp_ns: int) -> Path:
    """
    Return where the results go.

    Parameters
    ----------
    settings : OutputSettings
        ``directory``; where it is empty, a new folder below ROS_HOME (~/.ros) is named after the
        time of the first scan.
    stamp_ns : int
        Stamp of the first scan [ns].

    Returns
    -------
    Path

    """
    if settings.directory:
        return Path(settings.directory).expanduser()
    home = find_home()
    name = time.strftime('flight_%Y%m%dT%H%M%SZ', time.gmtime(stamp_ns // 1_000_000_000))
    folder, number = home / name, 1
    while folder.exists():
        number += 1
        folder = home / f'{name}_{number}'
    return folder


def save_results(settings: OutputSettings, stamp_ns: int, inspection: 'Inspection') -> Saved:
    """
    Write the results folder; where it cannot be written, another one, or the tables alone.

    No error leaves this function: the flight is over, and what is not written now is lost.  The
    order is the folder of the settings, a new one below ROS_HOME, then the same two without
    points and report, which need a thousandth of the room.

    Parameters
    ----------
    settings : OutputSettings
        ``directory``.
    stamp_ns : int
        Stamp of the first scan [ns], for the name of a new folder.
    inspection : Inspection
        The run.

    Returns
    -------
    Saved

    """
    wanted = choose_folder(settings, stamp_ns)
    spare = choose_folder(OutputSettings(), stamp_ns)
    problems: list[str] = []
    for tables_only in (False, True):
        for folder in dict.fromkeys((wanted, spare)):
            problem = _try_to_write(folder, inspection, tables_only)
            if not problem:
                return Saved(
                    folder=folder, whole=not tables_only, problem='; '.join(problems),
                )
            if problem not in problems:
                problems.append(problem)
    return Saved(folder=None, whole=False, problem='; '.join(problems))


def _try_to_write(folder: Path, inspection: 'Inspection', tables_only: bool) -> str:
    """Write a results folder and return what went wrong in one line, '' if nothing."""
    from plc_inspect.offline.export.results_folder import write_results

    try:
        write_results(folder, inspection, force=True, tables_only=tables_only)
    except DataError as error:
        return make_one_line(error)
    except BaseException as error:
        # The panic of a library in Rust is no Exception, and no module has its type.
        if not isinstance(error, Exception) and type(error).__name__ != 'PanicException':
            raise
        return f'{folder} cannot be written: {type(error).__name__}: {make_one_line(error)}'
    return ''
