"""The law's gains changed in flight, and the zones: by all agents at one mission time, or by none.
The paper's gains are `delta_a`, `delta_l`, `h` and `kappa`; an own law's are its numbers, with the
bounds it gives, and `h` and `kappa`. What holds for gains here holds for zones: an update has both,
so `tune` keeps the zones, and `zone` the gains.

Two phases. `tune` names all values, the time from which they hold (about two seconds ahead)
and the agents that fly. Each of those prepares the update or refuses it with a reason. When every
one of them has prepared, and well before the time, the station sends `apply`: now the update is
*decided*, and every agent that knows so puts it in force at its time. An update that was prepared
and not decided by then never happens: silence means the old gains.

Every state carries the tag of the gains in force and of the update that is decided, so peers repair
what the station's mesh link loses. What happens to an agent, and what it does:

- `apply` comes before the time, or a peer's state says that the update is decided: it says so in
  its own states, and puts the gains in force at the time.
- It hears neither before the time: it keeps the old gains. As soon as a peer's state says that the
  prepared gains are in force, it adopts them in the same tick.
- `apply` comes after the time: it refuses. If no agent flies the new gains by then, none begins.
- A peer flies gains that this agent has not prepared, because it was restarted, or lost while its
  peers were asked: the peers tell it the gains and zones (`LawNews`), and it takes them up where at
  least half of the peers that it hears fly them. Until then, or where fewer do (another station's
  mistake), it keeps its own and warns; so does every station.
- The station dies between the phases: nothing changes. It dies while it sends `apply`: the agents
  that heard it tell their peers.
- An agent that a peer hears was not asked: that peer refuses, so nothing changes.

Updates are ordered by their time, then by tag; no agent goes back to an older one. While one update
is under way no other is prepared. Between hosts, `tune` also tells how far each agent's clock is
ahead of the sender's; peers follow an agent that is early as soon as they hear it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

from swarm_ctl.core.model.geometry import area, crossing_edges
from swarm_ctl.core.model.messages import (
    Ack,
    AgentState,
    Command,
    CommandKind,
    Gains,
    LawNews,
    Phase,
    Severity,
    Tuning,
)
from swarm_ctl.core.model.plan import Compensation, Plan
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.core.swarm.snapshot import PeerSnapshot

ASKS: Final = (CommandKind.TUNE, CommandKind.ZONE)
"""First phases."""
KINDS: Final = (*ASKS, CommandKind.APPLY)
LEAD_S: Final = 2.0
"""From the command to its time; a lost message is sent again every half second. On the wall clock
where that is the slower one."""
_LEAD_AT_MOST_S: Final = 300.0
_MARGIN: Final = 0.25
"""The last part of the lead, in which nothing is decided any more, because `apply` needs time to
arrive."""
_PREPARED_KEPT: Final = 16

DELTA_A_AT_MOST: Final = 0.3
DELTA_L_AT_MOST: Final = 2.2
H_AT_MOST: Final = 0.05
"""Larger values weaken the repulsion, or outrun it. Of 900 random missions without the safety
filter 1 came under r_in (0.465 units) with all three at these values; 4, 3 and 3 with one of them
at delta_a 1, delta_l 2.5 or h 0.06, and 70 and 137 with delta_a 5 or h 0.2
(`python -m tests.bench.bench_gains`, as all figures here)."""
H_SAFE_AT_MOST: Final = 0.2
RATE_AT_MOST: Final = 2.0
SAFE_RATE_AT_MOST: Final = 4.0
"""With the safety filter: 0 of 600 missions under r_in, n from 2 to 50, late and lost states."""
PLAIN_RATE_AT_MOST: Final = 0.05
"""kappa * h with `compensation: none`: 0 of 300 missions under r_in; 80 with four times as much."""
_SAID: Final = ("h", "kappa", "delta_a", "delta_l")
_ROUNDING: Final = 1e-9
ZONES_AT_MOST: Final = 250
_CORNERS_AT_MOST: Final = 200
_FARTHEST_M: Final = 20_000.0
_ORIGINAL: Final = (-math.inf, 0)
_LOOK_S: Final = 0.25
"""Between two looks at what peers fly; one that has the same at the next look needs no news."""
_AGAIN_S: Final = 1.0
_ALONE_S: Final = 3.0
"""For so long the lowest of those that fly the newest law tells it alone."""
_HEARD_S: Final = 1.0


_NAMES: Final = ("delta_a", "delta_l", "h", "kappa")
_ALL_LAWS: Final = ("h", "kappa")
"""The paper's gains that count for every law: how fast an agent flies to a place."""


