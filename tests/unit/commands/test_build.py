"""Orders as commands: decided once by the sender, or refused with what would be allowed."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swarm_ctl.commands.build import AgentNow, SwarmNow, build
from swarm_ctl.commands.parse import Order, complete
from swarm_ctl.core.model.frames import geodetic_from_ned
from swarm_ctl.core.model.plan import EVERYONE, Fence, Zone
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.core.model.steps.goto import GotoStep
from swarm_ctl.core.model.steps.move import MoveStep
from swarm_ctl.core.swarm.gain_update import LEAD_S, planned
from swarm_ctl.errors import InputError
from swarm_ctl.mission.compile.loader import loads
from swarm_ctl.mission.compile.plan_file import plan_from_json, plan_to_json
from tests.unit.plans import REST, SCOUTS, SWEEPERS, groups_mission
from tests.unit.station.swarm import hexagon_plan

PLAN = hexagon_plan()
MISSIONS = sorted((Path(__file__).parents[3] / "missions").glob("*.yaml"))
SPARE = "{kind: line, spacing: 20}"
LAW = planned(PLAN)
AGENTS = tuple(AgentNow(k, (10.0 * k, 5.0), gains=LAW) for k in range(1, 7))
SWARM = SwarmNow(PLAN, 40.0, 3, AGENTS)


def with_agent(agent_id: int, **changes: object) -> SwarmNow:
    """The swarm with one agent changed."""
    agents = [replace(a, **changes) if a.id == agent_id else a for a in AGENTS]  # type: ignore[arg-type]
    return replace(SWARM, agents=tuple(agents))


@pytest.mark.parametrize("kind", ["hold", "resume", "next", "land", "return", "kill"])
def test_a_bare_command(kind: str) -> None:
    """Only `next` says which step it is to end."""
    command = build(Order(kind, (), (2, 4)), SWARM)
    assert (command.kind, command.agents, command.time_s) == (kind, (2, 4), 40.0)
    assert command.at_step == (3 if kind == "next" else 0)
    assert (command.step, command.tuning, command.plan_hash) == (None, None, 0)


@pytest.mark.parametrize("mission", MISSIONS, ids=lambda path: path.stem)
def test_a_plan_file_is_enough_to_order_each_shape_of_its_mission(mission: Path) -> None:
    """Also one that no step forms; one without a slot for each agent is none of the plan's."""
    text = mission.read_text().replace(
        "shapes:\n", f"shapes:\n  spare: {SPARE}\n  few: {SPARE.replace('}', ', count: 1}')}\n"
    )
    loaded = loads(text, str(mission))
    plan = plan_from_json(plan_to_json(loaded.plan, loaded.fleet)).plan
    names = sorted(loaded.file.shapes.keys() - {"few"})
    assert "spare" in names
    assert complete("form ", plan) == [f"form {name}" for name in names]
    agents = tuple(AgentNow(agent.id, agent.start) for agent in plan.agents)
    for group in plan.groups:
        swarm = SwarmNow(replace(plan, fence=None), 40.0, group.before + 1, agents)
        whom = () if group.name == EVERYONE else (group.name,)
        formed = [shape for shape in plan.shapes if len(shape.slots) == len(group.ids)]
        assert "spare" in [shape.name for shape in formed]
        for shape in formed:
            step = build(Order("form", (shape.name,), groups=whom), swarm).step
            assert isinstance(step, FormStep)
            assert sorted(step.slots) == sorted(shape.slots)
    with pytest.raises(InputError, match=f"no shape 'few' .*; allowed: {', '.join(names)}"):
        build(Order("form", ("few",)), swarm)


