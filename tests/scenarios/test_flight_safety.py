"""Geofence, battery, speed, tilt and lost links: each limit with each action, on the virtual
clock."""

from __future__ import annotations

import math
from typing import Any

import pytest

from swarm_ctl.core.model.messages import Phase
from swarm_ctl.core.model.plan import Policy
from swarm_ctl.mission.compile.loader import LoadedMission
from swarm_sim.firmware.protocol import telemetry
from tests.on_demand import on_demand
from tests.scenarios.swarm import VirtualSwarm, at_step, landing_fast
from tests.scenarios.test_steps import FORM, THIRD, of_kind, quartet, trio

ACTIONS = [Policy.LAND, Policy.RETURN, Policy.HOLD, Policy.CONTINUE]
OTHERS = (Policy.RETURN, Policy.LAND, Policy.CONTINUE)
"""Each policy acts alike, whatever its trigger (`test_battery` has them all)."""
PHASES = {
    Policy.LAND: Phase.LAND,
    Policy.RETURN: Phase.RETURN,
    Policy.HOLD: Phase.HOLD,
    Policy.CONTINUE: Phase.FLY,
}


def mission(
    policies: str, *, head: str = "", steps: tuple[str, ...] = ("hold: {duration_s: 12}", "land")
) -> LoadedMission:
    return trio(*steps, head=f"policies: {{{policies}}}\n{head}")


def reasons(swarm: VirtualSwarm) -> str:
    return "\n".join(event.text for event in swarm.events)


def in_third(mission: LoadedMission) -> VirtualSwarm:
    swarm = at_step(mission, THIRD)
    swarm.run(1)
    return swarm


def phase_of(swarm: VirtualSwarm, agent: int) -> Any:
    status = swarm.members[agent].status
    return status.phase if status else None


def settle(swarm: VirtualSwarm) -> None:
    """To the end: no two vehicles too near, all on the ground."""
    swarm.fly(1200)
    assert swarm.closest_m > swarm.plan.law.r_in * swarm.plan.unit_m
    assert swarm.all_down


@pytest.mark.parametrize("policy", ACTIONS)
def test_battery(policy: Policy) -> None:
    """Under the reserve, the agent does as the mission says; the others follow it down."""
    swarm = in_third(mission(f"battery_low: {policy.value}"))
    battery = swarm.hub.world.vehicles[1].firmware.battery
    battery.used_mah = 0.85 * battery.capacity_mah
    swarm.run(6)
    assert phase_of(swarm, 2) is PHASES[policy]
    assert ("battery at 15 %, the reserve is 20 %" in reasons(swarm)) is (
        policy is not Policy.CONTINUE
    )
    if policy is Policy.HOLD:
        swarm.command("land")
    settle(swarm)
    wanted = {Policy.CONTINUE: "completed", Policy.HOLD: "aborted"}.get(policy, "failed")
    assert swarm.outcomes()[2] == wanted
    if policy is Policy.RETURN:
        assert math.dist(swarm.positions()[2], swarm.plan.agent(2).start) < 1.5


FENCE = "fence: {polygon: [[-30, -30], [60, -30], [60, 60], [-30, 60]], height_m: 40}\n"


@pytest.mark.parametrize("policy", [Policy.HOLD, *map(on_demand, OTHERS)])
def test_fence(policy: Policy) -> None:
    """A vehicle blown towards the fence is stopped by its agent before it is far outside."""
    swarm = in_third(mission(f"fence: {policy.value}", head=FENCE))
    group = swarm.hub.world.vehicles[2]._group
    row = swarm.hub.world.vehicles[2]._row
    group.state.position[row, 0] += 62.0  # carried off at once: the worst gust there is
    swarm.run(3)
    assert phase_of(swarm, 3) in (
        PHASES[policy],
        Phase.HOLD if policy is Policy.LAND else PHASES[policy],
    )
    assert ("outside the geofence" in reasons(swarm)) is (policy is not Policy.CONTINUE)
    assert "drawn there" not in reasons(swarm)
    if policy in (Policy.HOLD, Policy.CONTINUE):
        swarm.command("land")
    swarm.fly(1200)
    assert swarm.all_down


@pytest.mark.parametrize("policy", [Policy.LAND, on_demand(Policy.RETURN)])
def test_tilt_and_speed(policy: Policy) -> None:
    """Leaning or racing more than allowed is a vehicle that does not do what it is told."""
    swarm = in_third(
        mission(
            f"too_fast: {policy.value}, max_tilt_deg: 5",
            steps=("move: {to: [90, 13], speed_mps: 5}", "land"),
        )
    )
    swarm.run(10)
    assert "leans" in reasons(swarm)
    settle(swarm)
    assert set(swarm.outcomes().values()) == {"failed"}
    swarm = in_third(
        mission(
            f"too_fast: {policy.value}, max_speed_mps: 2",
            steps=("move: {to: [90, 13], speed_mps: 4}", "land"),
        )
    )
    swarm.run(10)
    assert "m/s fast; allowed: 2 m/s" in reasons(swarm)
    settle(swarm)


