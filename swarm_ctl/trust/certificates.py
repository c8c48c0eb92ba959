"""Makes keys, certificates and the roster's signature. The only module that imports cryptography;
reading and verifying is Python's own ssl (module `handshake`)."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Final, TypeAlias

from cryptography import x509
from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from swarm_ctl.errors import TrustError
from swarm_ctl.trust.files import read_guarded
from swarm_ctl.trust.roster import digest

_CA_DAYS: Final = 5 * 365
_CLOCKS_DIFFER: Final = timedelta(minutes=10)
"""A certificate begins so long before it was made: the host's clock may be behind."""
_BOTH: Final = (ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH)
_DAMAGED: Final = (ValueError, TypeError, UnsupportedAlgorithm, x509.InvalidVersion)
"""What cryptography raises for bytes that are not what they say."""
PublicKey: TypeAlias = ec.EllipticCurvePublicKey


@dataclass(frozen=True, slots=True)
class Issued:
    """A certificate that was made."""

    pem: bytes
    serial: str
    not_after: datetime


def new_key() -> ec.EllipticCurvePrivateKey:
    """A private key on the curve P-256."""
    return ec.generate_private_key(ec.SECP256R1())


def key_pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    """A private key's file."""
    no = serialization.NoEncryption()
    text: bytes = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, no
    )
    return text


def request(common_name: str, key: ec.EllipticCurvePrivateKey) -> bytes:
    """A request (CSR) for a certificate of this key."""
    builder = x509.CertificateSigningRequestBuilder().subject_name(_named(common_name))
    pem: bytes = builder.sign(key, hashes.SHA256()).public_bytes(serialization.Encoding.PEM)
    return pem


def requested(pem: bytes, where: Path) -> tuple[str, PublicKey]:
    """Common name and public key of a request; TrustError where it is none, is not signed by its
    own key, or the key is of another kind."""
    try:
        found = x509.load_pem_x509_csr(pem)
        key, valid = found.public_key(), found.is_signature_valid
        (name,) = found.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    except _DAMAGED as error:
        raise TrustError(f"{where}: is no certificate request: {error}") from None
    if (
        not valid
        or not isinstance(key, ec.EllipticCurvePublicKey)
        or not isinstance(key.curve, ec.SECP256R1)
    ):
        raise TrustError(f"{where}: allowed: a request for a P-256 key, signed by that key")
    return str(name.value), key


def public_key(certificate: bytes, where: Path) -> PublicKey:
    """The public key of a certificate; TrustError where it is none, or of another kind."""
    try:
        key = x509.load_pem_x509_certificate(certificate).public_key()
    except _DAMAGED as error:
        raise TrustError(f"{where}: is no certificate: {error}") from None
    if not isinstance(key, ec.EllipticCurvePublicKey):
        raise TrustError(f"{where}: has a key of another kind; allowed: P-256")
    return key


class Authority:
    """A swarm's CA."""

    def __init__(self, key: ec.EllipticCurvePrivateKey, certificate: x509.Certificate) -> None:
        self._key = key
        self._certificate = certificate
        self.pem: Final = certificate.public_bytes(serialization.Encoding.PEM)
        """Its certificate."""

    @classmethod
    def new(cls, swarm: str, now: datetime) -> Authority:
        """A CA with a new key, for five years."""
        key, name = new_key(), _named(f"ca.{swarm}")
        builder = _builder(name, name, key.public_key(), now, now + timedelta(days=_CA_DAYS))
        may_sign = _usage(key_cert_sign=True, crl_sign=True)
        builder = builder.add_extension(x509.BasicConstraints(ca=True, path_length=0), True)
        builder = builder.add_extension(may_sign, True)
        return cls(key, builder.sign(key, hashes.SHA256()))

    @classmethod
    def load(cls, key: Path, certificate: Path) -> Authority:
        """The CA of these files; TrustError where one is missing, damaged or readable by others."""
        try:
            loaded = serialization.load_pem_private_key(read_guarded(key), password=None)
            found = x509.load_pem_x509_certificate(read_guarded(certificate))
        except _DAMAGED as error:
            raise TrustError(f"{key}, {certificate}: no CA: {error}") from None
        if not isinstance(loaded, ec.EllipticCurvePrivateKey):
            raise TrustError(f"{key}: is a key of another kind; allowed: P-256")
        if loaded.public_key() != found.public_key():
            raise TrustError(f"{key}: is not the key of {certificate}; allowed: its own")
        return cls(loaded, found)

    @property
    def key(self) -> bytes:
        """Its private key's file."""
        return key_pem(self._key)

    def issue(
        self, common_name: str, key: PublicKey, host: str, now: datetime, days: int
    ) -> Issued:
        """A certificate for servers and clients, of this name and for this address ('': none)."""
        ends = min(now + timedelta(days=days), self._certificate.not_valid_after_utc)
        builder = self._leaf(common_name, key, now, ends)
        hosts = [x509.DNSName(common_name), *([_host(host)] if host else [])]
        builder = builder.add_extension(x509.SubjectAlternativeName(hosts), False)
        builder = builder.add_extension(x509.ExtendedKeyUsage(_BOTH), False)
        made = builder.sign(self._key, hashes.SHA256())
        pem = made.public_bytes(serialization.Encoding.PEM)
        return Issued(pem, f"{made.serial_number:x}", made.not_valid_after_utc)

    def seal(self, roster: bytes, now: datetime) -> bytes:
        """The signature of a roster (module `roster`)."""
        key = new_key()
        ends = self._certificate.not_valid_after_utc
        builder = self._leaf(digest(roster), key.public_key(), now, ends)
        for_servers = x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH])
        made = builder.add_extension(for_servers, False).sign(self._key, hashes.SHA256())
        pem: bytes = made.public_bytes(serialization.Encoding.PEM)
        return pem + key_pem(key)

    def _leaf(
        self, common_name: str, key: PublicKey, now: datetime, ends: datetime
    ) -> x509.CertificateBuilder:
        builder = _builder(_named(common_name), self._certificate.subject, key, now, ends)
        own = x509.AuthorityKeyIdentifier.from_issuer_public_key(self._key.public_key())
        builder = builder.add_extension(x509.BasicConstraints(ca=False, path_length=None), True)
        return builder.add_extension(own, False).add_extension(_usage(digital_signature=True), True)


def _builder(
    subject: x509.Name, issuer: x509.Name, key: PublicKey, now: datetime, ends: datetime
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _CLOCKS_DIFFER)
        .not_valid_after(ends)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key), False)
    )


def _usage(**given: bool) -> x509.KeyUsage:
    none = dict.fromkeys(
        (
            "digital_signature",
            "content_commitment",
            "key_encipherment",
            "data_encipherment",
            "key_agreement",
            "key_cert_sign",
            "crl_sign",
            "encipher_only",
            "decipher_only",
        ),
        False,
    )
    return x509.KeyUsage(**{**none, **given})


def _named(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)
