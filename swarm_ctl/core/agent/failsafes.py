"""Every reason to break a mission off or to pause it, as rows of one table.

Each check is a pure function of one tick's situation and returns a trigger, or None. The weightiest
trigger decides; of equal ones the first in the table.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field, replace
from typing import Final

from swarm_ctl.core.agent.progress import Progress
from swarm_ctl.core.agent.tick import Tick
from swarm_ctl.core.model.causes import Cause, FailsafeAction
from swarm_ctl.core.model.messages import (
    AgentState,
    CommandKind,
    Outcome,
    Phase,
    ReturnStage,
    StepOutcome,
)
from swarm_ctl.core.model.plan import Plan, Point, Policy
from swarm_ctl.core.model.route import Routes
from swarm_ctl.core.model.rows import row
from swarm_ctl.core.model.steps.step import Step
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.core.model.timeouts import OWN_FIX_S, OWN_LOST_S
from swarm_ctl.core.model.vehicle import FALLS_MPS
from swarm_ctl.core.safety.fence import outside
from swarm_ctl.core.swarm.snapshot import OtherAircraft, PeerSnapshot


@dataclass(frozen=True, slots=True)
class FailsafeTrigger:
    """Why the mission cannot go on as it is, what the agent does, and how its run then ends. Two
    are equal by all but the sentence, whose figures change from tick to tick."""

    action: FailsafeAction
    outcome: Outcome
    reason: str = field(compare=False)
    step_outcome: StepOutcome = StepOutcome.ABORTED
    """How the step ends that the trigger breaks off."""
    cause: Cause = Cause.VEHICLE
    about: tuple[int, ...] = ()
    """The peers that are the cause."""


@row
class Situation:
    """One tick, as the checks see it."""

    tick: Tick
    plan: Plan
    progress: Progress
    had_control: bool
    """The vehicle has followed our setpoints in this flight."""
    was_armed: bool
    told_to_end: str
    ordered: CommandKind | None
    """`LAND`, `RETURN` or `KILL` once an operator has commanded it."""
    stop_point_m: Point
    height_m: float
    """Above the take-off point."""
    landing: bool
    """This agent is landing its vehicle: that it leaves the controlled mode is our own doing."""
    returning: bool
    """It is on its way back, where each agent flies for itself."""
    flown: bool
    """It was in the air in this flight."""
    departed: Mapping[int, str]
    """Why, by agent, of the peers that have left the formation (`Group`)."""
    accepted: AbstractSet[int]
    """Those of them that the operator has commanded to go on without."""
    routes: Routes
    awaited: PeerSnapshot
    """The peers that this agent waits for after its step ..."""
    waits_until: Mapping[int, int]
    """... and the number of the step that each of them has to be done with."""
    grounded: bool
    """It waits on the ground to be launched, or climbs alone to join the others."""
    fell: bool
    """It has just gone down as fast as only a fall does."""
    sunk_s: float
    """For how long it has been far below the height that it is to keep (`OwnVehicle`)."""
    found: bool = False
    """The agent has just started, and its vehicle is in the air, or may be: what the mission's
    policies say counts once it is taken over."""
    waits: str = ""
    """Why this agent waits, in its own words, or ''."""
    leads: Callable[[], int | None] = lambda: None
    """The peer whose told place the shape follows (`Group.leads`); asked outside the fence
    alone."""
    target_lost: Callable[[], str] = lambda: ""
    """The step's target was not heard for longer than the step waits for it; '' where it was."""
    estimate_doubt: str = ""
    """What the vehicle has been saying against its own estimate (`EstimateWatch`), or ''."""


Check = Callable[[Situation], FailsafeTrigger | None]

