"""One mission on several hosts: agents, a station and perhaps a router in each network namespace,
their vehicles in the middle."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

from swarm_ctl.engine.launch.sim_config import place, vehicle_config
from swarm_ctl.mission.compile.loader import load
from tests.hosts.namespaces import Network
from tests.hosts.relay import Air
from tests.system.running import SWARM_CTL

_VEHICLES, _MESHES, _ROUTER = 14600, 7400, 7447
"""First ports: these namespaces have no other processes."""


class Links(StrEnum):
    """What the fleet says of the links between the hosts."""

    HOSTS = "host"
    """The agents' hosts alone."""
    ROUTERS = "udp router"
    """A router of each host."""
    TCP_ROUTERS = "tcp router"
    ONE_ROUTER = "one udp router"
    """Of the first host, for all agents."""
    ONE_TCP_ROUTER = "one tcp router"
    TCP = "tcp"
    """Where each agent listens."""


_ONE = (Links.ONE_ROUTER, Links.ONE_TCP_ROUTER)
_ROUTED = {Links.ROUTERS: "udp", Links.TCP_ROUTERS: "tcp"} | dict(
    zip(_ONE, ("udp", "tcp"), strict=True)
)


@dataclass(frozen=True)
class HostClock:
    """How the clock of a host stands to that of the first one, and when NTP steps its date by how
    much."""

    ahead_s: float = 0.0
    rate: float = 1.0
    step_s: float = 0.0
    step_at: Path | None = None
    """The date jumps when this file is there."""


_STEPPED_DATE = """\
import datetime, os, time
now = time.time
def stepped():
    return now() + (float(os.environ["STEP_S"]) if os.path.exists(os.environ["STEP_AT"]) else 0.0)
time.time = stepped
time.time_ns = lambda: int(stepped() * 1e9)
open(f"{os.environ['STEP_AT']}.{os.getpid()}", "a").close()
"""
"""A process with PYTHONPATH to this as `sitecustomize.py` has such a date, and leaves a file
with its number. The monotonic clock, by which missions are flown, is never stepped
(clock_gettime(2))."""


