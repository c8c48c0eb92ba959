"""Winding a flight down: for each failsafe and each state of the vehicle the goal, the phase and
the end."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from swarm_ctl.core.agent.failsafes import FailsafeTrigger, failed
from swarm_ctl.core.agent.landing import STANDING_WANDERS_M, WANDERS_M
from swarm_ctl.core.agent.steering import KeepClear
from swarm_ctl.core.model.causes import Cause, FailsafeAction
from swarm_ctl.core.model.messages import Event, Outcome, Phase, Severity
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
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.core.swarm.snapshot import OtherAircraft
from tests.unit.core.builders import (
    FORM,
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
from tests.unit.plans import with_group

HOLDS, RETURNS, LANDS = FailsafeAction.HOLD, FailsafeAction.RETURN, FailsafeAction.LAND
YIELDS, KILLS, LEAVES = FailsafeAction.YIELD, FailsafeAction.KILL, FailsafeAction.LEAVE
MOVING = fix(velocity=(2.0, 0.0, 0.0))
STILL = FlyGoal((0.0, 0.0, 0.0))
TREE = Zone("tree", ((1.0, 0.0),), 2.0, 1.25)


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
        "hold in the autopilot's take-off, disarmed",
        HOLDS,
        Own(step=TAKEOFF, had_control=False),
        {"controlled": False, "armed": False},
        StandbyGoal,
        Phase.HOLD,
    ),
    ("hold in an own take-off", HOLDS, Own(step=TAKEOFF), {}, FlyGoal, Phase.HOLD),
    ("hold after it", HOLDS, Own(step=FORM), {"controlled": False}, FlyGoal, Phase.HOLD),
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
    assert own.vehicle.ended_s == (NOW + 0.1 if phase is Phase.ENDED else None)


@pytest.mark.parametrize(
    ("ago_s", "goal"), [(0.0, LandGoal), (0.5, LandGoal), (3.0, LandGoal), (3.1, ReleaseGoal)]
)
def test_who_was_asked_to_arm_a_moment_ago_is_not_taken_for_down(
    ago_s: float, goal: type[Goal]
) -> None:
    """Its heartbeat says so once a second."""
    own = in_phase(Phase.ARM, arming_s=NOW - ago_s, was_armed=False)
    assert isinstance(Flight(own=own).at(0.0, **GROUNDED), goal)


@pytest.mark.parametrize(
    ("left", "own", "later_s", "goal"),
    [
        (True, None, 29.9, StandbyGoal),
        (True, None, 30.1, ReleaseGoal),
        (True, fix(height_m=0.0), 1.0, ReleaseGoal),
        (False, None, 1.0, ReleaseGoal),
    ],
)
def test_who_left_on_the_ground_waits_for_a_position(
    left: bool, own: Any, later_s: float, goal: type[Goal]
) -> None:
    """Its peers wait for its word, which it has with its first position."""
    flight = Flight(own=Own(was_armed=False, arming_s=-math.inf))
    now = flight.own.tick(now=NOW + later_s, **(PARKED | {"fix": own}))
    assert isinstance(flight.own.landing.carry_out(now, flight.trigger, left=left).course, goal)


def test_a_vehicle_is_not_gone_before_ten_seconds() -> None:
    assert isinstance(Flight(HOLDS).at(0.0, heartbeat_s=NOW - 10.0), FlyGoal)


@pytest.mark.parametrize(("flown", "course"), [(False, STILL), (True, KeepClear())])
def test_a_hold_lifts_nothing_off_the_ground(flown: bool, course: Any) -> None:
    """Before it has flown, its height errs by more than a climb needs."""
    flight = Flight(HOLDS, own=Own(flown=flown))
    now = flight.own.tick(now=NOW, on_ground=True, fix=fix(height_m=0.0))
    intent = flight.own.landing.carry_out(now, flight.trigger, left=False)
    assert (intent.course, intent.phase) == (course, Phase.HOLD)


# --- landing ---


@pytest.mark.parametrize(
    ("what", "outcome", "later_s", "own", "lands"),
    [
        ("failed, at rest: holds for a moment", Outcome.FAILED, 2.99, fix(), False),
        ("failed, at rest, after 3 s", Outcome.FAILED, 3.0, fix(), True),
        ("commanded, at rest: at once", Outcome.ABORTED, 0.0, fix(), True),
        ("commanded, slowly: brakes", Outcome.ABORTED, 0.0, fix(velocity=(0.3, 0, 0)), False),
        ("commanded, sinking: at once", Outcome.ABORTED, 0.0, fix(velocity=(0, 0, 1.0)), True),
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
    now = flight.own.tick(now=NOW + 180.1)
    intent = flight.own.landing.carry_out(now, flight.trigger, left=False)
    assert isinstance(intent.course, ReleaseGoal)
    assert intent.reason == "not down after 180 s of landing"
    assert flight.own.vehicle.ended_s == NOW + 180.1
    assert flight.own.interruption.trigger == failed(LANDS, "")
    assert flight.own.interruption.reason == "not down after 180 s of landing"


def test_it_ends_when_the_vehicle_is_down() -> None:
    """With the outcome and the reason of the failsafe, said once."""
    flight = Flight(outcome=Outcome.ABORTED)
    flight.at(0.0)
    assert isinstance(flight.at(20.0, **GROUNDED), ReleaseGoal)
    assert flight.own.interruption.outcome is Outcome.ABORTED
    ended = Event(1, NOW + 20.0, Severity.INFO, "ended: aborted (a reason)")
    assert flight.own.log.events == [ended]
    assert flight.own.reason == "a reason"


@pytest.mark.parametrize(("seconds", "ends"), [(10.0, False), (10.1, True)])
def test_a_vehicle_without_motors_for_ten_seconds_is_down(seconds: float, ends: bool) -> None:
    """Whatever it said last of the ground; in one piece."""
    flight = Flight(YIELDS)
    silent = {"armed": False, "controlled": False}
    for later_s, armed in ((-6.0, False), (-3.0, True), (0.0, False)):
        assert isinstance(flight.at(later_s, **silent | {"armed": armed}), YieldGoal)
    assert isinstance(flight.at(seconds, **silent), ReleaseGoal) is ends


def test_the_landing_step_is_done_on_the_ground() -> None:
    """Without a failsafe: the mission's own end."""
    own = Own(step=LAST)
    assert isinstance(own.act(tick(), own.landing.land(tick())), LandGoal)
    own.landing.land(tick(on_ground=True))  # its motors turn
    assert not own.progress.done
    own.act(tick(), own.landing.land(tick(now=NOW + 1.0, **GROUNDED)))
    assert own.progress.finished
    assert own.progress.results[-1].end_s == NOW + 1.0
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
    own = landed(MISPLACED_M, home=home)
    assert own.interruption.outcome is Outcome.COMPLETED
    assert own.log.events == [Event(1, NOW + 20.1, Severity.INFO, "ended: completed")]
    own = landed(MISPLACED_M + 0.1, home=home)
    assert own.interruption.outcome is Outcome.FAILED
    assert own.reason == (why := f"the vehicle landed 3.1 m from {what}")
    assert own.interruption.trigger == failed(LANDS, why)
    assert own.log.events[0] == Event(1, NOW + 20.0, Severity.ERROR, why)


