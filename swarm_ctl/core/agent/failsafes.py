"""What forbids going on: every reason to break a mission off or to pause it, as rows of one table.

Each check is a pure function of one tick's situation and returns why, or None. The first row that
answers decides.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from swarm_ctl.core.agent.progress import Progress
from swarm_ctl.core.agent.return_to_launch import Stage
from swarm_ctl.core.control.navigation import OwnFix
from swarm_ctl.core.model.messages import AgentState, Phase
from swarm_ctl.core.model.plan import LandStep, Plan, Point, Policy, ReturnStep
from swarm_ctl.core.model.timeouts import OWN_LOST_S
from swarm_ctl.core.model.vehicle import VehicleView
from swarm_ctl.core.safety.fence import outside
from swarm_ctl.core.swarm.peers import Peers


@dataclass(frozen=True, slots=True)
class Situation:
    """One tick, as the checks see it."""

    now: float
    plan: Plan
    view: VehicleView
    fix: OwnFix | None
    peers: Peers
    progress: Progress
    station_s: float | None
    """When a station was last heard; None: never (a mission may fly without one)."""
    had_control: bool
    """The vehicle has followed our setpoints in this flight."""
    was_armed: bool
    lifeline_cut: bool
    operator_wants: str
    """`land`, `return`, `kill`, or ''."""
    stop_point_m: Point
    height_m: float
    """Above the take-off point."""
    landing: bool
    """This agent is landing its vehicle: leaving the controlled mode is its own doing."""
    returning: bool
    """It is on its way back: each for itself then, in turn."""


@dataclass(frozen=True, slots=True)
class FailsafeTrigger:
    """Why the mission can't go on as it is, what is done (a key of `RANK`), and how the run is then
    called."""

    action: str
    outcome: str
    reason: str


Check = Callable[[Situation], FailsafeTrigger | None]

_PATIENCE_S: Final = 30.0
"""On the ground a silent peer costs nothing but time: nobody arms without it, so it may take a
while to come back."""
_VEHICLE_LOST_S: Final = 5.0
"""No heartbeat (1 Hz) for this long: MAVProxy's and Skybrush's figure. Its own failsafe stops it
after 1 s."""


RANK: Final = {"hold": 0, "return": 1, "land": 2, "leave": 3, "yield": 3, "kill": 4}
"""What can be done, and what outweighs what."""


def find(situation: Situation) -> FailsafeTrigger | None:
    """The weightiest finding of the table, the first of those; None: all is well."""
    found = [finding for check in CHECKS if (finding := check(situation)) is not None]
    return max(found, key=lambda finding: RANK[finding.action], default=None)


def replaces(new: FailsafeTrigger | None, old: FailsafeTrigger | None, *, landing: bool) -> bool:
    """What is being done gives way to the new finding. A pause ends with its cause; landing is
    final but for a kill."""
    if old is None or old.action == "hold":
        return new != old
    if new is None or RANK[new.action] <= RANK[old.action]:
        return False
    return new.action == "kill" or (old.action == "return" and not landing)


def _operator(s: Situation) -> FailsafeTrigger | None:
    how = {"land": "landed", "return": "called back", "kill": "killed"}.get(s.operator_wants)
    return FailsafeTrigger(s.operator_wants, "aborted", f"{how} by the operator") if how else None


def _lifeline(s: Situation) -> FailsafeTrigger | None:
    return (
        FailsafeTrigger("land", "aborted", "the process that started this agent is gone")
        if s.lifeline_cut
        else None
    )


def _vehicle_fault(s: Situation) -> FailsafeTrigger | None:
    return FailsafeTrigger("land", "failed", s.view.fault) if s.view.fault else None


def _taken_over(s: Situation) -> FailsafeTrigger | None:
    if (
        not s.had_control
        or s.view.controlled
        or s.landing
        or isinstance(s.progress.current, LandStep)
    ):
        return None
    what = f"switched to {s.view.mode}" if s.view.armed else "disarmed"
    return FailsafeTrigger(
        "yield", "failed", f"the vehicle was {what} by somebody else (a pilot, or its own failsafe)"
    )


def _vehicle_silent(s: Situation) -> FailsafeTrigger | None:
    if not s.was_armed or s.now - s.view.heartbeat_s <= _VEHICLE_LOST_S:
        return None
    return FailsafeTrigger(
        "land", "failed", f"no heartbeat from the vehicle for {_VEHICLE_LOST_S:g} s"
    )


def _position_lost(s: Situation) -> FailsafeTrigger | None:
    if not s.was_armed or (s.fix is not None and s.fix.age_s <= OWN_LOST_S):
        return None
    return FailsafeTrigger("land", "failed", f"no position from the vehicle for {OWN_LOST_S:g} s")


def _peers_gone(s: Situation) -> FailsafeTrigger | None:
    """Lost peers, and peers that gave up: the mission can't be completed without them."""
    policy, after = s.plan.policies.agent_lost, s.plan.policies.agent_lost_after_s
    if s.returning or s.operator_wants == "return" or isinstance(s.progress.current, ReturnStep):
        return None
    if s.progress.step == 0:
        after = max(after, _PATIENCE_S)
    for peer in s.peers:
        if peer.state is None or progress_of(peer.state) >= (len(s.plan.steps), True):
            continue  # never heard: the step's time-out bounds the wait; or it has landed at its end
        reason = gave_up(peer.state, s.plan)
        if not reason and peer.age(s.now) > after:
            reason = f"agent {peer.id} has not been heard for {after:g} s"
        # before anything flies there is nothing to hold: any loss ends the mission
        if reason and (policy is not Policy.CONTINUE or not s.was_armed):
            return FailsafeTrigger(policy.value if s.was_armed else "land", "failed", reason)
    return None


