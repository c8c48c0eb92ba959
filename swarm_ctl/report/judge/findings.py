"""What makes a run failed whatever its agents say: collisions, falls, vehicles that came too close,
were in a zone, came down where or when they should not, or did not come down."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from swarm_ctl.core.model.messages import Outcome
from swarm_ctl.core.model.plan import Plan, Point
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.core.model.vehicle import FALLS_MPS, MISPLACED_M
from swarm_ctl.report.judge.distances import PairDistance, ZoneDistance
from swarm_ctl.runfolder.flight import Flight, TrackSource
from swarm_ctl.runfolder.run_folder import RunFolder
from swarm_ctl.runfolder.truth import Bools, EventKind, Truth, TruthEvent

HARD_MPS: Final = 3.0
"""A touch-down that breaks a vehicle; autopilots land with 0.5 to 1 m/s."""
_SINKS_M: Final = 0.5
"""A landing begins with coming to rest and making room; where it is when it has sunk by so much is
the place."""
_SILENT_S: Final = 3.0
"""Statuses come at 2 Hz: an older one says nothing of the end."""
_DROP_M: Final = 2.0
"""A vehicle that was disarmed on the ground sinks less than this, by its own height."""


class FindingKind(StrEnum):
    """What was found."""

    COLLISION = "collision"
    TOO_CLOSE = "too close"
    """A pair under r_in."""
    ZONE = "in a zone"
    DISARMED = "disarmed in the air"
    FALL = "fall"
    EARLY = "down before its landing"
    MISPLACED = "landed elsewhere"
    NOT_DOWN = "not down"


@dataclass(frozen=True, slots=True)
class Finding:
    """One of them. `text` has agents, time and figures."""

    kind: FindingKind
    time_s: float
    agents: tuple[int, ...]
    text: str


def find(
    run: RunFolder, pairs: Iterable[PairDistance], zones: Iterable[ZoneDistance]
) -> list[Finding]:
    """All findings of a run, the earliest first; `pairs` and `zones` are all distances."""
    flight, plan = run.flight, run.plan
    if flight is None or plan is None:
        return []
    found = list(_collisions(run))
    collided = {finding.agents for finding in found}
    found += _too_close(plan, (pair for pair in pairs if pair.agents not in collided))
    found += _in_zones(zones)
    for k, agent in enumerate(run.agents):
        events = _events(run, agent)
        limit_mps = max(FALLS_MPS, 2.0 * plan.limits.descent_mps)
        falls = [*_motors_off(run, k, events), *_falls(flight, k, agent, events, limit_mps)]
        found += falls
        if not falls:
            found += _landing(run, plan, k, events)
        found += _not_down(run, k)
    return sorted(found, key=lambda finding: finding.time_s)


def headlines(run: RunFolder, findings: Iterable[Finding]) -> list[str]:
    """A line for each kind: its first case with the step, and how many more there are."""
    kinds: dict[FindingKind, list[Finding]] = {}
    for finding in findings:
        kinds.setdefault(finding.kind, []).append(finding)
    return [_headline(run, found) for found in kinds.values()]


def _headline(run: RunFolder, found: list[Finding]) -> str:
    first, *others = found
    agents = {agent for finding in others for agent in finding.agents}
    more = f" (and {len(others)} more: {agents_named(agents)})" if others else ""
    return f"{first.text}, {step_at(run, first)}{more}"


def step_at(run: RunFolder, found: Finding) -> str:
    """In which step its agents were, with their groups where the mission has several: `in step 3
    (form wedge) of scouts and step 4 (move) of sweepers`."""
    told = dict[str, None]()
    for agent in found.agents:
        own = [group for group in run.groups if agent in group.plan.ids]
        begun = [(k, g) for g in own for k in g.begun if g.start_s(k) <= found.time_s]
        for k, group in begun[-1:]:
            whose = f" of {group.plan.name}" if len(run.groups) > 1 else ""
            told[f"step {k} ({group.plan.step_name(k)}){whose}"] = None
        if len(run.groups) == 1:
            break  # all are in the step of the first
    return f"in {' and '.join(told)}" if told else "before the first step"


# --- pairs ---


def _collisions(run: RunFolder) -> Iterator[Finding]:
    truth, manifest = run.truth, run.manifest
    if truth is None or manifest is None:
        return
    agent_of, told = manifest.agent_of_sysid, set[tuple[int, ...]]()
    for event in truth.events:
        if event.event != EventKind.COLLISION or event.sysid not in agent_of:
            continue
        other = event.other if event.other is not None else _partner(truth, event)
        sysids = sorted({event.sysid} if other is None else {event.sysid, other})
        agents = tuple(sorted(agent_of[sysid] for sysid in sysids if sysid in agent_of))
        if agents in told:
            continue
        told.add(agents)
        near_m = truth.minima.get((sysids[0], sysids[-1]))
        near = "" if near_m is None else f": {near_m:.2f} m apart"
        whose = (
            f"the vehicles of {agents_named(agents)}" if len(agents) > 1 else _vehicle(agents[0])
        )
        text = f"{whose} collided at {event.time_s:.1f} s{near}"
        yield Finding(FindingKind.COLLISION, event.time_s, agents, text)


def _partner(truth: Truth, event: TruthEvent) -> int | None:
    """The vehicle that collided at the same moment, in a truth that does not name it."""
    same = (
        each.sysid
        for each in truth.events
        if each.event == EventKind.COLLISION and each.time_s == event.time_s
    )
    return next((sysid for sysid in same if sysid != event.sysid), None)


def _too_close(plan: Plan, pairs: Iterable[PairDistance]) -> Iterator[Finding]:
    r_in_m = plan.law.r_in * plan.unit_m
    for pair in pairs:
        if pair.distance_m < r_in_m:
            apart = f"{pair.distance_m:.2f} m apart at {pair.time_s:.1f} s{_by(pair.source)}"
            text = f"{agents_named(pair.agents)} were {apart}, under r_in {r_in_m:.2f} m"
            yield Finding(FindingKind.TOO_CLOSE, pair.time_s, pair.agents, text)


def _by(source: TrackSource, whose: str = "their") -> str:
    return f" by {whose} own estimates" if source is TrackSource.ESTIMATES else ""


def _in_zones(zones: Iterable[ZoneDistance]) -> Iterator[Finding]:
    for near in zones:
        if near.distance_m == 0.0:
            north, east, down = near.point_ned_m
            at = f"at ({north:.1f}, {east:.1f}), {-down:.1f} m high{_by(near.source, 'its')}"
            text = f"{_vehicle(near.agent)} was in zone {near.zone} at {near.time_s:.1f} s, {at}"
            yield Finding(FindingKind.ZONE, near.time_s, (near.agent,), text)


# --- one vehicle ---


def _vehicle(agent: int) -> str:
    return f"the vehicle of agent {agent}"


def _events(run: RunFolder, agent: int) -> list[TruthEvent]:
    """Of the agent's vehicle, in the truth."""
    if run.truth is None or run.manifest is None or agent not in run.manifest.in_truth:
        return []
    sysid = next(entry.sysid for entry in run.manifest.fleet if entry.id == agent)
    return [event for event in run.truth.events if event.sysid == sysid]


