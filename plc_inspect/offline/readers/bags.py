# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Reads recordings of flights: rosbag2 (MCAP, sqlite3) and ROS 1 bags, by rosbags."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
import re
from types import TracebackType
from typing import Any, Literal, Self

from rosbags.highlevel import AnyReader
from rosbags.typesys import get_typestore, Stores

from plc_inspect.config import InputSettings
from plc_inspect.core.setup.moving_frames import MovingFrames
from plc_inspect.core.setup.transforms import FrameTree, StampedTransform
from plc_inspect.errors import DataError
from plc_inspect.messages.poses import (
    AUTO,
    pose_from_message,
    POSE_TYPES,
    poses_from_transforms,
    StampedPose,
    STATIC_TOPIC,
    TF,
    TF_TOPIC,
    TF_TYPES,
    transforms_from_message,
)
from plc_inspect.messages.scans import scan_from_message, SCAN_TYPE, ScanArrays
from plc_inspect.printable import make_one_line

MessageKind = Literal['scan', 'odometry']
_SUFFIXES = ('.mcap', '.db3', '.bag')
_PART = re.compile(r'(.*?)(?:_?\d{4}(?:-\d\d){5})?_(\d+)')  # ROS 1 dates each part


@dataclass(frozen=True, slots=True, eq=False)
class RecordedMessage:
    """One message of a recording, converted."""

    log_stamp_ns: int
    """When it was recorded [ns]."""
    content: ScanArrays | StampedPose


@dataclass(frozen=True, slots=True, eq=False)
class RawMessage:
    """One message of a recording, serialised as by ROS 2."""

    log_stamp_ns: int
    """When it was recorded [ns]."""
    topic: str
    """With the leading slash."""
    raw: bytes


