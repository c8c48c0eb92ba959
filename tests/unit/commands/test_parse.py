"""What an operator may type: parsed, completed, or refused with what would be allowed."""

from __future__ import annotations

import contextlib
import re
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.commands.parse import BY_NAME, Order, complete, parse
from swarm_ctl.core.model.plan import NamedAgents
from swarm_ctl.errors import InputError
from tests.unit.plans import SCOUTS, groups_mission
from tests.unit.station.swarm import hexagon_plan

PLAN = hexagon_plan()
GROUPS = groups_mission().plan


@pytest.mark.parametrize(
    ("line", "marked", "order"),
    [
        ("land", (), Order("land")),
        ("  hold  ", (3, 1), Order("hold", (), (1, 3))),
        ("land @2", (3,), Order("land", (), (2,))),
        ("land 3", (1,), Order("land", (), (3,))),
        ("hold 1,3-4", (), Order("hold", (), (1, 3, 4))),
        ("land @all", (3,), Order("land")),
        ("rtl @2", (), Order("return", (), (2,))),
        ("join @2", (), Order("resume", (), (2,))),
        ("return @1,4-6", (), Order("return", (), (1, 4, 5, 6))),
        ("form hexagon", (), Order("form", ("hexagon",))),
        ("move 20 -5.5 2", (), Order("move", ("20", "-5.5", "2"))),
        ("move --by 20 -5", (), Order("move", ("20", "-5"), by=True)),
        ("move 20 -5 2 --by", (), Order("move", ("20", "-5", "2"), by=True)),
        ("tune h=0.04 kappa=15", (), Order("tune", ("h=0.04", "kappa=15"))),
        ("tune plan", (), Order("tune", ("plan",))),
        ("expel 3", (1,), Order("expel", (), (3,))),
        ("expel @3,4", (), Order("expel", (), (3, 4))),
        ("readmit", (3,), Order("readmit", (), (3,))),
    ],
)
def test_orders(line: str, marked: tuple[int, ...], order: Order) -> None:
    """What an order's text says can be typed again."""
    assert parse(line, PLAN, marked) == order
    assert parse(order.text, PLAN, order.agents) == order


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("", "no command ''; allowed: hold, resume, next, form, move, follow, goto, launch, tune"),
        ("fly", "no command 'fly'; allowed"),
        ("land now", "@now names no agents; allowed: @all, @1,3-5"),
        ("land @1 now", "land takes nothing but agents, not 'now'; e.g. land @1,3-5"),
        ("form", "usage: form SHAPE; this mission has hexagon"),
        ("form two shapes", "usage: form SHAPE"),
        ("move 1", "usage: move NORTH EAST"),
        ("move a b", "usage: move NORTH EAST"),
        ("move nan 1", "usage: move NORTH EAST"),
        ("move --by", "usage: move NORTH EAST [SPEED], e.g. move 20 -5, or move --by 10 0"),
        ("hold --by", "@--by names no agents"),
        ("form hexagon @1", "form is for the whole swarm; leave out @1"),
        ("expel", "expel is about some agents, not all; e.g. expel 3"),
        ("expel 1-6", "expel is about some agents, not all"),
        ("readmit 9", "no agent 9 in this mission"),
        ("tune", "tune changes nothing; allowed: plan, or values of delta_a, delta_l, h, kappa"),
        (
            "tune h",
            "'h' is no value of the law; allowed: delta_a, delta_l, h, kappa, e.g. tune h=0.04",
        ),
        ("tune r_in=1", "'r_in=1' is no value of the law"),
        ("tune h=nan", "'h=nan' is no value of the law"),
        ("tune h=0.3", "tune: h 0.3; allowed in flight: above 0, at most 0.2"),
        ("tune kappa=21", "tune: kappa 21; allowed in flight: above 0, at most 20"),
        ("tune delta_l=1.9", "tune: delta_l 1.9; allowed in flight: 2 to 2.2"),
        ("tune h=0.04 @1", "tune is for the whole swarm"),
        ("land @9", "no agent 9 in this mission; allowed: 1, 2, 3, 4, 5, 6"),
        ("land @x", "@x names no agents; allowed: @all, @1,3-5"),
        ("land @", "names no agents"),
    ],
)
def test_refusals_say_what_is_allowed(line: str, why: str) -> None:
    with pytest.raises(InputError, match=re.escape(why)):
        parse(line, PLAN)


@given(st.text(max_size=40))
def test_any_text_is_an_order_or_refused(line: str) -> None:
    with contextlib.suppress(InputError):
        order = parse(line, PLAN)
        assert order.kind in BY_NAME
        assert set(order.agents) <= {agent.id for agent in PLAN.agents}


FALLS = {"land", "return", "kill", "expel", "launch"}


@given(st.text("abdefhiklmnorstuvx @123=", max_size=12))
def test_no_line_is_completed_to_what_lands_returns_or_kills(line: str) -> None:
    for found in complete(line, PLAN):
        assert found.startswith(line)
        assert found.split()[0] not in FALLS


def test_completion_knows_the_arguments_of_each_command_alone() -> None:
    assert complete("form ", PLAN) == ["form hexagon"]
    assert complete("form hexagon", PLAN) == complete("form hexagon ", PLAN) == []
    assert complete("form l", PLAN) == complete("form @", PLAN) == complete("move ", PLAN) == []
    assert complete("hold @", PLAN)[:2] == ["hold @all", "hold @1"]
    assert complete("land @", PLAN) == complete("kill ", PLAN) == complete("fly l", PLAN) == []