def test_where_a_landing_began_without_a_position_no_place_is_judged() -> None:
    own = Own(step=LAST)
    own.landing.land(own.tick(now=NOW, fix=None))
    own.landing.land(own.tick(now=NOW + 20.0, **(PARKED | {"fix": fix(99.0, height_m=0.0)})))
    assert own.progress.finished
    assert own.interruption.trigger is None


ROOM = {"wide": 2.0 * WANDERS_M, "narrow": 2.0 * STANDING_WANDERS_M}


def beside(room_m: float) -> Any:
    """A peer in the air that stands, so far beyond r_in."""
    of = plan()
    at = of.law.r_in * of.unit_m + room_m
    return peer(2, position_ned_m=(at, 0.0, -8.0), stop_point_m=(at, 0.0))


def test_two_in_the_air_make_room_before_they_land() -> None:
    """For what both may wander, in metres, whatever the unit is; not for ever."""
    flight, near = Flight(), beside(ROOM["wide"] - 0.1)
    goal = flight.at(3.5, near, peer(3))
    assert isinstance(goal, FlyGoal)
    assert goal.velocity_ned_mps[0] < -0.1
    assert isinstance(flight.at(9.9, near, peer(3)), FlyGoal)
    assert isinstance(flight.at(13.0, near, peer(3)), LandGoal)


