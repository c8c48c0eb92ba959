"""ROS 2 beside a swarm of real processes: agents that tell their own drones, and a station with
them. A router as rmw_zenoh's is there, and who reads needs none of this package."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Self

import pytest

pytest.importorskip("rosbags", reason="the extra `ros2` is not installed")

import zenoh
from rosbags.typesys import Stores, get_typestore
from typer.testing import CliRunner

from swarm_ctl.cli.app import app
from swarm_ctl.engine.launch.ports import free_ports
from tests.system.pair import HELD_S, SPEEDUP, agent, ended, pair_mission, simulator
from tests.system.running import SWARM_CTL

pytestmark = [pytest.mark.realtime, pytest.mark.timeout(120)]
STORE = get_typestore(Stores.ROS2_JAZZY)
DOMAIN = 31


class Graph:
    """A domain of ROS 2 as another program sees it: its publishers, and the messages."""

    def __init__(self, port: int) -> None:
        self.where = f'connect/endpoints=["tcp/127.0.0.1:{port}"]'
        self._lock = threading.Lock()
        self._tokens = set[str]()
        self._told = defaultdict[str, list[Any]](list)
        config = zenoh.Config()
        settings = {"mode": "router", "listen/endpoints": [f"tcp/127.0.0.1:{port}"]}
        for key, value in (settings | {"scouting/multicast/enabled": False}).items():
            config.insert_json5(key, json.dumps(value))
        self._router = zenoh.open(config)
        tokens, messages = f"@ros2_lv/{DOMAIN}/**", f"{DOMAIN}/**"
        self._seen = self._router.liveliness().declare_subscriber(tokens, self._see, history=True)
        self._ear = self._router.declare_subscriber(messages, self._hear)

    def _see(self, sample: zenoh.Sample) -> None:
        there = sample.kind == zenoh.SampleKind.PUT
        with self._lock:
            (self._tokens.add if there else self._tokens.discard)(str(sample.key_expr))

    def _hear(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        package, name = re.findall(r"/(\w+)::msg::dds_::(\w+)_/", key)[0]
        kind = f"{package}/msg/{name}"
        message: Any = STORE.deserialize_cdr(sample.payload.to_bytes(), kind)
        with self._lock:
            self._told[key.removeprefix(f"{DOMAIN}").rsplit("/", 2)[0]].append(message)

    def publishers(self) -> dict[str, list[str]]:
        """By topic: the nodes that announce that they publish it."""
        with self._lock:
            tokens = [each.split("/") for each in self._tokens if "/MP/" in each]
        nodes = defaultdict[str, list[str]](list)
        for token in tokens:
            nodes[token[9].replace("%", "/")].append(token[8])
        return {topic: sorted(names) for topic, names in nodes.items()}

    def services(self) -> set[str]:
        """With the node that serves each."""
        with self._lock:
            told = [each.split("/") for each in self._tokens if "/SS/" in each]
        return {f"{each[8]}:{each[9].replace('%', '/')}" for each in told}

    def told(self, topic: str) -> list[Any]:
        """The messages so far."""
        with self._lock:
            return [*self._told[topic]]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._router.close()  # type: ignore[no-untyped-call]


@pytest.fixture
def graph() -> Iterator[Graph]:
    (port,) = free_ports(1, socket.SOCK_STREAM)
    with Graph(port) as made:
        yield made


def until(true: Callable[[], object], processes: list[subprocess.Popen[Any]]) -> None:
    """Wait for it; fails where a process ends before."""
    end = time.monotonic() + 40.0
    while not true():
        assert all(each.poll() is None for each in processes)
        assert time.monotonic() < end
        time.sleep(0.05)


def companion_of(process: subprocess.Popen[Any]) -> int:
    """The process beside an agent."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    (found,) = (
        int(pid)
        for pid in children
        if b"companion_process" in Path(f"/proc/{pid}/cmdline").read_bytes()
    )
    return found


