"""The PX4 persona's tables: each answer as measured on a running PX4, without sockets or
physics."""

from __future__ import annotations

import math

import pytest

from swarm_sim.firmware.message import MavResult
from swarm_sim.firmware.px4_persona import LAND as LAND_MODE
from swarm_sim.firmware.px4_persona import (
    LAND_DETECT_S,
    LOITER,
    POSCTL,
    SPOOL_UP_S,
    TAKEOFF,
    Px4Persona,
)
from swarm_sim.firmware.px4_persona import OFFBOARD as OFFBOARD_MODE
from tests.unit.sim.harness import (
    ARM,
    IN_AIR,
    OFFBOARD,
    ORIGIN,
    PX4_LAND,
    PX4_POSCTL,
    SET_MODE,
    Rig,
)
from tests.unit.sim.harness import TAKEOFF as TAKE_OFF

ACCEPTED, REJECTED, UNSUPPORTED = (
    MavResult.ACCEPTED,
    MavResult.TEMPORARILY_REJECTED,
    MavResult.UNSUPPORTED,
)
NAN = math.nan


def ready() -> Rig:
    rig = Rig(Px4Persona)
    rig.run(3.0)
    return rig


def armed() -> Rig:
    rig = ready()
    assert rig.ask(ARM, 1) == ACCEPTED
    return rig


def flying() -> Rig:
    """Holding at 10 m."""
    rig = armed()
    assert rig.ask(TAKE_OFF, 0, 0, 0, NAN, NAN, NAN, ORIGIN.alt_m + 10.0) == ACCEPTED
    rig.sensed = IN_AIR
    rig.run(0.2)
    assert mode(rig) == LOITER.custom
    return rig


def stream(rig: Rig, seconds: float, rate_hz: float = 20.0) -> None:
    for _ in range(round(seconds * rate_hz)):
        rig.fly(1.0, 0.0, 0.0)
        rig.run(1.0 / rate_hz)


def offboard() -> Rig:
    rig = flying()
    stream(rig, 1.2)
    assert rig.ask(SET_MODE, 1, *OFFBOARD) == ACCEPTED
    return rig


def mode(rig: Rig) -> int:
    return rig.firmware.mode.custom


class TestAnswers:
    """The table at the end of MEASURED, PX4's column."""

    def test_take_off_while_disarmed_waits_for_arming(self) -> None:
        rig = ready()
        assert rig.ask(TAKE_OFF, 0, 0, 0, NAN, NAN, NAN, NAN) == ACCEPTED
        assert mode(rig) == TAKEOFF.custom
        assert not rig.firmware.demand.lift
        assert rig.ask(ARM, 1) == ACCEPTED
        rig.run(SPOOL_UP_S + 0.2)
        assert rig.firmware.demand.lift
        down = rig.firmware.demand.position_ned_m[2]
        assert down == pytest.approx(-2.5)  # MIS_TAKEOFF_ALT

    @pytest.mark.parametrize(
        ("seconds", "rate_hz", "answer"), [(0.8, 20, REJECTED), (1.2, 20, ACCEPTED)]
    )
    def test_offboard_wants_a_stream_of_over_a_second(
        self, seconds: float, rate_hz: float, answer: int
    ) -> None:
        rig = flying()
        stream(rig, seconds, rate_hz)
        assert rig.ask(SET_MODE, 1, *OFFBOARD) == answer

    def test_offboard_wants_2_hz(self) -> None:
        rig = flying()
        stream(rig, 6.0, 1.25)
        rig.fly(1.0, 0.0, 0.0)
        assert rig.ask(SET_MODE, 1, *OFFBOARD) == REJECTED

    def test_arming_needs_a_mode_to_fly_in(self) -> None:
        for wanted in (PX4_POSCTL, PX4_LAND, OFFBOARD):
            rig = ready()
            assert rig.ask(SET_MODE, 1, *wanted) == ACCEPTED
            assert rig.ask(ARM, 1) == REJECTED


