# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What is known as messages of the summary, each no longer than an alarm may wait."""

from collections.abc import Container, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plc_inspect.stream.frame import Frame, pack_frame, put_rows, put_text, SUMMARY
from plc_inspect.stream.nearness import pack_nearness
from plc_inspect.stream.summary import (
    find_turn,
    HELD,
    keys_of,
    pack_keys,
    pack_status,
    RowKey,
    Status,
    SummaryTables,
    TABLES,
)

MOST_CHANGED = 3500
"""
Changed rows of one message, before they are compressed [bytes]; the others follow.
Source: derivation: two packets of Ethernet when compressed, less than a tenth of a second of
256 kbit/s, as MESSAGE_SIZE of thin_map.
"""
_URGENCY = ('hazards', 'supports', 'spans')
"""Tables in the order in which their changes are told."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Share:
    """What a message tells of the rows, besides those that are gone."""

    turn: int = 0
    turns: int = 0
    """All rows of this turn of so many; of 0 none, of 1 everything."""
    again: Container[int] = ()
    """Hazards by number, also where nothing of them changed."""
    most: int = MOST_CHANGED
    """Rows that changed besides, at most so much [bytes]."""


EVERYTHING = Share(turns=1)
"""Of a message that needs none before it."""


class SummaryWriter:
    """
    Turns what is known into messages; keeps what was told last.

    Parameters
    ----------
    session : int
        Random number of this run of the node, 0 to 2**32 - 1.

    """

    def __init__(self, session: int) -> None:
        self._session = session
        self._sequence = 0
        self._told: dict[str, dict[RowKey, bytes]] = {name: {} for name in TABLES}
        self._texts: tuple[str, ...] = ()
        self.behind = False
        """Some rows that changed are not yet told."""

    def write(
        self, tables: SummaryTables, status: Status, texts: Sequence[str], uptime: float,
        share: Share,
    ) -> bytes:
        """
        Return the next message.

        Parameters
        ----------
        tables : SummaryTables
            All that is known now.
        status : Status
            Now.
        texts : sequence of str
            Frame of the coordinates, then a text for each of STATUSES.
        uptime : float
            Steady time of the node [s].
        share : Share
            Which rows it tells.

        Returns
        -------
        bytes

        """
        chosen = self._choose(tables, share)
        body = [pack_status(status, share.turn, share.turns)]
        for name in TABLES:
            (now, own), told = chosen[name], self._told[name]
            gone = sorted(set(told) - set(now))
            for key in gone:
                del told[key]
            told.update(
                item for item, this in zip(now.items(), own.tolist(), strict=True) if this
            )
            body.append(put_rows(getattr(tables, name)[own]))
            body.append(put_rows(pack_keys(name, gone)))
        before, self._texts = self._texts, tuple(texts)
        if self._texts != before or (share.turns and not share.turn):
            body.append(bytes([len(self._texts)]))
            body += map(put_text, self._texts)
        else:
            body.append(b'\0')
        body.append(put_rows(pack_nearness(status.near)))
        frame = Frame(
            kind=SUMMARY, flags=HELD * status.held, session=self._session,
            sequence=self._sequence, uptime=uptime, body=b''.join(body),
        )
        self._sequence += 1
        return pack_frame(frame)

    def _choose(
        self, tables: SummaryTables, share: Share
    ) -> dict[str, tuple[dict[RowKey, bytes], NDArray[np.bool_]]]:
        """Return the rows of each table by their keys, and which of them are told."""
        room, chosen = share.most, {}
        self.behind = False
        for name in _URGENCY:
            rows = getattr(tables, name)
            now = dict(zip(keys_of(name, rows), map(bytes, _cells(rows)), strict=True))
            own = np.array([
                (bool(share.turns) and find_turn(key, share.turns) == share.turn)
                or (name == 'hazards' and key[0] in share.again) for key in now
            ], dtype=np.bool_)
            told = self._told[name]
            changed = np.array([told.get(key) != data for key, data in now.items()], np.bool_)
            changed &= ~own
            order = np.flatnonzero(changed)
            if name == 'hazards':
                order = order[np.argsort(-rows['severity'][order].astype(np.int64), kind='stable')]
            fitting = order[:max(room, 0) // rows.dtype.itemsize]
            own[fitting] = True
            room -= len(fitting) * rows.dtype.itemsize
            self.behind |= len(fitting) < len(order)
            chosen[name] = now, own
        return chosen


def _cells(rows: NDArray[Any]) -> NDArray[np.void]:
    return np.ascontiguousarray(rows).view(f'V{rows.dtype.itemsize}')
