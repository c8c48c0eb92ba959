"""Where other MAVLink programs find the vehicles of a run: the ports that people know, and `--gcs`.

An ArduCopter in the loop listens on TCP 5760 + 10 i. A PX4 sends from UDP 14580 + i to 14540 + i.
Simulated vehicles stand there, too, where these ports are free.
"""

from __future__ import annotations

import contextlib
import itertools
import secrets
import socket
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from swarm_ctl.core.model.fleet import FleetAgent, VehicleKind
from swarm_ctl.engine.gcs.config import GcsAddress, RelayConfig, RelayVehicle
from swarm_ctl.engine.launch.ports import free_ports
from swarm_ctl.engine.vehicles.instances import GCS_PORT, PORTS, TCP, UDP, bound

_COLUMNS: Final = ("agent", "vehicle", "system", "its agent's link", "also on")


@dataclass(frozen=True, slots=True)
class KnownPort:
    """What people expect of the vehicle with number `i` of its firmware."""

    first: int
    step: int
    held: tuple[socket.SocketKind, int]
    """Bound while a run has the first vehicle's number, from before its vehicle has bound its own
    ports."""
    own: int | None = None
    """The port that the first vehicle sends from; None: it listens on `first`."""

    def numbers(self) -> Iterator[int]:
        """All but the one whose client would be where ground control software listens."""
        return (i for i in itertools.count() if self.first + self.step * i != GCS_PORT)

    def endpoint(self, i: int) -> str:
        """The vehicle's end, as the simulator writes it."""
        port = self.first + self.step * i
        if self.own is None:
            return f"tcpin:127.0.0.1:{port}"
        return f"udpout:127.0.0.1:{port}:{self.own + self.step * i}"

    def client(self, i: int) -> str:
        """What a client opens, as pymavlink writes it."""
        scheme = "tcp" if self.own is None else "udpin"
        return f"{scheme}:127.0.0.1:{self.first + self.step * i}"

    def hold(self, i: int) -> socket.socket:
        """Hold the vehicle's number, as `Instances` does: of two runs that start together one has
        it. OSError where another run holds it, or another program is there."""
        offset = self.step * i
        kind, held = self.held
        holding = bound(kind, held + offset)
        try:
            at = (TCP, self.first) if self.own is None else (UDP, self.own)
            bound(at[0], at[1] + offset).close()
        except OSError:
            holding.close()
            raise
        return holding


KNOWN: Final = {
    "ardupilot": KnownPort(5760, 10, PORTS[VehicleKind.ARDUCOPTER].held),
    "px4": KnownPort(14540, 1, PORTS[VehicleKind.PX4].held, 14580),
}


@dataclass(slots=True)
class GroundControl:
    """Where each vehicle is found beside its agent's link."""

    stations: tuple[GcsAddress, ...]
    further: dict[int, list[str]] = field(default_factory=dict)
    """Of simulated vehicles, by agent, as the simulator writes them."""
    known: dict[int, str] = field(default_factory=dict)
    """What a client opens, by agent; or why there is nothing."""
    links: dict[int, str] = field(default_factory=dict)
    """A link to the vehicle that its agent does not use, by agent."""

    mirrors: dict[int, int] = field(default_factory=dict)
    """Loopback ports, by agent: where an agent shares its vehicle's link, if that is the only
    one."""

    secret: bytes = field(default_factory=lambda: secrets.token_bytes(16))
    """Of this run: by it mirrors know the relay."""

    held: contextlib.ExitStack = field(default_factory=contextlib.ExitStack)
    """The numbers of the simulated vehicles, until the run has ended."""

    def take_started(self, links: Mapping[int, str]) -> None:
        """The free links of autopilots that have just been started, by agent."""
        self.known |= links
        if self.stations:
            self.links |= links
            self.known |= dict.fromkeys(links, "")  # each serves one client: the relay

    def relay(self, fleet: Sequence[FleetAgent]) -> RelayConfig | None:
        """What the relay is told; None where no GCS is to be served."""
        if not self.stations:
            return None
        vehicles = [
            RelayVehicle(
                agent.id,
                agent.sysid,
                agent.agent_sysid,
                self.links.get(agent.id) or f"udpout:127.0.0.1:{self.mirrors[agent.id]}",
                shared=agent.id not in self.links,
                secret="" if agent.id in self.links else self.secret.hex(),
            )
            for agent in fleet
        ]
        return RelayConfig(tuple(vehicles), self.stations)

    def table(self, fleet: Sequence[FleetAgent], kinds: Mapping[int, str]) -> Iterator[str]:
        """What is where, a line a vehicle."""
        rows = [
            (str(a.id), kinds[a.id], str(a.sysid), a.endpoint or "", self.known.get(a.id, ""))
            for a in fleet
        ]
        widths = [max(map(len, column)) for column in zip(_COLUMNS, *rows, strict=True)]
        for row in (_COLUMNS, *rows):
            line = "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True))
            yield line.rstrip()
        for each in self.stations:
            own = f"one that connects by itself: udpout:127.0.0.1:{each.own_port}"
            yield f"ground control software: every vehicle is sent to {each}; {own}"


def ground_control(
    fleet: Sequence[FleetAgent], simulated: Collection[int], gcs: Sequence[tuple[str, int]]
) -> GroundControl:
    """Choose ports, of those that are free now, and hold the numbers of simulated vehicles."""
    in_use = {agent.id: _port(agent.endpoint or "") for agent in fleet}
    count = len(gcs) + len(fleet) if gcs else 0
    ports = iter(free_ports(count, socket.SOCK_DGRAM, in_use.values()))
    found = GroundControl(tuple(GcsAddress(*address, next(ports)) for address in gcs))
    numbers = {autopilot: port.numbers() for autopilot, port in KNOWN.items()}
    for agent in fleet:
        if agent.id not in simulated:
            if gcs:
                found.mirrors[agent.id] = next(ports)
            continue
        port, i = KNOWN[agent.autopilot], next(numbers[agent.autopilot])
        client, further = port.client(i), []
        found.known[agent.id] = f"{client} is taken"
        if _port(client) not in in_use.values():
            with contextlib.suppress(OSError):
                found.held.enter_context(port.hold(i))
                further.append(port.endpoint(i))
                found.known[agent.id] = client
        if gcs:
            link = f"127.0.0.1:{next(ports)}"
            further.append(f"udpin:{link}")
            found.links[agent.id] = f"udpout:{link}"
        found.further[agent.id] = further
    return found


def _port(endpoint: str) -> int:
    """0 where it has none."""
    text = endpoint.rpartition(":")[2]
    return int(text) if text.isdecimal() else 0
