# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The routes of the page, for browsers that the gate has let in."""

from collections import deque
from collections.abc import Callable, Mapping
import dataclasses
from dataclasses import dataclass
import math
from typing import Any

from aiohttp import web

from plc_inspect.colors import LOOKS
from plc_inspect.monitor.web.access import Role, VISIT
from plc_inspect.monitor.web.cells import FAR, NEAR, RAMP
from plc_inspect.monitor.web.live import Hub
from plc_inspect.monitor.web.template import list_files, render
from plc_inspect.printable import make_printable

LONGEST_NAME = 40
"""Greatest length of the name of who acknowledges [characters]."""
MOST_NUMBERS = 1000
MOST_REQUESTS = 100
"""Most pending requests; more are refused."""
HEARTBEAT = 10.0
"""Period of pings [s]; a browser that does not answer within half of it is disconnected."""

FindProfile = Callable[[str, tuple[int, int]], Mapping[str, Any] | None]
"""Returns the profile of a span, from vehicle and (line_id, span_id)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Acknowledgement:
    """A request to acknowledge alarms."""

    vehicle: str
    numbers: tuple[int, ...]
    who: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Steering:
    """A request to steer a replay; None leaves a value unchanged."""

    time: float | None
    """Time to seek to [s]."""
    playing: bool | None
    speed: float | None


class Site:
    """
    The handlers of the page and of all that it requests.

    Parameters
    ----------
    find_profile : callable
        Returns the side view of a span.
    replays : bool
        The site replays a recorded flight: browsers steer its time and cannot acknowledge.

    """

    def __init__(self, find_profile: FindProfile, *, replays: bool = False) -> None:
        self._find_profile, self._replays = find_profile, replays
        self._hubs: dict[str, Hub] = {}
        self.first = ''
        """The vehicle shown by default."""
        self.requests: deque[Acknowledgement | Steering] = deque()
        """Requests of browsers, oldest first; thread-safe."""

    def find_hub(self, vehicle: str) -> Hub:
        """Return the hub of a vehicle; it is made on the first call."""
        return self._hubs.setdefault(vehicle, Hub())

    def forget(self, vehicle: str) -> None:
        """Show a vehicle no more; browsers that follow it get nothing new."""
        self._hubs.pop(vehicle, None)

    def add_routes(self, router: web.UrlDispatcher) -> None:
        """Register the routes."""
        router.add_get('/', self._show_page)
        router.add_get('/live', self._go_live)
        router.add_get('/profile', self._show_profile)
        if self._replays:
            router.add_post('/time', self._steer)
        else:
            router.add_post('/acknowledge', self._acknowledge)
        router.add_get('/{path:.*}', self._show_file)

    async def _show_page(self, request: web.Request) -> web.Response:
        text = render(
            'index.html', nonce=VISIT.get().nonce, looks=LOOKS.values(),
            ramp=RAMP, near=NEAR, far=FAR,
            table={name: dataclasses.asdict(look) for name, look in LOOKS.items()},
            known=sorted(self._hubs),
        )
        return web.Response(text=text, content_type='text/html')

    async def _show_file(self, request: web.Request) -> web.Response:
        found = list_files().get(request.path)
        if found is None:
            raise web.HTTPNotFound
        response = web.Response(body=found[1], content_type=found[0], charset='utf-8')
        response.enable_compression()
        return response

    async def _go_live(self, request: web.Request) -> web.WebSocketResponse:
        name = request.query.get('vehicle') or self.first or next(iter(self._hubs), '')
        hub = self._hubs.get(name)
        if hub is None:
            raise web.HTTPNotFound
        socket = web.WebSocketResponse(heartbeat=HEARTBEAT, max_msg_size=1024)
        await socket.prepare(request)
        await hub.serve(socket, {
            'vehicle': name,
            'acknowledges': VISIT.get().role is Role.ACKNOWLEDGE and not self._replays,
        }, alarms='alarms' in request.query)
        return socket

    async def _show_profile(self, request: web.Request) -> web.Response:
        try:
            line, span = map(int, request.query.get('span', '').split('/'))
        except ValueError:
            raise web.HTTPBadRequest(reason='span is LINE/SPAN, two numbers') from None
        found = self._find_profile(request.query.get('vehicle', ''), (line, span))
        if found is None:
            raise web.HTTPNotFound
        return web.json_response(found)

    async def _acknowledge(self, request: web.Request) -> web.Response:
        if VISIT.get().role is not Role.ACKNOWLEDGE:
            return web.Response(status=403, text='this token is for viewing only')
        try:
            given = await request.json()
            vehicle, numbers, who = given['vehicle'], given['numbers'], given['who']
        except (ValueError, LookupError, TypeError):  # an unknown charset is a LookupError
            raise web.HTTPBadRequest(reason='needs vehicle, numbers and who') from None
        names = isinstance(who, str) and isinstance(vehicle, str)
        good = names and isinstance(numbers, list) and all(
            isinstance(item, int) and 0 < item < math.inf for item in numbers
        )
        name = make_printable(who).strip() if good else ''
        if not good or not name or len(name) > LONGEST_NAME or len(numbers) > MOST_NUMBERS:
            raise web.HTTPBadRequest(
                reason=f'vehicle and who are names, who of 1 to {LONGEST_NAME} characters, '
                       'numbers are of alarms'
            )
        hub = self._hubs.get(vehicle)
        if hub is None:
            raise web.HTTPNotFound
        if given.get('life', hub.life) != hub.life:  # a page from before: other alarms now
            return web.Response(status=409, text='the monitor was started anew meanwhile')
        if len(self.requests) >= MOST_REQUESTS:
            raise web.HTTPServiceUnavailable
        self.requests.append(Acknowledgement(vehicle=vehicle, numbers=tuple(numbers), who=name))
        return web.Response(status=204)

    async def _steer(self, request: web.Request) -> web.Response:
        if VISIT.get().role is not Role.ACKNOWLEDGE:
            return web.Response(status=403, text='this token is for viewing only')
        try:
            given = await request.json()
            time, playing, speed = (given.get(name) for name in ('time', 'playing', 'speed'))
            good = playing in (None, True, False) and all(
                value is None or (math.isfinite(value) and value >= 0.0) for value in (time, speed)
            )
        except (ValueError, LookupError, AttributeError, TypeError):
            good = False
        if not good:
            raise web.HTTPBadRequest(reason='time and speed are numbers from 0 on')
        if len(self.requests) >= MOST_REQUESTS:
            raise web.HTTPServiceUnavailable
        self.requests.append(Steering(time=time, playing=playing, speed=speed))
        return web.Response(status=204)
