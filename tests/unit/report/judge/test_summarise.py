"""From a run folder to its summary, whatever is left of the folder."""

from __future__ import annotations

import json
import math
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from swarm_ctl.core.law.formation import formation_error
from swarm_ctl.core.model.causes import Cause
from swarm_ctl.core.model.messages import (
    CommandKind,
    Departure,
    Event,
    LinkReport,
    Outcome,
    Phase,
    Severity,
    StepOutcome,
    StepResult,
    TickReport,
)
from swarm_ctl.errors import InputError
from swarm_ctl.report.judge.summarise import summarise
from swarm_ctl.report.judge.summary import Summary, read_summary, write_summary
from swarm_ctl.report.judge.verdict import Ending
from swarm_ctl.report.page.run_history import read_history
from swarm_ctl.report.page.summary_table import verdict_line
from swarm_ctl.runfolder.manifest import write_manifest
from tests.unit.report.run_folders import (
    END,
    EXIT_CODES,
    FORM,
    FORMED,
    HOLD,
    LAND,
    LIFTOFF,
    PLAN,
    STEPS,
    SYSIDS,
    TOUCHDOWN,
    account,
    manifest,
    position,
    true_minimum,
    truth_lines,
    write_lines,
    write_run,
    write_status,
)
from tests.unit.station.swarm import HEXAGON, status_of


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return write_run(tmp_path)


def _error_m(t: float, agents: tuple[int, ...] = (1, 2, 3, 4, 5, 6)) -> float:
    slots = [(5 * HEXAGON[i - 1][0], 5 * HEXAGON[i - 1][1]) for i in agents]
    return float(formation_error([position(i, t)[:2] for i in agents], slots))


def test_a_completed_run(run: Path) -> None:
    summary = summarise(run, EXIT_CODES)
    assert (summary.outcome, summary.reason, summary.notes) == ("completed", "", ())
    assert summary.cause is None
    formed = next(k / 10 for k in range(int(FORM * 10), int(END * 10)) if _error_m(k / 10) < 0.5)
    assert FORM < formed < FORMED
    assert summary.time_to_form_s == pytest.approx(formed - FORM)
    assert summary.formation_error_m == pytest.approx(0.0, abs=1e-6)
    distance, pair = true_minimum()
    assert summary.min_true_distance_m == pytest.approx(distance)
    assert summary.min_true_pair == pair
    assert (summary.r_in_m, summary.r_m) == (2.5, 22.5)
    assert summary.longest_link_pair is not None
    i, j = summary.longest_link_pair
    assert j in PLAN.agent(i).neighbours
    lengths = {
        math.dist(position(a.id, k / 10)[:2], position(b, k / 10)[:2]): (a.id, b)
        for a in PLAN.agents
        for b in a.neighbours
        for k in range(int(FORM * 10), int(LAND * 10) + 1)
    }
    assert summary.longest_link_m == pytest.approx(max(lengths))
    assert {i, j} == set(lengths[max(lengths)])
    assert (summary.mission_time_s, summary.wall_time_s, summary.speedup) == (END, END / 5, 5.0)
    assert summary.exit_codes == EXIT_CODES


