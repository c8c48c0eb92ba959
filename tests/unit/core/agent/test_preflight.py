"""What keeps a vehicle on the ground: each check with a row that refuses and one at its limit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from swarm_ctl.core.agent.preflight import EstimateWatch, Preflight, ResponseWatch
from swarm_ctl.core.agent.tick import Tick
from swarm_ctl.core.control.navigation import Navigator
from swarm_ctl.core.law.own_response import OwnResponse
from swarm_ctl.core.model.frames import geodetic_from_ned
from swarm_ctl.core.model.plan import Response
from swarm_ctl.core.model.vehicle import FlightLimit, GlobalFix, LimitKind
from swarm_ctl.core.swarm.snapshot import OtherAircraft
from tests.unit.core.builders import NOW, ORIGIN, OWN, PARKED, UNIT_M, fix, peer, plan, tick, view

PLAN = plan()
OTHER = PLAN.hash() + 1


def preflight(*, expect_station: bool = False) -> Preflight:
    navigator = Navigator(PLAN.origin)
    return Preflight(PLAN, PLAN.agent(OWN), PLAN.hash(), navigator, expect_station, PLAN.response)


def on_ground(*peers: OtherAircraft, **changes: Any) -> Tick:
    return tick(*peers, **(PARKED | {"fix": fix(height_m=0.0)} | changes))


def global_fix(north: float) -> GlobalFix:
    """GLOBAL_POSITION_INT so far north of the origin [m]."""
    return GlobalFix(NOW, geodetic_from_ned((north, 0.0, 0.0), ORIGIN), 0.0, (0.0, 0.0, 0.0))


def unknown_clock() -> OtherAircraft:
    return replace(peer(2), clock_unknown=True)


NEVER = float("inf")
SPEED, CLIMB = LimitKind.SPEED, LimitKind.CLIMB
LIMITS = [
    (
        FlightLimit(SPEED, 4.9, "MPC_XY_VEL_MAX 4.9"),
        "the mission flies 5.0 m/s; vehicle 1 allows 4.9 (MPC_XY_VEL_MAX 4.9)",
    ),
    (FlightLimit(SPEED, 5.0, "WPNAV_SPEED 500"), ""),
    (
        FlightLimit(CLIMB, 0.5, "WP_SPD_UP 0.5"),
        "the mission climbs 1.0 m/s; vehicle 1 allows 0.5 (WP_SPD_UP 0.5)",
    ),
    (FlightLimit(LimitKind.DESCENT, 0.9, "WP_SPD_DN 0.9"), "the mission descends 1.0 m/s"),
    (
        FlightLimit(LimitKind.ACCELERATION, 1.2, "WPNAV_ACCEL 100"),
        "accelerates 2.8 m/s2; vehicle 1 allows 1.2 (WPNAV_ACCEL 100)",
    ),
    (FlightLimit(LimitKind.ACCELERATION, 2.6, "WPNAV_ACCEL 217"), ""),
]
ROWS: list[tuple[str, Callable[[], Tick], str]] = [
    ("all is well", on_ground, ""),
    (
        "not healthy",
        lambda: on_ground(healthy=False, health_reason="no SYS_STATUS"),
        "no SYS_STATUS",
    ),
    ("no position", lambda: on_ground(fix=None), "no position yet"),
    ("an old position", lambda: on_ground(fix=fix(age_s=0.51)), "no position yet"),
    ("a position just fresh", lambda: on_ground(fix=fix(age_s=0.5)), ""),
    (
        "beside its start",
        lambda: on_ground(fix=fix(1.5, 1.5)),
        "the vehicle stands 2.1 m from its planned start; allowed: 2 m",
    ),
    ("one unit from its start", lambda: on_ground(fix=fix(0.0, UNIT_M)), ""),
    (
        "two positions",
        lambda: on_ground(global_=global_fix(5.1)),
        "global and local position differ by 5.1 m; allowed: 5 m",
    ),
    ("nearly one position", lambda: on_ground(global_=global_fix(4.9)), ""),
    ("no global position", lambda: on_ground(global_=None), ""),
    (
        "an inaccurate position",
        lambda: on_ground(position_accuracy_m=3.4),
        "position accuracy 3.4 m; allowed: at most 1.0 m",
    ),
    ("a position just accurate enough", lambda: on_ground(position_accuracy_m=1.0), ""),
    ("an estimate's fault", lambda: on_ground(estimate_fault="no 3D fix"), "no 3D fix"),
    *(
        (f"too slow: {refusal}", lambda limit=limit: on_ground(limits=(limit,)), refusal)
        for limit, refusal in LIMITS
    ),
    (
        "limits not read",
        lambda: on_ground(unread_limits=("WP_SPD or WPNAV_SPEED",)),
        "parameters not read yet: WP_SPD or WPNAV_SPEED",
    ),
    ("battery", lambda: on_ground(battery_percent=19.0), "battery at 19 %; allowed: the reserve"),
    ("battery at the reserve", lambda: on_ground(battery_percent=20.0), ""),
    ("battery unknown", lambda: on_ground(battery_percent=None), ""),
    (
        "a peer's plan",
        lambda: on_ground(peer(2), peer(3, plan_hash=OTHER)),
        "agent 3 has another plan",
    ),
    ("a peer not heard", lambda: on_ground(peer(2), peer(3, NEVER)), ""),
    ("a station's plan", lambda: on_ground(plan_hash=OTHER), "station desk has another plan"),
    ("no station", lambda: on_ground(station_age_s=None), ""),
    (
        "a peer's clock",
        lambda: on_ground(unknown_clock()),
        "agent 2 is heard and has not answered yet",
    ),
    # which of two is told
    ("vehicle first", lambda: on_ground(plan_hash=OTHER, battery_percent=1.0), "battery at 1 %"),
    ("plan before clock", lambda: on_ground(unknown_clock(), plan_hash=OTHER), "another plan"),
]


def test_a_charge_that_is_not_told_is_a_caution_and_no_refusal() -> None:
    """battery_low can't act on what is not known."""
    words = "the vehicle does not say its charge: the reserve of 20 % can't act"
    assert words in preflight().caution(on_ground(battery_percent=None))
    assert words not in preflight().caution(on_ground(battery_percent=50.0))


