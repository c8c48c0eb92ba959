"""From where an agent is in its mission to what it does in this tick: prepare, take off, fly the
formation, or wind down."""

from __future__ import annotations

import math

from swarm_ctl.core.agent.command_handler import CommandHandler
from swarm_ctl.core.agent.failsafes import failed
from swarm_ctl.core.agent.group import Group
from swarm_ctl.core.agent.interruption import EventLog, Interruption
from swarm_ctl.core.agent.landing import WANDERS_M, Landing
from swarm_ctl.core.agent.own_vehicle import OwnVehicle
from swarm_ctl.core.agent.preflight import Preflight, swarm_flies
from swarm_ctl.core.agent.steering import (
    ClimbOver,
    Course,
    FlyShape,
    FlyTo,
    Intent,
    KeepClear,
    SetpointCount,
)
from swarm_ctl.core.agent.takeover import EVIDENCE_S, Takeover
from swarm_ctl.core.agent.tick import Tick
from swarm_ctl.core.control.navigation import OwnFix
from swarm_ctl.core.model.causes import Cause, FailsafeAction
from swarm_ctl.core.model.messages import CommandKind, Phase, Severity, StepOutcome
from swarm_ctl.core.model.plan import Point, Policy
from swarm_ctl.core.model.steps.step import Step
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.core.model.vehicle import AirborneGoal, ReleaseGoal, StandbyGoal

_HEIGHT_TOLERANCE_M = 0.5
_LIFTED_M = 0.15
"""A vehicle that says so much, and that it is not on the ground, has left it: either word alone may
be wrong for a moment."""


