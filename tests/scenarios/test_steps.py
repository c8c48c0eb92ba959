"""Steps that move a formation as a whole, and the way back, on the virtual clock."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swarm_ctl.core.law.formation import formation_error
from swarm_ctl.core.model.messages import Phase, ReturnStage
from swarm_ctl.core.model.plan import Policy
from swarm_ctl.mission.compile.loader import LoadedMission, load, loads
from tests.on_demand import on_demand
from tests.scenarios.swarm import VirtualSwarm, assert_arrives, at_step, landing_fast

TEXT = """\
# At half the usual rate, and for half the work; test_missions.py and others fly at 20 Hz.
version: 1
name: quartet
origin: {lat_deg: -35.36, lon_deg: 149.16, alt_m: 584}
unit_m: 1
tick_s: 0.1
law: {r: 20, r_out: 6, r_in: 2.5}
agents:
  - {id: 1, start: [0, 0]}
  - {id: 2, start: [0, 9]}
  - {id: 3, start: [0, 18]}
  - {id: 4, start: [0, 27]}
shapes:
  row: {kind: line, spacing: 9}
  square: {kind: grid, spacing: 9, columns: 2}
steps:
  - takeoff: {height_m: 4}
  - form: {shape: square, settle_s: 2}
"""
TRIO = TEXT.replace("  - {id: 4, start: [0, 27]}\n", "")
"""Where the fourth would only cost."""
TAKEOFF, FORM, THIRD = 1, 2, 3
READY = Path(__file__).parents[2] / "missions"


def quartet(*steps: str, head: str = "", height_m: int = 4, text: str = TEXT) -> LoadedMission:
    text = text.replace("height_m: 4}", f"height_m: {height_m}}}")
    return loads(head + text + "".join(f"  - {step}\n" for step in steps))


def trio(*steps: str, head: str = "", height_m: int = 4) -> LoadedMission:
    return quartet(*steps, head=head, height_m=height_m, text=TRIO)


def fly(mission: LoadedMission, until_s: float = 900.0) -> VirtualSwarm:
    swarm = landing_fast(VirtualSwarm(mission))
    swarm.fly(until_s)
    return swarm


def of_kind(flown: LoadedMission, autopilot: str) -> LoadedMission:
    """All its vehicles."""
    agents = tuple(replace(agent, autopilot=autopilot) for agent in flown.fleet.agents)
    return replace(flown, fleet=replace(flown.fleet, agents=agents))


def assert_good(swarm: VirtualSwarm, outcome: str = "completed") -> None:
    """All have ended so, apart, and are down."""
    assert swarm.outcomes() == dict.fromkeys((agent.id for agent in swarm.plan.agents), outcome)
    assert swarm.closest_m > swarm.plan.law.r_in * swarm.plan.unit_m
    assert swarm.all_down


def shape_error_m(swarm: VirtualSwarm, step: int, live: tuple[int, ...] = ()) -> float:
    formations = swarm.plan.groups[0].formations(swarm.plan.unit_m)
    formation, at = formations[step], swarm.positions()
    assert formation.formed
    slots = formation.offsets
    unit = swarm.plan.unit_m
    planned = {
        i: slots[member.agent._group.slot_exchange.exchange.role]
        for i, member in swarm.members.items()
    }
    return float(
        formation_error(
            [at[i] for i in live or at],
            [(planned[i][0] * unit, planned[i][1] * unit) for i in live or at],
        )
    )


@pytest.mark.parametrize("autopilot", [on_demand("ardupilot"), "px4"])
def test_a_formation_that_holds_is_calm(autopilot: str) -> None:
    """No swing from limit to limit: after 15 s no setpoint is over 2 m/s, of 5."""
    fleet = ", ".join(f"{{id: {agent}, autopilot: {autopilot}}}" for agent in range(1, 5))
    held = quartet("hold: {duration_s: 30}", "land", head=f"fleet:\n  agents: [{fleet}]\n")
    swarm = at_step(held, THIRD, seed=10)
    swarm.run(15.0)
    fastest = 0.0
    while swarm.in_step(THIRD):
        swarm.tick()
        setpoints = (m.agent._controller.setpoint_mps for m in swarm.members.values())
        fastest = max(fastest, *(math.hypot(*setpoint) for setpoint in setpoints))
    assert 0.0 < fastest < 2.0


def test_move_keeps_shape_and_arrives() -> None:
    """Along a path with a corner: never more than a metre out of shape, the centre at its end."""
    swarm = at_step(quartet("move: {along: [[20, 13], [20, 33]]}", "land"), THIRD)
    worst = 0.0
    while swarm.in_step(THIRD):
        swarm.tick()
        worst = max(worst, shape_error_m(swarm, THIRD))
    assert math.dist(swarm.centre(), (20, 33)) < 1.0
    assert worst < 1.0
    assert_arrives(swarm)


def test_the_formation_does_not_drift_while_it_holds() -> None:
    """The pinned agent keeps the centre where it was, for half a minute."""
    swarm = at_step(quartet("hold: {duration_s: 40}", "land"), THIRD)
    swarm.run(5)
    before = swarm.centre()
    swarm.run(30)
    assert math.dist(before, swarm.centre()) < 0.09


@pytest.mark.parametrize(
    ("step", "angle", "factor"),
    [("rotate: {angle_deg: 90}", 90, 1), on_demand("scale: {factor: 1.5}", 0, 1.5)],
)
def test_rotate_and_scale(step: str, angle: float, factor: float) -> None:
    """The slots end turned (clockwise from above) or wider, the centre stays."""
    swarm = at_step(quartet(step, "land"), THIRD)
    before, centre = np.array(list(swarm.positions().values())), swarm.centre()
    assert_arrives(swarm)
    after = np.array(list(swarm.positions().values()))
    turn = math.radians(angle)
    expected = (
        factor
        * (before - before.mean(axis=0))
        @ np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    )
    assert np.abs(after - after.mean(axis=0) - expected).max() < 1.2
    assert math.dist(centre, swarm.centre()) < 1.0
    assert shape_error_m(swarm, THIRD) < 0.6


def test_return_brings_all_home_at_once() -> None:
    """Each lands at its own start, and no pair comes too near on the way."""
    swarm, together = at_step(quartet("move: {to: [25, 20]}", "return"), 4), 0
    while any(member.alive for member in swarm.members.values()):
        swarm.tick()
        flying = [m for m in swarm.members.values() if m.alive and m.status]
        back = [m for m in flying if m.status and m.status.phase is Phase.RETURN]
        together = max(together, sum(m.agent._way_back.stage == ReturnStage.FLY for m in back))
    assert together == 4
    for agent in swarm.plan.agents:
        assert math.dist(swarm.positions()[agent.id], agent.start) < 1.5
    assert_good(swarm)


CASES = [
    (5, 1, Policy.CONTINUE),
    *(on_demand(step, 1, Policy.CONTINUE) for step in (1, 2, 3, 4, 6)),
    *(on_demand(step, 3, Policy.RETURN) for step in (2, 3)),
    (4, 3, Policy.RETURN),
    on_demand(3, 1, Policy.RETURN),
    (2, 1, Policy.LAND),
    on_demand(4, 1, Policy.LAND),
    on_demand(5, 3, Policy.LAND),
    on_demand(6, 3, Policy.LAND),
]


@pytest.mark.parametrize(("step", "victim", "policy"), CASES)
def test_an_agent_dies_in_any_step(step: int, victim: int, policy: Policy) -> None:
    """The pinned one or another: the survivors do as the policy says, apart from each other, and
    all come down. Who can't come home for the dead agent's vehicle lands beside it, and fails."""
    steps = "move: {to: [30, 13]}", "rotate: {angle_deg: 45}", "scale: {factor: 1.2}", "return"
    swarm = at_step(quartet(*steps, head=f"policies: {{agent_lost: {policy}}}\n"), step)
    swarm.run(1.5)
    swarm.kill(victim)
    swarm.fly(900)
    swarm.wait(lambda s: s.all_down, swarm.now + 40)  # the dead agent's vehicle, too
    outcomes = swarm.outcomes()
    assert set(outcomes) == {1, 2, 3, 4} - {victim}
    if policy is Policy.CONTINUE or step == 6:
        failed = [a for a in swarm.plan.agents if outcomes.get(a.id) == "failed"]
        assert all(math.dist(a.start, swarm.positions()[victim]) < 5.75 for a in failed)
        assert {*outcomes.values()} <= {"completed", "failed"}
    else:
        assert set(outcomes.values()) == {"failed"}
    if policy is Policy.RETURN and step > 1:
        for agent in swarm.plan.agents:
            if agent.id != victim:
                assert math.dist(swarm.positions()[agent.id], agent.start) < 1.5
    assert swarm.closest_m > swarm.plan.law.r_in * swarm.plan.unit_m
    assert swarm.all_down


def test_another_takes_over_when_the_pinned_agent_is_lost() -> None:
    """The move goes on to its end without a jump: the frame is where it was told to be last."""
    head = "policies: {agent_lost: continue}\n"
    swarm = at_step(quartet("move: {to: [50, 13]}", "land", head=head), THIRD)
    swarm.run(8)
    assert [m.agent._group.reference.pinned for m in swarm.members.values()] == [1, 1, 1, 1]
    frame = swarm.members[2].agent._group.reference.frame
    swarm.kill(1)
    swarm.run(2)
    after = swarm.members[2].agent._group.reference.frame
    assert frame is not None
    assert after is not None
    assert math.dist(frame.point_m, after.point_m) < 5
    assert [swarm.members[i].agent._group.reference.pinned for i in (2, 3, 4)] == [2, 2, 2]
    swarm.wait(lambda s: s.in_step(4))
    assert shape_error_m(swarm, THIRD, (2, 3, 4)) < 1.0
    swarm.fly(900)
    assert swarm.outcomes() == dict.fromkeys([2, 3, 4], "completed")


@pytest.mark.parametrize(
    "policy", [Policy.RETURN, Policy.HOLD, on_demand(Policy.LAND), on_demand(Policy.CONTINUE)]
)
def test_a_step_that_takes_too_long(policy: Policy) -> None:
    """`on_timeout`: hold until told otherwise, land, return, or go on to the next step."""
    late = f"timeout_s: 9, on_timeout: {policy.value}"
    step = f"form: {{shape: row, tolerance_m: 0.05, settle_s: 8, {late}}}"
    swarm = at_step(quartet(step, "land"), THIRD)
    swarm.run(12)
    if policy is Policy.HOLD:
        assert swarm.phases() == {Phase.HOLD}
        swarm.command("land")
    swarm.fly(900)
    wanted = {Policy.HOLD: "aborted", Policy.CONTINUE: "completed"}.get(policy, "failed")
    assert set(swarm.outcomes().values()) == {wanted}
    assert swarm.all_down
    if policy is Policy.RETURN:
        assert all(math.dist(swarm.positions()[a.id], a.start) < 1.5 for a in swarm.plan.agents)


def test_neighbours_of_a_form_step() -> None:
    """An explicit graph takes effect with its step, in every agent."""
    swarm = at_step(
        quartet("form: {shape: row, neighbours: [[1, 2], [2, 3], [3, 4]]}", "land"), THIRD
    )
    swarm.run(1)
    status = {i: m.status for i, m in swarm.members.items()}
    assert {i: s.neighbours for i, s in status.items() if s} == {
        1: (2,),
        2: (1, 3),
        3: (2, 4),
        4: (3,),
    }
    assert_arrives(swarm)


@pytest.mark.long
def test_a_line_that_moves_along_itself_stays_a_line() -> None:
    """The pinned agent, at one end of it, hurries no more than the others: at twice the law's rate
    it swung, and the line with it, up to 3.7 m to the sides."""
    mission = load(READY / "sweep.yaml")
    swarm = at_step(mission, 4)
    aside = 0.0
    while swarm.in_step(4):
        swarm.tick()
        aside = max(aside, *(abs(north) for north, _ in swarm.positions().values()))
    assert aside < 0.6
