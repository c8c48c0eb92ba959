"""Agents started one by one by hand, as on real hosts: no `run`, no station, no shared parent."""

from __future__ import annotations

import json
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from swarm_ctl.cli.station import station
from swarm_ctl.core.model.frames import geodetic_from_ned
from swarm_ctl.errors import InputError
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.node import Node
from swarm_ctl.mesh.zenoh_transport import ZenohTransport
from swarm_ctl.mission.compile.loader import LoadedMission, load
from swarm_ctl.report.folder.truth import load_truth
from tests.system.running import SWARM_CTL

pytestmark = pytest.mark.timeout(120)

MISSION = """
version: 1
name: pair
origin: {{lat_deg: 47.4, lon_deg: 8.5, alt_m: 400}}
unit_m: 5
law: {{r: 4.5, r_out: 1.5, r_in: 0.5}}
agents:
  - {{id: 1, start: [0, 0]}}
  - {{id: 2, start: [0, 3]}}
policies: {{agent_lost_after_s: 10}}
shapes:
  pair: {{kind: line, spacing: 2}}
steps:
  - takeoff: {{height_m: 5}}
  - form: {{shape: pair}}
  - land
fleet:
  agents:
    - {{id: 1, endpoint: "udpout:127.0.0.1:{vehicles[0]}", mesh: tcp/127.0.0.1:{meshes[0]}}}
    - {{id: 2, endpoint: "udpout:127.0.0.1:{vehicles[1]}", mesh: tcp/127.0.0.1:{meshes[1]}, autopilot: px4}}
"""


def two_free_ports(kind: socket.SocketKind) -> list[int]:
    with socket.socket(socket.AF_INET, kind) as one, socket.socket(socket.AF_INET, kind) as two:
        one.bind(("127.0.0.1", 0))
        two.bind(("127.0.0.1", 0))
        return [one.getsockname()[1], two.getsockname()[1]]


@pytest.fixture
def mission(tmp_path: Path) -> LoadedMission:
    path = tmp_path / "pair.yaml"
    path.write_text(
        MISSION.format(
            vehicles=two_free_ports(socket.SOCK_DGRAM), meshes=two_free_ports(socket.SOCK_STREAM)
        )
    )
    return load(path)


def simulator_config(mission: LoadedMission, epoch_s: float, speedup: float) -> dict[str, object]:
    plan = mission.plan
    vehicles = []
    for agent, entry in zip(plan.agents, mission.fleet.agents, strict=True):
        at = geodetic_from_ned(
            (agent.start[0] * plan.unit_m, agent.start[1] * plan.unit_m, 0.0), plan.origin
        )
        place = {"lat_deg": at.lat_deg, "lon_deg": at.lon_deg, "alt_m": at.alt_m}
        endpoint = (entry.endpoint or "").replace("udpout", "udpin")
        vehicles.append(
            {"sysid": entry.sysid, "persona": entry.autopilot, "endpoint": endpoint} | place
        )
    origin = {
        "lat_deg": plan.origin.lat_deg,
        "lon_deg": plan.origin.lon_deg,
        "alt_m": plan.origin.alt_m,
    }
    return {
        "version": 1,
        "speedup": speedup,
        "epoch_s": epoch_s,
        "origin": origin,
        "vehicles": vehicles,
    }


