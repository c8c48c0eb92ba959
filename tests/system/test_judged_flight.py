"""A station that flies agents which were started elsewhere records, ends with them, and judges."""

from __future__ import annotations

import json
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from swarm_ctl.mesh import keys
from swarm_ctl.mesh.node import Node
from swarm_ctl.mission.compile.loader import LoadedMission, load
from swarm_ctl.mission.compile.plan_file import named_by_hash, plan_to_json, read_plan
from swarm_ctl.report.judge.summarise import summarise
from swarm_ctl.runfolder.last_statuses import STATUSES
from swarm_ctl.runfolder.manifest import read_manifest, write_manifest
from tests.system.pair import SPEEDUP, agent, ended, listener_of, pair_mission, simulator
from tests.system.running import SWARM_CTL

pytestmark = pytest.mark.timeout(120)
_APART_S = 600.0
"""Between the agents' clocks: more than this flight can last."""
_TRUTH = "from-the-simulator.jsonl"


@pytest.fixture
def vehicles(tmp_path: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A simulator of two vehicles, which ends by itself once they have flown."""
    mission = pair_mission(tmp_path, spacing=3, settle_s=8)  # of each step a station tells
    truth = str(tmp_path / _TRUTH)
    simulated = simulator(mission, time.monotonic(), SPEEDUP, truth_path=truth, once=True)
    with ended([simulated]):
        yield simulated


class Flown(NamedTuple):
    """What was started by hand, each by itself."""

    station: subprocess.Popen[str]
    """Records and judges; no mission lies where it is: it knows the plan alone."""
    watching: subprocess.Popen[str]
    """A station without a run folder."""
    agents: list[subprocess.Popen[bytes]]
    mission: LoadedMission
    began_s: float


@pytest.fixture
def flown(
    vehicles: subprocess.Popen[bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Flown]:
    """Two agents and stations. The agents' clocks began at different times, and before the
    simulator's; agent 2 has the plan's hash alone, and its addresses are options."""
    monkeypatch.setenv("SWARM_CTL_STATE", str(tmp_path / "state"))
    mission, now, plan = load(tmp_path / "pair.yaml"), time.monotonic(), tmp_path / "plan.json"
    plan.write_text(plan_to_json(mission.plan, mission.fleet))
    peer, own = mission.fleet.agents
    addresses = [f"--endpoint={own.endpoint}", f"--mesh={own.mesh}", f"--peer={peer.mesh}"]
    name = Path(named_by_hash(mission.plan, mission.fleet)[: len("pair@") + 12])
    known = {1: (mission.source, []), 2: (name, addresses)}
    record = f"--headless --runs {tmp_path}/runs --truth {tmp_path}/{_TRUTH}".split()
    stations = _station(plan, *record), _station(mission.source, "--json")
    agents = [
        agent(file, i, now - _APART_S / SPEEDUP * i, SPEEDUP, "--expect-station", *more)
        for i, (file, more) in known.items()
    ]
    with ended([*stations, *agents]):
        yield Flown(*stations, agents, mission, now)


def _station(mission: Path, *more: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [SWARM_CTL, "station", "--mission", mission, "--speedup", f"{SPEEDUP:g}", *more],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def _summary(folder: Path) -> dict[str, Any]:
    (run,) = (folder / "runs").iterdir()
    assert {path.name for path in run.iterdir()} >= {"run.json", "report.html", "recording.mcap"}
    found: dict[str, Any] = json.loads((run / "summary.json").read_text())
    return found


def test_it_ends_with_the_mission_and_judges_it(
    flown: Flown, vehicles: subprocess.Popen[bytes], tmp_path: Path
) -> None:
    """Exit code 0, and a whole run's folder. Both agents' steps and the truth stand on one clock,
    though their own are far apart; the distance is that of the places where they stood, by the
    truth and by the vehicles' estimates, and the simulator ends, too. The agents find each other
    within 2 s; the one that has the plan's hash alone fetches it from a station, and keeps it. A
    station that only watches waits for them, tells their time and flight, and sees the end."""
    with closing(listener_of(flown.mission, keys.STATUS)) as listener:
        find_each_other(flown, listener)
    out, errors = flown.station.communicate(timeout=90)
    assert flown.station.returncode == 0, out + errors
    told = [each.communicate(timeout=60)[1].decode() for each in flown.agents]
    assert [each.returncode for each in flown.agents] == [0, 0], told
    has_watched(flown)
    plan = flown.mission.plan
    name = named_by_hash(plan, flown.mission.fleet)
    assert f"agent: {name}, from a station" in told[1]
    assert read_plan(tmp_path / "state" / "plans" / f"{name}.json").plan == plan
    summary = _summary(tmp_path)
    assert summary["outcome"] == "completed"
    assert [each["account"] for each in summary["agents"]] == ["final", "final"]
    assert summary["judged_by"] == {"1": "truth", "2": "truth"}
    assert summary["min_distance_m"] == pytest.approx(15.0, abs=2.0)
    ends = [agent["time_s"] for agent in summary["agents"]]
    assert abs(ends[0] - ends[1]) < _APART_S / 2
    takeoff, form, landing = (summary["steps"][k]["start_s"] for k in (1, 2, 3))
    assert takeoff < summary["truth"]["first_liftoff_s"] < form
    assert landing < summary["truth"]["last_touchdown_s"] < max(ends)
    assert vehicles.wait(30) == 0

    (run,) = (tmp_path / "runs").iterdir()
    write_manifest(run, read_manifest(run).model_copy(update={"simulated": ()}))
    by_estimates = summarise(run)
    assert by_estimates.outcome == "completed"
    assert set(by_estimates.judged_by.values()) == {"estimates"}
    assert by_estimates.min_distance_m == pytest.approx(15.0, abs=2.0)


def find_each_other(flown: Flown, listener: Node) -> None:
    """Each hears the other soon after the last one's start."""
    first: dict[int, float] = {}  # when each agent's first status came
    heard: dict[int, float] = {}  # when it first said that it hears its peer
    while len(heard) < 2:
        assert all(each.poll() is None for each in flown.agents)
        for status, _ in listener.take(keys.STATUS):
            time_s = status.time_s - _APART_S * status.agent
            first.setdefault(status.agent, time_s)
            if all(link.received for link in status.links.values()):
                heard.setdefault(status.agent, time_s)
        time.sleep(0.01)
    # an agent's state is published once its vehicle's position is known, 3 s after the
    # simulator's start
    assert max(heard.values()) - max(*first.values(), 3.0) < 2.0 * SPEEDUP


def has_watched(flown: Flown) -> None:
    """The station without a run folder; its time is that of the agent it heard first."""
    flown_s = (time.monotonic() - flown.began_s) * SPEEDUP
    flown.watching.send_signal(signal.SIGINT)
    lines = [json.loads(line) for line in flown.watching.communicate()[0].splitlines()]
    assert flown.watching.returncode == 130
    assert lines[0]["verdict"] == "waiting for agents 1-2"
    assert min(abs(lines[-1]["time_s"] - flown_s - _APART_S * i) for i in (1, 2)) < 5.0
    assert {"takeoff", "form pair", "land"} <= {line["step_name"] for line in lines}
    alarms = {alarm["name"] for line in lines for alarm in line["alarms"]}
    assert not alarms & {"other plan", "silent", "stranger"}


@pytest.mark.long
def test_sigterm_lands_the_swarm(flown: Flown, tmp_path: Path) -> None:
    """As `docker stop` sends it: the agents land, then the station ends with 130."""
    station = flown.station
    while not _airborne(tmp_path):
        assert station.poll() is None
        time.sleep(0.05)
    station.send_signal(signal.SIGTERM)
    out, errors = station.communicate(timeout=60)
    assert station.returncode == 130, out + errors
    summary = _summary(tmp_path)
    assert summary["outcome"] == "aborted"
    assert not any(agent["armed"] for agent in summary["agents"])


def _airborne(folder: Path) -> bool:
    lines = [
        line
        for path in folder.glob(f"runs/*/{STATUSES}")
        for line in path.read_text().splitlines(True)
    ]
    return any(json.loads(line)["airborne"] for line in lines if line.endswith("\n"))
