"""The verdict, by what is left of a run: each rule of `docs/look-up/verdict.md` that the agents'
accounts and the exit codes decide."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import pytest

from swarm_ctl.core.model.causes import Cause
from swarm_ctl.core.model.messages import (
    AgentStatus,
    LinkReport,
    Outcome,
    StepOutcome,
    StepResult,
    TickReport,
)
from swarm_ctl.report.judge.verdict import Ending, judge
from swarm_ctl.runfolder.last_statuses import LastStatus
from swarm_ctl.runfolder.run_folder import RunFolder
from tests.unit.report.run_folders import FORM, STEPS, account, manifest

DONE, LANDED, FAILED = Outcome.COMPLETED, Outcome.ABORTED, Outcome.FAILED
CTRL_C: Final = Ending("Ctrl-C")
KILLED: Final = Ending("Ctrl-C", at_once=True)


def broke(at_s: float, result: StepOutcome = StepOutcome.ABORTED) -> dict[str, Any]:
    """Off, in the form step."""
    return {"steps": (*STEPS[:2], StepResult("form hexagon", result, FORM, at_s))}


def landed(at_s: float = 30.0, **changes: Any) -> dict[str, Any]:
    """By the operator."""
    told = {"outcome": LANDED, "reason": "landed by the operator", "cause": Cause.ORDER}
    return told | broke(at_s) | changes


def low(at_s: float, cause: Cause | None = Cause.BATTERY) -> dict[str, Any]:
    """Failed."""
    return {"outcome": FAILED, "reason": "why", "cause": cause} | broke(at_s)


@dataclass(frozen=True)
class Row:
    """What each agent's account says that differs, who left none, and the verdict."""

    what: str
    agents: Mapping[int, dict[str, Any]] = field(default_factory=dict)
    codes: Mapping[str, int] = field(default_factory=dict)
    outcome: Outcome = FAILED
    reason: str = ""
    cause: Cause | None = None
    ending: Ending | None = None
    found: tuple[str, ...] = ()
    refused: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    heard: frozenset[int] = frozenset()
    """Their own account is missing: what the station heard last stands in."""
    successors: frozenset[int] = frozenset()


def each(told: dict[str, Any]) -> dict[int, dict[str, Any]]:
    return dict.fromkeys(range(1, 7), told)


