# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The benches of security call wrong what is wrong: an open door, a lost scan, a dear tunnel."""

import copy
import importlib
from pathlib import Path
import sys

import pytest

ROOT = Path(__file__).parents[2]
NOTHING = {'nodes': [], 'messages': 0, 'services': [], 'answers': [], 'listeners': 0}
TRIED = {'services called': 800, 'messages sent': 1200}


@pytest.fixture(scope='module', params=['security', 'tunnel_cost'])
def bench(request):
    """Import a bench as if it were run as a script."""
    paths = [str(ROOT / 'bench/live'), str(ROOT / 'bench')]
    sys.path[:0] = paths
    try:
        yield importlib.import_module(request.param)
    finally:
        for path in paths:
            sys.path.remove(path)


def make_outcome(security):
    """Return a flight in which all went well."""
    return security.Outcome(
        num_scans=463, code=0, num_spans=12, num_killed=3,
        found={
            'plain UDP': NOTHING | {'tried': TRIED},
            security.MEMBER: NOTHING | {'tried': {}, 'nodes': ['plc_inspect'], 'messages': 700},
        },
        monitor={'health': {'scans': 463.0}, 'spans': [{}] * 12, 'counts': {
            'lost_summary': 0, 'forged': 0, 'replayed': 0, 'foreign': 0,
        }},
        run={'settings': {'hazards': {'critical_distance': 2.0}}, 'input': {'counts': {
            'num_scans': 463, 'num_scans_lost': 0, 'scans_dropped': {},
        }}},
        tunnel=['plc_keys: 5 connections, 172 refused\n'],
    )


def change(outcome, path, value):
    """Return an outcome in which one thing is different."""
    changed = copy.deepcopy(outcome)
    place = getattr(changed, path[0])
    for key in path[1:-1]:
        place = place[key]
    if len(path) > 1:
        place[path[-1]] = value
    else:
        setattr(changed, path[0], value)
    return changed


@pytest.mark.parametrize(('path', 'value', 'flaw'), [
    (('found', 'plain UDP', 'messages'), 1, 'plain UDP found'),
    (('found', 'plain UDP', 'answers'), ['save'], 'plain UDP found'),
    (('found', 'plain UDP', 'listeners'), 1, 'plain UDP found'),
    (('found', 'plain UDP', 'tried'), {}, 'hardly tried'),
    (('found', 'MEMBER', 'messages'), 0, 'not even a member'),
    (('run', 'input', 'counts', 'num_scans'), 462, 'scans were lost'),
    (('run', 'input', 'counts', 'scans_dropped'), {'no pose': 1}, 'scans were lost'),
    (('monitor', 'health', 'scans'), 460.0, 'the ground missed scans'),
    (('monitor', 'counts', 'lost_summary'), 1, 'the ground missed messages'),
    (('monitor', 'counts', 'forged'), 1, 'the ground refused'),
    (('run', 'settings', 'hazards', 'critical_distance'), 0.0, 'something was changed'),
    (('log',), ['[WARN] [1] [plc_inspect]: parameter height.beta was 4.0, is 1.0'], 'was changed'),
    (('log',), ['[INFO] [1] [plc_inspect]: reset: map is forgotten'], 'was changed'),
    (('code',), 1, 'the node failed'),
])
@pytest.mark.parametrize('bench', ['security'], indirect=True)
def test_each_flaw_of_a_flight_is_told(bench, path, value, flaw):
    outcome = make_outcome(bench)
    assert outcome.flaws() == []
    path = tuple(bench.MEMBER if key == 'MEMBER' else key for key in path)
    flaws = change(outcome, path, value).flaws()
    assert len(flaws) == 1
    assert flaw in flaws[0]


@pytest.mark.parametrize('bench', ['security'], indirect=True)
def test_tables_have_what_strangers_tried_and_got(bench):
    outcome = make_outcome(bench)
    row = next(line for line in bench.describe_strangers(outcome).splitlines()
               if line.startswith('| plain UDP'))
    assert [cell.strip() for cell in row.split('|')[2:-1]] == ['1200', '800', *'00000']
    table = bench.describe_flights({'alone': outcome, 'among strangers': outcome})
    assert '| 463, 463' in table
    assert '5 connections, 172 refused' in table


@pytest.mark.parametrize('bench', ['tunnel_cost'], indirect=True)
def test_what_the_tunnel_costs_is_judged_by_medians(bench):
    link = 'link, most over 5 s [kbit/s]'

    def fly(cores, rate):
        return {'processor [cores]': cores, link: rate, 'lost': 0.0}

    plain = [fly(0.5, 200.0), fly(0.4, 200.0), fly(0.6, 200.0)]
    for cores, rate, wrong in ((0.54, 250.0, 0), (0.56, 250.0, 1), (0.56, 257.0, 2)):
        flights = {bench.PLAIN: plain, bench.TUNNEL: [fly(cores, rate)] * 3}
        table, flaws = bench.compare(flights)
        assert len(flaws) == wrong
        assert f'{cores / 0.5 - 1.0:+.1%}' in table
