"""The frame (centre, angle, scale) that all agents of a formation share.

The law keeps the shape wherever it stands. So one agent, the *pinned* one, advances the frame along
the step's path, sends it in its state, and holds its own place in it. The other agents take the
frame from that state, fly its velocity (feed-forward) and let the law do the rest. The frame is
state that is passed on, not a function of a clock: it does not matter when an agent enters a step,
and the next pinned agent goes on from the frame it followed.

The pinned agent is the one with the lowest id among those that are airborne, heard and flying the
formation. It slows the frame down while the shape is out of tolerance, and stops it while a peer
is not heard.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

from swarm_ctl.core.kernel.response import stop_distance
from swarm_ctl.core.model.geometry import Point, centred, mean_of, turned
from swarm_ctl.core.model.messages import AgentState, Phase
from swarm_ctl.core.model.plan import GroupPlan, Plan
from swarm_ctl.core.model.planned_formation import STILL, Frame, Motion
from swarm_ctl.core.model.steps.follow import FollowStep, Stops
from swarm_ctl.core.model.steps.step import Path, Step, strayed
from swarm_ctl.core.model.targets import TargetNow
from swarm_ctl.core.model.timeouts import PREDICT_S
from swarm_ctl.core.safety.fence import inside
from swarm_ctl.core.swarm.plausibility import JUMP_M
from swarm_ctl.core.swarm.snapshot import FormationKey, PeerSnapshot

_SLOW_SPAN_M: Final = 2.0
"""The frame slows down as the error exceeds the step's tolerance, and stops at this much more."""
_TURNS: Final = 3.0
"""Of the vehicles' acceleration: so hard a frame turns and brakes after its target. Stop points
turn and brake harder than vehicles; the noise of the news is smoothed by this."""
_BRAKES: Final = 0.8
"""Of the vehicles' acceleration: so hard a frame is braked that flies to the fence."""
_TRIM_S: Final = 5.0
"""So slowly the place about a target is corrected by where the vehicle is seen to be ..."""
_TRIM_M: Final = 3.0
"""... by no more than this, and while it is no farther off."""
_CREEP: Final = 0.05
"""The least share of its speed at the end of a leg: a square root profile alone never arrives."""


def rate_towards(
    frame: Frame,
    path: Path,
    radius_m: float,
    error_m: float | None,
    acceleration_mps2: float,
    dt_s: float,
) -> float:
    """The frame's rate (0..1 of the step's speed) for the next tick, within its acceleration.

    The formation error and the distance to the end of the leg limit it; `error_m` is None while a
    peer is not heard, and the frame stops.
    """
    wanted = 0.0
    if error_m is not None:
        wanted = max(0.0, min(1.0, 1.0 - (error_m - path.tolerance_m) / _SLOW_SPAN_M))
    # v = sqrt(2 a s): the speed from which the frame still stops at the end of the leg
    stopping = math.sqrt(2 * acceleration_mps2 * path.left_m(frame, radius_m)) / path.speed_mps
    jump = acceleration_mps2 * dt_s / path.speed_mps
    return max(0.0, min(wanted, max(stopping, _CREEP), frame.rate + jump))