@pytest.mark.parametrize(("what", "make", "refusal"), ROWS, ids=[row[0] for row in ROWS])
def test_what_is_refused(what: str, make: Callable[[], Tick], refusal: str) -> None:
    found = preflight().refusal(make())
    assert refusal in found if refusal else found == ""


@pytest.mark.parametrize(
    ("left_h", "refusal"),
    [
        (24.0, ""),
        (23.4, "its certificate ends in 23 h; allowed: 24 h and more (swarm-ctl trust rotate)"),
        (-1.0, "its certificate has ended; allowed: 24 h and more (swarm-ctl trust rotate)"),
    ],
)
def test_a_certificate_that_ends_soon_keeps_the_vehicle_down(left_h: float, refusal: str) -> None:
    check = replace(preflight(), keys_end_s=NOW + left_h * 3600.0)
    assert check.refusal(on_ground()) == refusal


def test_a_station_that_is_expected_has_to_be_heard() -> None:
    check = preflight(expect_station=True)
    assert check.refusal(on_ground(station_age_s=None)) == "no ground station heard yet"
    assert check.refusal(on_ground()) == ""


# --- the estimate in the air: what is said at which time, and what the watch then says ---

GOOD, BAD = 2.0, 2.1


@pytest.mark.parametrize(
    ("said", "doubted"),
    [
        ([(0, BAD), (1.9, BAD)], False),
        ([(0, BAD), (2, BAD)], True),
        ([(0, GOOD), (2, GOOD)], False),
        ([(0, BAD), (2, BAD), (3.9, GOOD)], True),
        ([(0, BAD), (2, BAD), (4, GOOD)], False),
        ([(0, BAD), (1, GOOD), (2, BAD)], True),
        ([(0, BAD), (2, GOOD), (3, BAD)], False),
        ([(0, BAD), (1, GOOD)], False),
        ([(0, BAD), (1, None), (3, None)], False),
    ],
)
def test_a_doubt_counts_once_it_lasts(
    said: list[tuple[float, float | None]], doubted: bool
) -> None:
    watch = EstimateWatch(2.0)
    found = [watch.look(t, view(position_accuracy_m=accuracy)) for t, accuracy in said]
    assert found[-1] == ("position accuracy 2.1 m; allowed: at most 2.0 m" if doubted else "")


def test_a_lasting_doubt_is_one_sentence() -> None:
    """Another sentence each tick would be a new failsafe each tick."""
    watch = EstimateWatch(2.0)
    found = {watch.look(t, view(position_accuracy_m=3.0 + t)) for t in (0.0, 2.0, 3.0, 4.0)}
    assert found == {"", "position accuracy 3.0 m; allowed: at most 2.0 m"}


@pytest.mark.parametrize(
    ("late_s", "doubt_s", "said"),
    [
        (0.71, 0.08, "the vehicle answers 0.71 s later than its response says, which is known to"),
        (-0.7, 0.08, "the vehicle answers 0.70 s earlier than its response says"),
        (0.57, 0.08, ""),  # may be 0.49
        (0.9, 0.11, ""),  # not sure yet
    ],
)
def test_a_vehicle_that_leaves_the_doubt_of_its_response_is_said_once(
    late_s: float, doubt_s: float, said: str
) -> None:
    response = Response()
    watch, estimate = ResponseWatch(response), OwnResponse(response, 0.05)
    assert watch.look(estimate) == ""
    estimate.estimate = estimate.estimate._replace(late_s=late_s, doubt_s=doubt_s)
    assert watch.look(estimate).startswith(said)
    assert watch.look(estimate) == ""
