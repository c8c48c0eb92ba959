"""Orders to groups by their names: from a test, a program, asyncio, and a scenario."""

from __future__ import annotations

import asyncio
import math
import re

import pytest

from swarm_ctl.api.flight import FlightError
from swarm_ctl.api.swarm import AsyncSwarm, Swarm
from swarm_ctl.core.model.messages import Phase
from swarm_ctl.errors import InputError
from swarm_ctl.testing.plugin import Fly
from swarm_ctl.virtual.scenario import scenario_of

MISSION = """\
version: 1
name: pairs-and-trio
origin: {lat_deg: -35.36, lon_deg: 149.16, alt_m: 584}
lengths: metres
tick_s: 0.1
law: {r: 60, r_out: 6, r_in: 2.5}
agents:
  - {id: 1, start: [0, 0]}
  - {id: 2, start: [0, 9]}
  - {id: 3, start: [0, 18]}
  - {id: 4, start: [-12, 0]}
  - {id: 5, start: [-12, 9]}
groups:
  scouts: [1, 2, 3]
shapes:
  row: {kind: line, spacing: 9}
  wedge: {kind: wedge, spacing: 9}
steps:
  - takeoff: {height_m: 4}
  - form: {shape: row, settle_s: 1}
  - split:
      scouts:
        - move: {by: [20, 0], settle_s: 1}
        - hold: {duration_s: 4}
  - form: {shape: row, settle_s: 1}
  - land: {}
"""
SCOUTS, REST = (1, 2, 3), (4, 5)


def _centre(swarm: Swarm, ids: tuple[int, ...]) -> tuple[float, float]:
    states = [swarm.view().agent(i).state for i in ids]
    places = [state.stop_point_m for state in states if state is not None]
    return sum(n for n, _ in places) / len(ids), sum(e for _, e in places) / len(ids)


def test_a_group_that_flies_no_steps_of_its_own_is_waited_for_by_its_name(swarm: Fly) -> None:
    """Its steps are the swarm's, and only its members are waited for: so it is with agents by their
    ids, and with a split's group in the steps that all fly. Once the flight is over, that is said,
    and not that a time went by; a change is told by the word that ordered it."""
    text = MISSION.replace("scouts: [1, 2, 3]", "scouts: [1, 2, 3]\n  pair: [4, 5]")
    flight = swarm(text, virtual=True)
    assert (flight.members("@pair"), flight.members("@4"), flight.members("")) == ((4, 5), (4,), ())
    assert flight.step_number("form row", "@pair") == 2
    assert flight.step_number("land", "@scouts") > flight.step_number("move", "@scouts")
    program = Swarm(flight)
    program.step("form row", group="@pair")
    assert repr(program.tune(h=0.04)) == "<tune: accepted by agents 1-5>"
    with pytest.raises(InputError, match="a circle and a polygon; allowed: one of them"):
        program.zone("add", "oak", circle=(90, 0, 1), polygon=[(1, 1), (1, 2), (2, 2)])
    program.land()
    program.finish()
    with pytest.raises(FlightError, match="was not reached within 300 s: the flight is over;"):
        program.step("land")


def test_a_group_is_ordered_by_its_name_and_the_others_fly_on(swarm: Fly) -> None:
    """It forms and moves by itself, from where it is; the mission goes on with it."""
    flight = swarm(MISSION, virtual=True)
    program = Swarm(flight)
    program.step("move", group="@scouts")
    assert flight.members("scouts") == SCOUTS
    program.wait(2.0)
    assert flight.command("hold", ["@scouts"]).meant == SCOUTS
    program.wait(3.0)
    scouts, rest = program.view().groups
    assert (scouts.name, scouts.agents, rest.waits_for) == ("scouts", SCOUTS, SCOUTS)
    assert {
        agent.id for agent in program.view().agents if agent.state and agent.state.override
    } == {*SCOUTS}
    others = _centre(program, REST)
    assert program.form("wedge", group="@scouts").command.agents == SCOUTS
    program.wait(8.0)
    before = _centre(program, SCOUTS)
    assert program.move(0.0, 12.0, 4.0, by=True, group="scouts").accepted
    program.wait(8.0)
    assert math.dist(_centre(program, SCOUTS), (before[0], before[1] + 12.0)) < 1.0
    assert math.dist(_centre(program, REST), others) < 1.0
    for order in (lambda: program.move(0.0, 0.0), lambda: program.form("row")):
        with pytest.raises(
            InputError, match=r"now fly @scouts \(agents 1-3\), @rest \(agents 4-5\)"
        ):
            order()
    with pytest.raises(
        InputError, match=re.escape("did you mean @scouts?; allowed: @all, @scouts")
    ):
        program.hold("@scout")
    with pytest.raises(ValueError, match="no agent 9; allowed: 1-5"):
        program.hold("@scouts", 9)

    async def goes_on() -> None:
        again = AsyncSwarm(program)
        assert (await again.resume("@scouts")).accepted
        await again.step("hold", group="@scouts")
        assert (await again.next("@scouts")).meant == SCOUTS
        await again.step(6)
        again.leave()

    asyncio.run(goes_on())
    assert program.form("wedge").command.agents == ()
    program.resume()
    result = program.finish()
    assert {*result.outcomes.values()} == {"completed"}
    assert result.summary is not None
    assert result.closest_m > 2.5


