# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The rows of the summary's tables as received, and whether any may be missing."""

from typing import Any

from plc_inspect.stream.summary import find_turn, keys_of, SummaryMessage, TABLES


class RowBook:
    """Rows of all tables; not thread-safe."""

    def __init__(self) -> None:
        self._rows: dict[str, dict[tuple[int, ...], Any]] = {name: {} for name in TABLES}
        self._heard: set[tuple[int, int]] = set()
        self.complete = False
        """No row that the node told is missing."""
        self._since: set[tuple[int, int]] = set()
        self.settled = True
        """All turns have come since hazards were held back, or since ``doubt``."""

    def __getitem__(self, table: str) -> dict[tuple[int, ...], Any]:
        """Return the rows of a table by their keys."""
        return self._rows[table]

    def clear(self) -> None:
        """Discard all, as the node began anew."""
        for rows in self._rows.values():
            rows.clear()
        self.miss()
        self.settled = True

    def miss(self) -> None:
        """Note that messages are missing: until all turns have come, rows may be too."""
        self.complete = False
        self._heard.clear()

    def doubt(self) -> None:
        """Note that rows may lack what was known: until all turns have come, nothing is gone."""
        self.settled = False
        self._since.clear()

    def take(self, message: SummaryMessage) -> bool:
        """Apply a message; return whether any row may have changed."""
        changed = False
        for name, rows in self._rows.items():
            table = getattr(message.tables, name)
            told = keys_of(name, table)
            gone = {key for key in message.gone[name] if key in rows}
            if message.turns:
                gone |= {key for key in rows.keys() - set(told)
                         if find_turn(key, message.turns) == message.turn}
            for key in gone:
                del rows[key]
            for key, row in zip(told, table, strict=True):
                changed |= key not in rows or rows[key].tobytes() != row.tobytes()
                rows[key] = row
            changed |= bool(gone)
        if message.status.held:  # a table of hazards that are held back is empty
            self.doubt()
        elif message.turns:
            self._since.add((message.turn, message.turns))
            self.settled |= _has_all(self._since, message.turns)
        if message.turns:
            self._heard.add((message.turn, message.turns))
        # a stream begins with nothing, so with its first message nothing is missing
        self.complete |= not message.frame.sequence or _has_all(self._heard, message.turns)
        return changed


def _has_all(heard: set[tuple[int, int]], turns: int) -> bool:
    """Return whether all turns of so many were heard; of 0 none can be."""
    return turns > 0 and all((turn, turns) in heard for turn in range(turns))
