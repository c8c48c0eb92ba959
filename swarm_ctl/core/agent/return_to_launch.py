"""The way back: all agents at once, in layers, to where they started.

Each agent first climbs to its layer, flies over its own start, and lands there. The safety
filter keeps all pairs apart horizontally, whatever their heights, as in the mission. Who stands in
the way of one with a lower id makes room until that one lands; who stands in the way of nobody and
can't go on lands where it is, and says so.
"""

from __future__ import annotations

import math
from typing import Final

from swarm_ctl.core.control.navigation import OwnFix
from swarm_ctl.core.model.messages import AgentState, Phase, ReturnStage
from swarm_ctl.core.model.plan import Plan, Point
from swarm_ctl.core.model.timeouts import FAR_EVERY_S
from swarm_ctl.core.model.vehicle import OVER_M
from swarm_ctl.core.swarm.hearing import hears_all
from swarm_ctl.core.swarm.snapshot import OtherAircraft, PeerSnapshot

HEIGHT_TOLERANCE_M: Final = 0.7
HOME_TOLERANCE_M: Final = 0.5
"""Above the start; the landing itself adds some."""
_SETTLE_S: Final = 1.0
"""At the own height this long before setting out: meanwhile the peers' states arrive. Two far words
longer in a large swarm: the one that tells that a peer returns, and the own one."""
_SLOW_MPS: Final = 0.3
_MEAN_S: Final = 0.5
"""The mean of the velocity over so long says whether the vehicle is slow: one word of it errs by up
to `_SLOW_MPS`."""
_BLOCKED_S: Final = 8.0
"""Standing still this long on the way: something is in the way. For good, if it is no agent that
comes down itself (a lost agent's vehicle): then the agent lands beside it."""
_OUTLIVED_S: Final = 5.0
"""[s]: an agent that heard another peer for so much longer is not deaf. As long as peers wait by
default before they call one lost (`policies.agent_lost_after_s`)."""
_NEAR: Final = 2.0
"""[of r_out]: a peer so near to the own stop point may be what is in the way."""
_LAYERS: Final = 3
"""Heights on the way back. The filter keeps pairs apart without them; with one for each agent the
last of sixteen climbed by 45 m."""
_CLEAR_M: Final = 1.0
"""Above `OVER_M`, so that vehicles on the ground are flown over."""


class ReturnToLaunch:
    """One agent's way back."""

    def __init__(self, plan: Plan, own_id: int) -> None:
        self._own = own_id
        self._settle_s = _SETTLE_S if hears_all(plan) else _SETTLE_S + 2.0 * FAR_EVERY_S
        self._at_height_since: float | None = None
        self._still_since: float | None = None
        self._mean_share = plan.tick_s / (_MEAN_S + plan.tick_s)
        self._mean_mps: complex | None = None
        """Of the velocity on the way."""
        self._near_m = _NEAR * plan.law.r_out * plan.unit_m
        start, unit = plan.agent(own_id).start, plan.unit_m
        self.home_m: Point = (start[0] * unit, start[1] * unit)
        """The own start in the common frame."""
        self.height_m = return_height_m(plan, own_id)
        """The own height on the way back, above the take-off point."""
        self.stage = ReturnStage.CLIMB
        self.blocked = False
        """It can't get home: something that does not come down is in the way."""

    def update(self, peers: PeerSnapshot, fix: OwnFix | None, height_m: float) -> ReturnStage:
        """One tick; `height_m` is above the take-off point."""
        now = peers.now_s
        if fix is None or self.stage is ReturnStage.DOWN:
            return self.stage
        if self.stage in (ReturnStage.FLY, ReturnStage.WAIT):
            self._fly(peers, fix)
            return self.stage
        if abs(height_m - self.height_m) > HEIGHT_TOLERANCE_M:
            self._at_height_since = None
        elif self._at_height_since is None:
            self._at_height_since = now
        if self._at_height_since is not None and now - self._at_height_since >= self._settle_s:
            self.stage = ReturnStage.WAIT if deserted(peers) else ReturnStage.FLY
        return self.stage

    def _fly(self, peers: PeerSnapshot, fix: OwnFix) -> None:
        now = peers.now_s
        velocity = complex(*fix.velocity_ned_mps[:2])
        mean = velocity if self._mean_mps is None else self._mean_mps
        self._mean_mps = mean + self._mean_share * (velocity - mean)
        if deserted(peers):
            self.stage = ReturnStage.WAIT
        if self.stage is ReturnStage.WAIT:
            first = any(self._goes_first(peer) for peer in self._beside(peers, fix))
            if not first and not deserted(peers):
                self.stage, self._still_since = ReturnStage.FLY, None
            return
        if abs(self._mean_mps) >= _SLOW_MPS:
            self._still_since = None
            return
        self._still_since = now if self._still_since is None else self._still_since
        if math.dist(fix.position_ned_m[:2], self.home_m) < HOME_TOLERANCE_M:
            self.stage = ReturnStage.DOWN
        elif now - self._still_since > _BLOCKED_S:
            beside = self._beside(peers, fix)
            if any(self._goes_first(peer) for peer in beside):
                self.stage = ReturnStage.WAIT
            elif not any(_comes_down(peer) for peer in beside):
                self.stage, self.blocked = ReturnStage.DOWN, True

    def _beside(self, peers: PeerSnapshot, fix: OwnFix) -> list[OtherAircraft]:
        own = complex(*fix.position_ned_m[:2])
        return [peer for peer in peers.near(own, self._near_m) if peer.followed]

    def _goes_first(self, peer: OtherAircraft) -> bool:
        state = peer.state
        if state is None or state.phase is not Phase.RETURN:
            return False
        return state.stage != ReturnStage.DOWN and peer.id < self._own


