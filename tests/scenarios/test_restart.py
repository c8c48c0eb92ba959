"""An agent that is killed in flight and started again: takes its vehicle over and rejoins, or
leaves it alone."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import numpy as np
import pytest

from swarm_ctl.core.agent.takeover import LEARN_S
from swarm_ctl.core.model.messages import Phase
from swarm_ctl.core.model.plan import Plan, Policy
from swarm_ctl.mission.compile.loader import LoadedMission, loads
from tests.on_demand import on_demand
from tests.scenarios.swarm import VirtualSwarm, assert_arrives, at_step, landing_fast
from tests.scenarios.test_steps import (
    FORM,
    TAKEOFF,
    THIRD,
    TRIO,
    assert_good,
    of_kind,
    quartet,
    shape_error_m,
    trio,
)
from tests.unit.plans import steps_of

GONE_S = 1.5
"""From the kill to the new process: Python starts in half a second."""
TALL = TRIO.replace("height_m: 4}", "height_m: 8}")
"""High enough to be gone, and back, on the way up."""
MISSIONS = {
    "takeoff": (TAKEOFF, 3.0, loads(TALL + "  - hold: {duration_s: 5}\n  - land\n")),
    "form": (FORM, 2.0, trio("hold: {duration_s: 5}", "land")),
    "hold": (THIRD, 5.0, trio("hold: {duration_s: 20}", "land")),
    "move": (THIRD, 4.0, trio("move: {to: [30, 13], speed_mps: 2}", "land")),
    "rotate": (THIRD, 6.0, trio("rotate: {angle_deg: 90}", "hold: {duration_s: 5}", "land")),
    "land": (THIRD, 1.0, trio("land")),
}


def texts(swarm: VirtualSwarm) -> str:
    return "\n".join(event.text for event in swarm.events)


def parameters(swarm: VirtualSwarm) -> list[dict[str, float]]:
    """Of each vehicle."""
    known = [vehicle.firmware.parameters for vehicle in swarm.hub.world.vehicles]
    return [{name: own[name] for name in own.names} for own in known]


def killed(mission: LoadedMission, step: int, after_s: float, agent: int) -> VirtualSwarm:
    landing = step == len(steps_of(mission.plan))
    swarm = at_step(mission, step, as_delivered=landing)
    swarm.run(after_s)
    swarm.kill(agent)
    return swarm


def restarted(
    mission: LoadedMission, step: int, after_s: float, agent: int, plan: Plan | None = None
) -> VirtualSwarm:
    swarm = killed(mission, step, after_s, agent)
    swarm.run(GONE_S)
    swarm.restart(agent, plan)
    return swarm


def most_acceleration(swarm: VirtualSwarm, agent: int, seconds: float) -> float:
    """Of its vehicle over the ground, averaged over a tick [m/s2]."""
    place, most = [a.id for a in swarm.plan.agents].index(agent), 0.0
    before = swarm.hub.world.velocities()[place][:2].copy()
    for _ in range(round(seconds / swarm.plan.tick_s)):
        swarm.tick()
        now = swarm.hub.world.velocities()[place][:2].copy()
        most = max(most, float(np.linalg.norm(now - before)) / swarm.plan.tick_s)
        before = now
    return most


@pytest.mark.parametrize("agent", [1, on_demand(3)])
@pytest.mark.parametrize(
    "where", ["takeoff", "form", "move", on_demand("hold"), on_demand("rotate")]
)
def test_rejoins(where: str, agent: int) -> None:
    """In every step, the pinned agent (1) and another: they go on to the landing, in shape, without
    a jerk, apart."""
    step, after_s, mission = MISSIONS[where]
    swarm = restarted(mission, step, after_s, agent)
    swarm.wait(
        lambda s: f"took over its vehicle in the air; rejoins at step {step}" in texts(s),
        swarm.now + 6,
    )
    assert most_acceleration(swarm, agent, LEARN_S) < 0.3
    height_m = -swarm.hub.world.positions()[agent - 1][2]
    assert_arrives(swarm)
    assert shape_error_m(swarm, len(steps_of(swarm.plan))) < 1.0
    if step != TAKEOFF:
        assert height_m == pytest.approx(4.0, abs=0.5)


def test_rejoins_a_landing() -> None:
    """The others are on their way down as planned: it goes down as well, and has completed."""
    swarm = restarted(*_row("land"), 2)
    swarm.fly(900)
    assert_good(swarm)


def _row(name: str) -> tuple[LoadedMission, int, float]:
    step, after_s, mission = MISSIONS[name]
    return mission, step, after_s


def test_comes_too_late() -> None:
    """After `agent_lost_after_s` the others hold and land; so does it, from where it stands."""
    swarm = killed(*_row("form"), 3)
    swarm.run(6.5)
    assert swarm.phases() & {Phase.HOLD, Phase.LAND}
    swarm.restart(3)
    swarm.fly(900)
    assert_good(swarm, "failed")


def test_one_that_ended_before_is_waited_for_by_none_that_starts_again() -> None:
    """It was never heard by the new process: the others, which have heard it land, go on, and so
    does that one."""
    swarm = at_step(trio("hold: {duration_s: 25}", "form: {shape: row}", "land"), THIRD)
    swarm.command("land", (1,))
    swarm.wait(lambda s: 1 in s.outcomes())
    swarm.run(4.0)
    swarm.kill(2)
    swarm.run(GONE_S)
    swarm.restart(2)
    swarm.fly(900)
    assert {swarm.outcomes()[agent] for agent in (2, 3)} == {"completed"}
    assert swarm.all_down


def test_another_plan_leaves_the_vehicle_alone() -> None:
    """It sends nothing that moves it, ends, and says why; the others land by the mission's
    policy."""
    mission, step, after_s = _row("form")
    swarm = restarted(mission, step, after_s, 3, replace(mission.plan, kappa=19.0))
    swarm.wait(lambda s: 3 in s.outcomes())
    assert set(swarm.members[3].goals) == {"StandbyGoal", "ReleaseGoal"}
    assert "is not taken over: agent 1 has another plan" in texts(swarm)
    swarm.fly(900)
    swarm.wait(lambda s: s.all_down, swarm.now + 60)
    assert_good(swarm, "failed")


@pytest.mark.parametrize("mode", [5, on_demand(17)])
def test_a_pilot_keeps_the_vehicle(mode: int) -> None:
    """LOITER and BRAKE of an ArduCopter are a pilot's modes: yielded, not a setpoint, the mode
    stays."""
    swarm = killed(*_row("form"), 3)
    swarm.hub.world.vehicles[2].firmware.set_mode(1, mode)
    swarm.run(GONE_S)
    swarm.restart(3)
    swarm.run(5)
    assert set(swarm.members[3].goals) <= {"StandbyGoal", "YieldGoal"}
    assert swarm.members[3].goals[-1] == "YieldGoal"
    assert "not taken over" in texts(swarm)
    assert swarm.hub.world.vehicles[2].firmware.mode.custom == mode


def test_no_other_agent_flies() -> None:
    """Without a peer in the air there is no proof that the vehicle is ours: left to its failsafe,
    which lands it."""
    swarm = killed(*_row("hold"), 3)
    for agent in (1, 2):
        swarm.kill(agent)
    swarm.station_alive = False
    swarm.run(GONE_S)
    swarm.restart(3)
    start = swarm.now
    swarm.wait(lambda s: 3 in s.outcomes())
    assert swarm.now - start < 10
    assert "no agent that flies this mission is heard" in texts(swarm)
    assert set(swarm.members[3].goals) == {"StandbyGoal", "ReleaseGoal"}
    swarm.wait(lambda s: s.all_down, swarm.now + 60)


def test_an_operators_land_is_proof_enough() -> None:
    """Nobody else is heard; the operator has said whose this vehicle is, and it is landed."""
    swarm = killed(*_row("hold"), 3)
    for agent in (1, 2):
        swarm.kill(agent)
    swarm.run(GONE_S)
    swarm.restart(3)
    swarm.command("land", (3,))
    swarm.wait(lambda s: 3 in s.outcomes(), swarm.now + 60)
    assert "took over its vehicle in the air, to land it" in texts(swarm)
    assert set(swarm.members[3].goals) == {"StandbyGoal", "LandGoal", "ReleaseGoal"}
    assert not swarm.hub.world.airborne()[2]


def test_two_with_one_id() -> None:
    """An agent that is started while its like still flies does not touch the vehicle."""
    swarm = at_step(MISSIONS["hold"][2], THIRD)
    first = swarm.members[3]
    place = swarm._far[2]
    swarm.restart(3)
    second, swarm._far[2] = swarm.members[3], place
    second.link = first.link  # it sees the same vehicle
    for _ in range(80):
        swarm.tick()
        for _ in swarm._turn(first):
            pass
    assert "FlyGoal" not in second.goals
    assert "another process speaks as agent 3" in (second.status.reason if second.status else "")


def test_px4_that_lands_is_seen_down() -> None:
    """A PX4 left OFFBOARD for good and lands: the new process does not stop it, and the mission is
    over."""
    swarm = restarted(of_kind(MISSIONS["hold"][2], "px4"), THIRD, 3.0, 2)
    swarm.fly(900)
    assert "lands already (AUTO.LAND): seen down" in texts(swarm)
    assert "FlyGoal" not in swarm.members[2].goals
    assert_good(swarm, "failed")


@pytest.mark.parametrize("autopilot", [on_demand("ardupilot"), "px4"])
def test_one_that_wakes_from_a_stop_waits_for_its_vehicles_word(autopilot: str) -> None:
    """SIGSTOP for 10 s: its vehicle lands by itself. The agent ends when it sees it down, and gives
    it its own parameters back."""
    mission = of_kind(MISSIONS["hold"][2], autopilot)
    before = parameters(landing_fast(VirtualSwarm(mission)))
    swarm = at_step(mission, THIRD)
    assert parameters(swarm) != before
    swarm.members[2].frozen = True
    swarm.run(10.0)
    while swarm._far[1]._outbox:  # a full socket keeps what came first, without a heartbeat
        swarm._far[1]._outbox.popleft()
    swarm.members[2].frozen = False
    swarm.wait(lambda s: s.members[2].ended is not None)
    assert not swarm.hub.world.airborne()[1], "it ended in the air"
    swarm.fly(900)
    assert "no heartbeat" not in texts(swarm)
    assert parameters(swarm) == before
    assert swarm.all_down


def test_px4_whose_agent_dies_at_take_off_lands() -> None:
    """It climbs by the agent's setpoints: without them it lands, as in every later step."""
    swarm = restarted(of_kind(MISSIONS["takeoff"][2], "px4"), TAKEOFF, 6.0, 2)
    swarm.fly(900)
    assert "lands already (AUTO.LAND): seen down" in texts(swarm)
    assert "AirborneGoal" not in swarm.members[2].goals
    assert swarm.all_down


