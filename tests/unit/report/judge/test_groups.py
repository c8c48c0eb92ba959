"""A run whose mission splits into groups: steps, findings and the verdict name them."""

from __future__ import annotations

import io
from dataclasses import replace
from typing import Final

import numpy as np
import pytest
from matplotlib.figure import Figure
from rich.console import Console, RenderableType

from swarm_ctl.core.model.causes import Cause
from swarm_ctl.core.model.fleet import FleetAgent
from swarm_ctl.core.model.messages import AgentStatus, Departure, Outcome, StepOutcome, StepResult
from swarm_ctl.core.model.route import Routes
from swarm_ctl.report.judge.findings import Finding, FindingKind, headlines, step_at
from swarm_ctl.report.judge.summarise import summary_of
from swarm_ctl.report.judge.summary import StepSummary, StepVerdict, Summary
from swarm_ctl.report.judge.verdict import Ending, judge
from swarm_ctl.report.page.junit import junit
from swarm_ctl.report.page.mission_plot import _draw_steps
from swarm_ctl.report.page.player import _steps
from swarm_ctl.report.page.player_parts import labels
from swarm_ctl.report.page.run_history import HeardMessages, RunHistory
from swarm_ctl.report.page.summary_table import brief, left_words, step_rows
from swarm_ctl.runfolder.flight import no_flight
from swarm_ctl.runfolder.last_statuses import LastStatus
from swarm_ctl.runfolder.run_folder import RunFolder
from swarm_ctl.station.picture.colours import inks
from tests.unit.plans import REST, SCOUTS, SWEEPERS, groups_mission
from tests.unit.report.run_folders import manifest
from tests.unit.station.swarm import status_of

PLAN: Final = groups_mission().plan
ROUTES: Final = Routes(PLAN).of
MANIFEST: Final = manifest(
    PLAN,
    fleet=tuple(FleetAgent(i, i, "ardupilot", f"udpout:127.0.0.1:{14600 + i}") for i in ROUTES),
)
EVERY_S: Final = 10.0
"""Each step takes so long, of each agent."""


def status(
    agent: int, steps: int = 11, how: StepOutcome = StepOutcome.DONE, **more: object
) -> AgentStatus:
    """An account that ends in this step, with this result."""
    results = [
        StepResult(ROUTES[agent].step_name(k), StepOutcome.DONE, EVERY_S * k, EVERY_S * (k + 1))
        for k in range(steps)
    ]
    last = ROUTES[agent].step_name(steps)
    results.append(StepResult(last, how, EVERY_S * steps, EVERY_S * (steps + 1)))
    outcome = Outcome.COMPLETED if how is StepOutcome.DONE else Outcome.FAILED
    told = {"outcome": outcome, "steps": tuple(results), "step": steps, "done": True}
    return status_of(PLAN, agent, 130.0, **(told | more))


def run_of(statuses: list[AgentStatus]) -> RunFolder:
    """The folder of a run that these agents flew."""
    made, agents = MANIFEST, tuple(agent.id for agent in PLAN.agents)
    last = {each.agent: LastStatus(each, final=True) for each in statuses}
    return RunFolder(made, None, {}, None, agents=agents, last=last, notes=[])


def completed() -> RunFolder:
    return run_of([status(agent.id) for agent in PLAN.agents])


def text_of(shown: RenderableType) -> str:
    console = Console(width=100, file=io.StringIO())
    with console.capture() as told:
        console.print(shown)
    return told.get()


def flown(*, sweepers: StepOutcome) -> RunFolder:
    """The sweepers break their third step off; the others end for that."""
    why = "step 3 (form line) timed out after 9 s: this agent was not done"
    told = [status(i, 3, sweepers, reason=why, cause=Cause.TIMEOUT) for i in SWEEPERS]
    follows = {"reason": "agent 5 broke the mission off", "cause": Cause.PEER}
    told += [status(i, 5, StepOutcome.ABORTED, **follows) for i in SCOUTS]
    told += [status(i, 3, StepOutcome.ABORTED, **follows) for i in REST]
    return run_of(sorted(told, key=lambda each: each.agent))