def test_steps_counts_links_and_versions_of_a_completed_run(run: Path) -> None:
    summary = summarise(run, EXIT_CODES)
    assert [(step.step, step.name, step.result, step.exceptions) for step in summary.steps] == [
        (0, "prepare", "done", {}),
        (1, "takeoff", "done", {}),
        (2, "form hexagon", "done", {}),
        (3, "hold", "done", {}),
        (4, "land", "done", {}),
    ]
    assert [(step.start_s, step.end_s) for step in summary.steps[2:4]] == [
        (FORM, HOLD),
        (HOLD, LAND),
    ]
    assert summary.steps[2].time_to_form_s == summary.time_to_form_s
    assert summary.sigma_status == {"paper": 30, "narrow": 6, "inactive": 12, "overspeed": 0}
    assert (summary.overspeed, summary.setpoint_rate_hz) == (0, 20.0)
    assert (summary.tick.count, summary.tick.overruns, summary.tick.late_p99_ms) == (3000, 0, 1.3)
    assert len(summary.links) == 30
    assert {(link.age_p50_s, link.age_p99_s, link.loss) for link in summary.links} == {
        (0.02, 0.05, 0.01)
    }
    assert [(agent.agent, agent.sysid, agent.account) for agent in summary.agents] == [
        (i, sysid, "final") for i, sysid in zip(range(1, 7), SYSIDS, strict=True)
    ]
    assert summary.truth is not None
    assert (summary.truth.first_liftoff_s, summary.truth.last_touchdown_s) == (LIFTOFF, TOUCHDOWN)
    assert (summary.truth.complete, summary.truth.collisions) == (True, ())
    assert summary.events == {"warning": 1, "info": 6}
    assert (summary.mission, summary.mission_file, summary.swarm) == (
        "hexagon",
        "missions/hexagon.yaml",
        "swarm",
    )
    assert summary.plan_hash == manifest().plan_hash
    assert summary.started_at == "2026-03-01T12:30:00+00:00"
    assert summary.versions == {"swarm-ctl": "0.1.0"}


def test_the_worst_tick_and_the_slowest_agent_stand_for_all(run: Path) -> None:
    made = account(4)
    write_status(
        run,
        replace(made, setpoint_rate_hz=17.5, tick=replace(made.tick, late_p99_ms=9.0, overruns=3)),
    )
    summary = summarise(run, EXIT_CODES)
    assert (summary.setpoint_rate_hz, summary.tick.late_p99_ms, summary.tick.overruns) == (
        17.5,
        9.0,
        3,
    )


# --- outcomes ---


def _abort(run: Path, *aborted: int) -> None:
    broken = (*STEPS[:2], StepResult("form hexagon", StepOutcome.ABORTED, FORM, 28.0))
    told = {"outcome": Outcome.ABORTED, "reason": "landed by the operator", "steps": broken}
    for i in aborted:
        write_status(run, account(i, step=2, **told))


def test_an_operators_landing_is_aborted(run: Path) -> None:
    _abort(run, 1, 2, 3, 4, 5, 6)
    summary = summarise(run, EXIT_CODES)
    assert (summary.outcome, summary.reason) == ("aborted", "agents 1-6: landed by the operator")
    assert summary.cause == "order"
    assert summary.time_to_form_s is None
    assert summary.formation_error_m == pytest.approx(_error_m(28.0))
    assert [step.result for step in summary.steps] == [
        "done",
        "done",
        "aborted",
        "not reached",
        "not reached",
    ]
    assert summary.steps[3].exceptions == {}


def test_a_run_that_was_ended_before_take_off_is_aborted(tmp_path: Path) -> None:
    """Its folder has a manifest alone; killed processes make it no failure."""
    write_manifest(tmp_path, manifest())
    killed = dict.fromkeys(EXIT_CODES, -9)
    for at_once in (False, True):
        summary = summarise(tmp_path, killed, Ending("Ctrl-C", at_once))
        assert (summary.outcome, summary.reason) == ("aborted", "Ctrl-C before take-off")
    summary = summarise(tmp_path, killed, Ending("agent-1 did not start: no port", failed=True))
    assert summary.outcome == "failed"
    assert summary.reason == "did not start: agent-1 did not start: no port"


def _leave(run: Path, *agents: int, **changes: Any) -> None:
    """These agents were landed by an order to them alone."""
    broken = (*STEPS[:2], StepResult("form hexagon", StepOutcome.ABORTED, FORM, 28.0))
    told = {"outcome": Outcome.ABORTED, "reason": "landed by the operator", "steps": broken}
    for agent in agents:
        left = Departure(CommandKind.LAND, 28.0 + 0.1 * agent)
        write_status(run, account(agent, left=left, **(told | changes)))


