# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Settings by their dotted names, as used in ROS parameters, files and command lines."""

from collections.abc import Iterator, Mapping
import dataclasses
from dataclasses import fields
from typing import Any

from plc_inspect.config import Settings
from plc_inspect.errors import ConfigError


def describe() -> Iterator[tuple[str, Any, Mapping[str, Any]]]:
    """
    Yield name, default and metadata of every setting, in order.

    Names are dotted, as in ``height.beta``.  The metadata holds ``description``, ``unit``,
    ``low``, ``high``, ``choices`` and ``structural`` (cannot be changed while running).
    """
    for section in fields(Settings):
        for item in fields(type(getattr(Settings(), section.name))):
            yield f'{section.name}.{item.name}', item.default, item.metadata


def to_mapping(settings: Settings) -> dict[str, dict[str, Any]]:
    """Return the settings as section -> name -> plain value; tuples become lists."""
    return {
        section: {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in values.items()
        }
        for section, values in dataclasses.asdict(settings).items()
    }


def update(settings: Settings, mapping: Mapping[str, Any]) -> Settings:
    """
    Return ``settings`` updated by a nested or dotted mapping.

    Integers are accepted for floats and lists for tuples.

    Raises
    ------
    ConfigError
        A section or name is unknown, or a value has the wrong type or range.

    """
    changes: dict[str, dict[str, Any]] = {}
    for key, value in _flatten(mapping):
        section, _, name = key.partition('.')
        current = getattr(settings, section, None) if section in _sections() else None
        if current is None or name not in {item.name for item in fields(current)}:
            raise ConfigError(f'unknown setting {key!r}')
        default = getattr(current, name)
        if isinstance(value, list):
            value = tuple(value)
        if isinstance(default, float) and type(value) is int:
            value = float(value)
        if isinstance(default, tuple) and isinstance(value, tuple):
            value = tuple(float(v) if type(v) is int else v for v in value)
        changes.setdefault(section, {})[name] = value
    return dataclasses.replace(
        settings,
        **{
            section: dataclasses.replace(getattr(settings, section), **values)
            for section, values in changes.items()
        },
    )


def _sections() -> set[str]:
    return {item.name for item in fields(Settings)}


def _flatten(mapping: Mapping[str, Any], prefix: str = '') -> Iterator[tuple[str, Any]]:
    for key, value in mapping.items():
        if isinstance(value, Mapping):
            yield from _flatten(value, f'{prefix}{key}.')
        else:
            yield f'{prefix}{key}', value
