# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
A mutual TLS tunnel between machines, for DDS over TCP whose own sockets stay on loopback.

Fast DDS has TLS of its own, but its server asks no client for a certificate, as it sets its verify
mode only after the handshake.  So the TCP of the graph stays on 127.0.0.1 and goes through this
tunnel: both ends must present a certificate of the fleet that is valid and not revoked.
"""

import asyncio
from collections.abc import Callable
import contextlib
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
import socket
import ssl
from typing import Any

from plc_inspect.errors import ConfigError
from plc_inspect.security.graph_profile import LOOPBACK, Place
from plc_inspect.security.strangers import Strangers

HANDSHAKE = 10.0
"""Longest handshake [s]; slower peers are disconnected."""
MOST_CONNECTIONS = 128
"""Most simultaneous connections of members; more are refused."""
PIECE = 65_536
MOST_REASONS = 50
"""Most reasons of refusals counted separately."""
FILES = ('root_ca.crt', 'crl.pem', 'member.crt', 'member.key')


@dataclass(slots=True)
class Counts:
    """Counts of connections."""

    accepted: int = 0
    refused: int = 0
    """Connections without a valid certificate."""
    reasons: dict[str, int] = field(default_factory=dict)


def make_context(folder: Path, *, server: bool) -> ssl.SSLContext:
    """
    Return the TLS context: TLS 1.3, and a certificate of the fleet that is not revoked.

    Parameters
    ----------
    folder : Path
        Folder of the member, as ``plc_keys`` made it.
    server : bool
        This end accepts connections.

    Returns
    -------
    SSLContext

    Raises
    ------
    ConfigError
        A file is missing or damaged.

    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER if server else ssl.PROTOCOL_TLS_CLIENT)
    context.minimum_version = ssl.TLSVersion.TLSv1_3
    context.check_hostname = False  # members are known by their names, not their addresses
    context.verify_mode = ssl.CERT_REQUIRED
    context.verify_flags |= ssl.VERIFY_CRL_CHECK_LEAF | ssl.VERIFY_X509_STRICT
    try:
        context.load_verify_locations(folder / 'root_ca.crt')
        context.load_verify_locations(folder / 'crl.pem')
        context.load_cert_chain(folder / 'member.crt', folder / 'member.key')
    except OSError as error:  # of ssl too
        raise ConfigError(f'{folder} is not a folder of a member: {error}') from error
    return context


