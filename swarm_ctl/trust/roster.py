"""The roster: whom a swarm knows. Its CA signs it.

The signature is a certificate that the CA issued for the SHA-256 of the roster's bytes, with a key
that is worthless elsewhere: with no address and for servers alone, it opens no link. So Python's
own ssl verifies a roster, and an agent needs no library for it.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from swarm_ctl.errors import TrustError
from swarm_ctl.trust.files import read_guarded
from swarm_ctl.trust.handshake import presented
from swarm_ctl.trust.names import KeyHolder, Role, checked_swarm

ROSTER: Final = "roster.json"
SEAL: Final = "roster.pem"
_VERSION: Final = 1


@dataclass(frozen=True, slots=True)
class Entry:
    """One certificate that the CA has issued."""

    common_name: str
    role: Role
    name: str
    """The agent's id, the operator's or the viewer's name."""
    serial: str
    """In hexadecimal digits."""
    not_after: datetime
    epoch: int
    host: str = ""
    """The address that the certificate is for; '': it never listens."""
    revoked: bool = False

    @property
    def member(self) -> KeyHolder:
        """Its owner."""
        return KeyHolder(self.role, self.name)


@dataclass(frozen=True, slots=True)
class Roster:
    """All certificates of a swarm's present epoch, and those that were revoked."""

    swarm: str
    epoch: int
    entries: tuple[Entry, ...]

    @property
    def current(self) -> tuple[Entry, ...]:
        """The entries that access rules may name."""
        return tuple(each for each in self.entries if each.epoch == self.epoch and not each.revoked)

    def entry(self, common_name: str) -> Entry | None:
        """The entry of a common name."""
        return next((each for each in self.entries if each.common_name == common_name), None)

    def of(self, member: KeyHolder) -> Entry | None:
        """The present entry of a member."""
        return next((each for each in self.current if each.member == member), None)

    def to_bytes(self) -> bytes:
        """The roster's file."""
        entries = [
            {
                "common_name": each.common_name,
                "role": each.role,
                "name": each.name,
                "serial": each.serial,
                "not_after": each.not_after.isoformat(),
                "epoch": each.epoch,
                "host": each.host,
                "revoked": each.revoked,
            }
            for each in self.entries
        ]
        document = {"version": _VERSION, "swarm": self.swarm, "epoch": self.epoch}
        return json.dumps({**document, "entries": entries}, indent=1).encode() + b"\n"


def digest(roster: bytes) -> str:
    """What the CA signs."""
    return hashlib.sha256(roster).hexdigest()


def read_roster(folder: Path, ca: Path) -> Roster:
    """The roster in a folder, signed by `ca`; TrustError where it is missing, damaged, changed, or
    another CA's."""
    path = folder / ROSTER
    data = read_guarded(path)
    seal = presented(folder / SEAL, folder / SEAL, ca)
    if seal.common_name != digest(data):
        raise TrustError(
            f"{path}: its signature is of another text: the roster was changed, or its two files"
            f" are of different days; allowed: both as `swarm-ctl trust` wrote them"
        )
    return parse(data, path)


def parse(data: bytes, where: Path) -> Roster:
    """The roster of these bytes, unverified (`read_roster` verifies); TrustError where they
    are none."""
    try:
        return _roster(json.loads(data))
    except (KeyError, TypeError, ValueError, RecursionError, TrustError) as error:
        raise TrustError(f"{where}: is no roster of version {_VERSION}: {error}") from None


def _roster(document: Mapping[str, Any]) -> Roster:
    if document["version"] != _VERSION:
        raise ValueError(f"version {document['version']}")
    entries = tuple(_entry(each) for each in document["entries"])
    return Roster(checked_swarm(document["swarm"]), int(document["epoch"]), entries)


def _entry(fields: Mapping[str, Any]) -> Entry:
    member = KeyHolder(Role(fields["role"]), str(fields["name"]))
    ends = datetime.fromisoformat(fields["not_after"])
    identity = (str(fields["common_name"]), member.role, member.name, str(fields["serial"]), ends)
    return Entry(*identity, int(fields["epoch"]), str(fields["host"]), bool(fields["revoked"]))
