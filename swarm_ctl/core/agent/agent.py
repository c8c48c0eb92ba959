"""The agent: `step(now, inbox) -> actions`, and nothing else. No I/O, no clock, no randomness.

One tick: take in what was heard, find out where we are, see whether anything forbids going on
(`core/agent/failsafes.py`), fly the current step (`core/agent/step_executor.py`) or wind the flight
down (`core/agent/landing.py`), and say so. What these share is the `Sortie`; who else flies is
`core/agent/barrier.py`. Everything sent anywhere is in `Actions`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from swarm_ctl.core.agent import failsafes
from swarm_ctl.core.agent.barrier import Barrier
from swarm_ctl.core.agent.command_handler import CommandHandler, Seat
from swarm_ctl.core.agent.flight_context import FlightContext
from swarm_ctl.core.agent.landing import Landing
from swarm_ctl.core.agent.preflight import HeardStation, Preflight
from swarm_ctl.core.agent.progress import Progress, step_name
from swarm_ctl.core.agent.return_to_launch import ReturnToLaunch
from swarm_ctl.core.agent.status_report import nearest
from swarm_ctl.core.agent.step_executor import StepExecutor
from swarm_ctl.core.agent.takeover import Takeover
from swarm_ctl.core.control.controller import Controller
from swarm_ctl.core.control.navigation import Navigator, OwnFix
from swarm_ctl.core.control.reference import Reference
from swarm_ctl.core.model.messages import (
    Ack,
    AgentState,
    AgentStatus,
    ClockNews,
    Command,
    Echo,
    Event,
    Phase,
    SigmaReport,
    StationBeacon,
    TickReport,
)
from swarm_ctl.core.model.plan import FormStep, Plan, Response, Step
from swarm_ctl.core.model.timeouts import OWN_FIX_S
from swarm_ctl.core.model.vehicle import Goal, VehicleView
from swarm_ctl.core.swarm.neighbourhood import Neighbourhood
from swarm_ctl.core.swarm.peers import Peers
from swarm_ctl.core.swarm.slot_exchange import SlotExchange

_STATUS_EVERY_S = 0.5
_SIGMA_EVERY_S = 0.2
_LINGER_S = 2.0
"""After the end an agent goes on saying so, and gives the vehicle its parameters back."""
_RELEASE_AT_MOST_S = 5.0
"""A vehicle that has not confirmed its own parameters by then (five tries) keeps ours, which are
the careful ones."""


@dataclass(slots=True)
class Inbox:
    """What one tick has to go by; received times are on the own clock."""

    view: VehicleView
    states: Sequence[tuple[AgentState, float]] = ()
    clocks: Sequence[tuple[ClockNews, float]] = ()
    """With when they came, not when they were looked for."""
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
    """What one tick sends: a goal for the vehicle, the rest for the mesh; None: nothing this
    time."""

    goal: Goal
    state: AgentState | None
    clock: ClockNews | None = None
    status: AgentStatus | None = None
    sigma: SigmaReport | None = None
    events: tuple[Event, ...] = ()
    acks: tuple[Ack, ...] = ()
    ended: Ended | None = None


class Agent:
    """One agent of a plan, from its first tick to its end.

    `expect_station`: it was started together with a ground station, so it does not arm before that
    is heard. `vehicle`: how the own vehicle answers, where that is not the plan's `response`.
    """

    def __init__(
        self,
        plan: Plan,
        agent_id: int,
        now: float,
        *,
        expect_station: bool = False,
        vehicle: Response | None = None,
    ) -> None:
        self._plan = plan
        self._id = agent_id
        self._hash = plan.hash()
        self._navigator = Navigator(plan.origin)
        self._peers = peers = Peers(plan, agent_id)
        self._controller = controller = Controller(plan, agent_id, peers, vehicle or plan.response)
        self._progress = progress = Progress(plan, now)
        self._reference = reference = Reference(plan, agent_id, peers)
        self._neighbourhood = Neighbourhood(plan, agent_id, peers)
        self._dealer = dealer = SlotExchange(plan, agent_id, peers)
        self._homing = ReturnToLaunch(plan, agent_id, peers)
        self._operator = CommandHandler(plan, agent_id, self._hash)
        self._sortie = sortie = FlightContext(plan, agent_id, controller)
        self._members = members = Barrier(sortie, peers, controller, progress, reference)
        gate = Preflight(
            plan, plan.agent(agent_id), self._hash, self._navigator, peers, expect_station
        )
        descent = Landing(sortie, controller, progress, self._homing)
        self._takeover = takeover = Takeover(
            sortie, gate, controller, progress, reference, self._step_forms, dealer
        )
        self._flight = StepExecutor(
            sortie,
            gate,
            members,
            controller,
            progress,
            reference,
            self._operator,
            descent,
            takeover,
            dealer,
            self._neighbourhood,
        )
        self._station: HeardStation | None = None
        self._lifeline_cut = False
        self._seq = 0
        self._status_due = self._sigma_due = now
        self._sigma_shown = False

    # --- one tick ---

    def step(self, now: float, inbox: Inbox) -> Actions:
        """Decide one tick; call it every `plan.tick_s`."""
        acks = self._take_in(now, inbox)
        view = inbox.view
        fix = self._navigator.fix(view, now)
        fresh = fix if fix is not None and fix.age_s <= OWN_FIX_S else None
        self._sortie.observe(view)
        if fix is not None:
            self._controller.locate(fix)
        self._members.measure(now, fresh)
        self._check(now, view, fix)
        if self._pausing:
            self._progress.paused_s += self._plan.tick_s
        goal = self._flight.decide(now, view, fresh, self._station)
        going_on = self._sortie.finding is None and self._sortie.phase is not Phase.ENDED
        if going_on and self._progress.advance(self._members.barrier(now), now):
            self._enter_step(now)
        actions = Actions(goal, self._state(now, fresh) if fresh is not None else None, acks=acks)
        actions.clock = self._peers.clocks.say(now)
        self._publish_slow(now, inbox, fix, actions)
        return actions

    # --- what is heard ---

    def _take_in(self, now: float, inbox: Inbox) -> tuple[Ack, ...]:
        for news, received_s in inbox.clocks:
            self._peers.clocks.hear(news, received_s)
        for state, received_s in inbox.states:
            self._takeover.hear(state, received_s)
            self._peers.hear(state, received_s)
        self._dealer.hear()
        self._reference.assign(self._dealer.roles)
        for beacon, received_s in inbox.beacons:
            self._station = (beacon, received_s)
        for level, text in self._operator.tuner.update(now, inbox.states):
            self._sortie.say(now, level, text)
        if self._controller.gains is not self._operator.tuner.gains:
            self._controller.tune(self._operator.tuner.gains)
        self._peers.count_ages(now)
        self._lifeline_cut |= inbox.lifeline_cut
        for text in inbox.view.texts:
            self._sortie.say(now, "warning", f"vehicle: {text}")
        return tuple(self._answer(now, command) for command in inbox.commands)

    def _answer(self, now: float, command: Command) -> Ack:
        """Acknowledge an operator's command, and do what it asks for if it is new and can be
        done."""
        frame, before, sortie = self._reference.frame, self._operator.override, self._sortie
        flown = before.step if before else self._progress.current
        airborne = sortie.was_armed and sortie.phase is not Phase.ENDED
        formed = bool(self._reference.slots)
        seat = Seat(
            self._plan,
            self._id,
            sortie.phase,
            airborne,
            self._progress,
            formed,
            before,
            now,
            self._peers,
        )
        ack, new = self._operator.answer(command, seat, frame.leg if frame else 0)
        if not new:
            return ack
        sortie.say(now, "info", f"the operator commands: {command.kind}")
        if command.kind == "next":
            self._progress.finish_step(now, "skipped")
        after = self._operator.override
        if after is not before:
            self._flight.commanded(command.kind, flown)
            self._enter(after.step if after else None, before.leg if before else 0)
        return ack

    # --- steps ---

    @property
    def _pausing(self) -> bool:
        """The mission's step waits, and its time with it."""
        finding = self._sortie.finding
        held = any(peer.state is not None and peer.state.command for peer in self._peers)
        paused = finding is not None and finding.action == "hold"
        return self._operator.override is not None or held or paused

    def _enter_step(self, now: float) -> None:
        self._sortie.say(
            now, "info", f"step {self._progress.step}: {step_name(self._plan, self._progress.step)}"
        )
        step = self._progress.current
        if step is not None:
            self._enter(step)

    def _enter(self, step: Step | None, leg: int = 0) -> None:
        """Begin a step: a mission's, an operator's, or (None) the mission's again, on its `leg`."""
        self._flight.begin()
        self._members.forget_shape()
        again = step is None
        step = self._progress.current if step is None else step
        if isinstance(step, FormStep) and self._operator.override is None:
            self._step_forms(step)
        elif isinstance(step, FormStep):
            self._reference.form(step.slots)
        else:
            self._reference.begin(leg if again else 0)

    def _step_forms(self, step: FormStep) -> None:
        """Begin a form step of the mission."""
        self._reference.form(step.slots, self._dealer.roles)
        if step.neighbours is not None:
            self._neighbourhood.choose(self._dealer.in_roles(step.neighbours))
        self._dealer.begin(step.slots)

    # --- what forbids going on ---

    def _check(self, now: float, view: VehicleView, fix: OwnFix | None) -> None:
        """Look for a finding that outweighs what is being done (`watch.replaces`)."""
        sortie = self._sortie
        if sortie.ended_s is not None:
            return
        finding = failsafes.find(
            failsafes.Situation(
                now,
                self._plan,
                view,
                fix,
                self._peers,
                self._progress,
                self._station[1] if self._station else None,
                sortie.had_control,
                sortie.was_armed,
                self._lifeline_cut,
                self._operator.wants,
                self._controller.stop_point_m,
                sortie.height(fix) if fix is not None else 0.0,
                landing=sortie.landing_s is not None,
                returning=sortie.phase is Phase.RETURN,
            )
        )
        if failsafes.replaces(finding, sortie.finding, landing=sortie.landing_s is not None):
            sortie.heed(now, finding, fix, self._progress)

    def _watch_neighbours(self, now: float) -> None:
        if self._progress.step == 0 or self._sortie.phase in (
            Phase.LAND,
            Phase.RETURN,
            Phase.ENDED,
        ):
            return  # on the way down the others fall silent one by one, and nobody follows them any more
        said = self._neighbourhood.lose(self._members.lost(now)) + self._neighbourhood.watch(now)
        for level, text in said:
            self._sortie.say(now, level, text)

    # --- what is said ---

    def _state(self, now: float, fix: OwnFix) -> AgentState:
        self._seq += 1
        sortie = self._sortie
        return AgentState(
            self._id,
            self._seq,
            now,
            self._hash,
            sortie.phase,
            self._progress.step,
            self._progress.done,
            sortie.was_armed and sortie.phase not in (Phase.ARM, Phase.ENDED),
            fix.position_ned_m,
            fix.velocity_ned_mps,
            self._controller.stop_point_m,
            self._controller.commanded_mps,
            self._reference.frame,
            int(self._homing.stage),
            self._flight.command,
            self._operator.tuner.tag,
            self._operator.tuner.decided,
            self._dealer.deal,
        )

    def _publish_slow(self, now: float, inbox: Inbox, fix: OwnFix | None, actions: Actions) -> None:
        self._watch_neighbours(now)
        sortie = self._sortie
        since = now - sortie.ended_s if sortie.ended_s is not None else -1.0
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
        actions.events, sortie.events = tuple(sortie.events), []
        if ending:
            actions.ended = Ended(sortie.outcome, sortie.reason)

    def _status(self, now: float, inbox: Inbox, fix: OwnFix | None) -> AgentStatus:
        sortie, station = self._sortie, self._station
        return sortie.account.status(
            now,
            inbox.view,
            self._peers,
            self._controller,
            self._progress,
            agent=self._id,
            phase=sortie.phase,
            reason=sortie.reason,
            outcome=sortie.outcome,
            height_m=sortie.height(fix) if fix is not None else None,
            formation_error_m=self._members.formation_error_m,
            near=nearest(self._peers.fresh(now), fix),
            station_s=station[1] if station else None,
            tick=inbox.tick(),
            bad_payloads=inbox.bad_payloads,
            roles=tuple(self._dealer.taken),
            echo=Echo(station[0].station, station[0].time_s, now - station[1]) if station else None,
        )
