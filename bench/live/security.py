# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Flies the demo flight through the tunnel while strangers try everything, and prints tables.

Node, driver, monitor, both ends of the tunnel and strangers are processes, each machine a network
namespace of its own on one bridge; that wants root.  Strangers use the network and the tunnel,
with keys of all kinds.  ``--write`` puts the tables into docs/security.md.
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
import json
import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common.tables import render_table, replace_section
from networks.fleet import (
    Fleet,
    interrupt,
    Network,
    PATIENCE,
    PORT,
    Processes,
    read_lines,
    ROOT,
    wait_until,
    write_profile,
)

from plc_inspect.offline.readers.bags import Recording

NODE, PLAYER = 'plc_inspect.ros.node.onboard', 'plc_inspect.ros.play'
MONITOR = 'plc_inspect.monitor.command'
COMMON = ROOT / 'bench/common'
STRANGER, BARE, TALKER = (
    COMMON / name for name in ('stranger.py', 'bare_tunnel.py', 'garbage.py')
)
MEMBER = 'certificate of the fleet, who only looks'
GARBAGE, SLOW, VICTIMS = 100, 20, 3
"""Connections that say nonsense, those that say one byte a second, monitors that are killed."""
SECONDS = 20.0
"""How long strangers try."""
PAUSE = 4.0
"""Between two that are killed [s]."""
START = 300.0
"""Longest wait for the node: it may have to compile its kernels [s]."""
DOCUMENT = ROOT / 'docs/security.md'


@dataclass(slots=True, kw_only=True)
class Outcome:
    """What became of a flight among strangers."""

    num_scans: int
    """Scans that the driver sent."""
    found: dict[str, dict[str, Any]] = field(default_factory=dict)
    """What each stranger got and tried, as ``stranger.py`` prints it."""
    monitor: dict[str, Any] = field(default_factory=dict)
    """The last that the monitor said, of ``--json``."""
    run: dict[str, Any] = field(default_factory=dict)
    """run.json of the node."""
    num_spans: int = 0
    log: list[str] = field(default_factory=list)
    """Of the node."""
    tunnel: list[str] = field(default_factory=list)
    """What the vehicle's end of the tunnel says of its connections."""
    code: int = -1
    took: float = 0.0
    """How the node ended, and how soon [s]."""
    num_killed: int = 0
    """Monitors that were killed while they were connected."""

    def flaws(self) -> list[str]:
        """Return what did not hold, in words."""
        nothing = {'nodes': [], 'messages': 0, 'services': [], 'answers': [], 'listeners': 0}
        wrong = [
            f'{name} found {found}' for name, found in self.found.items()
            if name != MEMBER and {key: found[key] for key in nothing} != nothing
        ]
        counts, health = self.run['input']['counts'], self.monitor['health']
        refused = sum(self.monitor['counts'][name] for name in ('forged', 'replayed', 'foreign'))
        changes = [line for line in self.log if ': parameter ' in line or ': reset: ' in line]
        member = self.found.get(MEMBER, {'messages': 99, 'nodes': [NODE]})
        wrong += [
            text for text, bad in (
                ('a stranger hardly tried', any(
                    item['tried'].get('services called', 0) < 100
                    for name, item in self.found.items() if name != MEMBER
                )),
                ('not even a member sees the node',
                 member['messages'] < 10 or not member['nodes']),
                ('scans were lost', counts['num_scans'] != self.num_scans
                 or counts['num_scans_lost'] or counts['scans_dropped']),
                ('the ground missed scans', health['scans'] != self.num_scans),
                ('the ground missed messages', self.monitor['counts']['lost_summary']),
                ('the ground refused messages', refused),
                ('something was changed',
                 changes or self.run['settings']['hazards']['critical_distance'] != 2.0),
                ('the node failed', self.code),
            ) if bad
        ]
        return wrong


def count_scans(bag: Path, start: float) -> int:
    """Return how many scans of a recording are sent from a time on."""
    with Recording(bag, 'velodyne_points', 'odometry') as recording:
        messages = [(item.log_stamp_ns, item.topic) for item in recording.raw_messages()]
    begin = messages[0][0] + start * 1e9
    return sum(stamp >= begin and 'points' in topic for stamp, topic in messages)


