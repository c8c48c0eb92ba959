"""The outcome of a run, and why: completed, aborted or failed."""

from __future__ import annotations

import math
import signal
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final, NamedTuple

from swarm_ctl.core.model.causes import Cause
from swarm_ctl.core.model.messages import AgentStatus, Outcome, StepOutcome
from swarm_ctl.core.model.plan import EVERYONE, Plan
from swarm_ctl.core.model.route import Routes
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.report.judge.summary import RunOutcome
from swarm_ctl.report.judge.unseen import bad_links, slow_machine
from swarm_ctl.runfolder.files import first_few
from swarm_ctl.runfolder.last_statuses import LastStatus
from swarm_ctl.runfolder.run_folder import RunFolder

_ORDERLY: Final = frozenset({0, 1, 130})
"""Exit codes of processes that ended by themselves: done, failed, aborted."""


class Verdict(NamedTuple):
    """Of a run."""

    outcome: RunOutcome
    reason: str
    """The cause first; '' when completed."""
    cause: Cause | None
    """None when completed."""


_OF_ENDING: Final = (Cause.ORDER, Cause.STARTER)
"""Why agents land when the run is ended: by the station's word, or for want of a lifeline."""


class Ending(NamedTuple):
    """What ended a run from outside, by the word of the process that started it."""

    words: str
    """"Ctrl-C", "SIGTERM", "the terminal was closed", or why it did not start."""
    at_once: bool = False
    """By a second Ctrl-C: all processes were killed."""
    failed: bool = False
    """It did not start."""


_BY_SLOWNESS: Final = frozenset(
    {Cause.TIMEOUT, Cause.PEER, Cause.STATION, Cause.VEHICLE_LINK, Cause.POSITION, Cause.FINDING}
)
"""What a machine that does not keep up may bring about."""
_FOLLOWS: Final = frozenset({None, Cause.PEER, Cause.ORDER, Cause.STARTER})
"""Causes that came from elsewhere: another agent, or whoever ends the flight."""
_HEARD_S: Final = 1.0
"""All agents hear an order within a second: who fails on the way that it was sent had broken its
mission off by that order, up to so long before the last one did."""
_BY_LINKS: Final = frozenset({Cause.TIMEOUT, Cause.PEER})


def judge(
    run: RunFolder,
    exit_codes: Mapping[str, int],
    found: Sequence[str] = (),
    ending: Ending | None = None,
    refused: Sequence[str] = (),
) -> Verdict:
    """The run's verdict. Its notes say what is missing or torn; `found` is what makes it failed
    whatever the agents say, and comes first, but for what may have brought that about.

    Completed needs every agent's own final status, every exit code 0 and no missing file. Aborted
    needs a final status of every agent, and every process to end by itself, and that no agent had
    failed by itself before the order. The exit code of a
    process does not count where another took its vehicle over and completed. An agent that left by
    an operator's order does not count where others flew on. `ending` is the cause of all that
    followed from it. `refused` fails the run, too, and comes behind what agents failed by.
    """
    if ending is not None and not found and (ended := _ended(run, ending)):
        return ended
    agents, last = run.agents, run.last
    replaced = {f"agent-{i}" for i in agents if i in last and _made_good(last[i])}
    exit_codes = {name: code for name, code in exit_codes.items() if name not in replaced}
    final = {i: last[i].status for i in agents if i in last and last[i].final}
    stayed = {i: s for i, s in final.items() if not has_left(s)} or final
    aborted = {i: s for i, s in stayed.items() if s.outcome is Outcome.ABORTED}
    # An agent that sees its peers land before it hears the command reports a failure.
    if (
        not found
        and not refused
        and aborted
        and not _failed_before(stayed, aborted)
        and len(final) == len(agents)
        and _ORDERLY.issuperset(exit_codes.values())
    ):
        reasons = _grouped(run.plan, {i: (s, s.reason or "on command") for i, s in aborted.items()})
        cause = next((s.cause for s in aborted.values() if s.cause), Cause.ORDER)
        if ending is not None:
            others = {i: (s, s.reason) for i, s in aborted.items() if s.cause not in _OF_ENDING}
            reasons = [f"{ending.words}: all landed", *_grouped(run.plan, others)]
        return Verdict(Outcome.ABORTED, first_few(reasons), cause)
    causes = [*_broken(run, final, exit_codes)]
    fell = bool(causes) or any(s.outcome is Outcome.FAILED for s in stayed.values())
    causes += _complaints(run.plan, stayed)
    orders = [(Cause.FINDING, text) for text in refused]
    causes = causes + orders if fell else orders + causes
    causes[:0] = [(Cause.FINDING, text) for text in found]
    causes += [
        (Cause.PROCESS, f"{name} exited with {code}")
        for name, code in exit_codes.items()
        if code > 1 or (code == 1 and (not final or not causes))
    ]
    causes += [] if agents else [(Cause.PROCESS, "no agent is known")]
    causes = causes or [(Cause.PROCESS, note) for note in run.notes]
    if not causes:
        return Verdict(Outcome.COMPLETED, "", None)
    reason = first_few([text for _, text in causes])
    unseen, words = _unseen(run, causes[0][0], list(final.values()))
    return Verdict(Outcome.FAILED, f"{words}. {reason}" if words else reason, unseen)


def _failed_before(
    stayed: Mapping[int, AgentStatus], aborted: Mapping[int, AgentStatus]
) -> list[AgentStatus]:
    """The agents that broke the mission off by a cause of their own before the order came."""
    order_s = min(map(_broken_s, aborted.values()))
    failed = (s for s in stayed.values() if s.outcome is Outcome.FAILED)
    return [s for s in failed if s.cause not in _FOLLOWS and _broken_s(s) < order_s - _HEARD_S]