def test_an_operators_hold_outlives_the_agent() -> None:
    """The new process does not know the command: it holds until the operator ends it, then goes on
    with the others."""
    swarm = at_step(MISSIONS["move"][2], THIRD)
    swarm.run(3)
    swarm.command("hold")
    swarm.run(2)
    swarm.kill(2)
    swarm.run(GONE_S)
    swarm.restart(2)
    swarm.run(6)
    before = swarm.positions()
    swarm.run(5)
    assert all(math.dist(before[i], at) < 0.5 for i, at in swarm.positions().items())
    assert swarm.phases() == {Phase.FLY, Phase.HOLD}
    swarm.command("resume", name="c2")
    assert_arrives(swarm)


def test_an_operators_kill_counts_for_any_vehicle() -> None:
    """Confirmed by hand, it is carried out although nothing is decided about the vehicle yet."""
    swarm = restarted(*_row("hold"), 3)
    swarm.run(0.5)
    swarm.command("kill", agents=(3,))
    swarm.run(3)
    assert "TerminateGoal" in swarm.members[3].goals
    assert "FlyGoal" not in swarm.members[3].goals


@pytest.mark.parametrize("step", [THIRD, THIRD + 1])
def test_one_that_finds_its_vehicle_landed_never_takes_off(step: int) -> None:
    """Killed in the hold, or in the landing, and started again once its vehicle is down: it does
    not arm, and ends."""
    head = "policies: {agent_lost: continue}\n"
    hold_s = 60 if step == THIRD else 1
    swarm = at_step(trio(f"hold: {{duration_s: {hold_s}}}", "land", head=head), step)
    swarm.run(1.0)
    swarm.kill(2)
    swarm.wait(lambda s: not s.hub.world.airborne()[1], swarm.now + 60)
    swarm.run(3.0)
    swarm.restart(2)
    swarm.wait(lambda s: s.members[2].ended is not None, swarm.now + 30)
    assert "AirborneGoal" not in swarm.members[2].goals
    assert swarm.outcomes()[2] == "failed"
    assert "the swarm flies already" in texts(swarm)