def planned(plan: Plan) -> Gains:
    """The mission's own gains."""
    law = plan.law
    own = tuple((each.name, each.value) for each in law.parameters)
    return Gains(law.delta_a, law.delta_l, law.h, plan.kappa, own)


def values_of(gains: Gains) -> dict[str, float]:
    """Each gain by its name."""
    names = _ALL_LAWS if gains.own else _NAMES
    return {name: getattr(gains, name) for name in names} | dict(gains.own)


def with_values(gains: Gains, changes: Mapping[str, float]) -> Gains:
    """The gains with other values, by name."""
    own = tuple((name, changes.get(name, value)) for name, value in gains.own)
    names = _ALL_LAWS if gains.own else _NAMES
    papers = {name: changes[name] for name in names if name in changes}
    return replace(gains, **papers, own=own)


def limits(plan: Plan) -> dict[str, tuple[float, float]]:
    """The range of each value in flight, (least, most); a least of 0 means above 0 for the paper's
    gains. The mission's own values are always allowed."""
    own = planned(plan)
    papers = {
        "delta_a": (0.0, max(DELTA_A_AT_MOST, own.delta_a)),
        "delta_l": (2.0, max(DELTA_L_AT_MOST, own.delta_l)),
        "h": (0.0, max(H_SAFE_AT_MOST if plan.safety.filter else H_AT_MOST, own.h)),
        "kappa": (0.0, 1.0 / plan.tick_s),
    }
    if not plan.law.own:
        return papers
    shared = {name: papers[name] for name in _ALL_LAWS}
    return shared | {each.name: (each.least, each.most) for each in plan.law.parameters}


def rate_at_most(plan: Plan) -> float:
    """The most that kappa * h may be in flight [1/s]."""
    most = SAFE_RATE_AT_MOST if plan.safety.filter else RATE_AT_MOST
    if plan.compensation is Compensation.NONE:
        most = PLAIN_RATE_AT_MOST
    return max(most, plan.kappa * plan.law.h)


def out_of_range(gains: Gains, plan: Plan) -> str:
    """Why these gains cannot be flown, and what could; '' where they can."""
    own = tuple(each.name for each in plan.law.parameters)
    if tuple(name for name, _ in gains.own) != own:
        return f"numbers of another law; allowed: {', '.join(own) or 'none of an own law'}"
    for name, (least, most) in limits(plan).items():
        value = values_of(gains).get(name, math.nan)
        above = value >= least if least or name in own else value > 0
        if not (math.isfinite(value) and above and value <= most + _ROUNDING):
            span = (
                f"{least:g} to {most:g}" if least or name in own else f"above 0, at most {most:g}"
            )
            return f"{name} {value:g}; allowed in flight: {span}"
    rate, most = gains.kappa * gains.h, rate_at_most(plan)
    if rate > most + _ROUNDING:
        return f"kappa * h is {rate:.3g}; allowed in flight: at most {most:g}"
    return ""


def named(gains: Gains) -> str:
    """`h 0.05, kappa 20, delta_a 0.1, delta_l 2`."""
    values = values_of(gains)
    order = sorted(values, key=lambda name: _SAID.index(name) if name in _SAID else len(_SAID))
    return ", ".join(f"{name} {values[name]:g}" for name in order)


def differences(one: Gains, other: Gains) -> str:
    """`h 0.05 -> 0.04, kappa 20 -> 15`; '' where they are the same."""
    before, after = values_of(one), values_of(other)
    pairs = ((name, a, after.get(name, math.nan)) for name, a in before.items())
    return ", ".join(f"{name} {a:g} -> {b:g}" for name, a, b in pairs if a != b)


