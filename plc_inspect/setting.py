# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""One setting: its default, description, unit and range, checked wherever settings are made."""

from dataclasses import Field, field, fields
import math
from typing import Any

from plc_inspect.errors import ConfigError


def setting(
    default: Any,
    description: str,
    *,
    unit: str = '',
    low: float = -math.inf,
    high: float = math.inf,
    choices: tuple[str, ...] = (),
    structural: bool = False,
) -> Any:
    """Declare one setting with what a user needs to know of it."""
    return field(
        default=default,
        metadata={
            'description': description,
            'unit': unit,
            'low': low,
            'high': high,
            'choices': choices,
            'structural': structural,
        },
    )


class Checked:
    """Type and range check shared by the settings of all stages."""

    __slots__ = ()

    def __post_init__(self) -> None:
        """Raise ConfigError unless every value has its type and lies in its range."""
        for item in fields(self):  # type: ignore[arg-type]
            _check(f'{type(self).__name__}.{item.name}', getattr(self, item.name), item)


def _check(name: str, value: Any, item: Field[Any]) -> None:
    default = item.default
    if isinstance(default, tuple):
        if not isinstance(value, tuple) or not value:
            raise ConfigError(f'{name} must be a non-empty list, got {value!r}')
        if len(value) != len(default) and isinstance(default[0], float):
            raise ConfigError(f'{name} must hold {len(default)} numbers, got {len(value)}')
        for element in value:
            _check_scalar(name, element, default[0], item)
    else:
        _check_scalar(name, value, default, item)


def _check_scalar(name: str, value: Any, default: Any, item: Field[Any]) -> None:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    expected = 'a number' if isinstance(default, float) else f'of type {type(default).__name__}'
    good = number if isinstance(default, float) else type(value) is type(default)
    if not good:
        raise ConfigError(f'{name} must be {expected}, got {value!r}')
    meta = item.metadata
    if number and not (math.isfinite(value) and meta['low'] <= value <= meta['high']):
        raise ConfigError(
            f'{name} must lie in [{meta["low"]:g}, {meta["high"]:g}] {meta["unit"]}'.rstrip()
            + f', got {value!r}'
        )
    if meta['choices'] and value not in meta['choices']:
        raise ConfigError(f'{name} must be one of {", ".join(meta["choices"])}, got {value!r}')