def below(away_m: float) -> Any:
    """A vehicle on the ground, so far off."""
    at = {"position_ned_m": (away_m, 0.0, 0.0), "stop_point_m": (away_m, 0.0)}
    return replace(peer(2, phase=Phase.ENDED, **at), down=True)


def unheard(away_m: float) -> Any:
    """An aircraft in the air that is not on the mesh any more."""
    return peer(2, 60.0, position_ned_m=(away_m, 0.0, -8.0), stop_point_m=(away_m, 0.0))


WIDE_M = plan().law.r_in * plan().unit_m + 2.0 * WANDERS_M
STAYS = KeepClear(ground=False, room_m=WIDE_M, down=False)


@pytest.mark.parametrize(
    ("peers", "later_s", "own", "course"),
    [
        ((), 2.9, fix(), STAYS),
        ((), 3.0, fix(), LandGoal()),
        ((beside(1.0),), 3.0, fix(), STAYS),
        ((below(2.7),), 3.0, fix(), KeepClear(ground=True, room_m=WIDE_M, down=False)),
        ((below(2.9),), 3.0, fix(), LandGoal()),
        ((below(2.7),), 13.0, fix(), LandGoal()),
        ((below(2.7),), 13.0, MOVING, STAYS),  # it has only just come to rest there
        ((unheard(2.5),), 3.0, fix(), LandGoal()),
        ((below(3.5), replace(peer(3), stop_point=3.0 + 0j)), 3.0, fix(), STAYS),
    ],
)
def test_room_is_made_for_what_is_beside_and_below(
    peers: Any, later_s: float, own: Any, course: Any
) -> None:
    """For what stands on the ground below, and what flies and is heard; not for ever."""
    flight = Flight()
    for at in (0.0, later_s - 0.05, later_s):
        now = flight.own.tick(*peers, now=NOW + at, fix=own)
        intent = flight.own.landing.carry_out(now, flight.trigger, left=False)
    assert intent.course == course


def test_room_is_made_for_what_is_not_on_the_mesh() -> None:
    flight = Flight(outcome=Outcome.ABORTED)
    now = flight.own.tick(now=NOW)
    seen = OtherAircraft(0, position=3.0 + 0j, stop_point=3.0 + 0j)
    now = replace(now, peers=replace(now.peers, traffic=(seen,)))
    assert flight.own.landing.carry_out(now, flight.trigger, left=False).course == STAYS


def test_a_zone_is_left_before_the_landing() -> None:
    """Told once; for a minute at most; and it stands before it comes down."""
    flight = Flight(outcome=Outcome.ABORTED, own=Own(plan(zones=(TREE,))))
    leaves = KeepClear(ground=False, room_m=WIDE_M, down=True)

    def course(later_s: float, own: Any) -> Any:
        now = flight.own.tick(now=NOW + later_s, fix=own)
        return flight.own.landing.carry_out(now, flight.trigger, left=False).course

    assert [course(at, fix()) for at in (0.0, 30.0, 59.9)] == [leaves] * 3
    told = Event(1, NOW, Severity.WARNING, "leaves zone tree before it lands")
    assert flight.own.log.events == [told]
    away = fix(-30.0, velocity=(2.0, 0.0, 0.0))
    assert [course(at, away) for at in (60.0, 62.9, 63.0)] == [STAYS, STAYS, LandGoal()]


def test_a_zone_that_is_not_left_is_landed_in_after_a_minute() -> None:
    flight = Flight(outcome=Outcome.ABORTED, own=Own(plan(zones=(TREE,))))
    assert isinstance(flight.at(59.9), FlyGoal)
    assert isinstance(flight.at(60.0), LandGoal)


