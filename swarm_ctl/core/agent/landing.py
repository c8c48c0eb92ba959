"""Winding a flight down: hold still, come back, land, yield or let fall. Ends with the vehicle on
the ground."""

from __future__ import annotations

import math

from swarm_ctl.core.agent.failsafes import FailsafeTrigger
from swarm_ctl.core.agent.flight_context import FlightContext
from swarm_ctl.core.agent.progress import Progress
from swarm_ctl.core.agent.return_to_launch import ReturnToLaunch, Stage
from swarm_ctl.core.control.controller import Controller
from swarm_ctl.core.control.navigation import OwnFix
from swarm_ctl.core.model.messages import Phase
from swarm_ctl.core.model.vehicle import (
    Goal,
    LandGoal,
    ReleaseGoal,
    StandbyGoal,
    TerminateGoal,
    VehicleView,
    YieldGoal,
)

_AT_REST_MPS = 0.3
_BRAKE_AT_MOST_S = 3.0
"""From 5 m/s a multirotor stands after 2.5 s (2.8 m/s2 and 0.4 s of dead time)."""
_LANDING_AT_MOST_S = 180.0
_RETURN_AT_MOST_S = 120.0
"""Per agent of the plan: the way back is one at a time."""
_ARMING_S = 3.0
"""An arm command may act this long after it was sent, and the heartbeat that tells comes once a
second."""
_GONE_VEHICLE_S = 10.0
"""Without a heartbeat for this long while winding down, there is nothing left to land."""
_DISARMED_S = 10.0
"""Without motors for this long it lies on the ground, whatever it said last: a vehicle that has
restarted in the air tells no more than its heartbeat until it is asked, and who has yielded asks
for nothing."""