_PATIENCE_S: Final = 30.0
"""On the ground a silent peer costs only time, because no agent arms without it."""
_VEHICLE_LOST_S: Final = 5.0
"""No heartbeat (1 Hz) for this long: the figure of MAVProxy and Skybrush. The vehicle's own
failsafe stops it after 1 s."""
_LANDS_M: Final = 2.0
"""The word that a vehicle stands on the ground may come after the word that it is disarmed, and the
ground may be this much higher than the take-off point."""
_GOES_ON: Final = frozenset(Phase) - {Phase.YIELD, Phase.RETURN, Phase.LAND, Phase.ENDED}
"""A peer in one of these has not given up (`gave_up`)."""
SUNK_S: Final = 2.0
"""Longer than a position estimate that jumps takes to come back."""


def find(situation: Situation) -> FailsafeTrigger | None:
    """The weightiest trigger of the table, the first of those; None: all is well."""
    found = [
        replace(trigger, cause=cause)
        for check, cause in CHECKS.items()
        if (trigger := check(situation)) is not None
    ]
    return max(found, key=lambda trigger: trigger.action.rank, default=None)


def replaces(new: FailsafeTrigger | None, old: FailsafeTrigger | None, *, landing: bool) -> bool:
    """Does the new trigger take the place of the old one?

    A hold ends with its cause. A landing is final, but for a kill and a fall, and for a pilot who
    takes the vehicle while it still brakes.
    """
    if old is None or old.action is FailsafeAction.HOLD:
        return new != old
    if new is None or new.action.rank <= old.action.rank:
        return False
    if new.action in (FailsafeAction.KILL, FailsafeAction.FALL):
        return True
    braking = old.action is FailsafeAction.LAND and new.action is FailsafeAction.YIELD
    return (old.action is FailsafeAction.RETURN or braking) and not landing


def failed(
    action: FailsafeAction,
    reason: str,
    cause: Cause = Cause.VEHICLE,
    *,
    about: tuple[int, ...] = (),
) -> FailsafeTrigger:
    """A trigger after which the run counts as failed."""
    return FailsafeTrigger(action, Outcome.FAILED, reason, cause=cause, about=about)


def _by_policy(
    policy: Policy, reason: str, *, about: tuple[int, ...] = ()
) -> FailsafeTrigger | None:
    if policy is Policy.CONTINUE:
        return None
    return failed(FailsafeAction(policy.value), reason, about=about)


def _by_order(s: Situation) -> FailsafeTrigger | None:
    how = _ORDERED.get(s.ordered)
    if how is None:
        return None
    action, what = how
    return FailsafeTrigger(action, Outcome.ABORTED, f"{what} by the operator")


_ORDERED: Final[dict[CommandKind | None, tuple[FailsafeAction, str]]] = {
    CommandKind.LAND: (FailsafeAction.LAND, "landed"),
    CommandKind.RETURN: (FailsafeAction.RETURN, "called back"),
    CommandKind.KILL: (FailsafeAction.KILL, "killed"),
}


def _told_to_end(s: Situation) -> FailsafeTrigger | None:
    if not s.told_to_end:
        return None
    return FailsafeTrigger(FailsafeAction.LAND, Outcome.ABORTED, s.told_to_end)


def _vehicle_fault(s: Situation) -> FailsafeTrigger | None:
    return failed(FailsafeAction.LAND, s.tick.view.fault) if s.tick.view.fault else None


def _taken_over(s: Situation) -> FailsafeTrigger | None:
    view = s.tick.view
    if not s.had_control or view.controlled or s.landing:
        return None
    if s.progress.lands_in_place:
        return None
    what = f"switched to {view.mode}" if view.armed else "disarmed"
    return failed(FailsafeAction.YIELD, _by_other_hands(what))


def _disarmed(s: Situation) -> FailsafeTrigger | None:
    """Whatever its mode: a PX4 that was disarmed stays in OFFBOARD, or goes back to it."""
    view = s.tick.view
    if view.armed or not s.flown:
        return None
    lands = s.landing or s.progress.lands_in_place
    down = view.on_ground or (lands and s.height_m < _LANDS_M)
    if not down or s.fell:
        reason = f"the vehicle was disarmed in the air; now it is {s.height_m:.1f} m up"
        return failed(FailsafeAction.FALL, reason)
    return None if lands else failed(FailsafeAction.YIELD, _by_other_hands("disarmed"))


