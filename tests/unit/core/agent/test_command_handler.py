"""An operator's commands, each in each phase: accepted or refused with a reason, never repeated."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.agent.command_handler import (
    ABOUT,
    KINDS,
    AgentSituation,
    CommandHandler,
    Override,
)
from swarm_ctl.core.model.messages import Ack, Command, CommandKind, Phase
from swarm_ctl.core.model.plan import Fence, Plan, Point
from swarm_ctl.core.model.steps.follow import FollowStep
from swarm_ctl.core.model.steps.goto import GotoStep
from swarm_ctl.core.model.steps.hold import HoldStep
from swarm_ctl.core.model.steps.move import MoveStep
from swarm_ctl.core.model.targets import TargetPlan
from swarm_ctl.core.swarm.gain_update import ASKS
from tests.unit.core.builders import (
    FORMING,
    GROUP,
    HOLD,
    LAST,
    MOVING,
    NOW,
    OWN,
    RETURNING,
    SLOTS,
    TAKEOFF,
    peer,
    plan,
    progress,
    snapshot,
)

PLAN = plan(
    fence=Fence(((-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (-50.0, 50.0)), 30.0),
    targets=(TargetPlan("boat"),),
)
FOLLOWING: Final = FollowStep(
    "boat", (0.0, 5.0), in_course=False, speed_mps=2.0, duration_s=9.0, timeout_s=9.0
)
HASH = PLAN.hash()
HELD: Final = Override(CommandKind.HOLD, HoldStep(1e9, 1e9), 7, 0)


def command(kind: str, name: str = "c1", **changes: Any) -> Command:
    """To all agents, with a number of its own; with what `form`, `move` and `expel` need."""
    steps = {
        CommandKind.FORM: FORMING,
        CommandKind.MOVE: MOVING,
        CommandKind.FOLLOW: FOLLOWING,
        CommandKind.GOTO: GotoStep(((OWN, (5.0, 5.0)),), 2.0, 60.0),
    }
    sent = Command(
        name,
        kind,
        (OWN,) if kind == CommandKind.GOTO else (),
        NOW,
        step=steps.get(CommandKind(kind)) if kind in KINDS else None,
    )
    about = (2,) if kind in ABOUT else ()
    return replace(sent, **{"number": sent.tag, "about": about} | changes)


def situation(
    phase: Phase = Phase.FLY,
    override: Override | None = None,
    *,
    step: int = HOLD,
    of: Plan = PLAN,
    formed: bool = True,
) -> AgentSituation:
    airborne = phase not in (Phase.CONNECT, Phase.PREPARE, Phase.ENDED)
    return AgentSituation(
        plan=of,
        group=GROUP,
        members=of.groups[0].ids,
        agent=OWN,
        phase=phase,
        airborne=airborne,
        progress=progress(of, step),
        formed=formed,
        override=override,
        peers=snapshot(),
    )


def answer(what: Command, where: AgentSituation | None = None) -> Ack:
    """The answer of an agent that has heard no other command but the one it carries out."""
    where = where or situation()
    handler = CommandHandler(PLAN, OWN, HASH)
    handler.override = where.override
    return handler.answer(what, where, 0)[0]


# --- each command in each phase ---

TABLE = """
        connect prepare arm takeoff fly hold held land return yield ended