PREPARED = {"steps": STEPS[:1], "armed": False}
ALL_LANDED = "agents 1-6: landed by the operator"
ROWS: Final = [
    Row("all completed", codes={"sim": 0, "agent-1": 0}, outcome=DONE),
    Row("all landed", each(landed()), {"sim": 1, "agent-1": 130}, LANDED, ALL_LANDED, Cause.ORDER),
    Row(
        "without a word", each(landed(reason="")), {}, LANDED, "agents 1-6: on command", Cause.ORDER
    ),
    Row("by a lifeline", each(landed(cause=Cause.STARTER)), {}, LANDED, ALL_LANDED, Cause.STARTER),
    Row("without a cause", each(landed(cause=None)), {}, LANDED, ALL_LANDED, Cause.ORDER),
    Row(
        "landed, and one process was killed",
        each(landed()),
        {"sim": -9},
        reason="sim was ended by SIGKILL; agents 1-6: aborted: landed by the operator, in step 2"
        " (form hexagon)",
        cause=Cause.PROCESS,
    ),
    Row(
        "landed, and one left no account of its own",
        each(landed()),
        heard=frozenset({3}),
        reason="agent 3 left no final status; last heard at 61.0 s in phase ended; agents 1-2, 4-6:"
        " aborted: landed by the operator, in step 2 (form hexagon)",
        cause=Cause.PROCESS,
    ),
    Row(
        "landed, and something was found",
        each(landed(reason="")),
        found=("two collided",),
        reason="two collided; agents 1-6: aborted, in step 2 (form hexagon)",
        cause=Cause.FINDING,
    ),
    Row(
        "all completed, and an order of the scenario was refused",
        refused=("order at 5 s",),
        reason="order at 5 s",
        cause=Cause.FINDING,
    ),
    Row(
        "landed, and an order was refused",
        each(landed()),
        refused=("order at 5 s",),
        reason="order at 5 s; agents 1-6: aborted: landed by the operator, in step 2 (form"
        " hexagon)",
        cause=Cause.FINDING,
    ),
    Row(
        "one failed, and an order was refused",
        {2: low(28.9)},
        refused=("order at 5 s",),
        reason="agent 2: why, in step 2 (form hexagon); order at 5 s",
        cause=Cause.BATTERY,
    ),
    Row(
        "one had failed before",
        each(landed()) | {2: low(28.9)},
        reason="agent 2: why, in step 2 (form hexagon); agents 1, 3-6: aborted: landed by the"
        " operator",
        cause=Cause.BATTERY,
    ),
    Row("one was told a moment before", each(landed()) | {2: low(29.1)}, outcome=LANDED),
    Row("one failed with the order", each(landed()) | {2: low(30.0)}, outcome=LANDED),
    Row("one failed later", each(landed()) | {2: low(31.0)}, outcome=LANDED),
    Row("one followed another", each(landed()) | {2: low(28.9, Cause.PEER)}, outcome=LANDED),
    Row("one says no cause", each(landed()) | {2: low(28.9, None)}, outcome=LANDED),
    Row("one timed out", {2: low(29.0, Cause.TIMEOUT)}, reason="agent 2: why", cause=Cause.TIMEOUT),
    Row(
        "one says nothing",
        {2: {"outcome": FAILED, "reason": "", "steps": ()}},
        reason="agent 2: failed",
        cause=Cause.VEHICLE,
    ),
    Row(
        "the first is the cause, and who follows comes last",
        {
            1: low(20.0, Cause.PEER) | {"reason": "agent 2 broke off"},
            2: low(30.0) | {"reason": "first"},
            3: low(math.inf) | {"reason": "never"} | broke(29.0, StepOutcome.DONE),
            4: low(31.0) | {"reason": "second"} | broke(31.0, StepOutcome.TIMEOUT),
        },
        reason="agent 2: first, in step 2 (form hexagon); agent 4: second; agent 3: never; agent 1:"
        " agent 2 broke off",
        cause=Cause.BATTERY,
    ),
    Row(
        "a step whose time is over, and after which the mission goes on, breaks nothing off",
        {
            1: low(30.0)
            | {
                "reason": "later",
                "steps": (
                    *STEPS[:2],
                    StepResult("form hexagon", StepOutcome.TIMEOUT, FORM, 22.0),
                    StepResult("hold", StepOutcome.ABORTED, 22.0, 30.0),
                ),
            },
            2: low(25.0) | {"reason": "first"},
        },
        reason="agent 2: first, in step 2 (form hexagon); agent 1: later",
        cause=Cause.BATTERY,
    ),
    # what no agent can see
    Row(
        "a slow machine",
        each(low(30.0, Cause.TIMEOUT) | {"tick": TickReport(count=890, overruns=1110)}),
        reason="this machine can't keep up with --speedup 5 (ticks 8.9 of 20 Hz); about 2 would do,"
        " or --lockstep. agents 1-6: why",
        cause=Cause.MACHINE,
    ),
    Row(
        "which makes no battery low",
        each(low(30.0) | {"tick": TickReport(count=890, overruns=1110)}),
        reason="agents 1-6: why, in step 2 (form hexagon)",
        cause=Cause.BATTERY,
    ),
    Row(
        "late links",
        {1: low(30.0, Cause.TIMEOUT) | {"links": {5: LinkReport(0.1, 0.8, 2.1, 300, 100)}}},
        reason="1 of 26 mesh links were late: agent 5's states reached agent 1 0.8 s old (median),"
        " 25% lost. agent 1: why",
        cause=Cause.LINK,
    ),
    Row(
        "which make no battery low, either",
        {1: low(30.0) | {"links": {5: LinkReport(0.1, 0.8, 2.1, 300, 100)}}},
        reason="agent 1: why, in step 2 (form hexagon)",
        cause=Cause.BATTERY,
    ),
    # processes
    Row("one exited", codes={"sim": 3}, reason="sim exited with 3", cause=Cause.PROCESS),
    Row("one failed", codes={"sim": 1}, reason="sim exited with 1", cause=Cause.PROCESS),
    Row(
        "an agent's status says more",
        {2: low(30.0)},
        {"agent-2": 1, "sim": 2},
        reason="agent 2: why, in step 2 (form hexagon); sim exited with 2",
        cause=Cause.BATTERY,
    ),
    Row(
        "a strange signal",
        codes={"sim": -99},
        reason="sim was ended by signal 99",
        cause=Cause.PROCESS,
    ),
    Row(
        "a process that was replaced",
        codes={"agent-3": -9},
        successors=frozenset({3}),
        outcome=DONE,
    ),
    Row(
        "one whose successor failed",
        {3: low(30.0)},
        {"agent-3": -9},
        successors=frozenset({3}),
        reason="agent-3 was ended by SIGKILL; agent 3: why, in step 2 (form hexagon)",
        cause=Cause.PROCESS,
    ),
    Row("a torn file", notes=("x is torn",), reason="x is torn", cause=Cause.PROCESS),
    # endings
    Row("Ctrl-C", each(landed()), {}, LANDED, "Ctrl-C: all landed", Cause.ORDER, CTRL_C),
    Row(
        "Ctrl-C, and one was killed",
        each(landed()) | {3: landed(cause=None, reason="killed")},
        outcome=LANDED,
        reason="Ctrl-C: all landed; agent 3: killed",
        cause=Cause.ORDER,
        ending=CTRL_C,
    ),
    Row(
        "Ctrl-C, and something was found",
        each(PREPARED),
        found=("two collided",),
        reason="two collided",
        cause=Cause.FINDING,
        ending=CTRL_C,
    ),
    Row(
        "Ctrl-C on the ground",
        each(PREPARED),
        outcome=LANDED,
        reason="Ctrl-C before take-off",
        cause=Cause.ORDER,
        ending=CTRL_C,
    ),
    Row(
        "one was armed",
        each(PREPARED) | {2: PREPARED | {"armed": True}},
        outcome=DONE,
        ending=CTRL_C,
    ),
    Row(
        "one had taken off", each(PREPARED) | {2: {"steps": STEPS[:2]}}, outcome=DONE, ending=CTRL_C
    ),
    Row("all had ended", codes={}, outcome=DONE, ending=KILLED),
    Row(
        "two had not",
        heard=frozenset({2, 5}),
        reason="ended by a second Ctrl-C: the vehicles of agents 2, 5 may be in the air",
        cause=Cause.ORDER,
        ending=KILLED,
    ),
    Row(
        "nor by a first one",
        heard=frozenset({2}),
        reason="agent 2 left no final status; last heard at 61.0 s in phase ended",
        cause=Cause.PROCESS,
        ending=CTRL_C,
    ),
    Row(
        "it did not start",
        reason="did not start: no port",
        cause=Cause.PROCESS,
        ending=Ending("no port", failed=True),
    ),
]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.what)
def test_the_verdict(row: Row) -> None:
    last = {}
    for i in range(1, 7):
        told: AgentStatus = replace(account(i, armed=False), **row.agents.get(i, {}))
        last[i] = LastStatus(told, final=i not in row.heard, successor=i in row.successors)
    run = RunFolder(
        manifest(), None, {}, None, agents=tuple(last), last=last, notes=list(row.notes)
    )
    verdict = judge(run, row.codes, row.found, row.ending, row.refused)
    assert verdict.outcome is row.outcome
    if row.outcome is not LANDED or row.reason:
        assert (verdict.reason, verdict.cause) == (row.reason, row.cause)


def test_without_a_manifest_the_agents_words_are_all() -> None:
    last = {1: LastStatus(account(1, **low(30.0, Cause.TIMEOUT)), final=True)}
    run = RunFolder(None, None, {}, None, agents=(1,), last=last, notes=["no manifest"])
    assert judge(run, {}) == (FAILED, "agent 1: why", Cause.TIMEOUT)


def test_a_run_without_agents_has_failed() -> None:
    run = RunFolder(manifest(), None, {}, None, agents=(), last={}, notes=[])
    assert judge(run, {}) == (FAILED, "no agent is known", Cause.PROCESS)
