"""Slot exchange flown by whole agents on the virtual clock: whose slot is whose, in this step and
those that follow."""

from __future__ import annotations

from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.mission.compile.loader import LoadedMission, loads
from tests.scenarios.swarm import VirtualSwarm, at_step, landing_fast
from tests.scenarios.test_steps import TEXT, assert_good, shape_error_m
from tests.unit.plans import steps_of

BACK = "{kind: offsets, offsets: [[0, 27], [0, 18], [0, 9], [0, 0]]}"


def turned_round(*steps: str, exchange: bool = True) -> LoadedMission:
    """Four in a row, and the fixed slot of each is at the other end."""
    text = TEXT.replace("shapes:\n", f"shapes:\n  back: {BACK}\n").replace(
        "form: {shape: square, settle_s: 2}",
        f"form: {{shape: back, slots: fixed, exchange: {str(exchange).lower()}, settle_s: 2}}",
    )
    return loads(text + "".join(f"  - {step}\n" for step in steps))


def roles(swarm: VirtualSwarm) -> list[int]:
    return [member.agent._group.slot_exchange.exchange.role for member in swarm.members.values()]


def formed_s(swarm: VirtualSwarm) -> float:
    status = swarm.members[1].status
    assert status is not None
    result = status.steps[2]
    assert result.end_s is not None
    return result.end_s - result.start_s


def apart(swarm: VirtualSwarm) -> bool:
    return swarm.closest_m > swarm.plan.law.r_in * swarm.plan.unit_m


def exchanged(step: int) -> VirtualSwarm:
    """They form, each may take another's slot, and hold: at this step's begin."""
    return at_step(turned_round("hold: {duration_s: 20}", "land"), step)


def test_exchange_saves_the_way_past_each_other() -> None:
    """Fixed slots are flown to, all past each other; with exchange the row stands where it was,
    much sooner."""
    fixed = at_step(turned_round("land", exchange=False), 3)
    assert roles(fixed) == [0, 1, 2, 3]
    assert apart(fixed)
    swarm = exchanged(3)
    assert sorted(roles(swarm)) == [0, 1, 2, 3]
    assert formed_s(swarm) < 0.8 * formed_s(fixed)
    assert "takes the slot of agent" in "\n".join(event.text for event in swarm.events)
    assert apart(swarm)


def test_later_steps_go_by_the_roles() -> None:
    """The shape turns, moves, changes, grows and comes home with every agent in the role that it
    has."""
    steps = (
        "rotate: {angle_deg: 45}",
        "move: {to: [12, 13], speed_mps: 2}",
        "form: {shape: square, slots: fixed, settle_s: 2, neighbours: rechoose}",
        "scale: {factor: 1.3}",
        "form: {shape: square, settle_s: 2}",
        "return",
    )
    swarm = landing_fast(VirtualSwarm(turned_round(*steps)))
    for step in range(3, 3 + len(steps)):
        swarm.wait(lambda s, step=step: s.in_step(step))
        assert sorted(roles(swarm)) == [0, 1, 2, 3] != roles(swarm)
        assert shape_error_m(swarm, step - 1) < 0.6
    swarm.fly(900)
    assert_good(swarm)


def test_an_operators_shape_knows_no_roles() -> None:
    """`form` gives every agent its own slot; afterwards the mission goes on with its roles."""
    swarm = exchanged(2)
    swarm.wait(lambda s: sorted(roles(s)) != roles(s))
    row = FormStep("row", ((0.0, 0.0), (9.0, 9.0), (0.0, 18.0), (9.0, 27.0)), 0.5, 2.0, 1e9)
    swarm.command("form", step=row, plan_hash=swarm.plan.hash())
    swarm.run(16)
    at = swarm.positions()
    assert at[1][1] < at[2][1] < at[3][1] < at[4][1]
    swarm.command("resume", name="c2")
    swarm.wait(lambda s: s.in_step(3))
    assert shape_error_m(swarm, 2) < 0.6
    assert apart(swarm)


def test_exchange_is_for_nearest_slots_unless_said() -> None:
    """`fixed` means fixed; the plain law of the paper exchanges nothing."""

    def allowed(form: str, head: str = "") -> bool:
        text = TEXT.replace("form: {shape: square, settle_s: 2}", f"form: {{shape: square{form}}}")
        step = steps_of(loads(head + text + "  - land\n").plan)[1]
        assert isinstance(step, FormStep)
        return step.exchange

    assert allowed("")
    assert not allowed(", slots: fixed")
    assert allowed(", slots: fixed, exchange: true")
    assert not allowed(", exchange: false")
