# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
The door of the page: who may come in, before anything reaches the server behind it.

The library that draws the page has no password.  So it listens on a port of its own on this
machine, and this forwards to it what may pass: with a token, only browsers that have shown it;
without one, only what is meant for this machine.
"""

import asyncio
from collections.abc import Mapping
import concurrent.futures
import contextlib
from dataclasses import dataclass
import hmac
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
import ipaddress
import secrets
import threading
from urllib.parse import parse_qs, urlsplit

from plc_inspect.errors import ConfigError
from plc_inspect.monitor.web.template import render

COOKIE = 'plc_monitor'
MOST_HEAD, MOST_BODY = 16_384, 4096
TIMEOUT = 15.0
"""A browser must have said what it wants by then [s]."""
PENALTY = 0.5
"""After a wrong token, the next is looked at no sooner [s]."""
ONCE = {'host', 'content-length', 'transfer-encoding', 'origin', 'upgrade', 'cookie'}
"""Headers that a request may have once."""


def is_loopback(host: str) -> bool:
    """Return whether only this machine can reach what listens on a host."""
    try:
        return host == 'localhost' or ipaddress.ip_address(host.strip('[]')).is_loopback
    except ValueError:
        return False


@dataclass(frozen=True, slots=True)
class Request:
    """What a browser asks for."""

    method: str
    target: str
    headers: Mapping[str, str]
    """By name in small letters."""
    head: bytes

    @property
    def upgrade(self) -> bool:
        """Whether it is to become a web socket."""
        return self.headers.get('upgrade', '').lower() == 'websocket'


def read_head(head: bytes) -> Request | None:
    """Return the request that a head holds, None where it is malformed."""
    try:
        first, *lines = head.decode('latin-1').rstrip('\r\n').split('\r\n')
        method, target, version = first.split(' ')
        headers: dict[str, str] = {}
        for line in lines:
            name, colon, value = line.partition(':')
            key = name.lower()
            if not colon or name.strip() != name or (key in headers and key in ONCE):
                return None
            headers[key] = value.strip()
    except ValueError:
        return None
    return Request(method, target, headers, head) if version.startswith('HTTP/1.') else None


class Gate:
    """
    Listens for browsers, in a thread of its own.

    Parameters
    ----------
    host : str
        Address to listen on.
    port : int
        Port to listen on, 0 any.
    inner : int
        Port of the page's server on this machine.
    token : str
        What a browser must show, empty for nothing.

    Raises
    ------
    ConfigError
        There is no token though others can reach the host, or the port cannot be had.

    """

    def __init__(self, host: str, port: int, inner: int, token: str = '') -> None:
        if not token and not is_loopback(host):
            raise ConfigError(
                f'others can reach {host}: give a --token that they must show, or --token auto'
            )
        self._local = is_loopback(host)
        self._inner, self._token = inner, token
        self._secret = secrets.token_urlsafe(32)
        self._busy = asyncio.Lock()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name='plc_gate', daemon=True)
        self._thread.start()
        started = asyncio.run_coroutine_threadsafe(
            asyncio.start_server(self._serve, host, port, limit=MOST_HEAD), self._loop
        )
        try:
            self._server = started.result(TIMEOUT)
        except (OSError, concurrent.futures.TimeoutError) as error:
            self._stop_loop()
            reason = getattr(error, 'strerror', None) or error
            raise ConfigError(f'cannot listen on {host} port {port}: {reason}') from error
        self.port: int = self._server.sockets[0].getsockname()[1]

    def close(self) -> None:
        """Stop listening, and cut all connections."""
        async def end() -> None:
            self._server.close()
            tasks = [task for task in asyncio.all_tasks() if task is not asyncio.current_task()]
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

        with contextlib.suppress(concurrent.futures.TimeoutError):
            asyncio.run_coroutine_threadsafe(end(), self._loop).result(5.0)
        self._stop_loop()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.run_forever()

    def _stop_loop(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(5.0)

    async def _serve(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        try:
            head = await asyncio.wait_for(reader.readuntil(b'\r\n\r\n'), TIMEOUT)
            request = read_head(head)
            if request is None:
                await _answer(writer, HTTPStatus.BAD_REQUEST, 'malformed request')
            elif not self._is_meant_for_us(request):
                await _answer(writer, HTTPStatus.FORBIDDEN, 'this page is for its own address')
            elif self._token and not self._knows(request):
                await self._welcome(request, reader, writer)
            else:
                await self._forward(request, reader, writer)
        except (OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError, TimeoutError,
                asyncio.CancelledError):
            pass  # It is cancelled only when the gate closes.
        finally:
            writer.close()
            with contextlib.suppress(OSError):
                await writer.wait_closed()

    def _is_meant_for_us(self, request: Request) -> bool:
        """Whether the browser was not sent here by a page from elsewhere."""
        host = request.headers.get('host', '')
        if self._local and not is_loopback(urlsplit(f'//{host}').hostname or ''):
            return False
        origin = request.headers.get('origin')
        return not request.upgrade or origin is None or urlsplit(origin).netloc == host

    def _knows(self, request: Request) -> bool:
        """Whether the browser has shown the token before."""
        try:
            cookies = SimpleCookie(request.headers.get('cookie', ''))
        except CookieError:
            return False
        own = cookies.get(COOKIE)
        return own is not None and hmac.compare_digest(
            own.value.encode(), self._secret.encode()
        )

    async def _welcome(
        self, request: Request, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        """Look at the token that is shown, or ask for it."""
        shown = ''
        if request.method == 'POST':
            size = request.headers.get('content-length', '')
            if not size.isdigit() or int(size) > MOST_BODY:
                await _answer(writer, HTTPStatus.BAD_REQUEST, 'malformed request')
                return
            body = await asyncio.wait_for(reader.readexactly(int(size)), TIMEOUT)
            shown = parse_qs(body.decode('utf-8', 'replace')).get('token', [''])[0]
        else:
            shown = parse_qs(urlsplit(request.target).query).get('token', [''])[0]
        if not shown:
            await _ask_for_token(writer, 'Token?')
            return
        async with self._busy:
            good = hmac.compare_digest(shown.encode(), self._token.encode())
            if not good:
                await asyncio.sleep(PENALTY)
        if good:
            await _answer(
                writer, HTTPStatus.SEE_OTHER, '', headers={
                    'Location': '/',
                    'Set-Cookie': f'{COOKIE}={self._secret}; Path=/; HttpOnly; SameSite=Lax',
                },
            )
        else:
            await _ask_for_token(writer, 'Wrong token.')

    async def _forward(
        self, request: Request, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        """Pass a request on to the page's server, and everything that follows."""
        inner_reader, inner_writer = await asyncio.open_connection('127.0.0.1', self._inner)
        inner_writer.write(request.head if request.upgrade else _close_after(request.head))
        tasks = [
            asyncio.create_task(_pump(inner_reader, writer)),
            asyncio.create_task(_pump(reader, inner_writer)),
        ]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            inner_writer.close()


