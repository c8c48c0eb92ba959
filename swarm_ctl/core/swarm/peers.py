"""What an agent has heard of the others, and the points that law and filter are fed with."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.core.law.stop_point import stop_distance
from swarm_ctl.core.model.frames import ned_from_geodetic
from swarm_ctl.core.model.messages import AgentState, Phase
from swarm_ctl.core.model.plan import Compensation, Plan, Point
from swarm_ctl.core.model.timeouts import FRESH_S, NEIGHBOUR_S, PREDICT_S
from swarm_ctl.core.model.vehicle import Contact
from swarm_ctl.core.swarm.clocks import Clocks
from swarm_ctl.core.swarm.peer import Peer

_MAX_CONTACTS = 8
"""Traffic the law takes in at most, nearest first."""
_SAME_AIRCRAFT_M = 2.5
"""A contact this close to a fresh peer is that peer, seen by the other sensor."""
_YIELDING = frozenset({Phase.FLY, Phase.HOLD, Phase.RETURN})
"""Who flies by setpoints, and so keeps apart itself."""
_CONTACT_S = 3.0
"""Contacts older than this are gone (ADSB_VEHICLE comes at about 1 Hz)."""


class Other(NamedTuple):
    """Somebody to keep apart from, as the safety filter sees him; north + 1j * east."""

    id: int
    """0: traffic that nobody on the mesh owns up to."""
    stop_point: complex
    """As it was told, `age_s` ago [m]."""
    commanded: complex
    """[m/s]"""
    age_s: float
    """At most."""
    heard: bool
    """Its news is fresh."""
    yields: bool
    """It does its half of keeping apart."""
    flying: tuple[int, int] | None
    """The (step, command) whose formation it flies; None: none."""


class Common(NamedTuple):
    """What all who fly a formation share."""

    velocity_mps: complex
    flying: tuple[int, int] | None
    """The (step, command) of who shares it."""


NOTHING_COMMON: Final = Common(0j, None)


@dataclass(frozen=True, slots=True)
class LawInput:
    """The others as `law.evaluate` wants them, leading size 1; units. Column k is `ids[k]`, 0 for
    traffic."""

    points: NDArray[np.float64]
    slots: NDArray[np.float64]
    neighbour: NDArray[np.bool_]
    present: NDArray[np.bool_]
    lower_id: NDArray[np.bool_]
    along: NDArray[np.bool_]
    """(k,): freshly heard, with a slot, and it flies the same (step, command)."""


class Peers:
    """All other agents of the plan, in the plan's order."""

    def __init__(self, plan: Plan, own_id: int) -> None:
        self._plan = plan
        self._own = own_id
        self._chosen = frozenset(plan.agent(own_id).neighbours)
        self.clocks = Clocks(own_id, (agent.id for agent in plan.agents if agent.id != own_id))
        self._by_id = {agent: Peer(agent, clock) for agent, clock in self.clocks.of.items()}
        self.ids = [*self._by_id, *[0] * _MAX_CONTACTS]
        """Agent id of each column of the law's input; 0 for traffic that nobody on the mesh owns up
        to."""
        self._shape: tuple[list[bool], list[bool], int] | None = None
        self._slots: Mapping[int, Point] = {}
        self._seen: dict[int, tuple[Contact, Point]] = {}
        self._strangers: list[Other] = []

    def __iter__(self) -> Iterator[Peer]:
        return iter(self._by_id.values())

    def hear(self, state: AgentState, received_s: float) -> None:
        """Take a state in; agents that the plan does not have are ignored."""
        peer = self._by_id.get(state.agent)
        if peer is not None:
            peer.hear(state, received_s)

    def choose(self, neighbours: Iterable[int]) -> None:
        """N_i from now on."""
        self._chosen = frozenset(neighbours)

    @property
    def links(self) -> frozenset[int]:
        """`chosen`; the same object until they are chosen anew."""
        return self._chosen

    @property
    def chosen(self) -> tuple[int, ...]:
        """N_i as chosen, heard or not."""
        return tuple(sorted(self._chosen))

    def age(self, agent: int, now: float) -> float:
        """Of the newest state of `agent` [s]."""
        return self._by_id[agent].age(now)

    def state(self, agent: int) -> AgentState | None:
        """The newest state of `agent`."""
        return self._by_id[agent].state

    def count_ages(self, now: float) -> None:
        """Sample every heard peer's age once (per tick)."""
        for peer in self:
            if peer.state is not None and peer.clock.known:
                peer.ages.add(peer.age(now))

    def fresh(self, now: float) -> list[AgentState]:
        """States no older than `FRESH_S`."""
        return [peer.state for peer in self if peer.state is not None and peer.age(now) <= FRESH_S]

    def neighbours(self, now: float) -> tuple[int, ...]:
        """N_i now: the chosen neighbours that are heard (docs/pages/law.md#symbols)."""
        return tuple(p.id for p in self if p.id in self._chosen and p.age(now) <= NEIGHBOUR_S)

    def near(self, now: float, own: complex, reach_m: float) -> list[Other]:
        """Everybody whose told stop point is within reach of the own one; strangers as of the last
        `law_input`."""
        found = [
            self._other(peer, peer.state, now)
            for peer in self._by_id.values()
            if peer.state is not None and abs(own - peer.stop_point) < reach_m
        ]
        found += (other for other in self._strangers if abs(own - other.stop_point) < reach_m)
        return found

    def far(self, ids: Iterable[int], now: float, own: complex, beyond_m: float) -> list[Other]:
        """Those of `ids` whose told stop point is farther from the own one than this."""
        peers = (self._by_id[i] for i in ids if i in self._by_id)
        return [
            self._other(peer, peer.state, now)
            for peer in peers
            if peer.state is not None and abs(own - peer.stop_point) > beyond_m
        ]

    def _other(self, peer: Peer, state: AgentState, now: float) -> Other:
        heard = peer.age(now) <= FRESH_S
        yields = heard and state.phase in _YIELDING
        flying = (state.step, state.command) if heard and state.phase is Phase.FLY else None
        return Other(
            peer.id, peer.stop_point, peer.commanded, peer.age_at_most(now), heard, yields, flying
        )

    def flies_along(self, column: int, now: float) -> bool:
        """Whoever is at this column of the law's input is heard and flies the formation (traffic
        never does)."""
        state = self._by_id[self.ids[column]].state if self.ids[column] else None
        return (
            state is not None
            and state.phase is Phase.FLY
            and self.age(state.agent, now) <= NEIGHBOUR_S
        )

    def law_input(
        self,
        now: float,
        own_m: Point,
        slots: Mapping[int, Point],
        contacts: Sequence[Contact],
        lead_s: float = 0.0,
        common: Common = NOTHING_COMMON,
    ) -> LawInput:
        """Everyone who may be near, as points in units; a peer never heard is absent.

        What they told is carried on with their commands for at most `lead_s`, with what is `common`
        for `PREDICT_S`. Agents without a slot in `slots` are nobody's neighbours: with an empty one
        only avoidance is left.
        """
        points: list[Point] = []
        present, linked, along = [], [], []
        for peer in self:
            age, state = peer.age(now), peer.state
            with_us = (
                state is not None
                and age <= FRESH_S
                and state.phase is Phase.FLY
                and (state.step, state.command) == common.flying
                and peer.id in slots
            )
            moving = common.velocity_mps if with_us else 0j
            points.append(
                self._point(state, age, lead_s, moving) if state is not None else (0.0, 0.0)
            )
            present.append(state is not None)
            along.append(with_us)
            linked.append(peer.id in self._chosen and age <= NEIGHBOUR_S and peer.id in slots)
        traffic = self._traffic(now, own_m, contacts)
        points += traffic
        shape = (present, linked, len(traffic))
        if shape != self._shape or slots is not self._slots:
            self._shape, self._slots = shape, slots
            self._columns = self._columns_for(present, linked, len(traffic), slots)
        where = np.array(points).reshape(1, -1, 2) / self._plan.unit_m
        return LawInput(
            where, *self._columns, np.array(along + [False] * len(traffic), dtype=np.bool_)
        )

    def _columns_for(
        self, present: list[bool], linked: list[bool], traffic: int, slots: Mapping[int, Point]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], NDArray[np.bool_]]:
        """What changes only when somebody comes or goes: slots, neighbour, present, lower_id."""
        offsets = [slots.get(peer.id, (0.0, 0.0)) for peer in self] + [(0.0, 0.0)] * traffic
        return (
            np.array(offsets).reshape(1, -1, 2),  # one alone has nobody: shape and type of nothing
            np.array([linked + [False] * traffic], dtype=np.bool_),
            np.array([present + [True] * traffic], dtype=np.bool_),
            np.array([[self._own < i or i == 0 for i in self.ids[: len(offsets)]]], dtype=np.bool_),
        )

    def _point(self, state: AgentState, age: float, lead_s: float, moving: complex) -> Point:
        """Stop point carried on with its command, or the plain position (`compensation: none`)
        [m]."""
        if self._plan.compensation is Compensation.NONE:
            return state.position_ned_m[0], state.position_ned_m[1]
        lead = min(age, lead_s)
        further = min(age, PREDICT_S) - lead
        (north, east), (vn, ve) = state.stop_point_m, state.commanded_mps
        return north + vn * lead + moving.real * further, east + ve * lead + moving.imag * further

    def _traffic(self, now: float, own_m: Point, contacts: Sequence[Contact]) -> list[Point]:
        """Contacts that are no fresh peer, as stop points [m]: what the mesh does not know, the
        sensor does."""
        self._strangers = []
        if not contacts:
            return []
        known = [p.state for p in self if p.state is not None and p.age(now) <= NEIGHBOUR_S]
        places = np.array(
            [
                _carried(s.position_ned_m, s.velocity_ned_mps, self._by_id[s.agent].age(now))
                for s in known
            ]
        )
        heard = [contact for contact in contacts if 0.0 <= now - contact.time_s <= _CONTACT_S]
        at = [_carried(self._place(c), c.velocity_ned_mps, now - c.time_s) for c in heard]
        # all with all at once: a swarm of 32 sees a thousand pairs a tick
        stranger = (
            (abs(np.array(at)[:, None] - places) >= _SAME_AIRCRAFT_M).all(axis=1)
            if known
            else [True] * len(at)
        )
        found: list[tuple[Point, Other]] = []
        for contact, where in itertools.compress(zip(heard, at, strict=True), stranger):
            vn, ve, _ = contact.velocity_ned_mps
            point = self._stopping(where.real, where.imag, vn, ve)
            age = min(now - contact.time_s, PREDICT_S)
            found.append(
                (point, Other(0, complex(*point), complex(vn, ve), age, True, False, None))
            )
        found.sort(key=lambda entry: math.dist(entry[0], own_m))
        self._strangers = [other for _, other in found[:_MAX_CONTACTS]]
        return [point for point, _ in found[:_MAX_CONTACTS]]

    def _place(self, contact: Contact) -> Point:
        """Where it was reported, in the common frame [m]; worked out once per report."""
        seen = self._seen.get(contact.address)
        if seen is None or seen[0] is not contact:
            north, east, _ = ned_from_geodetic(contact.position, self._plan.origin)
            seen = self._seen[contact.address] = (contact, (north, east))
        return seen[1]

    def _stopping(self, north: float, east: float, vn: float, ve: float) -> Point:
        """The stop point of an aircraft whose commands are unknown: it flies on for the dead time,
        then brakes."""
        if self._plan.compensation is Compensation.NONE:
            return north, east
        speed = math.hypot(vn, ve)
        if speed < 1e-6:
            return north, east
        response = self._plan.response
        ahead = response.dead_time_s + stop_distance(speed, response) / speed
        return north + vn * ahead, east + ve * ahead


def _carried(where: Sequence[float], velocity_mps: Sequence[float], age_s: float) -> complex:
    """Where it is by now, north + 1j * east [m]."""
    return complex(where[0] + velocity_mps[0] * age_s, where[1] + velocity_mps[1] * age_s)
