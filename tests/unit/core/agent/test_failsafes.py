"""The failsafes: for each check of the table a row that fires it, one just inside its limit, and
one for each exception; then what outweighs and replaces what."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.agent.failsafes import (
    CHECKS,
    FailsafeTrigger,
    Situation,
    failed,
    find,
    left_by_order,
    replaces,
)
from swarm_ctl.core.model.causes import Cause, FailsafeAction
from swarm_ctl.core.model.messages import CommandKind, Outcome, Phase, ReturnStage, StepOutcome
from swarm_ctl.core.model.plan import Fence, Plan, Policies, Policy
from swarm_ctl.core.model.route import Routes
from swarm_ctl.core.model.steps.follow import FollowStep
from swarm_ctl.core.model.steps.land import LandStep
from swarm_ctl.core.model.steps.return_ import ReturnStep
from swarm_ctl.core.model.steps.takeoff import TakeoffStep
from swarm_ctl.core.model.vehicle import GlobalFix
from tests.unit.core.builders import (
    HOLD,
    LAST,
    NOW,
    ORIGIN,
    PARKED,
    RETURNING,
    Own,
    fix,
    peer,
    plan,
    progress,
    state,
    tick,
)

INFINITE = float("inf")
FENCE = Fence(((-10.0, -10.0), (10.0, -10.0), (10.0, 10.0), (-10.0, 10.0)), 20.0)
FENCED = plan(fence=FENCE)
UP_OR_ON = plan(steps=(TakeoffStep(10.0, 60.0, Policy.CONTINUE), LandStep(60.0)))
LEFT = {3: "agent 3 was landed by the operator"}


def policies(**named: Any) -> Plan:
    """The plan with these policies."""
    return plan(policies=Policies(**named), fence=FENCE)


def situation(
    *peers: Any, of: Plan | None = None, step: int = HOLD, done: bool = False, **changes: Any
) -> Situation:
    """All is well in the hold step, but for `changes`: of the tick (`seen`) and the situation."""
    of = of or plan()
    heard = tick(*peers, **changes.pop("seen", {}))
    made = Situation(
        heard,
        of,
        progress(of, step, done=done),
        had_control=True,
        was_armed=True,
        told_to_end="",
        ordered=None,
        stop_point_m=(0.0, 0.0),
        height_m=8.0,
        landing=False,
        returning=False,
        flown=True,
        departed={},
        accepted=frozenset(),
        grounded=False,
        routes=Routes(of),
        awaited=heard.peers,
        waits_until=dict.fromkeys(of.groups[0].ids, step),
        fell=False,
        sunk_s=0.0,
    )
    return replace(made, **changes)


def on_the_ground(*peers: Any, **changes: Any) -> Situation:
    """The same in preparation, the vehicle disarmed."""
    told = {"seen": PARKED | changes.pop("seen", {}), "was_armed": False, "had_control": False}
    told["flown"] = False
    return situation(*peers, step=0, **(told | changes))


@dataclass(frozen=True)
class Row:
    """A situation, and the trigger it fires: action and words of its reason. None: no trigger."""

    what: str
    make: Callable[[], Situation]
    action: FailsafeAction | None = None
    reason: str = ""
    outcome: Outcome = Outcome.FAILED
    step_outcome: StepOutcome = field(default=StepOutcome.ABORTED)


def seen(**values: Any) -> Callable[[], Situation]:
    """Something in the tick differs."""
    return lambda: situation(seen=values)


def case(*peers: Any, **changes: Any) -> Callable[[], Situation]:
    """Something in the situation differs."""
    return lambda: situation(*peers, **changes)


def moving(*velocity: float, **changes: Any) -> Callable[[], Situation]:
    north, east, down = velocity
    return case(seen={"fix": fix(velocity=(north, east, down))}, **changes)


LOST: Final = "target boat has not been heard for 10 s"


def following(on_lost: Policy, lost: str) -> Situation:
    """In a step that follows a target."""
    step = FollowStep(
        "boat",
        (0.0, 0.0),
        in_course=False,
        speed_mps=2.0,
        duration_s=60.0,
        timeout_s=90.0,
        on_lost=on_lost,
    )
    of = plan()
    (group,) = of.groups
    steps = (*group.steps[: HOLD - 1], step, *group.steps[HOLD:])
    return situation(
        of=replace(of, groups=(replace(group, steps=steps),)), target_lost=lambda: lost
    )


def falling(local_mps: float, global_mps: float, age_s: float = 0.1, **changes: Any) -> Any:
    """Down, by LOCAL_POSITION_NED and by GLOBAL_POSITION_INT."""
    told = GlobalFix(NOW - age_s, ORIGIN, 8.0, (0.0, 0.0, global_mps))
    down = {"fix": fix(velocity=(0.0, 0.0, local_mps)), "global_": told}
    return case(seen=down, **changes)


FALLS = FailsafeAction.FALL
HOLDS, RETURNS, LANDS = FailsafeAction.HOLD, FailsafeAction.RETURN, FailsafeAction.LAND
YIELDS, KILLS = FailsafeAction.YIELD, FailsafeAction.KILL
OURS = Outcome.ABORTED
TIMEOUT = StepOutcome.TIMEOUT
OVER = NOW + 50.0 + 0.01
"""The hold step began 10 s before NOW and may take 60 s."""

WAITS_TO_RETURN = peer(2, phase=Phase.RETURN, stage=int(ReturnStage.WAIT))

ROWS = [
    Row("all is well", case()),
    # an operator's command
    Row("land", case(ordered=CommandKind.LAND), LANDS, "landed by the operator", OURS),
    Row("return", case(ordered=CommandKind.RETURN), RETURNS, "called back by the operator", OURS),
    Row("kill", case(ordered=CommandKind.KILL), KILLS, "killed by the operator", OURS),
    # the lifeline
    Row(
        "the parent is gone",
        case(told_to_end="the process that started this agent is gone"),
        LANDS,
        "started this agent is gone",
        OURS,
    ),
    # the vehicle's own fault
    Row("a fault", seen(fault="a fixed wing"), LANDS, "a fixed wing"),
    # the vehicle was taken over
    Row("a pilot's mode", seen(controlled=False, mode="LOITER"), YIELDS, "switched to LOITER"),
    Row(
        "disarmed before lift-off",
        case(seen={"controlled": False, "armed": False}, flown=False),
        YIELDS,
        "disarmed by a pilot or",
    ),
    Row(
        "a pilot has landed it",
        seen(controlled=False, armed=False, mode="LOITER", on_ground=True),
        YIELDS,
        "disarmed by a pilot or",
    ),
    Row("never controlled", case(seen={"controlled": False}, had_control=False)),
    Row("its own landing", case(seen={"controlled": False}, landing=True)),
    Row("the landing step", case(seen={"controlled": False}, step=LAST)),
    # disarmed, or falling
    Row("disarmed in the air", seen(armed=False), FALLS, "disarmed in the air; now it is 8.0 m up"),
    Row("disarmed in a pilot's mode", seen(armed=False, controlled=False, mode="LOITER"), FALLS),
    Row("it lies there", case(seen=PARKED, fell=True), FALLS, "disarmed in the air"),
    Row("it has landed by itself", case(seen=PARKED | {"controlled": True}), YIELDS, "disarmed by"),
    Row("it fell in the landing step", case(seen=PARKED, fell=True, step=LAST), FALLS, "disarmed"),
    Row("disarmed before it flew", case(seen={"armed": False}, flown=False)),
    Row("disarmed on its way down", case(seen={"armed": False}, landing=True), FALLS, "disarmed"),
    Row("disarmed in the landing step", case(seen={"armed": False}, step=LAST), FALLS, "disarmed"),
    Row("landed", case(seen={"armed": False, "on_ground": True}, step=LAST, height_m=0.0)),
    Row("landed, not told yet", case(seen={"armed": False}, landing=True, height_m=1.9)),
    Row("too high for that", case(seen={"armed": False}, landing=True, height_m=2.0), FALLS),
    Row("falling", falling(4.1, 2.1), LANDS, "fell out of height: 4.1 m/s down, 8.0 m up"),
    Row("just not falling", falling(4.0, 9.0)),
    Row("falling, by one message alone", falling(9.0, 2.0)),
    Row("falling, just told", falling(9.0, 9.0, age_s=0.5), LANDS, "fell out of height"),
    Row("falling, long ago", falling(9.0, 9.0, age_s=0.6)),
    Row("falling before it flew", falling(9.0, 9.0, flown=False)),
    Row("sunk", case(sunk_s=2.1), LANDS, "fell out of height: 8.0 m up for 2 s"),
    Row("sunk for a moment", case(sunk_s=2.0)),
    Row("sunk on the way down", case(sunk_s=9.0, landing=True)),
    Row("sunk in the landing step", case(sunk_s=9.0, step=LAST)),
    Row("sunk on the way back", case(sunk_s=9.0, returning=True)),
    # the vehicle's heartbeat
    Row("silent for 5 s", seen(heartbeat_s=NOW - 5.01), LANDS, "no heartbeat from the vehicle"),
    Row("silent for just 5 s", seen(heartbeat_s=NOW - 5.0)),
    Row("silent on the ground", lambda: on_the_ground(seen={"heartbeat_s": NOW - 60.0})),
    # the own position
    Row("no position", seen(fix=None), LANDS, "no position from the vehicle for 5 s"),
    Row("an old position", seen(fix=fix(age_s=5.01)), LANDS, "no position from the vehicle"),
    Row("a position of just 5 s", seen(fix=fix(age_s=5.0))),
    Row("no position on the ground", lambda: on_the_ground(seen={"fix": None})),
    # the vehicle's own word of its estimate
    Row("an estimate in doubt", case(estimate_doubt="GPS glitch"), HOLDS, "GPS glitch"),
    Row("in doubt, landing", case(estimate_doubt="GPS glitch", landing=True)),
    Row("in doubt, the landing step", case(estimate_doubt="GPS glitch", step=LAST)),
    Row("in doubt before control", case(estimate_doubt="GPS glitch", had_control=False)),
    Row(
        "in doubt, by policy land",
        case(estimate_doubt="GPS glitch", of=policies(estimate=Policy.LAND)),
        LANDS,
        "GPS glitch",
    ),
    Row(
        "in doubt, by policy continue",
        case(estimate_doubt="GPS glitch", of=policies(estimate=Policy.CONTINUE)),
    ),
    # too fast, too steep
    Row("10.1 m/s", moving(8.0, 6.2, 0.0), LANDS, "10.1 m/s fast; allowed: 10 m/s"),
    Row("just 10 m/s", moving(8.0, 6.0, 0.0)),
    Row("fast down is not fast", moving(0.0, 0.0, 12.0)),
    Row("fast, by policy hold", moving(11, 0, 0, of=policies(too_fast=Policy.HOLD)), HOLDS, "fast"),
    Row("fast, by policy continue", moving(11, 0, 0, of=policies(too_fast=Policy.CONTINUE))),
    Row("fast under a pilot", moving(11.0, 0.0, 0.0, had_control=False)),
    Row("61 degrees", seen(tilt_deg=61.0), LANDS, "leans 61 degrees; allowed: 60"),
    Row("just 60 degrees", seen(tilt_deg=60.0)),
    Row("no tilt known", seen(tilt_deg=None)),
    # wind
    Row("12.1 m/s of wind", seen(wind_mps=12.1), LANDS, "wind of 12.1 m/s; allowed: 12 m/s"),
    Row("just 12 m/s of wind", seen(wind_mps=12.0)),
    Row("no wind known", seen(wind_mps=None)),
    Row("wind before control", case(seen={"wind_mps": 20.0}, had_control=False)),
    Row("wind, by policy", case(seen={"wind_mps": 20.0}, of=policies(wind=Policy.RETURN)), RETURNS),
    # the geofence
    Row("outside", case(of=FENCED, stop_point_m=(10.1, 0.0)), LANDS, "outside the geofence."),
    Row(
        "drawn outside",
        case(of=FENCED, stop_point_m=(10.1, 0.0), leads=lambda: 3),
        LANDS,
        "outside the geofence, drawn there by the place that agent 3 tells",
    ),
    Row("just inside", case(of=FENCED, stop_point_m=(9.9, 0.0))),
    Row("too high", case(of=FENCED, height_m=20.1), LANDS, "20.1 m high; the geofence ends at 20"),
    Row("just low enough", case(of=FENCED, height_m=20.0)),
    Row("no fence", case(stop_point_m=(1e4, 0.0), height_m=1e3)),
    Row("outside, landing step", case(of=FENCED, stop_point_m=(99.0, 0.0), step=LAST)),
    Row("outside under a pilot", case(of=FENCED, stop_point_m=(99.0, 0.0), had_control=False)),
    Row(
        "outside, by policy",
        case(of=policies(fence=Policy.RETURN), stop_point_m=(99.0, 0.0)),
        RETURNS,
        "outside the geofence",
    ),
    # the target that a step follows
    Row("lost target, land", lambda: following(Policy.LAND, LOST), LANDS, LOST),
    Row("lost target, stand", lambda: following(Policy.HOLD, LOST)),
    Row("lost target, go on", lambda: following(Policy.CONTINUE, LOST)),
    Row("a target that is heard", lambda: following(Policy.LAND, "")),
    # the battery
    Row("below the reserve", seen(battery_percent=19.0), LANDS, "battery at 19 %, the reserve"),
    Row("just the reserve", seen(battery_percent=20.0)),
    Row("no battery known", seen(battery_percent=None)),
    Row("low on the ground", lambda: on_the_ground(seen={"battery_percent": 5.0})),
    Row("low, landing", case(seen={"battery_percent": 5.0}, step=LAST)),
    Row("low, returning", case(seen={"battery_percent": 5.0}, of=RETURNING, step=LAST)),
    Row(
        "low, by policy",
        case(seen={"battery_percent": 5.0}, of=policies(battery_low=Policy.RETURN)),
        RETURNS,
        "battery at 5 %",
    ),
    # peers
    Row("a silent peer", case(peer(2, 5.01), peer(3)), LANDS, "agent 2 has not been heard for 5 s"),
    Row("just heard", case(peer(2, 5.0), peer(3))),
    Row("never heard", case(peer(2, INFINITE), peer(3))),
    Row("silent beside one never heard", case(peer(2, INFINITE), peer(3, 9.0)), LANDS, "agent 3"),
    Row("silent beside one on its way", case(WAITS_TO_RETURN, peer(3, 9.0)), LANDS, "agent 3"),
    Row("silent in its last step", case(peer(2, 60.0, step=LAST), peer(3)), LANDS, "agent 2"),
    Row("silent after its end", case(peer(2, 60.0, step=LAST, done=True), peer(3))),
    Row("it lands", case(peer(2), peer(3, phase=Phase.LAND)), LANDS, "agent 3 broke the mission"),
    Row("it ended", case(peer(2), peer(3, phase=Phase.ENDED)), LANDS, "agent 3 broke the mission"),
    Row("it lands, by one word", case(peer(2), replace(peer(3, phase=Phase.LAND), ends=False))),
    Row("it lands in the last step", case(peer(2), peer(3, phase=Phase.LAND, step=LAST))),
    Row("it yields", case(peer(2), peer(3, phase=Phase.YIELD)), LANDS, "lost its vehicle to a"),
    Row(
        "it flies back",
        case(peer(2, phase=Phase.RETURN, stage=int(ReturnStage.FLY)), peer(3)),
        LANDS,
        "agent 2 broke the mission off",
    ),
    Row("it waits to fly back", case(WAITS_TO_RETURN, peer(3))),
    Row("silent while we return", case(peer(2, 60.0), peer(3), returning=True)),
    Row("silent in the return step", case(peer(2, 60.0), peer(3), of=RETURNING, step=LAST)),
    Row(
        "silent after a return command",
        case(peer(2, 60.0), peer(3), ordered=CommandKind.RETURN),
        RETURNS,
        "called back",
        OURS,
    ),
    Row(
        "silent since it ended in the landing step, which it was not done with",
        case(peer(2, 9.0, phase=Phase.ENDED, step=LAST, done=False), peer(3)),
        LANDS,
        "agent 2 broke the mission off",
    ),
    Row(
        "by policy hold", case(peer(2, 9.0), of=policies(agent_lost=Policy.HOLD)), HOLDS, "agent 2"
    ),
    Row("by policy continue", case(peer(2, 9.0), of=policies(agent_lost=Policy.CONTINUE))),
    # agents that left by an operator's order
    Row("a peer that left", case(peer(3, phase=Phase.LAND, left=CommandKind.LAND), departed=LEFT)),
    Row(
        "a peer that left and is silent", case(peer(3, 60.0, left=CommandKind.LAND), departed=LEFT)
    ),
    Row(
        "left, by policy hold",
        case(departed=LEFT, of=policies(left_by_order=Policy.HOLD)),
        HOLDS,
        "agent 3 was landed by the operator (policies.left_by_order: hold)",
        OURS,
    ),
    Row(
        "left, by policy hold, and the operator goes on without it",
        case(departed=LEFT, accepted={3}, of=policies(left_by_order=Policy.HOLD)),
    ),
    Row(
        "left, by policy land",
        case(departed=LEFT, of=policies(left_by_order=Policy.LAND)),
        LANDS,
        "agent 3",
        OURS,
    ),
    Row(
        "left, in the landing step",
        case(departed=LEFT, step=LAST, of=policies(left_by_order=Policy.LAND)),
    ),
    Row(
        "left, and this agent as well",
        case(departed=LEFT, ordered=CommandKind.RETURN, of=policies(left_by_order=Policy.LAND)),
        RETURNS,
        "called back",
        OURS,
    ),
    Row("silent in preparation", lambda: on_the_ground(peer(2, 30.01)), LANDS, "heard for 30 s."),
    Row(
        "silent in preparation, and this agent is ready",
        lambda: on_the_ground(peer(2, 30.01), waits="no SYS_STATUS", done=True),
        LANDS,
        "heard for 30 s.",
    ),
    Row("just heard in preparation", lambda: on_the_ground(peer(2, 30.0))),
    Row(
        "silent in preparation, by policy continue",
        lambda: on_the_ground(peer(2, 31.0), of=policies(agent_lost=Policy.CONTINUE)),
        LANDS,
        "agent 2 has not been heard for 30 s",
    ),
    Row(
        "gave up, and the own vehicle was found in the air",
        lambda: on_the_ground(peer(2, phase=Phase.ENDED, step=0), found=True),
    ),
    # the ground station
    Row("no station", seen(station_age_s=5.01), LANDS, "no ground station has been heard for 5 s"),
    Row("a station just heard", seen(station_age_s=5.0)),
    Row("a station never heard", seen(station_age_s=None)),
    Row(
        "no station, by policy hold",
        case(seen={"station_age_s": 9.0}, of=policies(station_lost=Policy.HOLD)),
        HOLDS,
        "no ground station",
    ),
    Row(
        "no station, by policy continue",
        case(seen={"station_age_s": 9.0}, of=policies(station_lost=Policy.CONTINUE)),
    ),
    # time-outs
    Row(
        "this agent is late",
        seen(now=OVER),
        LANDS,
        "step 3 (hold) timed out after 60 s: this agent was not done",
        step_outcome=TIMEOUT,
    ),
    Row(
        "the others are late",
        case(seen={"now": OVER}, done=True),
        LANDS,
        "step 3 (hold) timed out after 60 s: agents 2-3 not done",
        step_outcome=TIMEOUT,
    ),
    Row(
        "others are late, and others were done or have gone",
        case(
            peer(2, left=CommandKind.LAND),
            peer(3, 9.0, step=LAST, done=True),
            peer(4, 5.0),
            peer(5, 9.0),
            peer(6, 9.0, step=LAST),
            peer(7, done=True),
            of=plan(agents=7, policies=Policies(agent_lost=Policy.CONTINUE)),
            departed={2: "agent 2 was landed by the operator"},
            seen={"now": OVER},
            done=True,
        ),
        LANDS,
        "timed out after 60 s: agent 4 not done, agents 5-6 not heard.",
        step_outcome=TIMEOUT,
    ),
    Row(
        "all were done, but not together",
        case(peer(2, done=True), peer(3, done=True), seen={"now": OVER}, done=True),
        LANDS,
        "timed out after 60 s: the others were not done.",
        step_outcome=TIMEOUT,
    ),
    Row("just in time", seen(now=NOW + 50.0)),
    Row("late after the last step", case(seen={"now": OVER}, step=LAST, done=True)),
    Row("late on the way back", case(seen={"now": OVER}, returning=True)),
    Row(
        "the way back is late",
        case(seen={"now": OVER}, of=RETURNING, step=LAST, returning=True),
        LANDS,
        "step 5 (return) timed out",
        step_outcome=TIMEOUT,
    ),
    Row(
        "late, and the step goes on",
        case(seen={"now": OVER}, of=plan(ReturnStep(60.0, Policy.CONTINUE)), step=LAST),
    ),
    Row(
        "not up in time, and the step goes on",
        case(seen={"now": OVER}, of=UP_OR_ON, step=1),
        LANDS,
        "step 1 (takeoff) timed out after 60 s: this agent was not done",
        step_outcome=TIMEOUT,
    ),
    Row(
        "up in time, and the step goes on", case(seen={"now": OVER}, of=UP_OR_ON, step=1, done=True)
    ),
    Row(
        "late in preparation",
        lambda: on_the_ground(seen={"now": NOW + 110.01}),
        LANDS,
        "step 0 (prepare) timed out after 120 s: this agent was not ready",
        step_outcome=TIMEOUT,
    ),
    Row(
        "never ready, and it says why",
        lambda: on_the_ground(seen={"now": NOW + 110.01}, waits="no SYS_STATUS"),
        LANDS,
        "step 0 (prepare) timed out after 120 s: not ready: no SYS_STATUS",
        step_outcome=TIMEOUT,
    ),
    Row(
        "never ready, and a peer's time was over first",
        lambda: on_the_ground(peer(2, phase=Phase.ENDED, step=0), waits="no SYS_STATUS"),
        LANDS,
        "agent 2 broke the mission off; not ready: no SYS_STATUS",
    ),
    Row(
        "ready, and others never were",
        lambda: on_the_ground(
            peer(2, step=0, done=False), peer(3, INFINITE), seen={"now": NOW + 110.01}, done=True
        ),
        LANDS,
        "step 0 (prepare) timed out after 120 s: agent 2 not ready, agent 3 not heard",
        step_outcome=TIMEOUT,
    ),
]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.what)
def test_what_fires(row: Row) -> None:
    """The trigger of the row, with its outcome, or none. Where the row's reason ends with a full
    stop, nothing follows."""
    trigger = find(row.make())
    if row.action is None:
        assert trigger is None
        return
    assert trigger is not None
    assert (trigger.action, trigger.outcome) == (row.action, row.outcome)
    assert trigger.step_outcome is row.step_outcome
    assert row.reason in f"{trigger.reason}."


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_every_check_has_a_row_that_fires_it(check: Callable[[Situation], object]) -> None:
    assert any(check(row.make()) is not None for row in ROWS)


@pytest.mark.parametrize(
    ("make", "cause"),
    [
        (case(ordered=CommandKind.LAND), Cause.ORDER),
        (case(ordered=CommandKind.KILL), Cause.ORDER),
        (case(told_to_end="the process that started this agent is gone"), Cause.STARTER),
        (seen(fault="a fixed wing"), Cause.VEHICLE),
        (seen(controlled=False, mode="LOITER"), Cause.PILOT),
        (seen(now=OVER), Cause.TIMEOUT),
    ],
)
def test_a_trigger_names_its_cause(make: Callable[[], Situation], cause: Cause) -> None:
    trigger = find(make())
    assert trigger is not None
    assert trigger.cause is cause


def test_a_pause_postpones_the_time_out() -> None:
    late = situation(seen={"now": OVER})
    late.progress.paused_s = 0.02
    assert find(late) is None
    later = find(replace(late, tick=replace(late.tick, now=OVER + 0.02)))
    assert later is not None
    assert "after 60 s" in later.reason


@pytest.mark.parametrize(
    "make",
    [
        lambda agent: case(peer(agent, 9.0), of=policies(agent_lost=Policy.HOLD)),
        lambda agent: case(departed={agent: "left"}, of=policies(left_by_order=Policy.HOLD)),
        lambda agent: lambda: on_the_ground(peer(agent, 31.0)),
    ],
    ids=["lost", "left", "on the ground"],
)
def test_the_same_of_another_peer_is_another_failsafe(make: Any) -> None:
    """So a hold for one is said anew for the next."""
    assert find(make(2)()) != find(make(3)())
    assert find(make(2)()) == find(make(2)())


@pytest.mark.parametrize(
    ("left", "words"),
    [
        (CommandKind.LAND, "agent 3 was landed by the operator"),
        (CommandKind.RETURN, "agent 3 was called back by the operator"),
        (CommandKind.KILL, "agent 3 was killed by the operator"),
        (CommandKind.GOTO, "agent 3 was sent elsewhere by the operator"),
        (None, ""),
    ],
)
def test_how_a_peer_left_is_said(left: CommandKind | None, words: str) -> None:
    assert left_by_order(state(3, left=left)) == words


# --- which of several ---


def trigger(action: FailsafeAction, reason: str = "a reason") -> FailsafeTrigger:
    return failed(action, reason)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        (
            {
                "ordered": CommandKind.KILL,
                "told_to_end": "the process that started this agent is gone",
            },
            "killed",
        ),
        ({"seen": {"controlled": False, "mode": "LOITER", "tilt_deg": 60.0}}, "LOITER"),
        (
            {
                "ordered": CommandKind.RETURN,
                "told_to_end": "the process that started this agent is gone",
            },
            "started this agent",
        ),
        (
            {
                "ordered": CommandKind.LAND,
                "told_to_end": "the process that started this agent is gone",
            },
            "landed by the operator",
        ),
        ({"seen": {"wind_mps": 20.0, "battery_percent": 1.0}}, "wind"),
    ],
    ids=["kill over land", "yield over land", "land over return", "first of equals", "in order"],
)
def test_the_weightiest_decides(changes: dict[str, Any], reason: str) -> None:
    """Of equal ones, the first check of the table."""
    found = find(situation(**changes))
    assert found is not None
    assert reason in found.reason


ACTIONS = list(FailsafeAction)
REPLACED = {  # by what each action is replaced: while not landing, and while landing
    FailsafeAction.HOLD: (set(ACTIONS) - {HOLDS}, set(ACTIONS) - {HOLDS}),
    FailsafeAction.RETURN: ({LANDS, FailsafeAction.LEAVE, YIELDS, FALLS, KILLS}, {FALLS, KILLS}),
    FailsafeAction.LAND: ({YIELDS, FALLS, KILLS}, {FALLS, KILLS}),
    FailsafeAction.LEAVE: ({FALLS, KILLS}, {FALLS, KILLS}),
    FailsafeAction.YIELD: ({FALLS, KILLS}, {FALLS, KILLS}),
    FailsafeAction.FALL: ({KILLS}, {KILLS}),
    FailsafeAction.KILL: (set(), set()),
}


@pytest.mark.parametrize("landing", [False, True])
@pytest.mark.parametrize("old", ACTIONS)
def test_what_replaces_what(old: FailsafeAction, landing: bool) -> None:
    """A hold ends with its cause and gives way to anything else; a landing is final, but for a
    kill. A sentence with other figures is no other failsafe."""
    before = trigger(old)
    allowed = {new for new in ACTIONS if replaces(trigger(new, "new"), before, landing=landing)}
    assert allowed == REPLACED[old][landing]
    assert replaces(None, before, landing=landing) is (old is FailsafeAction.HOLD)
    assert not replaces(before, before, landing=landing)


@pytest.mark.parametrize("landing", [False, True])
def test_nothing_to_replace(landing: bool) -> None:
    assert not replaces(None, None, landing=landing)
    assert all(replaces(trigger(new), None, landing=landing) for new in ACTIONS)


@given(st.lists(st.sampled_from(ACTIONS), max_size=8), st.booleans())
def test_a_kill_is_carried_out_whatever_came_before(
    before: list[FailsafeAction], landing: bool
) -> None:
    """In any sequence of triggers, the kill takes their place and keeps it."""
    current: FailsafeTrigger | None = None
    for action in (*before, FailsafeAction.KILL, *before):
        new = trigger(action)
        if replaces(new, current, landing=landing):
            current = new
        landing |= current is not None and current.action is FailsafeAction.LAND
    assert current is not None
    assert current.action is FailsafeAction.KILL


@pytest.mark.parametrize(("down_mps", "falls"), [(4.1, True), (3.9, False)])
def test_the_tick_that_tells_of_disarming_tells_of_the_fall(down_mps: float, falls: bool) -> None:
    """An ArduCopter that was disarmed in the air says that it is on the ground; its speed in the
    same tick says that it falls."""
    own = Own()
    own.vehicle.watch_height(own.tick(fix=fix(velocity=(0.0, 0.0, down_mps)), **PARKED))
    assert own.vehicle.fell(NOW) is falls
