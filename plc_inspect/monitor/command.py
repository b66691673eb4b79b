# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The command ``plc_monitor``: the ground station."""

import argparse
from collections.abc import Callable, Sequence
from contextlib import ExitStack
import math
import os
from pathlib import Path
import secrets
import sys
import time
from typing import Any

from plc_inspect.errors import ConfigError, DataError
from plc_inspect.monitor.picture.picture import Picture
from plc_inspect.offline.commands.command_line import DONE, parse_with_ros, Parser, run_command

NAME = 'plc_monitor'
NODE = '/plc_inspect'
PERIOD = 0.5
"""Time between two pictures on the screen [s]."""
SETTLE = 0.3
"""After the first keyframe, what the node kept may go on coming in for so long [s]."""

AUTO = 'auto'
SHORTEST_TOKEN = 8
VARIABLE = 'PLC_MONITOR_TOKEN'

View = Callable[[Picture], object]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the monitor; return 0 done, 2 bad usage or no node with ``--once``."""
    arguments = _parse(argv)
    return run_command(NAME, lambda: _run(arguments))


def _run(arguments: argparse.Namespace) -> int:
    from plc_inspect.monitor.station import Station
    from plc_inspect.ros.graph.transport import prepare_transport

    prepare_transport()
    with ExitStack() as stack:
        recorder = None
        if arguments.record is not None:
            from plc_inspect.monitor.record.recorder import Recorder

            recorder = stack.enter_context(
                Recorder(arguments.record, arguments.node, force=arguments.force)
            )
        station = stack.enter_context(Station(
            arguments.node, arguments.ros, cloud=arguments.corridor, recorder=recorder
        ))
        if arguments.once:
            return _show_once(station, arguments)
        return _show(station, arguments)


def _show_once(station: Any, arguments: argparse.Namespace) -> int:
    deadline = time.monotonic() + arguments.wait
    picture = station.look()
    while not picture.complete:
        if time.monotonic() > deadline:
            raise DataError(
                f'no summary of {arguments.node} within {arguments.wait:g} s: is the node '
                'running, on this network and with the same ROS_DOMAIN_ID?'
            )
        station.spin(0.1)
        picture = station.look()
    settled = time.monotonic() + SETTLE
    while time.monotonic() < settled:
        station.spin(0.05)
    picture = station.look()
    if arguments.json:
        from plc_inspect.monitor.terminal.snapshot import format_snapshot
        print(format_snapshot(picture), flush=True)
    else:
        from plc_inspect.monitor.terminal.text import print_once
        print_once(picture, arguments.node)
    return DONE


def _show(station: Any, arguments: argparse.Namespace) -> int:
    if arguments.json:
        return _show_json(station, arguments.period)
    if arguments.web:
        return _show_page(station, arguments)
    from plc_inspect.monitor.terminal.screen import Screen

    with Screen(arguments.node) as screen:
        _loop(station, PERIOD, screen.show)
    return DONE


def _show_json(station: Any, period: float) -> int:
    from plc_inspect.monitor.terminal.snapshot import format_snapshot

    _loop(station, period, lambda picture: print(format_snapshot(picture), flush=True))
    return DONE


def _show_page(station: Any, arguments: argparse.Namespace) -> int:
    from plc_inspect.monitor.web.gate import is_loopback
    from plc_inspect.monitor.web.page import Page

    token = _choose_token(arguments)
    with Page(arguments.host, arguments.port, token, station.monitor.cloud) as page:
        print(f'{NAME}: {page.address}', flush=True)
        if arguments.token == AUTO:
            print(f'{NAME}: token {token}', flush=True)
        if not is_loopback(arguments.host):
            print(f'{NAME}: the token and the page cross the network unencrypted', flush=True)
        _loop(station, PERIOD, page.show)
    return DONE


def _choose_token(arguments: argparse.Namespace) -> str:
    """Return what browsers must show: given, made up, or nothing on this machine alone."""
    token: str = arguments.token
    if token == AUTO:
        return secrets.token_urlsafe(9)
    if token and len(token) < SHORTEST_TOKEN:
        raise ConfigError(
            f'a token needs at least {SHORTEST_TOKEN} characters, this has {len(token)}'
        )
    return token


def _loop(station: Any, period: float, show: View) -> None:
    """Show a picture every period until the graph is left."""
    due = time.monotonic()
    while station.spin(max(0.0, min(due - time.monotonic(), 0.2))):
        if time.monotonic() >= due:
            show(station.look())
            due = max(due + period, time.monotonic())


def _positive(text: str) -> float:
    value = float(text)
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f'{text} is not a positive number')
    return value


def _port(text: str) -> int:
    value = int(text)
    if not 0 <= value <= 65_535:
        raise argparse.ArgumentTypeError(f'{text} is no port')
    return value


def _parse(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = Parser(
        prog=NAME,
        description='Shows what plc_node finds, over a thin link, while the vehicle flies.',
    )
    parser.add_argument('--web', action='store_true', help='serve a live page for browsers')
    parser.add_argument('--host', default='127.0.0.1', metavar='ADDRESS',
                        help='where --web listens; for others than this machine it needs --token '
                        '(default: %(default)s)')
    parser.add_argument('--port', type=_port, default=8080, metavar='N',
                        help='port of --web, 0 any (default: %(default)s)')
    parser.add_argument('--token', default=os.environ.get(VARIABLE, ''), metavar='TEXT',
                        help=f'what browsers must show, auto makes one up; also {VARIABLE} in the '
                        'environment')
    parser.add_argument('--once', action='store_true', help='print a snapshot and end')
    parser.add_argument('--json', action='store_true', help='print a JSON object a line')
    parser.add_argument('--period', type=_positive, default=1.0, metavar='S',
                        help='time between two lines of --json (default: %(default)s)')
    parser.add_argument('--wait', type=_positive, default=10.0, metavar='S',
                        help='longest wait of --once for the node (default: %(default)s)')
    parser.add_argument('--node', default=NODE, metavar='NAME',
                        help='node with its namespace (default: %(default)s)')
    parser.add_argument('--record', type=Path, metavar='FILE.mcap', help='write what is seen')
    parser.add_argument('--force', action='store_true', help='replace the file of --record')
    parser.add_argument('--no-corridor', dest='corridor', action='store_false',
                        help='do not subscribe to the thinned corridor')
    return parse_with_ros(parser, argv)


if __name__ == '__main__':
    sys.exit(main())
