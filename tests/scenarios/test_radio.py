"""Three vehicles behind one radio of 57,600 baud: flown, overloaded, cut."""

from __future__ import annotations

from pathlib import Path
from statistics import median

from swarm_ctl.core.model.timeouts import OWN_FIX_S
from swarm_ctl.engine.radio.switch import LATE_S
from swarm_ctl.mission.compile.loader import load
from tests.scenarios.radio import RadioSwarm
from tests.scenarios.swarm import flown_once, landing_fast

TRIANGLE = Path(__file__).with_name("triangle.yaml")


@flown_once
def in_formation() -> RadioSwarm:
    swarm = RadioSwarm(load(TRIANGLE))
    landing_fast(swarm)
    swarm.wait(lambda s: s.in_step(2))
    return swarm


def test_three_vehicles_form_a_triangle_with_ten_setpoints_a_second_each() -> None:
    swarm = in_formation()
    loads = []
    while swarm.in_step(2):
        swarm.run(1.0)
        loads.append(swarm.load())
    swarm.fly()
    assert set(swarm.outcomes().values()) == {"completed"}
    assert swarm.all_down
    assert swarm.closest_m > 8.0
    assert median(v.setpoints_per_s for load in loads for v in load.vehicles) == 10
    assert max(load.used_bytes_per_s for load in loads) < 5760
    assert max(swarm.position_ages_s) < LATE_S < OWN_FIX_S
    assert not any(v.dropped or v.late for v in swarm.load().vehicles)
    assert swarm.channel.overflows == 0


def test_vehicles_land_by_their_own_failsafe_when_the_link_dies() -> None:
    """Nothing that the agents say reaches them from then on, and no setpoint is repeated."""
    swarm = in_formation()
    swarm.link_alive = False
    swarm.wait(lambda s: s.all_down, until_s=swarm.now + 60)
    swarm.fly()
    assert set(swarm.outcomes().values()) == {"failed"}
    assert swarm.closest_m > 8.0


def test_a_radio_that_delivers_late_is_a_radio_that_delivers_nothing() -> None:
    """A third of the bytes from now on: positions wait, so agents do not get them, and land."""
    swarm = in_formation()
    swarm.channel.bytes_per_s /= 3
    swarm.run(10.0)
    assert sum(v.late for v in swarm.load().vehicles) > 20
    swarm.wait(lambda s: s.all_down, until_s=swarm.now + 90)
    assert swarm.closest_m > 8.0
