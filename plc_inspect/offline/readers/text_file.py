# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Reads text, JSON and YAML files from outside, with limits on size and depth."""

from pathlib import Path
import stat
from typing import Any

import yaml

from plc_inspect.errors import ConfigError, DataError
from plc_inspect.printable import make_one_line

MOST_YAML = 1 << 18
"""Greatest size of a YAML file [bytes]; those shipped have 20 kB."""
MOST_JSON = 1 << 28
"""Greatest size of a JSON file [bytes]; 100,000 spans have 150 MB."""
MOST_DEPTH = 20
"""Greatest depth of a YAML file; those shipped have five levels."""
MOST_NODES = 100_000
"""Greatest number of values in YAML with aliases expanded; files shipped have a thousand."""
MOST_INTEGER = 2**63


class _Loader(yaml.SafeLoader):
    """Reads dates as text, as no setting is one, and refuses huge integers."""

    def construct_yaml_int(self, node: yaml.ScalarNode) -> int:
        """Read an integer that fits in 64 bits."""
        if len(node.value) <= 30:
            value = super().construct_yaml_int(node)
            if abs(value) < MOST_INTEGER:
                return int(value)
        raise yaml.constructor.ConstructorError(
            None, None, f'integer {node.value[:12]}... is too large', node.start_mark
        )


_Loader.add_constructor('tag:yaml.org,2002:int', _Loader.construct_yaml_int)
_Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in found if not tag.endswith(':timestamp')]
    for first, found in yaml.SafeLoader.yaml_implicit_resolvers.items()
}


def read_text(path: Path, most: int) -> str:
    """
    Read a text file.

    Parameters
    ----------
    path : Path
        A regular file; pipes and devices are refused.
    most : int
        Greatest size [bytes].

    Raises
    ------
    DataError
        The file is missing, unreadable, not a regular file, too large or not text.

    """
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise DataError(f'{path} is not a regular file')
        if status.st_size > most:
            raise DataError(f'{path} has {status.st_size} bytes, at most {most} are read')
        return path.read_text(encoding='utf-8')
    except (OSError, ValueError) as error:
        reason = getattr(error, 'strerror', None) or 'not text'
        raise DataError(f'{path} cannot be read: {reason}') from error


def read_yaml(path: Path) -> Any:
    """
    Read a YAML file: settings, rules or tables, which users may write.

    Raises
    ------
    ConfigError
        As for ``read_text`` and ``parse_yaml``.

    """
    try:
        return parse_yaml(read_text(path, MOST_YAML))
    except yaml.YAMLError as error:
        text = make_one_line(error)[:160]
        raise ConfigError(f'{path} is not a YAML file: {text}') from error
    except DataError as error:
        raise ConfigError(str(error)) from error


def parse_yaml(text: str) -> Any:
    """
    Parse YAML; dates stay text.

    Raises
    ------
    yaml.YAMLError
        It is no YAML, too deep, too large with its aliases written out, or holds values that
        cannot be.

    """
    try:
        _check_size(text)
        return yaml.load(text, _Loader)  # nosec B506
    except (ValueError, TypeError, OverflowError, RecursionError) as error:
        raise yaml.YAMLError(f'a value cannot be read: {error}') from error


def to_float(value: Any) -> Any:
    """Convert numbers that YAML 1.1 reads as text, such as 2e-05; leave all else as it is."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def _check_size(text: str) -> None:
    """Refuse YAML that is too deep, or too large with its aliases expanded."""
    sizes: list[int] = [0]
    names: list[str | None] = []
    anchors: dict[str | None, int] = {}
    for event in yaml.parse(text, _Loader):
        size = 0
        if isinstance(event, yaml.CollectionStartEvent):
            sizes.append(1)
            names.append(event.anchor)
        elif isinstance(event, yaml.CollectionEndEvent):
            size = anchors[names.pop()] = sizes.pop()
        elif isinstance(event, yaml.ScalarEvent):
            size = anchors[event.anchor] = 1
        elif isinstance(event, yaml.AliasEvent):
            if event.anchor in names:
                raise yaml.YAMLError(f'{event.anchor} holds itself')
            size = anchors.get(event.anchor, 1)
        sizes[-1] += size
        if len(sizes) > MOST_DEPTH + 1 or sizes[-1] > MOST_NODES:
            raise yaml.YAMLError(f'more than {MOST_DEPTH} levels or {MOST_NODES} values')
