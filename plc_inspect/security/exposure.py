# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Network exposure of this process, measured on its sockets instead of its settings.

Each listening TCP port is probed without a certificate.  It counts as closed only if the TLS
handshake requests one and then refuses the connection.
"""

from collections.abc import Iterator, Mapping
import contextlib
from dataclasses import dataclass
import ipaddress
import os
from pathlib import Path
import socket
import ssl

from plc_inspect.errors import ConfigError
from plc_inspect.security.member_keys import find_keys

PATIENCE = 2.0
"""Longest wait for the answer of a port to the probe [s]."""
LISTENING = '0A'
"""State of a listening socket in /proc/net/tcp."""
WARN_DAYS = 14
"""
Certificates that expire sooner are reported [d]: time to get new ones before the next flight.
"""
ADVICE = 'docs/security.md'
Address = tuple[str, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class Exposure:
    """Open sockets, and who may connect."""

    udp: tuple[Address, ...]
    """UDP sockets that other machines can reach."""
    plain: tuple[Address, ...]
    """Listening TCP ports that accept peers without a certificate."""
    closed: tuple[Address, ...]
    """Listening TCP ports that require a certificate."""
    sros2: bool
    """DDS Security is enabled and enforced."""
    own_profile: bool
    """Fast DDS uses the profile of the member's keys."""

    @property
    def open_doors(self) -> tuple[str, ...]:
        """Sockets open to anybody, as ``UDP 0.0.0.0:7400``."""
        udp = (f'UDP {host}:{port}' for host, port in self.udp)
        return (*udp, *(f'TCP {host}:{port}' for host, port in self.plain))

    @property
    def is_tls(self) -> bool:
        """Whether the only access is the tunnel, which requires a certificate."""
        return not self.open_doors and self.own_profile

    def describe(self) -> str:
        """Return a summary in one line."""
        if self.sros2:
            return 'DDS Security is enforced'
        doors = self.open_doors
        if doors:
            more = f' and {len(doors) - 1} more' if len(doors) > 1 else ''
            return f'graph is open to the network: {doors[0]}{more}; {ADVICE}'
        return 'nothing is open to the network' + (
            ', which has the tunnel of PLC_KEYS' if self.own_profile else ''
        )

    def demand(self, require: str) -> None:
        """
        Raise an error if the protection is less than required.

        Parameters
        ----------
        require : str
            ``tls``, ``sros2`` or ``off``.

        Raises
        ------
        ConfigError
            The protection is less.

        """
        if require == 'sros2' and not self.sros2:
            raise ConfigError(
                'security.require is sros2, but ROS_SECURITY_ENABLE=true and '
                f'ROS_SECURITY_STRATEGY=Enforce are not both set; {ADVICE}'
            )
        if require == 'tls' and not self.is_tls:
            cause = self.describe() if self.open_doors else (
                f'PLC_KEYS gave no profile; {ADVICE}'
            )
            raise ConfigError(f'security.require is tls, but {cause}')


def look_at_exposure() -> Exposure:
    """
    Examine the sockets of this process; takes milliseconds, or 2 s with a silent port.

    Returns
    -------
    Exposure

    Raises
    ------
    ConfigError
        PLC_KEYS does not name keys.

    """
    own = set(_own_sockets())
    udp = {
        address for name in ('udp', 'udp6') for address, _, inode in _read_table(name)
        if inode in own and not _is_loopback(address[0])
    }
    listening = {
        address for name in ('tcp', 'tcp6') for address, state, inode in _read_table(name)
        if inode in own and state == LISTENING
    }
    closed = {address for address in listening if refuses_strangers(address)}
    plain = {address for address in listening - closed if not _is_loopback(address[0])}
    keys = find_keys()
    profile = None if keys is None else keys.profile
    chosen = os.environ.get('FASTRTPS_DEFAULT_PROFILES_FILE', '')
    return Exposure(
        udp=tuple(sorted(udp)), plain=tuple(sorted(plain)), closed=tuple(sorted(closed)),
        sros2=is_sros2_enforced(os.environ),
        own_profile=profile is not None and bool(chosen) and Path(chosen) == profile,
    )


def is_sros2_enforced(environment: Mapping[str, str]) -> bool:
    """Return whether ROS is set to start only with DDS Security."""
    return (
        environment.get('ROS_SECURITY_ENABLE') == 'true'
        and environment.get('ROS_SECURITY_STRATEGY') == 'Enforce'
    )


def refuses_strangers(address: Address) -> bool:
    """Return whether a listening port refuses peers without a certificate."""
    host = address[0]
    if ipaddress.ip_address(host).is_unspecified:
        host = '::1' if ':' in host else '127.0.0.1'
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False  # the question is what it asks of us, not who it is
    context.verify_mode = ssl.CERT_NONE
    shaken = False
    try:
        with (
            socket.create_connection((host, address[1]), PATIENCE) as link,
            context.wrap_socket(link) as tls,
        ):
            shaken = True
            tls.settimeout(PATIENCE)
            return not tls.recv(1)
    except TimeoutError:
        return False  # it waits for what we say, or does not speak TLS
    except ssl.SSLError as error:
        return shaken or 'ALERT' in (error.reason or '')
    except OSError:
        return shaken


def _own_sockets() -> Iterator[int]:
    for path in Path('/proc/self/fd').iterdir():
        with contextlib.suppress(OSError):
            target = os.readlink(path)
            if target.startswith('socket:['):
                yield int(target[8:-1])


def _read_table(name: str) -> Iterator[tuple[Address, str, int]]:
    """Yield local address, state and inode of each socket of a kind."""
    try:
        lines = Path('/proc/self/net', name).read_text(encoding='ascii').splitlines()[1:]
    except OSError:
        return
    for line in lines:
        fields = line.split()
        host, _, port = fields[1].partition(':')
        words = [bytes.fromhex(host[k:k + 8])[::-1] for k in range(0, len(host), 8)]
        address = str(ipaddress.ip_address(b''.join(words))), int(port, 16)
        yield address, fields[3], int(fields[9])


def _is_loopback(host: str) -> bool:
    address = ipaddress.ip_address(host)
    mapped = getattr(address, 'ipv4_mapped', None)
    return (mapped or address).is_loopback