class Reference:
    """One agent's view of the shared frame, tick by tick."""

    def __init__(self, plan: Plan, group: GroupPlan, own_id: int) -> None:
        self._plan, self._ids = plan, group.ids
        self._own = own_id
        self._places: tuple[Point, ...] = ()
        """The newest shape's slots, centred, in the group's order [units]."""
        self._indices: Mapping[int, int] | None = None
        """Slot index of each agent; None: in the group's order."""
        self._slots: dict[int, Point] = {}
        self.radius_m = 0.0
        """Of the newest shape at scale 1."""
        self.frame: Frame | None = None
        self.motion = STILL
        """Of the frame, since `follow`."""
        self.pinned = own_id
        self.target: TargetNow | None = None
        """What is known of the target that the step follows."""
        self._trim_m = 0.0
        """By how much the place about a target is put ahead."""
        self.hemmed = False
        """A zone that came lies on the formation."""
        self.law_tag = 0
        """Of the own law: a leader with another one may have other zones, and so another way."""
        self.doubted: tuple[int, str] | None = None
        """The leader whose frame was not believed in this tick, and why."""
        self._bounds = FrameBounds()

    @property
    def leads(self) -> bool:
        """Whether this agent is the pinned one."""
        return self.pinned == self._own

    @property
    def slots(self) -> dict[int, Point]:
        """Each agent's slot in the shape as it is turned and scaled now [units], by agent id.

        Empty before the first form step.
        """
        frame = self.frame
        if frame is None or (frame.angle_rad, frame.scale) == (0.0, 1.0):
            return self._slots
        return {
            agent: turned(slot, frame.angle_rad, frame.scale) for agent, slot in self._slots.items()
        }

    @property
    def shape(self) -> tuple[Sequence[Point], Mapping[int, int] | None]:
        """What `form` was given last, but for where it stands."""
        return self._places, self._indices

    def form(self, slots: Sequence[Point], indices: Mapping[int, int] | None = None) -> None:
        """Begin a form step: the law alone decides where the shape will stand.

        `indices` gives the index in `slots` of each agent; None: the group's k-th agent has
        the k-th slot, and exchanges do not change that.
        """
        self._places = centred(slots)
        self.radius_m = max(math.hypot(*slot) for slot in self._places) * self._plan.unit_m
        self.frame, self.motion = None, STILL
        self._bounds.begin(None)
        self._indices = indices
        self._give_out()

    def deal(self, places: Mapping[int, Point]) -> None:
        """The same shape with other slots, wherever it is and goes: each agent's [units]."""
        ids = [*places]
        self._slots = dict(zip(ids, centred([places[i] for i in ids]), strict=True))
        self.radius_m = max(math.hypot(*slot) for slot in self._slots.values()) * self._plan.unit_m
        whole = zip(self._ids, self._places, strict=True)
        indices = self._indices or {agent: k for k, agent in enumerate(self._ids)}
        missing = {agent: self._places[indices[agent]] for agent, _ in whole if agent not in places}
        self._slots |= missing

    def whole(self) -> None:
        """Each agent has its slot of the whole shape again."""
        self.radius_m = max(math.hypot(*slot) for slot in self._places) * self._plan.unit_m
        self._give_out()

    def assign(self, indices: Mapping[int, int]) -> None:
        """Take the slot index of each agent after an exchange; ignored if `form` got none."""
        if self._indices is not None and indices is not self._indices:
            self._indices = indices
            self._give_out()

    def _give_out(self) -> None:
        indices = self._indices or {agent: k for k, agent in enumerate(self._ids)}
        self._slots = {agent: self._places[indices[agent]] for agent in self._ids}

    def begin(self, leg: int | None = 0) -> None:
        """Begin another kind of step from where the frame is; on its own leg, if `leg` is None."""
        if self.frame is not None:
            frame = self.frame.stopped()
            self.frame = frame if leg is None else replace(frame, leg=leg)
        self._bounds.begin(self.frame)

    def join(self, frame: Frame | None) -> None:
        """Go on from the frame of a peer, in the middle of a step."""
        self.frame = frame
        self._bounds.begin(frame)

    def follow(
        self,
        peers: PeerSnapshot,
        step: Step,
        key: FormationKey,
        own_m: Point,
        error_m: float | None,
        *,
        free: bool,
    ) -> None:
        """One tick of a step that keeps the formation.

        `key` is the own formation's: the frame of a pinned agent at another one stands still.
        `own_m` is the own stop point. `free`: this agent may be the pinned one.
        """
        self.doubted = None
        leader = self._leader(peers, free)
        self.pinned = leader.agent if leader is not None else self._own
        path = step.path
        heard = leader.frame if leader and (leader.step, leader.override) == key[1:] else None
        if leader is None:
            self._lead(peers, step, own_m, error_m)
            if self.frame is not None:
                self._bounds.lead(self.frame, peers.now_s)
        elif heard is not None and self._believed(leader, heard, step, peers, own_m):
            age = peers.age_s(leader.agent)
            frame = heard if age <= PREDICT_S else heard.stopped()
            self.frame = path.advanced(frame, age, self.radius_m) if path else frame.flown_on(age)
        elif self.frame is not None:
            self.frame = self.frame.stopped()
        self.motion = STILL
        if path is not None and self.frame is not None and self._slots:
            self.motion = path.motion(self.frame, self.radius_m)
        elif step.follows is not None and self.frame is not None and self._slots:
            self.motion = Motion(complex(*self.frame.velocity_mps))

    def trim(self, step: FollowStep, own: complex) -> None:
        """Learn from where the vehicle is what the model of its response leaves; once a tick.

        Args:
            step: that is flown.
            own: where the vehicle is, north + 1j * east [m].
        """
        target = self.target
        if self.frame is None or target is None or not target.fresh or not self._slots:
            return
        slot = complex(*turned(self._slot_m(self._own), self.frame.angle_rad, self.frame.scale))
        missed_m = step.missed_m(target, own - slot)
        if abs(missed_m) < _TRIM_M:
            trim_m = self._trim_m - missed_m * (self._plan.tick_s / _TRIM_S)
            self._trim_m = max(-_TRIM_M, min(_TRIM_M, trim_m))

    @property
    def feed_forward(self) -> Point:
        """The velocity of the own place with the frame [m/s], to be flown on top of the law's."""
        if self.frame is None or not self._slots:
            return (0.0, 0.0)
        place = turned(self._slot_m(self._own), self.frame.angle_rad, self.frame.scale)
        velocity = self.motion.of(complex(*place))
        return velocity.real, velocity.imag

    @property
    def spin(self) -> complex:
        """`Motion.spin` as the turned and scaled shape shows it. Its last bit may be another one
        (recorded flights have this one)."""
        if self.frame is None or not self.motion.spin:
            return 0j
        axis = complex(*turned((1.0, 0.0), self.frame.angle_rad, self.frame.scale))
        return self.motion.of(axis) / axis

    def off_m(self, own_m: Point) -> Point:
        """From the own stop point to the own place in the frame, (north, east) [m]."""
        if self.frame is None:
            return (0.0, 0.0)
        centre = self.frame.point_m
        place = turned(self._slot_m(self._own), self.frame.angle_rad, self.frame.scale)
        return centre[0] + place[0] - own_m[0], centre[1] + place[1] - own_m[1]

    def there(self, step: Step, own_m: Point) -> bool:
        """Whether the frame has arrived, and, on the pinned agent, this agent as well."""
        path = step.path
        if self.frame is None or path is None or not path.arrived(self.frame, self.radius_m):
            return False
        return not self.leads or math.hypot(*self.off_m(own_m)) < path.tolerance_m

    def _slot_m(self, agent: int) -> Point:
        unit = self._plan.unit_m
        return self._slots[agent][0] * unit, self._slots[agent][1] * unit

    def _believed(
        self, leader: AgentState, frame: Frame, step: Step, peers: PeerSnapshot, own_m: Point
    ) -> bool:
        """Whether the leader's frame is; `doubted` says why not."""
        feeds = step.path is not None and step.path.goes_on(frame, self.radius_m)
        age = peers.age_s(leader.agent)
        places = self._off_places(leader, frame, peers, own_m)
        feeds = feeds and age <= PREDICT_S
        why = self._bounds.doubt(frame, step, self.radius_m, peers.now_s, places, feeds=feeds)
        same = leader.gains_tag == self.law_tag
        self.doubted = (leader.agent, why) if why and same else None
        return not why

    def _off_places(
        self, leader: AgentState, frame: Frame, peers: PeerSnapshot, own_m: Point
    ) -> Places:
        """How far those that are heard are from their places in this frame."""
        if not self._slots:
            return Places(0.0, 0.0, 0.0)
        (north, east), off = frame.point_m, {}
        found = {s.agent: s.stop_point_m for s in peers.fresh() if s.airborne}
        for agent, at in {**found, leader.agent: leader.stop_point_m, self._own: own_m}.items():
            place = turned(self._slot_m(agent), frame.angle_rad, frame.scale)
            off[agent] = (at[0] - place[0] - north, at[1] - place[1] - east)
        worst = max(math.hypot(*by) for agent, by in off.items() if agent != self._own)
        return Places(worst, math.hypot(*off[leader.agent]), math.hypot(*mean_of(off.values())))

    def _leader(self, peers: PeerSnapshot, free: bool) -> AgentState | None:
        """The pinned agent's state; None if this agent is the pinned one."""
        for peer in peers.peers:
            s = peer.state
            if s is None or (free and peer.id > self._own):
                continue
            if peer.followed and s.airborne and s.phase is Phase.FLY:
                return s
        return None

    def _lead(self, peers: PeerSnapshot, step: Step, own_m: Point, error_m: float | None) -> None:
        if self.frame is None:
            self.frame = Frame(self._centre(peers, own_m))
        path, response = step.path, self._plan.response
        if step.follows is not None:
            stops = self._stops(peers)
            most = _TURNS * response.acceleration_mps2
            about = self.target, stops, most, self._plan.tick_s
            led = step.follows.led(self.frame, *about)
            if self._leaves_fence(led, _BRAKES * response.acceleration_mps2):
                led = step.follows.led(self.frame, None, *about[1:])
            self.frame = led
            return
        if path is None:
            self.frame = replace(self.frame, rate=0.0)
            return
        if (step.file is not None or self.hemmed) and error_m is not None:
            error_m = 0.0  # the shape is not flown: the frame goes ahead
        dt_s, brake = self._plan.tick_s, 0.5 * response.acceleration_mps2
        rate = rate_towards(self.frame, path, self.radius_m, error_m, brake, dt_s)
        self.frame = path.advanced(replace(self.frame, rate=rate), dt_s, self.radius_m)

    def _stops(self, peers: PeerSnapshot) -> Stops:
        """How far vehicles are behind their stop points, as they have answered in this flight."""
        told = [s.response_s for s in peers.fresh() if s.airborne and s.response_s > 0.0]
        response = self._plan.response
        dead_s = response.dead_time_s
        if told:
            dead_s = max(0.0, sum(told) / len(told) - response.lag_s)
        return Stops(
            dead_s, lambda speed: stop_distance(speed, response), response.lag_s, self._trim_m
        )

    def _leaves_fence(self, frame: Frame, most_mps2: float) -> bool:
        """A place would be outside of the fence before the frame could be braked."""
        fence = self._plan.fence
        if fence is None or not fence.polygon_m:
            return False
        velocity = complex(*frame.velocity_mps)
        rests = complex(*frame.point_m) + velocity * abs(velocity) / (2.0 * most_mps2)
        for agent in self._slots:
            place = rests + complex(*turned(self._slot_m(agent), frame.angle_rad, frame.scale))
            if not inside(fence.polygon_m, (place.real, place.imag)):
                return True
        return False

    def _centre(self, peers: PeerSnapshot, own_m: Point) -> Point:
        """The mean of stop point minus slot over this agent and the peers it hears."""
        found = {s.agent: s.stop_point_m for s in peers.fresh() if s.airborne} | {self._own: own_m}
        slots = {i: self._slot_m(i) for i in found}
        return mean_of((at[0] - slots[i][0], at[1] - slots[i][1]) for i, at in found.items())


