# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Survey a grid, from its inputs to its results folder."""

from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
import time
from typing import Any

from plc_inspect.config import Settings
from plc_inspect.core.hazards.clearance_rules import RuleSet
from plc_inspect.errors import DataError
from plc_inspect.grid.cells.inputs import expand_inputs
from plc_inspect.grid.cells.layout import count_allowed
from plc_inspect.grid.cells.room import open_room
from plc_inspect.grid.cells.sources import read_sources, Refusal, Source
from plc_inspect.grid.engine import Engine
from plc_inspect.grid.grid_folder import check_all_named, LOG, open_grid_folder
from plc_inspect.grid.grid_summary import GridSummary
from plc_inspect.grid.ledger_table import TABLE
from plc_inspect.grid.results import write_grid
from plc_inspect.grid.run import (
    cut_and_plan,
    estimate_memory,
    GridOptions,
    GridRun,
    inspect_tiles,
    renumber,
    Tell,
)
from plc_inspect.grid.tiles.survey_whole import remove_kept
from plc_inspect.grid.tiles.tile_job import TileJob, TILES
from plc_inspect.grid.whole_values import know_whole
from plc_inspect.offline.records.changes import check_systems, is_same_system, Survey
from plc_inspect.offline.records.georeference import require_horizontal
from plc_inspect.printable import make_one_line

