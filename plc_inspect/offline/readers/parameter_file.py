# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Reads and writes settings: parameter files, ``--set`` and the table of the documentation.

``python -m plc_inspect.offline.readers.parameter_file`` writes ``config/plc_inspect.yaml`` and
``docs/settings.md`` anew from the defaults.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
import textwrap
from typing import Any

import yaml

from plc_inspect.config import Settings
from plc_inspect.errors import ConfigError
from plc_inspect.offline.readers.text_file import parse_yaml, read_yaml, to_float
from plc_inspect.setting_names import describe, to_mapping, update

NODE_NAME = 'plc_inspect'
_NODE_KEYS = ('/**', f'/**/{NODE_NAME}', NODE_NAME, f'/{NODE_NAME}')
"""Node names in a ROS parameter file that address this node; later ones win."""
_NODE_ONLY = ('use_sim_time', 'start_type_description_service', 'qos_overrides')
"""Parameters of every ROS node, which are no settings."""
_YAML_HEAD = '# All settings with their defaults; made by `make settings`.'
_TABLE_HEAD = """\
# Settings

All settings of plc_inspect with their defaults. `plc_survey` and `plc_replay` take them as
`--set height.beta=5` or from a file with `--params`; `plc_node` takes them as ROS parameters.
A value of 0 where it says "0: from ..." is derived from the data; the derived value is in
`run.json` and in the report. Structural settings cannot be changed while the node runs.
`plc_tune` searches those of the paper's Table 1, see [tuning.md](tuning.md).

This page is made by `python -m plc_inspect.offline.readers.parameter_file`.
"""


def read_settings(path: Path | None, assignments: Sequence[str] = ()) -> Settings:
    """
    Return the defaults, updated from a parameter file and assignments.

    Parameters
    ----------
    path : Path or None
        A YAML file in the layout of ROS parameters (``/**: ros__parameters: ...``, or the node's
        name in place of ``/**``), or with the sections at its top level.
    assignments : sequence of str
        ``section.name=value``; later ones win.

    Raises
    ------
    ConfigError
        The file cannot be read or has another layout; a setting is unknown or out of range.

    """
    settings = Settings()
    if path is not None:
        try:
            settings = update(settings, _convert(_read_mapping(path)))
        except ConfigError as error:
            text = str(error)
            raise ConfigError(text if str(path) in text else f'{path}: {text}') from error
    for assignment in assignments:
        name, equals, text = assignment.partition('=')
        if not equals or not name.strip():
            raise ConfigError(f'--set takes section.name=value, got {assignment!r}')
        try:
            value = parse_yaml(text)
        except yaml.YAMLError as error:
            raise ConfigError(f'--set {assignment[:80]}: {text[:60]!r} is not a value') from error
        settings = update(settings, _convert({name.strip(): value}))
    return settings


def render_yaml(settings: Settings) -> str:
    """
    Return settings as a ROS parameter file, each with its description.

    ``read_settings`` reads the same settings from it.
    """
    values = to_mapping(settings)
    lines = [_YAML_HEAD, '/**:', '  ros__parameters:']
    previous = ''
    for name, _, meta in describe():
        section, _, key = name.partition('.')
        if section != previous:
            lines.append(f'    {section}:')
            previous = section
        about = meta['description'] + (f' [{meta["unit"]}]' if meta['unit'] else '')
        lines += textwrap.wrap(about, 91, initial_indent=' ' * 6 + '# ',
                               subsequent_indent=' ' * 6 + '# ')
        lines.append(f'      {key}: {_scalar(values[section][key])}')
    return '\n'.join(lines) + '\n'


def render_parameters(
    settings: Settings, default: Settings, names: Sequence[str], head: Sequence[str]
) -> str:
    """
    Return a ROS parameter file of some settings and all others that differ from the default.

    Parameters
    ----------
    settings, default : Settings
        The settings to write, and the values that are left out.
    names : sequence of str
        Settings that are always written, such as ``height.beta``.
    head : sequence of str
        Lines of the comment at the top.

    """
    values, usual = to_mapping(settings), to_mapping(default)
    lines = [f'# {line}' for line in head] + ['/**:', '  ros__parameters:']
    previous = ''
    for name, _, meta in describe():
        section, _, key = name.partition('.')
        value = values[section][key]
        if name not in names and value == usual[section][key]:
            continue
        if section != previous:
            lines.append(f'    {section}:')
            previous = section
        unit = f'  # [{meta["unit"]}]' if meta['unit'] else ''
        lines.append(f'      {key}: {_scalar(value)}{unit}')
    return '\n'.join(lines) + '\n'


