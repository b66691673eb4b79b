# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The tunnel, with keys of all kinds at its doors."""

import asyncio
import contextlib
from datetime import datetime, timedelta, UTC
import os
from pathlib import Path
import shutil
import signal
import socket
import ssl
import subprocess
import sys
import time

import pytest

from plc_inspect.errors import ConfigError
from plc_inspect.security.authority import issue, load_credential
from plc_inspect.security.graph_profile import Place
from plc_inspect.security.keyring import Keyring
from plc_inspect.security.policy import read_policy
from plc_inspect.security.strangers import MOST_STRANGERS
from plc_inspect.security.tunnel import _take, make_context, MOST_REASONS, Tunnel

ROOT = Path(__file__).parents[2]
NUM_VISITS = 200


@pytest.fixture(scope='module')
def fleet(tmp_path_factory):
    """Return a folder with keys of a fleet and of strangers."""
    folder = tmp_path_factory.mktemp('fleet')
    policy = read_policy(ROOT / 'config/security/policy.xml')
    keyring = Keyring(folder / 'keys', policy)
    keyring.create(domain=0, days=30, hosts=())
    shutil.copytree(folder / 'keys/logger', folder / 'revoked')
    keyring.revoke('logger')
    Keyring(folder / 'foreign', policy).create(domain=0, days=30, hosts=())
    root = load_credential((folder / 'keys/authority/root.key').read_bytes(),
                           (folder / 'keys/authority/root.crt').read_bytes())
    for name, days in (('expired', -3), ('early', 3)):
        shutil.copytree(folder / 'keys/ground', folder / name)
        own = issue(root, '/plc_inspect/ground', 1, (), datetime.now(UTC) + timedelta(days=days))
        (folder / name / 'member.key').write_bytes(own.key_pem)
        (folder / name / 'member.crt').write_bytes(own.pem)
    return folder


def find_port():
    """Return a port that nobody uses."""
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        return probe.getsockname()[1]


class Rig:
    """A node that says everything twice, behind the vehicle's end of a tunnel."""

    def __init__(self, keys):
        self.place, self.node = Place('127.0.0.1', find_port()), find_port()
        self.tunnel = Tunnel(keys, self.place, self.node)
        self.heard, self.tasks = b'', []

    async def __aenter__(self):
        async def echo(reader, writer):
            while data := await reader.read(100_000):
                self.heard += data
                writer.write(data * 2)
                await writer.drain()
            writer.close()

        self.server = await asyncio.start_server(echo, '127.0.0.1', self.node)
        self.tasks.append(asyncio.create_task(self.tunnel.listen()))
        await asyncio.sleep(0.1)
        return self

    async def __aexit__(self, *_):
        for task in self.tasks:
            task.cancel()
        await asyncio.gather(*self.tasks, return_exceptions=True)
        self.server.close()

    async def ask(self, keys, data=b'hello', **options):
        """Return what comes back through a tunnel with some keys."""
        entrance = find_port()
        self.other = Tunnel(keys, self.place, entrance, **options)
        self.tasks.append(asyncio.create_task(self.other.connect()))
        await asyncio.sleep(0.1)
        reader, writer = await asyncio.open_connection('127.0.0.1', entrance)
        writer.write(data)
        answer = b''
        with contextlib.suppress(ConnectionError):
            while len(answer) < 2 * len(data):
                piece = await asyncio.wait_for(reader.read(100_000), 5.0)
                if not piece:
                    break
                answer += piece
        writer.close()
        return answer


def run(body):
    """Run a test's coroutine with time to spare."""
    return asyncio.run(asyncio.wait_for(body, 60.0))


def test_members_reach_the_node(fleet):
    async def body():
        async with Rig(fleet / 'keys/vehicle') as rig:
            assert await rig.ask(fleet / 'keys/ground') == b'hellohello'
            large = os.urandom(3_000_000)
            assert len(await rig.ask(fleet / 'keys/operator', large)) == 6_000_000
            assert rig.heard == b'hello' + large
            assert rig.tunnel.counts.refused == 0

    run(body())


