# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Keys and certificates: a certificate authority, issuing, and revocation."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta, UTC
import ipaddress

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    load_pem_private_key,
    NoEncryption,
    PrivateFormat,
)
from cryptography.hazmat.primitives.serialization.pkcs7 import (
    PKCS7Options,
    PKCS7SignatureBuilder,
)
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from plc_inspect.errors import ConfigError

SLACK = timedelta(minutes=10)
"""Certificates are valid from this long before they are made, as the clocks of a fleet differ."""
MOST_DAYS = 3650
MOST_AUTHORITY_DAYS = 2 * MOST_DAYS


@dataclass(frozen=True, slots=True)
class Credential:
    """A certificate and its private key (P-256, which DDS Security and TLS both take)."""

    key: ec.EllipticCurvePrivateKey
    certificate: x509.Certificate

    @property
    def key_pem(self) -> bytes:
        """The private key as unencrypted PEM, as a vehicle starts unattended."""
        return self.key.private_bytes(
            Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()
        )

    @property
    def pem(self) -> bytes:
        """The certificate as PEM."""
        return self.certificate.public_bytes(Encoding.PEM)


def make_authority(
    name: str, days: int, now: datetime | None = None,
    key: ec.EllipticCurvePrivateKey | None = None,
) -> Credential:
    """
    Make a self-signed authority.

    Parameters
    ----------
    name : str
        Common name.
    days : int
        Validity [d].
    now : datetime or None
        With its time zone; None for the present.
    key : EllipticCurvePrivateKey or None
        Of an authority of this name that it continues: each verifies what the other signed.

    Returns
    -------
    Credential

    Raises
    ------
    ConfigError
        ``days`` is outside 1 to 7300.

    """
    key = ec.generate_private_key(ec.SECP256R1()) if key is None else key
    subject = _name(name)
    builder = _begin(subject, subject, key.public_key(), days, now, MOST_AUTHORITY_DAYS)
    usage = _usage(key_cert_sign=True, crl_sign=True, digital_signature=True)
    builder = builder.add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
    builder = builder.add_extension(usage, critical=True)
    builder = builder.add_extension(
        x509.AuthorityKeyIdentifier.from_issuer_public_key(key.public_key()), critical=False
    )
    return Credential(key, builder.sign(key, hashes.SHA256()))


def issue(
    authority: Credential, name: str, days: int, hosts: Sequence[str] = (),
    now: datetime | None = None,
) -> Credential:
    """
    Issue a certificate with a new key.

    Parameters
    ----------
    authority : Credential
        Who signs.
    name : str
        Common name; of an SROS2 enclave its path.
    hosts : sequence of str
        Names and addresses of a server, empty for a certificate that browsers never see.
    days, now
        As for ``make_authority``, with the same error, but of 3650 days at most.

    Returns
    -------
    Credential

    """
    key = ec.generate_private_key(ec.SECP256R1())
    issuer = authority.certificate.subject
    builder = _begin(_name(name), issuer, key.public_key(), days, now)
    builder = builder.add_extension(
        x509.BasicConstraints(ca=False, path_length=None), critical=True
    )
    builder = builder.add_extension(_usage(digital_signature=True), critical=True)
    builder = builder.add_extension(
        x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]),
        critical=False,
    )
    builder = builder.add_extension(
        x509.AuthorityKeyIdentifier.from_issuer_public_key(authority.key.public_key()),
        critical=False,
    )
    if hosts:
        builder = builder.add_extension(
            x509.SubjectAlternativeName([_general_name(host) for host in hosts]), critical=False
        )
    return Credential(key, builder.sign(authority.key, hashes.SHA256()))


