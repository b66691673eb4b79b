# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The terminal in a pseudo-terminal, narrow and wide, fed over the ROS graph; no node needed."""

import array
import fcntl
import io
import os
from pathlib import Path
import pty
import select
import signal
import struct
import subprocess
import sys
import termios
import threading
import time

import pyte
import pytest
import rclpy
from rclpy.context import Context
from rich.console import Console
from rig import isolate, take_domain
from std_msgs.msg import UInt8MultiArray
from stream_pieces import make_rows, NO_TABLES, Source

from plc_inspect.monitor.picture.model import Monitor
from plc_inspect.monitor.terminal.text import draw_once
from plc_inspect.ros.graph.qos import SUMMARY
from plc_inspect.stream.curve_check import NO_LENGTH

ROOT = Path(__file__).parents[3]
COMMAND = [sys.executable, '-m', 'plc_inspect.monitor.command']


class Radio:
    """Publishes a stream as a node would, twice a second, until it is told to be silent."""

    def __init__(self, domain):
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node('plc_inspect', context=self.context)
        self.publisher = self.publish()
        self.source, self.silent, self.ended = Source(), False, False
        self.began = time.monotonic()
        self.rows = make_rows(40, 30)
        self.keyframe = True
        self.thread = threading.Thread(target=self.run)
        self.thread.start()

    def publish(self):
        return self.node.create_publisher(UInt8MultiArray, '/plc_inspect/summary', SUMMARY)

    def run(self):
        while not self.ended:
            if not self.silent:
                data = self.source.summary(
                    time.monotonic() - self.began, keyframe=self.keyframe, tables=self.rows
                )
                self.keyframe = False
                self.publisher.publish(UInt8MultiArray(data=array.array('B', data)))
            time.sleep(0.3)

    def restart(self):
        """Be another node that knows nothing yet, and keeps nothing of the one before."""
        self.silent = True
        time.sleep(0.4)
        self.node.destroy_publisher(self.publisher)
        self.publisher = self.publish()
        self.source, self.rows, self.keyframe = Source(session=4242), NO_TABLES, True
        self.began = time.monotonic()
        self.silent = False

    def close(self):
        self.ended = True
        self.thread.join()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


class Terminal:
    """A command in a pseudo-terminal, and what stands on its screen."""

    def __init__(self, domain, columns, lines, *arguments):
        self.pid, self.file = pty.fork()
        if not self.pid:
            environment = os.environ | {'ROS_DOMAIN_ID': str(domain), 'TERM': 'xterm-256color'}
            for name in ('COLUMNS', 'LINES'):
                environment.pop(name, None)
            os.chdir(ROOT)
            os.execvpe(COMMAND[0], [*COMMAND, *arguments], environment)
        self.screen = pyte.Screen(columns, lines)
        self.stream = pyte.ByteStream(self.screen)
        self.resize(columns, lines)

    def resize(self, columns, lines):
        fcntl.ioctl(self.file, termios.TIOCSWINSZ, struct.pack('HHHH', lines, columns, 0, 0))
        self.screen.resize(lines, columns)

    def read(self, seconds):
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            if select.select([self.file], [], [], left)[0]:
                self.stream.feed(os.read(self.file, 65_536))

    def text(self):
        return '\n'.join(self.screen.display)

    def wait(self, look, deadline=30.0):
        """Wait until ``look`` has no objection to the text: half of it may be drawn."""
        end = time.monotonic() + deadline
        while True:
            self.read(0.1)
            try:
                look(self.text())
                return
            except AssertionError:
                if time.monotonic() > end:
                    raise

    def close(self):
        os.kill(self.pid, signal.SIGINT)
        end = time.monotonic() + 15.0
        while time.monotonic() < end:
            try:
                self.read(0.1)
            except OSError:
                break
        return os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])


@pytest.fixture
def domain():
    """Return the domain of a test's graph."""
    isolate()
    return take_domain()


@pytest.fixture
def radio(domain):
    """Return a stream on the graph."""
    radio = Radio(domain)
    yield radio
    radio.close()


def look_at(text, columns, lines):
    """Check what every size must show; return the rows."""
    rows = text.split('\n')
    assert len(rows) == lines
    assert all(len(row) == columns for row in rows)
    assert (' LIVE ' if columns < 110 else ' live: scans at 10.0 Hz') in rows[0]
    assert '/plc_inspect' in rows[0]
    assert 'data 0.' in rows[0]
    assert 'ALARM: hazard' in rows[1]
    for title in ('health, ', 'hazards: 30', 'spans: 40', 'events'):
        assert title in text
    assert 'scan rate' in text
    assert '10.0 Hz' in text
    assert 'scans lost  4' in text
    assert all(row[0] + row[-1] in ('╭╮', '││', '╰╯') for row in rows[2:])
    return rows


