"""Makes and changes a trust folder, on the computer that keeps the CA. cryptography is imported
only when it does.

trust/outdoors/  roster.json  roster.pem  ca/{ca.key,ca.crt}
    agent-3/{mesh.key,mesh.crt,ca.crt,roster.json,roster.pem,mavlink.key}  agent-3.bundle
    operator-anna/  viewer-tv/
"""

from __future__ import annotations

import dataclasses
import secrets
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Final

from swarm_ctl.errors import TrustError
from swarm_ctl.trust import identity
from swarm_ctl.trust.bundle import pack
from swarm_ctl.trust.files import (
    changed_folder,
    new_folder,
    read_guarded,
    read_plain,
    write_private,
)
from swarm_ctl.trust.identity import CA_FOLDER, CA_KEY
from swarm_ctl.trust.names import LOOPBACK, KeyHolder, Role, checked_host, checked_swarm, member_of
from swarm_ctl.trust.roster import ROSTER, SEAL, Entry, Roster, read_roster

if TYPE_CHECKING:
    from swarm_ctl.trust.certificates import Authority, PublicKey

DAYS: Final = 30


@dataclass(frozen=True, slots=True)
class Terms:
    """What new certificates have in common."""

    now: datetime
    days: int = DAYS
    requests: Mapping[KeyHolder, PublicKey] = field(default_factory=dict)
    """The members whose private key stays on their own host."""


def new(
    folder: Path,
    swarm: str,
    agents: Mapping[int, str],
    operators: Iterable[str],
    viewers: Iterable[str],
    terms: Terms,
    routers: Iterable[str] = (),
) -> None:
    """A new CA, and everything for these members.

    Args:
        folder: not there yet.
        agents: each agent's address on the mesh, such as 192.168.1.11. An operator's station
            listens on the loopback interface alone.
        routers: the address of each host's router, in a large swarm; they are numbered from 1.

    Raises:
        TrustError: the folder is there, or a name or an address can't be used.
    """
    members = {
        KeyHolder(Role.AGENT, str(agent)): checked_host(host) for agent, host in agents.items()
    }
    numbered = enumerate(routers, 1)
    members |= {KeyHolder(Role.ROUTER, str(k)): checked_host(host) for k, host in numbered}
    members |= {KeyHolder(Role.OPERATOR, name): LOOPBACK for name in operators}
    members |= {KeyHolder(Role.VIEWER, name): "" for name in viewers}
    unused = set(terms.requests) - set(members)
    if unused:
        asked, known = (", ".join(map(str, each)) for each in (unused, members))
        raise TrustError(f"a request is for {asked}; allowed: {known}")
    from swarm_ctl.trust.certificates import Authority

    authority = Authority.new(checked_swarm(swarm), terms.now)
    with new_folder(folder) as made:
        write_private(made / ".gitignore", b"*\n")  # keys belong in no repository
        (made / CA_FOLDER).mkdir(mode=0o700)
        write_private(made / CA_FOLDER / CA_KEY, authority.key)
        write_private(made / CA_FOLDER / identity.CA, authority.pem)
        entries = [
            _certify(made, authority, (swarm, 1), (member, host), terms)
            for member, host in members.items()
        ]
        _publish(made, authority, Roster(swarm, 1, tuple(entries)), terms.now)


def add(folder: Path, member: KeyHolder, host: str, terms: Terms) -> None:
    """One more member, in the present epoch. `host`: its address on the mesh, of one that
    listens."""
    host = checked_host(host) if host else ""
    with changed_folder(folder) as made:
        authority, roster = opened(made)
        if roster.of(member) is not None:
            raise TrustError(
                f"{folder}: has {member} already; allowed: trust revoke {member} before, or trust"
                " rotate for new certificates of all"
            )
        entry = _certify(made, authority, (roster.swarm, roster.epoch), (member, host), terms)
        grown = dataclasses.replace(roster, entries=(*roster.entries, entry))
        _publish(made, authority, grown, terms.now)


def revoke(folder: Path, member: KeyHolder, terms: Terms) -> None:
    """A new epoch without this member."""
    with changed_folder(folder) as made:
        authority, roster = opened(made)
        if roster.of(member) is None:
            known = ", ".join(str(each.member) for each in roster.current)
            raise TrustError(f"{folder}: has no {member}; allowed: {known}")
        _next_epoch(made, authority, roster, terms, gone=member)
        for path in (made / member.folder).iterdir():
            path.unlink()
        (made / member.folder).rmdir()
        (made / f"{member.folder}.bundle").unlink(missing_ok=True)


