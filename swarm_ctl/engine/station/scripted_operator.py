"""The operator of a scenario: gives orders at their times, and lands in the end whoever holds."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from swarm_ctl.commands.parse import parse
from swarm_ctl.commands.send import SentCommand
from swarm_ctl.engine.script import Holding, StationScript, holds
from swarm_ctl.engine.station.ground_station import Station
from swarm_ctl.errors import InputError

_ROUNDING_S: Final = 1e-9


class ScriptedOperator:
    """At one station. `say` gets why an order can't be given."""

    def __init__(self, script: StationScript, station: Station, say: Callable[[str], None]) -> None:
        self._orders, self._killed_s = list(script.orders), script.killed_s
        self._station, self._say = station, say
        self._holding = Holding(script.ends_s)
        self._given = 0

    def turn(self, now: float) -> bool:
        """At the end of a tick of the station; whether the station is to be killed now."""
        if self._holding.lands(holds(self._station.states()), now):
            self._give("land")
        while self._orders and self._orders[0][0] <= now + _ROUNDING_S:
            self._give(self._orders.pop(0)[1])
        return self._killed_s is not None and self._killed_s <= now + _ROUNDING_S

    def _give(self, line: str) -> None:
        self._given += 1
        try:
            give_line(self._station, line, self._given)
        except InputError as error:
            self._say(f"{line}: {error}")


def give_line(station: Station, line: str, number: int) -> SentCommand:
    """Give an order of the scenario, which is its `number`-th; InputError where there can't be
    one."""
    return station.order(parse(line, station.plan), f"order-{number}")