def test_an_agent_that_left_by_order_leaves_the_verdict_to_the_others(run: Path) -> None:
    """Completed; the summary says which agent left, by which order and when. The formation is
    judged by the others, to the end."""
    whole = summarise(run, EXIT_CODES)
    _leave(run, 3)
    summary = summarise(run, EXIT_CODES)
    assert (summary.outcome, summary.reason) == ("completed", "")
    assert [left.model_dump() for left in summary.left] == [
        {"agent": 3, "order": "land", "time_s": 28.3}
    ]
    assert verdict_line(summary).plain.startswith("completed: without agent 3 (land at 28.3 s); ")
    assert summary.steps[2].result == "done"
    assert summary.steps[2].exceptions == {3: "aborted"}
    assert summary.steps[4].result == "done"
    assert summary.time_to_form_s == whole.time_to_form_s
    assert summary.min_true_distance_m == whole.min_true_distance_m


def test_what_the_others_did_decides(run: Path) -> None:
    """Aborted if they were landed as well, also where each left by an order of its own; an agent
    that left and then failed is a failure."""
    _leave(run, 3)
    _abort(run, 1, 2, 4, 5, 6)
    assert summarise(run, EXIT_CODES).outcome == "aborted"
    _leave(run, 1, 2, 3, 4, 5, 6)
    assert summarise(run, EXIT_CODES).outcome == "aborted"


def test_an_agent_that_left_and_failed_is_a_failure(run: Path) -> None:
    _leave(run, 3, outcome=Outcome.FAILED, reason="not down after 180 s of landing")
    summary = summarise(run, EXIT_CODES)
    assert summary.outcome == "failed"
    assert summary.reason.startswith("agent 3: not down after 180 s of landing")


def test_an_agent_that_fails_is_named_with_its_reason(run: Path) -> None:
    write_status(
        run, account(4, outcome=Outcome.FAILED, reason="no position from the vehicle for 3 s")
    )
    summary = summarise(run, EXIT_CODES | {"agent-4": 1})
    assert (summary.outcome, summary.reason) == (
        "failed",
        "agent 4: no position from the vehicle for 3 s, in step 4 (land)",
    )


def _failed(run: Path, cause: Cause, reason: str, **changes: Any) -> None:
    """All agents end in the form step, for this reason."""
    result = StepOutcome.TIMEOUT if cause is Cause.TIMEOUT else StepOutcome.ABORTED
    steps = (*STEPS[:2], StepResult("form hexagon", result, FORM, 33.0))
    for i in range(1, 7):
        made = account(i, outcome=Outcome.FAILED, reason=reason, cause=cause, steps=steps)
        write_status(run, replace(made, **changes))


TIMED_OUT = "step 2 (form hexagon) timed out after 120 s: this agent was not done"
SLOW = TickReport(count=890, overruns=1110)


def test_a_machine_that_did_not_keep_up_is_the_cause(run: Path) -> None:
    """Its figures, the speed that would do, and then the step; the run is at --speedup 5."""
    _failed(run, Cause.TIMEOUT, TIMED_OUT, tick=SLOW)
    summary = summarise(run, EXIT_CODES)
    assert (summary.outcome, summary.cause) == ("failed", "machine")
    assert summary.reason == (
        "this machine can't keep up with --speedup 5 (ticks 8.9 of 20 Hz); about 2 would do,"
        " or --lockstep. "
        f"agents 1-6: {TIMED_OUT}"
    )
    assert {agent.cause for agent in summary.agents} == {Cause.TIMEOUT}
    assert summary.warnings == ()


@pytest.mark.parametrize("cause", [Cause.BATTERY, Cause.WIND, Cause.PILOT, Cause.FENCE])
def test_a_slow_machine_is_not_the_cause_of_everything(run: Path, cause: Cause) -> None:
    """A battery is low on any machine; that this one was slow is a warning."""
    _failed(run, cause, "why", tick=SLOW)
    summary = summarise(run, EXIT_CODES)
    assert (summary.cause, summary.reason) == (cause, "agents 1-6: why, in step 2 (form hexagon)")
    assert summary.warnings == (
        (
            "this machine can't keep up with --speedup 5 (ticks 8.9 of 20 Hz); about 2 would do,"
            " or --lockstep"
        ),
    )