def rotate(folder: Path, terms: Terms, hosts: Mapping[KeyHolder, str] | None = None) -> None:
    """A new epoch: new certificates for all, for new addresses (`hosts`) where given. A
    private key that is here is made anew, one on its own host stays; MAVLink keys stay, they are in
    the vehicles."""
    moved = {member: checked_host(host) for member, host in (hosts or {}).items()}
    with changed_folder(folder) as made:
        authority, roster = opened(made)
        entries = tuple(
            dataclasses.replace(each, host=moved.get(each.member, each.host))
            for each in roster.entries
        )
        _next_epoch(made, authority, dataclasses.replace(roster, entries=entries), terms)


def request_of(path: Path) -> tuple[KeyHolder, PublicKey]:
    """The member that asks for a certificate by a request (CSR), and its public key."""
    from swarm_ctl.trust.certificates import requested

    name, key = requested(read_plain(path), path)
    return member_of(name.split(".", 1)[0]), key


def request(folder: Path, member: KeyHolder) -> bytes:
    """On a member's own host: a private key in a new folder of the trust folder, and the request
    (CSR) that asks the CA for its certificate."""
    from swarm_ctl.trust.certificates import key_pem, new_key, request

    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    with new_folder(folder / member.folder) as made:
        key = new_key()
        write_private(made / identity.KEY, key_pem(key))
        return request(member.folder, key)


def opened(folder: Path) -> tuple[Authority, Roster]:
    """The CA and the roster of a trust folder; TrustError where one is missing, damaged or readable
    by others."""
    from swarm_ctl.trust.certificates import Authority

    ca = folder / CA_FOLDER / identity.CA
    authority = Authority.load(folder / CA_FOLDER / CA_KEY, ca)
    return authority, read_roster(folder, ca)


def _next_epoch(
    made: Path, authority: Authority, roster: Roster, terms: Terms, gone: KeyHolder | None = None
) -> None:
    epoch = (roster.swarm, roster.epoch + 1)
    revoked = [each for each in roster.entries if each.revoked or each.member == gone]
    entries = [
        *(dataclasses.replace(each, revoked=True) for each in revoked),
        *(
            _certify(made, authority, epoch, (each.member, each.host), terms)
            for each in roster.current
            if each.member != gone
        ),
    ]
    _publish(made, authority, Roster(*epoch, tuple(entries)), terms.now)


def _certify(
    made: Path,
    authority: Authority,
    epoch: tuple[str, int],
    whom: tuple[KeyHolder, str],
    terms: Terms,
) -> Entry:
    """Key (where it is made here), certificate, CA and MAVLink key of a member, in its folder."""
    member, host = whom
    folder = made / member.folder
    folder.mkdir(mode=0o700, exist_ok=True)
    issued = authority.issue(
        member.common_name(*epoch), _public_key(folder, member, terms), host, terms.now, terms.days
    )
    write_private(folder / identity.CERTIFICATE, issued.pem)
    write_private(folder / identity.CA, authority.pem)
    if member.role is Role.AGENT and not (folder / identity.MAVLINK_KEY).exists():
        key = secrets.token_bytes(identity.MAVLINK_KEY_BYTES)
        write_private(folder / identity.MAVLINK_KEY, key)
    name = (member.common_name(*epoch), member.role, member.name)
    return Entry(*name, issued.serial, issued.not_after, epoch[1], host)


def _public_key(folder: Path, member: KeyHolder, terms: Terms) -> PublicKey:
    from swarm_ctl.trust.certificates import key_pem, new_key, public_key

    certificate = folder / identity.CERTIFICATE
    if member in terms.requests:
        return terms.requests[member]
    if certificate.exists() and not (folder / identity.KEY).exists():  # the key is on its own host
        return public_key(read_guarded(certificate), certificate)
    key = new_key()
    write_private(folder / identity.KEY, key_pem(key))
    return key.public_key()


def _publish(made: Path, authority: Authority, roster: Roster, now: datetime) -> None:
    """The signed roster into the trust folder and all its members', and their bundles."""
    text = roster.to_bytes()
    seal = authority.seal(text, now)
    folders = [made / each.member.folder for each in roster.current]
    for folder in (made, *folders):
        write_private(folder / ROSTER, text)
        write_private(folder / SEAL, seal)
    for folder in folders:
        write_private(made / f"{folder.name}.bundle", pack(folder))
