# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
The keyring of a fleet: an authority, a register, and a folder of keys for each member.

The certificate of a member serves for the tunnel, as identity under SROS2 and, on the ground, for
the page.  Revoked ones are on the revocation list, which tunnel and SROS2 read.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime, timedelta, UTC
import json
import os
from pathlib import Path
import re
import shutil

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    load_pem_private_key,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
)

from plc_inspect.errors import ConfigError
from plc_inspect.security.authority import (
    Credential,
    issue,
    load_credential,
    make_authority,
    make_revocation_list,
    MOST_DAYS,
    sign_document,
    SLACK,
)
from plc_inspect.security.policy import make_governance, make_permissions, Rights

ROLES = ('vehicle', 'ground', 'operator', 'driver', 'navigation', 'logger')
ENCLAVES = '/plc_inspect'
"""Path above the enclaves of all members."""
LOCAL_HOSTS = ('localhost', '127.0.0.1')
REGISTER = 'register.json'
NAME = re.compile('[a-z][a-z0-9_]{0,30}')
SECRET, PUBLIC = 0o600, 0o644


@dataclass(frozen=True, slots=True, kw_only=True)
class Member:
    """One member of the fleet."""

    name: str
    role: str
    serial: int
    """Serial of its certificate by the root."""
    until: str
    """When its certificates end, ISO 8601 in UTC."""
    revoked: bool = False
    older: tuple[int, ...] = ()
    """Serials of its earlier certificates, which stay valid until they expire."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Register:
    """The register of issued certificates."""

    domain: int
    days: int
    hosts: tuple[str, ...] = ()
    """Names and addresses of the page, in addition to this machine's."""
    members: Mapping[str, Member]
    old_serials: tuple[int, ...] = ()
    """Serials of revoked certificates by the root that were replaced."""


