# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Attackers with all names right, against node, tunnel and monitor; all real processes."""

from contextlib import ExitStack
import json
import os
from pathlib import Path
import shutil
import struct
import subprocess
import sys
import threading

import pytest
from rig import FIRST_DEADLINE, Rig, take_domain, wait_for
from stream_pieces import NO_TABLES, Source

from plc_inspect.security.command import main
from plc_inspect.security.member_keys import VARIABLE
from plc_inspect.security.policy import read_policy
from plc_inspect.setting_names import describe
from plc_inspect.stream.signature import Signer

ROOT = Path(__file__).parents[2]
COMMON = ROOT / 'bench/common'
STRANGER, FORGER = COMMON / 'stranger.py', COMMON / 'forger.py'
POLICY = ROOT / 'config/security/policy.xml'
NODE, MONITOR = 'plc_inspect.ros.node.onboard', 'plc_inspect.monitor.command'
START = 36.0
"""Where in the demo flight the player begins [s]: its end is enough."""
CHOICES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'ROS_AUTOMATIC_DISCOVERY_RANGE', VARIABLE)
SECONDS = 8.0
"""How long strangers try [s]: all parameters are set once by then."""
PATIENCE = 90.0


class Processes:
    """Processes in a domain of their own, which end with the block."""

    def __init__(self, home, domain=None):
        self._stack = ExitStack()
        self.environment = {
            name: value for name, value in os.environ.items() if name not in CHOICES
        } | {'ROS_HOME': str(home), 'ROS_DOMAIN_ID': str(domain or take_domain())}

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._stack.close()

    def start(self, *command, **environment):
        """Start a Python process."""
        process = subprocess.Popen(
            [sys.executable, *map(str, command)], cwd=ROOT, text=True,
            env=self.environment | {name: str(value) for name, value in environment.items()},
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )
        self._stack.callback(process.communicate)
        self._stack.callback(process.kill)
        return process

    def start_node(self, *parameters, **environment):
        """Start a node and return it with the lines of its log, when it is ready."""
        given = [item for parameter in parameters for item in ('-p', parameter)]
        node = self.start('-m', NODE, '--ros-args', *given, **environment)
        log = read_lines(node.stderr)
        wait_for(lambda: any('ready' in line for line in log), 'node', FIRST_DEADLINE)
        return node, log

    def start_monitor(self, *arguments, **environment):
        """Start a monitor and return what it says."""
        monitor = self.start(
            '-m', MONITOR, '--json', '--period', '0.1', *arguments, **environment
        )
        return read_lines(monitor.stdout)

    def let_try(self, seconds=SECONDS, **environment):
        """Start a stranger."""
        return self.start(STRANGER, seconds, **environment)


def read_lines(stream):
    """Return a list that gets the lines of a stream as they come."""
    lines = []
    threading.Thread(
        target=lambda: lines.extend(iter(stream.readline, '')), daemon=True
    ).start()
    return lines


def read_found(process):
    """Return what a stranger found, and what it tried; Fast DDS writes its errors between."""
    text = process.communicate(timeout=PATIENCE)[0]
    found = json.loads(next(line for line in text.splitlines() if line.startswith('{')))
    return found, found.pop('tried')


@pytest.fixture(scope='module')
def fleet(tmp_path_factory):
    """Return a folder with keys."""
    folder = tmp_path_factory.mktemp('fleet') / 'keys'
    assert main(['create', str(folder)]) == 0
    return folder


def test_the_stranger_knows_all_names(monkeypatch):
    monkeypatch.syspath_prepend(str(COMMON))
    import stranger

    rights = read_policy(POLICY)['/plc_inspect/vehicle']
    own = 'rt/plc_inspect/'
    assert set(stranger.OUTPUTS) == {
        name.removeprefix(own) for name in rights.publish if name.startswith(own)
    }
    inputs = {
        name.removeprefix('rt') for name in rights.subscribe if name.startswith('rt')
    }
    assert inputs - set(stranger.INPUTS) <= {'/tf', '/tf_static'}  # tf2_msgs is in no wheel
    assert set(stranger.SERVICES) == {
        name.removeprefix('rq/plc_inspect/').removesuffix('Request')
        for name in rights.subscribe if name.startswith('rq')
    }


def test_the_policy_names_what_the_node_opens_and_nothing_else():
    rights = read_policy(POLICY)['/plc_inspect/vehicle']
    named = {
        'publisher': {name[2:] for name in rights.publish if name.startswith('rt')},
        'subscriber': {name[2:] for name in rights.subscribe if name.startswith('rt')},
        'service': {name[2:].removesuffix('Request') for name in rights.subscribe
                    if name.startswith('rq')},
    }
    rig = Rig(ready=False)

    def look(kind):
        ask = getattr(rig.client, f'get_{kind}_names_and_types_by_node')
        return {name for name, _ in ask('plc_inspect', '/')}

    try:
        wait_for(lambda: 'plc_inspect' in rig.client.get_node_names(), 'node')
        wait_for(lambda: look('service') == named['service'], 'services')
        wait_for(lambda: look('publisher') == named['publisher'], 'publishers')
        assert look('subscriber') <= named['subscriber']
        # tf2_msgs is in no wheel, and the clock is listened to under use_sim_time alone.
        assert named['subscriber'] - look('subscriber') <= {'/tf', '/tf_static', '/clock'}
    finally:
        rig.close()


