# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
All readers of what comes from outside, as functions of bytes.

Each ends quietly or by PlcInspectError; any other error is a defect, and so is a scan that is
taken with other points than an independent decoder finds.  ``tools/fuzz.py`` runs them with
atheris, the tests with hypothesis and with the corpus in ``tools/corpus``.
"""

from collections.abc import Callable
import io
import math
from pathlib import Path
import struct
import tempfile
from typing import Any
from unittest.mock import patch

import numpy as np
from rosbags.typesys import get_typestore, Stores

from plc_inspect.config import HazardSettings
from plc_inspect.errors import DataError, PlcInspectError
from plc_inspect.flight_record.reader import read_flight
from plc_inspect.grid.cells import cut
from plc_inspect.grid.cells.sources import read_sources
from plc_inspect.messages.poses import pose_from_message
from plc_inspect.messages.scans import scan_from_message
from plc_inspect.monitor.picture.model import Monitor
from plc_inspect.offline.readers.bags import Recording
from plc_inspect.offline.readers.catalogue import load_rules
from plc_inspect.offline.readers.clouds import read_cloud
from plc_inspect.offline.readers.parameter_file import read_settings
from plc_inspect.offline.records.results_reader import (
    parse_hazard,
    parse_span,
    parse_units,
    read_run,
    read_table,
    understanding,
)

STORE = get_typestore(Stores.ROS2_JAZZY)
CODES = {1: 'b', 2: 'B', 3: 'h', 4: 'H', 5: 'i', 6: 'I', 7: 'f', 8: 'd'}
"""Data types of PointField, as ``struct`` names them."""
MOST_DECODED = 2000
"""Points that the slow decoder reads."""
PART, MOST_PARTS = 50, 4
"""Points of a part of an indexed cloud, and parts that are read."""


class WrongScanError(AssertionError):
    """A scan was taken with other points than it holds."""


def _in_file(name: str, read: Callable[[Path], object]) -> Callable[[bytes], None]:
    """Return a target that reads the bytes from a file of a name."""

    def run(data: bytes) -> None:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / name
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(data)
            read(path)

    return run


def _read_bag(path: Path) -> None:
    with Recording(path, 'velodyne_points', 'odometry') as recording:
        for _ in recording:
            pass


def _read_copc(path: Path) -> None:
    """Cut a cloud by its own index, as a grid does with one that is larger than memory."""
    sources, refusals = read_sources([path])
    if refusals:
        raise DataError(refusals[0].error)
    with patch.object(cut, 'PART', PART):
        for part in range(min(cut.count_parts(sources[0]), MOST_PARTS)):
            for _ in cut.read_part(sources[0], part):
                pass


def _read_record(path: Path) -> None:
    read_flight(path.parent)


def _read_results(path: Path) -> None:
    name = path.stem
    if name == 'run':
        read_run(path.parent)
        return
    table = read_table(path.parent, name)
    with understanding(path):
        units = parse_units(table['metres_per_unit'])
        for row in table[name]:
            (parse_span if name == 'spans' else parse_hazard)(row, units)


def _read_rules(path: Path) -> None:
    load_rules(HazardSettings(rules=str(path)))


def read_scan(data: bytes) -> None:
    """Take a PointCloud2 of CDR, and compare its points with those of another decoder."""
    try:
        message = STORE.deserialize_cdr(data, 'sensor_msgs/msg/PointCloud2')
    except Exception as error:  # of rosbags, which the reader of bags counts
        raise DataError(str(error)) from error
    scan = scan_from_message(message)
    if message.width * message.height <= MOST_DECODED:
        expected = _decode(message)
        if not np.array_equal(np.array(expected, np.float32).reshape(-1, 3), scan.xyz):
            raise WrongScanError(f'{len(expected)} points are there, {len(scan.xyz)} were taken')


def _decode(message: Any) -> list[list[float]]:
    """Return the finite points of a message, point after point."""
    order = '>' if message.is_bigendian else '<'
    places = {item.name: item for item in message.fields}
    data, points = bytes(message.data), []
    for row in range(message.height if message.width else 0):
        for column in range(message.width):
            at = row * message.row_step + column * message.point_step
            values = []
            for axis in 'xyz':
                item = places[axis]
                (value,) = struct.unpack_from(
                    order + CODES[item.datatype], data, at + item.offset
                )
                with np.errstate(over='ignore'):
                    values.append(float(np.float32(value)))
            if all(math.isfinite(value) for value in values):
                points.append(values)
    return points


def read_pose(data: bytes) -> None:
    """Take an Odometry of CDR."""
    try:
        message = STORE.deserialize_cdr(data, 'nav_msgs/msg/Odometry')
    except Exception as error:
        raise DataError(str(error)) from error
    pose_from_message(message)


def read_stream(data: bytes) -> None:
    """Take messages of the thin link, each with two bytes of length in front, and draw them."""
    monitor, stream = Monitor(), io.BytesIO(data)
    now = 1.0
    while len(head := stream.read(2)) == 2:
        part = stream.read(int.from_bytes(head, 'little'))
        now += 0.5
        monitor.take_summary(part, now)
        monitor.take_cloud(part, now)
        picture = monitor.look(now)
        for span in picture.spans:
            span.trace()


TARGETS: dict[str, Callable[[bytes], None]] = {
    'scan': read_scan,
    'pose': read_pose,
    'stream': read_stream,
    'pcd': _in_file('cloud.pcd', read_cloud),
    'las': _in_file('cloud.las', read_cloud),
    'laz': _in_file('cloud.laz', read_cloud),
    'e57': _in_file('cloud.e57', read_cloud),
    'ply': _in_file('cloud.ply', read_cloud),
    'xyz': _in_file('cloud.xyz', read_cloud),
    'csv': _in_file('cloud.csv', read_cloud),
    'copc': _in_file('cloud.copc.laz', _read_copc),
    'mcap': _in_file('flight.mcap', _read_bag),
    'record': _in_file('out.record/000001.mcap', _read_record),
    'settings': _in_file('settings.yaml', lambda path: read_settings(path)),
    'rules': _in_file('rules.yaml', _read_rules),
    'spans': _in_file('spans.json', _read_results),
    'hazards': _in_file('hazards.json', _read_results),
    'run': _in_file('run.json', _read_results),
}
"""Name to function; the corpus of each is in a folder of its name."""


def run_target(name: str, data: bytes) -> str:
    """Run a target, and return the text of the refusal, '' where the bytes were taken."""
    try:
        TARGETS[name](data)
    except PlcInspectError as error:
        return str(error) or type(error).__name__
    return ''
