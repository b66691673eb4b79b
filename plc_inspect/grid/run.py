# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The run over a grid: cut inputs into cells, survey the whole, inspect tile by tile."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
import math
from pathlib import Path
import shutil
from typing import Any

import numpy as np

from plc_inspect import __version__
from plc_inspect.config import Settings
from plc_inspect.core.extraction.stray_points import lay_stray_grid, StrayGrid
from plc_inspect.core.hazards.clearance_rules import RuleSet
from plc_inspect.core.whole import Whole
from plc_inspect.errors import DataError
from plc_inspect.grid.cells.cut import (
    ATTRIBUTES,
    count_parts,
    cut_part,
    describe_lost,
    find_unusable,
    name_part,
    STATISTICS,
)
from plc_inspect.grid.cells.layout import (
    CellGrid,
    count_allowed,
    estimate_tile,
    lay_cells,
    lay_tiles,
    LEAST_EDGE,
    TooDense,
)
from plc_inspect.grid.cells.sources import Source
from plc_inspect.grid.engine import Engine, Outcome, Task
from plc_inspect.grid.ledger import Ledger, make_key
from plc_inspect.grid.stage import Stage
from plc_inspect.grid.tiles.plain_results import has_found
from plc_inspect.grid.tiles.tile_job import (
    CELLS,
    render_whole,
    StrayCells,
    TileJob,
    TILES,
    write_catalogue,
)
from plc_inspect.grid.tiles.tile_run import find_wider, inspect_tile
from plc_inspect.offline.records.changes import Survey

