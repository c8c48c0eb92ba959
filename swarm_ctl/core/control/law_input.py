"""From the snapshot of peers to the arrays that the law (26) takes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.core.model.messages import Phase
from swarm_ctl.core.model.plan import Compensation, Plan, Point
from swarm_ctl.core.model.rows import row
from swarm_ctl.core.swarm.snapshot import Formation, OtherAircraft, PeerSnapshot, predicted_s

Floats: TypeAlias = NDArray[np.float64]
Bools: TypeAlias = NDArray[np.bool_]


@row
class LawInput:
    """The other aircraft as `formation_law.evaluate` takes them: leading size 1, lengths in units.

    Column k is `aircraft[k]`: the plan's other agents in its order, then traffic.
    """

    aircraft: tuple[OtherAircraft, ...]
    points: Floats
    """(1, k, 2)"""
    slots: Floats
    """(1, k, 2)"""
    neighbour: Bools
    """(1, k), as the following two."""
    present: Bools
    lower_id: Bools
    """The own id is lower: decides which way two on one spot part."""
    along: Bools
    """(k,): fresh, with a slot, and it flies the same formation."""


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
        for peer in snapshot.peers:
            with_us = (
                peer.formation is not None and peer.formation == formation.key and peer.id in slots
            )
            moving = formation.velocity if with_us else 0j
            points.append(self._point(peer, peer.age(snapshot.now_s), lead_s, moving))
            present.append(peer.state is not None)
            along.append(with_us)
            linked.append(peer.followed and peer.id in neighbours and peer.id in slots)
        points += (other.stop_point for other in snapshot.traffic)
        aircraft = snapshot.peers + snapshot.traffic
        key = (present, linked, len(snapshot.traffic))
        if key != self._key or slots is not self._slots:
            self._key, self._slots = key, slots
            self._columns = _columns(aircraft, key, slots, self._own)
        where = np.array(points, dtype=np.complex128).view(np.float64).reshape(1, -1, 2)
        along += [False] * len(snapshot.traffic)
        return LawInput(
            aircraft, where / self._unit_m, *self._columns, np.array(along, dtype=np.bool_)
        )

    def _point(self, peer: OtherAircraft, age_s: float, lead_s: float, moving: complex) -> complex:
        """Where the law takes a peer to be [m]: its stop point carried on, or its position
        (`compensation: none`)."""
        if self._plain:
            return peer.position
        lead = min(age_s, lead_s)
        further = min(age_s, predicted_s(peer)) - lead
        return peer.stop_point + peer.setpoint * lead + moving * further


def _columns(
    aircraft: tuple[OtherAircraft, ...],
    key: tuple[list[bool], list[bool], int],
    slots: Mapping[int, Point],
    own_id: int,
) -> tuple[Floats, Bools, Bools, Bools]:
    """slots, neighbour, present, lower_id."""
    present, linked, traffic = key
    offsets = [slots.get(other.id, (0.0, 0.0)) for other in aircraft]
    return (
        np.array(offsets, dtype=np.float64).reshape(1, -1, 2),
        np.array([linked + [False] * traffic], dtype=np.bool_),
        np.array([present + [True] * traffic], dtype=np.bool_),
        np.array([[other.id == 0 or own_id < other.id for other in aircraft]], dtype=np.bool_),
    )


def flies_along(other: OtherAircraft) -> bool:
    """It was heard within `NEIGHBOUR_S` and flies the mission's law; traffic never does."""
    return other.followed and other.state is not None and other.state.phase is Phase.FLY