def test_one_agent_that_stood_still_is_no_slow_machine(run: Path) -> None:
    _failed(run, Cause.TIMEOUT, TIMED_OUT)
    write_status(run, replace(account(3), tick=SLOW))
    assert summarise(run, EXIT_CODES).cause is Cause.TIMEOUT


def test_a_machine_too_slow_for_real_time_needs_fewer_agents(run: Path) -> None:
    _failed(run, Cause.TIMEOUT, TIMED_OUT, tick=TickReport(count=100, overruns=900))
    assert "(ticks 2.0 of 20 Hz); fewer agents, or a longer tick_s. " in summarise(run).reason


def test_links_that_were_late_are_the_cause(run: Path) -> None:
    _failed(run, Cause.TIMEOUT, TIMED_OUT)
    steps = (*STEPS[:2], StepResult("form hexagon", StepOutcome.TIMEOUT, FORM, 33.0))
    late = {5: LinkReport(0.1, 0.8, 2.1, 300, 100), 4: LinkReport(0.1, 0.1, 0.2, 300, 1)}
    made = account(1, outcome=Outcome.FAILED, reason=TIMED_OUT, steps=steps)
    write_status(run, replace(made, cause=Cause.TIMEOUT, links=late))
    summary = summarise(run, EXIT_CODES)
    assert summary.cause == "link"
    assert summary.reason == (
        "1 of 27 mesh links were late: agent 5's states reached agent 1 0.8 s old (median), "
        f"25% lost. agents 1-6: {TIMED_OUT}"
    )


def test_agents_that_lived_on_unheard_are_a_mesh_that_fell_apart(run: Path) -> None:
    """Agents 1 to 3 and 4 to 6 no longer heard each other from 12 s before their ends on."""
    for i in range(1, 7):
        side = {1, 2, 3} if i < 4 else {4, 5, 6}
        links = {
            j: LinkReport(0.1 if j in side else 12.0, 0.1, 0.2, 300, 1)
            for j in range(1, 7)
            if j != i
        }
        reason = f"agent {4 if i < 4 else 1} has not been heard for 3 s"
        made = account(i, outcome=Outcome.FAILED, reason=reason, links=links)
        write_status(run, replace(made, cause=Cause.PEER))
    summary = summarise(run, EXIT_CODES)
    assert summary.cause is Cause.LINK
    assert summary.reason.startswith(
        "the mesh fell apart: agents 1-6 no longer heard each other. agents 1-3: agent 4 has"
    )


@pytest.mark.parametrize(
    ("age_s", "cause"),
    [(None, Cause.VEHICLE_LINK), (20.0, Cause.VEHICLE_LINK), (None, Cause.TIMEOUT)],
)
def test_an_agent_that_lost_its_vehicle_is_no_mesh_that_fell_apart(
    run: Path, age_s: float | None, cause: Cause
) -> None:
    """Its serial port was gone: it had no position, so no state to send."""
    why = "no heartbeat from the vehicle for 5 s"
    links = {4: LinkReport(12.0, 5.0, 9.0, 300, 1)}
    for i in (1, 2, 3, 5, 6):
        reason = "agent 4 has not been heard for 3 s"
        made = account(i, outcome=Outcome.FAILED, reason=reason, links=links)
        write_status(run, replace(made, cause=Cause.PEER))
    made = account(4, outcome=Outcome.FAILED, reason=why)
    write_status(run, replace(made, cause=cause, heartbeat_age_s=age_s))
    summary = summarise(run, EXIT_CODES)
    assert summary.cause is cause
    assert summary.reason.startswith(f"agent 4: {why}")


