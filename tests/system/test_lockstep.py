"""Runs in lockstep: the same flight on any machine, and no process that dies or stops holds it
up (`test_run.py` has what a flight in real time survives, too)."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from swarm_ctl.core.model.fleet import Fleet
from swarm_ctl.mission.compile.loader import load
from swarm_ctl.mission.compile.plan_file import plan_to_json
from swarm_ctl.runfolder.manifest import read_manifest
from swarm_ctl.virtual.virtual_swarm import VirtualSwarm, configuration
from swarm_sim.network.server import DRAIN_S
from swarm_sim.world.truth_recorder import TruthFile, TruthRecorder
from tests.on_demand import on_demand
from tests.system.conftest import Typed
from tests.system.running import HELD, HEXAGON, LOW, ROOT, Running
from tests.system.test_run import assert_apart, assert_truth_ends_on_the_ground

WOOD = ROOT / "missions" / "wood.yaml"

pytestmark = [pytest.mark.lockstep, pytest.mark.timeout(300)]

MAX = ("--speedup", "max", "--headless", "--no-report")
RUN = ("run", LOW, "--lockstep", "--speedup", "5", "--headless", "--no-report")
FAULTS = """
simulation:
  parameters: {SIM_WIND_SPD: 3, SIM_WIND_GUST: 1, SIM_GPS_NOISE: 0.1}
  faults:
    - {at_s: 2, for_s: 6, set: {SIM_LOSS: 30}}
    - {at_s: 5, for_s: 5, agents: [2, 3], set: {SIM_DELAY: 0.2}}
"""

TWENTY = """
version: 1
name: twenty
origin: {lat_deg: -35.36, lon_deg: 149.16, alt_m: 584}
unit_m: 1
law: {r: 14.5, r_out: 6, r_in: 2.5}
vehicle: {limits: {speed_mps: 4}}
agents:
"""
TWENTY += "".join(f"  - {{id: {k + 1}, start: [{k % 2 * 10}, {k // 2 * 10}]}}\n" for k in range(20))
TWENTY += """
shapes:
  block: {kind: grid, spacing: 9, columns: 5}
steps:
  - takeoff: {height_m: 4}
  - form: {shape: block, settle_s: 1, timeout_s: 100}
  - land
