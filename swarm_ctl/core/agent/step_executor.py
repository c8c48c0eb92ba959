"""From where an agent is in its mission to the tick's goal: prepare, take off, fly the formation,
or wind down."""

from __future__ import annotations

import math

from swarm_ctl.core.agent.barrier import Barrier
from swarm_ctl.core.agent.command_handler import CommandHandler
from swarm_ctl.core.agent.failsafes import failed
from swarm_ctl.core.agent.flight_context import FlightContext
from swarm_ctl.core.agent.landing import Landing
from swarm_ctl.core.agent.preflight import Preflight, swarm_flies
from swarm_ctl.core.agent.takeover import EVIDENCE_S, Takeover
from swarm_ctl.core.agent.tick import Tick
from swarm_ctl.core.control.navigation import OwnFix
from swarm_ctl.core.model.causes import Cause, FailsafeAction
from swarm_ctl.core.model.messages import CommandKind, Phase, Severity, StepOutcome
from swarm_ctl.core.model.plan import Point, Policy
from swarm_ctl.core.model.steps.step import Step
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.core.model.vehicle import AirborneGoal, Goal, ReleaseGoal, StandbyGoal
from swarm_ctl.core.swarm.snapshot import Formation

_HEIGHT_TOLERANCE_M = 0.5
_LIFTED_M = 0.15
"""A vehicle that says so much, and that it is not on the ground, has left it: either word alone may
be wrong for a moment."""