class Landing:
    """One agent's way out of the air, planned (`land`, `return` as steps) or not (a finding)."""

    def __init__(
        self,
        sortie: FlightContext,
        controller: Controller,
        progress: Progress,
        homing: ReturnToLaunch,
    ) -> None:
        self._plan = sortie.plan
        self._sortie = sortie
        self._controller = controller
        self._progress = progress
        self._homing = homing
        self._alone_since: float | None = None
        self._disarmed_since: float | None = None

    def carry_out(
        self, now: float, view: VehicleView, fix: OwnFix | None, finding: FailsafeTrigger
    ) -> Goal:
        """Do what a finding asks for: pause, yield, or hold for a moment and land."""
        sortie = self._sortie
        # a vehicle asked to arm a moment ago may do so yet: only what it says well after that
        # counts
        down = self._on_ground(now, view) and now - sortie.arming_s > _ARMING_S
        if down or now - view.heartbeat_s > _GONE_VEHICLE_S:
            return self.end(now)
        if finding.action == "kill":
            sortie.phase = Phase.LAND
            self._controller.rest()
            return TerminateGoal()
        if view.armed and not sortie.ours and finding.action != "kill":
            return self.end(
                now
            )  # somebody else's flight: nothing is sent to it, and soon no heartbeat either
        if not view.armed and not sortie.was_armed:
            self._controller.rest()
            return LandGoal() if math.isfinite(sortie.arming_s) else StandbyGoal()
        if finding.action == "yield":
            sortie.phase = Phase.YIELD
            self._controller.rest()
            return YieldGoal()
        if finding.action == "hold":
            return self._hold(now, view, fix)
        if finding.action == "return" and sortie.had_control:
            return self.come_back(now, view, fix)
        wait = self._plan.policies.hold_before_land_s if finding.outcome == "failed" else 0.0
        return self.land(now, view, fix, wait)

    def _on_ground(self, now: float, view: VehicleView) -> bool:
        """It stands there disarmed."""
        if view.armed:
            self._disarmed_since = None
            return False
        self._disarmed_since = now if self._disarmed_since is None else self._disarmed_since
        return view.on_ground or now - self._disarmed_since > _DISARMED_S

    def come_back(self, now: float, view: VehicleView, fix: OwnFix | None) -> Goal:
        """Up to the own height, wait for the turn, over the own start, down."""
        sortie = self._sortie
        if sortie.phase is not Phase.RETURN and sortie.landing_s is None:
            sortie.phase = Phase.RETURN
        why_not = self._cannot_return(now) if sortie.landing_s is None else ""
        if why_not:
            reason = sortie.finding.reason if sortie.finding else "return"
            sortie.finding = FailsafeTrigger(
                "land", "failed", f"{reason}; {why_not}, so it lands here"
            )
            sortie.finding_s = now
            sortie.say(now, "error", sortie.finding.reason)
            return self.land(now, view, fix)
        stage = self._homing.update(now, fix, sortie.height(fix) if fix else 0.0)
        if stage is Stage.DOWN:
            sortie.landing_s = sortie.landing_s or now
            return self.land(now, view, fix)
        sortie.reason = sortie.reason or f"return: {stage.name.lower()}"
        sortie.target_height_m = self._homing.height_m
        if fix is None:
            return sortie.setpoint(now, fix, None)
        if stage is Stage.FLY:
            speed = self._plan.policies.return_speed_mps
            return sortie.setpoint(
                now, fix, self._controller.go_to(now, self._homing.home_m, speed, view.contacts)
            )
        return sortie.setpoint(now, fix, self._controller.keep_clear(now, view.contacts))

    def land(self, now: float, view: VehicleView, fix: OwnFix | None, brake_s: float = 0.0) -> Goal:
        """Stand still first, so that nobody leaves the avoidance behind while moving; then down in
        place."""
        sortie = self._sortie
        if sortie.landing_s is None:
            waited = now - self._begun_s
            slow = fix is not None and math.hypot(*fix.velocity_ned_mps[:2]) < _AT_REST_MPS
            if waited < brake_s or not (slow or waited > _BRAKE_AT_MOST_S):
                return self._hold(now, view, fix)
            sortie.landing_s = now
        sortie.phase = Phase.LAND
        self._controller.rest()
        if view.on_ground and not view.armed and sortie.finding is None:
            self._progress.finish_step(now)
        elif now - sortie.landing_s > _LANDING_AT_MOST_S:
            sortie.finding = FailsafeTrigger(
                "land", "failed", f"not down after {_LANDING_AT_MOST_S:g} s of landing"
            )
            return self.end(now)
        return LandGoal()

    def end(self, now: float) -> Goal:
        """The flight is over: on the ground, or with nothing left to fly."""
        sortie = self._sortie
        sortie.phase = Phase.ENDED
        sortie.ended_s = now
        self._controller.rest()
        sortie.reason = sortie.finding.reason if sortie.finding else ""
        sortie.say(
            now,
            "info",
            f"ended: {sortie.outcome}" + (f" ({sortie.reason})" if sortie.reason else ""),
        )
        return ReleaseGoal()

    def _hold(self, now: float, view: VehicleView, fix: OwnFix | None) -> Goal:
        self._sortie.phase = Phase.HOLD
        if not view.controlled and self._progress.step <= 1:
            self._controller.rest()
            return (
                LandGoal() if view.armed else StandbyGoal()
            )  # still under the autopilot's own take-off
        return self._sortie.setpoint(
            now, fix, self._controller.keep_clear(now, view.contacts) if fix else None
        )

    @property
    def _begun_s(self) -> float:
        """When this way down began: with the finding, or with the mission's own step."""
        return self._sortie.finding_s if self._sortie.finding else self._progress.started_s

    def _cannot_return(self, now: float) -> str:
        """Why the way back has to be given up, or ''."""
        if now - self._begun_s > _RETURN_AT_MOST_S * len(self._plan.agents):
            return "it took too long"
        return "no other agent is heard" if self._deserted(now) else ""

    def _deserted(self, now: float) -> bool:
        if not self._homing.alone(now):
            self._alone_since = None
            return False
        self._alone_since = now if self._alone_since is None else self._alone_since
        return now - self._alone_since > self._plan.policies.agent_lost_after_s
