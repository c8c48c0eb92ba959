"""The last status of each agent: the one it wrote at its end, or the last one the station heard."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, TypeVar

from pydantic import TypeAdapter, ValidationError

from swarm_ctl.core.model.messages import Ack, AgentStatus, Command, Event, Outcome, StepResult
from swarm_ctl.core.model.text import escaped
from swarm_ctl.files import read_bytes
from swarm_ctl.recording.run_recorder import TROUBLES
from swarm_ctl.runfolder.files import Damage, read_lines

FINAL: Final = "agents"
"""Folder of one `<id>.json` per agent: its last AgentStatus, written by the agent at its end,
or by a station that judges agents of other hosts."""
STATUSES: Final = "statuses.jsonl"
"""Of the AgentStatus that the station heard some of each agent, all in which its zones are others
than in the one before, and its last, one JSON object a line."""
EVENTS: Final = "events.jsonl"
"""Every Event the station heard, one JSON object a line."""

COMMANDS: Final = "commands.jsonl"
"""Every Command the station heard or sent and every Ack, one JSON object a line."""

_TOO_MUCH: Final = (OverflowError, RecursionError)
"""Numbers and nesting beyond what Python reads."""
_TROUBLES: Final = 20
"""That are told at most."""
_STATUS_BYTES: Final = 1 << 20
"""Of a last status at most."""
_STATUS: Final = TypeAdapter(AgentStatus)
_EVENT: Final = TypeAdapter(Event)
_COMMAND: Final = TypeAdapter[Command | Ack](Command | Ack)
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class LastStatus:
    """The last that is known of one agent."""

    status: AgentStatus
    final: bool
    """Written by the agent itself at its end; otherwise the station heard it last."""
    successor: bool = False
    """The process was killed, another flew the vehicle on and told its end: final, too."""
    from_air: bool = False
    """By the last word of the process that was killed, its vehicle was in the air."""

    def step(self, k: int) -> StepResult | None:
        """The result of step k (0: prepare) for this agent; None where it did not get there."""
        return self.status.steps[k] if k < len(self.status.steps) else None


def read_last_statuses(
    folder: Path,
    statuses: Iterable[AgentStatus],
    agents: Iterable[int] | None,
    notes: list[str],
    killed: Collection[int] = (),
) -> dict[int, LastStatus]:
    """The last status of each of `agents` (None: of all agents in the folder); `statuses` are those
    that the station heard.

    `notes` gets a line for each file that is missing or torn. An agent whose process was `killed`
    has none; the end that the station heard is that of a process which took its vehicle over.
    """
    before, heard = of_processes(statuses)
    if agents is None:
        written = (path.stem for path in (folder / FINAL).glob("*.json"))
        agents = sorted({int(name) for name in written if name.isdecimal()} | set(heard))

    def final_of(agent: int) -> AgentStatus | None:
        return _final_status(folder / FINAL / f"{agent}.json", notes)

    return last_statuses(agents, (before, heard), final_of, notes, killed)


def last_statuses(
    agents: Iterable[int],
    processes: tuple[Mapping[int, AgentStatus], Mapping[int, AgentStatus]],
    final_of: Callable[[int], AgentStatus | None],
    notes: list[str],
    killed: Collection[int] = (),
) -> dict[int, LastStatus]:
    """As `read_last_statuses`, of what was heard (`of_processes`) and what each agent wrote at its
    end, None where it wrote nothing."""
    before, heard = processes
    found: dict[int, LastStatus] = {}
    for agent in agents:
        if agent in killed and agent in heard and _succeeded(before[agent], heard[agent]):
            found[agent] = LastStatus(heard[agent], True, True, before[agent].airborne)
            continue
        final = final_of(agent)
        if final is not None:
            found[agent] = LastStatus(final, final=True)
        elif agent in heard:
            last_s = heard[agent].time_s
            notes.append(f"agent {agent}: its last status heard, of {last_s:.1f} s, stands in")
            found[agent] = LastStatus(heard[agent], final=False)
        else:
            notes.append(f"agent {agent}: no status is known")
    return found


def flying_successors(folder: Path, killed: Collection[int]) -> dict[int, float]:
    """The agents whose process was `killed` and whose vehicle another one flies: when the station
    heard its last status, by its own clock [s]."""
    before, heard = of_processes(read_statuses(folder, []))
    return {
        agent: heard[agent].time_s
        for agent in killed
        if agent in heard
        and heard[agent].outcome is Outcome.RUNNING
        and _is_another(before[agent], heard[agent])
    }


def of_processes(
    statuses: Iterable[AgentStatus],
) -> tuple[dict[int, AgentStatus], dict[int, AgentStatus]]:
    """Of each agent that was heard, the last status of its first process, and the last status of
    all."""
    before, last = dict[int, AgentStatus](), dict[int, AgentStatus]()
    for status in statuses:
        if not _is_another(before.setdefault(status.agent, status), status):
            before[status.agent] = status
        last[status.agent] = status
    return before, last


def _is_another(before: AgentStatus, last: AgentStatus) -> bool:
    """The last status is of another process than the one before: its flight began later."""
    began = [status.steps[0].start_s if status.steps else None for status in (before, last)]
    return began[0] != began[1]


def _succeeded(before: AgentStatus, last: AgentStatus) -> bool:
    return last.outcome is not Outcome.RUNNING and _is_another(before, last)


def shifted(status: AgentStatus, by_s: float) -> AgentStatus:
    """The status with all times of its flight so much later."""

    def moved(step: StepResult) -> StepResult:
        end_s = None if step.end_s is None else step.end_s + by_s
        return replace(step, start_s=step.start_s + by_s, end_s=end_s)

    left = status.left
    return replace(
        status,
        time_s=status.time_s + by_s,
        steps=tuple(map(moved, status.steps)),
        roles=tuple((since_s + by_s, role) for since_s, role in status.roles),
        closings=tuple((at_s + by_s, fewer, k) for at_s, fewer, k in status.closings),
        left=left and replace(left, time_s=left.time_s + by_s),
    )


def read_statuses(folder: Path, notes: list[str]) -> Iterator[AgentStatus]:
    """Those of `STATUSES`, as `read_events`."""
    return _read(folder / STATUSES, _STATUS, notes)


def read_events(folder: Path, notes: list[str]) -> Iterator[Event]:
    """The station's events in their order; a missing or torn file goes to `notes` at the end."""
    return _read(folder / EVENTS, _EVENT, notes)


