"""Winding a flight down: for each failsafe and each state of the vehicle the goal, the phase and
the end."""

from __future__ import annotations

import math
from typing import Any

import pytest

from swarm_ctl.core.agent.failsafes import FailsafeTrigger, failed
from swarm_ctl.core.agent.landing import STANDING_WANDERS_M, WANDERS_M
from swarm_ctl.core.model.causes import Cause, FailsafeAction
from swarm_ctl.core.model.messages import Outcome, Phase
from swarm_ctl.core.model.vehicle import (
    MISPLACED_M,
    FlyGoal,
    Goal,
    LandGoal,
    ReleaseGoal,
    StandbyGoal,
    TerminateGoal,
    YieldGoal,
)
from tests.unit.core.builders import (
    LAST,
    NOW,
    PARKED,
    RETURNING,
    TAKEOFF,
    Own,
    fix,
    peer,
    plan,
    texts,
    tick,
)

HOLDS, RETURNS, LANDS = FailsafeAction.HOLD, FailsafeAction.RETURN, FailsafeAction.LAND
YIELDS, KILLS, LEAVES = FailsafeAction.YIELD, FailsafeAction.KILL, FailsafeAction.LEAVE
MOVING = fix(velocity=(2.0, 0.0, 0.0))


class Flight:
    """An agent that carries out a failsafe which fired at NOW."""

    def __init__(
        self,
        action: FailsafeAction = LANDS,
        outcome: Outcome = Outcome.FAILED,
        own: Own | None = None,
    ) -> None:
        self.own = own or Own()
        self.trigger = FailsafeTrigger(action, outcome, "a reason")
        self.own.interruption.go_over_to(self.trigger, anew_s=NOW)

    def at(self, later_s: float = 0.1, *peers: Any, **seen: Any) -> Goal:
        """The goal of one tick."""
        own = self.own
        now = own.tick(*peers, now=NOW + later_s, **seen)
        trigger = own.interruption.trigger or self.trigger
        return own.act(now, own.landing.carry_out(now, trigger, left=False))


def in_phase(phase: Phase, **changes: Any) -> Own:
    own = Own(**changes)
    own.phase = phase
    return own


def started(known_s: float) -> Own:
    """Half a second ago, or earlier, and heard of its vehicle for the first time then."""
    begun = {"since_s": min(NOW - 0.5, known_s), "known_s": known_s}
    return in_phase(Phase.PREPARE, arming_s=-math.inf, was_armed=False, had_control=False, **begun)


GROUNDED = PARKED | {"fix": fix(height_m=0.0)}

ROWS: list[tuple[str, FailsafeAction, Own, dict[str, Any], type[Goal], Phase]] = [
    ("hold", HOLDS, Own(), {}, FlyGoal, Phase.HOLD),
    ("land: stop first", LANDS, Own(), {"fix": MOVING}, FlyGoal, Phase.HOLD),
    ("return: climb first", RETURNS, Own(), {}, FlyGoal, Phase.RETURN),
    ("yield", YIELDS, Own(), {"controlled": False}, YieldGoal, Phase.YIELD),
    ("kill", KILLS, Own(), {}, TerminateGoal, Phase.LAND),
    ("on the ground", LANDS, Own(), GROUNDED, ReleaseGoal, Phase.ENDED),
    ("on the ground, kill", KILLS, Own(), GROUNDED, ReleaseGoal, Phase.ENDED),
    ("on the ground, yield", YIELDS, Own(), GROUNDED, ReleaseGoal, Phase.ENDED),
    ("no heartbeat for 10 s", LANDS, Own(), {"heartbeat_s": NOW - 10.0}, ReleaseGoal, Phase.ENDED),
    (
        "not our flight",
        LEAVES,
        Own(arming_s=-math.inf, was_armed=False),
        {},
        ReleaseGoal,
        Phase.ENDED,
    ),
    ("just started, and found armed", LANDS, started(NOW - 0.2), {}, StandbyGoal, Phase.PREPARE),
    (
        "just started, and not heard yet",
        LANDS,
        started(math.inf),
        GROUNDED | {"heartbeat_s": -math.inf},
        StandbyGoal,
        Phase.PREPARE,
    ),
    ("started, heard on the ground", LANDS, started(NOW - 3.0), GROUNDED, ReleaseGoal, Phase.ENDED),
    (
        "asked to arm a moment ago",
        LANDS,
        in_phase(Phase.ARM, arming_s=NOW - 2.0, was_armed=False),
        GROUNDED,
        LandGoal,
        Phase.ARM,
    ),
    (
        "disarmed in the air",
        LANDS,
        in_phase(Phase.PREPARE, was_armed=False, arming_s=-math.inf),
        {"armed": False},
        StandbyGoal,
        Phase.PREPARE,
    ),
    (
        "hold in the autopilot's take-off",
        HOLDS,
        Own(step=TAKEOFF, had_control=False),
        {"controlled": False},
        LandGoal,
        Phase.HOLD,
    ),
    (
        "return without ever having had control",
        RETURNS,
        Own(had_control=False),
        {"fix": MOVING},
        FlyGoal,
        Phase.HOLD,
    ),
]


