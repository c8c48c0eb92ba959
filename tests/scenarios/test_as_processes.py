"""A scenario is one file: as processes in lockstep it leaves the truth of the virtual clock, byte
for byte; what can't be the same there is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from swarm_ctl.errors import InputError
from swarm_ctl.fuzz import campaign
from swarm_ctl.fuzz.campaign import fly, unlike_as_processes
from swarm_ctl.mission.compile.loader import LoadedMission
from swarm_ctl.mission.input import yaml_file
from swarm_ctl.virtual.as_processes import run_script
from swarm_ctl.virtual.scenario import Scenario, load_scenario, scenario_of
from swarm_ctl.virtual.scenario_file import is_scenario
from swarm_ctl.virtual.scenario_flight import FlownScenario, fly_scenario
from tests.system.pair import BARE
from tests.system.running import LOW, Running

HEAD = f"version: 1\nname: both\nmission: {LOW}\nseed: 5\nlands_after_s: 10\n"
HAPPENS = """
mesh: {loss: 0.2, delay_s: 0.05, jitter_s: 0.1, duplicate: 0.1}
clocks:
  - {agents: [2], ahead_s: 100, drift: 0.0001}
happens:
  - {at_s: 7, order: next}
  - {at_s: 10, vehicle: {agents: [1], set: {SIM_GPS_NOISE: 0.3}}, for_s: 3}
  - {at_s: 13, order: hold}
  - {at_s: 14, says: {agents: [1], moved_m: [0.4, 0]}, for_s: 2}
  - {at_s: 15, order: "form row"}
  - {at_s: 16, clock: {agents: [2], ahead_s: 3}}
  - {at_s: 17, part: {one: [1, station], other: [2, 3]}, for_s: 1.5}
  - {at_s: 18, order: "tune h=0.04"}
  - {at_s: 20, order: resume}
  - {at_s: 21, stop: [3], for_s: 2}
  - {at_s: 22, pilot: {agents: [3], mode: land}}
  - {at_s: 23, part: {one: [3], other: [1], one_way: true}, for_s: 2}
  - {at_s: 24, kill: [2]}
  - {at_s: 25, station: gone}
"""


@pytest.mark.lockstep
@pytest.mark.timeout(120)
def test_processes_fly_what_the_virtual_clock_flies(tmp_path: Path) -> None:
    """All kinds of happenings, but those that are refused: the truth is the same."""
    path = tmp_path / "both.yaml"
    path.write_text(HEAD + HAPPENS)
    flown = fly_scenario(*load_scenario(path), tmp_path / "virtual")
    with Running("run", path, "--headless", "--no-report", cwd=tmp_path) as running:
        assert running.wait(90) == (0 if flown.summary.outcome == "completed" else 1)
        running.assert_nothing_left()
    assert "lockstep:" not in running.output, running.output
    truth = (running.folder / "truth.jsonl").read_bytes()
    assert truth == (tmp_path / "virtual" / "truth.jsonl").read_bytes()
    assert running.summary()["outcome"] == flown.summary.outcome
    refused = [each.model_dump() for each in flown.summary.refused_orders]
    assert running.summary()["refused_orders"] == refused
    assert [(each["time_s"], each["order"]) for each in refused] == [(7.0, "next")]
    assert load_scenario(running.folder / "scenario.yaml")[0] == flown.scenario


@pytest.mark.lockstep
@pytest.mark.timeout(120)
def test_a_drawn_flight_is_held_against_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    """What they fly otherwise is found. What can't happen to processes is left out."""
    mission = yaml_file.parse(BARE, "pair").data
    text = yaml_file.write({"version": 1, "mission": mission, "seed": 5})
    restarts = f"{text}happens: [{{at_s: 9, kill: [2]}}, {{at_s: 12, restart: [2]}}]\n"
    assert fly(*scenario_of(restarts), lockstep=True)[1] == []

    def otherwise(scenario: Scenario, mission: LoadedMission, folder: Path) -> FlownScenario:
        return fly_scenario(scenario.model_copy(update={"seed": 6}), mission, folder)

    monkeypatch.setattr(campaign, "fly_scenario", otherwise)
    assert "truth is another one" in unlike_as_processes(*scenario_of(text))


@pytest.mark.parametrize(
    ("happens", "said"),
    [
        ("{at_s: 9, restart: [2]}", r"happens\[0\], restart at 9 s: .*here: all but restart"),
        ("{at_s: 9, station: gone, for_s: 5}", r"happens\[0\], station at 9 s: .*allowed here"),
        ("{at_s: 0, kill: [2]}", r"happens\[0\], kill at 0 s: .*allowed here: after 0 s"),
    ],
)
def test_what_can_not_be_the_same_is_refused(tmp_path: Path, happens: str, said: str) -> None:
    """With its place, and with what is allowed."""
    path = tmp_path / "refused.yaml"
    path.write_text(f"{HEAD}happens:\n  - {happens}\n")
    scenario, mission = load_scenario(path)
    with pytest.raises(InputError, match=said):
        run_script(scenario, mission.plan)


def test_a_scenario_is_told_from_a_mission(tmp_path: Path) -> None:
    path = tmp_path / "both.yaml"
    path.write_text(HEAD)
    assert is_scenario(path)
    assert not is_scenario(LOW)
    with Running("run", path, "--headless", "--seed", "3", cwd=tmp_path) as running:
        assert running.wait(20) == 2
    assert "--seed 3" in running.output
    assert "its seed" in running.output
