"""Aircraft that the vehicle's own traffic receiver sees (ADSB_VEHICLE) and no peer explains.

The second source of proximity: avoidance goes on where the mesh is cut, and where a peer's word is
false. A peer explains a contact by its place and by its stop point: both are kept clear of where
they differ.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from swarm_ctl.core.kernel.response import stop_distance
from swarm_ctl.core.model.frames import ned_from_geodetic
from swarm_ctl.core.model.plan import Compensation, Plan, Point
from swarm_ctl.core.model.timeouts import PREDICT_S
from swarm_ctl.core.model.vehicle import Contact, Vector3
from swarm_ctl.core.swarm.plausibility import BeliefLimits
from swarm_ctl.core.swarm.snapshot import TRAFFIC, OtherAircraft, predicted_s

MAX_CONTACTS: Final = 8
"""The nearest contacts that the law takes in."""
_SAME_AIRCRAFT_M: Final = 2.5
"""A contact this close to a followed peer is that peer, seen by the other sensor."""
_STOPS_M: Final = 2.5
"""A contact whose own stop point is farther than this from the peer's, besides what its vehicle may
have done since, will come to rest elsewhere than the peer says."""
_CONTACT_S: Final = 3.0
"""Older contacts are dropped; ADSB_VEHICLE comes at about 1 Hz."""
_VACANT_S: Final = 10.0
"""The sensor hears an aircraft about once a second."""
_NEAR_M: Final = 5.0
"""It may have drifted so far, or be seen so far off, and still be the vehicle of a last place."""
_GROUND_M, _STANDS_MPS = 1.0, 0.5

_FEW: Final = 64
"""Pairs that are compared one by one before arrays are quicker: a swarm of 32 sees a thousand."""


class _Report(NamedTuple):
    """One ADSB_VEHICLE in the common frame."""

    contact: Contact
    place: complex
    velocity: complex
    stops: complex
    """From where it is to where it comes to rest."""
    differs_m: float
    """That place may be so far from what a peer says, by setpoints that have yet to be flown."""


class Traffic:
    """Contacts in the common frame; remembers where each report places its aircraft."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._fastest_mps = BeliefLimits.of(plan).fastest_mps
        self._response, self._limit_mps = plan.response, plan.limits.speed_mps
        self._ahead_s = plan.response.dead_time_s + plan.response.lag_s
        self.seen: frozenset[int] = frozenset()
        """The peers that the sensor sees where they say."""
        self.off: dict[int, float] = {}
        """By how much [m] the sensor sees others stop elsewhere than they say."""
        self._reports: dict[int, _Report] = {}
        """The newest of each address."""

    def unexplained(
        self, now: float, contacts: Sequence[Contact], peers: Sequence[OtherAircraft], own_m: Point
    ) -> tuple[OtherAircraft, ...]:
        """The contacts that are no followed peer, the `MAX_CONTACTS` nearest to `own_m` first."""
        stand = [p.state.position_ned_m for p in peers if p.down and p.state is not None]
        recent: list[_Report] = []
        at: list[complex] = []
        known = self._reports
        for contact in contacts:
            age_s = now - contact.time_s
            if not 0.0 <= age_s <= _CONTACT_S or (stand and self._stands(contact, stand)):
                continue
            report = known.get(contact.address)
            if report is None or report.contact is not contact:
                report = self._report(contact)
            recent.append(report)
            at.append(report.place + report.velocity * age_s)
        self.seen, self.off = frozenset(), {}
        if not recent:
            return ()
        strangers = self._unlike(now, recent, at, peers)
        if not strangers:
            return ()
        found = [_aircraft(now, recent[k], at[k]) for k in strangers]
        found.sort(key=lambda other: abs(other.stop_point - complex(*own_m)))
        return tuple(found[:MAX_CONTACTS])

    def _unlike(
        self,
        now: float,
        reports: Sequence[_Report],
        at: Sequence[complex],
        peers: Sequence[OtherAircraft],
    ) -> list[int]:
        """The places of the contacts of which no followed peer says that it is there and stops
        there."""
        followed = [peer for peer in peers if peer.followed and peer.state is not None]
        if not followed:
            return [*range(len(at))]
        ages = [peer.age(now) if peer.far else peer.age_s for peer in followed]
        told = [_carried_on(peer, age_s) for peer, age_s in zip(followed, ages, strict=True)]
        explained: set[int] = set()
        seen = []
        for k, j in _near(at, told):
            peer, report, age_s = followed[j], reports[k], ages[j]
            if abs(at[k] - peer.position) >= _SAME_AIRCRAFT_M + self._fastest_mps * age_s:
                continue
            stops = peer.stop_point + peer.setpoint * min(age_s, predicted_s(peer))
            off_m = abs(at[k] + report.stops - stops)
            if off_m <= report.differs_m + self._turned_m(now - report.contact.time_s):
                explained.add(k)
                seen.append(peer.id)
            else:
                self.off[peer.id] = off_m
        self.seen = frozenset(seen)
        if self.off:
            self.off = {i: off_m for i, off_m in self.off.items() if i not in self.seen}
        return [k for k in range(len(at)) if k not in explained]

    def _turned_m(self, age_s: float) -> float:
        """By what a vehicle did since the contact, its stop point may have moved so far."""
        turned = min(self._response.acceleration_mps2 * age_s, self._limit_mps)
        return turned * self._ahead_s

    def _stands(self, contact: Contact, places: Sequence[Vector3]) -> bool:
        """It is a peer that has landed and ended, at its height as well: no other flies there."""
        at = ned_from_geodetic(contact.position, self._plan.origin)
        return any(math.dist(at, place) < _SAME_AIRCRAFT_M for place in places)

    def _report(self, contact: Contact) -> _Report:
        """What a new contact says: worked out once."""
        north, east, _ = ned_from_geodetic(contact.position, self._plan.origin)
        velocity = _horizontal(contact.velocity_ned_mps)
        stops, flies_mps = self._stops(velocity), self._limit_mps + abs(velocity)
        differs_m = _STOPS_M + self._response.dead_time_s * flies_mps
        report = _Report(contact, complex(north, east), velocity, stops, differs_m)
        self._reports[contact.address] = report
        return report

    def _stops(self, velocity: complex) -> complex:
        """How far on an aircraft with unknown setpoints comes to rest [m]: it flies on for the dead
        time, then brakes."""
        speed = abs(velocity)
        if self._plan.compensation is Compensation.NONE or speed < 1e-6:
            return 0j
        response = self._plan.response
        ahead_s: float = response.dead_time_s + stop_distance(speed, response) / speed
        return velocity * ahead_s


