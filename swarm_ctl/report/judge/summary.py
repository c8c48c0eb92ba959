"""`summary.json`: the outcome and the numbers of one run, for other tools."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Final, Literal, TypeAlias

from pydantic import BaseModel, ConfigDict

from swarm_ctl.core.model.causes import Cause
from swarm_ctl.core.model.messages import CommandKind, Outcome, TickReport
from swarm_ctl.report.judge.findings import FindingKind
from swarm_ctl.runfolder.files import read_model, write_model
from swarm_ctl.runfolder.flight import TrackSource
from swarm_ctl.station.picture.protection import MeshKind

SUMMARY: Final = "summary.json"

RunOutcome: TypeAlias = Literal[Outcome.COMPLETED, Outcome.FAILED, Outcome.ABORTED]
AgentPair: TypeAlias = tuple[int, int]
"""Two agent ids, the lower first."""


class StepVerdict(StrEnum):
    """How a step went for an agent or for all agents; from good to bad."""

    DONE = "done"
    SKIPPED = "skipped"
    NOT_REACHED = "not reached"
    RUNNING = "running"
    ABORTED = "aborted"
    TIMEOUT = "timeout"


class _SummaryPart(BaseModel):
    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        defer_build=True,  # parts are read within the summary, which is built as one
    )


class StepSummary(_SummaryPart):
    """One step of the plan, over all agents that fly it. A group that joins early has one step for
    its wait. Times are mission seconds."""

    step: int
    """0 is preparation."""
    name: str
    result: StepVerdict
    """The worst of all agents."""
    start_s: float | None
    """When the first agent began."""
    end_s: float | None
    """When the last agent ended, of the agents that did."""
    exceptions: dict[int, StepVerdict]
    """Of each agent (by id) that did not do it; empty where no agent reached the step."""
    time_to_form_s: float | None = None
    """Of a form step: from `start_s` until the error stays below the tolerance for the settle
    time."""
    group: str = ""
    """Whose step it is, in a mission that splits into groups; else ''."""
    agents: tuple[int, ...] = ()
    """Of that group."""


class AgentSummary(_SummaryPart):
    """One agent by its last status; null and 0 where there is none."""

    agent: int
    sysid: int | None
    account: Literal["final", "last heard", "none"]
    """Where the status is from: the agent at its end, or the station; or there is none."""
    time_s: float | None = None
    """When the agent made the status, mission time."""
    outcome: Outcome | Literal["unknown"] = "unknown"
    """`running`: the agent did not live to its end."""
    reason: str = ""
    cause: Cause | None = None
    """What broke its mission off, or held it up."""
    phase: str = "unknown"
    armed: bool | None = None
    airborne: bool | None = None
    setpoints: int = 0
    setpoint_rate_hz: float | None = None
    """Per mission second."""
    sigma_status: dict[str, int] = {}
    """Pair-ticks by status."""
    overspeed: int = 0
    """Ticks with a pair for which consensus alone leaves the safety region."""
    tick: TickReport = TickReport()
    bad_payloads: int = 0


class LeftSummary(_SummaryPart):
    """An agent that left the formation by an operator's order, and was not lost."""

    agent: int
    order: CommandKind
    time_s: float
    """Mission time."""


class SafetySummary(_SummaryPart):
    """What the safety filter did, all agents (`core/kernel/constraints.py`)."""

    ticks: int
    """Agent-ticks with the filter."""
    touched: int
    """Agent-ticks in which the filter changed the velocity."""
    yielded: int
    """Agent-ticks in which the keep-outs excluded each other, and each was relaxed a little."""
    releases: int
    """Dead-locks that an agent left sideways."""
    exchanges: int
    """Pairs of agents that exchanged their slots."""


class LinkSummary(_SummaryPart):
    """One mesh link over the run, by its receiver's counts."""

    receiver: int
    sender: int
    age_p50_s: float | None
    age_p99_s: float | None
    received: int
    lost: int
    loss: float | None
    """Share (0..1) of the states sent that did not arrive; null if none arrived."""


class FindingSummary(_SummaryPart):
    """What makes the run failed whatever its agents say (docs/look-up/verdict.md)."""

    kind: FindingKind
    time_s: float
    """Mission time."""
    agents: tuple[int, ...]
    text: str


class RefusedSummary(_SummaryPart):
    """An order of the scenario that had to be accepted, and was refused."""

    time_s: float
    """Mission time at which the scenario gives it."""
    order: str
    """As it is typed."""
    why: str
    """By whom, and why."""


class ZoneSummary(_SummaryPart):
    """How close a vehicle came to a zone at whose heights it was."""

    zone: str
    agent: int
    distance_m: float
    """Horizontal; 0: it was in it."""
    time_s: float
    """Mission time."""