class Split:
    """A mission in flight. `sides`: the ids of the agents on each host; `mission`: its file's text
    without a fleet; `clocks`: by host, where they differ; `air`: from the start on."""

    def __init__(
        self,
        mission: str,
        sides: Sequence[Sequence[int]],
        where: Path,
        speedup: float,
        links: Links = Links.TCP,
        clocks: Mapping[int, HostClock] = MappingProxyType({}),
        air: Air | None = None,
    ) -> None:
        self._where, self._speedup, self._epoch_s = where, speedup, time.monotonic()
        self._links, self._clocks = links, clocks
        self.sides = sides
        self.truth_path = where / "truth.jsonl"
        """Where all vehicles have been."""
        self._open = ExitStack()
        self._processes: list[subprocess.Popen[bytes]] = []
        try:
            self.network = self._open.enter_context(Network(len(sides)))
            self._open.callback(self._kill)
            if air is not None:
                self.air(air)
            path = where / "split.yaml"
            path.write_text(mission + self._fleet())
            self.plan = load(path).plan
            self._simulator = self._simulate()
            self._path = path
            self.routers: dict[int, subprocess.Popen[bytes]] = {}
            if links in _ROUTED:
                for side in range(1 if links in _ONE else len(sides)):
                    self.start_router(side)
            self._stations = {side: self._station(side) for side in range(len(sides))}
            self._agents = {i: self._agent(i, side) for side, ids in enumerate(sides) for i in ids}
        except BaseException:
            self._open.close()
            raise

    def _fleet(self) -> str:
        lines = ["fleet:", "  agents:"]
        for side, ids in enumerate(self.sides):
            for i in ids:
                vehicle = f"udpout:{self.network.middle_address(side)}:{_VEHICLES + i}"
                lines.append(
                    f"    - {{id: {i}, endpoint: '{vehicle}', {self._place(i, side)}, "
                    f"autopilot: {self._autopilot(i)}}}"
                )
        return "\n".join(lines) + "\n"

    def _place(self, agent: int, side: int) -> str:
        """The agent on the mesh, as the fleet says it."""
        host = self.network.address(side)
        if self._links in _ROUTED:
            return f"host: {host}, router: '{self._router(side)}'"
        return {Links.HOSTS: f"host: {host}", Links.TCP: f"mesh: 'tcp/{host}:{_MESHES + agent}'"}[
            self._links
        ]

    def _router(self, side: int) -> str:
        host = self.network.address(0 if self._links in _ONE else side)
        return f"{_ROUTED[self._links]}/{host}:{_ROUTER}"

    @staticmethod
    def _autopilot(agent: int) -> str:
        return "ardupilot" if agent % 2 else "px4"

    def _simulate(self) -> subprocess.Popen[bytes]:
        plan, vehicles = self.plan, []
        for side, ids in enumerate(self.sides):
            for i in ids:
                endpoint = f"udpin:{self.network.middle_address(side)}:{_VEHICLES + i}"
                start = plan.agent(i).start
                at_m = (start[0] * plan.unit_m, start[1] * plan.unit_m)
                vehicles.append(vehicle_config(i, self._autopilot(i), endpoint, at_m, plan.origin))
        config = self._where / "sim.json"
        config.write_text(
            json.dumps(
                {
                    "version": 1,
                    "speedup": self._speedup,
                    "epoch_s": self._epoch_s,
                    "origin": place(plan.origin),
                    "sensing_range_m": plan.law.r * plan.unit_m,
                    "truth_path": str(self.truth_path),
                    "vehicles": vehicles,
                }
            )
        )
        command = self.network.middle.inside(
            [sys.executable, "-m", "swarm_sim", "--config", config]
        )
        return self._started(command, "simulator")

    def start_router(self, side: int) -> None:
        """Of a host; again, after it was killed."""
        words = [SWARM_CTL, "router", self._path, "--listen", self._router(side), "--open-mesh"]
        words += ["--speedup", str(self._speedup)]
        command = self.network.sides[side].inside(words)
        self.routers[side] = self._started(command, f"router-{side}")

    def _station(self, side: int) -> subprocess.Popen[bytes]:
        words = [SWARM_CTL, "station", "--mission", self._path, "--json", "--open-mesh"]
        words += ["--speedup", str(self._speedup)]
        return self._started(self.network.sides[side].inside(words), f"station-{side}")

    def _agent(self, agent: int, side: int) -> subprocess.Popen[bytes]:
        clock = self._clocks.get(side, HostClock())
        epoch_s = self._epoch_s - clock.ahead_s / self._speedup
        words = [SWARM_CTL, "agent", self._path, "--id", str(agent), "--open-mesh"]
        words += ["--speedup", str(self._speedup * clock.rate), "--epoch", str(epoch_s)]
        env = self._stepped(clock) if clock.step_at else None
        return self._started(self.network.sides[side].inside(words), f"agent-{agent}", env)

    def _stepped(self, clock: HostClock) -> dict[str, str]:
        date = self._where / "date"
        date.mkdir(exist_ok=True)
        (date / "sitecustomize.py").write_text(_STEPPED_DATE)
        path = os.pathsep.join([str(date), *filter(None, [os.environ.get("PYTHONPATH")])])
        return {"PYTHONPATH": path, "STEP_S": str(clock.step_s), "STEP_AT": str(clock.step_at)}

    def _started(
        self, command: list[str], name: str, env: Mapping[str, str] | None = None
    ) -> subprocess.Popen[bytes]:
        with (
            (self._where / f"{name}.out").open("wb") as out,
            (self._where / f"{name}.err").open("wb") as err,
        ):
            process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=out,
                stderr=err,
                env={**os.environ, **env} if env else None,
            )
        self._processes.append(process)
        return process

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def kill_host(self, side: int) -> None:
        """All that runs on it dies at once."""
        lost = [self._agents.pop(i) for i in self.sides[side]] + [self._stations.pop(side)]
        for process in [*lost, *([self.routers[side]] if side in self.routers else [])]:
            process.kill()

    def _kill(self) -> None:
        for process in self._processes:
            if process.poll() is None:
                process.kill()
            process.communicate()

    def air(self, air: Air) -> None:
        """So is the air between the hosts from now on."""
        self.network.air(air)

    def seen(self, side: int) -> dict[str, Any]:
        """What the station of this side has shown last (`swarm-ctl station --json`); {} before it
        has heard an agent."""
        lines = (self._where / f"station-{side}.out").read_bytes().split(b"\n")
        found: dict[str, Any] = json.loads(lines[-2]) if len(lines) > 1 else {}
        return found

    def agents(self, side: int) -> dict[int, dict[str, Any]]:
        """By id, as the station of this side sees them."""
        return {agent["id"]: agent for agent in self.seen(side).get("agents", [])}

    def own(self, side: int) -> list[dict[str, Any]]:
        """The agents of a side, as its station sees them."""
        seen = self.agents(side)
        return [seen[i] for i in self.sides[side] if i in seen]

    def said(self, agent: int) -> str:
        """What an agent has told its own terminal."""
        return (self._where / f"agent-{agent}.err").read_text()

    def wait_for(self, condition: Callable[[], bool], wall_s: float = 150.0) -> None:
        """AssertionError with what the stations show when it takes longer."""
        until = time.monotonic() + wall_s
        while not condition():
            if time.monotonic() > until:
                raise AssertionError(
                    f"not reached in {wall_s:g} s: {[self.seen(s) for s in range(len(self.sides))]}"
                )
            time.sleep(0.05)

    def wait_step(self, step: int, wall_s: float = 150.0) -> None:
        """Until every station sees its own agents in this step or beyond."""
        self.wait_for(
            lambda: all(
                len(own := self.own(side)) == len(ids)
                and all((agent["step"] or 0) >= step for agent in own)
                for side, ids in enumerate(self.sides)
            ),
            wall_s,
        )

    def wait_s(self, seconds: float) -> None:
        """Mission time."""
        time.sleep(seconds / self._speedup)

    def finish(self, wall_s: float = 90.0) -> dict[int, int]:
        """The agents' exit codes; then simulator and stations end, too, as they should."""
        until = time.monotonic() + wall_s
        try:
            codes = {
                i: agent.wait(max(0.1, until - time.monotonic()))
                for i, agent in self._agents.items()
            }
        except subprocess.TimeoutExpired:
            self.wait_for(lambda: False, 0.0)
            raise
        assert self._simulator.stdin is not None
        self._simulator.stdin.close()
        assert self._simulator.wait(30) == 0
        time.sleep(0.5)  # the stations show the last words they have heard
        for station in self._stations.values():
            os.kill(station.pid, signal.SIGINT)
            assert station.wait(10) == 130
        return codes

    @property
    def r_in_m(self) -> float:
        return self.plan.law.r_in * self.plan.unit_m
