# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The command ``plc_monitor``: the ground station."""

import argparse
from collections.abc import Callable, Sequence
from contextlib import ExitStack
import os
from pathlib import Path
import ssl
import sys
import time
from typing import Any, TYPE_CHECKING

from plc_inspect.errors import ConfigError, DataError
from plc_inspect.offline.commands.command_line import (
    DONE,
    parse_with_ros,
    Parser,
    positive,
    run_command,
)
from plc_inspect.printable import make_printable
from plc_inspect.security.member_keys import VARIABLE as KEYS

if TYPE_CHECKING:
    from plc_inspect.monitor.web.access import Tokens

NAME = 'plc_monitor'
NODE = '/plc_inspect'
PERIOD, PAGE_PERIOD = 0.5, 0.25
"""Time between two pictures on the screen, and on the page [s]."""
SETTLE = 0.3
"""Time after the picture is complete in which messages that the node kept may still arrive [s]."""

AUTO = 'auto'
VARIABLE, VIEW_VARIABLE = 'PLC_MONITOR_TOKEN', 'PLC_MONITOR_VIEW_TOKEN'
"""Tokens of who may acknowledge alarms, and of who may only view."""

def main(argv: Sequence[str] | None = None) -> int:
    """Run the monitor; return 0 done, 2 bad usage or no node with ``--once``."""
    arguments = _parse(argv)
    code = run_command(NAME, lambda: _run(arguments))
    if os.environ.get(KEYS):
        # Fast DDS over TCP waits for connections of peers that are gone, some for ever.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    return code


def _run(arguments: argparse.Namespace) -> int:
    if arguments.open is not None:
        return _replay(arguments)
    from plc_inspect.monitor.fleet import Fleet
    from plc_inspect.monitor.station import Station
    from plc_inspect.ros.graph.transport import prepare_transport

    prepare_transport()
    with ExitStack() as stack:
        recorder = None
        names = arguments.nodes or [NODE]
        arguments.node = names[0]
        if len(names) > 1 and not arguments.web:
            raise ConfigError('more than one --node needs --web')
        if arguments.record is not None:
            from plc_inspect.monitor.record.recorder import Recorder

            recorder = stack.enter_context(
                Recorder(arguments.record, arguments.node, force=arguments.force)  # all vehicles
            )

        def join(name: str) -> Station:
            return Station(
                name, arguments.ros, cloud=arguments.corridor,
                recorder=None if recorder is None else recorder.beside(name),
            )

        if arguments.web:
            fleet = stack.enter_context(Fleet(join, names, search=not arguments.nodes))
            return _show_page(fleet, arguments)
        station = stack.enter_context(join(arguments.node))
        if arguments.once:
            return _show_once(station, arguments)
        return _show(station, arguments)


