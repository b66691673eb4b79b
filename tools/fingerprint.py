# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Prints one hash of everything that plc_inspect finds.

Clouds and the demo flight: every array and field of the results, but for times, and every message
that a live flight and a record of it publish.  Equal output before and after a change means equal
results, bit for bit.  Real clouds are read from --real; one that is absent is named.
"""

import argparse
from collections.abc import Iterator, Sequence
import dataclasses
import enum
import hashlib
from pathlib import Path
import sys
import tempfile
from typing import Any

import numpy as np
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import Reader
from rosbags.typesys import get_typestore, Stores

from plc_inspect.config import Settings
from plc_inspect.core.live.session import Session
from plc_inspect.core.live.window import copy_window, plan_everything, WindowPlanner
from plc_inspect.core.mapping.accumulator import Accumulator
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.messages.poses import StampedPose
from plc_inspect.offline.commands.flight_run import replay
from plc_inspect.offline.export.results_folder import write_results
from plc_inspect.offline.readers.bags import Recording
from plc_inspect.offline.readers.clouds import read_cloud
from plc_inspect.ros.results.markers import add_deletions
from plc_inspect.ros.results.publishing import make_bundle
from plc_inspect.sim.scenes.catalogue import make_scene
from plc_inspect.sim.surveys.airborne import simulate_map

ROOT = Path(__file__).parents[1]
REAL = ROOT.parent / 'shared' / 'data' / 'real'
CLOUDS = ('ahn_12BZ1_21', 'oakland_part3_an')
SCENES = {'double_circuit': 12.0, 'town': 30.0, 'crossing': 20.0}
"""Simulated scenes and their pulses per square metre."""
TICK_EVERY = 1_000_000_000
"""Of the data's time between two ticks [ns]."""
LEFT_OUT = {'seconds'}
"""Fields that hold wall times."""
TYPES = get_typestore(Stores.ROS2_JAZZY)