def test_a_killed_agents_last_words_stand_in(run: Path) -> None:
    """Agent 3 is killed at 30 s, long before the shape stands; its vehicle hovers on and no longer
    counts."""
    (run / "agents" / "3.json").unlink()
    broken = (*STEPS[:2], StepResult("form hexagon", StepOutcome.ABORTED, FORM, 33.1))
    for i in (1, 2, 4, 5, 6):
        reason = "agent 3 has not been heard for 3 s"
        write_status(run, account(i, outcome=Outcome.FAILED, reason=reason, steps=broken))
    write_lines(run / "statuses.jsonl", *(status_of(PLAN, 3, t) for t in (25.0, 29.6)))
    summary = summarise(
        run, EXIT_CODES | {"agent-3": -9} | {f"agent-{i}": 1 for i in (1, 2, 4, 5, 6)}
    )
    assert summary.outcome == "failed"
    assert summary.reason == (
        "agent-3 was ended by SIGKILL; "
        "agent 3 left no final status; last heard at 29.6 s in phase fly; "
        "agents 1-2, 4-6: agent 3 has not been heard for 3 s, in step 2 (form hexagon)"
    )
    third = summary.agents[2]
    assert (third.account, third.outcome, third.time_s) == ("last heard", "running", 29.6)
    assert summary.steps[2].result == "aborted"
    assert summary.steps[2].exceptions == {
        1: "aborted",
        2: "aborted",
        3: "running",
    } | dict.fromkeys((4, 5, 6), "aborted")
    assert summary.formation_error_m == pytest.approx(_error_m(33.1, (1, 2, 4, 5, 6)), abs=1e-6)
    assert any("3.json" in note for note in summary.notes)


def test_an_agent_lives_as_long_as_it_was_heard_and_the_plans_time_more(run: Path) -> None:
    (run / "agents" / "3.json").unlink()
    broken = (*STEPS[:2], StepResult("form hexagon", StepOutcome.ABORTED, FORM, 28.0))
    for i in (1, 2, 4, 5, 6):
        write_status(run, account(i, outcome=Outcome.FAILED, reason="x", steps=broken))
    write_lines(run / "statuses.jsonl", status_of(PLAN, 3, 26.0))
    assert summarise(run).formation_error_m == pytest.approx(_error_m(28.0))
    write_lines(run / "statuses.jsonl", status_of(PLAN, 3, 24.0))
    assert summarise(run).formation_error_m == pytest.approx(_error_m(28.0, (1, 2, 4, 5, 6)))


def test_unknown_exit_codes_are_null_and_no_reproach(run: Path) -> None:
    summary = summarise(run)
    assert (summary.outcome, summary.exit_codes) == ("completed", None)


# --- damage ---

FILES = ["run.json", "truth.jsonl", "statuses.jsonl", "events.jsonl", "agents/4.json"]


def _named(notes: tuple[str, ...], name: str) -> bool:
    return any(name in note for note in notes)


@pytest.mark.parametrize("name", FILES)
def test_a_missing_file_is_noted_and_the_run_is_not_completed(run: Path, name: str) -> None:
    (run / name).unlink()
    summary = summarise(run, EXIT_CODES)
    assert summary.outcome == "failed"
    assert summary.reason
    assert _named(summary.notes, name)
    write_summary(run, summary)
    assert read_summary(run) == summary


@pytest.mark.parametrize("name", FILES)
def test_a_file_torn_anywhere_is_noted_and_the_run_is_not_completed(run: Path, name: str) -> None:
    whole = (run / name).read_bytes()
    for share in (0.0, 0.1, 0.5, 0.9, 0.999):
        length = int(share * len(whole))
        while length and whole[length - 1 : length] == b"\n":
            length -= 1
        (run / name).write_bytes(whole[:length])
        summary = summarise(run, EXIT_CODES)
        if length or name not in (
            "statuses.jsonl",
            "events.jsonl",
        ):  # an empty one may just have had nothing to tell
            assert summary.outcome == "failed", share
            assert _named(summary.notes, name)


def test_a_truth_that_ends_in_flight_still_tells_what_it_saw(run: Path) -> None:
    text = "\n".join(truth_lines(until_s=35.0)) + '\n{"type":"state","t":35.1,"ned":[[1'
    (run / "truth.jsonl").write_text(text)
    summary = summarise(run, EXIT_CODES | {"sim": -9})
    assert summary.outcome == "failed"
    assert summary.time_to_form_s is None
    assert summary.formation_error_m == pytest.approx(0.0, abs=1e-6)
    assert summary.min_true_distance_m is not None
    assert summary.truth is not None
    assert not summary.truth.complete
    assert len([note for note in summary.notes if "truth.jsonl" in note]) == 2