def _by_other_hands(what: str) -> str:
    return f"the vehicle was {what} by a pilot or by its own failsafe"


def _falls(s: Situation) -> FailsafeTrigger | None:
    """Both of the vehicle's position messages have to say so."""
    fix, told = s.tick.fix, s.tick.view.global_
    if not s.flown or fix is None or told is None or s.tick.now - told.time_s > OWN_FIX_S:
        return None
    down_mps = fix.velocity_ned_mps[2]
    if down_mps <= FALLS_MPS or told.velocity_ned_mps[2] <= 0.5 * FALLS_MPS:
        return None
    reason = f"the vehicle fell out of height: {down_mps:.1f} m/s down, {s.height_m:.1f} m up"
    return failed(FailsafeAction.LAND, reason)


def _sank(s: Situation) -> FailsafeTrigger | None:
    if s.sunk_s <= SUNK_S or s.landing or s.returning:
        return None
    if s.progress.goes_down:
        return None
    reason = f"the vehicle fell out of height: {s.height_m:.1f} m up for {SUNK_S:g} s and more"
    return failed(FailsafeAction.LAND, reason)


def _vehicle_silent(s: Situation) -> FailsafeTrigger | None:
    """While the agent listened: it waits for its vehicle's word after a stop of its own."""
    if not s.was_armed or s.tick.vehicle_silent_s <= _VEHICLE_LOST_S:
        return None
    reason = f"no heartbeat from the vehicle for {_VEHICLE_LOST_S:g} s"
    return failed(FailsafeAction.LAND, reason)


def _position_lost(s: Situation) -> FailsafeTrigger | None:
    if not s.was_armed or s.tick.position_silent_s <= OWN_LOST_S:
        return None
    return failed(FailsafeAction.LAND, f"no position from the vehicle for {OWN_LOST_S:g} s")


def _peers_gone(s: Situation) -> FailsafeTrigger | None:
    """Lost peers, and peers that gave up: the mission cannot be completed without them."""
    policy, after = s.plan.policies.agent_lost, s.plan.policies.agent_lost_after_s
    on_its_own = s.returning or s.ordered is CommandKind.RETURN
    if on_its_own or s.progress.goes_home or s.grounded or s.found:
        return None
    if s.progress.step == 0:
        after = max(after, _PATIENCE_S)
    for peer in s.awaited.peers:
        silent = peer.age_s > after and peer.silent_s > after  # no silence is longer than the age
        if not silent and peer.state is not None and peer.state.phase in _GOES_ON:
            continue
        steps = s.routes.of[peer.id].steps
        if peer.state is None or _completed(peer, steps) or peer.id in s.departed:
            continue  # never heard: the step's time-out bounds the wait
        reason = gave_up(peer, steps)
        if not reason and silent:
            ended = peer.state.phase is Phase.ENDED
            what = "broke the mission off" if ended else f"has not been heard for {after:g} s"
            reason = f"agent {peer.id} {what}"
        if not reason:
            continue
        if not s.was_armed:  # nothing flies yet that could hold
            own = f"; {_not_done(s)}" if s.waits and not s.progress.done else ""
            return failed(FailsafeAction.LAND, f"{reason}{own}", about=(peer.id,))
        if policy is not Policy.CONTINUE:
            return _by_policy(policy, reason, about=(peer.id,))
    return None


def _peers_departed(s: Situation) -> FailsafeTrigger | None:
    """An order to some agents: each of the others does as the mission says, whatever comes of
    those."""
    if not s.departed:
        return None
    policy = s.plan.policies.left_by_order
    new = {agent: why for agent, why in s.departed.items() if agent not in s.accepted}
    on_its_own = s.ordered is not None or s.progress.goes_down
    if policy is Policy.CONTINUE or on_its_own or not new:
        return None
    agent, why = next(iter(new.items()))
    reason = f"{why} (policies.left_by_order: {policy})"
    action = FailsafeAction(policy.value)
    return FailsafeTrigger(action, Outcome.ABORTED, reason, about=(agent,))


