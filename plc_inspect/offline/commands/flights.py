# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""``plc_replay`` over many recordings: each flight by itself, and an index page."""

import argparse
from collections.abc import Iterable, Iterator, Mapping, Sequence
import dataclasses
import glob
from pathlib import Path
import shutil
import sys
from typing import Any, TYPE_CHECKING

from plc_inspect import __version__
from plc_inspect.errors import ConfigError, DataError
from plc_inspect.offline.commands.command_line import BAD_INPUT, DEFECT, DONE, show_progress
from plc_inspect.offline.commands.grid import (
    check_numbers,
    choose_memory,
    choose_workers,
    tell_dashboard,
)
from plc_inspect.offline.readers.bags import find_recordings
from plc_inspect.printable import check_name, make_one_line, make_printable

if TYPE_CHECKING:
    from plc_inspect.config import Settings
    from plc_inspect.grid.engine import Task
    from plc_inspect.offline.commands.request import Request

FLIGHTS = 'flights'
STAGE = 'flight'
REPLAY_BYTES = 2e9
"""
Memory that the replay of a flight needs, at most [bytes].
Source: judgement: that of bags/demo took 0.6 GB; a long flight has a larger map.
"""


def are_many(arguments: argparse.Namespace) -> bool:
    """Return whether many recordings are named: more than one, a pattern, or a folder of them."""
    items = arguments.bags
    options = arguments.workers, arguments.scheduler, arguments.memory
    if len(items) > 1 or any(option is not None for option in options):
        return True
    path = Path(items[0])
    if not path.exists():
        return glob.has_magic(items[0])
    return path.is_dir() and find_recordings(path) not in ([path], [])


def expand_flights(items: Sequence[str], folder: Path | None = None) -> list[Path]:
    """
    Find the recordings that arguments name.

    A search, of a folder or by a pattern, passes over results: what lies in ``folder``, and
    folders with a ``run.json``.

    Parameters
    ----------
    items : sequence of str
        Recordings, folders (searched at any depth), patterns.
    folder : Path or None
        Results folder of the run.

    Returns
    -------
    list of Path
        Each once: in the order of the arguments, and by name within each.

    Raises
    ------
    DataError
        There is no such file, its name is not UTF-8, or a folder or pattern holds no recording.

    """
    found: dict[Path, None] = {}
    for item in items:
        path = Path(item)
        if not path.exists():
            names = sorted(glob.glob(item, recursive=True)) if glob.has_magic(item) else []
            if not names:
                raise DataError(
                    f'{item} ' + ('matches no file' if glob.has_magic(item) else 'does not exist')
                )
            searched = [flight for name in names for flight in find_recordings(Path(name))]
        else:
            searched = [] if path.is_file() else find_recordings(path)
        own = [flight for flight in searched if not _is_result(flight, folder)]
        own += [path] if path.is_file() else []
        if not own:
            raise DataError(f'{item} holds no recording: none ends in .mcap, .db3 or .bag')
        for flight in own:
            check_name(flight)
        found |= dict.fromkeys(flight.resolve() for flight in own)
    return list(found)


def _is_result(path: Path, folder: Path | None) -> bool:
    """Tell whether a recording is one that a run wrote, as results.mcap."""
    home = path if path.is_dir() else path.parent
    is_in_out = folder is not None and folder.resolve() in path.resolve().parents
    return is_in_out or (home / 'run.json').is_file()


def name_flights(
    paths: Iterable[Path], known: Mapping[str, str] | None = None
) -> dict[str, Path]:
    """Return recordings by the names of their results folders: those known, or made unique."""
    names = {path: name for name, path in (known or {}).items()}
    wanted = list(paths)
    named = {names[str(path)]: path for path in wanted if str(path) in names}
    for path in wanted:
        if str(path) in names:
            continue
        name, number = path.stem if path.is_file() else path.name, 1
        own = name
        while own in named:
            number += 1
            own = f'{name}_{number}'
        named[own] = path
    return named


def check_flights(arguments: argparse.Namespace) -> None:
    """Raise ConfigError if options conflict with many recordings."""
    for name, option in (('baseline', '--baseline'), ('origin', '--origin')):
        if getattr(arguments, name):
            raise ConfigError(f'{option} is for a single flight, not for many')
    check_numbers(arguments, ('workers', 'memory'))


def replay_flight(
    source: str, place: str, settings: 'Settings', request: 'Request'
) -> dict[str, Any]:
    """
    Replay one recording into a results folder of its own, in place of an older one.

    Returns
    -------
    dict
        Figures for the ledger and the index page.

    """
    from plc_inspect.offline.commands.flight_run import replay
    from plc_inspect.offline.commands.request import complete
    from plc_inspect.offline.export.files import measure_peak_memory
    from plc_inspect.offline.export.results_folder import write_results
    from plc_inspect.offline.terminal.losses import describe_losses

    inspection = complete(replay(Path(source), settings, rules=request.rules), request)
    folder = Path(place)
    folder.parent.mkdir(parents=True, exist_ok=True)
    write_results(folder, inspection, True, request.paper)
    result = inspection.result
    groups: dict[int, list[float]] = {}
    for span in result.spans:
        groups.setdefault(span.span_id, []).append(span.length)
    return {
        'num_points': result.num_points, 'num_lines': result.num_lines,
        'num_spans': len(result.spans), 'num_supports': len(result.supports),
        'kilometres': sum(sum(own) / len(own) for own in groups.values()) / 1000.0,
        'held_back': inspection.counts['held_back'],
        'losses': describe_losses(inspection).splitlines(),
        'peak_memory': measure_peak_memory(),
    }


