"""What one agent's mission waits for: the barrier between steps, the peers it is flown without, and
how well the formation stands."""

from __future__ import annotations

import math

from swarm_ctl.core.agent.failsafes import gave_up, progress_of
from swarm_ctl.core.agent.flight_context import FlightContext
from swarm_ctl.core.agent.tick import Tick
from swarm_ctl.core.law.formation import formation_error
from swarm_ctl.core.model.messages import AgentState, Severity
from swarm_ctl.core.model.plan import Policy, RotateStep, ScaleStep
from swarm_ctl.core.swarm.snapshot import OtherAircraft, PeerSnapshot

_MEASURE_EVERY_S = 0.2


class Barrier:
    """The swarm of one agent's mission."""

    def __init__(self, context: FlightContext) -> None:
        self._plan = context.plan
        self._context = context
        self._measure_due = -math.inf
        self._held_since: dict[int, float] = {}
        """By agent: since when it flies a command that this agent does not."""
        self.formation_error_m: float | None = None
        """Largest |e_j - mean e| over the agents of the mission, itself included; None unless all
        of their states are fresh."""

    def members(self, peers: PeerSnapshot) -> list[tuple[int, bool]]:
        """The progress that the barrier compares, (step, done), of every peer that it waits for.

        A silent peer blocks the barrier, unless the mission goes on without it.
        """
        lost = self.lost(peers)
        return [self._progress(peer) for peer in peers.peers if peer.id not in lost]

    def _progress(self, peer: OtherAircraft) -> tuple[int, bool]:
        if peer.state is None:
            return (-1, False)
        told = progress_of(peer.state)
        completed = told >= (len(self._plan.steps), True)  # silent because of that
        recent = peer.age_s <= self._plan.policies.agent_lost_after_s
        return told if completed or recent else (-1, False)

    def watch_commands(self, tick: Tick, own_override: int) -> None:
        """Note which peers carry out a command that was not given to this agent; call it every
        tick."""
        for peer in tick.peers.peers:
            apart = peer.state is not None and peer.state.override and not own_override
            if not apart:
                self._held_since.pop(peer.id, None)
            elif peer.id not in self._held_since:
                self._held_since[peer.id] = tick.now
                text = f"waits for agent {peer.id}, which a command holds: {self._pause_s:g} s"
                self._context.say(tick.now, Severity.INFO, f"{text} at most")

    def waits_for(self, now: float) -> dict[int, float]:
        """The agents that a command holds, and for how long the mission still waits for each
        [s]."""
        left = {i: self._pause_s - (now - since) for i, since in self._held_since.items()}
        return {i: left_s for i, left_s in left.items() if left_s > 0}

    def held_too_long(self, now: float) -> set[int]:
        """The agents that a command has held for longer than the mission waits."""
        return self._held_since.keys() - self.waits_for(now).keys()

    @property
    def _pause_s(self) -> float:
        return self._plan.policies.override_pause_s

    def lost(self, peers: PeerSnapshot) -> set[int]:
        """The peers that the mission goes on without: not heard for long, given up, or held by a
        command for too long, where the policy is `continue`."""
        policies = self._plan.policies
        if policies.agent_lost is not Policy.CONTINUE or not self._context.was_armed:
            return set()
        return self.held_too_long(peers.now_s) | {
            peer.id
            for peer in peers.peers
            if peer.state is not None
            and (peer.age_s > policies.agent_lost_after_s or gave_up(peer.state, self._plan))
        }

    def forget_shape(self) -> None:
        """Another shape is flown from now on: what was measured is the one before."""
        self.formation_error_m = None
        self._measure_due = -math.inf

    def measure(self, tick: Tick) -> None:
        """Keep `formation_error_m` up to date; call it every tick."""
        if tick.now >= self._measure_due:
            self._measure_due = tick.now + _MEASURE_EVERY_S
            self.formation_error_m = self._error_m(tick)

    def _error_m(self, tick: Tick) -> float | None:
        context, fix = self._context, tick.fix
        shape = context.reference.slots
        if not shape or fix is None:
            return None
        lost = self.lost(tick.peers)
        members = [state for state in tick.peers.fresh() if state.agent not in lost]
        expected = sum(
            not self._left(peer.state) for peer in tick.peers.peers if peer.id not in lost
        )
        if len(members) < expected:
            return None
        unit = self._plan.unit_m
        points = [fix.position_ned_m[:2], *(s.position_ned_m[:2] for s in members)]
        if isinstance(context.progress.current, RotateStep | ScaleStep):
            # The places move against each other. Vehicles lag behind them, their stop points do
            # not.
            points = [context.controller.stop_point_m, *(s.stop_point_m for s in members)]
        ids = [context.agent, *(state.agent for state in members)]
        slots = [(shape[i][0] * unit, shape[i][1] * unit) for i in ids]
        return float(formation_error(points, slots))

    def _left(self, state: AgentState | None) -> bool:
        return state is not None and bool(gave_up(state, self._plan))
