# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What the result of each tile depends on beyond its own points, measured over all tiles."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, replace
import json
from typing import Any

import numpy as np

from plc_inspect import __version__
from plc_inspect.core.cloud_frame import CloudFrame, derive_frame, sum_moments
from plc_inspect.core.corridor import choose_step
from plc_inspect.core.whole import Whole
from plc_inspect.grid.engine import Task
from plc_inspect.grid.ledger import make_key
from plc_inspect.grid.run import CutGrid, GridRun
from plc_inspect.grid.tiles.survey_whole import (
    CANDIDATES,
    count_tile,
    find_peak,
    HEIGHTS,
    join_bounds,
    join_extremes,
    join_spacing,
    measure_bounds,
    measure_candidates,
    measure_distances,
    measure_ground,
    remove_kept,
    write_candidate_boxes,
)
from plc_inspect.grid.tiles.tile_job import parse_whole, render_whole, TileJob, TILES

MOST_STEP = 1000
"""
Of the points of a grid every so many, at least, is one by which radii of the corridor are chosen.
Source: derived: as in a single cloud of a hundred million points, more than memory holds.
"""


def know_whole(run: GridRun, cut: CutGrid, jobs: Sequence[TileJob]) -> Whole:
    """
    Measure what the result of each tile depends on beyond its own points.

    Values of an earlier run with the same settings, CRS and units are kept, so that a changed
    input changes only its own tiles; not those of a run that failed to measure a tile.
    """
    settings = run.settings
    stages = [asdict(item) for item in (
        settings.height, settings.linearity, settings.outliers, settings.segment,
    )]
    key = make_key(__version__, stages, asdict(cut.grid), cut.crs, cut.units)
    known = run.ledger.find_fact('whole')
    if known is not None and known['key'] == key:
        remove_kept(run.work / TILES)  # inputs may have changed since
        return parse_whole(json.dumps(known['whole']))
    frame = derive_frame(cut.reference, cut.moments)
    if cut.strays:
        frame = _derive_without_strays(jobs, cut)
    num_failures = len(run.failures)
    found = _measure_whole(run, jobs, frame, key + make_key(cut.part_keys))
    whole = replace(found, probe_step=min(choose_step(cut.num_points), MOST_STEP))
    if len(run.failures) == num_failures:  # else the next run measures what is missing
        run.ledger.keep_fact('whole', {'key': key, 'whole': render_whole(whole)})
    return whole


def _derive_without_strays(jobs: Sequence[TileJob], cut: CutGrid) -> CloudFrame:
    moments = np.zeros_like(cut.moments)
    for job in jobs:
        moments += sum_moments(job.read(0.0).points, cut.reference)
    return derive_frame(cut.reference, moments)


def _measure_whole(
    run: GridRun, jobs: Sequence[TileJob], frame: CloudFrame, key: str
) -> Whole:
    settings = run.settings

    folder, num = run.work / TILES, settings.outliers.num_neighbors

    def ask(
        stage: str, tasks: Iterable[Task], *more: Any, suffix: str = ''
    ) -> list[dict[str, Any]]:
        listed = list(tasks)
        for task in listed:  # what it wrote may be gone
            if suffix and not (folder / f'{task.name}{suffix}').is_file():
                run.ledger.forget(stage, task.name)
        own = {task.name: make_key(key, task.name, more) for task in listed}
        answers = run.run(stage, listed, own)
        return [answers[task.name] for task in listed if task.name in answers]

    def for_each(function: Callable[..., dict[str, Any]], *more: Any) -> Iterator[Task]:
        for job in jobs:
            yield Task(name=job.tile.name, size=job.tile.num_points, function=function,
                       arguments=(job, *more))

    extent = [(job.tile.first, job.tile.last, job.tile.halo) for job in jobs]
    region = join_bounds(ask('bounds', for_each(measure_bounds, frame), extent))
    extremes = join_extremes(ask(
        'ground', for_each(measure_ground, frame, region, settings.height), extent,
        suffix=HEIGHTS,
    ))
    peak = 0.0
    if extremes[0] <= extremes[1]:
        peak = find_peak(ask(
            'histogram', for_each(count_tile, extremes, settings.height), extent, extremes
        ), extremes, settings.height)
    candidates = ask(
        'candidates', for_each(measure_candidates, frame, region, peak, settings),
        extent, extremes, peak, suffix=CANDIDATES,
    )
    write_candidate_boxes(folder, candidates)
    spacings = ask('spacing', (
        Task(name=own['name'], function=measure_distances, arguments=(
            str(folder), own['name'], num,
        )) for own in candidates
    ), make_key(candidates, num))
    spacing, anchor = join_spacing(spacings, candidates, num)
    return Whole(frame=frame, region=region, peak=peak, anchor=anchor, spacing=spacing,
                 probe_step=1)
