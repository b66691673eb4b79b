# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Records what the monitor saw as an MCAP file for Foxglove, RViz and replays.

The file holds the raw stream and, on the topics of the node, its content: tables, markers, the
corridor about the vehicle and diagnostics.
"""

from contextlib import suppress
import copy
from datetime import datetime, UTC
import json
from pathlib import Path
import time
from types import TracebackType
from typing import Any

import numpy as np

from plc_inspect.mcap_file import McapFile
from plc_inspect.messages.markers import list_marks
from plc_inspect.messages.rows import make_catenaries, make_corridor, make_hazards
from plc_inspect.messages.typestore import MessageMaker
from plc_inspect.monitor.picture.alarms import Alarm
from plc_inspect.monitor.picture.cloud_store import CloudStore
from plc_inspect.monitor.picture.picture import Link, Picture
from plc_inspect.stream.summary import HEALTH, STATUSES

FLUSH_PERIOD = 0.8
"""Period of flushing to the file [s]."""
CORRIDOR_PERIOD = 5.0
"""Period of messages of the corridor [s]."""
REACH = 150.0
"""Cells within this distance of the vehicle are in them [m]."""
_KINDS = {
    'summary': 'std_msgs/msg/UInt8MultiArray', 'thin_corridor': 'std_msgs/msg/UInt8MultiArray',
    'catenaries': 'sensor_msgs/msg/PointCloud2', 'hazards': 'sensor_msgs/msg/PointCloud2',
    'corridor': 'sensor_msgs/msg/PointCloud2', 'markers': 'visualization_msgs/msg/MarkerArray',
    'vehicle': 'geometry_msgs/msg/PoseStamped',
    'acknowledged': 'std_msgs/msg/String',
    '/diagnostics': 'diagnostic_msgs/msg/DiagnosticArray',
}


class Recorder:
    """
    Records the monitor of one vehicle; several may share a file.

    Parameters
    ----------
    path : Path
        MCAP file to write.
    node_name : str
        Name of the node with its namespace.
    force : bool
        Replace a file that is there.

    Raises
    ------
    ConfigError
        There is a file already, or it cannot be written.

    """

    def __init__(self, path: Path, node_name: str, *, force: bool = False) -> None:
        self._file = McapFile(path, force=force)
        self._name = node_name.rstrip('/')
        self._maker = MessageMaker()
        self._flushed = time.monotonic()
        # a clock of the ground that is set back meanwhile must not mix up the order of messages
        self._origin = time.time_ns() - time.monotonic_ns()
        self._corridor_at = -CORRIDOR_PERIOD
        self._seen: tuple[object, ...] = ()
        self._cells = -1
        self._faults: list[OSError] = []
        """Why the file ended before its time; shared by all that write to it."""

    def beside(self, node_name: str) -> 'Recorder':
        """Return a recorder of another node for the same file."""
        other = copy.copy(self)
        other._name, other._seen, other._cells = node_name.rstrip('/'), (), -1
        return other

    def __enter__(self) -> 'Recorder':
        """Return the recorder."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End the file in order."""
        self._file.close()

    def take(self, topic: str, data: bytes) -> None:
        """Record a message of the stream, 'summary' or 'cloud', as it came in."""
        self._write('summary' if topic == 'summary' else 'thin_corridor',
                    self._maker.bytes_array(data))
        self.flush()

    def show(self, picture: Picture, cloud: CloudStore) -> None:
        """Record the parts of the picture that changed."""
        if picture.link in (Link.LIVE, Link.LATE):
            self._write_picture(picture)
            now = time.monotonic()
            if now - self._corridor_at >= CORRIDOR_PERIOD and picture.cloud_cells != self._cells:
                self._corridor_at, self._cells = now, picture.cloud_cells
                self._write('corridor', self._make_corridor(picture, cloud))
        self.flush()

    def note(self, alarm: Alarm) -> None:
        """Record an acknowledgement as JSON: alarm, name, and time of day."""
        text = json.dumps({
            'alarm': alarm.number, 'what': alarm.key, 'text': alarm.cause.text, 'who': alarm.who,
            'time': datetime.now(UTC).isoformat(timespec='milliseconds'),
            'after': round(alarm.acknowledged - alarm.raised, 3), 'stands': alarm.stands,
        })
        self._write('acknowledged', self._maker.make('std_msgs/msg/String', data=text))
        self._flushed = time.monotonic()
        self._file.flush()

    def flush(self) -> None:
        """Flush the file if FLUSH_PERIOD has passed."""
        now = time.monotonic()
        if now - self._flushed >= FLUSH_PERIOD:
            self._flushed = now
            self._file.flush()

    def abandon(self, error: OSError) -> None:
        """End the file with what was written, as it cannot be written any more."""
        self._faults.append(error)
        with suppress(OSError):
            self._file.abandon()

    def _write_picture(self, picture: Picture) -> None:
        maker = self._maker
        header = maker.header(picture.stamp_ns, picture.frame_id)
        seen = picture.stamp_ns, picture.spans, picture.supports, picture.hazards
        if seen != self._seen:
            self._seen = seen
            self._write('catenaries', maker.cloud(header, make_catenaries(picture.spans)))
            self._write('hazards', maker.cloud(header, make_hazards(picture.hazards)))
            self._write('markers', self._make_markers(header, picture))
        if picture.vehicle is not None:
            self._write('vehicle', maker.make(
                'geometry_msgs/msg/PoseStamped', header=header, pose=maker.pose(picture.vehicle)
            ))
        if picture.health:
            self._write('/diagnostics', self._make_diagnostics(header, picture))

    def _write(self, topic: str, message: Any) -> None:
        if self._faults:
            raise self._faults[0]
        kind = _KINDS[topic]
        name = topic if topic.startswith('/') else f'{self._name}/{topic}'
        channel = self._file.add_channel(name, kind, self._maker.define(kind))
        now = self._origin + time.monotonic_ns()
        self._file.write(channel, now, self._maker.serialize(message, kind))

    def _make_corridor(self, picture: Picture, cloud: CloudStore) -> Any:
        if picture.vehicle is None:
            points, kind, clearance, _ = cloud.assemble_all()
        else:
            x, y, _ = picture.vehicle
            points, kind, clearance, _ = cloud.assemble_near((x - REACH, y - REACH),
                                                             (x + REACH, y + REACH))
            near = np.hypot(points[:, 0] - x, points[:, 1] - y) <= REACH
            points, kind, clearance = points[near], kind[near], clearance[near]
        rows = make_corridor(
            points, classification=kind, clearance=clearance, line_id=-1, span_id=-1
        )
        return self._maker.cloud(
            self._maker.header(picture.stamp_ns, picture.frame_id), rows
        )

    def _make_markers(self, header: Any, picture: Picture) -> Any:
        markers = [self._maker.deletion(header)]
        for mark in list_marks(picture.spans, picture.supports, picture.hazards):
            markers.append(self._maker.marker(header, mark))
        return self._maker.make('visualization_msgs/msg/MarkerArray', markers=markers)

    def _make_diagnostics(self, header: Any, picture: Picture) -> Any:
        make = self._maker.make
        status = [
            make(
                'diagnostic_msgs/msg/DiagnosticStatus', level=level, name=f'plc_inspect: {name}',
                message=text, hardware_id='plc_inspect',
                values=[
                    make('diagnostic_msgs/msg/KeyValue', key=key, value=f'{value:g}')
                    for (owner, key), value in zip(
                        HEALTH.values(), picture.health.values(), strict=True
                    ) if owner == name
                ],
            )
            for name, level, text in zip(STATUSES, picture.levels, picture.texts, strict=True)
        ]
        return make('diagnostic_msgs/msg/DiagnosticArray', header=header, status=status)
