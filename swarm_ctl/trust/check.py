"""What would keep a swarm from flying with its keys, found on the ground."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

from swarm_ctl.errors import TrustError
from swarm_ctl.trust import identity
from swarm_ctl.trust.explain import ask, day, same_host
from swarm_ctl.trust.files import access_fault, read_guarded, readable
from swarm_ctl.trust.handshake import Certificate, authority
from swarm_ctl.trust.identity import CA_FOLDER, CA_KEY, Identity, load_identity
from swarm_ctl.trust.names import LOOPBACK, KeyHolder, Role, address_of, member_of
from swarm_ctl.trust.roster import Roster, read_roster

LEAST_VALIDITY: Final = timedelta(hours=24)
"""With less, agents do not arm."""
_STAMP_AHEAD: Final = timedelta(minutes=10)
"""A stamp may be ahead of a right clock: each start of an agent adds a minute."""
_STAMP_ZERO: Final = datetime(2015, 1, 1, tzinfo=UTC)
_STAMP_UNIT: Final = timedelta(microseconds=10)


@dataclass(frozen=True, slots=True)
class MemberReport:
    """One member's folder."""

    member: str
    common_name: str = ""
    not_after: datetime | None = None
    host: str = ""
    mavlink_key: bool = False
    attention: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class TrustReport:
    """A trust folder: the one with the CA, or a host's."""

    folder: str
    swarm: str
    epoch: int
    members: tuple[MemberReport, ...]
    attention: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def needs_attention(self) -> bool:
        """Whether anything would keep the swarm from flying."""
        return bool(self.attention or any(each.attention for each in self.members))


@dataclass(frozen=True, slots=True)
class FleetNames:
    """What a fleet says of each agent: where it listens on the mesh; None: a loopback port, or a
    router's client. The same of its routers, which are numbered from 1."""

    agents: Mapping[int, str | None]
    routers: tuple[str | None, ...] = ()

    @property
    def endpoints(self) -> dict[KeyHolder, str | None]:
        """Where each of them listens."""
        agents = {KeyHolder(Role.AGENT, str(i)): at for i, at in sorted(self.agents.items())}
        routers = enumerate(self.routers, 1)
        return agents | {KeyHolder(Role.ROUTER, str(k)): at for k, at in routers}

    @property
    def hosts(self) -> dict[KeyHolder, str]:
        """The address that each certificate must be for."""
        endpoints = self.endpoints.items()
        return {member: address_of(at)[0] if at else LOOPBACK for member, at in endpoints}


def check(folder: Path, now: datetime, fleet: FleetNames | None = None) -> TrustReport:
    """Everything that is wrong with a trust folder, and with a fleet's use of it. Where an agent of
    the fleet listens now, a handshake with it is tried.

    Raises:
        TrustError: the folder can't be read, or holds no identity.
    """
    with readable(folder):
        paths = sorted(path for path in folder.iterdir() if path.is_dir() and _member(path))
    if not paths:
        raise TrustError(f"{folder}: has no identity; allowed: a folder that `trust new` made")
    examined = [_examined(path, now, fleet) for path in paths]
    loaded = [each for _, each in examined if each is not None]
    attention = [*_modes(folder), *_authority(folder, now), *_rosters(loaded), *_alike(loaded)]
    notes: list[str] = []
    newest = max((each.roster for each in loaded), key=lambda roster: roster.epoch, default=None)
    if newest is not None and fleet is not None:
        attention += _unknown(fleet, newest)
        for bad, text in _live(fleet, loaded):
            (attention if bad else notes).append(text)
    about = (newest.swarm, newest.epoch) if newest is not None else ("", 0)
    reports = tuple(report for report, _ in examined)
    return TrustReport(str(folder), *about, reports, tuple(attention), tuple(notes))


def _member(path: Path) -> KeyHolder | None:
    try:
        return member_of(path.name)
    except TrustError:
        return None


def _modes(folder: Path) -> Iterator[str]:
    """Files and folders that others may read; those of members have lines of their own."""
    ca = folder / CA_FOLDER
    files = (path for path in folder.iterdir() if path.is_file())
    return _others_read(folder, *files, *([ca, *ca.iterdir()] if ca.is_dir() else []))


def _others_read(*paths: Path) -> Iterator[str]:
    return filter(None, (access_fault(path, path.stat()) for path in paths))


def _authority(folder: Path, now: datetime) -> Iterator[str]:
    """What is wrong with the CA, where this computer keeps it."""
    ca = folder / CA_FOLDER
    if not ca.is_dir():
        return
    try:
        yield from _dates("the CA's certificate", authority(ca / identity.CA, ca / CA_KEY), now)
        roster = read_roster(folder, ca / identity.CA)
    except TrustError as error:
        yield str(error)
        return
    for entry in roster.current:
        if not (folder / entry.member.folder).is_dir():
            yield f"{folder / entry.member.folder}: is missing; the roster names {entry.member}"


