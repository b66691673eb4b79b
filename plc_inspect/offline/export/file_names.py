# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Names of the files in a results folder."""

POINTS = 'points.laz'
"""The points of a survey, or of a tile of a grid."""
LEDGER = 'ledger.sqlite'
"""The ledger of a grid, or of many flights."""
FILES = (
    'run.json',
    'spans.json',
    'spans.csv',
    'supports.json',
    'hazards.json',
    'hazards.csv',
    POINTS,
    'report.html',
    'supports.csv',
    'coverage.json',
    'catenaries.dxf',
    'results.mcap',
)
"""Files of every complete results folder."""
OPTIONAL_FILES = (
    'whatif.json',
    'changes.json',
    'report.pdf',
    'spans.geojson',
    'supports.geojson',
    'hazards.geojson',
    'results.kml',
    'coverage.geojson',
    'refly.geojson',
    'refly.plan',
    'results.gpkg',
)
"""Further files, if requested or possible."""
BEFORE = 'before_{}'
"""Folders in it with what was found in maps that ended before the last one of a flight."""