WIND_SWITCHES = {"ardupilot": ("EK3_DRAG_BCOEF_X", "EK3_DRAG_BCOEF_Y"), "px4": ("EKF2_DRAG_CTRL",)}
"""What makes a vehicle estimate the wind; 0 as delivered."""


@pytest.mark.parametrize(
    ("autopilot", "policy"),
    [on_demand("ardupilot", Policy.LAND), ("px4", Policy.RETURN), on_demand("px4", Policy.HOLD)],
)
def test_wind(autopilot: str, policy: Policy) -> None:
    """Under the limit nothing happens; above it all do as the mission says, and a hold ends with
    the wind."""
    held = ("hold: {duration_s: 20}", "land")
    windy = mission(f"wind: {policy.value}, wind_limit_mps: 7", steps=held)
    swarm = landing_fast(VirtualSwarm(of_kind(windy, autopilot)))
    for vehicle in swarm.hub.world.vehicles:
        for name in WIND_SWITCHES[autopilot]:
            vehicle.firmware.parameters.set(name, 12.0)
    swarm.wait(lambda s: s.in_step(THIRD))
    assert not [e for e in swarm.events if "does not estimate the wind" in e.text]
    blow(swarm, 6.0)
    swarm.run(8)
    assert swarm.phases() == {Phase.FLY}
    blow(swarm, 9.0)
    swarm.run(8)
    assert PHASES[policy] in swarm.phases()
    assert "wind of 9.0 m/s; allowed: 7 m/s" in reasons(swarm)
    blow(swarm, 2.0)
    settle(swarm)
    assert set(swarm.outcomes().values()) == {"completed" if policy is Policy.HOLD else "failed"}


def blow(swarm: VirtualSwarm, speed_mps: float) -> None:
    for vehicle in swarm.hub.world.vehicles:
        vehicle.firmware.parameters.set("SIM_WIND_SPD", speed_mps)
        vehicle.firmware.parameters.set("SIM_WIND_DIR", 250.0)


@pytest.mark.parametrize("autopilot", WIND_SWITCHES)
def test_without_an_estimate_the_tilt_limit_stands_in(autopilot: str) -> None:
    """A vehicle as delivered tells no wind (ArduCopter: one of 0); it has to lean against it all
    the same. Each agent says once, before it arms, that a chosen wind limit can't act."""
    calm = mission("too_fast: land, max_tilt_deg: 9, wind_limit_mps: 11")
    swarm = at_step(of_kind(calm, autopilot), THIRD)
    blow(swarm, 13.0)
    swarm.run(15)
    assert "wind of" not in reasons(swarm)
    assert "leans" in reasons(swarm)
    warned = [e.agent for e in swarm.events if "does not estimate the wind" in e.text]
    assert sorted(warned) == sorted(swarm.members)
    swarm.fly(1200)
    assert swarm.all_down


@pytest.mark.parametrize("policy", [Policy.HOLD, *map(on_demand, OTHERS)])
def test_station_lost(policy: Policy) -> None:
    """Each policy does what it says."""
    swarm = in_third(mission(f"station_lost: {policy.value}"))
    swarm.station_alive = False
    swarm.run(10)
    assert PHASES[policy] in swarm.phases()
    swarm.station_alive = policy is Policy.HOLD
    settle(swarm)
    wanted = "completed" if policy in (Policy.CONTINUE, Policy.HOLD) else "failed"
    assert set(swarm.outcomes().values()) == {wanted}
    if policy is Policy.RETURN:
        assert all(math.dist(swarm.positions()[a.id], a.start) < 1.5 for a in swarm.plan.agents)


def test_without_a_mesh_no_agent_returns() -> None:
    """`agent_lost: return` without a peer to hear: no order to keep, so each agent lands where it
    is."""
    swarm = in_third(mission("agent_lost: return, station_lost: return"))
    before = swarm.positions()
    for member in swarm.members.values():
        member.node.close()
    settle(swarm)
    assert all(math.dist(before[i], at) < 3.0 for i, at in swarm.positions().items())


