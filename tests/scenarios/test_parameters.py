"""What keeps a vehicle safe when its agent dies stays so, whoever sets parameters in flight."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.engine.gcs.config import GcsAddress, RelayVehicle
from swarm_ctl.engine.gcs.gcs_process import GcsRelay, VehiclePort
from swarm_ctl.engine.gcs.gcs_socket import GcsSocket
from swarm_ctl.engine.launch.ports import free_ports
from swarm_ctl.mavlink.wires import memory_wires
from swarm_ctl.mission.compile.loader import loads
from tests.scenarios.swarm import VirtualSwarm
from tests.scenarios.watched import Watch

MISSION = loads(
    """
version: 1
name: watched
origin: {lat_deg: 47.397742, lon_deg: 8.545594, alt_m: 488}
lengths: metres
tick_s: 0.1
law: {r: 60, r_out: 7, r_in: 2.5}
policies: {agent_lost: continue}
agents: [{id: 1, start: [0, 0]}, {id: 2, start: [0, 10]}]
shapes:
  row: {kind: line, spacing: 10}
steps:
  - takeoff: {height_m: 4}
  - form: {shape: row}
  - hold: {duration_s: 60}
  - land
fleet:
  agents: [{id: 1}, {id: 2, autopilot: px4}]
"""
)
HOLD = 3
DANGERS = {1: ("FS_GCS_ENABLE", 0), 2: ("COM_OF_LOSS_T", 600.0)}
"""Without a failsafe; with the last setpoint for ten minutes."""


class Joined(VirtualSwarm):
    """The relay itself on the virtual clock, as another client of vehicle 1, and a GCS."""

    def __init__(self) -> None:
        here, self._there = memory_wires()
        super().__init__(MISSION)
        self._gcs = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._gcs.bind(("127.0.0.1", 0))
        (self._own_port,) = free_ports(1, socket.SOCK_DGRAM)
        address = GcsAddress("127.0.0.1", self._gcs.getsockname()[1], self._own_port)
        self._socket = GcsSocket(address, 0.0)
        port = VehiclePort(RelayVehicle(1, 1, 250, "udpout:virtual"), here)
        self.relay = GcsRelay([port], [self._socket])

    def _transmit(self, link: int, data: bytes, to: Any) -> None:
        if to == "relay":
            self._there.write(data)
        else:
            super()._transmit(link, data, to)

    def tick(self) -> None:
        self.relay.step(self.now)
        while (data := self._there.read()) is not None:
            self.hub.receive(0, data, "relay")
        super().tick()

    def set_by_gcs(self, name: str, value: float) -> None:
        message = dialect.MAVLink_param_set_message(1, 1, name.encode(), value, 2)
        packed = message.pack(dialect.MAVLink(None, 255, 190))
        self._gcs.sendto(packed, ("127.0.0.1", self._own_port))

    def close(self) -> None:
        self._gcs.close()
        self._socket.close()


def known(swarm: VirtualSwarm, place: int) -> Any:
    return swarm.hub.world.vehicles[place].firmware.parameters


def down(swarm: VirtualSwarm, place: int) -> bool:
    return not swarm.hub.world.airborne()[place]


@contextmanager
def joined() -> Iterator[Joined]:
    with closing(Joined()) as swarm:
        swarm.wait(lambda s: s.in_step(HOLD))
        yield swarm


def test_a_gcs_takes_no_failsafe_from_a_vehicle_whose_agent_then_dies() -> None:
    """FS_GCS_ENABLE 0 went through the relay, the agent died, the vehicle hovered for ever."""
    with joined() as swarm:
        swarm.set_by_gcs("FS_GCS_ENABLE", 0)
        swarm.run(0.5)
        assert swarm.relay.refused == 1
        assert known(swarm, 0)["FS_GCS_ENABLE"] == 5
        swarm.kill(1)
        swarm.wait(lambda s: down(s, 0), swarm.now + 40.0)


def test_a_pilot_sets_what_he_likes_once_he_has_the_vehicle() -> None:
    with joined() as swarm:
        loiter = dialect.MAVLink_set_mode_message(1, 1, 5)
        swarm.hub.receive(0, loiter.pack(dialect.MAVLink(None, 255, 190)), "pilot")
        swarm.run(5.0)
        swarm.set_by_gcs("FS_GCS_ENABLE", 0)
        swarm.run(5.0)
        assert (swarm.relay.refused, known(swarm, 0)["FS_GCS_ENABLE"]) == (0, 0)


def test_what_another_sets_past_the_relay_is_set_again_and_the_vehicles_come_down() -> None:
    """On a link of the vehicle's own, and without a word on the agent's: it is read again."""
    watch = Watch(VirtualSwarm(MISSION))
    swarm = watch.swarm
    watch.wait(lambda s: s.in_step(HOLD))
    ours = {i: known(swarm, i - 1)[name] for i, (name, _) in DANGERS.items()}
    for agent, (name, value) in DANGERS.items():
        known(swarm, agent - 1).set(name, value)
    watch.run(14.0)
    for agent, (name, value) in DANGERS.items():
        assert known(swarm, agent - 1)[name] == ours[agent]
        assert any(f"changed in flight: {name} is {value:g}" in e.text for e in swarm.events)
        assert ("parameters", (agent,)) in watch.raised
        swarm.kill(agent)
    swarm.wait(lambda s: down(s, 0) and down(s, 1), swarm.now + 40.0)
