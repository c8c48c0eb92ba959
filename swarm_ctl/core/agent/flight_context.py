"""What has become of the own flight so far: one record that the parts of an agent share, each
writing its own lines.

`core/agent/agent.py` writes what forbids going on, `core/agent/step_executor.py` and
`core/agent/landing.py` the phase, its reason and times.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from swarm_ctl.core.agent import failsafes
from swarm_ctl.core.agent.progress import Progress
from swarm_ctl.core.agent.status_report import StatusReport
from swarm_ctl.core.control.controller import Controller
from swarm_ctl.core.control.navigation import OwnFix
from swarm_ctl.core.model.messages import Event, Phase
from swarm_ctl.core.model.plan import Plan, Point
from swarm_ctl.core.model.vehicle import FlyGoal, VehicleView
from swarm_ctl.core.safety import constraints


@dataclass(slots=True)
class FlightContext:
    """One agent's flight. Times are on the agent's clock, heights above the take-off point."""

    plan: Plan
    agent: int
    controller: Controller
    account: StatusReport = field(default_factory=StatusReport)
    phase: Phase = Phase.CONNECT
    reason: str = ""
    """Why it waits, holds or lands; '' when all is well."""
    finding: failsafes.FailsafeTrigger | None = None
    """What forbids going on, and is being carried out."""
    finding_s: float = math.inf
    arming_s: float = -math.inf
    """When the vehicle was last asked to arm, or taken over in the air."""
    was_armed: bool = False
    had_control: bool = False
    """The vehicle has followed our setpoints in this flight."""
    landing_s: float | None = None
    ended_s: float | None = None
    ground_m: float = 0.0
    """Height of the take-off point in the common frame."""
    target_height_m: float = 0.0
    planned_height_m: float = 0.0
    events: list[Event] = field(default_factory=list)
    """Said since the last tick."""

    @property
    def outcome(self) -> str:
        """As in `AgentStatus`."""
        if self.ended_s is None:
            return "running"
        return self.finding.outcome if self.finding else "completed"

    @property
    def ours(self) -> bool:
        """This process has asked the vehicle to arm, or has taken it over: it may be told to
        land."""
        return math.isfinite(self.arming_s)

    def say(self, now: float, level: str, text: str) -> None:
        """A line for the log."""
        self.events.append(Event(self.agent, now, level, text))

    def observe(self, view: VehicleView) -> None:
        """What the vehicle says of itself, as far as it is our doing."""
        self.was_armed |= view.armed and self.ours
        self.had_control |= self.was_armed and view.controlled

    def heed(
        self,
        now: float,
        finding: failsafes.FailsafeTrigger | None,
        fix: OwnFix | None,
        progress: Progress,
    ) -> None:
        """Something forbids going on from now on, or (None) no longer does."""
        if finding is None:
            self.say(now, "info", "going on")
            self.target_height_m = self.planned_height_m
        else:
            self.say(
                now,
                "error" if finding.outcome == "failed" else "warning",
                f"{finding.action}: {finding.reason}",
            )
            if finding.action != "hold":
                progress.break_off("timeout" if "timed out" in finding.reason else "aborted", now)
        self.finding, self.finding_s = finding, now
        if fix is not None:
            self.target_height_m = min(
                self.target_height_m, self.height(fix)
            )  # never climb on while stopping

    def height(self, fix: OwnFix) -> float:
        """Above the take-off point [m]."""
        return fix.height_m - self.ground_m

    def setpoint(self, now: float, fix: OwnFix | None, velocity: Point | None) -> FlyGoal:
        """The tick's setpoint: this velocity (north, east), and towards the target height. Zero
        without a fresh fix."""
        if fix is None or velocity is None:
            self.controller.rest()
            north, east, climb = 0.0, 0.0, 0.0
            self.reason = self.reason or "no fresh position from the vehicle"
        else:
            (north, east) = velocity
            climb = constraints.climb_rate(
                self.target_height_m - self.height(fix), self.plan.limits
            )
        self.account.setpoint(now)
        return FlyGoal((north, east, -climb))
