"""TLS handshakes by Python's ssl: in memory, to read and verify a certificate; over a socket, to
explain what zenoh calls a bare "Timeout!"."""

from __future__ import annotations

import contextlib
import ssl
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from swarm_ctl.errors import TrustError

_IGNORE_DATES: Final = 0x200000
"""OpenSSL's X509_V_FLAG_NO_CHECK_TIME, which Python's ssl does not name."""


@dataclass(frozen=True, slots=True)
class Certificate:
    """What a certificate says."""

    common_name: str
    serial: str
    not_before: datetime
    not_after: datetime
    hosts: tuple[str, ...]
    """The addresses and names that it is for."""


def presented(certificate: Path, key: Path, ca: Path) -> Certificate:
    """What the certificate says, verified in a handshake in memory: `ca` issued it, and the key is
    its own. Dates are not judged.

    Raises:
        TrustError: a file is missing or damaged, the key is another's, or another CA issued it.
    """
    server = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    client = client_context(ca)
    client.check_hostname = False
    ignore_dates(client)
    load_pair(server, certificate, key)
    to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
    ends = (
        client.wrap_bio(to_client, to_server),
        server.wrap_bio(to_server, to_client, server_side=True),
    )
    try:
        for _ in range(3):
            for end in ends:
                with contextlib.suppress(ssl.SSLWantReadError):
                    end.do_handshake()
        return certificate_of(ends[0].getpeercert() or {})
    except (ssl.SSLError, ValueError) as error:
        why = getattr(error, "verify_message", "") or str(error)
        raise TrustError(
            f"{certificate}: {ca} does not vouch for it ({why});"
            " allowed: a certificate of this swarm's CA"
        ) from None


def authority(certificate: Path, key: Path) -> Certificate:
    """What a CA's certificate says; TrustError where it is none, or the key is another's."""
    load_pair(ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER), certificate, key)
    found = client_context(certificate).get_ca_certs()
    if len(found) != 1:
        raise TrustError(f"{certificate}: is no CA's certificate; allowed: as `trust new` made it")
    return certificate_of(found[0])


def client_context(ca: Path) -> ssl.SSLContext:
    """A TLS client that trusts `ca` alone; TrustError where the file holds no certificate."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    try:
        context.load_verify_locations(ca)
    except OSError as error:  # ssl.SSLError, too
        raise TrustError(f"{ca}: is no certificate: {_reason(error)}") from None
    return context


def ignore_dates(context: ssl.SSLContext) -> None:
    """Verify all of a certificate but its dates."""
    context.verify_flags |= ssl.VerifyFlags(_IGNORE_DATES)


def load_pair(context: ssl.SSLContext, certificate: Path, key: Path) -> None:
    """Load a certificate and its key; TrustError where one can't be read, or they are no pair."""
    for path in (certificate, key):
        if not path.is_file():
            raise TrustError(f"{path}: is missing; allowed: as `swarm-ctl trust` made it")
    try:
        context.load_cert_chain(certificate, key)
    except ssl.SSLError as error:
        if error.reason == "KEY_VALUES_MISMATCH":
            raise TrustError(f"{key}: is not the key of {certificate}; allowed: its own") from None
        files = ", ".join(map(str, dict.fromkeys((certificate, key))))
        raise TrustError(
            f"{files}: no certificate and key; allowed: as `swarm-ctl trust` made it"
        ) from None


def certificate_of(fields: Mapping[str, Any]) -> Certificate:
    """From what Python's ssl tells of a verified peer; ValueError where something is missing."""
    try:
        names = [
            value for part in fields["subject"] for name, value in part if name == "commonName"
        ]
        before, after = (
            datetime.fromtimestamp(ssl.cert_time_to_seconds(fields[each]), UTC)
            for each in ("notBefore", "notAfter")
        )
        serial = f"{int(fields['serialNumber'], 16):x}"
        (common_name,) = names
    except KeyError as error:
        raise ValueError(f"the certificate has no {error}") from None
    hosts = tuple(value for _, value in fields.get("subjectAltName", ()))
    return Certificate(common_name, serial, before, after, hosts)


def _reason(error: OSError) -> str:
    return error.strerror or str(error)