def render_table() -> str:
    """Return the page of the documentation that lists all settings."""
    lines = [_TABLE_HEAD]
    previous = ''
    for name, default, meta in describe():
        section, _, key = name.partition('.')
        if section != previous:
            lines += [''] * bool(previous) + [
                f'## {section}',
                '',
                '| name | default | unit | range | meaning |',
                '| --- | --- | --- | --- | --- |',
            ]
            previous = section
        bounds = ', '.join(meta['choices'])
        number = isinstance(_first(default), int | float) and not isinstance(default, bool)
        if not bounds and number:
            bounds = f'{meta["low"]:,.10g} to {meta["high"]:,.10g}'
        about = meta['description'] + ('; structural' if meta['structural'] else '')
        value = _scalar(list(default) if isinstance(default, tuple) else default)
        lines.append(f'| `{key}` | {value} | {meta["unit"]} | {bounds} | {about} |')
    return '\n'.join(lines) + '\n'


def main() -> None:
    """Write ``config/plc_inspect.yaml`` and ``docs/settings.md`` below the working folder."""
    Path('config/plc_inspect.yaml').write_text(render_yaml(Settings()), encoding='utf-8')
    Path('docs/settings.md').write_text(render_table(), encoding='utf-8')


def _read_mapping(path: Path) -> Mapping[str, Any]:
    """Return the parameters in a file that address this node."""
    content = read_yaml(path)
    if content is None:
        return {}
    if not isinstance(content, Mapping):
        raise ConfigError(f'{path} holds a {type(content).__name__}, not settings')
    nodes = {
        key: value['ros__parameters']
        for key, value in content.items()
        if isinstance(value, Mapping) and 'ros__parameters' in value
    }
    if not nodes:
        return content
    if not any(key in nodes for key in _NODE_KEYS):
        raise ConfigError(f'{path} has parameters of {", ".join(map(str, nodes))} only')
    merged: dict[str, Any] = {}
    for key in _NODE_KEYS:
        parameters = nodes.get(key)
        if parameters is not None and not isinstance(parameters, Mapping):
            raise ConfigError(f'{path}: ros__parameters of {key} are not a mapping')
        merged.update(_flatten(parameters or {}))
    return {
        name: value for name, value in merged.items() if name.partition('.')[0] not in _NODE_ONLY
    }


def _flatten(mapping: Mapping[str, Any], prefix: str = '') -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in mapping.items():
        if isinstance(value, Mapping):
            flat.update(_flatten(value, f'{prefix}{key}.'))
        else:
            flat[f'{prefix}{key}'] = value
    return flat


def _convert(mapping: Mapping[str, Any]) -> dict[str, Any]:
    """Flatten, and convert numbers that YAML 1.1 reads as text, such as 1e-3."""
    defaults = {name: _first(default) for name, default, _ in describe()}
    flat = _flatten(mapping)
    for name, value in flat.items():
        if not isinstance(defaults.get(name), float):
            continue
        if isinstance(value, list):
            flat[name] = [to_float(element) for element in value]
        else:
            flat[name] = to_float(value)
    return flat


def _first(default: Any) -> Any:
    return default[0] if isinstance(default, tuple) else default


def _scalar(value: Any) -> str:
    """Return a value as YAML that ROS reads as the same type: floats keep their point."""
    if isinstance(value, list):
        return '[' + ', '.join(_scalar(element) for element in value) + ']'
    if isinstance(value, float):
        text = repr(value)
        return text.replace('e', '.0e') if 'e' in text and '.' not in text else text
    return yaml.safe_dump(value, default_flow_style=True).splitlines()[0]


if __name__ == '__main__':
    main()