@pytest.mark.parametrize(('keys', 'reason'), [
    ('foreign/ground', 'self-signed'), ('revoked', 'revoked'), ('expired', 'expired'),
    ('early', 'not yet valid'),
])
def test_others_reach_nothing(fleet, keys, reason):
    async def body():
        async with Rig(fleet / 'keys/vehicle') as rig:
            assert await rig.ask(fleet / keys) == b''
            assert rig.heard == b''
            reasons = {**rig.tunnel.counts.reasons, **rig.other.counts.reasons}
            assert any(reason in text for text in reasons), reasons
            assert rig.tunnel.counts.accepted == 0

    run(body())


def test_who_shows_nothing_reaches_nothing(fleet):
    async def body():
        async with Rig(fleet / 'keys/vehicle') as rig:
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
            context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
            reader, writer = await asyncio.open_connection(
                '127.0.0.1', rig.place.port, ssl=context
            )
            with contextlib.suppress(OSError):
                writer.write(b'hello')
                assert await reader.read(10) == b''
            writer.close()
            context.maximum_version = ssl.TLSVersion.TLSv1_2
            with pytest.raises((ssl.SSLError, ConnectionError)):
                await asyncio.open_connection('127.0.0.1', rig.place.port, ssl=context)
            assert rig.heard == b''

    run(body())


def test_a_new_revocation_list_holds_at_once(fleet, tmp_path):
    vehicle = shutil.copytree(fleet / 'keys/vehicle', tmp_path / 'vehicle')
    older = fleet / 'revoked/crl.pem'  # of before the logger was revoked

    async def body():
        async with Rig(vehicle) as rig:
            current = (vehicle / 'crl.pem').read_bytes()
            (vehicle / 'crl.pem').write_bytes(older.read_bytes())
            os.utime(vehicle / 'crl.pem', (1, 1))
            assert await rig.ask(fleet / 'revoked') == b'hellohello'
            (vehicle / 'crl.pem').write_bytes(current)
            assert await rig.ask(fleet / 'revoked') == b''

    run(body())


def test_the_other_end_is_who_it_should_be(fleet):
    async def body():
        async with Rig(fleet / 'keys/driver') as rig:  # a member, but no vehicle
            assert await rig.ask(fleet / 'keys/ground', peer='vehicle') == b''
            assert await rig.ask(fleet / 'keys/ground', peer='driver') == b'hellohello'

    run(body())


def test_garbage_and_slow_talkers_are_cut_off(fleet, monkeypatch):
    monkeypatch.setattr('plc_inspect.security.tunnel.HANDSHAKE', 1.0)

    async def body():
        async with Rig(fleet / 'keys/vehicle') as rig:
            slow = [await asyncio.open_connection('127.0.0.1', rig.place.port) for _ in range(20)]
            for number in range(100):
                _, writer = await asyncio.open_connection('127.0.0.1', rig.place.port)
                writer.write(os.urandom(300) if number % 2 else b'RTCP' * 50)
                writer.close()
            assert await rig.ask(fleet / 'keys/ground') == b'hellohello'
            for reader, writer in slow:
                with contextlib.suppress(ConnectionError):
                    assert await asyncio.wait_for(reader.read(10), 10.0) == b''
                writer.close()
            assert rig.heard == b'hello'
            assert rig.tunnel.counts.refused >= 100

    run(body())


@pytest.mark.parametrize('address', ['127.0.0.1', '127.0.0.2'])
def test_silent_strangers_keep_no_member_out(fleet, address):
    async def body():
        async with Rig(fleet / 'keys/vehicle') as rig:
            silent = [await asyncio.open_connection(
                '127.0.0.1', rig.place.port, local_addr=(address, 0)
            ) for _ in range(3 * MOST_STRANGERS)]
            began = time.monotonic()
            assert await rig.ask(fleet / 'keys/ground') == b'hellohello'
            assert time.monotonic() - began < 5.0
            assert rig.tunnel.counts.accepted == 1
            assert len(rig.tunnel._strangers) <= MOST_STRANGERS
            for _, writer in silent:
                writer.close()

    run(body())


