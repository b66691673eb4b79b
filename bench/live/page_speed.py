# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
How fast the page of the monitor draws, and how soon it shows something, with a long corridor.

A corridor of some 15 million points along 12 km, thinned as the node thins it, three conductors
and a vehicle that flies along them are served by a page of a process of its own, which tells of
changed blocks near the vehicle all the while.  A Chromium of tablet size, which draws in software,
opens it, and turns the picture in each view; printed are frames in a second (median, and the worst
second), points that were drawn, the browser's processor time for a frame, which says more than
frames a second on a busy machine, and the times until something was seen.
"""

import argparse
from collections.abc import Sequence
import dataclasses
import math
import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'test'))

from common.tables import render_table

from plc_inspect.results import PointClass
from plc_inspect.stream.blocks import SIDE, thin_points
from plc_inspect.stream.frame import CLOUD, Frame, pack_frame

VOXEL = 0.5
WIRES, SPAN, HEIGHT = (-4.0, 0.0, 4.0), 240.0, 18.0
HALF_WIDTH = 50.0
SPEED = 8.0
"""Of the vehicle [m/s]."""
TICK, CHANGED = 1.0, 120.0
"""Blocks so near to the vehicle change so often [s], [m]."""
STEP = 0.25
"""Between two looks, as the command has it [s]."""
SETTLED, LONGEST = 6.0, 90.0
"""All points are there when none came for so long; they are waited for no longer [s]."""
VIEWS = ('follow', 'overview', 'top', 'side')
LEAST_RATE, MOST_WAIT = 20.0, 3.0
"""Frames a second that are asked for, and the time until the first picture [s]."""
TURN = """new Promise(done => {
  const scene = station.scene, frames = [], end = performance.now() + SECONDS * 1000;
  const turn = now => {
    frames.push([now, scene.points.shown]);
    scene.turn({key: 'ArrowLeft', preventDefault() {}});
    if (now < end) requestAnimationFrame(turn); else done(frames);
  };
  requestAnimationFrame(turn);
})"""
READY = "performance.getEntriesByName('picture').length"
SINCE = "performance.getEntriesByName('picture')[0].startTime"
POINTS = 'station.scene.points.total'


def make_points(number: int, length: float, total: int, rng: np.random.Generator) -> tuple:
    """Return places, classes and clearances of one stretch of SPAN metres."""
    count = round(total * SPAN / length)
    place = np.empty((count, 3))
    place[:, 0] = number * SPAN + rng.uniform(0.0, SPAN, count)
    place[:, 1] = rng.uniform(-HALF_WIDTH, HALF_WIDTH, count)
    ground = 3.0 * np.sin(place[:, 0] / 90.0) + 2.0 * np.cos(place[:, 1] / 25.0)
    high = rng.random(count) < 0.8
    high &= np.abs(place[:, 1]) > 8.0
    place[:, 2] = ground + high * rng.uniform(0.5, 20.0, count)
    kind = np.where(high, PointClass.VEGETATION, PointClass.GROUND).astype(np.uint8)
    across = np.maximum(np.abs(place[:, 1]) - WIRES[-1], 0.0)
    clearance = np.hypot(across, HEIGHT + 6.0 - place[:, 2]).astype(np.float32)
    return place, kind, clearance


def serve(length: float, total: int) -> int:
    """Serve the page until the process is ended."""
    from stream_pieces import Source

    from plc_inspect.monitor.picture.model import Monitor
    from plc_inspect.monitor.web.page import Page
    from plc_inspect.stream.blocks import pack_blocks

    rng = np.random.default_rng(1)
    monitor, source = Monitor(), Source()
    tables = make_tables(length)
    sequence, count = 0, 0
    parts = [make_points(k, length, total, rng) for k in range(int(length / SPAN))]
    cells = thin_points(*(np.concatenate([part[k] for part in parts]) for k in range(3)), VOXEL)
    del parts
    blocks = {
        tuple(key): cells.codes[low:high] for key, low, high in zip(
            cells.blocks.tolist(), cells.starts, cells.starts[1:], strict=False
        )
    }

    def tell(some: dict) -> None:
        nonlocal sequence
        body = pack_blocks(some, overview=False, voxel=VOXEL, total=len(blocks))
        monitor.take_cloud(pack_frame(Frame(
            kind=CLOUD, flags=0, session=source.session, sequence=sequence,
            uptime=time.monotonic(), body=body,
        )), time.monotonic())
        sequence += 1

    began, ticked = time.monotonic(), 0.0
    with Page('127.0.0.1', 0) as page:
        while True:
            now = time.monotonic()
            along = SPEED * (now - began)
            monitor.take_summary(source.summary(
                now - began, keyframe=count % 20 == 0, tables=tables,
                vehicle=(along % length, -15.0, HEIGHT + 10.0), heading=0.0,
            ), now)
            if not count:
                keys = list(blocks)
                for k in range(0, len(keys), 200):
                    tell({key: blocks[key] for key in keys[k:k + 200]})
            elif now - ticked > TICK:
                ticked = now
                tell({
                    key: codes for key, codes in blocks.items()
                    if abs(key[0] * SIDE * VOXEL - along % length) < CHANGED
                })
            page.show('/plc_inspect', monitor.look(now), monitor.cloud)
            if not count:
                print(page.address, f'{cells.starts[-1]}', flush=True)
            count += 1
            time.sleep(max(0.0, STEP - (time.monotonic() - now)))


def make_tables(length: float):
    """Return the tables of a line of three conductors, with a support and a hazard at each end."""
    from factories import make_span
    from stream_pieces import make_hazards, make_result

    from plc_inspect.stream import summary

    spans, supports, hazards = [], [], []
    (hazard,), (support, *_) = make_hazards(1), make_result().supports
    for k in range(int(length / SPAN)):
        spans += [
            (make_span(line, k, (k * SPAN, y, HEIGHT), ((k + 1) * SPAN, y, HEIGHT)), True)
            for line, y in enumerate(WIRES)
        ]
        supports.append(dataclasses.replace(
            support, support_id=k, position=np.array([k * SPAN, 0.0, 0.0]), height=HEIGHT
        ))
        hazards.append(dataclasses.replace(
            hazard, hazard_id=k, span_id=k, position=np.array([(k + 0.5) * SPAN, 9.0, 8.0])
        ))
    return summary.make_tables(spans, supports, hazards)


def look(
    address: str, width: int, height: int, seconds: float, room: Path, server: int
) -> list[tuple]:
    """Open the page and turn the picture in each view."""
    from monitor.web.chrome import Chrome, stop_playing

    from plc_inspect.offline.report.browser import find_browser

    chrome = Chrome(find_browser(), room, width, height)
    try:
        began = time.monotonic()
        chrome.page.goto(address, wait_until='commit')
        chrome.wait(READY, 120.0)
        first = float(chrome.run(SINCE)) / 1000.0
        print(f'first picture after {first:.2f} s', flush=True)
        rows = [('coming in', *turn(chrome, seconds, server))]
        before, since = 0.0, time.monotonic()
        while time.monotonic() - since < SETTLED:
            chrome.page.wait_for_timeout(1000)
            if before != (before := chrome.run(POINTS)):
                since = time.monotonic()
            if time.monotonic() - began > LONGEST:
                break
        print(f'{before:.0f} points in the browser after '
              f'{time.monotonic() - began:.0f} s', flush=True)
        for view in VIEWS:
            chrome.run(f"station.scene.setView('{view}')")
            chrome.page.wait_for_timeout(2000)
            rows.append((view, *turn(chrome, seconds, server)))
        chrome.take_picture(room.parent / 'page_speed.png')
        assert chrome.errors == [], chrome.errors
    finally:
        chrome.close()
        stop_playing()
    return [('first', first, 0.0, 0.0, 0.0), *rows]


def sum_processor_time(server: int) -> float:
    """Return the processor time of all processes below this one but the server's [s]."""
    parents, spent = {}, {}
    for path in Path('/proc').glob('[0-9]*/stat'):
        try:
            fields = path.read_text().rpartition(')')[2].split()
        except OSError:
            continue  # it ended
        pid = int(path.parent.name)
        parents[pid], spent[pid] = int(fields[1]), int(fields[11]) + int(fields[12])

    def is_below(pid: int) -> bool:
        while pid in parents and pid != server:
            if pid == os.getpid():
                return True
            pid = parents[pid]
        return False

    return sum(
        ticks for pid, ticks in spent.items() if pid != os.getpid() and is_below(pid)
    ) / os.sysconf('SC_CLK_TCK')


