# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The side view of a span, as browsers are told of it."""

import asyncio
import json

from aiohttp import ClientSession
from stream_pieces import make_rows, Source

from plc_inspect.monitor.picture.model import Monitor
from plc_inspect.monitor.web.page import Page
from plc_inspect.stream.curve_check import NO_LENGTH


def find_profile(tables):
    """Return what a browser gets of the first span."""
    monitor = Monitor()
    assert monitor.take_summary(Source().summary(1.0, keyframe=True, tables=tables), 1.0)

    async def ask(address):
        async with ClientSession() as session, session.get(
            f'{address}profile?vehicle=/plc_inspect&span=0/0'
        ) as answer:
            assert answer.status == 200
            return await answer.text()

    with Page('127.0.0.1', 0) as page:
        page.show('/plc_inspect', monitor.look(1.0), monitor.cloud)
        text = asyncio.run(ask(page.address))

    def refuse(name):
        raise AssertionError(f'{name} is no JSON')

    return json.loads(text, parse_constant=refuse)['profile']


def test_a_hazard_of_unknown_lengths_is_drawn_where_it_is():
    tables = make_rows(6, 1)
    tables.hazards['line_id'] = tables.hazards['span_id'] = 0
    (known,) = find_profile(tables)['marks']
    assert known['clearance'] == 1.234
    for name in ('clearance', 'along_span'):
        tables.hazards[name] = NO_LENGTH
    (mark,) = find_profile(tables)['marks']
    assert mark['clearance'] is None
    assert abs(mark['x'] - known['x']) < 5.0
    assert mark['y'] == known['y']
