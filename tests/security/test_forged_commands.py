"""Commands that were recorded and sent again, or sent to one agent alone; and what the operator
does against an agent whose key is stolen."""

from __future__ import annotations

from dataclasses import replace

import pytest

from swarm_ctl.api.virtual_flight import VirtualFlight
from swarm_ctl.commands.parse import Order
from swarm_ctl.core.model.messages import AgentState, Command, Phase
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.payloads import encode
from swarm_ctl.virtual.virtual_swarm import VirtualSwarm
from tests.on_demand import on_demand
from tests.scenarios.swap import FORM, IDS, mission
from tests.scenarios.swarm import flown_once, landing_fast
from tests.security.forger import Attacked
from tests.unit.plans import steps_of

HOLD = FORM + 1


@flown_once
def attacked(step: int) -> Attacked:
    """A swarm at this step's begin; HOLD comes after FORM."""
    flight = Attacked(mission(rate_hz=10)) if step == FORM else attacked(FORM)
    flight.swarm.wait(lambda s: s.in_step(step), 60)
    return flight


@flown_once
def forming() -> VirtualFlight:
    """A flight at the form step's begin, by policy `continue`."""
    flight = VirtualFlight(mission("continue"))
    landing_fast(flight.swarm)
    flight.wait_step(FORM)
    return flight


def acks(flight: Attacked, command: str) -> list[tuple[bool, str]]:
    """How each agent answered."""
    return [(ack.accepted, ack.reason) for ack in flight.swarm.acks if ack.command == command]


def test_a_recorded_command_is_obeyed_once() -> None:
    """Sent again as it was, it is answered as before; under another id its number was used; later
    it is old."""
    flight = attacked(FORM)
    swarm = flight.swarm
    swarm.command("hold", name="hold")
    swarm.run(1.0)
    swarm.command("resume", name="resume")
    swarm.run(1.0)
    recorded = Command("hold", "hold", (), swarm.now - 2.0, number=1)
    swarm.acks.clear()
    for again in (recorded, replace(recorded, id="other")):
        swarm._station.send(keys.COMMAND, again)
    swarm.run(0.2)
    assert acks(flight, "hold") == [(True, "")] * len(IDS)
    assert acks(flight, "other") == [(False, "number 1 of station was used by another command")] * 4
    swarm.run(15.0)
    swarm._station.send(keys.COMMAND, replace(recorded, id="late", number=99))
    swarm.run(0.2)
    assert {why for _, why in acks(flight, "late")} == {
        "it is 17 s old, by its sender's clock; allowed: 15 s"
    }
    commanded = [event.text for event in swarm.events if "commands" in event.text]
    assert commanded.count("the operator commands: hold (station)") == len(IDS)
    swarm.fly()
    assert set(swarm.outcomes().values()) == {"completed"}


def test_a_shape_that_one_agent_alone_was_told_is_dropped() -> None:
    """The others wait for it, and the mission is completed."""
    flight = attacked(HOLD)
    swarm = flight.swarm
    step = next(step for step in steps_of(swarm.plan) if isinstance(step, FormStep))
    turned = replace(step, slots=(*step.slots[1:], step.slots[0]))
    forged = Command("f", "form", (), swarm.now, turned, swarm.plan.hash(), number=1)
    key = "swarm/test/station/x/command"
    for inlet in flight._transports[4].inlets(key):
        inlet.put(swarm.now, key, encode(forged))
    swarm.run(5.0)
    assert swarm.in_step(HOLD)
    swarm.fly()
    assert "4: no other agent flies the commanded form: going on without it" in flight.said()
    assert set(swarm.outcomes().values()) == {"completed"}
    assert swarm.closest_m > swarm.plan.law.r_in * swarm.plan.unit_m


def test_expel_and_readmit() -> None:
    """The others go on without the agent, and away from its vehicle; then with it again."""
    flight = forming()
    swarm = flight.swarm
    swarm.run(2.0)
    sent = flight.order(Order("expel", (), (3,)))
    assert sent.accepted
    assert sorted(sent.acks) == [1, 2, 4]
    before = swarm.positions()[3]
    swarm.run(8.0)
    place = swarm.positions()[3]
    assert abs(complex(*place) - complex(*before)) < 6.0
    status = {i: member.status for i, member in swarm.members.items()}
    assert all(s is not None and s.phase is Phase.FLY for s in status.values())
    assert flight.order(Order("readmit", (), (3,))).accepted
    swarm.run(0.2)
    now = swarm.now
    assert all(3 in {s.agent for s in _fresh(swarm, i, now)} for i in (1, 2, 4))
    result = flight.finish()
    assert set(result.outcomes.values()) == {"completed"}
    assert result.all_down
    assert swarm.closest_m > swarm.plan.law.r_in * swarm.plan.unit_m


def _fresh(swarm: VirtualSwarm, agent: int, now: float) -> list[AgentState]:
    return swarm.members[agent].agent._peers.snapshot(now).fresh()


@pytest.mark.parametrize("sensor", [True, on_demand(False)])
def test_one_that_is_expelled_for_good_is_flown_without(sensor: bool) -> None:
    """It obeys `land`. The traffic sensor shows that it stands on the ground: the others form where
    it was, and none comes down on it. Without a sensor they keep clear of its last place for good:
    the step's time-out ends the mission."""
    flight = forming()
    swarm = flight.swarm
    if not sensor:
        for vehicle in swarm.hub.world.vehicles:
            vehicle.firmware.traffic = tuple
    flight.order(Order("expel", (), (3,)))
    assert flight.order(Order("land", (), (3,))).accepted
    result = flight.finish()
    assert result.all_down
    assert swarm.closest_m > swarm.plan.law.r_in * swarm.plan.unit_m
    others = {result.outcomes[i] for i in (1, 2, 4)}
    assert others == {"completed"} if sensor else "completed" not in others
