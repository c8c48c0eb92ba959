"""What a pilot does to a vehicle, what a forged heartbeat does not, and a vehicle that is disarmed
or falls: on the virtual clock, with both personas."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarm_ctl.core.model.messages import Phase, Severity
from swarm_ctl.mission.compile.loader import loads
from tests.scenarios.swarm import VirtualSwarm
from tests.scenarios.test_steps import assert_good

TEXT = """\
version: 1
name: pair
origin: {{lat_deg: -35.36, lon_deg: 149.16, alt_m: 584}}
unit_m: 1
law: {{r: 20, r_out: 6, r_in: 2.5}}
agents: [{{id: 1, start: [0, 0]}}, {{id: 2, start: [0, 9]}}]
shapes: {{row: {{kind: line, spacing: 9}}}}
fleet: {{agents: [{{id: 1, autopilot: {autopilot}}}, {{id: 2, autopilot: {autopilot}}}]}}
policies: {{{policies}}}
steps:
  - takeoff: {{height_m: 8}}
  - form: {{shape: row, settle_s: 2}}
  - hold: {{duration_s: {hold_s}}}
  - land
"""
TAKEOFF, HOLD, LAND = 1, 3, 4
MODES = {
    "ardupilot": {"flown": 4, "pilot": 5, "landing": 9},
    "px4": {"flown": 6 << 16, "pilot": 3 << 16, "landing": 4 << 16 | 6 << 24},
}
WIRE_ID = {"ardupilot": 3, "px4": 12}
PILOTED = 2
"""The agent of the vehicle that the pilot takes."""
both = pytest.mark.parametrize("autopilot", MODES)


def mission(autopilot: str, policies: str = "agent_lost: hold", hold_s: float = 8) -> VirtualSwarm:
    text = TEXT.format(autopilot=autopilot, policies=policies, hold_s=hold_s)
    return VirtualSwarm(loads(text))


def holding(autopilot: str, policies: str = "agent_lost: hold") -> VirtualSwarm:
    """Two agents hold their formation."""
    swarm = mission(autopilot, policies, 40)
    swarm.wait(lambda s: s.in_step(HOLD))
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
    swarm, count = mission(autopilot), 0
    swarm.wait(lambda s: all(s.hub.world.airborne()))
    while swarm.now < 400 and all(member.alive for member in swarm.members.values()):
        mode, armed = FORGERIES[count % len(FORGERIES)]
        forged(swarm, autopilot, mode, agent=1 + count % 2, armed=armed)
        count += 1
        swarm.run(2.7)
    assert_good(swarm)
    assert count > 10
    assert has(swarm, "a heartbeat said")


@both
def test_a_flood_of_forged_heartbeats_lands_no_vehicle_and_keeps_none_up(autopilot: str) -> None:
    """Twenty a second, from the middle of the flight to the end."""
    swarm = mission(autopilot)
    swarm.wait(lambda s: s.in_step(HOLD))
    for _ in range(7 * 20):
        forged(swarm, autopilot, "pilot")
        swarm.tick()
    assert not has(swarm, "by a pilot")
    while swarm.now < 400 and not swarm.all_down:
        forged(swarm, autopilot, "pilot")
        swarm.tick()
    assert swarm.all_down
    assert set(swarm.outcomes().values()) <= {"completed"}


# --- a vehicle that falls ---


@pytest.mark.parametrize(
    ("autopilot", "at"), [("ardupilot", TAKEOFF), ("ardupilot", HOLD), ("px4", HOLD), ("px4", LAND)]
)
def test_disarmed_in_the_air(autopilot: str, at: int) -> None:
    """In the controlled mode, in the climb, or on its way down: failed within 1.5 s, by that
    reason."""
    swarm = mission(autopilot, "agent_lost: land")
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
