"""The flight that measures one vehicle: up, velocity steps out and back along north and east, down.
Pure.

An ordinary agent (`core/agent/agent.py`) flies it, alone in a plan of its own: take-off, hold,
land. So all that an agent refuses (an armed or unhealthy vehicle) and all that lands it (fence,
battery, speed, tilt, silence, time-outs, Ctrl-C) is the same here. While the agent holds, the steps
replace its horizontal setpoint; between them its own law brings it back to where it held.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

from swarm_ctl.core.agent.agent import Agent, Ended, Inbox
from swarm_ctl.core.identification.fit import Leg
from swarm_ctl.core.model.frames import ned_from_geodetic
from swarm_ctl.core.model.messages import Outcome, Phase
from swarm_ctl.core.model.plan import (
    EVERYONE,
    AgentPlan,
    Compensation,
    Fence,
    Geodetic,
    GroupPlan,
    LawParameters,
    Limits,
    Plan,
    Point,
    Policies,
    Response,
    Safety,
)
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.core.model.steps.hold import HoldStep
from swarm_ctl.core.model.steps.land import LandStep
from swarm_ctl.core.model.steps.takeoff import TakeoffStep
from swarm_ctl.core.model.vehicle import Contact, FlyGoal, Goal, LimitKind, StandbyGoal, VehicleView
from swarm_ctl.core.safety.fence import inside

WAYS: Final = {"north": (1.0, 0.0), "east": (0.0, 1.0)}
LONGEST_S: Final = 3.0
"""Length of the longest steps; ArduCopter reaches 90 % after 1.7 s."""
_STEPS: Final = ((1 / 3, LONGEST_S), (1.0, 0.7), (1.0, 1.5), (1.0, LONGEST_S))
"""Share of the speed, and its time out and back: small and large, settled and broken off while the
velocity rises, because jerk limits answer each differently."""
_REST_S: Final = 3.0
"""Zero velocity after each step."""
_BACK_S: Final = 3.0
"""The agent's own way back to the start, before each leg; then zero for `_STILL_S`."""
_STILL_S: Final = 2.0
_SPARE_S: Final = 1.5
"""The box is longer than the longest step by this time at full speed: the way that stopping
takes."""
_LOOK_S: Final = 1.0
_HEARD_S: Final = 15.0
"""Heartbeats come once a second: a vehicle that is silent for this long is not there."""
_LOOK_AT_MOST_S: Final = 120.0
"""A real ArduCopter is ready 42 s after its start."""
_CLEAR_M: Final = 10.0
_CLEAR_HEIGHT_M: Final = 5.0
"""No other aircraft may be nearer than this; the steps lead less far."""
_HEIGHT_SPARE_M: Final = 5.0
_TORN_S: Final = 0.5
"""A leg that lacks this much of its end was broken off."""
_GAP_S: Final = 0.25
"""The longest gap between setpoints: half of what an ArduCopter waits before it stops."""
_ID: Final = 1


@dataclass(frozen=True, slots=True)
class Steps:
    """What to fly, and where: at most `box_m` north, south, east and west of the start."""

    speed_mps: float = 3.0
    height_m: float = 10.0
    box_m: float = 13.5

    @property
    def least_box_m(self) -> float:
        """The smallest box that the steps fit in."""
        return self.speed_mps * (LONGEST_S + _SPARE_S)

    @property
    def duration_s(self) -> float:
        """Of all legs."""
        return sum(_BACK_S + _STILL_S + 2 * (hold_s + _REST_S) for _, hold_s in _STEPS) * len(WAYS)


