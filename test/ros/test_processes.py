# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The node and the player as the processes that users start."""

import json
import os
from pathlib import Path
import resource
import signal
import subprocess
import sys
import time

import pytest
import rclpy
from rclpy.context import Context
from rig import FIRST_DEADLINE, isolate, Robot, take_domain, wait_for

from plc_inspect.offline.commands.recover import main as recover
from plc_inspect.security.command import main as make_keys

ROOT = Path(__file__).parents[2]
DEMO = ROOT / 'bags' / 'demo'
NODE = 'plc_inspect.ros.node.onboard'
PLAYER = 'plc_inspect.ros.play'


class Command:
    """A module that runs as a process; its stderr goes into a file."""

    def __init__(self, folder, domain, module, *arguments, limit=None):
        isolate()
        self.log = folder / f'{module}.log'
        environment = os.environ | {'ROS_DOMAIN_ID': str(domain), 'ROS_HOME': str(folder)}

        def begin():
            for number in (signal.SIGHUP, signal.SIGQUIT):
                signal.signal(number, signal.SIG_DFL)  # a shell may let them be ignored
            if limit is not None:
                resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

        with self.log.open('w') as stream:
            self.process = subprocess.Popen(
                [sys.executable, '-m', module, *map(str, arguments)], cwd=ROOT,
                env=environment, stdout=stream, stderr=subprocess.STDOUT, preexec_fn=begin,
            )

    def text(self):
        return self.log.read_text()

    def end(self, number=signal.SIGINT, deadline=40.0):
        """Send a signal and return the exit code."""
        self.process.send_signal(number)
        return self.process.wait(deadline)

    def kill(self):
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()


@pytest.fixture
def start(tmp_path):
    """Return a function that starts a command; all are ended after the test."""
    commands = []
    domain = take_domain()

    def run(module, *arguments, **options):
        commands.append(Command(tmp_path, domain, module, *arguments, **options))
        return commands[-1]

    run.domain = domain
    yield run
    for command in commands:
        command.kill()


@pytest.fixture
def robot(start):
    """Return a robot on the graph of the commands."""
    isolate()
    context = Context()
    rclpy.init(context=context, domain_id=start.domain)
    robot = Robot(context)
    yield robot
    robot.close()
    rclpy.shutdown(context=context)


@pytest.mark.slow
@pytest.mark.parametrize(
    'number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT]
)
def test_signal_during_a_tick_saves_the_results(start, robot, tmp_path, number):
    node = start(
        NODE, '--ros-args', '-p', f'output.directory:={tmp_path / "out"}',
        '-p', 'segment.period:=0.05', '-p', 'map.max_voxels:=200000',
    )
    robot.connect()
    wait_for(lambda: 'ready' in node.text(), 'ready node', FIRST_DEADLINE)
    end = time.monotonic() + 3.0
    while time.monotonic() < end:  # a tick is running nearly all the time
        robot.step()
        time.sleep(0.02)
    assert node.end(number) == 0, node.text()
    assert f'saved to {tmp_path / "out"}' in node.text()
    assert 'Traceback' not in node.text()
    assert len(json.loads((tmp_path / 'out' / 'spans.json').read_text())['spans']) == 6
    assert sorted(path.name for path in tmp_path.iterdir() if 'partial' in path.name) == []


def fly(node, robot):
    """Let the node see the sample."""
    robot.connect()
    wait_for(lambda: 'ready' in node.text(), 'ready node', FIRST_DEADLINE)
    for _ in range(20):
        robot.step()
        time.sleep(0.05)


@pytest.mark.slow
@pytest.mark.parametrize('elsewhere', [True, False])
def test_results_that_cannot_be_written_where_they_should(start, robot, tmp_path, elsewhere):
    out = tmp_path / 'out'
    node = start(NODE, '--ros-args', '-p', f'output.directory:={out}',
                 '-p', 'map.max_voxels:=200000')
    fly(node, robot)
    out.mkdir()
    (out / 'mine.txt').write_text('keep')
    if not elsewhere:
        (tmp_path / 'plc_inspect').write_text('in the way')
    assert node.end(signal.SIGTERM) == (0 if elsewhere else 1), node.text()
    assert 'Traceback' not in node.text()
    assert 'files that are not results' in node.text()
    assert [item.name for item in out.iterdir()] == ['mine.txt']
    found = list(tmp_path.glob('plc_inspect/flight_*/points.laz'))
    assert len(found) == elsewhere
    told = [line for line in node.text().splitlines() if 'files that are not results' in line]
    assert len(told) == 1
    assert (f'saved to {found[0].parent}' if elsewhere else 'not saved') in told[0]