def _near(at: Sequence[complex], told: Sequence[complex]) -> list[tuple[int, int]]:
    """(k, j) of each contact k that is where peer j must be by its word."""
    if len(at) * len(told) <= _FEW:
        return [
            (k, j)
            for k, place in enumerate(at)
            for j, other in enumerate(told)
            if abs(place - other) < _SAME_AIRCRAFT_M
        ]
    near = np.abs(np.array(at)[:, None] - np.array(told)) < _SAME_AIRCRAFT_M
    return list(zip(*(places.tolist() for places in near.nonzero()), strict=True))


def _aircraft(now: float, report: _Report, where: complex) -> OtherAircraft:
    age_s = min(now - report.contact.time_s, PREDICT_S)
    stop, velocity = where + report.stops, report.velocity
    return OtherAircraft(
        id=TRAFFIC,
        state=None,
        position=where,
        stop_point=stop,
        setpoint=velocity,
        age_s=age_s,
        age_at_most_s=age_s,
        fresh=True,
    )


class Vacated:
    """Vehicles of expelled agents that do not fly where they were last believed to be, by the
    traffic sensor: it sees peers, and for `_VACANT_S` nothing there but what stands on the ground.

    Without a sensor there is no such evidence: silence does not free the place.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._since_s: dict[int, float] = {}
        self._rests: dict[int, Vector3] = {}
        """By agent: where its vehicle stands, or may have landed [m]."""

    def at_rest(self, peers: tuple[OtherAircraft, ...]) -> tuple[OtherAircraft, ...]:
        """The peers, these as vehicles on the ground: in no agent's way in flight, and none lands
        on them."""
        if not self._rests:
            return peers
        self._rests = {p.id: self._rests[p.id] for p in peers if p.expelled and p.id in self._rests}
        return tuple(map(self._placed, peers))

    def look(
        self, now: float, contacts: Sequence[Contact], peers: Sequence[OtherAircraft], *, sees: bool
    ) -> None:
        """Look at the contacts of this tick; `sees`: the sensor sees peers where they say."""
        expelled = [p for p in peers if p.expelled and p.state is not None and not p.down]
        if not expelled:
            return
        recent = [contact for contact in contacts if 0.0 <= now - contact.time_s <= _CONTACT_S]
        placed = [(c, ned_from_geodetic(c.position, self._plan.origin)) for c in recent]
        for peer in expelled:
            near = [(c, at) for c, at in placed if abs(_horizontal(at) - peer.position) < _NEAR_M]
            if not sees or not all(_stands(contact, at) for contact, at in near):
                self._since_s[peer.id] = now
            elif now - self._since_s.setdefault(peer.id, now) >= _VACANT_S:
                del self._since_s[peer.id]
                nowhere = (peer.position.real, peer.position.imag, 0.0)
                self._rests[peer.id] = near[0][1] if near else nowhere

    def _placed(self, peer: OtherAircraft) -> OtherAircraft:
        at = self._rests.get(peer.id)
        if at is None or peer.state is None:
            return peer
        place, state = _horizontal(at), replace(peer.state, position_ned_m=at)
        return replace(peer, state=state, position=place, stop_point=place, setpoint=0j, down=True)


def _stands(contact: Contact, at: Vector3) -> bool:
    """It stands on the ground, at the height of the take-off."""
    return -at[2] < _GROUND_M and math.hypot(*contact.velocity_ned_mps) < _STANDS_MPS


def _carried_on(peer: OtherAircraft, age_s: float) -> complex:
    """Where a peer of which the news has this age is now, with the velocity that it has told."""
    flies = peer.state.velocity_ned_mps if peer.state is not None else (0.0, 0.0)
    return peer.position + complex(flies[0], flies[1]) * age_s


def _horizontal(vector: Sequence[float]) -> complex:
    return complex(vector[0], vector[1])
