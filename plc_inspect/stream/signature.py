# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Signatures of the stream: who sent a message, and in which run.

A signed message has a flag in its head, and behind its body the number of the run and an Ed25519
signature of all that comes before: 72 bytes.  Numbers of runs rise from start to start of the
node, so that what was recorded in an earlier run is told from what is sent now, without clocks
that agree.  A reader without keys finds the body as ever.
"""

from dataclasses import dataclass
from itertools import pairwise
import struct

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    load_pem_private_key,
    load_pem_public_key,
    PublicFormat,
)

from plc_inspect.errors import ConfigError

SIGNED = 0x80
"""Flag in the head of a message that is signed."""
FLAGS_AT = 5
"""Where the head has its flags, see frame.py."""
PURPOSE = b'plc_inspect stream 1\0'
"""Signed with each message, so that its signature is good for nothing else."""
SIZE = 64
_RUN = struct.Struct('<Q')
OVERHEAD = _RUN.size + SIZE
"""Bytes that a signature adds to a message."""
_END = b'-----END PUBLIC KEY-----'


@dataclass(frozen=True, slots=True)
class Signature:
    """Who signed a message."""

    signer: str
    """Public key, hexadecimal."""
    run: int
    """Number of the node's run; greater than of all its runs before."""


def split_keys(pem: bytes) -> list[bytes]:
    """Return the public keys of a file, each as PEM, in their order."""
    starts = [0]
    while (at := pem.find(_END, starts[-1])) >= 0:
        starts.append(at + len(_END))
    return [pem[low:high].strip() + b'\n' for low, high in pairwise(starts)]


class Signer:
    """
    Signs the messages of one run.

    Parameters
    ----------
    pem : bytes
        Private Ed25519 key.
    run : int
        Number of the run, 0 to 2**64 - 1.

    Raises
    ------
    ConfigError
        It is no such key.

    """

    def __init__(self, pem: bytes, run: int) -> None:
        try:
            key = load_pem_private_key(pem, None)
        except (ValueError, TypeError) as error:
            raise ConfigError(f'key of the stream cannot be read: {error}') from error
        if not isinstance(key, Ed25519PrivateKey):
            raise ConfigError(f'key of the stream is no Ed25519 key: {type(key).__name__}')
        self._key, self._run = key, _RUN.pack(run)

    def sign(self, message: bytes) -> bytes:
        """Return a message of the stream with its signature."""
        head = message[:FLAGS_AT] + bytes([message[FLAGS_AT] | SIGNED])
        data = head + message[FLAGS_AT + 1:] + self._run
        return data + self._key.sign(PURPOSE + data)


class Verifier:
    """
    Tells who signed a message.

    Parameters
    ----------
    pem : bytes
        Public Ed25519 keys of all whose messages count, one after the other.

    Raises
    ------
    ConfigError
        There is none, or one is no such key.

    """

    def __init__(self, pem: bytes) -> None:
        try:
            keys = [load_pem_public_key(item) for item in split_keys(pem)]
        except ValueError as error:
            raise ConfigError(f'keys of the stream cannot be read: {error}') from error
        self._keys = {
            key.public_bytes(Encoding.Raw, PublicFormat.Raw).hex(): key
            for key in keys if isinstance(key, Ed25519PublicKey)
        }
        if not keys or len(self._keys) != len(keys):
            raise ConfigError('keys of the stream are no Ed25519 keys, or there is none')

    def check(self, message: bytes) -> Signature | None:
        """Return who signed a message, None where nobody did whose messages count."""
        if len(message) <= FLAGS_AT + OVERHEAD or not message[FLAGS_AT] & SIGNED:
            return None
        data, signature = message[:-SIZE], message[-SIZE:]
        for name, key in self._keys.items():
            try:
                key.verify(signature, PURPOSE + data)
            except InvalidSignature:
                continue
            return Signature(name, _RUN.unpack(data[-_RUN.size:])[0])
        return None
