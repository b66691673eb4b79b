# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A small line in a small cloud, and grids of it."""

import laspy
import numpy as np
import pyproj
from toys import make_ground, make_tree, make_wire

from plc_inspect import __version__
from plc_inspect.config import Settings
from plc_inspect.grid.cells.sources import read_sources
from plc_inspect.grid.engine import OwnProcess
from plc_inspect.grid.ledger import Ledger
from plc_inspect.grid.run import GridOptions, GridRun, renumber
from plc_inspect.grid.survey_grid import inspect_sources

ORIGIN = np.array([500_000.0, 5_700_000.0, 40.0])
SUPPORTS = np.array([(0.0, 0.0), (95.0, 0.0), (190.0, 4.0), (280.0, 30.0), (365.0, 60.0)])
SIDES = (-2.5, 0.0, 2.5)
GIGABYTES = 4e9


def make_line(num_spans=4):
    """Make three conductors over some spans, ground, and two trees that are too near."""
    parts = []
    for span in range(num_spans):
        start, end = SUPPORTS[span], SUPPORTS[span + 1]
        for number, side in enumerate(SIDES):
            ends = [np.array([place[0], place[1] + side, 14.0]) for place in (start, end)]
            parts.append(make_wire(*ends, c=900.0, seed=10 * span + number))
        middle = (start + end) / 2
        parts.append(make_ground(
            np.minimum(start, end) - 25.0, np.maximum(start, end) + 25.0,
            per_square_metre=0.8, seed=100 + span,
        ))
        if span in (0, 2):
            parts.append(make_tree(*middle, top=11.2, seed=200 + span))
    return np.round(np.concatenate(parts) + ORIGIN, 3)


def write_las(path, points, crs=None, **header_changes):
    """Write points, with intensities and classes, as LAS or LAZ of point format 6."""
    header = laspy.LasHeader(version='1.4', point_format=6)
    header.scales, header.offsets = np.full(3, 0.001), np.floor(ORIGIN)
    for name, value in header_changes.items():
        setattr(header, name, value)
    if crs is not None:
        header.add_crs(pyproj.CRS.from_user_input(crs))
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    las.intensity = np.arange(len(points)) % 60_000
    las.classification = np.arange(len(points)) % 7
    las.write(path)
    return path


def open_run(folder, ledger, *, engine=None, settings=None, told=None, **options):
    """Return a run over a folder."""
    return GridRun(
        folder=folder, settings=settings or Settings(), rules=None,
        options=GridOptions(**options), engine=engine or OwnProcess(GIGABYTES), ledger=ledger,
        tell=lambda *step: told.append(step) if told is not None else None,
    )


def inspect(folder, paths, told=None, **options):
    """Run a grid to its end; return what it came to and its tiles."""
    folder.mkdir(exist_ok=True)
    sources, refusals = read_sources(paths)
    with Ledger(folder, __version__) as ledger:
        run = open_run(folder, ledger, told=told, **options)
        numbers = ledger.number_sources([source.path for source in sources])
        return inspect_sources(run, renumber(sources, numbers), refusals)
