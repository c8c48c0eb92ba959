"""The agent: `step(now, inbox) -> actions`, and nothing else. No I/O, no clock, no randomness.

One tick: take in what was heard, find out where we are, see whether anything forbids going on (`core/watch.py`), fly
the current step or wind the flight down, and say so. Everything sent anywhere is in `Actions`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from swarm_ctl.core import safety, watch
from swarm_ctl.core.controller import Controller
from swarm_ctl.core.formation import formation_error
from swarm_ctl.core.freshness import OWN_FIX_S
from swarm_ctl.core.homing import Homing, Stage
from swarm_ctl.core.navigation import Navigator, OwnFix
from swarm_ctl.core.neighbourhood import Neighbourhood
from swarm_ctl.core.operator import Operator, Seat
from swarm_ctl.core.peers import Peers
from swarm_ctl.core.plan import (
    FormStep,
    HoldStep,
    LandStep,
    Plan,
    Point,
    Policy,
    ReturnStep,
    RotateStep,
    ScaleStep,
    Shaped,
    Step,
    TakeoffStep,
)
from swarm_ctl.core.progress import Progress, step_name
from swarm_ctl.core.readiness import not_ready, other_plan
from swarm_ctl.core.reference import Reference
from swarm_ctl.core.reporting import Account, nearest
from swarm_ctl.core.state import (
    Ack,
    AgentState,
    AgentStatus,
    Command,
    Echo,
    Event,
    Phase,
    SigmaReport,
    StationBeacon,
    TickReport,
)
from swarm_ctl.core.vehicle import Airborne, Fly, Goal, Land, Release, Standby, Terminate, VehicleView, Yield

_STATUS_EVERY_S = 0.5
_SIGMA_EVERY_S = 0.2
_MEASURE_EVERY_S = 0.2
_LINGER_S = 2.0
"""After the end an agent goes on saying so, and gives the vehicle its parameters back."""
_RELEASE_AT_MOST_S = 5.0
"""A vehicle that has not confirmed its own parameters by then (five tries) keeps ours, which are the careful ones."""
_HEIGHT_TOLERANCE_M = 0.5
_AT_REST_MPS = 0.3
_BRAKE_AT_MOST_S = 3.0
"""From 5 m/s a multirotor stands after 2.5 s (2.8 m/s2 and 0.4 s of dead time)."""
_LANDING_AT_MOST_S = 180.0
_RETURN_AT_MOST_S = 120.0
"""Per agent of the plan: the way back is one at a time."""
_ARMING_S = 3.0
"""An arm command may act this long after it was sent, and the heartbeat that tells comes once a second."""
_GONE_VEHICLE_S = 10.0
"""Without a heartbeat for this long while winding down, there is nothing left to land."""


@dataclass(slots=True)
class Inbox:
    """What one tick has to go by; received times are on the own clock."""

    view: VehicleView
    states: Sequence[tuple[AgentState, float]] = ()
    beacons: Sequence[tuple[StationBeacon, float]] = ()
    commands: Sequence[Command] = ()
    lifeline_cut: bool = False
    tick: Callable[[], TickReport] = TickReport
    """The loop's punctuality; asked only when a status is due."""
    bad_payloads: int = 0


@dataclass(frozen=True, slots=True)
class Ended:
    """The agent is through; `outcome` as in `AgentStatus`."""

    outcome: str
    reason: str


@dataclass(slots=True)
class Actions:
    """What one tick sends: a goal for the vehicle, the rest for the mesh; None: nothing this time."""

    goal: Goal
    state: AgentState | None
    status: AgentStatus | None = None
    sigma: SigmaReport | None = None
    events: tuple[Event, ...] = ()
    acks: tuple[Ack, ...] = ()
    ended: Ended | None = None


