"""What has become of one agent's flight so far: the record that the parts of an agent share.

`agent.py` writes the failsafe trigger; `step_executor.py`, `landing.py` and `takeover.py` write the
phase, its reason and the times.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from swarm_ctl.core.agent.failsafes import FailsafeTrigger
from swarm_ctl.core.agent.progress import Progress
from swarm_ctl.core.agent.tick import Tick
from swarm_ctl.core.control.altitude import climb_rate
from swarm_ctl.core.control.controller import Controller
from swarm_ctl.core.control.navigation import OwnFix
from swarm_ctl.core.control.reference import Reference
from swarm_ctl.core.model.causes import Cause, FailsafeAction
from swarm_ctl.core.model.messages import Event, Outcome, Phase, Severity
from swarm_ctl.core.model.plan import Plan, Point
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.core.model.vehicle import FALLS_MPS, FlyGoal, VehicleView
from swarm_ctl.core.swarm.neighbourhood import Neighbourhood
from swarm_ctl.core.swarm.slot_exchange import SlotExchange

_FLOWN_M: Final = 1.0
"""A position estimate on the ground wanders by less."""
_FELL_S: Final = 5.0
"""From a fall to the heartbeats that say `disarmed`: they come once a second."""
_SUNK_M: Final = 3.0
"""Far below the height to keep: this much, and half of the height. A baro drifts by less in a
flight."""


@dataclass(slots=True)
class SetpointCount:
    """Setpoints sent so far."""

    count: int = 0
    first_s: float = 0.0
    last_s: float = 0.0

    def add(self, now: float) -> None:
        """One was sent."""
        if self.count == 0:
            self.first_s = now
        self.count += 1
        self.last_s = now

    @property
    def rate_hz(self) -> float:
        """The mean rate from the first to the last one."""
        span = self.last_s - self.first_s
        return (self.count - 1) / span if span > 0 else 0.0


@dataclass(slots=True)
class FlightContext:
    """One agent's flight. Times are on the agent's clock [s], heights above its take-off point
    [m]."""

    plan: Plan
    agent: int
    controller: Controller
    progress: Progress
    reference: Reference
    neighbourhood: Neighbourhood
    slot_exchange: SlotExchange
    setpoints: SetpointCount = field(default_factory=SetpointCount)
    phase: Phase = Phase.CONNECT
    reason: str = ""
    """Why it waits, holds or lands; '' when all is well."""
    trigger: FailsafeTrigger | None = None
    """The failsafe that is being carried out."""
    trigger_s: float = math.inf
    arming_s: float = -math.inf
    """When the vehicle was last asked to arm, or taken over in the air."""
    left: bool = False
    """An order to some agents alone has ended its part: its peers wait for its word of that."""
    was_armed: bool = False
    had_control: bool = False
    """The vehicle has followed our setpoints in this flight."""
    landing_s: float | None = None
    ended_s: float | None = None
    flown: bool = False
    """The vehicle was in the air in this flight."""
    fell_s: float = -math.inf
    """When it last went down as fast as only a fall does."""
    sunk_since_s: float | None = None
    """Since when it has been far below the height that it had reached and is to keep."""
    at_height: bool = False
    """It has reached its planned height."""
    ground_m: float = 0.0
    """Height of the take-off point in the common frame."""
    target_height_m: float = 0.0
    planned_height_m: float = 0.0
    events: list[Event] = field(default_factory=list)
    """Said since the last tick."""

    @property
    def outcome(self) -> Outcome:
        """How the flight ended."""
        if self.ended_s is None:
            return Outcome.RUNNING
        return self.trigger.outcome if self.trigger else Outcome.COMPLETED

    @property
    def ours(self) -> bool:
        """This process asked the vehicle to arm, or took it over: it may tell it to land."""
        return math.isfinite(self.arming_s)

    def say(self, now: float, severity: Severity, text: str) -> None:
        """A line for the log."""
        self.events.append(Event(self.agent, now, severity, text))

    def observe(self, view: VehicleView) -> None:
        """Note that the vehicle armed, or followed our setpoints, by our own doing."""
        self.was_armed |= view.armed and self.ours
        self.had_control |= self.was_armed and view.controlled

    def watch_height(self, tick: Tick) -> None:
        """Note that the vehicle flies, that it is at its height, and that it has sunk far below."""
        fix, height_m = tick.newest_fix, self.target_height_m
        if fix is None or not (self.was_armed and tick.view.armed):
            return
        missing_m = height_m - self.height(fix)
        if fix.velocity_ned_mps[2] > FALLS_MPS:
            self.fell_s = tick.now
        self.flown |= self.height(fix) > _FLOWN_M and not tick.view.on_ground
        # Where a hold has stopped the climb is no height that it had reached.
        there = abs(self.planned_height_m - self.height(fix)) < _FLOWN_M
        self.at_height |= self.flown and self.had_control and there
        if not self.at_height or missing_m <= max(_SUNK_M, 0.5 * height_m):
            self.sunk_since_s = None
        elif self.sunk_since_s is None:
            self.sunk_since_s = tick.now

    def fell(self, now: float) -> bool:
        """It has just gone down as fast as only a fall does."""
        return now - self.fell_s <= _FELL_S

    def sunk_s(self, now: float) -> float:
        """For how long the vehicle has been far below its height [s]; 0: it is not."""
        return 0.0 if self.sunk_since_s is None else now - self.sunk_since_s

    def heed(self, tick: Tick, trigger: FailsafeTrigger | None) -> None:
        """A failsafe fires, or (None) its cause is gone and the mission goes on."""
        if trigger is None:
            self.say(tick.now, Severity.INFO, "going on")
            self.target_height_m = self.planned_height_m
        else:
            old = self.trigger
            same = old is not None and (old.action, old.cause) == (trigger.action, trigger.cause)
            # A hold fires anew with each other figure in its reason; another peer is another case.
            if not same or trigger.cause is Cause.PEER:
                severity = Severity.ERROR if trigger.outcome is Outcome.FAILED else Severity.WARNING
                self.say(tick.now, severity, f"{trigger.action}: {trigger.reason}")
            if trigger.action is not FailsafeAction.HOLD:
                self.progress.break_off(trigger.step_outcome, tick.now)
        self.trigger, self.trigger_s = trigger, tick.now
        if tick.newest_fix is not None:
            # never climb on while stopping
            self.target_height_m = min(self.target_height_m, self.height(tick.newest_fix))

    def height(self, fix: OwnFix) -> float:
        """Above the take-off point [m]."""
        return fix.height_m - self.ground_m

    def begin_form(self, step: FormStep) -> None:
        """Begin a form step of the mission: its shape by slot index, its graph, its exchanges."""
        exchange = self.slot_exchange
        self.reference.form(step.slots, exchange.roles)
        if step.neighbours is not None:
            self.neighbourhood.choose(exchange.in_roles(step.neighbours))
        exchange.begin(step.slots)

    def setpoint(self, now: float, fix: OwnFix | None, velocity: Point | None) -> FlyGoal:
        """The tick's setpoint: this velocity (north, east), and towards the target height. Zero
        without a fresh fix."""
        if fix is None or velocity is None:
            self.controller.rest()
            north, east, climb = 0.0, 0.0, 0.0
            self.reason = self.reason or "no fresh position from the vehicle"
        else:
            against = self.controller.headwind.fade()
            north = velocity[0] + against.real - fix.drift_mps[0]
            east = velocity[1] + against.imag - fix.drift_mps[1]
            missing_m = self.target_height_m - self.height(fix)
            climb = climb_rate(missing_m, self.plan.limits)
        self.setpoints.add(now)
        return FlyGoal((north, east, -climb))

    def keep_clear(self, tick: Tick) -> FlyGoal:
        """The setpoint of an agent that stays where it is and makes room."""
        fix = tick.fix
        return self.setpoint(tick.now, fix, self.controller.keep_clear(tick.peers) if fix else None)
