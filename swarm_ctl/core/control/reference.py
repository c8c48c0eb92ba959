"""Where the formation as a whole is to be: one frame (centre, angle, scale) that all agents share.

The law keeps the shape and does not care where it stands. So one agent, the *pinned* one, advances
the frame along the step's path, tells it in its state, and holds its own place in it; the others
take the frame as told, fly its velocity (feed-forward) and let the law do the rest. The frame is a
point that was told, not a function of a clock: it does not matter when an agent enters a step, and
whoever is pinned next goes on from the frame it followed.

Pinned is the lowest id in the air that is heard and flies the formation. It slows the frame down
while the shape is out of tolerance, and stops it while anybody is unheard.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final, TypeAlias

from swarm_ctl.core.model.messages import AgentState, Frame, Phase
from swarm_ctl.core.model.plan import FormStep, MoveStep, Plan, Point, RotateStep, ScaleStep, Step
from swarm_ctl.core.model.timeouts import NEIGHBOUR_S, PREDICT_S
from swarm_ctl.core.swarm.peers import Peers

Moving: TypeAlias = MoveStep | RotateStep | ScaleStep
MOVING: Final = (MoveStep, RotateStep, ScaleStep)
_SLOW_SPAN_M: Final = 2.0
"""From the step's tolerance to this much more, the frame slows down to a stop."""
_CREEP: Final = 0.05
"""The frame ends a leg at this share of its speed: a square root profile alone would never
arrive."""
_ARRIVED_M: Final = 0.02


# --- the frame's arithmetic: pure functions ---


def centred(slots: Mapping[int, Point]) -> dict[int, Point]:
    """The slots with their mean at zero."""
    north = sum(slot[0] for slot in slots.values()) / len(slots)
    east = sum(slot[1] for slot in slots.values()) / len(slots)
    return {agent: (slot[0] - north, slot[1] - east) for agent, slot in slots.items()}


def turned(slot: Point, angle_rad: float, scale: float) -> Point:
    """A centred slot in a frame, clockwise from north to east."""
    c, s = math.cos(angle_rad) * scale, math.sin(angle_rad) * scale
    return c * slot[0] - s * slot[1], s * slot[0] + c * slot[1]


def slots_after(plan: Plan, step: int) -> tuple[Point, ...] | None:
    """The slots [units] that stand when step `step` (from 1) of the plan is done; None before the
    first form step."""
    slots: tuple[Point, ...] | None = None
    angle, scale = 0.0, 1.0
    for each in plan.steps[:step]:
        if isinstance(each, FormStep):
            slots, angle, scale = each.slots, 0.0, 1.0
        elif isinstance(each, RotateStep):
            angle = each.angle_rad
        elif isinstance(each, ScaleStep):
            scale = each.factor
    if slots is None or (angle, scale) == (0.0, 1.0):
        return slots
    return tuple(turned(slot, angle, scale) for slot in centred(dict(enumerate(slots))).values())


def left_m(frame: Frame, step: Moving, radius_m: float) -> float:
    """How far the outermost agent has to go on this leg [m]; 0 when there is none left. `radius_m`
    at scale 1."""
    if isinstance(step, RotateStep):
        return abs(step.angle_rad - frame.angle_rad) * radius_m * frame.scale
    if isinstance(step, ScaleStep):
        return abs(step.factor - frame.scale) * radius_m
    if frame.leg >= len(step.waypoints_m):
        return 0.0
    return math.dist(frame.point_m, step.waypoints_m[frame.leg])


def arrived(frame: Frame, step: Moving, radius_m: float) -> bool:
    """The frame is at the end of the step."""
    last = not isinstance(step, MoveStep) or frame.leg >= len(step.waypoints_m)
    return last and left_m(frame, step, radius_m) < _ARRIVED_M


def advanced(frame: Frame, step: Moving, dt_s: float, radius_m: float) -> Frame:
    """The frame `dt_s` later at its own rate; it never passes the end of its leg."""
    left = left_m(frame, step, radius_m)
    go = frame.rate * step.speed_mps * dt_s
    share = 1.0 if left <= max(go, _ARRIVED_M) else go / left
    if isinstance(step, RotateStep):
        return replace(
            frame, angle_rad=frame.angle_rad + share * (step.angle_rad - frame.angle_rad)
        )
    if isinstance(step, ScaleStep):
        return replace(frame, scale=frame.scale + share * (step.factor - frame.scale))
    if frame.leg >= len(step.waypoints_m):
        return frame
    (n, e), (to_n, to_e) = frame.point_m, step.waypoints_m[frame.leg]
    point = (n + share * (to_n - n), e + share * (to_e - e))
    return replace(frame, point_m=point, leg=frame.leg + (share == 1.0))