def test_a_scenarios_operator_orders_a_group(swarm: Fly) -> None:
    """Its name is checked with the file."""
    text = "version: 1\nmission:\n" + "".join(f"  {line}\n" for line in MISSION.splitlines())
    happens = "happens:\n  - {at_s: 31, order: 'land @scouts'}\n"
    flight = swarm(text + happens, virtual=True)
    result = flight.finish()
    assert result.all_down
    left = {agent: status.left for agent, status in flight.statuses().items()}
    assert {agent for agent, order in left.items() if order is not None} == {*SCOUTS}
    assert all(flight.statuses()[agent].phase is Phase.ENDED for agent in REST)
    with pytest.raises(InputError, match="@scout names no agents and no group"):
        scenario_of(text + happens.replace("@scouts", "@scout"))


def test_orders_to_all_count_those_that_are_away(swarm: Fly) -> None:
    """While one waits on the ground, one was sent elsewhere and one comes down: steps are waited
    for without them; law and zones are changed in all of them; `next` leaves who was sent elsewhere
    there; `resume` is not refused by who comes down, and brings the other back."""
    holds = "".join(f"  - hold: {{duration_s: {s}}}\n" for s in (5, 200, 200))
    text = f"{MISSION.split('  - split:')[0]}{holds}  - land: {{}}\n"
    program = Swarm(swarm(text.replace("[-12, 9]}", "[-12, 9], waits: true}"), virtual=True))
    program.step(3)
    program.goto(-30.0, 30.0, 3)
    program.wait(12.0)
    program.land(4)
    program.wait(0.5)
    assert program.tune(h=0.05).meant == (1, 2, 3, 4, 5)
    program.wait(2.5)
    assert program.zone("add", "oak", circle=(60.0, 0.0, 3.0)).meant == (1, 2, 3, 4, 5)
    assert program.next().meant == (1, 2)
    program.wait(8.0)
    assert math.dist(_centre(program, (3,)), (-30.0, 30.0)) < 1.0
    assert program.hold().meant == (1, 2)
    assert program.resume().meant == (1, 2, 3)
    program.wait(15.0)
    assert math.dist(_centre(program, (3,)), (-30.0, 30.0)) > 10.0


def test_who_is_the_last_to_fly_an_ordered_shape_keeps_it(swarm: Fly) -> None:
    """The others were told to go on one by one, in that shape: it goes on in the same one, and the
    mission with it. It had taken the shape of before, and the step ran out of time."""
    text = MISSION.split("  - split:")[0].replace("  - {id: 4, start: [-12, 0]}\n", "")
    text = text.replace("  - {id: 5, start: [-12, 9]}\n", "")
    program = Swarm(swarm(f"{text}  - move: {{by: [20, 0]}}\n  - land: {{}}\n", virtual=True))
    program.step("move")
    program.form("wedge")
    program.wait(8.0)
    for agent in (1, 2):
        program.resume(agent)
    run = program.finish()
    assert "waits for agents 2-3, which a command holds: 120 s at most" in run.texts
    assert "no other agent flies the commanded form" in run.texts
    assert run.outcomes == dict.fromkeys((1, 2, 3), "completed")
