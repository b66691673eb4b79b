# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Files of keys: each has its mode from the start, and replaces an old one atomically."""

import os
from pathlib import Path

SECRET, PUBLIC = 0o600, 0o644


def put_secret(path: Path, data: bytes) -> None:
    """Write a file that only its owner may read."""
    _put(path, data, SECRET)


def put_public(path: Path, data: bytes) -> None:
    """Write a file that everybody may read."""
    _put(path, data, PUBLIC)


def _put(path: Path, data: bytes, mode: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    aside = path.with_name(f'.{path.name}.new')
    aside.unlink(missing_ok=True)
    with os.fdopen(os.open(aside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), 'wb') as file:
        file.write(data)
    aside.replace(path)
