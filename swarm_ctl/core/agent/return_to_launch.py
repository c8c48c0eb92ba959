"""The way back: one agent at a time, each at a height of its own, to where it started.

Each agent first climbs to its own height and waits there. The lowest id flies, at its height, over
its own start; while it lands, the next one sets out. The order follows from the states that agents
tell, without a coordinator: an agent that is not heard is not waited for. Horizontal avoidance
stays on all the way, so waiting agents make room.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Final

from swarm_ctl.core.control.navigation import OwnFix
from swarm_ctl.core.model.messages import AgentState, Phase
from swarm_ctl.core.model.plan import Plan, Point, TakeoffStep
from swarm_ctl.core.model.timeouts import FAR_EVERY_S
from swarm_ctl.core.swarm.hearing import hears_all
from swarm_ctl.core.swarm.snapshot import PeerSnapshot

HEIGHT_TOLERANCE_M: Final = 0.7
HOME_TOLERANCE_M: Final = 0.5
"""Above the start; the landing itself adds some."""
_SETTLE_S: Final = 1.0
"""At the own height this long before setting out: meanwhile the peers' states arrive. Two far words
longer in a large swarm: the one that tells that a peer returns, and the own one."""
_SLOW_MPS: Final = 0.3
_BLOCKED_S: Final = 8.0
"""Standing still this long on the way: something is in the way for good (a lost agent's vehicle),
so the agent lands beside it."""


class ReturnStage(IntEnum):
    """How far the way back is; on the wire as `AgentState.stage`."""

    CLIMB = 0
    WAIT = 1
    FLY = 2
    DOWN = 3


class ReturnToLaunch:
    """One agent's way back."""

    def __init__(self, plan: Plan, own_id: int) -> None:
        self._own = own_id
        self._settle_s = _SETTLE_S if hears_all(plan) else _SETTLE_S + 2.0 * FAR_EVERY_S
        self._at_height_since: float | None = None
        self._still_since: float | None = None
        start, unit = plan.agent(own_id).start, plan.unit_m
        self.home_m: Point = (start[0] * unit, start[1] * unit)
        """The own start in the common frame."""
        self.height_m = return_height_m(plan, own_id)
        """The own height on the way back, above the take-off point."""
        self.stage = ReturnStage.CLIMB

    def update(self, peers: PeerSnapshot, fix: OwnFix | None, height_m: float) -> ReturnStage:
        """One tick; `height_m` is above the take-off point."""
        now = peers.now_s
        if fix is None or self.stage is ReturnStage.DOWN:
            return self.stage
        if self.stage is ReturnStage.FLY:
            self._fly(now, fix)
            return self.stage
        if abs(height_m - self.height_m) > HEIGHT_TOLERANCE_M:
            self._at_height_since = None
        elif self._at_height_since is None:
            self._at_height_since = now
        if self._at_height_since is None or now - self._at_height_since < self._settle_s:
            self.stage = ReturnStage.CLIMB
        else:
            self.stage = ReturnStage.FLY if self._my_turn(peers) else ReturnStage.WAIT
        return self.stage

    def _fly(self, now: float, fix: OwnFix) -> None:
        if math.hypot(*fix.velocity_ned_mps[:2]) >= _SLOW_MPS:
            self._still_since = None
            return
        self._still_since = now if self._still_since is None else self._still_since
        home = math.dist(fix.position_ned_m[:2], self.home_m) < HOME_TOLERANCE_M
        if home or now - self._still_since > _BLOCKED_S:
            self.stage = ReturnStage.DOWN

    def _my_turn(self, peers: PeerSnapshot) -> bool:
        if deserted(peers):
            return False
        for peer in peers.peers:
            state = peer.state
            if state is None or not peer.followed or state.phase is not Phase.RETURN:
                continue
            flying = state.stage == ReturnStage.FLY
            if flying or (state.stage != ReturnStage.DOWN and peer.id < self._own):
                return False
        return True


def deserted(peers: PeerSnapshot) -> bool:
    """No peer is heard although some should be in the air: then no agent knows whose turn it is."""
    up = [peer for peer in peers.peers if peer.state is not None and in_the_air(peer.state)]
    return bool(up) and not any(peer.followed for peer in up)


def in_the_air(state: AgentState) -> bool:
    """By its newest state the agent is in the air and does not end."""
    return state.airborne and state.phase is not Phase.ENDED


def return_height_m(plan: Plan, agent_id: int) -> float:
    """Height above the take-off point on the way back: the mission's, and a separation for each
    agent before this one in the plan, as far as the fence allows."""
    rank = [agent.id for agent in plan.agents].index(agent_id)
    first = next((step.height_m for step in plan.steps if isinstance(step, TakeoffStep)), 10.0)
    separation = plan.policies.return_separation_m
    if plan.fence is not None and len(plan.agents) > 1:
        room = max(0.0, plan.fence.height_m - 2.0 - first)
        separation = min(separation, room / (len(plan.agents) - 1))
    return first + rank * separation
