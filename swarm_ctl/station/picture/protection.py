"""What keeps others off the swarm, as a ground station says it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from swarm_ctl.core.model.fleet import SigningPolicy
from swarm_ctl.trust.identity import Identity
from swarm_ctl.trust.names import Role


class MeshKind(StrEnum):
    """Who can reach the mesh."""

    LOCAL = "local"
    """Processes of this computer alone."""
    OPEN = "open"
    """Any computer of the network: nothing on it is authenticated."""
    TLS = "TLS"
    """Members of the swarm's roster."""


@dataclass(frozen=True, slots=True)
class Protection:
    """What keeps others off the swarm, and who this station is."""

    mesh: MeshKind
    who: str = ""
    """`operator anna`; '' without keys."""
    commands: bool = True
    """It is no mere viewer."""
    signing: bool = False
    """The vehicles' links have to be signed."""
    links_open: bool = False
    """Other computers reach vehicles' links that are not signed."""

    @property
    def is_open(self) -> bool:
        """Any computer of the network may command the swarm, or a vehicle of it."""
        return self.mesh is MeshKind.OPEN or self.links_open


LOCAL: Final = Protection(MeshKind.LOCAL)


def protection(
    identity: Identity | None, signing: SigningPolicy, *, is_open: bool = False
) -> Protection:
    """What a station says of its swarm; `is_open`: other computers can reach it without
    keys: its mesh, or where that has keys the links."""
    if identity is None:
        return Protection(MeshKind.OPEN) if is_open else LOCAL
    commands = identity.role is Role.OPERATOR
    signs = signing is SigningPolicy.REQUIRED
    return Protection(MeshKind.TLS, str(identity.member), commands, signs, is_open and not signs)


def protection_words(
    by: Protection, heard: int, signed: int, agents: int
) -> list[tuple[str, bool]]:
    """What an operator should know of it, in short words, and whether each is as it should be;
    nothing of a mesh inside one computer.

    Args:
        heard: agents that are heard: on a mesh with keys, each under its own.
        signed: those whose vehicle's link is signed.
        agents: all of them.
    """
    if by.mesh is MeshKind.LOCAL:
        return []
    if by.mesh is MeshKind.OPEN:
        return [("MESH OPEN", False), ("any computer that reaches it may command", False)]
    links = f"links signed {signed}/{agents}" if by.signing else "links not signed"
    links = "LINKS OPEN" if by.links_open else links
    return [
        (f"mesh TLS {heard}/{agents}", heard == agents),
        (links, signed == agents),
        (by.who, True),
    ]
