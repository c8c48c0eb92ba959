"""What an agent has heard of its peers, and the snapshot of it that each tick works with."""

from __future__ import annotations

import math
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

from swarm_ctl.core.model.histogram import Histogram
from swarm_ctl.core.model.messages import (
    AgentState,
    ClockNews,
    Glimpse,
    LinkReport,
    Phase,
    Severity,
)
from swarm_ctl.core.model.plan import Plan, Point
from swarm_ctl.core.model.route import Routes
from swarm_ctl.core.model.timeouts import FAR_EVERY_S, FAR_LATE_S, FRESH_S, NEIGHBOUR_S
from swarm_ctl.core.model.vehicle import Contact
from swarm_ctl.core.swarm.clocks import Clocks, PeerClock
from swarm_ctl.core.swarm.hearing import hears_all
from swarm_ctl.core.swarm.plausibility import (
    CLOCK_S,
    HEIGHT_JUMP_M,
    INSISTS_S,
    JUMP_M,
    LASTS_S,
    NO_JUMPS,
    SUSPECT_S,
    BeliefLimits,
    Creep,
    Doubt,
    HeightJumps,
    Jumps,
    Suspicion,
)
from swarm_ctl.core.swarm.snapshot import TRAFFIC, OtherAircraft, PeerSnapshot
from swarm_ctl.core.swarm.traffic import Traffic, Vacated

_CLEAR: Final = "both places where it may be are kept clear"
_EXPEL: Final = "others make all the way for it; `expel` ends that they follow it"