def fly(
    bag: Path, folder: Path, network: Network, *, start: float = 0.0, seconds: float = SECONDS,
    victims: int = VICTIMS, attacked: bool = True, rate: float = 1.0,
) -> Outcome:
    """Fly a recording from some time on, with attacks or without, and return what came of it."""
    fleet, outcome = Fleet(folder), Outcome(num_scans=count_scans(bag, start))
    with Processes(folder, network) as processes:
        ends = {
            name: processes.start_tunnel(name, folder / 'keys' / name, fleet.place)
            for name in ('vehicle', 'ground')
        }
        node = processes.start(
            'vehicle', fleet.keys('vehicle'), '-m', NODE, '--ros-args', '-p',
            'security.require:=tls', '-p', f'output.directory:={folder / "out"}',
        )
        outcome.log = read_lines(node.stderr)
        wait_until(lambda: any('ready' in line for line in outcome.log), 'node', START)
        _, seen = start_monitor(processes, fleet)
        doomed = [
            start_monitor(processes, fleet)[0] for _ in range(victims if attacked else 0)
        ]
        strangers = start_strangers(processes, fleet, seconds) if attacked else {}
        if attacked:
            processes.start('garbage', {}, TALKER, fleet.place.address, fleet.place.port, GARBAGE,
                            SLOW)
        player = processes.start('vehicle', fleet.keys('driver'), '-m', PLAYER, bag, '--start',
                                 start, '--rate', rate, '--wait', '30', '--quiet')
        for victim in doomed:
            time.sleep(PAUSE)
            victim.kill()
        outcome.num_killed = len(doomed)
        outcome.found = {name: read_result(process) for name, process in strangers.items()}
        if player.wait(START):
            raise SystemExit('the player failed')
        time.sleep(3.0)  # the summary comes each second
        outcome.monitor = json.loads(seen[-1])
        began = time.monotonic()
        outcome.code = interrupt(node, START)
        outcome.took = time.monotonic() - began
        end, said = ends['vehicle']
        interrupt(end)
        wait_until(lambda: any(' connections, ' in line for line in said), 'word of the tunnel')
        time.sleep(0.2)
        outcome.tunnel = said[next(k for k, line in enumerate(said) if ' connections, ' in line):]
    if not (folder / 'out/run.json').exists():
        raise SystemExit(f'the node saved nothing: {"".join(outcome.log[-3:])}')
    outcome.run = json.loads((folder / 'out/run.json').read_text(encoding='utf-8'))
    spans = json.loads((folder / 'out/spans.json').read_text(encoding='utf-8'))
    outcome.num_spans = len(spans['spans'])
    return outcome


def start_monitor(
    processes: Processes, fleet: Fleet
) -> 'tuple[subprocess.Popen[str], list[str]]':
    """Start a monitor on the ground and return it with what it says, when it is connected."""
    monitor = processes.start('ground', fleet.keys('ground'), '-m', MONITOR, '--json')
    seen = read_lines(monitor.stdout)
    wait_until(lambda: seen and json.loads(seen[-1])['link'] == 'live', 'monitor', START)
    return monitor, seen


def start_strangers(
    processes: Processes, fleet: Fleet, seconds: float
) -> 'dict[str, subprocess.Popen[str]]':
    """Let all strangers try at once, and a member look beside them."""
    environments: dict[str, dict[str, str]] = {
        'plain UDP': {}, '`ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST`': {
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        },
    }
    for name, keys in {MEMBER: fleet.folder / 'keys/operator', **fleet.keys_of_strangers}.items():
        processes.start_tunnel(name, keys, fleet.place)
        environments[name] = write_profile(keys, connect=PORT)
    bare = 'TLS without a certificate'
    processes.start(bare, {}, BARE, fleet.place.address, fleet.place.port, PORT)
    (fleet.folder / 'bare').mkdir()
    environments[bare] = write_profile(fleet.folder / 'bare', connect=PORT)
    return {
        name: processes.start(
            name, environment, STRANGER, seconds, *(['--look'] if name == MEMBER else [])
        ) for name, environment in environments.items()
    }