def _ended(run: RunFolder, ending: Ending) -> Verdict | None:
    """The verdict of a run that was ended before it took off, or at once; None of one that landed
    first, whose agents say how."""
    if ending.failed:
        return Verdict(Outcome.FAILED, f"did not start: {ending.words}", Cause.PROCESS)
    if not any(status.armed or len(status.steps) > 1 for status in run.statuses):
        return Verdict(Outcome.ABORTED, f"{ending.words} before take-off", Cause.ORDER)
    up = [i for i in run.agents if i not in run.last or not run.last[i].final]
    if ending.at_once and up:
        vehicles = f"the vehicles of {agents_named(up)} may be in the air"
        return Verdict(Outcome.FAILED, f"ended by a second Ctrl-C: {vehicles}", Cause.ORDER)
    return None


def _unseen(run: RunFolder, cause: Cause, final: Sequence[AgentStatus]) -> tuple[Cause, str]:
    """What brought the cause about, as far as no agent can see it; else the cause itself."""
    made = run.manifest
    if made is None:
        return cause, ""
    machine = slow_machine(final, made.plan, made.speedup) if cause in _BY_SLOWNESS else ""
    if machine:
        return Cause.MACHINE, machine
    links = bad_links(final, made.plan) if cause in _BY_LINKS else ""
    return (Cause.LINK, links) if links else (cause, "")


def has_left(status: AgentStatus) -> bool:
    """Its own part ended as the operator ordered, apart from the others."""
    return status.left is not None and status.outcome is Outcome.ABORTED


def _made_good(last: LastStatus) -> bool:
    return last.successor and last.status.outcome is Outcome.COMPLETED


def _broken(
    run: RunFolder, final: Mapping[int, AgentStatus], exit_codes: Mapping[str, int]
) -> Iterator[tuple[Cause, str]]:
    """Processes that were ended, and agents that left no account."""
    for name, code in exit_codes.items():
        if code < 0:
            yield Cause.PROCESS, f"{name} was ended by {_signal(code)}"
    for i in run.agents:
        if i not in run.last:
            yield Cause.PROCESS, f"agent {i} left no status"
        elif i not in final:
            heard = run.last[i].status
            group = _group(run.plan, heard)
            whose = f" of group {group}" if group else ""
            words = f"last heard at {heard.time_s:.1f} s in phase {heard.phase.name.lower()}"
            yield Cause.PROCESS, f"agent {i}{whose} left no final status; {words}"


def _complaints(plan: Plan | None, final: Mapping[int, AgentStatus]) -> Iterator[tuple[Cause, str]]:
    """Why agents did not complete, each reason once; the cause first, with its step, then the
    agents that followed it. An agent that failed exits with 1: its status says more."""
    incomplete = [s for s in final.values() if s.outcome is not Outcome.COMPLETED]
    incomplete.sort(key=lambda s: (s.cause is Cause.PEER, _broken_s(s)))
    groups: dict[str, list[AgentStatus]] = {}
    for status in incomplete:
        groups.setdefault(_complaint(status), []).append(status)
    for k, (why, same) in enumerate(groups.items()):
        first, where = same[0], ""
        if k == 0 and first.steps and first.cause is not Cause.TIMEOUT:  # that one names its step
            where = f", in step {len(first.steps) - 1} ({first.steps[-1].name})"
        yield first.cause or Cause.VEHICLE, f"{_who(plan, same)}: {why}{where}"


def _who(plan: Plan | None, statuses: Sequence[AgentStatus]) -> str:
    """`agents 1-3`, or where they broke off as agents of groups: `group scouts (agents 1-3) and
    group rest (agent 7)`."""
    found: dict[str, list[int]] = {}
    for status in statuses:
        found.setdefault(_group(plan, status), []).append(status.agent)
    named = [agents_named(found[""])] if "" in found else []
    named += [f"group {name} ({agents_named(ids)})" for name, ids in found.items() if name]
    return " and ".join(named)


def _group(plan: Plan | None, status: AgentStatus) -> str:
    """That the agent flew in last, beside others; else ''."""
    route = Routes(plan).of.get(status.agent) if plan is not None else None
    name = route.group(len(status.steps) - 1).name if route is not None else EVERYONE
    return "" if name == EVERYONE else name


def _broken_s(status: AgentStatus) -> float:
    """When the agent broke the mission off: the first one has the cause, the others follow it."""
    broken = (StepOutcome.ABORTED, StepOutcome.TIMEOUT)
    ends = (step.end_s for step in status.steps[-1:] if step.result in broken)
    return min((end_s for end_s in ends if end_s is not None), default=math.inf)


def _complaint(status: AgentStatus) -> str:
    if status.outcome is Outcome.FAILED and status.reason:
        return status.reason
    return f"{status.outcome}: {status.reason}" if status.reason else str(status.outcome)


def _grouped(plan: Plan | None, reasons: Mapping[int, tuple[AgentStatus, str]]) -> Iterable[str]:
    """`agents 1-3: why`, each reason once."""
    by_reason: dict[str, list[AgentStatus]] = {}
    for status, reason in reasons.values():
        by_reason.setdefault(reason, []).append(status)
    return [f"{_who(plan, same)}: {reason}" for reason, same in by_reason.items()]


def _signal(code: int) -> str:
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"signal {-code}"
