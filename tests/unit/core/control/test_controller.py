"""The seam between the law and the safety filter: what an agent flies, and what it stores of it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm_ctl.core.control.controller import Controller
from swarm_ctl.core.model.messages import Gains
from swarm_ctl.core.model.plan import Plan, Point, Response
from swarm_ctl.core.swarm.snapshot import Formation, OtherAircraft, PeerSnapshot
from tests.unit.core.builders import GROUP, HOLD, NOW, OWN, SLOTS, UNIT_M, fix, peer, plan, snapshot

PLAN = plan()
R_IN_M, R_OUT_M = PLAN.law.r_in * UNIT_M, PLAN.law.r_out * UNIT_M
ROW = Formation({1: SLOTS[0], 2: SLOTS[1], 3: SLOTS[2]}, frozenset({2, 3}), 0j, (GROUP, HOLD, 0))


def controller(of: Plan = PLAN, north: float = 0.0, east: float = 0.0, **own: Any) -> Controller:
    """Of agent 1, at a place [m]."""
    made = Controller(of, OWN, of.response)
    made.locate(fix(north, east, **own), NOW)
    return made


def at(agent: int, north: float, east: float, age_s: float = 0.05, **told: Any) -> OtherAircraft:
    """A peer that stands there, unless `told` says otherwise."""
    place = {"position_ned_m": (north, east, -8.0), "stop_point_m": (north, east)}
    return peer(agent, age_s, **(place | told))


def speed(velocity: Point) -> float:
    return math.hypot(*velocity)


# --- what stands between the law and the vehicle ---


def anywhere(metres: float = 25.0) -> st.SearchStrategy[float]:
    return st.floats(-metres, metres, allow_nan=False)


PLACES = st.tuples(anywhere(), anywhere(), anywhere(5.0), anywhere(5.0), st.floats(0.0, 6.0))


def other(agent: int, place: tuple[float, float, float, float, float]) -> OtherAircraft:
    north, east, vn, ve, age_s = place
    return at(agent, north, east, age_s, setpoint_mps=(vn, ve), velocity_ned_mps=(vn, ve, 0.0))


@settings(max_examples=60)
@given(PLACES, PLACES, anywhere(60.0), anywhere(60.0))
def test_no_velocity_is_above_the_limit(
    second: tuple[float, ...], third: tuple[float, ...], north: float, east: float
) -> None:
    """Whatever the peers tell, in every way of flying; and what is returned is what is stored."""
    peers = snapshot(other(2, second), other(3, third))  # type: ignore[arg-type]
    own = controller(north=north, east=east)
    for flown in (own.form(peers, ROW), own.go_to(peers, (0.0, 0.0), 2.5), own.keep_clear(peers)):
        assert all(map(math.isfinite, flown))
        assert speed(flown) <= PLAN.limits.speed_mps + 1e-6
    assert own.setpoint_mps == flown


@pytest.mark.parametrize(("rare", "free_s"), [(False, 1.0), (True, 2.0)])
def test_a_silent_peer_may_have_flown_on_longer_after_a_far_word(rare: bool, free_s: float) -> None:
    """The agent leaves one second of the peer's last setpoint free, after a far word two: it does
    not fly there from ahead, and up to there it does."""
    told = {"setpoint_mps": (4.0, 0.0), "velocity_ned_mps": (4.0, 0.0, 0.0)}
    silent = replace(at(2, 0.0, 0.0, 6.0, **told), rare=rare)
    margins = controller().safety_filter.margins
    asks_m = margins.keep_out + 3.0 * margins.growth
    for beyond_m, flies in ((0.0, False), (1.5, True)):
        own = controller(north=4.0 * free_s + asks_m + beyond_m)
        north_mps, _ = own.go_to(snapshot(silent, at(3, 60.0, 60.0)), (-20.0, 0.0), 2.5)
        assert (north_mps < -0.1) is flies


@settings(max_examples=60)
@given(st.floats(0.0, 2 * math.pi), st.floats(1.05, 1.4), st.floats(0.0, 2 * math.pi))
def test_no_agent_flies_at_a_peer_that_stands_beside_it(
    bearing: float, ratio: float, wish: float
) -> None:
    """With the filter, whatever lies behind the peer."""
    gap = ratio * R_IN_M
    peer_at = gap * math.cos(bearing), gap * math.sin(bearing)
    goal = 50 * math.cos(wish), 50 * math.sin(wish)
    north, east = controller().go_to(snapshot(at(2, *peer_at)), goal, 2.5)
    assert north * peer_at[0] + east * peer_at[1] <= 1e-6 * gap


def test_it_keeps_clear_of_all_that_comes_near() -> None:
    """A peer or an aircraft that only the traffic sensor sees; far ones move nothing."""
    near, far = at(2, 0.8 * R_OUT_M, 0.0), at(2, 40.0, 0.0)
    assert controller().keep_clear(snapshot(near))[0] < 0.0
    assert speed(controller().keep_clear(snapshot(far))) == 0.0
    stranger = OtherAircraft(0, None, 4 + 0j, 4 + 0j, 0j, 0.1, 0.1, fresh=True)
    assert controller().keep_clear(PeerSnapshot(NOW, (), (stranger,)))[0] < 0.0


# --- what it stores ---


def test_the_sigma_report_has_the_pairs_within_r_out() -> None:
    own = controller()
    own.form(snapshot(at(2, 0.5 * R_OUT_M, 0.0), at(3, 0.0, 20.0)), ROW)
    report = own.sigma_report(NOW)
    assert report is not None
    assert [(pair.peer, pair.neighbour) for pair in report.pairs] == [(2, True)]
    assert report.pairs[0].distance == pytest.approx(0.5 * PLAN.law.r_out)
    assert sum(own.tally.values()) == 1


def test_a_slow_vehicle_is_flown_calmly() -> None:
    """A PX4's lag bounds the law's rate; gains that are less, and quicker vehicles', are kept."""
    fast, slow = Response(0.4, 0.62, 2.8), Response(0.0, 0.8, 8.0)
    lively = Gains(PLAN.law.delta_a, PLAN.law.delta_l, 0.2, 20.0)
    rates = []
    for vehicle in (fast, slow):
        own = Controller(PLAN, OWN, vehicle)
        own.set_gains(lively)
        rates.append(own.gain)
        assert own.gains == lively
        own.set_gains(replace(lively, h=0.05))
        assert own.gain == pytest.approx(1.0)
    assert rates == pytest.approx([4.0, 2.0])
