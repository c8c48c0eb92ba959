"""A run over time, for figures: from the truth, and from the recording where there is one."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from swarm_ctl.core.law.graph import edges
from swarm_ctl.core.model.messages import AgentState, AgentStatus, SigmaReport
from swarm_ctl.core.model.plan import FormStep, Plan
from swarm_ctl.errors import InputError
from swarm_ctl.recording import RECORDING, read, recover
from swarm_ctl.report.folder.manifest import Manifest
from swarm_ctl.report.folder.metrics import Flight
from swarm_ctl.report.folder.run_folder import Run, read_run
from swarm_ctl.report.folder.truth import Floats


@dataclass(slots=True)
class Heard:
    """What the station heard of each agent, by id."""

    states: dict[int, list[AgentState]] = field(default_factory=dict)
    statuses: dict[int, list[AgentStatus]] = field(default_factory=dict)
    sigmas: dict[tuple[int, int], list[tuple[float, float, float]]] = field(default_factory=dict)
    """(time, distance, sigma) as agent i sees j, by (i, j); units."""


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """Everything the figures of one run need. Without truth or recording the parts that need it are
    empty."""

    name: str
    run: Run
    manifest: Manifest
    flight: Flight
    heard: Heard
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
    def links(self) -> tuple[tuple[int, int], ...]:
        """The start graph, by id."""
        return edges({agent.id: agent.neighbours for agent in self.plan.agents})

    def column(self, agent: int) -> int:
        """Its column in the flight."""
        return self.agents.index(agent)

    def errors(self) -> Floats:
        """e_i [m] in the form step of each moment (T, n, 2); nan before the first, and for agents
        not flying."""
        found = np.full(self.flight.points_m.shape, np.nan)
        for k, step in enumerate(self.plan.steps, start=1):
            start_s = self.run.start_s(k)
            if isinstance(step, FormStep) and math.isfinite(start_s):
                from_here = self.flight.time_s >= start_s
                slots = self._turned(
                    np.array(step.slots) * self.plan.unit_m, self.flight.time_s[from_here]
                )
                roles = self.run.roles(self.flight.time_s[from_here])
                found[from_here] = self.flight.points_m[from_here] - np.take_along_axis(
                    slots, roles[..., None], axis=1
                )
        found[~self.flight.live] = np.nan
        found[self.flight.time_s > self.run.landing_s()] = np.nan
        return found

    def _turned(self, slots_m: Floats, time_s: Floats) -> Floats:
        """The slots (n, 2) as the swarm's frame had them turned and scaled at each moment, (T, n,
        2)."""
        told = next(
            (
                t
                for _, states in sorted(self.heard.states.items())
                if (t := [s for s in states if s.frame])
            ),
            [],
        )
        centre = slots_m.mean(axis=0)
        if not told:
            return np.broadcast_to(slots_m, (len(time_s), *slots_m.shape))
        at = np.searchsorted([s.time_s for s in told], time_s, side="right") - 1
        frames = [s.frame for s in told if s.frame]
        turns = np.array([frame.scale * np.exp(1j * frame.angle_rad) for frame in frames])
        turns = np.where(at >= 0, turns[np.maximum(at, 0)], 1.0)
        z = (slots_m - centre) @ np.array([1.0, 1.0j])
        turned = turns[:, None] * z
        return np.asarray(np.stack((turned.real, turned.imag), axis=-1) + centre)

    def nearest(self) -> Floats:
        """Distance [m] of each live agent to the nearest other vehicle, on the ground or not (T,
        n); nan: none."""
        points = self.flight.points_m
        apart = np.linalg.norm(points[:, :, None] - points[:, None], axis=-1)
        apart[np.isnan(apart)] = np.inf
        apart[~self.flight.live] = np.inf
        apart[:, np.arange(points.shape[1]), np.arange(points.shape[1])] = np.inf
        least = apart.min(axis=-1, initial=np.inf)
        return np.where(np.isfinite(least), least, np.nan)

    def lengths(self) -> Floats:
        """Length [m] of each link while both ends fly (T, links)."""
        columns = [(self.column(i), self.column(j)) for i, j in self.links]
        points, live = self.flight.points_m, self.flight.live
        if not columns:
            return np.zeros((len(points), 0))
        found = [np.where(live[:, i] & live[:, j], np.linalg.norm(points[:, i] - points[:, j], axis=-1), np.nan)
                 for i, j in columns]  # fmt: skip
        return np.stack(found, axis=-1)


def read_history(folder: Path) -> History:
    """Read a run folder; a recording that was cut off gets its footer first. InputError where there
    is no manifest."""
    run = read_run(folder)
    if run.manifest is None:
        raise InputError(f"{folder}: is no run folder: {run.notes[0]}")
    notes = list(run.notes)
    heard = _heard(folder, notes)
    n = len(run.manifest.plan.agents)
    flight = run.flight or Flight(
        np.zeros(0), np.zeros((0, n, 2)), np.zeros((0, n), dtype=np.bool_)
    )
    return History(folder.resolve().name, run, run.manifest, flight, heard, tuple(notes))


def _heard(folder: Path, notes: list[str]) -> Heard:
    heard = Heard()
    if not (folder / RECORDING).exists():
        notes.append(f"{RECORDING}: there is none; figures of what was said are left out")
        return heard
    if recover(folder):
        notes.append(f"{RECORDING}: was cut off; recovered up to its last second")
    for _, payload in read(folder):
        match payload:
            case AgentState():
                heard.states.setdefault(payload.agent, []).append(payload)
            case AgentStatus():
                heard.statuses.setdefault(payload.agent, []).append(payload)
            case SigmaReport():
                for pair in payload.pairs:
                    row = (payload.time_s, pair.distance, pair.sigma)
                    heard.sigmas.setdefault((payload.agent, pair.peer), []).append(row)
    return heard
