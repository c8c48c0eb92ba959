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

    def lines(self, width: int) -> list[StyledLine]:
        """The question on as many lines as it needs, and the keys on one of their own."""
        words = textwrap.wrap(f"{self.what}.", max(8, width - 2))
        return [StyledLine(f" {line}") for line in (*words, self.keys)]


def consequence(order: Order, plan: Plan, step: int, left: Collection[int] = ()) -> str:
    """What an order that lands, returns or kills will do in the mission's `step`, and to which
    agents, and what the others do, but for those that have `left`; '' for any other order."""
    agents = order.agents or tuple(agent.id for agent in plan.agents)
    does = BY_NAME[order.kind].asks[len(agents) > 1]
    if order.kind == CommandKind.NEXT:
        after = [each for group in plan.groups if (each := group.step(step + 1)) is not None]
        for kind in sorted({each.kind for each in after if each.goes_down}):
            does = f"step {step} ends, and step {step + 1} is '{kind}'"
    rest = others(order.kind, order.agents, plan, left)
    more = f"; {rest}" if rest else ""
    return f"{order.kind} {agents_named(agents)}: {does}{more}" if does else ""
