# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
How long an alarm takes from the node's message to the screen, over a thin, long and lossy link.

Vehicle and ground are network namespaces with a link of 256 kbit/s, 2 % loss and 200 ms each way
between them (``networks/thin_path.py``; it needs root).  In the air the node's own stream tells of
a corridor that takes all that its budget allows and of a line of some hundred spans, and raises a
hazard every few seconds; on the ground plc_monitor serves the page to a Chromium.  With --far the
monitor is in the air too, and the browser alone beyond the link.  Printed are the times from the
message that first tells of an alarm to its row on the page.
"""

import argparse
from collections.abc import Sequence
import dataclasses
import json
import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'test'))

from networks.thin_path import ThinPath, write_wrapper

from plc_inspect.node_config import StreamSettings

MOST = 1.0
"""An alarm is on the screen so soon after the node's message [s]."""
EVERY = 3.0
"""Between two alarms [s], and up to so much more."""
SPEED, AHEAD, DENSITY = 8.0, 60.0, 12
"""Of the vehicle [m/s]; the corridor goes on so far before it [m]; points of a square metre."""
IN_SIGHT = 12
"""Spans that change with each tick."""
TOKEN = 'of this bench alone'
WATCH = """void (globalThis.seen = {}, setInterval(() => {
  for (const item of document.querySelectorAll('#alarm-list li[data-state=new] .what')) {
    seen[item.textContent.split(/[,:;] /)[0]] ??= Date.now() / 1000;
  }
}, 10))"""
EVENTS = "[...document.querySelectorAll('#events li')].map(item => item.textContent)"
PORT = 8123


def send(kbps: float, seconds: float, seed: int, num_spans: int) -> int:
    """Be the vehicle: tell what the node's stream tells, and print when each alarm is told."""
    from diagnostic_msgs.msg import DiagnosticStatus
    import rclpy
    from stream_pieces import HEALTH, make_hazards, make_rows

    from plc_inspect.ros.results.thin_link import News, Stream
    from plc_inspect.stream.blocks import thin_points
    from plc_inspect.stream.summary import HEALTH as PLACES
    from plc_inspect.stream.summary import STATUSES

    class Intake:
        told_vehicle = np.zeros(3)

    rclpy.init()
    node = rclpy.create_node('plc_inspect')
    intake, settings, rng = Intake(), StreamSettings(max_kbps=kbps), np.random.default_rng(seed)
    stream = Stream(node, lambda: settings, intake, lambda name, call: call)
    report = []
    for title in STATUSES:
        status = DiagnosticStatus(name=f'plc_inspect: {title}', message='all is well')
        status.values = [
            _pair(key, HEALTH.get(name, 1.0))
            for name, (own, key) in PLACES.items() if own == title
        ]
        report.append(status)
    began, number, due, told = time.monotonic(), 0, 12.0, 0.0
    rows, hazards = make_rows(num_spans, 0), list[Any]()
    while (now := time.monotonic() - began) < seconds:
        rclpy.spin_once(node, timeout_sec=0.02)
        intake.told_vehicle = np.array([SPEED * now, 0.0, 20.0])
        stream.tell_nearness((), 0.0)
        raised = now > due
        if raised:
            due = now + EVERY + rng.uniform(0.0, 1.0)
            (hazard,) = make_hazards(1)
            hazards = [dataclasses.replace(hazard, hazard_id=number)]
            number += 1
        if not raised and now - told < 1.0:
            continue
        told = now
        for name in ('num_points', 'rmse', 'ground_clearance'):  # of spans in sight
            rows.spans[name][:IN_SIGHT] = rng.integers(0, 30_000, IN_SIGHT)
        points = make_points(SPEED * now, rng)
        cells = thin_points(points, rng.choice(np.array([2, 5], np.uint8), len(points)),
                            rng.uniform(1.0, 30.0, len(points)).astype(np.float32), 0.5)
        tables = dataclasses.replace(rows, hazards=_pack_hazards(hazards))
        stream.tell_health(report)
        stream.publish(News(tables=tables, cells=cells, frame_id='odom',
                            stamp_ns=round(1e9 * (1000 + now)), held=False))
        if raised:
            print(json.dumps([f'hazard {number - 1}', time.time()]), flush=True)
    rclpy.shutdown()
    return 0


def make_points(along: float, rng: np.random.Generator) -> np.ndarray:
    """Return the points of what came into sight in the last second, and some more."""
    count = round(DENSITY * 4.0 * SPEED * 60.0)
    place = rng.uniform((along + AHEAD - 4.0 * SPEED, -30.0, 0.0), (along + AHEAD, 30.0, 12.0),
                        (count, 3))
    return place


def _pack_hazards(hazards: Sequence[Any]) -> Any:
    from plc_inspect.stream.summary import make_tables

    return make_tables([], [], hazards).hazards


def _pair(key: str, value: float) -> Any:
    from diagnostic_msgs.msg import KeyValue

    return KeyValue(key=key, value=f'{value:g}')


