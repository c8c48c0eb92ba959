"""The section `simulation`: its values, the simulator's configuration, and that the plan knows
nothing of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from swarm_ctl.engine.launch.sim_config import simulator_config
from swarm_ctl.mission.compile.loader import loads
from swarm_ctl.mission.sections.simulation_section import NEUTRAL
from swarm_sim.config import SimConfig
from swarm_sim.firmware.parameters import SIM_DEFAULTS
from tests.unit.mission.example import TEXT, problems

PLACES = Path(__file__).parents[4]
SECTION = """\
simulation:
  parameters: {SIM_WIND_SPD: 4}
  faults:
    - {at_s: 30, for_s: 5, agents: [3], set: {SIM_GPS_FREEZE: 1}}
    - {at_s: 35, for_s: 10, set: {SIM_WIND_SPD: 8, SIM_BATT_DRAIN: 3}}
"""
FIRST = TEXT.count("\n") + 1
"""Line of `simulation:`."""


def test_the_parameters_are_the_simulators() -> None:
    assert {name: item.value for name, item in SIM_DEFAULTS.items()} == NEUTRAL
    text = (PLACES / "sim" / "README.md").read_text()
    assert [name for name in NEUTRAL if name not in text] == []


def test_the_simulator_is_told_what_begins_and_what_ends() -> None:
    """Under system ids, which need not be the agents'; at one time what ends comes first; back to
    the start's value."""
    loaded = loads((TEXT + SECTION).replace("sysid: 3", "sysid: 33"))
    vehicles = [
        replace(entry, endpoint=f"udpout:127.0.0.1:{15000 + entry.id}")
        for entry in loaded.fleet.agents
    ]
    told = simulator_config(loaded.plan, vehicles, loaded.file.simulation)
    config = SimConfig.model_validate(told | {"epoch_s": 0.0})
    assert config.sim_parameters == {"SIM_WIND_SPD": 4}
    assert [(fault.at_s, fault.sysid, fault.set) for fault in config.faults] == [
        (30, 33, {"SIM_GPS_FREEZE": 1}),
        (35, 33, {"SIM_GPS_FREEZE": 0}),
        *((35, sysid, {"SIM_WIND_SPD": 8, "SIM_BATT_DRAIN": 3}) for sysid in (1, 2, 33)),
        *((45, sysid, {"SIM_WIND_SPD": 4, "SIM_BATT_DRAIN": 1}) for sysid in (1, 2, 33)),
    ]


def test_vehicles_that_are_not_simulated_have_no_faults() -> None:
    """The simulator gets the faults of its vehicles; a warning names the other vehicles."""
    loaded = loads(TEXT + SECTION)
    told = simulator_config(loaded.plan, [loaded.fleet.agent(3)], loaded.file.simulation)
    assert {fault["sysid"] for fault in told["faults"]} == {3}
    ignored = "ignored by agents with a vehicle of their own: 1, 2"
    assert [warning for warning in loaded.warnings if "simulation" in warning] == [
        f"mission.yaml:{FIRST + 1}: simulation.parameters: {ignored}",
        f"mission.yaml:{FIRST + 4}: simulation.faults#2: {ignored}",
    ]


def test_gusts_that_the_keep_out_does_not_bear_are_warned_of() -> None:
    gusts = "  parameters: {SIM_WIND_GUST: 1.3}\n  faults: [{at_s: 5, set: {SIM_WIND_GUST: 2}}]\n"
    (warning,) = (each for each in loads(f"{TEXT}simulation:\n{gusts}").warnings if "gust" in each)
    assert "simulation.faults#1.set.SIM_WIND_GUST: gusts of 2 m/s" in warning
    assert warning.endswith("leave room for 1.31 m/s")


@pytest.mark.parametrize(
    ("old", "new", "line", "field", "what", "allowed"),
    [
        (
            "SIM_GPS_FREEZE",
            "SIM_GPS_FREZE",
            3,
            "simulation.faults#1.set.SIM_GPS_FREZE",
            "did you mean",
            "SIM_LOSS",
        ),
        (
            "[3]",
            "[4]",
            3,
            "simulation.faults#1.agents#1",
            "agent 4 is not in this mission",
            "one of 1, 2, 3",
        ),
        ("[3]", "[]", 3, "simulation.faults#1.agents", "has 0 entries", "1 to 250"),
        ("at_s: 30", "at_s: -1", 3, "simulation.faults#1.at_s", "-1 is out of range", "from 0"),
        ("for_s: 5", "for_s: 0", 3, "simulation.faults#1.for_s", "0 is out of range", "above 0"),
        ("{SIM_GPS_FREEZE: 1}", "{}", 3, "simulation.faults#1.set", "sets nothing", "SIM_*"),
        (
            "FREEZE: 1",
            "FREEZE: 2",
            3,
            "simulation.faults#1.set.SIM_GPS_FREEZE",
            "2 is not allowed",
            "one of 0, 1",
        ),
        (
            "SPD: 4",
            "SPD: fast",
            1,
            "simulation.parameters.SIM_WIND_SPD",
            '"fast" is text',
            "from 0 to 60",
        ),
        (
            "GPS_FREEZE: 1}",
            "WIND_SPD: 1}",
            4,
            "simulation.faults#2.at_s",
            "while faults#1 lasts",
            "36 or later",
        ),
    ],
)
def test_what_is_refused(
    old: str, new: str, line: int, field: str, what: str, allowed: str
) -> None:
    text = SECTION.replace("for_s: 5", "for_s: 6") if "WIND_SPD" in new else SECTION
    assert text.count(old) == 1
    (problem,) = problems(TEXT + text.replace(old, new))
    assert (problem.where, problem.field) == (f"trio.yaml:{FIRST + line}", field)
    assert what in problem.what
    assert allowed in problem.allowed
