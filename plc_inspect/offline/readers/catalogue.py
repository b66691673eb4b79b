# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Reads rule sets and conductors, shipped or given by a user, and load cases."""

import math
from pathlib import Path
from typing import Any

from plc_inspect.config import HazardSettings
from plc_inspect.core.hazards.clearance_rules import parse_rules, PLAIN, plain_rules, RuleSet
from plc_inspect.core.loads.sag_tension import Case, Conductor
from plc_inspect.errors import ConfigError, DataError
from plc_inspect.offline.readers.text_file import read_yaml, to_float
from plc_inspect.shared_files import find_shared

GRAVITY = 9.80665
_COLUMNS = ('name', 'diameter', 'mass', 'area', 'modulus', 'expansion', 'source')
_CASE_KEYS = ('temperature', 'ice', 'wind')


def list_rules() -> list[str]:
    """Return the names of the shipped rule sets."""
    folder = find_shared('rules')
    return sorted(path.stem for path in folder.glob('*.yaml')) if folder else []


def load_rules(settings: HazardSettings) -> RuleSet:
    """
    Read the rule set that the settings name.

    Parameters
    ----------
    settings : HazardSettings
        As for ``make_rules``; ``rules`` as for ``read_rules``.

    Returns
    -------
    RuleSet

    Raises
    ------
    ConfigError
        There is no such rule set, it cannot be read, or it contradicts itself or the settings.

    """
    return make_rules(read_rules(settings.rules), settings)


def read_rules(name: str) -> Any:
    """
    Return what the file of a rule set holds, None for the plain rules, which have none.

    Parameters
    ----------
    name : str
        'plain', the name of a file in ``config/rules`` without its suffix, or a path that ends in
        .yaml.

    Raises
    ------
    ConfigError
        There is no such rule set, or it cannot be read.

    """
    if name == PLAIN:
        return None
    if name.endswith(('.yaml', '.yml')):
        path = Path(name)
    else:
        shared = find_shared(f'rules/{name}.yaml')
        if shared is None or '/' in name:
            known = ', '.join([PLAIN, *list_rules()])
            raise ConfigError(f'unknown rule set {name!r}; there are {known}, or a .yaml file')
        path = shared
    return read_yaml(path)


def make_rules(content: Any, settings: HazardSettings) -> RuleSet:
    """Return the rule set of what ``read_rules`` returned; ConfigError as ``parse_rules``."""
    return plain_rules(settings) if settings.rules == PLAIN else parse_rules(content, settings)


def load_conductor(name: str, path: Path | None = None) -> Conductor:
    """
    Return a conductor by name.

    Parameters
    ----------
    name : str
        Name as in the table; case does not matter.
    path : Path or None
        Table to use in place of ``config/conductors.yaml``.

    Returns
    -------
    Conductor

    Raises
    ------
    ConfigError
        The table cannot be read, a row is wrong, or no conductor has this name.

    """
    path = path or find_shared('conductors.yaml')
    if path is None:
        raise ConfigError('config/conductors.yaml is not installed: give --conductors')
    rows = read_yaml(path)
    if not isinstance(rows, list) or not rows:
        raise ConfigError(f'{path}: expected a list of conductors')
    table = [_read_conductor(row, f'{path}, row {number + 1}') for number, row in enumerate(rows)]
    found = [item for item in table if item.name.casefold() == name.strip().casefold()]
    if not found:
        known = ', '.join(item.name for item in table)
        raise ConfigError(f'unknown conductor {name!r}; there are {known}')
    return found[0]


def parse_case(text: str) -> Case:
    """
    Parse a case such as ``temperature=80`` or ``winter: temperature=-5, ice=0.01, wind=15``.

    Parameters
    ----------
    text : str
        Temperature of the conductor [degrees Celsius], ice [m] and wind [m/s]; a name may stand
        in front.

    Returns
    -------
    Case

    Raises
    ------
    ConfigError
        The text is malformed, or a value is not a number or out of range.

    """
    head, colon, body = text.partition(':')
    name, body = (head.strip(), body) if colon else ('', text)
    values: dict[str, float] = {}
    for part in body.split(','):
        key, equals, value = part.partition('=')
        key = key.strip()
        if key not in _CASE_KEYS or not equals or key in values:
            raise ConfigError(
                f'case {text!r}: expected temperature=C, ice=m, wind=m/s, got {part.strip()!r}'
            )
        try:
            values[key] = float(value)
        except ValueError:
            raise ConfigError(f'case {text!r}: {value.strip()!r} is not a number') from None
    if 'temperature' not in values:
        raise ConfigError(f'case {text!r} has no temperature')
    title = f'{values["temperature"]:g} C'
    title += f', {1000 * values["ice"]:g} mm ice' if values.get('ice') else ''
    title += f', {values["wind"]:g} m/s wind' if values.get('wind') else ''
    try:
        return Case(name=name or title, **values)
    except DataError as error:
        raise ConfigError(str(error)) from error


def _read_conductor(row: Any, where: str) -> Conductor:
    if not isinstance(row, dict):
        raise ConfigError(f'{where} is not a mapping')
    wrong = sorted(set(map(str, row)) ^ set(_COLUMNS))
    if wrong:
        state = 'is unknown' if wrong[0] in row else 'is missing'
        raise ConfigError(f'{where}: {wrong[0]} {state}')
    values = {}
    for key in ('diameter', 'mass', 'area', 'modulus', 'expansion'):
        value = to_float(row[key])
        if isinstance(value, bool) or not isinstance(value, int | float) or not (
            math.isfinite(value) and value > 0
        ):
            raise ConfigError(f'{where}: {key} must be a positive number, got {value!r}')
        values[key] = float(value)
    return Conductor(
        name=str(row['name']),
        diameter=values['diameter'] * 1e-3,
        weight=values['mass'] * 1e-3 * GRAVITY,
        stiffness=values['modulus'] * values['area'],
        expansion=values['expansion'],
        source=' '.join(str(row['source']).split()),
    )