"""


@contextmanager
def busy(loops: int) -> Iterator[None]:
    """So many processes that take all the time they get."""
    code = "while True: pass"
    running = [subprocess.Popen([sys.executable, "-c", code]) for _ in range(loops)]
    try:
        yield
    finally:
        for process in running:
            process.kill()
            process.wait()


def left_by(running: Running, *names: str) -> list[bytes]:
    return [(running.folder / name).read_bytes() for name in names]


def virtual_truth(mission: Path, seed: int, truth: Path) -> bytes:
    """Of the same mission in this process, on a virtual clock."""
    swarm = VirtualSwarm(load(mission), seed, lockstep=True)
    config = configuration(load(mission), seed)
    swarm.hub.recorder = TruthRecorder(swarm.hub.world, config, TruthFile(truth))
    swarm.fly()
    swarm.tick()  # in which the simulator learns that no agent is left
    until = swarm.hub.world.time_s + DRAIN_S
    while not swarm.all_down and swarm.hub.world.time_s < until:
        swarm.tick()
    swarm.hub.recorder.close()
    return truth.read_bytes()


def test_the_same_flight_beside_a_busy_loop(tmp_path: Path) -> None:
    """A run beside a busy loop, with wind, noise, lost and late frames by a seed: the truth is
    that of one process on a virtual clock, byte for byte; another seed's is not. Of two runs, with
    their events: `tests/scenarios/test_plugin.py`; of drawn flights: `fuzz --lockstep`."""
    mission = tmp_path / "faults.yaml"
    lower = LOW.read_text().replace("height_m: 4", "height_m: 2").replace("_s: 5}", "_s: 1}")
    mission.write_text(lower + FAULTS)
    more = ("--seed", "7", "--junit", "j.xml")
    with Running("run", mission, *MAX, *more, cwd=tmp_path) as running:
        running.wait_for(lambda: "starting" in running.output)
        with busy(1):
            assert running.wait(120) == 0, running.output
        running.assert_nothing_left()
    assert 'failures="0"' in (tmp_path / "j.xml").read_text()
    truth = left_by(running, "truth.jsonl")
    assert truth == [virtual_truth(mission, 7, tmp_path / "7.jsonl")]
    assert truth != [virtual_truth(mission, 8, tmp_path / "8.jsonl")]
    assert running.summary()["tick"]["overruns"] == 0
    assert not any(link["lost"] for link in running.summary()["links"])


@pytest.mark.parametrize("seed", [on_demand(seed) for seed in range(1, 21)])
def test_the_wood(tmp_path: Path, seed: int) -> None:
    """All steps of the mission among zones: by the simulator's truth none comes nearer to one than
    its clearance, and no two come under r_in. One flight of it is in every run, on the virtual
    clock (`tests/scenarios/test_zones.py`)."""
    with Running("run", WOOD, *MAX, "--seed", str(seed), cwd=tmp_path) as running:
        assert running.wait(280) == 0, running.output
        running.assert_nothing_left()
    summary = running.summary()
    assert [step["result"] for step in summary["steps"]] == ["done"] * 6
    assert summary["nearest_zone"]["distance_m"] > 1.25
    assert summary["min_true_distance_m"] > summary["r_in_m"]


def test_an_agent_is_stopped(tmp_path: Path) -> None:
    """After the bound it is noted, and mission time goes on without it: its vehicle's failsafe
    acts, the others land, `run` ends it 5 s later and reports."""
    run = ("run", HELD, *MAX)
    with Running(*run, "--lockstep-patience", "3", cwd=tmp_path) as running:
        running.wait_for_event("step 2:", 3)
        running.kill("agent-2", signal.SIGSTOP)
        assert running.wait() == 1, running.output
        running.assert_nothing_left()
        assert "agent-2 has not done its tick for 3 s of the wall clock" in running.output
        assert "agent-2 has hung for 8 s and is killed" in running.output
        assert running.summary()["outcome"] == "failed"
        assert_truth_ends_on_the_ground(running.folder)
        assert_apart(running.folder)


@pytest.mark.long
def test_a_stopped_agent_comes_back(tmp_path: Path) -> None:
    """It takes part again from a later tick, and the flight ends without a process that hangs."""
    with Running(*RUN, "--lockstep-patience", "1", cwd=tmp_path) as running:
        running.wait_for_event("step 2:", 3)
        running.kill("agent-2", signal.SIGSTOP)
        running.wait_for(lambda: "has not done its tick" in running.output)
        running.kill("agent-2", signal.SIGCONT)
        running.wait_for(lambda: "agent-2 is back" in running.output)
        assert running.wait() in (0, 1), running.output
        running.assert_nothing_left()
        assert_truth_ends_on_the_ground(running.folder)


@pytest.mark.long
def test_an_agent_is_started_again(tmp_path: Path) -> None:
    """By hand, after it was killed: it joins at a tick, takes its vehicle over, and the flight ends
    in order."""
    with Running(*RUN, cwd=tmp_path) as running:
        running.wait_for_event("step 2:", 3)
        running.kill("agent-3")
        told, plan = read_manifest(running.folder), tmp_path / "plan.json"
        plan.write_text(plan_to_json(told.plan, Fleet(told.fleet, None, told.signing)))
        words = ("agent", plan, "--id", "3", "--lockstep", running.folder)
        with Running(*words, cwd=tmp_path) as again:
            again.wait_for(lambda: '"agent":3' in states_of_3_after_it(running), 60)
            assert running.wait() == 1, running.output
            assert again.wait(30) in (0, 1), again.output
        running.assert_nothing_left()
        assert_truth_ends_on_the_ground(running.folder)
        assert_apart(running.folder)


def states_of_3_after_it(running: Running) -> str:
    """What agent 3 has said since it was lost: only a new process of it says anything."""
    lines = (running.folder / "events.jsonl").read_text().splitlines()
    lost = [i for i, line in enumerate(lines) if "neighbour 3 is not heard" in line]
    return "\n".join(lines[lost[0] :]) if lost else ""


@pytest.mark.long
def test_the_clock_is_killed(tmp_path: Path) -> None:
    """The flight goes on by the wall clock and completes."""
    with Running(*RUN, cwd=tmp_path) as running:
        running.wait_for_event("step 2:", 3)
        running.kill("clock")
        assert running.wait() == 0, running.output
        running.assert_nothing_left()
        assert_truth_ends_on_the_ground(running.folder)
        assert_apart(running.folder)


@pytest.mark.long
def test_the_clock_is_stopped(tmp_path: Path) -> None:
    """All processes give it up at the same moment, and the flight completes by the wall clock."""
    with Running(*RUN, cwd=tmp_path) as running:
        running.wait_for_event("step 2:", 3)
        running.kill("clock", signal.SIGSTOP)
        assert running.wait(120) == 0, running.output
        running.assert_nothing_left()
        assert_apart(running.folder)


def test_a_vehicle_with_its_own_clock_is_refused(tmp_path: Path, typed: Typed) -> None:
    """Before anything starts, with the reason and what is allowed."""
    mission = tmp_path / "own.yaml"
    line = "{id: 4, sysid: 4, autopilot: ardupilot}"
    entry = "{id: 4, sysid: 4, autopilot: ardupilot, endpoint: 'udpin:127.0.0.1:14550'}"
    mission.write_text(HEXAGON.read_text().replace(line, entry))
    code, _, errors = typed("run", str(mission), *MAX)
    assert code == 2
    assert "agent 4 flies the vehicle at udpin:127.0.0.1:14550" in errors
    assert "allowed: simulated vehicles" in errors
    code, _, errors = typed("run", str(HEXAGON), *MAX, "--vehicles", "px4")
    assert code == 2
    assert "its own simulator interface" in errors
    assert not (tmp_path / "runs").exists()


@pytest.mark.long
def test_a_large_swarm_flies_the_same_twice(tmp_path: Path) -> None:
    """Twenty agents with near and far peers that change as two rows become a block: two runs beside
    busy loops and a virtual clock have the same truth, byte for byte, and no message is late."""
    mission = tmp_path / "twenty.yaml"
    mission.write_text(TWENTY)
    truths = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        with busy(2), Running("run", mission, *MAX, "--seed", "7", cwd=tmp_path / name) as running:
            assert running.wait(280) == 0, running.output
        assert "not come after" not in running.output
        truths += left_by(running, "truth.jsonl")
    assert truths == [virtual_truth(mission, 7, tmp_path / "7.jsonl")] * 2


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize("policy", ["continue", "land"])
def test_ten_of_thirty_two_are_killed_at_once(tmp_path: Path, policy: str) -> None:
    """While they form: their vehicles land by their own failsafe, the others go on without them, or
    land, and none comes too near another."""
    mission = tmp_path / "mission.yaml"
    text = (ROOT / "missions" / "thirtytwo.yaml").read_text()
    mission.write_text(text + f"policies: {{agent_lost: {policy}}}\n")
    dead = random.Random(1).sample(range(1, 33), 10)
    with Running("run", mission, *MAX, cwd=tmp_path) as running:
        running.wait_for_event("step 2:", 32)
        for agent in dead:
            running.kill(f"agent-{agent}")
        assert running.wait(800) == 1, running.output
        running.assert_nothing_left()
        outcomes = {end["agent"]: end["outcome"] for end in running.summary()["agents"]}
        assert_truth_ends_on_the_ground(running.folder)
        assert_apart(running.folder)
    lived = {outcomes[agent] for agent in range(1, 33) if agent not in dead}
    assert lived == {"completed" if policy == "continue" else "failed"}