@pytest.mark.slow
def test_where_nothing_is_closed_the_stranger_gets_and_changes_everything(tmp_path):
    """What the other tests rely on: it would find what is open."""
    with Processes(tmp_path) as processes:
        _, log = processes.start_node('output.record:=false')
        found, tried = read_found(processes.let_try(3 * SECONDS))  # a busy node answers late
        assert '/plc_inspect' in [f'/{name}' for name in found['nodes']]
        assert found['messages'] > 10
        assert len(found['services']) == len(found['answers']) == 10
        assert found['listeners'] >= 2
        assert tried['services called'] > len(list(describe()))
        wait_for(lambda: any('parameter hazards.critical_distance was 2.0' in line
                             for line in log), 'changed parameter')
        wait_for(lambda: any('reset: ' in line for line in log), 'reset')


@pytest.mark.slow
def test_without_a_key_of_the_fleet_nothing_is_read_and_nothing_changes(
    monkeypatch, tmp_path
):
    """The end of the demo flight, each machine a network namespace, as the bench flies it."""
    monkeypatch.syspath_prepend(str(ROOT / 'bench/live'))
    monkeypatch.syspath_prepend(str(ROOT / 'bench'))
    from networks.fleet import lacks_networks, Network
    import security

    if reason := lacks_networks():
        pytest.skip(reason)
    with Network() as network:
        outcome = security.fly(ROOT / 'bags/demo', tmp_path, network, start=START,
                               seconds=SECONDS, victims=1)
    assert len(outcome.found) == 7
    assert outcome.num_scans > 50
    assert outcome.flaws() == []
    assert outcome.num_killed == 1
    refused = ' '.join(outcome.tunnel)
    for reason in ('revoked', 'expired', 'CERTIFICATE', 'WRONG_VERSION'):
        assert reason in refused


@pytest.fixture
def signing(fleet, tmp_path, monkeypatch):
    """Return a node that signs its stream and has found a line, with no tunnel before it."""
    folder = shutil.copytree(fleet / 'vehicle', tmp_path / 'vehicle')
    (folder / 'fastdds.xml').unlink(missing_ok=True)
    monkeypatch.setenv(VARIABLE, str(folder))
    monkeypatch.setenv('ROS_HOME', str(tmp_path))
    rig = Rig()
    rig.feed()
    assert rig.call('segment').success
    rig.feed(2)
    assert rig.call('segment').message.startswith('3 lines, 6 spans')
    yield rig
    rig.close()


@pytest.mark.slow
def test_what_is_forged_replayed_and_reordered_is_counted_and_shown(signing, fleet, tmp_path):
    key = (fleet / 'vehicle/stream.key').read_bytes()
    source, earlier = Source(5), Signer(key, 1)  # a flight of long ago, by the same vehicle
    recorded = [earlier.sign(source.summary(k, keyframe=not k, tables=NO_TABLES))
                for k in range(10)]
    path = tmp_path / 'recorded'
    path.write_bytes(b''.join(struct.pack('<I', len(item)) + item for item in recorded))
    ground = shutil.copytree(fleet / 'ground', tmp_path / 'ground')
    with Processes(tmp_path / 'home', signing.domain) as processes:
        near = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
                'FASTRTPS_DEFAULT_PROFILES_FILE': ROOT / 'config/fastdds.xml'}
        seen = processes.start_monitor(
            '--no-corridor', '--node', '/relay/plc_inspect', PLC_KEYS=ground, **near
        )
        forger = processes.start(FORGER, path, **near)
        said = read_lines(forger.stdout)

        def look():
            return json.loads(seen[-1]) if seen else None

        def count(name):
            return look()['counts'][name]

        wait_for(lambda: said, 'tries of the forger', PATIENCE)
        tried = json.loads(said[0])
        assert tried['forged'] > 40
        assert tried['replayed'] >= 10 + 6
        wait_for(lambda: count('forged') >= tried['forged']
                 and count('replayed') >= tried['replayed'], f'{tried} in {look()["counts"]}')
        passed = look()['counts']['messages']
        wait_for(lambda: count('messages') > passed + 1, 'the next messages of the node')
        counts = look()['counts']
        assert {name: counts[name] for name in tried} == tried  # each one, and none twice
        assert counts['malformed'] == counts['reordered'] == counts['foreign'] == 0
        assert counts['lost_summary'] == counts['restarts'] == 0
        check_picture(look(), signing)
        texts = [item['text'] for item in look()['events']]
        assert any(text.startswith('messages that the node did not send') for text in texts)
        assert any(text.startswith('messages that were sent before') for text in texts)

        forger.stdin.write('\n')
        forger.stdin.flush()
        wait_for(lambda: len(said) > 1, 'wrong order', PATIENCE)
        pairs = json.loads(said[1])['reordered']
        wait_for(lambda: count('reordered') >= pairs, f'{pairs} in {look()["counts"]}')
        wait_for(lambda: look()['complete'], 'complete picture')
        check_picture(look(), signing)


def check_picture(picture, rig):
    """Check that a monitor shows what its node found."""
    assert picture['link'] == 'live'
    found = {(item.span.line_id, item.span.span_id) for item in rig.node.state.confirmed}
    assert {(item['line_id'], item['span_id']) for item in picture['spans']} == found
    assert len(found) == 6
