"""From the snapshot of peers to the arrays that the law (26) takes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.core.model.messages import Phase
from swarm_ctl.core.model.plan import Compensation, Plan, Point
from swarm_ctl.core.model.rows import row
from swarm_ctl.core.swarm.snapshot import Formation, OtherAircraft, PeerSnapshot, predicted_s

Floats: TypeAlias = NDArray[np.float64]
Bools: TypeAlias = NDArray[np.bool_]

_LITTLE_MORE: Final = 1.0 + 1e-9
"""The law compares squares, which are rounded otherwise."""


class Columns(NamedTuple):
    """What of the law's input changes only when a peer comes, goes or gets another slot, as
    `formation_law.evaluate` takes it: leading size 1."""

    slots: Floats
    """(1, k, 2) [units]"""
    neighbour: Bools
    """(1, k), as the following two."""
    present: Bools
    lower_id: Bools
    """The own id is lower: decides which way two on one spot part."""


@row
class LawInput:
    """The other aircraft as the law takes them. All lists have one item an aircraft: the plan's
    other agents in its order, then traffic."""

    aircraft: tuple[OtherAircraft, ...]
    points: list[complex]
    """north + 1j * east [units]"""
    slots: list[complex]
    """Likewise; 0 without one."""
    linked: list[int]
    """The places of the neighbours that are heard."""
    along: list[bool]
    """Fresh, with a slot, and it flies the same formation."""
    columns: Columns

    def near(self, own: complex, radius: float) -> bool:
        """Whether one may be closer than `radius` to `own` [units]; never wrongly false."""
        reach = radius * _LITTLE_MORE
        return any(abs(point - own) < reach for point in self.points)

    def arrays(self) -> tuple[Floats, Floats, Bools, Bools, Bools]:
        """The arguments `others` to `lower_id` of `formation_law.evaluate`."""
        points = np.array(self.points, dtype=np.complex128).view(np.float64)
        return points.reshape(1, -1, 2), *self.columns

    def errors_linked(self) -> list[complex]:
        """The neighbours' distances from their slots [units]."""
        return [self.points[k] - self.slots[k] for k in self.linked]

    def errors_along(self) -> list[complex]:
        """Of each aircraft [units]; 0 where it does not fly along."""
        return [
            point - slot if along else 0j
            for point, slot, along in zip(self.points, self.slots, self.along, strict=True)
        ]


class LawInputBuilder:
    """Builds the law's input each tick; keeps the columns that change only when a peer comes, goes
    or gets another slot."""

    def __init__(self, plan: Plan, own_id: int) -> None:
        self._unit_m = plan.unit_m
        self._plain = plan.compensation is Compensation.NONE
        self._own = own_id
        self._key: tuple[list[bool], list[bool], int] | None = None
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
        now, plain = snapshot.now_s, self._plain
        for peer in snapshot.peers:  # few calls: a large swarm has a hundred
            with_us = (
                peer.formation is not None and peer.formation == formation.key and peer.id in slots
            )
            moving = formation.velocity if with_us else 0j
            age_s = peer.age(now) if peer.far else peer.age_s
            lead = min(age_s, lead_s)
            further = min(age_s, predicted_s(peer)) - lead if moving else 0.0
            told = peer.stop_point + peer.setpoint * lead + moving * further
            points.append(peer.position if plain else told)
            present.append(peer.state is not None)
            along.append(with_us)
            linked.append(
                peer.followed
                and peer.id in neighbours
                and peer.id in slots
                and (with_us or not peer.elsewhere(formation.key))  # mostly answered by the first
            )
        points += (other.stop_point for other in snapshot.traffic)
        aircraft = snapshot.peers + snapshot.traffic
        key = (present, linked, len(snapshot.traffic))
        if key != self._key or slots is not self._slots:
            self._key, self._slots = key, slots
            self._columns = _columns(aircraft, key, slots, self._own)
            self._places = [complex(*slots.get(other.id, (0.0, 0.0))) for other in aircraft]
            self._linked = [k for k, is_linked in enumerate(linked) if is_linked and present[k]]
        along += [False] * len(snapshot.traffic)
        unit_m = self._unit_m
        points = [point / unit_m for point in points]
        return LawInput(aircraft, points, self._places, self._linked, along, self._columns)


def _columns(
    aircraft: tuple[OtherAircraft, ...],
    key: tuple[list[bool], list[bool], int],
    slots: Mapping[int, Point],
    own_id: int,
) -> Columns:
    present, linked, traffic = key
    offsets = [slots.get(other.id, (0.0, 0.0)) for other in aircraft]
    return Columns(
        np.array(offsets, dtype=np.float64).reshape(1, -1, 2),
        np.array([linked + [False] * traffic], dtype=np.bool_),
        np.array([present + [True] * traffic], dtype=np.bool_),
        np.array([[other.id == 0 or own_id < other.id for other in aircraft]], dtype=np.bool_),
    )


def flies_along(other: OtherAircraft) -> bool:
    """It was heard within `NEIGHBOUR_S` and flies the mission's law; traffic never does."""
    return other.followed and other.state is not None and other.state.phase is Phase.FLY
