"""Why a peer refuses us, or we it: zenoh says a bare "Timeout!", so Python's ssl tries first."""

from __future__ import annotations

import contextlib
import ipaddress
import socket
import ssl
from dataclasses import dataclass
from datetime import datetime
from typing import Final

from swarm_ctl.trust.handshake import (
    Certificate,
    certificate_of,
    client_context,
    ignore_dates,
    load_pair,
)
from swarm_ctl.trust.identity import Identity
from swarm_ctl.trust.names import address_of

PATIENCE_S: Final = 3.0
_VERDICT_S: Final = 0.5
"""A server judges our certificate after its own part of the handshake: so long we wait for its
alert. One that accepts us waits for our first word."""
_EXPIRED, _NOT_YET = 10, 9
_DATES: Final = "out of date"
_CHAIN: Final = frozenset({2, 7, 18, 19, 20, 21})
"""OpenSSL's codes of a certificate that another CA issued."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What an endpoint of the mesh answered."""

    reached: bool
    """False: nothing listens there, or no packet arrives."""
    fault: str | None = None
    """Why no link would open, or nothing would be heard on it; None: all is well."""
    peer: str = ""
    """The common name of what answered, where its certificate is good."""


def explain_handshake(
    identity: Identity, endpoint: str, patience_s: float = PATIENCE_S
) -> str | None:
    """Why the mesh at `endpoint` (`tls/192.168.1.11:7447`) would refuse this identity, or the
    identity the mesh; None where it would not, or nothing answers there.

    Takes up to `patience_s` and half a second of the wall clock. Dates are judged by the system's
    clock, as zenoh does.
    """
    return ask(identity, endpoint, patience_s).fault


def ask(identity: Identity, endpoint: str, patience_s: float = PATIENCE_S) -> Answer:
    """As `explain_handshake`, and whether anything answers."""
    host, port = address_of(endpoint)
    try:
        raw = socket.create_connection((host, port), timeout=patience_s)
    except OSError:
        return Answer(reached=False)
    with raw:
        answer = _answer(identity, _client(identity), raw, endpoint)
    if answer.fault is _DATES:
        return Answer(True, _outdated(identity, (host, port), endpoint, patience_s))
    return answer


def _client(identity: Identity) -> ssl.SSLContext:
    context = client_context(identity.ca_file)
    context.check_hostname = False  # judged below, where its certificate can be named
    load_pair(context, identity.certificate_file, identity.key_file)
    return context


def _answer(
    identity: Identity, context: ssl.SSLContext, raw: socket.socket, endpoint: str
) -> Answer:
    try:
        with context.wrap_socket(raw) as link:
            peer = certificate_of(link.getpeercert() or {})
            link.settimeout(_VERDICT_S)
            closed = False
            with contextlib.suppress(TimeoutError):  # it waits for our first word: it accepts us
                closed = not link.recv(1)
            fault = f"{endpoint} closed the link after the handshake" if closed else None
            return Answer(True, _unnamed(identity, peer, endpoint) or fault, peer.common_name)
    except ssl.SSLCertVerificationError as error:
        return Answer(True, _unverified(identity, error, endpoint))
    except ssl.SSLError as error:
        return Answer(True, _refused(identity, error.reason or str(error), endpoint))
    except TimeoutError:
        within = f"{raw.gettimeout() or 0.0:g} s"
        why = f"answers no TLS within {within}: its mesh is open, or the way there is slow"
    except (OSError, ValueError) as error:
        why = f"broke off the handshake: {error}"
    return Answer(True, f"{endpoint} {why}; allowed: a mesh with trust")


def _outdated(
    identity: Identity, address: tuple[str, int], endpoint: str, patience_s: float
) -> str:
    """The dates of the other end's certificate: another handshake, which does not judge them."""
    context = _client(identity)
    ignore_dates(context)
    own = "swarm-ctl trust rotate, or a right clock on this machine"
    try:
        with (
            socket.create_connection(address, timeout=patience_s) as raw,
            context.wrap_socket(raw) as link,
        ):
            peer = certificate_of(link.getpeercert() or {})
    except (OSError, ValueError):
        return f"{endpoint}: its certificate is out of date; allowed: {own}"
    dates = f"not valid before {day(peer.not_before)}, expired on {day(peer.not_after)}"
    return (
        f"{endpoint}: by this machine's clock the certificate of {peer.common_name} is out of date"
        f" ({dates}); allowed: {own}"
    )


def _unverified(identity: Identity, error: ssl.SSLCertVerificationError, endpoint: str) -> str:
    """What is wrong with the certificate of the other end."""
    if error.verify_code in (_EXPIRED, _NOT_YET):
        return _DATES
    if error.verify_code in _CHAIN:
        return (
            f"{endpoint}: another CA issued its certificate: it is of another swarm than"
            f" {identity.swarm}, or of keys made anew; allowed: certificates of {identity.ca_file}"
        )
    return f"{endpoint}: its certificate is refused: {error.verify_message}"


def _refused(identity: Identity, reason: str, endpoint: str) -> str:
    """What the other end finds wrong with our certificate."""
    own = identity.common_name
    if "CERTIFICATE_EXPIRED" in reason:
        return (
            f"{endpoint} refuses {own}: by its clock it expired on"
            f" {day(identity.certificate.not_after)}, or is not valid yet; allowed: swarm-ctl trust"
            " rotate, or a right clock on that machine"
        )
    if "UNKNOWN_CA" in reason or "CERTIFICATE_UNKNOWN" in reason or "DECRYPT" in reason:
        return (
            f"{endpoint} refuses {own}: it trusts another CA: it is of another swarm, or of keys"
            " made anew; allowed: a bundle of the same `swarm-ctl trust new` on both"
        )
    if "WRONG_VERSION" in reason or "RECORD_LAYER" in reason or "EOF" in reason:
        return f"{endpoint} speaks no TLS: its mesh is open; allowed: a mesh with trust"
    return f"{endpoint} refuses {own}: {reason.lower().replace('_', ' ')}"


def _unnamed(identity: Identity, peer: Certificate, endpoint: str) -> str | None:
    """What our own rules say to a peer whose certificate is good."""
    host, _ = address_of(endpoint)
    if not any(same_host(host, each) for each in peer.hosts):
        hosts = ", ".join(each for each in peer.hosts if each != peer.common_name) or "none"
        return (
            f"{endpoint}: the certificate of {peer.common_name} is for another address: {hosts};"
            f" allowed: one for {host} (swarm-ctl trust rotate --fleet FILE)"
        )
    entry = identity.roster.entry(peer.common_name)
    roster = f"the roster of epoch {identity.epoch}"
    if entry is not None and entry.revoked:
        return f"{endpoint}: refused by permissions: {peer.common_name} was revoked"
    if entry is None or entry.epoch != identity.epoch:
        return (
            f"{endpoint}: refused by permissions: {roster} does not name {peer.common_name};"
            " allowed: bundles of one day on all hosts (swarm-ctl trust install)"
        )
    return None


def same_host(one: str, other: str) -> bool:
    """Whether two texts name one address, however it is written, or one name."""
    try:
        return ipaddress.ip_address(one) == ipaddress.ip_address(other)
    except ValueError:
        return one.lower() == other.lower()


def day(when: datetime) -> str:
    """A date and a time of day for a text."""
    return f"{when:%Y-%m-%d %H:%M} UTC"