class Again:
    """A drawn moment of a take-off, from `prepare` to the first of `form`, at which an agent is
    killed and, a drawn time later, started again."""

    def __init__(self, seed: int) -> None:
        draw = random.Random(seed)
        mission = quartet("hold: {duration_s: 5}", "land")
        kinds = draw.choice([("ardupilot",), ("px4",), ("ardupilot", "px4")])
        agents = tuple(replace(a, autopilot=draw.choice(kinds)) for a in mission.fleet.agents)
        policies = replace(mission.plan.policies, agent_lost=draw.choice(list(LOST)))
        plan = replace(mission.plan, policies=policies)
        mission = replace(mission, plan=plan, fleet=replace(mission.fleet, agents=agents))
        self.swarm = swarm = landing_fast(VirtualSwarm(mission, seed + 1))
        self.agent = draw.choice(swarm.plan.agents).id
        step, off = draw.choice([(0, False), (TAKEOFF, False), (TAKEOFF, True), (FORM, True)])
        own = swarm.members[self.agent]
        swarm.wait(lambda _: own.status is not None and own.status.step == step)
        swarm.wait(lambda _: self.airborne >= off)
        swarm.run(draw.uniform(0.0, 3.0))
        swarm.kill(self.agent)
        swarm.run(draw.choice([draw.uniform(0.3, 8.0), draw.uniform(8.0, 25.0)]))

    @property
    def airborne(self) -> bool:
        """Its vehicle, by truth."""
        place = [a.id for a in self.swarm.plan.agents].index(self.agent)
        return self.swarm.hub.world.airborne()[place]

    @property
    def others_take_off(self) -> bool:
        """Each of the others is there and takes off: none winds its flight down."""
        others = [m for i, m in self.swarm.members.items() if i != self.agent]
        phases = {m.status.phase for m in others if m.alive and m.status is not None}
        return all(m.alive for m in others) and phases <= {Phase.PREPARE, Phase.ARM, Phase.TAKEOFF}

    def joined(self) -> bool:
        """It is with the others in a step after the take-off."""
        members = self.swarm.members.values()
        return all(m.alive and m.status is not None and m.status.step > TAKEOFF for m in members)


