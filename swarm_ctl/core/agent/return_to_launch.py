"""The way back: one agent at a time, each at a height of its own, to where it started.

Everybody first climbs to its own height and waits there; the lowest id flies, at its height, over
its own start; while it lands, the next one sets out. The order is made of told states, no
coordinator: an agent that is not heard is not waited for. Horizontal avoidance stays on the whole
way, so those that wait make room.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Final

from swarm_ctl.core.control.navigation import OwnFix
from swarm_ctl.core.model.messages import AgentState, Phase
from swarm_ctl.core.model.plan import Plan, Point, TakeoffStep
from swarm_ctl.core.model.timeouts import NEIGHBOUR_S
from swarm_ctl.core.swarm.peers import Peers

HEIGHT_TOLERANCE_M: Final = 0.7
HOME_TOLERANCE_M: Final = 0.5
"""Above the start; the landing itself adds some."""
_SETTLE_S: Final = 1.0
"""At the own height this long before setting out: the others' news travel meanwhile."""
_SLOW_MPS: Final = 0.3
_BLOCKED_S: Final = 8.0
"""Standing still this long on the way: something is in the way for good (a lost agent's vehicle);
land beside it."""


class Stage(IntEnum):
    """How far the way back is; on the wire as `AgentState.stage`."""

    CLIMB = 0
    WAIT = 1
    FLY = 2
    DOWN = 3


class ReturnToLaunch:
    """One agent's way back."""

    def __init__(self, plan: Plan, own_id: int, peers: Peers) -> None:
        self._plan = plan
        self._own = own_id
        self._peers = peers
        self._at_height_since: float | None = None
        self._still_since: float | None = None
        self.stage = Stage.CLIMB

    @property
    def home_m(self) -> Point:
        """The own start in the common frame."""
        start, unit = self._plan.agent(self._own).start, self._plan.unit_m
        return start[0] * unit, start[1] * unit

    @property
    def height_m(self) -> float:
        """The own height for the way back, above the take-off point."""
        return return_height_m(self._plan, self._own)

    def update(self, now: float, fix: OwnFix | None, height_m: float) -> Stage:
        """One tick."""
        if fix is None or self.stage is Stage.DOWN:
            return self.stage
        if self.stage is Stage.FLY:
            self._fly(now, fix)
            return self.stage
        if abs(height_m - self.height_m) > HEIGHT_TOLERANCE_M:
            self._at_height_since = None
        elif self._at_height_since is None:
            self._at_height_since = now
        settled = self._at_height_since is not None and now - self._at_height_since >= _SETTLE_S
        self.stage = (
            Stage.FLY if settled and self._my_turn(now) else Stage.WAIT if settled else Stage.CLIMB
        )
        return self.stage

    def _fly(self, now: float, fix: OwnFix) -> None:
        if math.hypot(*fix.velocity_ned_mps[:2]) >= _SLOW_MPS:
            self._still_since = None
            return
        self._still_since = now if self._still_since is None else self._still_since
        home = math.dist(fix.position_ned_m[:2], self.home_m) < HOME_TOLERANCE_M
        if home or now - self._still_since > _BLOCKED_S:
            self.stage = Stage.DOWN

    def alone(self, now: float) -> bool:
        """Nobody is heard although somebody should be in the air: without news there is no order to
        keep."""
        up = [peer for peer in self._peers if peer.state is not None and flies(peer.state)]
        return bool(up) and all(peer.age(now) > NEIGHBOUR_S for peer in up)

    def _my_turn(self, now: float) -> bool:
        if self.alone(now):
            return False
        for peer in self._peers:
            s = peer.state
            if (
                s is None
                or peer.age(now) > NEIGHBOUR_S
                or s.phase is not Phase.RETURN
                or s.stage == Stage.DOWN
            ):
                continue
            if s.stage == Stage.FLY or peer.id < self._own:
                return False
        return True


def flies(state: AgentState) -> bool:
    """The agent has said last that it is in the air and not about to end."""
    return state.airborne and state.phase is not Phase.ENDED


def return_height_m(plan: Plan, agent_id: int) -> float:
    """Height above the take-off point on the way back: the mission's, and a separation for each
    agent before."""
    rank = [agent.id for agent in plan.agents].index(agent_id)
    first = next((step.height_m for step in plan.steps if isinstance(step, TakeoffStep)), 10.0)
    separation = plan.policies.return_separation_m
    if plan.fence is not None and len(plan.agents) > 1:
        separation = min(
            separation, max(0.0, (plan.fence.height_m - 2.0 - first) / (len(plan.agents) - 1))
        )
    return first + rank * separation
