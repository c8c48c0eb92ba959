"""What an operator is told of an order: what each agent answers, and what the others do."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Final

from swarm_ctl.commands.send import SentCommand
from swarm_ctl.core.model.messages import ENDING, CommandKind
from swarm_ctl.core.model.plan import Plan, Policy
from swarm_ctl.core.model.text import agents_named

_DOES: Final = {
    CommandKind.LAND: "landing",
    CommandKind.RETURN: "flying home",
    CommandKind.KILL: "motors off",
    CommandKind.HOLD: "holding",
}
_ABOUT: Final = {
    CommandKind.EXPEL: "listen to {} no more, and keep clear",
    CommandKind.READMIT: "listen to {} again",
}
_OTHERS: Final = {
    Policy.CONTINUE: ("goes on without {them}", "go on without {them}"),
    Policy.HOLD: ("holds until `resume`", "hold until `resume`"),
    Policy.LAND: ("lands, too", "land, too"),
    Policy.RETURN: ("returns, too", "return, too"),
}
"""One agent, and several."""


def answers(
    sent: SentCommand, plan: Plan, left: Collection[int] = (), beside: Collection[int] = ()
) -> Iterator[str]:
    """A line for each answer, with the agents that gave it; `left` have left the formation already,
    those `beside` fly in other groups."""
    kind, about = sent.command.kind, sent.command.about
    taken = [i for i, ack in sorted(sent.acks.items()) if ack.accepted and i not in about]
    rest = others(kind, taken, plan, {*left, *sent.meant}, beside) if sent.command.agents else ""
    if taken and about:
        does, then = _ABOUT[CommandKind(kind)], others(kind, about, plan, left, beside)
        yield f"{agents_named(taken)}: {does.format(agents_named(about))}{f'; {then}' * bool(then)}"
    elif taken:
        does = next((does for name, does in _DOES.items() if name == kind), "") if rest else ""
        yield f"{agents_named(taken)}: {does or 'accepted'}{'; ' if rest else ''}{rest}"
    yield from refusals(sent)


def refusals(sent: SentCommand) -> Iterator[str]:
    """A line for each reason, with the agents that gave it."""
    for reason, agents in sent.refusals.items():
        yield f"{agents_named(agents)}: refused: {reason}"


def others(
    kind: str,
    named: Collection[int],
    plan: Plan,
    left: Collection[int] = (),
    beside: Collection[int] = (),
) -> str:
    """What the agents do that an order to the agents `named` leaves out; '' where there are none,
    or where the order says nothing of them. Those `beside` fly in groups with none of them.

    `agents 1-2 go on without it (policies.left_by_order)`
    """
    rest = [agent.id for agent in plan.agents if agent.id not in {*named, *left, *beside}]
    apart = not rest
    rest = rest or sorted(set(beside).difference(named, left))
    if not named or not rest or kind not in (*ENDING, CommandKind.HOLD, CommandKind.EXPEL):
        return ""
    policies, them, several = plan.policies, "it" if len(named) == 1 else "them", len(rest) > 1
    does = _OTHERS[policies.left_by_order][several].format(them=them)
    rule = "policies.left_by_order"
    if kind == CommandKind.HOLD:
        waits = f"wait{'' if several else 's'} for {them} {policies.override_pause_s:g} s at most"
        does, rule = f"{waits}, then {does}", "policies.override_pause_s, left_by_order"
    if apart:
        fly = "fly on" if several else "flies on"
        does = f"{fly}, and where the groups meet {'they ' if several else 'it '}{does}"
    return f"{agents_named(rest)} {does} ({rule})"
