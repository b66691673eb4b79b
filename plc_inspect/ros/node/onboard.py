# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The command ``plc_node``: the onboard node."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, ExitStack, suppress
import os
import signal
import sys
import traceback
from types import FrameType
from typing import NoReturn, TYPE_CHECKING

from plc_inspect.errors import explain_missing, PlcInspectError
from plc_inspect.printable import make_one_line
from plc_inspect.ros.graph.ending import was_cut_short
from plc_inspect.ros.graph.transport import explain_start, lacks_plugins, prepare_transport
from plc_inspect.security.member_keys import find_keys

if TYPE_CHECKING:
    from rclpy.executors import Executor

    from plc_inspect.ros.background.tick_process import TickProcess
    from plc_inspect.ros.node.inspect_node import InspectNode

NAME = 'plc_node'
DONE, DEFECT, BAD_INPUT = 0, 1, 2

ALSO_TERM = (signal.SIGINT, signal.SIGHUP, signal.SIGQUIT)
"""Ctrl-C; the terminal or the ssh session closes; somebody presses the wrong keys."""

SWITCH_INTERVAL = 0.0005
"""How long the worker may hold Python's lock while a callback waits for it [s]."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the node until it is interrupted; return the exit code."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # nothing has begun that must be ended
    arguments = list(sys.argv if argv is None else [NAME, *argv])
    if {'-h', '--help'} & set(arguments):
        print(f'usage: {NAME} [--ros-args -p NAME:=VALUE --params-file FILE -r FROM:=TO ...]\n\n'
              'Finds power lines in scans and odometry, in flight. docs/settings.md lists the\n'
              'parameters, docs/interfaces.md the topics and services.')
        return DONE
    with ExitStack() as stack:
        return _run(arguments, stack)


def _run(arguments: list[str], stack: ExitStack) -> int:
    """Run the node; what is begun before it ends with the stack."""
    try:
        prepare_transport()
        keys = find_keys()
        ticks = _start_ticks(stack)
        import rclpy
        from rclpy.executors import SingleThreadedExecutor

        from plc_inspect.ros.node.inspect_node import InspectNode
    except PlcInspectError as error:
        return _complain(error)
    except ModuleNotFoundError as error:
        return _complain(explain_missing(error))
    sys.setswitchinterval(SWITCH_INTERVAL)
    for number in ALSO_TERM:
        if signal.getsignal(number) is not signal.SIG_IGN:  # nohup
            signal.signal(number, _pass_on)
    try:
        with _hold_tongue():
            rclpy.init(args=arguments)
    except Exception as error:  # rclpy has an exception for each kind of bad argument
        return _complain(error)
    try:
        rest = rclpy.utilities.remove_ros_args(arguments)[1:]
        if rest:
            return _complain(f'unknown argument {rest[0]!r} (see {NAME} --help)')
        node = InspectNode(ticks)
    except PlcInspectError as error:
        rclpy.utilities.try_shutdown()
        return _complain(error)
    except Exception as error:
        if lacks_plugins(error):
            rclpy.utilities.try_shutdown()
            return _complain(explain_start(error))
        if not was_cut_short(error):
            raise
        return DONE
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    code = max(_spin(executor), _save(node))
    if keys is not None:
        # Fast DDS over TCP waits for connections of peers that are gone, some for ever.
        _leave_at_once(code)
    executor.shutdown()
    node.destroy_node()
    rclpy.utilities.try_shutdown()
    if code != DONE:
        _leave_at_once(code)
    return DONE


def _start_ticks(stack: ExitStack) -> 'TickProcess | None':
    """Start the process of the ticks, which loads its modules beside those of this one."""
    from plc_inspect.ros.background.tick_process import TickProcess

    try:
        ticks = TickProcess()
    except OSError as error:
        print(f'{NAME}: ticks run beside the callbacks, which is slower, as no process can be '
              f'started for them: {make_one_line(error)}', file=sys.stderr)
        return None
    stack.callback(ticks.close)
    return ticks


def _spin(executor: 'Executor') -> int:
    """Let callbacks run until the node is interrupted; return the exit code."""
    try:
        executor.spin()
    except KeyboardInterrupt:
        pass
    except BaseException as error:  # whatever it is, the results are saved
        if not isinstance(error, Exception) or not was_cut_short(error):
            traceback.print_exc()
            return DEFECT
    return DONE


def _save(node: 'InspectNode') -> int:
    """Save the results; return the exit code."""
    # A second signal must not cut this off.
    for number in (signal.SIGTERM, *ALSO_TERM):
        signal.signal(number, signal.SIG_IGN)
    try:
        return DONE if node.close() else DEFECT
    except Exception:
        traceback.print_exc()
        return DEFECT


def _pass_on(number: int, frame: FrameType | None) -> None:
    """End as on SIGTERM, which rclpy listens to: between callbacks, not within one."""
    os.kill(os.getpid(), signal.SIGTERM)


def _leave_at_once(code: int) -> NoReturn:
    """End without waiting for threads, of which one may be busy for long."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    os._exit(code)


@contextmanager
def _hold_tongue() -> Iterator[None]:
    """Keep the ROS client library from writing to stderr; what it says is in the exception."""
    kept = os.dup(2)
    try:
        with open(os.devnull, 'wb') as nothing:
            os.dup2(nothing.fileno(), 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def _complain(error: object) -> int:
    print(f'{NAME}: {make_one_line(error)}', file=sys.stderr)
    return BAD_INPUT


if __name__ == '__main__':
    sys.exit(main())