def _comes_down(peer: OtherAircraft) -> bool:
    """It is on its way home, or lands: it will not be in the way for good."""
    return (
        peer.state is not None
        and in_the_air(peer.state)
        and peer.state.phase in (Phase.RETURN, Phase.LAND)
    )


def deserted(peers: PeerSnapshot) -> bool:
    """No peer is heard although some should be in the air: then no agent knows where they fly. Of
    those that are expelled none is listened to: that says nothing. Nor does one that fell silent
    while another one was heard, which has ended since: this agent hears, and that one was lost."""
    told = [peer for peer in peers.peers if peer.state is not None and not peer.expelled]
    up = [peer for peer in told if peer.state is not None and in_the_air(peer.state)]
    if not up or any(peer.followed for peer in up):
        return False
    least_s = min(peer.silent_s for peer in up)
    return least_s - min(peer.silent_s for peer in told) <= _OUTLIVED_S


def in_the_air(state: AgentState) -> bool:
    """By its newest state the agent is in the air and does not end."""
    return state.airborne and state.phase is not Phase.ENDED


def highest_m(plan: Plan, agent_id: int) -> float:
    """Up to which height above the origin the vehicle flies over its start."""
    steps = plan.steps_of(agent_id)
    up_m = max((step.climbs_to_m or 0.0 for step in steps), default=0.0)
    returns = any(step.goes_home for step in steps)
    return max(up_m, return_height_m(plan, agent_id)) if returns else up_m


def return_height_m(plan: Plan, agent_id: int) -> float:
    """Height above the take-off point on the way back: the mission's, or what flies over vehicles
    on the ground, and one of three layers above it, a separation apart as far as the fence allows.
    Agents that follow each other in the plan have different ones."""
    rank = [agent.id for agent in plan.agents].index(agent_id)
    steps = plan.steps_of(agent_id)
    first = next((up_m for step in steps if (up_m := step.climbs_to_m) is not None), 10.0)
    over_m = OVER_M + _CLEAR_M
    first = max(first, over_m if plan.fence is None else min(over_m, plan.fence.height_m - 2.0))
    layers, separation = min(_LAYERS, len(plan.agents)), plan.policies.return_separation_m
    if plan.fence is not None and layers > 1:
        room = max(0.0, plan.fence.height_m - 2.0 - first)
        separation = min(separation, room / (layers - 1))
    return first + rank % layers * separation