class TruthSummary(_SummaryPart):
    """What the simulator's truth file holds."""

    samples: int
    complete: bool
    """The simulator finished the file."""
    first_liftoff_s: float | None
    last_touchdown_s: float | None
    collisions: tuple[int, ...]
    """Sysids of vehicles that hit something."""


class ProtectionSummary(_SummaryPart):
    """What kept others off the swarm."""

    mesh: MeshKind
    operator: str = ""
    """Whose certificate the run's station had: `operator anna`; '' without keys."""
    authenticated: tuple[int, ...] = ()
    """The agents that were heard under their own certificates."""
    signing: bool = False
    """The vehicles' links had to be signed."""
    signed: tuple[int, ...] = ()
    """The agents whose vehicle's link was signed."""


class Summary(_SummaryPart):
    """The summary of one run. What is not known is null, and `notes` says why."""

    schema_version: Literal[1] = 1
    mission: str | None
    """The plan's name."""
    mission_file: str | None
    plan_hash: str | None
    own_law: str = ""
    """NAME@DIGEST of an own law that was flown; '': the paper's."""
    swarm: str | None
    routers: tuple[str, ...] = ()
    """Where routers listened; none of a mesh of peers."""
    started_at: str | None
    """ISO 8601."""
    outcome: RunOutcome
    """`completed`: by the final status of every agent that is not in `left`, nothing in `findings`
    and `refused_orders`, every process ended with 0, no file is missing; `aborted`: landed on an
    operator's command, or ended before take-off; `failed`: everything else."""
    reason: str
    """Why it was not completed, the cause first, then the step; empty otherwise."""
    cause: Cause | None = None
    """The cause alone; null where the run was completed."""
    left: tuple[LeftSummary, ...] = ()
    """The agents that left by an order to some agents, the first one first."""
    findings: tuple[FindingSummary, ...] = ()
    """The earliest first."""
    refused_orders: tuple[RefusedSummary, ...] = ()
    """Of a scenario, the earliest first; each makes the run failed."""
    judged_by: dict[int, TrackSource] = {}
    """Who says where the vehicle of each agent (by id) was."""
    protection: ProtectionSummary | None = None
    """Null where the manifest is not known."""
    steps: tuple[StepSummary, ...]
    time_to_form_s: float | None
    """Of the first form step; null if the shape never stood."""
    formation_error_m: float | None
    """Largest |e_i - mean e| of the live agents, just before the landing begins."""
    min_distance_m: float | None = None
    """Smallest horizontal distance of any two vehicles in the air, by the truth or by the vehicles'
    own estimates; also between samples."""
    min_distance_pair: AgentPair | None = None
    min_distance_doubt_m: float | None = None
    """How far it may be off; 0 by the truth."""
    min_true_distance_m: float | None
    """Smallest true horizontal distance of any two vehicles, first lift-off to last touchdown; null
    without a truth."""
    min_true_pair: AgentPair | None
    r_in_m: float | None
    nearest_zone: ZoneSummary | None = None
    """The closest of all vehicles and zones; null without zones."""
    longest_link_m: float | None
    """Greatest horizontal distance of a planned neighbour pair, from the first form step to the
    landing."""
    longest_link_pair: AgentPair | None
    r_m: float | None
    sigma_status: dict[str, int]
    """Pair-ticks by status, all agents."""
    overspeed: int
    """Ticks with an overspeed pair, all agents."""
    safety: SafetySummary | None = None
    """Null where the mission flies without the filter, or no agent's status is known."""
    setpoint_rate_hz: float | None
    """The slowest agent's, per mission second."""
    tick: TickReport
    """The worst agent's percentiles; counts of all agents."""
    links: tuple[LinkSummary, ...]
    agents: tuple[AgentSummary, ...]
    truth: TruthSummary | None
    events: dict[str, int]
    """Events the station heard, by level."""
    exit_codes: dict[str, int] | None
    """By process; negative: ended by that signal. Null where they are not known."""
    speedup: float | None
    mission_time_s: float | None
    """Until the last message or line of truth."""
    wall_time_s: float | None
    """`mission_time_s` by the wall clock; null for a run in lockstep."""
    versions: dict[str, str]
    warnings: tuple[str, ...] = ()
    """What is no failure and should be known, above all how far estimates may be off."""
    notes: tuple[str, ...]
    """What was missing or torn when this was written."""


def write_summary(folder: Path, summary: Summary) -> Path:
    """Write `summary.json` into the run folder, whole or not at all; its path."""
    return write_model(folder / SUMMARY, summary)


def read_summary(folder: Path) -> Summary:
    """Read `summary.json`; InputError where it is missing or not a summary."""
    return read_model(folder / SUMMARY, Summary)
