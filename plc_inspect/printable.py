# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Text from files and from the network, made safe for a terminal and for spreadsheets."""

import re

_CONTROL = re.compile('[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]')
"""All but tab and line feed; the last ones turn the direction of writing."""
_FORMULA = ('=', '+', '-', '@', '\t', '\r')


def make_printable(text: str) -> str:
    """Return a text with its control characters written out as in Python."""
    return _CONTROL.sub(lambda found: found[0].encode('unicode_escape').decode('ascii'), text)


def make_one_line(text: object) -> str:
    """Return a text on one line, with its control characters written out."""
    return make_printable(' '.join(str(text).split()))


def make_cell(text: str) -> str:
    """Return a text that no spreadsheet takes for a formula."""
    return f"'{text}" if text.startswith(_FORMULA) else text
