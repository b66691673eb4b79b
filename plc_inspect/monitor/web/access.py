# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Access to the page: tokens and their roles, cookies, and a penalty for wrong tokens."""

from collections import OrderedDict
from collections.abc import Mapping
from contextvars import ContextVar
from dataclasses import dataclass
import enum
import hmac
import os
from pathlib import Path
import secrets
import stat
import time

from plc_inspect.errors import ConfigError
from plc_inspect.security.strangers import name_network

SHORTEST_TOKEN = 8
MOST_TOKEN_FILE = 4096
"""Greatest size of a token file [bytes]."""
PENALTY, MOST_PENALTY = 0.5, 5.0
"""
After a wrong token its sender waits so long for the next try, twice as long each time [s]: eight
random letters and digits (36**8 / 2 tries of 5 s) take one address two hundred thousand years.
"""
MOST_PEERS = 1000
"""Most addresses with wrong tokens that are remembered."""


class Role(enum.Enum):
    """What a browser may do."""

    VIEW = 'view'
    ACKNOWLEDGE = 'acknowledge'
    """See all, and acknowledge alarms."""


@dataclass(slots=True)
class Visit:
    """One request, from the gate to its answer."""

    nonce: str
    """Nonce that scripts and styles of the answer must carry (CSP)."""
    role: Role | None = None
    """Role of its browser, None without access."""


VISIT: ContextVar[Visit] = ContextVar('visit')
"""Visit of the request being answered; set by the gate."""


@dataclass(frozen=True, slots=True)
class Tokens:
    """Tokens by role; empty for a page that needs none."""

    by_role: Mapping[Role, str]

    def find_role(self, shown: str) -> Role | None:
        """Return the role of a token; compares all tokens in constant time."""
        found = None
        for role, token in self.by_role.items():
            if compare(shown, token):
                found = role
        return found


NO_TOKENS = Tokens({})


def compare(shown: str, secret: str) -> bool:
    """Return in constant time whether a text, which may stand for any bytes, is a secret."""
    one, other = (text.encode('utf-8', 'surrogateescape') for text in (shown, secret))
    return hmac.compare_digest(one, other)


def make_tokens() -> Tokens:
    """Return random tokens."""
    return Tokens({role: secrets.token_urlsafe(12) for role in Role})


def check_tokens(tokens: Mapping[Role, str]) -> Tokens:
    """
    Return the checked tokens of some roles.

    Raises
    ------
    ConfigError
        One is too short, or two are the same.

    """
    for token in tokens.values():
        if len(token) < SHORTEST_TOKEN:
            raise ConfigError(
                f'a token needs at least {SHORTEST_TOKEN} characters, this has {len(token)}'
            )
    if len(set(tokens.values())) < len(tokens):
        raise ConfigError('two roles have the same token')
    return Tokens(tokens)


def read_tokens(path: Path) -> Tokens:
    """
    Read a file of tokens: lines such as ``view TOKEN`` and ``acknowledge TOKEN``.

    Parameters
    ----------
    path : Path
        A file that only its owner may read.

    Returns
    -------
    Tokens

    Raises
    ------
    ConfigError
        It cannot be read, others may read it, or it holds something else.

    """
    try:
        with path.open(encoding='utf-8') as file:
            mode = stat.S_IMODE(os.fstat(file.fileno()).st_mode)
            text = file.read(MOST_TOKEN_FILE)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f'{path} cannot be read: {error}') from error
    if mode & 0o077:
        raise ConfigError(f'{path} may be read by others (mode {mode:o}): chmod 600 {path}')
    found: dict[Role, str] = {}
    for line in filter(None, map(str.strip, text.splitlines())):
        name, _, token = line.partition(' ')
        roles = {role.value: role for role in Role}
        if name not in roles or not token.strip():
            raise ConfigError(f'{path}: lines are "view TOKEN" or "acknowledge TOKEN"')
        found[roles[name]] = token.strip()
    if not found:
        raise ConfigError(f'{path} holds no token')
    return check_tokens(found)


class Penalties:
    """
    Wrong tokens by address: an address that guesses must wait, no other does.

    An IPv6 address counts as its /64 network, as a host may use any address of it.
    """

    def __init__(self) -> None:
        self._peers: OrderedDict[str, tuple[int, float]] = OrderedDict()

    def wait_of(self, peer: str) -> float:
        """Return the remaining wait of an address [s]."""
        return max(0.0, self._peers.get(name_network(peer), (0, 0.0))[1] - time.monotonic())

    def note_wrong(self, peer: str) -> None:
        """Note a wrong token of an address."""
        peer = name_network(peer)
        count = self._peers.pop(peer, (0, 0.0))[0]
        wait = min(PENALTY * 2.0 ** min(count, 10), MOST_PENALTY)
        self._peers[peer] = count + 1, time.monotonic() + wait
        while len(self._peers) > MOST_PEERS:
            self._peers.popitem(last=False)

    def note_right(self, peer: str) -> None:
        """Reset the penalty of an address."""
        self._peers.pop(name_network(peer), None)
