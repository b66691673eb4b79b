# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The index page of a grid: what it says of hazards is what the reports say."""

import dataclasses

from factories import make_inspection

from plc_inspect.grid.index_page import list_worst
from plc_inspect.offline.records.inspection import describe_hazard
from plc_inspect.results import HazardKind


def test_hazards_are_ranked_by_what_their_rules_measure():
    run = make_inspection(num_ground=10)
    near = dataclasses.replace(
        run.result.hazards[0], clearance=30.0, horizontal=0.5, required=3.0, hazard_id=0,
        note='measured horizontally',
    )
    far = dataclasses.replace(near, clearance=2.4, required=3.0, hazard_id=1, note='')
    sags = [
        dataclasses.replace(far, kind=HazardKind.SAG, clearance=excess, required=0.5, hazard_id=k)
        for k, excess in ((2, 0.6), (3, 4.0))
    ]
    records = [describe_hazard(item, run.units) for item in (*sags, far, near)]
    rows = list_worst(records, ['a', 'b', 'c', 'd'], {})
    assert [row['hazard_id'] for row in rows] == [3, 0, 1, 2]
    assert [row['tile'] for row in rows] == ['b', 'd', 'c', 'a']
    assert [row['measured'] for row in rows] == ['4.00', '0.50', '2.40', '0.60']
