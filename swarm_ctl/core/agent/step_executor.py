"""From where an agent is in its mission to the tick's goal: prepare, take off, fly the formation,
or wind down."""

from __future__ import annotations

import math

from swarm_ctl.core.agent.barrier import Barrier
from swarm_ctl.core.agent.command_handler import CommandHandler
from swarm_ctl.core.agent.flight_context import FlightContext
from swarm_ctl.core.agent.landing import Landing
from swarm_ctl.core.agent.preflight import HeardStation, Preflight
from swarm_ctl.core.agent.progress import Progress
from swarm_ctl.core.agent.takeover import Takeover
from swarm_ctl.core.control.controller import Controller
from swarm_ctl.core.control.navigation import OwnFix
from swarm_ctl.core.control.reference import Reference
from swarm_ctl.core.model.messages import Phase
from swarm_ctl.core.model.plan import (
    FormStep,
    HoldStep,
    LandStep,
    Point,
    Policy,
    ReturnStep,
    Shaped,
    Step,
    TakeoffStep,
)
from swarm_ctl.core.model.vehicle import AirborneGoal, Goal, ReleaseGoal, StandbyGoal, VehicleView
from swarm_ctl.core.swarm.neighbourhood import Neighbourhood
from swarm_ctl.core.swarm.peers import Common
from swarm_ctl.core.swarm.slot_exchange import SlotExchange

_HEIGHT_TOLERANCE_M = 0.5


