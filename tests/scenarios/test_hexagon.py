"""The hexagon on the virtual clock, nominal and broken in every way that `core/agent/failsafes.py`
knows."""

from __future__ import annotations

from dataclasses import replace

import pytest

from swarm_ctl.core.agent.agent import Agent
from swarm_ctl.core.model.causes import Cause
from swarm_ctl.core.model.messages import Outcome, Phase, Severity
from swarm_ctl.mission.compile.loader import LoadedMission, loads
from swarm_ctl.report.judge.verdict import judge
from swarm_ctl.runfolder.last_statuses import LastStatus
from swarm_ctl.runfolder.run_folder import RunFolder
from tests.on_demand import on_demand
from tests.scenarios.swarm import VirtualSwarm, at_step, landing_fast, low_hexagon, low_hexagon_text
from tests.unit.plans import with_group

TAKEOFF, FORM, HOLD, LAND = 1, 2, 3, 4


@pytest.fixture(scope="module")
def hexagon() -> LoadedMission:
    """With little patience on the ground."""
    mission = low_hexagon()
    return replace(mission, plan=replace(mission.plan, prepare_timeout_s=20.0))


def texts(swarm: VirtualSwarm) -> str:
    return "\n".join(event.text for event in swarm.events)


def assert_safe(swarm: VirtualSwarm) -> None:
    """No two vehicles under r_in, all on the ground and disarmed."""
    assert swarm.closest_m > swarm.plan.law.r_in * swarm.plan.unit_m
    assert swarm.all_down


@pytest.mark.parametrize(
    ("response", "said"),
    [
        ("dead_time_s: 0, lag_s: 0.15", "s later than its response says, which is known to 0.2 s"),
        ("dead_time_s: 0.2, lag_s: 0.5", ""),
    ],
)
def test_a_vehicle_unlike_its_response_is_said_in_flight(response: str, said: str) -> None:
    """By each agent, once; and nothing of it where the response fits."""
    section = f"vehicle: {{response: {{{response}, doubt_s: 0.2}}}}\n"
    swarm = VirtualSwarm(loads(low_hexagon_text() + section))
    swarm.fly(25)
    found = [event for event in swarm.events if "its response says" in event.text]
    assert sorted(event.agent for event in found) == ([1, 2, 3, 4, 5, 6] if said else [])
    assert all(said in event.text for event in found)
    assert all(event.level == Severity.WARNING for event in found)
    assert swarm.closest_m > swarm.plan.law.r_in * swarm.plan.unit_m


def test_mixed_personas(hexagon: LoadedMission) -> None:
    """Half ArduCopter, half PX4 fly one formation: all agents complete all steps, apart, each
    asking for the same."""
    agents = tuple(
        replace(a, autopilot=("ardupilot", "px4")[a.id % 2]) for a in hexagon.fleet.agents
    )
    swarm = VirtualSwarm(replace(hexagon, fleet=replace(hexagon.fleet, agents=agents)))
    swarm.fly(300)
    assert swarm.outcomes() == dict.fromkeys(range(1, 7), "completed")
    assert_safe(swarm)
    for member in swarm.members.values():
        assert member.goals == ["StandbyGoal", "AirborneGoal", "FlyGoal", "LandGoal", "ReleaseGoal"]


@pytest.mark.parametrize("step", [0, FORM, on_demand(TAKEOFF), on_demand(HOLD)])
def test_told_to_end(hexagon: LoadedMission, step: int) -> None:
    """When `run` is gone, agents land (or end at once where nothing flies yet)."""
    swarm = at_step(hexagon, step)
    swarm.run(1)
    swarm.told_to_end = "the process that started this agent is gone"
    start = swarm.now
    swarm.fly(400)
    assert set(swarm.outcomes().values()) == {"aborted"}
    assert swarm.all_down
    if step == 0:
        assert swarm.now - start < 5


