"""What must hold in every flight of a scenario, by the simulator's truth.

Each check is a sentence of docs/do/fuzz.md. It looks at the vehicles, not at what agents say of
them; where it needs an agent's word (that an order was taken, why a mission broke off), the word is
held against the truth. What a scenario takes out of the swarm's hands (a pilot, a vehicle that
tells a wrong place, an agent that lies) is left out for as long as that lasts, and no longer.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from swarm_ctl.fuzz.invariants.ends import all_are_down, all_end, steps_go_together
from swarm_ctl.fuzz.invariants.links import links_are_told
from swarm_ctl.fuzz.invariants.losses import policies_act
from swarm_ctl.fuzz.invariants.orders import nothing_moves_unordered, orders_are_obeyed
from swarm_ctl.fuzz.invariants.places import (
    fence_is_kept,
    pairs_are_apart,
    speeds_are_kept,
    zones_are_kept,
)
from swarm_ctl.fuzz.invariants.seen import Seen
from swarm_ctl.fuzz.invariants.setpoints import rooms_are_shared
from swarm_ctl.fuzz.invariants.verdict import forecast_holds, verdict_agrees
from swarm_ctl.virtual.scenario_flight import FlownScenario


class Invariant(StrEnum):
    """One that a flight may break."""

    ENDS = "it ends within its bound"
    DOWN = "all are down and disarmed in the end"
    APART = "no pair is under r_in"
    ROOM = "no agent takes more than its share of the room to another one"
    FENCED = "nobody is out of the fence without its policy acting"
    ZONED = "no vehicle is in a zone"
    SLOW = "no vehicle is faster than it may be"
    ORDERED = "nothing moves that was not ordered"
    TOGETHER = "no agent goes on before the others are done"
    OBEYS = "an order that was accepted is carried out"
    ACTS = "what is lost makes its policy act"
    HEARD = "what an agent says of its links is so"
    VERDICT = "verdict, cause and truth agree"
    FORECAST = "the forecast holds in fair weather"
    RAISES = "no error is raised"
    SAME = "the same seed has the same bytes"
    ALIKE = "processes in lockstep fly what the virtual clock flies"


@dataclass(frozen=True, slots=True)
class Broken:
    """An invariant that did not hold, and how."""

    invariant: Invariant
    text: str


def broken(flown: FlownScenario) -> list[Broken]:
    """All that did not hold in this flight. The last three are for whoever flies it."""
    seen = Seen(flown)
    return [Broken(invariant, text) for invariant, check in CHECKS.items() for text in check(seen)]


CHECKS: Final[dict[Invariant, Callable[[Seen], Iterator[str]]]] = {
    Invariant.ENDS: all_end,
    Invariant.DOWN: all_are_down,
    Invariant.APART: pairs_are_apart,
    Invariant.ROOM: rooms_are_shared,
    Invariant.FENCED: fence_is_kept,
    Invariant.ZONED: zones_are_kept,
    Invariant.SLOW: speeds_are_kept,
    Invariant.ORDERED: nothing_moves_unordered,
    Invariant.TOGETHER: steps_go_together,
    Invariant.OBEYS: orders_are_obeyed,
    Invariant.ACTS: policies_act,
    Invariant.HEARD: links_are_told,
    Invariant.VERDICT: verdict_agrees,
    Invariant.FORECAST: forecast_holds,
}
"""By the flight's truth."""
