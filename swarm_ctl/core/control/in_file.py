"""A move in file: all agents follow one way, one behind the other, and stand in their shape again
where it opens.

No agent leads: each has its rank by its slot, the front one first, and follows the one before it,
by where that one says that it is. One that is lost, or has left, is followed by nobody. Where the
way opens, each flies to its own place; until its turn comes, it stays.

Where zones change in flight the way is another one (`detour.py`): each goes on from where it is,
and in the same order.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
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


_NEAR_M: Final = 8.0
"""A vehicle that is farther from where its slot is on the way has set out before."""
_APART_M: Final = 15.0
"""A vehicle is looked for along the whole way at places so far apart."""
_NOWHERE: Final = complex(math.inf, math.inf)


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
        planned_m: tuple[Point, Point],
        centre_m: Point,
        slots: Mapping[int, Point],
        own_m: Point,
        peers: PeerSnapshot,
        departed: Collection[int],
    ) -> Point | None:
        """Where to fly now; None: stay.

        Args:
            step: the move as it is flown now.
            planned_m: where it was planned to begin, and its first corner by the plan: they say who
                goes first, also to one that comes later.
            centre_m: the formation's, as the frame has it.
            slots: of all agents, as the shape is turned and scaled now [units].
            own_m: the own stop point.
            peers: all that is heard.
            departed: the agents that have left the formation.
        """
        at = {p.id: p.stop_point for p in peers.peers if p.followed and p.id in slots}
        at[self._own] = complex(*own_m)
        if self._step is None:
            self._set_out(step, planned_m, centre_m, slots, at)
        elif self._step is not step:
            self._go_over(step, at)
        self._step = step
        homes = self._homes(step, slots)
        heard = at.keys() - set(departed)
        for agent in (self._own, *heard):
            self._look(agent, at[agent], homes[agent])
        whole, own = self._ends[-1], self._at[self._own]
        before = self._ranks[: self._ranks.index(self._own)]
        last = next((i for i in reversed(before) if i in heard), None)
        ahead = OUT if last is None else self._at[last]
        most = next_on(own, ahead, whole, self._gap_m)
        if most == OUT:
            return homes[self._own].real, homes[self._own].imag
        if most == STAYS:
            return None
        to = point_on(self._way, self._ends, most)
        return to.real, to.imag

    def _set_out(
        self,
        step: MoveStep,
        planned_m: tuple[Point, Point],
        centre_m: Point,
        slots: Mapping[int, Point],
        at: Mapping[int, complex],
    ) -> None:
        """The way, from behind the last slot on, the ranks, and where on it each is. The frame may
        have gone ahead: then the way begins where it was planned to."""
        near = math.dist(centre_m, planned_m[0]) <= _NEAR_M
        start_m = centre_m if near else planned_m[0]
        queue = queue_of(start_m, step.waypoints_m, slots, self._unit_m)
        self._way, self._ends, _, self._at = queue
        self._ranks = queue_of(planned_m[0], planned_m[1:], slots, self._unit_m).ranks
        self._opens = self._ends[-1] - (step.opens_m or 0.0)
        whole = range(0, math.ceil(self._ends[-1]), round(_APART_M))
        for agent, place in at.items():
            if abs(point_on(self._way, self._ends, self._at[agent]) - place) > _NEAR_M:
                self._at[agent] = self._found(place, whole)

    def _go_over(self, step: MoveStep, at: Mapping[int, complex]) -> None:
        """To another way, each from where it is: by what it has flown of the old one, or by what of
        that was left."""
        was = {
            agent: (along, at.get(agent, point_on(self._way, self._ends, along)))
            for agent, along in self._at.items()
            if along != OUT
        }
        before_m = self._ends[-1]
        self._way, self._ends = way_of(self._way[0], step.waypoints_m)
        self._opens = self._ends[-1] - (step.opens_m or 0.0)
        longer_m = self._ends[-1] - before_m
        for agent, (along, place) in was.items():
            self._at[agent] = self._found(place, (along, max(0.0, along + longer_m)))

    def _found(self, place: complex, guesses: Iterable[float]) -> float:
        """How far along the way a vehicle is that is near one of these."""
        found = [along_way(self._way, self._ends, guess, place, OUT, _NOWHERE) for guess in guesses]
        return min(found, key=lambda along: abs(point_on(self._way, self._ends, along) - place))

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
    way, ends = way_of(start - heading * back_m, waypoints_m)
    ranks = sorted(along, key=lambda i: (-along[i], i))
    return Queue(
        way, ends, ranks, {i: min(max(0.0, back_m + x), ends[1]) for i, x in along.items()}
    )


def way_of(first: complex, waypoints_m: Sequence[Point]) -> tuple[list[complex], list[float]]:
    """The corners of a way, and how far along it each is."""
    way = [first, *(complex(*at) for at in waypoints_m)]
    return way, [0.0, *itertools.accumulate(abs(b - a) for a, b in itertools.pairwise(way))]
