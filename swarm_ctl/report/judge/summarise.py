"""From a run folder to its summary. Reads files and nothing else, so whoever outlived the run can
do it."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from swarm_ctl.core.agent.progress import step_name
from swarm_ctl.core.law.graph import edges
from swarm_ctl.core.law.planned_formation import planned_formations
from swarm_ctl.core.model.messages import AgentStatus, StepResult, TickReport
from swarm_ctl.core.model.plan import FormStep, Plan
from swarm_ctl.report.folder import metrics
from swarm_ctl.report.folder.accounts import read_events
from swarm_ctl.report.folder.run_folder import Run, read_run
from swarm_ctl.report.folder.truth import Floats, Truth
from swarm_ctl.report.judge.summary import (
    AgentPair,
    AgentSummary,
    LinkSummary,
    Result,
    SafetySummary,
    StepSummary,
    Summary,
    TruthSummary,
)
from swarm_ctl.report.judge.verdict import judge

_WORSE: Final[tuple[Result, ...]] = ("done", "not reached", "running", "aborted", "timeout")
"""Step results from good to bad."""


def summarise(folder: Path, exit_codes: Mapping[str, int] | None = None) -> Summary:
    """The summary of the run in `folder`. `exit_codes` by process name, None where they are not
    known.

    Every file may be missing or torn: what that leaves open is null, `notes` says why, and the run
    is not completed.
    """
    run = read_run(folder)
    manifest, truth, notes = run.manifest, run.truth, run.notes
    levels = Counter[str]()
    last_s = [s.time_s for s in run.statuses] + (
        [truth.last_s] if truth and truth.last_s is not None else []
    )
    for event in read_events(folder, notes):
        levels[event.level] += 1
        last_s.append(event.time_s)
    outcome, reason = judge(run.agents, run.accounts, exit_codes, notes)
    steps, flown = _steps(run), _flown(run)
    closest, closest_pair = _closest(run)
    tally = Counter[str]()
    for status in run.statuses:
        tally.update(status.sigma_tally)
    rates = [s.setpoint_rate_hz for s in run.statuses]
    speedup = manifest.speedup if manifest else None
    law, unit_m = (manifest.plan.law, manifest.plan.unit_m) if manifest else (None, 1.0)
    return Summary(
        mission=manifest.plan.name if manifest else None,
        mission_file=manifest.mission if manifest else None,
        plan_hash=manifest.plan_hash if manifest else None,
        swarm=manifest.swarm if manifest else None,
        started_at=manifest.started_at.isoformat() if manifest else None,
        outcome=outcome,
        reason=reason,
        steps=steps,
        time_to_form_s=next(
            (step.time_to_form_s for step in steps if step.name.startswith("form")), None
        ),
        formation_error_m=flown.formation_error_m,
        min_true_distance_m=closest,
        min_true_pair=closest_pair,
        r_in_m=law.r_in * unit_m if law else None,
        longest_link_m=flown.longest_link_m,
        longest_link_pair=flown.longest_link_pair,
        r_m=law.r * unit_m if law else None,
        sigma_status=dict(tally),
        overspeed=sum(s.overspeed_ticks for s in run.statuses),
        safety=_safety(run),
        setpoint_rate_hz=min(rates, default=None),
        tick=_worst_tick([s.tick for s in run.statuses]),
        links=tuple(link for s in run.statuses for link in _links(s)),
        agents=tuple(_agent(run, agent) for agent in run.agents),
        truth=_truth_summary(truth) if truth else None,
        events=dict(levels),
        exit_codes=dict(exit_codes) if exit_codes is not None else None,
        speedup=speedup,
        mission_time_s=max(last_s, default=None),
        wall_time_s=max(last_s) / speedup if last_s and speedup else None,
        versions=manifest.versions if manifest else {},
        notes=tuple(notes),
    )


# --- steps ---


def _steps(run: Run) -> tuple[StepSummary, ...]:
    if run.plan is None:
        return ()
    return tuple(_step(run, run.plan, k) for k in range(len(run.plan.steps) + 1))


def _step(run: Run, plan: Plan, k: int) -> StepSummary:
    results = {i: run.accounts[i].step(k) if i in run.accounts else None for i in run.agents}
    words = {i: _word(found) for i, found in results.items()}
    reached = [found for found in results.values() if found]
    start_s = min((found.start_s for found in reached), default=None)
    return StepSummary(
        step=k,
        name=step_name(plan, k),
        result=max(words.values(), key=_WORSE.index, default="not reached"),
        start_s=start_s,
        end_s=max((found.end_s for found in reached if found.end_s is not None), default=None),
        exceptions={i: word for i, word in words.items() if word != "done"} if reached else {},
        time_to_form_s=_time_to_form(run, plan, k, start_s),
    )


def _word(found: StepResult | None) -> Result:
    """A result of the schema; a word that it does not know is no success."""
    if found is None:
        return "not reached"
    return next((word for word in _WORSE if word == found.result), "running")


def _time_to_form(run: Run, plan: Plan, k: int, start_s: float | None) -> float | None:
    step = plan.steps[k - 1] if k else None
    flight = run.flight
    if not isinstance(step, FormStep) or start_s is None or flight is None:
        return None
    next_form = next(
        (j for j in range(k + 1, len(plan.steps) + 1) if isinstance(plan.steps[j - 1], FormStep)),
        None,
    )
    end_s = min(run.landing_s(), run.start_s(next_form) if next_form else math.inf)
    error_m = metrics.formation_error(
        flight, _in_metres(plan, step.slots)[run.roles(flight.time_s)]
    )
    return metrics.time_to_settle(
        flight.time_s, error_m, start_s, end_s, step.tolerance_m, step.settle_s
    )


# --- flight ---


@dataclass(frozen=True, slots=True)
class _Flown:
    formation_error_m: float | None = None
    longest_link_m: float | None = None
    longest_link_pair: AgentPair | None = None


def _flown(run: Run) -> _Flown:
    """What happened from the first form step to the landing."""
    flight, plan = run.flight, run.plan
    if flight is None or plan is None:
        return _Flown()
    formed = [
        (run.start_s(k), step) for k, step in enumerate(plan.steps, 1) if isinstance(step, FormStep)
    ]
    begun = [(start_s, step) for start_s, step in formed if start_s < math.inf]
    if not begun:
        return _Flown()
    flight = flight.during(begun[0][0], run.landing_s())
    last = max(k for k in range(1, len(plan.steps) + 1) if run.start_s(k) < math.inf)
    standing = planned_formations(plan)[last].offsets
    error_m = metrics.last_number(
        metrics.formation_error(flight, _in_metres(plan, standing)[run.roles(flight.time_s)])
    )
    column = {agent.id: k for k, agent in enumerate(plan.agents)}
    links = edges({agent.id: agent.neighbours for agent in plan.agents})
    longest = metrics.longest_link(flight, [(column[a], column[b]) for a, b in links])
    if longest is None:
        return _Flown(error_m)
    i, j = longest[1]
    return _Flown(error_m, longest[0], (plan.agents[i].id, plan.agents[j].id))


def _in_metres(plan: Plan, slots: tuple[tuple[float, float], ...]) -> Floats:
    return np.array(slots) * plan.unit_m


def _closest(run: Run) -> tuple[float | None, AgentPair | None]:
    found = metrics.closest_approach(run.truth) if run.truth else None
    if found is None:
        return None, None
    agent_of = run.manifest.agent_of_sysid if run.manifest else {}
    if not all(sysid in agent_of for sysid in found[1]):
        return found[0], None
    a, b = sorted(agent_of[sysid] for sysid in found[1])
    return found[0], (a, b)


# --- agents, links, truth ---


def _agent(run: Run, agent: int) -> AgentSummary:
    account = run.accounts.get(agent)
    fleet = run.manifest.fleet if run.manifest else ()
    s = account.status if account else None
    return AgentSummary(
        agent=agent,
        sysid=next((entry.sysid for entry in fleet if entry.id == agent), None),
        account="none" if account is None else "final" if account.final else "last heard",
        time_s=s.time_s if s else None,
        outcome=s.outcome if s else "unknown",
        reason=s.reason if s else "",
        phase=s.phase.name.lower() if s else "unknown",
        armed=s.armed if s else None,
        airborne=s.airborne if s else None,
        setpoints=s.setpoints if s else 0,
        setpoint_rate_hz=s.setpoint_rate_hz if s else None,
        sigma_status=s.sigma_tally if s else {},
        overspeed=s.overspeed_ticks if s else 0,
        tick=s.tick if s else TickReport(),
        bad_payloads=s.bad_payloads if s else 0,
    )


def _safety(run: Run) -> SafetySummary | None:
    told = [s.safety for s in run.statuses]
    if not told or (run.plan is not None and not run.plan.safety.filter):
        return None
    return SafetySummary(
        ticks=sum(s.ticks for s in told),
        touched=sum(s.touched for s in told),
        yielded=sum(s.yielded for s in told),
        releases=sum(s.releases for s in told),
        exchanges=sum(len(s.roles) for s in run.statuses) // 2,
    )


def _links(s: AgentStatus) -> list[LinkSummary]:
    return [
        LinkSummary(
            receiver=s.agent,
            sender=sender,
            age_p50_s=link.age_p50_s,
            age_p99_s=link.age_p99_s,
            received=link.received,
            lost=link.lost,
            loss=link.lost / (link.received + link.lost) if link.received else None,
        )
        for sender, link in sorted(s.links.items())
    ]


def _worst_tick(ticks: list[TickReport]) -> TickReport:
    return TickReport(
        count=sum(tick.count for tick in ticks),
        overruns=sum(tick.overruns for tick in ticks),
        late_p50_ms=max((tick.late_p50_ms for tick in ticks), default=0.0),
        late_p99_ms=max((tick.late_p99_ms for tick in ticks), default=0.0),
        late_max_ms=max((tick.late_max_ms for tick in ticks), default=0.0),
        work_p50_ms=max((tick.work_p50_ms for tick in ticks), default=0.0),
        work_p99_ms=max((tick.work_p99_ms for tick in ticks), default=0.0),
    )


def _truth_summary(truth: Truth) -> TruthSummary:
    times = {
        kind: [event.time_s for event in truth.events if event.event == kind]
        for kind in ("liftoff", "touchdown")
    }
    return TruthSummary(
        samples=len(truth.time_s),
        complete=truth.complete,
        first_liftoff_s=min(times["liftoff"], default=None),
        last_touchdown_s=max(times["touchdown"], default=None),
        collisions=tuple(
            sorted({event.sysid for event in truth.events if event.event == "collision"})
        ),
    )