def make_revocation_list(
    authority: Credential, serials: Iterable[int], days: int, now: datetime | None = None
) -> bytes:
    """
    Make the certificate revocation list (CRL) of an authority.

    Parameters
    ----------
    authority : Credential
        Who signs.
    serials : iterable of int
        Serial numbers of the revoked certificates.
    days : int
        Validity of the list [d].
    now : datetime or None
        With its time zone; None for the present.

    Returns
    -------
    bytes
        PEM.

    """
    time = _whole_second(now)
    builder = x509.CertificateRevocationListBuilder(
        issuer_name=authority.certificate.subject, last_update=time - SLACK,
        next_update=time + timedelta(days=days),
    )
    builder = builder.add_extension(
        x509.AuthorityKeyIdentifier.from_issuer_public_key(authority.key.public_key()),
        critical=False,
    )
    builder = builder.add_extension(x509.CRLNumber(int(time.timestamp())), critical=False)
    for serial in sorted(serials):
        entry = x509.RevokedCertificateBuilder(serial_number=serial, revocation_date=time)
        builder = builder.add_revoked_certificate(entry.build())
    return builder.sign(authority.key, hashes.SHA256()).public_bytes(Encoding.PEM)


def sign_document(authority: Credential, text: str) -> bytes:
    """Return a text as S/MIME with a detached signature, as DDS Security requires."""
    builder = PKCS7SignatureBuilder().set_data(text.encode())
    builder = builder.add_signer(authority.certificate, authority.key, hashes.SHA256())
    return builder.sign(Encoding.SMIME, [PKCS7Options.Text, PKCS7Options.DetachedSignature])


def load_credential(key_pem: bytes, pem: bytes) -> Credential:
    """
    Read a certificate and its key.

    Raises
    ------
    ConfigError
        They are not PEM, the key is of another kind, or they do not belong together.

    """
    return load_credentials(key_pem, pem)[0]


def load_credentials(key_pem: bytes, pem: bytes) -> list[Credential]:
    """Read certificates of one key, in their order; errors as for ``load_credential``."""
    try:
        key = load_pem_private_key(key_pem, None)
        certificates = x509.load_pem_x509_certificates(pem)
    except (ValueError, TypeError) as error:
        raise ConfigError(f'key or certificate cannot be read: {error}') from error
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise ConfigError(f'a key of kind {type(key).__name__}, expected an elliptic curve')
    if any(key.public_key() != item.public_key() for item in certificates):
        raise ConfigError('key and certificate do not belong together')
    return [Credential(key, item) for item in certificates]


def read_end(pem: bytes) -> datetime:
    """
    Return the end of validity of a certificate, in UTC.

    Raises
    ------
    ConfigError
        It is not a certificate.

    """
    try:
        certificate = x509.load_pem_x509_certificate(pem)
    except ValueError as error:
        raise ConfigError(f'certificate cannot be read: {error}') from error
    return find_end(certificate)


def find_end(certificate: x509.Certificate) -> datetime:
    """Return the end of validity of a certificate, in UTC."""
    end = getattr(certificate, 'not_valid_after_utc', None)
    if end is None:  # cryptography before 42
        end = certificate.not_valid_after.replace(tzinfo=UTC)
    return end


def _begin(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePublicKey, days: int,
    now: datetime | None, most: int = MOST_DAYS,
) -> x509.CertificateBuilder:
    if not 1 <= days <= most:
        raise ConfigError(f'certificates hold for 1 to {most} days, not {days}')
    time = _whole_second(now)
    builder = x509.CertificateBuilder(
        subject_name=subject, issuer_name=issuer, public_key=key,
        serial_number=x509.random_serial_number(), not_valid_before=time - SLACK,
        not_valid_after=time + timedelta(days=days),
    )
    return builder.add_extension(x509.SubjectKeyIdentifier.from_public_key(key), critical=False)


def _whole_second(now: datetime | None) -> datetime:
    return (datetime.now(UTC) if now is None else now).replace(microsecond=0)


def _name(text: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text)])


def _usage(
    *, digital_signature: bool = False, key_cert_sign: bool = False, crl_sign: bool = False
) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=digital_signature, key_cert_sign=key_cert_sign, crl_sign=crl_sign,
        content_commitment=False, key_encipherment=False, data_encipherment=False,
        key_agreement=False, encipher_only=False, decipher_only=False,
    )


def _general_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)
