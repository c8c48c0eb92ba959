"""The agent: `step(now, inbox) -> actions`, and nothing else. No I/O, no clock, no randomness.

One tick: take in what was heard, make the snapshot of peers, see whether a failsafe fires
(`failsafes.py`), carry out the current step (`step_executor.py`) or wind the flight down
(`landing.py`), and say so. What these parts share is the `FlightContext`. Everything that is sent
anywhere is in `Actions`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass
from typing import Final

from swarm_ctl.core.agent import failsafes
from swarm_ctl.core.agent.barrier import Barrier
from swarm_ctl.core.agent.command_handler import AgentSituation, CommandHandler
from swarm_ctl.core.agent.flight_context import FlightContext
from swarm_ctl.core.agent.landing import Landing
from swarm_ctl.core.agent.preflight import EstimateWatch, Preflight, ResponseWatch
from swarm_ctl.core.agent.progress import Progress, step_name
from swarm_ctl.core.agent.return_to_launch import ReturnToLaunch
from swarm_ctl.core.agent.status_report import RefusalsSaid, status_report
from swarm_ctl.core.agent.step_executor import StepExecutor
from swarm_ctl.core.agent.takeover import Takeover
from swarm_ctl.core.agent.tick import Attention, HeardStation, Tick
from swarm_ctl.core.control.controller import Controller
from swarm_ctl.core.control.navigation import Navigator, OwnFix
from swarm_ctl.core.control.reference import Reference
from swarm_ctl.core.model.causes import FailsafeAction
from swarm_ctl.core.model.messages import (
    Ack,
    AgentState,
    AgentStatus,
    ClockNews,
    Command,
    CommandKind,
    Event,
    Glimpse,
    Outcome,
    Phase,
    Refusal,
    Severity,
    SigmaReport,
    StationBeacon,
    StepOutcome,
    TickReport,
)
from swarm_ctl.core.model.own_parameters import Found, ParameterNote
from swarm_ctl.core.model.plan import Plan, Response
from swarm_ctl.core.model.steps.step import Step
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.core.model.vehicle import Goal, VehicleView
from swarm_ctl.core.swarm.hearing import Hearing, hears_all
from swarm_ctl.core.swarm.neighbourhood import Neighbourhood
from swarm_ctl.core.swarm.peers import Peers
from swarm_ctl.core.swarm.plausibility import Doubt, Finding
from swarm_ctl.core.swarm.slot_exchange import SlotExchange

_STANDS_MPS = 0.5
STATUS_EVERY_S: Final = 0.5
_SIGMA_EVERY_S = 0.2
_LINGER_S = 2.0
"""After the end an agent goes on saying so, and gives the vehicle its parameters back."""
_RELEASE_AT_MOST_S = 5.0
"""A vehicle that has not confirmed its own parameters by then (five tries) keeps ours, which are
the careful ones."""


@dataclass(slots=True)
class Inbox:
    """What one tick has to go by. Times are on the own clock: when a message came, not when it was
    read."""

    view: VehicleView
    states: Sequence[tuple[AgentState, float]] = ()
    far: Sequence[tuple[AgentState, float]] = ()
    """Far words (`core/swarm/hearing.py`)."""
    clocks: Sequence[tuple[ClockNews, float]] = ()
    beacons: Sequence[tuple[StationBeacon, float]] = ()
    commands: Sequence[Command] = ()
    told_to_end: str = ""
    """Why this agent is to end: its starter is gone, a signal came; '' while it is not."""
    tick: Callable[[], TickReport] = TickReport
    """The loop's punctuality; asked only when a status is due."""
    bad_payloads: int = 0
    refused: Callable[[float], tuple[Refusal, ...]] = lambda _: ()
    """What was refused on the mesh in the last seconds; asked only when a status is due."""


@dataclass(frozen=True, slots=True)
class Ended:
    """The agent is through."""

    outcome: Outcome
    reason: str


