# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Sends objects to another process, and those that both keep once."""

from collections.abc import Callable, Iterable
import io
from multiprocessing.connection import Connection
import pickle
from typing import Any

import numpy as np

from plc_inspect.results import UInt8

LEAST_APART = 65_536
"""Arrays from so many bytes on are not copied into the message.  Source: numerical."""


class Exchange:
    """
    One end of a pipe between two processes of this program.

    What is of a shared class is immutable, has a number, and crosses once: later messages name
    its number, and each end finds the very object that it had before.  So do the arrays in it.
    Objects that a message with ``forget`` does not lead to are dropped at both ends.

    Parameters
    ----------
    connection : Connection
        To the other end.
    shared : iterable of type
        The shared classes; none of them contains another one.
    first : bool
        True at one end, False at the other: each gives numbers of its own.

    """

    def __init__(self, connection: Connection, shared: Iterable[type], *, first: bool) -> None:
        self._connection = connection
        self._shared = frozenset(shared)
        self._next = int(first)
        self._objects: dict[int, Any] = {}
        self._numbers: dict[int, int] = {}
        """Of an object's id, which is its own as long as it is held here."""
        self._parts: dict[int, set[int]] = {}
        """Numbers of the arrays in an object."""

    def __len__(self) -> int:
        """Return the number of objects that both ends hold."""
        return len(self._objects)

    def send(self, *values: Any, forget: bool = False) -> None:
        """
        Send some values, each to be read on its own.

        Raises
        ------
        OSError
            The other process has ended.

        """
        fresh: list[int] = []
        named: set[int] = set()

        def name(item: Any) -> int:
            number = self._numbers.get(id(item))
            if number is None:
                number, self._next = self._next, self._next + 2
                self._hold(number, item)
                fresh.append(number)
            return number

        def name_shared(item: Any) -> int | None:
            if type(item) not in self._shared and id(item) not in self._numbers:
                return None
            named.add(number := name(item))
            return number

        frames = [_pack(value, name_shared) for value in values]
        parts: dict[int, set[int]] = {}
        for number in fresh:  # grows by the arrays in those before
            own = parts[number] = set[int]()
            frames.append(_pack_arrays_apart(self._objects[number], name, own))
        self._parts |= parts
        dropped = self._drop_others(named) if forget else []
        large = [part for frame in frames for part in frame if part.nbytes >= LEAST_APART]
        told = [
            [part.nbytes if part.nbytes >= LEAST_APART else bytes(part) for part in frame]
            for frame in frames
        ]
        self._connection.send_bytes(pickle.dumps((len(values), parts, dropped, told), 5))
        for part in large:
            self._connection.send_bytes(part)

    def receive(self) -> tuple[Any, ...]:
        """
        Return the values that the other end sends next, once they are there.

        Raises
        ------
        EOFError
            The other process has ended.

        """
        count, parts, dropped, told = pickle.loads(self._connection.recv_bytes())
        frames = [
            (
                self._connection.recv_bytes() if isinstance(first, int) else first,
                [self._take(part) if isinstance(part, int) else part for part in apart],
            ) for first, *apart in told
        ]
        for number, frame in zip(reversed(parts), reversed(frames[count:]), strict=True):
            self._hold(number, self._unpack(*frame))  # arrays come before what they are in
        self._parts |= parts
        values = tuple(self._unpack(*frame) for frame in frames[:count])
        self._drop(dropped)
        return values

    def _take(self, size: int) -> UInt8:
        room = np.empty(size, dtype=np.uint8)
        self._connection.recv_bytes_into(room.data)
        return room

    def _unpack(self, content: bytes, apart: list[UInt8 | bytes]) -> Any:
        return _Unpickler(content, apart, self._objects).load()

    def _hold(self, number: int, item: Any) -> None:
        self._objects[number], self._numbers[id(item)] = item, number

    def _drop_others(self, named: set[int]) -> list[int]:
        stays = named.union(*(self._parts[number] for number in named))
        dropped = list(self._objects.keys() - stays)
        self._drop(dropped)
        return dropped

    def _drop(self, numbers: Iterable[int]) -> None:
        for number in numbers:
            del self._parts[number]
            del self._numbers[id(self._objects.pop(number))]


class _Pickler(pickle.Pickler):
    """Names what is sent apart."""

    def __init__(
        self, file: io.BytesIO, name: Callable[[Any], int | None], apart: list[memoryview]
    ) -> None:
        super().__init__(file, 5, buffer_callback=lambda buffer: _put_apart(buffer, apart))
        self._name = name

    def persistent_id(self, obj: Any) -> int | None:
        return self._name(obj)


class _Unpickler(pickle.Unpickler):
    """Finds what was sent apart."""

    def __init__(
        self, content: bytes, apart: list[UInt8 | bytes], objects: dict[int, Any]
    ) -> None:
        super().__init__(io.BytesIO(content), buffers=apart)
        self._objects = objects

    def persistent_load(self, pid: int) -> Any:
        return self._objects[pid]


def _put_apart(buffer: pickle.PickleBuffer, apart: list[memoryview]) -> bool:
    """Put a large buffer into a list, and return whether it is small and stays where it is."""
    content = buffer.raw()
    small = content.nbytes < LEAST_APART
    if not small:
        apart.append(content)
    return small


def _pack(value: Any, name: Callable[[Any], int | None]) -> list[memoryview]:
    file, apart = io.BytesIO(), list[memoryview]()
    _Pickler(file, name, apart).dump(value)
    return [file.getbuffer(), *apart]


def _pack_arrays_apart(
    item: Any, name: Callable[[Any], int], names: set[int]
) -> list[memoryview]:
    """Pack an object but for the arrays in it, whose names are added to some."""
    def name_part(part: Any) -> int | None:
        if not isinstance(part, np.ndarray) or part is item:
            return None
        names.add(number := name(part))
        return number

    return _pack(item, name_part)
