"""Groups that part and meet: no agent is ahead of those that it waits for, whatever is lost, late
or repeated, and all come to the end in whatever order they act."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.agent.progress import Progress
from swarm_ctl.core.model.plan import GroupPlan, Plan, Policy
from swarm_ctl.core.model.route import Routes, flight_s
from swarm_ctl.core.model.steps.barrier import BarrierStep
from swarm_ctl.core.model.steps.hold import HoldStep
from swarm_ctl.core.model.steps.land import LandStep
from swarm_ctl.core.model.steps.takeoff import TakeoffStep
from tests.unit.core.builders import plan

HOLD, LAND = HoldStep(10.0, 40.0), LandStep(60.0)
MEET, JOIN = BarrierStep("ridge", 60.0), BarrierStep("join 1", 60.0)
GOES_ON = replace(MEET, on_timeout=Policy.CONTINUE)
ONE, OTHER, HOME = (1, 2), (3, 4, 5), (6,)
NEVER = (-1, False)


def parted(meet: BarrierStep = MEET) -> Plan:
    """All take off; two groups fly their own steps with one barrier between them, a third lands;
    the two join."""
    made = plan(agents=6)
    agents = {agent.id: agent for agent in made.agents}

    def group(name: str, ids: tuple[int, ...], before: int, *steps: object) -> GroupPlan:
        return GroupPlan(name, tuple(agents[i] for i in ids), steps, before, 8.0)  # type: ignore[arg-type]

    whole = GroupPlan("all", made.agents, (TakeoffStep(8.0, 60.0), HOLD))
    one = group("one", ONE, 2, HOLD, meet, JOIN, JOIN)
    other = group("other", OTHER, 2, HOLD, HOLD, meet, JOIN)
    return replace(
        made,
        groups=(
            whole,
            one,
            other,
            group("home", HOME, 2, LAND),
            group("rest", ONE + OTHER, 6, HOLD, LAND),
        ),
    )


PLAN = parted()
ROUTES = Routes(PLAN)
IDS = tuple(ROUTES.of)
LAST = {i: len(ROUTES.of[i].steps) for i in IDS}


def go_on(agent: int, progress: Progress, heard: dict[int, tuple[int, bool]]) -> None:
    """As an agent does after each tick."""
    waits = ROUTES.awaited(agent, progress.step)
    told = {i: heard[i] for i in waits if i != agent}
    if progress.done and not progress.finished and not ROUTES.late(agent, progress.step, told):
        progress.advance(0.0)


def needed(agent: int, step: int) -> dict[int, int]:
    """Straight from the plan: what all others have to be done with before `agent` begins a step."""
    group = PLAN.group_of(agent, step)
    if step == group.before + 1 and group.name == "rest":
        return dict.fromkeys(ONE + OTHER, 6)
    found = dict.fromkeys(PLAN.group_of(agent, step - 1).ids, step - 1)
    if ROUTES.of[agent].steps[step - 2] is MEET:
        found |= dict.fromkeys(ONE, 4) | dict.fromkeys(OTHER, 5)
    return found


@given(st.data())
def test_no_agent_runs_ahead(data: st.DataObject) -> None:
    """An agent begins a step only when all that it waits for are done with theirs before it; true
    at every moment."""
    agents = {i: Progress(ROUTES.of[i], 60.0, 0.0) for i in IDS}
    heard = {i: dict.fromkeys(IDS, NEVER) for i in IDS}  # what i last heard of each
    done_with = dict.fromkeys(IDS, -1)
    for _ in range(data.draw(st.integers(1, 60))):
        i = data.draw(st.sampled_from(IDS))
        match data.draw(st.sampled_from(["finish", "go on", "deliver", "deliver", "deliver"])):
            case "finish":
                agents[i].finish_step(0.0)
                done_with[i] = max(done_with[i], agents[i].step)
            case "go on":
                before = agents[i].step
                go_on(i, agents[i], heard[i])
                if agents[i].step > before > 0:
                    wanted = needed(i, agents[i].step)
                    assert all(done_with[j] >= number for j, number in wanted.items())
            case _:
                for j in IDS:
                    heard[i][j] = max(heard[i][j], (agents[j].step, agents[j].done))


@given(st.permutations(IDS))
def test_all_come_to_the_end_in_any_order(order: list[int]) -> None:
    """With every state delivered, whatever the order they act in; the steps of each count on."""
    agents = {i: Progress(ROUTES.of[i], 60.0, 0.0) for i in IDS}
    for _ in range(40):
        for i in order:
            agents[i].finish_step(0.0)
            go_on(i, agents[i], {j: (agents[j].step, agents[j].done) for j in IDS})
    assert all(agent.finished for agent in agents.values())
    assert {i: len(agent.results) for i, agent in agents.items()} == {
        i: last + 1 for i, last in LAST.items()
    }


@given(st.data())
def test_what_another_agent_proves_is_true(data: st.DataObject) -> None:
    """A step that another one's step proves is one to which nobody keeps the agent from going."""
    agents = {i: Progress(ROUTES.of[i], 60.0, 0.0) for i in IDS}
    for _ in range(data.draw(st.integers(1, 60))):
        i = data.draw(st.sampled_from(IDS))
        agents[i].finish_step(0.0)
        go_on(i, agents[i], {j: (agents[j].step, agents[j].done) for j in IDS})
    heard = {j: (agents[j].step, agents[j].done) for j in IDS}
    i, j = data.draw(st.permutations(IDS))[:2]
    for _ in range(LAST[i]):
        agents[i].finish_step(0.0)
        go_on(i, agents[i], heard)
    assert agents[i].step >= ROUTES.proven(i, j, agents[j].step)


def test_a_barrier_that_is_left_when_its_time_is_over_proves_nothing_of_the_other_group() -> None:
    """An agent that is further tells those of its group where they are, and the others only that
    the swarm has parted, up to where all join again."""
    routes = Routes(parted(GOES_ON))
    past = routes.of[1].barriers["ridge"] + 1
    assert routes.proven(2, 1, past) == past
    assert {routes.proven(i, 1, past) for i in OTHER} == {3}
    assert {ROUTES.proven(i, 1, past) for i in OTHER} == {6}
    assert {routes.proven(i, 1, LAST[1]) for i in OTHER} == {LAST[3]}


def test_a_group_begins_when_the_last_of_its_agents_has_come() -> None:
    """The flight lasts as long as its longest way: 1 + 1, then 4 beside 20, then 1 + 5."""
    seconds = [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 5.0, 5.0, 5.0, 5.0, 3.0, 1.0, 5.0]
    assert len(seconds) == len(PLAN.all_steps())
    assert flight_s(PLAN, seconds) == 28.0