def test_two_agents_and_a_station_that_knows_the_mission(
    mission: LoadedMission, tmp_path: Path
) -> None:
    """Both find each other within 2 s of the last start, fly the mission and exit 0; no `run` was
    needed. A station without a run folder waits for them, tells their time and their flight, and
    sees the end.
    """
    speedup, epoch_s = 5.0, time.monotonic()
    config = tmp_path / "sim.json"
    config.write_text(json.dumps(simulator_config(mission, epoch_s, speedup)))
    listener = Node(
        ZenohTransport(
            [], [entry.mesh for entry in mission.fleet.agents if entry.mesh], time.monotonic
        ),
        mission.plan.name,
        "listener",
    )
    listener.listen(keys.STATUS)
    processes = [
        subprocess.Popen(
            [sys.executable, "-m", "sim", "--config", str(config)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
    ]
    watching = subprocess.Popen(
        [SWARM_CTL, "station", "--mission", mission.source, "--json", "--speedup", "5"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    processes.append(watching)
    try:
        agents = [
            subprocess.Popen(
                [
                    SWARM_CTL,
                    "agent",
                    mission.source,
                    "--id",
                    str(i),
                    "--speedup",
                    "5",
                    "--epoch",
                    str(epoch_s),
                ],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
            )
            for i in (1, 2)
        ]
        processes += agents
        first: dict[int, float] = {}  # when each agent's first status came
        heard: dict[int, float] = {}  # when it first said that it hears its peer
        while len(heard) < 2:
            assert all(agent.poll() is None for agent in agents), [
                a.communicate()[1] for a in agents
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
        assert [agent.wait(60) for agent in agents] == [0, 0]
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
    finally:
        listener.close()
        for process in processes:
            if process.poll() is None:
                process.kill()
            process.communicate()


def started(
    mission: LoadedMission, agent: int, speedup: float, epoch_s: float
) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [
            SWARM_CTL,
            "agent",
            mission.source,
            "--id",
            str(agent),
            "--speedup",
            str(speedup),
            "--epoch",
            str(epoch_s),
        ],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )


def test_an_agent_is_killed_and_started_again(mission: LoadedMission, tmp_path: Path) -> None:
    """SIGKILL while they form, started again by hand: it takes its vehicle over, both complete,
    apart; no station."""
    speedup, epoch_s = 2.0, time.monotonic()
    config, truth = tmp_path / "sim.json", tmp_path / "truth.jsonl"
    config.write_text(
        json.dumps(simulator_config(mission, epoch_s, speedup) | {"truth_path": str(truth)})
    )
    listener = Node(
        ZenohTransport(
            [], [entry.mesh for entry in mission.fleet.agents if entry.mesh], time.monotonic
        ),
        mission.plan.name,
        "listener",
    )
    listener.listen(keys.STATUS, keys.EVENT)
    simulator = subprocess.Popen(
        [sys.executable, "-m", "sim", "--config", str(config)],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    agents = {i: started(mission, i, speedup, epoch_s) for i in (1, 2)}
    processes = [simulator, *agents.values()]
    try:
        forming: set[int] = set()
        while len(forming) < 2:
            assert all(agent.poll() is None for agent in agents.values()), [
                a.communicate()[1] for a in agents.values()
            ]
            forming |= {
                status.agent for status, _ in listener.take(keys.STATUS) if status.step == 2
            }
            time.sleep(0.01)
        agents[1].kill()
        agents[1].wait()
        agents[1] = started(mission, 1, speedup, epoch_s)
        processes.append(agents[1])
        codes = [agent.wait(60) for agent in agents.values()]
        assert codes == [0, 0], [agent.communicate()[1] for agent in agents.values()]
        said = [event.text for event, _ in listener.take(keys.EVENT)]
        assert any(
            "took over its vehicle in the air; rejoins at step 2" in text for text in said
        ), said
        assert said.count("ended: completed") == 2
        assert simulator.stdin is not None
        simulator.stdin.close()  # its lifeline: it ends, and finishes the truth
        assert simulator.wait(20) == 0
        plan = mission.plan
        assert min(load_truth(truth).minima.values()) > plan.law.r_in * plan.unit_m
    finally:
        listener.close()
        for process in processes:
            if process.poll() is None:
                process.kill()
            process.communicate()


def test_one_agent_lands_on_sigint(mission: LoadedMission) -> None:
    """Without its peer it waits on the ground; Ctrl-C ends it cleanly, and it says how."""
    agent = subprocess.Popen(
        [SWARM_CTL, "agent", mission.source, "--id", "1"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert agent.stderr is not None
    try:
        assert agent.stderr.readline() == "agent: ready\n"
        agent.send_signal(signal.SIGINT)
        assert agent.wait(30) == 0
        assert (
            agent.stderr.read() == "agent: aborted: the process that started this agent is gone\n"
        )
    finally:
        agent.kill()
        agent.communicate()


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
    text = MISSION.format(vehicles=[1, 2], meshes=[3, 4])
    path = tmp_path / "bare.yaml"
    path.write_text(text[: text.index("fleet:")])
    with pytest.raises(InputError, match=re.escape(why)):
        station(
            *(Path(a) for a in arguments[:1] if not a.startswith("-")),
            mission=path,
            mesh=arguments[-1:],
        )


def test_an_agent_needs_its_endpoints(tmp_path: Path) -> None:
    """A fleet that does not name them is refused with what is missing."""
    text = MISSION.format(vehicles=[1, 2], meshes=[3, 4])
    path = tmp_path / "bare.yaml"
    path.write_text(text[: text.index("fleet:")])
    for arguments, words in ((["--id", "1"], "`endpoint`"), (["--id", "9"], "allowed: 1, 2")):
        done = subprocess.run(
            [SWARM_CTL, "agent", path, *arguments], capture_output=True, text=True, check=False
        )
        assert done.returncode == 2
        assert words in done.stderr
