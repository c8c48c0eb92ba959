"""Instance numbers of autopilots: each stands for a set of ports, and two runs share none.

A number is held by binding a port that its autopilot does not use, so it is free again when the
process that holds it ends, however it ends.
"""

from __future__ import annotations

import contextlib
import socket
from dataclasses import dataclass
from typing import Final, Self

from swarm_ctl.core.model.fleet import VehicleKind
from swarm_ctl.errors import StartError

TCP, UDP = socket.SOCK_STREAM, socket.SOCK_DGRAM
GCS_PORT: Final = 14550
"""Where ground control software listens by itself, and every PX4 sends until some answers. Instance
10's agent would listen there, too, hear its own vehicle on two links and all others, and take them
for two vehicles. So no vehicle stands there."""


@dataclass(frozen=True, slots=True)
class InstancePorts:
    """The ports of one kind of autopilot: those of instance 0, each a kind of socket and a number,
    and the step to the next instance."""

    used: tuple[tuple[socket.SocketKind, int], ...]
    step: int
    held: tuple[socket.SocketKind, int]
    """Not used by the autopilot: bound for as long as the instance is ours."""
    most: int
    """Instances; the next one's ports would be another's."""

    def of(self, instance: int) -> list[tuple[socket.SocketKind, int]]:
        """All ports of an instance, the held one first."""
        return [(kind, port + self.step * instance) for kind, port in (self.held, *self.used)]


PORTS: Final = {
    # MAVLink on 5760, 5762, 5763; RC input on 5501.
    VehicleKind.ARDUCOPTER: InstancePorts(
        ((TCP, 5760), (TCP, 5762), (TCP, 5763), (UDP, 5501)), 10, (UDP, 5760), 200
    ),
    # The agent's link, PX4's end of it, its ground-station link, the onlooker's link both ways.
    VehicleKind.PX4: InstancePorts(
        ((UDP, 14540), (UDP, 14580), (UDP, 18570), (UDP, 14030), (UDP, 14280)), 1, (TCP, 14580), 40
    ),
}


class Instances:
    """The instance numbers that this process holds, while it is entered."""

    def __init__(self) -> None:
        self._held = contextlib.ExitStack()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._held.close()

    def take(self, kind: VehicleKind) -> int:
        """The least number whose ports are free; StartError where there is none."""
        ports = PORTS[kind]
        for instance in range(ports.most):
            if (UDP, GCS_PORT) in ports.of(instance):
                continue
            with contextlib.suppress(OSError), contextlib.ExitStack() as tried:
                held, *_ = [
                    tried.enter_context(bound(socket_kind, port))
                    for socket_kind, port in ports.of(instance)
                ]
                self._held.enter_context(held.dup())
                return instance
        raise StartError(f"no {kind} can be started: the ports of {ports.most} are all in use")


def bound(kind: socket.SocketKind, port: int) -> socket.socket:
    """A socket that has this port of the loopback interface; OSError where it is taken."""
    probe = socket.socket(socket.AF_INET, kind)
    try:
        if kind is TCP:  # as the autopilots do: a port of a connection that has just ended is free
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind(("127.0.0.1", port))
        if kind is TCP:
            probe.listen(1)  # SO_REUSEADDR alone lets two sockets bind that don't listen
    except OSError:
        probe.close()
        raise
    return probe
