"""A run over time, for figures: its flight, and the recording if there is one."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from swarm_ctl.core.law.formation import distances
from swarm_ctl.core.law.graph import edges
from swarm_ctl.core.model.frames import ned_from_geodetic
from swarm_ctl.core.model.messages import AgentState, AgentStatus, Payload, SigmaReport, TargetWord
from swarm_ctl.core.model.plan import Geodetic, Plan
from swarm_ctl.core.model.steps.follow import FollowStep
from swarm_ctl.core.model.targets import PREDICTED_S, STANDS_MPS
from swarm_ctl.errors import InputError
from swarm_ctl.recording import RECORDING, read, recover
from swarm_ctl.recording.mcap_reader import is_whole
from swarm_ctl.recording.mcap_records import RecordingDamage
from swarm_ctl.runfolder.flight import Flight, no_flight
from swarm_ctl.runfolder.manifest import Manifest
from swarm_ctl.runfolder.run_folder import RunFolder, read_run
from swarm_ctl.runfolder.truth import Floats


@dataclass(slots=True)
class HeardMessages:
    """What the station heard of each agent, by id."""

    states: dict[int, list[AgentState]] = field(default_factory=dict)
    statuses: dict[int, list[AgentStatus]] = field(default_factory=dict)
    sigmas: dict[tuple[int, int], list[tuple[float, float, float]]] = field(default_factory=dict)
    """(time, distance, sigma) as agent i sees j, by (i, j); units."""
    targets: dict[str, list[tuple[float, TargetWord]]] = field(default_factory=dict)
    """(when it was there, word) of each target, by name."""
    said: list[tuple[float, Payload]] = field(default_factory=list)
    """(time heard, message) of all of them."""


_GAP_S: Final = 2.0 * PREDICTED_S
"""Two words of a target that are farther apart do not say where it was between them."""
_OFTEN_S: Final = 0.05
"""Words of several tellers that are no farther apart are one."""


class TargetTrack(NamedTuple):
    """Where a target was by what was told of it, T words in the order of their times."""

    name: str
    time_s: Floats
    """(T,), when it was there."""
    ned_m: Floats
    """(T, 3)"""
    velocity_mps: Floats
    """(T, 2), north and east; nan where it was not told."""

    def at(self, time_s: Floats) -> tuple[Floats, Floats]:
        """Its place (N, 2) [m] at these times, on straight lines between the words, and the age of
        the newest word (N,) [s]; nan before the first, and where there was none for longer than a
        formation carries its motion on."""
        after = np.searchsorted(self.time_s, time_s, side="right")
        before = np.clip(after - 1, 0, None)
        age_s = np.where(after > 0, time_s - self.time_s[before], np.nan)
        later = np.clip(after, 0, len(self.time_s) - 1)
        known = (after > 0) & (np.maximum(self.time_s[later] - self.time_s[before], age_s) < _GAP_S)
        found = [np.interp(time_s, self.time_s, self.ned_m[:, c]) for c in range(2)]
        return np.where(known[:, None], np.stack(found, axis=-1), np.nan), age_s


@dataclass(frozen=True, slots=True, eq=False)
class RunHistory:
    """What the figures of one run need; without a flight or a recording, parts of it are empty."""

    name: str
    run: RunFolder
    manifest: Manifest
    flight: Flight
    heard: HeardMessages
    notes: tuple[str, ...]

    @property
    def plan(self) -> Plan:
        """What was flown."""
        return self.manifest.plan

    @property
    def agents(self) -> list[int]:
        """Ids in the plan's order."""
        return [agent.id for agent in self.plan.agents]

    @property
    def by(self) -> str:
        """Who says where the vehicles were: `truth`, `estimates`, or both."""
        return " and ".join(sorted(set(self.flight.sources), reverse=True))

    @property
    def links(self) -> tuple[tuple[int, int], ...]:
        """The start graph, by id."""
        return edges({agent.id: agent.neighbours for agent in self.plan.agents})

    def errors(self) -> Floats:
        """e_i [m] in the newest form step of each moment (T, n, 2); nan before the first one, and
        for agents that do not fly."""
        flight = self.flight
        found = np.full(flight.points_m.shape, np.nan)
        for group in self.run.groups:
            for k, step in zip(group.plan.numbers, group.plan.steps, strict=True):
                if (form := step.new_shape) is not None:
                    since, until = group.start_s(k), group.ends_s()
                    at = (flight.time_s >= since) & (flight.time_s <= until)
                    slots = group.slots(form, since, flight.time_s[at]) * self.plan.unit_m
                    centre = np.mean(form.slots, axis=0) * self.plan.unit_m
                    slots = self._turned(slots, centre, flight.time_s[at])
                    of = np.ix_(np.flatnonzero(at), np.array(group.columns))
                    found[of] = flight.points_m[of] - slots
        found[~flight.live] = np.nan
        return found

    def deviations(self) -> Floats:
        """e_i less the mean of all of its group that fly [m], (T, n, 2): how far each is from its
        slot, wherever the shape stands; nan as in `errors`."""
        found, times = self.errors(), self.flight.time_s
        for group in self.run.groups:
            before = group.plan.before
            since_s = group.start_s(before + 1) if before else -np.inf
            at = (times >= since_s) & (times <= group.ends_s())
            of = np.ix_(np.flatnonzero(at), np.array(group.columns))
            own, there = found[of], np.isfinite(found[of])
            count = np.maximum(there.sum(axis=1, keepdims=True), 1)
            found[of] = own - np.where(there, own, 0.0).sum(axis=1, keepdims=True) / count
        return found

    def targets(self) -> list[TargetTrack]:
        """Of each target that was told of, its track."""
        return [self._track(name, words) for name, words in sorted(self.heard.targets.items())]

    def _track(self, name: str, words: list[tuple[float, TargetWord]]) -> TargetTrack:
        kept = list[tuple[float, TargetWord]]()
        for time_s, word in sorted(words, key=lambda each: each[0]):
            if not kept or time_s - kept[-1][0] > _OFTEN_S:
                kept.append((time_s, word))
        height_m = next((t.height_m for t in self.plan.targets if t.name == name), None)
        places, velocities = [], []
        for _, word in kept:
            told = Geodetic(word.latitude_deg, word.longitude_deg, word.altitude_m or 0.0)
            north, east, down = ned_from_geodetic(told, self.plan.origin)
            known = word.altitude_m is not None and height_m is None
            places.append((north, east, down if known else -(height_m or 0.0)))
            velocities.append((word.velocity_ned_mps or (np.nan, np.nan))[:2])
        times = np.array([time_s for time_s, _ in kept])
        return TargetTrack(name, times, np.array(places), np.array(velocities))

    def off_targets(self) -> Floats:
        """How far each agent is from its place about the target that its group follows [m] (T, n);
        nan where it follows none by the mission, or nobody told where that is."""
        flight, tracks = self.flight, {track.name: track for track in self.targets()}
        found, errors = np.full(flight.live.shape, np.nan), self.errors()
        for group in self.run.groups:
            centre = np.zeros(2)
            for k, step in zip(group.plan.numbers, group.plan.steps, strict=True):
                if (form := step.new_shape) is not None:
                    centre = np.mean(form.slots, axis=0) * self.plan.unit_m
                follows, until_s = step.follows, min(group.start_s(k + 1), group.ends_s())
                if follows is None or follows.target not in tracks:
                    continue
                at = (flight.time_s >= group.start_s(k)) & (flight.time_s <= until_s)
                wanted = _wanted(tracks[follows.target], follows, flight.time_s[at])
                of = np.ix_(np.flatnonzero(at), np.array(group.columns))
                found[of] = np.linalg.norm(errors[of] + centre - wanted[:, None], axis=-1)
        return found

    def first_form_s(self) -> float:
        """When the first form step began; 0 where none did."""
        groups = self.run.groups
        begun = (group.start_s(k) for group in groups for k in group.form_steps)
        found = min(begun, default=np.inf)
        return found if np.isfinite(found) else 0.0

    def _turned(self, slots_m: Floats, centre: Floats, time_s: Floats) -> Floats:
        """The slots (T, n, 2) turned about this centre and scaled as the shared frame is at each
        moment."""
        states = next((found for found in self._framed() if found), [])
        if not states:
            return slots_m
        # Turning and scaling is a product of complex numbers north + i east; 1 before any frame.
        turns = [1.0, *(s.frame.scale * np.exp(1j * s.frame.angle_rad) for s in states if s.frame)]
        at = np.searchsorted([s.time_s for s in states], time_s, side="right")
        z = np.array(turns)[at, None] * ((slots_m - centre) @ np.array([1.0, 1.0j]))
        return np.asarray(np.stack((z.real, z.imag), axis=-1) + centre)

    def _framed(self) -> Iterator[list[AgentState]]:
        """By agent, its states that hold a frame."""
        for _, states in sorted(self.heard.states.items()):
            yield [s for s in states if s.frame]

    def nearest(self) -> Floats:
        """Distance [m] of each live agent to the nearest other vehicle that is not in another
        layer, flying or not (T, n); nan: none."""
        apart = distances(self.flight.points_m)
        down, plan = self.flight.position_ned_m[..., 2], self.plan
        if plan.wake is not None:
            high = np.abs(down[:, :, None] - down[:, None, :])
            apart[high >= plan.layer_m] = np.nan
        own = np.arange(apart.shape[1])
        apart[:, own, own] = np.nan
        apart[~self.flight.live] = np.nan
        return least(apart)

    def lengths(self) -> Floats:
        """Length [m] of each link while both agents fly (T, links); nan: one of them does not."""
        points, live = self.flight.points_m, self.flight.live
        column = self.agents.index
        ends = np.array([(column(i), column(j)) for i, j in self.links], dtype=np.intp)
        i, j = ends.reshape(-1, 2).T
        lengths = np.linalg.norm(points[:, i] - points[:, j], axis=-1)
        return np.where(live[:, i] & live[:, j], lengths, np.nan)