def measure(arguments: argparse.Namespace) -> int:
    """Open the link, and compare when alarms were told with when they were seen."""
    from monitor.web.chrome import Chrome, stop_playing

    from plc_inspect.offline.report.browser import find_browser

    environment = os.environ | {'ROS_DOMAIN_ID': '77', 'PLC_MONITOR_TOKEN': TOKEN}
    processes: list[subprocess.Popen[str]] = []
    with tempfile.TemporaryDirectory() as room, ThinPath(
        arguments.link, arguments.loss / 100.0, arguments.delay / 1000.0, arguments.seed
    ) as path:
        def start(name: str, *words: object, **options: Any) -> subprocess.Popen[str]:
            processes.append(subprocess.Popen(
                path.inside(name, sys.executable, *words), env=environment, text=True,
                stdout=subprocess.PIPE, **options,
            ))
            return processes[-1]

        try:
            page = start(path.air if arguments.far else path.ground,
                         '-m', 'plc_inspect.monitor.command', '--web', '--port', PORT,
                         *(('--host', '10.77.0.1') if arguments.far else ()))
            assert page.stdout is not None
            page.stdout.readline()
            node = start(path.air, __file__, '--send', '--kbps', arguments.kbps,
                         '--seconds', arguments.seconds, '--seed', arguments.seed,
                         '--spans', arguments.spans)
            program = write_wrapper(Path(room) / 'browser', path.ground, find_browser())
            chrome = Chrome(str(program), Path(room) / 'profile', 1024, 768)
            began = time.monotonic()
            chrome.page.goto(f'http://{"10.77.0.1" if arguments.far else "127.0.0.1"}:{PORT}/',
                             wait_until='commit', timeout=120_000)
            chrome.page.fill('input[name=token]', TOKEN)
            chrome.page.press('input[name=token]', 'Enter')
            chrome.wait("document.querySelector('#state-text')?.textContent?.startsWith('live')"
                        " || document.querySelectorAll('#spans tr').length > 0", 120.0)
            print(f'state and tables after {time.monotonic() - began:.1f} s', flush=True)
            chrome.run(WATCH)
            chrome.wait("performance.getEntriesByName('picture').length", 120.0)
            print(f'picture after {time.monotonic() - began:.1f} s', flush=True)
            node.wait(arguments.seconds + 60.0)
            chrome.page.wait_for_timeout(3000)
            seen = chrome.run('seen')
            events = chrome.run(EVENTS)
            points = chrome.run('station.scene.points.total')
            assert chrome.errors == [], chrome.errors
            chrome.close()
        finally:
            stop_playing()
            for process in processes:
                process.kill()
                process.wait()
        assert node.stdout is not None
        told = dict(map(json.loads, node.stdout))
        if arguments.verbose:
            print(*events, *(f'{time.strftime("%X", time.localtime(when))} told {name}'
                             for name, when in told.items()), sep='\n')
        way = path.down
        print(f'link: {way.bytes * 8e-3 / arguments.seconds:.0f} kbit/s down, {way.lost} lost, '
              f'{way.dropped} dropped; {points} points came')
    return judge(told, seen)


def judge(told: dict[str, float], seen: dict[str, float]) -> int:
    """Print how late alarms were; return 1 where one was too late, or too few were measured."""
    first = min(seen.values(), default=0.0)
    wanted = {name: when for name, when in told.items() if when > first}
    late = sorted(seen[name] - when for name, when in wanted.items() if name in seen)
    missing = sorted(set(wanted) - set(seen))
    print(f'alarms: {len(late)} seen, {len(missing)} never; load {os.getloadavg()[0]:.1f}')
    if late:
        p50, p95 = np.quantile(late, (0.5, 0.95))
        slow = [f'{name} {seen[name] - when:.2f} s' for name, when in wanted.items()
                if name in seen and seen[name] - when > MOST]
        print(f'later than {MOST:g} s: {", ".join(slow) or "none"}')
        print(f'from the message to the screen: p50 {p50:.2f}, p95 {p95:.2f}, '
              f'greatest {late[-1]:.2f} s')
    return int(not late or bool(missing) or late[-1] > MOST)


def main(argv: Sequence[str] | None = None) -> int:
    """Measure; return 1 where an alarm was too late."""
    parser = argparse.ArgumentParser(description='Alarms over a thin link.')
    parser.add_argument('--link', type=float, default=256.0, metavar='KBIT/S')
    parser.add_argument('--loss', type=float, default=2.0, metavar='%')
    parser.add_argument('--delay', type=float, default=200.0, metavar='MS', help='one way')
    parser.add_argument('--kbps', type=float, default=StreamSettings().max_kbps,
                        help='stream.max_kbps of the node (default: %(default)s)')
    parser.add_argument('--seconds', type=float, default=120.0)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--spans', type=int, default=300, metavar='N',
                        help='spans that the node knows (default: %(default)s)')
    parser.add_argument('--verbose', action='store_true', help='print what the page tells too')
    parser.add_argument('--far', action='store_true', help='the browser alone is beyond the link')
    parser.add_argument('--send', action='store_true', help=argparse.SUPPRESS)
    arguments = parser.parse_args(argv)
    if arguments.send:
        return send(arguments.kbps, arguments.seconds, arguments.seed, arguments.spans)
    return measure(arguments)


if __name__ == '__main__':
    sys.exit(main())
