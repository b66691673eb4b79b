# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Sections of a grid: the spans that belong to one tile, and a report for each section."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
import shapely

from plc_inspect.grid.engine import Task
from plc_inspect.grid.joining import JoinedGrid
from plc_inspect.grid.ledger import make_key
from plc_inspect.grid.run import GridRun
from plc_inspect.grid.stage import Stage
from plc_inspect.grid.tiles.plain_results import plain
from plc_inspect.grid.tiles.section_report import (
    bound,
    COVERAGE,
    find_strips,
    remove_report,
    REPORT,
    Section,
    write_section_report,
)
from plc_inspect.grid.tiles.tile_job import TileJob
from plc_inspect.offline.records.units import Units
from plc_inspect.setting_names import to_mapping

STAGE = 'report'
NEAR_END = 30.0
"""
Supports within this distance of the end of a span belong to its section [m].
Source: judgement.
"""
AROUND = 300.0
"""
Spans of other tiles within this distance of the spans of a section count for its flight [m].
Source: derived: the conductors beyond open ends, and what a run is longer and farther aside.
"""


def plan_reports(
    run: GridRun, folder: Path, jobs: Sequence[TileJob], joined: JoinedGrid, crs: str,
    units: Units,
) -> Stage:
    """
    Return what writes a report for each tile to which spans belong.

    Parameters
    ----------
    run : GridRun
        The run.
    folder : Path
        Holds a folder for each tile, by its name.
    jobs : sequence of TileJob
        The tiles that were inspected.
    joined : JoinedGrid
        What was found in the grid.
    crs, units
        Of the coordinates.

    Returns
    -------
    Stage
        Its answers are the figures of each report; see `write_section_report`.

    """
    sections = _lay_sections(run, jobs, joined, crs, units)
    boxes = shapely.box(*np.array(
        [job.tile.rectangle(job.grid) for job in jobs]
    ).reshape(-1, 4).T)
    tree = shapely.STRtree(boxes)
    tasks, keys = [], {}
    for job in jobs:
        name = job.tile.name
        section = sections.get(job.tile.number)
        if section is None:
            remove_report(folder / name)
            continue
        near = sorted(tree.query(shapely.box(*bound(find_strips(section.spans)))).tolist())
        tiles = [(jobs[k], tuple(
            (*own, *new) for own, new in sorted(joined.numbers[jobs[k].tile.number].items())
        )) for k in near]
        tasks.append(Task(
            name=name, size=len(section.spans), function=write_section_report,
            arguments=(str(folder / name), section, tiles),
        ))
        keys[name] = make_key(
            [run.ledger.find_task('tile', other.tile.name) for other, _ in tiles],
            [numbers for _, numbers in tiles], _describe(section),
        )
        if not all((folder / name / own).is_file() for own in (REPORT, COVERAGE)):
            run.ledger.forget(STAGE, name)
    return Stage(name=STAGE, tasks=tasks, keys=keys)


def _lay_sections(
    run: GridRun, jobs: Sequence[TileJob], joined: JoinedGrid, crs: str, units: Units
) -> dict[int, Section]:
    """Return the section of each tile to which spans belong, by the number of the tile."""
    places = np.array([item.position[:2] for item in joined.supports]).reshape(-1, 2)
    supports = cKDTree(places)
    names = {job.tile.number: job.tile.name for job in jobs}
    spans: dict[int, list[int]] = {}
    hazards: dict[int, list[int]] = {}
    for table, tiles in ((spans, joined.span_tiles), (hazards, joined.hazard_tiles)):
        for k, tile in enumerate(tiles):
            table.setdefault(tile, []).append(k)
    plan = np.array([(item.start[:2], item.end[:2]) for item in joined.spans]).reshape(-1, 2, 2)
    boxes = shapely.STRtree(shapely.box(*plan.min(axis=1).T, *plan.max(axis=1).T))
    sections = {}
    for tile, members in spans.items():
        own = tuple(joined.spans[k] for k in members)
        ends = plan[members].reshape(-1, 2)
        low, high = ends.min(axis=0) - AROUND, ends.max(axis=0) + AROUND
        around = set(boxes.query(shapely.box(*low, *high)).tolist())
        near = sorted({k for row in supports.query_ball_point(ends, NEAR_END) for k in row})
        sections[tile] = Section(
            source=f'{run.folder.name}, section {names[tile]}', spans=own,
            others=tuple(joined.spans[k] for k in sorted(around - {*members})),
            supports=tuple(joined.supports[k] for k in near),
            hazards=tuple(joined.hazards[k] for k in hazards.get(tile, [])),
            vegetation=tuple(
                (span.line_id, span.span_id, joined.vegetation[span.line_id, span.span_id])
                for span in own
            ),
            settings=run.settings, rules=run.rules, crs=crs, units=units,
        )
    return sections


def _describe(section: Section) -> list[Any]:
    """Return what a report depends on besides its points, as plain values."""
    return [
        section.source, section.vegetation, to_mapping(section.settings), repr(section.rules),
        section.crs, [section.units.horizontal, section.units.vertical],
        *([plain(item) for item in items]
          for items in (section.spans, section.others, section.supports, section.hazards)),
    ]
