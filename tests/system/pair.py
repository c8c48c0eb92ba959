"""Two agents, an ArduCopter and a PX4, started one by one by hand as on real hosts."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from swarm_ctl.engine.launch.ports import free_ports
from swarm_ctl.engine.launch.sim_config import simulator_config
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.node import Node
from swarm_ctl.mesh.zenoh_transport import ZenohTransport
from swarm_ctl.mission.compile.loader import LoadedMission, load
from tests.system.running import SWARM_CTL

MISSION = """
version: 1
name: pair
origin: {{lat_deg: 47.4, lon_deg: 8.5, alt_m: 400}}
unit_m: 5
tick_s: 0.1
law: {{r: 4.5, r_out: 1.5, r_in: 0.5}}
agents:
  - {{id: 1, start: [0, 0]}}
  - {{id: 2, start: [0, 3]}}
policies: {{agent_lost_after_s: 10}}
shapes:
  pair: {{kind: line, spacing: {spacing}}}
steps:
  - takeoff: {{height_m: 2}}
  - form: {{shape: pair, settle_s: {settle_s}, timeout_s: 900}}
  - land
fleet:
  agents:
    - {{id: 1, endpoint: "udpout:127.0.0.1:{vehicles[0]}", mesh: tcp/127.0.0.1:{meshes[0]}}}
    - id: 2
      endpoint: "udpout:127.0.0.1:{vehicles[1]}"
      mesh: tcp/127.0.0.1:{meshes[1]}
      autopilot: px4
"""
SPEEDUP = 2.0
"""Of a flight in real time that has to be completed. A busy machine stood still for 2.9 s once: at
three times the speed that is longer than a vehicle's own failsafe waits (5 s)."""
HELD_S = 600
"""Of the form step: the flight lasts until it is broken off, on a machine of any speed."""
BARE = MISSION.format(vehicles=[1, 2], meshes=[3, 4], spacing=2, settle_s=1).partition("fleet:")[0]
"""Without a fleet."""


def pair_mission(folder: Path, spacing: int = 2, settle_s: int = 1) -> LoadedMission:
    """The mission in `folder`, on free ports of this host. With a `spacing` of 3 units the vehicles
    form where they stand."""
    path = folder / "pair.yaml"
    vehicles, meshes = (free_ports(2, kind) for kind in (socket.SOCK_DGRAM, socket.SOCK_STREAM))
    where = {"vehicles": vehicles, "meshes": meshes}
    path.write_text(MISSION.format(**where, spacing=spacing, settle_s=settle_s))
    return load(path)


def listener_of(mission: LoadedMission, *channels: keys.Channel[Any]) -> Node:
    """A member of the agents' mesh that hears these channels."""
    meshes = [entry.mesh for entry in mission.fleet.agents if entry.mesh]
    node = Node(ZenohTransport([], meshes, time.monotonic), mission.plan.name, "listener")
    node.listen(*channels)
    return node


def simulator(
    mission: LoadedMission, epoch_s: float, speedup: float, key: Path | None = None, **more: Any
) -> subprocess.Popen[bytes]:
    """The simulator of the mission's vehicles; it ends with its stdin. The first one has the
    signing key."""
    settings = simulator_config(mission.plan, mission.fleet.agents, mission.file.simulation)
    if key is not None:
        settings["vehicles"][0]["signing_key_path"] = str(key)
    path = mission.source.with_name("sim.json")
    path.write_text(json.dumps(settings | {"epoch_s": epoch_s, "speedup": speedup} | more))
    return subprocess.Popen(
        [sys.executable, "-m", "swarm_sim", "--config", str(path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def agent(
    file: Path,
    agent_id: int,
    epoch_s: float,
    speedup: float,
    *more: str,
    command: Path = SWARM_CTL,
    env: dict[str, str] | None = None,
) -> subprocess.Popen[bytes]:
    """`swarm-ctl agent` with a plan or mission file."""
    clock = ("--epoch", str(epoch_s), "--speedup", str(speedup))
    return subprocess.Popen(
        [command, "agent", file, "--id", str(agent_id), *clock, *more],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        env=os.environ if env is None else env,
    )


def agent_in_waiting(
    plan: Path, agent_id: int, epoch_s: float, speedup: float, *more: str
) -> subprocess.Popen[bytes]:
    """The same with its imports done, which begins when its stdin ends: a vehicle's own failsafe
    waits for a new agent for 5 s only."""
    code = (
        "import sys, swarm_ctl.engine.agent.agent_process, swarm_ctl.mission.compile.plan_file;"
        "import swarm_ctl.engine.fetched_plan;"
        "from swarm_ctl.cli.app import app; sys.stdin.read(); app()"
    )
    options = ("--id", str(agent_id), "--epoch", str(epoch_s), "--speedup", str(speedup), *more)
    return subprocess.Popen(
        [sys.executable, "-c", code, "agent", plan, *options],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )


@contextmanager
def ended(processes: list[subprocess.Popen[Any]]) -> Iterator[None]:
    """All processes of the list are gone behind this block."""
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()
            for pipe in (process.stdin, process.stdout, process.stderr):
                if pipe is not None:
                    pipe.close()