@dataclass(slots=True)
class Actions:
    """What one tick sends: a goal for the vehicle, the rest for the mesh. None: nothing now."""

    goal: Goal
    state: AgentState | None
    far: AgentState | None = None
    """The same, for those that do not follow this agent."""
    follow: frozenset[int] | None = None
    """The peers whose states are to be heard from now on."""
    clock: ClockNews | None = None
    status: AgentStatus | None = None
    sigma: SigmaReport | None = None
    events: tuple[Event, ...] = ()
    acks: tuple[Ack, ...] = ()
    ended: Ended | None = None


class Agent:
    """One agent of a plan, from its first tick to its end.

    Args:
        plan: the mission, the same for all agents.
        agent_id: which of its agents this is.
        now: the own clock [s].
        expect_station: it was started together with a ground station, so it does not arm before it
            hears one.
        vehicle: how the own vehicle answers a setpoint; None: as the plan's `response` says.
        keys_end_s: when its certificate ends, on the own clock; a flight outlasts it.
        speedup: of mission time; a command may be that much older, because its sender waits by the
            wall clock.
        same_clock: the agents that were started with it on the same clock.
    """

    def __init__(
        self,
        plan: Plan,
        agent_id: int,
        now: float,
        *,
        expect_station: bool = False,
        vehicle: Response | None = None,
        keys_end_s: float = math.inf,
        speedup: float = 1.0,
        same_clock: Container[int] = (),
    ) -> None:
        self._plan = plan
        self._id = agent_id
        self._hash = plan.hash()
        self._navigator = Navigator(plan.origin)
        self._peers = Peers(plan, agent_id, same_clock)
        self._context = context = FlightContext(
            plan,
            agent_id,
            Controller(plan, agent_id, vehicle or plan.response),
            Progress(plan, now),
            Reference(plan, agent_id),
            Neighbourhood(plan, agent_id),
            SlotExchange(plan, agent_id, self._peers),
        )
        reach_m = context.controller.safety_filter.reach_m
        self._hearing = None if hears_all(plan) else Hearing(plan, agent_id, reach_m)
        self._barrier = Barrier(context)
        self._command_handler = CommandHandler(plan, agent_id, self._hash, speedup)
        self._way_back = ReturnToLaunch(plan, agent_id)
        preflight = Preflight(
            plan,
            plan.agent(agent_id),
            self._hash,
            self._navigator,
            expect_station,
            vehicle or plan.response,
            keys_end_s,
        )
        self._takeover = Takeover(context, preflight)
        self._estimate = EstimateWatch(plan.policies.position_accuracy_flight_m)
        self._response = ResponseWatch(vehicle or plan.response)
        self._executor = StepExecutor(
            context,
            preflight,
            self._barrier,
            self._command_handler,
            Landing(context, self._way_back),
            self._takeover,
        )
        self._shape = context.reference.shape
        """Before the newest commanded one."""
        self._station: HeardStation | None = None
        self._notes: list[ParameterNote] = []
        self._attention = Attention()
        self._told_to_end = self._waits = ""
        self._seq = 0
        self._status_due = self._sigma_due = now
        self._refused_said = RefusalsSaid()
        self._sigma_shown = False

    # --- one tick ---

    def step(self, now: float, inbox: Inbox) -> Actions:
        """Decide one tick; call it every `plan.tick_s`."""
        context = self._context
        tick = self._take_in(now, inbox)
        self._tell_notes(now)
        acks = tuple(self._answer(tick, command) for command in inbox.commands)
        context.observe(inbox.view)
        self._barrier.measure(tick)
        self._barrier.watch_commands(tick, self._executor.override)
        if self._barrier.alone(now):
            self._drop_command(tick)
        self._hold_if_expelled()
        self._check_failsafes(tick)
        if self._pausing(tick):
            context.progress.paused_s += self._plan.tick_s
        goal = self._executor.decide(tick)
        if context.reference.doubted is not None:
            leader, words = context.reference.doubted
            self._peers.doubt(leader, Finding(Doubt.FRAME, words), now)
        going_on = context.trigger is None and context.phase is not Phase.ENDED
        if going_on:
            context.reason = context.reason or self._waiting(now)
        # no step is entered under an order that stops it
        going_on = going_on and self._command_handler.override is None
        may_go_on = going_on and context.progress.done
        if may_go_on and context.progress.advance(self._barrier.members(tick.peers), now):
            self._enter_step(now)
        actions = Actions(goal, self._state(tick, tick.fix) if tick.fix is not None else None)
        actions.acks = acks
        self._choose_near(tick, actions)
        actions.clock = self._peers.clocks.say(now)
        self._watch_neighbours(tick)
        self._publish_slow(tick, inbox, actions)
        return actions

    # --- what is heard ---

    def likely(self, word: Glimpse, received_s: float) -> bool:
        """Whether this word of a peer may follow what was believed of it."""
        return self._peers.likely(word, received_s)

    def _take_in(self, now: float, inbox: Inbox) -> Tick:
        context, peers = self._context, self._peers
        for news, received_s in inbox.clocks:
            peers.hear_clock(news, received_s)
        believed = []
        for states, far in ((inbox.states, False), (inbox.far, True)):
            for state, received_s in states:
                self._takeover.hear(state, received_s)
                if peers.hear(state, received_s, far=far):
                    believed.append((state, received_s))
        for severity, text in peers.watch(now):
            context.say(now, severity, text)
        peers.count_ages(now)
        context.slot_exchange.hear()
        context.reference.assign(context.slot_exchange.roles)
        for beacon, received_s in inbox.beacons:
            self._station = (beacon, received_s)
        self._update_gains(now, believed)
        self._told_to_end = self._told_to_end or inbox.told_to_end
        for text in inbox.view.texts:
            context.say(now, Severity.WARNING, f"vehicle: {text}")
        self._notes += inbox.view.notes
        fix = self._navigator.fix(inbox.view, now)
        if fix is not None:
            context.controller.locate(fix, now)
            unlike = self._response.look(context.controller.estimate)
            if unlike:
                context.say(now, Severity.WARNING, unlike)
        snapshot = peers.snapshot(now, inbox.view.contacts, context.controller.point_m)
        self._attention.run(now)
        return Tick(now, inbox.view, fix, snapshot, self._station, self._attention)

    def _tell_notes(self, now: float) -> None:
        """Said when a station hears it, or at the latest before the flight: an event is sent
        once."""
        context = self._context
        if self._station is None and context.phase in (Phase.CONNECT, Phase.PREPARE):
            return
        for note in self._notes:
            severity = Severity.INFO if note.found is Found.UNKNOWN else Severity.WARNING
            context.say(now, severity, f"vehicle: {note.text}")
        self._notes = []

    def _update_gains(self, now: float, states: Sequence[tuple[AgentState, float]]) -> None:
        gain_update = self._command_handler.gain_update
        for severity, text in gain_update.update(now, states):
            self._context.say(now, severity, text)
        if self._context.controller.gains is not gain_update.gains:
            self._context.controller.set_gains(gain_update.gains)

    def _answer(self, tick: Tick, command: Command) -> Ack:
        """Acknowledge a command, and do what it asks for if it is new and can be done."""
        context, handler = self._context, self._command_handler
        frame, before = context.reference.frame, handler.override
        flown = before.step if before else context.progress.current
        situation = AgentSituation(
            self._plan,
            self._id,
            context.phase,
            context.was_armed and context.phase is not Phase.ENDED,
            context.progress,
            bool(context.reference.slots),
            before,
            tick.peers,
            self._takeover.not_given_back(tick.view),
            self._barrier.held,
        )
        ack, new = handler.answer(command, situation, frame.leg if frame else 0)
        if not new:
            return ack
        if command.kind == CommandKind.FORM:
            self._shape = context.reference.shape
        context.say(tick.now, Severity.INFO, f"the operator commands: {_named(command)}")
        context.left = handler.left is not None
        self._peers.expel(handler.expelled)
        if command.kind == CommandKind.RESUME and context.phase is Phase.YIELD:
            self._takeover.take_back(tick)
        elif command.kind == CommandKind.RESUME:
            self._barrier.accept()
            self._takeover.catch_up(tick)
        elif command.kind == CommandKind.READMIT and handler.override is not before:
            self._takeover.catch_up(tick)
        if command.kind == CommandKind.NEXT:
            context.progress.finish_step(tick.now, StepOutcome.SKIPPED)
        after = handler.override
        if after is not before:
            self._executor.overridden(command.kind, flown)
            self._enter(after.step if after else None, before.leg if before else 0)
        return ack

    def _drop_command(self, tick: Tick) -> None:
        """A shape or a move is for all: one that no peer flies was not commanded to all."""
        context, handler = self._context, self._command_handler
        before = handler.override
        if before is None or not handler.drop_alone():
            return
        text = f"no other agent flies the commanded {before.kind}: going on without it"
        context.say(tick.now, Severity.WARNING, text)
        self._takeover.catch_up(tick)
        if before.kind == CommandKind.FORM:
            context.reference.form(*self._shape)
        after = handler.override
        self._enter(after.step if after else None, before.leg)

    def _hold_if_expelled(self) -> None:
        """An agent that was expelled on its way up holds as soon as it flies."""
        context, handler = self._context, self._command_handler
        if context.phase is not Phase.FLY or context.trigger is not None:
            return
        frame = context.reference.frame
        if handler.hold_expelled(frame.leg if frame else 0) and handler.override is not None:
            self._executor.overridden(CommandKind.EXPEL, context.progress.current)
            self._enter(handler.override.step, 0)

    # --- steps ---

    def _pausing(self, tick: Tick) -> bool:
        """The mission's step waits, and its time with it."""
        trigger = self._context.trigger
        held = self._barrier.waits_for(tick.now)
        paused = trigger is not None and trigger.action is FailsafeAction.HOLD
        return self._command_handler.override is not None or bool(held) or paused

    def _waiting(self, now: float) -> str:
        """Which agents the mission waits for because of a command, or ''."""
        left = self._barrier.waits_for(now)
        if not left:
            return ""
        # Whole tens, so that a status is new only now and then.
        seconds = 10 * math.ceil(min(left.values()) / 10)
        return f"waits for {agents_named(sorted(left))}, held by a command: {seconds} s at most"

    def _enter_step(self, now: float) -> None:
        progress = self._context.progress
        name = step_name(self._plan, progress.step)
        self._context.say(now, Severity.INFO, f"step {progress.step}: {name}")
        if progress.current is not None:
            self._enter(progress.current)

    def _enter(self, step: Step | None, leg: int = 0) -> None:
        """Begin a step: a mission's, a command's, or (None) the mission's again, on its `leg`."""
        context = self._context
        self._executor.begin()
        self._barrier.forget_shape()
        again = step is None
        step = context.progress.current if step is None else step
        form = step.new_shape if step is not None else None
        if form is not None and self._command_handler.override is None:
            context.begin_form(form)
        elif form is not None:
            context.reference.form(form.slots)
        else:
            context.reference.begin(leg if again else 0)

    # --- failsafes ---

    def _check_failsafes(self, tick: Tick) -> None:
        """Look for a trigger that outweighs what is being done."""
        context, fix = self._context, tick.newest_fix
        if context.ended_s is not None:
            return
        context.watch_height(tick)
        landing = context.landing_s is not None
        if context.trigger is None:
            self._waits = context.reason
        trigger = failsafes.find(
            failsafes.Situation(
                tick,
                self._plan,
                context.progress,
                had_control=context.had_control,
                was_armed=context.was_armed,
                told_to_end=self._told_to_end,
                ordered=self._command_handler.ordered,
                stop_point_m=context.controller.stop_point_m,
                height_m=context.height(fix) if fix is not None else 0.0,
                landing=landing,
                returning=context.phase is Phase.RETURN,
                # What it said on the ground was the pre-flight check's.
                estimate_doubt=(
                    self._estimate.look(tick.now, tick.view) if context.was_armed else ""
                ),
                flown=context.flown,
                departed=self._barrier.departed,
                accepted=self._barrier.accepted,
                fell=context.fell(tick.now),
                sunk_s=context.sunk_s(tick.now),
                waits=self._waits,
                leads=lambda: self._barrier.leads(tick),
            )
        )
        if failsafes.replaces(trigger, context.trigger, landing=landing):
            context.heed(tick, trigger)

    def _watch_neighbours(self, tick: Tick) -> None:
        context = self._context
        if context.progress.step == 0 or context.phase in (Phase.LAND, Phase.RETURN, Phase.ENDED):
            return  # on the way down the peers fall silent one by one, and none is followed
        neighbourhood = context.neighbourhood
        said = neighbourhood.lose(self._barrier.lost(tick.peers)) + neighbourhood.watch(tick.peers)
        for severity, text in said:
            context.say(tick.now, severity, text)

    def _choose_near(self, tick: Tick, actions: Actions) -> None:
        """In a large swarm: which peers to hear at every tick, and the own far word."""
        hearing, context = self._hearing, self._context
        if hearing is None:
            return
        own_m = context.controller.stop_point_m if tick.newest_fix is not None else None
        always = context.neighbourhood.own | context.slot_exchange.partners
        always = (always | {context.reference.pinned}) - {self._id}
        actions.follow = hearing.look(tick.now, own_m, self._peers, always)
        if actions.follow is not None:
            self._peers.follow(actions.follow, tick.now)
        if hearing.says(tick.now):
            actions.far = actions.state

    # --- what is said ---

    def _state(self, tick: Tick, fix: OwnFix) -> AgentState:
        self._seq += 1
        context, handler = self._context, self._command_handler
        gain_update, left = handler.gain_update, handler.left
        still = math.hypot(*fix.velocity_ned_mps) < _STANDS_MPS  # one that falls may say `landed`
        stands = still and tick.view.on_ground and not tick.view.armed
        return AgentState(
            self._id,
            self._seq,
            tick.now,
            self._hash,
            context.phase,
            context.progress.step,
            context.progress.done,
            context.was_armed and context.phase not in (Phase.ARM, Phase.ENDED),
            fix.position_ned_m,
            fix.velocity_ned_mps,
            context.controller.stop_point_m,
            context.controller.setpoint_mps,
            context.reference.frame,
            int(self._way_back.stage),
            self._executor.override,
            gain_update.tag,
            gain_update.decided,
            context.slot_exchange.exchange,
            context.controller.estimate.response_s,
            context.controller.estimate.doubt_s,
            left.order if left is not None else None,
            stands and context.phase is Phase.ENDED,
        )

    def _publish_slow(self, tick: Tick, inbox: Inbox, actions: Actions) -> None:
        """What is not sent every tick: the sigma report, the status, events, the end."""
        context, now = self._context, tick.now
        since = now - context.ended_s if context.ended_s is not None else -1.0
        ending = since >= (_LINGER_S if inbox.view.released else _RELEASE_AT_MOST_S)
        if now >= self._sigma_due:
            self._sigma_due = now + _SIGMA_EVERY_S
            actions.sigma = context.controller.sigma_report(now)
            if actions.sigma is None and self._sigma_shown:
                actions.sigma = SigmaReport(self._id, now, (0.0, 0.0), (0.0, 0.0), ())
            self._sigma_shown = actions.sigma is not None and bool(actions.sigma.pairs)
        if now >= self._status_due or ending:
            self._status_due = now + STATUS_EVERY_S
            refused = inbox.refused(now)
            for text in self._refused_said.due(refused, now):
                context.say(now, Severity.WARNING, text)
            actions.status = status_report(
                context,
                tick,
                formation_error_m=self._barrier.formation_error_m,
                links=self._peers.links(now),
                loop=inbox.tick(),
                bad_payloads=inbox.bad_payloads,
                refused=refused,
                doubted=self._peers.suspects(now),
                left=self._command_handler.left,
            )
        actions.events, context.events = tuple(context.events), []
        if ending:
            actions.ended = Ended(context.outcome, context.reason)


def _named(command: Command) -> str:
    """`expel 3 (station-77-a1b2c3)`."""
    about = " ".join((command.kind, ",".join(map(str, command.about)))).strip()
    return f"{about} ({command.station})" if command.station else about