@pytest.mark.parametrize(
    ("what", "action", "own", "seen", "goal", "phase"), ROWS, ids=[row[0] for row in ROWS]
)
def test_what_a_failsafe_does_at_first(
    what: str,
    action: FailsafeAction,
    own: Own,
    seen: dict[str, Any],
    goal: type[Goal],
    phase: Phase,
) -> None:
    flight = Flight(action, own=own)
    assert isinstance(flight.at(**seen), goal)
    assert own.phase is phase


# --- landing ---


@pytest.mark.parametrize(
    ("what", "outcome", "later_s", "own", "lands"),
    [
        ("failed, at rest: holds for a moment", Outcome.FAILED, 2.99, fix(), False),
        ("failed, at rest, after 3 s", Outcome.FAILED, 3.0, fix(), True),
        ("commanded, at rest: at once", Outcome.ABORTED, 0.0, fix(), True),
        ("commanded, moving: brakes", Outcome.ABORTED, 3.0, MOVING, False),
        ("commanded, moving still", Outcome.ABORTED, 3.01, MOVING, True),
        ("no position: brakes", Outcome.ABORTED, 3.0, None, False),
        ("no position, after 3 s", Outcome.ABORTED, 3.01, None, True),
    ],
)
def test_it_stands_still_before_it_comes_down(
    what: str, outcome: Outcome, later_s: float, own: Any, lands: bool
) -> None:
    """So that no agent drops its avoidance while it moves; a failed mission waits 3 s for the
    others to hear of it."""
    flight = Flight(outcome=outcome)
    assert isinstance(flight.at(later_s, fix=own), LandGoal) is lands
    assert flight.own.phase is (Phase.LAND if lands else Phase.HOLD)


def test_a_landing_does_not_stop_again() -> None:
    flight = Flight(outcome=Outcome.ABORTED)
    flight.at(0.0)
    assert isinstance(flight.at(1.0, fix=MOVING), LandGoal)


def test_a_landing_of_three_minutes_is_given_up() -> None:
    flight = Flight(outcome=Outcome.ABORTED)
    flight.at(0.0)
    assert isinstance(flight.at(180.0), LandGoal)
    assert isinstance(flight.at(180.1), ReleaseGoal)
    assert flight.own.interruption.trigger == failed(LANDS, "")
    assert flight.own.interruption.reason == "not down after 180 s of landing"


def test_it_ends_when_the_vehicle_is_down() -> None:
    """With the outcome and the reason of the failsafe, said once."""
    flight = Flight(outcome=Outcome.ABORTED)
    flight.at(0.0)
    assert isinstance(flight.at(20.0, **GROUNDED), ReleaseGoal)
    assert flight.own.interruption.outcome is Outcome.ABORTED
    assert texts(flight.own.log.events) == ["ended: aborted (a reason)"]


@pytest.mark.parametrize(("seconds", "ends"), [(10.0, False), (10.1, True)])
def test_a_vehicle_without_motors_for_ten_seconds_is_down(seconds: float, ends: bool) -> None:
    """Whatever it said last of the ground."""
    flight = Flight(YIELDS)
    silent = {"armed": False, "controlled": False}
    flight.at(0.0, **silent)
    assert isinstance(flight.at(seconds, **silent), ReleaseGoal) is ends


def test_the_landing_step_is_done_on_the_ground() -> None:
    """Without a failsafe: the mission's own end."""
    own = Own(step=LAST)
    assert isinstance(own.act(tick(), own.landing.land(tick())), LandGoal)
    assert not own.progress.done
    own.act(tick(), own.landing.land(tick(**GROUNDED)))
    assert own.progress.finished
    assert own.phase is Phase.LAND


def landed(off_m: float, *, home: bool) -> Own:
    """An agent whose landing began over its place, and whose vehicle came down `off_m` north."""
    own = Own(RETURNING if home else plan(), step=LAST)
    step = own.landing.come_back if home else own.landing.land
    for now in (NOW, NOW + 1.0, NOW + 1.1):
        one = own.tick(now=now)
        own.act(one, step(one))
    step(own.tick(now=NOW + 20.0, armed=False, on_ground=True, fix=fix(off_m, height_m=0.0)))
    own.act(tick(), own.landing.end(NOW + 20.1))
    return own


