"""From a run folder to its summary. Reads files only: it works after every process has ended."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np

from swarm_ctl.core.law.graph import edges
from swarm_ctl.core.model.causes import Cause
from swarm_ctl.core.model.fleet import SigningPolicy
from swarm_ctl.core.model.messages import AgentStatus, Event, Outcome, StepResult, TickReport
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.report.judge.distances import (
    PairDistance,
    ZoneDistance,
    pair_distances,
    zone_distances,
)
from swarm_ctl.report.judge.findings import Finding, find, headlines, step_at
from swarm_ctl.report.judge.summary import (
    AgentSummary,
    FindingSummary,
    LeftSummary,
    LinkSummary,
    ProtectionSummary,
    RefusedSummary,
    SafetySummary,
    StepSummary,
    StepVerdict,
    Summary,
    TruthSummary,
    ZoneSummary,
)
from swarm_ctl.report.judge.unseen import slow_machine
from swarm_ctl.report.judge.verdict import Ending, judge
from swarm_ctl.rim import Rim
from swarm_ctl.runfolder import metrics
from swarm_ctl.runfolder.flight import TrackSource
from swarm_ctl.runfolder.last_statuses import read_events, read_troubles
from swarm_ctl.runfolder.manifest import Manifest
from swarm_ctl.runfolder.refused_orders import RefusedOrder, read_refused
from swarm_ctl.runfolder.run_folder import FlownGroup, RunFolder, read_run
from swarm_ctl.runfolder.truth import Truth
from swarm_ctl.station.picture.protection import MeshKind
from swarm_ctl.trust.names import member_of

_FROM_BAD_TO_GOOD = list(reversed(StepVerdict))


def summarise(
    folder: Path, exit_codes: Mapping[str, int] | None = None, ending: Ending | None = None
) -> Summary:
    """The summary of the run in `folder`; `exit_codes` by process name, None if not known;
    `ending`: what ended it from outside.

    Every file may be missing or torn: what depends on it is null, `notes` says why, and the run
    is not completed. Never raises: a run that can't be judged has failed.
    """
    rim = Rim("the summary")
    summary = rim.run(_summary, folder, exit_codes, ending)
    if summary is None:
        (trouble,) = rim.troubles()
        summary = _unjudged(exit_codes, f"the run can't be judged: {trouble.why}")
    return summary


def _unjudged(exit_codes: Mapping[str, int] | None, why: str) -> Summary:
    unknown: dict[str, Any] = {
        name: None
        for name, field in Summary.model_fields.items()
        if field.is_required() and name not in ("outcome", "reason")
    }
    known: dict[str, Any] = {
        "sigma_status": {},
        "overspeed": 0,
        "tick": TickReport(),
        "events": {},
        "exit_codes": dict(exit_codes) if exit_codes is not None else None,
        "versions": {},
    }
    known |= dict.fromkeys(("steps", "links", "agents", "notes"), ())
    return Summary(**unknown | known, outcome=Outcome.FAILED, reason=why, cause=Cause.PROCESS)


def _summary(folder: Path, exit_codes: Mapping[str, int] | None, ending: Ending | None) -> Summary:
    run = read_run(folder, _killed(exit_codes or {}))
    events = list(read_events(folder, run.notes))
    refused = read_refused(folder, run.notes)
    return summary_of(run, events, read_troubles(folder), exit_codes, ending, refused)


def summary_of(
    run: RunFolder,
    events: Sequence[Event],
    troubles: Sequence[str] = (),
    exit_codes: Mapping[str, int] | None = None,
    ending: Ending | None = None,
    refused: Sequence[RefusedOrder] = (),
) -> Summary:
    """The summary of a run that is known: what its folder has, or what a flight on a virtual clock
    left. `troubles` are those of what only shows; `refused` the scenario's orders that had to be
    accepted, and were not."""
    truth, statuses = run.truth, run.statuses
    last_s = [s.time_s for s in statuses] + [event.time_s for event in events]
    last_s += [truth.last_s] if truth and truth.last_s is not None else []
    pairs = pair_distances(run)
    zones = zone_distances(run)
    findings = find(run, pairs, zones)
    headings = headlines(run, findings)
    orders = [each.text for each in refused]
    outcome, reason, cause = judge(run, exit_codes or {}, headings, ending, orders)
    steps = _steps(run)
    tally = Counter[str]()
    for status in statuses:
        tally.update(status.sigma_tally)
    speedup = run.manifest.speedup if run.manifest else None
    stepped = run.manifest is not None and run.manifest.lockstep is not None
    return Summary(
        **_of_manifest(run.manifest),
        **_flown(run),
        **_closest(run, pairs),
        nearest_zone=_nearest_zone(zones),
        outcome=outcome,
        reason=reason,
        cause=cause,
        left=_left(run),
        findings=tuple(_finding(run, finding) for finding in findings),
        refused_orders=tuple(RefusedSummary(**asdict(each)) for each in refused),
        judged_by=dict(zip(run.agents, run.flight.sources, strict=True)) if run.flight else {},
        protection=_protection(run),
        steps=steps,
        time_to_form_s=_first_forming_s(run, steps),
        sigma_status=dict(tally),
        overspeed=sum(s.overspeed_ticks for s in statuses),
        safety=_safety(run),
        setpoint_rate_hz=min((s.setpoint_rate_hz for s in statuses), default=None),
        tick=_worst_tick([s.tick for s in statuses]),
        links=tuple(link for s in statuses for link in _links(s)),
        agents=tuple(_agent(run, agent) for agent in run.agents),
        truth=_truth_summary(truth) if truth else None,
        events=dict(Counter(event.level for event in events)),
        exit_codes=dict(exit_codes) if exit_codes is not None else None,
        mission_time_s=max(last_s, default=None),
        wall_time_s=max(last_s) / speedup if last_s and speedup and not stepped else None,
        warnings=(*doubts(run, pairs), *_slow(run, cause), *troubles),
        notes=tuple(run.notes),
    )


def _finding(run: RunFolder, found: Finding) -> FindingSummary:
    """In a mission with groups, with those that the agents were in."""
    where = f", {step_at(run, found)}" if len(run.groups) > 1 else ""
    return FindingSummary(**asdict(found) | {"text": f"{found.text}{where}"})


def _protection(run: RunFolder) -> ProtectionSummary | None:
    manifest = run.manifest
    if manifest is None:
        return None
    if manifest.trust is None:
        return ProtectionSummary(mesh=MeshKind.OPEN if manifest.open_mesh else MeshKind.LOCAL)
    flown_by = manifest.flown_by
    return ProtectionSummary(
        mesh=MeshKind.TLS,
        operator=str(member_of(flown_by.name)) if flown_by else "",
        authenticated=tuple(status.agent for status in run.statuses),
        signing=manifest.signing is SigningPolicy.REQUIRED,
        signed=tuple(
            s.agent for s in run.statuses if s.vehicle_link is not None and s.vehicle_link.signed
        ),
    )


def _left(run: RunFolder) -> tuple[LeftSummary, ...]:
    found = (
        LeftSummary(agent=s.agent, order=s.left.order, time_s=s.left.time_s)
        for s in run.statuses
        if s.left is not None
    )
    return tuple(sorted(found, key=lambda left: (left.time_s, left.agent)))


def _slow(run: RunFolder, cause: Cause | None) -> list[str]:
    """That the machine did not keep up, where the reason does not say so."""
    if run.manifest is None or cause is Cause.MACHINE:
        return []
    found = slow_machine(run.statuses, run.manifest.plan, run.manifest.speedup)
    return [found] if found else []


def _killed(exit_codes: Mapping[str, int]) -> set[int]:
    """The agents whose processes were ended by a signal."""
    names = (name for name, code in exit_codes.items() if code < 0)
    return {int(name.removeprefix("agent-")) for name in names if name.startswith("agent-")}


def _of_manifest(manifest: Manifest | None) -> dict[str, Any]:
    """The fields that come from the manifest alone."""
    names = ("mission", "mission_file", "plan_hash", "swarm", "started_at", "r_in_m", "r_m")
    if manifest is None:
        return dict.fromkeys((*names, "speedup")) | {"versions": {}}
    law, unit_m = manifest.plan.law, manifest.plan.unit_m
    return {
        "mission": manifest.plan.name,
        "mission_file": manifest.mission,
        "plan_hash": manifest.plan_hash,
        "own_law": law.own,
        "swarm": manifest.swarm,
        "routers": manifest.routers,
        "started_at": manifest.started_at.isoformat(),
        "r_in_m": law.r_in * unit_m,
        "r_m": law.r * unit_m,
        "speedup": manifest.speedup,
        "versions": manifest.versions,
    }


# --- steps ---


def _steps(run: RunFolder) -> tuple[StepSummary, ...]:
    told = [(group, k) for group in run.groups for k in group.plan.told_steps]
    return tuple(_step(run, group, k) for group, k in told if not group.plan.waits_on(k))


def _first_forming_s(run: RunFolder, steps: Sequence[StepSummary]) -> float | None:
    """Of the first form step; of several groups, the slowest."""
    first = [(g.plan.name, k) for g in run.groups if not g.plan.before for k in g.form_steps[:1]]
    found = [
        next(each.time_to_form_s for each in steps if each.step == k and each.group in ("", name))
        for name, k in first
    ]
    known = [each for each in found if each is not None]
    return max(known) if known and len(known) == len(found) else None


def _step(run: RunFolder, group: FlownGroup, k: int) -> StepSummary:
    last = group.last
    results = {i: last[i].step(k) if i in last else None for i in group.plan.ids}
    verdicts = {i: _verdict(found) for i, found in results.items()}
    reached = [found for found in results.values() if found]
    undone = {i: each for i, each in verdicts.items() if each is not StepVerdict.DONE}
    start_s = min((found.start_s for found in reached), default=None)
    gone = {left.agent for left in _left(run)} | {i for i in last if _never_flew(run, i)}
    stayed = [each for i, each in verdicts.items() if i not in gone] or verdicts.values()
    worst = min(stayed, key=_FROM_BAD_TO_GOOD.index, default=StepVerdict.NOT_REACHED)
    return StepSummary(
        step=k,
        name=group.plan.step_name(k),
        result=worst,
        start_s=start_s,
        end_s=max((found.end_s for found in reached if found.end_s is not None), default=None),
        exceptions=undone if reached else {},
        time_to_form_s=_time_to_form(run, group, k, start_s),
        **({"group": group.plan.name, "agents": group.plan.ids} if len(run.groups) > 1 else {}),
    )


def _never_flew(run: RunFolder, agent: int) -> bool:
    """It waited on the ground to the end, as the mission has it."""
    waits = run.plan is not None and run.plan.agent(agent).waits
    return waits and len(run.last[agent].status.steps) <= 1


def _verdict(found: StepResult | None) -> StepVerdict:
    return StepVerdict(found.result) if found else StepVerdict.NOT_REACHED


def _time_to_form(run: RunFolder, group: FlownGroup, k: int, start_s: float | None) -> float | None:
    flown = group.plan.step(k)
    step = flown.new_shape if flown is not None else None
    if step is None or start_s is None or run.flight is None or run.plan is None:
        return None
    flight = run.flight.of(group.columns)
    later = [j for j in group.form_steps if j > k]
    end_s = min([group.ends_s(), *(group.start_s(j) for j in later[:1])])
    slots_m = group.slots(step, start_s, flight.time_s) * run.plan.unit_m
    error_m = metrics.formation_error(flight, slots_m)
    return metrics.time_to_settle(
        flight.time_s, error_m, start_s, end_s, step.tolerance_m, step.settle_s
    )


# --- flight ---


def _flown(run: RunFolder) -> dict[str, Any]:
    """Formation error and longest link from the first form step to the landing."""
    found: dict[str, Any] = dict.fromkeys(
        ("formation_error_m", "longest_link_m", "longest_link_pair")
    )
    groups = [_flown_by(run, group) for group in run.groups]
    errors_m = [error_m for error_m, _ in groups if error_m is not None]
    longest = max((link for _, link in groups if link is not None), default=None)
    found["formation_error_m"] = max(errors_m, default=None)
    if longest is not None:
        found["longest_link_m"], found["longest_link_pair"] = longest
    return found


def _flown_by(
    run: RunFolder, group: FlownGroup
) -> tuple[float | None, tuple[float, tuple[int, int]] | None]:
    """The last formation error [m], and the longest link [m] with its agents; None: not known."""
    forms = [k for k in group.form_steps if k in group.begun]
    if run.flight is None or run.plan is None or not forms:
        return None, None
    flight = run.flight.during(group.start_s(forms[0]), group.ends_s()).of(group.columns)
    # The newest shape, turned and scaled as planned.
    formation, last = group.newest_formation(run.plan.unit_m), group.plan.step(forms[-1])
    form = last.new_shape if last is not None else None
    if form is None:
        return None, None
    slots = group.slots(form, group.start_s(forms[-1]), flight.time_s)
    turn = formation.scale * np.exp(1j * formation.angle_rad)
    turned = (slots[..., 0] + 1j * slots[..., 1]) * (turn * run.plan.unit_m)
    error_m = metrics.formation_error(flight, np.stack((turned.real, turned.imag), axis=-1))
    ids = group.plan.ids
    links = edges({agent.id: agent.neighbours for agent in group.plan.agents})
    longest = metrics.longest_link(flight, [(ids.index(a), ids.index(b)) for a, b in links])
    if longest is None:
        return metrics.last_number(error_m), None
    length_m, (i, j) = longest
    return metrics.last_number(error_m), (length_m, (ids[i], ids[j]))


def _closest(run: RunFolder, pairs: Sequence[PairDistance]) -> dict[str, Any]:
    """The smallest distance of all, and that of the truth; `pairs` have the closest first."""
    true = next((pair for pair in pairs if pair.source is TrackSource.TRUTH), None)
    found: dict[str, Any] = {
        "min_true_distance_m": true.distance_m if true else None,
        "min_true_pair": true.agents if true else None,
    }
    if pairs:
        found["min_distance_m"], found["min_distance_pair"] = pairs[0].distance_m, pairs[0].agents
        found["min_distance_doubt_m"] = pairs[0].doubt_m
    elif run.truth is not None and run.truth.minima:
        # without a manifest no agent is known
        found["min_true_distance_m"] = found["min_distance_m"] = min(run.truth.minima.values())
    return found


def _nearest_zone(zones: Sequence[ZoneDistance]) -> ZoneSummary | None:
    """`zones` have the closest first."""
    if not zones:
        return None
    near = zones[0]
    return ZoneSummary(
        zone=near.zone, agent=near.agent, distance_m=near.distance_m, time_s=near.time_s
    )


# --- agents, links, truth ---


def _agent(run: RunFolder, agent: int) -> AgentSummary:
    last = run.last.get(agent)
    fleet = run.manifest.fleet if run.manifest else ()
    sysid = next((entry.sysid for entry in fleet if entry.id == agent), None)
    if last is None:
        return AgentSummary(agent=agent, sysid=sysid, account="none")
    s = last.status
    return AgentSummary(
        agent=agent,
        sysid=sysid,
        account="final" if last.final else "last heard",
        time_s=s.time_s,
        outcome=s.outcome,
        reason=s.reason,
        cause=s.cause,
        phase=s.phase.name.lower(),
        armed=s.armed,
        airborne=s.airborne,
        setpoints=s.setpoints,
        setpoint_rate_hz=s.setpoint_rate_hz,
        sigma_status=s.sigma_tally,
        overspeed=s.overspeed_ticks,
        tick=s.tick,
        bad_payloads=s.bad_payloads,
    )


def _safety(run: RunFolder) -> SafetySummary | None:
    reports = [s.safety for s in run.statuses]
    if not reports or (run.plan is not None and not run.plan.safety.filter):
        return None
    names = ("ticks", "touched", "yielded", "releases")
    sums = {name: sum(getattr(report, name) for report in reports) for name in names}
    return SafetySummary(**sums, exchanges=sum(len(s.roles) for s in run.statuses) // 2)


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
    """The sums of the counts, and the worst of each percentile."""
    worst = ("late_p50_ms", "late_p99_ms", "late_max_ms", "work_p50_ms", "work_p99_ms")
    return TickReport(
        count=sum(tick.count for tick in ticks),
        overruns=sum(tick.overruns for tick in ticks),
        **{name: max((getattr(tick, name) for tick in ticks), default=0.0) for name in worst},
    )


def _truth_summary(truth: Truth) -> TruthSummary:
    def times(kind: str) -> list[float]:
        return [event.time_s for event in truth.events if event.event == kind]

    collided = {event.sysid for event in truth.events if event.event == "collision"}
    return TruthSummary(
        samples=len(truth.time_s),
        complete=truth.complete,
        first_liftoff_s=min(times("liftoff"), default=None),
        last_touchdown_s=max(times("touchdown"), default=None),
        collisions=tuple(sorted(collided)),
    )


_LEVEL_M: Final = 3.0
"""A barometer drifts by less than this in a flight; more is a slope, or a wrong height."""


def doubts(run: RunFolder, pairs: Iterable[PairDistance]) -> Iterator[str]:
    """A sentence each."""
    plan = run.plan
    r_in_m = plan.law.r_in * plan.unit_m if plan else 0.0
    for pair in pairs:
        if r_in_m <= pair.distance_m < r_in_m + pair.doubt_m:
            yield (
                f"{agents_named(pair.agents)} were {pair.distance_m:.2f} m apart at"
                f" {pair.time_s:.1f} s by their own estimates, give or take {pair.doubt_m:.2f} m:"
                f" they may have been under r_in {r_in_m:.2f} m"
            )
    for agent, track in run.tracks.items():
        for since_s, for_s in track.gaps():
            what = "where its vehicle was in the air is not known"
            yield f"agent {agent}: {what} for {for_s:.1f} s from {since_s:.1f} s on"
        heights = track.height_m[np.isfinite(track.height_m)]
        if len(heights) and abs(heights[-1]) > _LEVEL_M:
            height = f"{heights[-1]:+.1f} m from the height of its take-off"
            yield f"agent {agent}: its vehicle ended {height}, by its own estimate"
    silent = [i for i, track in run.tracks.items() if not np.isfinite(track.accuracy_m).any()]
    if silent:
        what = "the vehicle says no accuracy of its position, so the doubt has none of it"
        yield f"{agents_named(silent)}: {what}"
    for agent, last in run.last.items():
        if last.successor:
            how = "took its vehicle over" if last.from_air else "flew its vehicle from the ground"
            yield f"agent {agent}: its process was killed; another {how}"