def velocity_mps(frame: Frame, step: Moving, slot: Point, radius_m: float) -> Point:
    """How fast the place of the centred `slot` (metres at scale 1) moves with the frame: the
    feed-forward."""
    left = left_m(frame, step, radius_m)
    if left < _ARRIVED_M or frame.rate == 0.0:
        return (0.0, 0.0)
    speed = frame.rate * step.speed_mps
    if isinstance(step, MoveStep):
        (n, e), (to_n, to_e) = frame.point_m, step.waypoints_m[frame.leg]
        return (to_n - n) / left * speed, (to_e - e) / left * speed
    place = turned(slot, frame.angle_rad, frame.scale)
    if isinstance(step, RotateStep):
        turn = math.copysign(speed / (radius_m * frame.scale), step.angle_rad - frame.angle_rad)
        return -place[1] * turn, place[0] * turn
    grow = math.copysign(speed / (radius_m * frame.scale), step.factor - frame.scale)
    return place[0] * grow, place[1] * grow


def rate_towards(
    frame: Frame,
    step: Moving,
    radius_m: float,
    error_m: float | None,
    acceleration_mps2: float,
    dt_s: float,
) -> float:
    """The rate for the next tick: as fast as the shape's error and the end of the leg allow,
    without a jump."""
    # unheard is worse than out of shape: stop
    wanted = (
        0.0
        if error_m is None
        else max(0.0, min(1.0, 1.0 - (error_m - step.tolerance_m) / _SLOW_SPAN_M))
    )
    stopping = math.sqrt(2 * acceleration_mps2 * left_m(frame, step, radius_m)) / step.speed_mps
    jump = acceleration_mps2 * dt_s / step.speed_mps
    return max(0.0, min(wanted, max(stopping, _CREEP), frame.rate + jump))


# --- who leads, and what an agent makes of it ---