class Tunnel:
    """
    One end of the tunnel, for an event loop.

    Parameters
    ----------
    folder : Path
        Keys of the member; they are reread when they change, so a new revocation list applies to
        the next connection.
    place : Place
        Address of the vehicle's end on the link.
    port : int
        Loopback port of Fast DDS: of the node on the vehicle, of the entrance elsewhere.
    peer : str
        Member expected at the other end, '' for any of the fleet.
    tell : callable or None
        Receives the reason of a refusal and its count, at the first one and whenever the count has
        doubled.

    """

    def __init__(
        self, folder: Path, place: Place, port: int, peer: str = '',
        tell: Callable[[str, int], object] | None = None,
    ) -> None:
        self._folder, self._place, self._port, self._peer = folder, place, port, peer
        self._tell = tell
        self.counts = Counts()
        self._contexts: dict[bool, tuple[tuple[float, ...], ssl.SSLContext]] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._strangers = Strangers[asyncio.Task[Any]]()
        """Tasks of connections whose other end is not known yet."""

    async def listen(self) -> None:
        """
        Run the vehicle's end until cancelled.

        Raises
        ------
        ConfigError
            The keys cannot be read, or the port cannot be opened.

        """
        self._context(server=True)
        await self._serve(self._place, self._let_in)

    async def connect(self) -> None:
        """Run the other end until cancelled; errors as for ``listen``."""
        self._context(server=False)
        await self._serve(Place(LOOPBACK, self._port), self._lead_out)

    async def _serve(self, place: Place, handle: Callable[[socket.socket], Any]) -> None:
        try:
            listener = socket.create_server((place.address, place.port), backlog=MOST_CONNECTIONS)
        except OSError as error:
            raise ConfigError(
                f'cannot listen on {place.address}:{place.port}: {error.strerror or error}'
            ) from error
        listener.setblocking(False)

        async def run(link: socket.socket) -> None:
            try:
                await handle(link)
            except (OSError, TimeoutError, ConfigError) as error:  # of ssl too
                self._note(error)

        try:
            while True:
                link, address = await asyncio.get_running_loop().sock_accept(listener)
                task = asyncio.create_task(run(link))
                self._tasks.add(task)
                task.add_done_callback(partial(self._forget, link))
                leaving = self._strangers.add(task, address[0])
                if leaving is not None:
                    self._note(TimeoutError('too many handshakes at once'))
                    leaving.cancel()
        finally:
            listener.close()
            for task in self._tasks:
                task.cancel()

    def _forget(self, link: socket.socket, task: asyncio.Task[None]) -> None:
        link.close()  # here, as a task may be cancelled before it began
        self._tasks.discard(task)
        self._strangers.discard(task)

    async def _let_in(self, link: socket.socket) -> None:
        outer = await _take(link, self._context(server=True))
        try:
            self._accept(outer[1])
            await _join(outer, await asyncio.open_connection(LOOPBACK, self._port))
        finally:
            outer[1].close()

    async def _lead_out(self, link: socket.socket) -> None:
        inner = await _take(link, None)
        try:
            outer = await asyncio.wait_for(asyncio.open_connection(
                self._place.address, self._place.port, ssl=self._context(server=False),
                ssl_handshake_timeout=HANDSHAKE, server_hostname='plc_inspect',
            ), HANDSHAKE + 1.0)
            try:
                self._accept(outer[1])
                await _join(inner, outer)
            finally:
                outer[1].close()
        finally:
            inner[1].close()

    def _accept(self, writer: asyncio.StreamWriter) -> None:
        """Check who is at the other end of this task's connection, and count it."""
        self._check_peer(writer)
        task = asyncio.current_task()
        if task is not None:
            self._strangers.discard(task)
        if len(self._tasks) - len(self._strangers) > MOST_CONNECTIONS:
            raise ConnectionRefusedError(f'{MOST_CONNECTIONS} connections are in use')
        self.counts.accepted += 1

    def _check_peer(self, writer: asyncio.StreamWriter) -> None:
        certificate = writer.get_extra_info('peercert') or {}
        names = [value for item in certificate.get('subject', ()) for _, value in item]
        if not names or (self._peer and names != [f'/plc_inspect/{self._peer}']):
            raise PermissionError(f'the other end is {", ".join(names) or "nobody"}')

    def _context(self, *, server: bool) -> ssl.SSLContext:
        try:
            times = tuple((self._folder / name).stat().st_mtime for name in FILES)
        except OSError as error:
            raise ConfigError(f'{error.filename} cannot be read: {error.strerror}') from error
        known = self._contexts.get(server)
        if known is None or known[0] != times:
            known = times, make_context(self._folder, server=server)
            self._contexts[server] = known
        return known[1]

    def _note(self, error: Exception) -> None:
        self.counts.refused += 1
        reason = getattr(error, 'verify_message', '') or getattr(error, 'reason', '') or str(error)
        reason = reason or type(error).__name__
        if len(self.counts.reasons) >= MOST_REASONS and reason not in self.counts.reasons:
            return
        count = self.counts.reasons[reason] = self.counts.reasons.get(reason, 0) + 1
        if self._tell is not None and not count & (count - 1):
            self._tell(reason, count)


Ends = tuple[asyncio.StreamReader, asyncio.StreamWriter]


async def _take(link: socket.socket, context: ssl.SSLContext | None) -> Ends:
    """
    Return both streams of an accepted connection, with TLS from the first byte.

    The loop then owns the socket, and closes it once it no longer watches it: a descriptor closed
    before that would be reused by the next connection, which would receive nothing.
    """
    loop = asyncio.get_running_loop()
    owned = socket.socket(fileno=link.detach())
    owned.setblocking(False)
    reader = asyncio.StreamReader()
    protocol = asyncio.StreamReaderProtocol(reader)
    transport, _ = await loop.connect_accepted_socket(
        lambda: protocol, owned, ssl=context,
        ssl_handshake_timeout=None if context is None else HANDSHAKE,
    )
    return reader, asyncio.StreamWriter(transport, protocol, reader, loop)


async def _join(one: Ends, other: Ends) -> None:
    """Forward data both ways until one end closes."""
    async def pump(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError):
            while data := await reader.read(PIECE):
                writer.write(data)
                await writer.drain()

    tasks = [
        asyncio.create_task(pump(one[0], other[1])), asyncio.create_task(pump(other[0], one[1]))
    ]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        other[1].close()
