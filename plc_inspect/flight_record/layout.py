# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
The layout of a flight record; see docs/record.md.

A record is a folder of segments, which are MCAP files read one after the other.  The messages of
one chunk belong together.
"""

from dataclasses import dataclass
import io
import json
from pathlib import Path
from typing import Any
import zipfile

import numpy as np
from numpy.typing import NDArray

from plc_inspect.errors import DataError

PROFILE = 'plc_inspect'
VERSION = 1
"""Version of the layout; a reader accepts no other."""
SUFFIX = '.record'
"""Suffix of a record, after the name of its results folder."""

HEADER, STATE, BOOKS, VOXELS, CELLS, WIRES = (
    'header', 'state', 'books', 'voxels', 'cells', 'wires'
)
"""Suffixes of topics: the first three hold JSON, the others arrays."""
TOPIC = '/plc_inspect/record/'
"""Prefix of topics."""
_DESCRIPTIONS = {
    HEADER: 'what the node was started with',
    STATE: 'what came in so far, and what the map is; closes each chunk',
    BOOKS: 'spans, supports and hazards that changed, with all that is kept of them',
}
_JSON = 'jsonschema', 'json'
_ARRAYS = '', 'npz'


@dataclass(frozen=True, slots=True)
class Kind:
    """Schema of a topic."""

    name: str
    definition: str
    encoding: tuple[str, str]


def describe_topic(topic: str) -> Kind:
    """Return the schema of a topic."""
    name = f'plc_inspect.record.{topic}'
    if topic not in _DESCRIPTIONS:
        return Kind(name, '', _ARRAYS)
    schema = {'type': 'object', 'title': name, 'description': _DESCRIPTIONS[topic]}
    return Kind(name, json.dumps(schema), _JSON)


def pack_json(value: Any) -> bytes:
    """Return a plain value as JSON."""
    return json.dumps(value, ensure_ascii=False, allow_nan=False).encode()


def unpack_json(data: bytes) -> dict[str, Any]:
    """Return the value that ``pack_json`` packed; DataError if it is not an object."""
    try:
        value = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise DataError(f'this is not JSON: {error}') from error
    if not isinstance(value, dict):
        raise DataError(f'this holds a {type(value).__name__}, not an object')
    return value


def pack_arrays(**arrays: NDArray[Any]) -> bytes:
    """Return arrays in numpy's NPZ format, uncompressed."""
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)  # type: ignore[arg-type]
    return buffer.getvalue()


def unpack_arrays(data: bytes) -> dict[str, NDArray[Any]]:
    """Return the arrays that ``pack_arrays`` packed; DataError on other data."""
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as held:
            return {name: held[name] for name in held.files}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise DataError(f'these are not arrays: {error}') from error


def split_bytes(values: NDArray[Any]) -> NDArray[np.uint8]:
    """Return all first bytes of the values, then all second ones: they compress better."""
    flat = np.ascontiguousarray(values).reshape(-1)
    return np.ascontiguousarray(flat.view(np.uint8).reshape(len(flat), flat.dtype.itemsize).T)


def join_bytes(split: NDArray[np.uint8], dtype: Any) -> NDArray[Any]:
    """Return the values that ``split_bytes`` split."""
    return np.ascontiguousarray(split.T).reshape(-1).view(dtype)


def list_segments(folder: Path) -> list[Path]:
    """List the segments of a record in their order; one segment alone is a record too."""
    if folder.is_file():
        return [folder]
    return sorted(item for item in folder.glob(f'{"[0-9]" * 6}.mcap') if item.is_file())


def name_segment(folder: Path, number: int) -> Path:
    """Return the path of a segment."""
    return folder / f'{number:06d}.mcap'
