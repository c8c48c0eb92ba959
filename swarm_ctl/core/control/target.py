"""What one agent knows of the targets that its formation may follow: where each is, how it moves,
and which words of it are believed.

A word is an average of nothing: a receiver's position with its noise, some tenths of a second late,
and some never come. So the last few words together give velocity and turn rate, and these carry the
position to now. `docs/do/missions.md` says what is done with them.

A word that jumps is not believed, as a peer's is not: by a forged sender, or by a receiver that has
lost its satellites. It is believed when it goes on for `_INSISTS_S` while nobody says otherwise.
Points are north + 1j * east in the common frame [m]; times are on the own clock [s].
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from swarm_ctl.core.model.frames import geodetic_from_ned, ned_from_geodetic
from swarm_ctl.core.model.messages import Phase, Severity, TargetWord
from swarm_ctl.core.model.plan import Geodetic, Plan
from swarm_ctl.core.model.steps.follow import FollowStep
from swarm_ctl.core.model.targets import (
    CLEAR_M,
    LATE_S,
    PREDICTED_S,
    SELDOM_S,
    STANDS_MPS,
    TargetNow,
    TargetPlan,
)
from swarm_ctl.core.model.vehicle import Contact
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.core.safety.fence import inside
from swarm_ctl.core.swarm.snapshot import TRAFFIC, OtherAircraft, PeerSnapshot

_KEPT: Final = 6
"""Words that the velocity and the turn rate come from: 1.2 s at 5 Hz. More smooth the noise and lag
in a turn."""
_WINDOW_S: Final = 3.0
"""Older ones say nothing of how it moves now."""
_STRAIGHT: Final = 0.04
"""[rad/s] A slower turn is noise of the velocities."""
_SPINS: Final = 0.6
"""[rad/s] The fastest turn that is believed: 8 m/s in a circle of 13 m."""
_TELLS_S: Final = 0.2
"""Between two words that an agent tells of a target that it hears."""
_JUMP_M: Final = 5.0
_JUMP_MPS: Final = 3.0
"""A word may be so far from where the last ones lead, and so much farther a second since."""
_HEIGHT_JUMP_M: Final = 10.0
_CLIMBS_MPS: Final = 10.0
"""The same of its height: a receiver's is off by more than its place, and aircraft climb so."""
_UNLIKE_MPS: Final = 1.0
"""So much may a told velocity differ from that of the told places, beside what their noise makes
of it. Some receivers tell 0 for what they do not know."""
_UNLIKE_WORDS: Final = 4
"""Fewer words tell no velocity by their places ..."""
_UNLIKE_SPAN_S: Final = 0.5
"""... nor do those of a shorter time."""
_UNLIKE_MEAN: Final = 20
"""The mean over so many comparisons counts: noise goes, what is told wrongly stays."""
_INSISTS_S: Final = 2.0
_SAYS_S: Final = 2.0
"""A target that is silent for longer is said to be: a few words in a row are often lost."""
_SAID_S: Final = 5.0
"""What goes on is said again after so long."""
_FASTEST_MPS: Final = 60.0
_VAGUE_M: Final = 30.0
"""A word of a place that is known no better leads nobody."""


class Sighting(NamedTuple):
    """One word, in the common frame."""

    true_s: float
    at: complex
    velocity: complex | None
    accuracy_m: float
    height_m: float | None
    teller: str
    late_s: float = 0.0
    """So old it was when it came."""
    on_ground: bool = False


