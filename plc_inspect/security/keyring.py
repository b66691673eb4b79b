# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
The keyring of a fleet: an authority, a register, and a folder of keys for each member.

The certificate of a member serves for the tunnel, as identity under SROS2 and, on the ground, for
the page.  Revoked ones are on the revocation list, which tunnel and SROS2 read.

A renewal takes days until all members have their new folders.  Meanwhile old and new ones go
together: the certificates of the root have one key and name, so that each verifies all that any of
them signed; SROS2 asks for the very certificate that signed a document, so that is the oldest
that holds as long; keys of streams overlap too (stream_keys.py).
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime, timedelta, UTC
import json
from pathlib import Path
import re
import shutil

from plc_inspect.errors import ConfigError
from plc_inspect.security.authority import (
    Credential,
    find_end,
    issue,
    load_credentials,
    make_authority,
    make_revocation_list,
    MOST_DAYS,
    sign_document,
    SLACK,
)
from plc_inspect.security.key_files import put_public, put_secret
from plc_inspect.security.policy import make_governance, make_permissions, Rights
from plc_inspect.security.stream_keys import read_announced, renew_stream_keys

ROLES = ('vehicle', 'ground', 'operator', 'driver', 'navigation', 'logger')
ENCLAVES = '/plc_inspect'
"""Path above the enclaves of all members."""
LOCAL_HOSTS = ('localhost', '127.0.0.1')
REGISTER = 'register.json'
NAME = re.compile('[a-z][a-z0-9_]{0,30}')
ROOT = 'plc_inspect root'
AUTHORITY_TERMS = 2
"""
Validity of a certificate of the root, and of the revocation list, in that of members.
Source: derivation: with one per term of members, each is known to all a term before it signs.
"""
LEAST_TERMS = 1.5
"""
The newest certificate of the root holds at least so long, in terms of members, or another one is
made.
Source: derivation: of members renewed once a term it is then made at each renewal, of others not
at each.
"""


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
        if not 1 <= days <= MOST_DAYS:
            raise ConfigError(f'certificates hold for 1 to {MOST_DAYS} days, not {days}')
        self.folder.mkdir(parents=True, exist_ok=True)
        self.folder.chmod(0o700)
        self._authority.mkdir(mode=0o700, exist_ok=True)
        root = make_authority(ROOT, AUTHORITY_TERMS * days, now)
        put_secret(self._authority / 'root.key', root.key_pem)
        put_public(self._authority / 'root.crt', root.pem)
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
        """Reissue the certificates of all members, and that of the root before it ends."""
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
        for folder in (self.folder / name, self._find_streams(name)):
            shutil.rmtree(folder, ignore_errors=True)
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

    def _find_streams(self, name: str) -> Path:
        """Return the folder with the authority's part of the keys of a vehicle's stream."""
        return self._authority / 'streams' / name

    def _load_roots(self) -> list[Credential]:
        """Return the root with each of its certificates, the newest first."""
        try:
            return load_credentials(
                (self._authority / 'root.key').read_bytes(),
                (self._authority / 'root.crt').read_bytes(),
            )
        except OSError as error:
            raise ConfigError(f'{error.filename} cannot be read: {error.strerror}') from error

    def _renew_roots(self, days: int, now: datetime) -> list[Credential]:
        """Return the root, with another certificate if the newest ends soon."""
        roots = [item for item in self._load_roots() if find_end(item.certificate) > now]
        if not roots or find_end(roots[0].certificate) < now + LEAST_TERMS * timedelta(days=days):
            key = self._load_roots()[0].key
            roots.insert(0, make_authority(ROOT, AUTHORITY_TERMS * days, now, key))
            put_public(self._authority / 'root.crt', _join(roots))
        return roots

    def _issue(
        self, register: Register, name: str, role: str, now: datetime | None
    ) -> Register:
        """Write the folder of a member; return the register with it."""
        rights = self._policy.get(f'{ENCLAVES}/{role}')
        if rights is None:
            raise ConfigError(f'the policy has no enclave {ENCLAVES}/{role}')
        now = datetime.now(UTC) if now is None else now
        days, enclave = register.days, f'{ENCLAVES}/{name}'
        hosts = (*LOCAL_HOSTS, *register.hosts) if role in ('ground', 'operator') else ()
        roots = self._renew_roots(days, now)
        own = issue(roots[0], enclave, days, hosts, now)
        begin, end = now - SLACK, now + timedelta(days=days)
        documents = {
            'permissions': make_permissions(enclave, rights, register.domain, begin, end),
            'governance': make_governance(register.domain),
        }
        until = end.replace(microsecond=0).isoformat()
        before = register.members.get(name)
        member = Member(
            name=name, role=role, serial=own.certificate.serial_number, until=until,
            older=() if before is None or before.revoked else _list(before),
        )
        register = replace(register, members={**register.members, name: member})
        self._save(register)  # before the keys are anywhere, or nobody could revoke them
        folder = self.folder / name
        folder.mkdir(mode=0o700, exist_ok=True)
        put_secret(folder / 'member.key', own.key_pem)
        put_public(folder / 'member.crt', own.pem)
        if role == 'vehicle':  # it signs its stream with a key of its own
            renew_stream_keys(self._find_streams(name), folder)
        signer = next(item for item in reversed(roots) if find_end(item.certificate) >= (
            find_end(own.certificate)
        ))
        _put_enclave(folder / 'sros2', enclave, signer, own, documents)
        return register

    def _finish(self, register: Register, now: datetime | None) -> Register:
        """Write what all members must know to each of them, and the register."""
        roots = self._load_roots()
        serials = [
            serial for item in register.members.values() if item.revoked
            for serial in _list(item)
        ]
        revoked = make_revocation_list(
            roots[0], [*serials, *register.old_serials], AUTHORITY_TERMS * register.days, now
        )
        put_public(self._authority / 'crl.pem', revoked)
        live = [item for item in register.members.values() if not item.revoked]
        public = b''.join(
            read_announced(self._find_streams(item.name), self.folder / item.name)
            for item in live if item.role == 'vehicle'
        )
        for member in live:
            folder = self.folder / member.name
            enclave = folder / 'sros2' / 'enclaves' / ENCLAVES[1:] / member.name
            for place in (enclave, folder):
                put_public(place / 'crl.pem', revoked)
            for place in (enclave, folder / 'sros2' / 'public'):
                for name in ('identity_ca', 'permissions_ca'):
                    put_public(place / f'{name}.cert.pem', _join(roots))
            put_public(folder / 'root_ca.crt', _join(roots))
            put_public(folder / 'stream.pub', public)
        self._save(register)
        return register

    def _save(self, register: Register) -> None:
        values = asdict(register)
        values['members'] = list(values['members'].values())
        text = json.dumps(values, indent=1) + '\n'
        put_secret(self.folder / REGISTER, text.encode())


def _put_enclave(
    keystore: Path, enclave: str, signer: Credential, own: Credential, documents: Mapping[str, str]
) -> None:
    """Write a keystore of one enclave, in the layout of ``ros2 security``, without links."""
    folder = keystore / 'enclaves' / enclave[1:]
    put_secret(folder / 'key.pem', own.key_pem)
    put_public(folder / 'cert.pem', own.pem)
    for name, text in documents.items():
        place = folder if name == 'permissions' else keystore / 'enclaves'
        put_public(place / f'{name}.xml', text.encode())
        put_public(folder / f'{name}.p7s', sign_document(signer, text))


def _list(member: Member) -> tuple[int, ...]:
    """List the serials of all certificates of a member."""
    return (*member.older, member.serial)


def _join(roots: Sequence[Credential]) -> bytes:
    """Return the certificates of the root as one file."""
    return b''.join(item.pem for item in roots)
