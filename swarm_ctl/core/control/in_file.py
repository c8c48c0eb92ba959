"""A move in file: all agents follow one way, one behind the other, and stand in their shape again
where it opens.

No agent leads: each has its rank by its slot, the front one first, and follows the one before it,
by where that one says that it is. One that is lost, or has left, is followed by nobody. Where the
way opens, each flies to its own place; until its turn comes, it stays.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping, Sequence
from typing import Final, NamedTuple

from swarm_ctl.core.kernel.queue import OUT, STAYS, along_way, next_on, point_on
from swarm_ctl.core.model.geometry import Point
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.model.steps.move import MoveStep
from swarm_ctl.core.swarm.snapshot import PeerSnapshot

GAP: Final = 1.1
"""[of r_out] from one to the next: so far, the avoidance does not act between them."""


def gap_m(plan: Plan) -> float:
    """From one stop point to the next on the way."""
    return GAP * plan.law.r_out * plan.unit_m


class InFile:
    """One agent's part in a move in file."""

    def __init__(self, plan: Plan, own_id: int) -> None:
        self._own, self._unit_m, self._gap_m = own_id, plan.unit_m, gap_m(plan)
        self._step: MoveStep | None = None
        self._way: list[complex] = []
        self._ends: list[float] = []
        """How far along the way each corner is."""
        self._opens = 0.0
        """How far along it the way opens."""
        self._ranks: list[int] = []
        self._at: dict[int, float] = {}
        """How far along the way each agent is; `OUT` for good where it has opened."""

    def begin(self) -> None:
        """Another step begins."""
        self._step = None

    def place(
        self,
        step: MoveStep,
        start_m: Point,
        slots: Mapping[int, Point],
        own_m: Point,
        peers: PeerSnapshot,
        departed: Collection[int],
    ) -> Point | None:
        """Where to fly now; None: stay.

        Args:
            step: the move.
            start_m: the formation's centre before it.
            slots: of all agents, as the shape is turned and scaled now [units].
            own_m: the own stop point.
            peers: all that is heard.
            departed: the agents that have left the formation.
        """
        if self._step is not step:
            self._set_out(step, start_m, slots)
        homes = self._homes(step, slots)
        self._look(self._own, complex(*own_m), homes[self._own])
        heard = set[int]()
        for peer in peers.peers:
            if peer.followed and peer.id in slots and peer.id not in departed:
                heard.add(peer.id)
                self._look(peer.id, peer.stop_point, homes[peer.id])
        whole, own = self._ends[-1], self._at[self._own]
        before = self._ranks[: self._ranks.index(self._own)]
        last = next((i for i in reversed(before) if i in heard), None)
        ahead = OUT if last is None else self._at[last]
        most = next_on(own, ahead, whole, self._gap_m)
        if most == OUT:
            return homes[self._own].real, homes[self._own].imag
        if most == STAYS:
            return None
        at = point_on(self._way, self._ends, most)
        return at.real, at.imag

    def _set_out(self, step: MoveStep, start_m: Point, slots: Mapping[int, Point]) -> None:
        """The way, from behind the last slot on, and the ranks."""
        self._step = step
        queue = queue_of(start_m, step.waypoints_m, slots, self._unit_m)
        self._way, self._ends, self._ranks, self._at = queue
        self._opens = self._ends[-1] - (step.opens_m or 0.0)

    def _homes(self, step: MoveStep, slots: Mapping[int, Point]) -> dict[int, complex]:
        """Where the slots are at the end of the move."""
        goal = complex(*step.waypoints_m[-1])
        return {i: goal + complex(*slot) * self._unit_m for i, slot in slots.items()}

    def _look(self, agent: int, at: complex, home: complex) -> None:
        """Where it is on the way, near where it was."""
        was = self._at[agent]
        self._at[agent] = along_way(self._way, self._ends, was, at, self._opens, home)


class Queue(NamedTuple):
    """How agents set out on one way."""

    way: list[complex]
    """From behind the last slot on [m]."""
    ends: list[float]
    """How far along the way each corner is."""
    ranks: list[int]
    """The front one first."""
    at: dict[int, float]
    """How far along the way each is."""


def queue_of(
    start_m: Point, waypoints_m: Sequence[Point], slots: Mapping[int, Point], unit_m: float
) -> Queue:
    """Of agents that stand in these slots [units] around the start."""
    start, first = complex(*start_m), complex(*waypoints_m[0])
    heading = (first - start) / max(abs(first - start), 1e-9)
    along = {i: (heading.conjugate() * complex(*slot)).real * unit_m for i, slot in slots.items()}
    back_m = max(0.0, -min(along.values()))
    way = [start - heading * back_m, *(complex(*at) for at in waypoints_m)]
    legs = [abs(b - a) for a, b in itertools.pairwise(way)]
    ends = [0.0, *itertools.accumulate(legs)]
    ranks = sorted(along, key=lambda i: (-along[i], i))
    return Queue(
        way, ends, ranks, {i: min(max(0.0, back_m + x), legs[0]) for i, x in along.items()}
    )
