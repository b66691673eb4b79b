# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Those who have connected and not yet shown who they are: a bounded number, whoever they are."""

from collections import Counter
from collections.abc import Hashable
import ipaddress
from typing import Generic, TypeVar

NETWORK = 64
"""Prefix bits of an IPv6 address, which its host cannot choose (RFC 4291, 2.5.4)."""
MOST_STRANGERS = 64
"""
Most of them at once; beyond, the oldest one of the address with the most gives way, so that silent
ones keep nobody out.
Source: judgement: a fleet has a dozen members, and each takes a second over a slow link.
"""

Who = TypeVar('Who', bound=Hashable)


class Strangers(Generic[Who]):
    """Strangers with their addresses, the oldest first."""

    def __init__(self) -> None:
        self._peers: dict[Who, str] = {}

    def __len__(self) -> int:
        """Return how many they are."""
        return len(self._peers)

    def add(self, who: Who, peer: str) -> Who | None:
        """Add one from an address; return who is to give way, None nobody."""
        self._peers[who] = name_network(peer)
        if len(self._peers) <= MOST_STRANGERS:
            return None
        ((busiest, _),) = Counter(self._peers.values()).most_common(1)
        oldest = next(item for item, network in self._peers.items() if network == busiest)
        del self._peers[oldest]
        return oldest

    def discard(self, who: Who) -> None:
        """Leave one out that is known now, or gone."""
        self._peers.pop(who, None)


def name_network(peer: str) -> str:
    """Return the network of an IPv6 address, and anything else as it is."""
    try:
        address = ipaddress.ip_address(peer.partition('%')[0])
    except ValueError:
        return peer
    if isinstance(address, ipaddress.IPv4Address):
        return peer
    if address.ipv4_mapped is not None:
        return str(address.ipv4_mapped)
    return str(ipaddress.ip_network((address, NETWORK), strict=False))
