# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
The page's own server, viser, which has no password: it answers to the gate alone.

It listens on a port of this machine, where any user could ask it.  So each request must carry a
secret that only the gate has.  Its page is one HTML file whose loader adds the program as an
inline script: both get the nonce of the answer, so that the browser runs these and no other.
"""

from collections.abc import Iterator
import contextlib
from dataclasses import dataclass
import hmac
from http import HTTPStatus
import io
import secrets
import socket
from typing import Any

from plc_inspect.errors import ConfigError

SECRET = 'X-Plc-Inner'  # nosec B105
"""Header with the secret."""
_LOADER, _LOADED = b' data-p=', b'e.type="module";'


@dataclass(frozen=True, slots=True)
class Inner:
    """Where the page's server is, and what it wants to hear."""

    port: int
    secret: str


def find_inner() -> Inner:
    """Return a port of this machine that nobody uses, and a new secret."""
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        return Inner(probe.getsockname()[1], secrets.token_urlsafe(32))


def start_inner(inner: Inner) -> Any:
    """
    Start viser, quietly, and without the tunnel that would lead around the gate.

    Raises
    ------
    ConfigError
        This viser listens in another way, so that the secret was never asked for.

    """
    import viser

    with contextlib.redirect_stdout(io.StringIO()), _guard(inner.secret) as guarded:
        server = viser.ViserServer(
            host='127.0.0.1', port=inner.port, label='plc_monitor', verbose=False
        )
    if not guarded or server.get_port() != inner.port:
        server.stop()
        raise ConfigError('this viser does not listen as expected: pip install "viser>=1.1,<2"')
    server.request_share_url = lambda *_, **__: None  # type: ignore[method-assign]
    server.gui.configure_theme(
        show_logo=False, show_share_button=False, dark_mode=True, control_width='large'
    )
    return server


def add_nonce(page: bytes, nonce: str) -> bytes:
    """Return viser's page with a nonce for its loader and for the program that it adds."""
    mark = b'nonce="' + nonce.encode() + b'"'
    page = page.replace(_LOADER, b' ' + mark + _LOADER, 1)
    return page.replace(_LOADED, b'e.' + mark + b';' + _LOADED, 1)


@contextlib.contextmanager
def _guard(secret: str) -> Iterator[list[bool]]:
    """Let web socket servers that start within the block ask for the secret first."""
    import websockets.asyncio.server as library

    original, guarded = library.serve, []

    def serve(*arguments: Any, **options: Any) -> Any:
        answer = options.pop('process_request', None)

        def check(connection: Any, request: Any) -> Any:
            shown = request.headers.get(SECRET, '')
            if not hmac.compare_digest(shown.encode(), secret.encode()):
                return connection.respond(HTTPStatus.FORBIDDEN, 'ask the gate\n')
            return None if answer is None else answer(connection, request)

        guarded.append(True)
        return original(*arguments, process_request=check, **options)

    library.serve = serve  # type: ignore[assignment,misc]
    try:
        yield guarded
    finally:
        library.serve = original  # type: ignore[misc]
