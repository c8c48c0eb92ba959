"""The group that an agent flies in now: its members, their steps and for whom they wait, their
shape with its frame, its graph and the roles in it, and whom it is flown without."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Final

from swarm_ctl.core.agent.failsafes import FailsafeTrigger, gave_up, left_by_order, progress_of
from swarm_ctl.core.agent.interruption import EventLog
from swarm_ctl.core.agent.progress import Progress
from swarm_ctl.core.agent.tick import Tick
from swarm_ctl.core.control.detour import Detour
from swarm_ctl.core.control.in_file import InFile
from swarm_ctl.core.control.reference import Reference
from swarm_ctl.core.control.target import Targets
from swarm_ctl.core.law.formation import dealt, error_of_one
from swarm_ctl.core.model.causes import FailsafeAction
from swarm_ctl.core.model.messages import AgentState, CommandKind, Phase, Severity
from swarm_ctl.core.model.plan import Plan, Point, Policy
from swarm_ctl.core.model.route import Routes
from swarm_ctl.core.model.steps.follow import BELOW_TOP_M, LOWEST_M, FollowStep
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.core.model.steps.move import MoveStep
from swarm_ctl.core.model.steps.step import Step
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.core.swarm.neighbourhood import Neighbourhood
from swarm_ctl.core.swarm.peers import Peers
from swarm_ctl.core.swarm.slot_exchange import SlotExchange
from swarm_ctl.core.swarm.snapshot import (
    Formation,
    FormationKey,
    OtherAircraft,
    PeerSnapshot,
    predicted_s,
)

_MEASURE_EVERY_S = 0.2
_LEADS_M: Final = 1.0
"""So far ahead of all others in the shape is one that they follow."""
_FLIES_MPS: Final = 0.1
"""A vehicle that is slower flies nowhere."""
_RISES_S: Final = 3.0
"""The told heights of a target are smoothed over so long: a boat goes up and down on waves."""
_RISE_STEP_M: Final = 0.5
"""The formation's height is changed by so much at least."""
_UP: Final = 1
"""The take-off's number: an agent that is launched goes on from it to the others' step."""
_GONE_S: Final = 60.0
"""An agent that was not heard for so long may have ended."""
_CLOSES_S: Final = 1.0
"""All agents know by then who is left."""
_NEAR: Final = 1.0
"""[of r_out]: one that comes back is so near to its place when it is one of them again ..."""
_STANDS_MPS: Final = 0.3
_BLOCKED_S: Final = 8.0
"""... or has stood for so long: something is in its way, and the law has ways out of that."""
ALONE_S: Final = 15.0
"""A command for all reaches all within ten seconds, or its sender gives it up."""