def run_flights(
    arguments: argparse.Namespace, settings: 'Settings', request: 'Request'
) -> int:
    """
    Replay many recordings, without those already replayed.

    Returns
    -------
    int
        0 done, 2 if a flight could not be replayed, 1 if one failed by a defect.

    Raises
    ------
    PlcInspectError
        No recording is found, or the folder holds something else.

    """
    from plc_inspect.grid.engine import open_engine
    from plc_inspect.grid.flights_page import write_flights
    from plc_inspect.grid.grid_folder import (
        check_all_named,
        check_grid_folder,
        LEDGER_FILES,
        LOG,
        open_grid_folder,
    )
    from plc_inspect.grid.ledger_table import TABLE, write_ledger_table
    from plc_inspect.grid.run import GridOptions, GridRun
    from plc_inspect.grid.survey_grid import log_too
    from plc_inspect.whole_files import check_outside

    folder = arguments.output
    paths = expand_flights(arguments.bags, folder)
    check_outside(paths, folder)
    files = (*LEDGER_FILES, TABLE, LOG, 'run.json', 'index.html', FLIGHTS)
    check_grid_folder(folder, files)
    memory = choose_memory(arguments, has_tiles=False)
    num_workers = choose_workers(arguments, len(paths), memory or REPLAY_BYTES)
    with (
        open_engine(num_workers, arguments.scheduler, memory) as engine,
        show_progress(arguments.quiet, time_left=True) as progress,
        open_grid_folder(folder, arguments.force, files) as ledger,
    ):
        tell_dashboard(engine, arguments.quiet)
        known = ledger.find_fact(FLIGHTS) or {}
        check_all_named(folder, [
            path for name, path in known.items() if _find_result(folder, name).is_file()
        ], paths)
        named = name_flights(paths, known)
        ledger.keep_fact(FLIGHTS, {name: str(path) for name, path in named.items()})
        for name in ('index.html', TABLE):  # outdated from here on
            (folder / name).unlink(missing_ok=True)
        run = GridRun(
            folder=folder, settings=settings, rules=request.rules, options=GridOptions(),
            engine=engine, ledger=ledger,
            tell=log_too(folder / LOG, lambda step, done, total, failed: progress(
                f'{step} {done}/{total}', done / max(total, 1)
            )),
        )
        tasks = list(_make_tasks(named, folder, settings, request))
        for task in tasks:
            if not _find_result(folder, task.name).is_file():
                ledger.forget(STAGE, task.name)
        answers = run.run(STAGE, tasks, {
            task.name: _make_key(named[task.name], settings, request) for task in tasks
        })
        failures = [
            (name, f'{error}; its earlier result is kept'
             if _find_result(folder, name).is_file() else error)
            for _, name, error in ledger.list_failures()
        ]
        missing = write_ledger_table(ledger, folder, settings)
    for path in (folder / FLIGHTS).iterdir() if (folder / FLIGHTS).is_dir() else ():
        if path.name not in named:
            shutil.rmtree(path)
    failures += [(name, answer['held_back']) for name, answer in sorted(answers.items())
                 if answer['held_back']]
    totals = write_flights(folder, FLIGHTS, named, answers, failures)
    if not arguments.quiet:
        if missing:
            print(f'note: {missing}\n')
        print(', '.join(f'{value} {name}' for name, value in totals.items()))
        print(make_printable(f'\nreport: {folder / "index.html"}'))
    for name, error in failures:
        print(make_one_line(f'plc_replay: {name}: {error}'), file=sys.stderr)
    if failures:
        return DEFECT if run.num_defects else BAD_INPUT
    return DONE


def _find_result(folder: Path, name: str) -> Path:
    """Return the path of a file that a flight has once it is replayed."""
    return folder / FLIGHTS / name / 'run.json'


def _make_tasks(
    named: dict[str, Path], folder: Path, settings: 'Settings', request: 'Request'
) -> Iterator['Task']:
    from plc_inspect.grid.engine import Task

    for name, path in named.items():
        yield Task(name=name, function=replay_flight, arguments=(
            str(path), str((folder / FLIGHTS / name).absolute()), settings, request,
        ))


def _make_key(path: Path, settings: 'Settings', request: 'Request') -> str:
    """Return a digest of everything that requires replaying a flight again."""
    from plc_inspect.grid.ledger import make_key

    files = sorted(path.rglob('*')) if path.is_dir() else [path]
    stamps = [
        [str(item), item.stat().st_size, item.stat().st_mtime_ns] for item in files
        if item.is_file()
    ]
    return make_key(__version__, stamps, dataclasses.asdict(settings), repr(request))