def test_an_empty_folder_gives_a_summary(tmp_path: Path) -> None:
    summary = summarise(tmp_path, {"sim": -9})
    assert (summary.outcome, summary.mission, summary.steps) == ("failed", None, ())
    assert summary.reason.startswith("sim was ended by SIGKILL")
    assert len(summary.notes) == 4
    assert read_summary(write_summary(tmp_path, summary).parent) == summary


def test_without_a_manifest_the_agents_are_those_that_left_a_trace(run: Path) -> None:
    (run / "run.json").unlink()
    (run / "agents" / "3.json").unlink()
    summary = summarise(run, EXIT_CODES)
    assert [(agent.agent, agent.account) for agent in summary.agents][2] == (3, "last heard")
    assert len(summary.agents) == 6
    assert summary.min_true_distance_m is not None
    assert summary.min_true_pair is None


def test_nothing_at_all_known_of_an_agent(run: Path) -> None:
    (run / "agents" / "5.json").unlink()
    write_lines(run / "statuses.jsonl", *(account(i) for i in (1, 2, 3, 4, 6)))
    summary = summarise(run, EXIT_CODES | {"agent-5": 3})
    assert summary.reason.startswith("agent 5 left no status")
    assert summary.agents[4].outcome == "unknown"
    assert summary.steps[2].exceptions == {5: "not reached"}
    assert summary.steps[2].result == "not reached"


def test_vehicles_nobody_knows_are_noted(run: Path) -> None:
    lines = truth_lines()
    header = json.loads(lines[0])
    header["sysids"][0] = 99
    (run / "truth.jsonl").write_text("\n".join([json.dumps(header), *lines[1:]]) + "\n")
    summary = summarise(run, EXIT_CODES)
    assert summary.outcome == "failed"
    assert "sysid 11, 99" in summary.reason


def test_a_collision_is_told(run: Path) -> None:
    with (run / "truth.jsonl").open("a") as file:
        file.write('{"type":"event","t":61.0,"sysid":12,"event":"collision"}\n')
    summary = summarise(run, EXIT_CODES)
    assert summary.truth is not None
    assert summary.truth.collisions == (12,)


def test_a_skipped_step_is_told_as_such(run: Path) -> None:
    steps = (*STEPS[:3], replace(STEPS[3], result=StepOutcome.SKIPPED), STEPS[4])
    write_status(run, account(2, steps=steps))
    step = summarise(run, EXIT_CODES).steps[3]
    assert (step.result, step.exceptions) == ("skipped", {2: "skipped"})


# --- the schema ---


def test_a_summary_comes_back_as_it_was(run: Path) -> None:
    summary = summarise(run, EXIT_CODES)
    path = write_summary(run, summary)
    data: dict[str, Any] = json.loads(path.read_text())
    assert data["outcome"] == "completed"
    assert data["min_true_pair"] == list(true_minimum()[1])
    assert read_summary(run) == summary
    path.write_text(json.dumps(data | {"surplus": 1}))
    with pytest.raises(InputError, match="surplus"):
        read_summary(run)


def test_writing_twice_leaves_one_whole_file(run: Path) -> None:
    before = {path.name for path in run.iterdir()}
    write_summary(run, summarise(run))
    write_summary(run, summarise(run, EXIT_CODES))
    assert {path.name for path in run.iterdir()} - before == {"summary.json"}
    assert read_summary(run).exit_codes == EXIT_CODES


def test_no_summary_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"summary\.json"):
        read_summary(tmp_path)


