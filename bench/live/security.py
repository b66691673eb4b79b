# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Flies the demo flight over mutual TLS while strangers try everything, and prints a table.

Node, driver, monitor, both ends of the tunnel and strangers are processes, each machine a network
namespace of its own on one bridge; that wants root.  Strangers use the network and the tunnel,
with keys of all kinds.
"""

import argparse
from collections.abc import Sequence
from datetime import datetime, timedelta, UTC
import json
import os
from pathlib import Path
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from typing import Any

from plc_inspect.security.authority import issue, load_credential
from plc_inspect.security.graph_profile import make_profile, Place
from plc_inspect.security.keyring import Keyring
from plc_inspect.security.policy import read_policy

ROOT = Path(__file__).resolve().parents[2]
NODE, PLAYER = 'plc_inspect.ros.node.onboard', 'plc_inspect.ros.play'
MONITOR, KEYS = 'plc_inspect.monitor.command', 'plc_inspect.security.command'
STRANGER = ROOT / 'bench/common/stranger.py'
CHOICES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'ROS_AUTOMATIC_DISCOVERY_RANGE', 'PLC_KEYS')
GARBAGE, SLOW = 100, 20
"""Connections that say nonsense, and those that say one byte a second."""
PORT, ABOARD = 17_411, 17_412
START, PATIENCE = 200.0, 60.0


class Fleet:
    """
    Keys for a flight, with those of strangers.

    Parameters
    ----------
    folder : Path
        Where they go.

    """

    def __init__(self, folder: Path) -> None:
        policy = read_policy(ROOT / 'config/security/policy.xml')
        now = datetime.now(UTC)
        self.folder = folder
        self.place = Place('10.77.0.1', 7411)
        keyring = Keyring(folder / 'keys', policy)
        keyring.create(domain=0, days=30, hosts=())
        shutil.copytree(folder / 'keys/logger', folder / 'revoked')
        keyring.revoke('logger')
        other = Keyring(folder / 'other', policy)
        other.create(domain=0, days=30, hosts=())
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
            'other CA': folder / 'other/ground', 'revoked': folder / 'revoked',
            'expired': expired,
        }

    def keys(self, name: str) -> dict[str, str]:
        """Return the environment of a member."""
        return {'PLC_KEYS': str(self.folder / 'keys' / name)}


class Network:
    """Machines on one bridge, each a network namespace, the vehicle first."""

    def __init__(self) -> None:
        self._mark = f'plc{os.getpid()}'
        self._names: dict[str, str] = {}
        self.join('vehicle')

    def __enter__(self) -> 'Network':
        """Return it."""
        return self

    def __exit__(self, *_: object) -> None:
        """Take it away."""
        for name in self._names.values():
            run_ip('netns', 'del', name)

    def join(self, machine: str) -> list[str]:
        """Return how to start a command on a machine, which is set up at first."""
        if machine not in self._names:
            number = len(self._names) + 1
            name, vehicle = f'{self._mark}_{number}', f'{self._mark}_1'
            run_ip('netns', 'add', name)
            self._names[machine] = name
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
        return ['ip', 'netns', 'exec', self._names[machine]]


def run_ip(*arguments: str) -> None:
    """Run ip, which is part of iproute2."""
    subprocess.run(['ip', *arguments], check=True)


def write_profile(keys: Path, **ports: int) -> dict[str, str]:
    """Write a Fast DDS profile and return the environment that chooses it."""
    (keys / 'fastdds.xml').write_text(make_profile(**ports), encoding='utf-8')
    return {'FASTRTPS_DEFAULT_PROFILES_FILE': str(keys / 'fastdds.xml')}


class Processes:
    """Processes that end with the block."""

    def __init__(self, folder: Path, domain: int, network: Network) -> None:
        self.network = network
        self._all: list[subprocess.Popen[str]] = []
        clean = {name: value for name, value in os.environ.items() if name not in CHOICES}
        self._environment = clean | {'ROS_DOMAIN_ID': str(domain), 'ROS_HOME': str(folder)}

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
        self, machine: str, environment: dict[str, str], *command: str, **options: Any
    ) -> 'subprocess.Popen[str]':
        """Start a Python process on a machine."""
        process = subprocess.Popen(
            [*self.network.join(machine), sys.executable, *command], cwd=ROOT,
            env=self._environment | environment, text=True, **options,
        )
        self._all.append(process)
        return process

    def start_tunnel(self, machine: str, keys: Path, place: Place) -> None:
        """Start an end of the tunnel."""
        word = '--listen' if machine == 'vehicle' else '--connect'
        self.start(machine, {}, '-m', KEYS, 'tunnel', str(keys), word,
                   f'{place.address}:{place.port}', '--port', str(PORT),
                   stdout=subprocess.DEVNULL)

    def start_strangers(self, fleet: Fleet, seconds: float) -> 'dict[str, subprocess.Popen[str]]':
        """Let all strangers try at once."""
        environments = {
            'plain UDP': {}, 'LOCALHOST range': {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'},
        }
        for name, keys in fleet.keys_of_strangers.items():
            self.start_tunnel(name, keys, fleet.place)
            environments[name] = write_profile(keys, connect=PORT)
        self.start('no certificate', {}, str(STRANGER.with_name('bare_tunnel.py')),
                   fleet.place.address, str(fleet.place.port), str(PORT))
        (fleet.folder / 'bare').mkdir()
        environments['no certificate'] = write_profile(fleet.folder / 'bare', connect=PORT)
        return {
            name: self.start(name, environment, str(STRANGER), str(seconds),
                             stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
            for name, environment in environments.items()
        }


class Watcher:
    """The monitor's JSON, read in a thread."""

    def __init__(self, process: 'subprocess.Popen[str]') -> None:
        self.last: dict[str, Any] = {}
        self._process = process
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for line in self._process.stdout or ():
            self.last = json.loads(line)

    def health(self, name: str) -> float:
        """Return a number of the node's health, 0 for none."""
        return float(self.last.get('health', {}).get(name) or 0.0)