def test_each_step_has_its_group_and_a_short_group_joins_once() -> None:
    """The agents of a group are asked for its steps alone."""
    steps = summary_of(completed(), []).steps
    assert [(s.group, s.step, s.name) for s in steps if s.group == "scouts"] == [
        ("scouts", 3, "form wedge"),
        ("scouts", 4, "move"),
        ("scouts", 5, "barrier ridge"),
        ("scouts", 6, "move"),
        ("scouts", 7, "join 1"),
    ]
    assert [(s.group, s.step) for s in steps if s.group == "rest"] == [("rest", 3)]
    assert [s.step for s in steps if s.group == "all"] == [0, 1, 2, 9, 10, 11]
    members = {s.group: s.agents for s in steps}
    assert members["sweepers"] == SWEEPERS
    assert {s.result for s in steps} == {StepVerdict.DONE}
    assert all(not s.exceptions for s in steps)


def test_an_older_summary_of_steps_without_groups_still_reads() -> None:
    old = summary_of(completed(), []).steps[0].model_dump(mode="json", exclude={"group", "agents"})
    assert StepSummary.model_validate(old).group == ""


def test_the_verdict_says_which_group_failed_and_why() -> None:
    """The one that failed first, by the group of its step; then those that followed it."""
    verdict = judge(flown(sweepers=StepOutcome.TIMEOUT), {})
    assert verdict.outcome is Outcome.FAILED
    first, *others = verdict.reason.split("; ")
    assert first == (
        "group sweepers (agents 5-10): step 3 (form line) timed out after 9 s: this agent was not"
        " done"
    )
    assert others == [
        "group rest (agents 11-12) and group scouts (agents 1-4): agent 5 broke the mission off"
    ]


def test_an_order_to_all_names_the_groups_that_it_found() -> None:
    told = [
        status(i, 3, StepOutcome.ABORTED, reason="landed", outcome=Outcome.ABORTED) for i in ROUTES
    ]
    assert judge(run_of(told), {}).reason == (
        "group scouts (agents 1-4) and group sweepers (agents 5-10) and group rest (agents 11-12):"
        " landed"
    )
    by_hand = Ending("Ctrl-C")
    assert judge(run_of(told), {}, ending=by_hand).reason == (
        "Ctrl-C: all landed; group scouts (agents 1-4) and group sweepers (agents 5-10) and group"
        " rest (agents 11-12): landed"
    )


def test_before_the_split_the_verdict_names_no_group() -> None:
    told = [
        status(agent.id, 2, StepOutcome.ABORTED, reason="battery low", cause=Cause.VEHICLE)
        for agent in PLAN.agents
    ]
    assert judge(run_of(told), {}).reason == "agents 1-12: battery low, in step 2 (form block)"


def test_one_that_left_no_account_is_named_with_its_group() -> None:
    run = completed()
    last = run.last | {2: LastStatus(status(2, 4, StepOutcome.RUNNING), final=False)}
    reason = judge(replace(run, last=last), {}).reason
    assert reason.startswith("agent 2 of group scouts left no final status; last heard at 130.0 s")


def test_a_finding_is_in_the_steps_of_its_agents_groups() -> None:
    run = completed()
    found = Finding(FindingKind.TOO_CLOSE, 45.0, (2, 7), "agents 2, 7 were 1.00 m apart")
    where = "in step 4 (move) of scouts and step 4 (move) of sweepers"
    assert step_at(run, found) == where
    assert headlines(run, [found]) == [f"agents 2, 7 were 1.00 m apart, {where}"]
    within = replace(found, agents=(1, 2), time_s=55.0)
    assert step_at(run, within) == "in step 5 (barrier ridge) of scouts"
    early = replace(found, time_s=-1.0)
    assert step_at(run, early) == "before the first step"


@pytest.fixture
def failed() -> Summary:
    return summary_of(flown(sweepers=StepOutcome.TIMEOUT), [])


def test_the_tables_name_the_groups(failed: Summary) -> None:
    """And not the whole swarm, where the end of a flight is told in few words."""
    words = " ".join(text_of(brief(failed)).split())
    assert "3 sweepers form line timeout" in words
    assert "5 scouts barrier ridge aborted" in words
    assert "not reached: scouts 6-7, sweepers 4-8, 9-11" in words
    heads, *rows = step_rows(failed)
    assert heads == ["group", "step", "result", "from [s]", "to [s]", "not done"]
    assert ["sweepers", "form line", "timeout", "30.0", "40.0", "5-10 timeout"] in rows
    assert ["all", "takeoff", "done", "10.0", "20.0", ""] in rows