class StepExecutor:
    """One agent's flying. What it decides by and leaves behind is the `Sortie`."""

    def __init__(
        self,
        sortie: FlightContext,
        gate: Preflight,
        members: Barrier,
        controller: Controller,
        progress: Progress,
        reference: Reference,
        operator: CommandHandler,
        descent: Landing,
        takeover: Takeover,
        dealer: SlotExchange,
        neighbourhood: Neighbourhood,
    ) -> None:
        self._plan = sortie.plan
        self._sortie = sortie
        self._gate = gate
        self._members = members
        self._controller = controller
        self._progress = progress
        self._reference = reference
        self._operator = operator
        self._descent = descent
        self._takeover = takeover
        self._dealer = dealer
        self._neighbourhood = neighbourhood
        self._scattered = False
        """The operator's `hold` came while the shape was not formed yet: stay, don't go on
        forming."""
        self._inside_since: float | None = None
        self._judged_s = 0.0
        self._last_text = ""

    @property
    def command(self) -> int:
        """`Command.tag` of the operator's command that is carried out, 0 for none."""
        return self._operator.override.tag if self._operator.override is not None else 0

    def begin(self) -> None:
        """A step begins: the mission's, an operator's, or the mission's again."""
        self._inside_since = None

    def commanded(self, kind: str, before: Step | None) -> None:
        """The operator's command `kind` takes the place of `before`, which was flown until now."""
        self._scattered = isinstance(before, FormStep) or (self._scattered and kind == "hold")

    def decide(
        self, now: float, view: VehicleView, fix: OwnFix | None, station: HeardStation | None
    ) -> Goal:
        """The tick's goal. `fix` is None unless it is fresh."""
        sortie = self._sortie
        self._last_text = view.texts[-1] if view.texts else self._last_text
        sortie.reason = sortie.finding.reason if sortie.finding else ""
        if sortie.ended_s is not None:
            self._controller.rest()
            return ReleaseGoal()
        if self._takeover.pending(view):
            self._controller.rest()
            sortie.phase, sortie.reason = Phase.PREPARE, self._takeover.look(now, view, fix)
            return StandbyGoal()
        if self._progress.finished:
            return self._descent.end(now)
        if sortie.finding is not None:
            return self._descent.carry_out(now, view, fix, sortie.finding)
        step = self._progress.current
        if step is None:
            return self._prepare(now, view, fix, station)
        if isinstance(step, TakeoffStep):
            return self._take_off(now, view, fix, step)
        if isinstance(step, LandStep):
            return self._descent.land(now, view, fix)
        if isinstance(step, ReturnStep):
            return self._descent.come_back(now, view, fix)
        return self._takeover.learning(now, view, fix, self.command) or self._fly_formation(
            now, view, fix, step
        )

    def _prepare(
        self, now: float, view: VehicleView, fix: OwnFix | None, station: HeardStation | None
    ) -> Goal:
        """Wait for a healthy vehicle on its planned start, and for peers and station with the same
        plan."""
        sortie = self._sortie
        self._controller.rest()
        sortie.phase = Phase.PREPARE if math.isfinite(view.heartbeat_s) else Phase.CONNECT
        armed_before = view.armed and not sortie.was_armed
        sortie.reason = (
            "the vehicle is armed already; disarm it first"
            if armed_before and view.healthy
            else self._gate.closed_by(view, fix, station)
        )
        if not sortie.reason:
            self._progress.finish_step(now)
            sortie.reason = "waiting for the others"
        elif self._progress.done:
            self._progress.done = False  # health can be lost again while waiting
        return StandbyGoal()

    def _take_off(
        self, now: float, view: VehicleView, fix: OwnFix | None, step: TakeoffStep
    ) -> Goal:
        sortie = self._sortie
        if not view.armed or fix is None:
            sortie.phase = Phase.ARM
            self._controller.rest()
            if fix is not None:
                sortie.ground_m = fix.height_m
            sortie.arming_s = now
            sortie.reason = self._last_text or "waiting for the vehicle to arm"
            return AirborneGoal(step.height_m)
        sortie.phase = Phase.TAKEOFF
        sortie.target_height_m = sortie.planned_height_m = step.height_m
        missing = step.height_m - sortie.height(fix)
        if missing > _HEIGHT_TOLERANCE_M and not self._progress.done:
            self._controller.rest()
            return AirborneGoal(step.height_m)
        if view.controlled:
            self._progress.finish_step(now)
        return sortie.setpoint(now, fix, self._controller.keep_clear(now, view.contacts))

    def _fly_formation(
        self, now: float, view: VehicleView, fix: OwnFix | None, step: Shaped
    ) -> Goal:
        """The law in the mission's step, or in what the operator has put in its place."""
        sortie, override = self._sortie, self._operator.override
        sortie.phase = Phase.FLY
        if override is not None:
            sortie.reason = f"the operator commands: {override.kind}"
            if override.kind == "hold" and self._scattered:
                return sortie.setpoint(
                    now, fix, self._controller.keep_clear(now, view.contacts) if fix else None
                )
        flown = override.step if override is not None else step
        if override is None and fix is not None:
            self._exchange(now, step)
        velocity = self._formation_velocity(now, view, flown) if fix else None
        if override is None:
            self._judge(now, step)
        return sortie.setpoint(now, fix, velocity)

    def _formation_velocity(self, now: float, view: VehicleView, step: Step) -> Point:
        reference, own = self._reference, self._controller.stop_point_m
        key = (self._progress.step, self.command)
        extra, common = (0.0, 0.0), Common(0j, key)
        if not isinstance(step, FormStep):
            free = self._sortie.finding is None
            reference.follow(now, step, key, own, self._members.formation_error_m, free=free)
            extra = reference.feed_forward(step, own, self._controller.gain)
            common = Common(complex(*reference.common_mps(step)), key)
        return self._controller.form(now, reference.slots, view.contacts, extra, common)

    def _exchange(self, now: float, step: Shaped) -> None:
        """Slots with whoever is in the way, where the step allows it."""
        new = isinstance(step, FormStep) and step.exchange and not self._progress.done
        key = (self._progress.step, self.command)
        partner = self._dealer.look(
            now, self._controller.stop_point_m, key, self._neighbourhood.links, new=new
        )
        if partner is not None:
            self._reference.assign(self._dealer.roles)
            self._inside_since = None
            self._sortie.say(
                now,
                "info",
                f"takes the slot of agent {partner} (exchanged: they were in each other's way)",
            )

    def _judge(self, now: float, step: Shaped) -> None:
        """Own part of the step done? Or its time over, where the mission then goes on."""
        late = step.on_timeout is Policy.CONTINUE and now > self._progress.timed_out_at
        if isinstance(step, HoldStep):
            if now - self._progress.started_s - self._progress.paused_s >= step.duration_s:
                self._progress.finish_step(now)
            return
        unjudged_s, self._judged_s = now - self._judged_s, now
        error_m = self._members.formation_error_m
        inside = error_m is not None and error_m < step.tolerance_m and self._dealer.settled(now)
        if not isinstance(step, FormStep):
            inside = inside and self._reference.there(step, self._controller.stop_point_m)
        if error_m is None and self._inside_since is not None:
            # late news (a mesh that lost something and waits for it) tells nothing of the shape: it
            # takes longer
            self._inside_since = min(now, self._inside_since + unjudged_s)
        elif not inside:
            self._inside_since = None
        elif self._inside_since is None:
            self._inside_since = now
        elif now - self._inside_since >= step.settle_s:
            self._progress.finish_step(now)
        if late:
            self._progress.finish_step(now, "timeout")