def _wanted(track: TargetTrack, step: FollowStep, time_s: Floats) -> Floats:
    """Where the centre of a formation is to be (N, 2)."""
    place, _ = track.at(time_s)
    offset = np.array(step.offset_m)
    if not step.in_course:
        return np.asarray(place + offset)
    north, east = (np.interp(time_s, track.time_s, track.velocity_mps[:, c]) for c in range(2))
    speed = np.hypot(north, east)
    course = (north + 1j * east) / np.where(speed < STANDS_MPS, np.nan, speed)
    turned = complex(*offset) * course
    return np.asarray(place + np.stack((turned.real, turned.imag), axis=-1))


def least(values: Floats) -> Floats:
    """The least number along the last axis; nan where there is none."""
    found = np.where(np.isnan(values), np.inf, values).min(axis=-1, initial=np.inf)
    return np.where(np.isfinite(found), found, np.nan)


def read_history(folder: Path) -> RunHistory:
    """Read a run folder; a recording that was cut off or is damaged as far as it can be read.

    Raises:
        InputError: the folder has no manifest.
    """
    run = read_run(folder)
    if run.manifest is None:
        allowed = "a folder that `run` has made, such as those in runs/"
        raise InputError(f"{folder}: is no run folder: {run.notes[0]}; allowed: {allowed}")
    notes = list(run.notes)
    heard = _heard(folder, notes)
    flight = run.flight or no_flight(len(run.manifest.plan.agents))
    return RunHistory(folder.resolve().name, run, run.manifest, flight, heard, tuple(notes))