def _station_gone(s: Situation) -> FailsafeTrigger | None:
    policy, after = s.plan.policies.station_lost, s.plan.policies.station_lost_after_s
    if s.station_s is None or s.now - s.station_s <= after:
        return None
    return _by_policy(policy, f"no ground station has been heard for {after:g} s")


def _too_slow(s: Situation) -> FailsafeTrigger | None:
    step = s.progress.current
    policy = step.on_timeout if step is not None else Policy.LAND
    if s.progress.finished or s.now <= s.progress.timed_out_at or policy is Policy.CONTINUE:
        return None
    if s.returning and not isinstance(step, ReturnStep):
        return None  # the way back has its own bound
    seconds = s.progress.timed_out_at - s.progress.started_s - s.progress.paused_s
    what = "the others were not" if s.progress.done else "this agent was not"
    name = s.progress.results[-1].name
    return _by_policy(
        policy, f"step {s.progress.step} ({name}) timed out after {seconds:g} s: {what} done"
    )


def _beyond_fence(s: Situation) -> FailsafeTrigger | None:
    """The stop point counts: a vehicle that can no longer stop inside is as good as outside."""
    if not s.had_control or s.fix is None or isinstance(s.progress.current, LandStep):
        return None
    reason = outside(s.plan.fence, s.stop_point_m, s.height_m)
    return _by_policy(s.plan.policies.fence, reason) if reason else None


def _battery_low(s: Situation) -> FailsafeTrigger | None:
    left, reserve = s.view.battery_percent, s.plan.policies.battery_reserve_percent
    if (
        not s.was_armed
        or left is None
        or left >= reserve
        or isinstance(s.progress.current, LandStep | ReturnStep)
    ):
        return None
    return _by_policy(
        s.plan.policies.battery_low, f"battery at {left:.0f} %, the reserve is {reserve:g} %"
    )


def _too_fast(s: Situation) -> FailsafeTrigger | None:
    if not s.had_control or s.fix is None:
        return None
    policies, (north, east, _) = s.plan.policies, s.fix.velocity_ned_mps
    speed, tilt = math.hypot(north, east), s.view.tilt_deg
    if speed > policies.max_speed_mps:
        return _by_policy(
            policies.too_fast, f"{speed:.1f} m/s fast; allowed: {policies.max_speed_mps:g} m/s"
        )
    if tilt is not None and tilt > policies.max_tilt_deg:
        return _by_policy(
            policies.too_fast, f"leans {tilt:.0f} degrees; allowed: {policies.max_tilt_deg:g}"
        )
    return None


def _too_windy(s: Situation) -> FailsafeTrigger | None:
    """By the vehicle's own estimate. PX4 has the same limit of its own (COM_WIND_MAX), off as
    delivered."""
    wind, policies = s.view.wind_mps, s.plan.policies
    if not s.had_control or wind is None or wind <= policies.wind_limit_mps:
        return None
    return _by_policy(
        policies.wind, f"wind of {wind:.1f} m/s; allowed: {policies.wind_limit_mps:g} m/s"
    )


def _by_policy(policy: Policy, reason: str) -> FailsafeTrigger | None:
    return None if policy is Policy.CONTINUE else FailsafeTrigger(policy.value, "failed", reason)


CHECKS: Final[tuple[Check, ...]] = (
    _operator,
    _lifeline,
    _vehicle_fault,
    _taken_over,
    _vehicle_silent,
    _position_lost,
    _too_fast,
    _too_windy,
    _beyond_fence,
    _battery_low,
    _peers_gone,
    _station_gone,
    _too_slow,
)


def progress_of(state: AgentState) -> tuple[int, bool]:
    """What the barrier compares, lexicographically."""
    return state.step, state.done


def gave_up(state: AgentState, plan: Plan) -> str:
    """Why this peer will not take part to the end, or '': it lands, yielded or ended before its
    time."""
    step = plan.steps[min(state.step, len(plan.steps)) - 1] if state.step > 0 else None
    going_down = isinstance(step, LandStep | ReturnStep)
    if state.phase is Phase.YIELD:
        return f"agent {state.agent} has lost its vehicle to a pilot or a failsafe"
    # one that is called back has not left before it flies: the others hear the same command within
    # a second
    left = state.phase in (Phase.LAND, Phase.ENDED) or (
        state.phase is Phase.RETURN and state.stage >= Stage.FLY
    )
    if left and not going_down:
        return f"agent {state.agent} broke the mission off"
    return ""