def bad_zones(zones: tuple[Zone, ...]) -> str:
    """Why these can't be zones, and what could; '' where they can."""
    if len(zones) > ZONES_AT_MOST:
        return f"{len(zones)} zones; allowed: at most {ZONES_AT_MOST}"
    if len({zone.name for zone in zones}) < len(zones):
        return "two zones have one name; allowed: a name of its own for each"
    for zone in zones:
        heights = (zone.floor_m or 0.0, zone.ceiling_m or 0.0)
        numbers = (
            zone.radius_m,
            zone.clearance_m,
            *heights,
            *(x for at in zone.corners_m for x in at),
        )
        if not all(abs(x) <= _FARTHEST_M for x in numbers):  # NaN is not
            return f"zone {zone.name}: a number is out of range; allowed: to {_FARTHEST_M:g} m"
        if zone.clearance_m < 0.0:
            return f"zone {zone.name}: clearance {zone.clearance_m:g}; allowed: 0 m or more"
        low, high = zone.floor_m, zone.ceiling_m
        if low is not None and high is not None and low >= high:
            return f"zone {zone.name}: floor {low:g}, ceiling {high:g}; allowed: a floor below it"
        circle, corners = len(zone.corners_m) == 1, zone.corners_m
        if not (zone.radius_m > 0 if circle else 3 <= len(corners) <= _CORNERS_AT_MOST):
            allowed = f"a radius above 0, or 3 to {_CORNERS_AT_MOST} corners"
            return f"zone {zone.name} is no area; allowed: {allowed}"
        if not circle and (crossing_edges(corners) or area(corners) < 0.01):
            return f"zone {zone.name} is no area; allowed: corners in order around a place"
    return ""


def zone_changes(before: tuple[Zone, ...], after: tuple[Zone, ...]) -> str:
    """`add pond, lift oak`; '' where they are the same."""
    was, are = ({zone.name: zone for zone in zones} for zones in (before, after))
    words = [f"add {name}" for name, zone in are.items() if was.get(name) != zone]
    return ", ".join(words + [f"lift {name}" for name in was if name not in are])