def test_completion_knows_the_law() -> None:
    """Names that are not given yet, with the mission's values."""
    assert complete("tune ", PLAN) == [
        f"tune {v}" for v in ("delta_a=0.1", "delta_l=2", "h=0.05", "kappa=20", "plan")
    ]
    assert complete("tune h", PLAN) == ["tune h=0.05"]
    assert complete("tune h=0.04 k", PLAN) == ["tune h=0.04 kappa=20"]
    assert complete("tune h=0.04 h", PLAN) == []


def test_an_order_by_so_much_says_so() -> None:
    order = replace(parse("move 10 0", hexagon_plan()), by=True)
    assert order.text == "move --by 10 0"
    assert parse("move 10 0", hexagon_plan()).text == "move 10 0"


@pytest.mark.parametrize(
    ("line", "order"),
    [
        ("hold @scouts", Order("hold", groups=("scouts",))),
        ("hold scouts", Order("hold", groups=("scouts",))),
        ("@scouts hold", Order("hold", groups=("scouts",))),
        ("land @scouts,7", Order("land", (), (7,), groups=("scouts",))),
        ("land @scouts,@7 @rest", Order("land", (), (7,), groups=("scouts", "rest"))),
        ("land @1-3 @5", Order("land", (), (1, 2, 3, 5))),
        ("hold @scouts,all", Order("hold")),
        ("form wedge @scouts", Order("form", ("wedge",), groups=("scouts",))),
        ("form wedge @1-4", Order("form", ("wedge",), SCOUTS)),
        ("move @rest --by 3 4", Order("move", ("3", "4"), by=True, groups=("rest",))),
        ("expel @rest", Order("expel", groups=("rest",))),
    ],
)
def test_groups_are_known_by_name(line: str, order: Order) -> None:
    """With agents beside them, in any order of words, behind one `@` or several."""
    assert parse(line, GROUPS) == order
    if order.whom:
        assert parse(f"{order.text} @{order.whom}", GROUPS) == order


def test_a_marked_group_forms() -> None:
    assert parse("form wedge", GROUPS, SCOUTS) == Order("form", ("wedge",), SCOUTS)


@pytest.mark.parametrize(
    ("line", "why"),
    [
        (
            "hold @scout",
            "@scout names no agents and no group; did you mean @scouts?; allowed: @all, @scouts",
        ),
        ("hold @seven", "no group; allowed: @all, @scouts, @sweepers, @rest, @1,3-5"),
        ("hold @scouts,99", "no agent 99"),
        ("hold @99,all", "no agent 99"),
        ("tune h=0.04 @scouts", "tune is for the whole swarm; leave out @scouts"),
        (
            "form wedge @scouts,7",
            "a whole group; leave out @scouts,7, or name one group: @scouts, @sweepers, @rest",
        ),
        ("move 1 2 @1-3", "or name one group: @scouts"),
        ("follow boat @scouts,rest", "or name one group"),
    ],
)
def test_what_is_no_group_is_refused_with_their_names(line: str, why: str) -> None:
    with pytest.raises(InputError, match=re.escape(why)):
        parse(line, GROUPS)


def test_completion_knows_the_groups() -> None:
    """Behind a shape or a point as well; never behind what lands."""
    assert complete("hold @", GROUPS)[:4] == [
        f"hold @{w}" for w in ("all", "scouts", "sweepers", "rest")
    ]
    assert complete("form wedge @sc", GROUPS) == ["form wedge @scouts"]
    assert complete("move 20 -5 @s", GROUPS) == ["move 20 -5 @scouts", "move 20 -5 @sweepers"]
    assert complete("move 20 -5 @scouts ", GROUPS) == complete("land @s", GROUPS) == []
    assert complete("form ", GROUPS) == [f"form {w}" for w in ("block", "line", "ring", "wedge")]


def test_goto_and_launch_are_for_agents_that_are_named() -> None:
    """By metres or by latitude and longitude; without agents, and for no number, they say how."""
    order = parse("goto 20 -5 3 @1,2", PLAN)
    assert (order.kind, order.arguments, order.agents) == ("goto", ("20", "-5", "3"), (1, 2))
    assert parse("goto -35.36,149.16 @1", PLAN).arguments == ("-35.36,149.16",)
    assert parse("goto 20 -5", PLAN, marked=[3]).agents == (3,)
    assert parse("launch 3", PLAN).agents == (3,)
    assert parse("join 3", PLAN) == parse("resume 3", PLAN)
    for line, why in (
        ("goto 20 -5", "goto is for some agents; e.g. goto 20 -5 @3; for all: move"),
        ("launch", "launch is for some agents; e.g. launch @3"),
        (
            "goto 20 @3",
            "usage: goto NORTH EAST [SPEED], e.g. goto 20 -5 @3, or goto -35.3629,149.16",
        ),
        ("goto nan 1 @3", "usage: goto"),
    ):
        with pytest.raises(InputError, match=re.escape(why)):
            parse(line, PLAN)


def test_a_group_that_flies_no_steps_of_its_own_is_known_to_orders() -> None:
    """It only names agents."""
    plan = replace(PLAN, named=(NamedAgents("west", (1, 4)),))
    order = parse("hold @west", plan)
    assert order.groups == ("west",)
    assert order.named(plan, 1) == (1, 4)
    with pytest.raises(InputError, match="allowed: @all, @west"):
        parse("hold @wets", plan)
