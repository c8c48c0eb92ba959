"""What the agents said of themselves: their final accounts, and what the station last heard where
one is missing."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeVar

from pydantic import TypeAdapter, ValidationError

from swarm_ctl.core.model.messages import AgentStatus, Event, StepResult
from swarm_ctl.report.folder.files import Damage, read_lines

ACCOUNTS: Final = "agents"
"""Folder of one `<id>.json` per agent: its last AgentStatus, written by itself at its end."""
STATUSES: Final = "statuses.jsonl"
"""Every AgentStatus the station heard, one JSON object a line."""
EVENTS: Final = "events.jsonl"
"""Every Event the station heard, one JSON object a line."""

_STATUS: Final = TypeAdapter(AgentStatus)
_EVENT: Final = TypeAdapter(Event)
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Account:
    """The last that is known of one agent."""

    status: AgentStatus
    final: bool
    """Written by the agent itself at its end; otherwise it is what the station last heard."""

    def step(self, k: int) -> StepResult | None:
        """How step k (0: prepare) went for this agent; None where it did not get there."""
        return self.status.steps[k] if k < len(self.status.steps) else None


def read_accounts(
    folder: Path, agents: Iterable[int] | None, notes: list[str]
) -> dict[int, Account]:
    """The account of each of `agents` (None: of whoever left one); what is missing or torn goes to
    `notes`."""
    heard = {status.agent: status for status in _read(folder / STATUSES, _STATUS, notes)}
    if agents is None:
        left = (path.stem for path in (folder / ACCOUNTS).glob("*.json"))
        agents = sorted({int(name) for name in left if name.isdecimal()} | set(heard))
    found: dict[int, Account] = {}
    for agent in agents:
        final = _final_account(folder / ACCOUNTS / f"{agent}.json", notes)
        if final is not None:
            found[agent] = Account(final, final=True)
        elif agent in heard:
            notes.append(
                f"agent {agent}: its last status heard, of {heard[agent].time_s:.1f} s, stands in"
            )
            found[agent] = Account(heard[agent], final=False)
        else:
            notes.append(f"agent {agent}: nothing is known of it")
    return found


def read_events(folder: Path, notes: list[str]) -> Iterator[Event]:
    """The station's events, in the order they were heard; what is missing or torn goes to `notes`
    at the end."""
    return _read(folder / EVENTS, _EVENT, notes)


def _final_account(path: Path, notes: list[str]) -> AgentStatus | None:
    name = f"{path.parent.name}/{path.name}"
    try:
        return _STATUS.validate_json(path.read_bytes())
    except OSError as error:
        notes.append(f"{name}: {error.strerror}")
    except ValidationError:
        notes.append(f"{name}: torn, or no account of an agent")
    return None


def _read(path: Path, adapter: TypeAdapter[T], notes: list[str]) -> Iterator[T]:
    damage = Damage()
    try:
        for line in read_lines(path, damage):
            try:
                yield adapter.validate_json(line)
            except ValidationError:
                damage.bad_lines += 1
    except OSError as error:
        notes.append(f"{path.name}: {error.strerror}")
    notes += damage.describe(path.name)