def _motors_off(run: RunFolder, k: int, events: list[TruthEvent]) -> Iterator[Finding]:
    """Disarmed in the air: by an event of the truth, or by its states or the vehicle's own."""
    flight, agent = run.flight, run.agents[k]
    if flight is None:
        return
    told = next((event for event in events if event.event == EventKind.DISARM), None)
    time_s, height_m = (told.time_s, told.height_m) if told else (math.nan, None)
    if told is None:
        armed, down = flight.armed[:, k], flight.position_ned_m[:, k, 2]
        off = np.flatnonzero(armed[:-1] & ~armed[1:])
        true = flight.sources[k] is TrackSource.TRUTH
        for at in off.tolist():
            drop_m = _drop(down[at + 1 :])
            if (true and flight.airborne[at + 1, k]) or (not true and drop_m > _DROP_M):
                time_s, height_m = float(flight.time_s[at + 1]), drop_m
                break
    if not math.isnan(time_s):
        high = "" if height_m is None else f", {height_m:.1f} m high"
        text = f"{_vehicle(agent)} was disarmed in the air at {time_s:.1f} s{high}"
        yield Finding(FindingKind.DISARMED, time_s, (agent,), text)


def _drop(down_m: np.ndarray[tuple[int], np.dtype[np.float64]]) -> float:
    """How far it sank from the first of these moments on [m]; 0 where that is not known."""
    known = down_m[np.isfinite(down_m)]
    return float(known.max() - known[0]) if len(known) and np.isfinite(down_m[0]) else 0.0


