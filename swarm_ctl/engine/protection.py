"""Who this process is on the mesh, and what keeps others off it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from swarm_ctl.core.model.fleet import FleetAgent
from swarm_ctl.core.model.timeouts import KEYS_VALID_S
from swarm_ctl.engine.clock import date_and_time
from swarm_ctl.errors import TrustError
from swarm_ctl.mesh.access import access_settings, as_tls
from swarm_ctl.trust.explain import explain_handshake, same_host
from swarm_ctl.trust.identity import Identity, certificates_end, identity_folder, load_identity
from swarm_ctl.trust.names import LOOPBACK, KeyHolder, Role, address_of, member_of

_ASKED, _ASK_WALL_S = 3, 0.3
"""So many endpoints are asked why they refuse, each for so long."""
_MADE_BY: Final = "swarm-ctl trust new --fleet FILE"


@dataclass(frozen=True, slots=True)
class Keys:
    """What a command line says of keys, and of the mesh."""

    identity: Path | None = None
    """The folder of who speaks."""
    open_mesh: bool = False
    """Other computers may reach a mesh without keys."""
    fleet_file: str = "FILE"
    """What `swarm-ctl trust new` is to be told."""
    zenoh: Mapping[str, Any] = field(default_factory=dict)
    """A user's own zenoh settings."""


NO_KEYS: Final = Keys()


def agent_identity_folder(trust: str | None, agent: int, given: Path | None = None) -> Path | None:
    """The folder with an agent's identity: the one given, else the agent's in the fleet's trust;
    None where the mesh is open."""
    if given is not None or trust is None:
        return given
    return _folder(trust) / KeyHolder(Role.AGENT, str(agent)).folder


def own_identity(folder: Path | None, agent: int) -> Identity | None:
    """The identity of the agent itself; None where the mesh is open. TrustError where the folder
    is another member's."""
    if folder is None:
        return None
    identity = load_identity(folder)
    if identity.member != KeyHolder(Role.AGENT, str(agent)):
        raise TrustError(f"{folder}: is {identity.member}; allowed: the identity of agent {agent}")
    return identity


def router_identity_folder(trust: str | None, listen: str) -> Path | None:
    """The folder of the router that listens at this endpoint; None where the mesh is open.
    TrustError where the fleet's trust has none for that address."""
    if trust is None:
        return None
    folder, host = _folder(trust), address_of(listen)[0]
    for path in sorted(folder.glob(f"{Role.ROUTER}-*")):
        if path.is_dir():
            entry = load_identity(path).roster.of(member_of(path.name))
            if entry is not None and same_host(host, entry.host):
                return path
    raise TrustError(
        f"{trust}: has no router for {host}; allowed: one that swarm-ctl trust new or trust"
        " add router made from a fleet of more than 16 agents, or with routers"
    )


def router_identity(folder: Path | None) -> Identity | None:
    """The identity of a router; None where the mesh is open. TrustError where the folder is another
    member's."""
    if folder is None:
        return None
    identity = load_identity(folder)
    if identity.role is not Role.ROUTER:
        raise TrustError(f"{folder}: is {identity.member}; allowed: the identity of a router")
    return identity


def valid_for_s(identity: Identity | None) -> float:
    """How long the identity's certificate is still good [s]; without end on an open mesh."""
    if identity is None:
        return math.inf
    return (certificates_end(identity) - date_and_time()).total_seconds()


def station_identity(trust: str | None, given: Path | None = None) -> Identity | None:
    """The identity of a ground station: the one given, else that of the only operator in the
    fleet's trust; None where the mesh is open.

    Raises:
        TrustError: there is none, several operators are there, or it is an agent's.
    """
    if given is None and trust is None:
        return None
    folder = given or identity_folder(_folder(trust or ""), Role.OPERATOR)
    identity = load_identity(folder)
    if identity.role is Role.AGENT:
        raise TrustError(
            f"{folder}: is {identity.member}, which flies; allowed: an operator's or a viewer's"
            " identity (--identity FOLDER)"
        )
    return identity


def operator_identity(trust: str | None, given: Path | None = None) -> Identity | None:
    """As `station_identity`, for a process that commands; TrustError for a viewer."""
    identity = station_identity(trust, given)
    if identity is not None and identity.role is not Role.OPERATOR:
        raise TrustError(
            f"{identity.folder}: {identity.member} may only watch; allowed: an operator"
        )
    return identity


def access(identity: Identity | None, swarm: str) -> Mapping[str, Any] | None:
    """What zenoh is told of a protected mesh; None where the mesh is open."""
    return None if identity is None else access_settings(identity, swarm)


def explained(identity: Identity | None, endpoints: Sequence[str]) -> str:
    """Why the mesh at one of the first endpoints refuses this process, or this process the mesh;
    '' where none does. Takes up to 0.8 s of the wall clock for each."""
    if identity is None:
        return ""
    asked = (explain_handshake(identity, as_tls(each), _ASK_WALL_S) for each in endpoints[:_ASKED])
    return next((fault for fault in asked if fault), "")


def refuse_useless(
    identity: Identity, agents: Iterable[FleetAgent], routers: Mapping[KeyHolder, str | None]
) -> None:
    """TrustError where an agent, a router, or the operator, has no certificate in the roster, one
    for another address, or one that has ended: no link would open. Nor would an agent arm whose
    certificate ends in under 24 h."""
    endpoints = {KeyHolder(Role.AGENT, str(agent.id)): agent.mesh for agent in agents}
    for member, mesh in {identity.member: None, **endpoints, **routers}.items():
        entry = identity.roster.of(member)
        if entry is None:
            raise TrustError(
                f"{identity.folder}: the roster of {identity.swarm} has no {member}; allowed: one"
                " that `swarm-ctl trust add` made"
            )
        left_s = (entry.not_after - date_and_time()).total_seconds()
        if left_s < KEYS_VALID_S:
            ends = "ended" if left_s <= 0 else f"ends in {left_s / 3600:.0f} h,"
            raise TrustError(
                f"the certificate of {member} {ends} on {entry.not_after:%Y-%m-%d}; allowed: 24 h"
                " and more, by swarm-ctl trust rotate"
            )
        host = address_of(mesh)[0] if mesh else LOOPBACK
        if not same_host(host, entry.host):
            raise TrustError(
                f"the certificate of {member} is for {entry.host or 'no address'}, and it listens"
                f" at {host}; allowed: new ones, by swarm-ctl trust rotate --fleet FILE"
            )


def _folder(trust: str) -> Path:
    folder = Path(trust)
    if not folder.is_dir():
        raise TrustError(
            f"trust: {trust}: is no folder; allowed: one that {_MADE_BY} has made, or"
            " --identity FOLDER"
        )
    return folder
