# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Keys for a flight among strangers, and machines on one bridge, each a network namespace."""

from collections.abc import Callable
from datetime import datetime, timedelta, UTC
import os
from pathlib import Path
import shutil
import signal
import subprocess
import sys
import threading
import time

from plc_inspect.security.authority import issue, load_credential
from plc_inspect.security.graph_profile import make_profile, Place
from plc_inspect.security.keyring import Keyring
from plc_inspect.security.policy import read_policy

ROOT = Path(__file__).resolve().parents[2]
POLICY = ROOT / 'config/security/policy.xml'
KEYS = 'plc_inspect.security.command'
CHOICES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'ROS_AUTOMATIC_DISCOVERY_RANGE', 'PLC_KEYS')
PORT, ABOARD = 17_411, 17_412
PATIENCE = 60.0
OWN = ('vehicle', 'ground')
"""Others have machines of their own in truth: here they get what these leave."""


class Fleet:
    """
    Keys for a flight, with those of strangers.

    Parameters
    ----------
    folder : Path
        Where they go.

    """

    def __init__(self, folder: Path) -> None:
        policy = read_policy(POLICY)
        now = datetime.now(UTC)
        self.folder, self.place = folder, Place('10.77.0.1', 7411)
        keyring = Keyring(folder / 'keys', policy)
        keyring.create(domain=0, days=30, hosts=())
        shutil.copytree(folder / 'keys/logger', folder / 'revoked')
        keyring.revoke('logger')
        Keyring(folder / 'other', policy).create(domain=0, days=30, hosts=())
        own = folder / 'keys'
        write_profile(own / 'vehicle', listen=PORT, aboard=ABOARD)
        write_profile(own / 'ground', connect=PORT)
        write_profile(own / 'driver', aboard=ABOARD)
        expired = shutil.copytree(own / 'ground', folder / 'expired')
        root = load_credential(
            (own / 'authority/root.key').read_bytes(), (own / 'authority/root.crt').read_bytes()
        )
        ended = issue(root, '/plc_inspect/ground', 1, (), now - timedelta(days=3))
        (expired / 'member.key').write_bytes(ended.key_pem)
        (expired / 'member.crt').write_bytes(ended.pem)
        self.keys_of_strangers = {
            'certificate of another authority': folder / 'other/ground',
            'revoked certificate': folder / 'revoked',
            'certificate that has ended': expired,
        }

    def keys(self, name: str) -> dict[str, str]:
        """Return the environment of a member."""
        return {'PLC_KEYS': str(self.folder / 'keys' / name)}


def write_profile(keys: Path, **ports: int) -> dict[str, str]:
    """Write a Fast DDS profile and return the environment that chooses it."""
    (keys / 'fastdds.xml').write_text(make_profile(**ports), encoding='utf-8')
    return {'FASTRTPS_DEFAULT_PROFILES_FILE': str(keys / 'fastdds.xml')}


class Network:
    """Machines on one bridge, each with network and memory of its own, the vehicle first."""

    def __init__(self) -> None:
        self._mark = f'plc{os.getpid()}'
        self._machines: dict[str, tuple[str, subprocess.Popen[str]]] = {}
        self.join('vehicle')

    def __enter__(self) -> 'Network':
        """Return it."""
        return self

    def __exit__(self, *_: object) -> None:
        """Take it away."""
        for name, holder in self._machines.values():
            holder.kill()
            holder.wait()
            run_ip('netns', 'del', name)

    def join(self, machine: str) -> list[str]:
        """Return how to start a command on a machine, which is set up at first."""
        if machine not in self._machines:
            self._set_up(machine, len(self._machines) + 1)
        return ['nsenter', '-t', str(self._machines[machine][1].pid), '-n', '-m']

    def find_pid(self, machine: str) -> int:
        """Return the number of a process on a machine, for what /proc tells of its network."""
        return self._machines[machine][1].pid

    def find_port(self, machine: str) -> str:
        """Return the device of the vehicle's bridge that leads to a machine."""
        return f'port{list(self._machines).index(machine) + 1}'

    def _set_up(self, machine: str, number: int) -> None:
        name, vehicle = f'{self._mark}_{number}', f'{self._mark}_1'
        run_ip('netns', 'add', name)
        holder = subprocess.Popen(
            ['ip', 'netns', 'exec', name, 'unshare', '-m', 'sh', '-c',
             'mount -t tmpfs shm /dev/shm && echo ready && exec sleep infinity'],
            stdout=subprocess.PIPE, text=True,
        )
        self._machines[machine] = name, holder
        if holder.stdout is None or not holder.stdout.readline():
            raise SystemExit(f'{machine} gets no memory of its own')
        run_ip('-n', name, 'link', 'set', 'lo', 'up')
        if number == 1:
            run_ip('-n', name, 'link', 'add', 'bridge', 'type', 'bridge')
            device = 'bridge'
        else:
            device, port = 'eth0', f'port{number}'
            run_ip('-n', name, 'link', 'add', device, 'type', 'veth', 'peer', 'name', port,
                   'netns', vehicle)
            run_ip('-n', vehicle, 'link', 'set', port, 'master', 'bridge', 'up')
        run_ip('-n', name, 'addr', 'add', f'10.77.0.{number}/24', 'dev', device)
        run_ip('-n', name, 'link', 'set', device, 'up')


