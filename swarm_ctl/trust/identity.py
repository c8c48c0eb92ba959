"""An identity: one folder with what proves to a swarm who this process is."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Final

from swarm_ctl.errors import TrustError
from swarm_ctl.trust.files import guard, read_guarded
from swarm_ctl.trust.handshake import Certificate, presented
from swarm_ctl.trust.names import KeyHolder, Role, member_of
from swarm_ctl.trust.roster import Roster, read_roster

KEY: Final = "mesh.key"
CERTIFICATE: Final = "mesh.crt"
CA: Final = "ca.crt"
MAVLINK_KEY: Final = "mavlink.key"
STAMP: Final = "stamp"
MAVLINK_KEY_BYTES: Final = 32
CA_FOLDER: Final = "ca"
CA_KEY: Final = "ca.key"
"""The CA's own, on the computer that keeps it."""


@dataclass(frozen=True, slots=True)
class Identity:
    """A member of a swarm, and the files that prove it. zenoh reads the PEM files itself."""

    folder: Path
    member: KeyHolder
    certificate: Certificate
    roster: Roster
    mavlink_key: bytes | None = field(repr=False)
    """The 32 bytes that sign the vehicle's link; None: there are none."""

    @property
    def common_name(self) -> str:
        """`agent-3.outdoors.e1`."""
        return self.certificate.common_name

    @property
    def role(self) -> Role:
        """What it may do."""
        return self.member.role

    @property
    def name(self) -> str:
        """The agent's id, the operator's or the viewer's name."""
        return self.member.name

    @property
    def agent_id(self) -> int:
        """The agent's id; TrustError for an operator or a viewer."""
        if self.role is not Role.AGENT:
            raise TrustError(f"{self.folder}: is {self.member}; allowed: an agent's identity")
        return int(self.name)

    @property
    def swarm(self) -> str:
        """The swarm's name on the mesh, the S in `swarm/S/...`."""
        return self.roster.swarm

    @property
    def epoch(self) -> int:
        """The roster's."""
        return self.roster.epoch

    @property
    def key_file(self) -> Path:
        """The private key, PEM."""
        return self.folder / KEY

    @property
    def certificate_file(self) -> Path:
        """Its certificate, PEM."""
        return self.folder / CERTIFICATE

    @property
    def ca_file(self) -> Path:
        """The certificate of the swarm's CA, PEM."""
        return self.folder / CA

    @property
    def stamp_file(self) -> Path:
        """Where the last MAVLink signing stamp is kept (module `stamp`)."""
        return self.folder / STAMP


def load_identity(folder: Path) -> Identity:
    """The identity in a folder such as `trust/outdoors/agent-3`.

    The dates of its certificate are not judged here: an agent that starts again in flight must not
    end it (`certificates_end` for the pre-flight check).

    Raises:
        TrustError: a file is missing, damaged or readable by others, the roster is not the CA's, or
            does not name this certificate in its present epoch.
    """
    return load_member(folder, member_of(folder.resolve().name))


def load_member(folder: Path, member: KeyHolder) -> Identity:
    """As `load_identity`, from a folder of any name."""
    guard(folder)
    for name in (KEY, CERTIFICATE, CA):
        read_guarded(folder / name)
    certificate = presented(folder / CERTIFICATE, folder / KEY, folder / CA)
    roster = read_roster(folder, folder / CA)
    _refuse_unnamed(roster, certificate, member, folder)
    return Identity(folder, member, certificate, roster, _mavlink_key(folder / MAVLINK_KEY))


def identity_folder(trust: Path, role: Role, name: str | None = None) -> Path:
    """The folder of a member in a trust folder. Without a name: the only one of this role.

    Raises:
        TrustError: there is none, or without a name several.
    """
    found = sorted(path.name for path in trust.glob(f"{role}-*") if path.is_dir())
    if name is not None:
        found = [each for each in found if each == KeyHolder(role, name).folder]
    if len(found) == 1:
        return trust / found[0]
    what = f"{role} {name}" if name else str(role)
    if not found:
        raise TrustError(f"{trust}: has no {what}; allowed: one that `swarm-ctl trust add` made")
    raise TrustError(f"{trust}: has {', '.join(found)}; allowed: name one of them")


def certificates_end(identity: Identity) -> datetime:
    """When the identity's certificate ends (UTC): a take-off too near to it is refused, a flight
    never ended by it."""
    return identity.certificate.not_after


def _refuse_unnamed(
    roster: Roster, certificate: Certificate, member: KeyHolder, folder: Path
) -> None:
    entry = roster.entry(certificate.common_name)
    wanted = member.common_name(roster.swarm, roster.epoch)
    again = "copy its bundle to this host again, and `swarm-ctl trust install` it"
    if entry is not None and entry.revoked:
        raise TrustError(f"{folder}: {entry.common_name} was revoked; allowed: {wanted}")
    if certificate.common_name != wanted:
        raise TrustError(
            f"{folder}: the certificate is {certificate.common_name}'s, and the roster is of epoch"
            f" {roster.epoch} of swarm {roster.swarm}; allowed: {wanted}: {again}"
        )
    if entry is None or entry.serial != certificate.serial:
        raise TrustError(
            f"{folder}: the roster does not name this certificate of {wanted}"
            f" (serial {certificate.serial}); allowed: {entry.serial if entry else 'none'}: {again}"
        )


def _mavlink_key(path: Path) -> bytes | None:
    if not path.exists():
        return None
    key = read_guarded(path)
    if len(key) != MAVLINK_KEY_BYTES:
        raise TrustError(f"{path}: has {len(key)} bytes; allowed: {MAVLINK_KEY_BYTES}")
    return key