class TestOffboard:
    """Setpoints and their loss."""

    def test_axes_are_ignored_one_by_one(self) -> None:
        rig = offboard()
        rig.fly(2.0, 3.0, 9.0, mask=3527 & ~4 | 32, z=-20.0)  # vx, vy, and a height
        assert rig.firmware.demand.velocity_ned_mps == (2.0, 3.0, 0.0)
        assert rig.firmware.demand.position_ned_m == (None, None, -19.0)

    def test_other_frames_are_no_sign_of_life(self) -> None:
        rig = flying()
        for _ in range(40):
            rig.fly(1.0, 0.0, 0.0, frame=9)
            rig.run(0.05)
        assert rig.ask(SET_MODE, 1, *OFFBOARD) == REJECTED

    def test_silence_descends_lands_and_disarms(self) -> None:
        rig = offboard()
        rig.run(0.9)
        assert mode(rig) == OFFBOARD_MODE.custom
        rig.said.clear()
        rig.run(0.3)
        assert mode(rig) == POSCTL.custom
        assert rig.texts() == ["Failsafe activated"]
        assert rig.firmware.demand.velocity_ned_mps == (0.0, 0.0, 0.7)
        rig.move(landed=True)
        rig.run(LAND_DETECT_S + 2.3)
        assert not rig.firmware.armed

    def test_a_lost_ground_station_alone_changes_nothing_by_default(self) -> None:
        rig = flying()
        rig.tell("HEARTBEAT", type=6)
        rig.run(30.0)
        assert mode(rig) == LOITER.custom
        rig.firmware.parameters.set("NAV_DLL_ACT", 3)
        rig.run(0.2)
        assert mode(rig) == LAND_MODE.custom


class TestGround:
    """Landing and disarming."""

    @pytest.mark.parametrize("by_failsafe", [False, True])
    def test_after_a_flight_in_offboard_it_stands_there_and_refuses_to_arm(
        self, by_failsafe: bool
    ) -> None:
        rig = offboard()
        if by_failsafe:
            rig.run(1.5)
        else:
            assert rig.ask(SET_MODE, 1, *PX4_LAND) == ACCEPTED
        rig.move(landed=True)
        rig.run(LAND_DETECT_S + 2.3)
        assert (rig.firmware.armed, mode(rig)) == (False, OFFBOARD_MODE.custom)
        assert not rig.firmware.armable(), "PREARM_CHECK is not healthy"
        assert rig.ask(ARM, 1) == REJECTED
        assert rig.ask(SET_MODE, 1, 4, 3) == ACCEPTED
        assert rig.firmware.armable()
        assert rig.ask(ARM, 1) == ACCEPTED

    def test_armed_and_never_flown_it_disarms(self) -> None:
        rig = armed()
        rig.run(9.8)
        assert rig.firmware.armed
        rig.run(0.5)
        assert not rig.firmware.armed


@pytest.mark.parametrize(
    ("parameter", "value", "asked", "flown"),
    [
        ("MPC_XY_VEL_MAX", 2.0, (3.0, 4.0, 0.0), (1.2, 1.6, 0.0)),
        ("MPC_Z_VEL_MAX_UP", 0.5, (0.0, 0.0, -2.0), (0.0, 0.0, -0.5)),
        ("MPC_Z_VEL_MAX_DN", 0.5, (0.0, 0.0, 1.0), (0.0, 0.0, 0.5)),
    ],
)
def test_offboard_flies_no_faster_than_the_vehicle_s_limits(
    parameter: str,
    value: float,
    asked: tuple[float, float, float],
    flown: tuple[float, float, float],
) -> None:
    rig = flying()
    rig.firmware.parameters.set(parameter, value)
    stream(rig, 1.5)
    assert rig.ask(SET_MODE, 1, 6) == ACCEPTED
    rig.fly(*asked)
    assert rig.firmware.demand.velocity_ned_mps == pytest.approx(flown)