class StepFlight:
    """One vehicle's flight: call `step` every `tick_s` and pursue its goal, until `ended` is set.

    Args:
        steps: what to fly.
        typical: the response that the agent's own way back uses.
        tick_s: between two calls.
        fence: a geofence that the box has to lie in, in metres from `origin`.
        origin: of the fence.
    """

    def __init__(
        self,
        steps: Steps,
        typical: Response,
        tick_s: float,
        fence: Fence | None = None,
        origin: Geodetic | None = None,
    ) -> None:
        self._steps, self._typical, self._tick_s = steps, typical, tick_s
        self._fence, self._origin = fence, origin
        self._began_s: float | None = None
        self._ready_s: float | None = None
        self._agent: Agent | None = None
        self._holding_s: float | None = None
        self._schedule = list(_schedule(steps.speed_mps))
        self._flown: dict[int, list[tuple[float, float, float, float]]] = {}
        self._stop = ""
        self.said: list[str] = []
        """What the flight has to say to the operator; the caller empties it."""
        self.ended: Ended | None = None

    @property
    def legs(self) -> list[Leg]:
        """The legs that were flown to their end, with a setpoint each tick."""
        found = []
        for k, part in enumerate(self._schedule):
            samples = self._flown.get(k, [])
            times = [sample[0] for sample in samples]
            if not part.leg or not samples or times[-1] - times[0] < part.seconds - _TORN_S:
                continue
            if all(later - sooner <= _GAP_S for sooner, later in itertools.pairwise(times)):
                found.append(Leg(part.way, part.kind, *zip(*samples, strict=True)))
        return found

    @property
    def missing(self) -> str:
        """Why there is too little to fit, or '': each kind of leg has to be there, in one direction
        at least."""
        legs = self.legs
        if {leg.kind for leg in legs} == {part.kind for part in self._schedule}:
            return ""
        all_legs = len(_STEPS) * len(WAYS)
        flown = f"{len(legs)} of {all_legs} legs were flown without a gap of {_GAP_S:g} s"
        return f"{flown}: is this machine too busy?"

    def step(self, now: float, view: VehicleView, stop: str = "") -> Goal:
        """One tick. `stop` says why to land now, for good."""
        self._stop = self._stop or stop
        self._began_s = now if self._began_s is None else self._began_s
        if self._agent is None:
            return self._look(now, view)
        self._stop = self._stop or _traffic(view)
        actions = self._agent.step(now, Inbox(view, told_to_end=self._stop))
        self.said += [event.text for event in actions.events]
        if actions.ended is not None:
            reason = (
                self._stop
                if actions.ended.outcome is Outcome.ABORTED and self._stop
                else actions.ended.reason
            )
            self.ended = replace(actions.ended, reason=reason)
        state, goal = actions.state, actions.goal
        if (
            state is None
            or state.step != _HOLD
            or state.phase is not Phase.FLY
            or not isinstance(goal, FlyGoal)
        ):
            return goal
        flown = self._hold(now, state.position_ned_m[:2], state.velocity_ned_mps[:2], goal)
        if flown is not goal:
            self._agent.flown_otherwise()
        return flown

    def _look(self, now: float, view: VehicleView) -> StandbyGoal:
        """Plan nothing before the vehicle is heard, ready, on the ground and disarmed."""
        waited = now - (self._began_s or now)
        if self._stop:
            self._refuse(Outcome.ABORTED, self._stop)
        elif view.fault:
            self._refuse(Outcome.FAILED, view.fault)
        elif view.armed or not view.on_ground:
            what = "is armed" if view.armed else "is in the air"
            self._refuse(Outcome.FAILED, f"the vehicle {what} already; land and disarm it first")
        elif not view.healthy or view.global_ is None or view.unread_limits:
            self._ready_s = None
            patience_s = _LOOK_AT_MOST_S if math.isfinite(view.heartbeat_s) else _HEARD_S
            if waited > patience_s:
                self._refuse(
                    Outcome.FAILED, f"not ready after {patience_s:g} s: {view.health_reason}"
                )
        elif self._ready_s is None:
            self._ready_s = now
        elif now - self._ready_s >= _LOOK_S:
            here = view.global_.position
            beyond = self._beyond(here)
            if beyond:
                self._refuse(Outcome.FAILED, beyond)
            else:
                typical = _within(self._typical, view)
                self._agent = Agent(_plan(self._steps, typical, self._tick_s, here), _ID, now)
        return StandbyGoal()

    def _refuse(self, outcome: Outcome, reason: str) -> None:
        self.ended = Ended(outcome, reason)

    def _beyond(self, here: Geodetic) -> str:
        """Why the box is not within the mission's geofence, or ''."""
        if self._fence is None or self._origin is None:
            return ""
        if self._steps.height_m > self._fence.height_m:
            top = f"the geofence, which ends at {self._fence.height_m:g} m"
            return f"{self._steps.height_m:g} m is above {top}"
        north, east, _ = ned_from_geodetic(here, self._origin)
        box, parts = self._steps.box_m, [k / 10 for k in range(-10, 11)]
        edge = [(box * a, box * b) for a in parts for b in parts if max(abs(a), abs(b)) == 1.0]
        if all(inside(self._fence.polygon_m, (north + n, east + e)) for n, e in edge):
            return ""
        return f"the box of {box:g} m around the vehicle is not all inside the mission's geofence"

    def _hold(self, now: float, position: Point, velocity: Point, goal: FlyGoal) -> FlyGoal:
        """The schedule's velocity instead of the hold's, and its record."""
        self._holding_s = now if self._holding_s is None else self._holding_s
        since = now - self._holding_s
        index = next((k for k, part in enumerate(self._schedule) if since < part.until_s), None)
        if index is None or (part := self._schedule[index]).command_mps is None:
            return goal
        (n, e), along = WAYS[part.way], part.at(since)
        if part.leg:
            if index not in self._flown:
                self.said.append(f"{part.way}, {part.kind}")
            sample = (
                now,
                along,
                n * position[0] + e * position[1],
                n * velocity[0] + e * velocity[1],
            )
            self._flown.setdefault(index, []).append(sample)
        return FlyGoal((along * n, along * e, goal.velocity_ned_mps[2]))