LOST = (Policy.LAND, Policy.HOLD, Policy.CONTINUE, Policy.RETURN)
TOLD = (2, 4, 18)
"""It ends on the ground; it takes off and joins; it joins in the air. Of all 60: 26, 21, 4, and 9
that see their vehicles land."""


@pytest.mark.parametrize("seed", [s if s in TOLD else on_demand(s) for s in range(60)])
def test_one_that_comes_back_to_a_take_off_joins_or_ends(seed: int) -> None:
    """Its vehicle leaves the ground only while all others take off, too; then all go on
    together."""
    again = Again(seed)
    swarm, flew, lifted = again.swarm, again.airborne, False
    swarm.restart(again.agent)
    own = swarm.members[again.agent]
    while own.ended is None and not again.joined():
        before = again.others_take_off
        swarm.tick()
        if again.airborne and not flew:
            assert before, "it takes off alone"
            lifted = True
        flew = again.airborne
        assert swarm.now < 200.0, texts(swarm)
    assert own.ended is None or not lifted, own.ended
    assert own.ended is None or not again.airborne, own.ended
    assert swarm.closest_m > swarm.plan.law.r_in * swarm.plan.unit_m


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_a_climb_that_a_hold_has_stopped_goes_on(autopilot: str) -> None:
    """An agent is away as the others climb: they hold, below their height, until it is back. Those
    that went on were taken for fallen out of height; an ArduCopter takes no second take-off in the
    air, and hung there until the step's time was over."""
    head = "policies: {agent_lost: hold, agent_lost_after_s: 8}\n"
    swarm = at_step(of_kind(trio("land", head=head, height_m=16), autopilot), TAKEOFF)
    swarm.kill(2)
    swarm.wait(lambda s: Phase.HOLD in s.phases())
    swarm.run(8.0)
    assert not swarm.hub.world.armed()[1]
    heights = [-swarm.hub.world.positions()[place][2] for place in (0, 2)]
    assert 1.0 < min(heights) < 12.0
    swarm.restart(2)
    swarm.wait(lambda s: s.in_step(FORM), swarm.now + 40.0)
    assert min(-down for _, _, down in swarm.hub.world.positions()) > 14.0
