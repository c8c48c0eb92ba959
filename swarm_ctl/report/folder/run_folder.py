"""A run folder, read once, for summary, report and figures."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from swarm_ctl.core.model.messages import AgentStatus, StepOutcome
from swarm_ctl.core.model.plan import FormStep, LandStep, Plan, ReturnStep
from swarm_ctl.errors import InputError
from swarm_ctl.report.folder.last_statuses import LastStatus, read_last_statuses
from swarm_ctl.report.folder.manifest import Manifest, read_manifest
from swarm_ctl.report.folder.metrics import TrueFlight, flight_of
from swarm_ctl.report.folder.truth import TRUTH, Floats, Truth, load_truth


@dataclass(frozen=True, slots=True, eq=False)
class RunFolder:
    """What the folder has; `notes` says what is missing or torn."""

    manifest: Manifest | None
    truth: Truth | None
    flight: TrueFlight | None
    """The truth with one column per agent; needs manifest and truth."""
    agents: tuple[int, ...]
    """The plan's; without a manifest, those that left a trace."""
    last: dict[int, LastStatus]
    """By agent; without an entry nothing is known of the agent."""
    notes: list[str]

    @property
    def plan(self) -> Plan | None:
        """The manifest's."""
        return self.manifest.plan if self.manifest else None

    @property
    def statuses(self) -> list[AgentStatus]:
        """The last one of each agent."""
        return [last.status for last in self.last.values()]

    @property
    def form_steps(self) -> list[int]:
        """The numbers of the plan's form steps, from 1."""
        steps = enumerate(self.plan.steps if self.plan else (), 1)
        return [k for k, step in steps if isinstance(step, FormStep)]

    def slot_indices(self, time_s: Floats) -> npt.NDArray[np.intp]:
        """The slot index of each agent at each moment, (T, n); exchanges change it."""
        found = np.tile(np.arange(len(self.agents)), (len(time_s), 1))
        for k, agent in enumerate(self.agents):
            for since_s, index in self.last[agent].status.roles if agent in self.last else ():
                if 0 <= index < len(self.agents):
                    found[time_s >= since_s, k] = index
        return found

    def start_s(self, k: int) -> float:
        """When the first agent began step k; inf: no agent did."""
        found = (last.step(k) for last in self.last.values())
        return min((result.start_s for result in found if result), default=math.inf)

    def landing_s(self) -> float:
        """When the landing began, by plan or because an agent broke its step off; inf: unknown."""
        steps = self.plan.steps if self.plan else ()
        planned = (
            self.start_s(k)
            for k, step in enumerate(steps, 1)
            if isinstance(step, LandStep | ReturnStep)
        )
        broken = (
            result.end_s
            for status in self.statuses
            for result in status.steps
            if result.result in (StepOutcome.ABORTED, StepOutcome.TIMEOUT)
            and result.end_s is not None
        )
        return min([*planned, *broken], default=math.inf)


def read_run(folder: Path) -> RunFolder:
    """Read what there is of manifest, truth and statuses; never raises, `notes` has the reasons."""
    notes: list[str] = []
    manifest = _manifest(folder, notes)
    truth = _truth(folder, manifest, notes)
    planned = tuple(agent.id for agent in manifest.plan.agents) if manifest else None
    last = read_last_statuses(folder, planned, notes)
    flight = _flight(truth, manifest, last) if truth and manifest else None
    return RunFolder(manifest, truth, flight, planned or tuple(last), last, notes)


def _manifest(folder: Path, notes: list[str]) -> Manifest | None:
    try:
        return read_manifest(folder)
    except InputError as error:
        notes.append(str(error))
        return None


def _truth(folder: Path, manifest: Manifest | None, notes: list[str]) -> Truth | None:
    try:
        truth = load_truth(folder / TRUTH)
    except OSError as error:
        notes.append(f"{TRUTH}: {error.strerror}")
        return None
    notes += truth.damage.describe(TRUTH)
    if not truth.complete:
        notes.append(f"{TRUTH}: no end line, the simulator did not finish it")
    if manifest is not None:
        strange = set(truth.sysids) ^ {agent.sysid for agent in manifest.fleet}
        if strange:
            sysids = ", ".join(map(str, sorted(strange)))
            notes.append(f"{TRUTH}: it and the fleet do not agree about sysid {sysids}")
    return truth


def _flight(truth: Truth, manifest: Manifest, last: dict[int, LastStatus]) -> TrueFlight:
    agents = [agent.id for agent in manifest.plan.agents]
    sysid = {agent.id: agent.sysid for agent in manifest.fleet}
    until_s = [_live_until(last.get(i), manifest.plan) for i in agents]
    return flight_of(truth, [sysid[i] for i in agents], until_s)


def _live_until(last: LastStatus | None, plan: Plan) -> float:
    """An agent without a final status lives until its peers count it as lost."""
    if last is None:
        return -math.inf
    return math.inf if last.final else last.status.time_s + plan.policies.agent_lost_after_s