class GainUpdate:
    """One agent's gains: in force, prepared, and decided but waiting for their time."""

    def __init__(self, plan: Plan, own_id: int, plan_hash: int) -> None:
        self._plan = plan
        self._own = own_id
        self._hash = plan_hash
        self._prepared: dict[int, Tuning] = {}
        self._since = _ORIGINAL
        self._unknown: set[int] = set()
        self._look_s = self._tell_s = -math.inf
        """When the next look at the peers is due, and the next word to them."""
        self._other_s = math.inf
        """Since when a peer flies another law."""
        self.gains = planned(plan)
        self.zones: tuple[Zone, ...] | None = None
        """In force; None: the plan's."""
        self.tag = 0
        """`Command.tag` of the update in force; 0: the mission's own gains."""
        self.decided = 0
        """`Command.tag` of the update that waits for its time; 0: none."""

    @property
    def zones_in_force(self) -> tuple[Zone, ...]:
        """The update's, else the plan's."""
        return self._of(self.zones)

    def refusal(self, command: Command, peers: PeerSnapshot) -> str:
        """Why the command cannot be obeyed; '' where it can."""
        now = peers.now_s
        if command.kind == CommandKind.APPLY:
            return self._too_late(command.commits, now)
        tuning = self._on_own_clock(command.tuning)
        if tuning is None:
            return "the command has no values"
        if not now < tuning.at_s <= now + _LEAD_AT_MOST_S:
            when = f"it is for {tuning.at_s:.1f} s, and it is {now:.1f} s"
            return f"{when}; allowed: within {_LEAD_AT_MOST_S:g} s"
        pending = [
            t.at_s for tag, t in self._prepared.items() if t.at_s > now and tag != command.tag
        ]
        if pending:
            return f"another change is under way until {max(pending):.1f} s"
        unasked = [peer for peer in self._flying(peers) if peer not in command.agents]
        if unasked:
            return f"{agents_named(unasked)} flies too, and was not asked"
        wrong = out_of_range(tuning.gains, self._plan) or bad_zones(tuning.zones or ())
        return wrong or self._more_than_asked(command.kind, tuning)

    def _more_than_asked(self, kind: str, tuning: Tuning) -> str:
        """Why it would change other zones than was meant, or ''. Its sender may know the zones of a
        moment ago: no zone that was just added is lifted by that."""
        changes = zone_changes(self._of(self.zones), self._of(tuning.zones))
        if kind == CommandKind.ZONE and self._of(tuning.zones) == self._plan.zones:
            return ""  # back to the mission's own
        most = 1 if kind == CommandKind.ZONE else 0
        if changes.count(",") + bool(changes) <= most:
            return ""
        return f"it would {changes}: its sender knows older zones; send it again"

    def _too_late(self, tag: int, now: float) -> str:
        if tag in (self.tag, self.decided):
            return ""
        tuning = self._prepared.get(tag)
        if tuning is None:
            return f"agent {self._own} has not prepared this change"
        if now < tuning.at_s:
            return ""
        keeps = f"agent {self._own} keeps its law until a peer flies the other"
        return f"too late: it was for {tuning.at_s:.1f} s; {keeps}"

    def _flying(self, peers: PeerSnapshot) -> list[int]:
        """The peers that are heard and fly their vehicles."""
        patience = self._plan.policies.agent_lost_after_s
        return [
            peer.id
            for peer in peers.peers
            if peer.state is not None
            and peer.silent_s <= patience
            and peer.state.phase not in (Phase.YIELD, Phase.ENDED)
        ]

    def obey(self, command: Command) -> None:
        """Prepare an update that was accepted, or take it as decided."""
        if command.kind == CommandKind.APPLY:
            self._decide(command.commits)
        elif (tuning := self._on_own_clock(command.tuning)) is not None:
            self._prepared[command.tag] = tuning
            while len(self._prepared) > _PREPARED_KEPT:
                del self._prepared[next(iter(self._prepared))]

    def update(
        self, now: float, states: Iterable[tuple[AgentState, float]]
    ) -> list[tuple[Severity, str]]:
        """One tick: `states` of peers that came since the last one. Returns what is to be said,
        (severity, text)."""
        said: list[tuple[Severity, str]] = []
        for state, _ in states:
            if (
                state.gains_tag == self.tag and state.next_gains_tag == self.decided
            ) or state.plan_hash != self._hash:
                continue
            known = self._prepared.get(state.next_gains_tag)
            if known is not None and now < known.at_s:
                self._decide(state.next_gains_tag)
            if state.gains_tag in self._prepared:
                said += self._adopt(state.gains_tag)
            elif state.gains_tag not in (0, self.tag) and state.gains_tag not in self._unknown:
                self._unknown.add(state.gains_tag)
                text = f"flies a law that agent {self._own} was not asked about"
                said.append((Severity.WARNING, f"agent {state.agent} {text}"))
        if self.decided and now >= self._prepared[self.decided].at_s:
            said += self._adopt(self.decided)
        return said

    # --- those that were not asked ---

    def tell(self, peers: PeerSnapshot) -> LawNews | None:
        """The law in force, for peers that fly an older one; None: nothing is to be told now."""
        now = peers.now_s
        if not self.tag or now < self._look_s:
            return None
        self._look_s = now + _LOOK_S
        tags = self._tags(peers)
        if all(tag == self.tag for tag in tags.values()):
            self._other_s = math.inf
            return None
        before, self._other_s = self._other_s, min(self._other_s, now)
        alone = any(tag == self.tag and agent < self._own for agent, tag in tags.items())
        if not before < now or now < self._tell_s or (alone and now - before < _ALONE_S):
            return None
        self._tell_s = now + _AGAIN_S
        return LawNews(self._own, self.tag, now - self._since[0], self.gains, self.zones)

    def take_up(self, news: LawNews, peers: PeerSnapshot) -> list[tuple[Severity, str]]:
        """Fly what at least half of the peers fly that are heard, if it is newer and can be flown.
        Returns what is to be said, (severity, text)."""
        tags = self._tags(peers)
        many = 2 * sum(tag == news.tag for tag in tags.values()) >= len(tags)
        if news.tag == self.tag or tags.get(news.agent) != news.tag or not many:
            return []
        if out_of_range(news.gains, self._plan) or bad_zones(news.zones or ()):
            return []
        at_s = peers.now_s - max(0.0, news.for_s)
        self._prepared[news.tag] = Tuning(news.gains, at_s, zones=news.zones)
        said = self._adopt(news.tag)
        text = f"takes up what agent {news.agent} flies"
        return [(Severity.WARNING, text), *said] if said else []

    def _tags(self, peers: PeerSnapshot) -> dict[int, int]:
        """What each peer flies that is heard, by its own word."""
        return {
            peer.id: peer.state.gains_tag
            for peer in peers.peers
            if peer.state is not None
            and peer.silent_s <= _HEARD_S
            and peer.state.plan_hash == self._hash
            and peer.state.phase is not Phase.ENDED
        }

    def _on_own_clock(self, tuning: Tuning | None) -> Tuning | None:
        ahead_s = dict(tuning.ahead_s).get(self._own, 0.0) if tuning else 0.0
        return replace(tuning, at_s=tuning.at_s + ahead_s) if tuning and ahead_s else tuning

    def _decide(self, tag: int) -> None:
        if tag != self.tag:
            self.decided = tag

    def _adopt(self, tag: int) -> list[tuple[Severity, str]]:
        """Put an update in force, unless a newer one is."""
        if tag == self.decided:
            self.decided = 0
        tuning = self._prepared[tag]
        if (tuning.at_s, tag) <= self._since:
            return []
        self._since, self.tag = (tuning.at_s, tag), tag
        before, self.gains = self.gains, tuning.gains
        zones = self.zones
        self.zones = None if tuning.zones == self._plan.zones else tuning.zones
        changed = zone_changes(self._of(zones), self._of(self.zones))
        what = differences(before, self.gains) or ("" if changed else "the same values")
        said = [(Severity.INFO, f"the law is another one: {what}")] if what else []
        return said + ([(Severity.INFO, f"zones: {changed}")] if changed else [])

    def _of(self, zones: tuple[Zone, ...] | None) -> tuple[Zone, ...]:
        return self._plan.zones if zones is None else zones