def test_the_test_cases_of_a_ci_name_the_groups(failed: Summary) -> None:
    assert 'name="4 move of scouts"' in junit(failed)
    assert 'name="4 move of sweepers"' in junit(failed)


def test_those_who_left_together_are_told_together() -> None:
    gone = {"outcome": Outcome.ABORTED, "left": Departure("land", 45.0)}  # type: ignore[arg-type]
    told = [status(i, 4, StepOutcome.ABORTED, **gone) for i in SCOUTS]
    told += [status(i) for i in (*SWEEPERS, *REST)]
    summary = summary_of(run_of(told), [])
    assert summary.outcome is Outcome.COMPLETED
    assert left_words(summary) == "without agents 1-4 (land at 45.0 s)"


def test_the_player_tells_the_steps_of_all_groups_at_each_moment() -> None:
    run = completed()
    history = RunHistory("run", run, MANIFEST, no_flight(12), HeardMessages(), ())
    told = {step["t"]: step["text"] for step in _steps(history)}
    assert told[20.0] == "form block"
    assert told[30.0] == "scouts form wedge, sweepers form line, rest join 1"
    assert told[50.0] == "scouts barrier ridge, sweepers hold, rest join 1"
    assert told[70.0] == "scouts join 1, sweepers move, rest join 1"
    assert told[90.0] == "form ring"
    assert [*told] == sorted(told)
    assert inks(history.plan) == [0] * 4 + [1] * 6 + [2] * 2
    assert labels(history.plan)[:6] == ["1 scouts", "2", "3", "4", "5 sweepers", "6"]


def test_a_shape_stands_wherever_the_other_groups_are() -> None:
    """100 m apart: each agent is off by its own group's mean alone."""
    run, nothing = completed(), no_flight(12)
    places = np.full((2, 12, 3), np.nan)
    for group, centre in (("scouts", (0.0, 0.0)), ("sweepers", (100.0, -50.0))):
        plan = next(each for each in PLAN.groups if each.name == group)
        form = plan.steps[0].new_shape
        assert form is not None
        columns = [agent - 1 for agent in plan.ids]
        places[:, columns, :2] = np.array(form.slots) * PLAN.unit_m + centre
        places[:, columns, 2] = -10.0
    places[1, 0, 0] += 4.0
    there = np.isfinite(places[..., 0])
    flight = replace(
        nothing,
        time_s=np.array([32.0, 35.0]),
        position_ned_m=places,
        airborne=there,
        armed=there,
        live=there,
    )
    history = RunHistory("run", run, MANIFEST, flight, HeardMessages(), ())
    off_m = np.linalg.norm(history.deviations(), axis=-1)
    assert off_m[0, :10] == pytest.approx(np.zeros(10), abs=1e-6)
    assert off_m[1, :4] == pytest.approx([3.0, 1.0, 1.0, 1.0])
    assert off_m[1, 4:10] == pytest.approx(np.zeros(6), abs=1e-6)
    assert np.isnan(off_m[:, 10:]).all()


def test_each_groups_way_has_its_colour_on_the_missions_plot() -> None:
    """The whole swarm's is black; a join has no mark."""
    axes = Figure().subplots()
    _draw_steps(PLAN, axes)
    lines = {str(line.get_label()): line.get_color() for line in axes.lines}
    assert {*lines} == {
        *("scouts: 4 move", "scouts: 6 move", "sweepers: 4 move", "sweepers: 7 move"),
        "all: 10 move",
    }
    assert lines["scouts: 4 move"] == lines["scouts: 6 move"]
    assert len({lines[f"{name} move"] for name in ("scouts: 4", "sweepers: 4", "all: 10")}) == 3
    assert lines["all: 10 move"] == "k"
    forms = [str(marks.get_label()) for marks in axes.collections]
    assert forms == [
        "all: 2 form block",
        "scouts: 3 form wedge",
        "sweepers: 3 form line",
        "all: 9 form ring",
    ]