class Recording:
    """
    The scans and poses of one recording, in order of recording.

    A context manager; iterating yields ``RecordedMessage`` and may be repeated.

    Parameters
    ----------
    path : Path
        A rosbag2 folder, a lone ``.mcap`` or ``.db3`` file, or a ROS 1 ``.bag``.
    scan_topic, odometry_topic : str
        Topic names, with or without a leading slash.
    source : InputSettings or None
        ``odometry_type``, ``map_frame`` and ``base_frame`` are used; None: the defaults.  If the
        type is 'auto' and the topic of poses is missing, poses come from /tf.

    Raises
    ------
    DataError
        On entering or iterating: the recording is missing, damaged or of an unknown kind, or
        does not hold the topics with the right types.

    """

    def __init__(
        self, path: Path | str, scan_topic: str, odometry_topic: str,
        source: InputSettings | None = None,
    ) -> None:
        self.path = Path(path)
        self._scans, self._poses = _absolute(scan_topic), _absolute(odometry_topic)
        self._pose_name = odometry_topic
        self._source = source or InputSettings()
        if self._scans == self._poses:
            raise DataError(f'scans and odometry cannot share the topic {scan_topic!r}')
        self._moving: MovingFrames | None = None
        self._fixed: list[StampedTransform] = []
        self._not_fixed: list[Exception] = []
        self.pose_type = ''
        """Message type of the poses, known once the recording is open."""
        self._reader: AnyReader | None = None
        self._connections: list[Any] = []
        self._num_read = 0
        self.skipped: Counter[str] = Counter()
        """Messages that could not be read: reason to count."""
        self.first_errors: dict[str, str] = {}
        """Reason to the text of its first error."""
        self.malformed: dict[str, str] = {}
        """'scan' or 'odometry' to the text of the first error of its messages."""

    def __enter__(self) -> Self:
        """Open the recording and find the topics."""
        source = _find_source(self.path)
        self._num_read = 0
        try:
            store = get_typestore(Stores.ROS2_JAZZY)
            reader = AnyReader([source], default_typestore=store)
            reader.open()
        except Exception as error:  # rosbags passes errors of struct, zstd, sqlite and others on
            text = _in_one_line(error)
            if isinstance(error, KeyError) and isinstance(error.args[0], str):
                text = f'a channel has a schema in {text}, not of ROS; leave it out (mcap filter)'
            raise DataError(f'{self.path} cannot be read: {text}') from error
        self._reader = reader
        try:
            self._connections = self._find_connections()
            self._fixed = self._read_fixed()
        except DataError:
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the recording."""
        reader, self._reader = self._reader, None
        if reader is not None:
            reader.close()

    @property
    def topics(self) -> dict[str, str]:
        """Every topic of the recording and its type."""
        return {
            name: info.msgtype or 'several types'
            for name, info in sorted(self._open_reader().topics.items())
        }

    @property
    def pose_name(self) -> str:
        """Topic of the poses as given, which may be relative."""
        return TF_TOPIC if self.pose_type in TF_TYPES else self._pose_name

    @property
    def fixed_transforms(self) -> list[StampedTransform]:
        """Transforms of /tf_static, whenever recorded."""
        return self._fixed

    @property
    def problem(self) -> str:
        """Why /tf has given no poses so far, '' if it has or is not used."""
        return self._moving.explain() if self._moving is not None else ''

    @property
    def num_messages(self) -> int:
        """Number of scans and poses in the recording."""
        return sum(connection.msgcount for connection in self._connections)

    @property
    def duration(self) -> float:
        """Time from the first to the last message of any topic [s]."""
        return max(0, self._open_reader().duration) * 1e-9

    @property
    def progress(self) -> float:
        """Share of the scans and poses read, 0 to 1."""
        total = self.num_messages
        return min(1.0, self._num_read / total) if total else 1.0

    def __iter__(self) -> Iterator[RecordedMessage]:
        """
        Yield the scans and poses, converted, in the order of recording.

        A message that cannot be read is skipped and counted in ``skipped``, which starts anew
        with every pass.

        Raises
        ------
        DataError
            The file is damaged.

        """
        reader = self._open_reader()
        self.skipped.clear()
        self.first_errors.clear()
        self.malformed.clear()
        for error in self._not_fixed:
            self._count(f'{STATIC_TOPIC}: malformed', error)
        self._moving = self._follow_frames()
        for connection, stamp, raw in self._read(reader):
            for content in self._convert(reader, connection, raw):
                yield RecordedMessage(stamp, content)

    def raw_messages(self) -> Iterator[RawMessage]:
        """
        Yield the scans and poses as bytes, in the order of recording.

        Raises
        ------
        DataError
            The file is damaged.

        """
        reader = self._open_reader()
        store = get_typestore(Stores.ROS2_JAZZY)
        for connection, stamp, raw in self._read(reader):
            if not reader.is2:  # headers of ROS 1 have one more field
                kind = connection.msgtype
                new = TF_TYPES[0] if kind in TF_TYPES else kind
                raw = bytes(store.serialize_cdr(reader.deserialize(raw, kind), new))
            yield RawMessage(stamp, _absolute(connection.topic), bytes(raw))

    def _read(self, reader: AnyReader) -> Iterator[tuple[Any, int, bytes]]:
        self._num_read = 0
        messages = iter(reader.messages(self._connections))
        while True:
            try:
                item = next(messages)
            except StopIteration:
                return
            except Exception as error:  # as in __enter__
                raise DataError(
                    f'{self.path} is damaged after {self._num_read} of {self.num_messages} '
                    f'messages: {_in_one_line(error)}'
                ) from error
            self._num_read += 1
            yield item

    def _open_reader(self) -> AnyReader:
        if self._reader is None:
            raise DataError(f'{self.path} is not open')
        return self._reader

    def _find_connections(self) -> list[Any]:
        scans = self._find(self._scans, (SCAN_TYPE,))
        wanted = self._source.odometry_type
        there = {_absolute(c.topic): c.msgtype for c in self._open_reader().connections}
        from_tf = wanted == TF or (
            wanted == AUTO and self._poses not in there and there.get(TF_TOPIC) in TF_TYPES
        )
        if from_tf:
            poses = self._find(TF_TOPIC, TF_TYPES)
        else:
            kinds = tuple(POSE_TYPES.values()) if wanted == AUTO else (POSE_TYPES[wanted],)
            poses = self._find(self._poses, kinds)
        self.pose_type = poses[0].msgtype
        return scans + poses

    def _find(self, topic: str, kinds: tuple[str, ...]) -> list[Any]:
        """Return the connections of a topic that have the first of some types that occurs."""
        matching = [c for c in self._open_reader().connections if _absolute(c.topic) == topic]
        for kind in kinds:
            if good := [c for c in matching if c.msgtype == kind]:
                return good
        problem = f'has no {topic}'
        if matching:
            problem = f'has {topic} as {matching[0].msgtype}'
        there = ', '.join(f'{name} ({type_})' for name, type_ in self.topics.items())
        raise DataError(
            f'{self.path} {problem}, wanted {" or ".join(kinds)}; its topics: {there or "none"}'
        )

    def _follow_frames(self) -> MovingFrames | None:
        if self.pose_type not in TF_TYPES:
            return None
        tree = FrameTree()
        for item in self._fixed:
            tree.add(item)
        return MovingFrames(tree, self._source.map_frame, self._source.base_frame)

    def _read_fixed(self) -> list[StampedTransform]:
        reader = self._open_reader()
        fixed = [c for c in reader.connections if _absolute(c.topic) == STATIC_TOPIC]
        matching = [c for c in fixed if c.msgtype in TF_TYPES]
        found: list[StampedTransform] = []
        self._not_fixed = []
        tree = FrameTree()
        try:
            messages = list(reader.messages(matching)) if matching else []
        except Exception as error:  # as in __enter__
            raise DataError(
                f'{self.path}: {STATIC_TOPIC} cannot be read: {_in_one_line(error)}'
            ) from error
        for connection, _, raw in messages:
            try:
                message = reader.deserialize(raw, connection.msgtype)
                items = transforms_from_message(message)
            except Exception as error:  # as in _convert
                self._not_fixed.append(error)
                continue
            for item in items:
                try:
                    tree.add(item)
                except DataError as error:
                    self._not_fixed.append(error)
                else:
                    found.append(item)
        return found

    def _convert(
        self, reader: AnyReader, connection: Any, raw: bytes
    ) -> list[ScanArrays | StampedPose]:
        kind: MessageKind = 'scan' if connection.msgtype == SCAN_TYPE else 'odometry'
        try:
            message = reader.deserialize(raw, connection.msgtype)
        except Exception as error:  # damaged bytes raise struct, index, unicode and other errors
            self.skip(kind, f'{connection.topic}: not decodable', error)
            return []
        found: list[ScanArrays | StampedPose] = []
        try:
            if kind == 'scan':
                found.append(scan_from_message(message))
            elif self._moving is None:
                found.append(pose_from_message(message))
            else:  # those before an error stay
                found.extend(poses_from_transforms(message, self._moving, self._source))
        except DataError as error:
            self.skip(kind, f'{connection.topic}: malformed', error)
        return found

    def skip(self, kind: MessageKind, reason: str, error: BaseException) -> None:
        """Count a message that cannot be used; keep the first error of its reason and kind."""
        self.malformed.setdefault(kind, self._count(reason, error))

    def _count(self, reason: str, error: BaseException) -> str:
        self.skipped[reason] += 1
        text = _in_one_line(error)
        self.first_errors.setdefault(reason, text)
        return text


def _absolute(topic: str) -> str:
    return '/' + topic.strip('/')


def _in_one_line(error: BaseException) -> str:
    return make_one_line(error) or type(error).__name__


def find_recordings(path: Path) -> list[Path]:
    """
    Return the recordings in a folder at any depth, by name, or the folder if it is one itself.

    Files are recordings by their suffix; folders within that hold results are passed over.
    Raises DataError for split files without metadata.
    """
    if not path.is_dir():
        return [path] if path.suffix in _SUFFIXES else []
    files = sorted(file for file in path.iterdir() if file.suffix in _SUFFIXES and file.is_file())
    if (path / 'metadata.yaml').exists():
        return [path]
    parts = [_PART.fullmatch(file.stem) for file in files]
    names = {part[1] for part in parts if part}
    if all(parts) and len(names) == 1 and len({part[2] for part in parts if part}) > 1:
        how = 'rosbags-convert --src *.bag' if files[0].suffix == '.bag' else 'ros2 bag reindex'
        raise DataError(
            f'{path} has no metadata.yaml and {len(files)} files {names.pop()}_N: parts of one'
            f' recording? Then run {how}, otherwise name the files'
        )
    folders = sorted(item for item in path.iterdir() if item.is_dir())
    inner = [
        own for item in folders if not (item / 'run.json').is_file()
        for own in find_recordings(item)
    ]
    return [path] if len(files) == 1 and not inner else files + inner


def _find_source(path: Path) -> Path:
    """Return what rosbags must open: the path, or the only bag file of a bare folder."""
    if not path.exists():
        raise DataError(f'{path} does not exist')
    if path.is_file():
        if path.suffix not in _SUFFIXES:
            raise DataError(f'{path} is not a recording: its name must end in .mcap, .db3 or .bag')
        if path.stat().st_size == 0:
            raise DataError(f'{path} is empty')
        return path
    if not path.is_dir():
        raise DataError(f'{path} is neither a folder nor a regular file')
    if (path / 'metadata.yaml').exists():
        return path
    files = sorted(file for file in path.iterdir() if file.suffix in _SUFFIXES)
    if len(files) != 1:
        raise DataError(
            f'{path} is not a recording: it has no metadata.yaml and {len(files)} bag files'
        )
    return files[0]