def test_simulator_gone(hexagon: LoadedMission) -> None:
    """Vehicles that fall silent end every agent, failed, in bounded time."""
    swarm = at_step(hexagon, FORM)
    swarm.simulator_alive = False
    start = swarm.now
    swarm.fly(400)
    assert set(swarm.outcomes().values()) == {"failed"}
    assert swarm.now - start < 30


def test_a_frozen_agent_sends_nothing(hexagon: LoadedMission) -> None:
    """Deadman: a stalled control loop stops the setpoints; its vehicle stops by its own
    failsafe."""
    swarm = at_step(hexagon, FORM)
    swarm.run(3)
    swarm.members[1].frozen = True
    swarm.run(5)
    place = [a.id for a in swarm.plan.agents].index(1)
    assert abs(swarm.hub.world.velocities()[place][:2]).max() < 0.1


def test_another_plan_does_not_arm(hexagon: LoadedMission) -> None:
    """An agent with a different plan keeps the whole swarm on the ground, and every agent says
    why."""
    swarm = landing_fast(VirtualSwarm(hexagon))
    other = replace(hexagon.plan, kappa=19.0)
    swarm.members[4].agent = Agent(other, 4, 0.0)
    swarm.run(8)
    assert swarm.phases() == {Phase.PREPARE}
    reasons = [m.status.reason for m in swarm.members.values() if m.status]
    assert all("another plan" in reason for reason in reasons)


def test_a_vehicle_on_the_wrong_spot_does_not_arm(hexagon: LoadedMission) -> None:
    """A vehicle further than a unit from its planned start is not armed: N_i would be a lie."""
    agents = tuple(
        replace(a, start=(a.start[0], a.start[1] + 2.0)) if a.id == 3 else a
        for a in hexagon.plan.agents
    )
    swarm = landing_fast(VirtualSwarm(hexagon))
    swarm.plan = elsewhere = with_group(hexagon.plan, agents=agents)
    swarm._plan_hash = elsewhere.hash()
    for agent_id, member in swarm.members.items():
        member.agent = Agent(elsewhere, agent_id, 0.0)
    swarm.run(8)
    status = swarm.members[3].status
    assert status is not None
    assert "10.0 m from its planned start" in status.reason
    swarm.fly(hexagon.plan.prepare_timeout_s + 10)
    assert swarm.all_down
    last = {i: LastStatus(m.status, final=True) for i, m in swarm.members.items() if m.status}
    outcome, reason, cause = judge(RunFolder(None, None, {}, None, tuple(last), last, []), {})
    assert (outcome, cause) == (Outcome.FAILED, Cause.TIMEOUT)
    assert "step 0 (prepare) timed out after 20 s: agent 3 not ready" in reason
    assert "not ready: the vehicle stands 10.0 m from its planned start" in reason


def test_preparation_times_out(hexagon: LoadedMission) -> None:
    """An agent that never shows up ends the others, in bounded time, on the ground."""
    swarm = landing_fast(VirtualSwarm(hexagon))
    swarm.kill(2)
    swarm.fly(hexagon.plan.prepare_timeout_s + 10)
    assert set(swarm.outcomes().values()) == {"failed"}
    assert "(prepare) timed out after 20 s: not ready: agent 2 not heard" in texts(swarm)
    assert swarm.all_down


def test_a_peer_silent_on_the_ground_is_waited_for(hexagon: LoadedMission) -> None:
    """Ten seconds of silence before take-off (a busy machine, a radio that is plugged in late) end
    nothing."""
    swarm = landing_fast(VirtualSwarm(hexagon))
    swarm.members[2].frozen = True
    swarm.run(1)
    swarm.members[2].frozen = False
    swarm.wait(lambda s: s.now > 2.5)
    swarm.members[2].frozen = True
    swarm.run(10)
    assert swarm.phases() == {Phase.PREPARE}
    swarm.members[2].frozen = False
    swarm.wait(lambda s: s.in_step(FORM))