def _station_gone(s: Situation) -> FailsafeTrigger | None:
    policy, after = s.plan.policies.station_lost, s.plan.policies.station_lost_after_s
    if s.tick.station_silent_s <= after:
        return None  # a mission may fly without a station
    return _by_policy(policy, f"no ground station has been heard for {after:g} s")


def _step_timed_out(s: Situation) -> FailsafeTrigger | None:
    progress, step = s.progress, s.progress.current
    policy = step.on_timeout if step is not None else Policy.LAND
    if progress.finished or s.tick.now <= progress.timed_out_at:
        return None
    if policy is Policy.CONTINUE:
        if progress.done or step is None or step.climbs_to_m is None:
            return None
        policy = Policy.LAND  # it can't go on with a vehicle that is not up
    if s.returning and not progress.goes_home:
        return None  # the way back has its own bound
    seconds = progress.timed_out_at - progress.started_s - progress.paused_s
    step_name = f"step {progress.step} ({progress.results[-1].name})"
    reason = f"{step_name} timed out after {seconds:g} s: {_not_done(s)}"
    action = FailsafeAction(policy.value)
    return FailsafeTrigger(action, Outcome.FAILED, reason, StepOutcome.TIMEOUT)


def _not_done(s: Situation) -> str:
    """Which agents were not done with the step, and why, as far as this agent knows."""
    lacks = "not done" if s.progress.step else "not ready"
    if not s.progress.done:
        return f"{lacks}: {s.waits}" if s.waits else f"this agent was {lacks}"
    patience_s, waits = s.plan.policies.agent_lost_after_s, s.waits_until
    late, unheard = set[int](), set[int]()
    for peer in s.awaited.peers:
        steps = s.routes.of[peer.id].steps
        if peer.id in s.departed or _completed(peer, steps):
            continue
        if peer.state is None or peer.silent_s > patience_s:
            unheard.add(peer.id)
        elif progress_of(peer.state) < (waits[peer.id], True):
            late.add(peer.id)
    found = [f"{agents_named(late)} {lacks}"] if late else []
    found += [f"{agents_named(unheard)} not heard"] if unheard else []
    return ", ".join(found) or f"the others were {lacks}"


def _completed(peer: OtherAircraft, steps: Sequence[Step]) -> bool:
    return peer.state is not None and progress_of(peer.state) >= (len(steps), True)


def _beyond_fence(s: Situation) -> FailsafeTrigger | None:
    """The stop point counts: a vehicle that can no longer stop inside is as good as outside."""
    if not s.had_control or s.tick.newest_fix is None or s.progress.lands_in_place:
        return None
    reason = outside(s.plan.fence, s.stop_point_m, s.height_m)
    if not reason:
        return None
    leads = s.leads()
    drawn = "" if leads is None else f", drawn there by the place that agent {leads} tells"
    return _by_policy(s.plan.policies.fence, reason + drawn)


def _target_lost(s: Situation) -> FailsafeTrigger | None:
    step = s.progress.current
    follows = step.follows if step is not None and not s.progress.done else None
    if follows is None or follows.on_lost is Policy.HOLD:
        return None  # the formation stands
    reason = s.target_lost()
    return _by_policy(follows.on_lost, reason) if reason else None


def _battery_low(s: Situation) -> FailsafeTrigger | None:
    left, reserve = s.tick.view.battery_percent, s.plan.policies.battery_reserve_percent
    if not s.was_armed or left is None or left >= reserve:
        return None
    if s.progress.goes_down:
        return None
    reason = f"battery at {left:.0f} %, the reserve is {reserve:g} %"
    return _by_policy(s.plan.policies.battery_low, reason)


