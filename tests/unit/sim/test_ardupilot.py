"""The ArduCopter persona's tables: each answer as measured on a running ArduCopter, without sockets
or physics."""

from __future__ import annotations

import math

import pytest

from swarm_sim.firmware.ardupilot_persona import (
    DISARM_S,
    GCS_FAILSAFE,
    LAND_DETECT_S,
    MODES,
    ArdupilotPersona,
)
from swarm_sim.firmware.flying.maneuvers import HoldManeuver, LandManeuver
from swarm_sim.firmware.message import LandedState, MavResult
from tests.unit.sim.harness import (
    ARM,
    AUTO,
    BRAKE,
    GUIDED,
    IN_AIR,
    LAND,
    RTL,
    SET_MODE,
    TAKEOFF,
    Rig,
)

ACCEPTED, DENIED, UNSUPPORTED, FAILED = (
    MavResult.ACCEPTED,
    MavResult.DENIED,
    MavResult.UNSUPPORTED,
    MavResult.FAILED,
)


def ready() -> Rig:
    """Disarmed on the ground, would arm."""
    rig = Rig(ArdupilotPersona)
    rig.run(3.0)
    return rig


def armed() -> Rig:
    rig = ready()
    assert rig.ask(SET_MODE, 1, GUIDED) == ACCEPTED
    assert rig.ask(ARM, 1) == ACCEPTED
    return rig


def flying() -> Rig:
    """In GUIDED, at 10 m."""
    rig = armed()
    assert rig.ask(TAKEOFF, 0, 0, 0, 0, 0, 0, 10.0) == ACCEPTED
    rig.sensed = IN_AIR
    rig.run(0.2)
    return rig


def mode(rig: Rig) -> int:
    return rig.firmware.mode.custom


class TestAnswers:
    """The table at the end of MEASURED, ArduCopter's column."""

    def test_arm_before_ready(self) -> None:
        rig = Rig(ArdupilotPersona)
        rig.run(2.9)
        assert rig.ask(ARM, 1) == FAILED
        assert rig.texts()[0].startswith("Arm: ")
        assert not rig.firmware.armed

    def test_forced_arming_needs_its_number(self) -> None:
        rig = Rig(ArdupilotPersona)
        rig.run(1.0)
        assert rig.ask(ARM, 1, 21196) == FAILED
        assert rig.ask(ARM, 1, 2989) == ACCEPTED
        assert rig.firmware.armed

    def test_unknown_mode(self) -> None:
        rig = ready()
        assert rig.ask(SET_MODE, 1, 99) == FAILED
        assert rig.texts() == ["No such mode 99"]

    @pytest.mark.parametrize("height", [0.0, -5.0, math.nan, math.inf])
    def test_take_off_to_nowhere(self, height: float) -> None:
        assert armed().ask(TAKEOFF, 0, 0, 0, 0, 0, 0, height) == FAILED

    def test_disarm_in_flight(self) -> None:
        rig = flying()
        assert rig.ask(ARM, 0) == FAILED
        assert rig.ask(ARM, 0, 2989) == FAILED
        assert rig.firmware.armed
        assert rig.ask(ARM, 0, 21196) == ACCEPTED
        assert not rig.firmware.demand.lift

    @pytest.mark.parametrize("number", [m.custom for m in MODES.values()])
    def test_arming_by_mode(self, number: int) -> None:
        rig = ready()
        entered = rig.ask(SET_MODE, 1, number)
        assert entered == (FAILED if number == AUTO else ACCEPTED)
        if entered == ACCEPTED:
            row = MODES[number]
            assert rig.ask(ARM, 1) == (ACCEPTED if row.armable else FAILED)
            if not row.armable:
                assert rig.texts() == [f"Arm: {row.name} mode not armable"]

    def test_guided_in_the_air_without_a_position_estimate(self) -> None:
        rig = Rig(ArdupilotPersona, ready_after_s=100.0)
        rig.run(1.0)
        rig.ask(ARM, 1, 2989)
        rig.sensed = IN_AIR
        rig.run(0.2)
        assert rig.ask(SET_MODE, 1, GUIDED) == FAILED
        assert rig.texts() == ["Mode change to GUIDED failed: requires position"]
        assert rig.ask(SET_MODE, 1, LAND) == ACCEPTED


