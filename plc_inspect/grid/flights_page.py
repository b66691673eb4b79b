# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The index page of many flights: totals, hazards from the worst on, all flights."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from plc_inspect import __version__
from plc_inspect.colors import LOOKS
from plc_inspect.grid.index_page import MOST_HAZARDS, read_style
from plc_inspect.offline.export.files import write_json
from plc_inspect.offline.records.results_reader import read_table
from plc_inspect.offline.report.figures import rank
from plc_inspect.templates import open_templates
from plc_inspect.whole_files import replace_file

SEVERITIES = ('critical', 'warning', 'notice')


def write_flights(
    folder: Path, place: str, named: Mapping[str, Path], answers: Mapping[str, dict[str, Any]],
    failures: Sequence[tuple[str, str]],
) -> dict[str, Any]:
    """
    Write ``run.json``, then ``index.html``, which completes the folder.

    Parameters
    ----------
    folder : Path
        Of the results.
    place : str
        Folder in it that holds a results folder for each flight.
    named : mapping
        Path of the recording of each flight, by name.
    answers : mapping
        Answers of the replayed flights, by name.
    failures : sequence of tuple
        Name and error of failed flights, and of flights whose hazards are held back.

    Returns
    -------
    dict
        Totals.

    """
    hazards = [
        item | {'flight': name}
        for name in sorted(answers)
        for item in read_table(folder / place / name, 'hazards')['hazards']
    ]
    hazards.sort(key=rank)
    per_flight = Counter(item['flight'] for item in hazards)
    number = Counter(item['severity'] for item in hazards)
    kinds = Counter((item['severity'], item['kind']) for item in hazards)
    totals = {
        'flights': len(answers),
        'km of line': round(sum(answer['kilometres'] for answer in answers.values()), 2),
        'spans': sum(answer['num_spans'] for answer in answers.values()),
        'supports': sum(answer['num_supports'] for answer in answers.values()),
        **{f'{name} hazards': number[name] for name in SEVERITIES},
    }
    write_json(folder / 'run.json', {
        'version': __version__, 'command': 'plc_replay',
        'totals': totals,
        'hazards': {f'{severity} {kind}': count for (severity, kind), count
                    in sorted(kinds.items())},
        'flights': {
            name: answers[name] | {'source': str(named[name])} for name in sorted(answers)
        },
        'failures': [list(item) for item in failures],
    })
    page = open_templates('grid/templates').get_template('flights.html.j2').render(
        title=folder.name, version=__version__, style=read_style(), totals=totals, place=place,
        looks=LOOKS,
        hazards=hazards[:MOST_HAZARDS], num_more=max(len(hazards) - MOST_HAZARDS, 0),
        failures=failures,
        flights=[
            answers[name] | {'name': name, 'hazards': per_flight[name]} for name in sorted(answers)
        ],
    )
    with replace_file(folder / 'index.html') as aside:
        aside.write_text(page, encoding='utf-8')
    return totals