class Agent:
    """One agent of a plan, from its first tick to its end.

    `expect_station`: it was started together with a ground station, so it does not arm before that is heard.
    """

    def __init__(self, plan: Plan, agent_id: int, now: float, *, expect_station: bool = False) -> None:
        self._expect_station = expect_station
        self._plan = plan
        self._own = plan.agent(agent_id)
        self._id = agent_id
        self._hash = plan.hash()
        self._navigator = Navigator(plan.origin)
        self._peers = Peers(plan, agent_id)
        self._controller = Controller(plan, agent_id, self._peers)
        self._progress = Progress(plan, now)
        self._reference = Reference(plan, agent_id, self._peers)
        self._neighbourhood = Neighbourhood(plan, agent_id, self._peers)
        self._homing = Homing(plan, agent_id, self._peers)
        self._operator = Operator(plan, agent_id, self._hash)
        self._phase = Phase.CONNECT
        self._finding: watch.Finding | None = None
        self._finding_s = math.inf
        self._landing_s: float | None = None
        self._alone_since: float | None = None
        self._scattered = False
        """The operator's `hold` came while the shape was not formed yet: stay, don't go on forming."""
        self._ended_s: float | None = None
        self._arming_s = -math.inf
        self._station: tuple[StationBeacon, float] | None = None
        self._had_control = self._was_armed = self._lifeline_cut = False
        self._takeoff_height_m = 0.0
        self._target_height_m = self._planned_height_m = 0.0
        self._inside_since: float | None = None
        self._formation_error: float | None = None
        self._measure_due = now
        self._reason = ""
        self._last_text = ""
        self._seq = 0
        self._account = Account()
        self._status_due = self._sigma_due = now
        self._sigma_shown = False
        self._events: list[Event] = []

    # --- one tick ---

    def step(self, now: float, inbox: Inbox) -> Actions:
        """Decide one tick; call it every `plan.tick_s`."""
        acks = self._take_in(now, inbox)
        view = inbox.view
        fix = self._navigator.fix(view, now)
        fresh = fix is not None and fix.age_s <= OWN_FIX_S
        self._was_armed |= view.armed and math.isfinite(self._arming_s)
        self._had_control |= self._was_armed and view.controlled
        if fix is not None:
            self._controller.locate(fix)
        if now >= self._measure_due:
            self._measure_due = now + _MEASURE_EVERY_S
            self._formation_error = self._measure_formation(now, fix if fresh else None)
        self._check(now, view, fix)
        if self._pausing:
            self._progress.paused_s += self._plan.tick_s
        goal = self._decide(now, view, fix if fresh else None)
        going_on = self._finding is None and self._phase is not Phase.ENDED
        if going_on and self._progress.advance(self._members(now), now):
            self._enter_step(now)
        actions = Actions(goal, self._state(now, fix) if fix is not None and fresh else None, acks=acks)
        self._publish_slow(now, inbox, fix, actions)
        return actions

    def _take_in(self, now: float, inbox: Inbox) -> tuple[Ack, ...]:
        for state, received_s in inbox.states:
            self._peers.hear(state, received_s)
        for beacon, received_s in inbox.beacons:
            self._station = (beacon, received_s)
        for level, text in self._operator.tuner.update(now, inbox.states):
            self._say(now, level, text)
        if self._controller.gains is not self._operator.tuner.gains:
            self._controller.tune(self._operator.tuner.gains)
        self._peers.count_ages(now)
        self._lifeline_cut |= inbox.lifeline_cut
        for text in inbox.view.texts:
            self._last_text = text
            self._say(now, "warning", f"vehicle: {text}")
        return tuple(self._answer(now, command) for command in inbox.commands)

    # --- the operator ---

    def _answer(self, now: float, command: Command) -> Ack:
        """Acknowledge a command, and do what it asks for if it is new and can be done."""
        frame, before = self._reference.frame, self._operator.override
        flown = before.step if before else self._progress.current
        airborne = self._was_armed and self._phase is not Phase.ENDED
        formed = bool(self._reference.slots)
        seat = Seat(self._plan, self._id, self._phase, airborne, self._progress, formed, before, now, self._peers)
        ack, new = self._operator.answer(command, seat, frame.leg if frame else 0)
        if not new:
            return ack
        self._say(now, "info", f"the operator commands: {command.kind}")
        if command.kind == "next":
            self._progress.finish_step(now, "skipped")
        after = self._operator.override
        if after is not before:
            self._scattered = isinstance(flown, FormStep) or (self._scattered and command.kind == "hold")
            self._enter(after.step if after else None, before.leg if before else 0)
        return ack

    @property
    def _pausing(self) -> bool:
        """The mission's step waits, and its time with it."""
        held = any(peer.state is not None and peer.state.command for peer in self._peers)
        paused = self._finding is not None and self._finding.action == "hold"
        return self._operator.override is not None or held or paused

    def _enter(self, step: Step | None, leg: int = 0) -> None:
        """Begin a step: a mission's, an operator's, or (None) the mission's again, on its `leg`."""
        self._inside_since = self._formation_error = None
        self._measure_due = -math.inf  # what was measured is the shape before
        again = step is None
        step = self._progress.current if step is None else step
        if isinstance(step, FormStep):
            self._reference.form(step.slots)
            if step.neighbours is not None:
                self._neighbourhood.choose(step.neighbours)
        else:
            self._reference.begin(leg if again else 0)

    # --- what forbids going on ---

    def _check(self, now: float, view: VehicleView, fix: OwnFix | None) -> None:
        """Look for a finding that outweighs what is being done (`watch.replaces`)."""
        if self._ended_s is not None:
            return
        finding = watch.find(
            watch.Situation(
                now,
                self._plan,
                view,
                fix,
                self._peers,
                self._progress,
                self._station[1] if self._station else None,
                self._had_control,
                self._was_armed,
                self._lifeline_cut,
                self._operator.wants,
                self._controller.stop_point_m,
                self._height(fix) if fix is not None else 0.0,
                landing=self._landing_s is not None,
                returning=self._phase is Phase.RETURN,
            )
        )
        if not watch.replaces(finding, self._finding, landing=self._landing_s is not None):
            return
        if finding is None:
            self._say(now, "info", "going on")
            self._target_height_m = self._planned_height_m
        else:
            self._say(now, "error" if finding.outcome == "failed" else "warning", f"{finding.action}: {finding.reason}")
            if finding.action != "hold":
                self._progress.break_off("timeout" if "timed out" in finding.reason else "aborted", now)
        self._finding, self._finding_s = finding, now
        if fix is not None:
            self._target_height_m = min(self._target_height_m, self._height(fix))  # never climb on while stopping

    # --- what to do ---

    def _decide(self, now: float, view: VehicleView, fix: OwnFix | None) -> Goal:
        self._reason = self._finding.reason if self._finding else ""
        if self._ended_s is not None:
            self._controller.rest()
            return Release()
        if self._progress.finished:
            return self._end(now)
        if self._finding is not None:
            return self._wind_down(now, view, fix, self._finding)
        step = self._progress.current
        if step is None:
            return self._prepare(now, view, fix)
        if isinstance(step, TakeoffStep):
            return self._take_off(now, view, fix, step)
        if isinstance(step, LandStep):
            return self._land(now, view, fix, brake_s=0.0)
        if isinstance(step, ReturnStep):
            return self._return(now, view, fix)
        return self._fly_formation(now, view, fix, step)

    def _fly_formation(self, now: float, view: VehicleView, fix: OwnFix | None, step: Shaped) -> Goal:
        """The law in the mission's step, or in what the operator has put in its place."""
        self._phase = Phase.FLY
        override = self._operator.override
        if override is not None:
            self._reason = f"the operator commands: {override.kind}"
            if override.kind == "hold" and self._scattered:
                return self._fly(now, fix, self._controller.keep_clear(now, view.contacts) if fix else None)
        flown = override.step if override is not None else step
        velocity = self._formation_velocity(now, view, flown) if fix else None
        if override is None:
            self._judge_step(now, step)
        return self._fly(now, fix, velocity)

    def _formation_velocity(self, now: float, view: VehicleView, step: Step) -> Point:
        reference, own = self._reference, self._controller.stop_point_m
        extra = (0.0, 0.0)
        if not isinstance(step, FormStep):
            key = (self._progress.step, self._command)
            free = self._finding is None
            reference.follow(now, step, key, own, self._formation_error, free=free)
            extra = reference.feed_forward(step, own, self._controller.gain)
        return self._controller.form(now, reference.slots, view.contacts, extra)

    @property
    def _command(self) -> int:
        return self._operator.override.tag if self._operator.override is not None else 0

    def _prepare(self, now: float, view: VehicleView, fix: OwnFix | None) -> Goal:
        """Wait for a healthy vehicle on its planned start, and for peers and station with the same plan."""
        self._controller.rest()
        self._phase = Phase.PREPARE if math.isfinite(view.heartbeat_s) else Phase.CONNECT
        armed_before = view.armed and not self._was_armed
        self._reason = (
            "the vehicle is armed already; disarm it first"
            if armed_before and view.healthy
            else not_ready(self._plan, self._own, view, fix, self._navigator)
            or other_plan(self._hash, self._peers, self._station, expect_station=self._expect_station)
        )
        if not self._reason:
            self._progress.finish_step(now)
            self._reason = "waiting for the others"
        elif self._progress.done:
            self._progress.done = False  # health can be lost again while waiting
        return Standby()

    def _take_off(self, now: float, view: VehicleView, fix: OwnFix | None, step: TakeoffStep) -> Goal:
        if not view.armed or fix is None:
            self._phase = Phase.ARM
            self._controller.rest()
            if fix is not None:
                self._takeoff_height_m = fix.height_m
            self._arming_s = now
            self._reason = self._last_text or "waiting for the vehicle to arm"
            return Airborne(step.height_m)
        self._phase = Phase.TAKEOFF
        self._target_height_m = self._planned_height_m = step.height_m
        missing = step.height_m - self._height(fix)
        if missing > _HEIGHT_TOLERANCE_M and not self._progress.done:
            self._controller.rest()
            return Airborne(step.height_m)
        if view.controlled:
            self._progress.finish_step(now)
        return self._fly(now, fix, self._controller.keep_clear(now, view.contacts))

    def _judge_step(self, now: float, step: Shaped) -> None:
        """Own part of the step done? Or its time over, where the mission then goes on."""
        late = step.on_timeout is Policy.CONTINUE and now > self._progress.timed_out_at
        if isinstance(step, HoldStep):
            if now - self._progress.started_s - self._progress.paused_s >= step.duration_s:
                self._progress.finish_step(now)
            return
        inside = self._formation_error is not None and self._formation_error < step.tolerance_m
        if not isinstance(step, FormStep):
            inside = inside and self._reference.there(step, self._controller.stop_point_m)
        if not inside:
            self._inside_since = None
        elif self._inside_since is None:
            self._inside_since = now
        elif now - self._inside_since >= step.settle_s:
            self._progress.finish_step(now)
        if late:
            self._progress.finish_step(now, "timeout")

    def _fly(self, now: float, fix: OwnFix | None, velocity: Point | None) -> Goal:
        """The tick's setpoint; without a fresh position it is zero."""
        if fix is None or velocity is None:
            self._controller.rest()
            north, east, climb = 0.0, 0.0, 0.0
            self._reason = self._reason or "no fresh position from the vehicle"
        else:
            (north, east) = velocity
            climb = safety.climb_rate(self._target_height_m - self._height(fix), self._plan.limits)
        self._account.setpoint(now)
        return Fly((north, east, -climb))

    def _wind_down(self, now: float, view: VehicleView, fix: OwnFix | None, finding: watch.Finding) -> Goal:
        """Carry a finding out: pause, yield, or hold for a moment and land."""
        # a vehicle asked to arm a moment ago may do so yet: only what it says well after that counts
        down = view.on_ground and not view.armed and now - self._arming_s > _ARMING_S
        if down or now - view.heartbeat_s > _GONE_VEHICLE_S:
            return self._end(now)
        if finding.action == "kill":
            self._phase = Phase.LAND
            self._controller.rest()
            return Terminate()
        if not view.armed and not self._was_armed:
            self._controller.rest()
            return Land() if math.isfinite(self._arming_s) else Standby()
        if finding.action == "yield":
            self._phase = Phase.YIELD
            self._controller.rest()
            return Yield()
        if finding.action == "hold":
            return self._hold(now, view, fix)
        if finding.action == "return" and self._had_control:
            return self._return(now, view, fix)
        wait = self._plan.policies.hold_before_land_s if finding.outcome == "failed" else 0.0
        return self._land(now, view, fix, wait)

    def _hold(self, now: float, view: VehicleView, fix: OwnFix | None) -> Goal:
        self._phase = Phase.HOLD
        if not view.controlled and self._progress.step <= 1:
            self._controller.rest()
            return Land() if view.armed else Standby()  # still under the autopilot's own take-off
        return self._fly(now, fix, self._controller.keep_clear(now, view.contacts) if fix else None)

    def _return(self, now: float, view: VehicleView, fix: OwnFix | None) -> Goal:
        """Up to the own height, wait for the turn, over the own start, down."""
        begun = self._finding_s if self._finding else self._progress.started_s
        if self._phase is not Phase.RETURN and self._landing_s is None:
            self._phase = Phase.RETURN
        too_late = now - begun > _RETURN_AT_MOST_S * len(self._plan.agents)
        if self._landing_s is None and (too_late or self._deserted(now)):
            why = "it took too long" if too_late else "no other agent is heard"
            reason = self._finding.reason if self._finding else "return"
            self._finding, self._finding_s = watch.Finding("land", "failed", f"{reason}; {why}, so it lands here"), now
            self._say(now, "error", self._finding.reason)
            return self._land(now, view, fix, brake_s=0.0)
        stage = self._homing.update(now, fix, self._height(fix) if fix else 0.0)
        if stage is Stage.DOWN:
            self._landing_s = self._landing_s or now
            return self._land(now, view, fix, brake_s=0.0)
        self._reason = self._reason or f"return: {stage.name.lower()}"
        self._target_height_m = self._homing.height_m
        if fix is None:
            return self._fly(now, fix, None)
        if stage is Stage.FLY:
            speed = self._plan.policies.return_speed_mps
            return self._fly(now, fix, self._controller.go_to(now, self._homing.home_m, speed, view.contacts))
        return self._fly(now, fix, self._controller.keep_clear(now, view.contacts))

    def _deserted(self, now: float) -> bool:
        if not self._homing.alone(now):
            self._alone_since = None
            return False
        self._alone_since = now if self._alone_since is None else self._alone_since
        return now - self._alone_since > self._plan.policies.agent_lost_after_s

    def _land(self, now: float, view: VehicleView, fix: OwnFix | None, brake_s: float) -> Goal:
        """Stand still first, so that nobody leaves the avoidance behind while moving; then down in place."""
        if self._landing_s is None:
            begun = self._finding_s if self._finding else self._progress.started_s
            waited = now - begun
            slow = fix is not None and math.hypot(*fix.velocity_ned_mps[:2]) < _AT_REST_MPS
            if waited < brake_s or not (slow or waited > _BRAKE_AT_MOST_S):
                return self._hold(now, view, fix)
            self._landing_s = now
        self._phase = Phase.LAND
        self._controller.rest()
        if view.on_ground and not view.armed and self._finding is None:
            self._progress.finish_step(now)
        elif now - self._landing_s > _LANDING_AT_MOST_S:
            self._finding = watch.Finding("land", "failed", f"not down after {_LANDING_AT_MOST_S:g} s of landing")
            return self._end(now)
        return Land()

    def _end(self, now: float) -> Goal:
        self._phase = Phase.ENDED
        self._ended_s = now
        self._controller.rest()
        finding = self._finding
        self._reason = finding.reason if finding else ""
        self._say(now, "info", f"ended: {self._outcome}" + (f" ({self._reason})" if self._reason else ""))
        return Release()

    # --- steps, formation, neighbours ---

    def _members(self, now: float) -> list[tuple[int, bool]]:
        """What the barrier waits for: the whole plan. Silent ones block it, unless the policy is to go on without."""
        lost, members = self._lost(now), []
        for peer in self._peers:
            heard = peer.state if peer.age(now) <= self._plan.policies.agent_lost_after_s else None
            if peer.state is not None and watch.progress_of(peer.state) >= (len(self._plan.steps), True):
                heard = peer.state  # through, and silent because of it
            if peer.id not in lost:
                members.append(watch.progress_of(heard) if heard is not None else (-1, False))
        return members

    def _lost(self, now: float) -> set[int]:
        """Who the mission goes on without: not heard for long, or given up, where its policy is to go on."""
        policies = self._plan.policies
        if policies.agent_lost is not Policy.CONTINUE or not self._was_armed:
            return set()
        return {
            peer.id
            for peer in self._peers
            if peer.state is not None
            and (peer.age(now) > policies.agent_lost_after_s or watch.gave_up(peer.state, self._plan))
        }

    def _enter_step(self, now: float) -> None:
        self._say(now, "info", f"step {self._progress.step}: {step_name(self._plan, self._progress.step)}")
        step = self._progress.current
        if step is not None:
            self._enter(step)

    def _measure_formation(self, now: float, fix: OwnFix | None) -> float | None:
        """Largest |e_j - mean e| over everybody heard, itself included [m]; None unless all of them are fresh."""
        shape = self._reference.slots
        if not shape or fix is None:
            return None
        lost = self._lost(now)
        members = [s for s in self._peers.fresh(now) if s.agent not in lost]
        if len(members) < sum(not self._counts_out(peer.state) for peer in self._peers if peer.id not in lost):
            return None
        unit = self._plan.unit_m
        points = [(fix.position_ned_m[0], fix.position_ned_m[1])]
        points += [(s.position_ned_m[0], s.position_ned_m[1]) for s in members]
        if isinstance(self._progress.current, RotateStep | ScaleStep):
            # the places themselves move against each other: vehicles lag behind them, their stop points do not
            points = [self._controller.stop_point_m, *(s.stop_point_m for s in members)]
        ids = [self._id, *(s.agent for s in members)]
        slots = [(shape[i][0] * unit, shape[i][1] * unit) for i in ids]
        return float(formation_error(points, slots))

    def _counts_out(self, state: AgentState | None) -> bool:
        return state is not None and bool(watch.gave_up(state, self._plan))

    def _watch_neighbours(self, now: float) -> None:
        if self._progress.step == 0 or self._phase in (Phase.LAND, Phase.RETURN, Phase.ENDED):
            return  # on the way down the others fall silent one by one, and nobody follows them any more
        said = self._neighbourhood.lose(self._lost(now)) + self._neighbourhood.watch(now)
        for level, text in said:
            self._say(now, level, text)

    # --- saying so ---

    @property
    def _outcome(self) -> str:
        if self._ended_s is None:
            return "running"
        return self._finding.outcome if self._finding else "completed"

    def _height(self, fix: OwnFix) -> float:
        return fix.height_m - self._takeoff_height_m

    def _say(self, now: float, level: str, text: str) -> None:
        self._events.append(Event(self._id, now, level, text))

    def _state(self, now: float, fix: OwnFix) -> AgentState:
        self._seq += 1
        return AgentState(
            self._id,
            self._seq,
            now,
            self._hash,
            self._phase,
            self._progress.step,
            self._progress.done,
            self._was_armed and self._phase not in (Phase.ARM, Phase.ENDED),
            fix.position_ned_m,
            fix.velocity_ned_mps,
            self._controller.stop_point_m,
            self._controller.commanded_mps,
            self._reference.frame,
            int(self._homing.stage),
            self._command,
            self._operator.tuner.tag,
            self._operator.tuner.decided,
        )

    def _publish_slow(self, now: float, inbox: Inbox, fix: OwnFix | None, actions: Actions) -> None:
        self._watch_neighbours(now)
        since = now - self._ended_s if self._ended_s is not None else -1.0
        ending = since >= (_LINGER_S if inbox.view.released else _RELEASE_AT_MOST_S)
        if now >= self._sigma_due:
            self._sigma_due = now + _SIGMA_EVERY_S
            actions.sigma = self._controller.sigma_report(now)
            if actions.sigma is None and self._sigma_shown:
                actions.sigma = SigmaReport(self._id, now, (0.0, 0.0), (0.0, 0.0), ())
            self._sigma_shown = actions.sigma is not None and bool(actions.sigma.pairs)
        if now >= self._status_due or ending:
            self._status_due = now + _STATUS_EVERY_S
            actions.status = self._status(now, inbox, fix)
        actions.events, self._events = tuple(self._events), []
        if ending:
            actions.ended = Ended(self._outcome, self._reason)

    def _status(self, now: float, inbox: Inbox, fix: OwnFix | None) -> AgentStatus:
        return self._account.status(
            now,
            inbox.view,
            self._peers,
            self._controller,
            self._progress,
            agent=self._id,
            phase=self._phase,
            reason=self._reason,
            outcome=self._outcome,
            height_m=self._height(fix) if fix is not None else None,
            formation_error_m=self._formation_error,
            near=nearest(self._peers.fresh(now), fix),
            station_s=self._station[1] if self._station else None,
            tick=inbox.tick(),
            bad_payloads=inbox.bad_payloads,
            echo=Echo(self._station[0].station, self._station[0].time_s, now - self._station[1])
            if self._station
            else None,
        )
