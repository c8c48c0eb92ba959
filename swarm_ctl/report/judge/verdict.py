"""How a run is called, and why: completed, aborted or failed."""

from __future__ import annotations

import signal
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from swarm_ctl.core.model.text import agents_named
from swarm_ctl.report.folder.accounts import Account
from swarm_ctl.report.judge.summary import Outcome

_ORDERLY: Final = frozenset({0, 1, 130})
"""Exit codes of processes that ended by themselves: done, failed, aborted."""
_SHOWN_CAUSES: Final = 5


def judge(
    agents: Iterable[int],
    accounts: Mapping[int, Account],
    exit_codes: Mapping[str, int] | None,
    notes: Sequence[str],
) -> tuple[Outcome, str]:
    """The run's outcome and the reason ('' when completed). `notes` are what was missing or torn.

    Completed asks for everything: each agent's own word, every exit code 0, nothing missing. An
    operator's landing is one only if every agent lived to tell.
    """
    agents = tuple(agents)
    codes = exit_codes or {}
    final = {i: accounts[i].status for i in agents if i in accounts and accounts[i].final}
    aborted = [i for i in final if final[i].outcome == "aborted"]
    # an agent that sees the others land before it hears the command itself calls that a failure
    if aborted and len(final) == len(agents) and _ORDERLY.issuperset(codes.values()):
        return "aborted", _join(_grouped({i: final[i].reason or "on command" for i in aborted}))
    causes = [
        *(f"{name} was ended by {_signal(code)}" for name, code in codes.items() if code < 0),
        *_unaccounted(agents, accounts, final),
        *_grouped(
            {
                i: _complaint(s.outcome, s.reason)
                for i, s in final.items()
                if s.outcome != "completed"
            }
        ),
        *(
            f"{name} exited with {code}"
            for name, code in codes.items()
            if code > 1 or (code == 1 and not final)
        ),
    ]
    causes += [f"{name} exited with 1" for name, code in codes.items() if code == 1 and not causes]
    if not agents:
        causes.append("no agent is known")
    causes = causes or list(notes)
    return ("failed", _join(causes)) if causes else ("completed", "")


def _unaccounted(
    agents: Sequence[int], accounts: Mapping[int, Account], final: Mapping[int, object]
) -> Iterable[str]:
    for i in agents:
        if i not in accounts:
            yield f"agent {i} left no account"
        elif i not in final:
            last = accounts[i].status
            yield f"agent {i} left no account; last heard at {last.time_s:.1f} s in phase {last.phase.name.lower()}"


def _complaint(outcome: str, reason: str) -> str:
    return (
        reason if outcome == "failed" and reason else f"{outcome}: {reason}" if reason else outcome
    )


def _grouped(reasons: Mapping[int, str]) -> list[str]:
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


def _join(causes: Sequence[str]) -> str:
    more = [f"and {len(causes) - _SHOWN_CAUSES} more"] if len(causes) > _SHOWN_CAUSES else []
    return "; ".join([*causes[:_SHOWN_CAUSES], *more])