class StepExecutor:
    """Carries out one agent's steps. What it decides by and leaves behind is the context."""

    def __init__(
        self,
        context: FlightContext,
        preflight: Preflight,
        barrier: Barrier,
        command_handler: CommandHandler,
        landing: Landing,
        takeover: Takeover,
    ) -> None:
        self._context = context
        self._preflight = preflight
        self._barrier = barrier
        self._command_handler = command_handler
        self._landing = landing
        self._takeover = takeover
        self._scattered = False
        """A `hold` command came before the shape was formed: stay, do not go on forming."""
        self._inside_since: float | None = None
        self._judged_s = 0.0
        self._flies_since: float | None = None
        """Since when a peer has said that the first step is over, and this vehicle stands."""
        self._lifted_m: Point | None = None
        """Where the vehicle has left the ground."""
        self._last_text = self._cautioned = ""

    @property
    def override(self) -> int:
        """`Command.tag` of the command that is flown instead of the mission's step; 0: none."""
        override = self._command_handler.override
        return override.tag if override is not None else 0

    def begin(self) -> None:
        """A step begins: the mission's, a command's, or the mission's again."""
        self._inside_since = None

    def overridden(self, kind: str, before: Step | None) -> None:
        """A command of this kind takes the place of `before`, which was flown until now."""
        still = self._scattered and kind == CommandKind.HOLD
        forms = before is not None and before.new_shape is not None
        self._scattered = forms or still

    def decide(self, tick: Tick) -> Goal:
        """The tick's goal."""
        context, view = self._context, tick.view
        self._last_text = view.texts[-1] if view.texts else self._last_text
        context.reason = context.trigger.reason if context.trigger else ""
        if context.ended_s is not None:
            context.controller.rest()
            return ReleaseGoal()
        if self._takeover.pending(view):
            context.controller.rest()
            context.phase, context.reason = Phase.PREPARE, self._takeover.look(tick)
            return StandbyGoal()
        if context.progress.finished:
            return self._landing.end(tick.now)
        if context.trigger is not None:
            return self._landing.carry_out(tick, context.trigger)
        step = context.progress.current
        if step is None:
            return self._prepare(tick)
        if step.climbs_to_m is not None:
            return self._take_off(tick, step.climbs_to_m)
        if step.lands_in_place:
            return self._landing.land(tick)
        if step.goes_home:
            return self._landing.come_back(tick)
        learning = self._takeover.learning(tick, self.override)
        return learning or self._fly_formation(tick, step)

    def _prepare(self, tick: Tick) -> Goal:
        """Wait for a healthy vehicle on its planned start, and for peers and station with the same
        plan."""
        context, view = self._context, tick.view
        context.controller.rest()
        heard = math.isfinite(view.heartbeat_s)
        context.phase = Phase.PREPARE if heard else Phase.CONNECT
        flies = self._flies_already(tick)
        if flies:
            context.reason = flies
        elif view.armed and not context.was_armed and view.healthy:
            context.reason = "the vehicle is armed already; disarm it first"
        else:
            context.reason = self._preflight.refusal(tick) or self._unheard(tick)
        if not context.reason:
            self._warn(tick)
            context.progress.finish_step(tick.now)
            context.reason = "waiting for the others"
        elif context.progress.done:
            context.progress.done = False  # health can be lost again while waiting
        return StandbyGoal()

    def _flies_already(self, tick: Tick) -> str:
        """Why this vehicle does not take off any more, or ''; once that lasts, the agent ends."""
        flies = swarm_flies(tick.peers)
        if not flies:
            self._flies_since = None
            return ""
        self._flies_since = tick.now if self._flies_since is None else self._flies_since
        if tick.now - self._flies_since > EVIDENCE_S:
            self._context.heed(tick, failed(FailsafeAction.LAND, flies, Cause.PEER))
        return flies

    def _unheard(self, tick: Tick) -> str:
        """The peers that this agent has never heard, or '': the others see by it that the agent
        hears them."""
        gone = self._barrier.departed
        unheard = [p.id for p in tick.peers.peers if p.state is None and p.id not in gone]
        return f"{agents_named(unheard)} not heard" if unheard else ""

    def _warn(self, tick: Tick) -> None:
        caution = self._preflight.caution(tick)
        if caution and caution != self._cautioned:
            self._context.say(tick.now, Severity.INFO, caution)
        self._cautioned = caution or self._cautioned

    def _take_off(self, tick: Tick, height_m: float) -> Goal:
        context, view, fix = self._context, tick.view, tick.fix
        flies = "" if view.armed else self._flies_already(tick)
        if flies:
            context.phase, context.reason = Phase.ARM, flies
            context.controller.rest()
            return StandbyGoal()
        if not view.armed or fix is None:
            context.phase = Phase.ARM
            context.controller.rest()
            if fix is not None:
                context.ground_m = fix.height_m
            context.arming_s = tick.now
            context.reason = self._last_text or "waiting for the vehicle to arm"
            return AirborneGoal(height_m)
        context.phase = Phase.TAKEOFF
        context.target_height_m = context.planned_height_m = height_m
        missing_m = height_m - context.height(fix)
        climbs = missing_m > _HEIGHT_TOLERANCE_M and not context.progress.done
        # An autopilot's own take-off that a hold, a pilot or the end of an agent broke off is not
        # begun again in the air: setpoints bring the vehicle up.
        broken_off = context.setpoints.count > 0 or self._takeover.took
        if climbs and broken_off and view.controlled and not view.on_ground:
            return context.keep_clear(tick)
        if climbs:
            return self._climb(tick, fix, height_m)
        if view.controlled:
            context.progress.finish_step(tick.now)
        return context.keep_clear(tick)

    def _climb(self, tick: Tick, fix: OwnFix, height_m: float) -> Goal:
        """Straight up, against the wind, and out of the way of others. Until it has left the ground
        a vehicle is not steered: it would lean there."""
        context, controller = self._context, self._context.controller
        steered = tick.view.climbs_by_setpoints and tick.view.controlled
        stands = tick.view.on_ground or context.height(fix) < _LIFTED_M
        if stands or not steered or self._lifted_m is None:
            controller.rest()
            self._lifted_m = fix.position_ned_m[:2]
            return AirborneGoal(height_m)
        wanted = complex(*controller.stand_at(tick.peers, self._lifted_m))
        against = controller.headwind.meet(wanted, complex(*fix.velocity_ned_mps[:2]))
        sent = wanted + against - complex(*fix.drift_mps)
        return AirborneGoal(height_m, (sent.real, sent.imag))

    def _fly_formation(self, tick: Tick, step: Step) -> Goal:
        """The law in the mission's step, or in what a command has put in its place."""
        context, override, fix = self._context, self._command_handler.override, tick.fix
        context.phase = Phase.FLY
        if override is not None:
            context.reason = f"the operator commands: {override.kind}"
            stands = override.kind == CommandKind.HOLD and self._scattered
            if stands or override.kind == CommandKind.EXPEL:
                return context.keep_clear(tick)
        flown = override.step if override is not None else step
        if override is None and fix is not None:
            self._exchange_slots(tick, step)
        velocity = self._formation_velocity(tick, flown) if fix else None
        if override is None:
            self._judge(tick.now, step)
        return context.setpoint(tick.now, fix, velocity)

    def _formation_velocity(self, tick: Tick, step: Step) -> Point:
        context, reference = self._context, self._context.reference
        own, key = context.controller.stop_point_m, (context.progress.step, self.override)
        extra, common, spin, off = (0.0, 0.0), 0j, 0j, None
        if step.new_shape is None:
            free = context.trigger is None
            error_m = self._barrier.formation_error_m
            others = tick.peers.without(self._barrier.departed)
            reference.follow(others, step, key, own, error_m, free=free)
            extra = reference.feed_forward(step)
            off = reference.off_m(own) if reference.leads and reference.slots else None
            common, spin = complex(*reference.common_mps(step)), reference.spin(step)
        formation = Formation(reference.slots, context.neighbourhood.own, common, key, spin)
        return context.controller.form(tick.peers, formation, extra, off)

    def _exchange_slots(self, tick: Tick, step: Step) -> None:
        """Exchange slots with an agent that is in the way, where the step allows it."""
        context = self._context
        new = step.exchanges and not context.progress.done
        key = (context.progress.step, self.override)
        partner = context.slot_exchange.look(
            tick.now, context.controller.stop_point_m, key, context.neighbourhood.links, new=new
        )
        if partner is None:
            return
        context.reference.assign(context.slot_exchange.roles)
        self._inside_since = None
        text = f"takes the slot of agent {partner} (exchanged: they were in each other's way)"
        context.say(tick.now, Severity.INFO, text)

    def _judge(self, now: float, step: Step) -> None:
        """Is the own part of the step done? Or its time over, where the mission then goes on?"""
        context, progress = self._context, self._context.progress
        settling = step.settling
        if settling is None:
            lasted_s = now - progress.started_s - progress.paused_s
            if step.lasts_s is not None and lasted_s >= step.lasts_s:
                progress.finish_step(now)
            return
        late = step.on_timeout is Policy.CONTINUE and now > progress.timed_out_at
        unjudged_s, self._judged_s = now - self._judged_s, now
        error_m = self._barrier.formation_error_m
        inside = error_m is not None and error_m < settling.tolerance_m
        inside = inside and context.slot_exchange.settled(now)
        if step.new_shape is None:
            inside = inside and context.reference.there(step, context.controller.stop_point_m)
        if error_m is None and self._inside_since is not None:
            # Late states (a mesh that lost something and waits for it) tell nothing of the shape,
            # so settling takes longer by that much.
            self._inside_since = min(now, self._inside_since + unjudged_s)
        elif not inside:
            self._inside_since = None
        elif self._inside_since is None:
            self._inside_since = now
        elif now - self._inside_since >= settling.settle_s:
            progress.finish_step(now)
        if late:
            progress.finish_step(now, StepOutcome.TIMEOUT)
