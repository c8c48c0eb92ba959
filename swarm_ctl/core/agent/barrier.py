"""Who one agent flies its mission with: what the barrier waits for, who is lost, how the shape
stands."""

from __future__ import annotations

import math

from swarm_ctl.core.agent import failsafes
from swarm_ctl.core.agent.flight_context import FlightContext
from swarm_ctl.core.agent.progress import Progress
from swarm_ctl.core.control.controller import Controller
from swarm_ctl.core.control.navigation import OwnFix
from swarm_ctl.core.control.reference import Reference
from swarm_ctl.core.law.formation import formation_error
from swarm_ctl.core.model.messages import AgentState
from swarm_ctl.core.model.plan import Plan, Policy, RotateStep, ScaleStep
from swarm_ctl.core.swarm.peers import Peers

_MEASURE_EVERY_S = 0.2


class Barrier:
    """The swarm of one agent's mission."""

    def __init__(
        self,
        sortie: FlightContext,
        peers: Peers,
        controller: Controller,
        progress: Progress,
        reference: Reference,
    ) -> None:
        self._plan: Plan = sortie.plan
        self._sortie = sortie
        self._peers = peers
        self._controller = controller
        self._progress = progress
        self._reference = reference
        self._measure_due = -math.inf
        self.formation_error_m: float | None = None
        """Largest |e_j - mean e| over everybody heard, itself included; None unless all of them are
        fresh."""

    def barrier(self, now: float) -> list[tuple[int, bool]]:
        """What the barrier waits for: the whole plan. Silent ones block it, unless the policy is to
        go on without."""
        lost, members = self.lost(now), []
        for peer in self._peers:
            heard = peer.state if peer.age(now) <= self._plan.policies.agent_lost_after_s else None
            if peer.state is not None and failsafes.progress_of(peer.state) >= (
                len(self._plan.steps),
                True,
            ):
                heard = peer.state  # through, and silent because of it
            if peer.id not in lost:
                members.append(failsafes.progress_of(heard) if heard is not None else (-1, False))
        return members

    def lost(self, now: float) -> set[int]:
        """Who the mission goes on without: not heard for long, or given up, where its policy is to
        go on."""
        policies = self._plan.policies
        if policies.agent_lost is not Policy.CONTINUE or not self._sortie.was_armed:
            return set()
        return {
            peer.id
            for peer in self._peers
            if peer.state is not None
            and (
                peer.age(now) > policies.agent_lost_after_s
                or failsafes.gave_up(peer.state, self._plan)
            )
        }

    def forget_shape(self) -> None:
        """Another shape is flown from now on: what was measured is the one before."""
        self.formation_error_m = None
        self._measure_due = -math.inf

    def measure(self, now: float, fix: OwnFix | None) -> None:
        """Keep `formation_error_m` up to date; call it every tick."""
        if now >= self._measure_due:
            self._measure_due = now + _MEASURE_EVERY_S
            self.formation_error_m = self._error_m(now, fix)

    def _error_m(self, now: float, fix: OwnFix | None) -> float | None:
        shape = self._reference.slots
        if not shape or fix is None:
            return None
        lost = self.lost(now)
        members = [s for s in self._peers.fresh(now) if s.agent not in lost]
        if len(members) < sum(
            not self._left(peer.state) for peer in self._peers if peer.id not in lost
        ):
            return None
        unit = self._plan.unit_m
        points = [(fix.position_ned_m[0], fix.position_ned_m[1])]
        points += [(s.position_ned_m[0], s.position_ned_m[1]) for s in members]
        if isinstance(self._progress.current, RotateStep | ScaleStep):
            # the places themselves move against each other: vehicles lag behind them, their stop
            # points do not
            points = [self._controller.stop_point_m, *(s.stop_point_m for s in members)]
        ids = [self._sortie.agent, *(s.agent for s in members)]
        slots = [(shape[i][0] * unit, shape[i][1] * unit) for i in ids]
        return float(formation_error(points, slots))

    def _left(self, state: AgentState | None) -> bool:
        return state is not None and bool(failsafes.gave_up(state, self._plan))
