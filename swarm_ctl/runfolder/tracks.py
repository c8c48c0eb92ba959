"""What the vehicles told of themselves, from the recording: the agents' states and statuses."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from swarm_ctl.core.model.messages import AgentState, AgentStatus, Phase
from swarm_ctl.core.model.timeouts import NEIGHBOUR_S
from swarm_ctl.core.swarm.in_plan import InPlan
from swarm_ctl.recording.mcap_reader import messages, payload_of
from swarm_ctl.recording.mcap_records import RecordingDamage
from swarm_ctl.runfolder.truth import Bools, Floats

KNOWN_S: Final = NEIGHBOUR_S
"""Between two states this far apart at most, a vehicle flew straight; else its place is unknown."""
ONE_CLOCK_S: Final = 1.0
"""An agent's clock that differs less from the station's is the same one, and delays are small."""
_NO_WORD: Final = (Phase.CONNECT, Phase.PREPARE)
"""Of an agent that has just started: it does not know its vehicle yet."""


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """One vehicle by its own word: M states and K statuses, in the order of their times [s]."""

    time_s: Floats
    """(M,)"""
    position_ned_m: Floats
    """(M, 3)"""
    velocity_ned_mps: Floats
    """(M, 3)"""
    told_s: Floats
    """(K,)"""
    armed: Bools
    """(K,)"""
    airborne: Bools
    """(K,)"""
    accuracy_m: Floats
    """(K,) horizontal; nan where the vehicle says none."""
    height_m: Floats
    """(K,) above the take-off point; nan where it is not known."""

    def motion(self, time_s: Floats) -> tuple[Floats, Floats, Floats]:
        """Position (T, 3), descent [m/s] (T,) and doubt [m] (T,) at these times; nan where there
        is no state within `KNOWN_S`.

        The doubt is twice the vehicle's own accuracy (one standard deviation), where it says one,
        and what it flies at its speed in half the time between two states.
        """
        if len(self.time_s) < 2:
            return np.full((len(time_s), 3), np.nan), *(np.full(len(time_s), np.nan),) * 2
        right = np.clip(np.searchsorted(self.time_s, time_s), 1, len(self.time_s) - 1)
        gap_s = self.time_s[right] - self.time_s[right - 1]
        inside = (time_s >= self.time_s[0]) & (time_s <= self.time_s[-1])
        known = np.where(inside & (gap_s <= KNOWN_S), 1.0, np.nan)
        position, velocity = (
            np.stack([np.interp(time_s, self.time_s, values[:, k]) for k in range(3)], axis=-1)
            for values in (self.position_ned_m, self.velocity_ned_mps)
        )
        doubt = 0.5 * gap_s * np.hypot(velocity[:, 0], velocity[:, 1]) + self._accuracy(time_s)
        return position * known[:, None], velocity[:, 2] * known, doubt * known

    def arming(self, time_s: Floats) -> tuple[Bools, Bools]:
        """Armed and airborne (T,), each by the vehicle's last word before."""
        last = np.searchsorted(self.told_s, time_s, side="right") - 1
        told = last >= 0
        if not len(self.told_s):
            return told, told
        return self.armed[last] & told, self.airborne[last] & told

    def gaps(self) -> Iterator[tuple[float, float]]:
        """(since when, for how long) [s] its place was not known while it was in the air."""
        steps = np.diff(self.time_s)
        for k in np.flatnonzero(steps > KNOWN_S).tolist():
            _, airborne = self.arming(self.time_s[k : k + 1])
            if airborne[0]:
                yield float(self.time_s[k]), float(steps[k])

    def _accuracy(self, time_s: Floats) -> Floats:
        there = np.isfinite(self.accuracy_m)
        if not there.any():
            return np.zeros(len(time_s))
        return np.asarray(2.0 * np.interp(time_s, self.told_s[there], self.accuracy_m[there]))


_STEPS_S: Final = 600.0
"""A clock that differs by so much from one message to another is not one clock: no flight lasts as
long as it would seem."""


@dataclass(slots=True)
class _Process:
    """What one process of an agent told: its clock is its own."""

    states: list[AgentState] = field(default_factory=list)
    statuses: list[AgentStatus] = field(default_factory=list)
    behind_s: float = np.inf
    """The station's clock less the process's, at least."""

    def take(self, payload: AgentState | AgentStatus, received_s: float) -> None:
        behind_s = received_s - payload.time_s
        if self.states and abs(behind_s - self.behind_s) > _STEPS_S:
            return  # by another clock than its own
        self.behind_s = min(self.behind_s, behind_s)
        if isinstance(payload, AgentState):
            self.states.append(payload)
        elif payload.phase not in _NO_WORD:
            self.statuses.append(payload)

    def offset_s(self, one_clock_s: float) -> float:
        """What makes its times the station's; 0 where both have one clock, which differs by less
        than `one_clock_s`."""
        return self.behind_s if abs(self.behind_s) > one_clock_s else 0.0


def read_tracks(
    folder: Path,
    agents: Iterable[int],
    *,
    elsewhere: bool = False,
    damage: RecordingDamage | None = None,
    in_plan: InPlan | None = None,
) -> dict[int, Track]:
    """The track of each of `agents` that the recording has. `elsewhere`: the agents' clocks
    are not the station's. `damage` notes what can't be read. What names more than the plan has
    is left out. InputError without a recording."""
    processes: dict[int, list[_Process]] = {agent: [] for agent in agents}
    for message in messages(folder, damage):
        if not message.topic.endswith(("/state", "/status")):
            continue
        payload = payload_of(message.topic, message.data)
        if isinstance(payload, AgentState | AgentStatus) and payload.agent in processes:
            if in_plan is not None and in_plan.unknown(payload):
                continue
            found = processes[payload.agent]
            if not found or _is_new(payload, found[-1]):
                found.append(_Process())
            found[-1].take(payload, message.time_s)
    one_clock_s = 0.0 if elsewhere else ONE_CLOCK_S
    return {agent: _track(found, one_clock_s) for agent, found in processes.items() if found}


def _is_new(payload: AgentState | AgentStatus, process: _Process) -> bool:
    """A process that starts numbers its states anew."""
    states = process.states
    return isinstance(payload, AgentState) and bool(states) and payload.seq < states[-1].seq // 2


def _track(processes: list[_Process], one_clock_s: float) -> Track:
    offsets = [(p, p.offset_s(one_clock_s)) for p in processes]
    states = {s.time_s + offset_s: s for p, offset_s in offsets for s in p.states}
    statuses = {s.time_s + offset_s: s for p, offset_s in offsets for s in p.statuses}
    moved, told = sorted(states.items()), sorted(statuses.items())

    def figures(name: str) -> Floats:
        return np.array([getattr(s, name) for _, s in told], dtype=np.float64)

    return Track(
        time_s=np.array([t for t, _ in moved]),
        position_ned_m=np.array([s.position_ned_m for _, s in moved]).reshape(-1, 3),
        velocity_ned_mps=np.array([s.velocity_ned_mps for _, s in moved]).reshape(-1, 3),
        told_s=np.array([t for t, _ in told]),
        armed=np.array([s.armed for _, s in told], dtype=np.bool_),
        airborne=np.array([s.airborne for _, s in told], dtype=np.bool_),
        accuracy_m=figures("position_accuracy_m"),
        height_m=figures("height_m"),
    )