@pytest.mark.parametrize(
    ("home", "what"), [(True, "its start"), (False, "where its landing began")]
)
def test_a_landing_elsewhere_is_told_and_has_failed(home: bool, what: str) -> None:
    """By the constant of the judge."""
    assert landed(MISPLACED_M - 0.1, home=home).interruption.outcome is Outcome.COMPLETED
    own = landed(MISPLACED_M + 0.1, home=home)
    assert own.interruption.outcome is Outcome.FAILED
    assert own.reason == f"the vehicle landed 3.1 m from {what}"


ROOM = {"wide": 2.0 * WANDERS_M, "narrow": 2.0 * STANDING_WANDERS_M}


def beside(room_m: float, speed_mps: float = 0.0) -> Any:
    """A peer in the air, so far beyond r_in."""
    of = plan()
    at, moves = of.law.r_in * of.unit_m + room_m, (0.0, speed_mps, 0.0)
    return peer(2, position_ned_m=(at, 0.0, -8.0), stop_point_m=(at, 0.0), velocity_ned_mps=moves)


def test_two_in_the_air_make_room_before_they_land() -> None:
    """For what both may wander, in metres, whatever the unit is; not for ever."""
    flight, near = Flight(), beside(ROOM["wide"] - 0.1)
    goal = flight.at(3.5, near, peer(3))
    assert isinstance(goal, FlyGoal)
    assert goal.velocity_ned_mps[0] < -0.1
    assert isinstance(flight.at(9.9, near, peer(3)), FlyGoal)
    assert isinstance(flight.at(13.1, near, peer(3)), LandGoal)


@pytest.mark.parametrize(
    ("room_m", "speed_mps", "goal"),
    [
        (ROOM["narrow"] + 0.1, 0.0, LandGoal),
        (ROOM["narrow"] - 0.5, 0.0, FlyGoal),
        (ROOM["narrow"] + 0.1, 1.0, FlyGoal),
        (ROOM["wide"] + 0.1, 1.0, LandGoal),
    ],
)
def test_a_small_formation_that_stands_lands_in_its_places(
    room_m: float, speed_mps: float, goal: type[Goal]
) -> None:
    """In a planned `land` two that stand need less room: the inner ones of a grid were pushed out
    of it by metres. A peer that moved as the landing began needs all of it, also once it stands."""
    flight = Flight()
    flight.own.interruption.lift()
    flight.own.progress.started_s = NOW
    for later_s, moves_mps in ((0.1, speed_mps), (0.2, 0.0)):
        one = flight.own.tick(beside(room_m, moves_mps), peer(3), now=NOW + later_s)
        assert isinstance(flight.own.act(one, flight.own.landing.land(one)), goal)


# --- the way back ---


def test_it_comes_back_and_lands_at_home() -> None:
    """Climb, fly, down: each with its phase and reason."""
    flight = Flight(RETURNS, Outcome.ABORTED)
    own = flight.own
    home, away = fix(), fix(30.0)
    assert isinstance(flight.at(0.1, fix=away), FlyGoal)
    assert (own.phase, own.reason) == (Phase.RETURN, "a reason")
    goal = flight.at(1.2, fix=away)
    assert isinstance(goal, FlyGoal)
    assert goal.velocity_ned_mps[0] < 0.0
    assert isinstance(flight.at(9.0, fix=home), LandGoal)
    assert own.phase is Phase.LAND


def test_a_way_back_without_a_peer_is_given_up() -> None:
    """No agent knows whose turn it is: land here, after the patience of `agent_lost_after_s`."""
    flight = Flight(RETURNS, Outcome.ABORTED)
    silent = (peer(2, 60.0), peer(3, 60.0))
    flight.at(0.0, *silent)
    assert isinstance(flight.at(5.0, *silent), FlyGoal)
    flight.at(5.1, *silent)
    assert flight.own.interruption.trigger == failed(LANDS, "")
    reason = "a reason; no other agent is heard, so it lands here"
    assert flight.own.interruption.reason == reason


def test_a_way_back_has_two_minutes_for_each_agent() -> None:
    flight = Flight(RETURNS, Outcome.ABORTED)
    flight.at(0.0)
    flight.at(360.0)
    assert flight.own.interruption.trigger is flight.trigger
    flight.at(360.1)
    assert flight.own.interruption.trigger is not None
    assert "it took more than 360 s, so it lands here" in flight.own.interruption.trigger.reason


def test_the_return_step_is_the_missions_own_way_back() -> None:
    own = Own(RETURNING, step=LAST)
    for later_s, goal in ((0.0, FlyGoal), (1.0, FlyGoal), (1.1, LandGoal)):
        one = own.tick(now=NOW + later_s)
        assert isinstance(own.act(one, own.landing.come_back(one)), goal)
    own.landing.come_back(own.tick(now=NOW + 20.0, **GROUNDED))
    assert own.progress.finished
    assert own.interruption.outcome is Outcome.RUNNING
    own.landing.end(NOW + 20.1)
    assert own.interruption.outcome is Outcome.COMPLETED