LOG_PERIOD = 5.0
"""Seconds between two lines of the log."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GridInputs:
    """Inputs of the survey."""

    items: tuple[str, ...]
    """Files, folders, patterns, tile indices."""
    folder: Path
    crs: str | None = None
    unit: float | None = None
    """Metres in one unit of inputs without a CRS."""
    baseline: Survey | None = None
    """An earlier survey to compare with."""
    geo: bool = False
    """Files for geographic information systems are required."""
    force: bool = False
    """Start over if the folder holds a grid."""


def survey_grid(
    inputs: GridInputs, settings: Settings, rules: RuleSet | None, options: GridOptions,
    start: Callable[[int], AbstractContextManager[Engine]], tell: Tell,
) -> GridSummary:
    """
    Survey a grid; tasks that an earlier run finished are not run again.

    Parameters
    ----------
    inputs : GridInputs
        Inputs of the survey.
    settings : Settings
        Of all stages.
    rules : RuleSet or None
        Clearance rules.
    options : GridOptions
        How the grid is divided.
    start : callable
        Opens the engine that runs the tasks, called with the number of points of all inputs.
    tell : callable
        Progress callback.

    Returns
    -------
    GridSummary

    Raises
    ------
    DataError
        No input is usable, the inputs have different CRS, or memory is too small.
    ConfigError
        The CRS is not known, though files for geographic information systems are required.

    """
    paths = expand_inputs(inputs.items, inputs.folder)
    tell('headers', 0, len(paths), 0)
    sources, refusals = read_sources(paths, inputs.crs, inputs.unit)
    check_together(sources, refusals)
    first = next(source for source in sources if source.num_points)
    if inputs.geo:
        require_horizontal(first.path, first.crs)
    if inputs.baseline is not None:
        check_systems(inputs.baseline, first.path, first.crs)
    num_points = sum(source.num_points for source in sources)
    with start(num_points) as engine, open_grid_folder(inputs.folder, inputs.force) as ledger:
        count_allowed(engine.memory)
        check_all_named(inputs.folder, ledger.list_sources(), paths)
        for name in ('index.html', TABLE):  # not whole any more
            (inputs.folder / name).unlink(missing_ok=True)
        run = GridRun(
            folder=inputs.folder, settings=settings, rules=rules, options=options,
            engine=engine, ledger=ledger, tell=log_too(inputs.folder / LOG, tell),
            baseline=inputs.baseline,
        )
        numbers = ledger.number_sources([str(path) for path in paths])
        for refusal in refusals:
            ledger.describe_source(refusal.path, error=refusal.error)
        return inspect_sources(run, renumber(sources, numbers), refusals)[0]


def inspect_sources(
    run: GridRun, sources: Sequence[Source], refusals: Sequence[Refusal] = ()
) -> tuple[GridSummary, list[TileJob]]:
    """
    Cut inputs into cells, inspect the tiles, and join their results.

    Parameters
    ----------
    run : GridRun
        Inputs of the survey.
    sources : sequence of Source
        With their numbers in the ledger.
    refusals : sequence of Refusal
        Inputs that cannot be used.

    Returns
    -------
    summary : GridSummary
    jobs : list of TileJob
        The tiles.

    Raises
    ------
    DataError
        None of the inputs can be read, or memory is too small.

    """
    held = [source for source in sources if source.num_points]  # others have no bounds
    with open_room(run.work) as run.room:
        cut, jobs = cut_and_plan(run, held)
        memory = estimate_memory(jobs) / 1e9
        run.tell(f'memory: {memory:.1f} GB for the largest of', 0, len(jobs), 0)
        answers = inspect_tiles(run, cut, jobs, know_whole(run, cut, jobs))
        remove_kept(run.work / TILES)
    notes = [
        *(source.note for source in sources if source.note), *cut.notes, *find_twins(held),
        *question_times(held), *describe_cut(answers.values()),
    ]
    return write_grid(run, sources, refusals, cut, jobs, answers, notes), jobs


def find_twins(sources: Sequence[Source]) -> list[str]:
    """Return a note on each input with as many points and the same bounds as one before."""
    seen: dict[tuple[object, ...], str] = {}
    notes = []
    for source in sources:
        first = seen.setdefault((source.num_points, source.low, source.high), source.path)
        if first != source.path:
            notes.append(
                f'{first} and {source.path} hold {source.num_points} points within the same'
                ' bounds: if they are one tile, its points are counted twice; leave one out'
            )
    return notes


def describe_cut(answers: Iterable[dict[str, Any]]) -> list[str]:
    """Return a note if spans are cut off by halos that could not be wider."""
    halos = [answer['halo'] for answer in answers if answer['num_cut']]
    if not halos:
        return []
    return [
        f'spans near {len(halos)} tiles are cut off by halos of {min(halos):.0f} m and more, and'
        ' memory or the limit of 2 km allows no wider ones: ends, sags and hazards may differ'
        ' there from those of one run; give more --memory, or a smaller --tile'
    ]


def question_times(sources: Sequence[Source]) -> list[str]:
    """Return a note where the GPS times of inputs are of two kinds."""
    first = {source.time_type: source.path for source in reversed(sources)}
    first.pop(None, None)
    if len(first) < 2:
        return []
    return [
        f'GPS times are seconds of the week in {first[0]}, and standard times in {first[1]}:'
        ' points.laz holds both'
    ]


def check_together(sources: Sequence[Source], refusals: Sequence[Refusal]) -> None:
    """Raise DataError if inputs cannot form one grid."""
    if not sources:
        raise DataError(f'no input can be used: {refusals[0].error}')
    held = [source for source in sources if source.num_points]
    if not held:
        raise DataError(f'none of {len(sources)} inputs holds a point')
    first = held[0]
    same = {first.crs}
    for other in held[1:]:
        if other.crs not in same and is_same_system(first.crs, other.crs):
            same.add(other.crs)
        if other.crs not in same or other.units != first.units:
            raise DataError(
                f'{first.path} and {other.path} have different coordinate reference systems '
                f'({_name(first)}, {_name(other)}): convert them to one, or give --crs'
            )


def _name(source: Source) -> str:
    return source.crs.partition('"')[2].partition('"')[0] or 'none'


def log_too(path: Path, tell: Tell) -> Tell:
    """Return a progress callback that also writes a log line every LOG_PERIOD."""
    begun: dict[str, tuple[float, int]] = {}
    last = [0.0]

    def tell_and_log(step: str, done: int, total: int, failed: int) -> None:
        tell(step, done, total, failed)
        now = time.monotonic()
        is_new = step not in begun
        started, before = begun.setdefault(step, (now, done))
        if not (is_new or done == total or now - last[0] >= LOG_PERIOD):
            return
        last[0] = now
        rate = (done - before) / max(now - started, 1e-9)
        left = f', {(total - done) / rate:.0f} s left' if rate > 0 and done < total else ''
        pace = f', {rate:.2f}/s' if done > before else ''
        with path.open('a', encoding='utf-8') as file:
            stamp = time.strftime('%Y-%m-%dT%H:%M:%SZ', time.gmtime())
            file.write(make_one_line(
                f'{stamp} {step}: {done} of {total}{pace}{left}, {failed} failed'
            ) + '\n')

    return tell_and_log