class StepExecutor:
    """Carries out one agent's steps."""

    def __init__(
        self,
        vehicle: OwnVehicle,
        group: Group,
        interruption: Interruption,
        log: EventLog,
        preflight: Preflight,
        command_handler: CommandHandler,
        landing: Landing,
        takeover: Takeover,
        setpoints: SetpointCount,
    ) -> None:
        self._vehicle, self._group, self._interruption = vehicle, group, interruption
        self._log, self._setpoints = log, setpoints
        self._preflight = preflight
        self._command_handler = command_handler
        self._landing = landing
        self._takeover = takeover
        self._scattered = False
        """A `hold` command came before the shape was formed: stay, do not go on forming."""
        self._stays_up = False
        """It has stopped its climb for that."""
        self._inside_since: float | None = None
        self._judged_s = 0.0
        self._flies_since: float | None = None
        """Since when a peer has said that the first step is over, and this vehicle stands."""
        self._lifted_m: Point | None = None
        """Where the vehicle has left the ground."""
        self._last_text = self._cautioned = ""

    def begin(self) -> None:
        """A step begins: the mission's, a command's, or the mission's again."""
        self._inside_since = None

    def overridden(self, kind: str, before: Step | None) -> None:
        """A command of this kind takes the place of `before`, which was flown until now."""
        still = self._scattered and kind == CommandKind.HOLD
        forms = before is not None and before.new_shape is not None
        self._scattered = forms or still or self._group.away
        self._stays_up = still and self._stays_up

    def decide(self, tick: Tick, own_m: Point) -> Intent:
        """What the agent does in this tick; `own_m` is its stop point."""
        view, progress, interruption = tick.view, self._group.progress, self._interruption
        self._last_text = view.texts[-1] if view.texts else self._last_text
        if self._vehicle.ended_s is not None:
            return Intent(ReleaseGoal(), Phase.ENDED)
        if self._takeover.pending(view):
            return Intent(StandbyGoal(), Phase.PREPARE, self._takeover.look(tick))
        if progress.finished:
            return self._landing.end(tick.now)
        if interruption.trigger is not None:
            left = self._command_handler.left is not None
            return self._landing.carry_out(tick, interruption.trigger, left=left)
        step = progress.current
        if step is None:
            return self._prepare(tick)
        if step.climbs_to_m is not None:
            return self._take_off(tick, step.climbs_to_m)
        if step.lands_in_place:
            return self._landing.land(tick)
        if step.goes_home:
            return self._landing.come_back(tick)
        learning = self._takeover.learning(tick, self._command_handler.tag)
        return learning or self._fly_formation(tick, step, own_m)

    def _prepare(self, tick: Tick) -> Intent:
        """Wait for a healthy vehicle on its planned start, and for peers and station with the same
        plan."""
        view, progress = tick.view, self._group.progress
        heard = math.isfinite(view.heartbeat_s)
        phase = Phase.PREPARE if heard else Phase.CONNECT
        if self._group.grounded and self._group.all_over(tick.peers):
            progress.finish_step(tick.now, StepOutcome.SKIPPED)
            return self._landing.end(tick.now)
        flies = "" if self._group.grounded else self._flies_already(tick)
        if flies:
            reason = flies
        elif view.armed and not self._vehicle.was_armed and view.healthy:
            reason = "the vehicle is armed already; disarm it first"
        else:
            reason = self._preflight.refusal(tick) or self._unheard(tick)
        if not reason and self._group.grounded:
            launched = self._command_handler.launched
            reason = self._flown_over(tick) if launched else "waits to be launched"
        if not reason:
            self._warn(tick)
            progress.finish_step(tick.now)
            reason = "waiting for the others"
        elif progress.done:
            progress.done = False  # health can be lost again while waiting
        return Intent(StandbyGoal(), phase, reason)

    def _flies_already(self, tick: Tick) -> str:
        """Why this vehicle does not take off any more, or ''; once that lasts, the agent ends."""
        flies = swarm_flies(self._group.mates(tick))
        if not flies:
            self._flies_since = None
            return ""
        self._flies_since = tick.now if self._flies_since is None else self._flies_since
        if tick.now - self._flies_since > EVIDENCE_S:
            self._interruption.heed(tick, failed(FailsafeAction.LAND, flies, Cause.PEER))
        return flies

    def _unheard(self, tick: Tick) -> str:
        """The peers that this agent has never heard, or '': the others see by it that the agent
        hears them."""
        gone = self._group.departed
        unheard = [p.id for p in tick.peers.peers if p.state is None and p.id not in gone]
        return f"{agents_named(unheard)} not heard" if unheard else ""

    def _flown_over(self, tick: Tick) -> str:
        """Who is over a vehicle that is to climb, or ''. They make room for it."""
        if tick.fix is None:
            return ""
        plan, own = self._preflight.plan, complex(*tick.fix.position_ned_m[:2])
        room_m = plan.law.r_in * plan.unit_m + WANDERS_M
        near = [peer for peer in tick.peers.near(own, room_m) if not peer.down]
        over = [peer.id for peer in near if peer.state is None or peer.state.airborne]
        return f"{agents_named(over)} in its way up" if over else ""

    def _warn(self, tick: Tick) -> None:
        caution = self._preflight.caution(tick)
        if caution and caution != self._cautioned:
            self._log.say(tick.now, Severity.INFO, caution)
        self._cautioned = caution or self._cautioned

    def _take_off(self, tick: Tick, height_m: float) -> Intent:
        vehicle, progress, view, fix = self._vehicle, self._group.progress, tick.view, tick.fix
        alone = view.armed or self._group.grounded
        flies = "" if alone else self._flies_already(tick)
        if flies:
            return Intent(StandbyGoal(), Phase.ARM, flies)
        if not view.armed or fix is None:
            vehicle.ask_to_arm(tick.now, fix)
            reason = self._last_text or "waiting for the vehicle to arm"
            return Intent(AirborneGoal(height_m), Phase.ARM, reason)
        vehicle.climb_to(height_m)
        missing_m = height_m - vehicle.height(fix)
        climbs = missing_m > _HEIGHT_TOLERANCE_M and not progress.done
        # An autopilot's own take-off that a hold, a pilot or the end of an agent broke off is not
        # begun again in the air: setpoints bring the vehicle up.
        broken_off = self._setpoints.count > 0 or self._takeover.took
        if climbs and not (broken_off and view.controlled and not view.on_ground):
            return self._climb(tick, fix, height_m)
        if view.controlled and not climbs:
            progress.finish_step(tick.now)
        return Intent(KeepClear(), Phase.TAKEOFF)

    def _climb(self, tick: Tick, fix: OwnFix, height_m: float) -> Intent:
        """Straight up, against the wind, and out of the way of others. Until it has left the ground
        a vehicle is not steered: it would lean there."""
        steered = tick.view.climbs_by_setpoints and tick.view.controlled
        stands = tick.view.on_ground or self._vehicle.height(fix) < _LIFTED_M
        if stands or not steered or self._lifted_m is None:
            self._lifted_m = fix.position_ned_m[:2]
            return Intent(AirborneGoal(height_m), Phase.TAKEOFF)
        return Intent(ClimbOver(self._lifted_m, height_m), Phase.TAKEOFF)

    def _fly_formation(self, tick: Tick, step: Step, own_m: Point) -> Intent:
        """The law in the mission's step, or in what a command has put in its place."""
        override, reason = self._command_handler.override, None
        course: Course = KeepClear()
        if override is not None:
            reason = f"the operator commands: {override.kind}"
            stands = override.kind == CommandKind.HOLD and self._scattered
            if stands or override.kind == CommandKind.EXPEL:
                self._stay_up(tick)
                return Intent(KeepClear(), Phase.FLY, reason)
            sent_to = self._command_handler.sent_to
            if sent_to is not None:
                return Intent(FlyTo(*sent_to), Phase.FLY, reason)
        tag = self._command_handler.tag
        if self._group.away:
            place_m = self._group.joining(tick, self._group.key(tag), own_m)
            if place_m is not None:
                course = FlyTo(place_m, self._preflight.plan.limits.speed_mps)
                return Intent(course, Phase.FLY, reason or "joins the others")
            self._group.join()
            self._takeover.take_up(tick, tag)
        if tick.fix is not None:
            if override is None:
                self._exchange_slots(tick, step, own_m)
            flown = override.step if override is not None else step
            free = self._interruption.trigger is None
            law = self._command_handler.gain_update
            flown = self._group.on_way(flown, law.zones_in_force, law.tag, tag)
            step = flown if override is None else step
            course = FlyShape(*self._group.formation(tick, flown, tag, own_m, free=free))
            vehicle = self._vehicle
            flies_m = vehicle.planned_height_m - vehicle.up_m
            vehicle.fly_up(self._group.up_m + self._group.rises_m(flies_m))
            file = flown.file
            if file is not None:
                place_m = self._group.file_place(tick, file, own_m)
                course = KeepClear() if place_m is None else FlyTo(place_m, file.speed_mps)
        if override is None:
            self._judge(tick, step, own_m)
        return Intent(course, Phase.FLY, reason)

    def _stay_up(self, tick: Tick) -> None:
        """At the height that a command to stay finds it at, on its way to that of its slot."""
        vehicle, fix = self._vehicle, tick.newest_fix
        if not self._stays_up and self._group.high and fix is not None:
            self._stays_up = True
            vehicle.fly_up(vehicle.up_m + vehicle.height(fix) - vehicle.planned_height_m)

    def _exchange_slots(self, tick: Tick, step: Step, own_m: Point) -> None:
        """Exchange slots with an agent that is in the way, where the step allows it."""
        group, exchange = self._group, self._group.slot_exchange
        new = step.exchanges and not group.progress.done and not group.closed
        key = group.key(self._command_handler.tag)
        partner = exchange.look(tick.now, own_m, key, group.neighbourhood.links, new=new)
        if partner is None:
            return
        group.assign_roles()
        self._inside_since = None
        text = f"takes the slot of agent {partner} (exchanged: they were in each other's way)"
        self._log.say(tick.now, Severity.INFO, text)

    def _at_height(self, tick: Tick) -> bool:
        """The vehicle is at its slot's height, where slots have some."""
        vehicle, fix = self._vehicle, tick.newest_fix
        if not self._group.high:
            return True
        return fix is not None and (
            abs(vehicle.target_height_m - vehicle.height(fix)) <= _HEIGHT_TOLERANCE_M
        )

    def _judge(self, tick: Tick, step: Step, own_m: Point) -> None:
        """Is the own part of the step done? Or its time over, where the mission then goes on?"""
        now = tick.now
        group, progress = self._group, self._group.progress
        settling = step.settling
        if settling is None:
            lasted_s = now - progress.started_s - progress.paused_s
            follows = step.follows
            goes_on = follows is not None and follows.on_lost is Policy.CONTINUE
            if goes_on and group.target_lost(now):
                progress.finish_step(now, StepOutcome.TIMEOUT)
            there = follows is not None and follows.reached(group.reference.target)
            if there or (step.lasts_s is not None and lasted_s >= step.lasts_s):
                progress.finish_step(now)
            return
        late = step.on_timeout is Policy.CONTINUE and now > progress.timed_out_at
        unjudged_s, self._judged_s = now - self._judged_s, now
        error_m = group.formation_error_m
        inside = error_m is not None and error_m < settling.tolerance_m
        inside = inside and group.slot_exchange.settled(now) and self._at_height(tick)
        if step.new_shape is None:
            inside = inside and group.reference.there(step, own_m)
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