class Keyring:
    """
    A folder with the keys of a fleet; keep it on an offline machine.

    Parameters
    ----------
    folder : Path
        The folder.
    policy : mapping of str to Rights
        Rights by enclave, as from ``read_policy``; a member has the rights of its role.

    """

    def __init__(self, folder: Path, policy: Mapping[str, Rights]) -> None:
        self.folder = folder
        self._policy = policy

    def create(
        self, *, domain: int, days: int, hosts: Sequence[str], now: datetime | None = None
    ) -> Register:
        """
        Create the authority and one member of each role.

        Raises
        ------
        ConfigError
            The folder is not empty, or a number is out of range.

        """
        if self.folder.exists() and any(self.folder.iterdir()):
            raise ConfigError(f'{self.folder} is not empty: name a new folder for the keys')
        if not 0 <= domain <= 232:
            raise ConfigError(f'a ROS_DOMAIN_ID is 0 to 232, not {domain}')
        self.folder.mkdir(parents=True, exist_ok=True)
        self.folder.chmod(0o700)
        root = make_authority('plc_inspect root', _longest(days), now)
        self._put_authority('root', root)
        register = Register(domain=domain, days=days, hosts=tuple(hosts), members={})
        for role in ROLES:
            register = self._issue(register, role, role, now)
        return self._finish(register, now)

    def add(self, name: str, role: str, now: datetime | None = None) -> Register:
        """
        Add a member.

        Raises
        ------
        ConfigError
            The name is taken or invalid, or the role is unknown.

        """
        register = self.load()
        if not NAME.fullmatch(name) or name == 'authority':
            raise ConfigError(f'{name!r} is not a name: small letters, digits and _, at most 31')
        if role not in ROLES:
            raise ConfigError(f'{role!r} is not a role: one of {", ".join(ROLES)}')
        before = register.members.get(name)
        if before is not None and not before.revoked:
            raise ConfigError(f'{name} is there already: plc_keys renew gives it new keys')
        if before is not None:
            register = replace(register, old_serials=(*register.old_serials, *_list(before)))
        return self._finish(self._issue(register, name, role, now), now)

    def renew(self, now: datetime | None = None) -> Register:
        """Reissue the certificates of all members by the present authority."""
        register = self.load()
        for member in register.members.values():
            if not member.revoked:
                register = self._issue(register, member.name, member.role, now)
        return self._finish(register, now)

    def revoke(self, name: str, now: datetime | None = None) -> Register:
        """
        Revoke the keys of a member, and give all others the new revocation list.

        Raises
        ------
        ConfigError
            There is no such member, or it is revoked already.

        """
        register = self.load()
        member = register.members.get(name)
        if member is None or member.revoked:
            known = ', '.join(key for key, item in register.members.items() if not item.revoked)
            raise ConfigError(f'{name!r} is not a member with keys; those are {known}')
        shutil.rmtree(self.folder / name, ignore_errors=True)
        members = {**register.members, name: replace(member, revoked=True)}
        return self._finish(replace(register, members=members), now)

    def load(self) -> Register:
        """
        Read the register.

        Raises
        ------
        ConfigError
            There is none, or it cannot be read.

        """
        path = self.folder / REGISTER
        try:
            values = json.loads(path.read_text(encoding='utf-8'))
            members = {
                item['name']: Member(**{**item, 'older': tuple(item.get('older', ()))})
                for item in values.pop('members')
            }
            values['hosts'] = tuple(values['hosts'])
            values['old_serials'] = tuple(values['old_serials'])
            return Register(members=members, **values)
        except FileNotFoundError:
            raise ConfigError(
                f'{self.folder} holds no keys: plc_keys create {self.folder} makes them'
            ) from None
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise ConfigError(f'{path} cannot be read: {error}') from error

    @property
    def _authority(self) -> Path:
        return self.folder / 'authority'

    def _put_authority(self, name: str, credential: Credential) -> None:
        self._authority.mkdir(mode=0o700, exist_ok=True)
        _put(self._authority / f'{name}.key', credential.key_pem, SECRET)
        _put(self._authority / f'{name}.crt', credential.pem, PUBLIC)

    def _take_authority(self, name: str) -> Credential:
        try:
            return load_credential(
                (self._authority / f'{name}.key').read_bytes(),
                (self._authority / f'{name}.crt').read_bytes(),
            )
        except OSError as error:
            raise ConfigError(f'{error.filename} cannot be read: {error.strerror}') from error

    def _issue(
        self, register: Register, name: str, role: str, now: datetime | None
    ) -> Register:
        """Write the folder of a member; return the register with it."""
        root = self._take_authority('root')
        days, enclave = register.days, f'{ENCLAVES}/{name}'
        hosts = (*LOCAL_HOSTS, *register.hosts) if role in ('ground', 'operator') else ()
        own = issue(root, enclave, days, hosts, now)
        begin = (datetime.now(UTC) if now is None else now) - SLACK
        end = begin + SLACK + timedelta(days=days)
        folder = self.folder / name
        folder.mkdir(mode=0o700, exist_ok=True)
        _put(folder / 'member.key', own.key_pem, SECRET)
        _put(folder / 'member.crt', own.pem, PUBLIC)
        _put(folder / 'root_ca.crt', root.pem, PUBLIC)
        if role == 'vehicle':  # it signs its stream with a key of its own
            stream = Ed25519PrivateKey.generate()
            _put(folder / 'stream.key', stream.private_bytes(
                Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()
            ), SECRET)
        rights = self._policy.get(f'{ENCLAVES}/{role}')
        if rights is None:
            raise ConfigError(f'the policy has no enclave {ENCLAVES}/{role}')
        documents = {
            'permissions': make_permissions(enclave, rights, register.domain, begin, end),
            'governance': make_governance(register.domain),
        }
        _put_enclave(folder / 'sros2', enclave, root, own, documents)
        until = end.replace(microsecond=0).isoformat()
        before = register.members.get(name)
        member = Member(
            name=name, role=role, serial=own.certificate.serial_number, until=until,
            older=() if before is None or before.revoked else _list(before),
        )
        return replace(register, members={**register.members, name: member})

    def _finish(self, register: Register, now: datetime | None) -> Register:
        """Write revocation list and public keys of vehicles to all members, and the register."""
        serials = [
            serial for item in register.members.values() if item.revoked
            for serial in _list(item)
        ]
        revoked = make_revocation_list(
            self._take_authority('root'), [*serials, *register.old_serials],
            _longest(register.days), now,
        )
        _put(self._authority / 'crl.pem', revoked, PUBLIC)
        live = [item for item in register.members.values() if not item.revoked]
        signers = [
            load_pem_private_key((self.folder / item.name / 'stream.key').read_bytes(), None)
            for item in live if item.role == 'vehicle'
        ]
        public = b''.join(
            key.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)
            for key in signers
        )
        for member in live:
            folder = self.folder / member.name
            enclave = folder / 'sros2' / 'enclaves' / ENCLAVES[1:] / member.name
            _put(enclave / 'crl.pem', revoked, PUBLIC)
            _put(folder / 'crl.pem', revoked, PUBLIC)
            _put(folder / 'stream.pub', public, PUBLIC)
        values = asdict(register)
        values['members'] = list(values['members'].values())
        text = json.dumps(values, indent=1) + '\n'
        _put(self.folder / REGISTER, text.encode(), SECRET)
        return register


def _put_enclave(
    keystore: Path, enclave: str, root: Credential, own: Credential, documents: Mapping[str, str]
) -> None:
    """Write a keystore of one enclave, in the layout of ``ros2 security``, without links."""
    public, folder = keystore / 'public', keystore / 'enclaves' / enclave[1:]
    public.mkdir(parents=True, exist_ok=True)
    folder.mkdir(parents=True, exist_ok=True)
    for place in (public, folder):
        for name in ('identity_ca', 'permissions_ca'):
            _put(place / f'{name}.cert.pem', root.pem, PUBLIC)
    _put(folder / 'key.pem', own.key_pem, SECRET)
    _put(folder / 'cert.pem', own.pem, PUBLIC)
    for name, text in documents.items():
        place = folder if name == 'permissions' else keystore / 'enclaves'
        _put(place / f'{name}.xml', text.encode(), PUBLIC)
        signed = sign_document(root, text)
        _put(folder / f'{name}.p7s', signed, PUBLIC)


def _put(path: Path, data: bytes, mode: int) -> None:
    """Write a file with its mode set from the start, replacing an old one atomically."""
    path.parent.mkdir(parents=True, exist_ok=True)
    aside = path.with_name(f'.{path.name}.new')
    aside.unlink(missing_ok=True)
    with os.fdopen(os.open(aside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), 'wb') as file:
        file.write(data)
    aside.replace(path)


def _list(member: Member) -> tuple[int, ...]:
    """List the serials of all certificates of a member."""
    return (*member.older, member.serial)


def _longest(days: int) -> int:
    """Return the validity of an authority whose members are valid for ``days`` [d]."""
    return min(MOST_DAYS, 2 * days)
