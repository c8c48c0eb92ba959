"""What one tick knows of the other aircraft: one immutable snapshot, read by law, filter and frame.

`Peers.snapshot` makes it once a tick. Horizontal vectors are complex numbers north + 1j * east in
the common frame, in m and m/s; ages are seconds at `now_s`.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Mapping
from dataclasses import replace
from typing import Final, TypeAlias

from swarm_ctl.core.model.messages import AgentState, CommandKind, Phase
from swarm_ctl.core.model.plan import Point
from swarm_ctl.core.model.rows import row
from swarm_ctl.core.model.timeouts import FAR_LATE_S, PREDICT_S
from swarm_ctl.core.model.vehicle import OVER_M

_HEIGHT_DOUBT_M: Final = 0.5
"""Agents know two vehicles' own estimates of height; the judge goes by the true ones."""
TRAFFIC: Final = 0
"""The id of an aircraft that the traffic sensor sees and no peer on the mesh explains."""

FormationKey: TypeAlias = tuple[str, int, int]
"""The group, its step, and the tag of the command that is flown in place of that, or 0."""


@row
class OtherAircraft:
    """A peer as it was heard last, or an aircraft that only the traffic sensor sees."""

    id: int
    """Agent id, or `TRAFFIC`."""
    state: AgentState | None = None
    """The newest state; None for traffic and for a peer that was never heard."""
    position: complex = 0j
    stop_point: complex = 0j
    """As it was told, `age_s` ago."""
    setpoint: complex = 0j
    """The velocity it was told to fly."""
    age_s: float = math.inf
    """Best guess."""
    age_at_most_s: float = math.inf
    """With all doubt about the sender's clock."""
    fresh: bool = False
    """Its state is at most `FRESH_S` old."""
    followed: bool = False
    """Its state is at most `NEIGHBOUR_S` old: it may be a neighbour."""
    yields: bool = False
    """It does its half of keeping apart."""
    formation: FormationKey | None = None
    """Whose formation it flies; None: none, or its state is not fresh."""
    response_s: float = 0.0
    """From a setpoint to its flown velocity, as it tells; 0: it tells none."""
    clock_unknown: bool = False
    """It is heard, and how far its clock is ahead is not known yet."""

    ends: bool = False
    """It says that its part is over, as all its states for `LASTS_S`: one may be forged. So it is
    with the next three."""
    left: CommandKind | None = None
    """The order by which it has left the formation (`AgentState.left`)."""
    down: bool = False
    """Its vehicle stands on the ground, and stays there: its flight is over, or it waits to be
    launched."""
    held: bool = False
    """It carries out a command."""
    expelled: bool = False
    """The operator has ordered not to listen to it."""
    suspect: bool = False
    """A word of it was not believed a moment ago."""
    far: bool = False
    """It is heard now and then: all limits of its age come `FAR_LATE_S` later, and `age_s` may be
    that of a tick before."""
    rare: bool = False
    """Its newest state was a far word."""
    true_s: float = -math.inf
    """When its state was true, on the own clock."""
    height_off_m: float = 0.0
    """By so much its heights have jumped in this flight (`HeightJumps`)."""
    listened_s: float = math.inf
    """For how long it has been listened to: it was expelled, or the agent itself was stopped."""

    def age(self, now: float) -> float:
        """Of its state at `now` [s]."""
        return now - self.true_s if self.far else self.age_s

    def elsewhere(self, key: FormationKey | None) -> bool:
        """It flies another step or command than `key`, by its newest state; or it has gone on, to
        land perhaps, while a command keeps the own agent."""
        told = self.state
        if told is None:
            return False
        if told.phase is not Phase.FLY:
            return key is not None and key[2] != 0 and told.step > key[1]
        return key is None or told.left is not None or (told.step, told.override) != key[1:]

    @property
    def silent_s(self) -> float:
        """Its age, less what its words may be later than states; who is not listened to is not
        silent."""
        return min(self.age_s - FAR_LATE_S if self.far else self.age_s, self.listened_s)


def predicted_s(peer: OtherAircraft) -> float:
    """For how long [s] a prediction of this peer holds."""
    return PREDICT_S + FAR_LATE_S if peer.far else PREDICT_S


@row
class PeerSnapshot:
    """All other aircraft at one tick."""

    now_s: float
    peers: tuple[OtherAircraft, ...]
    """Every other agent of the plan, in the plan's order, heard or not."""
    traffic: tuple[OtherAircraft, ...] = ()
    """What only the traffic sensor sees, nearest first."""
    over: frozenset[int] = frozenset()
    """The peers that the own vehicle is apart from by height (`core/safety/safety_filter.py`): no
    plane between them acts."""

    def without(self, gone: Container[int]) -> PeerSnapshot:
        """The same, as if the agents `gone` had never been heard."""
        if not gone or not any(peer.state is not None and peer.id in gone for peer in self.peers):
            return self
        left = (OtherAircraft(peer.id) if peer.id in gone else peer for peer in self.peers)
        return replace(self, peers=tuple(left))

    def aloft(self, down_m: float) -> PeerSnapshot:
        """What an agent at `down_m` of the common frame keeps clear of: without the vehicles that
        stand on the ground more than `OVER_M` below it, and what estimates of height err by."""
        return self.without(
            {
                peer.id
                for peer in self.peers
                if peer.down
                and peer.state is not None
                and peer.state.position_ned_m[2] - down_m > OVER_M + _HEIGHT_DOUBT_M
            }
        )

    def fresh(self) -> list[AgentState]:
        """The states that are at most `FRESH_S` old."""
        return [peer.state for peer in self.peers if peer.fresh and peer.state is not None]

    def age_s(self, agent: int) -> float:
        """Age of the newest state of `agent`; infinite where it was never heard."""
        return next((peer.age(self.now_s) for peer in self.peers if peer.id == agent), math.inf)

    def near(self, own: complex, reach_m: float) -> list[OtherAircraft]:
        """All aircraft whose told stop point is less than `reach_m` from the point `own`, but those
        `over` it."""
        found = [
            peer
            for peer in self.peers
            if peer.state is not None and abs(own - peer.stop_point) < reach_m
        ]
        if self.over:
            found = [peer for peer in found if peer.id not in self.over]
        found += (other for other in self.traffic if abs(own - other.stop_point) < reach_m)
        return found

    def far(self, ids: Iterable[int], own: complex, beyond_m: float) -> list[OtherAircraft]:
        """The peers in `ids` whose told stop point is more than `beyond_m` from `own`."""
        return [
            peer
            for peer in self.peers
            if peer.id in ids and peer.state is not None and abs(own - peer.stop_point) > beyond_m
        ]


@row
class Formation:
    """What an agent flies with its peers in this tick."""

    slots: Mapping[int, Point]
    """By agent [units]. Agents without a slot have no neighbour links."""
    neighbours: frozenset[int]
    """N_i as chosen, heard or not."""
    velocity: complex = 0j
    """The velocity that all of the formation share."""
    key: FormationKey | None = None
    """What peers of the same formation fly; None: no formation."""
    spin: complex = 0j
    """How it grows and turns about its centre [1/s] (`Motion.spin`)."""


NO_FORMATION: Final = Formation({}, frozenset())
"""Keep apart, and nothing else."""
