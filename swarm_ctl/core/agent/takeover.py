"""An agent that starts and finds its vehicle in the air. A restarted agent takes its own vehicle
over; it leaves any other alone.

What it demands before it sends a single setpoint (all of it at once, within `EVIDENCE_S`):
1. the vehicle is heard, of the planned autopilot, armed, in the air, its position known by both of
   its messages;
2. the vehicle is in the mode that follows setpoints (an ArduCopter whose agent has died stays in
   GUIDED and stands), or, while the swarm takes off, in the autopilot's own take-off or hold, or
   it lands as the swarm does. LOITER and BRAKE of an ArduCopter are a pilot's modes;
3. the vehicle has our failsafe parameters, so an agent of ours has armed it. They are read, never
   set, on an armed vehicle;
4. the vehicle stands still over the ground, so no other process sends it setpoints;
5. an agent of the same plan is heard and flies this mission, or the operator has told this one to
   land; no agent with another plan is heard, and for a second no other process speaks with this
   agent's id.

Meanwhile the agent sends nothing but heartbeats and requests. Without the evidence it ends, and its
heartbeats with it: the vehicle is left to its own failsafe, or to the pilot who flies it. A vehicle
that lands already is seen down, not stopped. To a vehicle in a pilot's mode the agent yields.

An agent that yielded to a pilot takes its vehicle again by the operator's `resume`, once the
vehicle itself says that it is in the controlled mode again: no agent asks a pilot's vehicle for a
mode.

A vehicle that was taken over or taken again is held where it is (avoidance on) for `LEARN_S`, and
for as long as its peers carry out a command that came before this agent did. Then it flies the
swarm's step.
"""

from __future__ import annotations

import math
from typing import Final

from swarm_ctl.core.agent.failsafes import FailsafeTrigger, failed
from swarm_ctl.core.agent.group import Group
from swarm_ctl.core.agent.interruption import EventLog, Interruption
from swarm_ctl.core.agent.own_vehicle import OwnVehicle
from swarm_ctl.core.agent.preflight import Preflight
from swarm_ctl.core.agent.steering import Intent, KeepClear
from swarm_ctl.core.agent.tick import Tick
from swarm_ctl.core.control.navigation import OwnFix
from swarm_ctl.core.model.causes import Cause, FailsafeAction
from swarm_ctl.core.model.messages import AgentState, Outcome, Phase, Severity
from swarm_ctl.core.model.timeouts import FRESH_S, NEIGHBOUR_S
from swarm_ctl.core.model.vehicle import VehicleView

EVIDENCE_S: Final = 5.0
"""Heartbeats come once a second, lost parameter answers are asked for again after one, and a mesh
link is up after half a second. Our heartbeats keep the vehicle's own failsafe from landing it
meanwhile, so the agent looks no longer than that takes."""
LEARN_S: Final = 1.0
"""Twenty states of each peer, and time for the peers to see that this agent flies by setpoints
again."""
_STANDS_MPS: Final = 0.5
"""An ArduCopter left alone is slower than this 3 s after 5 m/s; gusts move it less."""
_IN_THE_AIR: Final = frozenset({Phase.TAKEOFF, Phase.FLY, Phase.HOLD, Phase.RETURN, Phase.LAND})
_DECIDED: Final = frozenset({FailsafeAction.LEAVE, FailsafeAction.YIELD, FailsafeAction.KILL})


