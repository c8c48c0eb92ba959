"""The agent: `step(now, inbox) -> actions`, and nothing else. No I/O, no clock, no randomness.

One tick: take in what was heard, find out where we are, see whether anything forbids going on (`core/watch.py`), fly
the current step or wind the flight down, and say so. Everything sent anywhere is in `Actions`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from swarm_ctl.core import graph, safety, watch
from swarm_ctl.core.controller import Controller
from swarm_ctl.core.formation import formation_error
from swarm_ctl.core.freshness import OWN_FIX_S
from swarm_ctl.core.navigation import AGREE_M, Navigator, OwnFix
from swarm_ctl.core.peers import Peers
from swarm_ctl.core.plan import FormStep, HoldStep, LandStep, Plan, Point, Policy, TakeoffStep
from swarm_ctl.core.progress import Progress, step_name
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
    VehicleLinkReport,
)
from swarm_ctl.core.vehicle import Airborne, Fly, Goal, Land, Release, Standby, VehicleView, Yield

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
        self._graph = {agent.id: agent.neighbours for agent in plan.agents}
        self._navigator = Navigator(plan.origin)
        self._peers = Peers(plan, agent_id)
        self._controller = Controller(plan, agent_id, self._peers)
        self._progress = Progress(plan, now)
        self._phase = Phase.CONNECT
        self._slots: dict[int, Point] = {}
        self._finding: watch.Finding | None = None
        self._finding_s = math.inf
        self._landing_s: float | None = None
        self._ended_s: float | None = None
        self._arming_s = -math.inf
        self._station: tuple[StationBeacon, float] | None = None
        self._had_control = self._was_armed = self._lifeline_cut = False
        self._land_command = ""
        self._answers: dict[str, Ack] = {}
        self._takeoff_height_m = 0.0
        self._target_height_m = self._planned_height_m = 0.0
        self._inside_since: float | None = None
        self._formation_error: float | None = None
        self._measure_due = now
        self._reason = ""
        self._last_text = ""
        self._neighbours: tuple[int, ...] = self._own.neighbours
        self._seq = 0
        self._setpoints = 0
        self._first_setpoint_s = self._last_setpoint_s = 0.0
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
        self._peers.count_ages(now)
        self._lifeline_cut |= inbox.lifeline_cut
        for text in inbox.view.texts:
            self._last_text = text
            self._say(now, "warning", f"vehicle: {text}")
        return tuple(self._answer(now, command) for command in inbox.commands)

    def _answer(self, now: float, command: Command) -> Ack:
        """Acknowledge a command; one seen before gets its old answer and nothing else."""
        known = self._answers.get(command.id)
        if known is not None:
            return known
        refusal = ""
        if command.agents and self._id not in command.agents:
            refusal = f"not meant for agent {self._id}"
        elif command.kind != "land":
            refusal = f"unknown command {command.kind!r}; allowed: land"
        elif self._phase in (Phase.YIELD, Phase.ENDED):
            refusal = f"agent {self._id} no longer flies its vehicle"
        else:
            self._land_command = "landed by the operator"
            self._say(now, "info", "the operator commands: land")
        ack = Ack(self._id, command.id, not refusal, refusal)
        self._answers[command.id] = ack
        return ack

    # --- what forbids going on ---

    def _check(self, now: float, view: VehicleView, fix: OwnFix | None) -> None:
        """Look for a finding; the first that lands or yields stays, a pause ends with its cause."""
        if self._ended_s is not None or (self._finding is not None and self._finding.action != "hold"):
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
                self._land_command,
            )
        )
        if finding == self._finding:
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
        self._phase = Phase.FLY
        velocity = self._controller.form(now, self._slots, view.contacts) if fix else None
        self._judge_step(now, step)
        return self._fly(now, fix, velocity)

    def _prepare(self, now: float, view: VehicleView, fix: OwnFix | None) -> Goal:
        """Wait for a healthy vehicle on its planned start, and for peers and station with the same plan."""
        self._controller.rest()
        self._phase = Phase.PREPARE if math.isfinite(view.heartbeat_s) else Phase.CONNECT
        self._reason = self._not_ready(view, fix)
        if not self._reason:
            self._progress.finish_step(now)
            self._reason = "waiting for the others"
        elif self._progress.done:
            self._progress.done = False  # health can be lost again while waiting
        return Standby()

    def _not_ready(self, view: VehicleView, fix: OwnFix | None) -> str:
        if not view.healthy or fix is None:
            return view.health_reason or "no position yet"
        if view.armed and not self._was_armed:
            return "the vehicle is armed already; disarm it first"
        unit = self._plan.unit_m
        start = (self._own.start[0] * unit, self._own.start[1] * unit)
        off = math.dist(start, fix.position_ned_m[:2])
        if off > unit:
            return f"the vehicle stands {off:.1f} m from its planned start; allowed: {unit:g} m"
        apart = self._navigator.disagreement_m(view, fix)
        if apart > AGREE_M:
            return f"global and local position differ by {apart:.1f} m; allowed: {AGREE_M:g} m"
        hashes = [(f"agent {p.id}", p.state.plan_hash) for p in self._peers if p.state is not None]
        if self._station is not None:
            hashes.append((f"station {self._station[0].station}", self._station[0].plan_hash))
        elif self._expect_station:
            return "no ground station heard yet"
        for who, plan_hash in hashes:
            if plan_hash != self._hash:
                return f"{who} has another plan ({plan_hash:016x}, ours is {self._hash:016x})"
        return ""

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

    def _judge_step(self, now: float, step: FormStep | HoldStep) -> None:
        if isinstance(step, HoldStep):
            if now - self._progress.started_s >= step.duration_s:
                self._progress.finish_step(now)
            return
        inside = self._formation_error is not None and self._formation_error < step.tolerance_m
        if not inside:
            self._inside_since = None
        elif self._inside_since is None:
            self._inside_since = now
        elif now - self._inside_since >= step.settle_s:
            self._progress.finish_step(now)

    def _fly(self, now: float, fix: OwnFix | None, velocity: Point | None) -> Goal:
        """The tick's setpoint; without a fresh position it is zero."""
        if fix is None or velocity is None:
            self._controller.rest()
            north, east, climb = 0.0, 0.0, 0.0
            self._reason = self._reason or "no fresh position from the vehicle"
        else:
            (north, east) = velocity
            climb = safety.climb_rate(self._target_height_m - self._height(fix), self._plan.limits)
        if self._setpoints == 0:
            self._first_setpoint_s = now
        self._setpoints += 1
        self._last_setpoint_s = now
        return Fly((north, east, -climb))

    def _wind_down(self, now: float, view: VehicleView, fix: OwnFix | None, finding: watch.Finding) -> Goal:
        """Carry a finding out: pause, yield, or hold for a moment and land."""
        # a vehicle asked to arm a moment ago may do so yet: only what it says well after that counts
        down = view.on_ground and not view.armed and now - self._arming_s > _ARMING_S
        if down or now - view.heartbeat_s > _GONE_VEHICLE_S:
            return self._end(now)
        if not view.armed and not self._was_armed:
            self._controller.rest()
            return Land() if math.isfinite(self._arming_s) else Standby()
        if finding.action == "yield":
            self._phase = Phase.YIELD
            self._controller.rest()
            return Yield()
        if finding.action == "hold":
            return self._hold(now, view, fix)
        wait = self._plan.policies.hold_before_land_s if finding.outcome == "failed" else 0.0
        return self._land(now, view, fix, wait)

    def _hold(self, now: float, view: VehicleView, fix: OwnFix | None) -> Goal:
        self._phase = Phase.HOLD
        if not view.controlled and self._progress.step <= 1:
            self._controller.rest()
            return Land() if view.armed else Standby()  # still under the autopilot's own take-off
        return self._fly(now, fix, self._controller.keep_clear(now, view.contacts) if fix else None)

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
        policies = self._plan.policies
        without = policies.agent_lost is Policy.CONTINUE and self._was_armed
        members = []
        for peer in self._peers:
            heard = peer.state if peer.age(now) <= policies.agent_lost_after_s else None
            if peer.state is not None and watch.progress_of(peer.state) >= (len(self._plan.steps), True):
                heard = peer.state  # through, and silent because of it
            if heard is not None:
                members.append(watch.progress_of(heard))
            elif not (without and peer.state is not None):
                members.append((-1, False))
        return members

    def _enter_step(self, now: float) -> None:
        step = self._progress.current
        self._say(now, "info", f"step {self._progress.step}: {step_name(self._plan, self._progress.step)}")
        if isinstance(step, FormStep):
            self._slots = dict(zip((agent.id for agent in self._plan.agents), step.slots, strict=True))
            self._inside_since = None

    def _measure_formation(self, now: float, fix: OwnFix | None) -> float | None:
        """Largest |e_j - mean e| over everybody heard, itself included [m]; None unless all of them are fresh."""
        if not self._slots or fix is None:
            return None
        members = self._peers.fresh(now)
        if len(members) + 1 < sum(not self._counts_out(peer.state) for peer in self._peers) + 1:
            return None
        unit = self._plan.unit_m
        points = [(fix.position_ned_m[0], fix.position_ned_m[1])]
        points += [(s.position_ned_m[0], s.position_ned_m[1]) for s in members]
        ids = [self._id, *(s.agent for s in members)]
        slots = [(self._slots[i][0] * unit, self._slots[i][1] * unit) for i in ids]
        return float(formation_error(points, slots))

    def _counts_out(self, state: AgentState | None) -> bool:
        return state is not None and bool(watch.gave_up(state, self._plan))

    def _watch_neighbours(self, now: float) -> None:
        """Report who leaves and rejoins N_i, and what that does to the graph (LAW.md section 1)."""
        if self._progress.step == 0 or self._phase is Phase.ENDED:
            return
        heard = self._peers.neighbours(now)
        if heard == self._neighbours:
            return
        gone = sorted(set(self._neighbours) - set(heard))
        back = sorted(set(heard) - set(self._neighbours))
        self._neighbours = heard
        for agent in back:
            self._say(now, "info", f"neighbour {agent} is heard again")
        if gone:
            parts = graph.components(graph.without(self._graph, set(self._own.neighbours) - set(heard)))
            what = "stays connected" if len(parts) == 1 else f"falls apart: {' | '.join(map(str, parts))}"
            names = ", ".join(map(str, gone))
            self._say(now, "warning", f"neighbour {names} is not heard; the graph {what}")

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
        view = inbox.view
        nearest_id, nearest_m = self._nearest(now, fix)
        span = self._last_setpoint_s - self._first_setpoint_s
        return AgentStatus(
            agent=self._id,
            time_s=now,
            phase=self._phase,
            step=self._progress.step,
            done=self._progress.done,
            reason=self._reason,
            outcome=self._outcome,
            mode=view.mode,
            armed=view.armed,
            airborne=not view.on_ground,
            battery_percent=view.battery_percent,
            height_m=self._height(fix) if fix is not None else None,
            formation_error_m=self._formation_error,
            nearest_agent=nearest_id,
            nearest_m=nearest_m,
            heartbeat_age_s=now - view.heartbeat_s if math.isfinite(view.heartbeat_s) else None,
            station_age_s=now - self._station[1] if self._station else None,
            setpoints=self._setpoints,
            setpoint_rate_hz=(self._setpoints - 1) / span if span > 0 else 0.0,
            neighbours=self._peers.neighbours(now),
            sigma_tally=self._controller.tally,
            overspeed_ticks=self._controller.overspeed_ticks,
            links={peer.id: peer.report(now) for peer in self._peers},
            steps=tuple(self._progress.results),
            tick=inbox.tick(),
            bad_payloads=inbox.bad_payloads,
            vehicle_link=VehicleLinkReport(view.frames, view.frames_lost, view.round_trip_s),
            echo=Echo(self._station[0].station, self._station[0].time_s, now - self._station[1])
            if self._station
            else None,
        )

    def _nearest(self, now: float, fix: OwnFix | None) -> tuple[int | None, float | None]:
        if fix is None:
            return None, None
        own = fix.position_ned_m
        gaps = [
            (math.hypot(own[0] - s.position_ned_m[0], own[1] - s.position_ned_m[1]), s.agent)
            for s in self._peers.fresh(now)
        ]
        if not gaps:
            return None, None
        distance, agent = min(gaps)
        return agent, distance
