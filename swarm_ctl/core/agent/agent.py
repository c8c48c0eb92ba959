"""The agent: `step(now, inbox) -> actions`, and nothing else. No I/O, no clock, no randomness.

One tick hears, obeys, judges, decides, flies and says: `Agent.step` has the order. What a stage
finds out is a value that the next ones read: `Tick` (what was heard), `Intent` (what is done),
the vehicle's goal. What lasts from tick to tick has one owner each: `OwnVehicle`, `Group`,
`Interruption`, `EventLog` and the controller. Everything that is sent anywhere is in `Actions`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Generator, Sequence
from dataclasses import dataclass, replace
from typing import Final

from swarm_ctl.core.agent import failsafes
from swarm_ctl.core.agent.command_handler import AgentSituation, CommandHandler
from swarm_ctl.core.agent.group import Group
from swarm_ctl.core.agent.interruption import EventLog, Interruption
from swarm_ctl.core.agent.landing import Landing
from swarm_ctl.core.agent.own_vehicle import OwnVehicle
from swarm_ctl.core.agent.preflight import EstimateWatch, Preflight, ResponseWatch
from swarm_ctl.core.agent.return_to_launch import ReturnToLaunch
from swarm_ctl.core.agent.status_report import RefusalsSaid, status_report
from swarm_ctl.core.agent.steering import NO_FIX, Course, Intent, Steering
from swarm_ctl.core.agent.step_executor import StepExecutor
from swarm_ctl.core.agent.takeover import Takeover
from swarm_ctl.core.agent.tick import Attention, HeardStation, Tick
from swarm_ctl.core.control.controller import NO_WAY, Controller
from swarm_ctl.core.control.navigation import Navigator, OwnFix
from swarm_ctl.core.law.formation_law import FormationLaw
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
    LawNews,
    Outcome,
    Phase,
    Refusal,
    Severity,
    SigmaReport,
    StationBeacon,
    StepOutcome,
    TargetWord,
    TickReport,
)
from swarm_ctl.core.model.plan import Plan, Response
from swarm_ctl.core.model.steps.follow import FollowStep
from swarm_ctl.core.model.steps.step import Step
from swarm_ctl.core.model.vehicle import Found, Goal, ParameterNote, VehicleView
from swarm_ctl.core.safety.surroundings import FENCE_NAME
from swarm_ctl.core.swarm.hearing import Hearing, hears_all
from swarm_ctl.core.swarm.peers import Peers
from swarm_ctl.core.swarm.plausibility import Doubt, Suspicion
from swarm_ctl.core.swarm.snapshot import PeerSnapshot

_STANDS_MPS = 0.5
STATUS_EVERY_S: Final = 0.5
_SIGMA_EVERY_S = 0.2
_HINDRANCE_S = 30.0
"""A step that times out names what kept the vehicle from its place so long ago."""
_LINGER_S = 2.0
"""After the end an agent goes on saying so, and gives the vehicle its parameters back."""
_GO_ON: Final = (CommandKind.READMIT, CommandKind.NEXT)
"""They end a command, as `resume` does."""
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
    laws: Sequence[LawNews] = ()
    targets: Sequence[tuple[TargetWord, float]] = ()
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
    law: LawNews | None = None
    targets: tuple[TargetWord, ...] = ()
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
        own_law: the law that the plan pins in place of the paper's (`law_loader.py`).
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
        own_law: FormationLaw | None = None,
    ) -> None:
        response = vehicle or plan.response
        self._plan, self._id = plan, agent_id
        self._hash = plan.hash()
        # what lasts from tick to tick
        self._log = log = EventLog(agent_id)
        self._vehicle = own = OwnVehicle()
        self._peers = Peers(plan, agent_id, same_clock)
        self._group = Group(plan, agent_id, self._peers, now, log)
        self._interruption = Interruption(own, self._group.progress, log)
        self._controller = Controller(plan, agent_id, response, own_law)
        self._attention = Attention()
        self._station: HeardStation | None = None
        self._notes: list[ParameterNote] = []
        self._told_to_end = ""
        self._phase, self._reason, self._waits = Phase.CONNECT, "", ""
        self._hindrance = "", -math.inf
        """What kept the vehicle from its place last, and when."""
        self._no_way = 0, ""
        """The step in which it was said last that there is no way, and how."""
        self._inside = ""
        """The zone that the vehicle is in."""
        self._sightings = tuple[TargetWord, ...]()
        """What this agent itself hears of targets in this tick."""
        self._shape = self._group.reference.shape
        """Before the newest commanded one; so the next."""
        self._heights = self._group.heights
        # what hears and judges
        self._navigator = Navigator(plan.origin)
        reach_m = self._controller.safety_filter.reach_m
        self._hearing = None if hears_all(plan) else Hearing(plan, agent_id, reach_m)
        self._command_handler = CommandHandler(plan, agent_id, self._hash, speedup)
        self._estimate = EstimateWatch(plan.policies.position_accuracy_flight_m)
        self._response = ResponseWatch(response)
        # what decides, flies and says
        preflight = Preflight(
            plan=plan,
            own=plan.agent(agent_id),
            plan_hash=self._hash,
            navigator=self._navigator,
            expect_station=expect_station,
            response=response,
            keys_end_s=keys_end_s,
        )
        self._steering = Steering(self._controller, own, plan.limits)
        self._way_back = ReturnToLaunch(plan, agent_id)
        flight = own, self._group, self._interruption, log
        self._takeover = Takeover(agent_id, *flight, preflight)
        self._executor = StepExecutor(
            *flight,
            preflight,
            self._command_handler,
            Landing(plan, *flight, self._controller, self._way_back),
            self._takeover,
            self._steering.setpoints,
        )
        self._seq = 0
        self._status_due = self._sigma_due = now
        self._refused_said = RefusalsSaid()
        self._sigma_shown = False

    def step(self, now: float, inbox: Inbox) -> Actions:
        """Decide one tick; call it every `plan.tick_s`."""
        return ended(self.stages(now, inbox))

    def stages(self, now: float, inbox: Inbox) -> Generator[None, None, Actions]:
        """`step`, with a halt after each part: agents of one process may tick side by side, and do
        so in four fifths of the time, because a part's code is at hand then."""
        tick = yield from self._hear(now, inbox)
        yield
        acks = tuple([self._obey(tick, command) for command in inbox.commands])
        self._judge(tick)
        yield
        decision = self._decide(tick)
        yield
        goal = self._steering.fly(tick, decision.course)
        yield
        self._go_on(tick)
        return self._say(tick, inbox, goal, acks)

    def flown_otherwise(self) -> None:
        """Another velocity is sent than that of this tick's goal: from how the vehicle flies now
        nothing is learnt."""
        self._controller.estimate.restart()

    # --- hear: what came in becomes one tick's facts ---

    def likely(self, word: Glimpse, received_s: float) -> bool:
        """Whether this word of a peer may follow what was believed of it."""
        return self._peers.likely(word, received_s)

    def _hear(self, now: float, inbox: Inbox) -> Generator[None, None, Tick]:
        log, peers, group, view = self._log, self._peers, self._group, inbox.view
        if stop_s := self._attention.run(now):
            peers.sleep(stop_s, now)
        for news, received_s in inbox.clocks:
            peers.hear_clock(news, received_s)
        believed = []
        for states, far in ((inbox.states, False), (inbox.far, True)):
            for state, received_s in states:
                self._takeover.hear(state, received_s)
                if peers.hear(state, received_s, far=far):
                    believed.append((state, received_s))
        yield
        for severity, text in peers.watch(now):
            log.say(now, severity, text)
        peers.count_ages(now)
        group.slot_exchange.hear()
        group.assign_roles()
        for beacon, received_s in inbox.beacons:
            self._station = (beacon, received_s)
        self._update_gains(now, believed)
        self._told_to_end = self._told_to_end or inbox.told_to_end
        for text in view.texts:
            log.say(now, Severity.WARNING, f"vehicle: {text}")
        self._notes += view.notes
        yield
        fix = self._navigator.fix(view, now)
        if fix is not None:
            self._controller.locate(fix, now)
            unlike = self._response.look(self._controller.estimate)
            if unlike:
                log.say(now, Severity.WARNING, unlike)
        yield
        snapshot = peers.snapshot(now, view.contacts, self._controller.point_m)
        for law in inbox.laws:
            self._fly_law(now, self._command_handler.gain_update.take_up(law, snapshot))
        snapshot = self._hear_targets(now, inbox, snapshot)
        self._tell_notes(now)
        heard = self._station, self._attention, self._phase
        return Tick(now, view, fix, snapshot, *heard)

    def _hear_targets(self, now: float, inbox: Inbox, snapshot: PeerSnapshot) -> PeerSnapshot:
        """The other aircraft, with the targets that are at the own height."""
        targets, group = self._group.targets, self._group
        if not targets:
            return snapshot
        for word, received_s in inbox.targets:
            targets.hear(word, received_s)
        step = self._flown_step()
        leads = group.reference.leads and self._phase is Phase.FLY
        began_s = group.progress.started_s if leads else None
        contacts = inbox.view.contacts
        self._sightings = tuple(targets.sight(now, contacts, snapshot, step, began_s))
        down_m = self._controller.down_m
        follows = step if self._phase is Phase.FLY else None
        for severity, text in targets.say(now, follows, self._controller.zones, -down_m):
            self._log.say(now, severity, text)
        strangers = targets.aircraft(now, down_m)
        return replace(snapshot, traffic=(*snapshot.traffic, *strangers))

    def _flown_step(self) -> FollowStep | None:
        """What follows a target now: the command's step, else the mission's."""
        override = self._command_handler.override
        step = override.step if override is not None else self._group.progress.current
        return step.follows if step is not None else None

    def _tell_notes(self, now: float) -> None:
        """Said when a station hears it, or at the latest before the flight: an event is sent
        once."""
        if self._station is None and self._phase in (Phase.CONNECT, Phase.PREPARE):
            return
        for note in self._notes:
            severity = Severity.INFO if note.found is Found.UNKNOWN else Severity.WARNING
            self._log.say(now, severity, f"vehicle: {note.text}")
        self._notes = []

    def _update_gains(self, now: float, states: Sequence[tuple[AgentState, float]]) -> None:
        self._fly_law(now, self._command_handler.gain_update.update(now, states))

    def _fly_law(self, now: float, said: Sequence[tuple[Severity, str]]) -> None:
        gain_update = self._command_handler.gain_update
        for severity, text in said:
            self._log.say(now, severity, text)
        if self._controller.gains is not gain_update.gains:
            self._controller.set_gains(gain_update.gains)
        zones = gain_update.zones_in_force
        if self._controller.zones is not zones:
            self._controller.set_zones(zones)

    # --- obey: the operator's commands ---

    def _obey(self, tick: Tick, command: Command) -> Ack:
        """Acknowledge a command, and do what it asks for if it is new and can be done."""
        handler, group = self._command_handler, self._group
        frame, before = group.reference.frame, handler.override
        joins, step = False, group.progress.step
        flown = before.step if before else group.progress.current
        trigger = self._interruption.trigger
        situation = AgentSituation(
            plan=self._plan,
            group=group.name,
            members=group.ids,
            agent=self._id,
            phase=self._phase,
            airborne=self._vehicle.was_armed and self._phase is not Phase.ENDED,
            progress=group.progress,
            formed=bool(group.reference.slots),
            override=before,
            peers=tick.peers,
            not_given_back=self._takeover.not_given_back(tick.view),
            held=group.held(trigger),
            lands=trigger is not None and trigger.action is FailsafeAction.LAND,
        )
        ack, new = handler.answer(command, situation, frame.leg if frame else 0)
        if not new:
            return ack
        if command.kind == CommandKind.FORM:
            self._shape, self._heights = group.reference.shape, group.heights
        self._log.say(tick.now, Severity.INFO, f"the operator commands: {_named(command)}")
        self._peers.expel(handler.expelled, tick.now)
        if command.kind == CommandKind.RESUME and self._phase is Phase.YIELD:
            self._takeover.take_back(tick)
        elif command.kind == CommandKind.RESUME:
            group.accept()
            joins = self._takeover.catch_up(tick, handler.tag)
        elif command.kind in _GO_ON and handler.override is not before:
            joins = self._takeover.catch_up(tick, handler.tag)
        elif group.away and handler.override is not before:
            joins = self._takeover.take_up(tick, handler.tag)
        group.away |= handler.sent_to is not None
        if command.kind == CommandKind.NEXT and group.progress.step == step:
            group.progress.finish_step(tick.now, StepOutcome.SKIPPED)
        after = handler.override
        if after is not before:
            self._executor.overridden(command.kind, flown)
            leg = before.leg if before else 0
            self._enter(after.step if after else None, None if joins else leg)
        return ack

    def _drop_command(self, tick: Tick) -> None:
        """A shape or a move is for all: one that no peer flies was not commanded to all, or the
        others have resumed the mission in that shape."""
        handler = self._command_handler
        before, shared = handler.override, self._group.shared == handler.tag
        if before is None or not handler.drop_alone():
            return
        text = f"no other agent flies the commanded {before.kind}: going on without it"
        self._log.say(tick.now, Severity.WARNING, text)
        if before.kind == CommandKind.FORM and not shared:
            self._group.reference.form(*self._shape)
            self._group.heights = self._heights
        joins = self._takeover.catch_up(tick, handler.tag)
        after = handler.override
        self._enter(after.step if after else None, None if joins else before.leg)

    def _hold_if_expelled(self) -> None:
        """An agent that was expelled on its way up holds as soon as it flies."""
        handler, group = self._command_handler, self._group
        if self._phase is not Phase.FLY or self._interruption.trigger is not None:
            return
        frame = group.reference.frame
        if handler.hold_expelled(frame.leg if frame else 0) and handler.override is not None:
            self._executor.overridden(CommandKind.EXPEL, group.progress.current)
            self._enter(handler.override.step, 0)

    def _come_along(self, tick: Tick) -> None:
        """An agent that was sent away comes along when the others go down, and goes on alone when
        none of them flies any more: nobody would call it back. One on its way back keeps to the
        step of the others."""
        handler = self._command_handler
        joins = self._group.away and self._phase is Phase.FLY and handler.override is None
        if joins and self._takeover.behind(tick):
            self._takeover.catch_up(tick)
            self._enter(None, None)
        if handler.sent_to is None:
            return
        ends = self._takeover.swarm_goes_down(tick)
        if not ends and self._group.all_over(tick.peers):
            ends = "no other agent flies the mission any more"
        if ends:
            self._log.say(tick.now, Severity.INFO, f"comes along: {ends}")
            handler.come_back()
            self._takeover.catch_up(tick)
            self._enter(None, None)

    # --- judge: the group, and whether a failsafe fires ---

    def _judge(self, tick: Tick) -> None:
        own, group, interruption = self._vehicle, self._group, self._interruption
        own.observe(tick)
        group.measure(tick, self._controller.stop_point_m, airborne=own.was_armed)
        group.watch_commands(tick, self._command_handler.tag, interruption.trigger)
        if self._command_handler.sent_to is None:
            group.close_gaps(tick, airborne=own.was_armed)
        if group.alone(tick.now):
            self._drop_command(tick)
        self._hold_if_expelled()
        self._come_along(tick)
        if own.ended_s is None:
            own.watch_height(tick)
            trigger = failsafes.find(self._situation(tick))
            landing = own.landing_s is not None
            stops = failsafes.replaces(trigger, interruption.trigger, landing=landing)
            if stops or interruption.holds:
                interruption.heed(tick, trigger)
        if self._pausing(tick):
            group.progress.hold_up(tick.now, self._plan.tick_s)

    def _situation(self, tick: Tick) -> failsafes.Situation:
        """The facts that the failsafes judge."""
        own, group, fix = self._vehicle, self._group, tick.newest_fix
        stop_point_m = self._controller.stop_point_m
        return failsafes.Situation(
            tick,
            self._plan,
            group.progress,
            had_control=own.had_control,
            was_armed=own.was_armed,
            told_to_end=self._told_to_end,
            ordered=self._command_handler.ordered,
            stop_point_m=stop_point_m,
            height_m=own.height(fix) if fix is not None else 0.0,
            landing=own.landing_s is not None,
            returning=self._phase is Phase.RETURN,
            # What it said on the ground was the pre-flight check's.
            estimate_doubt=self._estimate.look(tick.now, tick.view) if own.was_armed else "",
            flown=own.flown,
            departed=group.departed,
            accepted=group.accepted,
            grounded=group.grounded,
            routes=group.routes,
            awaited=group.awaited(tick),
            waits_until=group.routes.awaited(self._id, group.progress.step),
            fell=own.fell(tick.now),
            sunk_s=own.sunk_s(tick.now),
            found=own.strange(tick.now) or self._takeover.pending(tick.view),
            waits=self._waits_for(tick.now),
            target_lost=lambda: group.target_lost(tick.now),
            leads=lambda: group.leads(tick, stop_point_m),
        )

    @property
    def _waits_on_ground(self) -> bool:
        """It has not been launched yet."""
        return self._group.grounded and not self._command_handler.launched

    def _pausing(self, tick: Tick) -> bool:
        """The mission's step waits, and its time with it."""
        held = self._command_handler.override is not None or self._interruption.holds
        return held or self._waits_on_ground or bool(self._group.waits_for(tick.now))

    # --- decide, and go on to the next step ---

    def _decide(self, tick: Tick) -> Intent:
        """What is done in this tick: the agent's phase from now on, and its reason."""
        stopped = self._interruption.reason
        decision = self._executor.decide(tick, self._controller.stop_point_m)
        reason = stopped if decision.reason is None else decision.reason
        blind = tick.fix is None and isinstance(decision.course, Course)
        self._phase, self._reason = decision.phase, reason or (NO_FIX if blind else "")
        inside = self._controller.safety_filter.inside
        if inside and inside != self._inside:
            self._log.say(tick.now, Severity.WARNING, f"is in {inside}, and leaves it")
        self._inside = inside
        returns = decision.phase is Phase.RETURN
        if returns or (decision.phase is Phase.FLY and not self._reason):
            self._note_hindrance(tick, also=returns)
        if self._interruption.trigger is None:
            self._waits = self._reason
        return decision

    def _note_hindrance(self, tick: Tick, *, also: bool) -> None:
        """What keeps the vehicle from its place is the reason, `also` behind another one; that
        there is no way is said at once."""
        found = self._hindered(tick)
        said = self._group.progress.step, found
        if found.startswith(NO_WAY) and self._no_way != said:
            self._no_way = said
            self._log.say(tick.now, Severity.WARNING, found)
        if found:
            self._hindrance = found, tick.now
            self._reason = f"{self._reason}; {found}" if also and self._reason else found

    def _waits_for(self, now: float) -> str:
        """Why it waits, or what kept it from its place a moment ago; ''."""
        found, last_s = self._hindrance
        recent = last_s > max(self._group.progress.started_s, now - _HINDRANCE_S)
        return self._waits or (found if recent else "")

    def _hindered(self, tick: Tick) -> str:
        """What keeps the vehicle from its place: a zone, or the fence, and who has led it there."""
        found = self._controller.hindered
        if not found.endswith(FENCE_NAME):
            return found
        wish = self._controller.safety_filter.wish
        leads = self._group.leads(tick, self._controller.stop_point_m, wish)
        return (
            found
            if leads is None
            else f"{found}, drawn there by the place that agent {leads} tells"
        )

    def _go_on(self, tick: Tick) -> None:
        """Enter the next step, if all members are done with this one and no order stops it."""
        now, group = tick.now, self._group
        if group.reference.doubted is not None:
            leader, words = group.reference.doubted
            self._peers.doubt(leader, Suspicion(Doubt.FRAME, words), now)
        if self._interruption.trigger is not None or self._phase is Phase.ENDED:
            return
        self._reason = self._reason or group.waiting(now)
        progress = group.progress
        if self._command_handler.override is not None or not progress.done or progress.finished:
            return
        if group.grounded and progress.step and self._takeover.catch_up(tick):
            self._enter(None, None)
            return
        told = group.told(tick, airborne=self._vehicle.was_armed)
        late = group.routes.late(self._id, progress.step, told)
        if not late or group.goes_on_without(late, told, now):
            group.go_on(now)
            self._enter_step(now)

    def _enter_step(self, now: float) -> None:
        progress = self._group.progress
        self._log.say(now, Severity.INFO, f"step {progress.step}: {progress.name}")
        if progress.current is not None:
            self._enter(progress.current)

    def _enter(self, step: Step | None, leg: int | None = 0) -> None:
        """Begin a step: a mission's, a command's, or (None) the mission's again, on its `leg`;
        None: on that of the others, whose frame it has."""
        group = self._group
        self._executor.begin()
        group.forget_shape()
        again = step is None
        step = group.progress.current if step is None else step
        form = step.new_shape if step is not None else None
        if form is not None and self._command_handler.override is None:
            group.begin_form(form)
        elif form is not None:
            group.order_form(form)
        else:
            group.reference.begin(leg if again else 0)

    # --- say ---

    def _say(self, tick: Tick, inbox: Inbox, goal: Goal, acks: tuple[Ack, ...]) -> Actions:
        actions = Actions(goal, self._state(tick, tick.fix) if tick.fix is not None else None)
        actions.acks = acks
        self._choose_near(tick, actions)
        actions.clock = self._peers.clocks.say(tick.now)
        actions.targets = self._sightings
        actions.law = self._command_handler.gain_update.tell(tick.peers)
        # on the way down the peers fall silent one by one, and none is followed
        down = self._phase in (Phase.LAND, Phase.RETURN, Phase.ENDED)
        if self._group.progress.step > 0 and not down:
            self._group.watch_neighbours(tick, airborne=self._vehicle.was_armed)
        self._report(tick, inbox, actions)
        return actions

    def _choose_near(self, tick: Tick, actions: Actions) -> None:
        """In a large swarm: which peers to hear at every tick, and the own far word."""
        hearing, group = self._hearing, self._group
        if hearing is None:
            return
        own_m = self._controller.stop_point_m if tick.newest_fix is not None else None
        always = group.neighbourhood.own | group.slot_exchange.partners
        always = (always | {group.reference.pinned}) - {self._id}
        actions.follow = hearing.look(tick.now, own_m, self._peers, always)
        if actions.follow is not None:
            self._peers.follow(actions.follow, tick.now)
        if hearing.says(tick.now):
            actions.far = actions.state

    def _state(self, tick: Tick, fix: OwnFix) -> AgentState:
        self._seq += 1
        group, handler, controller = self._group, self._command_handler, self._controller
        gain_update, left = handler.gain_update, handler.left
        still = math.hypot(*fix.velocity_ned_mps) < _STANDS_MPS  # one that falls may say `landed`
        stands = still and tick.view.on_ground and not tick.view.armed
        return AgentState(
            agent=self._id,
            seq=self._seq,
            time_s=tick.now,
            plan_hash=self._hash,
            phase=self._phase,
            step=group.progress.step,
            done=group.progress.done,
            airborne=self._vehicle.was_armed and self._phase not in (Phase.ARM, Phase.ENDED),
            position_ned_m=fix.position_ned_m,
            velocity_ned_mps=fix.velocity_ned_mps,
            stop_point_m=controller.stop_point_m,
            setpoint_mps=controller.setpoint_mps,
            frame=group.reference.frame,
            stage=int(self._way_back.stage),
            override=handler.tag,
            gains_tag=gain_update.tag,
            next_gains_tag=gain_update.decided,
            exchange=group.slot_exchange.exchange,
            response_s=controller.estimate.response_s,
            doubt_s=controller.estimate.doubt_s,
            left=left.order if left else CommandKind.GOTO if group.away else None,
            down=stands and (self._phase is Phase.ENDED or self._waits_on_ground),
            goal_height_m=self._steering.goal_height_m if self._plan.wake is not None else None,
        )

    def _report(self, tick: Tick, inbox: Inbox, actions: Actions) -> None:
        """What is not sent every tick: the sigma report, the status, events, the end."""
        now, ended_s, controller = tick.now, self._vehicle.ended_s, self._controller
        lingers_s = _LINGER_S if inbox.view.released else _RELEASE_AT_MOST_S
        ending = ended_s is not None and now - ended_s >= lingers_s
        if now >= self._sigma_due:
            self._sigma_due = now + _SIGMA_EVERY_S
            actions.sigma = controller.sigma_report(now)
            if actions.sigma is None and self._sigma_shown:
                actions.sigma = SigmaReport(self._id, now, (0.0, 0.0), (0.0, 0.0), ())
            self._sigma_shown = actions.sigma is not None and bool(actions.sigma.pairs)
        if ending or now >= self._status_due:
            self._status_due = now + STATUS_EVERY_S
            refused = inbox.refused(now)
            for text in self._refused_said.due(refused, now):
                self._log.say(now, Severity.WARNING, text)
            actions.status = status_report(
                tick,
                self._id,
                self._phase,
                self._reason,
                self._vehicle,
                self._group,
                self._interruption,
                controller,
                self._steering.setpoints,
                links=self._peers.links(now),
                loop=inbox.tick(),
                bad_payloads=inbox.bad_payloads,
                refused=refused,
                doubted=self._peers.suspects(now),
                left=self._command_handler.left,
            )
        actions.events = self._log.take()
        if ending:
            actions.ended = Ended(self._interruption.outcome, self._reason)


def ended(stages: Generator[None, None, Actions]) -> Actions:
    """What comes of them, without a halt."""
    while True:
        try:
            next(stages)
        except StopIteration as end:
            actions: Actions = end.value
            return actions


def _named(command: Command) -> str:
    """`expel 3 (station-77-a1b2c3)`."""
    about = " ".join((command.kind, ",".join(map(str, command.about)))).strip()
    return f"{about} ({command.station})" if command.station else about
