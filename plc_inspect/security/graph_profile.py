# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Fast DDS profiles that keep all sockets on loopback.

Between machines the tunnel carries their TCP (tunnel.py); on board, programs find the node over
loopback and send large messages through shared memory.  The built-in transports with their
multicast are off, so a participant with such a profile is invisible on the network.
"""

from dataclasses import dataclass
import ipaddress
from xml.etree import ElementTree

from plc_inspect.errors import ConfigError
from plc_inspect.security.xml_document import add_text, write

NAMESPACE = 'http://www.eprosima.com'
LOOPBACK = '127.0.0.1'
LOGICAL_PORT = 7410
"""
Logical port of discovery within a TCP connection; the same at both ends.
"""
BUFFER = 4_194_304
"""Buffer of a socket [bytes]: six scans of 660 kB."""
SEGMENT, MESSAGE = 16_777_216, 2_097_152
"""Shared memory and the largest message in it [bytes], as in config/fastdds.xml."""


@dataclass(frozen=True, slots=True)
class Place:
    """Address and port of the vehicle's end of the tunnel."""

    address: str
    port: int


def read_place(text: str) -> Place:
    """
    Read ADDRESS:PORT.

    Raises
    ------
    ConfigError
        It is not an IPv4 unicast address with a port.

    """
    address, colon, port = text.rpartition(':')
    try:
        good = bool(colon) and not ipaddress.IPv4Address(address).is_unspecified
    except ValueError:
        good = False
    if not good:
        raise ConfigError(
            f'{text!r} is not an ADDRESS:PORT of one interface, such as 10.0.0.1:7411'
        )
    return Place(address, read_port(port))


def read_port(text: str) -> int:
    """
    Read a port.

    Raises
    ------
    ConfigError
        It is not a port from 1024 to 65535.

    """
    if not (text.isascii() and text.isdigit() and 1024 <= int(text) <= 65_535):
        raise ConfigError(f'{text!r} is not a port from 1024 to 65535')
    return int(text)


def make_profile(
    *, listen: int | None = None, connect: int | None = None, aboard: int | None = None
) -> str:
    """
    Return the Fast DDS profile of one participant.

    Parameters
    ----------
    listen : int or None
        For the node: TCP port on loopback that accepts the tunnel.
    connect : int or None
        For programs on other machines: TCP port on loopback of the tunnel's entrance.
    aboard : int or None
        For programs on the node's machine: UDP port of the node on loopback.

    Returns
    -------
    str
        XML.

    Raises
    ------
    ConfigError
        It both listens and connects, or does nothing.

    """
    if listen is not None and connect is not None:
        raise ConfigError('a participant either listens or connects')
    if listen is None and connect is None and aboard is None:
        raise ConfigError('say where to listen, whom to connect to, or the port aboard')
    root = ElementTree.Element('dds', xmlns=NAMESPACE)
    profiles = ElementTree.SubElement(root, 'profiles')
    transports = ElementTree.SubElement(profiles, 'transport_descriptors')
    used = []
    if aboard is not None:
        _add_aboard(transports)
        used += ['plc_shared_memory', 'plc_loopback']
    if listen is not None or connect is not None:
        _add_tcp_transport(transports, listen)
        used.append('plc_tcp')
    attributes = {'profile_name': 'plc_inspect', 'is_default_profile': 'true'}
    participant = ElementTree.SubElement(profiles, 'participant', attributes)
    rtps = ElementTree.SubElement(participant, 'rtps')
    chosen = ElementTree.SubElement(rtps, 'userTransports')
    for name in used:
        add_text(chosen, 'transport_id', name)
    add_text(rtps, 'useBuiltinTransports', 'false')
    _add_meetings(ElementTree.SubElement(rtps, 'builtin'), listen, connect, aboard)
    return write(root)


def _add_aboard(transports: ElementTree.Element) -> None:
    memory = _transport(transports, 'plc_shared_memory', 'SHM')
    add_text(memory, 'segment_size', SEGMENT)
    add_text(memory, 'maxMessageSize', MESSAGE)
    loopback = _transport(transports, 'plc_loopback', 'UDPv4')
    add_text(ElementTree.SubElement(loopback, 'interfaceWhiteList'), 'address', LOOPBACK)


def _add_tcp_transport(transports: ElementTree.Element, listen: int | None) -> None:
    tcp = _transport(transports, 'plc_tcp', 'TCPv4')
    add_text(tcp, 'sendBufferSize', BUFFER)
    add_text(tcp, 'receiveBufferSize', BUFFER)
    add_text(ElementTree.SubElement(tcp, 'interfaceWhiteList'), 'address', LOOPBACK)
    if listen is not None:
        add_text(ElementTree.SubElement(tcp, 'listening_ports'), 'port', listen)


def _add_meetings(
    builtin: ElementTree.Element, listen: int | None, connect: int | None, aboard: int | None
) -> None:
    """Add the locators at which the participant listens, and its initial peers."""
    node_aboard = aboard is not None and listen is not None
    if listen is not None or aboard is not None:
        own = ElementTree.SubElement(builtin, 'metatrafficUnicastLocatorList')
        if listen is not None:
            _add_tcp(own, listen)
        if aboard is not None:
            _add_udp(own, aboard if node_aboard else None)
    if connect is not None or (aboard is not None and not node_aboard):
        peers = ElementTree.SubElement(builtin, 'initialPeersList')
        if connect is not None:
            _add_tcp(peers, connect)
        if aboard is not None:
            _add_udp(peers, aboard)


def _add_tcp(parent: ElementTree.Element, port: int) -> None:
    locator = ElementTree.SubElement(ElementTree.SubElement(parent, 'locator'), 'tcpv4')
    add_text(locator, 'address', LOOPBACK)
    add_text(locator, 'port', LOGICAL_PORT)
    add_text(locator, 'physical_port', port)


def _add_udp(parent: ElementTree.Element, port: int | None) -> None:
    locator = ElementTree.SubElement(ElementTree.SubElement(parent, 'locator'), 'udpv4')
    add_text(locator, 'address', LOOPBACK)
    if port is not None:
        add_text(locator, 'port', port)


def _transport(parent: ElementTree.Element, name: str, kind: str) -> ElementTree.Element:
    transport = ElementTree.SubElement(parent, 'transport_descriptor')
    add_text(transport, 'transport_id', name)
    add_text(transport, 'type', kind)
    return transport