hold    no      no      no  no      ok  no   ok   no   no     no    no
resume  no      no      no  no      no  no   ok   no   no     no    no
next    no      no      no  no      ok  no   ok   no   no     no    no
form    no      no      no  no      ok  no   ok   no   no     no    no
move    no      no      no  no      ok  no   ok   no   no     no    no
follow  no      no      no  no      ok  no   ok   no   no     no    no
goto    no      no      no  no      ok  no   ok   no   no     no    no
launch  no      no      no  no      no  no   no   no   no     no    no
land    ok      ok      ok  ok      ok  ok   ok   ok   ok     no    no
return  no      no      ok  ok      ok  ok   ok   no   ok     no    no
kill    ok      ok      ok  ok      ok  ok   ok   ok   ok     ok    no
expel   no      no      ok  ok      ok  ok   ok   ok   ok     ok    ok
readmit no      no      ok  ok      ok  ok   ok   ok   ok     ok    ok
"""
"""`hold`: by a failsafe's policy; `held`: by an operator's command, in phase FLY. No agent of this
plan waits on the ground to be launched."""
_HEAD, *_LINES = [line.split() for line in TABLE.strip().splitlines()]
CELLS = [
    (kind, phase, word == "ok")
    for kind, *words in _LINES
    for phase, word in zip(_HEAD, words, strict=True)
]
STEP_OF = {"connect": 0, "prepare": 0, "arm": TAKEOFF, "takeoff": TAKEOFF, "land": LAST}


@pytest.mark.parametrize(("kind", "phase", "accepted"), CELLS)
def test_each_command_in_each_phase(kind: str, phase: str, accepted: bool) -> None:
    """As the table says; every refusal gives a reason."""
    held = phase == "held"
    where = situation(
        Phase.FLY if held else Phase[phase.upper()],
        HELD if held else None,
        step=STEP_OF.get(phase, HOLD),
    )
    ack = answer(command(kind), where)
    assert (ack.accepted, ack.agent, ack.command) == (accepted, OWN, "c1")
    assert bool(ack.reason) is not accepted


def test_resume_takes_a_vehicle_again_that_is_given_back() -> None:
    """And no other command does."""
    given_back = replace(situation(Phase.YIELD), not_given_back="")
    assert answer(command("resume"), given_back).accepted
    others = set(KINDS) - {CommandKind.RESUME, CommandKind.KILL, *ASKS, *ABOUT}
    assert not any(answer(command(kind), given_back).accepted for kind in others)


@pytest.mark.parametrize(
    "waits",
    [{"override": 7}, {"left": CommandKind.GOTO}, {"phase": Phase.HOLD}, {"phase": Phase.YIELD}],
    ids=str,
)
def test_a_resume_to_all_is_done_for_those_that_fly_on(waits: dict[str, Any]) -> None:
    """While another agent waits for it. By its own number it is refused, and so it is of all where
    none waits."""
    handler = CommandHandler(PLAN, OWN, HASH)
    some = replace(situation(), peers=snapshot(peer(2), peer(3, **waits)))
    ack, new = handler.answer(command("resume"), some, 0)
    assert (ack.accepted, new) == (True, False)
    assert not answer(command("resume", agents=(OWN,)), some).accepted
    assert not answer(command("resume"), situation()).accepted


def test_a_target_that_the_mission_has_not_is_refused_with_its_name() -> None:
    """So are an offset that is no number, a speed beyond the limits, and some agents alone."""
    for changes, why in (
        ({"step": replace(FOLLOWING, target="ship")}, "no target 'ship'"),
        ({"step": replace(FOLLOWING, offset_m=(math.nan, 0.0))}, "offset_m is nan"),
        ({"step": replace(FOLLOWING, speed_mps=99.0)}, "99 m/s; allowed: above 0"),
        ({"step": MOVING}, "has no target"),
        ({"agents": (OWN,)}, "as a whole"),
    ):
        ack = answer(command("follow", **changes), situation())
        assert not ack.accepted
        assert why in ack.reason


def test_the_table_has_every_command_and_phase() -> None:
    told = {kind for kind, *_ in _LINES}
    assert told == set(KINDS) - {*ASKS}  # test_gain_update.py
    assert {phase.name.lower() for phase in Phase} == set(_HEAD) - {"held"}


# --- why not ---


def form(*slots: Point) -> Command:
    return command("form", step=replace(FORMING, slots=slots))


def move(to: Point, speed_mps: float = 2.0) -> Command:
    return command("move", step=MoveStep((to,), speed_mps, 0.5, 2.0, 60.0))


NAN = float("nan")
BRAKES = replace(situation(Phase.HOLD), lands=True)
REFUSALS: list[tuple[str, Command, AgentSituation, str]] = [
    ("another agent's", command("hold", agents=(2, 3)), situation(), "not meant for agent 1"),
    ("unknown", command("loop"), situation(), "unknown command 'loop'; allowed: hold"),
    ("ended", command("land"), situation(Phase.ENDED), "no longer flies its vehicle"),
    ("another plan's", command("form", plan_hash=HASH + 1), situation(), "made for the plan"),
    ("nothing to resume", command("resume"), situation(), "not held; there is nothing to resume"),
    ("not yet", command("hold"), situation(Phase.TAKEOFF), "not flying yet (phase takeoff)"),
    ("landing", command("hold"), situation(Phase.LAND), "on its way down (phase land)"),
    ("land step", command("hold"), situation(step=LAST), "on its way down (phase fly)"),
    ("return step", command("hold"), situation(of=RETURNING, step=LAST), "on its way down"),
    ("held by a policy", command("form"), situation(Phase.HOLD), "held by a policy"),
    ("return while landing", command("return"), situation(Phase.LAND), "is landing already"),
    ("return, braking to land", command("return"), BRAKES, "is landing already"),
    ("return on the ground", command("return"), situation(Phase.PREPARE), "is not in the air"),
    ("kill after the end", command("kill"), situation(Phase.ENDED), "agent 1 has ended"),
    ("no shape", command("form", step=None), situation(), "the command has no shape"),
    ("some form", command("form", agents=(1, 2)), situation(), "for a whole group"),
    ("two slots", form(*SLOTS[:2]), situation(), "row has 2 slots for 3 agents"),
    ("a slot is NaN", form(*SLOTS[:2], (NAN, 0.0)), situation(), "its slots is nan"),
    ("slots too near", form(*SLOTS[:2], (0.0, 8.0)), situation(), "3 units apart; allowed: more"),
    ("no point", command("move", step=None), situation(), "no point to go to"),
    ("no waypoints", command("move", step=MoveStep((), 1, 1, 1, 1)), situation(), "no point to"),
    ("some move", command("move", agents=(1,)), situation(), "moves as a whole"),
    ("no formation", command("move"), situation(formed=False), "no formation to move yet"),
    ("too fast", move((0.0, 0.0), 5.1), situation(), "5.1 m/s; allowed: above 0, at most 5 m/s"),
    ("no speed", move((0.0, 0.0), 0.0), situation(), "0 m/s; allowed: above 0"),
    ("beyond the fence", move((51.0, 0.0)), situation(), "(51, 0) m: outside the geofence"),
    ("to NaN", move((NAN, 0.0)), situation(), "its waypoints_m is nan"),
]


@pytest.mark.parametrize(
    ("what", "given_command", "where", "reason"), REFUSALS, ids=[row[0] for row in REFUSALS]
)
def test_why_a_command_is_refused(
    what: str, given_command: Command, where: AgentSituation, reason: str
) -> None:
    ack = answer(given_command, where)
    assert not ack.accepted
    assert reason in ack.reason


@pytest.mark.parametrize(
    "just_allowed",
    [
        command("hold", agents=(1, 3)),
        command("form", plan_hash=HASH),
        form(*SLOTS[:2], (0.0, 8.01)),
        move((49.9, 0.0)),
        move((0.0, 0.0), 5.0),
    ],
)
def test_just_allowed(just_allowed: Command) -> None:
    assert answer(just_allowed).accepted


# --- what they leave behind ---


class Flying:
    """An agent in the hold step, to which commands come."""

    def __init__(self) -> None:
        self.handler = CommandHandler(PLAN, OWN, HASH)
        self.done: list[str] = []

    def take(self, *commands: Command, leg: int = 0) -> list[Ack]:
        acks = []
        for each in commands:
            ack, new = self.handler.answer(each, situation(override=self.handler.override), leg)
            acks.append(ack)
            self.done += [each.id] * new
        return acks


def at(later_s: float, kind: str, name: str, **changes: Any) -> Command:
    return command(kind, name, time_s=NOW + later_s, **changes)


def test_an_override_lasts_until_resume_or_next() -> None:
    """It carries the command's step and tag, and the leg on which the mission's step goes on."""
    agent = Flying()
    form = at(0, "form", "a")
    agent.take(form, leg=2)
    assert agent.handler.override == Override("form", FORMING, form.tag, 2)
    agent.take(at(1, "hold", "b"), leg=0)
    assert agent.handler.override is not None
    assert isinstance(agent.handler.override.step, HoldStep)
    assert agent.handler.override.leg == 2
    agent.take(at(2, "resume", "c"))
    assert agent.handler.override is None


def test_an_older_command_is_refused_but_never_an_ending_one() -> None:
    """By the sender's time, not by the order in which they come."""
    agent = Flying()
    older = at(-1, "form", "old"), at(-1, "land", "down")
    assert agent.take(at(0, "hold", "new"))[0].accepted
    refused, landed = agent.take(*older)
    assert refused.reason == "a newer command is in force"
    assert landed.accepted


NAMES = st.integers(0, 5)
COMMANDS = st.lists(
    st.tuples(NAMES, st.sampled_from(["hold", "resume", "next", "form", "move", "land"])),
    max_size=8,
    unique_by=lambda row: row[0],
)


def commands_of(rows: list[tuple[int, str]]) -> list[Command]:
    """One command a name, at the time that its name says."""
    return [at(name, kind, f"c{name}") for name, kind in rows]


@given(COMMANDS, st.data())
def test_repeated_commands_change_nothing(rows: list[tuple[int, str]], data: st.DataObject) -> None:
    """A station repeats a command until it is acknowledged: each copy gets the first answer, and
    what the agent flies is the same as without the copies."""
    once = commands_of(rows)
    often = list(once)
    for each in data.draw(st.lists(st.sampled_from(once), max_size=8)) if once else []:
        often.insert(data.draw(st.integers(often.index(each) + 1, len(often))), each)
    plain, repeated = Flying(), Flying()
    acks = {ack.command: ack for ack in plain.take(*once)}
    assert all(ack == acks[ack.command] for ack in repeated.take(*often))
    assert repeated.done == plain.done
    assert repeated.handler.override == plain.handler.override
    assert repeated.handler.ordered == plain.handler.ordered
