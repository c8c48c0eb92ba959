"""Who takes part in a swarm, and the common names of their certificates."""

from __future__ import annotations

import ipaddress
import re
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from swarm_ctl.errors import TrustError

_SWARM: Final = re.compile(r"[a-z0-9]([a-z0-9-]{0,22}[a-z0-9])?")
_NAME: Final = re.compile(r"[a-z0-9]([a-z0-9-]{0,18}[a-z0-9])?")
_HOST: Final = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.-]{0,251}[A-Za-z0-9])?")
_ENDPOINT: Final = re.compile(r"\w+/(?P<host>\[[^\]]+\]|[^:/\s]+):(?P<port>[0-9]{1,5})")
LOOPBACK: Final = "127.0.0.1"


class Role(StrEnum):
    """What the owner of a certificate may do."""

    AGENT = "agent"
    """Flies a vehicle: publishes under its own id, hears all."""
    OPERATOR = "operator"
    """Commands the swarm, hears all."""
    VIEWER = "viewer"
    """Hears all, publishes nothing."""
    ROUTER = "router"
    """Passes on what all others say, on one host of a large swarm."""


@dataclass(frozen=True, slots=True)
class KeyHolder:
    """One owner of a certificate: a role, and a name in it (an agent's is its id)."""

    role: Role
    name: str

    def __post_init__(self) -> None:
        if self.role is Role.AGENT:
            if re.fullmatch(r"[1-9][0-9]{0,2}", self.name) is None or int(self.name) > 250:
                raise TrustError(f"agent {self.name!r} is no agent's id; allowed: 1 to 250")
        elif _NAME.fullmatch(self.name) is None:
            raise TrustError(
                f"{self.role} {self.name!r} is no name; allowed: 1 to 20 of a-z, 0-9 and -"
            )

    def __str__(self) -> str:
        return f"{self.role} {self.name}"

    @property
    def folder(self) -> str:
        """The name of its folder: `agent-3`."""
        return f"{self.role}-{self.name}"

    def common_name(self, swarm: str, epoch: int) -> str:
        """`agent-3.outdoors.e1`."""
        return f"{self.folder}.{swarm}.e{epoch}"


def member_of(folder: str) -> KeyHolder:
    """The member of a folder's name such as `agent-3`; TrustError where it names none."""
    role, _, name = folder.partition("-")
    if role not in tuple(Role):
        raise TrustError(
            f"{folder!r} names no identity; allowed: a folder such as agent-3, operator-anna,"
            " viewer-tv, router-1"
        )
    return KeyHolder(Role(role), name)


def checked_swarm(name: str) -> str:
    """The name as it is; TrustError where it can't stand in a certificate and in a mesh key."""
    if _SWARM.fullmatch(name) is None:
        raise TrustError(f"{name!r} is no swarm's name; allowed: 1 to 24 of a-z, 0-9 and -")
    return name


def swarm_named_after(text: str) -> str:
    """A swarm's name from any text, such as a file's name; TrustError where nothing is left."""
    return checked_swarm(re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")[:24].rstrip("-"))


def checked_host(host: str) -> str:
    """An address or a DNS name that a certificate can hold; TrustError for others, and for
    addresses that no peer can connect to."""
    try:
        unspecified = ipaddress.ip_address(host).is_unspecified
    except ValueError:
        unspecified = False
        if _HOST.fullmatch(host) is None:
            raise TrustError(f"{host!r} is no address; allowed: an IP address or a name") from None
    if unspecified:
        raise TrustError(
            f"{host} is no address that a peer connects to, and a certificate needs one;"
            " allowed: the host's own address, such as 192.168.1.11"
        )
    return host


def address_of(endpoint: str) -> tuple[str, int]:
    """Host and port of a mesh endpoint such as `tls/192.168.1.11:7447`; TrustError for another
    text."""
    found = _ENDPOINT.fullmatch(endpoint.split("#", 1)[0].split("?", 1)[0])
    if found is None:
        raise TrustError(
            f"{endpoint!r} is no endpoint of the mesh; allowed: such as tls/192.168.1.11:7447"
        )
    return found["host"].strip("[]"), int(found["port"])
