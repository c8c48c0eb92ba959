"""Aircraft that the vehicle's own traffic receiver sees (ADSB_VEHICLE) and no peer explains.

The second source of proximity: avoidance goes on where the mesh is cut, and where a peer's word is
false. A peer explains a contact by its place and by its stop point: both are kept clear of where
they differ.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from swarm_ctl.core.law.stop_point import stop_distance
from swarm_ctl.core.model.frames import ned_from_geodetic
from swarm_ctl.core.model.plan import Compensation, Plan, Point
from swarm_ctl.core.model.timeouts import PREDICT_S
from swarm_ctl.core.model.vehicle import Contact, Vector3
from swarm_ctl.core.swarm.snapshot import TRAFFIC, OtherAircraft

MAX_CONTACTS: Final = 8
"""The nearest contacts that the law takes in."""
_SAME_AIRCRAFT_M: Final = 2.5
"""A contact this close to a followed peer is that peer, seen by the other sensor."""
_STOPS_M: Final = 2.5
"""A contact whose own stop point is farther than this from the peer's, besides what its vehicle may
have done since, will come to rest elsewhere than the peer says."""
_CONTACT_S: Final = 3.0
"""Older contacts are dropped; ADSB_VEHICLE comes at about 1 Hz."""


class Traffic:
    """Contacts in the common frame; remembers where each report places its aircraft."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self.seen: frozenset[int] = frozenset()
        """The peers that the sensor sees where they say."""
        self.off: dict[int, float] = {}
        """By how much [m] the sensor sees others stop elsewhere than they say."""
        self._placed: dict[int, tuple[Contact, complex]] = {}

    def unexplained(
        self, now: float, contacts: Sequence[Contact], peers: Sequence[OtherAircraft], own_m: Point
    ) -> tuple[OtherAircraft, ...]:
        """The contacts that are no followed peer, the `MAX_CONTACTS` nearest to `own_m` first."""
        stand = [p.state.position_ned_m for p in peers if p.down and p.state is not None]
        recent = [
            contact
            for contact in contacts
            if 0.0 <= now - contact.time_s <= _CONTACT_S and not self._stands(contact, stand)
        ]
        self.seen, self.off = frozenset(), {}
        if not recent:
            return ()
        at = [
            self._place(contact) + _horizontal(contact.velocity_ned_mps) * (now - contact.time_s)
            for contact in recent
        ]
        stranger = self._unlike(now, recent, at, peers)
        found = [
            self._aircraft(now, contact, where)
            for contact, where in itertools.compress(zip(recent, at, strict=True), stranger)
        ]
        found.sort(key=lambda other: abs(other.stop_point - complex(*own_m)))
        return tuple(found[:MAX_CONTACTS])

    def _unlike(
        self,
        now: float,
        contacts: Sequence[Contact],
        at: Sequence[complex],
        peers: Sequence[OtherAircraft],
    ) -> list[bool]:
        """For each contact: no followed peer says that it is there and stops there."""
        followed = [peer for peer in peers if peer.followed and peer.state is not None]
        if not followed:
            return [True] * len(at)
        known = [
            peer.position + _horizontal(peer.state.velocity_ned_mps) * peer.age_s
            for peer in followed
            if peer.state is not None
        ]
        # all contacts against all peers at once: a swarm of 32 sees a thousand pairs a tick
        near = np.abs(np.array(at)[:, None] - np.array(known)) < _SAME_AIRCRAFT_M
        unlike, seen = [True] * len(at), []
        for k, j in zip(*(places.tolist() for places in near.nonzero()), strict=True):
            peer, contact = followed[j], contacts[k]
            velocity = _horizontal(contact.velocity_ned_mps)
            told = peer.stop_point + peer.setpoint * min(peer.age_s, PREDICT_S)
            off_m = abs(self._stop_point(at[k], velocity) - told)
            if off_m <= self._may_differ_m(velocity, now - contact.time_s):
                unlike[k] = False
                seen.append(peer.id)
            else:
                self.off[peer.id] = off_m
        self.seen = frozenset(seen)
        self.off = {i: off_m for i, off_m in self.off.items() if i not in self.seen}
        return unlike

    def _may_differ_m(self, velocity: complex, age_s: float) -> float:
        """Setpoints that the vehicle has yet to fly, and what it did since the contact."""
        response, limit = self._plan.response, self._plan.limits.speed_mps
        turned = min(response.acceleration_mps2 * age_s, limit)
        ahead_s = response.dead_time_s + response.lag_s
        return _STOPS_M + response.dead_time_s * (limit + abs(velocity)) + turned * ahead_s

    def _stands(self, contact: Contact, places: Sequence[Vector3]) -> bool:
        """It is a peer that has landed and ended, at its height as well: no other flies there."""
        if not places:
            return False
        at = ned_from_geodetic(contact.position, self._plan.origin)
        return any(math.dist(at, place) < _SAME_AIRCRAFT_M for place in places)

    def _place(self, contact: Contact) -> complex:
        """Where the report places it [m]; worked out once a report."""
        placed = self._placed.get(contact.address)
        if placed is None or placed[0] is not contact:
            north, east, _ = ned_from_geodetic(contact.position, self._plan.origin)
            placed = self._placed[contact.address] = (contact, complex(north, east))
        return placed[1]

    def _aircraft(self, now: float, contact: Contact, where: complex) -> OtherAircraft:
        velocity = _horizontal(contact.velocity_ned_mps)
        age_s = min(now - contact.time_s, PREDICT_S)
        stop = self._stop_point(where, velocity)
        return OtherAircraft(TRAFFIC, None, where, stop, velocity, age_s, age_s, fresh=True)

    def _stop_point(self, where: complex, velocity: complex) -> complex:
        """Of an aircraft with unknown setpoints: it flies on for the dead time, then brakes."""
        speed = abs(velocity)
        if self._plan.compensation is Compensation.NONE or speed < 1e-6:
            return where
        response = self._plan.response
        ahead_s = response.dead_time_s + stop_distance(speed, response) / speed
        return complex(where + velocity * ahead_s)


def _horizontal(vector: Sequence[float]) -> complex:
    return complex(vector[0], vector[1])
