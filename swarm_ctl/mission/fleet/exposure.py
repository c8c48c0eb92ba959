"""What of a swarm without keys, or of links without signatures, other computers can reach."""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Iterable
from typing import Final

from swarm_ctl.core.model.fleet import Fleet, SigningPolicy, plain_endpoint
from swarm_ctl.errors import InputError

_HOST: Final = re.compile(r"(?:\w+/|\w+:)?(?P<host>\[[^\]]+\]|[^:/\s\[\]]*):\d+")
_LISTENING: Final = ("udpin:", "tcpin:")


def leaves_loopback(endpoint: str) -> bool:
    """Whether other computers can reach an endpoint such as `tcp/192.168.1.11:7447`,
    `udpin:0.0.0.0:14550` or `192.168.1.5:14550`."""
    found = _HOST.fullmatch(endpoint)
    host = found["host"].strip("[]") if found else endpoint
    if host == "localhost":
        return False
    try:
        return not ipaddress.ip_address(host).is_loopback
    except ValueError:
        return True  # a name, which may be any host's


def exposures(fleet: Fleet, peers: Iterable[str] = ()) -> list[str]:
    """Where a fleet, and `peers` on its mesh, are open to other computers, in words."""
    if fleet.trust is not None:
        return exposed_links(fleet)
    meshes = [(agent.id, agent.mesh or "") for agent in fleet.agents if agent.mesh]
    return [
        *(f"agent {i} is on the mesh at {at}" for i, at in meshes if leaves_loopback(at)),
        *(f"a router is at {at}" for at in fleet.routers if leaves_loopback(at)),
        *(f"the mesh is at {at}" for at in peers if leaves_loopback(at)),
        *exposed_links(fleet),
    ]


def exposed_links(fleet: Fleet) -> list[str]:
    """The same of the vehicles' links alone, which keys of the mesh do not protect."""
    if fleet.signing is SigningPolicy.REQUIRED:
        return []
    links = [(agent.id, agent.reached_at or "") for agent in fleet.agents]
    return [f"agent {i} listens for its vehicle at {at}" for i, at in links if listens_wide(at)]


def listens_wide(endpoint: str) -> bool:
    """A vehicle's link that waits for whatever computer speaks to it."""
    plain = plain_endpoint(endpoint)
    return plain.startswith(_LISTENING) and leaves_loopback(plain)


def refuse_exposed(exposures: Iterable[str], fleet_file: str, trust: object = None) -> None:
    """InputError where other computers can reach what nothing protects, with what would.

    Args:
        exposures: in words.
        fleet_file: what to make keys for.
        trust: where the keys are; None: there are none.
    """
    found = list(exposures)
    if not found:
        return
    more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
    lacks = "the fleet has no keys" if trust is None else "the fleet has signing: off"
    reached = "swarm" if trust is None else "vehicle"
    made = f"keys (swarm-ctl trust new --fleet {fleet_file})"
    raise InputError(
        f"{found[0]}{more}, and {lacks}: any computer there could command the {reached};"
        f" allowed: {made if trust is None else 'signing: required'}, loopback addresses,"
        " or --open-mesh"
    )
