"""What a pilot does to a vehicle, what a forged heartbeat does not, and a vehicle that is disarmed
or falls: on the virtual clock, with both personas."""

from __future__ import annotations

from functools import cache
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarm_ctl.core.model.messages import Phase, Severity
from swarm_ctl.mission.compile.loader import LoadedMission, loads
from tests.on_demand import on_demand
from tests.scenarios.swarm import VirtualSwarm, at_step
from tests.scenarios.test_steps import assert_good

TEXT = """\
version: 1
name: pair
origin: {{lat_deg: -35.36, lon_deg: 149.16, alt_m: 584}}
unit_m: 1
tick_s: 0.1
law: {{r: 20, r_out: 6, r_in: 2.5}}
agents: [{{id: 1, start: [0, 0]}}, {{id: 2, start: [0, 9]}}]
shapes: {{row: {{kind: line, spacing: 9}}}}
fleet: {{agents: [{{id: 1, autopilot: {autopilot}}}, {{id: 2, autopilot: {autopilot}}}]}}
policies: {{{policies}}}
steps:
  - takeoff: {{height_m: 6}}
  - form: {{shape: row, settle_s: 2}}
  - hold: {{duration_s: {hold_s}}}
  - land
"""
TAKEOFF, HOLD, LAND = 1, 3, 4
MODES = {
    "ardupilot": {"flown": 4, "pilot": 5, "landing": 9},
    "px4": {"flown": 6 << 16, "pilot": 4 << 16 | 3 << 24, "landing": 4 << 16 | 6 << 24},
}
WIRE_ID = {"ardupilot": 3, "px4": 12}
PILOTED = 2
"""The agent of the vehicle that the pilot takes."""
both = pytest.mark.parametrize("autopilot", MODES)


@cache
def mission(autopilot: str, policies: str = "agent_lost: hold", hold_s: float = 8) -> LoadedMission:
    return loads(TEXT.format(autopilot=autopilot, policies=policies, hold_s=hold_s))


def holding(autopilot: str, policies: str = "agent_lost: hold") -> VirtualSwarm:
    """Two agents hold their formation."""
    swarm = at_step(mission(autopilot, policies, 25), HOLD)
    swarm.run(2)
    return swarm


def forged(
    swarm: VirtualSwarm, autopilot: str, mode: str, agent: int = PILOTED, *, armed: bool = True
) -> None:
    """A heartbeat on the link of `agent`, as its vehicle would send it."""
    codec = mavlink.MAVLink(None, srcSystem=agent, srcComponent=1)
    base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | 128 * armed
    kind = (mavlink.MAV_TYPE_QUADROTOR, WIRE_ID[autopilot], base, MODES[autopilot][mode], 4)
    swarm._far[agent - 1].write(mavlink.MAVLink_heartbeat_message(*kind, 3).pack(codec))


def firmware(swarm: VirtualSwarm, agent: int = PILOTED) -> Any:
    return swarm.hub.world.vehicles[agent - 1].firmware


def switch(swarm: VirtualSwarm, autopilot: str, mode: str) -> None:
    """The pilot's ground station sets the mode."""
    firmware(swarm).set_mode(1, MODES[autopilot][mode])


def phase(swarm: VirtualSwarm, agent: int = PILOTED) -> Phase | None:
    status = swarm.members[agent].status
    return status.phase if status else None


def said(swarm: VirtualSwarm, agent: int = PILOTED) -> list[tuple[Severity, str]]:
    return [(event.level, event.text) for event in swarm.events if event.agent == agent]


def has(swarm: VirtualSwarm, words: str, agent: int = PILOTED) -> bool:
    return any(words in text for _, text in said(swarm, agent))


# --- what is not a pilot ---


FORGERIES = [("landing", True), ("pilot", True), ("flown", False)]


@both
def test_single_forged_heartbeats_change_nothing(autopilot: str) -> None:
    """One after the other, to each agent in turn, from lift-off to the end: the mission completes,
    and the log has them."""
    swarm, count = VirtualSwarm(mission(autopilot)), 0
    swarm.wait(lambda s: all(s.hub.world.airborne()))
    while swarm.now < 400 and all(member.alive for member in swarm.members.values()):
        mode, armed = FORGERIES[count % len(FORGERIES)]
        forged(swarm, autopilot, mode, agent=1 + count % 2, armed=armed)
        count += 1
        swarm.run(2.7)
    swarm.fly(400)
    assert_good(swarm)
    assert count > 10
    assert has(swarm, "a heartbeat said")


@both
def test_a_flood_of_forged_heartbeats_lands_no_vehicle_and_keeps_none_up(autopilot: str) -> None:
    """Twenty a second, from the middle of the flight to the end."""
    swarm = at_step(mission(autopilot), HOLD)

    def flooded() -> None:
        for _ in range(2):
            forged(swarm, autopilot, "pilot")
        swarm.tick()

    for _ in range(7 * 10):
        flooded()
    assert not has(swarm, "by a pilot")
    while swarm.now < 400 and not swarm.all_down:
        flooded()
    assert swarm.all_down
    assert set(swarm.outcomes().values()) <= {"completed"}


# --- a pilot ---


def piloted(autopilot: str, policies: str = "agent_lost: hold") -> VirtualSwarm:
    """A pilot has taken the vehicle: the agent yields within 3 s, and the other holds."""
    swarm = holding(autopilot, policies)
    switch(swarm, autopilot, "pilot")
    taken_s = swarm.now
    swarm.wait(lambda s: phase(s) is Phase.YIELD, taken_s + 3.0)
    assert has(swarm, "by a pilot or by its own failsafe")
    return swarm


