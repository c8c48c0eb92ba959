"""The server's time: a process that was not scheduled for a while is no silence to its vehicles."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim.clock import SimClock
from sim.firmware.px4_persona import LOITER, OFFBOARD
from sim.network.server import Server
from tests.unit.sim.harness import ARM, ORIGIN, SET_MODE, TAKEOFF, VELOCITY_ONLY, config
from tests.unit.sim.harness import OFFBOARD as OFFBOARD_MODE

NAN = float("nan")
SETPOINT_S = 0.05


class HandClock(SimClock):
    """A clock that the test sets."""

    def __init__(self) -> None:
        super().__init__(0.0, 1.0)
        self.time_s = 0.0

    def now(self) -> float:
        return self.time_s


class Offboard:
    """A PX4 in OFFBOARD behind a real socket, and its client."""

    def __init__(self, server: Server, clock: HandClock, client: socket.socket) -> None:
        self.server, self.clock, self._client = server, clock, client
        self._mav = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
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
            self.setpoint()
            self.serve(SETPOINT_S)

    def serve(self, seconds: float) -> None:
        """Lets time pass, then the server run until it is at that time."""
        self.clock.time_s += seconds
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


def test_setpoints_that_waited_for_a_stopped_simulator_are_spread_over_the_time(
    offboard: Offboard,
) -> None:
    """None is taken for late: the PX4, which wants one a second, stays in OFFBOARD."""
    for _ in range(round(2.0 / SETPOINT_S)):
        offboard.setpoint()
    offboard.serve(2.0)
    assert offboard.firmware.mode is OFFBOARD
    assert not offboard.firmware.failsafe


def test_a_silent_client_is_noticed_by_a_stopped_simulator_too(offboard: Offboard) -> None:
    offboard.serve(2.0)
    assert offboard.firmware.mode is LOITER
    assert offboard.firmware.failsafe


def test_the_world_never_goes_beyond_the_last_look_at_the_sockets(offboard: Offboard) -> None:
    """Wherever in its loop the process was stopped, what waits is read first."""
    offboard.clock.time_s += 2.0
    before_s = offboard.server.hub.world.time_s
    offboard.server._catch_up()
    assert offboard.server.hub.world.time_s == before_s