def test_who_floods_ends_only_strangers_of_its_own(fleet):
    async def body():
        async with Rig(fleet / 'keys/vehicle') as rig:
            reader, writer = await asyncio.open_connection('127.0.0.1', rig.place.port)
            await asyncio.sleep(0.1)
            others = [await asyncio.open_connection(
                '127.0.0.1', rig.place.port, local_addr=('127.0.0.2', 0)
            ) for _ in range(3 * MOST_STRANGERS)]
            with pytest.raises(TimeoutError):  # it is still waited for
                await asyncio.wait_for(reader.read(1), 0.5)
            for link in (writer, *(other for _, other in others)):
                link.close()

    run(body())


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_what_it_refused_is_told_at_once_and_at_its_end(fleet, number):
    port = find_port()
    tunnel = subprocess.Popen(
        [sys.executable, '-m', 'plc_inspect.security.command', 'tunnel', fleet / 'keys/vehicle',
         '--listen', f'127.0.0.1:{port}', '--port', str(find_port())], cwd=ROOT, text=True,
        stdout=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),  # as in the background
    )
    end = time.monotonic() + 30.0
    while time.monotonic() < end:
        with contextlib.suppress(OSError), socket.create_connection(('127.0.0.1', port)) as link:
            link.sendall(b'nonsense' * 10)
            break
        time.sleep(0.1)
    assert tunnel.stdout.readline() == 'plc_keys: 1 refused: WRONG_VERSION_NUMBER\n'
    tunnel.send_signal(number)
    assert tunnel.communicate(timeout=30.0)[0].splitlines() == [
        'plc_keys: 0 connections, 1 refused', 'plc_keys: 1 refused: WRONG_VERSION_NUMBER',
    ]
    assert tunnel.returncode == 0


def test_refusals_are_told_the_first_time_and_when_they_doubled(tmp_path):
    told = []
    tunnel = Tunnel(tmp_path, Place('127.0.0.1', 1), 1, tell=lambda *own: told.append(own))
    for _ in range(9):
        tunnel._note(PermissionError('the other end is nobody'))
    for number in range(100):
        tunnel._note(OSError(str(number)))
    assert [count for reason, count in told if 'nobody' in reason] == [1, 2, 4, 8]
    assert len(tunnel.counts.reasons) == MOST_REASONS
    assert tunnel.counts.refused == 109


def test_one_connection_after_the_other_is_heard(fleet):
    async def body():
        async with Rig(fleet / 'keys/vehicle') as rig:
            context = make_context(fleet / 'keys/ground', server=False)
            num_heard = 0
            for _ in range(NUM_VISITS):
                reader, writer = await asyncio.wait_for(asyncio.open_connection(
                    '127.0.0.1', rig.place.port, ssl=context, server_hostname='plc_inspect',
                ), 2.0)
                writer.write(b'a')
                num_heard += await asyncio.wait_for(reader.readexactly(2), 2.0) == b'aa'
                writer.close()
            assert num_heard == NUM_VISITS

    run(body())


def test_the_loop_alone_closes_what_it_listens_to():
    async def body():
        with (
            socket.create_server(('127.0.0.1', 0)) as server,
            socket.create_connection(server.getsockname()) as other,
        ):
            link, _ = server.accept()
            link.setblocking(False)
            reader, writer = await _take(link, None)
            link.close()
            other.sendall(b'hello')
            assert await asyncio.wait_for(reader.readexactly(5), 5.0) == b'hello'
            writer.close()
            await writer.wait_closed()

    run(body())


def test_keys_that_are_none_are_told(fleet, tmp_path):
    with pytest.raises(ConfigError, match='not a folder of a member'):
        make_context(tmp_path, server=True)
    with pytest.raises(ConfigError, match='cannot be read'):
        run(Tunnel(tmp_path, Place('127.0.0.1', find_port()), 1).listen())
    with socket.create_server(('127.0.0.1', 0)) as taken:
        place = Place('127.0.0.1', taken.getsockname()[1])
        with pytest.raises(ConfigError, match=f'cannot listen on 127.0.0.1:{place.port}'):
            run(Tunnel(fleet / 'keys/vehicle', place, 1).listen())
