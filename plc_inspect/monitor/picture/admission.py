# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Admission of messages: only those of the node are used; the others are counted by kind.

With keys, each message must be signed by the node, and is used once and in order.  Without keys
the sender cannot be verified; still, no single forged message can silence the node: a new session
is accepted only when the present one is silent or was reset, and numbers cannot leap.
"""

from collections import deque
from dataclasses import dataclass
import enum
import math

from plc_inspect.stream.frame import Frame
from plc_inspect.stream.signature import Signature, Verifier

SILENT = 2.5
"""Another session may take over after this silence [s]; the node speaks every second."""
KEPT = 24
"""Messages that the node keeps for late subscribers; as many may be repeated on request."""
LEAP, LEAP_RATE = 100, 50.0
"""
Greatest gap of numbers without keys, and what each second of silence adds [1/s]: five times what a
tick of 0.1 s sends, so that numbers may go on after a long loss, but a forged one is refused.
"""
REMEMBERED = 256
"""Most numbers of used messages remembered, to distinguish repeated from late ones."""
REFUSAL_PERIOD = 10.0
"""Least time between two reports of refused messages of one kind [s]."""


class Verdict(enum.Enum):
    """The verdict on a message."""

    TAKEN = 'taken'
    FORGED = 'forged'
    """Without the node's signature, or with an impossible number."""
    REPLAYED = 'replayed'
    """The node's, but received before or of an earlier run."""
    REORDERED = 'reordered'
    """The node's, but older than the newest one used."""
    KEPT = 'kept'
    """The node's, from before a reset, sent again on request."""
    FOREIGN = 'foreign'
    """Of another node, while the present one is sending."""


REFUSALS = {
    'forged': 'messages that the node did not send are refused',
    'replayed': 'messages that were sent before are refused',
    'reordered': 'messages came after newer ones and are not used',
    'foreign': 'another node of this name speaks: it is shown once this one is silent',
}
"""Texts of verdicts, by name."""


@dataclass(frozen=True, slots=True)
class Judgement:
    """A verdict, and the number of messages missed."""

    verdict: Verdict
    missing: int = 0
    """Messages between the one before and this one."""
    resent: bool = False
    """It was sent again on request, and later ones were used before."""

    @property
    def good(self) -> bool:
        """Whether the message is to be used."""
        return self.verdict is Verdict.TAKEN


