"""What makes a run failed whatever its agents say, and how it is put; by the truth and by the
vehicles' own estimates."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pytest

from swarm_ctl.core.model.messages import AgentState, Outcome, Phase
from swarm_ctl.core.model.steps.return_ import ReturnStep
from swarm_ctl.core.model.vehicle import OVER_M
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.recording.mcap_recorder import McapRecorder
from swarm_ctl.recording.run_recorder import RunRecorder
from swarm_ctl.report.judge.summarise import summarise
from swarm_ctl.report.judge.summary import Summary
from swarm_ctl.runfolder.flight import TrackSource
from swarm_ctl.runfolder.manifest import write_manifest
from swarm_sim.world import world
from tests.unit.plans import steps_of, with_group
from tests.unit.report.run_folders import (
    END,
    EXIT_CODES,
    FORMED,
    LAND,
    LIFTOFF,
    PLAN,
    SYSIDS,
    TOUCHDOWN,
    account,
    manifest,
    position,
    truth_lines,
    write_lines,
    write_run,
    write_status,
)
from tests.unit.station.swarm import state_of, status_of

Line = dict[str, Any]


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return write_run(tmp_path)


def _changed(run: Path, change: Callable[[Line], Line], *more: Line) -> Summary:
    """The summary of the run with another truth; `more` lines come before the last."""
    lines = [change(json.loads(line)) for line in truth_lines()]
    text = "".join(json.dumps(line) + "\n" for line in [*lines[:-1], *more, lines[-1]])
    (run / "truth.jsonl").write_text(text)
    return summarise(run, EXIT_CODES)


def _states(change: Callable[[Line, float], None]) -> Callable[[Line], Line]:
    def changed(line: Line) -> Line:
        if line["type"] == "state":
            change(line, line["t"])
        return line

    return changed


def _event(time_s: float, sysid: int, event: str, **more: float) -> Line:
    return {"type": "event", "t": time_s, "sysid": sysid, "event": event} | more


def _same(line: Line) -> Line:
    return line


def _zoned(run: Path, *zones: Zone, told: tuple[float, tuple[Zone, ...]] | None = None) -> Summary:
    """The summary of the run, its mission with these zones; from when on its agents told others."""
    plan = replace(PLAN, zones=zones)
    write_manifest(run, manifest(plan))
    since_s, others = told or (math.inf, None)
    heard = []
    for agent in range(1, 7):
        end = replace(account(agent), zones=others)
        write_status(run, end)
        times = (20.0, *((since_s,) if told else ()), 45.0)
        heard += [status_of(plan, agent, t, zones=others if t >= since_s else None) for t in times]
        heard.append(end)
    write_lines(run / "statuses.jsonl", *heard)
    return summarise(run, EXIT_CODES)


# --- by the truth ---


SLOT_3_M = position(3, FORMED)[:2]
NEAR_3 = Zone("oak", (SLOT_3_M,), 2.0, 1.0)
"""Agent 3 flies into it, and stands there."""
BESIDE_3 = Zone("elm", ((SLOT_3_M[0] + 5.0, SLOT_3_M[1]),), 2.0, 1.0)


def test_a_vehicle_in_a_zone_is_a_failure(run: Path) -> None:
    """With the moment and the place at which it went in; beside it is none, and is told."""
    found = _zoned(run, BESIDE_3, NEAR_3)
    assert (found.outcome, found.cause) == ("failed", "finding")
    told = re.fullmatch(
        r"the vehicle of agent 3 was in zone oak at (\d+\.\d) s, at \((.*), (.*)\), 10.0 m high,"
        r" in step 2 \(form hexagon\)",
        found.reason,
    )
    assert told is not None, found.reason
    time_s, north, east = map(float, told.groups())
    assert (north, east) == pytest.approx(position(3, time_s)[:2], abs=0.06)
    assert math.dist((north, east), SLOT_3_M) < 2.1
    assert math.dist(position(3, time_s - 0.1)[:2], SLOT_3_M) >= 2.0
    well = _zoned(run, BESIDE_3)
    assert well.outcome == "completed"
    assert well.nearest_zone is not None
    assert (well.nearest_zone.agent, well.nearest_zone.zone) == (3, "elm")
    flown = [position(3, k / 10)[:2] for k in range(int(10 * LIFTOFF), int(10 * TOUCHDOWN))]
    nearest_m = min(math.dist(at, BESIDE_3.corners_m[0]) for at in flown) - 2.0
    assert well.nearest_zone.distance_m == pytest.approx(nearest_m)


@pytest.mark.parametrize("heights", [{"floor_m": 12.0}, {"ceiling_m": 8.0}], ids=["below", "above"])
def test_a_vehicle_below_or_above_a_zone_is_in_none(run: Path, heights: dict[str, float]) -> None:
    found = _zoned(run, replace(NEAR_3, **heights))
    assert (found.outcome, found.nearest_zone) == ("completed", None)


def test_a_zone_counts_while_it_is_in_force(run: Path) -> None:
    """Agent 3 is in it from 31 s on. Added before that, it counts; lifted before that, it does
    not; added over the vehicle, it counts when that comes back, which it does not."""
    assert _zoned(run, told=(25.0, (NEAR_3,))).outcome == "failed"
    assert _zoned(run, NEAR_3, told=(25.0, ())).outcome == "completed"
    over = _zoned(run, told=(40.0, (NEAR_3,)))
    assert over.outcome == "completed"
    assert over.nearest_zone is not None
    assert over.nearest_zone.agent != 3


def test_a_collision_comes_first_with_pair_time_distance_and_step(run: Path) -> None:
    """The agents say that they completed; one process says otherwise, and comes after."""
    lines = [_event(30.0, 12, "collision", other=15), _event(30.0, 15, "collision", other=12)]
    lines += [{"type": "min", "t": 30.0, "pairs": [[12, 15, 0.31]]}]
    summary = _changed(run, _same, *lines)
    told = "the vehicles of agents 2, 5 collided at 30.0 s: 0.31 m apart, in step 2 (form hexagon)"
    assert (summary.outcome, summary.reason) == ("failed", told)
    assert [(each.kind, each.agents) for each in summary.findings] == [("collision", (2, 5))]
    assert summary.min_distance_pair == (2, 5)
    later = summarise(run, EXIT_CODES | {"agent-4": -9})
    assert later.reason == f"{told}; agent-4 was ended by SIGKILL"


def test_a_collision_of_an_earlier_truth_finds_its_pair(run: Path) -> None:
    pairs = ((25.0, 11), (25.0, 16), (30.0, 12), (30.0, 15))
    lines = [_event(time_s, sysid, "collision") for time_s, sysid in pairs]
    assert [each.agents for each in _changed(run, _same, *lines).findings] == [(1, 6), (2, 5)]


def test_a_pair_under_r_in_is_a_failure(run: Path) -> None:
    summary = _changed(run, _same, {"type": "min", "t": 25.5, "pairs": [[11, 13, 2.49]]})
    assert summary.outcome == "failed"
    assert summary.reason == (
        "agents 1, 3 were 2.49 m apart at 25.5 s, under r_in 2.50 m, in step 2 (form hexagon)"
    )


def test_two_that_pass_each_other_between_two_samples(run: Path) -> None:
    """5 m apart in each sample, and no line of minima: they crossed at 0 m."""

    def cross(line: Line, t: float) -> None:
        if t > 39.95:
            line["ned"][0][:2] = [0.0, 300.0 if t < 40.05 else 305.0]
            line["ned"][1][:2] = [0.0, 305.0 if t < 40.05 else 300.0]

    summary = _changed(run, _states(cross))
    assert summary.outcome == "failed"
    first = next(each for each in summary.findings if each.kind == "too close")
    assert first.agents == (1, 2)
    assert first.time_s == pytest.approx(40.05)
    assert summary.min_true_distance_m == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("told", [True, False])
def test_motors_off_in_the_air(run: Path, told: bool) -> None:
    """By the event, or by the states alone."""

    def off(line: Line, t: float) -> None:
        if t >= 30.0:
            line["armed"][2] = 0

    events = [_event(29.98, 13, "disarm", height_m=9.98)] if told else []
    summary = _changed(run, _states(off), *events)
    assert summary.outcome == "failed"
    high = "was disarmed in the air at 30.0 s, 10.0 m high"
    assert summary.reason == f"the vehicle of agent 3 {high}, in step 2 (form hexagon)"


@pytest.mark.parametrize("event", ["crash", "touchdown"])
def test_a_fall_is_a_failure_with_its_speed(run: Path, event: str) -> None:
    summary = _changed(run, _same, _event(31.0, 13, event, impact_mps=12.7))
    assert summary.outcome == "failed"
    assert summary.reason.startswith(
        "the vehicle of agent 3 fell: it hit the ground at 31.0 s with 12.7 m/s"
    )


def test_a_fall_shows_in_the_velocities(run: Path) -> None:
    def fall(line: Line, t: float) -> None:
        if 29.95 < t < 30.25:
            line["vel"][2] = [0.0, 0.0, 6.0]

    summary = _changed(run, _states(fall))
    assert summary.reason.startswith("the vehicle of agent 3 fell with 6.0 m/s at 30.1 s")


def test_coming_down_before_the_landing(run: Path) -> None:
    summary = _changed(run, _same, _event(30.0, 13, "touchdown", impact_mps=0.5))
    assert summary.reason.startswith(
        "the vehicle of agent 3 came down at 30.0 s, before its landing"
    )


@pytest.mark.parametrize(
    ("away_m", "from_s", "outcome"),
    [(2.9, TOUCHDOWN, "completed"), (3.1, TOUCHDOWN, "failed"), (3.1, LAND + 5.0, "completed")],
)
def test_a_landing_elsewhere(run: Path, away_m: float, from_s: float, outcome: str) -> None:
    """It drifts away while it comes down; before it sinks it may."""

    def drift(line: Line, t: float) -> None:
        if t > from_s - 0.05:
            line["ned"][2][0] += away_m

    summary = _changed(run, _states(drift))
    assert summary.outcome == outcome
    if outcome == "failed":
        assert "agent 3 landed 3.1 m from where its landing began" in summary.reason


def test_a_return_ends_at_the_start(run: Path) -> None:
    """The six land in their shape, where a `return` should have brought them to their starts."""
    plan = with_group(PLAN, steps=(*steps_of(PLAN)[:-1], ReturnStep(60.0)))
    write_manifest(run, manifest(plan, plan_hash=plan.fingerprint()))
    summary = summarise(run, EXIT_CODES)
    assert {each.kind for each in summary.findings} == {"landed elsewhere"}
    assert "m from its start" in summary.reason
    assert "(and 5 more: agents 2-6)" in summary.reason


def test_a_vehicle_that_is_still_up_is_no_orderly_end(run: Path) -> None:
    """Also where the operator has landed the swarm."""

    def stay(line: Line, _: float) -> None:
        line["airborne"][2] = line["armed"][2] = int(line["t"] >= LIFTOFF)

    for i in range(1, 7):
        write_status(run, account(i, outcome=Outcome.ABORTED, reason="landed by the operator"))
    summary = _changed(run, _states(stay))
    assert summary.outcome == "failed"
    assert summary.reason.startswith("the vehicle of agent 3 was still in the air at the end")


# --- by the vehicles' own estimates ---


def _estimated(
    run: Path,
    agents: tuple[int, ...] = (1, 2, 3, 4, 5, 6),
    *,
    accuracy_m: float | None = 0.1,
    disarmed_s: Mapping[int, float] = MappingProxyType({}),
    change: Callable[[AgentState], AgentState | None] = lambda state: state,
    silent_s: Mapping[int, float] = MappingProxyType({}),
) -> Summary:
    """The summary of the same flight in which `agents` have real vehicles."""
    simulated = tuple(i for i in range(1, 7) if i not in agents)
    write_manifest(run, manifest(simulated=simulated))
    if not simulated:
        (run / "truth.jsonl").unlink()
    else:
        keep = [SYSIDS[i - 1] for i in simulated]
        (run / "truth.jsonl").write_text("".join(_only(keep)))
    recorder = RunRecorder(run, McapRecorder(run, 0, {}))
    for k in range(int(END * 10) + 1):
        t = k / 10
        up = LIFTOFF <= t < TOUCHDOWN
        for i in (i for i in agents if t < silent_s.get(i, math.inf)):
            where = position(i, t)
            state = change(state_of(PLAN, i, t, seq=k + 1, position_ned_m=where))
            if state is not None:
                recorder.take(state, t)
            if k % 5 == 0:
                armed = LIFTOFF <= t < min(TOUCHDOWN + 0.5, disarmed_s.get(i, END))
                status = status_of(PLAN, i, t, armed=armed, airborne=up, height_m=10.0 * up)
                told_s = t if state is None else state.time_s
                status = replace(status, time_s=told_s, position_accuracy_m=accuracy_m)
                recorder.take(status, t)
    recorder.close()
    statuses = [status_of(PLAN, i, 30.0) for i in range(1, 7)]
    write_lines(run / "statuses.jsonl", *statuses, *(account(i) for i in range(1, 7)))
    return summarise(run, EXIT_CODES)


def _only(sysids: list[int]) -> list[str]:
    """The truth of these vehicles alone."""
    places, lines = [SYSIDS.index(sysid) for sysid in sysids], []
    for line in map(json.loads, truth_lines()):
        for name in {"ned", "vel", "armed", "airborne"} & line.keys():
            line[name] = [line[name][k] for k in places]
        if line["type"] == "header":
            line["sysids"] = sysids
        if line["type"] == "min":
            line["pairs"] = [pair for pair in line["pairs"] if set(pair[:2]) <= set(sysids)]
        if line.get("sysid", sysids[0]) in sysids:
            lines.append(json.dumps(line) + "\n")
    return lines


def test_an_old_word_of_an_agent_says_nothing_of_the_end(run: Path) -> None:
    """Agent 3 was last heard in the air at 15 s: that is what the verdict says, and how long before
    the end."""
    summary = _estimated(run, silent_s={3: 15.0})
    assert summary.outcome == "failed"
    assert summary.reason.startswith(
        "the vehicle of agent 3 was in the air when it was last heard of, at 14.5 s,"
        f" {END - 14.5:.0f} s before the end: whether it came down is not known"
    )


def test_real_vehicles_complete_by_their_own_estimates(run: Path) -> None:
    """The same figures as by the truth, and their doubt: twice 0.1 m of each, and what 1 m/s flies
    in half of 0.1 s."""
    true = summarise(run, EXIT_CODES)
    summary = _estimated(run)
    assert (summary.outcome, summary.reason, summary.notes, summary.warnings) == (
        "completed",
        "",
        (),
        (),
    )
    assert set(summary.judged_by.values()) == {TrackSource.ESTIMATES}
    assert summary.truth is None
    assert summary.min_true_distance_m is None
    assert summary.min_distance_m == pytest.approx(true.min_distance_m, abs=0.02)
    assert summary.min_distance_pair == true.min_distance_pair
    assert summary.min_distance_doubt_m == pytest.approx(0.5, abs=0.01)
    assert summary.time_to_form_s == pytest.approx(true.time_to_form_s, abs=0.1)
    assert summary.longest_link_m == pytest.approx(true.longest_link_m, abs=0.1)
    assert summary.formation_error_m == pytest.approx(0.0, abs=1e-6)


def test_a_mixed_fleet_has_both(run: Path) -> None:
    summary = _estimated(run, (2, 5))
    assert (summary.outcome, summary.reason) == ("completed", "")
    assert summary.judged_by == {
        i: TrackSource.ESTIMATES if i in (2, 5) else TrackSource.TRUTH for i in range(1, 7)
    }
    assert summary.time_to_form_s is not None
    assert summary.min_true_pair is not None
    assert not set(summary.min_true_pair) & {2, 5}


def test_estimates_under_r_in_fail_and_doubt_warns(run: Path) -> None:
    def near(distance_m: float) -> Callable[[AgentState], AgentState]:
        def moved(state: AgentState) -> AgentState:
            north, east, down = position(1, state.time_s)
            if state.agent == 2 and 38.0 < state.time_s < 42.0:
                return replace(state, position_ned_m=(north, east + distance_m, down))
            return state

        return moved

    summary = _estimated(run, change=near(2.4))
    assert summary.outcome == "failed"
    assert "2.40 m apart" in summary.reason
    assert "by their own estimates, under r_in 2.50 m" in summary.reason


def test_a_distance_that_may_be_too_small_is_a_warning(run: Path) -> None:
    summary = _estimated(run, accuracy_m=3.0)
    assert summary.outcome == "completed"
    assert any("give or take 12." in text for text in summary.warnings)


def test_what_is_not_known_is_said(run: Path) -> None:
    def silent(state: AgentState) -> AgentState | None:
        return None if state.agent == 3 and 30.0 < state.time_s < 35.0 else state

    summary = _estimated(run, accuracy_m=None, change=silent)
    assert summary.outcome == "completed"
    assert "agent 3: where its vehicle was in the air is not known for 5.0 s from 30.0 s on" in (
        summary.warnings
    )
    assert any("says no accuracy" in text for text in summary.warnings)


def test_a_clock_of_its_own_does_not_move_a_vehicle(run: Path) -> None:
    """Agent 3 was started by hand: its clock is 500 s behind."""

    def late(state: AgentState) -> AgentState:
        return replace(state, time_s=state.time_s - 500.0) if state.agent == 3 else state

    summary = _estimated(run, change=late)
    assert summary.time_to_form_s is not None
    assert summary.formation_error_m == pytest.approx(0.0, abs=1e-6)


def test_real_vehicles_without_a_recording_are_not_judged_well(run: Path) -> None:
    write_manifest(run, manifest(simulated=()))
    (run / "truth.jsonl").unlink()
    summary = summarise(run, EXIT_CODES)
    assert summary.outcome == "failed"
    assert "recording.mcap: No such file" in summary.reason


def test_motors_off_in_the_air_show_in_the_estimates(run: Path) -> None:
    """Agent 3's vehicle says disarmed at 30 s and sinks only then."""
    summary = _estimated(run, disarmed_s={3: 30.0})
    assert summary.outcome == "failed"
    assert "agent 3 was disarmed in the air at 30.0 s" in summary.reason


