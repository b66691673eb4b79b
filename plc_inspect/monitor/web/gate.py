# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
The door of the page: who may come in, before anything reaches the server behind it.

With tokens, only browsers that have shown one pass, and each answer says what a browser may do
with it; without, only what is meant for this machine.
"""

import asyncio
from collections.abc import AsyncIterable, Awaitable, Callable
import concurrent.futures
import contextlib
import hmac
import ipaddress
import secrets
import ssl
import threading
from urllib.parse import unquote, urlsplit

from aiohttp import ClientError, ClientSession, ClientTimeout, web, WSMessage, WSMsgType

from plc_inspect.errors import ConfigError
from plc_inspect.monitor.web.access import NO_TOKENS, Penalties, Role, Tokens
from plc_inspect.monitor.web.inner_server import add_nonce, Inner, SECRET
from plc_inspect.monitor.web.template import render

COOKIE = 'plc_monitor'
MOST_BODY = 4096
MOST_MESSAGE = 50 * 1024 * 1024
"""Of a web socket, as viser has it [bytes]."""
MOST_CONNECTIONS = 200
TIMEOUT = 15.0
"""A browser must have said what it wants by then [s]."""
HEADERS = {
    'X-Content-Type-Options': 'nosniff', 'X-Frame-Options': 'DENY',
    'Referrer-Policy': 'same-origin', 'Cross-Origin-Opener-Policy': 'same-origin',
    'Cross-Origin-Resource-Policy': 'same-origin', 'Cache-Control': 'no-store',
    'Permissions-Policy': 'camera=(), geolocation=(), microphone=()',
}
"""With no referrer at all, browsers would send forms with an origin of ``null``."""
POLICY = (
    "default-src 'none'; script-src 'nonce-{nonce}' 'wasm-unsafe-eval'; worker-src blob:; "
    "connect-src 'self' data: blob:; img-src 'self' data: blob:; font-src 'self' data:; "
    "style-src 'self' 'unsafe-inline'; form-action 'self'; base-uri 'none'; "
    "frame-ancestors 'none'"
)
"""Styles are inline throughout in viser's page; scripts are not, but for those with the nonce."""

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


def is_loopback(host: str) -> bool:
    """Return whether only this machine can reach what listens on a host."""
    try:
        return host == 'localhost' or ipaddress.ip_address(host.strip('[]')).is_loopback
    except ValueError:
        return False


