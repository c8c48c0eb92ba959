"""A run folder, read once: what every summary, report or figure of that run starts from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from swarm_ctl.core.model.messages import AgentStatus
from swarm_ctl.core.model.plan import LandStep, Plan, ReturnStep
from swarm_ctl.errors import InputError
from swarm_ctl.report.folder.accounts import Account, read_accounts
from swarm_ctl.report.folder.manifest import Manifest, read_manifest
from swarm_ctl.report.folder.metrics import Flight, flight_of
from swarm_ctl.report.folder.truth import TRUTH, Floats, Truth, load_truth


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """What the folder has; `notes` says what is missing or torn."""

    manifest: Manifest | None
    truth: Truth | None
    flight: Flight | None
    """The truth with one column per agent; needs manifest and truth."""
    agents: tuple[int, ...]
    """The plan's; without a manifest, those that left a trace."""
    accounts: dict[int, Account]
    notes: list[str]

    @property
    def plan(self) -> Plan | None:
        """The manifest's."""
        return self.manifest.plan if self.manifest else None

    @property
    def statuses(self) -> list[AgentStatus]:
        """The last one known of each agent."""
        return [account.status for account in self.accounts.values()]

    def roles(self, time_s: Floats) -> npt.NDArray[np.intp]:
        """Whose slots each agent flew to at each moment, (T, n): places in the plan; exchanges
        change them."""
        found = np.tile(np.arange(len(self.agents)), (len(time_s), 1))
        for k, agent in enumerate(self.agents):
            account = self.accounts.get(agent)
            for since_s, role in account.status.roles if account else ():
                if 0 <= role < len(self.agents):
                    found[time_s >= since_s, k] = role
        return found

    def start_s(self, k: int) -> float:
        """When the first agent began step k; inf: nobody did."""
        found = (account.step(k) for account in self.accounts.values())
        return min((result.start_s for result in found if result), default=math.inf)

    def landing_s(self) -> float:
        """When the landing began: the land step, or the first agent that broke its step off; inf:
        neither is known."""
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
            if result.result in ("aborted", "timeout") and result.end_s is not None
        )
        return min([*planned, *broken], default=math.inf)


def read_run(folder: Path) -> Run:
    """Read what there is of manifest, truth and accounts; raises for nothing that a killed process
    leaves behind."""
    notes: list[str] = []
    manifest = _manifest(folder, notes)
    truth = _truth(folder, manifest, notes)
    planned = tuple(agent.id for agent in manifest.plan.agents) if manifest else None
    accounts = read_accounts(folder, planned, notes)
    flight = _flight(truth, manifest, accounts) if truth and manifest else None
    return Run(manifest, truth, flight, planned or tuple(accounts), accounts, notes)


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
            notes.append(
                f"{TRUTH}: it and the fleet do not agree about sysid {', '.join(map(str, sorted(strange)))}"
            )
    return truth


def _flight(truth: Truth, manifest: Manifest, accounts: dict[int, Account]) -> Flight:
    agents = [agent.id for agent in manifest.plan.agents]
    sysid = {agent.id: agent.sysid for agent in manifest.fleet}
    return flight_of(
        truth,
        [sysid[i] for i in agents],
        [_live_until(accounts.get(i), manifest.plan) for i in agents],
    )


def _live_until(account: Account | None, plan: Plan) -> float:
    """An agent that left no account lived as long as it was heard, and a little longer by the
    mission's own rule."""
    if account is None:
        return -math.inf
    return math.inf if account.final else account.status.time_s + plan.policies.agent_lost_after_s
