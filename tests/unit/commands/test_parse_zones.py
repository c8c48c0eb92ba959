"""Zones as an operator orders them: read, or refused with what would be allowed."""

from __future__ import annotations

from dataclasses import replace

import pytest

from swarm_ctl.commands.build import AgentNow, SwarmNow, build
from swarm_ctl.commands.parse import Order, complete, parse
from swarm_ctl.core.model.messages import CommandKind
from swarm_ctl.core.model.plan import Zone
from swarm_ctl.core.swarm.gain_update import planned
from swarm_ctl.errors import InputError
from tests.unit.station.swarm import hexagon_plan

OAK = Zone("oak", ((300.0, 0.0),), 4.0, 1.25)
PLAN = replace(hexagon_plan(), zones=(OAK,))
AGENTS = tuple(AgentNow(k, (10.0 * k, 5.0), gains=planned(PLAN)) for k in range(1, 7))
SWARM = SwarmNow(PLAN, 40.0, 3, AGENTS)


def ordered(line: str, swarm: SwarmNow = SWARM) -> tuple[Zone, ...] | None:
    """The zones that a line makes of those in force."""
    command = build(parse(line, swarm.plan), swarm)
    assert command.kind == CommandKind.ZONE
    assert command.tuning is not None
    assert command.tuning.gains == planned(PLAN)
    return command.tuning.zones


def test_a_zone_is_added_to_those_in_force() -> None:
    pond = Zone("pond", ((30.0, -5.0),), 4.0, 1.25)
    assert ordered("zone add pond circle 30 -5 4") == (OAK, pond)
    box = ordered("zone add box polygon 0 0 9 0 9 9 floor=2 ceiling=20 clearance=3")
    assert box == (OAK, Zone("box", ((0.0, 0.0), (9.0, 0.0), (9.0, 9.0)), 0.0, 3.0, 2.0, 20.0))
    have = replace(SWARM, agents=tuple(replace(a, zones=(pond,)) for a in AGENTS))
    assert ordered("zone lift pond", have) == ()
    assert ordered("zone lift oak") == ()


def test_the_gains_keep_the_zones() -> None:
    have = replace(SWARM, agents=tuple(replace(a, zones=()) for a in AGENTS))
    command = build(Order("tune", ("h=0.004",)), have)
    assert command.tuning is not None
    assert command.tuning.zones == ()
    assert build(Order("tune", ("h=0.004",)), SWARM).tuning.zones is None  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("zone", "usage: zone add NAME circle N E R"),
        ("zone add pond", "usage: zone add"),
        ("zone add pond circle 1 2", "usage: zone add"),
        ("zone add pond circle 1 2 x", "usage: zone add"),
        ("zone add pond circle 1 2 3 high=4", "usage: zone add"),
        ("zone add pond polygon 0 0 9 0", "usage: zone add"),
        ("zone add ../x circle 1 2 3", "is no name"),
        ("zone add pond circle 1 2 -3", "zone pond is no area"),
        ("zone add pond circle 1 2 3 clearance=-30", "clearance -30; allowed: 0 m or more"),
        ("zone add pond circle 1 2 3 floor=9 ceiling=2", "floor 9, ceiling 2; allowed: a floor"),
        ("zone add pond circle 1 2 3 floor=5 floor=50", "a number is given twice"),
        ("zone add pond circle 1e9 2 3", "a number is out of range"),
        ("zone add box polygon 0 0 9 9 9 0 0 9", "zone box is no area"),
        ("zone add oak circle 1 2 3", "there is a zone oak"),
        ("zone list", "zones: oak"),
        ("zone lift elm", "there is no zone elm; allowed: oak"),
        ("zone lift oak @2", "zone is for the whole swarm"),
    ],
)
def test_what_is_no_zone_is_refused(line: str, why: str) -> None:
    with pytest.raises(InputError) as caught:
        build(parse(line, PLAN), SWARM)
    assert why in str(caught.value)


def test_agents_that_differ_or_are_not_heard_stop_it() -> None:
    unlike = (replace(AGENTS[0], zones=()), *AGENTS[1:])
    silent = (replace(AGENTS[0], stop_point_m=None), *AGENTS[1:])
    for agents, why in ((unlike, "different zones"), (silent, "is not heard")):
        with pytest.raises(InputError, match=why):
            build(parse("zone add p circle 1 2 3", PLAN), replace(SWARM, agents=agents))


def test_agents_that_differ_get_the_mission_s_own_zones_by_an_order() -> None:
    """The refusal says who has which, and the order that all can take; also where laws differ."""
    unlike = (replace(AGENTS[0], zones=()), *AGENTS[1:])
    with pytest.raises(InputError, match=r"\(agent 1: none; agents 2-6: as planned\).*`zone plan`"):
        build(parse("zone lift oak", PLAN), replace(SWARM, agents=unlike))
    other = replace(planned(PLAN), h=0.004)
    for agents in (unlike, (replace(unlike[0], gains=other), *unlike[1:])):
        command = build(parse("zone plan", PLAN), replace(SWARM, agents=agents))
        assert command.agents == (1, 2, 3, 4, 5, 6)
        assert command.tuning is not None
        assert (command.tuning.zones, command.tuning.gains) == (PLAN.zones, planned(PLAN))


def test_words_are_completed() -> None:
    assert complete("zone ", PLAN) == ["zone add ", "zone lift ", "zone list", "zone plan"]
    assert complete("zone lift ", PLAN) == ["zone lift oak"]
    assert complete("zone add pond c", PLAN) == ["zone add pond circle "]