def read_result(process: 'subprocess.Popen[str]') -> dict[str, Any]:
    """Return what a stranger found; Fast DDS writes its errors between."""
    lines = process.communicate(timeout=PATIENCE)[0].splitlines()
    result: dict[str, Any] = json.loads(next(line for line in lines if line.startswith('{')))
    return result


def wait_until(condition: Any, what: str, patience: float = PATIENCE) -> None:
    """Wait for a condition, or fail."""
    end = time.monotonic() + patience
    while not condition():
        if time.monotonic() > end:
            raise SystemExit(f'no {what} within {patience:g} s')
        time.sleep(0.05)


def fly(bag: Path, folder: Path, network: Network) -> None:
    """Fly, attack, and print what became of it."""
    fleet = Fleet(folder)
    with Processes(folder, 1 + os.getpid() % 100, network) as processes:
        for name in ('vehicle', 'ground'):
            processes.start_tunnel(name, folder / 'keys' / name, fleet.place)
        node = processes.start(
            'vehicle', fleet.keys('vehicle'), '-m', NODE, '--ros-args', '-p',
            'security.require:=tls', '-p', f'output.directory:={folder / "out"}',
            stderr=subprocess.DEVNULL,
        )
        watcher = Watcher(processes.start(
            'ground', fleet.keys('ground'), '-m', MONITOR, '--json', stdout=subprocess.PIPE
        ))
        wait_until(lambda: watcher.last.get('link') == 'live', 'monitor', START)
        time.sleep(3.0)
        player = processes.start(
            'vehicle', fleet.keys('driver'), '-m', PLAYER, str(bag), '--wait', '30', '--quiet'
        )
        wait_until(lambda: watcher.health('scans') > 10, 'scans')
        processes.start('garbage', {}, str(STRANGER.with_name('garbage.py')),
                        fleet.place.address, str(fleet.place.port), str(GARBAGE), str(SLOW))
        strangers = processes.start_strangers(fleet, 20.0)
        for _ in range(3):  # members that are killed in the middle
            victim = processes.start(
                'ground', fleet.keys('ground'), '-m', MONITOR, '--json',
                stdout=subprocess.DEVNULL,
            )
            time.sleep(4.0)
            victim.kill()
        found = {name: read_result(process) for name, process in strangers.items()}
        player.wait(START)
        time.sleep(3.0)
        last = watcher.last
        node.send_signal(signal.SIGINT)
        began = time.monotonic()
        code = node.wait(PATIENCE)
        ended = time.monotonic() - began
    print(f'\n| stranger | {" | ".join(next(iter(found.values())))} |')
    print('| --- ' * 6 + '|')
    for name, result in found.items():
        print(f'| {name} | {" | ".join(map(str, result.values()))} |')
    counts = last['counts']
    print(f'\n{GARBAGE} garbage and {SLOW} slow connections, 3 members killed; the node ended '
          f'with {code} within {ended:.0f} s')
    run = json.loads((folder / 'out/run.json').read_text(encoding='utf-8'))
    flown = {
        name: run['input']['counts'][name] for name in
        ('num_scans', 'num_scans_inserted', 'num_scans_lost', 'scans_dropped', 'num_poses')
    }
    spans = json.loads((folder / 'out/spans.json').read_text(encoding='utf-8'))['spans']
    print(f'the node: {len(spans)} spans, {flown}')
    print(f'the monitor: link {last["link"]}, {len(last["spans"])} spans, scans '
          f'{watcher.health("scans"):.0f}, summary lost {counts["lost_summary"]}, refused: '
          + ', '.join(f'{counts[name]} {name}' for name in ('forged', 'replayed', 'foreign')))


def main(argv: Sequence[str] | None = None) -> int:
    """Run the bench."""
    parser = argparse.ArgumentParser(description='Flies over TLS among strangers.')
    parser.add_argument('bag', type=Path, nargs='?', default=ROOT / 'bags/demo')
    arguments = parser.parse_args(argv)
    with tempfile.TemporaryDirectory() as folder, Network() as network:
        fly(arguments.bag, Path(folder), network)
    return 0


if __name__ == '__main__':
    sys.exit(main())
