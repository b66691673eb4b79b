# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
The keys by which vehicles sign their streams, so that old and new ones overlap.

Each public key is announced to all a renewal before it signs, and taken back a renewal after: who
has the keys of one renewal understands who has those of the one before or after it.  The key that
comes next stays with the authority until it is the vehicle's.
"""

from pathlib import Path

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    load_pem_private_key,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
)

from plc_inspect.errors import ConfigError
from plc_inspect.security.key_files import put_public, put_secret
from plc_inspect.stream.signature import split_keys

KEY = 'stream.key'
"""Private key of a vehicle, in its folder."""
NEXT, ANNOUNCED = 'next.key', 'stream.pub'
"""With the authority: the private key that comes next, and all that are announced."""


def renew_stream_keys(folder: Path, own: Path) -> None:
    """
    Give a vehicle the key that was announced, and announce another one.

    Parameters
    ----------
    folder : Path
        Of the vehicle's keys, with the authority.
    own : Path
        Folder of the vehicle.

    Raises
    ------
    ConfigError
        A key cannot be read.

    """
    announced = split_keys(read_announced(folder, own))
    before = announced[-2:-1]
    if (folder / NEXT).exists():
        key = _read(folder / NEXT)
    elif announced:  # of a keyring that announced none
        key, before = _read(own / KEY), []
    else:
        key = Ed25519PrivateKey.generate()
    coming = Ed25519PrivateKey.generate()
    put_secret(own / KEY, _pack(key))
    put_public(folder / ANNOUNCED, b''.join((*before, _publish(key), _publish(coming))))
    put_secret(folder / NEXT, _pack(coming))


def read_announced(folder: Path, own: Path) -> bytes:
    """Return the public keys of a vehicle as PEM, the oldest first; parameters as above."""
    try:
        return (folder / ANNOUNCED).read_bytes()
    except FileNotFoundError:
        return _publish(_read(own / KEY)) if (own / KEY).exists() else b''
    except OSError as error:
        raise ConfigError(f'{error.filename} cannot be read: {error.strerror}') from error


def _read(path: Path) -> Ed25519PrivateKey:
    try:
        key = load_pem_private_key(path.read_bytes(), None)
    except (OSError, ValueError, TypeError) as error:
        raise ConfigError(f'{path} cannot be read: {error}') from error
    if not isinstance(key, Ed25519PrivateKey):
        raise ConfigError(f'{path} is no Ed25519 key')
    return key


def _pack(key: Ed25519PrivateKey) -> bytes:
    return key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())


def _publish(key: Ed25519PrivateKey) -> bytes:
    return key.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)