class Admission:
    """
    Admission of one monitor, for the summary and the corridor.

    Parameters
    ----------
    verifier : Verifier or None
        Verifies signatures of the fleet's vehicles; None: without keys.
    runs : dict of str to int
        Newest run seen of each signer; updated in place.

    """

    def __init__(
        self, verifier: Verifier | None = None, runs: dict[str, int] | None = None
    ) -> None:
        self._verifier = verifier
        self.runs: dict[str, int] = {} if runs is None else runs
        self.session: int | None = None
        """Session whose messages are accepted."""
        self._signer: str | None = None
        self._origin: int | None = None
        self._past: deque[int] = deque(maxlen=REMEMBERED)
        self._heard = -math.inf
        self._counters: dict[bytes, _Counter] = {}

    def is_signed(self, data: bytes) -> bool:
        """Return whether a vehicle of the fleet signed a message; True without keys."""
        return self._verifier is None or self._verifier.check(data) is not None

    def judge(
        self, frame: Frame, data: bytes, now: float, resets: int | None = None
    ) -> Judgement:
        """
        Judge a message.

        Parameters
        ----------
        frame : Frame
            Header of the message.
        data : bytes
            As it came in.
        now : float
            Steady time [s].
        resets : int or None
            Number of resets that the message states, None if it states none.

        Returns
        -------
        Judgement

        """
        origin = None if resets is None else (frame.session - resets) % (1 << 32)
        signature = None
        if self._verifier is not None:
            signature = self._verifier.check(data)
            if signature is None:
                return Judgement(Verdict.FORGED)
        if frame.session == self.session and (
            signature is None or signature.signer == self._signer
        ):
            if signature is not None and signature.run < self.runs.get(signature.signer, 0):
                return Judgement(Verdict.REPLAYED)
            judgement = self._judge_number(frame, now)
            if judgement.good and self._origin is None:  # a message of the corridor came first
                self._origin = origin
            return judgement
        refusal = self._refuse_session(frame.session, signature, origin, now)
        if refusal is not None:
            asked = frame.kind in self._counters and self._counters[frame.kind].asked
            kept = asked and frame.session in self._past
            return Judgement(Verdict.KEPT if kept else refusal)
        self._begin(frame.session, signature, origin)
        return self._judge_number(frame, now)

    def is_ahead(self, frame: Frame, data: bytes) -> bool:
        """
        Return whether a message is the node's and newer than all used ones.

        It is not counted as used: it may have overtaken earlier messages.
        """
        counter = self._counters.get(frame.kind)
        if counter is None or frame.session != self.session:
            return False
        signature = None if self._verifier is None else self._verifier.check(data)
        if self._verifier is not None and (
            signature is None or signature.signer != self._signer
            or signature.run < self.runs.get(signature.signer, 0)
        ):
            return False
        return 0 < frame.sequence - counter.newest <= LEAP

    def reopen(self, kind: bytes) -> None:
        """Accept the messages that the node keeps once more, as a resend was requested."""
        if kind in self._counters:
            self._counters[kind].reopen()

    def _refuse_session(
        self, session: int, signature: Signature | None, origin: int | None, now: float
    ) -> Verdict | None:
        """Return why a session is refused, None if it is accepted."""
        silent = now - self._heard > SILENT
        if signature is None:
            reset = (
                self.session is not None and origin is not None and origin == self._origin
                and session == (self.session + 1) % (1 << 32)
            )
            return None if self.session is None or silent or reset else Verdict.FOREIGN
        newest = self.runs.get(signature.signer, -1)
        if signature.run < newest:
            return Verdict.REPLAYED
        if self.session is None or signature.signer != self._signer:
            return None if self.session is None or silent else Verdict.FOREIGN
        if signature.run == newest and (session - self.session) % (1 << 32) >= 1 << 31:
            return Verdict.REPLAYED  # before a reset
        return None

    def _begin(
        self, session: int, signature: Signature | None, origin: int | None
    ) -> None:
        if self.session is not None:
            self._past.append(self.session)
        self.session, self._origin, self._counters = session, origin, {}
        if signature is not None:
            self._signer = signature.signer
            self.runs[signature.signer] = signature.run

    def _judge_number(self, frame: Frame, now: float) -> Judgement:
        counter = self._counters.setdefault(frame.kind, _Counter())
        judgement = counter.judge(frame.sequence, now, strict=self._verifier is not None)
        if judgement.good:
            self._heard = now
        return judgement


class _Counter:
    """Sequence numbers of the messages of one kind in one session."""

    def __init__(self) -> None:
        self.newest = -1
        """Of the messages that were taken."""
        self._floor = self._used = -1
        self.asked = True
        """Kept messages may arrive; before the first message none can be missing."""
        self._heard = -math.inf
        self._taken: deque[int] = deque(maxlen=REMEMBERED)

    def reopen(self) -> None:
        self._used = max(self._used, self.newest)
        self._floor, self.asked = max(-1, self.newest - KEPT), True

    def judge(self, number: int, now: float, *, strict: bool) -> Judgement:
        begun, quiet = bool(self._taken), now - self._heard
        lowest = self._floor if self.asked else self.newest
        if number <= lowest:
            if strict or quiet <= SILENT:
                repeated = number in self._taken
                return Judgement(Verdict.REPLAYED if repeated else Verdict.REORDERED)
            # Without keys: what came before had a number that was not the node's.
            self.asked, self._used = True, -1
        elif begun and not strict and number - self.newest > LEAP + LEAP_RATE * quiet:
            return Judgement(Verdict.FORGED)
        missing = 0 if self.asked else number - self.newest - 1
        self.newest, self._floor, self.asked = number, number, False
        self._heard = now
        self._taken.append(number)
        return Judgement(Verdict.TAKEN, missing, resent=number < self._used)