def test_a_fall_shows_in_the_estimates(run: Path) -> None:
    """Its agent may not have seen it: the status that says disarmed comes too late."""

    def fall(state: AgentState) -> AgentState:
        if state.agent == 3 and 29.95 < state.time_s < 31.0:
            return replace(state, velocity_ned_mps=(0.0, 0.0, 7.0))
        return state

    summary = _estimated(run, change=fall)
    assert summary.outcome == "failed"
    assert summary.reason.startswith("the vehicle of agent 3 fell with 7.0 m/s")


# --- a process that took a vehicle over ---


def test_a_takeover_that_completes_is_completed(run: Path) -> None:
    """Agent 3 is killed; another process takes its vehicle over and says its end to the station."""
    (run / "agents" / "3.json").unlink()
    began = account(3).steps
    again = tuple(replace(each, start_s=31.0) for each in began)
    heard = [status_of(PLAN, 3, 30.0), account(3, steps=again)]
    write_lines(run / "statuses.jsonl", *heard)
    summary = summarise(run, EXIT_CODES | {"agent-3": -9})
    assert (summary.outcome, summary.reason, summary.notes) == ("completed", "", ())
    assert summary.warnings == ("agent 3: its process was killed; another took its vehicle over",)
    assert summary.steps[1].start_s == LIFTOFF
    write_lines(run / "statuses.jsonl", replace(heard[0], airborne=False), heard[1])
    ground = "agent 3: its process was killed; another flew its vehicle from the ground"
    assert summarise(run, EXIT_CODES | {"agent-3": -9}).warnings == (ground,)
    write_lines(run / "statuses.jsonl", *heard[:1], replace(heard[1], outcome=Outcome.FAILED))
    failed = summarise(run, EXIT_CODES | {"agent-3": -9})
    assert failed.reason.startswith("agent-3 was ended by SIGKILL")
    write_lines(run / "statuses.jsonl", heard[0], status_of(PLAN, 3, LAND, phase=Phase.LAND))
    assert summarise(run, EXIT_CODES | {"agent-3": -9}).outcome == "failed"


def test_the_simulator_counts_the_same_approaches() -> None:
    """It knows nothing of the controller, so it has the constant once more."""
    assert world._OVER_M == OVER_M