class Group:
    """One agent's group. `now` [s, own clock] is when the agent starts."""

    def __init__(self, plan: Plan, own_id: int, peers: Peers, now: float, log: EventLog) -> None:
        self._plan, self._own = plan, own_id
        self._policies, self._unit_m = plan.policies, plan.unit_m
        self._fence, self._tick_s = plan.fence, plan.tick_s
        self._near_m = _NEAR * plan.law.r_out * plan.unit_m
        self._peers, self._log = peers, log
        self.routes = Routes(plan)
        self.progress = Progress(self.routes.of[own_id], plan.prepare_timeout_s, now)
        self.targets = Targets(plan, own_id)
        self._set_up()
        self._set_out: Point | None = None
        """Where the frame stood when the newest step began."""
        self._measure_due = -math.inf
        self._form: FormStep | None = None
        """That the mission has formed last; None: an order has, or none has yet."""
        self._left: tuple[int, ...] = ()
        """Who is left in the shape that is flown; (): all."""
        self._fewer: tuple[tuple[int, ...], float] = (), math.inf
        """Who has been left of late, and since when."""
        self.closings: list[tuple[float, int, int]] = []
        """(since [s], how many places fewer, which of them is the own), for each time that the
        shape has closed or opened."""
        self._grounded = frozenset(agent.id for agent in plan.agents if agent.waits)
        """They stay on the ground until they are launched, and count as soon as they are up."""
        self.away = own_id in self._grounded
        """This agent was sent away, or waits on the ground, and is not back at its place yet; the
        others go on without it."""
        self._moved_s = math.inf
        """When it moved last as it joined them."""
        self._rejoined_s = math.inf
        """When it began in mid-mission [s]: it has heard nothing of what was before."""
        self._held_since: dict[int, float] = {}
        """By agent: since when it flies a command that this agent does not."""
        self._alone_since = math.inf
        self.shared = 0
        """`Command.tag` of the newest command that a peer flew beside this agent; 0: none."""
        self.departed: dict[int, str] = {}
        """The peers that have left the formation, by id, and why: by an operator's order, or
        because a command has held them for longer than the mission waits."""
        self.accepted: set[int] = set()
        """Those of them that the operator has commanded to go on without."""
        self.high = plan.wake is not None
        """Slots have heights."""
        self.heights: tuple[tuple[float, ...], bool] = (), True
        """How far above the flight height the slots of the newest shape are, and whether roles
        decide whose slot is whose."""
        self._follows: FollowStep | None = None
        """What follows a target, in this tick."""
        self._rise_m = self._rises_m = 0.0
        """After it, as wanted now and as flown."""
        self.formation_error_m: float | None = None
        """Largest |e_j - mean e| over the agents of the mission, itself included; None unless all
        of their states are fresh, or, of far peers, followed: the loss of three far words in a row
        is common among many, and must not stop the formation."""

    def _set_up(self) -> None:
        """For the group that flies the current step."""
        plan, own_id, group = self._plan, self._own, self.progress.group
        self.name, self.ids, self._first = group.name, group.ids, group.before
        self.members = frozenset(self.ids) if len(self.ids) < len(plan.agents) else None
        """None: all agents."""
        self.reference = Reference(plan, group, own_id)
        self.neighbourhood = Neighbourhood(group, own_id)
        self.slot_exchange = SlotExchange(plan, group, own_id, self._peers)
        self.targets.members = frozenset(self.ids)
        self._in_file = InFile(plan, own_id)
        self._detour = Detour(plan)
        self._formations = group.formations(plan.unit_m)
        self._planned_m = (self._formations[0].centre_m,) * 2
        """Where the step that is flown was planned to begin, and its first corner."""

    @property
    def grounded(self) -> bool:
        """This agent stays on the ground until it is launched, or has just been."""
        return self._own in self._grounded and self.progress.step <= _UP

    def all_over(self, peers: PeerSnapshot) -> bool:
        """The others that fly the mission have ended, or are not heard any more: nobody is left to
        join. Those that were sent away, or wait on the ground, do not fly it."""
        over = [
            (peer.ends and peer.state.phase is Phase.ENDED) or peer.silent_s > _GONE_S
            for peer in peers.peers
            if peer.state is not None and peer.left is not CommandKind.GOTO
            if peer.id not in self._grounded or peer.state.step > _UP
        ]
        return bool(over) and all(over)

    def mates(self, tick: Tick) -> PeerSnapshot:
        """The peers of the group as it is now: an order may have brought this agent to another one
        since the tick began."""
        if self.members is None:
            return tick.peers
        peers = tick.peers.peers
        return PeerSnapshot(tick.peers.now_s, tuple(p for p in peers if p.id in self.members))

    # --- from step to step ---

    def awaited(self, tick: Tick) -> PeerSnapshot:
        """The peers that this agent waits for after its step: at a barrier, those of other groups,
        too."""
        waits = self.routes.awaited(self._own, self.progress.step)
        if len(waits) == len(self.ids):
            return self.mates(tick)
        peers = tick.peers
        return PeerSnapshot(peers.now_s, tuple(p for p in peers.peers if p.id in waits))

    def told(self, tick: Tick, *, airborne: bool) -> dict[int, tuple[int, bool]]:
        """The progress (step, done), by id, of every peer that this agent waits for after its step.

        A silent peer holds it up, unless the mission goes on without it.
        """
        awaited = self.awaited(tick)
        lost = self.lost(awaited, airborne=airborne)
        return {peer.id: self._progress(peer) for peer in awaited.peers if peer.id not in lost}

    def _progress(self, peer: OtherAircraft) -> tuple[int, bool]:
        if peer.state is None:
            return (-1, False)
        told = progress_of(peer.state)
        completed = told >= (len(self.routes.of[peer.id].steps), True)  # silent because of that
        recent = peer.silent_s <= self._policies.agent_lost_after_s
        return told if completed or recent else (-1, False)

    def goes_on_without(
        self, late: list[int], told: Mapping[int, tuple[int, bool]], now: float
    ) -> bool:
        """Those that are late are of other groups, and the step's policy waits no longer for them;
        or one of the own group has gone on: its time was over, or it has heard them."""
        progress, step = self.progress, self.progress.current
        if (
            step is None
            or step.on_timeout is not Policy.CONTINUE
            or not set(late).isdisjoint(self.ids)
        ):
            return False
        if now <= progress.timed_out_at:
            return any(told[mate][0] > progress.step for mate in told.keys() & set(self.ids))
        text = f"{progress.name}: its time is over, goes on without {agents_named(late)}"
        self._log.say(now, Severity.WARNING, text)
        progress.run_out(now)
        return True

    def go_on(self, now: float) -> None:
        """To the next step, and with it, where the swarm splits or joins, to another group."""
        self.progress.advance(now)
        self._regroup(now)

    def _regroup(self, now: float) -> bool:
        """Where the current step is another group's: with its members."""
        group = self.progress.group
        if (group.name, group.before) == (self.name, self._first):
            return False
        taken = self.slot_exchange.taken
        self._set_up()
        self._form, self._left = None, ()
        self._follows, self._rise_m, self._rises_m = None, 0.0, 0.0
        self.heights = group.ups_m, True
        self.slot_exchange.taken = taken
        if group.formed:
            slots = [agent.start for agent in group.agents]
            self.reference.form(slots, self.slot_exchange.roles)
            self.slot_exchange.begin(slots)
        self._log.say(now, Severity.INFO, f"group {group.name} now: {agents_named(group.ids)}")
        return True

    def lost(self, peers: PeerSnapshot, *, airborne: bool) -> set[int]:
        """The peers that the mission goes on without: those that have left, and, where the policy
        `agent_lost` is `continue` and the flight has begun, those that are not heard for long or
        gave up."""
        policies = self._policies
        if policies.agent_lost is not Policy.CONTINUE or not airborne:
            return set(self.departed)
        return self.departed.keys() | {
            peer.id
            for peer in peers.peers
            if peer.state is not None
            and (
                peer.silent_s > policies.agent_lost_after_s
                or (peer.ends and gave_up(peer, self.routes.of[peer.id].steps))
            )
        }

    # --- whom a command holds, and who has left ---

    def watch_commands(
        self, tick: Tick, own_override: int, interrupted: FailsafeTrigger | None
    ) -> None:
        """Note which peers carry out a command that was not given to this agent, and which have
        left; call it every tick."""
        awaited = self.awaited(tick).peers
        self._watch_held(tick, () if own_override else awaited)
        self._watch_alone(tick, own_override)
        before, self.departed = self.departed, {}
        if self._held_since:
            pause_s = self._policies.override_pause_s
            held = self._held_since.keys() - self.waits_for(tick.now).keys()
            self.departed = {i: f"a command has held agent {i} for {pause_s:g} s" for i in held}
        strange = tick.now - self._rejoined_s > self._policies.agent_lost_after_s
        strange = strange and any(peer.followed for peer in awaited)
        for peer in awaited:
            state = peer.state
            if peer.id in self._grounded and (state is None or state.step <= _UP):
                self.departed[peer.id] = f"agent {peer.id} waits on the ground to be launched"
            elif peer.expelled:
                self.departed[peer.id] = f"agent {peer.id} was expelled by the operator"
            elif peer.left is not None and peer.state is not None:
                self.departed[peer.id] = left_by_order(peer.state)
            elif strange and state is None:  # the others may have heard it end
                words = f"agent {peer.id} was not heard since this agent started again"
                self.departed[peer.id] = words
        self.slot_exchange.departed = self.departed
        self.accepted &= self.departed.keys()
        if not self.departed:
            return
        apart = (p.id for p in self.mates(tick).peers if p.left is CommandKind.GOTO)
        self.accepted.update(apart)  # the operator, who sent them, goes on without them
        self.accepted.update(self._grounded.intersection(self.departed))
        goes_on = self._policies.left_by_order is Policy.CONTINUE
        if not goes_on or interrupted is not None:
            return
        for agent in sorted(self.departed.keys() - before.keys()):
            self._log.say(tick.now, Severity.INFO, f"goes on: {self.departed[agent]}")

    def held(self, interrupted: FailsafeTrigger | None) -> bool:
        """This agent is held until the operator's `resume`, because agents have left."""
        stopped = interrupted is not None and interrupted.action is FailsafeAction.HOLD
        by_policy = self._policies.left_by_order is Policy.HOLD
        return stopped and by_policy and bool(self.departed.keys() - self.accepted)

    def accept(self) -> None:
        """The operator commands to go on without those that have left."""
        self.accepted = set(self.departed)

    def _watch_held(self, tick: Tick, peers: Iterable[OtherAircraft]) -> None:
        """Those of `peers` that fly a command, while this agent flies none."""
        held = [p.id for p in peers if p.held and p.left is None]
        if not held and not self._held_since:
            return
        if new := [agent for agent in held if agent not in self._held_since]:
            who, pause_s = agents_named(new), self._policies.override_pause_s
            text = f"waits for {who}, which a command holds: {pause_s:g} s at most"
            self._log.say(tick.now, Severity.INFO, text)
        self._held_since = {agent: self._held_since.get(agent, tick.now) for agent in held}

    def _watch_alone(self, tick: Tick, own_override: int) -> None:
        """Peers fly the formation, and none of them the command that this agent flies."""
        if not own_override:
            self._alone_since = math.inf
            return
        flying = [p.formation[2] for p in self.mates(tick).peers if p.formation and p.left is None]
        if own_override in flying:
            self.shared = own_override
        alone = flying and own_override not in flying
        self._alone_since = min(self._alone_since, tick.now) if alone else math.inf

    def alone(self, now: float) -> bool:
        """For `ALONE_S` no peer has flown the command that this agent flies."""
        return now - self._alone_since > ALONE_S

    def waits_for(self, now: float) -> dict[int, float]:
        """The agents that a command holds, and for how long the mission still waits for each
        [s]."""
        if not self._held_since:
            return {}
        pause_s = self._policies.override_pause_s
        left = {i: pause_s - (now - since) for i, since in self._held_since.items()}
        return {i: left_s for i, left_s in left.items() if left_s > 0}

    def waiting(self, now: float) -> str:
        """Which agents the mission waits for because of a command, or ''."""
        left = self.waits_for(now)
        if not left:
            return ""
        # Whole tens, so that a status is new only now and then.
        seconds = 10 * math.ceil(min(left.values()) / 10)
        return f"waits for {agents_named(sorted(left))}, held by a command: {seconds} s at most"

    # --- the shape ---

    def key(self, override: int) -> FormationKey:
        """Of what this agent flies, `override` being the command in place of the step."""
        return (self.name, self.progress.step, override)

    def assign_roles(self) -> None:
        """As the agents tell them now."""
        if not self._left:
            self.reference.assign(self.slot_exchange.roles)

    def close_gaps(self, tick: Tick, *, airborne: bool) -> None:
        """Where the step says so, fly the shape of those that are left, once they have been the
        same for a moment; call it every tick."""
        form = self._form
        if form is None or not form.closed or not airborne:
            return
        lost = self.lost(self.mates(tick), airborne=airborne).union(self.departed)
        left = tuple(i for i in self.ids if i not in lost)
        fewer = len(self.ids) - len(left)
        left = left if 0 < fewer <= len(form.closed) else ()
        if left != self._fewer[0]:
            self._fewer = left, tick.now
        if left == self._left or tick.now - self._fewer[1] < _CLOSES_S:
            return
        self._left = left
        if not left:
            self.reference.whole()
            self.assign_roles()
            self.closings.append((tick.now, 0, -1))
            return
        roles = self.slot_exchange.roles
        found = dealt([form.slots[roles[i]] for i in left], form.closed[fewer - 1])
        places = dict(zip(left, found, strict=True))
        self.reference.deal({i: form.closed[fewer - 1][place] for i, place in places.items()})
        self.closings.append((tick.now, fewer, places.get(self._own, -1)))
        text = f"the shape closes: {form.shape} of {agents_named(left)}"
        self._log.say(tick.now, Severity.INFO, text)

    @property
    def closed(self) -> bool:
        """The shape is flown by fewer than it has slots."""
        return bool(self._left)

    def begin_form(self, step: FormStep) -> None:
        """Begin a form step of the mission: its shape by slot index, its graph, its exchanges."""
        exchange = self.slot_exchange
        self._form, self._left, self._fewer = step, (), ((), math.inf)
        self.reference.form(step.slots, exchange.roles)
        self.heights = step.ups_m, True
        if step.neighbours is not None:
            self.neighbourhood.choose(exchange.in_roles(step.neighbours))
        exchange.begin(step.slots)

    def order_form(self, step: FormStep) -> None:
        """Begin an operator's shape: each agent's own slot of it, whatever the roles."""
        self._form, self._left = None, ()
        self.reference.form(step.slots)
        self.heights = step.ups_m, False

    @property
    def up_m(self) -> float:
        """How far above the flight height the own slot is."""
        ups_m, by_role = self.heights
        if not ups_m:
            return 0.0
        return ups_m[self.slot_exchange.exchange.role if by_role else self.ids.index(self._own)]

    def rises_m(self, flies_m: float) -> float:
        """How far above the flight height `flies_m` the formation is to be, after a target that is
        flown above; in steps, slowly, and with all slots below the fence's top. The take-off points
        count as level with the origin: the heights of receivers differ by metres, and all are to be
        level."""
        step, target = self._follows, self.reference.target
        if step is None or step.above_m is None:
            self._rise_m = self._rises_m = 0.0
        elif target is not None and target.fresh and target.height_m is not None:
            ups_m = (0.0, *self.heights[0])
            top_m = self._fence.height_m - BELOW_TOP_M if self._fence is not None else math.inf
            wanted_m = min(target.height_m + step.above_m, top_m - max(ups_m))
            wanted_m = max(LOWEST_M - min(ups_m), wanted_m)
            self._rise_m += (wanted_m - flies_m - self._rise_m) * self._tick_s / _RISES_S
            if abs(self._rise_m - self._rises_m) > _RISE_STEP_M:
                self._rises_m = self._rise_m
        return self._rises_m

    def on_way(self, step: Step, zones: tuple[Zone, ...], law_tag: int, override: int) -> Step:
        """The step as it is flown with these zones in force; call it before `formation`.

        Args:
            step: the mission's, or the command's.
            zones: in force.
            law_tag: of the update that they came with.
            override: the command's tag, or 0.
        """
        reference, stands = self.reference, self._formations
        reference.law_tag = law_tag
        before = stands[min(max(self.progress.step - 1 - self._first, 0), len(stands) - 1)]
        if override and self._set_out is not None:
            before = replace(before, centre_m=self._set_out)
        self._planned_m = before.centre_m, (step.way_m or (before.centre_m,))[0]
        flown, frame = self._detour.flown(step, before, zones, reference.frame, law_tag)
        if frame is not reference.frame:
            reference.join(frame)
        reference.hemmed = self._detour.hemmed(flown, reference.frame)
        return flown

    def formation(
        self, tick: Tick, step: Step, override: int, own_m: Point, *, free: bool
    ) -> tuple[Formation, Point, Point | None]:
        """The formation of this tick, the own place's velocity in it [m/s], and on an agent that is
        pinned to its place how far it is off [m]. After a target all are: by one alone the rest of
        twenty would be drawn along too slowly to turn with it.

        Args:
            tick: what is heard.
            step: the mission's, or the command's.
            override: the command's tag, or 0.
            own_m: the own stop point.
            free: this agent may be the pinned one.
        """
        reference, key = self.reference, self.key(override)
        off, follows = None, step.follows
        self._follows = follows
        reference.target = None
        if follows is not None and not self.waits_for(tick.now):
            reference.target = self.targets.now(follows.target, tick.now)
        if step.new_shape is None:
            others = self.mates(tick).without(self.departed)
            reference.follow(others, step, key, own_m, self.formation_error_m, free=free)
            if follows is not None and tick.fix is not None:
                reference.trim(follows, complex(*tick.fix.position_ned_m[:2]))
            pinned = reference.leads or follows is not None
            off = reference.off_m(own_m) if pinned and reference.slots else None
        near, centre = self.neighbourhood.own, reference.motion.velocity
        formation = Formation(reference.slots, near, centre, key, reference.spin)
        return formation, reference.feed_forward, off

    def target_lost(self, now: float) -> str:
        """That the mission step's target was not heard for longer than it waits for it, or ''."""
        step = self.progress.current
        follows = step.follows if step is not None else None
        if follows is None:
            return ""
        lost_s = self.targets.lost_s(follows, now, self.progress.goes_on_since_s)
        if lost_s <= follows.lost_after_s:
            return ""
        return f"target {follows.target} has not been heard for {follows.lost_after_s:g} s"

    def joining(self, tick: Tick, key: FormationKey, own_m: Point) -> Point | None:
        """Where an agent that was away flies, until it is so near to its place that the law draws
        the others away by little: on its own way home it leaves them alone. None: it is there, as
        near as it gets, or nobody flies the formation."""
        lost, slots = self.lost(self.mates(tick), airborne=True), self.reference.slots
        others = [
            peer
            for peer in self.mates(tick).peers
            if peer.state is not None
            and peer.state.phase in (Phase.FLY, Phase.HOLD)
            and peer.state.left is None
            and peer.id not in lost
        ]
        if not others or not slots:
            return None
        seen = [peer for peer in others if peer.followed]
        if not seen:
            return own_m
        at = [peer.stop_point - complex(*slots[peer.id]) * self._unit_m for peer in seen]
        place = sum(at) / len(at) + complex(*slots[self._own]) * self._unit_m
        fix = tick.newest_fix
        moves = fix is None or math.hypot(*fix.velocity_ned_mps[:2]) > _STANDS_MPS
        if moves or math.isinf(self._moved_s):
            self._moved_s = tick.now
        near = abs(place - complex(*own_m)) < self._near_m
        near |= tick.now - self._moved_s > _BLOCKED_S
        together = any(peer.formation == key for peer in seen)
        return None if together and near else (place.real, place.imag)

    def join(self) -> None:
        """It is one of the formation again."""
        self.away, self._moved_s = False, math.inf

    def file_place(self, tick: Tick, step: MoveStep, own_m: Point) -> Point | None:
        """Where to fly in a move in file; None: stay. Call it after `formation`."""
        frame = self.reference.frame
        if frame is None or not self.reference.slots:
            return None
        about = frame.point_m, self.reference.slots, own_m, self.mates(tick), self.departed
        return self._in_file.place(step, self._planned_m, *about)

    def forget_shape(self) -> None:
        """Another shape is flown from now on: what was measured is the one before."""
        self._in_file.begin()
        frame = self.reference.frame
        self._set_out = frame.point_m if frame is not None else None
        self.formation_error_m = None
        self._measure_due = -math.inf

    def measure(self, tick: Tick, own_m: Point, *, airborne: bool) -> None:
        """Keep `formation_error_m` up to date; call it every tick. `own_m` is the own stop
        point."""
        if tick.now >= self._measure_due:
            self._measure_due = tick.now + _MEASURE_EVERY_S
            self.formation_error_m = self._error_m(tick, complex(*own_m), airborne=airborne)

    def _error_m(self, tick: Tick, own: complex, *, airborne: bool) -> float | None:
        shape, fix, peers = self.reference.slots, tick.fix, self.mates(tick)
        if not shape or fix is None:
            return None
        lost = self.lost(peers, airborne=airborne)
        members = [p for p in peers.peers if _counts(p) and p.id not in lost]
        expected = sum(
            not (peer.ends and gave_up(peer, self.routes.of[peer.id].steps))
            for peer in peers.peers
            if peer.id not in lost
        )
        if len(members) < expected:
            return None
        step = self.progress.current
        if step is not None and step.spins:
            # The places move against each other. Vehicles lag behind them, their stop points do
            # not.
            at = [peer.stop_point + peer.setpoint * _since(peer, tick.now) for peer in members]
        else:
            own = complex(*fix.position_ned_m[:2])
            at = [_position(p, tick.now) for p in members]
        ids = [self._own, *(peer.id for peer in members)]
        slots = [complex(shape[i][0] * self._unit_m, shape[i][1] * self._unit_m) for i in ids]
        return error_of_one([own, *at], slots)

    def leads(self, tick: Tick, own_m: Point, wish: complex = 0j) -> int | None:
        """The peer that by its own word is ahead of all others in the shape, the way that this
        vehicle flies, or wishes to fly. The law makes all follow it; a vehicle that is blown away
        leads itself."""
        fix, slots = tick.newest_fix, self.reference.slots
        velocity = wish or (complex(*fix.velocity_ned_mps[:2]) if fix is not None else 0j)
        if self._own not in slots or abs(velocity) < _FLIES_MPS:
            return None
        stops = {p.id: p.stop_point for p in self.mates(tick).peers if _counts(p) and p.id in slots}
        stops[self._own] = complex(*own_m)
        way = velocity.conjugate() / abs(velocity)
        ahead = {
            i: (way * (at - complex(*slots[i]) * self._unit_m)).real for i, at in stops.items()
        }
        first, *others = sorted(ahead, key=lambda i: ahead[i], reverse=True)
        led = others and ahead[first] - ahead[others[0]] > _LEADS_M
        return first if led and first != self._own else None

    def watch_neighbours(self, tick: Tick, *, airborne: bool) -> None:
        """Bridge the graph where an agent is lost, and say which neighbours are not heard."""
        neighbourhood = self.neighbourhood
        said = neighbourhood.lose(self.lost(self.mates(tick), airborne=airborne))
        for severity, text in said + neighbourhood.watch(self.mates(tick)):
            self._log.say(tick.now, severity, text)

    # --- in the middle ---

    def rejoin(self, now: float, step: int, flying: list[AgentState]) -> None:
        """Go on at this step, with the formation as the peers have it that are `flying`."""
        self.progress.rejoin(step, now)
        self._rejoined_s = min(self._rejoined_s, now)
        if self._regroup(now):
            self.slot_exchange.rejoin(now)
        for each in self.progress.steps[self._first : step]:
            if each.new_shape is not None:
                self.begin_form(each.new_shape)
        self.take_up(flying)

    def take_up(self, flying: list[AgentState]) -> bool:
        """The frame as the peers have it that are `flying` in the own step; whether one has one."""
        in_step = [s for s in flying if s.step == self.progress.step and s.agent in self.ids]
        if not in_step:
            return False
        leader = min(in_step, key=lambda state: state.agent)
        self._detour.join(leader.gains_tag)
        self.reference.join(leader.frame)
        return leader.frame is not None


def _since(peer: OtherAircraft, now: float) -> float:
    """For how long [s] a far peer has flown on since its word; of a near one it counts as none."""
    return min(peer.age(now), predicted_s(peer)) if peer.far else 0.0


def _counts(peer: OtherAircraft) -> bool:
    """Where it is, is known well enough to measure the formation."""
    return peer.state is not None and (peer.followed if peer.far else peer.fresh)


def _position(peer: OtherAircraft, now: float) -> complex:
    if not peer.far or peer.state is None:
        return peer.position
    north, east, _ = peer.state.velocity_ned_mps
    return peer.position + complex(north, east) * _since(peer, now)
