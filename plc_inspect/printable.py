# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Make text from files and the network safe for terminals and spreadsheets."""

import os
from pathlib import Path
import re

from plc_inspect.errors import DataError

_CONTROL = re.compile('[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ud800-\udfff]')
"""
Control characters except tab and line feed, those that change the writing direction, and bytes of
file names that are not UTF-8, for which Python has surrogates.
"""
_FORMULA = ('=', '+', '-', '@', '\t', '\r')


def make_printable(text: str) -> str:
    """Return a text with its control characters escaped as in Python."""
    return _CONTROL.sub(lambda found: found[0].encode('unicode_escape').decode('ascii'), text)


def make_one_line(text: object) -> str:
    """Return a text on one line, with its control characters escaped."""
    return make_printable(' '.join(str(text).split()))


def make_cell(text: str) -> str:
    """Return a text that spreadsheets do not take for a formula."""
    return f"'{text}" if text.startswith(_FORMULA) else text


def decode_name(name: str) -> str:
    """Return the name of a file with a replacement character for each byte that is not UTF-8."""
    return os.fsencode(name).decode('utf-8', 'replace')


def check_name(path: Path) -> None:
    """Raise DataError for a path that the tables of many inputs cannot hold."""
    if decode_name(str(path)) != str(path):
        raise DataError(f'{path}: its name is not UTF-8, as names in the ledger are: rename it')
