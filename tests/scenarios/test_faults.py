"""The fault timetable of a mission file, on the virtual clock: what is set happens, to whom, when,
and ends."""

from __future__ import annotations

import math

import pytest

from swarm_ctl.api.virtual_flight import VirtualFlight
from swarm_ctl.testing.plugin import Fly
from tests.scenarios.swarm import landing_fast

TEXT = """\
version: 1
name: trouble
origin: {lat_deg: -35.36, lon_deg: 149.16, alt_m: 584}
lengths: metres
tick_s: 0.1
law: {r: 45, r_out: 9, r_in: 3}
agents:
  - {id: 1, start: [0, 0]}
  - {id: 2, start: [0, 12]}
  - {id: 3, start: [0, 24]}
shapes:
  row: {kind: line, spacing: 12}
steps:
  - takeoff: {height_m: 5}
  - form: {shape: row, settle_s: 2}
  - hold: {duration_s: 20}
  - land
policies: {agent_lost: continue}
fleet:
  agents: [{id: 1}, {id: 2, sysid: 12, autopilot: px4}, {id: 3}]
simulation:
  faults:
    - {at_s: 18, for_s: 5, agents: [2], set: {SIM_GPS_JUMP_N: 3.5}}
    - {at_s: 25, agents: [3], set: {SIM_BATT_FAIL: 1}}
"""


def test_what_the_timetable_says_happens(swarm: Fly) -> None:
    """From the first lift-off on: a position that jumps moves the vehicle the other way, and back;
    an empty battery is the end of one agent."""
    flight = swarm(TEXT, virtual=True)
    assert isinstance(flight, VirtualFlight)

    swarm_flown = landing_fast(flight.swarm)
    swarm_flown.wait(lambda flown: any(flown.hub.world.airborne()))
    lifted_s = swarm_flown.now

    def at(time_s: float) -> dict[int, tuple[float, float]]:
        flight.wait_s(lifted_s + time_s - swarm_flown.now)
        return swarm_flown.positions()

    before, during, after = at(17.9), at(22.5), at(27.0)
    assert during[2][0] - before[2][0] == pytest.approx(-3.5, abs=1.0)
    assert math.dist(after[2], before[2]) < 1.0
    assert max(math.dist(during[i], before[i]) for i in (1, 3)) < 1.5
    run = flight.finish()
    assert run.outcomes == {1: "completed", 2: "completed", 3: "failed"}
    assert run.closest_m > 3.0
    assert run.truth is not None
    told = [(event.sysid, event.event) for event in run.truth.events if "SIM_" in event.event]
    assert told == [(12, "SIM_GPS_JUMP_N 3.5"), (12, "SIM_GPS_JUMP_N 0"), (3, "SIM_BATT_FAIL 1")]
