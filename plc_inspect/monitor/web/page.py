# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The page: a live 3D picture in the browser, drawn by viser behind the gate."""

import contextlib
import dataclasses
import io
import ssl
import threading
from types import TracebackType
from typing import Any

import numpy as np

from plc_inspect.monitor.picture.cloud_store import CellArrays, CloudStore
from plc_inspect.monitor.picture.picture import Picture, SpanItem
from plc_inspect.monitor.web.access import NO_TOKENS, Tokens
from plc_inspect.monitor.web.gate import Gate
from plc_inspect.monitor.web.inner_server import find_inner, start_inner
from plc_inspect.monitor.web.panel import Panel
from plc_inspect.monitor.web.profile import PROFILE_WIDTH
from plc_inspect.monitor.web.scene_3d import Scene


class Page:
    """
    The web server.

    Parameters
    ----------
    host : str
        Address to listen on.
    port : int
        Port to listen on, 0 any.
    cloud : CloudStore
        Of the monitor.
    tokens : Tokens
        What browsers must show.
    tls : SSLContext or None
        Certificate of the page; None: plain HTTP.

    Raises
    ------
    ConfigError
        The host wants a token, or the port cannot be had.

    """

    def __init__(
        self, host: str, port: int, cloud: CloudStore, tokens: Tokens = NO_TOKENS,
        tls: ssl.SSLContext | None = None,
    ) -> None:
        self._cloud = cloud
        self._noted: set[int] = set()
        self._lock = threading.RLock()
        self._panels: dict[int, Panel] = {}
        self._picture: Picture | None = None
        inner = find_inner()
        self._gate = Gate(host, port, inner, tokens, tls=tls, acknowledge=self._acknowledge)
        self._host, self._scheme = host, 'http' if tls is None else 'https'
        try:
            self._server = start_inner(inner)
        except BaseException:
            self._gate.close()
            raise
        self._scene = Scene(self._server, self._on_choice)
        self._server.on_client_connect(self._on_connect)
        self._server.on_client_disconnect(self._on_disconnect)

    def __enter__(self) -> 'Page':
        """Return the page."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop serving."""
        self._gate.close()
        with contextlib.redirect_stdout(io.StringIO()):
            self._server.stop()

    @property
    def address(self) -> str:
        """Where the page is."""
        host = f'[{self._host}]' if ':' in self._host else self._host
        return f'{self._scheme}://{host}:{self._gate.port}/'

    def show(self, picture: Picture) -> None:
        """Show a picture in all browsers; alarms that somebody has noted are no more."""
        with self._lock:
            self._noted &= {item.hazard_id for item in picture.alarms}
            left = tuple(item for item in picture.alarms if item.hazard_id not in self._noted)
            picture = dataclasses.replace(picture, alarms=left)
            self._picture = picture
            arrived = self._scene.update(picture, self._cloud)
            for panel in self._panels.values():
                panel.update(picture, arrived)

    def _acknowledge(self) -> None:
        with self._lock:
            if self._picture is not None:
                self._noted |= {item.hazard_id for item in self._picture.alarms}

    def _on_connect(self, client: Any) -> None:
        with self._lock:
            panel = Panel(client, lambda: self._scene.origin, self._cut_out)
            self._panels[client.client_id] = panel
            if self._picture is not None:
                panel.update(self._picture, False)

    def _on_disconnect(self, client: Any) -> None:
        with self._lock:
            self._panels.pop(client.client_id, None)

    def _on_choice(self, client_id: int, number: int) -> None:
        with self._lock:
            panel = self._panels.get(client_id)
            if panel is not None:
                panel.choose_hazard(number)

    def _cut_out(self, span: SpanItem) -> CellArrays:
        with self._lock:
            return self._cloud.cut_out(np.array(span.start), np.array(span.end), PROFILE_WIDTH)