WORK = 'work'
"""Folder of the cells and of the results of each tile; the final results do not need it."""
Tell = Callable[[str, int, int, int], None]
"""Progress callback: step, number of its tasks done, in all, and failed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GridOptions:
    """How a grid is divided."""

    halo: float | None = None
    """Initial halo around a tile [m], None: see `lay_tiles`."""
    edge: float | None = None
    """Edge of the cells that points are cut into [m], None: derived from their density."""
    tile_edge: float = math.inf
    """Greatest edge of a tile [m]."""
    shift: tuple[float, float] = (0.0, 0.0)
    """Shift of the cell borders in x and y [m]."""


@dataclass(slots=True, kw_only=True)
class GridRun:
    """A run over a grid, with its ledger and engine."""

    folder: Path
    settings: Settings
    rules: RuleSet | None
    options: GridOptions
    engine: Engine
    ledger: Ledger
    tell: Tell
    baseline: Survey | None = None
    """An earlier survey to compare with."""
    room: Path = Path()
    """Where its tasks write aside; see `room.open_room`."""
    failures: list[str] = field(default_factory=list)
    num_defects: int = 0

    @property
    def work(self) -> Path:
        """The working folder of the tasks."""
        return self.folder / WORK

    @property
    def allowed(self) -> int:
        """Number of points that a tile with its halo may hold."""
        return count_allowed(self.engine.memory)

    def run(
        self, name: str, tasks: Sequence[Task], keys: dict[str, str],
        renew: Callable[[str, dict[str, Any]], str] | None = None,
    ) -> dict[str, dict[str, Any]]:
        """Run the unfinished tasks of a `Stage`; return the answers of all by name."""
        return self.run_together(Stage(name=name, tasks=tasks, keys=keys, renew=renew))[0]

    def run_together(self, *stages: Stage) -> list[dict[str, dict[str, Any]]]:
        """
        Run the unfinished tasks of stages that do not need each other.

        Parameters
        ----------
        *stages : Stage
            With names of their own; tasks are started in this order.

        Returns
        -------
        list of dict
            Of each stage, the answers of all its tasks by name.

        """
        left: list[Task] = []
        answers: list[dict[str, dict[str, Any]]] = []
        done, failed = [], [0] * len(stages)
        for stage in stages:
            known, todo = stage.divide(self.ledger)
            answers.append(known)
            done.append(len(known))
            left += sorted(todo, key=lambda task: -task.size)
            self.ledger.drop_others(stage.name, [task.name for task in stage.tasks])
        number = {stage.name: k for k, stage in enumerate(stages)}

        def tell(first: int) -> None:
            for k in range(first, len(stages)):
                self.tell(stages[k].name, done[k], len(stages[k].tasks), failed[k])
                if done[k] < len(stages[k].tasks):
                    break  # the next one has not begun

        tell(0)
        for outcome in self.engine.run(left):
            k = number[outcome.stage]
            done[k] += 1
            if outcome.answer is None:
                failed[k] += 1
                self._fail(outcome)
            else:
                answers[k][outcome.name] = outcome.answer
            self.ledger.keep_task(
                outcome.stage, outcome.name, stages[k].find_key(outcome.name, outcome.answer),
                outcome.answer, outcome.error, seconds=outcome.seconds, worker=outcome.worker,
            )
            tell(k)
        return answers

    def _fail(self, outcome: Outcome) -> None:
        self.failures.append(f'{outcome.stage} {outcome.name}: {outcome.error}')
        self.num_defects += outcome.is_defect


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CutGrid:
    """All points, in cells on disk."""

    grid: CellGrid
    crs: str
    """WKT of all inputs, '' where none is known."""
    units: tuple[float, float]
    """Metres in one horizontal and one vertical unit of the inputs."""
    counts: np.ndarray
    """Points in each cell."""
    pieces: np.ndarray
    """(K, 3) cell, place of its part, points."""
    part_keys: tuple[str, ...]
    """Digest of what each part depends on, in their order."""
    reference: np.ndarray
    moments: np.ndarray
    strays: tuple[StrayCells, ...]
    held: np.ndarray
    """Numbers of the cells with points that are not stray."""
    num_points: int
    num_lost: int
    num_withheld: int
    notes: tuple[str, ...]
    """On points that were left out."""


def cut_sources(run: GridRun, sources: Sequence[Source]) -> CutGrid:
    """Cut all inputs into cells on disk; DataError if none can be read."""
    grid = _choose_cells(run, sources)
    low = np.array([source.low for source in sources]).min(axis=0)
    high = np.array([source.high for source in sources]).max(axis=0)
    reference = np.floor((low + high) / 2)
    plane = lay_stray_grid(low, high)
    folder = run.work / CELLS
    folder.mkdir(exist_ok=True)
    tasks, keys = [], {}
    for source in sources:
        for part in range(count_parts(source)):
            name = name_part(source.number, part)
            tasks.append(Task(name=name, function=cut_part, arguments=(
                str(run.room), str(folder), source, part, grid, tuple(reference.tolist()), plane,
            )))
            keys[name] = make_key(__version__, source.state, source.units, part, asdict(grid),
                                  reference.tolist(), low.tolist(), high.tolist(), STATISTICS,
                                  ATTRIBUTES.descr)
            if not (folder / name).is_dir():  # removed, to save space
                run.ledger.forget('cut', name)
    answers = run.run('cut', tasks, keys)
    for name, error in find_unusable(sources, answers).items():
        del answers[name]
        run.failures.append(f'cut {name}: {error}')
        run.ledger.keep_task('cut', name, '', None, error)
    for path in folder.glob('s*'):
        if path.name not in answers:
            shutil.rmtree(path, ignore_errors=True)
    _describe_sources(run, sources, answers)
    if not answers:
        error = run.ledger.list_failures()[0][2]
        raise DataError(f'none of {len(sources)} inputs can be used: {error}')
    names = sorted(answers)
    rows = [
        (int(cell), place, num)
        for place, name in enumerate(names) for cell, num in answers[name]['cells'].items()
    ]
    pieces = np.array(rows, dtype=np.int64).reshape(-1, 3)
    write_catalogue(run.work, names, [answers[name]['num_points'] for name in names], pieces)
    counts = np.bincount(
        pieces[:, 0], weights=pieces[:, 2], minlength=grid.rows * grid.columns
    ).astype(np.int64)
    parts = [answers[name] for name in names]
    strays, held = _find_strays(parts, plane, grid, np.flatnonzero(counts))
    return CutGrid(
        grid=grid, crs=sources[0].crs, units=sources[0].units, counts=counts,
        pieces=pieces, part_keys=tuple(keys[name] for name in names),
        reference=reference, strays=strays, held=held,
        moments=np.sum([part['moments'] for part in parts], axis=0),
        num_points=sum(part['num_points'] for part in parts),
        num_lost=sum(part['num_lost'] for part in parts),
        num_withheld=sum(part['num_withheld'] for part in parts),
        notes=tuple(describe_lost(sources, answers)),
    )


def _describe_sources(
    run: GridRun, sources: Sequence[Source], answers: dict[str, dict[str, Any]]
) -> None:
    """Enter each input: with its digest if all of it was cut, else with the error."""
    failed = {name: error for stage, name, error in run.ledger.list_failures() if stage == 'cut'}
    for source in sources:
        names = [name_part(source.number, part) for part in range(count_parts(source))]
        error = next((failed[name] for name in names if name in failed), '')
        digest = '' if error else answers[names[0]]['sha256']
        run.ledger.describe_source(source.path, source.num_points, digest, error)


def _choose_cells(run: GridRun, sources: Sequence[Source]) -> CellGrid:
    """Return the cells of an earlier run if they do for the inputs, else new ones."""
    options = run.options
    boxes = [(*source.low[:2], *source.high[:2]) for source in sources]
    known = run.ledger.find_fact('cells')
    if known is not None and known['wish'] == _render_wish(run, sources):
        grid = CellGrid(**known['grid'] | {'origin': tuple(known['grid']['origin'])})
        is_over_all = grid.holds(boxes) or known['sources'] == _digest(sources)
        if is_over_all and grid.edge <= max(options.tile_edge, LEAST_EDGE):
            return grid
    grid = lay_cells(
        boxes, sum(source.num_points for source in sources), run.allowed, options.edge,
        options.shift, options.tile_edge,
    )
    _keep_cells(run, sources, grid)
    return grid


def _keep_cells(run: GridRun, sources: Sequence[Source], grid: CellGrid) -> None:
    run.ledger.keep_fact('cells', {
        'wish': _render_wish(run, sources), 'grid': asdict(grid), 'sources': _digest(sources),
    })
    run.ledger.keep_fact('whole', None)


def _render_wish(run: GridRun, sources: Sequence[Source]) -> list[Any]:
    """Return what the cells depend on besides the bounds of the inputs."""
    return [run.options.edge, *run.options.shift, sources[0].crs, *sources[0].units]


def _digest(sources: Sequence[Source]) -> str:
    return make_key([source.state for source in sources])


def _find_strays(
    parts: Sequence[dict[str, Any]], plane: StrayGrid | None, grid: CellGrid, used: np.ndarray
) -> tuple[tuple[StrayCells, ...], np.ndarray]:
    """Return the cells of stray points, which are few and far from the rest, and what is left."""
    if plane is None:
        return (), used
    counts = np.zeros(int(np.prod(plane.shape)), dtype=np.int64)
    for part in parts:
        for cell, count in part['strays'].items():
            counts[int(cell)] += count
    marked = plane.find_strays(counts)
    if not marked.any():
        return (), used
    columns = np.asarray(((counts > 0) & ~marked).reshape(plane.shape).any(axis=2))
    corners = grid.outline(used)[:, [[0, 1], [0, 3], [2, 1], [2, 3]]]
    place = ((corners - plane.low[:2]) / plane.cell).astype(np.int64)
    place = place.clip(0, np.array(columns.shape) - 1)
    left = columns[place[..., 0], place[..., 1]].any(axis=1)
    return (StrayCells(grid=plane, marked=marked),), used[left]


def cut_and_plan(run: GridRun, sources: Sequence[Source]) -> tuple[CutGrid, list[TileJob]]:
    """
    Cut all inputs into cells, and divide these into tiles that fit in memory.

    The cells are laid by the bounds of the inputs.  Where these tell less than they should of the
    density, as one stray point does, cells are laid anew by those that hold points.
    """
    num_failures, num_defects = len(run.failures), run.num_defects
    while True:
        del run.failures[num_failures:]  # all is cut again
        run.num_defects = num_defects
        cut = cut_sources(run, sources)
        try:
            return cut, plan_tiles(run, cut)
        except TooDense:
            grid = lay_cells(
                cut.grid.outline(cut.held), cut.num_points, run.allowed, run.options.edge,
                run.options.shift, run.options.tile_edge,
            )
            if grid.edge >= cut.grid.edge:
                raise
            _keep_cells(run, sources, grid)


def plan_tiles(run: GridRun, cut: CutGrid) -> list[TileJob]:
    """Divide the cells into tiles that fit in memory."""
    tiles = lay_tiles(
        cut.grid, cut.counts, run.options.halo, run.allowed, run.options.tile_edge
    )
    return [
        TileJob(
            folder=str(run.work), room=str(run.room), tile=tile, grid=cut.grid, strays=cut.strays
        )
        for tile in tiles
    ]


def inspect_tiles(
    run: GridRun, cut: CutGrid, jobs: Sequence[TileJob], whole: Whole
) -> dict[str, dict[str, Any]]:
    """Inspect all tiles not inspected yet; return the answer of each."""
    rules = None if run.rules is None else repr(run.rules)
    common = make_key(__version__, asdict(run.settings), rules, render_whole(whole))
    tiles = {job.tile.name: job.tile for job in jobs}
    order = np.argsort(cut.pieces[:, 0], kind='stable')
    cells, parts = cut.pieces[order, 0], cut.pieces[order, 1]

    def render_key(name: str, answer: dict[str, Any]) -> str:
        tile = tiles[name]
        if not has_found(run.work / TILES / name):
            return ''
        if answer['num_cut'] and find_wider(answer['halo'], answer['num_read'], run.allowed):
            return ''  # now there is memory for a halo that was too wide
        near = tile.cells(cut.grid, answer['halo'])
        first, last = np.searchsorted(cells, near), np.searchsorted(cells, near, side='right')
        used = sorted({
            (cell, cut.part_keys[part])
            for cell, begin, end in zip(near, first.tolist(), last.tolist(), strict=True)
            for part in parts[begin:end].tolist()
        })
        return make_key(common, tile.first, tile.last, used, run.options.halo)

    return run.run('tile', [
        Task(name=job.tile.name, size=job.tile.num_near, function=inspect_tile, arguments=(
            job, whole, run.settings, run.rules, run.allowed,
        )) for job in jobs
    ], dict.fromkeys(tiles, ''), render_key)


def estimate_memory(jobs: Sequence[TileJob]) -> float:
    """Return the memory expected for the largest tile [bytes]."""
    return estimate_tile(max((job.tile.num_near for job in jobs), default=0))


def renumber(sources: Sequence[Source], numbers: dict[str, int]) -> list[Source]:
    """Return the inputs with their numbers in the ledger, sorted by them."""
    own = [replace(source, number=numbers[source.path]) for source in sources]
    return sorted(own, key=lambda source: source.number)
