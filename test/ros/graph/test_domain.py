# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import os
import subprocess
import sys

import pytest

from plc_inspect.errors import ConfigError
from plc_inspect.ros.graph import domain
from plc_inspect.ros.graph.domain import set_apart, take_domain

TAKE = """
import sys
from plc_inspect.ros.graph.domain import take_domain
print(take_domain(), flush=True)
sys.stdin.read()
"""


@pytest.fixture
def room(tmp_path, monkeypatch):
    """Locks of its own, none of them held."""
    monkeypatch.setenv('TMPDIR', str(tmp_path))
    monkeypatch.setattr(domain.tempfile, 'tempdir', None)
    monkeypatch.setattr(domain, '_held', [])
    yield tmp_path
    for _, lock in domain._held:
        os.close(lock)


def test_two_processes_are_never_in_one_domain(room):
    other = subprocess.Popen(
        [sys.executable, '-c', TAKE], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )
    try:
        assert int(other.stdout.readline()) == 1
        assert take_domain() == 2
    finally:
        other.communicate('')
    assert take_domain() == 1


def test_a_process_and_those_it_starts_are_set_apart(room, monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', '0')
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'SUBNET')
    assert set_apart() == 1
    assert os.environ['ROS_DOMAIN_ID'] == '1'
    assert os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'


def test_domains_take_turns_and_run_out(room, monkeypatch):
    monkeypatch.setattr(domain, 'MOST_DOMAINS', 2)
    assert [take_domain() for _ in range(5)] == [1, 2, 1, 2, 1]
    monkeypatch.setattr(domain, 'LAST_DOMAIN', 0)
    monkeypatch.setattr(domain, '_held', [])
    with pytest.raises(ConfigError, match='all ROS domains'):
        take_domain()


def test_a_lock_that_leads_elsewhere_is_left_alone(room):
    (room / 'plc_inspect_domain_1').symlink_to(room / 'elsewhere')
    assert take_domain() == 2
    assert not (room / 'elsewhere').exists()