def turn(chrome, seconds: float, server: int) -> tuple[float, float, float, float]:
    """Return frames a second, of the worst second, points drawn, processor time a frame [ms]."""
    before = sum_processor_time(server)
    frames = np.array(chrome.run(TURN.replace('SECONDS', f'{seconds:g}')))
    at = (frames[:, 0] - frames[0, 0]) / 1000.0
    counts = np.bincount(at.astype(int), minlength=math.floor(at[-1]))[:math.floor(at[-1])]
    each = 1000.0 * (sum_processor_time(server) - before) / len(frames)
    return float(np.median(counts)), float(counts.min()), float(np.median(frames[:, 1])), each


def main(argv: Sequence[str] | None = None) -> int:
    """Measure; return 1 where a figure misses its limit."""
    parser = argparse.ArgumentParser(description='Frames a second of the page.')
    parser.add_argument('--length', type=float, default=12_000.0, metavar='M')
    parser.add_argument('--points', type=int, default=15_000_000, metavar='N')
    parser.add_argument('--size', type=int, nargs=2, default=(1024, 768), metavar='PX')
    parser.add_argument('--seconds', type=float, default=10.0, metavar='S')
    parser.add_argument('--room', type=Path, help='where a picture of the end is left')
    parser.add_argument('--serve', action='store_true', help=argparse.SUPPRESS)
    arguments = parser.parse_args(argv)
    if arguments.serve:
        return serve(arguments.length, arguments.points)
    server = subprocess.Popen(
        [sys.executable, __file__, '--serve', '--length', f'{arguments.length}',
         '--points', f'{arguments.points}'], stdout=subprocess.PIPE, text=True,
    )
    try:
        assert server.stdout is not None
        address, cells = server.stdout.readline().split()
        print(f'{arguments.points} points, {cells} cells; load {os.getloadavg()[0]:.1f}')
        with tempfile.TemporaryDirectory() as room:
            own = arguments.room or Path(room)
            own.mkdir(parents=True, exist_ok=True)
            (_, first, *_), *rows = look(
                address, *arguments.size, arguments.seconds, own / 'profile', server.pid
            )
    finally:
        server.kill()
        server.wait()
    print(render_table(
        ('view', 'frames/s, median', 'worst second', 'points drawn', 'processor, ms a frame'),
        [(name, f'{rate:.0f}', f'{worst:.0f}', f'{points:.0f}', f'{each:.0f}')
         for name, rate, worst, points, each in rows],
    ))
    print(f'load {os.getloadavg()[0]:.1f}')
    good = first < MOST_WAIT and all(rate >= LEAST_RATE for _, rate, *_ in rows)
    return int(not good)


if __name__ == '__main__':
    sys.exit(main())