class Peers:
    """All other agents of the plan, in the plan's order. `same_clock`: those on the own clock."""

    def __init__(self, plan: Plan, own_id: int, same_clock: Container[int] = ()) -> None:
        others = (agent.id for agent in plan.agents if agent.id != own_id)
        self.clocks = Clocks(own_id, others, same_clock)
        limits = BeliefLimits.of(plan)
        near_s, routes = -math.inf if hears_all(plan) else math.inf, Routes(plan)
        self._by_id = {
            agent: Peer(agent, clock, limits, routes.of[agent].names, near_s=near_s)
            for agent, clock in self.clocks.of.items()
        }
        self._near = list(self) if hears_all(plan) else []
        self._traffic, self._vacated = Traffic(plan), Vacated(plan)
        self._suspects: dict[int, Doubt] = {}
        self._off_since: dict[int, float] = {}

    def __iter__(self) -> Iterator[Peer]:
        return iter(self._by_id.values())

    def hear(self, state: AgentState, received_s: float, *, far: bool = False) -> bool:
        """Take a state (`far`: a far word) in, if it is believed; one of an agent that the plan
        does not have is not."""
        peer = self._by_id.get(state.agent)
        if peer is None:
            return False
        return peer.hear(peer.limits.in_plan.own_mission(state), received_s, far=far)

    def likely(self, word: Glimpse, received_s: float) -> bool:
        """Whether this word of a peer may follow what was believed of it."""
        peer = self._by_id.get(word.agent)
        return peer is not None and peer.likely(word, received_s)

    def follow(self, near: Container[int], now: float) -> None:
        """These peers are near, and all others far."""
        for peer in self:
            peer.approach(now, near=peer.id in near)
        self._near = [peer for peer in self if peer.id in near]

    def links(self, now: float) -> dict[int, LinkReport]:
        """The mesh links from the near peers."""
        return {peer.id: peer.report(now) for peer in self._near}

    def hear_clock(self, news: ClockNews, received_s: float) -> None:
        """Take in what a peer says of its clock."""
        peer = self._by_id.get(news.agent)
        if peer is not None and not peer.expelled:
            peer.clock.stepped_s = 0.0
            self.clocks.hear(news, received_s)
            if peer.clock.stepped_s > CLOCK_S:
                peer.doubt(
                    Suspicion(Doubt.CLOCK, f"its clock word steps by {peer.clock.stepped_s:.3g} s"),
                    received_s,
                )

    def doubt(self, agent: int, finding: Suspicion, now: float) -> None:
        """A word of this peer is not believed, as another part of the agent found."""
        self._by_id[agent].doubt(finding, now)

    def expel(self, agents: Container[int], now: float) -> None:
        """Listen to these peers no more, and to all others."""
        for peer in self:
            peer.expel(now, out=peer.id in agents)

    def sleep(self, stop_s: float, now: float) -> None:
        """The agent itself was stopped for `stop_s` [s] before `now`."""
        for peer in self:
            peer.sleep(stop_s, now)

    def suspects(self, now: float) -> dict[int, str]:
        """The peers of which a word was not believed of late, and why."""
        return {p.id: p.found.words for p in self if p.found is not None and p.suspect(now)}

    def watch(self, now: float) -> list[tuple[Severity, str]]:
        """Peers that are no longer believed, or again: said once each."""
        said = []
        for peer in self:
            if peer.found is None:
                continue  # it was always believed
            before = self._suspects.get(peer.id)
            if peer.suspect(now):
                if peer.found.doubt is not before:
                    self._suspects[peer.id] = peer.found.doubt
                    then = _EXPEL if peer.found.doubt is Doubt.CREEP else _CLEAR
                    words = f"agent {peer.id} is not believed: {peer.found.words}; {then}"
                    said.append((Severity.WARNING, words))
            elif before is not None:
                del self._suspects[peer.id]
                said.append((Severity.INFO, f"agent {peer.id} is believed again"))
        return said

    def age(self, agent: int, now: float) -> float:
        """Age of the newest state of `agent` [s]."""
        return self._by_id[agent].age(now)

    def late_s(self, agent: int, now: float) -> float:
        """By how much [s] the words of `agent` may be older than states are."""
        return self._by_id[agent].late_s(now)

    def state(self, agent: int) -> AgentState | None:
        """The newest state of `agent`."""
        return self._by_id[agent].state

    def count_ages(self, now: float) -> None:
        """Sample the age of every near peer that is listened to and has not ended; call it once a
        tick."""
        for peer in self._near:
            state, known = peer.state, peer.clock.known and not peer.expelled
            if state is not None and state.phase is not Phase.ENDED and known:
                peer.ages.add(now - peer.true_s)

    def snapshot(
        self, now: float, contacts: Sequence[Contact] = (), own_m: Point = (0.0, 0.0)
    ) -> PeerSnapshot:
        """The other aircraft now; `own_m` decides which contacts are the nearest ones."""
        # few calls: a large swarm has a hundred, and most of them are far
        peers = self._vacated.at_rest(
            tuple([p.seen if now < p.seen_until_s else p.view(now) for p in self._by_id.values()])
        )
        traffic = self._traffic.unexplained(now, contacts, peers, own_m)
        self._vacated.look(now, contacts, peers, sees=bool(self._traffic.seen))
        self._compare(now)
        # one that the sensor sees where it was believed to be is not elsewhere
        seen = self._traffic.seen
        elsewhere = [
            at
            for p in self._by_id.values()
            if p.other is not None and p.id not in seen and (at := p.elsewhere(now)) is not None
        ]
        return PeerSnapshot(now, peers, (*traffic, *elsewhere))

    def _compare(self, now: float) -> None:
        """Doubt the peers that the traffic sensor has seen stop elsewhere for a while."""
        off_m = self._traffic.off
        if not off_m and not self._off_since:
            return
        self._off_since = {i: self._off_since.get(i, now) for i in off_m}
        for i, since_s in self._off_since.items():
            if now - since_s >= LASTS_S:
                words = f"the traffic sensor sees it stop {off_m[i]:.1f} m from where it says"
                self._by_id[i].doubt(Suspicion(Doubt.SENSOR, words), now)