def _falls(
    flight: Flight, k: int, agent: int, events: list[TruthEvent], limit_mps: float
) -> Iterator[Finding]:
    for event in events:
        hard = event.event == EventKind.TOUCHDOWN and (event.impact_mps or 0.0) > HARD_MPS
        if hard or event.event == EventKind.CRASH:
            speed = "" if event.impact_mps is None else f" with {event.impact_mps:.1f} m/s"
            text = f"{_vehicle(agent)} fell: it hit the ground at {event.time_s:.1f} s{speed}"
            yield Finding(FindingKind.FALL, event.time_s, (agent,), text)
            return
    # a vehicle whose motors are off may say at once that it has landed, wherever it is
    flown = np.logical_or.accumulate(flight.airborne[:, k])
    fast = (flight.descent_mps[:, k] > limit_mps) & flown
    twice = np.flatnonzero(fast[1:] & fast[:-1]) + 1
    if len(twice):
        at = int(twice[0])
        time_s, speed_mps = float(flight.time_s[at]), flight.descent_mps[at, k]
        text = f"{_vehicle(agent)} fell with {speed_mps:.1f} m/s at {time_s:.1f} s"
        yield Finding(FindingKind.FALL, time_s, (agent,), text)


def _landing(run: RunFolder, plan: Plan, k: int, events: list[TruthEvent]) -> Iterator[Finding]:
    """An agent that completed has landed at its landing step, where that step is to land it."""
    agent, flight = run.agents[k], run.flight
    last = run.last.get(agent)
    if last is None or flight is None or last.status.outcome is not Outcome.COMPLETED:
        return
    group = [each for each in run.groups if agent in each.plan.ids][-1]
    steps = plan.steps_of(agent)
    numbers = [j for j, s in enumerate(steps, 1) if s.goes_down]
    begun_s = group.start_s(numbers[0]) if numbers else math.inf
    if not math.isfinite(begun_s):
        return
    up = [j + 1 for j, s in enumerate(steps, 1) if s.climbs_to_m is not None]
    flies_s = group.start_s(up[0]) if up else math.inf
    early = [
        event.time_s
        for event in events
        if event.event == EventKind.TOUCHDOWN and flies_s < event.time_s < begun_s
    ]
    if early:
        text = f"{_vehicle(agent)} came down at {early[0]:.1f} s, before its landing"
        yield Finding(FindingKind.EARLY, early[0], (agent,), text)
        return
    known = np.flatnonzero(np.isfinite(flight.points_m[:, k, 0]))
    after = known[flight.time_s[known] >= begun_s]
    if not len(after):
        return
    sunk_m = flight.position_ned_m[after, k, 2]
    stands = after[: max(1, int(np.argmax(sunk_m > sunk_m[0] + _SINKS_M)))]
    home = steps[numbers[0] - 1].goes_home
    north, east = plan.agent(agent).start
    place: Point = (north * plan.unit_m, east * plan.unit_m)
    if not home:
        place = tuple(flight.points_m[stands[-1], k].tolist())
    away_m = math.dist(place, flight.points_m[known[-1], k].tolist())
    if away_m > MISPLACED_M:
        what = "its start" if home else "where its landing began"
        text = f"{_vehicle(agent)} landed {away_m:.1f} m from {what}"
        yield Finding(FindingKind.MISPLACED, float(flight.time_s[known[-1]]), (agent,), text)


def _last_s(run: RunFolder) -> float:
    """When the last word of any agent is from."""
    told = [track.told_s[-1] for track in run.tracks.values() if len(track.told_s)]
    return float(max(told, default=-math.inf))


def _not_down(run: RunFolder, k: int) -> Iterator[Finding]:
    """Armed or in the air when it was last heard of."""
    agent, flight = run.agents[k], run.flight
    if flight is None or not len(flight.time_s):
        return
    if flight.sources[k] is TrackSource.TRUTH and not (run.truth and run.truth.complete):
        return  # it ends with the simulator, wherever the vehicle is
    armed: Bools = flight.armed[:, k]
    airborne: Bools = flight.airborne[:, k]
    time_s = float(flight.time_s[-1])
    if agent in run.tracks and len(run.tracks[agent].told_s):
        track = run.tracks[agent]
        armed, airborne, time_s = track.armed, track.airborne, float(track.told_s[-1])
    if armed[-1] or airborne[-1]:
        how = "in the air" if airborne[-1] else "armed"
        text = f"{_vehicle(agent)} was still {how} at the end, {time_s:.1f} s"
        silent_s = _last_s(run) - time_s
        if silent_s > _SILENT_S:
            text = (
                f"{_vehicle(agent)} was {how} when it was last heard of, at {time_s:.1f} s,"
                f" {silent_s:.0f} s before the end: whether it came down is not known"
            )
        yield Finding(FindingKind.NOT_DOWN, time_s, (agent,), text)