_BESIDE_M: Final = 1.0
"""Of its way: what rounding, and a leader that changes, bring about; in a small formation `_SMALL`
of its radius, so that no shape is turned or shrunk by more."""
_SMALL: Final = 0.15
_FASTER: Final = 1.05
"""Than the step's speed: two clocks run at the same rate to much less."""
_PACE_S: Final = 0.5
"""Of the way at full speed: states are at most so late, and clocks are known better."""
_FORGETS_S: Final = 5.0
"""A rate that leads too far: on a busy machine a leader loses ticks, and its frame moves by whole
ticks. So a fifth of them may be lost for as long as a move takes."""
_BEHIND_S: Final = 2.0
"""A frame that is taken over may be so far behind: who comes back to a formation looks on for a
second (`takeover.LEARN_S`) before it leads, by words that are late."""
_LATE_S: Final = 10.0
"""A step begins so much later on one agent than on another, at most: a command reaches all in this
time, or none."""


class FrameBounds:
    """How far a leader's frame is believed: as far as its step, its age and the places allow.

    All agents of a formation take their frame from one of them. So what that one says of it is held
    against what each of them knows:

    - its way: from where the frame stood when the step began, along the step's own path, not beside
      it;
    - its pace: no faster along it than the step flies, and no slower than the rate that it tells;
    - after a target: no faster than the step flies;
    - at first, where the vehicles are: the leader near its place, or all of them near theirs.

    A frame that is not believed is not followed: the formation stands, and the leader is named.
    """

    def __init__(self) -> None:
        self._start: Frame | None = None
        """Where the frame stood when the step began; None: not known."""
        self._first_m: float | None = None
        """How far along the step's way the first frame was that was believed."""
        self._first_s = self._last_s = -math.inf
        self._pace_mps = 0.0
        """Of the step in which a frame was believed last."""
        self._ahead_m = 0.0
        """How far the rates that were told have of late led beyond the frames."""
        self._done_m, self._fed_s = 0.0, -math.inf
        """How far along its way the last frame was, and when."""
        self._led: tuple[Frame, float] | None = None
        """The last frame of a target that was believed, and when."""
        self._own: tuple[Frame, Frame, float] | None = None
        """The first and the last frame with which this agent led in the step, and when."""

    def begin(self, start: Frame | None) -> None:
        """A step begins, with the frame here."""
        self._start, self._first_m, self._ahead_m, self._led = start, None, 0.0, None
        self._own = None

    def lead(self, frame: Frame, now: float) -> None:
        """This agent leads, with the frame here: who leads after it goes on from there."""
        self._own = self._own[0] if self._own else self._start or frame, frame, now

    def doubt(
        self, frame: Frame, step: Step, radius_m: float, now: float, places: Places, *, feeds: bool
    ) -> str:
        """Why this frame is not believed, or ''.

        `radius_m` is the outermost place's distance from the centre at scale 1. `feeds`: the rate
        that it tells is flown now.
        """
        if step.follows is not None:
            return self._doubt_led(frame, step.frame_mps, radius_m, now)
        speed = step.frame_mps
        tolerance_m = step.settling.tolerance_m if step.settling else 0.0
        beside_m = min(_BESIDE_M, _SMALL * radius_m)
        if self._first_m is None:
            lag_m = self._pace_mps * min(_LATE_S, max(0.0, now - self._last_s) + _PACE_S)
            first_m = beside_m + lag_m
            why = self._doubt_first(frame, step, radius_m, tolerance_m, first_m, places)
            if why and (led := self._led_from(frame, step, radius_m, beside_m, now)):
                self._start, why = led, ""
            if why and places.worst_m > min(tolerance_m + JUMP_M, 2 * _SMALL * radius_m):
                return why
            if why or self._start is None:
                self._start = frame
            self._first_m, self._first_s = step.along(self._start, frame, radius_m)[0], now
            if not why:
                beside_m += lag_m
        start = self._start or frame
        done_m, off_m = step.along(start, frame, radius_m)
        if off_m > beside_m:
            if self._first_s != now:
                return _off(off_m, beside_m)
            self._start, self._first_m = frame, 0.0
            done_m = step.along(frame, frame, radius_m)[0]
        most_m = speed * (_FASTER * (now - self._first_s) + _PACE_S) + beside_m
        if done_m - self._first_m > most_m:
            gone = f"{done_m - self._first_m:.1f} m in {now - self._first_s:.1f} s"
            return f"its formation moved by {gone}; allowed: {most_m:.1f} m"
        self._feed(done_m, frame.rate * speed if feeds else 0.0, now)
        allowed_m = speed * 2 * _PACE_S + beside_m
        if self._ahead_m > allowed_m:
            behind = f"stays {self._ahead_m:.1f} m behind what its rate says"
            return f"its formation {behind}; allowed: {allowed_m:.1f} m"
        self._last_s, self._pace_mps = now, speed
        return ""

    def _doubt_led(self, frame: Frame, most_mps: float, radius_m: float, now: float) -> str:
        """Of a frame that a target leads: no plan knows its way, but its speed has a limit."""
        beside_m = min(_BESIDE_M, _SMALL * radius_m)
        # an agent that was held by an order comes back to a frame that has gone on without it
        began = self._start or frame, min(now - _LATE_S, self._last_s)
        last, since_s = self._led or began
        apart_m, turned_m, grown_m = strayed(last, frame, radius_m)
        if turned_m + grown_m > beside_m:
            return _off(turned_m + grown_m, beside_m)
        most_m = most_mps * (_FASTER * (now - since_s) + _PACE_S) + beside_m
        if apart_m > most_m:
            gone = f"{apart_m:.1f} m in {now - since_s:.1f} s"
            return f"its formation moved by {gone}; allowed: {most_m:.1f} m"
        speed = math.hypot(*frame.velocity_mps)
        if speed > _FASTER * most_mps:
            return f"its formation moves at {speed:.1f} m/s; allowed: {most_mps:g} m/s"
        self._led = frame, now
        self._last_s, self._pace_mps = now, most_mps
        return ""

    def _feed(self, done_m: float, speed_mps: float, now: float) -> None:
        """The frame is so far along its way, and its rate has been flown at this speed since the
        last one, believed or not."""
        if self._first_s == now:
            self._ahead_m = 0.0
        elif now > self._fed_s:
            passed_s = min(now - self._fed_s, _PACE_S)
            led_m = speed_mps * passed_s - (done_m - self._done_m)
            self._ahead_m = self._ahead_m * math.exp(-passed_s / _FORGETS_S) + led_m
        self._done_m, self._fed_s = done_m, now

    def _doubt_first(
        self,
        frame: Frame,
        step: Step,
        radius_m: float,
        tolerance_m: float,
        beside_m: float,
        places: Places,
    ) -> str:
        """Of the first frame in a step."""
        if self._start is None:
            start = Frame(frame.point_m, leg=frame.leg)
            _, off_m = step.along(start, frame, radius_m)
            off_m += max(0.0, places.centre_off_m - JUMP_M)
            return _off(off_m, beside_m) if off_m > beside_m else ""
        done_m, off_m = step.along(self._start, frame, radius_m)
        if off_m > beside_m:
            return _off(off_m, beside_m)
        near = places.leader_off_m <= tolerance_m + JUMP_M
        most_m = step.frame_mps * _LATE_S + beside_m
        if done_m <= most_m or near:
            return ""
        return f"its formation is {done_m:.1f} m on its way; allowed: {most_m:.1f} m"

    def _led_from(
        self, frame: Frame, step: Step, radius_m: float, beside_m: float, now: float
    ) -> Frame | None:
        """From where this agent led in the step, if the first frame of another leader goes on from
        its last one; None: it does not."""
        if self._own is None:
            return None
        start, last, led_s = self._own
        done_m, off_m = step.along(start, frame, radius_m)
        further_m = done_m - step.along(start, last, radius_m)[0]
        most_m = step.frame_mps * (_FASTER * (now - led_s) + _PACE_S) + beside_m
        least_m = -step.frame_mps * _BEHIND_S - beside_m
        goes_on = off_m <= beside_m and least_m <= further_m <= most_m
        return start if goes_on else None


class Places(NamedTuple):
    """How far vehicles are from their places in a frame [m]."""

    worst_m: float
    """The farthest peer that is heard."""
    leader_off_m: float
    centre_off_m: float
    """The centre, by all that are heard."""


def _off(off_m: float, allowed_m: float) -> str:
    return f"its formation is {off_m:.1f} m off its way; allowed: {allowed_m:.1f} m"
