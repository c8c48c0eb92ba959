"""The operator of a scenario: gives orders at their times, and lands in the end whoever holds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

from swarm_ctl.commands.answers import refusals
from swarm_ctl.commands.parse import parse
from swarm_ctl.commands.send import SentCommand
from swarm_ctl.engine.script import Excused, Holding, ScriptedOrder, StationScript, holds
from swarm_ctl.engine.station.ground_station import Station
from swarm_ctl.errors import InputError
from swarm_ctl.runfolder.refused_orders import RefusedOrder

_ROUNDING_S: Final = 1e-9


class ScriptedOperator:
    """At one station. `say` gets why an order can't be given; `refused` the orders that had to be
    accepted and were not, each once all that are meant have answered."""

    def __init__(
        self,
        script: StationScript,
        station: Station,
        say: Callable[[str], None],
        refused: Callable[[RefusedOrder], None] = lambda _: None,
    ) -> None:
        self._orders, self._killed_s = list(script.orders), script.killed_s
        self._station, self._say, self._refused = station, say, refused
        self._holding = Holding(script.ends_s)
        self._given = 0
        self._open: list[tuple[ScriptedOrder, SentCommand]] = []
        self._excused = Excused()

    def turn(self, now: float, *, orders: bool = True) -> bool:
        """At the end of a tick of the station; whether the station is to be killed now. Without
        `orders`, the operator only lands the agents that hold."""
        states = self._station.states()
        self._excused.hear(states)
        if self._holding.lands(holds(states), now):
            self._give(ScriptedOrder(now, "land", may_be_refused=True))
        while orders and self._orders and self._orders[0].at_s <= now + _ROUNDING_S:
            self._give(self._excused.of(self._orders.pop(0)))
        self._look(lambda sent: sent.over)
        killed = self._killed_s is not None and self._killed_s <= now + _ROUNDING_S
        if killed:
            self.end()
        return killed

    def end(self) -> None:
        """The station ends: what is not answered yet will not be."""
        self._look(lambda _: True)

    def _give(self, order: ScriptedOrder) -> None:
        self._given += 1
        try:
            sent = give_line(self._station, order.line, self._given)
        except InputError as error:
            self._say(f"{order.line}: {error}")
            if not order.may_be_refused:
                self._refused(RefusedOrder(order.at_s, order.line, str(error)))
            return
        self._open.append((order, sent))
        self._excused.gave(sent.command)

    def _look(self, ready: Callable[[SentCommand], bool]) -> None:
        for order, sent in self._open:
            refused = refusal(order, sent) if ready(sent) else None
            if refused is not None:
                self._refused(refused)
        self._open = [each for each in self._open if not ready(each[1])]


def give_line(station: Station, line: str, number: int) -> SentCommand:
    """Give an order of the scenario, which is its `number`-th; InputError where there can't be
    one."""
    return station.order(parse(line, station.plan), f"order-{number}")


def refusal(order: ScriptedOrder, sent: SentCommand) -> RefusedOrder | None:
    """That agents refused it; None: none did, or they may."""
    spared = () if sent.command.agents else order.expelled
    counted = {agent: ack for agent, ack in sent.acks.items() if agent not in spared}
    why = "; ".join(refusals(replace(sent, acks=counted)))
    return RefusedOrder(order.at_s, order.line, why) if why and not order.may_be_refused else None
