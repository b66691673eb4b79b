# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What is open to the network, and a node that refuses to start on it; real processes."""

import json
import os
from pathlib import Path
import signal
import socket
import ssl
import subprocess
import sys
import threading

import pytest
from rig import take_domain

from plc_inspect.errors import ConfigError
from plc_inspect.security.command import main
from plc_inspect.security.exposure import Exposure, look_at_exposure, refuses_strangers
from plc_inspect.security.tunnel import make_context

ROOT = Path(__file__).parents[2]
NODE, MONITOR = 'plc_inspect.ros.node.onboard', 'plc_inspect.monitor.command'
CHOICES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'ROS_AUTOMATIC_DISCOVERY_RANGE', 'PLC_KEYS')
STRANGER = ROOT / 'bench/common/stranger.py'
NO_PLUGINS = 'this Fast DDS has no security plugins'


@pytest.fixture(scope='module')
def keys(tmp_path_factory):
    """Make keys with profiles for a machine of its own."""
    folder = tmp_path_factory.mktemp('fleet') / 'keys'
    ports = []
    for _ in range(2):
        with socket.socket() as probe:
            probe.bind(('127.0.0.1', 0))
            ports.append(str(probe.getsockname()[1]))
    assert main(['create', str(folder)]) == 0
    for name, given in (('vehicle', ['--listen', ports[0], '--aboard', ports[1]]),
                        ('ground', ['--connect', ports[0]])):
        assert main(['profile', str(folder / name), *given]) == 0
    return folder


@pytest.fixture(scope='module')
def environment(tmp_path_factory):
    """Return an environment that chooses nothing yet."""
    own = {name: value for name, value in os.environ.items() if name not in CHOICES}
    return own | {'ROS_HOME': str(tmp_path_factory.mktemp('home')),
                  'ROS_DOMAIN_ID': str(take_domain())}


def run_node(environment, *arguments):
    """Run a node that is to refuse, and return what it says."""
    done = subprocess.run(
        [sys.executable, '-m', NODE, '--ros-args', *arguments], cwd=ROOT, env=environment,
        capture_output=True, text=True, timeout=90, check=False,
    )
    lines = [line for line in done.stderr.splitlines() if '[rcl]' not in line]
    assert done.returncode == 2, done.stderr
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith('plc_node: ')
    return lines[0]


@pytest.mark.slow
def test_it_refuses_what_is_open(keys, environment):
    require = ('-p', 'security.require:=tls')
    assert 'graph is open to the network: UDP ' in run_node(environment, *require)
    trap = environment | {
        'PLC_KEYS': str(keys / 'vehicle'), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    }
    assert 'graph is open to the network: UDP ' in run_node(trap, *require)
    assert 'ROS_SECURITY_ENABLE' in run_node(environment, '-p', 'security.require:=sros2')
    assert 'not a folder of a member' in run_node(environment | {'PLC_KEYS': '/nowhere'})


def test_without_plugins_one_line_says_what_to_do(keys, environment):
    secure = environment | {
        'ROS_SECURITY_ENABLE': 'true', 'ROS_SECURITY_STRATEGY': 'Enforce',
        'ROS_SECURITY_KEYSTORE': str(keys / 'vehicle/sros2'),
    }
    probe = subprocess.run(
        [sys.executable, '-c', 'import rclpy; rclpy.init(); rclpy.create_node("probe")',
         '--ros-args', '--enclave', '/plc_inspect/vehicle'],
        env=secure, capture_output=True, text=True, timeout=60, check=False,
    )
    if 'security libraries' not in probe.stderr:
        pytest.skip('this Fast DDS has security plugins')
    text = run_node(secure, '--enclave', '/plc_inspect/vehicle')
    assert NO_PLUGINS in text
    assert 'docs/security.md' in text


def test_under_sros2_the_ground_reads_and_strangers_see_nothing(keys, environment):
    secure = environment | {'ROS_SECURITY_ENABLE': 'true', 'ROS_SECURITY_STRATEGY': 'Enforce'}
    node = subprocess.Popen(
        [sys.executable, '-m', NODE, '--ros-args', '--enclave', '/plc_inspect/vehicle', '-p',
         'security.require:=sros2'], cwd=ROOT, stderr=subprocess.PIPE, text=True,
        env=secure | {'ROS_SECURITY_KEYSTORE': str(keys / 'vehicle/sros2'),
                      'ROS_DOMAIN_ID': '0'},
    )
    try:
        if any(NO_PLUGINS in line for line in node.stderr if 'plc_node' in line):
            pytest.skip(f'{NO_PLUGINS}: this needs a sourced Jazzy')
        done = subprocess.run(
            [sys.executable, '-m', MONITOR, '--once', '--wait', '60', '--ros-args', '--enclave',
             '/plc_inspect/ground'], cwd=ROOT, timeout=120, check=False,
            env=secure | {'ROS_SECURITY_KEYSTORE': str(keys / 'ground/sros2'),
                          'ROS_DOMAIN_ID': '0'},
        )
        assert done.returncode == 0
        assert try_everything(environment | {'ROS_DOMAIN_ID': '0'}, 10.0) == NOTHING
    finally:
        node.kill()
        node.wait()