@dataclass(slots=True)
class GainUpdateRound:
    """The sender's side of one update: which agents have answered, and what follows from it."""

    ask: Command
    """A `tune` with the agents named and a `tuning`."""
    answers: dict[int, Ack] = field(default_factory=dict)
    failed: str = ""
    """Why nothing changes."""
    applied: Command | None = None
    """The `apply` that was sent once all agents had prepared."""

    @property
    def over(self) -> bool:
        """Nothing more will come of it."""
        return bool(self.failed) or self.applied is not None

    def hear(self, ack: Ack) -> None:
        """Take an answer in; answers to other commands are ignored."""
        if ack.command == self.ask.id and ack.agent in self.ask.agents:
            self.answers[ack.agent] = ack

    def decide(self, now: float) -> Command | None:
        """`apply`, once all agents have prepared in time. Sets `failed` as soon as that cannot be
        any more. `now`: mission time [s]."""
        tuning = self.ask.tuning
        if self.over or tuning is None:
            return None
        refused = [ack for ack in self.answers.values() if not ack.accepted]
        missing = [agent for agent in self.ask.agents if agent not in self.answers]
        if refused:
            self.failed = f"refused by agent {refused[0].agent}: {refused[0].reason}"
        elif now >= tuning.at_s - _MARGIN * (tuning.at_s - self.ask.time_s):
            names = agents_named(missing)
            self.failed = f"no answer from {names}" if missing else "the answers came too late"
        elif not missing:
            self.applied = replace(
                self.ask,
                id=f"{self.ask.id}-apply",
                kind=CommandKind.APPLY,
                time_s=now,
                commits=self.ask.tag,
            )
        return self.applied
