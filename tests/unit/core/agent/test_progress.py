"""The barrier of states: no agent is ahead of what all have done, whatever is lost, late or
repeated."""

from __future__ import annotations

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.agent.progress import Progress
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.mission.compile.loader import load
from tests.unit.plans import steps_of

PLAN: Plan = load(Path(__file__).parents[4] / "missions" / "hexagon.yaml").plan
AGENTS = 4
NEVER = (-1, False)


@given(st.data())
def test_no_agent_runs_ahead(data: st.DataObject) -> None:
    """An agent is in step k + 1 only when every agent has been done with step k; true at every
    moment."""
    agents = [Progress(PLAN.groups[0], 60.0, 0.0) for _ in range(AGENTS)]
    heard = [[NEVER] * AGENTS for _ in agents]  # heard[i][j]: what i last heard of j
    done_with = [-1] * AGENTS  # the furthest step each has finished
    for turn in range(data.draw(st.integers(1, 60))):
        i = data.draw(st.integers(0, AGENTS - 1))
        match data.draw(st.sampled_from(["finish", "advance", "deliver", "deliver", "deliver"])):
            case "finish":
                agents[i].finish_step(float(turn))
                done_with[i] = max(done_with[i], agents[i].step)
            case "advance":
                others = [heard[i][j] for j in range(AGENTS) if j != i]
                agents[i].advance(others, float(turn))
            case _:
                j = data.draw(st.integers(0, AGENTS - 1))
                heard[i][j] = (agents[j].step, agents[j].done)
        for agent in agents:
            assert all(done >= agent.step - 1 for done in done_with)


@given(st.permutations(range(AGENTS)))
def test_it_goes_through_in_any_order(order: list[int]) -> None:
    """With every state delivered, all agents reach the end whatever the order they act in."""
    agents = [Progress(PLAN.groups[0], 60.0, 0.0) for _ in range(AGENTS)]
    for turn in range(3 * (len(steps_of(PLAN)) + 1)):
        for i in order:
            agents[i].finish_step(float(turn))
            agents[i].advance([(a.step, a.done) for a in agents if a is not agents[i]], float(turn))
    assert all(agent.finished for agent in agents)
    for agent in agents:
        assert [result.result for result in agent.results] == ["done"] * (len(steps_of(PLAN)) + 1)


def test_results_tell_how_each_step_went() -> None:
    """A step that is broken off keeps its name and says how it ended."""
    progress = Progress(PLAN.groups[0], 60.0, 1.0)
    progress.finish_step(2.0)
    progress.advance([], 3.0)
    progress.break_off("timeout", 4.0)
    progress.break_off("aborted", 9.0)
    assert [(r.name, r.result, r.start_s, r.end_s) for r in progress.results] == [
        ("prepare", "done", 1.0, 2.0),
        ("takeoff", "timeout", 3.0, 4.0),
    ]


def test_steps_have_the_mission_files_names() -> None:
    assert [PLAN.groups[0].step_name(k) for k in range(6)] == [
        "prepare",
        "takeoff",
        "form hexagon",
        "hold",
        "land",
        "?",
    ]
