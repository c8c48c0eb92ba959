"""What one agent's mission waits for: the barrier between steps, the peers it is flown without, and
how well the formation stands."""

from __future__ import annotations

import math
from typing import Final

from swarm_ctl.core.agent.failsafes import gave_up, left_by_order, progress_of
from swarm_ctl.core.agent.flight_context import FlightContext
from swarm_ctl.core.agent.tick import Tick
from swarm_ctl.core.law.formation import error_of_one
from swarm_ctl.core.model.causes import FailsafeAction
from swarm_ctl.core.model.messages import Severity
from swarm_ctl.core.model.plan import Policy
from swarm_ctl.core.swarm.snapshot import OtherAircraft, PeerSnapshot, predicted_s

_MEASURE_EVERY_S = 0.2
_LEADS_M: Final = 1.0
"""So far ahead of all others in the shape is one that they follow."""
_FLIES_MPS: Final = 0.1
"""A vehicle that is slower flies nowhere."""
ALONE_S: Final = 15.0
"""A command for all reaches all within ten seconds, or its sender gives it up."""


class Barrier:
    """The swarm of one agent's mission."""

    def __init__(self, context: FlightContext) -> None:
        self._plan = context.plan
        self._context = context
        self._measure_due = -math.inf
        self._held_since: dict[int, float] = {}
        """By agent: since when it flies a command that this agent does not."""
        self._alone_since = math.inf
        self.departed: dict[int, str] = {}
        """The peers that have left the formation, by id, and why: by an operator's order, or
        because a command has held them for longer than the mission waits."""
        self.accepted: set[int] = set()
        """Those of them that the operator has commanded to go on without."""
        self.formation_error_m: float | None = None
        """Largest |e_j - mean e| over the agents of the mission, itself included; None unless all
        of their states are fresh, or, of far peers, followed: the loss of three far words in a row
        is common among many, and must not stop the formation."""

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
        recent = peer.silent_s <= self._plan.policies.agent_lost_after_s
        return told if completed or recent else (-1, False)

    def watch_commands(self, tick: Tick, own_override: int) -> None:
        """Note which peers carry out a command that was not given to this agent, and which have
        left; call it every tick."""
        self._watch_held(tick, own_override)
        self._watch_alone(tick, own_override)
        before, pause_s = self.departed, self._pause_s
        held = self._held_since.keys() - self.waits_for(tick.now).keys()
        self.departed = {i: f"a command has held agent {i} for {pause_s:g} s" for i in held}
        for peer in tick.peers.peers:
            if peer.expelled:
                self.departed[peer.id] = f"agent {peer.id} was expelled by the operator"
            elif peer.left is not None and peer.state is not None:
                self.departed[peer.id] = left_by_order(peer.state)
        self.accepted &= self.departed.keys()
        self._context.slot_exchange.departed = self.departed
        goes_on = self._plan.policies.left_by_order is Policy.CONTINUE
        flies = goes_on and self._context.trigger is None
        for agent in (
            sorted(self.departed.keys() - before.keys()) if flies and self.departed else ()
        ):
            self._context.say(tick.now, Severity.INFO, f"goes on: {self.departed[agent]}")

    @property
    def held(self) -> bool:
        """This agent is held until the operator's `resume`, because agents have left."""
        trigger = self._context.trigger
        stopped = trigger is not None and trigger.action is FailsafeAction.HOLD
        by_policy = self._plan.policies.left_by_order is Policy.HOLD
        return stopped and by_policy and bool(self.departed.keys() - self.accepted)

    def accept(self) -> None:
        """The operator commands to go on without those that have left."""
        self.accepted = set(self.departed)

    def _watch_held(self, tick: Tick, own_override: int) -> None:
        held = [p.id for p in tick.peers.peers if p.held and p.left is None and not own_override]
        for agent in held:
            if agent not in self._held_since:
                text = f"waits for agent {agent}, which a command holds: {self._pause_s:g} s"
                self._context.say(tick.now, Severity.INFO, f"{text} at most")
        self._held_since = {agent: self._held_since.get(agent, tick.now) for agent in held}

    def _watch_alone(self, tick: Tick, own_override: int) -> None:
        """Peers fly the formation, and none of them the command that this agent flies."""
        if not own_override:
            self._alone_since = math.inf
            return
        flying = [p.formation[1] for p in tick.peers.peers if p.formation and p.left is None]
        alone = flying and own_override not in flying
        self._alone_since = min(self._alone_since, tick.now) if alone else math.inf

    def alone(self, now: float) -> bool:
        """For `ALONE_S` no peer has flown the command that this agent flies."""
        return now - self._alone_since > ALONE_S

    def waits_for(self, now: float) -> dict[int, float]:
        """The agents that a command holds, and for how long the mission still waits for each
        [s]."""
        if not self._held_since:
            return {}
        left = {i: self._pause_s - (now - since) for i, since in self._held_since.items()}
        return {i: left_s for i, left_s in left.items() if left_s > 0}

    @property
    def _pause_s(self) -> float:
        return self._plan.policies.override_pause_s

    def lost(self, peers: PeerSnapshot) -> set[int]:
        """The peers that the mission goes on without: those that have left, and, where the policy
        `agent_lost` is `continue`, those that are not heard for long or gave up."""
        policies = self._plan.policies
        if policies.agent_lost is not Policy.CONTINUE or not self._context.was_armed:
            return set(self.departed)
        return self.departed.keys() | {
            peer.id
            for peer in peers.peers
            if peer.state is not None
            and (
                peer.silent_s > policies.agent_lost_after_s
                or (peer.ends and gave_up(peer, self._plan))
            )
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

    def leads(self, tick: Tick) -> int | None:
        """The peer that by its own word is ahead of all others in the shape, the way that this
        vehicle flies. The law makes all follow it; a vehicle that is blown away leads itself."""
        context, fix, unit = self._context, tick.newest_fix, self._plan.unit_m
        slots = context.reference.slots
        velocity = complex(*fix.velocity_ned_mps[:2]) if fix is not None else 0j
        if context.agent not in slots or abs(velocity) < _FLIES_MPS:
            return None
        stops = {p.id: p.stop_point for p in tick.peers.peers if _counts(p) and p.id in slots}
        stops[context.agent] = complex(*context.controller.stop_point_m)
        way = velocity.conjugate() / abs(velocity)
        ahead = {i: (way * (at - complex(*slots[i]) * unit)).real for i, at in stops.items()}
        first, *others = sorted(ahead, key=lambda i: ahead[i], reverse=True)
        led = others and ahead[first] - ahead[others[0]] > _LEADS_M
        return first if led and first != context.agent else None

    def _error_m(self, tick: Tick) -> float | None:
        context, fix = self._context, tick.fix
        shape = context.reference.slots
        if not shape or fix is None:
            return None
        lost = self.lost(tick.peers)
        members = [p for p in tick.peers.peers if _counts(p) and p.id not in lost]
        expected = sum(
            not (peer.ends and gave_up(peer, self._plan))
            for peer in tick.peers.peers
            if peer.id not in lost
        )
        if len(members) < expected:
            return None
        unit = self._plan.unit_m
        own, at = complex(*fix.position_ned_m[:2]), [_position(p, tick.now) for p in members]
        step = context.progress.current
        if step is not None and step.spins:
            # The places move against each other. Vehicles lag behind them, their stop points do
            # not.
            own = complex(*context.controller.stop_point_m)
            at = [peer.stop_point + peer.setpoint * _since(peer, tick.now) for peer in members]
        ids = [context.agent, *(peer.id for peer in members)]
        slots = [complex(shape[i][0] * unit, shape[i][1] * unit) for i in ids]
        return error_of_one([own, *at], slots)


def _since(peer: OtherAircraft, now: float) -> float:
    """For how long [s] a far peer has flown on since its word; of a near one it counts as none."""
    return min(peer.age(now), predicted_s(peer)) if peer.far else 0.0


def _counts(peer: OtherAircraft) -> bool:
    """Where it is, is known well enough to measure the formation."""
    return peer.state is not None and (peer.followed if peer.far else peer.fresh)


def _position(peer: OtherAircraft, now: float) -> complex:
    if not peer.far or peer.state is None:
        return peer.position
    north, east, _ = peer.state.velocity_ned_mps
    return peer.position + complex(north, east) * _since(peer, now)
