# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What a ground station remembers of vehicles, with two monitors at once."""

import json
from pathlib import Path

import pytest

from plc_inspect.monitor.seen_runs import FILE, SeenRuns
from plc_inspect.security.keyring import Keyring
from plc_inspect.security.policy import read_policy

ROOT = Path(__file__).parents[2]


@pytest.fixture
def home(tmp_path, monkeypatch):
    """Return where a machine with keys remembers runs."""
    policy = read_policy(ROOT / 'config/security/policy.xml')
    Keyring(tmp_path / 'keys', policy).create(domain=0, days=10, hosts=())
    monkeypatch.setenv('PLC_KEYS', str(tmp_path / 'keys/ground'))
    monkeypatch.setenv('ROS_HOME', str(tmp_path))
    return tmp_path / 'plc_inspect' / FILE


def test_two_monitors_keep_the_newest_run_of_each_vehicle(home):
    one, other = SeenRuns(), SeenRuns()
    one.admission.runs.update({'a': 5, 'b': 9})
    one.save()
    other.admission.runs.update({'a': 7, 'b': 3, 'c': 1})
    other.save()
    assert json.loads(home.read_text()) == {'a': 7, 'b': 9, 'c': 1}
    one.admission.runs['a'] = 6
    one.save()
    assert SeenRuns().admission.runs == {'a': 7, 'b': 9, 'c': 1}
