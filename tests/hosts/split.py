"""One mission on several hosts: agents and a station in each network namespace, their vehicles in
the middle."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self

from swarm_ctl.mission.compile.loader import load
from swarm_ctl.runtime.launch.sim_config import place, vehicle_config
from tests.hosts.namespaces import Network
from tests.hosts.relay import Air
from tests.system.running import SWARM_CTL

_VEHICLES, _MESHES = 14600, 7400
"""First ports: these namespaces have no other processes."""


class Split:
    """A mission in flight. `sides`: the ids of the agents on each host; `mission`: its file's text
    without a fleet."""

    def __init__(
        self, mission: str, sides: Sequence[Sequence[int]], where: Path, speedup: float
    ) -> None:
        self._where, self._speedup, self._epoch_s = where, speedup, time.monotonic()
        self.sides = sides
        self.truth_path = where / "truth.jsonl"
        """Where all vehicles have been."""
        self._open = ExitStack()
        self._processes: list[subprocess.Popen[bytes]] = []
        try:
            self.network = self._open.enter_context(Network(len(sides)))
            self._open.callback(self._kill)
            path = where / "split.yaml"
            path.write_text(mission + self._fleet())
            self.plan = load(path).plan
            self._simulator = self._simulate()
            self._stations = [self._station(side, path) for side in range(len(sides))]
            self._agents = {
                i: self._agent(i, side, path) for side, ids in enumerate(sides) for i in ids
            }
        except BaseException:
            self._open.close()
            raise

    def _fleet(self) -> str:
        lines = ["fleet:", "  agents:"]
        for side, ids in enumerate(self.sides):
            for i in ids:
                vehicle = f"udpout:{self.network.middle_address(side)}:{_VEHICLES + i}"
                mesh = f"tcp/{self.network.address(side)}:{_MESHES + i}"
                lines.append(
                    f"    - {{id: {i}, endpoint: '{vehicle}', mesh: {mesh}, "
                    f"autopilot: {self._autopilot(i)}}}"
                )
        return "\n".join(lines) + "\n"

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

    def _station(self, side: int, path: Path) -> subprocess.Popen[bytes]:
        words = [SWARM_CTL, "station", "--mission", path, "--json", "--open-mesh"]
        words += ["--speedup", str(self._speedup)]
        return self._started(self.network.sides[side].inside(words), f"station-{side}")

    def _agent(self, agent: int, side: int, path: Path) -> subprocess.Popen[bytes]:
        words = [SWARM_CTL, "agent", path, "--id", str(agent)]
        words += ["--speedup", str(self._speedup), "--epoch", str(self._epoch_s), "--open-mesh"]
        return self._started(self.network.sides[side].inside(words), f"agent-{agent}")

    def _started(self, command: list[str], name: str) -> subprocess.Popen[bytes]:
        with (
            (self._where / f"{name}.out").open("wb") as out,
            (self._where / f"{name}.err").open("wb") as err,
        ):
            process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=out, stderr=err)
        self._processes.append(process)
        return process

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

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

    def wait_step(self, step: int) -> None:
        """Until every station sees its own agents in this step or beyond."""
        self.wait_for(
            lambda: all(
                len(own := self.own(side)) == len(ids)
                and all((agent["step"] or 0) >= step for agent in own)
                for side, ids in enumerate(self.sides)
            )
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
        for station in self._stations:
            os.kill(station.pid, signal.SIGINT)
            assert station.wait(10) == 130
        return codes

    @property
    def r_in_m(self) -> float:
        return self.plan.law.r_in * self.plan.unit_m