def _examined(
    path: Path, now: datetime, fleet: FleetNames | None
) -> tuple[MemberReport, Identity | None]:
    member = member_of(path.name)
    report = MemberReport(str(member))
    faults = [
        fault for each in (path, *path.iterdir()) if (fault := access_fault(each, each.stat()))
    ]
    if faults:
        return dataclasses.replace(report, attention=tuple(faults)), None
    if not (path / identity.KEY).exists() and (path.parent / CA_FOLDER).is_dir():
        return dataclasses.replace(report, notes=("its private key is on its own host",)), None
    try:
        found = load_identity(path)
    except TrustError as error:
        return dataclasses.replace(report, attention=(str(error),)), None
    attention = (
        *_dates("its certificate", found.certificate, now),
        *_stamp(found.stamp_file, now),
        *_vehicle(found),
        *_address(found, fleet),
    )
    hosts = ", ".join(host for host in found.certificate.hosts if host != found.common_name)
    about = (found.common_name, found.certificate.not_after, hosts, found.mavlink_key is not None)
    return MemberReport(str(member), *about, tuple(attention)), found


def _dates(what: str, certificate: Certificate, now: datetime) -> Iterator[str]:
    ends = day(certificate.not_after)
    if now < certificate.not_before:
        begins = day(certificate.not_before)
        yield f"{what} is not valid before {begins}, and this machine's clock says {day(now)}"
    elif now >= certificate.not_after:
        yield f"{what} expired on {ends}; allowed: swarm-ctl trust rotate"
    elif certificate.not_after - now < LEAST_VALIDITY:
        yield f"{what} ends in under 24 h, on {ends}: no agent arms; allowed: trust rotate"


def _stamp(path: Path, now: datetime) -> Iterator[str]:
    try:
        text = read_guarded(path).decode().strip() if path.exists() else ""
        last = _STAMP_ZERO + int(text or 0) * _STAMP_UNIT
    except (TrustError, ValueError, OverflowError) as error:
        yield f"{path}: has no stamp: {error}"
        return
    if last > now + _STAMP_AHEAD:
        yield (
            f"this machine's clock says {day(now)}, which is before the last flight's stamp"
            f" ({day(last)}); allowed: a right clock"
        )


def _vehicle(found: Identity) -> Iterator[str]:
    if found.role is Role.AGENT and found.mavlink_key is None:
        path = found.folder / identity.MAVLINK_KEY
        yield f"{path}: is missing: its vehicle's link can't be signed; allowed: its bundle again"


def _address(found: Identity, fleet: FleetNames | None) -> Iterator[str]:
    wanted = fleet.hosts.get(found.member) if fleet is not None else None
    if wanted is not None and not any(same_host(wanted, host) for host in found.certificate.hosts):
        yield (
            f"its certificate is for another address: {', '.join(found.certificate.hosts)}; the"
            f" fleet says {wanted}; allowed: swarm-ctl trust rotate --fleet FILE"
        )


def _rosters(loaded: Sequence[Identity]) -> Iterator[str]:
    """Members whose rosters differ: one host has not got the newest bundle."""
    swarms = sorted({each.swarm for each in loaded})
    if len(swarms) > 1:
        yield f"identities of several swarms: {', '.join(swarms)}; allowed: one trust folder each"
    cas = {each.ca_file.read_bytes() for each in loaded}
    if len(cas) > 1:
        yield "identities of several CAs; allowed: bundles of one `swarm-ctl trust new`"
    epochs = {each.epoch for each in loaded}
    for each in loaded:
        if each.epoch < max(epochs):
            yield (
                f"{each.folder}: its roster is of epoch {each.epoch}, the newest here is of epoch"
                f" {max(epochs)}; allowed: install its newest bundle"
            )


def _alike(loaded: Sequence[Identity]) -> Iterator[str]:
    """A vehicle's key must not move another vehicle."""
    seen: dict[bytes, Identity] = {}
    for each in loaded:
        if each.mavlink_key is not None:
            first = seen.setdefault(each.mavlink_key, each)
            if first is not each:
                yield (
                    f"{first.member} and {each.member} have the same MAVLink key;"
                    " allowed: one of its own for each vehicle"
                )


def _unknown(fleet: FleetNames, roster: Roster) -> Iterator[str]:
    for member in fleet.endpoints:
        if roster.of(member) is None:
            yield (
                f"the fleet has {member}, the roster of epoch {roster.epoch} has not;"
                f" allowed: swarm-ctl trust add {member} --fleet FILE"
            )


def _live(fleet: FleetNames, loaded: Sequence[Identity]) -> Iterator[tuple[bool, str]]:
    """Handshakes with the agents and routers that listen: (whether it needs attention, a text)."""
    endpoints = {member: endpoint for member, endpoint in fleet.endpoints.items() if endpoint}
    known = [each for each in loaded if each.role in (Role.OPERATOR, Role.VIEWER)] or loaded
    with ThreadPoolExecutor(max_workers=32) as pool:
        answers = pool.map(lambda endpoint: ask(known[0], endpoint), endpoints.values())
        for (member, endpoint), answer in zip(endpoints.items(), answers, strict=True):
            own = member.common_name(known[0].swarm, known[0].epoch)
            if not answer.reached:
                yield False, f"{member} does not listen at {endpoint}: no handshake was tried"
            elif answer.fault:
                yield True, f"{member}: {answer.fault}"
            elif answer.peer != own:
                yield True, f"{member}: at {endpoint} answers {answer.peer}; allowed: {own}"
            else:
                yield False, f"{member}: a handshake at {endpoint} as {known[0].common_name}"
