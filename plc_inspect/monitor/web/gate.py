# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
The gate of the page: checks each browser before anything is served.

With tokens, only browsers that have shown one pass; without, only requests meant for this machine.
The headers of each answer limit what a browser may do with it.
"""

import asyncio
from collections.abc import Awaitable, Callable
import concurrent.futures
import contextlib
import ipaddress
import secrets
import ssl
import threading
from urllib.parse import unquote, urlsplit

from aiohttp import web

from plc_inspect.errors import ConfigError
from plc_inspect.monitor.web.access import (
    compare,
    NO_TOKENS,
    Penalties,
    Role,
    Tokens,
    VISIT,
    Visit,
)
from plc_inspect.monitor.web.site import Site
from plc_inspect.monitor.web.template import render
from plc_inspect.security.strangers import Strangers

COOKIE = 'plc_monitor'
MOST_BODY = 4096
MOST_CONNECTIONS = 200
TIMEOUT = 15.0
"""Time within which a browser must send its request [s]."""
HEADERS = {
    'X-Content-Type-Options': 'nosniff', 'X-Frame-Options': 'DENY',
    'Referrer-Policy': 'same-origin', 'Cross-Origin-Opener-Policy': 'same-origin',
    'Cross-Origin-Resource-Policy': 'same-origin', 'Cache-Control': 'no-store',
    'Permissions-Policy': 'camera=(), geolocation=(), microphone=()',
}
"""With no referrer at all, browsers would send forms with an origin of ``null``."""
POLICY = (
    "default-src 'none'; script-src 'self' 'nonce-{nonce}'; worker-src 'self'; "
    "connect-src 'self'; "
    "img-src 'self' data:; style-src 'self' 'nonce-{nonce}'; form-action 'self'; "
    "base-uri 'none'; frame-ancestors 'none'"
)

class _Doorbell(asyncio.Protocol):
    """The first protocol of a connection, before anything is read from it."""

    def __init__(self, ring: Callable[[asyncio.Transport], None]) -> None:
        self._ring = ring

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        if isinstance(transport, asyncio.Transport):
            self._ring(transport)


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
    site : Site
        What is served.
    tokens : Tokens
        Tokens that let browsers in.
    tls : SSLContext or None
        Certificate of the page; None: plain HTTP.

    Raises
    ------
    ConfigError
        There is no token although others can reach the host, or the port cannot be opened.

    """

    def __init__(
        self, host: str, port: int, site: Site, tokens: Tokens = NO_TOKENS, *,
        tls: ssl.SSLContext | None = None,
    ) -> None:
        if not tokens.by_role and not is_loopback(host):
            raise ConfigError(
                f'others can reach {host}: give tokens that they must show, as --token auto or '
                '--token-file'
            )
        self._local, self._scheme = is_loopback(host), 'http' if tls is None else 'https'
        self._site, self._tokens = site, tokens
        self._secrets = {role: secrets.token_urlsafe(32) for role in tokens.by_role}
        self._penalties = Penalties()
        self._strangers = Strangers[asyncio.Transport]()
        self._arrivals: dict[object, asyncio.Event] = {}
        """Connections of browsers that have not yet shown that they may come in."""
        self._receiving: set[asyncio.Task[None]] = set()
        self._open: set[web.RequestHandler] = set()
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
            for task in self._receiving:
                task.cancel()
            await asyncio.gather(*self._receiving, return_exceptions=True)
            await self._runner.cleanup()

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
        self._site.add_routes(app.router)
        self._runner = web.AppRunner(
            app, access_log=None, keepalive_timeout=TIMEOUT, shutdown_timeout=1.0
        )
        await self._runner.setup()
        try:
            self._server = await self._loop.create_server(
                lambda: _Doorbell(lambda link: self._answer(link, tls)), host, port
            )
        except OSError:
            await self._runner.cleanup()
            raise
        number: int = self._server.sockets[0].getsockname()[1]
        return number

    def _answer(self, link: asyncio.Transport, tls: ssl.SSLContext | None) -> None:
        """Take a connection; where too many strangers wait, one of them has to leave."""
        link.pause_reading()
        task = self._loop.create_task(self._receive(link, tls))
        self._receiving.add(task)
        task.add_done_callback(self._receiving.discard)
        task.add_done_callback(lambda _: self._strangers.discard(link))
        leaving = self._strangers.add(link, (link.get_extra_info('peername') or ('',))[0])
        if leaving is not None:
            leaving.abort()

    async def _receive(self, link: asyncio.Transport, tls: ssl.SSLContext | None) -> None:
        """Serve a connection, which is cut off if it may not come in within TIMEOUT."""
        server = self._runner.server
        if server is None or link.is_closing():  # the page is closed, or others came meanwhile
            return link.abort()
        protocol, known = server(), asyncio.Event()
        self._arrivals[protocol] = known
        transport: asyncio.Transport | None = link
        try:
            if tls is None:
                link.set_protocol(protocol)
            else:
                transport = await self._loop.start_tls(
                    link, protocol, tls, server_side=True, ssl_handshake_timeout=TIMEOUT
                )
            if transport is not None:
                protocol.connection_made(transport)
                link.resume_reading()
                await asyncio.wait_for(known.wait(), TIMEOUT)
        except (OSError, TimeoutError, asyncio.CancelledError):
            link.abort()
        finally:
            del self._arrivals[protocol]
        return None

    def _let_stay(self, protocol: web.RequestHandler) -> None:
        """Keep the connection of a browser that may come in."""
        self._open = {item for item in self._open if item.transport is not None} | {protocol}
        if len(self._open) > MOST_CONNECTIONS:
            self._open.discard(protocol)
            raise web.HTTPServiceUnavailable(reason=f'{MOST_CONNECTIONS} connections are open')
        if protocol in self._arrivals:
            self._arrivals[protocol].set()

    @web.middleware
    async def _guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Middleware: refuse what may not pass, and add security headers to each answer."""
        visit = Visit(nonce=secrets.token_urlsafe(16))
        VISIT.set(visit)
        try:
            response = await self._let_in(request, handler)
        except web.HTTPException as error:
            response = web.Response(status=error.status, text=error.reason)
        if not response.prepared:
            response.headers.update(HEADERS)
            response.headers['Content-Security-Policy'] = POLICY.format(nonce=visit.nonce)
            response.headers['Server'] = 'plc_monitor'
            if self._scheme == 'https':
                response.headers['Strict-Transport-Security'] = 'max-age=31536000'
        return response

    async def _let_in(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        if not self._is_meant_for_us(request):
            return web.Response(status=403, text='this page is for its own address')
        if any(part == '..' for part in unquote(request.rel_url.raw_path).split('/')):
            return web.Response(status=404, text='not found')
        role = VISIT.get().role = self._find_role(request)
        logs_in = request.path == '/login' and request.method == 'POST'
        if role is None and not logs_in:
            wait = self._penalties.wait_of(request.remote or '')
            message = 'Token?' if not wait else 'Wait a little.'
            return _ask_for_token(message)
        if role is not None:
            self._let_stay(request.protocol)
        return await handler(request)

    def _is_meant_for_us(self, request: web.Request) -> bool:
        """Whether the request comes from this page, not from another site."""
        host = request.headers.get('Host', '')
        try:
            name = urlsplit(f'//{host}').hostname or ''
        except ValueError:
            raise web.HTTPBadRequest(reason='malformed Host') from None
        if self._local and not is_loopback(name):
            return False
        acts = request.method != 'GET' or 'Upgrade' in request.headers
        origin = request.headers.get('Origin')
        if acts and request.headers.get('Sec-Fetch-Site', 'same-origin') == 'cross-site':
            return False
        return not acts or origin is None or origin == f'{self._scheme}://{host}'

    def _find_role(self, request: web.Request) -> Role | None:
        """Return the role of a browser from its cookie or header, None without access."""
        if not self._tokens.by_role:
            return Role.ACKNOWLEDGE
        own = request.cookies.get(COOKIE, '')
        for role, secret in self._secrets.items():
            if compare(own, secret):
                return role
        word, _, shown = request.headers.get('Authorization', '').partition(' ')
        return self._try_token(request, shown) if word == 'Bearer' and shown else None

    def _try_token(self, request: web.Request, shown: str) -> Role | None:
        """Return the role of a token; after a wrong one, its address must wait."""
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
            return _ask_for_token('Wrong token.' if shown else 'Token?')
        response = web.Response(status=303, headers={'Location': '/'})
        response.set_cookie(
            COOKIE, self._secrets[role], path='/', httponly=True, samesite='Strict',
            secure=self._scheme == 'https',
        )
        return response


def _ask_for_token(message: str) -> web.Response:
    text = render('door.html', message=message, nonce=VISIT.get().nonce)
    return web.Response(status=401, text=text, content_type='text/html')