@dataclass(slots=True)
class Tracker:
    """Of one target."""

    name: str
    words: list[Sighting] = field(default_factory=list)
    """Those that are believed, the newest last."""
    course: complex = 1 + 0j
    _others: list[Sighting] = field(default_factory=list)
    """The newest that were not believed."""
    _found: list[str] = field(default_factory=list)
    """What is to be said."""
    _estimate: TargetNow | None = None
    _unlike: complex = 0j
    """How far the told velocities are from those of the places, in the mean ..."""
    _compared: int = 0
    """... of so many comparisons."""

    def hear(self, word: Sighting) -> bool:
        """Take a word in, if it is believed; older ones than the newest are dropped."""
        if self.words and word.true_s <= self.words[-1].true_s:
            return False
        if absurd := _absurd(word):
            self._found.append(absurd)
            return False
        why = self._doubt(word)
        silent = bool(self.words) and word.true_s - self.words[-1].true_s >= _INSISTS_S
        goes_on = (bool(why) or silent) and self._insists(word)
        if why and not goes_on:
            self._found.append(why)
            return False
        if goes_on:
            if why:
                away_m = abs(word.at - self.words[-1].at)
                self._found.append(f"is believed again, {away_m:.0f} m away")
            # what was believed before led elsewhere, and so did its velocity
            self.words, self._compared = self._others[:-1], 0
        self._others = []
        self.words = [w for w in self.words if word.true_s - w.true_s <= _WINDOW_S]
        self.words = [*self.words, word][-_KEPT:]
        self._estimate = self._fit()
        return True

    def now(self, now: float) -> TargetNow | None:
        """What is known at this time; None: nothing was heard."""
        known = self._estimate
        if known is None:
            return None
        age_s = max(0.0, now - self.words[-1].true_s)
        at, velocity, course = known.ahead(min(age_s, known.lasts_s + known.late_s))
        return known._replace(at=at, velocity=velocity, course=course, age_s=age_s)

    def take_said(self) -> list[str]:
        """What was found since."""
        found, self._found = self._found, []
        return found

    def _doubt(self, word: Sighting) -> str:
        """Why it is not believed, or ''."""
        known = self.now(word.true_s)
        if known is None:
            return ""
        silent_s = word.true_s - self.words[-1].true_s
        away_m = abs(word.at - known.at)
        # after a silence it may be where its speed has brought it, in any direction
        gone_m = (_JUMP_MPS + 2.0 * abs(known.velocity)) * max(0.0, silent_s - PREDICTED_S)
        most_m = _JUMP_M + 2.0 * word.accuracy_m + _JUMP_MPS * silent_s + gone_m
        if away_m <= most_m:
            return self._doubt_height(word, known.height_m, silent_s)
        last = self.words[-1].teller
        if word.teller != last and silent_s < _INSISTS_S:
            return f"is told by two, {last} and {word.teller}, {away_m:.0f} m apart"
        return f"jumped by {away_m:.0f} m by the word of {word.teller}"

    def _doubt_height(self, word: Sighting, last_m: float | None, silent_s: float) -> str:
        if last_m is None or word.height_m is None:
            return ""
        off_m = abs(word.height_m - last_m)
        if off_m <= _HEIGHT_JUMP_M + 2.0 * word.accuracy_m + _CLIMBS_MPS * silent_s:
            return ""
        return f"jumped by {off_m:.0f} m in height by the word of {word.teller}"

    def _insists(self, word: Sighting) -> bool:
        """Such words go on, from one place, and nobody says otherwise."""
        others = self._others
        if others and abs(word.at - others[-1].at) > _JUMP_M + _FASTEST_MPS * (
            word.true_s - others[-1].true_s
        ):
            others = []
        self._others = [*others, word][-_KEPT * 4 :]
        silent_s = word.true_s - self.words[-1].true_s
        return min(silent_s, word.true_s - self._others[0].true_s) >= _INSISTS_S

    def _fit(self) -> TargetNow:
        words, last = self.words, self.words[-1]
        times = [word.true_s - last.true_s for word in words]
        velocities = [word.velocity for word in words]
        told = [v for v in velocities if v is not None]
        by_places = _slope(times, [word.at for word in words])
        if len(told) < len(words) or self._contradicts(times, told, by_places):
            told = [by_places] * len(words)
        every_s = -times[0] / max(len(times) - 1, 1)
        middle_s = sum(times) / len(times)
        mean = sum(told) / len(told)
        turns = self._turns(times, told)
        velocity = mean * cmath.exp(-1j * turns * middle_s)
        if abs(velocity) > STANDS_MPS:
            self.course = velocity / abs(velocity)
        blank = TargetNow(
            at=0j,
            velocity=velocity,
            turns=turns,
            course=self.course,
            age_s=0.0,
            late_s=min(last.late_s, LATE_S),
            lasts_s=max(PREDICTED_S, 1.5 * min(every_s, SELDOM_S)),
            accuracy_m=last.accuracy_m,
            height_m=last.height_m,
            on_ground=last.on_ground,
        )
        carried = [
            word.at + blank._replace(velocity=v).ahead(-t)[0]
            for word, v, t in zip(words, told, times, strict=True)
        ]
        return blank._replace(at=sum(carried) / len(carried))

    def _contradicts(
        self, times: Sequence[float], told: Sequence[complex], by_places: complex
    ) -> bool:
        """The told velocities are not those of the told places: then the places count."""
        span_s = -times[0]
        if len(times) < _UNLIKE_WORDS or span_s < _UNLIKE_SPAN_S:
            return False
        flies = sum(told) / len(told)
        self._compared = min(self._compared + 1, _UNLIKE_MEAN)
        self._unlike += (flies - by_places - self._unlike) / self._compared
        noise_mps = self.words[-1].accuracy_m / span_s
        if abs(self._unlike) <= _UNLIKE_MPS + noise_mps * (1.0 + 4.0 / self._compared):
            return False
        off = f"tells a velocity {abs(self._unlike):.1f} m/s off that of its places"
        self._found.append(f"{off}: the places count")
        return True

    def _turns(self, times: Sequence[float], told: Sequence[complex]) -> float:
        """How fast the course turns, by the velocities."""
        if len(told) < 3 or min(map(abs, told)) < STANDS_MPS:
            return 0.0
        course = told[-1]
        angles = [cmath.phase(velocity / course) for velocity in told]
        turns = _slope(times, [complex(angle) for angle in angles]).real
        return max(-_SPINS, min(_SPINS, turns)) if abs(turns) > _STRAIGHT else 0.0