def resume(swarm: VirtualSwarm) -> str:
    """The operator's `resume` for the agent; why it was refused, or ''."""
    swarm.acks.clear()
    swarm.command("resume", agents=(PILOTED,), name=f"resume-{swarm.now:.2f}")
    swarm.run(0.2)
    return next(ack.reason for ack in swarm.acks if ack.agent == PILOTED)


@both
def test_a_pilot_takes_a_vehicle_and_gives_it_back(autopilot: str) -> None:
    """The agent never asks for a mode, refuses `resume` in the pilot's mode, and waits for it in
    its own; then both complete the mission in formation."""
    swarm = piloted(autopilot)
    swarm.run(10)
    assert firmware(swarm).mode.name == {"ardupilot": "LOITER", "px4": "AUTO.LOITER"}[autopilot]
    assert phase(swarm, 1) is Phase.HOLD
    assert f"set {firmware_mode(autopilot)}, then `resume` again" in resume(swarm)
    switch(swarm, autopilot, "flown")
    swarm.run(5)
    assert phase(swarm) is Phase.YIELD
    assert resume(swarm) == ""
    swarm.run(3)
    assert {phase(swarm), phase(swarm, 1)} == {Phase.FLY}
    swarm.fly(900)
    assert_good(swarm)
    assert has(swarm, "takes its vehicle again; goes on at step 3: hold")


def test_a_vehicle_that_its_own_failsafe_took_comes_back_as_from_a_pilot() -> None:
    """An agent cannot tell the two apart: `resume` alone sets no mode. Once the failsafe's cause is
    gone, the operator sets the mode and commands `resume`."""
    swarm = holding("ardupilot")
    vehicle = firmware(swarm)
    vehicle.parameters.set("BATT_FS_LOW_ACT", 2)
    vehicle.parameters.set("BATT_LOW_MAH", 3300.0)
    swarm.wait(lambda s: phase(s) is Phase.YIELD)
    assert vehicle.mode.name == "RTL"
    assert "set GUIDED, then `resume` again" in resume(swarm)
    assert vehicle.mode.name == "RTL"
    vehicle.parameters.set("BATT_LOW_MAH", 0.0)
    switch(swarm, "ardupilot", "flown")
    swarm.run(3)
    assert resume(swarm) == ""
    swarm.fly(900)
    assert_good(swarm)


def firmware_mode(autopilot: str) -> str:
    return {"ardupilot": "GUIDED", "px4": "OFFBOARD"}[autopilot]


def test_a_vehicle_that_comes_back_to_a_swarm_that_lands_lands_too() -> None:
    """By policy `land` the other went down meanwhile."""
    swarm = piloted("ardupilot", "agent_lost: land")
    swarm.run(8)
    switch(swarm, "ardupilot", "flown")
    swarm.run(4)
    assert resume(swarm) == ""
    swarm.fly(900)
    assert swarm.all_down
    assert swarm.outcomes() == {1: "failed", 2: "failed"}


def test_a_swarm_goes_on_without_the_piloted_vehicle_and_takes_it_in_again() -> None:
    """By policy `continue`: the vehicle comes back at the step that the other is in."""
    swarm = piloted("ardupilot", "agent_lost: continue")
    status = swarm.members[1].status
    swarm.run(3)
    assert status is not None
    assert phase(swarm, 1) is Phase.FLY
    switch(swarm, "ardupilot", "flown")
    swarm.run(4)
    assert resume(swarm) == ""
    swarm.fly(900)
    assert_good(swarm)


def test_a_pilot_is_not_fought_by_a_landing_that_was_about_to_begin() -> None:
    """The other agent dies; while this one brakes before its landing, the pilot takes it."""
    swarm = holding("ardupilot", "agent_lost: land")
    swarm.kill(1)
    swarm.wait(lambda s: has(s, "land: agent 1"))
    switch(swarm, "ardupilot", "pilot")
    swarm.run(10)
    assert phase(swarm) is Phase.YIELD
    assert firmware(swarm).mode.name == "LOITER"


# --- a vehicle that falls ---


@pytest.mark.parametrize(
    ("autopilot", "at"),
    [("ardupilot", TAKEOFF), on_demand("ardupilot", HOLD), on_demand("px4", HOLD), ("px4", LAND)],
)
def test_disarmed_in_the_air(autopilot: str, at: int) -> None:
    """In the controlled mode, in the climb, or on its way down: failed within 1.5 s, by that
    reason."""
    swarm = at_step(mission(autopilot, "agent_lost: land"), at)
    swarm.wait(lambda s: s.in_step(at) and -s.hub.world.positions()[PILOTED - 1][2] > 4.0)
    swarm.run(0.5)
    firmware(swarm).disarm(force=True)
    swarm.run(1.5)
    (level,) = [level for level, text in said(swarm) if text.startswith("fall: the vehicle was")]
    assert level is Severity.ERROR
    swarm.fly(900)
    assert swarm.outcomes()[PILOTED] == "failed"
    assert swarm.all_down
    assert swarm.closest_m > swarm.plan.law.r_in * swarm.plan.unit_m


def test_a_px4_that_lands_by_other_hands_and_stays_armed_is_disarmed() -> None:
    """Its own disarming is off: the agent ends, and holds the run up no longer than that takes."""
    swarm = holding("px4", "agent_lost: land")
    firmware(swarm).parameters.set("COM_DISARM_LAND", -1.0)
    switch(swarm, "px4", "landing")
    swarm.wait(lambda s: phase(s) is Phase.ENDED, swarm.now + 60)
    assert not firmware(swarm).armed
    assert has(swarm, "AUTO.LAND by a pilot or by its own failsafe")
