"""What forbids going on: every reason to break a mission off or to pause it, as rows of one table.

Each check is a pure function of one tick's situation and returns why, or None. The first row that answers decides.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from swarm_ctl.core.freshness import OWN_LOST_S
from swarm_ctl.core.navigation import OwnFix
from swarm_ctl.core.peers import Peers
from swarm_ctl.core.plan import LandStep, Plan, Policy
from swarm_ctl.core.progress import Progress
from swarm_ctl.core.state import AgentState, Phase
from swarm_ctl.core.vehicle import VehicleView


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
    land_command: str
    """Why an operator wants it down, or ''."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Why the mission can't go on as it is, what is done (`land`, `hold`, `yield`), and how the run is then called."""

    action: str
    outcome: str
    reason: str


Check = Callable[[Situation], Finding | None]

_PATIENCE_S: Final = 30.0
"""On the ground a silent peer costs nothing but time: nobody arms without it, so it may take a while to come back."""
_VEHICLE_LOST_S: Final = 5.0
"""No heartbeat (1 Hz) for this long: MAVProxy's and Skybrush's figure. Its own failsafe stops it after 1 s."""


def find(situation: Situation) -> Finding | None:
    """The first finding of the table, or None: all is well."""
    for check in CHECKS:
        finding = check(situation)
        if finding is not None:
            return finding
    return None


def _operator(s: Situation) -> Finding | None:
    return Finding("land", "aborted", s.land_command) if s.land_command else None


def _lifeline(s: Situation) -> Finding | None:
    return Finding("land", "aborted", "the process that started this agent is gone") if s.lifeline_cut else None


def _vehicle_fault(s: Situation) -> Finding | None:
    return Finding("land", "failed", s.view.fault) if s.view.fault else None


def _taken_over(s: Situation) -> Finding | None:
    landing = isinstance(s.progress.current, LandStep)
    if not s.had_control or s.view.controlled or landing:
        return None
    what = f"switched to {s.view.mode}" if s.view.armed else "disarmed"
    return Finding("yield", "failed", f"the vehicle was {what} by somebody else (a pilot, or its own failsafe)")


def _vehicle_silent(s: Situation) -> Finding | None:
    if not s.was_armed or s.now - s.view.heartbeat_s <= _VEHICLE_LOST_S:
        return None
    return Finding("land", "failed", f"no heartbeat from the vehicle for {_VEHICLE_LOST_S:g} s")


def _position_lost(s: Situation) -> Finding | None:
    if not s.was_armed or (s.fix is not None and s.fix.age_s <= OWN_LOST_S):
        return None
    return Finding("land", "failed", f"no position from the vehicle for {OWN_LOST_S:g} s")


def _peers_gone(s: Situation) -> Finding | None:
    """Lost peers, and peers that gave up: the mission can't be completed without them."""
    policy, after = s.plan.policies.agent_lost, s.plan.policies.agent_lost_after_s
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
            return Finding("hold" if policy is Policy.HOLD and s.was_armed else "land", "failed", reason)
    return None


def _station_gone(s: Situation) -> Finding | None:
    policy, after = s.plan.policies.station_lost, s.plan.policies.station_lost_after_s
    if s.station_s is None or s.now - s.station_s <= after or policy is Policy.CONTINUE:
        return None
    return Finding(policy.value, "failed", f"no ground station has been heard for {after:g} s")


def _too_slow(s: Situation) -> Finding | None:
    if s.progress.finished or s.now <= s.progress.timed_out_at:
        return None
    seconds = s.progress.timed_out_at - s.progress.started_s
    what = "the others were not" if s.progress.done else "this agent was not"
    name = s.progress.results[-1].name
    return Finding("land", "failed", f"step {s.progress.step} ({name}) timed out after {seconds:g} s: {what} done")


CHECKS: Final[tuple[Check, ...]] = (
    _operator,
    _lifeline,
    _vehicle_fault,
    _taken_over,
    _vehicle_silent,
    _position_lost,
    _peers_gone,
    _station_gone,
    _too_slow,
)


def progress_of(state: AgentState) -> tuple[int, bool]:
    """What the barrier compares, lexicographically."""
    return state.step, state.done


def gave_up(state: AgentState, plan: Plan) -> str:
    """Why this peer will not take part to the end, or '': it lands, yielded or ended before its time."""
    on_land_step = state.step > 0 and isinstance(plan.steps[min(state.step, len(plan.steps)) - 1], LandStep)
    if state.phase is Phase.YIELD:
        return f"agent {state.agent} has lost its vehicle to a pilot or a failsafe"
    if state.phase in (Phase.LAND, Phase.ENDED) and not on_land_step:
        return f"agent {state.agent} broke the mission off"
    return ""