class Takeover:
    """One agent's way from a vehicle found in the air to the mission, or away from it."""

    def __init__(
        self,
        agent: int,
        vehicle: OwnVehicle,
        group: Group,
        interruption: Interruption,
        log: EventLog,
        preflight: Preflight,
    ) -> None:
        self._agent, self._log = agent, log
        self._vehicle, self._group, self._interruption = vehicle, group, interruption
        self._preflight = preflight
        self._since: float | None = None
        self._double_s = -math.inf
        """When a state with our own id was heard last."""
        self._step = -1
        """The step that it rejoined at; -1: it took no vehicle over."""
        self._learn_until: float | None = None

    @property
    def took(self) -> bool:
        """It took a vehicle over in the air, or again."""
        return self._step >= 0

    def hear(self, state: AgentState, received_s: float) -> None:
        """A state with our own id comes from another process."""
        if state.agent == self._agent:
            self._double_s = received_s

    def pending(self, view: VehicleView) -> bool:
        """The vehicle is in the air, not by our doing, and nothing is decided yet."""
        trigger = self._interruption.trigger
        decided = trigger is not None and trigger.action in _DECIDED
        found = view.armed and not view.on_ground and not self._vehicle.ours
        return found and not decided and self._group.progress.step == 0

    def look(self, tick: Tick) -> str:
        """One tick of looking: takes over, or fires a trigger that is carried out from the next
        tick on. Returns why it waits, or ''."""
        now, fix = tick.now, tick.fix
        self._since = now if self._since is None else self._since
        flying = self._flying(tick)
        if flying and not self._may_follow(tick.view, flying):
            self._vehicle.leave(now)
            return self._decide(tick, _not_followed(tick.view))
        missing = self._missing(tick, proven=bool(flying) or self._told_to_land(tick.view))
        if not missing and fix is not None and now - self._since >= NEIGHBOUR_S:
            self._take(tick, fix, flying)
            return ""
        if missing and now - self._since > EVIDENCE_S:
            why = f"a vehicle in the air is not taken over: {missing}"
            return self._decide(tick, failed(FailsafeAction.LEAVE, why))
        return (
            f"the vehicle is in the air; {missing or 'listening for another process that flies it'}"
        )

    def learning(self, tick: Tick, override: int) -> Intent | None:
        """While a vehicle that was just taken over is held; None: fly on.

        `override` is the tag of the command that this agent carries out.
        """
        if self._step < 0:
            return None
        self._follow_hold(tick)
        group = self._group.ids
        flying = (s for s in self._flying(tick) if s.agent in group)
        foreign = any(s.override not in (0, override) for s in flying)
        if self._learn_until is None or (tick.now >= self._learn_until and not foreign):
            self._learn_until = None
            return None
        waits = "waits for the operator's command to end"
        reason = waits if foreign else "taken over: holds while it learns"
        return Intent(KeepClear(), Phase.HOLD, reason)

    # --- the evidence ---

    def _told_to_land(self, view: VehicleView) -> bool:
        """By the operator, before it was known whose this vehicle is; and no pilot flies it."""
        trigger = self._interruption.trigger
        if trigger is None or trigger.action is not FailsafeAction.LAND:
            return False
        return trigger.outcome is Outcome.ABORTED and view.controlled

    def _missing(self, tick: Tick, *, proven: bool) -> str:
        view, fix = tick.view, tick.fix
        if tick.now - self._double_s <= NEIGHBOUR_S:
            return f"another process speaks as agent {self._agent}"
        other_plan = self._preflight.other_plan(tick.peers, None)
        if other_plan:
            return other_plan
        if not view.healthy or fix is None or fix.age_s > FRESH_S or view.global_ is None:
            return view.health_reason or "no position yet"
        apart = self._preflight.disagreement(tick)
        if apart:
            return apart
        if not proven:
            return "no agent that flies this mission is heard"
        speed = math.hypot(*fix.velocity_ned_mps[:2])
        if speed > _STANDS_MPS:
            return f"it moves at {speed:.1f} m/s: a pilot may fly it"
        return ""

    def _flying(self, tick: Tick) -> list[AgentState]:
        """The newest states of the peers that fly this mission, and with this agent or after it."""
        routes, proven = self._group.routes.of, self._group.routes.proven
        return [
            state
            for state in tick.peers.fresh()
            if state.plan_hash == self._preflight.plan_hash
            and state.airborne
            and state.left is None
            and state.phase in _IN_THE_AIR
            and 0 < state.step <= len(routes[state.agent].steps)
            and proven(self._agent, state.agent, state.step) > 0
        ]

    def _may_follow(self, view: VehicleView, flying: list[AgentState]) -> bool:
        step = self._group.progress.steps[self._step_of(flying) - 1]
        if step.lands_in_place and view.landing:
            return True
        return view.controlled

    # --- what comes of it ---

    def _decide(self, tick: Tick, trigger: FailsafeTrigger) -> str:
        self._interruption.heed(tick, trigger)
        return trigger.reason

    def _take(self, tick: Tick, fix: OwnFix, flying: list[AgentState]) -> None:
        vehicle, progress, now = self._vehicle, self._group.progress, tick.now
        step = self._step_of(flying)
        vehicle.take_over(now, fix.height_m - _height_above_home(tick.view, fix))
        heights = [up_m for each in progress.steps[:step] if (up_m := each.climbs_to_m) is not None]
        vehicle.climb_to(heights[-1] if heights else vehicle.height(fix))
        if flying:
            self._group.slot_exchange.rejoin(now)
            self._rejoin(now, step, flying)
            text = f"took over its vehicle in the air; rejoins at step {step}: {progress.name}"
        else:
            text = "took over its vehicle in the air, to land it"
        self._log.say(now, Severity.WARNING, text)
        own = tick.view.own
        if own is None or all(value.own in value.ours for value in own.values.values()):
            text = "the vehicle's own failsafe parameters are not known any more: it keeps ours"
            self._log.say(now, Severity.WARNING, text)

    def _rejoin(self, now: float, step: int, flying: list[AgentState]) -> None:
        """Go on at this step, with the formation as the peers have it."""
        self._step = step
        self._group.rejoin(now, step, flying)
        current = self._group.progress.current
        if current is not None and current.flies_formation:
            self._learn_until = now + LEARN_S

    # --- a vehicle that a pilot gives back ---

    def not_given_back(self, view: VehicleView) -> str:
        """Why an agent that yielded cannot take its vehicle again, or ''."""
        trigger, agent = self._interruption.trigger, f"agent {self._agent}"
        if trigger is None or trigger.action is not FailsafeAction.YIELD or not self._vehicle.ours:
            return f"{agent} does not fly this vehicle any more"
        if not view.armed or view.on_ground:
            return f"the vehicle of {agent} is not in the air"
        if not view.controlled or view.mode_doubt:
            wanted = view.controlled_mode
            return f"the vehicle of {agent} is in {view.mode}; set {wanted}, then `resume` again"
        return ""

    def take_back(self, tick: Tick) -> None:
        """By the operator's word: hold for `LEARN_S`, then fly the swarm's step."""
        progress, flying = self._group.progress, self._flying(tick)
        self._interruption.lift()
        self._vehicle.take_back()
        step = max(progress.step, self._step_of(flying))
        self._rejoin(tick.now, step, flying)
        text = f"takes its vehicle again; goes on at step {step}: {progress.name}"
        self._log.say(tick.now, Severity.WARNING, text)
        if tick.peers.peers and not flying:
            why = "no other agent flies the mission any more"
            self._interruption.heed(tick, failed(FailsafeAction.LAND, why, Cause.PEER))

    def behind(self, tick: Tick) -> bool:
        """The others are further in the mission than this agent."""
        return self._step_of(self._flying(tick)) > self._group.progress.step

    def take_up(self, tick: Tick, override: int) -> bool:
        """Where the others are in the own step, or in the command of this tag that is flown in its
        place; whether some fly it."""
        return self._group.take_up([s for s in self._flying(tick) if s.override == override])

    def catch_up(self, tick: Tick, override: int = 0) -> bool:
        """To the step of the others, who went on without this agent, which a command held for long
        or has launched, and to where they are in it; whether there are such."""
        flying = self._flying(tick)
        step = self._step_of(flying)
        if step <= self._group.progress.step:
            return self.take_up(tick, override)
        self._rejoin(tick.now, step, flying)
        return True

    def _step_of(self, flying: list[AgentState]) -> int:
        """The own step: the furthest that the steps of these peers prove."""
        routes = self._group.routes
        return max((routes.proven(self._agent, s.agent, s.step) for s in flying), default=0)

    def swarm_goes_down(self, tick: Tick) -> str:
        """That the mission has come to its end, as the peers fly it, or ''."""
        step = self._step_of(self._flying(tick))
        steps = self._group.progress.steps
        return steps[step - 1].title if step and steps[step - 1].goes_down else ""

    def _follow_hold(self, tick: Tick) -> None:
        """This agent has not seen the beginning of a hold step: the step is over when a peer says
        so."""
        progress = self._group.progress
        step = progress.current
        if progress.step != self._step or step is None or step.lasts_s is None:
            return
        group = self._group.ids
        flying = (s for s in self._flying(tick) if s.agent in group)
        if any((s.step, s.done) >= (self._step, True) for s in flying):
            progress.finish_step(tick.now)


def _not_followed(view: VehicleView) -> FailsafeTrigger:
    if view.landing:
        why = f"the vehicle lands already ({view.mode}): seen down"
        return failed(FailsafeAction.LAND, why)
    why = f"the vehicle is in the air in {view.mode}, a mode that no agent set: not taken over"
    return failed(FailsafeAction.YIELD, why, Cause.PILOT)


def _height_above_home(view: VehicleView, fix: OwnFix) -> float:
    """[m], carried on to the time of the fix; home is where the vehicle was armed."""
    if view.global_ is None or view.local is None:
        return 0.0
    later = view.local.time_s + min(fix.age_s, FRESH_S) - view.global_.time_s
    return view.global_.relative_alt_m - fix.velocity_ned_mps[2] * later