def _close_after(head: bytes) -> bytes:
    """Return a head that lets the server end the connection after its answer."""
    lines = head.split(b'\r\n')
    kept = [line for line in lines[:-2] if not line.lower().startswith(b'connection:')]
    return b'\r\n'.join([*kept, b'Connection: close', b'', b''])


async def _pump(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with contextlib.suppress(OSError):
        while data := await reader.read(65_536):
            writer.write(data)
            await writer.drain()


async def _ask_for_token(writer: asyncio.StreamWriter, message: str) -> None:
    text = render('token.html', message=message)
    await _answer(writer, HTTPStatus.UNAUTHORIZED, text, html=True)


async def _answer(
    writer: asyncio.StreamWriter, status: HTTPStatus, text: str, *, html: bool = False,
    headers: Mapping[str, str] | None = None,
) -> None:
    body = text.encode()
    lines = [
        f'HTTP/1.1 {status.value} {status.phrase}',
        f'Content-Type: text/{"html" if html else "plain"}; charset=utf-8',
        f'Content-Length: {len(body)}', 'Connection: close', 'Cache-Control: no-store',
        'X-Content-Type-Options: nosniff', 'Referrer-Policy: no-referrer',
        *(f'{name}: {value}' for name, value in (headers or {}).items()),
    ]
    writer.write('\r\n'.join([*lines, '', '']).encode() + body)
    await writer.drain()