@pytest.mark.slow
def test_narrow_wide_lost_and_back(domain, radio):
    def narrow(text):
        rows = look_at(text, 80, 24)
        first = next((row for row in rows if row.startswith('│ critical')), '')
        assert first.split()[1:8] == ['critical', 'vegetation', '0', '0', '0', '1.23', '2.00']
        assert not any('…' in row[10:-1] for row in rows[2:9])

    def wide(text):
        rows = look_at(text, 150, 50)
        assert 'delay' in text
        assert any('hazards: 30' in row and 'spans: 40' in row for row in rows)
        assert 'restarts 0' in rows[0]
        assert sum('vegetation' in row for row in rows) > 20

    def too_small(text):
        assert '60 x 20 are needed' in ' '.join(text.split())

    def lost(text):
        for words in ('LINK LOST', 'everything below is OLD', 'hazards: 30'):  # with their age
            assert words in text

    def back(text):
        for words in (
            ' LIVE ', 'spans: 0', 'the node was started anew', '10 alarms may still be there'
        ):
            assert words in text
        assert 'ALARM:' not in text

    terminal = Terminal(domain, 80, 24)
    try:
        terminal.wait(narrow)
        terminal.resize(150, 50)
        terminal.wait(wide)
        terminal.resize(40, 10)
        terminal.wait(too_small)
        terminal.resize(80, 24)
        radio.silent = True
        terminal.wait(lost)
        radio.restart()
        terminal.wait(back)
    finally:
        code = terminal.close()
    assert code == 130


def test_alarms_of_the_run_before_may_still_be_there():
    monitor, source = Monitor(), Source()
    monitor.take_summary(source.summary(5.0, keyframe=True, tables=make_rows(6, 4)), 100.0)
    monitor.take_summary(source.summary(6.0, tables=make_rows(6, 3)), 101.0)  # number 3 clears
    other = Source(session=9)
    monitor.take_summary(other.summary(1.0, keyframe=True, tables=NO_TABLES), 104.0)
    console = Console(width=200, record=True, file=io.StringIO())
    console.print(draw_once(monitor.look(104.0), '/plc_inspect'))
    text = console.export_text()
    assert '1 alarm may still be there, as the node began anew: ' in text
    assert ' (and 1 cleared)' in text
    monitor.acknowledge([1], 'crew', 105.0)
    console.print(draw_once(monitor.look(105.0), '/plc_inspect'))
    assert '1 alarm cleared that nobody acknowledged' in console.export_text()


def run(domain, *arguments, timeout=60):
    return subprocess.run(
        [*COMMAND, *arguments], cwd=ROOT, capture_output=True, text=True, timeout=timeout,
        env=os.environ | {'ROS_DOMAIN_ID': str(domain)}, check=False,
    )


def test_once_prints_a_snapshot(domain, radio):
    radio.restart()
    radio.rows = make_rows(6, 3)
    time.sleep(0.5)
    done = run(domain, '--once')
    assert done.returncode == 0, done.stderr
    assert 'live: scans' in done.stdout or 'LIVE' in done.stdout
    assert 'hazards: 3' in done.stdout
    assert 'spans: 6' in done.stdout
    assert '\x1b' not in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize(('arguments', 'text'), [
    (['--once', '--wait', '0.3', '--node', '/nobody'], 'no summary of /nobody within 0.3 s'),
    (['--web', '--host', '0.0.0.0'], 'others can reach 0.0.0.0: give tokens'),
    (['--web', '--token', 'secret word'], '--token TEXT would show it to all users'),
    (['--web', '--token-file', '/nowhere'], '/nowhere cannot be read'),
    (['--web', '--port', '99999'], '99999 is not a port'),
    (['--record', '/nowhere/x.mcap', '--json'], '/nowhere/x.mcap: No such file'),
    (['--period', '0', '--json'], '0 is not a positive number'),
    (['--node', 'bad name', '--json'], 'bad name'),
    ([], 'standard output is not a terminal: use --once or --json'),
    (['--ros-args', '--nonsense'], '--nonsense'),
])
def test_bad_usage_is_one_line(domain, arguments, text):
    done = run(domain, *arguments)
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith('plc_monitor: ')
    assert text in done.stderr
    assert done.stderr.count('\n') == 1
    assert done.stdout == ''


def test_what_is_not_known_is_a_dash():
    monitor, tables, console = Monitor(), make_rows(6, 3), Console(file=io.StringIO(), width=100)
    for name in ('required', 'sigma', 'along_span'):
        tables.hazards[name] = NO_LENGTH
    monitor.take_summary(Source().summary(1.0, keyframe=True, tables=tables, health={}), 1.0)
    console.print(draw_once(monitor.look(1.1), '/plc_inspect'))
    assert 'nan' not in console.file.getvalue()
