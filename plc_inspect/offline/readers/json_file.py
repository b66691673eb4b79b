# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Reading JSON files that hold an object."""

import json
from pathlib import Path
from typing import Any

from plc_inspect.errors import DataError


def read_json(path: Path) -> dict[str, Any]:
    """
    Read a JSON file that holds an object.

    Raises
    ------
    DataError
        It is missing, cannot be read, is no JSON or holds another kind of value.

    """
    try:
        value = json.loads(path.read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or 'not text'
        raise DataError(f'{path} cannot be read: {reason}') from error
    except ValueError as error:
        raise DataError(f'{path} is no JSON: {error}') from error
    if not isinstance(value, dict):
        raise DataError(f'{path} holds a {type(value).__name__}, not an object')
    return value