def lacks_networks() -> str:
    """Return why there can be no network namespaces here, '' where there can be."""
    try:
        name = f'plc{os.getpid()}_try'
        run_ip('netns', 'add', name)
        run_ip('netns', 'del', name)
    except (OSError, subprocess.CalledProcessError) as error:
        detail = getattr(error, 'stderr', '') or str(error)
        return f'machines on a network of their own want root and iproute2: {detail.strip()}'
    return ''


def run_ip(*arguments: str) -> None:
    """Run ip, which is part of iproute2."""
    subprocess.run(['ip', *arguments], check=True, capture_output=True, text=True)


class Processes:
    """Processes on machines of a network, which end with the block."""

    def __init__(self, home: Path, network: Network) -> None:
        self.network = network
        self._all: list[subprocess.Popen[str]] = []
        clean = {name: value for name, value in os.environ.items() if name not in CHOICES}
        self._environment = clean | {'ROS_DOMAIN_ID': '1', 'ROS_HOME': str(home)}

    def __enter__(self) -> 'Processes':
        """Return it."""
        return self

    def __exit__(self, *_: object) -> None:
        """Kill what is left."""
        for process in self._all:
            if process.poll() is None:
                process.kill()
            process.wait(PATIENCE)

    def start(
        self, machine: str, environment: dict[str, str], *command: object
    ) -> 'subprocess.Popen[str]':
        """Start a Python process on a machine."""
        polite = [] if machine in OWN else ['nice', '-n', '19']
        process = subprocess.Popen(
            [*self.network.join(machine), *polite, sys.executable, *map(str, command)], cwd=ROOT,
            env=self._environment | environment, text=True, stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )
        self._all.append(process)
        return process

    def start_tunnel(
        self, machine: str, keys: Path, place: Place
    ) -> 'tuple[subprocess.Popen[str], list[str]]':
        """Start an end of the tunnel and return it, with what it will say at its end."""
        word = '--listen' if machine == 'vehicle' else '--connect'
        tunnel = self.start(machine, {}, '-m', KEYS, 'tunnel', keys, word,
                            f'{place.address}:{place.port}', '--port', PORT)
        read_lines(tunnel.stderr)
        return tunnel, read_lines(tunnel.stdout)


def read_lines(stream: object) -> list[str]:
    """Return a list that gets the lines of a stream as they come."""
    lines: list[str] = []
    threading.Thread(
        target=lambda: lines.extend(iter(stream.readline, '')), daemon=True
    ).start()
    return lines


def wait_until(
    condition: Callable[[], object], what: str, patience: float = PATIENCE
) -> None:
    """Wait for a condition, or fail."""
    end = time.monotonic() + patience
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f'no {what} within {patience:g} s')
        time.sleep(0.05)


def interrupt(process: 'subprocess.Popen[str]', patience: float = PATIENCE) -> int:
    """Interrupt a process and return the code that it ends with."""
    process.send_signal(signal.SIGINT)
    return process.wait(patience)
