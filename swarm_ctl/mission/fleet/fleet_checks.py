"""What the entries of a fleet must be together, in a file of their own or in a mission."""

from __future__ import annotations

from collections.abc import Sequence

from swarm_ctl.mission.input.document import Findings, Mistake, Place, twice
from swarm_ctl.mission.sections.fleet_section import FleetEntry, FleetSection


def check_trust(fleet: FleetSection, place: Place) -> Findings:
    """What is wrong with how the fleet, which stands at `place`, is protected."""
    if fleet.trust is None and fleet.signing == "required":
        what = "signing is required, and there are no keys to sign with"
        yield Mistake((*place, "signing"), what, "trust: FOLDER beside it (swarm-ctl trust new)")
    entries = [(*place, "agents", k) for k in range(len(fleet.agents))]
    ways = {(*entries[k], "mesh"): entry.mesh for k, entry in enumerate(fleet.agents)}
    ways |= {(*entries[k], "router"): entry.router for k, entry in enumerate(fleet.agents)}
    for spot, at in {**ways, (*place, "router"): fleet.router}.items():
        scheme = (at or "tcp/").partition("/")[0]
        if fleet.trust is None and scheme in ("tls", "quic"):
            allowed = f"trust: FOLDER in the fleet, or {'tcp/' if scheme == 'tls' else 'udp/'}"
            yield Mistake(spot, f"{scheme}/ without keys", allowed)


def check_fleet(entries: Sequence[FleetEntry], place: Place, *, radio: bool) -> Findings:
    """What is wrong with the entries of a fleet, which stand at `place`, each taken alone: two
    vehicles on separate links may have one sysid, but not in one mission. `radio`: the fleet says
    what a shared radio carries."""
    for field, values, allowed in (
        ("id", [e.id for e in entries], "one entry for each agent"),
        ("mesh", [e.mesh for e in entries], "a mesh endpoint of its own"),
        ("agent_sysid", [e.agent_sysid for e in entries], "an agent_sysid of its own"),
    ):
        yield from twice({(*place, k, field): v for k, v in enumerate(values)}, allowed)
    yield from _shared_endpoints(entries, place, radio=radio)
    vehicles = {entry.vehicle_sysid for entry in entries}
    for k, entry in enumerate(entries):
        if entry.agent_sysid in vehicles:
            what = f"agent {entry.id} can't speak as {entry.agent_sysid}, a vehicle's sysid"
            yield Mistake((*place, k, "agent_sysid"), what, "an id of no vehicle, 1 to 254")
        if entry.sysid is None and entry.id > 250:
            what = f"sysid is missing, and the id, {entry.id}, can't be one"
            yield Mistake((*place, k), what, "sysid: 1 to 250")
        if entry.vehicle and entry.endpoint:
            what = f"vehicle {entry.vehicle} has an endpoint already, {entry.endpoint}"
            yield Mistake((*place, k, "vehicle"), what, "vehicle or endpoint")
        if entry.firmware != (entry.kind.autopilot or entry.firmware):
            what = f"vehicle {entry.vehicle} is no {entry.firmware}"
            allowed = f"autopilot: {entry.kind.autopilot}, or none"
            yield Mistake((*place, k, "vehicle"), what, allowed)
        ways = {"endpoint": entry.endpoint, "mesh": entry.mesh, "router": entry.router}
        for name, value in ways.items():
            port = value.rpartition(":")[2] if value and not value.startswith("serial:") else "1"
            if not 1 <= int(port) <= 65535:
                what = f"port {port} is out of range"
                yield Mistake((*place, k, name), what, "a port from 1 to 65535")


def _shared_endpoints(entries: Sequence[FleetEntry], place: Place, *, radio: bool) -> Findings:
    """Only a radio has several vehicles behind it, and knows them by their system ids."""
    ways = {(*place, k, "endpoint"): _reached_at(entry) for k, entry in enumerate(entries)}
    alone = {spot: None if _is_radio(at, radio=radio) else at for spot, at in ways.items()}
    yield from twice(
        alone,
        "an endpoint of its own for every vehicle; or radio_bytes_per_s in the fleet, what a radio"
        " that they share carries (swarm-ctl link)",
    )
    behind = {
        (*spot[:-1], "sysid"): (at, entry.vehicle_sysid)
        for (spot, at), entry in zip(ways.items(), entries, strict=True)
        if at is not None and alone[spot] is None
    }
    for spot, found in behind.items():
        if list(behind.values()).count(found) > 1:
            what = f"sysid {found[1]} is there twice behind the radio {found[0]}"
            yield Mistake(spot, what, "a sysid of its own for every vehicle behind a radio")


def _is_radio(at: str | None, *, radio: bool) -> bool:
    """Whether several vehicles may be behind this endpoint."""
    return at is not None and (radio or at.startswith("serial:"))


def check_hosts(fleet: FleetSection, place: Place) -> Findings:
    """What is wrong with where the agents of the fleet, which stands at `place`, run."""
    routers: dict[str, str] = {}
    hosted = any(entry.host for entry in fleet.agents)
    for k, entry in enumerate(fleet.agents):
        spot, router = (*place, "agents", k), entry.router or fleet.router
        if hosted and not entry.host:
            what = f"agent {entry.id} has no host, and other agents have one"
            yield Mistake(spot, what, "host: the computer that it runs on; or no host at all")
        if entry.host and router and routers.setdefault(entry.host, router) != router:
            what = f"{entry.host} has the router {routers[entry.host]} already"
            yield Mistake((*spot, "router"), what, "one router for each host")


def _reached_at(entry: FleetEntry) -> str | None:
    """The vehicle's endpoint; with its host where another host may have the same one."""
    kind, _, address = (entry.endpoint or "").partition(":")
    own = kind in ("serial", "udpin", "tcpin") or address.startswith(("127.", "localhost:"))
    return f"{entry.endpoint} of {entry.host}" if own and entry.host else entry.endpoint
