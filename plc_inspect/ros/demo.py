# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
The demo: node and player as two processes over DDS, and what they find on the terminal.

``python -m plc_inspect.ros.demo BAG OUT`` starts both, prints lines and hazards as the node
publishes them, and ends both; the node writes the results folder.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import Any

from plc_inspect.errors import DataError, PlcInspectError
from plc_inspect.offline.commands.command_line import BAD_INPUT, DONE, INTERRUPTED, Parser
from plc_inspect.offline.export.results_folder import check_results
from plc_inspect.offline.readers.bags import Recording
from plc_inspect.printable import make_one_line
from plc_inspect.ros.graph.domain import set_apart
from plc_inspect.ros.graph.ending import was_cut_short
from plc_inspect.ros.graph.transport import prepare_transport

NAME = 'plc_demo'
READY_TIMEOUT = 45.0
"""The node must be up by then [s]."""
SLACK = 15.0
"""The player may take this much longer than the recording [s]."""
SAVE_TIMEOUT = 25.0
"""The node must have ended by then, results written [s]."""
KILL_TIMEOUT = 5.0
GROWTH = 25.0
"""A span is told of again when it has grown by this [m]."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the demo; return 0 done, 2 bad usage, 1 where a part of it failed."""
    parser = Parser(prog=NAME, description='Node and player over DDS, live on the terminal.')
    parser.add_argument('bag', type=Path, metavar='BAG')
    parser.add_argument('output', type=Path, metavar='OUT', help='results folder, replaced')
    arguments = parser.parse_args(argv)
    try:
        check_results(arguments.output, force=True)
        return _run(arguments.bag, arguments.output)
    except PlcInspectError as error:
        print(f'{NAME}: {make_one_line(error)}', file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        return INTERRUPTED


def _run(bag: Path, output: Path) -> int:
    with Recording(bag, 'velodyne_points', 'odometry') as recording:
        duration = recording.duration
    _prepare_kernels()
    prepare_transport()
    # A domain of its own: robots and other demos on the network are not disturbed.
    set_apart()
    started = time.monotonic()
    print(f'{bag}: {duration:.0f} s of flight, at the speed it was recorded; node and player are '
          'two processes')
    with _Process('plc_inspect.ros.node.onboard', '--ros-args', '--log-level', 'warn', '-p',
                  f'output.directory:={output.absolute()}', '-p', 'output.record:=false') as node:
        monitor = _join_graph(started)
        try:
            monitor.wait_until_ready(node, READY_TIMEOUT)
            with _Process('plc_inspect.ros.play', str(bag), '--wait', '10', '--quiet') as player:
                monitor.watch(node, player, duration + SLACK)
            monitor.settle(1.5)
        finally:
            monitor.close()
        node.interrupt(SAVE_TIMEOUT)
    seconds = time.monotonic() - started
    print(f'\nall processes ended after {seconds:.0f} s\n')
    _print_tables(output)
    print(f'\nresults: {output}\nreport:  {output / "report.html"}')
    return DONE


def _join_graph(started: float) -> '_Monitor':
    """Return a monitor; a signal while it is set up ends the demo as one does later."""
    try:
        return _Monitor(started)
    except Exception as error:
        if not was_cut_short(error):
            raise
        raise KeyboardInterrupt from None


def _print_tables(output: Path) -> None:
    """Print spans and hazards of a results folder."""
    from plc_inspect.offline.records.results_reader import read_table

    print('line  span  length [m]  sag [m]  rmse [m]  points')
    for span in read_table(output, 'spans')['spans']:
        print(f'{span["line_id"]:4d}  {span["span_id"]:4d}  {span["length"]:10.2f}  '
              f'{span["sag"]:7.2f}  {span["rmse"]:8.3f}  {span["num_points"]:6d}')
    print('\nhazard  severity  kind        line  span  measured [m]  required [m]')
    for item in read_table(output, 'hazards')['hazards']:
        print(f'{item["hazard_id"]:6d}  {item["severity"]:8s}  {item["kind"]:10s}  '
              f'{item["line_id"]:4d}  {item["span_id"]:4d}  {item["clearance"]:12.2f}  '
              f'{item["required"]:12.2f}')


def _prepare_kernels() -> None:
    """Compile the kernels where this is the first run, so that the flight need not wait."""
    from plc_inspect.config import Settings
    from plc_inspect.core.live.warm_up import warm_up_intake, warm_up_pipeline

    started = time.monotonic()
    warm_up_intake()
    warm_up_pipeline(Settings())
    warm_up_pipeline(Settings(), rare=True)
    if time.monotonic() - started > 10.0:
        print('set-up: kernels compiled for this machine, once')


class _Process:
    """A command of this package in a process of its own, ended in any case."""

    def __init__(self, module: str, *arguments: str) -> None:
        self.name = module.rpartition('.')[2]
        self._command = [sys.executable, '-m', module, *arguments]

    def __enter__(self) -> '_Process':
        self._process = subprocess.Popen(self._command)
        return self

    def __exit__(self, *error: object) -> None:
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(KILL_TIMEOUT)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()

    def poll(self) -> int | None:
        """Return the exit code, None while it runs."""
        return self._process.poll()

    def interrupt(self, timeout: float) -> None:
        """End the process as Ctrl-C does, and wait for it."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)
        try:
            code = self._process.wait(timeout)
        except subprocess.TimeoutExpired:
            raise DataError(f'the {self.name} did not end within {timeout:g} s') from None
        if code != 0:
            raise DataError(f'the {self.name} ended with exit code {code}')


class _Monitor:
    """Subscribes to the node's results and prints what is new."""

    def __init__(self, started: float) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.node import Node
        from sensor_msgs.msg import PointCloud2
        from std_srvs.srv import Trigger

        from plc_inspect.messages.rows import read_rows
        from plc_inspect.ros.graph.qos import RESULTS

        rclpy.init()
        self._read = read_rows
        self._node = Node('plc_demo')
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._node.create_subscription(
            PointCloud2, '/plc_inspect/catenaries', self._show_spans, RESULTS
        )
        self._node.create_subscription(
            PointCloud2, '/plc_inspect/hazards', self._show_hazards, RESULTS
        )
        self._client = self._node.create_client(Trigger, '/plc_inspect/segment')
        self._trigger = Trigger
        self._started = started
        self._spans: dict[tuple[int, int], int] = {}
        self._hazards: dict[int, int] = {}

    def wait_until_ready(self, node: _Process, timeout: float) -> None:
        """Wait until the node answers; its first job is to make the kernels ready."""
        self._spin_until(self._client.service_is_ready, node, timeout, 'the node is not up')
        future = self._client.call_async(self._trigger.Request())
        self._spin_until(future.done, node, timeout, 'the node does not answer')

    def watch(self, node: _Process, player: _Process, timeout: float) -> None:
        """Print what the node finds until the player ends."""
        self._spin_until(
            lambda: player.poll() is not None, node, timeout, 'the player does not end'
        )
        if player.poll() != 0:
            raise DataError(f'the player ended with exit code {player.poll()}')

    def settle(self, seconds: float) -> None:
        """Go on printing for a while."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            self._spin()

    def close(self) -> None:
        """Leave the graph."""
        import rclpy

        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.utilities.try_shutdown()

    def _spin(self) -> None:
        try:
            self._executor.spin_once(timeout_sec=0.1)
        except Exception as error:
            if not was_cut_short(error):
                raise
            raise KeyboardInterrupt from None  # rclpy took the signal before Python did

    def _spin_until(self, done: Any, node: _Process, timeout: float, problem: str) -> None:
        deadline = time.monotonic() + timeout
        while not done():
            if node.poll() is not None:
                raise DataError(f'the node ended with exit code {node.poll()}')
            if time.monotonic() > deadline:
                raise DataError(f'{problem} after {timeout:g} s')
            self._spin()

    def _say(self, text: str) -> None:
        print(f'{time.monotonic() - self._started:5.1f} s  {text}', flush=True)

    def _show_spans(self, message: Any) -> None:
        for row in self._read(message):
            key = int(row['line_id']), int(row['span_id'])
            length = int(row['length'] / GROWTH)
            if length > self._spans.get(key, -1):
                word = 'found' if key not in self._spans else 'grown'
                self._spans[key] = length
                self._say(_describe_span(word, row))

    def _show_hazards(self, message: Any) -> None:
        from plc_inspect.results import HazardKind, Severity

        now = {int(row['id']): int(row['severity']) for row in self._read(message)}
        for row in self._read(message):
            number = int(row['id'])
            if self._hazards.get(number) != now[number]:
                severity = Severity(now[number]).name.lower()
                kind = HazardKind(int(row['kind'])).name.lower()
                self._say(f'hazard {number}: {severity}, {kind} {row["clearance"]:.2f} m from '
                          f'line {row["line_id"]} span {row["span_id"]}')
        for number in sorted(set(self._hazards) - set(now)):
            self._say(f'hazard {number}: cleared')
        self._hazards = now


def _describe_span(word: str, row: Mapping[str, Any]) -> str:
    return (f'line {row["line_id"]} span {row["span_id"]} {word}: {row["length"]:6.1f} m, '
            f'sag {row["sag"]:.2f} m, {row["num_points"]} points')


if __name__ == '__main__':
    sys.exit(main())
