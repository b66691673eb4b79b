# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The controls of one browser: what it chose, and where it looks."""

from collections.abc import Callable
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plc_inspect.monitor.picture.cloud_store import CellArrays
from plc_inspect.monitor.picture.picture import HazardItem, Picture, SpanItem
from plc_inspect.monitor.web.markup import (
    draw_bar,
    draw_hazard,
    draw_hazards,
    draw_health,
    draw_profile,
    draw_spans,
    draw_style,
)

NONE = 'none'
BEHIND = np.array([-35.0, -35.0, 30.0])
"""Where a browser that follows the vehicle looks from, about it [m]."""
NEAR = np.array([-14.0, -14.0, 9.0])
LIFT = -14.0
"""On an upright screen, whose lower half is controls, it looks below its target by this [m]."""
PROFILE_PERIOD = 2.0
"""The profile is drawn anew no sooner [s]."""


class Panel:
    """
    One browser.

    Parameters
    ----------
    client : viser.ClientHandle
        The browser.
    origin : callable
        Returns (3,) what is subtracted from all places [m].
    cut_out : callable
        Returns the cells of the corridor beside a span.

    """

    def __init__(
        self, client: Any, origin: Callable[[], NDArray[np.float64]],
        cut_out: Callable[[SpanItem], CellArrays],
    ) -> None:
        self._client = client
        self._find_origin, self._cut_out = origin, cut_out
        self._picture: Picture | None = None
        self._last: NDArray[np.float64] | None = None
        self._profile: tuple[object, float] = (None, 0.0)
        gui = client.gui
        upright = client.camera.image_height > client.camera.image_width
        self._lift = np.array([0.0, 0.0, LIFT if upright else 0.0])
        gui.add_html(draw_style())
        self._bar = gui.add_html('')
        self._follow = gui.add_checkbox('Follow the vehicle', True)
        tabs = gui.add_tab_group()
        with tabs.add_tab('Hazards'):
            self._hazards = gui.add_html('')
            self._hazard = gui.add_dropdown('Hazard', (NONE,))
            self._detail = gui.add_html('')
        with tabs.add_tab('Spans'):
            self._spans = gui.add_html('')
            self._span = gui.add_dropdown('Span', (NONE,))
            self._side = gui.add_html('')
        with tabs.add_tab('Health'):
            self._health = gui.add_html('')
        self._hazard.on_update(lambda _: self._go_to_hazard())
        self._span.on_update(lambda _: self._redraw_profile())

    def choose_hazard(self, number: int) -> None:
        """Show a hazard that was tapped."""
        if self._picture is None:
            return
        item = next((h for h in self._picture.hazards if h.hazard_id == number), None)
        if item is None:
            return
        self._hazard.value = _name_hazard(item)
        self._detail.content = draw_hazard(item)
        span = f'{item.line_id}/{item.span_id}'
        if span in self._span.options:
            self._span.value = span
        self._redraw_profile()

    def update(self, picture: Picture, arrived: bool) -> None:
        """Show a picture."""
        self._picture = picture
        _set(self._bar, draw_bar(picture))
        _set(self._hazards, draw_hazards(picture))
        _set(self._spans, draw_spans(picture))
        _set(self._health, draw_health(picture))
        _offer(self._hazard, [_name_hazard(item) for item in picture.hazards])
        _offer(self._span, sorted(
            (f'{item.line_id}/{item.span_id}' for item in picture.spans),
            key=lambda text: tuple(map(int, text.split('/'))),
        ))
        _set(self._detail, draw_hazard(self._chosen_hazard()))
        span = self._chosen_span()
        drawn = span, picture.cloud_cells, picture.hazards
        if drawn != self._profile[0] and time.monotonic() - self._profile[1] > PROFILE_PERIOD:
            self._redraw_profile()
        self._fly(picture, arrived)

    def _chosen_hazard(self) -> HazardItem | None:
        chosen = self._hazard.value
        hazards = self._picture.hazards if self._picture else ()
        return next((item for item in hazards if _name_hazard(item) == chosen), None)

    def _chosen_span(self) -> SpanItem | None:
        chosen = self._span.value
        spans = self._picture.spans if self._picture else ()
        return next((item for item in spans if f'{item.line_id}/{item.span_id}' == chosen), None)

    def _redraw_profile(self) -> None:
        picture = self._picture
        if picture is None:
            return
        span = self._chosen_span()
        cells = None if span is None else self._cut_out(span)
        self._profile = (span, picture.cloud_cells, picture.hazards), time.monotonic()
        _set(self._side, draw_profile(span, picture.hazards, cells)
             if cells is not None else draw_profile(None, (), _NO_CELLS))

    def _go_to_hazard(self) -> None:
        item = self._chosen_hazard()
        _set(self._detail, draw_hazard(item))
        if item is None:
            return
        self._follow.value = False
        self._look(np.array(item.position), NEAR)

    def _fly(self, picture: Picture, arrived: bool) -> None:
        """Keep the vehicle in view, from where the browser looks at it."""
        if picture.vehicle is None:
            return
        place = np.array(picture.vehicle)
        if arrived or self._last is None:
            self._look(place, BEHIND)
        elif self._follow.value and np.abs(place - self._last).max() > 0.05:
            camera = self._client.camera
            self._look(place, camera.position - camera.look_at)
        self._last = place

    def _look(self, place: NDArray[np.float64], offset: NDArray[np.float64]) -> None:
        target = place - self._find_origin()
        with self._client.atomic():
            self._client.camera.position = target + self._lift + offset
            self._client.camera.look_at = target + self._lift


_NO_CELLS: CellArrays = (
    np.empty((0, 3), np.float32), np.empty(0, np.uint8), np.empty(0, np.float32),
    np.empty(0, np.float32),
)


def _name_hazard(item: HazardItem) -> str:
    return f'#{item.hazard_id} {item.kind}, line {item.line_id} span {item.span_id}'


def _set(handle: Any, content: str) -> None:
    """Send a text only where it changed."""
    if handle.content != content:
        handle.content = content


def _offer(handle: Any, names: list[str]) -> None:
    options = (NONE, *names)
    if tuple(handle.options) != options:
        chosen = handle.value
        handle.options = options
        if handle.value != chosen and chosen in options:
            handle.value = chosen