@pytest.mark.parametrize(
    ("order", "point", "speed"),
    [
        (Order("move", ("20", "-5.5")), (20.0, -5.5), PLAN.limits.speed_mps / 2),
        (Order("move", ("20", "-5.5", "1.5")), (20.0, -5.5), 1.5),
        (Order("move", ("20", "-5.5"), by=True), (55.0, -0.5), PLAN.limits.speed_mps / 2),
    ],
)
def test_move(order: Order, point: tuple[float, float], speed: float) -> None:
    """To a point, or by so much from the centre of all stop points, (35, 5)."""
    step = build(order, SWARM).step
    assert isinstance(step, MoveStep)
    assert (step.waypoints_m, step.speed_mps) == ((pytest.approx(point),), speed)


def test_tune_asks_every_agent_that_flies() -> None:
    """For a time that leaves room for the answers; with how far clocks are ahead."""
    swarm = with_agent(2, flies=False)
    swarm = replace(swarm, agents=(replace(AGENTS[0], clock_ahead_s=0.5), *swarm.agents[1:]))
    command = build(Order("tune", ("h=0.04",)), swarm)
    assert command.agents == (1, 3, 4, 5, 6)
    assert command.tuning is not None
    assert command.tuning.gains == replace(LAW, h=0.04)
    assert command.tuning.at_s == 40.0 + LEAD_S
    assert command.tuning.ahead_s == ((1, 0.5),)
    fast = build(Order("tune", ("plan",)), replace(swarm, speedup=10.0))
    assert fast.tuning is not None
    assert fast.tuning.at_s == 40.0 + 10.0 * LEAD_S


def test_agents_with_different_laws_need_all_values() -> None:
    swarm = with_agent(3, gains=replace(LAW, h=0.03))
    with pytest.raises(InputError, match="agents fly different laws; name all of"):
        build(Order("tune", ("h=0.04",)), swarm)
    assert build(Order("tune", ("plan",)), swarm).tuning is not None


@pytest.mark.parametrize(
    ("order", "swarm", "why"),
    [
        (Order("fly"), SWARM, "unknown command 'fly'; allowed: hold, resume"),
        (Order("hold", (), (1, 9)), SWARM, "there is no agent 9; allowed: 1, 2, 3, 4, 5, 6"),
        (Order("form", ("hexagn",)), SWARM, "did you mean hexagon?; allowed: "),
        (Order("form", ("hexagon",)), with_agent(2, lost=True), "form: agent 2 is not heard"),
        (Order("move", ("1", "1"), by=True), with_agent(2, lost=True), "move: agent 2 is not"),
        (Order("move", ("inf", "1")), SWARM, "move to (inf, 1) m; allowed: finite numbers"),
        (Order("move", ("1", "1", "0")), SWARM, "move at 0 m/s; allowed: above 0, at most"),
        (Order("move", ("1", "1", str(math.nan))), SWARM, "move at nan m/s"),
        (Order("tune", ("h=9",)), SWARM, "tune: h 9; allowed in flight"),
        (Order("tune", ("plan",)), with_agent(2, stop_point_m=None), "tune: agent 2 is not heard"),
        (Order("tune", ("plan",)), replace(SWARM, agents=()), "tune: no agent flies any more"),
    ],
)
def test_refusals_say_what_is_allowed(order: Order, swarm: SwarmNow, why: str) -> None:
    with pytest.raises(InputError, match=re.escape(why)):
        build(order, swarm)


def test_orders_are_for_the_formation() -> None:
    """An agent that has left it need not be heard, and takes the slot that no other wants; an order
    to all that ends the mission is for it until its vehicle is down; none calls it back that
    comes down by an order."""
    gone = with_agent(3, stop_point_m=None, left=True, down=True)
    assert gone.meant(Order("hold")) == (1, 2, 4, 5, 6)
    assert gone.meant(Order("land")) == (1, 2, 4, 5, 6)
    assert with_agent(3, left=True).meant(Order("land")) == (1, 2, 3, 4, 5, 6)
    assert with_agent(3, left=True).meant(Order("return")) == (1, 2, 3, 4, 5, 6)
    assert with_agent(3, left=True, ends=True).meant(Order("return")) == (1, 2, 4, 5, 6)
    assert gone.meant(Order("hold", (), (3,))) == (3,)
    whole, without = (build(Order("form", ("hexagon",)), s).step for s in (SWARM, gone))
    assert isinstance(whole, FormStep)
    assert isinstance(without, FormStep)
    assert sorted(without.slots) == sorted(whole.slots)
    assert build(Order("move", ("1", "2"), by=True), gone).step is not None


