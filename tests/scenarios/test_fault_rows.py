"""What goes wrong while four cross each other's ways, as scenarios: all invariants of drawn flights
hold, it ends as it should, and the log says why."""

from __future__ import annotations

from typing import Any, NamedTuple

import pytest

from swarm_ctl.fuzz.invariants.table import broken
from swarm_ctl.mission.input import yaml_file
from swarm_ctl.virtual.scenario import scenario_of
from swarm_ctl.virtual.scenario_flight import ScenarioFlight
from tests.scenarios import swap
from tests.scenarios.swarm import landing_fast

FORM_S = 12.0
"""When the form step has begun."""


class Row(NamedTuple):
    """One thing that goes wrong, and what must come of it."""

    name: str
    scenario: str
    """Times count from `FORM_S`."""
    says: tuple[str, ...] = ()
    """Events that name the cause."""
    outcome: str = "completed"
    policy: str = "land"
    rate_hz: int = 10


LOST = "agent {} has not been heard for 5 s"
PARTED = "part: {one: [1, 2], other: [3, 4]}"
GUSTS = "SIM_WIND_SPD: 5, SIM_WIND_DIR: 70, SIM_WIND_GUST: 2"
SPURTS = [
    f"{{at_s: {1.2 * k:.1f}, for_s: 0.8, part: {{one: [{i}], other: {list(range(i + 1, 5))}}}}}"
    for k in range(50)
    for i in (1, 2, 3)
]

ROWS = (
    Row("half is lost", "mesh: {loss: 0.5}"),
    # never younger than FRESH_S: as if nothing were heard
    Row("0.55 s late", "mesh: {delay_s: 0.55}", (LOST.format(2),), "failed"),
    Row(
        "parted for 8 s",
        f"happens: [{{at_s: 3, for_s: 8, {PARTED}}}]",
        (LOST.format(1), LOST.format(3)),
        "failed",
    ),
    Row(
        "parted for 8 s, goes on",
        f"happens: [{{at_s: 3, for_s: 8, {PARTED}}}]",
        ("neighbours 3, 4 are not heard; the graph stays connected",),
        policy="continue",
    ),
    # as over TCP that loses packets: everything waits for what was lost
    Row("in spurts", f"happens: [{', '.join(SPURTS)}]"),
    Row(
        "one is deaf",
        "happens: [{at_s: 3, part: {one: [4], other: [1, 2, 3], one_way: true}}]",
        (LOST.format(1),),
        "failed",
    ),
    # at half the rate, what it lost first is lost in one tick with the rest
    Row(
        "one has lost the mesh",
        "happens: [{at_s: 3, part: {one: [2], other: [1, 3, 4, station]}}]",
        (LOST.format(2), "no ground station"),
        "failed",
        rate_hz=20,
    ),
    Row(
        "clocks apart, drifting; lost, late, twice",
        "mesh: {loss: 0.3, delay_s: 0.05, jitter_s: 0.15, duplicate: 0.2}\n"
        "clocks: [{agents: [1], ahead_s: 3600, drift: 1.0e-4},"
        " {agents: [2], ahead_s: -0.3, drift: -1.0e-4},"
        " {agents: [3], ahead_s: -0.7, drift: 2.0e-4}]",
    ),
    Row(
        "the clocks of two hosts jump",
        "happens: [{at_s: 3, clock: {agents: [1, 2], ahead_s: 2}},"
        " {at_s: 5, clock: {agents: [3, 4], ahead_s: -2}}]",
    ),
    Row(
        "GPS jumps and comes back",
        "happens: [{at_s: 3, for_s: 2, vehicle: {agents: [2], set: {SIM_GPS_JUMP_E: 3}}}]",
    ),
    Row(
        "frozen for 10 s", "happens: [{at_s: 3, stop: [3], for_s: 10}]", (LOST.format(3),), "failed"
    ),
    # the others follow what it says, and it follows the others: the shape never comes to rest, and
    # drifts to the fence
    Row(
        "lies by 3 m",
        "happens: [{at_s: 1, says: {agents: [2], moved_m: [3, 0]}}]",
        ("kept inside the fence, drawn there by the place that agent 2 tells",),
        "failed",
    ),
    Row(
        "a vehicle restarts in the air",  # and falls; its telemetry is not asked for again
        "happens: [{at_s: 3, vehicle: {agents: [2], set: {SIM_REBOOT: 1}}}]",
        ("disarmed by a pilot or by its own failsafe",),
        "failed",
    ),
    Row(
        "gusts, lost, late",
        "mesh: {loss: 0.2, delay_s: 0.05, jitter_s: 0.1}\n"
        f"happens: [{{at_s: -12, vehicle: {{agents: [1, 2, 3, 4], set: {{{GUSTS}}}}}}}]",
    ),
    Row(
        "the vehicles' radio loses a fifth",
        "happens: [{at_s: -12, vehicle: {agents: [1, 2, 3, 4], set: {SIM_LOSS: 20}}}]",
    ),
)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_fault(row: Row) -> None:
    written: dict[str, Any] = yaml_file.parse(row.scenario, row.name).data
    for each in written.get("happens", ()):
        each["at_s"] += FORM_S
    mission = swap.text(row.policy, row.rate_hz)
    written |= {"version": 1, "mission": yaml_file.parse(mission, row.name).data}
    flight = ScenarioFlight(*scenario_of(yaml_file.write(written)))
    landing_fast(flight.swarm)
    flown = flight.fly()
    assert broken(flown) == []
    assert flown.summary.outcome == row.outcome, flown.summary.reason
    said = "\n".join(event.text for event in flown.events)
    assert [text for text in row.says if text not in said] == []
