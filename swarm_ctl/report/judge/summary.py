"""`summary.json`: what came out of one run, in numbers that other tools read. The models are its
JSON Schema."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final, Literal, TypeAlias

from pydantic import BaseModel, ConfigDict, ValidationError

from swarm_ctl.core.model.messages import TickReport
from swarm_ctl.errors import InputError
from swarm_ctl.report.folder.files import wording, write_whole

SUMMARY: Final = "summary.json"

Outcome: TypeAlias = Literal["completed", "failed", "aborted"]
Result: TypeAlias = Literal["done", "running", "aborted", "timeout", "not reached"]
AgentPair: TypeAlias = tuple[int, int]
"""Two agent ids, the lower first."""


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)


class StepSummary(_Part):
    """One step of the plan, over all agents. Times are mission seconds."""

    step: int
    """0 is preparation."""
    name: str
    result: Result
    """`done` only if it was done for every agent; otherwise the worst of the agents' results."""
    start_s: float | None
    """When the first agent began."""
    end_s: float | None
    """When the last agent ended, of those that did."""
    exceptions: dict[int, str]
    """Result of each agent (by id) for which it was not done; empty where nobody got here."""
    time_to_form_s: float | None = None
    """Of a form step: from `start_s` until the true error stays under the tolerance for the settle
    time."""


class AgentSummary(_Part):
    """One agent's account."""

    agent: int
    sysid: int | None
    account: Literal["final", "last heard", "none"]
    """Written by the agent at its end; else what the station last heard of it; else nothing."""
    time_s: float | None
    """When the account was made, mission time."""
    outcome: str
    """`completed`, `failed`, `aborted`, `running` (it did not live to its end) or `unknown`."""
    reason: str
    phase: str
    armed: bool | None
    airborne: bool | None
    setpoints: int
    setpoint_rate_hz: float | None
    """Per mission second."""
    sigma_status: dict[str, int]
    """Pair-ticks by status."""
    overspeed: int
    """Ticks with a pair for which consensus alone leaves the safety region."""
    tick: TickReport
    bad_payloads: int


class SafetySummary(_Part):
    """What the safety filter did, all agents (`core/safety/constraints.py`)."""

    ticks: int
    """Agent-ticks in which it was asked."""
    touched: int
    """In which it changed the wish."""
    yielded: int
    """In which the keep-outs excluded each other, and all gave way a little."""
    releases: int
    """Times an agent was stuck and went sideways."""
    exchanges: int
    """Pairs of agents that took each other's slots."""


class LinkSummary(_Part):
    """One mesh link, as its receiver counted it over the run."""

    receiver: int
    sender: int
    age_p50_s: float | None
    age_p99_s: float | None
    received: int
    lost: int
    loss: float | None
    """Share (0..1) of the states sent that did not arrive; None where nothing was ever heard."""


class TruthSummary(_Part):
    """What the simulator's truth file holds."""

    samples: int
    complete: bool
    """The simulator finished it."""
    first_liftoff_s: float | None
    last_touchdown_s: float | None
    collisions: tuple[int, ...]
    """Sysids of vehicles that hit something."""


class Summary(_Part):
    """The summary of one run. What could not be told is null, and `notes` says why."""

    schema_version: Literal[1] = 1
    mission: str | None
    """The plan's name."""
    mission_file: str | None
    plan_hash: str | None
    swarm: str | None
    started_at: str | None
    """ISO 8601."""
    outcome: Outcome
    """`completed`: every agent says so, every process ended with 0, nothing is missing here;
    `aborted`: landed on an operator's command; `failed`: everything else."""
    reason: str
    """Why it was not completed; empty otherwise."""
    steps: tuple[StepSummary, ...]
    time_to_form_s: float | None
    """Of the first form step: from its start until the true formation error stays under the
    tolerance for the settle time; null if it never did."""
    formation_error_m: float | None
    """Largest |e_i - mean e| of the live agents, from truth, at the last moment before the landing
    begins."""
    min_true_distance_m: float | None
    """Smallest true horizontal distance of any two vehicles, first lift-off to last touchdown."""
    min_true_pair: AgentPair | None
    r_in_m: float | None
    longest_link_m: float | None
    """Greatest true horizontal distance of a planned neighbour pair, from the first form step to
    the landing."""
    longest_link_pair: AgentPair | None
    r_m: float | None
    sigma_status: dict[str, int]
    """Pair-ticks by status, all agents."""
    overspeed: int
    """Ticks with an overspeed pair, all agents."""
    safety: SafetySummary | None = None
    """Null where the mission flies without the filter, or no agent left an account."""
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
    """By process; negative: ended by that signal. Null where whoever wrote this did not know
    them."""
    speedup: float | None
    mission_time_s: float | None
    """Until the last thing on record."""
    wall_time_s: float | None
    """The same at the wall clock."""
    versions: dict[str, str]
    notes: tuple[str, ...]
    """What was missing or torn when this was written."""


def summary_schema() -> dict[str, Any]:
    """The JSON Schema of `summary.json`."""
    return Summary.model_json_schema()


def write_summary(folder: Path, summary: Summary) -> Path:
    """Write `summary.json` into the run folder, whole or not at all; where it is."""
    path = folder / SUMMARY
    write_whole(path, summary.model_dump_json(indent=2) + "\n")
    return path


def read_summary(folder: Path) -> Summary:
    """Read `summary.json`; InputError where it is missing or not a summary."""
    path = folder / SUMMARY
    try:
        return Summary.model_validate_json(path.read_bytes())
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from error
    except ValidationError as error:
        raise InputError(f"{path}: {wording(error)}") from error