def test_an_agent_tells_its_own_drone_and_a_station_the_others(
    tmp_path: Path, graph: Graph, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No topic of a drone has two publishers at a time. Agent 1 tells ROS 2; a station comes and
    tells drone 2 alone. What is beside agent 1 is killed: the station tells both, and the agent
    flies on until it is told to land."""
    monkeypatch.setenv("ZENOH_CONFIG_OVERRIDE", graph.where)
    mission, epoch_s = pair_mission(tmp_path, 3, HELD_S), time.monotonic()
    flown = simulator(mission, epoch_s, 1.0)
    first = agent(mission.source, 1, epoch_s, 1.0, "--ros2", str(DOMAIN))
    second = agent(mission.source, 2, epoch_s, 1.0)
    agents = [first, second]
    with ended([flown, *agents]):
        until(lambda: graph.told("/drone_1/fix"), agents)
        beside = companion_of(first)
        node = "swarm_ctl_drone_1"
        told = {f"/drone_1/{each}": [node] for each in ("pose", "odom", "fix")}
        shared = {each: [node] for each in ("/tf", "/swarm/markers", "/diagnostics")}
        until(lambda: graph.publishers() == told | shared, agents)
        drawn = [m for each in graph.told("/swarm/markers") for m in each.markers]
        assert {m.id for m in drawn} == {1}
        assert not graph.services()
        command = [str(SWARM_CTL), "station", "--mission", str(mission.source), "--json"]
        station = subprocess.Popen(
            [*command, "--ros2", str(DOMAIN)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        with ended([station]):
            alive = [*agents, station]
            told |= {f"/drone_2/{each}": ["swarm_ctl"] for each in ("pose", "odom", "fix")}
            both = {each: ["swarm_ctl", node] for each in shared}
            until(lambda: graph.publishers() == told | both, alive)
            until(lambda: graph.told("/drone_2/fix"), alive)
            os.kill(beside, signal.SIGKILL)
            until(lambda: graph.publishers() == {key: ["swarm_ctl"] for key in told | both}, alive)
            for each in agents:
                each.send_signal(signal.SIGINT)
            said = [each.communicate(timeout=60)[1] for each in agents]
            assert [each.returncode for each in agents] == [0, 0], said
            assert all(each.endswith(b"agent: aborted: Ctrl-C\n") for each in said)
    diagnosed = {s.name: s for each in graph.told("/diagnostics") for s in each.status}
    assert {"swarm_ctl: agent 1", "swarm_ctl: drone 1", "swarm_ctl: swarm"} <= diagnosed.keys()


def test_what_is_beside_an_agent_ends_with_it(
    tmp_path: Path, graph: Graph, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An agent that is killed leaves no process; one whose companion hangs flies on."""
    monkeypatch.setenv("ZENOH_CONFIG_OVERRIDE", graph.where)
    mission, epoch_s = pair_mission(tmp_path, 3, HELD_S), time.monotonic()
    flown = simulator(mission, epoch_s, SPEEDUP)
    second = agent(mission.source, 2, epoch_s, SPEEDUP, "--ros2", str(DOMAIN))
    with ended([flown, second]):
        # mission time has its own pace, and one node tells it: the first agent's, once it is there
        until(lambda: graph.publishers().get("/clock") == ["swarm_ctl_drone_2"], [second])
        first = agent(mission.source, 1, epoch_s, SPEEDUP, "--ros2", str(DOMAIN))
        agents = [first, second]
        with ended([first]):
            until(lambda: graph.publishers().get("/clock") == ["swarm_ctl_drone_1"], agents)
            until(lambda: graph.told("/drone_1/pose") and graph.told("/drone_2/pose"), agents)
            hung, other = (companion_of(each) for each in agents)
            os.kill(hung, signal.SIGSTOP)
            try:
                second.kill()
                until(lambda: not Path(f"/proc/{other}").exists(), [])
                assert first.wait(60) == 1  # its mission needs the other; it lands
            finally:
                os.kill(hung, signal.SIGKILL)


def test_an_agent_takes_no_orders(tmp_path: Path) -> None:
    """Nothing flies then."""
    given = ["agent", str(pair_mission(tmp_path).source), "--id", "1", "--ros2=0,orders"]
    words = "ros2=0,orders: is no domain of ROS 2; allowed: 0 to 232"
    assert str(CliRunner().invoke(app, given).exception) == words