def read_commands(folder: Path, notes: list[str]) -> Iterator[Command | Ack]:
    """The commands that the station heard or sent, and their answers, as `read_events`."""
    return _read(folder / COMMANDS, _COMMAND, notes)


def read_troubles(folder: Path) -> list[str]:
    """What of all that only shows went wrong at the station, in words; none without the file."""
    found = list[str]()
    with contextlib.suppress(OSError):
        for line in read_lines(folder / TROUBLES, Damage()):
            with contextlib.suppress(ValueError, TypeError, KeyError, *_TOO_MUCH):
                said = json.loads(line)
                how = "stopped" if said["off"] else "failed"
                words = f"{said['part']} {how} at {float(said['time_s']):.1f} s: {said['why']}"
                found.append(escaped(words))
    return found[:_TROUBLES]


def _final_status(path: Path, notes: list[str]) -> AgentStatus | None:
    name = f"{path.parent.name}/{path.name}"
    try:
        return _STATUS.validate_json(read_bytes(path, _STATUS_BYTES))
    except FileNotFoundError:
        notes.append(f"agent {path.stem}: it left no account of its end ({name})")
    except OSError as error:
        notes.append(f"{name}: {error.strerror}")
    except ValidationError:
        notes.append(f"{name}: torn, or not an agent's status")
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