@pytest.mark.slow
def test_limit_of_file_size_leaves_the_tables(start, robot, tmp_path):
    node = start(NODE, '--ros-args', '-p', f'output.directory:={tmp_path / "out"}',
                 '-p', 'map.max_voxels:=200000', limit=100_000)
    fly(node, robot)
    assert node.end(signal.SIGTERM) == 1, node.text()
    assert 'Traceback' not in node.text()
    assert f'saved the tables only to {tmp_path / "out"}' in node.text()
    assert len(json.loads((tmp_path / 'out' / 'spans.json').read_text())['spans']) == 6
    assert not (tmp_path / 'out' / 'points.laz').exists()


@pytest.mark.slow
def test_killed_node_goes_on_and_its_record_makes_the_results(start, robot, tmp_path):
    options = ('--ros-args', '-p', f'output.directory:={tmp_path / "out"}',
               '-p', 'map.max_voxels:=200000', '-p', 'segment.period:=0.3')
    stale = tmp_path / '.out.abc.partial'
    (stale / 'new').mkdir(parents=True)
    node = start(NODE, *options)
    fly(node, robot)
    assert f'{stale} was left half-written' in node.text()
    assert not stale.exists()
    wait_for(lambda: robot.step() or time.sleep(0.05) or 'line 2 found' in node.text(), 'lines')
    time.sleep(1.0)
    assert node.end(signal.SIGKILL) == -signal.SIGKILL
    assert not (tmp_path / 'out').exists()
    assert recover([str(tmp_path / 'out.record'), '-o', str(tmp_path / 'made'), '--quiet']) == 0
    again = start(NODE, *options)
    wait_for(lambda: again.text().endswith(': ready\n'), 'ready node')
    assert ' goes on: ' in again.text()
    assert again.end(signal.SIGTERM) == 0, again.text()
    keys = [
        [(row['line_id'], row['span_id'])
         for row in json.loads((tmp_path / name / 'spans.json').read_text())['spans']]
        for name in ('made', 'out')
    ]
    assert len(keys[0]) == 6
    assert keys[0] == keys[1]


SPIN = """
import sys
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from plc_inspect.ros.node.onboard import main

def spin(executor):
    {first}
    with executor.context.handle:
        rclpy_implementation.WaitSet(0, 0, 0, 0, 0, 0, executor.context.handle)
    raise RuntimeError('a defect')

SingleThreadedExecutor.spin = spin
sys.exit(main(['--ros-args', '-p', 'map.max_voxels:=20000']))
"""


@pytest.mark.slow
@pytest.mark.parametrize(('first', 'code', 'keys'), [
    ('rclpy.shutdown()', 0, False), ('pass', 1, False), ('pass', 1, True),
])
def test_end_of_ros_in_the_middle_of_a_wait_is_no_defect(tmp_path, first, code, keys):
    # A signal may come between the question whether all is well and the wait for messages.
    isolate()
    given = {}
    if keys:
        assert make_keys(['create', str(tmp_path / 'keys')]) == 0
        given['PLC_KEYS'] = str(tmp_path / 'keys/vehicle')
    done = subprocess.run(
        [sys.executable, '-c', SPIN.format(first=first)], cwd=ROOT, text=True, timeout=120.0,
        env=os.environ | given | {
            'ROS_DOMAIN_ID': str(take_domain()), 'ROS_HOME': str(tmp_path),
        },
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False,
    )
    assert done.returncode == code, done.stdout
    assert ('Traceback' in done.stdout) == ('a defect' in done.stdout) == bool(code)
    assert 'nothing to save' in done.stdout


INTERRUPT = """
import os
import signal
import sys
import time
from plc_inspect.ros.node import inspect_node, onboard

def interrupt(real):
    def run(*arguments):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.3)
        return real(*arguments)
    return run

if {at!r} == 'start':
    inspect_node.warm_up_intake = interrupt(inspect_node.warm_up_intake)
else:
    real = inspect_node.InspectNode._on_second
    inspect_node.InspectNode._on_second = interrupt(real)
    onboard._save = interrupt(onboard._save)
sys.exit(onboard.main(['--ros-args', '-p', 'map.max_voxels:=20000']))
"""