def test_defaults_are_safe() -> None:
    """What a mission does not say: land, a fence around all that is planned, a fifth of the battery
    kept."""
    plan = quartet("land").plan
    safe = plan.policies
    assert {
        safe.fence,
        safe.battery_low,
        safe.too_fast,
        safe.wind,
        safe.agent_lost,
        safe.station_lost,
    } == {Policy.LAND}
    assert safe.battery_reserve_percent == 20
    assert plan.fence is not None
    assert plan.fence.height_m == 120
    assert len(plan.fence.polygon_m) == 4


# --- what a vehicle says against its own estimate ---


def second(swarm: VirtualSwarm, parameter: str, value: float) -> None:
    """Set a parameter of agent 2's vehicle."""
    swarm.hub.world.vehicles[1].firmware.parameters.set(parameter, value)


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_no_vehicle_takes_off_before_its_position_is_accurate(autopilot: str) -> None:
    """One bad vehicle keeps all on the ground; they fly once it is good."""
    swarm = VirtualSwarm(of_kind(mission(""), autopilot))
    second(swarm, "SIM_GPS_ACC", 3.4)
    swarm.run(8)
    assert swarm.phases() == {Phase.PREPARE}
    status = swarm.members[2].status
    assert status is not None
    assert status.reason == "position accuracy 3.4 m; allowed: at most 1.0 m"
    assert status.position_accuracy_m == pytest.approx(3.4)
    second(swarm, "SIM_GPS_ACC", 0.9)
    swarm.wait(lambda s: s.in_step(FORM))
    assert "hold:" not in reasons(swarm)


@pytest.mark.parametrize(
    ("autopilot", "policy"),
    [
        ("ardupilot", Policy.HOLD),
        ("px4", Policy.LAND),
        on_demand("ardupilot", Policy.LAND),
        on_demand("px4", Policy.HOLD),
    ],
)
def test_an_estimate_that_gets_bad_in_the_air(autopilot: str, policy: Policy) -> None:
    swarm = in_third(of_kind(mission(f"estimate: {policy.value}"), autopilot))
    second(swarm, "SIM_GPS_ACC", 1.9)
    swarm.run(5)
    assert swarm.phases() == {Phase.FLY}
    second(swarm, "SIM_GPS_ACC", 3.4)
    swarm.run(4)
    assert Phase.HOLD in swarm.phases()
    assert "position accuracy 3.4 m; allowed: at most 2.0 m" in reasons(swarm)
    second(swarm, "SIM_GPS_ACC", 0.3)
    settle(swarm)
    assert set(swarm.outcomes().values()) == {"completed" if policy is Policy.HOLD else "failed"}


def test_a_gps_that_jumps_is_seen_by_the_estimator_and_held_through() -> None:
    """A jump of 4.4 m: a real ArduCopter refuses it for 7 s and speaks of a glitch until 17 s."""
    swarm = in_third(mission(""))
    second(swarm, "SIM_GPS_JUMP_N", 4.4)
    swarm.run(5)
    assert Phase.HOLD in swarm.phases()
    assert "the estimator's horizontal position differs from its sensors (1.17" in reasons(swarm)
    swarm.run(10)
    assert Phase.HOLD in swarm.phases()
    settle(swarm)
    assert set(swarm.outcomes().values()) == {"completed"}


@pytest.mark.parametrize("name", ["EKF_STATUS_REPORT", "GPS_RAW_INT"])
def test_an_estimate_that_is_no_longer_told_is_not_good(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    swarm = in_third(mission(""))
    monkeypatch.setitem(telemetry.MESSAGES, name, (telemetry.MESSAGES[name][0], lambda _: None))
    swarm.run(7)
    assert Phase.HOLD in swarm.phases()
    assert f"no {name} for 3 s" in reasons(swarm)


# --- a mission faster than the vehicle ---


@pytest.mark.parametrize(
    ("autopilot", "parameter", "value", "refusal"),
    [
        ("px4", "MPC_XY_VEL_MAX", 4.0, "flies 5.0 m/s; vehicle 2 allows 4.0 (MPC_XY_VEL_MAX 4)"),
        ("ardupilot", "WPNAV_ACCEL", 100.0, "vehicle 2 allows 1.2 (WPNAV_ACCEL 100)"),
        ("px4", "MPC_Z_VEL_MAX_DN", 0.5, "descends 1.0 m/s; vehicle 2 allows 0.5"),
    ],
)
def test_a_mission_faster_than_a_vehicle_stays_on_the_ground(
    autopilot: str, parameter: str, value: float, refusal: str
) -> None:
    fast = mission("", head="vehicle: {limits: {speed_mps: 5}}\n")
    swarm = VirtualSwarm(of_kind(fast, autopilot))
    second(swarm, parameter, value)
    swarm.run(8)
    assert swarm.phases() == {Phase.PREPARE}
    status = swarm.members[2].status
    assert status is not None
    assert refusal in status.reason