class Reference:
    """One agent's view of the frame, tick by tick."""

    def __init__(self, plan: Plan, own_id: int, peers: Peers) -> None:
        self._plan = plan
        self._own = own_id
        self._peers = peers
        self._places: list[Point] = []
        """The newest shape's slots, centred, in the plan's order."""
        self._roles: Mapping[int, int] | None = None
        self._slots: dict[int, Point] = {}
        self.radius_m = 0.0
        self.frame: Frame | None = None
        self.pinned = own_id

    @property
    def leads(self) -> bool:
        """This agent is the pinned one."""
        return self.pinned == self._own

    @property
    def slots(self) -> dict[int, Point]:
        """The shape now, by agent [units]; empty before the first form step."""
        frame = self.frame
        if frame is None or (frame.angle_rad, frame.scale) == (0.0, 1.0):
            return self._slots
        return {
            agent: turned(slot, frame.angle_rad, frame.scale) for agent, slot in self._slots.items()
        }

    def form(self, slots: Sequence[Point], roles: Mapping[int, int] | None = None) -> None:
        """A form step begins: the law alone decides where the shape will stand.

        `roles` say which of the slots is whose; None: the k-th is that of the plan's k-th agent,
        whatever is exchanged.
        """
        self._places = list(centred(dict(enumerate(slots))).values())
        self.radius_m = max(math.hypot(*slot) for slot in self._places) * self._plan.unit_m
        self.frame = None
        self._roles = roles
        self._give_out()

    def assign(self, roles: Mapping[int, int]) -> None:
        """Who has which role now. A shape that knows no roles stays as it is."""
        if self._roles is not None and roles is not self._roles:
            self._roles = roles
            self._give_out()

    def _give_out(self) -> None:
        ids = [agent.id for agent in self._plan.agents]
        roles = self._roles or {agent: place for place, agent in enumerate(ids)}
        self._slots = {agent: self._places[roles[agent]] for agent in ids}

    def begin(self, leg: int = 0) -> None:
        """Another step begins: from where the frame is."""
        if self.frame is not None:
            self.frame = replace(self.frame, leg=leg, rate=0.0)

    def follow(
        self,
        now: float,
        step: Step,
        key: tuple[int, int],
        own_m: Point,
        error_m: float | None,
        *,
        free: bool,
    ) -> None:
        """One tick of a step that keeps the formation. `key`: what a leader has to be at (step,
        command) to be heard.

        `own_m` is the own stop point. `free`: this agent may lead (it is not held back by
        anything).
        """
        leader = self._leader(now, free)
        self.pinned = leader.agent if leader is not None else self._own
        if leader is None:
            self._lead(now, step, own_m, error_m)
        elif (leader.step, leader.command) == key and leader.frame is not None:
            age = self._peers.age(leader.agent, now)
            told = replace(leader.frame, rate=leader.frame.rate if age <= PREDICT_S else 0.0)
            self.frame = (
                advanced(told, step, age, self.radius_m) if isinstance(step, MOVING) else told
            )
        elif self.frame is not None:
            self.frame = replace(self.frame, rate=0.0)

    def feed_forward(self, step: Step, own_m: Point, gain: float) -> Point:
        """What is flown on top of the law [m/s]: the frame's velocity, and for the pinned agent its
        way to its place.

        `gain` [1/s] is the law's own, kappa * h: the place in the frame weighs as much as the
        neighbours together.
        """
        if self.frame is None or not self._slots:
            return (0.0, 0.0)
        north = east = 0.0
        if isinstance(step, MOVING):
            north, east = velocity_mps(self.frame, step, self._slot_m(self._own), self.radius_m)
        if self.leads:
            off = self.off_m(own_m)
            north, east = north + gain * off[0], east + gain * off[1]
        return north, east

    def common_mps(self, step: Step) -> Point:
        """What everybody's feed-forward has in common: the whole frame's velocity where it moves
        along a way."""
        if self.frame is None or not isinstance(step, MoveStep):
            return (0.0, 0.0)
        return velocity_mps(self.frame, step, (0.0, 0.0), self.radius_m)

    def off_m(self, own_m: Point) -> Point:
        """From the own point to the own place in the frame [m]."""
        if self.frame is None:
            return (0.0, 0.0)
        place = turned(self._slot_m(self._own), self.frame.angle_rad, self.frame.scale)
        return self.frame.point_m[0] + place[0] - own_m[0], self.frame.point_m[1] + place[
            1
        ] - own_m[1]

    def there(self, step: Step, own_m: Point) -> bool:
        """The frame has arrived, and the pinned agent with it."""
        if (
            self.frame is None
            or not isinstance(step, MOVING)
            or not arrived(self.frame, step, self.radius_m)
        ):
            return False
        return not self.leads or math.hypot(*self.off_m(own_m)) < step.tolerance_m

    def _slot_m(self, agent: int) -> Point:
        unit = self._plan.unit_m
        return self._slots[agent][0] * unit, self._slots[agent][1] * unit

    def _leader(self, now: float, free: bool) -> AgentState | None:
        """The pinned agent's state; None: it is this one."""
        for peer in self._peers:
            s = peer.state
            if s is None or (free and peer.id > self._own):
                continue
            if peer.age(now) <= NEIGHBOUR_S and s.airborne and s.phase is Phase.FLY:
                return s
        return None

    def _lead(self, now: float, step: Step, own_m: Point, error_m: float | None) -> None:
        if self.frame is None:
            self.frame = Frame(self._centre(now, own_m))
        if not isinstance(step, MOVING):
            self.frame = replace(self.frame, rate=0.0)
            return
        dt_s, brake = self._plan.tick_s, 0.5 * self._plan.response.acceleration_mps2
        rate = rate_towards(self.frame, step, self.radius_m, error_m, brake, dt_s)
        self.frame = advanced(replace(self.frame, rate=rate), step, dt_s, self.radius_m)

    def _centre(self, now: float, own_m: Point) -> Point:
        """Where the formation stands: the mean of point minus slot over everybody who is heard."""
        found = {s.agent: s.stop_point_m for s in self._peers.fresh(now) if s.airborne} | {
            self._own: own_m
        }
        gaps = [(at[0] - self._slot_m(i)[0], at[1] - self._slot_m(i)[1]) for i, at in found.items()]
        return sum(gap[0] for gap in gaps) / len(gaps), sum(gap[1] for gap in gaps) / len(gaps)
