"""The question before what can't be taken back: what will be done, and to which agents."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Collection
from dataclasses import dataclass

from swarm_ctl.commands.answers import others
from swarm_ctl.commands.parse import BY_NAME, Order
from swarm_ctl.core.model.messages import CommandKind
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.station.dashboard.drawing.styled_line import StyledLine
from swarm_ctl.station.picture.view import SwarmView


@dataclass(frozen=True, slots=True)
class Ask:
    """A question that stands on the screen until a key answers it. Only Enter says yes."""

    what: str
    """What will be done: `land agents 1-6: they land where they are`."""
    keys: str
    """What the keys do."""
    do: Callable[[], None]
    otherwise: str
    """What the operator is told where any other key drops it."""

    def lines(self, width: int, *, answered: bool) -> list[StyledLine]:
        """The question on as many lines as it needs, and the keys on one of their own, which is
        empty until a key is an answer."""
        words = textwrap.wrap(f"{self.what}.", max(8, width - 2))
        return [StyledLine(f" {line}") for line in (*words, self.keys if answered else "")]


def consequence(order: Order, plan: Plan, view: SwarmView | None) -> str:
    """What an order that lands, returns or kills will do as the operator sees the swarm (None: not
    yet), and to which agents, and what the others do, but for those that have left; '' for any
    other order."""
    named = order.named(plan, view.step if view is not None else 0)
    agents = named or tuple(agent.id for agent in plan.agents)
    does = BY_NAME[order.kind].asks[len(agents) > 1]
    if order.kind == CommandKind.NEXT:
        for step, kind in sorted(_landings(agents, plan, view)):
            does = f"step {step} ends, and step {step + 1} is '{kind}'"
    left, beside = (view.left, view.beside(agents)) if view is not None else ((), ())
    rest = others(order.kind, named, plan, left, beside)
    more = f"; {rest}" if rest else ""
    who = view.whom(agents) if view is not None and named else agents_named(agents)
    return f"{order.kind} {who}: {does}{more}" if does else ""


def _landings(agents: Collection[int], plan: Plan, view: SwarmView | None) -> set[tuple[int, str]]:
    """The steps that bring some of these agents down next: behind which step, and their kinds."""
    found = set[tuple[int, str]]()
    many = view is not None and len(view.groups) > 1
    for agent in agents:
        group = view.group_now(agent) if view is not None and many else None
        now = group.step if group is not None else view.step if view is not None else 0
        after = [g.step(now + 1) for g in plan.groups if agent in g.members]
        found |= {(now, step.kind) for step in after if step is not None and step.goes_down}
    return found
