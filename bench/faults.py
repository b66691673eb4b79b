# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Does faults to the real node over DDS, and prints for each what was found and what was said.

The node is a process of its own; the demo flight is sent to it with a fault in it.  Spans are
compared with those of the flight without fault: missing, and extra ones.  ``--root`` runs the
node of another checkout.  Ends with 1, and names the rows, where a span lies elsewhere, more is
critical than without fault, or a part is missing without a word or with exit code 0 and no
results.
"""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
import json
import os
from pathlib import Path
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from typing import Any

from common.fault_kinds import Fault, FAULTS
from common.flight_faults import Event
from common.tables import render_table, replace_section
import numpy as np
from scipy.spatial import cKDTree

from plc_inspect.core.alignment.parts import BY_RATE, Part
from plc_inspect.core.alignment.rigid_move import RigidMove
from plc_inspect.offline.readers.bags import Recording
from plc_inspect.ros.graph.domain import take_domain
from plc_inspect.ros.graph.transport import prepare_transport

ROOT = Path(__file__).resolve().parents[1]
NODE = 'plc_inspect.ros.node.onboard'
DOMAIN = take_domain()
START = 300.0
"""Longest wait for the node [s]; kernels may have to be compiled."""
END = 200.0
"""Longest wait for its end [s]."""
PAGE = ROOT / 'docs' / 'faults.md'
COLUMNS = 'fault', 'found', 'end', 'said in /diagnostics, and at the end'
NEAR = 0.5
"""Distance within which a span lies where one of the flight without fault does [m]."""
GOES_ON = 10.0
"""Beyond its open ends a span of that flight may be seen so much farther [m]."""
NOT_TRIED = 'not tried'
"""End of a flight that could not begin here."""
LEAST_FOUND = 0.9
"""Share of the length that is to be found, or said to be lost; as in bench/studies."""


@dataclass(eq=False)
class Feeder:
    """Publishers and services of one flight, and what the node says in /diagnostics."""

    context: Any
    node: Any
    publishers: dict[str, Any]
    process: int = 0
    """Of the node."""
    disk: Path | None = None
    """Which the output folder is on, where it has one of its own."""
    said: dict[str, int] = field(default_factory=dict)

    def call_often(self, name: str, count: int) -> str:
        """Call a service so often at once, and tell how many calls were answered."""
        from std_srvs.srv import Trigger

        from plc_inspect.ros.graph.qos import REQUESTS

        # by default a client keeps ten answers, and loses the others where it is not quick
        client = self.node.create_client(
            Trigger, f'/plc_inspect/{name}', qos_profile=REQUESTS
        )
        client.wait_for_service(10.0)
        futures = [client.call_async(Trigger.Request()) for _ in range(count)]
        end = time.monotonic() + 15.0
        while time.monotonic() < end and not all(future.done() for future in futures):
            time.sleep(0.05)
        return f'{sum(future.done() for future in futures)} of {count} calls answered'

    def fill_disk(self) -> str:
        """Write to the disk until nothing more goes on it."""
        assert self.disk is not None
        with (self.disk / 'more').open('wb', buffering=0) as file, suppress(OSError):
            while file.write(b'x' * 100_000):
                pass
        return ''

    def stop_node(self, seconds: float) -> str:
        """Let the system stop the node for a while, the flight goes on."""
        os.kill(self.process, signal.SIGSTOP)
        threading.Timer(seconds, os.kill, (self.process, signal.SIGCONT)).start()
        return ''

    def set_parameter(self, name: str, value: str) -> str:
        """Set a parameter, and tell what the node answered."""
        from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
        from rcl_interfaces.srv import SetParameters

        client = self.node.create_client(SetParameters, '/plc_inspect/set_parameters')
        client.wait_for_service(10.0)
        content = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=value)
        future = client.call_async(
            SetParameters.Request(parameters=[Parameter(name=name, value=content)])
        )
        end = time.monotonic() + 10.0
        while time.monotonic() < end and not future.done():
            time.sleep(0.05)
        (answer,) = future.result().results
        return 'accepted' if answer.successful else f'refused: {answer.reason}'


def read_flight(seconds: float, bag: Path = ROOT / 'bags/demo') -> list[Event]:
    """Return the first part of a flight, the demo flight by default."""
    from nav_msgs.msg import Odometry
    from rclpy.serialization import deserialize_message
    from sensor_msgs.msg import PointCloud2

    events = []
    with Recording(bag, 'velodyne_points', 'odometry') as recording:
        first = None
        for item in recording.raw_messages():
            first = item.log_stamp_ns if first is None else first
            moment = (item.log_stamp_ns - first) * 1e-9
            if moment > seconds:
                break
            kind, of = ('scan', PointCloud2) if 'points' in item.topic else ('odometry', Odometry)
            events.append(Event(moment, kind, deserialize_message(item.raw, of)))
    return events


@contextmanager
def open_feeder(two: bool) -> Iterator[Feeder]:
    """Yield publishers of a flight on a graph of their own, of two drivers if wanted."""
    from diagnostic_msgs.msg import DiagnosticArray
    from nav_msgs.msg import Odometry
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from sensor_msgs.msg import PointCloud2

    from plc_inspect.ros.graph.qos import PLAYER

    context = rclpy.context.Context()
    rclpy.init(context=context, domain_id=DOMAIN)
    node = rclpy.create_node('faults', context=context)
    second = [node.create_publisher(PointCloud2, 'velodyne_points', PLAYER)] if two else []
    feeder = Feeder(context, node, {
        'scan': node.create_publisher(PointCloud2, 'velodyne_points', PLAYER),
        'odometry': node.create_publisher(Odometry, 'odometry', PLAYER),
        **({'second': second[0]} if second else {}),
    })

    def hear(message: Any) -> None:
        for status in message.status:
            if status.level != b'\x00' and 'security' not in status.name:
                level = 'ERROR' if status.level == b'\x02' else 'WARN'
                text = f'{level} {status.name.rpartition(" ")[2]}: {status.message}'
                feeder.said[text] = feeder.said.get(text, 0) + 1

    node.create_subscription(DiagnosticArray, '/diagnostics', hear, 10)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    thread = threading.Thread(target=executor.spin, daemon=True)
    thread.start()
    try:
        yield feeder
    finally:
        executor.shutdown()
        thread.join(5.0)
        node.destroy_node()
        context.shutdown()


@contextmanager
def mount_disk(options: str, place: Path) -> Iterator[None]:
    """Have a small or read-only file system at a place, which needs the right to mount."""
    if not options:
        yield
        return
    subprocess.run(['mount', '-t', 'tmpfs', '-o', options, 'tmpfs', place], check=True)
    try:
        yield
    finally:
        subprocess.run(['umount', place], check=True)


def fly(fault: Fault, events: list[Event], rate: float, root: Path, room: Path) -> list[str]:
    """Fly once, and return what was found, how it ended, and what was said."""
    disk = room / 'disk'
    disk.mkdir()
    try:
        with mount_disk(fault.disk, disk):
            found, *texts = fly_on(fault, events, rate, root, room)
            if fault.disk and found:
                kept = shutil.copytree(found, room / 'kept', dirs_exist_ok=True)
                found = str(kept)
            return [found, *texts]
    except subprocess.CalledProcessError as error:
        return ['', NOT_TRIED, str(error)]


def fly_on(fault: Fault, events: list[Event], rate: float, root: Path, room: Path) -> list[str]:
    """Fly with all disks there."""
    out, log = (room / 'disk' if fault.disk else room) / 'out', room / 'log'

    def begin() -> None:
        for number in (signal.SIGHUP, signal.SIGQUIT, signal.SIGINT):
            signal.signal(number, signal.SIG_DFL)
        if fault.file_size is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (fault.file_size, fault.file_size))

    with log.open('w') as stream:
        process = subprocess.Popen(
            [sys.executable, '-m', NODE, '--ros-args', '-p', f'output.directory:={out}',
             *fault.arguments],
            cwd=root, stdout=stream, stderr=subprocess.STDOUT, preexec_fn=begin,
            env=os.environ | {'ROS_DOMAIN_ID': str(DOMAIN), 'ROS_HOME': str(room / 'home'),
                              'PYTHONPATH': str(root)},
        )
    try:
        ready = time.monotonic() + START
        while 'ready' not in log.read_text() and process.poll() is None:
            if time.monotonic() > ready:
                break
            time.sleep(0.2)
        note = ''
        said: dict[str, int] = {}
        if process.poll() is None:
            fault.before(out)
            events = fault.change(events)
            with open_feeder(any(event.kind == 'second' for event in events)) as feeder:
                said, feeder.process, feeder.disk = feeder.said, process.pid, room / 'disk'
                note = _send(feeder, events, fault, rate)
            process.send_signal(fault.number)
        code: int | str
        try:
            code = process.wait(END)
        except subprocess.TimeoutExpired:
            code = 'none'
    finally:
        process.kill()
        process.wait()
    found = [*out.glob('spans.json'), *room.glob('home/plc_inspect/*/spans.json')]
    lines = _name_places(log.read_text(), room).splitlines()
    last = [line for line in lines if 'saved' in line or NODE in line]
    told = [text for text in said if 'no scan and no odometry' not in text]  # before, and after
    often: dict[str, list[str]] = {}  # texts that differ in figures are one
    for text in told:
        often.setdefault(re.sub(r'[-\d.]+', '0', text), []).append(text)
    groups = sorted(often.values(), key=lambda group: -sum(said[text] for text in group))
    texts = [group[-1] for group in groups[:3]]
    if 'saved to' not in (last or [''])[-1] or 'ROS_HOME' in (last or [''])[-1]:
        texts.append((last or lines or ['nothing'])[-1][-150:])
    return [str(found[0].parent) if found else '', f'exit {code}',
            _name_places('; '.join([*([note] if note else []), *texts]), room)]


def _name_places(text: str, room: Path) -> str:
    """Name folders by what they are for: a page holds no path of the machine that wrote it."""
    for name, place in (
        ('OUT', 'out'), ('OUT', 'disk/out'), ('ROS_HOME', 'home'), ('DISK', 'disk'),
    ):
        text = text.replace(str(room / place), name)
    return re.sub(r'(\[[A-Z]+\] )?\[\d+\.\d+\] ', '', text)  # when it was logged


def _send(feeder: Feeder, events: list[Event], fault: Fault, rate: float) -> str:
    end = time.monotonic() + 30.0
    while not all(item.get_subscription_count() for item in feeder.publishers.values()):
        if time.monotonic() > end:
            return 'the node does not listen'
        time.sleep(0.05)
    note, done = '', False
    begin = time.monotonic()
    for event in events:
        if not done and event.time > events[-1].time / 2:
            done, before = True, time.monotonic()
            note = fault.during(feeder)
            begin += time.monotonic() - before
        time.sleep(max(0.0, begin + event.time / rate - time.monotonic()))
        feeder.publishers[event.kind].publish(event.message)
    time.sleep(4.0)
    return note


def trace(span: dict[str, Any], more: float = 0.0) -> np.ndarray:
    """
    Return (N, 3) points along a span of spans.json, half a metre apart or nearer [m].

    Beyond its open ends it goes on so far.
    """
    start, end = np.array(span['start']), np.array(span['end'])
    low = -more * span['open_start']
    high = span['length'] + more * span['open_end']
    along = np.linspace(low, high, 2 + int((high - low) / 0.5))
    plan = start[:2] + (end - start)[:2] * (along / max(span['length'], 1e-9))[:, None]
    heights = span['a'] + span['c'] * np.cosh((along - span['b']) / span['c'])
    return np.column_stack((plan, heights))


def find_move(found: Path) -> RigidMove | None:
    """Return what brings results from the odometry's frame at the end into that at the start."""
    counts = json.loads((found / 'run.json').read_text())['input']['counts']
    parts = [Part.from_record(item) for item in counts['parts']]
    whole = parts and (parts[-1].aligned or parts[-1].by == BY_RATE)
    return parts[-1].move if whole else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What a flight gave, beside that without fault."""

    spans: int
    share: float
    """Of the length of the spans without fault that was found."""
    ghosts: int
    hazards: int
    critical: int
    shift: float = 0.0
    """By which all of it is off [m]."""

    def describe(self) -> str:
        """Return it in one line."""
        off = f', {self.shift:.1f} m off as a whole' if self.shift else ''
        return (f'{self.spans} spans, {self.share:.0%} of the length{off}, {self.ghosts} ghosts; '
                f'{self.hazards} hazards, {self.critical} critical')


def is_right(outcome: Outcome | None, critical: int, code: int, said: str) -> bool:
    """
    Tell whether what came of a fault is right, or is left out and said.

    Parameters
    ----------
    outcome : Outcome or None
        None: no results.
    critical : int
        Critical hazards without fault.
    code : int
        Exit code of the node.
    said : str
        In /diagnostics and at the end.

    """
    if outcome is None:
        return code != 0 and bool(said)
    if outcome.ghosts or outcome.critical > critical:
        return False
    return outcome.share >= LEAST_FOUND or bool(said)


def find_shift(spans: Sequence[Any], reference: Sequence[Any], move: RigidMove) -> np.ndarray:
    """Return by how much spans are off as a whole, by the supports that they end at [m]."""
    own, known = (
        np.array([item[end] for item in items for end in ('start', 'end')
                  if not item[f'open_{end}']]).reshape(-1, 3) for items in (spans, reference)
    )
    if not len(own) or not len(known):
        return np.zeros(3)
    own = move.apply(own)
    result: np.ndarray = np.median(own - known[cKDTree(known).query(own)[1]], axis=0)
    return result


def compare(found: str, reference: list[Any], fault: Fault) -> Outcome | None:
    """
    Return how many spans were found, and how many are not there in the flight without fault.

    A span is there where it lies within NEAR of one of that flight all along, whole or in part.
    Where the odometry was corrected the results are in its frame at the end; they are brought
    back.  Where the map began anew they are off by the fault's offset.
    """
    if not found:
        return None
    spans = json.loads((Path(found) / 'spans.json').read_text())['spans']
    hazards = json.loads((Path(found) / 'hazards.json').read_text())['hazards']
    move = find_move(Path(found))
    back = move or RigidMove()
    traces = [back.apply(trace(item)) for item in spans]
    offset = np.zeros(3) if move else np.array(fault.offset)
    if fault.is_scaled:
        offset = find_shift(spans, reference, back)
    known = cKDTree(np.concatenate([trace(item, GOES_ON) for item in reference]) + offset)
    ghosts = sum(bool((known.query(item)[0] > NEAR).any()) for item in traces)
    tree = cKDTree(np.concatenate(traces or [np.full((1, 3), 1e9)]))
    far = [tree.query(trace(item) + offset)[0] <= NEAR for item in reference]
    share = np.concatenate(far).mean()
    critical = sum(item['severity'] == 'critical' for item in hazards)
    return Outcome(
        spans=len(spans), share=float(share), ghosts=ghosts, hazards=len(hazards),
        critical=critical, shift=float(np.linalg.norm(offset)) if fault.is_scaled else 0.0,
    )


def main() -> int:
    """Do the faults, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('names', nargs='*', help='parts of the names of the faults; all')
    parser.add_argument('--rate', type=float, default=2.0)
    parser.add_argument('--seconds', type=float, default=20.0)
    parser.add_argument('--write', action='store_true', help='write docs/faults.md')
    parser.add_argument('--root', type=Path, default=ROOT)
    arguments = parser.parse_args()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    prepare_transport()
    chosen = [name for name in FAULTS if name == 'none' or not arguments.names
              or any(part in name for part in arguments.names)]
    rows, wrong, reference, critical = [], [], [], 0
    with tempfile.TemporaryDirectory() as folder:
        for number, name in enumerate(chosen):
            room = Path(folder) / str(number)
            room.mkdir()
            found, end, said = fly(
                FAULTS[name], read_flight(arguments.seconds), arguments.rate,
                arguments.root.resolve(), room,
            )
            if name == 'none' and found:
                reference = json.loads((Path(found) / 'spans.json').read_text())['spans']
            if not reference:
                print(f'the flight without a fault found no span: {said}', file=sys.stderr)
                return 1
            outcome = compare(found, reference, FAULTS[name])
            if name == 'none' and outcome:
                critical = outcome.critical
            right = end == NOT_TRIED or is_right(
                outcome, critical, int(end.rpartition(' ')[2]), said
            )
            wrong += [] if right else [name]
            text = outcome.describe() if outcome else 'no results'
            rows.append([name, text, end, said[:400]])
            print(' | '.join(rows[-1]) + ('' if right else ' | BAD'), flush=True)
    if arguments.write:
        table = render_table(COLUMNS, [[cell.replace('|', '/') for cell in row] for row in rows])
        replace_section(PAGE, 'faults', table)
    print(f'{len(wrong)} of {len(rows)} are not as they should be', *wrong, sep='\n    ')
    return int(bool(wrong))


if __name__ == '__main__':
    sys.exit(main())
