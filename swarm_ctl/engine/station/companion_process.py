"""The process beside an agent: a station that hears and says nothing on the mesh. What it knows is
what its agent heard and said, so its extensions show the swarm as that drone knows it.

The agent starts it as `python -m swarm_ctl.engine.station.companion_process`.
"""

from __future__ import annotations

import os
import select
import socket
import sys
from collections.abc import Callable
from contextlib import closing
from typing import Final

from swarm_ctl.commands.parse import Order
from swarm_ctl.engine.clock import Clock, unix_s
from swarm_ctl.engine.companion import CONFIG_JSON, CompanionConfig, received
from swarm_ctl.engine.station.attachments import Attachments
from swarm_ctl.engine.station.ground_station import Station
from swarm_ctl.engine.station.mesh_clock import MeshClock
from swarm_ctl.engine.station.recorders import LiveRecorder
from swarm_ctl.engine.station.screens import Screen
from swarm_ctl.engine.station.station_loop import Control, loop
from swarm_ctl.errors import SwarmError
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.memory_transport import MemoryHub, MemoryTransport
from swarm_ctl.mesh.node import Node
from swarm_ctl.station.picture.protection import MeshKind, Protection
from swarm_ctl.station.picture.view import SwarmView

_NICE: Final = 10
"""The agent comes first."""


def show_agent(config: CompanionConfig, messages: socket.socket, ended: Callable[[], bool]) -> None:
    """Show what comes until the agent has `ended`; raises as `Attachments`."""
    plan, name = config.plan, f"agent-{config.agent}"
    clock: Clock | MeshClock = Clock(config.epoch_s, config.speedup)
    if config.stepped:
        clock = MeshClock(config.speedup, lockstep=True)
    hub = MemoryHub(clock.now)
    control = _BesideAgent(hub, messages, ended)
    only_looks = Protection(MeshKind.LOCAL, name, commands=False)
    with closing(Node(MemoryTransport(hub), plan.name, f"{name}-companion")) as node:
        station = Station(plan, node, clock, protection=only_looks)
        with Attachments(config.attach, station, config.agent) as attached:
            if attached.sinks:
                start_ns = round((unix_s() - clock.now() / clock.speedup) * 1e9)
                recorder = LiveRecorder(attached.sinks, plan, start_ns, station.name)
                with closing(recorder):
                    station.record(recorder)
                    loop(station, _Notes(), control, attached)
            else:
                loop(station, _Notes(), control, attached)


class _BesideAgent(Control):
    """Hears the agent, and ends when the agent has."""

    def __init__(self, hub: MemoryHub, messages: socket.socket, ended: Callable[[], bool]) -> None:
        self._hub, self._messages, self._ended = hub, messages, ended
        self._agent = MemoryTransport(hub)

    def obey(self, station: Station, screen: Screen) -> bool:
        del station, screen
        return self._ended()

    def begin(self, wall_seconds: float) -> bool:
        select.select([self._messages], [], [], wall_seconds)
        for key, data in received(self._messages):
            channel, _, name = key.rpartition("/")
            heard = f"{channel}/{keys.STATE.name}" if name == keys.FAR.name else key
            self._hub.publish(self._agent, heard, data)
        return True


class _Notes(Screen):
    """What the operator is told goes where the agent's words go."""

    left = False

    def show(self, view: SwarmView) -> None:
        """Extensions show it."""

    def note(self, text: str) -> None:
        sys.stderr.write(f"agent: {text}\n")

    def orders(self) -> list[Order]:
        return []

    def close(self) -> None:
        """There is no terminal to give back."""


def main() -> int:
    """Entry of the process; arguments: the descriptor where the agent's messages come, and the
    agent's process."""
    os.nice(_NICE)
    descriptor, parent = map(int, sys.argv[1:])
    config = CONFIG_JSON.validate_json(sys.stdin.buffer.read())
    with socket.socket(fileno=descriptor) as messages:
        messages.setblocking(False)
        try:
            show_agent(config, messages, lambda: os.getppid() != parent)
        except SwarmError as error:
            sys.stderr.write(f"agent: {error}; the flight goes on\n")
            return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