_AGE_BIN_S = 0.01
_YIELDING = frozenset({Phase.FLY, Phase.HOLD, Phase.RETURN})
"""A peer in these phases flies by setpoints, so it keeps apart itself."""
_ENDS = {Phase.YIELD: 1, Phase.LAND: 2, Phase.ENDED: 2, Phase.RETURN: 2}
"""Phases that say that a part is over; those of one number follow each other."""
_SENDERS_S = 5.0
"""A process that starts again counts its states from 1, once. Twice in this time is two senders."""
_STARTED = 40
"""A process that has just started, and of which a second was lost, counts less."""
_TURNS_S = 0.05
"""A clock that drifts faster than clocks do contradicts what is known of it by less."""
_OVERDUE_S = 0.1
"""A far peer that is silent, or whose word has yet to last, is looked at so often."""
_UNSEEN = OtherAircraft(TRAFFIC)
"""Of a peer that was not looked at yet: `seen_until_s` is over, so no snapshot reads it."""
_TWO = Suspicion(Doubt.SENDERS, "two senders speak as it")


@dataclass(slots=True)
class _Other:
    """The newest state that was not believed."""

    state: AgentState
    received_s: float
    since_s: float
    """Since when such states make sense one after the other."""
    jumps: Jumps = NO_JUMPS


