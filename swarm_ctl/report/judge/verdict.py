"""The outcome of a run, and why: completed, aborted or failed."""

from __future__ import annotations

import math
import signal
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final

from swarm_ctl.core.model.messages import AgentStatus, Outcome, StepOutcome
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.report.folder.files import first_few
from swarm_ctl.report.folder.last_statuses import LastStatus
from swarm_ctl.report.judge.summary import RunOutcome

_ORDERLY: Final = frozenset({0, 1, 130})
"""Exit codes of processes that ended by themselves: done, failed, aborted."""


def judge(
    agents: Sequence[int],
    last: Mapping[int, LastStatus],
    exit_codes: Mapping[str, int],
    notes: Sequence[str],
    found: Sequence[str] = (),
) -> tuple[RunOutcome, str]:
    """The run's outcome and the reason ('' when completed). `notes` say what is missing or torn;
    `found` is what makes it failed whatever the agents say, and comes first.

    Completed needs every agent's own final status, every exit code 0 and no missing file. Aborted
    needs a final status of every agent, and every process to end by itself. The exit code of a
    process does not count where another took its vehicle over and completed.
    """
    replaced = {f"agent-{i}" for i in agents if i in last and _made_good(last[i])}
    exit_codes = {name: code for name, code in exit_codes.items() if name not in replaced}
    final = {i: last[i].status for i in agents if i in last and last[i].final}
    aborted = {i: s for i, s in final.items() if s.outcome is Outcome.ABORTED}
    # An agent that sees its peers land before it hears the command reports a failure.
    if (
        not found
        and aborted
        and len(final) == len(agents)
        and _ORDERLY.issuperset(exit_codes.values())
    ):
        reasons = _grouped({i: s.reason or "on command" for i, s in aborted.items()})
        return Outcome.ABORTED, first_few(reasons)
    causes = [*found, *_causes(agents, last, final, exit_codes)] or [
        f"{name} exited with 1" for name, code in exit_codes.items() if code == 1
    ]
    causes += [] if agents else ["no agent is known"]
    causes = causes or list(notes)
    return (Outcome.FAILED, first_few(causes)) if causes else (Outcome.COMPLETED, "")


def _made_good(last: LastStatus) -> bool:
    return last.successor and last.status.outcome is Outcome.COMPLETED


def _causes(
    agents: Sequence[int],
    last: Mapping[int, LastStatus],
    final: Mapping[int, AgentStatus],
    exit_codes: Mapping[str, int],
) -> Iterator[str]:
    """What made the run fail. An agent that failed exits with 1: its status says more."""
    for name, code in exit_codes.items():
        if code < 0:
            yield f"{name} was ended by {_signal(code)}"
    for i in agents:
        if i not in last:
            yield f"agent {i} left no status"
        elif i not in final:
            heard = last[i].status
            phase = heard.phase.name.lower()
            yield (
                f"agent {i} left no final status; "
                f"last heard at {heard.time_s:.1f} s in phase {phase}"
            )
    incomplete = {i: s for i, s in final.items() if s.outcome is not Outcome.COMPLETED}
    incomplete = dict(sorted(incomplete.items(), key=lambda item: _broken_s(item[1])))
    yield from _grouped({i: _complaint(s) for i, s in incomplete.items()})
    for name, code in exit_codes.items():
        if code > 1 or (code == 1 and not final):
            yield f"{name} exited with {code}"


def _broken_s(status: AgentStatus) -> float:
    """When the agent broke the mission off: the first one has the cause, the others follow it."""
    broken = (StepOutcome.ABORTED, StepOutcome.TIMEOUT)
    ends = (step.end_s for step in status.steps if step.result in broken)
    return min((end_s for end_s in ends if end_s is not None), default=math.inf)


def _complaint(status: AgentStatus) -> str:
    if status.outcome is Outcome.FAILED and status.reason:
        return status.reason
    return f"{status.outcome}: {status.reason}" if status.reason else str(status.outcome)


def _grouped(reasons: Mapping[int, str]) -> Iterable[str]:
    """`agents 1-3: why`, each reason once."""
    by_reason: dict[str, list[int]] = {}
    for i, reason in reasons.items():
        by_reason.setdefault(reason, []).append(i)
    return [f"{agents_named(ids)}: {reason}" for reason, ids in by_reason.items()]


def _signal(code: int) -> str:
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"signal {-code}"