class TestSetpoints:
    """GUIDED velocity."""

    def test_not_on_the_ground(self) -> None:
        rig = armed()
        rig.fly(0.0, 0.0, -1.0)
        assert not rig.firmware.demand.lift

    @pytest.mark.parametrize(
        ("mask", "frame"),
        [(3527 | 8, 1), (3527 | 32, 1), (3527 | 56, 1), (3527, 6), (3527, 0), (0xFFFF, 1)],
    )
    def test_what_is_not_usable_stops_the_vehicle(self, mask: int, frame: int) -> None:
        """One ignored axis drops the group; unknown frames too."""
        rig = flying()
        rig.fly(1.0, 0.0, 0.0)
        rig.fly(3.0, 0.0, 0.0, mask=mask, frame=frame)
        assert isinstance(rig.firmware.maneuver, HoldManeuver)
        assert mode(rig) == GUIDED

    @pytest.mark.parametrize(("mask", "yaw"), [(2503, 1.0), (1479, None), (4039, None)])
    def test_masks_seen_in_the_wild(self, mask: int, yaw: float | None) -> None:
        rig = flying()
        rig.fly(1.0, 2.0, 0.0, mask=mask, yaw=1.0, yaw_rate=0.5)
        assert rig.firmware.demand.velocity_ned_mps == (1.0, 2.0, 0.0)
        if yaw is not None:
            assert rig.firmware.demand.heading_rad == yaw

    @pytest.mark.parametrize("frame", [8, 9])
    def test_body_frames_are_turned_by_the_heading(self, frame: int) -> None:
        rig = flying()
        rig.move(heading_rad=math.pi / 2)
        rig.fly(1.0, 0.0, 0.25, frame=frame)
        assert rig.firmware.demand.velocity_ned_mps == pytest.approx((0.0, 1.0, 0.25))

    def test_silence_stops_it_after_guid_timeout_and_keeps_the_mode(self) -> None:
        rig = flying()
        rig.fly(3.0, 0.0, 0.0)
        rig.run(2.9)
        assert rig.firmware.demand.velocity_ned_mps == (3.0, 0.0, 0.0)
        rig.run(0.3)
        assert rig.firmware.demand.velocity_ned_mps == (0.0, 0.0, 0.0)
        assert (mode(rig), rig.firmware.armed, rig.texts()) == (GUIDED, True, [])


class TestGcsFailsafe:
    """FS_GCS_ENABLE: 5 s after the last heartbeat of MAV_GCS_SYSID."""

    def lost(self, action: int, source: tuple[int, int] = (255, 190)) -> Rig:
        rig = flying()
        rig.firmware.parameters.set("FS_GCS_ENABLE", action)
        rig.tell("HEARTBEAT", source=source, type=6)
        rig.run(4.9)
        assert mode(rig) == GUIDED
        rig.run(0.3)
        return rig

    @pytest.mark.parametrize(
        ("action", "expected"),
        [(0, GUIDED), (1, RTL), (3, RTL), (4, LAND), (5, LAND), (7, BRAKE), (99, GUIDED)],
    )
    def test_actions(self, action: int, expected: int) -> None:
        rig = self.lost(action)
        assert mode(rig) == expected
        assert ("GCS Failsafe" in rig.texts()) == (action in GCS_FAILSAFE)

    def test_only_the_configured_ground_station_counts(self) -> None:
        """Another's heartbeats neither start nor feed the watch."""
        assert mode(self.lost(5, source=(42, 190))) == GUIDED
        rig = flying()
        rig.firmware.parameters.set("FS_GCS_ENABLE", 5)
        rig.tell("HEARTBEAT", type=6)
        for _ in range(6):
            rig.run(1.0)
            rig.tell("HEARTBEAT", source=(42, 190), type=6)
        assert mode(rig) == LAND

    def test_on_the_ground_it_disarms(self) -> None:
        rig = armed()
        rig.firmware.parameters.set("FS_GCS_ENABLE", 1)
        rig.tell("HEARTBEAT", type=6)
        rig.run(5.2)
        assert not rig.firmware.armed

    def test_a_heartbeat_again_clears_it_and_keeps_the_mode(self) -> None:
        rig = self.lost(5)
        rig.tell("HEARTBEAT", type=6)
        assert "GCS Failsafe Cleared" in rig.texts()
        assert mode(rig) == LAND


class TestGround:
    """Landing and disarming."""

    def test_land_disarms_once_the_motors_have_spooled_down(self) -> None:
        rig = flying()
        assert rig.ask(SET_MODE, 1, LAND) == ACCEPTED
        assert isinstance(rig.firmware.maneuver, LandManeuver)
        rig.run(20.0)
        assert rig.firmware.armed
        rig.move(landed=True)
        rig.run(LAND_DETECT_S - 0.2)
        assert rig.firmware.landed_state() is not LandedState.ON_GROUND
        rig.run(DISARM_S - LAND_DETECT_S)
        assert rig.firmware.landed_state() is LandedState.ON_GROUND
        assert rig.firmware.armed
        rig.run(0.4)
        assert not rig.firmware.armed

    def test_armed_and_idle_it_disarms_after_disarm_delay(self) -> None:
        rig = armed()
        rig.run(9.8)
        assert rig.firmware.armed
        rig.run(0.5)
        assert not rig.firmware.armed
        assert "Disarming motors" in rig.texts()