@dataclass(slots=True)
class Peer:
    """One peer as this agent hears it: its newest state, how old that is, what was lost, and what
    was not believed.

    A state that cannot be true after the one before (`core/swarm/plausibility.py`) is not taken in.
    The peer's vehicle may be at either place: where the last state that was believed puts it, or
    where the other one does. So both are kept clear of, for `SUSPECT_S`, and the peer is not
    counted on to keep apart itself. A peer that says the same on and on is believed after
    `INSISTS_S`, unless the states that were believed go on too. `limits`: of what is believed.
    """

    id: int
    clock: PeerClock
    limits: BeliefLimits
    groups: tuple[str, ...] = ()
    """The own one, if it is a member."""
    state: AgentState | None = None
    """The newest one that is believed."""
    received_s: float = -math.inf
    received: int = 0
    lost: int = 0
    ages: Histogram = field(default_factory=lambda: Histogram(_AGE_BIN_S))
    true_s: float = math.inf
    """When the state was true, on the own clock, by the best guess."""
    earliest_s: float = math.inf
    """The same, at the earliest."""
    found: Suspicion | None = None
    """Why its word was not believed last."""
    expelled: bool = False
    """The operator has ordered not to listen to it."""
    listened_s: float = -math.inf
    """Since when it is listened to again; later by each stop of the agent itself since its newest
    state."""
    near_s: float = -math.inf
    """Since when it is near (`core/swarm/hearing.py`); inf: it is far."""
    rare: bool = False
    """Its newest state was a far word."""
    _counted: int | None = None
    """`seq` of its newest state, far words left out, since it is near and listened to."""
    seen: OtherAircraft = _UNSEEN
    """A far peer as it was looked at last."""
    seen_until_s: float = -math.inf
    """A far peer looks the same until then, unless it is heard."""
    _flew: bool = False
    """It has said that its vehicle is armed or flies: before, an estimate settles by metres."""
    _found_s: float = -math.inf
    _jumps: Jumps = NO_JUMPS
    _creep: Creep = field(default_factory=Creep)
    _heights: HeightJumps = field(default_factory=HeightJumps)
    other: _Other | None = None
    """Its newest word that was not believed."""
    _back_s: float = -math.inf
    """When it last counted its states anew."""
    _stepped_s: float = 0.0
    """By how much its clock had stepped by the last word that was not believed."""
    _says: dict[str, tuple[object, float]] = field(default_factory=dict)
    """What it says in each state, and since when: that its part is over, that it has left, that
    its vehicle is down, that it carries out a command."""

    def age(self, now: float) -> float:
        """Seconds since the state was true, not negative: right but for half the round trip."""
        return math.inf if self.state is None else now - self.true_s

    def suspect(self, now: float) -> bool:
        """A word of it was not believed a moment ago."""
        return now - self._found_s <= SUSPECT_S

    def late_s(self, now: float) -> float:
        """By how much [s] its words may be older than states are: it is far, or its states do not
        come yet."""
        return FAR_LATE_S if now - self.near_s <= NEIGHBOUR_S else 0.0

    def view(self, now: float) -> OtherAircraft:
        """This peer at one tick; a far one's ages are those of a tick before."""
        if self.near_s != math.inf:
            return self._look(now)
        if now >= self.seen_until_s:
            self.seen = self._look(now)
            settled = not self._says and not self.suspect(now) and self.age(now) < FAR_EVERY_S
            self.seen_until_s = self.true_s + FAR_EVERY_S if settled else now + _OVERDUE_S
        return self.seen

    def _look(self, now: float) -> OtherAircraft:
        """Never heard: no state, infinite age."""
        state = self.state
        if state is None:
            return OtherAircraft(
                self.id, clock_unknown=self.clock.unknown_s is not None, expelled=self.expelled
            )
        age_s = now - self.true_s
        late_s = FAR_LATE_S if now - self.near_s <= NEIGHBOUR_S else 0.0  # `late_s`, without a call
        heard, suspect, says = not self.expelled, now - self._found_s <= SUSPECT_S, self._says
        fresh = age_s <= FRESH_S + late_s and heard
        return OtherAircraft(
            self.id,
            state,
            complex(state.position_ned_m[0], state.position_ned_m[1]),
            complex(state.stop_point_m[0], state.stop_point_m[1]),
            complex(state.setpoint_mps[0], state.setpoint_mps[1]),
            age_s,
            now - self.earliest_s,
            fresh,
            age_s <= NEIGHBOUR_S + late_s and heard,
            age_s <= FRESH_S and heard and state.phase in _YIELDING and not suspect,
            (self._group(state.step), state.step, state.override)
            if fresh and state.phase is Phase.FLY and state.left is None
            else None,
            self.limits.counted_s(state.response_s),
            self.clock.unknown_s is not None,
            "ends" in says and self._lasts("ends", now),
            state.left if "left" in says and self._lasts("left", now) else None,
            state.down and "down" in says and self._lasts("down", now),
            heard and "held" in says and self._lasts("held", now),
            self.expelled,
            suspect,
            late_s > 0.0,
            self.rare,
            self.true_s,
            abs(self._heights.off_m),
            now - self.listened_s,
        )

    def _group(self, step: int) -> str:
        return self.groups[step] if step < len(self.groups) else ""

    def approach(self, now: float, *, near: bool) -> None:
        """It is near from now on, or far."""
        if near is (self.near_s != math.inf):
            return
        self.near_s = now if near else math.inf
        self._counted, self.seen_until_s = None, -math.inf

    def expel(self, now: float, *, out: bool) -> None:
        """Listen to it no more, or again."""
        if self.expelled and not out:
            self.listened_s, self._counted = now, None
        self.expelled, self.seen_until_s = out, -math.inf

    def sleep(self, stop_s: float, now: float) -> None:
        """The agent itself was stopped for `stop_s` [s] before `now`: it could hear nobody."""
        told_s = min(self.received_s, self.true_s)
        self.listened_s = min(now, max(self.listened_s, told_s) + stop_s)
        self.seen_until_s = -math.inf

    def elsewhere(self, now: float) -> OtherAircraft | None:
        """The other place where its vehicle may be, by the word that was not believed."""
        other = self.other
        if other is None or now - other.received_s > SUSPECT_S:
            return None
        (north, east, _), age_s = other.state.position_ned_m, now - other.received_s
        at, stop = complex(north, east), complex(*other.state.stop_point_m)
        return OtherAircraft(
            id=TRAFFIC,
            state=None,
            position=at,
            stop_point=stop,
            setpoint=0j,
            age_s=age_s,
            age_at_most_s=age_s,
        )

    # --- what it says ---

    def hear(self, state: AgentState, received_s: float, *, far: bool = False) -> bool:
        """Take a state in, if it is believed. Newest wins: what is older than what is known is
        dropped; gaps in `seq` count as lost, but those between far words."""
        if self.expelled:
            return False
        self.seen_until_s = -math.inf
        believed = self._hear(state, received_s)
        newest = believed or state.seq == (self.state.seq if self.state else None)
        if newest:
            self.rare = far and (believed or self.rare)
        if not far and newest:
            if self._counted is not None and state.seq > self._counted:
                self.lost += state.seq - self._counted - 1
            self._counted = state.seq
        return believed

    def likely(self, word: Glimpse, received_s: float) -> bool:
        """Whether a word may follow what was believed: it fits the peer's clock, and a state is new
        and where the vehicle flies to. In a flood these are read first."""
        told_s, old = word.time_s, self.state
        early_s = self.clock.bounds(received_s)[0] - CLOCK_S
        if not told_s - received_s >= early_s or self.clock.beyond(told_s, received_s):
            return False  # NaN, too
        if word.at_m is None:
            return True
        if old is None or told_s <= old.time_s:
            return False
        elapsed_s, velocity = told_s - old.time_s, old.velocity_ned_mps
        off_n = word.at_m[0] - old.position_ned_m[0] - elapsed_s * velocity[0]
        off_e = word.at_m[1] - old.position_ned_m[1] - elapsed_s * velocity[1]
        return math.hypot(off_n, off_e) <= JUMP_M

    def _hear(self, state: AgentState, received_s: float) -> bool:
        old = self.state
        finding = self.limits.absurd(state)
        if old is None or finding is not None:
            if finding is not None:
                self.doubt(finding, received_s)
                return False
            self._believe(state, received_s)
            return True
        silent_s = received_s - self.received_s
        if state.time_s <= old.time_s and state.seq <= old.seq and silent_s <= NEIGHBOUR_S:
            # behind in time and number, and a newer one came just before
            self._hear_late(old, state, received_s)
            return False
        finding, jumps = self._judge(old, state, received_s)
        if finding is not None and not self._insists(finding, state, received_s):
            return False
        if state.seq <= old.seq or self._stepped_s > _TURNS_S:
            self._look_for_two(old, state, received_s)
        self._jumps, self._stepped_s = jumps, 0.0
        if self._flew and (creep := self._creep.look(old, state)) is not None:
            self._doubt_creep(creep, received_s)
        if self._flew and self.limits.heights:
            self._look_at_height(old, state, received_s)
        self._believe(state, received_s)
        return True

    def _hear_late(self, old: AgentState, state: AgentState, received_s: float) -> None:
        """What comes late is still from the same vehicle."""
        other_one = state.seq == old.seq and state.time_s != old.time_s
        jumped, _ = self.limits.jump(state, old, old.time_s - state.time_s, NO_JUMPS)
        if other_one or jumped is not None:
            self.other = _Other(state, received_s, received_s)
            self.doubt(_TWO, received_s)

    def _look_for_two(self, old: AgentState, state: AgentState, received_s: float) -> None:
        """Two senders that take turns: states counted anew again and again, or by two clocks."""
        if state.seq <= old.seq and received_s - self.received_s <= NEIGHBOUR_S:
            if state.seq > _STARTED or received_s - self._back_s <= _SENDERS_S:
                self.doubt(_TWO, received_s)
            self._back_s = received_s
        if self._stepped_s > _TURNS_S and received_s - self.received_s < INSISTS_S:
            self.doubt(_TWO, received_s)

    def _look_at_height(self, old: AgentState, state: AgentState, received_s: float) -> None:
        """It is followed all the same, and counts in no layer while it is doubted."""
        climbed_m = old.position_ned_m[2] - state.position_ned_m[2]
        climb_mps = -0.5 * (old.velocity_ned_mps[2] + state.velocity_ned_mps[2])
        jumped_m = self._heights.look(state.time_s - old.time_s, climbed_m, climb_mps)
        if jumped_m:
            words = f"its height jumped by {abs(jumped_m):.1f} m; allowed: {HEIGHT_JUMP_M:g} m"
            self.doubt(Suspicion(Doubt.HEIGHT, words), received_s)

    def _doubt_creep(self, finding: Suspicion, received_s: float) -> None:
        """It is followed all the same: where its vehicle is instead, no other word tells."""
        other = self.found is not None and self.found.doubt is not Doubt.CREEP
        if not (other and self.suspect(received_s)):
            self.doubt(finding, received_s)

    def _judge(
        self, old: AgentState, state: AgentState, received_s: float
    ) -> tuple[Suspicion | None, Jumps]:
        """Whether this state can follow the old one."""
        silent_s = received_s - self.received_s
        ahead_s, told_s = self.clock.beyond(state.time_s, received_s), state.time_s - old.time_s
        if silent_s <= NEIGHBOUR_S and (ahead_s > 0.0 or told_s <= 0.0):
            self._stepped_s = abs(ahead_s if ahead_s > 0.0 else told_s - silent_s)
            return Suspicion(Doubt.CLOCK, f"its clock stepped by {self._stepped_s:.3g} s"), NO_JUMPS
        if not (self._flew or state.airborne):
            return None, NO_JUMPS
        # by its own clock, and not much longer than it was silent
        elapsed_s = min(told_s, silent_s + CLOCK_S) if told_s > 0.0 else silent_s
        return self.limits.jump(old, state, elapsed_s, self._jumps)

    def _insists(self, finding: Suspicion, state: AgentState, received_s: float) -> bool:
        """It says this for `INSISTS_S`, and what was believed did not go on: so it is."""
        other, jumps, since_s = self.other, NO_JUMPS, received_s
        if other is not None and received_s - other.received_s <= NEIGHBOUR_S:
            told_s = state.time_s - other.state.time_s
            jumped, jumps = self.limits.jump(other.state, state, max(0.0, told_s), other.jumps)
            if jumped is None and 0.0 < told_s <= received_s - other.received_s + CLOCK_S:
                since_s = other.since_s
        self.other = _Other(state, received_s, since_s, jumps)
        if finding.doubt is not Doubt.CLOCK or self._stepped_s > CLOCK_S:
            self.doubt(finding, received_s)
        return min(received_s - since_s, received_s - self.received_s) >= INSISTS_S

    def _believe(self, state: AgentState, received_s: float) -> None:
        old, before_s = self.state, self.true_s
        self.clock.told(state.time_s, received_s)
        self._date(state.time_s, received_s)
        if old is not None and state.time_s < old.time_s and self.true_s < before_s:
            self.clock.forget(state.time_s, received_s)  # it has not answered since
            self._date(state.time_s, received_s)
        ends = _ENDS.get(state.phase, 0)
        if ends or state.override or state.left is not None or state.down or self._says:
            self._note("ends", (ends, state.step) if ends else None, received_s)
            self._note("left", state.left is not None or None, received_s)  # by whatever order
            self._note("down", state.down or None, received_s)
            self._note("held", state.override != 0 or None, received_s)
        self._flew |= state.airborne
        self.state, self.received_s = state, received_s
        self.received += 1

    def _note(self, what: str, word: object, now: float) -> None:
        """It says this; None: it does not."""
        if word is None:
            self._says.pop(what, None)
        elif (known := self._says.get(what)) is None or known[0] != word:
            self._says[what] = (word, now)

    def _lasts(self, what: str, now: float) -> bool:
        known = self._says.get(what)
        return known is not None and now - known[1] >= LASTS_S

    # --- what is not believed ---

    def doubt(self, finding: Suspicion, now: float) -> None:
        """Its word is not believed."""
        self.seen_until_s = -math.inf
        self.found, self._found_s = finding, now

    def _date(self, told_s: float, received_s: float) -> None:
        low, high = self.clock.bounds(received_s)
        self.true_s = min(told_s - 0.5 * (low + high), received_s)
        self.earliest_s = min(told_s - high, received_s)
        if self.clock.unknown_s is not None:
            # how old its states are is not known: not fresh, and lost if that lasts
            self.true_s = self.earliest_s = self.clock.unknown_s - 1.01 * NEIGHBOUR_S

    def report(self, now: float) -> LinkReport:
        """The mesh link from this peer over the whole run."""
        age, (low, high) = self.age(now), self.clock.bounds(now)
        return LinkReport(
            age_s=None if math.isinf(age) or self.expelled else age,
            age_p50_s=self.ages.percentile(0.5),
            age_p99_s=self.ages.percentile(0.99),
            received=self.received,
            lost=self.lost,
            clock_ahead_s=round(0.5 * (low + high), 6) if self.clock.known else None,
            round_trip_s=round(high - low, 6) if self.clock.known else None,
        )