def _absurd(word: Sighting) -> str:
    """Why nothing moves, or is known, as this word says; ''."""
    speed = abs(word.velocity) if word.velocity is not None else 0.0
    if speed > _FASTEST_MPS:
        return f"moves at {speed:.0f} m/s by the word of {word.teller}"
    if word.accuracy_m > _VAGUE_M:
        return f"is known to {word.accuracy_m:.0f} m alone by the word of {word.teller}"
    return ""


def _slope(times: Sequence[float], values: Sequence[complex]) -> complex:
    """Of the straight line nearest to them; 0 of a single one."""
    middle, mean = sum(times) / len(times), sum(values) / len(values)
    spread = sum((t - middle) ** 2 for t in times)
    if spread < 1e-9:
        return 0j
    return sum((t - middle) * (v - mean) for t, v in zip(times, values, strict=True)) / spread


class Targets:
    """All targets of a plan, as one agent knows them."""

    def __init__(self, plan: Plan, own_id: int) -> None:
        self._plan, self._own = plan, own_id
        self._response_s = plan.response.dead_time_s + plan.response.lag_s
        self._of = {target.name: target for target in plan.targets}
        self._trackers = {target.name: Tracker(target.name) for target in plan.targets}
        self._told_s = dict.fromkeys(self._of, -math.inf)
        self._said: dict[tuple[str, str], float] = {}
        self._silent: set[str] = set()
        self.members = frozenset[int]()
        """Of the own group."""
        self._joined: set[str] = set()
        """Those that are an agent which flies in the own formation now: after itself it would go on
        and on."""
        self._step: FollowStep | None = None
        self._step_s = -math.inf
        """When `say` was first asked about it."""

    def __bool__(self) -> bool:
        return bool(self._of)

    def now(self, name: str, now: float) -> TargetNow | None:
        """What is known of it; None: nothing."""
        tracker = self._trackers.get(name)
        return tracker.now(now) if tracker is not None else None

    def hear(self, word: TargetWord, received_s: float) -> None:
        """From the mesh. What is no target of the plan is not listened to."""
        target = self._of.get(word.name)
        if target is None or not 0.0 <= word.age_s < math.inf:
            return
        told = Geodetic(word.latitude_deg, word.longitude_deg, word.altitude_m or 0.0)
        at = ned_from_geodetic(told, self._plan.origin)
        velocity = word.velocity_ned_mps
        flies = complex(velocity[0], velocity[1]) if velocity is not None else None
        height_m = target.height_m
        if height_m is None and word.altitude_m is not None:
            height_m = -at[2]
        true_s = received_s - word.age_s
        numbers = (true_s, *at, *(velocity or ()), word.accuracy_m)
        if not all(map(math.isfinite, numbers)):
            return
        self._trackers[word.name].hear(
            Sighting(
                true_s=true_s,
                at=complex(at[0], at[1]),
                velocity=flies,
                accuracy_m=word.accuracy_m,
                height_m=height_m,
                teller=word.teller,
                late_s=word.age_s,
                on_ground=word.on_ground,
            )
        )

    def sight(
        self,
        now: float,
        contacts: Sequence[Contact],
        peers: PeerSnapshot,
        step: FollowStep | None,
        begun_s: float | None,
    ) -> list[TargetWord]:
        """What this agent itself hears of targets, by its vehicle's receiver and of agents; it is
        believed as words are, and told on, 5 times a second at most.

        Args:
            now: own clock.
            contacts: of the vehicle's receiver.
            peers: for a target that is an agent.
            step: that is flown, if it follows one.
            begun_s: of that step, on the agent that leads: it plays a target of its mission.
        """
        words = list[TargetWord]()
        at_hand = {p.id for p in peers.peers if p.state and p.state.phase is Phase.YIELD}
        members = self.members - at_hand
        self._joined = {name for name, target in self._of.items() if target.agent in members}
        for target in self._of.values():
            if now < self._told_s[target.name] + _TELLS_S - 1e-6:
                continue
            word = self._sighted(now, target, contacts, peers)
            if target.way_m and step is not None and step.target == target.name:
                word = self._played(now, target, begun_s) if begun_s is not None else None
            if word is not None:
                self._told_s[target.name] = now
                self.hear(word, now)
                words.append(word)
        return words

    def _sighted(
        self, now: float, target: TargetPlan, contacts: Sequence[Contact], peers: PeerSnapshot
    ) -> TargetWord | None:
        for contact in contacts if target.adsb else ():
            if contact.address == target.adsb:
                at, age_s = contact.position, now - contact.time_s
                return TargetWord(
                    target.name,
                    at.lat_deg,
                    at.lon_deg,
                    age_s,
                    altitude_m=at.alt_m,
                    velocity_ned_mps=contact.velocity_ned_mps,
                    agent=self._own,
                )
        for peer in peers.peers if target.name not in self._joined else ():
            if peer.id == target.agent and peer.state is not None:
                at = geodetic_from_ned(peer.state.position_ned_m, self._plan.origin)
                return TargetWord(
                    target.name,
                    at.lat_deg,
                    at.lon_deg,
                    peer.age(now),
                    altitude_m=at.alt_m,
                    velocity_ned_mps=peer.state.velocity_ned_mps,
                    accuracy_m=1.0,
                    agent=self._own,
                    on_ground=not peer.state.airborne,
                )
        return None

    def _played(self, now: float, target: TargetPlan, begun_s: float) -> TargetWord:
        (north, east), (v_north, v_east) = target.played(now - begun_s)
        height_m = target.height_m or 0.0
        at = geodetic_from_ned((north, east, -height_m), self._plan.origin)
        return TargetWord(
            target.name,
            at.lat_deg,
            at.lon_deg,
            0.0,
            altitude_m=at.alt_m,
            velocity_ned_mps=(v_north, v_east, 0.0),
            accuracy_m=0.5,
            agent=self._own,
        )

    def aircraft(self, now: float, down_m: float) -> tuple[OtherAircraft, ...]:
        """The targets as strangers to keep clear of, by an agent at this depth; an agent of the
        plan is known by its own word."""
        return tuple(self._kept_clear(now, down_m))

    def _kept_clear(self, now: float, down_m: float) -> Iterator[OtherAircraft]:
        for name, tracker in self._trackers.items():
            known, target = tracker.now(now), self._of[name]
            if known is None or target.agent:
                continue
            if target.way_m and not known.fresh:  # its step is over: no agent plays it any more
                continue
            if known.height_m is not None and abs(known.height_m + down_m) > CLEAR_M:
                continue
            # as stop points are ahead of vehicles, its place is ahead of it
            stop, velocity, _ = known.ahead(self._response_s)
            yield OtherAircraft(
                id=TRAFFIC,
                state=None,
                position=known.at,
                stop_point=stop,
                setpoint=velocity,
                age_s=known.age_s,
                age_at_most_s=known.age_s,
                fresh=known.fresh,
            )

    def lost_s(self, step: FollowStep, now: float, since_s: float) -> float:
        """For how long the step's target has not been heard, `since_s` the step began."""
        known = self.now(step.target, now)
        return now - since_s if known is None else min(known.age_s, now - since_s)

    def say(
        self, now: float, step: FollowStep | None, zones: Sequence[Zone], height_m: float
    ) -> Iterator[tuple[Severity, str]]:
        """What is to be said of the targets, with these zones in force, by an agent at this height
        above the origin; what goes on, every some seconds."""
        for name, tracker in self._trackers.items():
            for text in tracker.take_said():
                if self._due(name, " ".join(text.split()[:2]), now):
                    yield Severity.WARNING, f"target {name} {text}"
        if step != self._step:
            self._step, self._step_s = step, now
        if step is None:
            return
        known, name = self.now(step.target, now), step.target
        silent = known is None or not known.fresh
        long = self.lost_s(step, now, self._step_s) > _SAYS_S
        if long and name not in self._silent:
            self._silent.add(name)
            why = "is not heard"
            if name in self._joined:
                agent = self._of[name].agent
                why = f"is agent {agent} of this formation, and no pilot flies it"
            yield Severity.WARNING, f"target {name} {why}: the formation stands"
        elif not silent and name in self._silent:
            self._silent.discard(name)
            yield Severity.INFO, f"target {name} is heard: the formation closes up"
        if known is None or silent:
            return
        for what, text in self._meets(known, step, zones, height_m):
            if self._due(name, what, now):
                yield Severity.WARNING, f"target {name} {text}"

    def _meets(
        self, known: TargetNow, step: FollowStep, zones: Sequence[Zone], height_m: float
    ) -> Iterator[tuple[str, str]]:
        """Why the formation can't be where this target is, in a word and in a sentence with what is
        done."""
        speed, at = abs(known.velocity), (known.at.real, known.at.imag)
        if speed > step.speed_mps:
            fast = f"is faster than the formation may fly: {speed:.1f} m/s"
            yield "fast", f"{fast}; allowed: {step.speed_mps:g} m/s"
        fence = self._plan.fence
        if fence is not None and not inside(fence.polygon_m, at):
            yield "fence", "is outside the fence: the formation stays inside"
        for zone in zones:
            if zone.contains(at) and zone.blocks(height_m, height_m):
                yield zone.name, f"is in zone {zone.name}: the vehicles keep out of it"
        if known.on_ground:
            yield "ground", "is on the ground: the formation stands by it"
        if step.above_m is not None and known.height_m is None:
            yield "height", "does not tell its height: the formation keeps its own"

    def _due(self, name: str, what: str, now: float) -> bool:
        last_s = self._said.get((name, what), -math.inf)
        if now - last_s < _SAID_S:
            return False
        self._said[name, what] = now
        return True
