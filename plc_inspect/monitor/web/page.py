# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The page: the pictures of all vehicles, live in browsers."""

from collections.abc import Container, Mapping
import dataclasses
import ssl
import threading
import time
from types import TracebackType
from typing import Any

import numpy as np

from plc_inspect.monitor.picture.cloud_store import CloudStore
from plc_inspect.monitor.picture.names import name_conductor, name_stretch
from plc_inspect.monitor.picture.picture import Picture
from plc_inspect.monitor.replay.replay import Replay
from plc_inspect.monitor.web.access import NO_TOKENS, Tokens
from plc_inspect.monitor.web.cells import take_changed
from plc_inspect.monitor.web.gate import Gate
from plc_inspect.monitor.web.profile import FRAME, lay_out_profile, PROFILE_WIDTH
from plc_inspect.monitor.web.site import Acknowledgement, Site, Steering
from plc_inspect.monitor.web.values import (
    format_metres,
    make_fleet_row,
    make_parts,
    make_replay,
    make_rows,
    Rows,
    thin_track,
)

TRACK_PERIOD = 10.0
"""Period of sending the flown track [s]; between, browsers extend it themselves."""


class Page:
    """
    The web server.

    Parameters
    ----------
    host : str
        Address to listen on.
    port : int
        Port to listen on, 0 any.
    tokens : Tokens
        Tokens that let browsers in.
    tls : SSLContext or None
        Certificate of the page; None: plain HTTP.
    replays : bool
        The page replays a recorded flight.

    Raises
    ------
    ConfigError
        The host needs a token, or the port cannot be opened.

    """

    def __init__(
        self, host: str, port: int, tokens: Tokens = NO_TOKENS,
        tls: ssl.SSLContext | None = None, *, replays: bool = False,
    ) -> None:
        self._lock = threading.Lock()
        self._shown: dict[str, tuple[Picture, CloudStore]] = {}
        self._fleet: dict[str, Mapping[str, Any]] = {}
        self._rows: dict[str, tuple[tuple[object, ...], Rows]] = {}
        self._tracks: dict[str, tuple[float, int | None, list[list[float]]]] = {}
        self._site = Site(self._find_profile, replays=replays)
        self._gate = Gate(host, port, self._site, tokens, tls=tls)
        self._host, self._scheme = host, 'http' if tls is None else 'https'

    def __enter__(self) -> 'Page':
        """Return the page."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop serving."""
        self._gate.close()

    @property
    def address(self) -> str:
        """URL of the page."""
        host = f'[{self._host}]' if ':' in self._host else self._host
        return f'{self._scheme}://{host}:{self._gate.port}/'

    def show(
        self, vehicle: str, picture: Picture, cloud: CloudStore,
        replay: Replay | None = None,
    ) -> None:
        """
        Show the picture of a vehicle in all browsers that follow it.

        Parameters
        ----------
        vehicle : str
            Name of the node.
        picture : Picture
            What is known.
        cloud : CloudStore
            Its corridor.
        replay : Replay or None
            State of the replay, None live.

        """
        with self._lock:
            self._shown[vehicle] = picture, cloud
            blocks = take_changed(cloud)
        if replay is None:
            parts = make_parts(picture, vehicle, round(time.time() - time.monotonic(), 1))
        else:
            parts = make_parts(picture, vehicle, replay.tape.start)
            parts |= make_replay(parts['state'], replay)
        self._fleet[vehicle] = make_fleet_row(vehicle, picture)
        rows = [self._fleet[name] for name in sorted(self._fleet)]
        rows = [row for row in rows if row['heard']] or rows
        parts['fleet'] = rows
        self._site.first = rows[0]['name']
        parts['track'] = self._find_track(vehicle, picture, replay)
        self._site.find_hub(vehicle).put(
            parts, self._find_rows(vehicle, picture), blocks, picture.vehicle
        )

    def keep(self, vehicles: Container[str]) -> None:
        """Show no vehicles but these any more."""
        with self._lock:
            gone = [name for name in self._shown if name not in vehicles]
            for name in gone:
                del self._shown[name]
        for name in gone:
            for known in (self._fleet, self._rows, self._tracks):
                known.pop(name, None)
            self._site.forget(name)

    def take_requests(self) -> list[Acknowledgement | Steering]:
        """Return the requests of browsers since the last call."""
        requests = self._site.requests
        return [requests.popleft() for _ in range(len(requests))]

    def _find_rows(self, vehicle: str, picture: Picture) -> Rows:
        """Return the rows of the tables, rebuilt only if they changed."""
        known = picture.hazards, picture.supports, picture.spans
        before = self._rows.get(vehicle)
        if before is None or any(one is not other for one, other in zip(
            before[0], known, strict=True
        )):
            before = self._rows[vehicle] = known, make_rows(picture)
        return before[1]

    def _find_track(
        self, vehicle: str, picture: Picture, replay: Replay | None
    ) -> list[list[float]]:
        now = time.monotonic()
        then, session, track = self._tracks.get(vehicle, (-TRACK_PERIOD, None, []))
        stale = now - then >= TRACK_PERIOD or session != picture.session or not track
        if stale or replay is not None:
            track = thin_track(picture)
            self._tracks[vehicle] = now, picture.session, track
        return track

    def _find_profile(self, vehicle: str, key: tuple[int, int]) -> Mapping[str, Any] | None:
        with self._lock:
            found = self._shown.get(vehicle)
            span = None if found is None else next(
                (item for item in found[0].spans if item.key == key), None
            )
            if found is None or span is None:
                return None
            picture, cloud = found
            cells = cloud.cut_out(np.array(span.start), np.array(span.end), PROFILE_WIDTH)
        profile = lay_out_profile(span, picture.hazards, cells)
        return {
            'frame': dataclasses.asdict(FRAME), 'profile': dataclasses.asdict(profile),
            'title': f'{name_stretch(span, picture.supports)}, {name_conductor(span.line_id)}',
            'text': f'length {span.length:.1f} m, sag {format_metres(span.sag, span.sigma_sag)}, '
                    f'lowest above ground {format_metres(span.ground_clearance)}',
        }
