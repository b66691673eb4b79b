# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The 3D picture of the page: corridor, catenaries, supports, hazards, vehicle and its track."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plc_inspect.colors import parse_color, severity_color
from plc_inspect.monitor.picture.cloud_store import CloudStore
from plc_inspect.monitor.picture.picture import HazardItem, name_severity, Picture, SpanItem
from plc_inspect.results import Float32, PointClass, UInt8
from plc_inspect.stream.blocks import BlockKey

NEAR, FAR = 2.0, 15.0
"""Clearances of the two ends of the colours [m]."""
_RAMP = np.array([
    [178, 24, 43], [239, 138, 98], [253, 219, 130], [166, 217, 106], [90, 160, 150],
    [120, 130, 150],
], dtype=np.float64)
_STRUCTURE = (150, 155, 165)

Chosen = Callable[[int, int], object]
"""Gets the browser's number and the hazard's."""


def color_cells(kind: UInt8, clearance: Float32) -> UInt8:
    """
    Return the colours of cells: red near a conductor, grey far from it.

    Parameters
    ----------
    kind : UInt8
        (M,) PointClass.
    clearance : Float32
        (M,) [m], NaN unknown.

    Returns
    -------
    UInt8
        (M, 3) red, green, blue.

    """
    share = np.clip((np.nan_to_num(clearance, nan=FAR) - NEAR) / (FAR - NEAR), 0.0, 1.0)
    place = share * (len(_RAMP) - 1)
    colors = np.column_stack([
        np.interp(place, np.arange(len(_RAMP)), _RAMP[:, channel]) for channel in range(3)
    ])
    colors[kind == PointClass.GROUND] *= 0.8
    colors[kind == PointClass.TOWER] = _STRUCTURE
    return np.asarray(np.rint(colors), dtype=np.uint8).reshape(-1, 3)


class Scene:
    """
    What all browsers see.

    Parameters
    ----------
    server : viser.ViserServer
        Running.
    choose : callable
        Called when somebody taps a hazard.

    """

    def __init__(self, server: Any, choose: Chosen) -> None:
        self._server = server
        self._choose = choose
        self._origin: NDArray[np.float64] | None = None
        self._corridor: dict[BlockKey, Any] = {}
        self._hazards: dict[int, tuple[HazardItem, list[Any]]] = {}
        self._drawn: dict[str, tuple[object, Any]] = {}
        server.scene.set_up_direction('+z')
        server.scene.configure_default_lights(cast_shadow=False)

    @property
    def origin(self) -> NDArray[np.float64]:
        """What is subtracted from all places, so that float32 is enough [m]."""
        return np.zeros(3) if self._origin is None else self._origin

    def update(self, picture: Picture, cloud: CloudStore) -> bool:
        """Draw what changed; return whether this is the first time that there is anything."""
        first = self._find_origin(picture)
        if self._origin is None:
            return False
        with self._server.atomic():
            for home in cloud.take_changed():
                self._draw_cells(home, cloud)
            self._draw_once('spans', picture.spans, self._draw_spans)
            self._draw_once('supports', picture.supports, self._draw_supports)
            self._draw_hazards(picture.hazards)
            self._draw_once('vehicle', picture.vehicle, self._draw_vehicle)
            self._draw_once('track', picture.track, self._draw_track)
        return first

    def _find_origin(self, picture: Picture) -> bool:
        if self._origin is not None:
            return False
        if picture.vehicle is None and not picture.spans:
            return False
        place = picture.vehicle or picture.spans[0].start
        self._origin = np.round(np.array(place) / 10.0) * 10.0
        return True

    def _draw_once(self, name: str, what: Any, draw: Callable[[Any], Any]) -> None:
        """Draw something anew where it is not what was drawn before."""
        old = self._drawn.get(name)
        if old is not None and old[0] == what:
            return
        handle = draw(what)
        if handle is None and old is not None and old[1] is not None:
            old[1].remove()
        self._drawn[name] = what, handle

    def _draw_cells(self, home: BlockKey, cloud: CloudStore) -> None:
        points, kind, clearance, size = cloud.assemble(home)
        # The catenaries stand for the wires, which would hide them.
        shown = kind != PointClass.WIRE
        points, kind, clearance, size = points[shown], kind[shown], clearance[shown], size[shown]
        if not len(points):
            handle = self._corridor.pop(home, None)
            if handle is not None:
                handle.remove()
            return
        middle = points.mean(axis=0).astype(np.float64)
        self._corridor[home] = self._server.scene.add_point_cloud(
            f'/corridor/{home[0]}_{home[1]}', (points - middle).astype(np.float32),
            color_cells(kind, clearance), point_size=float(size.min()) * 0.5,
            point_shape='circle', precision='float16', point_shading='flat',
            position=tuple(middle - self.origin),
        )

    def _draw_spans(self, spans: tuple[SpanItem, ...]) -> Any:
        segments, colors = [], []
        for span in spans:
            curve = span.trace() - self.origin
            pieces = np.stack((curve[:-1], curve[1:]), axis=1)
            segments.append(pieces)
            color = parse_color(severity_color(name_severity(span.severity)))
            colors.append(np.broadcast_to(np.array(color, np.uint8), pieces.shape))
        if not segments:
            return None
        return self._server.scene.add_line_segments(
            '/spans', np.concatenate(segments).astype(np.float32), np.concatenate(colors),
            thickness=4.0, thickness_units='screen',
        )

    def _draw_supports(self, supports: tuple[Any, ...]) -> Any:
        if not supports:
            return None
        feet = np.array([item.position for item in supports]) - self.origin
        tops = feet + np.array([[0.0, 0.0, item.height] for item in supports])
        return self._server.scene.add_line_segments(
            '/supports', np.stack((feet, tops), axis=1).astype(np.float32), (110, 118, 130),
            thickness=7.0, thickness_units='screen',
        )

    def _draw_hazards(self, hazards: tuple[HazardItem, ...]) -> None:
        now = {item.hazard_id: item for item in hazards}
        for number in set(self._hazards) - set(now):
            for handle in self._hazards.pop(number)[1]:
                handle.remove()
        for number, item in now.items():
            old = self._hazards.get(number)
            if old is not None and old[0] == item:
                continue
            place = tuple(np.array(item.position) - self.origin)
            ball = self._server.scene.add_icosphere(
                f'/hazards/{number}', radius=1.0, subdivisions=2,
                color=parse_color(severity_color(item.severity_name)), opacity=0.75,
                position=place, cast_shadow=False, receive_shadow=False,
            )

            @ball.on_click
            def _(event: Any, number: int = number) -> None:
                self._choose(event.client_id, number)

            label = self._server.scene.add_label(
                f'/hazard_texts/{number}', f'{item.kind} {item.clearance:.2f} m',
                position=(place[0], place[1], place[2] + 1.4), anchor='bottom-center',
            )
            self._hazards[number] = item, [ball, label]

    def _draw_vehicle(self, vehicle: Any) -> Any:
        if vehicle is None:
            return None
        return self._server.scene.add_icosphere(
            '/vehicle', radius=0.8, color=(25, 118, 210), subdivisions=2,
            position=tuple(np.array(vehicle) - self.origin), cast_shadow=False,
            receive_shadow=False,
        )

    def _draw_track(self, track: tuple[Any, ...]) -> Any:
        if len(track) < 2:
            return None
        places = (np.array(track) - self.origin).astype(np.float32)
        return self._server.scene.add_line_segments(
            '/track', np.stack((places[:-1], places[1:]), axis=1), (25, 118, 210),
            thickness=2.0, thickness_units='screen',
        )
