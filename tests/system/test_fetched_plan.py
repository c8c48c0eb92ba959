"""Agents that have no file: each fetches its plan from a station, by name and hash."""

from __future__ import annotations

import signal
import subprocess
import time
from contextlib import closing
from pathlib import Path

import pytest

from swarm_ctl.mesh import keys
from swarm_ctl.mission.compile.loader import load
from swarm_ctl.mission.compile.offers import named_by_hash
from tests.system.pair import agent, agent_in_waiting, ended, pair_mission, simulator
from tests.system.running import SWARM_CTL
from tests.system.test_agents_alone import listener_of

pytestmark = [pytest.mark.realtime, pytest.mark.timeout(90)]


def test_two_agents_fetch_their_plan_and_fly_on_without_the_station(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They know where they listen, and the plan's hash. The station connects to them, gives each
    the plan, and is killed while they form; so is agent 1, which starts again from what it kept,
    without a station, without an address, and takes its vehicle over in the air."""
    loaded = pair_mission(tmp_path, 3)
    text = loaded.source.read_text().replace("policies: {", "policies: {station_lost: continue, ")
    loaded.source.write_text(text)
    mission, speedup, epoch_s = load(loaded.source), 2.0, time.monotonic()
    name = Path(named_by_hash(mission.plan)[: len("pair@") + 6])
    monkeypatch.setenv("SWARM_CTL_STATE", str(tmp_path / "state"))
    meshes = [entry.mesh or "" for entry in mission.fleet.agents]
    agents = {
        1: agent(name, 1, epoch_s, speedup, "--mesh", meshes[0]),
        2: agent(name, 2, epoch_s, speedup, "--mesh", meshes[1]),
    }
    station = subprocess.Popen(
        [SWARM_CTL, "station", "--mission", mission.source, "--json", "--speedup", str(speedup)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    again = agent_in_waiting(name, 1, epoch_s, speedup)
    flown = [simulator(mission, epoch_s, speedup), station, again, *agents.values()]
    with closing(listener_of(mission, keys.STATUS, keys.EVENT)) as listener, ended(flown):
        forming: set[int] = set()
        while len(forming) < 2:
            assert all(each.poll() is None for each in agents.values()), [
                each.communicate()[1] for each in agents.values()
            ]
            forming |= {each.agent for each, _ in listener.take(keys.STATUS) if each.step == 2}
            time.sleep(0.01)
        station.kill()
        agents[1].kill()
        told = agents[1].communicate()[1].decode()
        assert f"agent: {named_by_hash(mission.plan)}, from a station" in told
        assert again.stdin is not None
        again.stdin.close()
        assert again.stderr is not None
        line = f"agent: {named_by_hash(mission.plan)}, fetched before: "
        assert again.stderr.readline().decode().startswith(line)
        said: list[str] = []
        while not any("took over its vehicle in the air" in text for text in said):
            assert again.poll() is agents[2].poll() is None, again.stderr.read()
            said += [event.text for event, _ in listener.take(keys.EVENT)]
            time.sleep(0.01)


def test_ctrl_c_ends_the_wait(tmp_path: Path) -> None:
    """An agent that waits for a plan has no vehicle to look after: it ends at once."""
    mission = pair_mission(tmp_path)
    at = mission.fleet.agents[0].mesh or ""
    waiting = agent(Path("pair@3fa9c1"), 1, time.monotonic(), 1.0, "--mesh", at)
    with ended([waiting]):
        assert waiting.stderr is not None
        assert waiting.stderr.readline().startswith(b"agent: waits 60 s for pair@3fa9c1")
        waiting.send_signal(signal.SIGINT)
        assert waiting.wait(10) == 130
