"""Frames go between a radio and the agents of its vehicles by system id, and nothing else does."""

from __future__ import annotations

import contextlib
import random
import socket
from collections import Counter
from typing import Any

from swarm_ctl.core.model.fleet import FleetAgent
from swarm_ctl.engine.launch.ports import free_ports
from swarm_ctl.engine.radio.link_process import AgentPort
from swarm_ctl.engine.radio.switch import LATE_S, STALLED_S, RadioRoute, Switch
from swarm_ctl.mavlink import outgoing
from swarm_ctl.mavlink.wires import MemoryWire, memory_wires, open_wire

TURN_S = 0.005


def packed(message: Any, system: int) -> bytes:
    data: bytes = message.pack(outgoing.dialect.MAVLink(None, system, 1))
    return data


def heartbeat(system: int) -> bytes:
    return packed(outgoing.heartbeat(), system)


def setpoint(vehicle: int, north: float = 1.0) -> bytes:
    return packed(outgoing.velocity(vehicle, (north, 0.0, 0.0), 0.0), 250)


def position(system: int, boot_s: float) -> bytes:
    local = outgoing.dialect.MAVLink_local_position_ned_message
    return packed(local(round(boot_s * 1e3), 1, 2, 3, 0, 0, 0), system)


class Bench:
    """A switch with two agents, and the far ends of all its wires."""

    def __init__(self) -> None:
        near, self.radio = memory_wires()
        self.agents: list[MemoryWire] = []
        places = []
        for i in (1, 2):
            wire, far = memory_wires()
            self.agents.append(far)
            entry = FleetAgent(i, i, "ardupilot", agent_sysid=251 - i)
            places.append(RadioRoute(entry, wire, 10.0))
        self.switch = Switch(near, places, "serial:/dev/x", 5760)
        self.now = 0.0
        self.turn()

    def turn(self, seconds: float = TURN_S) -> None:
        self.now += seconds
        self.switch.turn(self.now)

    def heard(self, agent: int) -> list[bytes]:
        return drained(self.agents[agent - 1])


def drained(wire: MemoryWire) -> list[bytes]:
    found = []
    while (data := wire.read()) is not None:
        found.append(data)
    return found


def test_another_systems_frame_reaches_no_agent_and_is_counted() -> None:
    bench = Bench()
    bench.radio.write(heartbeat(77))
    bench.turn()
    assert bench.heard(1) == bench.heard(2) == []
    assert bench.switch.load(bench.now).foreign == 1


def test_an_agent_does_not_speak_for_a_vehicle() -> None:
    bench = Bench()
    bench.agents[0].write(heartbeat(2))
    bench.turn()
    assert drained(bench.radio) == []


def test_garbage_and_a_flood_from_the_radio_leave_the_way_up_open() -> None:
    bench, dice = Bench(), random.Random(1)
    for _ in range(200):
        bench.radio.write(dice.randbytes(300))
        bench.radio.write(heartbeat(77) * 20)
        bench.agents[1].write(setpoint(2))
        bench.turn(0.02)
    setpoints = sum(map(len, drained(bench.radio))) / len(setpoint(2))
    assert setpoints > 35, "4 s at 10 a second"
    assert bench.switch.load(bench.now).bad > 0


def test_a_link_that_stood_still_throws_old_positions_and_setpoints_away() -> None:
    bench = Bench()
    bench.radio.write(position(1, 10.0))
    bench.agents[0].write(setpoint(1))
    bench.turn(STALLED_S + 0.1)
    assert bench.heard(1) == []
    assert drained(bench.radio) == []
    bench.agents[0].write(setpoint(1))
    bench.turn()
    assert drained(bench.radio) == [setpoint(1)]


def test_a_position_that_waited_in_the_radio_reaches_no_agent() -> None:
    bench = Bench()
    bench.radio.write(position(1, 10.0))
    bench.turn(0.1)
    for boot_s in (10.1, 10.1 + LATE_S):
        bench.radio.write(position(1, boot_s))
        bench.turn(LATE_S + 0.15)
    assert bench.heard(1) == [position(1, 10.0)]
    assert bench.switch.load(bench.now).vehicles[0].late == 2


def test_a_vehicle_that_boots_again_is_heard_at_once() -> None:
    bench = Bench()
    for boot_s in (1000.0, 0.5):
        bench.radio.write(position(1, boot_s))
        bench.turn(0.1)
    assert len(bench.heard(1)) == 2


def test_vehicles_at_one_udp_port_each_get_their_own_frames_however_they_speak() -> None:
    """939 of 1,126 frames went to whoever had spoken last."""
    (port,) = free_ports(1, socket.SOCK_DGRAM)
    with contextlib.ExitStack() as stack:
        radio = stack.enter_context(contextlib.closing(open_wire(f"udpin:127.0.0.1:{port}")))
        vehicles, far, places = {}, {}, []
        for i in range(1, 7):
            vehicles[i] = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            vehicles[i].connect(("127.0.0.1", port))
            vehicles[i].setblocking(False)
            wire, far[i] = memory_wires()
            places.append(
                RadioRoute(FleetAgent(i, i, "ardupilot", agent_sysid=251 - i), wire, 10.0)
            )
        switch, dice, got = (
            Switch(radio, places, "udpin", 100_000),
            random.Random(1),
            Counter[int](),
        )
        for turn in range(400):
            for i in dice.sample(range(1, 7), 3):
                vehicles[i].send(heartbeat(i))
            far[1 + turn % 6].write(setpoint(1 + turn % 6))
            switch.turn(turn * 0.025)
            for i, vehicle in vehicles.items():
                with contextlib.suppress(BlockingIOError):
                    while True:
                        assert vehicle.recv(300) == setpoint(i)
                        got[i] += 1
    assert min(got.values()) > 50


def test_an_agent_that_speaks_from_another_port_is_answered_there() -> None:
    """One that was started again, where its own port was taken; at the old one nobody listens."""
    (port,) = free_ports(1, socket.SOCK_DGRAM)
    entry = FleetAgent(1, 1, "ardupilot", agent_sysid=250)
    near, radio = memory_wires()
    with contextlib.ExitStack() as stack:
        wire = stack.enter_context(contextlib.closing(AgentPort(1, port)))
        switch = Switch(near, [RadioRoute(entry, wire, 10.0)], "serial:/dev/x", 5760)
        agents = []
        for _ in range(2):
            agent = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            agent.settimeout(5.0)
            agents.append(agent)
        for start_s, agent in zip((0.0, 10.0), agents, strict=True):
            agent.sendto(heartbeat(250), ("127.0.0.1", port))
            switch.turn(start_s)
            radio.write(heartbeat(1))
            switch.turn(start_s + TURN_S)
            assert agent.recv(300) == heartbeat(1)
        agents[0].setblocking(False)
        with contextlib.suppress(BlockingIOError):
            raise AssertionError(f"the old port was told {agents[0].recv(300)!r}")