def test_an_agent_that_holds_makes_room() -> None:
    """Avoidance stays on: a peer one metre away pushes it off."""
    near = peer(2, position_ned_m=(1.0, 0.0, -8.0), stop_point_m=(1.0, 0.0))
    goal = Flight(HOLDS).at(0.1, near, peer(3))
    assert isinstance(goal, FlyGoal)
    assert goal.velocity_ned_mps[0] < 0.0


def test_the_policies_of_the_rows() -> None:
    assert plan().policies.hold_before_land_s == 3.0
    assert plan().policies.agent_lost_after_s == 5.0


@pytest.mark.parametrize(("action", "ends"), [(FailsafeAction.FALL, True), (YIELDS, False)])
def test_a_fallen_vehicle_that_stays_armed_is_given_up(action: FailsafeAction, ends: bool) -> None:
    """After three minutes on its side; a pilot's vehicle is never given up while it is armed."""
    flight = Flight(action)
    assert isinstance(flight.at(179.0), YieldGoal)
    assert isinstance(flight.at(181.0), ReleaseGoal if ends else YieldGoal)


def test_a_vehicle_that_others_land_is_given_up_when_it_stays_armed() -> None:
    """By its own failsafe or by a pilot: three minutes in the landing mode, in one piece."""
    flight, lands = Flight(YIELDS), {"landing": True, "controlled": False}
    assert isinstance(flight.at(0.1, **lands), YieldGoal)
    assert isinstance(flight.at(100.0, controlled=False), YieldGoal)  # a pilot flies it
    assert isinstance(flight.at(110.0, **lands), YieldGoal)
    assert isinstance(flight.at(289.0, **lands), YieldGoal)
    assert flight.own.reason == "a reason; given up if it is still armed after 180 s"
    assert isinstance(flight.at(291.0, **lands), ReleaseGoal)
    assert flight.own.reason == "a reason; still armed after 180 s"
    assert flight.own.interruption.outcome is Outcome.FAILED


@pytest.mark.parametrize(("later_s", "ends"), [(2.9, False), (3.1, True)])
def test_a_kill_is_not_over_before_the_vehicle_is_known(later_s: float, ends: bool) -> None:
    """An agent that has just started takes its vehicle for disarmed until heartbeats say more."""
    flight = Flight(KILLS, own=Own(was_armed=False, arming_s=-math.inf))
    assert isinstance(flight.at(later_s, **GROUNDED), ReleaseGoal if ends else TerminateGoal)


def test_a_hold_is_said_once_whatever_its_figure() -> None:
    """The reason in force is the newest; another cause is said, and another peer."""
    own = Own()
    fired = [
        (Cause.WIND, "wind of 9", ()),
        (Cause.WIND, "wind of 10", ()),
        (Cause.PEER, "agent 3 is silent", (3,)),
        (Cause.PEER, "agent 4 is silent", (4,)),
    ]
    for k, (cause, reason, about) in enumerate(fired):
        own.interruption.heed(tick(now=NOW + k), failed(HOLDS, reason, cause, about=about))
        assert own.interruption.trigger
        assert own.interruption.trigger.reason == reason
    assert texts(own.log.events) == [
        "hold: wind of 9",
        "hold: agent 3 is silent",
        "hold: agent 4 is silent",
    ]


def test_a_hold_keeps_its_height_whatever_its_figure() -> None:
    """A hold that goes on is none that begins: it stops no climb anew, where the height is noise,
    and began when it began."""
    own = Own()
    own.interruption.heed(tick(now=NOW), failed(HOLDS, "wind of 9", Cause.WIND))
    began_s, height_m = own.interruption.since_s, own.vehicle.target_height_m
    lower = fix(height_m=1.0)
    own.interruption.heed(tick(now=NOW + 1, fix=lower), failed(HOLDS, "wind of 10", Cause.WIND))
    assert (own.interruption.since_s, own.vehicle.target_height_m) == (began_s, height_m)


@pytest.mark.parametrize(("action", "height_m"), [(HOLDS, 2.0), (LANDS, 0.5)])
def test_a_hold_is_flown_off_the_ground_and_goes_on_to_its_height(
    action: FailsafeAction, height_m: float
) -> None:
    """Half a metre up, noise of the height would touch the ground; a landing need not climb."""
    own = Own()
    low = fix(height_m=0.5)
    own.interruption.heed(tick(now=NOW, fix=low), failed(action, "a reason", Cause.WIND))
    assert own.vehicle.target_height_m == height_m
    own.interruption.heed(tick(now=NOW + 1, fix=low), None)
    assert own.vehicle.target_height_m == own.vehicle.planned_height_m
