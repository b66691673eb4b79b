# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The command ``plc_keys``: keys and certificates for a fleet."""

import argparse
from collections.abc import Sequence
import contextlib
from datetime import datetime, UTC
from pathlib import Path
import signal
import sys

from plc_inspect.errors import ConfigError
from plc_inspect.offline.commands.command_line import DONE, Parser, run_command
from plc_inspect.printable import make_printable
from plc_inspect.security.member_keys import PROFILE
from plc_inspect.shared_files import find_shared
from plc_inspect.whole_files import replace_file

NAME = 'plc_keys'
POLICY = 'security/policy.xml'
DAYS = 365
"""Validity of certificates [d]: one season; renew them before the next."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return 0 done, 2 bad usage or keys that cannot be read."""
    return run_command(NAME, lambda: _run(_parse(argv)))


def _run(arguments: argparse.Namespace) -> int:
    if arguments.action == 'profile':
        return _write_profile(arguments)
    if arguments.action == 'tunnel':
        return _carry(arguments)
    from plc_inspect.security.keyring import Keyring
    from plc_inspect.security.policy import read_policy

    path = arguments.policy or find_shared(POLICY)
    if path is None:
        raise ConfigError(f'config/{POLICY} is not installed: name it with --policy')
    keyring = Keyring(arguments.keys, read_policy(path))
    if arguments.action == 'create':
        register = keyring.create(
            domain=arguments.domain, days=arguments.days, hosts=arguments.page
        )
    elif arguments.action == 'add':
        register = keyring.add(arguments.name, arguments.role)
    elif arguments.action == 'revoke':
        register = keyring.revoke(arguments.name)
        print(f'{arguments.name} is revoked: copy crl.pem to all others, which until then still '
              'let it in')
    elif arguments.action == 'renew':
        register = keyring.renew()
    else:
        register = keyring.load()
    now = datetime.now(UTC)
    print(f'{"member":<16}{"role":<12}{"valid for":<12}')
    for member in register.members.values():
        left = (datetime.fromisoformat(member.until) - now).days
        state = 'revoked' if member.revoked else f'{left} days' if left >= 0 else 'expired'
        print(f'{member.name:<16}{member.role:<12}{state:<12}')
    return DONE


def _write_profile(arguments: argparse.Namespace) -> int:
    from plc_inspect.security.graph_profile import make_profile, read_port

    ports = {
        name: None if text is None else read_port(text)
        for name in ('listen', 'connect', 'aboard')
        for text in [getattr(arguments, name)]
    }
    text = make_profile(**ports)
    folder: Path = arguments.folder
    if not folder.is_dir():
        raise ConfigError(f'{folder} is not a folder')
    with replace_file(folder / PROFILE) as aside:
        aside.write_text(text, encoding='utf-8')
    print(f'export PLC_KEYS={folder.absolute()}')
    return DONE


def _carry(arguments: argparse.Namespace) -> int:
    import asyncio

    from plc_inspect.security.graph_profile import read_place, read_port
    from plc_inspect.security.tunnel import Tunnel

    if (arguments.listen is None) == (arguments.connect is None):
        raise ConfigError('the tunnel either listens or connects: --listen or --connect')
    place, port = read_place(arguments.listen or arguments.connect), read_port(arguments.port)

    def tell(reason: str, count: int) -> None:
        print(f'{NAME}: {count} refused: {make_printable(reason)}', flush=True)

    async def run() -> None:
        loop, own = asyncio.get_running_loop(), asyncio.current_task()
        for number in (signal.SIGINT, signal.SIGTERM):  # systemd's too, and in the background
            loop.add_signal_handler(number, own.cancel if own is not None else loop.stop)
        await (tunnel.listen() if arguments.listen else tunnel.connect())

    tunnel = Tunnel(arguments.folder, place, port, arguments.peer, tell)
    with contextlib.suppress(asyncio.CancelledError):
        asyncio.run(run())
    counts = tunnel.counts
    print(f'{NAME}: {counts.accepted} connections, {counts.refused} refused', flush=True)
    for reason, count in sorted(counts.reasons.items()):
        tell(reason, count)
    return DONE


def _parse(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = Parser(
        prog=NAME, description='Makes keys and certificates for vehicle, ground and all others, '
        'for TLS and for SROS2; docs/security.md says how to use them.',
    )
    actions = parser.add_subparsers(dest='action', required=True, metavar='ACTION')
    create = actions.add_parser('create', help='make authorities and a member of each role')
    create.add_argument('keys', type=Path, metavar='KEYS', help='new folder')
    create.add_argument('--days', type=int, default=DAYS, metavar='N',
                        help='how long certificates hold (default: %(default)s)')
    create.add_argument('--domain', type=int, default=0, metavar='N',
                        help='ROS_DOMAIN_ID that SROS2 permits (default: %(default)s)')
    create.add_argument('--page', action='append', default=[], metavar='HOST',
                        help='name or address of the ground station in browsers; may be repeated')
    add = actions.add_parser('add', help='add a member, such as a second vehicle')
    add.add_argument('keys', type=Path, metavar='KEYS')
    add.add_argument('name', metavar='NAME')
    add.add_argument('--role', required=True, metavar='ROLE',
                     help='vehicle, ground, operator, driver, navigation or logger')
    revoke = actions.add_parser('revoke', help='take the keys of a member back')
    revoke.add_argument('keys', type=Path, metavar='KEYS')
    revoke.add_argument('name', metavar='NAME')
    for action, text in (('renew', 'issue all certificates anew'), ('list', 'show the members')):
        actions.add_parser(action, help=text).add_argument('keys', type=Path, metavar='KEYS')
    for item in actions.choices.values():
        item.add_argument('--policy', type=Path, metavar='FILE',
                          help='SROS2 policy in place of config/security/policy.xml')
    profile = actions.add_parser(
        'profile', help="write a member's Fast DDS profile, on the machine where it is used"
    )
    profile.add_argument('folder', type=Path, metavar='FOLDER', help='folder of the member')
    profile.add_argument('--listen', metavar='PORT',
                         help='loopback port where the tunnel finds the node: of the vehicle')
    profile.add_argument('--connect', metavar='PORT',
                         help='loopback port of the entrance to the tunnel: of other machines')
    profile.add_argument('--aboard', metavar='PORT',
                         help='loopback port where programs of its own machine find the node')
    tunnel = actions.add_parser(
        'tunnel', help='carry the graph between vehicle and others by mutual TLS, until stopped'
    )
    tunnel.add_argument('folder', type=Path, metavar='FOLDER', help='folder of the member')
    tunnel.add_argument('--listen', metavar='ADDRESS:PORT', help='on the vehicle: its address')
    tunnel.add_argument('--connect', metavar='ADDRESS:PORT', help="on others: the vehicle's")
    tunnel.add_argument('--port', required=True, metavar='PORT',
                        help='loopback port of the profile')
    tunnel.add_argument('--peer', default='', metavar='NAME',
                        help='talk to this member only (default: any of the fleet)')
    return parser.parse_args(argv)


if __name__ == '__main__':
    sys.exit(main())