def test_a_move_or_shape_that_brings_any_agent_out_of_the_fence_is_refused() -> None:
    """The centre alone would be inside."""
    fence = Fence(((-200.0, -200.0), (-200.0, 80.0), (200.0, 80.0), (200.0, -200.0)), 120.0)
    near = replace(SWARM, plan=replace(PLAN, fence=fence))
    build(Order("move", ("0", "0")), near)
    with pytest.raises(InputError, match=r"move: agent [1-6] would be outside the geofence"):
        build(Order("move", ("185", "0")), near)
    small = replace(fence, polygon_m=((-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (1.0, -1.0)))
    with pytest.raises(
        InputError, match=r"form hexagon: agent [1-6] would be outside the geofence"
    ):
        build(Order("form", ("hexagon",)), replace(SWARM, plan=replace(PLAN, fence=small)))


def test_a_move_goes_round_zones_or_is_refused() -> None:
    """As a mission's does; and no order gives a place in a zone."""
    tree = Zone("tree", ((35.0, 60.0),), 4.0, 1.25)
    wooded = replace(SWARM, plan=replace(PLAN, zones=(tree,)))
    step = build(Order("move", ("35", "150")), wooded).step
    assert isinstance(step, MoveStep)
    assert len(step.waypoints_m) > 1
    assert step.waypoints_m[-1] == (35.0, 150.0)
    with pytest.raises(InputError, match=r"move: agent [1-6] would be in zone tree"):
        build(Order("move", ("35", "60")), wooded)
    ring = ((-9.0, -60.0), (-9.0, 70.0), (90.0, 70.0), (90.0, -60.0))
    outer = ((-20.0, -70.0), (-20.0, 80.0), (100.0, 80.0), (100.0, -70.0))
    walls = tuple(
        Zone(f"wall-{k}", (a, b, d, c), 0.0, 1.25)
        for k, (a, b, c, d) in enumerate(
            zip(ring, (*ring[1:], ring[0]), outer, (*outer[1:], outer[0]), strict=True)
        )
    )
    closed = replace(SWARM, plan=replace(PLAN, zones=walls, fence=None))
    with pytest.raises(InputError, match="move: there is no way past zone wall-"):
        build(Order("move", ("35", "250")), closed)


GROUPS = groups_mission().plan
WHERE = {agent.id: (agent.start[0] * 5.0 + 40.0, agent.start[1] * 5.0) for agent in GROUPS.agents}


def in_groups(step: int = 5, **left: bool) -> SwarmNow:
    """The groups side by side, each in a step of its own; the scouts are ahead by one."""
    ahead = {i: i in SCOUTS for i in WHERE}
    agents = [AgentNow(i, at, gains=LAW, step=step + ahead[i]) for i, at in WHERE.items()]
    agents = [
        replace(a, left=True, down=left[f"a{a.id}"]) if f"a{a.id}" in left else a for a in agents
    ]
    return SwarmNow(GROUPS, 40.0, step + 1, tuple(agents))


@pytest.mark.parametrize("kind", ["hold", "resume", "next", "land", "return", "kill"])
def test_an_order_to_a_group_is_for_its_agents(kind: str) -> None:
    """Also to one and an agent beside it; `next` ends the step that these are in."""
    swarm = in_groups()
    for groups, ids, meant, step in (
        (("sweepers",), (), SWEEPERS, 5),
        (("scouts",), (12,), (*SCOUTS, 12), 6),
        (("rest", "scouts"), (), (*SCOUTS, *REST), 6),
        ((), (), (), 6),
    ):
        order = Order(kind, (), ids, groups=groups)
        command = build(order, swarm)
        assert command.agents == meant
        assert swarm.meant(order) == (meant or tuple(WHERE))
        assert command.at_step == (step if kind == "next" else 0)


def test_who_has_left_is_not_asked_with_its_group() -> None:
    """But where it is named itself; one that is away is landed with the others, or called back."""
    swarm = in_groups(a2=True, a3=False)
    assert swarm.meant(Order("hold", groups=("scouts",))) == (1, 4)
    assert swarm.meant(Order("land", groups=("scouts",))) == (1, 3, 4)
    assert swarm.meant(Order("resume", groups=("scouts",))) == (1, 3, 4)
    assert swarm.meant(Order("hold", (), (2,), groups=("scouts",))) == (1, 2, 4)
    assert build(Order("hold", groups=("scouts",)), swarm).agents == SCOUTS


@pytest.mark.parametrize("whom", [{"groups": ("scouts",)}, {"agents": SCOUTS}])
def test_a_group_alone_flies_a_shape_or_moves(whom: dict[str, tuple[str, ...]]) -> None:
    """By its size, from where its own agents are; whether it is named or its agents are."""
    swarm = in_groups()
    form = build(Order("form", ("wedge",), **whom), swarm)  # type: ignore[arg-type]
    assert isinstance(form.step, FormStep)
    assert (form.agents, len(form.step.slots)) == (SCOUTS, 4)
    move = build(Order("move", ("10", "0"), by=True, **whom), swarm)  # type: ignore[arg-type]
    assert isinstance(move.step, MoveStep)
    own = [WHERE[i] for i in SCOUTS]
    assert move.agents == SCOUTS
    assert move.step.waypoints_m[-1] == pytest.approx(
        (sum(n for n, _ in own) / 4 + 10.0, sum(e for _, e in own) / 4)
    )


def test_a_group_with_one_that_left_forms_with_its_slot_open() -> None:
    """Agents take a shape for all of their group, whoever is gone."""
    swarm = in_groups(a2=True)
    command = build(Order("form", ("wedge",), groups=("scouts",)), swarm)
    assert isinstance(command.step, FormStep)
    assert (command.agents, len(command.step.slots)) == (SCOUTS, 4)
    assert swarm.meant(Order("form", ("wedge",), groups=("scouts",))) == (1, 3, 4)
    silent = replace(swarm, agents=tuple(replace(a, lost=a.id == 9) for a in swarm.agents))
    assert build(Order("form", ("wedge",), groups=("scouts",)), silent).step is not None
    with pytest.raises(InputError, match="form: agent 9 is not heard"):
        build(Order("form", ("line",), groups=("sweepers",)), silent)


@pytest.mark.parametrize(
    "order",
    [
        Order("move", ("10", "0")),
        Order("form", ("wedge",)),
        Order("form", ("wedge",), groups=("scouts", "sweepers")),
        Order("move", ("10", "0"), SWEEPERS[1:]),
        Order("move", ("10", "0"), (7,), groups=("scouts",)),
    ],
)
def test_side_by_side_one_group_is_to_be_named(order: Order) -> None:
    """All would fly to one point."""
    flying = "@scouts (agents 1-4), @sweepers (agents 5-10), @rest (agents 11-12)"
    with pytest.raises(InputError, match=re.escape(f"one group, as a whole; now fly {flying}")):
        build(order, in_groups())


def test_before_and_after_the_split_the_whole_swarm_is_ordered() -> None:
    """A group that flies no steps of its own now is refused as a part of it."""
    for step in (2, 9):
        swarm = SwarmNow(GROUPS, 40.0, step, tuple(AgentNow(i, at) for i, at in WHERE.items()))
        command = build(Order("form", ("block",)), swarm)
        assert isinstance(command.step, FormStep)
        assert (command.agents, len(command.step.slots)) == ((), 12)
        with pytest.raises(InputError, match="now flies @all"):
            build(Order("form", ("wedge",), groups=("scouts",)), swarm)


def test_a_shape_of_another_size_is_none_of_the_group() -> None:
    few = tuple(s for s in GROUPS.shapes if s.name != "ring" or len(s.slots) == 12)
    swarm = replace(in_groups(), plan=replace(GROUPS, shapes=few))
    why = "shape ring has 12 slots, scouts 4 agents; allowed: block, line, wedge"
    with pytest.raises(InputError, match=why):
        build(Order("form", ("ring",), groups=("scouts",)), swarm)


def test_the_rest_are_those_that_a_split_leaves_now() -> None:
    """Or next: each split leaves others."""
    second = [replace(g, before=20, agents=g.agents[:1]) for g in GROUPS.groups if g.name == "rest"]
    plan = replace(GROUPS, groups=(*GROUPS.groups, *second))
    agents = tuple(AgentNow(i, at) for i, at in WHERE.items())
    for step, rest in ((1, REST), (5, REST), (9, (11,)), (22, (11,))):
        command = build(Order("hold", groups=("rest",)), SwarmNow(plan, 40.0, step, agents))
        assert command.agents == rest


def test_who_is_readmitted_has_to_answer() -> None:
    """It goes on by that order, so it is sent until it has come; who is expelled may be gone."""
    swarm = in_groups()
    for kind, meant in (("expel", {*WHERE} - {3}), ("readmit", {*WHERE})):
        assert set(swarm.meant(Order(kind, (), (3,)))) == meant


def test_to_expel_all_is_refused() -> None:
    with pytest.raises(InputError, match="some agents, not all"):
        build(Order("expel", groups=("scouts", "sweepers", "rest")), in_groups())
    assert build(Order("expel", groups=("scouts",)), in_groups()).about == SCOUTS


def test_goto_takes_agents_to_a_point_as_they_are_to_each_other() -> None:
    """One to the point itself; two keep their offset; latitude and longitude are of the map."""
    one = build(Order("goto", ("6", "8", "2"), (1,)), SWARM).step
    assert isinstance(one, GotoStep)
    assert (one.places_m, one.speed_mps) == (((1, (6.0, 8.0)),), 2.0)
    two = build(Order("goto", ("6", "8"), (1, 2)), SWARM).step
    assert isinstance(two, GotoStep)
    places, now = dict(two.places_m), {a.id: a.stop_point_m for a in SWARM.agents}
    assert now[1] is not None
    assert now[2] is not None
    assert np.subtract(places[2], places[1]) == pytest.approx(np.subtract(now[2], now[1]))
    assert np.mean([places[1], places[2]], axis=0) == pytest.approx([6.0, 8.0])
    there = geodetic_from_ned((6.0, 8.0, 0.0), PLAN.origin)
    word = f"{there.lat_deg:.9f},{there.lon_deg:.9f}"
    same = build(Order("goto", (word,), (1,)), SWARM).step
    assert isinstance(same, GotoStep)
    assert same.place_m(1) == pytest.approx((6.0, 8.0), abs=0.01)


@pytest.mark.parametrize(
    ("words", "agents", "why"),
    [
        (("6", "8", "99"), (1,), "goto at 99 m/s"),
        (("91,8",), (1,), "is nowhere on earth"),
        (("6", "8"), (1, 2, 3, 4, 5, 6), "for all: move"),
        (("9000", "8"), (1,), "outside the geofence"),
    ],
)
def test_goto_is_refused_where_none_could_fly(
    words: tuple[str, ...], agents: tuple[int, ...], why: str
) -> None:
    box = Fence(((-50.0, -50.0), (-50.0, 50.0), (50.0, 50.0), (50.0, -50.0)), 50.0)
    fenced = replace(SWARM, plan=replace(PLAN, fence=box))
    with pytest.raises(InputError, match=why):
        build(Order("goto", words, agents), fenced)
