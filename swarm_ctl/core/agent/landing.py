"""Winding a flight down: hold still, come back, land, yield or let fall. Ends with the vehicle on
the ground."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

from swarm_ctl.core.agent.failsafes import FailsafeTrigger, failed
from swarm_ctl.core.agent.group import Group
from swarm_ctl.core.agent.interruption import EventLog, Interruption
from swarm_ctl.core.agent.own_vehicle import GONE_VEHICLE_S, OwnVehicle
from swarm_ctl.core.agent.return_to_launch import HOME_TOLERANCE_M, ReturnToLaunch, deserted
from swarm_ctl.core.agent.steering import FlyTo, Intent, KeepClear
from swarm_ctl.core.agent.tick import Tick
from swarm_ctl.core.control.controller import Controller
from swarm_ctl.core.model.causes import Cause, FailsafeAction
from swarm_ctl.core.model.messages import Outcome, Phase, ReturnStage, Severity
from swarm_ctl.core.model.plan import Plan, Point
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.core.model.timeouts import LANDING_AT_MOST_S
from swarm_ctl.core.model.vehicle import (
    MISPLACED_M,
    FlyGoal,
    LandGoal,
    ReleaseGoal,
    StandbyGoal,
    TerminateGoal,
    Vector3,
    YieldGoal,
)
from swarm_ctl.core.swarm.snapshot import OtherAircraft

_AT_REST_MPS = 0.3
_BRAKE_AT_MOST_S = 3.0
"""From 5 m/s a multirotor stands after 2.5 s (2.8 m/s2 and 0.4 s of dead time)."""
_ASIDE_AT_MOST_S = 10.0
"""To leave the place above a vehicle that stands there: the filter takes 3 s where there is
room."""
_OUT_AT_MOST_S: Final = 60.0
"""To leave the place above a zone: at a fifth of the top speed, most are narrower."""
WANDERS_M: Final = 1.0
"""A vehicle that lands leaves its place by less: real PX4s brake late and drift. Two in the air
make room for both before they land, whatever the unit is."""
STANDING_WANDERS_M: Final = 0.75
"""... by less where it stood before: two simulated PX4s that did came nearer by 0.94 m at most. A
small formation that stands lands in its places."""
_STANDING_MPS: Final = 0.6
"""A real PX4 that stands says up to 0.5 m/s."""
BESIDE: Final = 0.2
"""So far from r_in to r_out: room for what the stop point does not know, and within the filter's
own keep-out (0.35)."""
_RETURN_AT_MOST_S = 120.0
"""Per agent of the plan, of a return that is no step: for all that others may be in the way of. The
own way comes on top of that, at half the speed. A step has its own time-out."""
_NEARER_M: Final = 0.5
_NO_NEARER_S: Final = 8.0
"""A vehicle whose start lies in a zone, and which that zone has let come no nearer for so long, is
as near as it will be: meanwhile it has looked for a way beside it."""
_ARMING_S = 3.0
"""An arm command may act this long after it was sent, and the heartbeat that tells comes once a
second."""
_TELL_S = 30.0
"""For its first position on the ground: vehicles that have just started take so long."""
_DISARMED_S = 10.0
"""A vehicle without motors for this long lies on the ground, whatever it said last. One that
restarted in the air says no more than its heartbeat until it is asked, and an agent that yielded
asks for nothing."""


class Landing:
    """One agent's way out of the air: planned (`land` and `return` steps) or by a failsafe."""

    def __init__(
        self,
        plan: Plan,
        vehicle: OwnVehicle,
        group: Group,
        interruption: Interruption,
        log: EventLog,
        controller: Controller,
        way_back: ReturnToLaunch,
    ) -> None:
        self._plan, self._log = plan, log
        self._vehicle, self._interruption = vehicle, interruption
        self._progress, self._controller = group.progress, controller
        self._way_back = way_back
        self._return_at_most_s = math.inf
        self._deserted_since: float | None = None
        r_in_m = plan.law.r_in * plan.unit_m
        self._room_m = r_in_m + 2.0 * WANDERS_M
        self._standing_room_m = r_in_m + 2.0 * STANDING_WANDERS_M
        self._stood: frozenset[int] | None = None
        """The peers that stood with this agent as its landing began."""
        self._left_zone = ""
        """The zone that it left last before it landed."""
        self._aside_s = -math.inf
        """When it last made room before it landed."""
        self._place_m: Point | None = None
        """Where it is to come down."""
        self._home_s = -math.inf
        """When it came to rest over its own start."""
        self._home_zone = ""
        """The zone in which its own start lies."""
        self._nearest_home = math.inf, -math.inf
        """How near to its start it came [m], and when."""
        self._disarmed_since: float | None = None
        self._lands_since: float | None = None
        """Since when a vehicle that we yielded has been in its landing mode [s]."""

    def carry_out(self, tick: Tick, trigger: FailsafeTrigger, *, left: bool) -> Intent:
        """Do what a failsafe asks for: pause, yield, or hold for a moment and land. `left`: an
        order to some agents alone has ended this agent's part."""
        vehicle, view, now = self._vehicle, tick.view, tick.now
        # A vehicle that was asked to arm a moment ago may still do so: only what it says well
        # after that counts.
        down = self._on_ground(tick) and not _lately(vehicle.arming_s, now, _ARMING_S)
        killed = trigger.action is FailsafeAction.KILL
        since_s = self._interruption.since_s
        # An agent that has just started may not know yet that its vehicle flies.
        unsure = vehicle.strange(now) and trigger.action is not FailsafeAction.LEAVE
        unsure |= killed and not vehicle.was_armed and _lately(since_s, now, _ARMING_S)
        # Its peers wait for its word, which it has with its first position.
        unsure |= left and tick.newest_fix is None and _lately(since_s, now, _TELL_S)
        if not unsure and (down or tick.vehicle_silent_s > GONE_VEHICLE_S):
            return self.end(now)
        if killed:
            return Intent(TerminateGoal(), Phase.LAND)
        if view.armed and not vehicle.ours:
            if unsure:
                return Intent(StandbyGoal(), tick.before)
            return self.end(now)  # not our flight: nothing is sent, soon no heartbeat either
        if not view.armed and not vehicle.was_armed:
            asked = math.isfinite(vehicle.arming_s)
            return Intent(LandGoal() if asked else StandbyGoal(), tick.before)
        if trigger.action in (FailsafeAction.FALL, FailsafeAction.YIELD):
            return self._yield(tick, trigger)
        if trigger.action is FailsafeAction.HOLD:
            return self._hold(tick)
        if trigger.action is FailsafeAction.RETURN and vehicle.had_control:
            return self.come_back(tick)
        failure = trigger.outcome is Outcome.FAILED
        return self.land(tick, self._plan.policies.hold_before_land_s if failure else 0.0)

    def _yield(self, tick: Tick, trigger: FailsafeTrigger) -> Intent:
        """Leave it to a pilot, for as long as one flies it; wait for a vehicle that fell, or that
        another than us has brought into its landing mode, no longer than for our own landing."""
        now, since = tick.now, self._lands_since
        if trigger.action is FailsafeAction.FALL:
            since = self._interruption.since_s
        elif tick.view.landing:
            since = now if since is None else since
        else:
            since = None
        self._lands_since = since
        if since is None:
            return Intent(YieldGoal(), Phase.YIELD)
        if now - since <= LANDING_AT_MOST_S:
            limit = f"given up if it is still armed after {LANDING_AT_MOST_S:g} s"
            return Intent(YieldGoal(), Phase.YIELD, f"{trigger.reason}; {limit}")
        why = f"{trigger.reason}; still armed after {LANDING_AT_MOST_S:g} s"
        self._interruption.go_over_to(replace(trigger, reason=why))
        self._log.say(now, Severity.ERROR, why)
        return self.end(now)  # without the agent's heartbeats the vehicle's failsafe acts

    def come_back(self, tick: Tick) -> Intent:
        """Up to the own height, over the own start, down."""
        vehicle, interruption, way_back = self._vehicle, self._interruption, self._way_back
        fix, trigger = tick.fix, interruption.trigger
        if tick.before is not Phase.RETURN and vehicle.landing_s is None:
            way_m = math.dist(self._controller.stop_point_m, way_back.home_m)
            own_s = 2.0 * way_m / self._plan.policies.return_speed_mps
            self._return_at_most_s = _RETURN_AT_MOST_S * len(self._plan.agents) + own_s
        why_not = self._cannot_return(tick) if vehicle.landing_s is None else ""
        if why_not:
            cause = trigger.reason if trigger else "return"
            why = f"{cause}; {why_not}, so it lands here"
            root = trigger.cause if trigger else Cause.PEER
            interruption.go_over_to(failed(FailsafeAction.LAND, why, root), anew_s=tick.now)
            self._log.say(tick.now, Severity.ERROR, why)
            return self.land(tick)
        stage = way_back.update(tick.peers, fix, vehicle.height(fix) if fix else 0.0)
        if stage is ReturnStage.DOWN and not way_back.blocked:
            if vehicle.landing_s is None and math.isinf(self._home_s):
                self._come_down_at_home(tick)
            return self.land(tick)
        vehicle.go_home_at(way_back.height_m)
        reason = None if trigger else f"return: {stage.name.lower()}"
        if stage not in (ReturnStage.FLY, ReturnStage.DOWN):
            return Intent(KeepClear(), Phase.RETURN, reason)
        speed_mps = self._plan.policies.return_speed_mps
        return Intent(FlyTo(way_back.home_m, speed_mps), Phase.RETURN, reason)

    def _come_down_at_home(self, tick: Tick) -> None:
        """On the own start, which the plan keeps for it, whichever vehicle stands at its own start
        beside that. One that came down elsewhere is landed beside, and so is a zone that was added
        in flight."""
        self._home_s = tick.now
        astray = [peer.id for peer in self._below(tick) if not self._at_its_start(peer)]
        if not astray and not self._over_zone():
            self._vehicle.land(tick.now)
            self._place_m = self._way_back.home_m
        if not astray:
            return
        stands = f"{agents_named(astray)} came down beside its start: it lands aside"
        self._log.say(tick.now, Severity.WARNING, f"return: {stands}")

    def _at_its_start(self, peer: OtherAircraft) -> bool:
        starts = [agent.start for agent in self._plan.agents if agent.id == peer.id]
        unit = self._plan.unit_m
        return any(
            abs(complex(*start) * unit - peer.stop_point) <= WANDERS_M + HOME_TOLERANCE_M
            for start in starts
        )

    def land(self, tick: Tick, brake_s: float = 0.0) -> Intent:
        """Stand still first, so that no agent drops its avoidance while it moves; then down in
        place."""
        vehicle, view, fix, now = self._vehicle, tick.view, tick.fix, tick.now
        if vehicle.landing_s is None:
            waited = now - self._begun_s
            slow = fix is not None and math.hypot(*fix.velocity_ned_mps[:2]) < _AT_REST_MPS
            over, crowded = bool(self._below(tick)), self._crowded(tick)
            aside = (over or crowded) and waited < brake_s + _ASIDE_AT_MOST_S
            zone = self._over_zone() if waited < brake_s + _OUT_AT_MOST_S else ""
            if zone and zone != self._left_zone:
                self._log.say(now, Severity.WARNING, f"leaves {zone} before it lands")
            self._left_zone = zone or self._left_zone
            if aside or zone:
                self._aside_s = now
            braked = slow or now - max(self._begun_s, self._aside_s) > _BRAKE_AT_MOST_S
            if waited < brake_s or not braked or aside or zone:
                ground = over and aside
                return self._hold(tick, ground=ground, room_m=self._room_m, down=bool(zone))
            vehicle.land(now)
            self._place_m = fix.position_ned_m[:2] if fix is not None else None
        since_s = now if vehicle.landing_s is None else vehicle.landing_s
        if view.on_ground and not view.armed and self._interruption.trigger is None:
            self._judge_place(tick)
            self._progress.finish_step(now)
        elif now - since_s > LANDING_AT_MOST_S:
            why = f"not down after {LANDING_AT_MOST_S:g} s of landing"
            self._interruption.go_over_to(failed(FailsafeAction.LAND, why))
            return self.end(now)
        return Intent(LandGoal(), Phase.LAND)

    def _judge_place(self, tick: Tick) -> None:
        """A vehicle that came down elsewhere than it was told has not done its step."""
        place, fix = self._place_m, tick.newest_fix
        off_m = math.dist(place, fix.position_ned_m[:2]) if place and fix is not None else 0.0
        if off_m <= MISPLACED_M:
            return
        home = self._way_back.stage is ReturnStage.DOWN and not self._way_back.blocked
        what = "its start" if home else "where its landing began"
        why = f"the vehicle landed {off_m:.1f} m from {what}"
        self._log.say(tick.now, Severity.ERROR, why)
        self._interruption.go_over_to(failed(FailsafeAction.LAND, why))

    def end(self, now: float) -> Intent:
        """The flight is over: on the ground, or with nothing left to fly."""
        self._vehicle.end(now)
        reason = self._interruption.reason
        why = f" ({reason})" if reason else ""
        self._log.say(now, Severity.INFO, f"ended: {self._interruption.outcome}{why}")
        return Intent(ReleaseGoal(), Phase.ENDED, reason)

    def _below(self, tick: Tick) -> list[OtherAircraft]:
        """The vehicles on the ground that are hardly farther than `r_in`: flown over, not landed
        on."""
        own, law = complex(*self._controller.stop_point_m), self._plan.law
        reach = law.r_in + BESIDE * (law.r_out - law.r_in)
        near = tick.peers.near(own, reach * self._plan.unit_m)
        return [other for other in near if other.down]

    def _crowded(self, tick: Tick) -> bool:
        """A vehicle in the air is so near that the two may come under `r_in` while both land."""
        own = complex(*self._controller.stop_point_m)
        if self._stood is None:
            self._stood = self._standing(tick)
        for other in tick.peers.near(own, self._room_m):
            if other.down or not (other.followed or other.state is None):
                continue
            stood = other.id in self._stood
            if not stood or abs(own - other.stop_point) < self._standing_room_m:
                return True
        return False

    def _standing(self, tick: Tick) -> frozenset[int]:
        """The peers that stand as this agent does, as a planned landing begins. Who had to brake
        for an order wanders by more, also when it is slow again."""
        fix = tick.fix
        ordered = self._interruption.trigger is not None
        if ordered or fix is None or not _stands(fix.velocity_ned_mps):
            return frozenset()
        return frozenset(s.agent for s in tick.peers.fresh() if _stands(s.velocity_ned_mps))

    def _over_zone(self) -> str:
        """The zone that the vehicle would come down in, or ''."""
        return self._controller.safety_filter.over_zone(complex(*self._controller.stop_point_m))

    def _hold(
        self, tick: Tick, *, ground: bool = False, room_m: float = 0.0, down: bool = False
    ) -> Intent:
        if not tick.view.controlled and self._progress.step <= 1:
            # still under the autopilot's own take-off
            return Intent(LandGoal() if tick.view.armed else StandbyGoal(), Phase.HOLD)
        if tick.view.on_ground and not self._vehicle.flown:
            # its height errs by more than a climb needs: it would lift off
            return Intent(FlyGoal((0.0, 0.0, 0.0)), Phase.HOLD)
        return Intent(KeepClear(ground, room_m, down), Phase.HOLD)

    def _on_ground(self, tick: Tick) -> bool:
        """The vehicle stands there disarmed."""
        if tick.view.armed:
            self._disarmed_since = None
            return False
        if self._disarmed_since is None:
            self._disarmed_since = tick.now
        return tick.view.on_ground or tick.now - self._disarmed_since > _DISARMED_S

    @property
    def _begun_s(self) -> float:
        """When this way down began: with the trigger, with the mission's own step, or over the own
        start."""
        interruption = self._interruption
        since = interruption.since_s if interruption.trigger else self._progress.started_s
        return max(since, self._home_s)

    def _cannot_return(self, tick: Tick) -> str:
        """Why the way back has to be given up, or ''."""
        stopped = self._interruption.trigger is not None
        if stopped and tick.now - self._begun_s > self._return_at_most_s:
            return f"it took more than {self._return_at_most_s:.0f} s"
        if zone := self._beside_home(tick):
            return f"its start lies in {zone}"
        if self._way_back.blocked:
            hindered = self._controller.hindered
            return f"it {hindered}" if hindered else "something stands in its way home"
        if not deserted(tick.peers):
            self._deserted_since = None
            return ""
        since = self._deserted_since
        self._deserted_since = tick.now if since is None else since
        patience_s = self._plan.policies.agent_lost_after_s
        late = tick.now - self._deserted_since > patience_s
        return "no other agent is heard" if late else ""

    def _beside_home(self, tick: Tick) -> str:
        """The zone in which the own start lies, and beside which the vehicle is as near to it as it
        will be; ''."""
        way_back, controller = self._way_back, self._controller
        zone = controller.safety_filter.over_zone(complex(*way_back.home_m))
        if zone and zone != self._home_zone:
            text = f"return: its start lies in {zone}: it lands beside it"
            self._log.say(tick.now, Severity.WARNING, text)
        self._home_zone = zone
        left_m = math.dist(controller.stop_point_m, way_back.home_m)
        flies = way_back.stage is ReturnStage.FLY
        if not zone or not flies or left_m < self._nearest_home[0] - _NEARER_M:
            self._nearest_home = left_m, tick.now
        no_nearer = tick.now - self._nearest_home[1] > _NO_NEARER_S
        return zone if no_nearer and controller.hindered.endswith(zone) else ""


def _stands(velocity_ned_mps: Vector3) -> bool:
    return math.hypot(*velocity_ned_mps[:2]) < _STANDING_MPS


def _lately(at_s: float, now: float, seconds: float) -> bool:
    """Whether it was at most so long ago; -inf: never."""
    return now - at_s <= seconds
