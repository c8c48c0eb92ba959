"""An agent that starts and finds its vehicle in the air: a restarted one takes it over, everybody
else leaves it alone.

What is demanded before a single setpoint is sent (all of it at once, within `EVIDENCE_S`):
1. the vehicle is heard, of the planned autopilot, armed, in the air, its position known by both of
   its messages;
2. it is in the mode that follows setpoints (an ArduCopter whose agent has died stays in GUIDED and
   stands), or, while the swarm takes off, in the autopilot's own take-off or hold, or it lands as
   the swarm does. LOITER of an ArduCopter is a pilot's, and so is BRAKE;
3. it has our failsafe parameters: one of us has armed it. They are read, never set, on an armed
   vehicle;
4. it stands still over the ground: nobody sends it setpoints;
5. an agent of the same plan is heard and flies this mission, none with another plan is, and nobody
   speaks as us (for a second).

While that is looked for, nothing but heartbeats and requests is sent. Without it the agent ends,
and its heartbeats with it: the vehicle is its own failsafe's, or whoever's it was. A vehicle that
lands already is seen down, not stopped; one in a pilot's mode is yielded.

Taken over, it is held where it is (avoidance on) for `LEARN_S`, and as long as the others carry out
an operator's command that came before this agent did. Then it flies the swarm's step like everybody
else.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from swarm_ctl.core.agent.failsafes import FailsafeTrigger
from swarm_ctl.core.agent.flight_context import FlightContext
from swarm_ctl.core.agent.preflight import Preflight
from swarm_ctl.core.agent.progress import Progress, step_name
from swarm_ctl.core.control.controller import Controller
from swarm_ctl.core.control.navigation import OwnFix
from swarm_ctl.core.control.reference import Reference
from swarm_ctl.core.model.messages import AgentState, Phase
from swarm_ctl.core.model.plan import FormStep, HoldStep, LandStep, Plan, ReturnStep, TakeoffStep
from swarm_ctl.core.model.timeouts import FRESH_S, NEIGHBOUR_S
from swarm_ctl.core.model.vehicle import FlyGoal, VehicleView
from swarm_ctl.core.swarm.peers import Peers
from swarm_ctl.core.swarm.slot_exchange import SlotExchange

EVIDENCE_S: Final = 5.0
"""Heartbeats come once a second, lost parameter answers are asked for again after one, a mesh link
is up after half a second; our heartbeats keep the vehicle's own failsafe from landing it meanwhile,
so not longer than that takes."""
LEARN_S: Final = 1.0
"""Twenty states of each peer, and one of the others' time to see that this one flies by setpoints
again."""
_STANDS_MPS: Final = 0.5
"""An ArduCopter left alone is under this 3 s after 5 m/s; gusts move it less."""
_IN_THE_AIR: Final = frozenset({Phase.TAKEOFF, Phase.FLY, Phase.HOLD, Phase.RETURN, Phase.LAND})


class Takeover:
    """One agent's way from a vehicle found in the air to the mission, or away from it."""

    def __init__(
        self,
        sortie: FlightContext,
        gate: Preflight,
        controller: Controller,
        progress: Progress,
        reference: Reference,
        form: Callable[[FormStep], None],
        dealer: SlotExchange,
    ) -> None:
        self._plan: Plan = sortie.plan
        self._sortie = sortie
        self._gate = gate
        self._peers: Peers = gate.peers
        self._controller = controller
        self._progress = progress
        self._reference = reference
        self._form = form
        """Begins a form step."""
        self._dealer = dealer
        self._since: float | None = None
        self._double_s = -math.inf
        self._step = -1
        self._learn_until: float | None = None

    def hear(self, state: AgentState, received_s: float) -> None:
        """It may be another process with our id."""
        if state.agent == self._sortie.agent:
            self._double_s = received_s

    def pending(self, view: VehicleView) -> bool:
        """The vehicle is in the air and not by our doing; nothing is decided yet."""
        sortie = self._sortie
        decided = sortie.finding is not None and sortie.finding.action in ("leave", "yield", "kill")
        found = view.armed and not view.on_ground and not sortie.ours
        return found and not decided and self._progress.step == 0

    def look(self, now: float, view: VehicleView, fix: OwnFix | None) -> str:
        """One tick of looking: takes over, refuses (a finding, carried out from the next tick on),
        or why it waits."""
        sortie = self._sortie
        self._since = now if self._since is None else self._since
        flying = self._flying(now)
        if flying and not self._may_follow(view, flying):
            sortie.arming_s = now
            return self._decide(now, fix, _not_followed(view))
        missing = self._missing(now, view, fix, flying)
        if not missing and fix is not None and now - self._since >= NEIGHBOUR_S:
            self._take(now, view, fix, flying)
            return ""
        if missing and now - self._since > EVIDENCE_S:
            why = f"a vehicle in the air is not taken over: {missing}"
            return self._decide(now, fix, FailsafeTrigger("leave", "failed", why))
        return f"the vehicle is in the air; {missing or 'listening whether anybody else flies it'}"

    def learning(
        self, now: float, view: VehicleView, fix: OwnFix | None, command: int
    ) -> FlyGoal | None:
        """The setpoint while a vehicle just taken over is held; None: fly on."""
        if self._step < 0:
            return None
        self._catch_up(now)
        foreign = any(s.command not in (0, command) for s in self._flying(now))
        if self._learn_until is None or (now >= self._learn_until and not foreign):
            self._learn_until = None
            return None
        sortie = self._sortie
        sortie.phase = Phase.HOLD
        sortie.reason = (
            "waits for the operator's command to end"
            if foreign
            else "taken over: holds while it learns"
        )
        return sortie.setpoint(
            now, fix, self._controller.keep_clear(now, view.contacts) if fix else None
        )

    # --- the evidence ---

    def _missing(
        self, now: float, view: VehicleView, fix: OwnFix | None, flying: list[AgentState]
    ) -> str:
        other_plan = self._gate.other_plan(None)
        if now - self._double_s <= NEIGHBOUR_S:
            return f"another process speaks as agent {self._sortie.agent}"
        if other_plan:
            return other_plan
        if not view.healthy or fix is None or fix.age_s > FRESH_S or view.global_ is None:
            return view.health_reason or "no position yet"
        apart = self._gate.disagrees(view, fix)
        if apart:
            return apart
        if not flying:
            return "no agent that flies this mission is heard"
        speed = math.hypot(*fix.velocity_ned_mps[:2])
        return (
            f"it moves at {speed:.1f} m/s: somebody else may fly it" if speed > _STANDS_MPS else ""
        )

    def _flying(self, now: float) -> list[AgentState]:
        """Who is heard in the air in this mission."""
        heard = (s for s in self._peers.fresh(now) if s.plan_hash == self._gate.plan_hash)
        return [
            s
            for s in heard
            if s.airborne and s.phase in _IN_THE_AIR and 0 < s.step <= len(self._plan.steps)
        ]

    def _may_follow(self, view: VehicleView, flying: list[AgentState]) -> bool:
        step = self._plan.steps[_step_of(flying) - 1]
        if isinstance(step, LandStep) and view.landing:
            return True
        return view.controlled or (isinstance(step, TakeoffStep) and view.taken_off)

    # --- what comes of it ---

    def _decide(self, now: float, fix: OwnFix | None, finding: FailsafeTrigger) -> str:
        self._sortie.heed(now, finding, fix, self._progress)
        return finding.reason

    def _take(self, now: float, view: VehicleView, fix: OwnFix, flying: list[AgentState]) -> None:
        sortie, plan = self._sortie, self._plan
        self._step = step = _step_of(flying)
        sortie.arming_s, sortie.was_armed = now, True
        sortie.ground_m = fix.height_m - _height_above_home(view, fix)
        heights = [each.height_m for each in plan.steps[:step] if isinstance(each, TakeoffStep)]
        sortie.target_height_m = sortie.planned_height_m = (
            heights[-1] if heights else sortie.height(fix)
        )
        self._progress.rejoin(step, now)
        self._dealer.rejoin(now)
        for each in plan.steps[:step]:
            if isinstance(each, FormStep):
                self._form(each)
        self._reference.frame = min(
            (s for s in flying if s.step == step), key=lambda s: s.agent
        ).frame
        sortie.say(
            now,
            "warning",
            f"took over its vehicle in the air; rejoins at step {step}: {step_name(plan, step)}",
        )
        sortie.say(
            now,
            "warning",
            "the vehicle's own failsafe parameters are not known any more: it keeps ours",
        )
        if not isinstance(plan.steps[step - 1], TakeoffStep | LandStep | ReturnStep):
            self._learn_until = now + LEARN_S

    def _catch_up(self, now: float) -> None:
        """A hold lasts from its beginning, which this agent has not seen: it is over when another
        says so."""
        progress = self._progress
        if progress.step != self._step or not isinstance(progress.current, HoldStep):
            return
        if any((s.step, s.done) >= (self._step, True) for s in self._flying(now)):
            progress.finish_step(now)


def _not_followed(view: VehicleView) -> FailsafeTrigger:
    if view.landing:
        return FailsafeTrigger(
            "land", "failed", f"the vehicle lands already ({view.mode}): seen down"
        )
    why = f"the vehicle is in the air in {view.mode}, which is somebody else's word: not taken over"
    return FailsafeTrigger("yield", "failed", why)


def _step_of(flying: list[AgentState]) -> int:
    """The swarm's step: the furthest that anybody is in proves all before it."""
    return max(s.step for s in flying)


def _height_above_home(view: VehicleView, fix: OwnFix) -> float:
    """[m], carried on to the time of the fix; home is where the vehicle was armed."""
    if view.global_ is None or view.local is None:
        return 0.0
    later = view.local.time_s + min(fix.age_s, FRESH_S) - view.global_.time_s
    return view.global_.relative_alt_m - fix.velocity_ned_mps[2] * later
