"""From the snapshot of peers to what the law (26) takes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.core.model.messages import Phase
from swarm_ctl.core.model.plan import Compensation, Plan, Point
from swarm_ctl.core.model.rows import row
from swarm_ctl.core.swarm.snapshot import (
    TRAFFIC,
    Formation,
    OtherAircraft,
    PeerSnapshot,
    predicted_s,
)

Floats: TypeAlias = NDArray[np.float64]
Bools: TypeAlias = NDArray[np.bool_]


@row
class LawInput:
    """The other aircraft as the law takes them. All lists have one item an aircraft: the plan's
    other agents in its order, then traffic."""

    aircraft: tuple[OtherAircraft, ...]
    points: list[complex]
    """north + 1j * east [units]"""
    slots: list[complex]
    """Likewise; 0 without one."""
    linked: list[bool]
    """It is a neighbour, and heard."""
    present: list[bool]
    """It was heard, or seen."""
    lower: list[bool]
    """The own id is lower: decides which way two on one spot part."""
    along: list[bool]
    """Fresh, with a slot, and it flies the same formation."""

    def arrays(self) -> tuple[Floats, Floats, Bools, Bools, Bools]:
        """The arguments `others` to `lower_id` of `formation_law.evaluate`, which own laws take."""
        points, slots = (
            np.array(each, dtype=np.complex128).view(np.float64).reshape(1, -1, 2)
            for each in (self.points, self.slots)
        )
        neighbour, present, lower = (
            np.array([each], dtype=np.bool_) for each in (self.linked, self.present, self.lower)
        )
        return points, slots, neighbour, present, lower

    def errors_along(self) -> list[complex]:
        """Of each aircraft [units]; 0 where it does not fly along."""
        return [
            point - slot if along else 0j
            for point, slot, along in zip(self.points, self.slots, self.along, strict=True)
        ]


class LawInputBuilder:
    """Builds the law's input each tick; keeps what changes only when an aircraft comes or goes, or
    the slots change."""

    def __init__(self, plan: Plan, own_id: int) -> None:
        self._unit_m = plan.unit_m
        self._plain = plan.compensation is Compensation.NONE
        self._own = own_id
        self._traffic = -1
        self._slots: Mapping[int, Point] = {}

    def build(self, snapshot: PeerSnapshot, formation: Formation, lead_s: float) -> LawInput:
        """All aircraft that may be near.

        A peer is carried on with its setpoint for at most `lead_s` [s], then with the formation's
        common velocity for as long as a prediction holds (`predicted_s`). A peer without a slot is
        no neighbour.
        """
        slots, neighbours = formation.slots, formation.neighbours
        points: list[complex] = []
        present, linked, along = [], [], []
        now, plain, unit_m = snapshot.now_s, self._plain, self._unit_m
        key, velocity = formation.key, formation.velocity
        for peer in snapshot.peers:  # few calls: a large swarm has a hundred
            flies = peer.formation
            with_us = flies is not None and flies == key and peer.id in slots
            moving = velocity if with_us else 0j
            age_s = peer.age(now) if peer.far else peer.age_s
            lead = min(age_s, lead_s)
            further = min(age_s, predicted_s(peer)) - lead if moving else 0.0
            told = peer.stop_point + peer.setpoint * lead + moving * further
            points.append((peer.position if plain else told) / unit_m)
            present.append(peer.state is not None)
            along.append(with_us)
            linked.append(
                peer.followed
                and peer.state is not None
                and peer.id in neighbours
                and peer.id in slots
                and (with_us or not peer.elsewhere(key))  # mostly answered by the first
            )
        traffic = snapshot.traffic
        aircraft = snapshot.peers + traffic
        for other in traffic:
            points.append(other.stop_point / unit_m)
            present.append(True)
            along.append(False)
            linked.append(False)
        if slots is not self._slots or len(traffic) != self._traffic:
            self._slots, self._traffic = slots, len(traffic)
            self._places = [complex(*slots.get(other.id, (0.0, 0.0))) for other in aircraft]
            self._lower = [other.id == TRAFFIC or self._own < other.id for other in aircraft]
        return LawInput(
            aircraft=aircraft,
            points=points,
            slots=self._places,
            linked=linked,
            present=present,
            lower=self._lower,
            along=along,
        )


def flies_along(other: OtherAircraft) -> bool:
    """It was heard within `NEIGHBOUR_S` and flies the mission's law; traffic never does."""
    return other.followed and other.state is not None and other.state.phase is Phase.FLY