@pytest.mark.parametrize(
    ("room_m", "moves", "own_moves", "goal"),
    [
        (ROOM["narrow"], (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), LandGoal),
        (ROOM["narrow"], (0.0, 0.0, 1.0), (0.0, 0.0, 1.0), LandGoal),
        (ROOM["narrow"] - 0.5, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), FlyGoal),
        (ROOM["narrow"] + 0.1, (0.0, 0.6, 0.0), (0.0, 0.0, 0.0), FlyGoal),
        (ROOM["narrow"] + 0.1, (0.0, 0.0, 0.0), (0.6, 0.0, 0.0), FlyGoal),
        (ROOM["narrow"] + 0.1, (0.0, 0.0, 0.0), None, FlyGoal),
        (ROOM["wide"] + 0.1, (0.0, 1.0, 0.0), (0.0, 0.0, 0.0), LandGoal),
    ],
)
def test_a_small_formation_that_stands_lands_in_its_places(
    room_m: float, moves: Any, own_moves: Any, goal: type[Goal]
) -> None:
    """In a planned `land` two that stand need less room: the inner ones of a grid were pushed out
    of it by metres. Who moved as the landing began needs all of it, also once it stands."""
    flight, still = Flight(), (0.0, 0.0, 0.0)
    flight.own.interruption.lift()
    flight.own.progress.started_s = NOW
    near, off_m = beside(room_m), 7.0
    near = replace(near, stop_point=near.stop_point + off_m)
    assert near.state is not None
    for later_s, theirs, ours in ((0.1, moves, own_moves), (0.2, still, still)):
        other = replace(near, state=replace(near.state, velocity_ned_mps=theirs))
        own = None if ours is None else fix(off_m, velocity=ours)
        one = flight.own.tick(other, peer(3), now=NOW + later_s, fix=own)
        done = flight.own.act(one, flight.own.landing.land(one))
    assert isinstance(done, goal)


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
    silent = (peer(2, 60.0), peer(3, 60.0))
    assert isinstance(flight.at(10.0, *silent, fix=home), LandGoal)
    flight.at(16.0, *silent, fix=home)
    assert own.interruption.trigger is flight.trigger  # its way back is over


def test_a_way_back_stands_still_while_it_has_no_position() -> None:
    flight = Flight(RETURNS)
    assert flight.at(0.1, fix=None) == STILL
    assert flight.own.phase is Phase.RETURN


def test_a_way_back_without_a_peer_is_given_up() -> None:
    """No agent knows whose turn it is: land here, after the patience of `agent_lost_after_s`."""
    flight = Flight(RETURNS, Outcome.ABORTED)
    flight.trigger = replace(flight.trigger, cause=Cause.BATTERY)
    flight.own.interruption.go_over_to(flight.trigger)
    silent = (peer(2, 60.0), peer(3, 60.0))
    flight.at(-2.0, *silent)
    flight.at(-1.0)  # heard in between
    flight.at(0.0, *silent)
    assert isinstance(flight.at(5.0, *silent), FlyGoal)
    flight.at(5.1, *silent)
    reason = "a reason; no other agent is heard, so it lands here"
    assert given_up(flight.own, Cause.BATTERY) == (
        failed(LANDS, reason, Cause.BATTERY),
        reason,
        NOW + 5.1,
    )


def test_so_is_a_return_step() -> None:
    own, silent = Own(RETURNING, step=LAST), (peer(2, 60.0), peer(3, 60.0))
    for later_s in (0.0, 5.0, 5.1):
        one = own.tick(*silent, now=NOW + later_s)
        own.act(one, own.landing.come_back(one))
    reason = "return; no other agent is heard, so it lands here"
    assert given_up(own, Cause.PEER) == (failed(LANDS, reason, Cause.PEER), reason, NOW + 5.1)


def given_up(own: Own, cause: Cause) -> Any:
    """The trigger in force, what was said of it as an error, and since when it is in force."""
    (event,) = own.log.events
    assert own.interruption.trigger is not None
    assert own.interruption.trigger.cause is cause
    assert (event.time_s, event.level) == (own.interruption.since_s, Severity.ERROR)
    return own.interruption.trigger, event.text, own.interruption.since_s


def test_a_way_back_has_two_minutes_for_each_agent() -> None:
    """And twice the time that its own way takes, from where it begins."""
    flight, far_m = Flight(RETURNS, Outcome.ABORTED), 30.0
    most_s = 360.0 + 2.0 * far_m / plan().policies.return_speed_mps
    flight.at(0.0, fix=fix(far_m))
    flight.at(1.0, fix=fix(far_m / 2.0))
    flight.at(most_s, fix=fix(far_m / 2.0))
    assert flight.own.interruption.trigger is flight.trigger
    flight.at(most_s + 0.1)
    assert flight.own.interruption.trigger is not None
    reason = f"it took more than {most_s:.0f} s, so it lands here"
    assert reason in flight.own.interruption.trigger.reason