NOTHING = {'nodes': [], 'messages': 0, 'services': [], 'answers': [], 'listeners': 0}


def try_everything(environment, seconds):
    """Return what a stranger finds."""
    done = subprocess.run([sys.executable, STRANGER, str(seconds)], env=environment,
                          capture_output=True, text=True, timeout=90, check=True)
    return json.loads(next(line for line in done.stdout.splitlines() if line.startswith('{')))


@pytest.mark.slow
def test_nothing_of_a_node_with_keys_is_on_the_network(keys, environment):
    home = environment | {'PLC_KEYS': str(keys / 'vehicle')}
    node = subprocess.Popen(
        [sys.executable, '-m', NODE, '--ros-args', '-p', 'security.require:=tls'], cwd=ROOT,
        env=home, stderr=subprocess.PIPE, text=True,
    )
    try:
        assert any('ready' in line for line in iter(node.stderr.readline, ''))
        found = try_everything(environment, 6.0)
        assert min(found.pop('tried').values()) > 0
        assert found == NOTHING
        done = subprocess.run(  # a member, on loopback as the tunnel is
            [sys.executable, '-m', MONITOR, '--once', '--json', '--wait', '60'], cwd=ROOT,
            env=environment | {'PLC_KEYS': str(keys / 'ground')}, capture_output=True, text=True,
            timeout=90, check=False,
        )
        assert done.returncode == 0, done.stderr
        counts = json.loads(done.stdout)['counts']
        assert [counts[name] for name in ('forged', 'replayed', 'foreign')] == [0, 0, 0]
    finally:
        node.send_signal(signal.SIGINT)
        node.stderr.close()
        assert node.wait(30.0) in (0, -signal.SIGPIPE)


def test_ports_are_tried_as_a_stranger_would(keys):
    context = make_context(keys / 'vehicle', server=True)
    lax = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    lax.load_cert_chain(keys / 'vehicle/member.crt', keys / 'vehicle/member.key')

    def serve(listener, tls):
        link, _ = listener.accept()
        with link:
            try:
                with tls.wrap_socket(link, server_side=True) as secure:
                    secure.recv(1)
            except OSError:
                pass

    for tls, closed in ((context, True), (lax, False)):
        with socket.create_server(('127.0.0.1', 0)) as listener:
            thread = threading.Thread(target=serve, args=(listener, tls), daemon=True)
            thread.start()
            assert refuses_strangers(listener.getsockname()) == closed
            thread.join(10.0)
    with socket.create_server(('127.0.0.1', 0)) as silent:
        assert not refuses_strangers(silent.getsockname())


def test_sockets_are_seen():
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wide,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own,
        socket.create_server(('0.0.0.0', 0)) as listener,
    ):
        wide.bind(('0.0.0.0', 0))
        own.bind(('127.0.0.1', 0))
        found = look_at_exposure()
        assert ('0.0.0.0', wide.getsockname()[1]) in found.udp
        assert own.getsockname()[1] not in [port for _, port in found.udp]
        assert ('0.0.0.0', listener.getsockname()[1]) in found.plain


def test_what_is_required_is_demanded():
    def expose(**values):
        given = {'udp': (), 'plain': (), 'closed': (), 'sros2': False, 'own_profile': False}
        return Exposure(**(given | values))

    for exposure, require in (
        (expose(), 'off'), (expose(udp=(('0.0.0.0', 7400),)), 'off'),
        (expose(own_profile=True), 'tls'), (expose(sros2=True), 'sros2'),
    ):
        exposure.demand(require)
    for exposure, require, text in (
        (expose(), 'tls', 'PLC_KEYS gave no profile'),
        (expose(own_profile=True, udp=(('0.0.0.0', 7400),)), 'tls', 'UDP 0.0.0.0:7400'),
        (expose(own_profile=True, plain=(('10.0.0.1', 80),)), 'tls', 'TCP 10.0.0.1:80'),
        (expose(own_profile=True), 'sros2', 'ROS_SECURITY_ENABLE'),
    ):
        with pytest.raises(ConfigError, match=text):
            exposure.demand(require)