def test_summarise_only_reads(run: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    copy = tmp_path_factory.mktemp("copy") / "run"
    shutil.copytree(run, copy)
    summarise(copy, EXIT_CODES)
    assert {p.relative_to(copy): p.read_bytes() for p in copy.rglob("*") if p.is_file()} == {
        p.relative_to(run): p.read_bytes() for p in run.rglob("*") if p.is_file()
    }


def test_events_and_phases_do_not_decide(run: Path) -> None:
    """An error event alone is no failure: the agents' own words are."""
    write_lines(run / "events.jsonl", Event(1, 30.0, Severity.ERROR, "something loud"))
    write_status(run, account(1, phase=Phase.LAND))
    summary = summarise(run, EXIT_CODES)
    assert (summary.outcome, summary.events) == ("completed", {"error": 1})
    assert isinstance(summary, Summary)


def test_a_formation_is_judged_by_who_has_which_slot(run: Path) -> None:
    """Agents 2 and 3 say that they exchanged slots, and fly to their first ones all the same: no
    formation since."""
    for agent, role in ((2, 2), (3, 1)):
        write_status(run, account(agent, roles=((HOLD, role),)))
    summary = summarise(run, EXIT_CODES)
    gap_m = 5 * math.dist(HEXAGON[1], HEXAGON[2])
    assert summary.formation_error_m == pytest.approx(gap_m)
    assert summary.time_to_form_s is not None  # before the exchange
    assert summary.safety is not None
    assert summary.safety.exchanges == 1
    write_manifest(run, manifest(replace(PLAN, safety=replace(PLAN.safety, filter=False))))
    assert summarise(run, EXIT_CODES).safety is None
    errors = read_history(run).errors()
    assert math.dist(
        errors[int(FORMED * 10) + 1, 1], errors[int(FORMED * 10) + 1, 0]
    ) == pytest.approx(0.0, abs=1e-6)
    assert math.dist(errors[int(HOLD * 10) + 2, 1], errors[int(HOLD * 10) + 2, 0]) == pytest.approx(
        gap_m
    )


def test_a_role_that_no_plan_has_is_left_out(run: Path) -> None:
    """An account may be anything; its agent keeps its own slot then."""
    write_status(run, account(2, roles=((HOLD, 99), (HOLD, -4))))
    assert summarise(run, EXIT_CODES).formation_error_m == pytest.approx(0.0, abs=1e-6)


def test_a_run_that_cannot_be_judged_has_failed_with_a_reason(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An error in the judge itself is no traceback: there is a summary, which can be read again."""

    def fail(*_: object) -> None:
        raise IndexError("tuple index out of range")

    monkeypatch.setattr("swarm_ctl.report.judge.summarise.pair_distances", fail)
    summary = summarise(run, EXIT_CODES)
    assert summary.outcome == "failed"
    assert summary.reason.startswith("the run can't be judged: IndexError: tuple index out of")
    assert summary.exit_codes == EXIT_CODES
    write_summary(run, summary)
    assert read_summary(run) == summary


@pytest.mark.parametrize(
    "time_s", ["1" + "0" * 400, "NaN", "[" * 60_000], ids=["huge", "no number", "nested"]
)
def test_a_refused_order_that_can_not_be_read_is_noted(run: Path, time_s: str) -> None:
    """The run is not completed, and all else is judged; what can be read is told."""
    line = '{"time_s": %s, "order": "next", "why": "w"}\n'
    (run / "refused.jsonl").write_text(line % time_s)
    summary = summarise(run, EXIT_CODES)
    assert (summary.outcome, summary.mission) == ("failed", PLAN.name)
    assert _named(summary.notes, "refused.jsonl: 1 line")
    (run / "refused.jsonl").write_text(line % time_s + line % 5)
    assert summarise(run, EXIT_CODES).reason == "the scenario's order `next` at 5 s: w"


def test_what_failed_at_the_station_is_a_warning_and_changes_no_verdict(run: Path) -> None:
    line = '{"time_s": 12.34, "part": "recording.mcap", "why": "No space left", "off": true}\n'
    before = summarise(run, EXIT_CODES)
    odd = ("[" * 60_000, '{"time_s": 1%s, "part": "", "why": "", "off": true}' % ("0" * 400))
    (run / "troubles.jsonl").write_text("\n".join((*odd, line)))
    summary = summarise(run, EXIT_CODES)
    assert summary.outcome == before.outcome == "completed"
    assert summary.warnings == (*before.warnings, "recording.mcap stopped at 12.3 s: No space left")
