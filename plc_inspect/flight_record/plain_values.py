# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Frozen dataclasses of results as plain values for JSON, and back."""

from collections.abc import Mapping
import dataclasses
import enum
import math
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints, TypeVar, Union

import numpy as np

from plc_inspect.errors import DataError

Kind = TypeVar('Kind')


def to_plain(value: Any) -> Any:
    """
    Return a value as plain JSON types; numbers stay exact.

    Dataclasses become objects, arrays and tuples lists, enum members their values, and non-finite
    numbers null.
    """
    if dataclasses.is_dataclass(value):
        return {
            item.name: to_plain(getattr(value, item.name)) for item in dataclasses.fields(value)
        }
    if isinstance(value, enum.Enum):
        return to_plain(value.value)
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(name): to_plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [to_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def from_plain(kind: type[Kind], value: Any) -> Kind:
    """
    Return a value of a kind from what ``to_plain`` made of it.

    Parameters
    ----------
    kind : type
        A dataclass or whatever its fields are annotated with.
    value : Any
        As from JSON.

    Returns
    -------
    Kind
        Null where a number is meant is NaN.

    Raises
    ------
    DataError
        The value is not of the kind.

    """
    try:
        result: Kind = _read(kind, value)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        name = getattr(kind, '__name__', str(kind))
        raise DataError(f'this is no {name}: {type(error).__name__}: {error}') from error
    return result


def _read(kind: Any, value: Any) -> Any:
    if dataclasses.is_dataclass(kind):
        hints = get_type_hints(kind)
        return kind(**{name: _read(hints[name], item) for name, item in value.items()})  # type: ignore[operator]
    origin, parts = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        return None if value is None else _read(parts[0], value)
    if origin is tuple:
        inner = parts[:1] * len(value) if parts[-1] is Ellipsis else parts
        return tuple(_read(part, item) for part, item in zip(inner, value, strict=True))
    if origin is dict:
        return {name: _read(parts[1], item) for name, item in value.items()}
    if origin is np.ndarray:
        if not isinstance(value, list):
            raise TypeError(f'{value!r} is not a list')
        return np.array(value, dtype=get_args(parts[1])[0])
    if kind is float:
        return math.nan if value is None else float(value)
    if isinstance(kind, type) and not isinstance(value, kind):
        if not issubclass(kind, enum.Enum):
            raise TypeError(f'{value!r} is not of type {kind.__name__}')
        return kind(value)
    return value