class Gate:
    """
    Listens for browsers, in a thread of its own.

    Parameters
    ----------
    host : str
        Address to listen on.
    port : int
        Port to listen on, 0 any.
    inner : Inner
        The page's server on this machine.
    tokens : Tokens
        What a browser must show.
    tls : SSLContext or None
        Certificate of the page; None: plain HTTP.
    acknowledge : callable
        Called when somebody who may takes note of the alarms.

    Raises
    ------
    ConfigError
        There is no token though others can reach the host, or the port cannot be had.

    """

    def __init__(
        self, host: str, port: int, inner: Inner, tokens: Tokens = NO_TOKENS, *,
        tls: ssl.SSLContext | None = None, acknowledge: Callable[[], object] = lambda: None,
    ) -> None:
        if not tokens.by_role and not is_loopback(host):
            raise ConfigError(
                f'others can reach {host}: give tokens that they must show, as --token auto or '
                '--token-file'
            )
        self._local, self._scheme = is_loopback(host), 'http' if tls is None else 'https'
        self._inner, self._tokens, self._acknowledge = inner, tokens, acknowledge
        self._secrets = {role: secrets.token_urlsafe(32) for role in tokens.by_role}
        self._penalties = Penalties()
        self._open: dict[object, bool] = {}
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name='plc_gate', daemon=True)
        self._thread.start()
        started = asyncio.run_coroutine_threadsafe(self._start(host, port, tls), self._loop)
        try:
            self.port: int = started.result(TIMEOUT)
        except (OSError, concurrent.futures.TimeoutError) as error:
            self._stop_loop()
            reason = getattr(error, 'strerror', None) or error
            raise ConfigError(f'cannot listen on {host} port {port}: {reason}') from error

    def close(self) -> None:
        """Stop listening, and cut all connections."""
        async def end() -> None:
            self._server.close()
            await self._runner.cleanup()
            await self._session.close()

        with contextlib.suppress(concurrent.futures.TimeoutError):
            asyncio.run_coroutine_threadsafe(end(), self._loop).result(5.0)
        self._stop_loop()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.run_forever()

    def _stop_loop(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(5.0)

    async def _start(self, host: str, port: int, tls: ssl.SSLContext | None) -> int:
        app = web.Application(middlewares=[self._guard], client_max_size=MOST_BODY)
        app.router.add_post('/login', self._log_in)
        app.router.add_post('/acknowledge', self._take_note)
        app.router.add_get('/{path:.*}', self._forward)
        self._session = ClientSession(timeout=ClientTimeout(total=None, sock_connect=TIMEOUT))
        self._runner = web.AppRunner(
            app, access_log=None, keepalive_timeout=TIMEOUT, shutdown_timeout=1.0
        )
        await self._runner.setup()
        try:
            self._server = await self._loop.create_server(
                self._make_protocol, host, port, ssl=tls,
                ssl_handshake_timeout=None if tls is None else TIMEOUT,
            )
        except OSError:
            await self._runner.cleanup()
            await self._session.close()
            raise
        number: int = self._server.sockets[0].getsockname()[1]
        return number

    def _make_protocol(self) -> web.RequestHandler:
        """Return what serves a connection, and cut it off where it says nothing in time."""
        server = self._runner.server
        if server is None:
            raise OSError('the page is closed')
        protocol = server()
        self._open = {
            item: served for item, served in self._open.items()
            if getattr(item, 'transport', None) is not None
        }

        def check() -> None:
            if not self._open.get(protocol) and protocol.transport is not None:
                protocol.transport.close()

        self._loop.call_later(0.0 if len(self._open) >= MOST_CONNECTIONS else TIMEOUT, check)
        self._open[protocol] = False
        return protocol

    @web.middleware
    async def _guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Let pass what may, and say on each answer what a browser may do with it."""
        self._open[request.protocol] = True
        request['nonce'] = secrets.token_urlsafe(16)
        try:
            response = await self._let_in(request, handler)
        except web.HTTPException as error:
            response = web.Response(status=error.status, text=error.reason)
        except (ClientError, ConnectionError, TimeoutError):
            response = web.Response(status=502, text='the page does not answer')
        if not response.prepared:
            response.headers.update(HEADERS)
            response.headers['Content-Security-Policy'] = POLICY.format(nonce=request['nonce'])
            response.headers['Server'] = 'plc_monitor'
            if self._scheme == 'https':
                response.headers['Strict-Transport-Security'] = 'max-age=31536000'
        return response

    async def _let_in(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        if not self._is_meant_for_us(request):
            return web.Response(status=403, text='this page is for its own address')
        if any(part == '..' for part in unquote(request.rel_url.raw_path).split('/')):
            return web.Response(status=404, text='not found')
        request['role'] = self._find_role(request)
        logs_in = request.path == '/login' and request.method == 'POST'
        if request['role'] is None and not logs_in:
            wait = self._penalties.wait_of(request.remote or '')
            return _ask_for_token('Token?' if not wait else 'Wait a little.', 401)
        return await handler(request)

    def _is_meant_for_us(self, request: web.Request) -> bool:
        """Whether the browser was not sent here by a page from elsewhere."""
        host = request.headers.get('Host', '')
        if self._local and not is_loopback(urlsplit(f'//{host}').hostname or ''):
            return False
        acts = request.method != 'GET' or 'Upgrade' in request.headers
        origin = request.headers.get('Origin')
        if acts and request.headers.get('Sec-Fetch-Site', 'same-origin') == 'cross-site':
            return False
        return not acts or origin is None or origin == f'{self._scheme}://{host}'

    def _find_role(self, request: web.Request) -> Role | None:
        """Return what a browser may do, by its cookie or header; None: nothing."""
        if not self._tokens.by_role:
            return Role.ACKNOWLEDGE
        own = request.cookies.get(COOKIE, '').encode()
        for role, secret in self._secrets.items():
            if hmac.compare_digest(own, secret.encode()):
                return role
        word, _, shown = request.headers.get('Authorization', '').partition(' ')
        return self._try_token(request, shown) if word == 'Bearer' and shown else None

    def _try_token(self, request: web.Request, shown: str) -> Role | None:
        """Return the role of a token; who showed a wrong one waits before the next."""
        peer = request.remote or ''
        if self._penalties.wait_of(peer):
            raise web.HTTPTooManyRequests(reason='wait a little before the next token')
        role = self._tokens.find_role(shown)
        if role is None:
            self._penalties.note_wrong(peer)
        else:
            self._penalties.note_right(peer)
        return role

    async def _log_in(self, request: web.Request) -> web.StreamResponse:
        shown = str((await request.post()).get('token', ''))
        role = self._try_token(request, shown) if shown else None
        if role is None:
            return _ask_for_token('Wrong token.' if shown else 'Token?', 401)
        response = web.Response(status=303, headers={'Location': '/'})
        response.set_cookie(
            COOKIE, self._secrets[role], path='/', httponly=True, samesite='Strict',
            secure=self._scheme == 'https',
        )
        return response

    async def _take_note(self, request: web.Request) -> web.StreamResponse:
        if request['role'] is not Role.ACKNOWLEDGE:
            return web.Response(status=403, text='this token is for viewing only')
        self._acknowledge()
        return web.Response(status=303, headers={'Location': '/'})

    async def _forward(self, request: web.Request) -> web.StreamResponse:
        """Pass a request on to the page's server, and everything that follows."""
        url = f'127.0.0.1:{self._inner.port}{request.rel_url.raw_path}'
        secret = {SECRET: self._inner.secret}
        if request.headers.get('Upgrade', '').lower() == 'websocket':
            return await self._join(request, f'ws://{url}', secret)
        async with self._session.get(f'http://{url}', headers=secret) as answer:
            body = await answer.read()
            kind = answer.headers.get('Content-Type', 'application/octet-stream')
            if kind.startswith('text/html'):
                body = add_nonce(body, request['nonce'])
            page = web.Response(status=answer.status, body=body, headers={'Content-Type': kind})
            page.enable_compression()
            return page

    async def _join(
        self, request: web.Request, url: str, secret: dict[str, str]
    ) -> web.StreamResponse:
        """Join a web socket of a browser to the page's server."""
        offered = request.headers.get('Sec-WebSocket-Protocol', '').split(',')
        protocols = [item.strip() for item in offered if item.strip()]
        outer = web.WebSocketResponse(
            protocols=protocols, max_msg_size=MOST_MESSAGE, compress=False
        )
        async with self._session.ws_connect(
            url, headers=secret, protocols=protocols, max_msg_size=MOST_MESSAGE, compress=0
        ) as inner:
            await outer.prepare(request)
            tasks = [
                asyncio.create_task(_pump(outer, inner.send_bytes, inner.send_str)),
                asyncio.create_task(_pump(inner, outer.send_bytes, outer.send_str)),
            ]
            try:
                await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            finally:
                for task in tasks:
                    task.cancel()
                await asyncio.gather(*tasks, return_exceptions=True)
                await outer.close()
        return outer


async def _pump(
    source: AsyncIterable[WSMessage],
    send_bytes: Callable[[bytes], Awaitable[None]], send_text: Callable[[str], Awaitable[None]],
) -> None:
    with contextlib.suppress(ConnectionError, ClientError):
        async for message in source:
            if message.type is WSMsgType.BINARY:
                await send_bytes(message.data)
            elif message.type is WSMsgType.TEXT:
                await send_text(message.data)


def _ask_for_token(message: str, status: int) -> web.Response:
    text = render('token.html', message=message)
    return web.Response(status=status, text=text, content_type='text/html')
