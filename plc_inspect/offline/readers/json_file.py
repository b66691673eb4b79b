# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Reads JSON files that hold an object."""

import json
from pathlib import Path
from typing import Any

from plc_inspect.errors import DataError
from plc_inspect.offline.readers.text_file import MOST_JSON, read_text


def read_json(path: Path) -> dict[str, Any]:
    """
    Read a JSON file that holds an object.

    Raises
    ------
    DataError
        The file is missing, unreadable, not JSON, or holds another kind of value.

    """
    text = read_text(path, MOST_JSON)
    try:
        value = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise DataError(f'{path} is not JSON: {error}') from error
    if not isinstance(value, dict):
        raise DataError(f'{path} holds a {type(value).__name__}, not an object')
    return value