@pytest.mark.slow
@pytest.mark.parametrize('at', ['start', 'callback and before the save'])
def test_ctrl_c_ends_the_node_between_callbacks(tmp_path, at):
    isolate()
    done = subprocess.run(
        [sys.executable, '-c', INTERRUPT.format(at=at)], cwd=ROOT, text=True, timeout=120.0,
        env=os.environ | {'ROS_DOMAIN_ID': str(take_domain()), 'ROS_HOME': str(tmp_path)},
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False,
    )
    assert done.returncode == 0, done.stdout
    assert 'Traceback' not in done.stdout
    assert ('nothing to save' in done.stdout) == (at != 'start')


@pytest.mark.slow
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_demo_ends_its_processes_on_a_signal(start, tmp_path, number):
    demo = start('plc_inspect.ros.demo', DEMO, tmp_path / 'out')
    wait_for(lambda: 'node and player' in demo.text(), 'node and player', FIRST_DEADLINE)
    time.sleep(2.0)
    assert demo.end(number) == 130, demo.text()
    assert 'Traceback' not in demo.text()


@pytest.mark.slow
def test_without_data_nothing_is_saved_with_the_committed_parameter_file(start, tmp_path):
    node = start(
        NODE, '--ros-args', '--params-file', ROOT / 'config' / 'plc_inspect.yaml',
        '-p', 'map.max_voxels:=20000',
    )
    wait_for(lambda: 'ready' in node.text(), 'ready node', FIRST_DEADLINE)
    assert node.end() == 0
    assert 'nothing to save' in node.text()
    assert not (tmp_path / 'plc_inspect').exists()


@pytest.mark.slow
def test_flight_of_which_nothing_was_used_is_no_success(start, robot, tmp_path):
    node = start(NODE, '--ros-args', '-p', 'map.max_voxels:=20000')
    robot.connect()
    wait_for(lambda: 'ready' in node.text(), 'ready node', FIRST_DEADLINE)
    for _ in range(30):
        robot.time = round(robot.time + 0.1, 6)
        robot.send_pose()
        robot.send_scan(stamp=robot.time + 18.0)
        time.sleep(0.05)
    assert node.end() == 1
    assert 'nothing to save: scan stamps are 18.' in node.text()


@pytest.mark.slow
def test_bad_usage_of_the_node_is_one_line(start):
    node = start(NODE, 'surplus')
    assert node.process.wait(60.0) == 2, node.text()
    assert "unknown argument 'surplus'" in node.text()
    assert node.text().startswith('plc_node: ')
    assert node.text().count('\n') == 1


TRIES = """
import json
import sys
from plc_inspect.ros.node.onboard import main

for arguments in json.loads(sys.argv[1]):
    print('exit', main(arguments), file=sys.stderr)
"""


@pytest.mark.slow
def test_bad_parameters_of_the_node_are_one_line_each():
    tries = [
        (['--ros-args', '-p', 'height.beta:=1000.0'], 'height.beta must lie in [1, 50]'),
        (['--ros-args', '-p', 'height.betta:=5.0'], 'unknown parameter height.betta'),
        (['--ros-args', '-p', 'height.num_bins:=many'], 'height.num_bins must be like 100'),
        (['--ros-args', '--params-file', '/nowhere.yaml'], '/nowhere.yaml'),
        (['--ros-args', '--nonsense'], '--nonsense'),
    ]
    isolate()
    done = subprocess.run(
        [sys.executable, '-c', TRIES, json.dumps([arguments for arguments, _ in tries])],
        cwd=ROOT, env=os.environ | {'ROS_DOMAIN_ID': str(take_domain())}, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=120.0, check=True,
    )
    said = done.stdout.splitlines()
    assert said[1::2] == ['exit 2'] * len(tries), done.stdout
    for (_, text), line in zip(tries, said[::2], strict=True):
        assert text in line
        assert line.startswith('plc_node: ')


def test_help():
    for module, usage in ((NODE, 'usage: plc_node'), (PLAYER, 'usage: plc_play')):
        done = subprocess.run(
            [sys.executable, '-m', module, '--help'], capture_output=True, text=True, cwd=ROOT,
            timeout=30, check=True,
        )
        assert done.stdout.startswith(usage)


def test_bad_usage_of_the_player_is_one_line(start):
    player = start(PLAYER, '/nowhere')
    assert player.process.wait(30.0) == 2
    assert '/nowhere does not exist' in player.text()
    assert player.text().count('\n') == 1
