"""The flight of `swarm-ctl measure` on a virtual clock: real agent, driver and simulator, bytes
carried in memory."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import common

from swarm_ctl.core.identification.fit import Fit, fit
from swarm_ctl.core.identification.step_flight import StepFlight, Steps
from swarm_ctl.core.model.autopilots import AUTOPILOT_KINDS
from swarm_ctl.core.model.plan import Fence, Geodetic
from swarm_ctl.core.safety.fence import outside
from swarm_ctl.mavlink.link import VehicleLink
from swarm_ctl.mavlink.wires import memory_wires
from swarm_sim.config import SimConfig
from swarm_sim.network.hub import Hub
from swarm_sim.physics.kinematics import VelocityResponse as Motion
from swarm_sim.physics.response import ArdupilotResponse
from swarm_sim.world.world import STEP_S

TICK_S = 0.05
PLACE = {"lat_deg": 47.397742, "lon_deg": 8.545594, "alt_m": 488.0}
HERE = Geodetic(**PLACE)
STEPS = Steps(height_m=5.0)


class Measured:
    """One vehicle and its step flight."""

    def __init__(
        self,
        persona: str = "ardupilot",
        *,
        motion: Motion | None = None,
        fence: Fence | None = None,
    ) -> None:
        near, self._far = memory_wires()
        vehicle = {
            "sysid": 7,
            "persona": persona,
            "endpoint": "udpin:127.0.0.1:1",
            "ready_after_s": 1.0,
            **PLACE,
        }
        settings = {"version": 1, "epoch_s": 0.0, "origin": PLACE, "vehicles": [vehicle]}
        self.hub = Hub(
            SimConfig.model_validate(settings), 0.0, lambda _, data, __: self._far.write(data)
        )
        if motion is not None:
            self.hub.world.groups[persona].response = motion
        self.persona, self.now = persona, 0.0
        self.link = VehicleLink(near, persona, 7)
        self.flight = StepFlight(STEPS, AUTOPILOT_KINDS[persona].response, TICK_S, fence, HERE)
        self.texts: list[str] = []
        self.farthest_m = self.highest_m = 0.0
        self.deaf = False

    def tick(self, stop: str = "") -> None:
        self.now += TICK_S
        while (data := self._far.read()) is not None:
            if not self.deaf:
                self.hub.receive(0, data, ("agent", 1))
        while self.hub.world.next_s <= self.now + STEP_S / 2:
            self.hub.step()
        north, east, down = self.hub.world.positions()[0]
        self.farthest_m = max(self.farthest_m, abs(north), abs(east))
        self.highest_m = max(self.highest_m, -down)
        self.link.receive(self.now)
        self.link.pursue(self.flight.step(self.now, self.link.view(), stop), self.now)
        self.texts += self.flight.said
        self.flight.said.clear()

    def until(self, met: Callable[[], Any], within_s: float = 300.0, stop: str = "") -> None:
        end = self.now + within_s
        while not met():
            assert self.now < end, self.texts
            self.tick(stop)

    def to_the_end(self, stop: str = "") -> tuple[str, str]:
        self.until(lambda: self.flight.ended, stop=stop)
        assert self.flight.ended is not None
        return self.flight.ended.outcome, self.flight.ended.reason

    def stepping(self, legs: int = 1) -> None:
        """In the middle of a leg."""
        self.until(lambda: len(self.texts) >= legs + 3)
        self.until(lambda: self.speed > 0.5)

    def pilot(self, mode: int) -> None:
        """Another ground station changes the mode."""
        message = common.MAVLink_command_long_message(7, 1, 176, 0, 1, mode, 0, 0, 0, 0, 0)
        self.hub.receive(0, message.pack(common.MAVLink(None, 254, 190)), ("pilot", 1))

    @property
    def speed(self) -> float:
        view = self.link.view()
        return math.hypot(*view.local.velocity_ned_mps[:2]) if view.local else 0.0

    @property
    def parked(self) -> bool:
        return bool(self.hub.world.parked())

    def found(self, legs: int = 8) -> Fit:
        assert self.to_the_end() == ("completed", "")
        assert self.flight.missing == ""
        assert len(self.flight.legs) == legs
        assert self.parked
        return fit(self.flight.legs, AUTOPILOT_KINDS[self.persona].response)


def test_an_arducopter_is_measured_and_a_slower_one_found_slower() -> None:
    """Near to what is typical; half the acceleration and a fifth of a second on the way show as
    just that. All of it within the box, and the vehicle stands where it stood. The agent itself,
    whose setpoints are not flown in a leg, finds nothing wrong with its vehicle.
    """
    usual = Measured()
    typical, found = AUTOPILOT_KINDS["ardupilot"].response, usual.found()
    assert found.usable
    assert found.warnings == ()
    assert not [text for text in usual.texts if "measure it" in text]
    assert found.response.dead_time_s == pytest.approx(typical.dead_time_s, abs=0.1)
    assert found.response.lag_s == pytest.approx(typical.lag_s, abs=0.15)
    assert found.response.acceleration_mps2 == pytest.approx(typical.acceleration_mps2, rel=0.2)
    assert usual.farthest_m < STEPS.least_box_m
    assert usual.highest_m < STEPS.height_m + 1.0
    assert math.hypot(*usual.hub.world.positions()[0][:2]) < 1.0
    own = usual.link._autopilot.parameters
    assert own.released(usual.link._heard), "it has its own failsafe parameters again"

    slow = Measured(motion=ArdupilotResponse(acceleration_mps2=1.2, jerk_mps3=2.4))
    slow.hub.world.vehicles[0].firmware.parameters.set("SIM_DELAY", 0.1)
    slow.until(lambda: not slow.flight.missing)  # the legs along north
    slower = fit(slow.flight.legs, typical)
    assert slower.response.dead_time_s > found.response.dead_time_s + 0.15
    assert slower.response.acceleration_mps2 == pytest.approx(1.2, rel=0.25)
    assert slower.warnings


def test_a_px4_is_measured_although_a_leg_has_a_gap() -> None:
    """It starts at once and creeps in: no dead time worth the name, the longer lag. The gap is of a
    busy machine: the vehicle stops by itself meanwhile, and the leg does not count. What is left is
    enough, as long as each kind is there."""
    measured, typical = Measured("px4"), AUTOPILOT_KINDS["px4"].response
    measured.until(lambda: any("north, 3 m/s for 0.7" in text for text in measured.texts))
    measured.now += 0.4
    found = measured.found(legs=7)
    assert [leg.kind for leg in measured.flight.legs].count("3 m/s for 0.7 s") == 1
    assert found.usable
    assert found.response.dead_time_s < 0.15
    assert found.response.dead_time_s + found.response.lag_s == pytest.approx(
        typical.dead_time_s + typical.lag_s, abs=0.2
    )


def test_an_armed_vehicle_is_left_alone() -> None:
    """It belongs to another operator: no parameter is set, only requests are sent."""
    measured = Measured()
    firmware = measured.hub.world.vehicles[0].firmware
    own = [firmware.parameters[name] for name in ("GUID_TIMEOUT", "FS_GCS_ENABLE")]
    firmware.parameters.set("DISARM_DELAY", 0.0)  # it would disarm itself after 10 s on the ground
    firmware.armed = True
    outcome, reason = measured.to_the_end()
    assert outcome == "failed"
    assert "armed already" in reason
    assert [firmware.parameters[name] for name in ("GUID_TIMEOUT", "FS_GCS_ENABLE")] == own
    assert measured.link.counters.setpoints == 0


def test_ctrl_c_lands_it_in_a_step() -> None:
    measured = Measured()
    measured.stepping()
    assert measured.to_the_end("Ctrl-C") == ("aborted", "Ctrl-C")
    assert measured.parked
    assert "0 of 8 legs" in measured.flight.missing


def test_ctrl_c_on_the_ground_and_in_the_climb() -> None:
    measured = Measured()
    measured.tick()
    assert measured.to_the_end("Ctrl-C") == ("aborted", "Ctrl-C")
    assert measured.parked
    climbing = Measured()
    climbing.until(lambda: climbing.highest_m > 2.0)
    assert climbing.to_the_end("Ctrl-C") == ("aborted", "Ctrl-C")
    assert climbing.parked
    assert climbing.highest_m < STEPS.height_m


def test_a_pilot_has_it_at_once() -> None:
    """LOITER in the middle of a step: no setpoint, no mode comes from us any more, until the pilot
    has landed."""
    measured = Measured()
    measured.stepping()
    measured.pilot(5)
    measured.until(lambda: measured.link.view().mode == "LOITER")
    sent = measured.link.counters.setpoints
    for _ in range(200):
        measured.tick()
    assert measured.link.view().mode == "LOITER"
    assert measured.link.counters.setpoints == sent
    measured.pilot(9)
    outcome, reason = measured.to_the_end()
    assert outcome == "failed"
    assert "LOITER" in reason


def test_out_of_its_box_it_lands() -> None:
    """A storm it can't stand against."""
    measured = Measured()
    measured.stepping()
    measured.hub.world.vehicles[0].firmware.parameters.set("SIM_WIND_SPD", 30.0)
    outcome, reason = measured.to_the_end()
    assert outcome == "failed"
    assert any(
        word in reason for word in ("outside the geofence", "fast; allowed", "leans", "wind of")
    )
    assert measured.parked


def test_a_lost_link_lands_it_by_its_own_failsafe() -> None:
    """Nothing of ours arrives any more, nothing of its own is heard here: both sides give up."""
    measured = Measured()
    measured.stepping()
    measured.deaf = True
    measured.hub.world.vehicles[0].firmware.parameters.set("SIM_HB_MUTE", 1.0)
    outcome, reason = measured.to_the_end()
    assert outcome == "failed"
    assert "no heartbeat" in reason
    measured.until(lambda: measured.parked)
    assert measured.farthest_m < STEPS.box_m


def test_a_box_beyond_the_geofence_is_refused_on_the_ground() -> None:
    for fence, why in (
        (
            Fence(((-13.0, -50.0), (50.0, -50.0), (50.0, 50.0), (-13.0, 50.0)), 50.0),
            "not all inside",
        ),
        (Fence((), 4.0), "above the geofence"),
    ):
        assert outside(fence, (0.0, 0.0), 0.0) == ""
        measured = Measured(fence=fence)
        outcome, reason = measured.to_the_end()
        assert (outcome, measured.highest_m) == ("failed", 0.0)
        assert why in reason
