"""The hexagon on three hosts, two agents on each: a router or a host that is lost, clocks that
differ, links that lose much.

Every vehicle's own link stays whole. Agents act by policy, and no two vehicles come too near.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.hosts.namespaces import why_not
from tests.hosts.relay import Air
from tests.hosts.split import HostClock, Links, Split
from tests.hosts.test_split_mesh import assert_apart_and_down

pytestmark = [
    pytest.mark.long,
    pytest.mark.timeout(300),
    pytest.mark.skipif(bool(why_not()), reason=why_not() or "-"),
]

MISSION = """
version: 1
name: hosts
origin: {{lat_deg: 47.4, lon_deg: 8.5, alt_m: 400}}
unit_m: 5
law: {{r: 4.5, r_out: 1.5, r_in: 0.5}}
agents:
  - {{id: 1, start: [14, 16]}}
  - {{id: 2, start: [12, 12]}}
  - {{id: 3, start: [10, 18]}}
  - {{id: 4, start: [6, 12]}}
  - {{id: 5, start: [6, 16]}}
  - {{id: 6, start: [14, 10]}}
shapes:
  hexagon: {{kind: ring, count: 6, side: 2}}
policies: {{agent_lost: {lost}, station_lost: {lost}}}
steps:
  - takeoff: {{height_m: 5}}
  - form: {{shape: hexagon, slots: nearest, tolerance_m: 0.5, settle_s: 5, timeout_s: 120}}
  - hold: {{duration_s: {hold_s}}}
  - land
"""
FORM, HOLD = 2, 3
SIDES = ((1, 2), (3, 4), (5, 6))
ALL = range(1, 7)


def hosts(
    where: Path, links: Links, lost: str = "land", hold_s: float = 3, **more: object
) -> Split:
    mission = MISSION.format(lost=lost, hold_s=hold_s)
    return Split(mission, SIDES, where, 1, links, **more)  # type: ignore[arg-type]  # Split's own


def near(flight: Split, *sides: int) -> bool:
    """Each station, or that of these sides, has heard every agent of the mission in the last
    second."""
    heard = [flight.agents(side) for side in sides or range(len(SIDES))]
    return all(
        len(agents) == len(ALL) and all(agent["age_s"] < 1.0 for agent in agents.values())
        for agents in heard
    )


def test_a_router_is_lost_and_started_again(tmp_path: Path) -> None:
    """Its host's agents hear no peer meanwhile, and hold; then all go on."""
    with hosts(tmp_path, Links.ROUTERS, "hold") as flight:
        flight.wait_step(FORM)
        flight.routers[1].kill()
        flight.wait_s(6)
        flight.start_router(1)
        flight.wait_for(lambda: near(flight), 30)
        assert flight.finish(180) == dict.fromkeys(ALL, 0)
        assert_apart_and_down(flight)


def test_a_host_is_lost(tmp_path: Path) -> None:
    """Both its agents and its router die in the air: the others land, and say which they miss; its
    vehicles land by their own failsafe."""
    with hosts(tmp_path, Links.ROUTERS) as flight:
        flight.wait_step(FORM)
        flight.kill_host(1)
        assert flight.finish(180) == dict.fromkeys((1, 2, 5, 6), 1)
        for agent in (1, 2, 5, 6):
            assert "has not been heard" in flight.said(agent)
        assert_apart_and_down(flight)


def test_hosts_that_part_and_meet_again(tmp_path: Path) -> None:
    """Each router is cut off from the others for 12 s. Agents hear those of their own host
    meanwhile, and hold; then all go on."""
    with hosts(tmp_path, Links.ROUTERS, "hold") as flight:
        flight.wait_step(FORM)
        flight.air(Air(cut=True))
        flight.wait_s(12)
        assert all(not near(flight, side) for side in range(len(SIDES)))
        flight.air(Air())
        flight.wait_for(lambda: near(flight), 30)
        assert flight.finish(180) == dict.fromkeys(ALL, 0)
        assert_apart_and_down(flight)


@pytest.mark.parametrize("links", [Links.ONE_ROUTER, Links.ONE_TCP_ROUTER], ids=["udp", "tcp"])
def test_a_host_gets_another_address(tmp_path: Path, links: Links) -> None:
    """Its agents and its station connect to the router of another host anew, by themselves."""
    with hosts(tmp_path, links, "hold") as flight:
        flight.wait_step(FORM)
        flight.network.move(1, "10.77.0.52")
        flight.wait_s(3)
        flight.wait_for(lambda: near(flight), 30)
        assert flight.finish(180) == dict.fromkeys(ALL, 0)
        assert_apart_and_down(flight)


def test_dates_that_are_stepped_in_flight(tmp_path: Path) -> None:
    """NTP sets one host's date an hour ahead and another's a day back while they form: a flight
    goes by clocks that no date moves."""
    step = tmp_path / "step"
    clocks = {
        1: HostClock(step_s=3600.0, step_at=step),
        2: HostClock(step_s=-86400.0, step_at=step),
    }
    with hosts(tmp_path, Links.HOSTS, clocks=clocks) as flight:
        flight.wait_step(FORM)
        assert len(list(tmp_path.glob("step.*"))) == len((*SIDES[1], *SIDES[2]))
        step.touch()
        assert flight.finish(180) == dict.fromkeys(ALL, 0)
        assert_apart_and_down(flight)


def test_clocks_of_several_hosts(tmp_path: Path) -> None:
    """One is an hour ahead, one is a day behind and 300 ppm fast: all fly as with one clock, over
    links that lose a twentieth and take 20 ms."""
    clocks = {1: HostClock(3600.0), 2: HostClock(-86400.0, 1.0003)}
    air = Air(loss=0.05, delay_s=0.02)
    with hosts(tmp_path, Links.HOSTS, clocks=clocks, air=air) as flight:
        assert flight.finish(180) == dict.fromkeys(ALL, 0)
        assert_apart_and_down(flight)


@pytest.mark.parametrize("links", [Links.HOSTS, Links.TCP_ROUTERS])
def test_links_that_lose_a_fifth(tmp_path: Path, links: Links) -> None:
    """And take 100 ms each way. The shape stands 120 s after the start of the processes; with the
    default patience no agent takes another for lost."""
    with hosts(tmp_path, links, air=Air(loss=0.2, delay_s=0.1)) as flight:
        flight.wait_step(HOLD, 120)
        assert flight.finish(120) == dict.fromkeys(ALL, 0)
        assert_apart_and_down(flight)