def _show_once(station: Any, arguments: argparse.Namespace) -> int:
    deadline = time.monotonic() + arguments.wait
    picture = station.look()
    while not picture.complete:
        if time.monotonic() > deadline:
            there = station.find_nodes()
            hint = f'there is: --node {", --node ".join(there)}' if there else (
                'is the node running, on this network and with the same ROS_DOMAIN_ID?'
            )
            raise DataError(
                f'no summary of {arguments.node} within {arguments.wait:g} s: {hint}'
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
    from plc_inspect.monitor.terminal.screen import Screen

    with Screen(arguments.node) as screen:
        _loop(station, PERIOD, lambda own: screen.show(own.look()))
    return DONE


def _show_json(station: Any, period: float) -> int:
    from plc_inspect.monitor.terminal.snapshot import format_snapshot

    _loop(station, period, lambda own: print(format_snapshot(own.look()), flush=True))
    return DONE


def _show_page(fleet: Any, arguments: argparse.Namespace) -> int:
    from plc_inspect.monitor.web.page import Page
    from plc_inspect.monitor.web.site import Acknowledgement

    tokens, tls = _choose_tokens(arguments), _choose_certificate()
    def show(_: object = None) -> None:
        for request in page.take_requests():
            if isinstance(request, Acknowledgement) and request.vehicle in fleet.stations:
                fleet.stations[request.vehicle].acknowledge(request.numbers, request.who)
        page.keep(fleet.stations)
        for name, station in fleet.stations.items():
            page.show(name, station.look(), station.monitor.cloud)

    with Page(arguments.host, arguments.port, tokens, tls) as page:
        show()
        _introduce(page, arguments, tokens, tls)
        _loop(fleet, PAGE_PERIOD, show)
    return DONE


def _introduce(
    page: Any, arguments: argparse.Namespace, tokens: 'Tokens', tls: ssl.SSLContext | None
) -> None:
    """Print the address of the page, and how to get in."""
    from plc_inspect.monitor.web.gate import is_loopback

    print(f'{NAME}: {page.address}', flush=True)
    if arguments.token == AUTO:
        for role, token in tokens.by_role.items():
            print(f'{NAME}: token to {role.value}: {token}', flush=True)
    if tls is None and not is_loopback(arguments.host):
        print(f'{NAME}: the token and the page cross the network unencrypted: set PLC_KEYS '
              'for HTTPS (docs/security.md)', flush=True)


def _replay(arguments: argparse.Namespace) -> int:
    """Replay a recorded flight on the page until the command is interrupted."""
    from plc_inspect.monitor.replay.replay import Replay
    from plc_inspect.monitor.replay.tape import read_tape
    from plc_inspect.monitor.web.page import Page
    from plc_inspect.monitor.web.site import Steering

    if arguments.once or arguments.json or arguments.record is not None:
        raise ConfigError('--open replays on the page: not with --once, --json, --record')
    names = arguments.nodes or ['']
    if len(names) > 1:
        raise ConfigError('--open replays one vehicle: give --node once')
    replay = Replay(read_tape(arguments.open, names[0]))
    if replay.tape.note:
        text = make_printable(f'{NAME}: {arguments.open}: {replay.tape.note}')
        print(text, file=sys.stderr, flush=True)
    tokens, tls = _choose_tokens(arguments), _choose_certificate()
    with Page(arguments.host, arguments.port, tokens, tls, replays=True) as page:
        page.show(replay.tape.name, replay.look(), replay.cloud, replay)
        _introduce(page, arguments, tokens, tls)
        before = time.monotonic()
        while True:
            time.sleep(PAGE_PERIOD)
            for request in page.take_requests():
                if isinstance(request, Steering):
                    replay.steer(request.time, request.playing, request.speed)
            now = time.monotonic()
            replay.step(now - before)
            before = now
            page.show(replay.tape.name, replay.look(), replay.cloud, replay)


def _choose_tokens(arguments: argparse.Namespace) -> 'Tokens':
    """Return the tokens of the page: from a file, the environment, random, or none."""
    from plc_inspect.monitor.web.access import check_tokens, make_tokens, read_tokens, Role

    if arguments.token_file is not None:
        return read_tokens(arguments.token_file)
    if arguments.token == AUTO:
        return make_tokens()
    if arguments.token:
        raise ConfigError(
            f'--token TEXT would show it to all users of this machine: set {VARIABLE}, or use '
            '--token-file or --token auto'
        )
    given = {
        role: text for role, name in ((Role.ACKNOWLEDGE, VARIABLE), (Role.VIEW, VIEW_VARIABLE))
        if (text := os.environ.get(name, ''))
    }
    return check_tokens(given)


def _choose_certificate() -> ssl.SSLContext | None:
    """Return the page's certificate, from the keys of this machine."""
    from plc_inspect.security.member_keys import find_keys

    keys = find_keys()
    if keys is None:
        return None
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        context.load_cert_chain(keys.folder / 'member.crt', keys.folder / 'member.key')
    except (OSError, ssl.SSLError) as error:
        raise ConfigError(f'{keys.folder}/member.crt cannot be used: {error}') from error
    return context


def _loop(station: Any, period: float, show: Callable[[Any], object]) -> None:
    """
    Show a station or a fleet every ``period`` [s] until shutdown of ROS.

    A new alarm of a fleet is shown at once.
    """
    due, raises = time.monotonic(), 0
    while station.spin(max(0.0, min(due - time.monotonic(), 0.2))):
        alarmed = getattr(station, 'raises', 0) != raises
        if alarmed or time.monotonic() >= due:
            raises = getattr(station, 'raises', 0)
            show(station)
            due = max(due + period, time.monotonic())


def port(text: str) -> int:
    """Read a port, 0 any, as the type of an argument."""
    value = int(text)
    if not 0 <= value <= 65_535:
        raise argparse.ArgumentTypeError(f'{text} is not a port')
    return value


def _parse(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = Parser(
        prog=NAME,
        description='Shows what plc_node finds, over a thin link, while the vehicle flies.',
    )
    parser.add_argument('--web', action='store_true', help='serve a live page for browsers')
    parser.add_argument('--open', type=Path, metavar='FILE',
                        help='replay a record of --record, or show a results folder, on the page')
    parser.add_argument('--host', default='127.0.0.1', metavar='ADDRESS',
                        help='where --web listens; for others than this machine it needs --token '
                        '(default: %(default)s)')
    parser.add_argument('--port', type=port, default=8080, metavar='N',
                        help='port of --web, 0 any (default: %(default)s)')
    parser.add_argument('--token', default='', metavar='auto',
                        help='make up what browsers must show, to view and to acknowledge alarms; '
                        f'or give it by {VARIABLE} and {VIEW_VARIABLE} in the environment')
    parser.add_argument('--token-file', type=Path, metavar='FILE',
                        help='lines "view TOKEN" and "acknowledge TOKEN", for its owner alone')
    parser.add_argument('--once', action='store_true', help='print a snapshot and end')
    parser.add_argument('--json', action='store_true', help='print a JSON object a line')
    parser.add_argument('--period', type=positive, default=1.0, metavar='S',
                        help='time between two lines of --json (default: %(default)s)')
    parser.add_argument('--wait', type=positive, default=10.0, metavar='S',
                        help='longest wait of --once for the node (default: %(default)s)')
    parser.add_argument('--node', dest='nodes', action='append', metavar='NAME',
                        help=f'node with its namespace (default: {NODE}); with --web it may be '
                        'given several times, and without it the page follows all that it finds; '
                        'with --open the vehicle of a record')
    parser.add_argument('--record', type=Path, metavar='FILE.mcap', help='write what is seen')
    parser.add_argument('--force', action='store_true', help='replace the file of --record')
    parser.add_argument('--no-corridor', dest='corridor', action='store_false',
                        help='do not subscribe to the thinned corridor')
    return parse_with_ros(parser, argv)


if __name__ == '__main__':
    sys.exit(main())