def read_result(process: 'subprocess.Popen[str]') -> dict[str, Any]:
    """Return what a stranger found; Fast DDS writes its errors between."""
    lines = process.communicate(timeout=PATIENCE + SECONDS)[0].splitlines()
    result: dict[str, Any] = json.loads(next(line for line in lines if line.startswith('{')))
    return result


def describe_strangers(outcome: Outcome) -> str:
    """Return the table of what strangers tried and got."""
    tried, got = ('messages sent', 'services called'), (
        'nodes', 'messages', 'services', 'answers', 'listeners'
    )
    rows = []
    for name, found in outcome.found.items():
        values = [found['tried'].get(key, 0) for key in tried] + [
            value if isinstance(value, int) else len(value) for value in map(found.get, got)
        ]
        rows.append((name, *map(str, values)))
    return render_table(
        ('stranger', *(f'tried: {key}' for key in tried), 'nodes seen', 'messages read',
         'services seen', 'answers', 'listeners'), rows,
    )


def describe_flights(outcomes: Mapping[str, Outcome]) -> str:
    """Return the table of what became of flights."""
    columns = [list_figures(outcome) for outcome in outcomes.values()]
    return render_table(
        ('of the flight', *outcomes),
        [(name, *(column[name] for column in columns)) for name in columns[0]],
    )


def list_figures(outcome: Outcome) -> dict[str, str]:
    """Return what became of a flight, by what it is of."""
    counts, seen = outcome.run['input']['counts'], outcome.monitor
    dropped = ', '.join(f'{count} ({why})' for why, count in counts['scans_dropped'].items())
    refused = sum(seen['counts'][name] for name in ('forged', 'replayed', 'foreign'))
    return {
        'scans sent, taken in': f'{outcome.num_scans}, {counts["num_scans"]}',
        'scans lost, dropped': f'{counts["num_scans_lost"]}, {dropped or 0}',
        'spans: node, ground': f'{outcome.num_spans}, {len(seen["spans"])}',
        'scans that the ground knows of': f'{seen["health"]["scans"]:.0f}',
        'messages of the stream lost, refused': f'{seen["counts"]["lost_summary"]}, {refused}',
        'connected monitors that were killed': str(outcome.num_killed),
        'connections at the vehicle': outcome.tunnel[0].partition(':')[2].strip(),
        'the node ended': f'with {outcome.code}, within {outcome.took:.0f} s',
    }


def main(argv: Sequence[str] | None = None) -> int:
    """Run the bench; 1 where something does not hold."""
    parser = argparse.ArgumentParser(description='Flies through the tunnel among strangers.')
    parser.add_argument('bag', type=Path, nargs='?', default=ROOT / 'bags/demo')
    parser.add_argument('--rate', type=float, default=1.0, metavar='R',
                        help='speed of the flight; less than 1 on a machine that is busy')
    parser.add_argument('--write', action='store_true', help='put the tables into the docs')
    arguments = parser.parse_args(argv)
    flights, flaws = {}, []
    for name in ('alone', 'among strangers'):
        with tempfile.TemporaryDirectory() as folder, Network() as network:
            outcome = fly(
                arguments.bag, Path(folder), network, attacked=name == 'among strangers',
                rate=arguments.rate,
            )
        flights[name] = outcome
        flaws += [f'{name}: {flaw}' for flaw in outcome.flaws()]
    refused = [line.removeprefix('plc_keys:').strip() for line in outcome.tunnel[1:]]
    text = (
        f'{describe_strangers(outcome)}\n\n{describe_flights(flights)}\n\n'
        f'Beside the strangers {GARBAGE} connections said nonsense and {SLOW} a byte a second. '
        f'The tunnel told of: {"; ".join(refused)}.\n'
        f'The flight went at {arguments.rate:g} times its speed. '
        f'The load was {os.getloadavg()[1]:.0f} on {os.cpu_count()} cores.'
    )
    print(text)
    for flaw in flaws:
        print(f'security: {flaw}')
    if arguments.write:
        replace_section(DOCUMENT, 'strangers', text)
    return 1 if flaws else 0


if __name__ == '__main__':
    sys.exit(main())