def _heard(folder: Path, notes: list[str]) -> HeardMessages:
    heard = HeardMessages()
    if not (folder / RECORDING).exists():
        notes.append(f"{RECORDING}: is missing; figures of messages are left out")
        return heard
    try:
        damage, whole = RecordingDamage(), is_whole(folder)
        _take(heard, folder, damage)
        notes += [] if whole else [f"{RECORDING}: was cut off; read up to its last second"]
        notes += [words for words in damage.describe(RECORDING) if words not in notes]
        with contextlib.suppress(OSError):
            if copy := recover(folder, damaged=damage.bad > 0):
                notes.append(f"{copy.name}: a whole copy of what can be read, for other tools")
    except InputError as error:
        notes.append(str(error))
    return heard


def _take(heard: HeardMessages, folder: Path, damage: RecordingDamage) -> None:
    for heard_s, payload in read(folder, damage):
        heard.said.append((heard_s, payload))
        match payload:
            case AgentState():
                heard.states.setdefault(payload.agent, []).append(payload)
            case AgentStatus():
                heard.statuses.setdefault(payload.agent, []).append(payload)
            case TargetWord():
                when = heard_s - payload.age_s, payload
                heard.targets.setdefault(payload.name, []).append(when)
            case SigmaReport():
                for pair in payload.pairs:
                    row = (payload.time_s, pair.distance, pair.sigma)
                    heard.sigmas.setdefault((payload.agent, pair.peer), []).append(row)