@pytest.mark.parametrize(
    ("held_up", "words"),
    [("", "something stands in its way home"), ("goes round zone oak", "it goes round zone oak")],
)
def test_a_way_back_that_is_blocked_says_by_what(held_up: str, words: str) -> None:
    flight = Flight(RETURNS)
    flight.at(0.0)
    flight.own.landing._way_back.blocked = True
    flight.own.controller._round = held_up
    flight.at(0.1)
    assert flight.own.interruption.reason == f"a reason; {words}, so it lands here"


def test_who_starts_in_a_zone_lands_beside_it_once_it_comes_no_nearer() -> None:
    """For eight seconds on its way, and where that very zone is in the way."""
    own = Flight(RETURNS, own=Own(plan(zones=(TREE,)))).own

    def gives_up(later_s: float, north_m: float, zone: str = "tree", height_m: float = 8.0) -> bool:
        own.controller._round = f"goes round zone {zone}"
        at = fix(north_m, velocity=(1.0, 0.0, 0.0), height_m=height_m)
        own.phase = own.landing.come_back(own.tick(now=NOW + later_s, fix=at)).phase
        return own.interruption.reason != "a reason"

    assert not gives_up(-20.0, 30.0, height_m=2.0)  # it climbs
    for later_s, north_m in ((0.0, 30.0), (1.0, 30.0), (2.0, 10.0), (3.0, 6.0), (11.0, 5.6)):
        assert not gives_up(later_s, north_m)
    assert not gives_up(11.1, 5.6, "oak")
    assert gives_up(11.2, 5.6)
    assert own.interruption.reason == "a reason; its start lies in zone tree, so it lands here"


CLOSE = tuple(
    replace(agent, start=(0.0, 1.2 * (agent.id - 1))) for agent in plan().groups[0].agents
)
"""Their starts are 2.4 m from each other."""


@pytest.mark.parametrize(
    ("peer_east_m", "zones", "lands", "said"),
    [
        (10.0, (), True, []),
        (2.4, (), True, []),
        (1.4, (), True, []),  # hardly beside its own start
        (0.8, (), False, ["return: agent 2 came down beside its start: it lands aside"]),
        (
            10.0,
            (TREE,),
            False,
            [
                "return: its start lies in zone tree: it lands beside it",
                "leaves zone tree before it lands",
            ],
        ),
    ],
)
def test_its_start_is_landed_on_but_where_something_stands_that_should_not(
    peer_east_m: float, zones: tuple[Zone, ...], lands: bool, said: list[str]
) -> None:
    """The plan keeps it, whichever vehicle stands at its own start beside that."""
    own = Own(with_group(RETURNING, agents=CLOSE), step=LAST)
    at = {"position_ned_m": (0.0, peer_east_m, 0.0), "stop_point_m": (0.0, peer_east_m)}
    lies = replace(peer(2, phase=Phase.ENDED, **at), down=True)
    for later_s in (0.0, 1.0, 1.1, 1.2):
        if later_s == 1.1:
            own.controller.set_zones(zones)  # added in flight
        one = own.tick(lies, peer(3), now=NOW + later_s)
        course = own.landing.come_back(one).course
    assert isinstance(course, LandGoal) is lands
    assert own.vehicle.landing_s == (NOW + 1.1 if lands else None)
    assert [(e.time_s, e.level, e.text) for e in own.log.events] == [
        (NOW + 1.1, Severity.WARNING, text) for text in said
    ]


def test_the_return_step_is_the_missions_own_way_back() -> None:
    own = Own(RETURNING, step=LAST)
    for later_s, goal, reason in (
        (0.0, FlyGoal, "return: climb"),
        (1.0, FlyGoal, "return: fly"),
        (1.1, LandGoal, ""),
    ):
        one = own.tick(now=NOW + later_s)
        assert isinstance(own.act(one, own.landing.come_back(one)), goal)
        assert own.phase is (Phase.RETURN if reason else Phase.LAND)
        assert own.reason == reason
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
    assert isinstance(flight.at(180.0), YieldGoal)
    assert flight.own.phase is Phase.YIELD
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
    assert flight.own.reason == (why := "a reason; still armed after 180 s")
    assert flight.own.log.events[0] == Event(1, NOW + 291.0, Severity.ERROR, why)
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