def feed(digest: Any, value: Any) -> None:
    """Put a value and all that it holds into a digest."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        for item in sorted(field.name for field in dataclasses.fields(value)):
            if item not in LEFT_OUT:
                digest.update(item.encode())
                feed(digest, getattr(value, item))
    elif isinstance(value, np.ndarray):
        digest.update(f'{value.dtype.str}{value.shape}'.encode())
        digest.update(np.ascontiguousarray(value).tobytes())
    elif isinstance(value, dict):
        for key in sorted(value, key=str):
            digest.update(str(key).encode())
            feed(digest, value[key])
    elif isinstance(value, tuple | list):
        digest.update(f'{len(value)}'.encode())
        for item in value:
            feed(digest, item)
    elif isinstance(value, enum.Enum):
        digest.update(value.name.encode())
    elif isinstance(value, float | np.floating):
        digest.update(float(value).hex().encode())
    else:
        digest.update(str(value).encode())


def simulate(name: str) -> np.ndarray:
    """Return (N, 3) points of a simulated scene [m]."""
    scene = make_scene(name, 3)
    return simulate_map(scene, SCENES[name], np.random.default_rng(3), noise=0.03).points


def copy_message(message: Any) -> Any:
    """Return a message of rclpy as plain values; its bytes have padding that is not settled."""
    name = type(message).__module__.split('.')[0] + '/msg/' + type(message).__name__
    return TYPES.deserialize_cdr(bytes(serialize_message(message)), name)


def fly(bag: Path) -> Iterator[tuple[str, Any]]:
    """Yield topic and content of each message of a live flight, a tick each second of data."""
    settings = Settings()
    accumulator, session = Accumulator(settings), Session()
    planner, due, seen = WindowPlanner(settings.height.beta), 0, set()
    topics = settings.input.scan_topic, settings.input.odometry_topic
    voxels, vehicle = accumulator.map, None

    def pack(state: Any) -> Iterator[tuple[str, Any]]:
        nonlocal seen
        bundle = make_bundle(
            state, accumulator.frame_id, accumulator.last_inserted or 0, settings.stream
        )
        for name in ('lines', 'corridor', 'catenaries', 'hazards'):
            yield name, copy_message(getattr(bundle, name))
        markers, seen = add_deletions(bundle.header, bundle.markers, seen)
        yield 'markers', copy_message(markers)
        for rows in ('spans', 'supports', 'hazards'):
            yield 'summary', getattr(bundle.news.tables, rows)

    with Recording(bag, *topics) as recording:
        for message in recording:
            content, now = message.content, message.log_stamp_ns * 1e-9
            if isinstance(content, StampedPose):
                vehicle = np.array(content.position)
                accumulator.add_pose(
                    content.stamp_ns, content.position, content.quaternion, now=now,
                    frame_id=content.frame_id, child_frame_id=content.child_frame_id,
                )
                continue
            accumulator.add_scan(
                content.stamp_ns, content.xyz, content.time, now=now,
                frame_id=content.frame_id, num_not_finite=content.num_not_finite,
            )
            if content.stamp_ns < due:
                continue
            due = content.stamp_ns + TICK_EVERY
            plan = planner.plan(voxels, [item.span for item in session.state.spans], vehicle)
            if plan is None:
                continue
            window = next(item for item in copy_window(voxels, plan) if item is not None)
            tick = session.tick(window, settings, vehicle)
            voxels.label(window.slots, window.points, tick.labels)
            yield from pack(tick.state)
    accumulator.finish()
    plan = plan_everything(voxels, [])
    window = next(item for item in copy_window(voxels, plan) if item is not None)
    state, _, _ = session.conclude(window.points, settings, window.sequence, complete=True)
    yield from pack(state)


def read_record(bag: Path) -> Iterator[tuple[str, Any]]:
    """Yield topic and content of each message that a replay writes for playback."""
    with tempfile.TemporaryDirectory() as room:
        write_results(Path(room, 'out'), replay(bag, Settings()))
        with Reader(Path(room, 'out', 'results.mcap')) as reader:
            for connection, stamp, data in reader.messages():
                yield connection.topic, (stamp, TYPES.deserialize_cdr(data, connection.msgtype))


def list_prints(real: Path) -> Iterator[tuple[str, str]]:
    """Yield what was run, and its hash."""
    for name in (*SCENES, *CLOUDS):
        if name in CLOUDS and not (real / f'{name}.laz').is_file():
            yield name, f'absent: {name}.laz was not found'
            continue
        points = simulate(name) if name in SCENES else read_cloud(real / f'{name}.laz').points
        digest = hashlib.sha256()
        feed(digest, Pipeline().run(points))
        yield name, digest.hexdigest()
    digest = hashlib.sha256()
    feed(digest, replay(ROOT / 'bags' / 'demo', Settings()).result)
    yield 'demo, replayed', digest.hexdigest()
    for name, messages in (('demo, live', fly), ('demo, record', read_record)):
        digests: dict[str, Any] = {}
        for topic, content in messages(ROOT / 'bags' / 'demo'):
            feed(digests.setdefault(topic, hashlib.sha256()), content)
        for topic, found in sorted(digests.items()):
            yield f'{name}, {topic}', found.hexdigest()


def main(argv: Sequence[str] | None = None) -> int:
    """Print the hash of each part, and the hash of all of them."""
    parser = argparse.ArgumentParser(description='Prints hashes of everything that is found.')
    parser.add_argument('--real', type=Path, default=REAL, metavar='DIR', help='real clouds')
    whole = hashlib.sha256()
    for name, print_ in list_prints(parser.parse_args(argv).real):
        whole.update(print_.encode())
        print(f'{print_[:16]}  {name}', flush=True)
    print(f'{whole.hexdigest()[:16]}  all')
    return 0


if __name__ == '__main__':
    sys.exit(main())