def _too_fast(s: Situation) -> FailsafeTrigger | None:
    fix = s.tick.newest_fix
    if not s.had_control or fix is None:
        return None
    policies, (north, east, _) = s.plan.policies, fix.velocity_ned_mps
    speed, tilt = math.hypot(north, east), s.tick.view.tilt_deg
    if speed > policies.max_speed_mps:
        reason = f"{speed:.1f} m/s fast; allowed: {policies.max_speed_mps:g} m/s"
        return _by_policy(policies.too_fast, reason)
    if tilt is not None and tilt > policies.max_tilt_deg:
        reason = f"leans {tilt:.0f} degrees; allowed: {policies.max_tilt_deg:g}"
        return _by_policy(policies.too_fast, reason)
    return None


def _estimate_in_doubt(s: Situation) -> FailsafeTrigger | None:
    """By the vehicle's own word. Its autopilot has a failsafe of its own, at looser limits."""
    if not s.had_control or s.landing or s.progress.lands_in_place:
        return None
    policy, doubt = s.plan.policies.estimate, s.estimate_doubt
    return _by_policy(policy, doubt) if doubt else None


def _too_windy(s: Situation) -> FailsafeTrigger | None:
    """By the vehicle's own estimate. PX4 has the same limit of its own (COM_WIND_MAX), off as
    delivered."""
    wind, policies = s.tick.view.wind_mps, s.plan.policies
    if not s.had_control or wind is None or wind <= policies.wind_limit_mps:
        return None
    reason = f"wind of {wind:.1f} m/s; allowed: {policies.wind_limit_mps:g} m/s"
    return _by_policy(policies.wind, reason)


CHECKS: Final[dict[Check, Cause]] = {
    _by_order: Cause.ORDER,
    _told_to_end: Cause.STARTER,
    _vehicle_fault: Cause.VEHICLE,
    _disarmed: Cause.PILOT,
    _taken_over: Cause.PILOT,
    _falls: Cause.FALL,
    _sank: Cause.FALL,
    _vehicle_silent: Cause.VEHICLE_LINK,
    _position_lost: Cause.POSITION,
    _too_fast: Cause.SPEED,
    _too_windy: Cause.WIND,
    _estimate_in_doubt: Cause.ESTIMATE,
    _beyond_fence: Cause.FENCE,
    _battery_low: Cause.BATTERY,
    _target_lost: Cause.TARGET,
    _peers_departed: Cause.ORDER,
    _peers_gone: Cause.PEER,
    _station_gone: Cause.STATION,
    _step_timed_out: Cause.TIMEOUT,
}
"""The table, and the cause that each row names."""


def progress_of(state: AgentState) -> tuple[int, bool]:
    """What the barrier compares, lexicographically."""
    return state.step, state.done


def left_by_order(state: AgentState) -> str:
    """How this peer has left the formation, or ''."""
    if state.left is CommandKind.GOTO:
        return f"agent {state.agent} was sent elsewhere by the operator"
    how = _ORDERED.get(state.left)
    return f"agent {state.agent} was {how[1]} by the operator" if how is not None else ""


def gave_up(peer: OtherAircraft, steps: Sequence[Step]) -> str:
    """Why this peer will not take part to the end, or '': it lands, yielded or ended early, by all
    of its states for a while."""
    state = peer.state
    if state is None or not peer.ends:
        return ""
    step = steps[min(state.step, len(steps)) - 1] if state.step > 0 else None
    going_down = step is not None and step.goes_down
    if state.phase is Phase.YIELD:
        return f"agent {state.agent} has lost its vehicle to a pilot or a failsafe"
    # A peer that is called back has not left before it flies: all agents hear the same command
    # within a second.
    back = state.phase is Phase.RETURN and state.stage >= ReturnStage.FLY
    if (back or state.phase in (Phase.LAND, Phase.ENDED)) and not going_down:
        return f"agent {state.agent} broke the mission off"
    return ""
