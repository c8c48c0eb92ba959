"""The server's time: a simulator that was not scheduled for a while is no silent link."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarm_sim.clock import SimClock
from swarm_sim.firmware.px4_persona import LOITER, OFFBOARD
from swarm_sim.network.server import Server
from tests.unit.sim.harness import ARM, LAND_NOW, ORIGIN, SET_MODE, TAKEOFF, VELOCITY_ONLY, config
from tests.unit.sim.harness import OFFBOARD as OFFBOARD_MODE

NAN = float("nan")
SETPOINT_S = 0.05


class HandClock(SimClock):
    """A clock that goes on only while the server rests, and tells so."""

    def __init__(self) -> None:
        super().__init__(0.0, 1.0)
        self.time_s = 0.0
        self.told: Callable[[], None] = lambda: None

    def now(self) -> float:
        return self.time_s

    def rest(self, wall_s: float) -> None:
        self.time_s += wall_s
        self.told()


class Offboard:
    """A PX4 in OFFBOARD behind a real socket, and its client."""

    def __init__(self, server: Server, clock: HandClock, client: socket.socket) -> None:
        self.server, self.clock, self._client = server, clock, client
        self._mav = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self._spoken_s = 0.0
        self.firmware = server.hub.world.vehicles[0].firmware
        self.firmware.parameters.set("COM_OBL_RC_ACT", 5.0)  # hold
        self.command(ARM, 1)
        self.command(TAKEOFF, 0, 0, 0, NAN, NAN, NAN, ORIGIN.alt_m + 10)
        self.fly(8.0)
        self.command(SET_MODE, 1, *OFFBOARD_MODE)
        self.fly(1.0)
        assert self.firmware.mode is OFFBOARD

    def command(self, command: int, *p: float) -> None:
        numbers = [*p, *[0.0] * (7 - len(p))]
        self._send(mavlink.MAVLink_command_long_message(1, 1, command, 0, *numbers))

    def setpoint(self) -> None:
        rest = (0.0,) * 7
        message = mavlink.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, 1, VELOCITY_ONLY, 0, 0, 0, 1.0, *rest
        )
        self._send(message)

    def fly(self, seconds: float) -> None:
        """Setpoints at 20 Hz, each served at once."""
        for _ in range(round(seconds / SETPOINT_S)):
            self.clock.time_s += SETPOINT_S
            self.speak()
            self.serve()

    def speak(self) -> None:
        """The setpoints that are due by the clock."""
        while self._spoken_s + SETPOINT_S <= self.clock.time_s + 1e-9:
            self._spoken_s += SETPOINT_S
            self.setpoint()

    def serve(self) -> None:
        """Lets the server run until it is at the clock's time."""
        while self.server.hub.world.next_s <= self.clock.time_s:
            self.server._poll(0.0)
            self.server._catch_up()

    def _send(self, message: mavlink.MAVLink_message) -> None:
        self._client.sendto(message.pack(self._mav), self.server._sockets[0]._socket.getsockname())


@pytest.fixture
def offboard() -> Iterator[Offboard]:
    settings = config(1, "px4").model_dump()
    settings["vehicles"][0]["endpoint"] = "udpin:127.0.0.1:0"
    clock = HandClock()
    with (
        Server(type(config()).model_validate(settings), clock, None) as server,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client,
    ):
        yield Offboard(server, clock, client)


def test_a_stopped_simulator_does_not_take_the_time_for_silence(offboard: Offboard) -> None:
    """The PX4 wants a setpoint a second, and stays in OFFBOARD though it sees 2 s go by at once."""
    offboard.clock.told = offboard.speak
    began_s = offboard.clock.time_s
    offboard.clock.time_s += 2.0
    offboard.speak()
    offboard.serve()
    assert offboard.firmware.mode is OFFBOARD
    assert not offboard.firmware.failsafe
    assert offboard.clock.time_s < began_s + 10.2  # a quarter faster than the clock


def test_a_client_that_wakes_later_than_the_simulator_is_not_silent(offboard: Offboard) -> None:
    """After a stop of both it has nearly as long for its next setpoint as without a stop."""
    stopped_s, late_s = offboard.clock.time_s + 1.5, 0.7
    offboard.clock.time_s = stopped_s

    def wakes() -> None:
        if offboard.clock.time_s >= stopped_s + late_s:
            offboard.speak()

    offboard.clock.told = wakes
    offboard.serve()
    assert offboard.firmware.mode is OFFBOARD
    assert not offboard.firmware.failsafe


def test_a_stopped_simulator_notices_a_silent_client(offboard: Offboard) -> None:
    """Time that goes by without setpoints is silence, as fast as it goes."""
    offboard.clock.time_s += 2.0
    offboard.serve()
    assert offboard.firmware.mode is LOITER
    assert offboard.firmware.failsafe


def test_once_it_has_flown_a_simulator_that_is_to_fly_once_ends(offboard: Offboard) -> None:
    """Not on the ground before, not in the air, not in the pause between two flights: 10 s after
    all stand disarmed."""
    server, world = offboard.server, offboard.server.hub.world
    assert not server._drained()
    server._config = server._config.model_copy(update={"once": True})
    assert not server._drained()
    offboard.command(LAND_NOW, 0, 0, 0, NAN, NAN, NAN, NAN)
    stood_s = None
    for _ in range(600):
        offboard.clock.time_s += 0.1
        offboard.serve()
        stood_s = (stood_s or world.time_s) if world.parked() else None
        if server._drained():
            break
    assert stood_s is not None
    assert world.time_s - stood_s == pytest.approx(10.0, abs=0.3)


def test_a_simulator_that_never_flew_waits(offboard: Offboard) -> None:
    """Vehicles that stand from the start are no end of a flight."""
    settings = config(1).model_copy(update={"once": True})
    clock = HandClock()
    with Server(settings, clock, None) as server:
        for _ in range(20):
            clock.time_s += 1.0
            server._catch_up()
            assert not server._drained()