_HOLD: Final = 3
"""The plan's step that holds."""


@dataclass(frozen=True, slots=True)
class _Part:
    """A stretch of the schedule that ends at `until_s`; `command_mps` None: the agent's own way
    back."""

    way: str
    kind: str
    until_s: float
    seconds: float
    command_mps: float | None
    leg: bool
    hold_s: float = 0.0

    def at(self, since: float) -> float:
        """The command: out, rest, back, rest."""
        into = since - (self.until_s - self.seconds)
        if self.command_mps is None or not self.leg:
            return 0.0
        half = self.hold_s + _REST_S
        return math.copysign(self.command_mps, half - into) if into % half < self.hold_s else 0.0


def _schedule(speed_mps: float) -> Iterator[_Part]:
    end = 0.0
    for way in WAYS:
        for share, hold_s in _STEPS:
            kind = f"{share * speed_mps:.3g} m/s for {hold_s:g} s"
            for seconds, command, leg in (
                (_BACK_S, None, False),
                (_STILL_S, 0.0, False),
                (2 * (hold_s + _REST_S), share * speed_mps, True),
            ):
                end += seconds
                yield _Part(
                    way=way,
                    kind=kind,
                    until_s=end,
                    seconds=seconds,
                    command_mps=command,
                    leg=leg,
                    hold_s=hold_s,
                )


def _within(typical: Response, view: VehicleView) -> Response:
    """A vehicle that its parameters make slower than usual is measured, too."""
    found = (x.allowed for x in view.limits if x.kind is LimitKind.ACCELERATION)
    return replace(typical, acceleration_mps2=min(typical.acceleration_mps2, *found, math.inf))


def _traffic(view: VehicleView) -> str:
    """Why another aircraft is too near, or '': steps do not keep clear of it."""
    if view.global_ is None or view.on_ground:
        return ""
    for contact in view.contacts:
        north, east, down = ned_from_geodetic(contact.position, view.global_.position)
        if (
            math.hypot(north, east) < _CLEAR_M
            and abs(down) < _CLEAR_HEIGHT_M
            and _above_ground(contact, view)
        ):
            near = f"another aircraft is {math.hypot(north, east):.0f} m away"
            return f"{near}; allowed: {_CLEAR_M:g} m and more"
    return ""


def _above_ground(contact: Contact, view: VehicleView) -> bool:
    """The aircraft is not parked beside the start."""
    if view.global_ is None:
        return False
    ground_m = view.global_.position.alt_m - view.global_.relative_alt_m
    return contact.position.alt_m > ground_m + 2.0


def _plan(steps: Steps, typical: Response, tick_s: float, here: Geodetic) -> Plan:
    """Take-off, the agent's place, the steps, landing; around `here`."""
    box, spare_s = steps.box_m, 30.0
    up_s = spare_s + 3 * steps.height_m
    kappa = 1.0 / tick_s
    flown = (
        TakeoffStep(steps.height_m, up_s),
        FormStep("start", ((0.0, 0.0),), tolerance_m=1.0, settle_s=1.0, timeout_s=spare_s),
        HoldStep(steps.duration_s, steps.duration_s + spare_s),
        LandStep(spare_s + 3 * steps.height_m),
    )
    return Plan(
        name="measure",
        origin=here,
        unit_m=5.0,
        tick_s=tick_s,
        kappa=kappa,
        law=LawParameters(
            4.5, 0.3, 0.1, 1.0 / kappa
        ),  # parked vehicles below are no reason to make way
        compensation=Compensation.STOP_POINT,
        response=typical,
        limits=Limits(speed_mps=steps.speed_mps),
        policies=Policies(max_speed_mps=2 * steps.speed_mps),
        prepare_timeout_s=30.0,
        groups=(GroupPlan(EVERYONE, (AgentPlan(_ID, (0.0, 0.0), ()),), flown),),
        shapes=(),
        zones=(),
        fence=Fence(
            ((-box, -box), (box, -box), (box, box), (-box, box)), steps.height_m + _HEIGHT_SPARE_M
        ),
        safety=Safety(filter=False, guard=False, release=False, align=False),
    )
