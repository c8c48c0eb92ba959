"""Agents started one by one by hand, as on real hosts: no `run`, no station, no shared parent."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from swarm_ctl.cli.app import app
from swarm_ctl.cli.flight.station import station
from swarm_ctl.errors import InputError
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.node import Node
from swarm_ctl.mesh.zenoh_transport import ZenohTransport
from swarm_ctl.mission.compile.loader import LoadedMission, load
from swarm_ctl.mission.compile.plan_file import named_by_hash, plan_to_json, read_plan
from swarm_ctl.runfolder.truth import load_truth
from tests.system.pair import BARE, SPEEDUP, agent, agent_in_waiting, ended, pair_mission, simulator
from tests.system.running import SWARM_CTL

pytestmark = pytest.mark.timeout(120)


@pytest.fixture
def mission(tmp_path: Path) -> LoadedMission:
    return pair_mission(tmp_path)


def listener_of(mission: LoadedMission, *channels: keys.Channel[Any]) -> Node:
    """A member of the agents' mesh that hears these channels."""
    meshes = [entry.mesh for entry in mission.fleet.agents if entry.mesh]
    node = Node(ZenohTransport([], meshes, time.monotonic), mission.plan.name, "listener")
    node.listen(*channels)
    return node


def test_two_agents_and_a_station_that_knows_the_mission(
    mission: LoadedMission, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both find each other within 2 s of the last start, fly the mission and exit 0; no `run` was
    needed. One has the mission file, the other only its hash: it fetches the plan from the station
    and keeps it, and addresses are options. A station without a run folder waits for them, tells
    their time and their flight, and sees the end.
    """
    speedup, epoch_s = SPEEDUP, time.monotonic()
    monkeypatch.setenv("SWARM_CTL_STATE", str(tmp_path / "state"))
    name, fleet = named_by_hash(mission.plan, mission.fleet), mission.fleet.agents
    own, peer = fleet[1], fleet[0]
    addresses = [f"--endpoint={own.endpoint}", f"--mesh={own.mesh}", f"--peer={peer.mesh}"]
    watching = subprocess.Popen(
        [SWARM_CTL, "station", "--mission", mission.source, "--json", "--speedup", str(speedup)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    agents = [
        agent(mission.source, 1, epoch_s, speedup),
        agent(Path(name[: len("pair@") + 12]), 2, epoch_s, speedup, *addresses),
    ]
    with (
        closing(listener_of(mission, keys.STATUS)) as listener,
        ended([simulator(mission, epoch_s, speedup), watching, *agents]),
    ):
        first: dict[int, float] = {}  # when each agent's first status came
        heard: dict[int, float] = {}  # when it first said that it hears its peer
        while len(heard) < 2:
            assert all(each.poll() is None for each in agents), [
                each.communicate()[1] for each in agents
            ]
            for status, _ in listener.take(keys.STATUS):
                first.setdefault(status.agent, status.time_s)
                if all(link.received for link in status.links.values()):
                    heard.setdefault(status.agent, status.time_s)
            time.sleep(0.01)
        # an agent's state is published once its vehicle's position is known, 3 s after the
        # simulator's start
        last_start = max(*first.values(), 3.0)
        assert max(heard.values()) - last_start < 2.0 * speedup
        assert [each.wait(60) for each in agents] == [0, 0]
        assert agents[1].stderr is not None
        assert f"agent: {name}, from a station" in agents[1].stderr.read().decode()
        assert read_plan(tmp_path / "state" / "plans" / f"{name}.json").plan == mission.plan
        flown = (time.monotonic() - epoch_s) * speedup
        watching.send_signal(signal.SIGINT)
        lines = [json.loads(line) for line in watching.communicate()[0].splitlines()]
        assert watching.returncode == 130
        assert lines[0]["verdict"] == "waiting for agents 1-2"
        assert abs(lines[-1]["time_s"] - flown) < 5.0
        assert {"takeoff", "form pair", "land"} <= {line["step_name"] for line in lines}
        assert not {alarm["name"] for line in lines for alarm in line["alarms"]} & {
            "other plan",
            "silent",
            "stranger",
        }


def test_an_agent_is_killed_and_started_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """SIGKILL while they form, started again by hand: it takes its vehicle over, both complete,
    apart; no station. All have the plan that was fetched before. Its link is signed: it signs on
    above its last stamp."""
    speedup, epoch_s = SPEEDUP, time.monotonic()
    mission = pair_mission(tmp_path, settle_s=5)  # it is killed before the step is done
    key = tmp_path / "mavlink.key"
    key.write_bytes(bytes(range(32)))
    key.chmod(0o600)
    signed = ("--signing-key", str(key))
    truth, plan = tmp_path / "truth.jsonl", Path(named_by_hash(mission.plan, mission.fleet))
    kept = tmp_path / "state" / "plans"
    monkeypatch.setenv("SWARM_CTL_STATE", str(kept.parent))
    kept.mkdir(parents=True)
    (kept / f"{plan}.json").write_text(plan_to_json(mission.plan, mission.fleet))
    flown = simulator(mission, epoch_s, speedup, key, truth_path=str(truth))
    agents = {i: agent(plan, i, epoch_s, speedup, *(signed if i == 1 else ())) for i in (1, 2)}
    again = agent_in_waiting(plan, 1, epoch_s, speedup, *signed)
    processes = [flown, again, *agents.values()]
    with closing(listener_of(mission, keys.STATUS, keys.EVENT)) as listener, ended(processes):
        forming: set[int] = set()
        while len(forming) < 2:
            assert all(each.poll() is None for each in agents.values()), [
                each.communicate()[1] for each in agents.values()
            ]
            forming |= {
                status.agent for status, _ in listener.take(keys.STATUS) if status.step == 2
            }
            time.sleep(0.01)
        agents[1].kill()
        agents[1].wait()
        agents[1] = again
        assert again.stdin is not None
        again.stdin.close()
        codes = [each.wait(60) for each in agents.values()]
        assert codes == [0, 0], [each.communicate()[1] for each in agents.values()]
        said = [event.text for event, _ in listener.take(keys.EVENT)]
        assert any(
            "took over its vehicle in the air; rejoins at step 2" in text for text in said
        ), said
        assert said.count("ended: completed") == 2
        assert flown.stdin is not None
        flown.stdin.close()  # its lifeline: it ends, and finishes the truth
        assert flown.wait(20) == 0
        r_in_m = mission.plan.law.r_in * mission.plan.unit_m
        assert min(load_truth(truth).minima.values()) > r_in_m


def test_ctrl_c_ends_the_wait_for_a_plan(mission: LoadedMission) -> None:
    """An agent that waits has no vehicle to look after: it ends at once."""
    at = mission.fleet.agents[0].mesh or ""
    waiting = agent(Path("pair@3fa9c1d2e4b5"), 1, time.monotonic(), 1.0, "--mesh", at)
    with ended([waiting]):
        assert waiting.stderr is not None
        assert waiting.stderr.readline().startswith(b"agent: waits 60 s for pair@3fa9c1d2e4b5")
        waiting.send_signal(signal.SIGINT)
        assert waiting.wait(10) == 130


def test_one_agent_lands_on_sigint(mission: LoadedMission) -> None:
    """Without its peer it waits on the ground; Ctrl-C ends it cleanly, and it says how."""
    alone = agent(mission.source, 1, time.monotonic(), 10.0)
    with ended([alone]):
        assert alone.stderr is not None
        assert alone.stderr.readline() == b"agent: ready\n"
        alone.send_signal(signal.SIGINT)
        assert alone.wait(30) == 0
        told = alone.stderr.read().decode()
        assert told.endswith("agent: aborted: Ctrl-C\n")


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (
            ["--mesh", "tcp/10.0.0.5"],
            "--mesh tcp/10.0.0.5: no endpoint of the mesh; allowed: tcp/HOST:PORT",
        ),
        (["--mesh", "tcp/10.0.0.5:99999"], "no endpoint of the mesh"),
        ([], "its fleet does not say where agents listen (`mesh`)"),
        (["runs/x", "--mesh", "tcp/10.0.0.5:7447"], "both a run folder"),
    ],
)
def test_a_station_needs_endpoints(tmp_path: Path, arguments: list[str], why: str) -> None:
    """As the fleet of the mission or the command line names them."""
    path = tmp_path / "bare.yaml"
    path.write_text(BARE)
    run = Path(arguments[0]) if arguments[0:1] == ["runs/x"] else None
    with pytest.raises(InputError, match=re.escape(why)):
        station(run, mission=path, mesh=arguments[-1:])


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["--id", "9"], "allowed: 1, 2"),
        (["--id", "1"], "has no `endpoint` in the fleet"),
        (["--id", "1", "--endpoint", "udpout:127.0.0.1:1"], "has no `mesh` in the fleet"),
    ],
)
@pytest.mark.parametrize("kind", ["plan", "mission"])
def test_an_agent_needs_its_addresses(
    kind: str, arguments: list[str], why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the fleet of either file, or as options; what is missing is named."""
    path, plan = tmp_path / "bare.yaml", tmp_path / "plan.json"
    path.write_text(BARE)
    loaded = load(path)
    plan.write_text(plan_to_json(loaded.plan, loaded.fleet))
    file = str(plan if kind == "plan" else path)
    monkeypatch.setattr("sys.argv", ["swarm-ctl", "agent", file, *arguments])
    with pytest.raises(InputError, match=re.escape(why)):
        app()
    monkeypatch.setattr("sys.argv", ["swarm-ctl", "agent", str(plan), "--fleet", "x", *arguments])
    with pytest.raises(InputError, match="is a plan file and has its fleet; allowed: --endpoint"):
        app()
