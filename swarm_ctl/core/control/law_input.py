"""From the snapshot of peers to the rows that a law takes."""

from __future__ import annotations

from collections.abc import Mapping

from swarm_ctl.core.kernel.receiver import Known, out_of_reach
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


@row
class LawInput:
    """The other aircraft as the law takes them, in the plan's order, then traffic."""

    aircraft: list[OtherAircraft]
    """One a row."""
    rows: list[Known]
    errors: list[complex]
    """Of every aircraft, point minus slot [units]; 0 where it does not fly along."""
    along: int
    """How many do: fresh, with a slot, and in the same formation."""


class LawInputBuilder:
    """Builds the law's input each tick; keeps what changes only when an aircraft comes or goes, or
    the slots change."""

    def __init__(self, plan: Plan, own_id: int) -> None:
        self._unit_m = plan.unit_m
        self._plain = plan.compensation is Compensation.NONE
        self._own = own_id
        self._traffic = -1
        self._slots: Mapping[int, Point] = {}

    def build(
        self,
        snapshot: PeerSnapshot,
        formation: Formation,
        lead_s: float,
        own: complex,
        reach: float,
    ) -> LawInput:
        """All neighbours, and all aircraft within `reach` of `own` [units].

        A peer is carried on with its setpoint for at most `lead_s` [s], then with the formation's
        common velocity for as long as a prediction holds (`predicted_s`). A peer without a slot is
        no neighbour. One that is apart by height is no row, or, as a neighbour, one out of reach.
        """
        slots, neighbours = formation.slots, formation.neighbours
        now, plain, unit_m = snapshot.now_s, self._plain, self._unit_m
        key, velocity = formation.key, formation.velocity
        traffic, within, over = snapshot.traffic, reach * reach, snapshot.over
        if slots is not self._slots or len(traffic) != self._traffic:
            self._slots, self._traffic = slots, len(traffic)
            everyone = snapshot.peers + traffic
            self._places = [complex(*slots.get(other.id, (0.0, 0.0))) for other in everyone]
            self._lower = [other.id == TRAFFIC or self._own < other.id for other in everyone]
        new = tuple.__new__  # a third of the time that `Known(...)` takes
        aircraft: list[OtherAircraft] = []
        rows: list[Known] = []
        errors: list[complex] = []
        count = 0
        for peer, place, lower in zip(snapshot.peers, self._places, self._lower, strict=False):
            # few calls: a large swarm has a hundred
            agent, state, setpoint = peer.id, peer.state, peer.setpoint
            flies = peer.formation
            with_us = flies is not None and flies == key and agent in slots
            age_s = peer.age(now) if peer.far else peer.age_s
            lead = min(lead_s, age_s)
            if plain:
                point = peer.position / unit_m
            elif with_us and velocity:
                further = min(age_s, predicted_s(peer)) - lead
                point = (peer.stop_point + setpoint * lead + velocity * further) / unit_m
            else:
                point = (peer.stop_point + setpoint * lead) / unit_m
            if with_us:
                errors.append(point - place)
                count += 1
            else:
                errors.append(0j)
            if state is None:
                continue
            linked = (
                agent in neighbours
                and peer.followed
                and (with_us or (agent in slots and not peer.elsewhere(key)))
            )
            if not linked:
                q = own - point
                if not q.real * q.real + q.imag * q.imag < within:
                    continue
            if agent in over:
                if not linked:
                    continue
                off = out_of_reach(point - own, reach)
                point, place = point + off, place + off
            aircraft.append(peer)
            known = (agent, point, place, setpoint / unit_m, age_s, linked, lower)
            rows.append(new(Known, known))
        for other in traffic:
            errors.append(0j)
            point = other.stop_point / unit_m
            q = own - point
            if q.real * q.real + q.imag * q.imag < within:
                aircraft.append(other)
                flown = other.setpoint / unit_m
                rows.append(new(Known, (TRAFFIC, point, 0j, flown, other.age_s, False, True)))
        return LawInput(aircraft=aircraft, rows=rows, errors=errors, along=count)


def flies_along(other: OtherAircraft) -> bool:
    """It was heard within `NEIGHBOUR_S` and flies the mission's law; traffic never does."""
    return other.followed and other.state is not None and other.state.phase is Phase.FLY
